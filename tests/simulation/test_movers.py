"""Discs that drift about a room, as in the dynamic test of a planner: they bounce, and stay inside."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A, ChairBody
from waychair.geometry import transform_points, wrap_angle
from waychair.simulation.people.people import CONTACT_GAP, HEADING_NS, SimulatedPeople
from waychair.simulation.scene.scene import PersonBehaviour, PersonPlan, PersonState
from waychair.types import FloatArray, OccupancyGrid, Pose2, Twist

TICK_NS = 50_000_000
TICK = 0.05
AWAY = Pose2(1000.0, 1000.0, 0.0)
"""A place at which a chair is in no mover's way."""

ROBOT = ChairBody(
    length=0.3, width=0.3, axle_from_rear=0.15, track=0.25, wheel_radius=0.03, laser_x=0.0, camera_x=0.0, camera_y=0.0
)


def _room(length: float, width: float) -> OccupancyGrid:
    """Free ground [0, length] x [0, width] within walls of 0.2 m."""
    cells = np.full((round(width / 0.05) + 8, round(length / 0.05) + 8), 100, np.int8)
    cells[4:-4, 4:-4] = 0
    return OccupancyGrid(cells, 0.05, Pose2(-0.2, -0.2, 0.0))


def _disc(x: float, y: float, speed: float = 0.15) -> PersonPlan:
    return PersonPlan(PersonBehaviour.BOUNCE, np.array([[x, y]]), speed, radius=0.15)


def _people(grid: OccupancyGrid, *plans: PersonPlan, seed: int = 0, body: ChairBody = CHAIR_A) -> SimulatedPeople:
    return SimulatedPeople(plans, grid, body, np.random.default_rng(seed))


def _watch(people: SimulatedPeople, seconds: float, pose: Pose2 = AWAY) -> Iterator[tuple[PersonState, ...]]:
    for _ in range(round(seconds / TICK)):
        people.step(TICK_NS, pose, Twist())
        yield people.states


def _positions(states: tuple[PersonState, ...]) -> FloatArray:
    return np.array([[state.pose.x, state.pose.y] for state in states])


def _smallest_gap(states: tuple[PersonState, ...]) -> float:
    gaps = [
        math.dist((a.pose.x, a.pose.y), (b.pose.x, b.pose.y)) - a.radius - b.radius
        for i, a in enumerate(states)
        for b in states[:i]
    ]
    return min(gaps, default=math.inf)


def _gap_to_chair(state: PersonState, chair: Pose2, body: ChairBody) -> float:
    """Distance [m] of the disc from the outline; as deep as the disc at most where it is inside."""
    x, y = transform_points(chair.inverse(), np.array([[state.pose.x, state.pose.y]]))[0]
    outside = math.hypot(max(x - body.front, -body.rear - x, 0.0), max(abs(y) - body.width / 2, 0.0))
    return outside - state.radius


def _movers(count: int, seed: int) -> SimulatedPeople:
    """A room of 3 x 3 m with discs of 0.30 m that drift at 0.15 m/s."""
    places = [(0.4 + 0.7 * (i % 4), 0.4 + 0.7 * (i // 4)) for i in range(count)]
    plans = [_disc(*place) for place in places]
    return _people(_room(3.0, 3.0), *plans, seed=seed, body=ROBOT)


@pytest.mark.parametrize("count", [3, *(pytest.param(n, marks=pytest.mark.nightly) for n in (1, 10))])
def test_movers_stay_in_their_room_at_their_speed_for_ten_minutes(count: int) -> None:
    people = _movers(count, seed=count)
    states = list(_watch(people, 600.0))
    tracks = np.array([_positions(crowd) for crowd in states])
    assert tracks.min() >= 0.15 - 1e-9
    assert tracks.max() <= 2.85 + 1e-9
    assert min(map(_smallest_gap, states[::10])) >= -2e-9
    walked = np.hypot(*np.diff(tracks, axis=0).reshape(-1, 2).T).sum() / (600.0 * count)
    assert walked == pytest.approx(0.15, rel=0.005)
    assert all(state.speed == pytest.approx(0.15) for state in states[-1])


def test_movers_change_their_heading_every_two_seconds_and_otherwise_only_by_bouncing() -> None:
    grid = _room(40.0, 40.0)
    people = _people(grid, _disc(20.0, 20.0))
    headings = np.array([state.pose.theta for (state,) in _watch(people, 200.0)])
    period = HEADING_NS // TICK_NS
    new = np.flatnonzero(np.abs(np.diff(headings)) > 1e-9) + 1
    assert np.array_equal(new % period, np.full(len(new), period - 1))
    assert len(new) >= 98  # nearly every draw differs from the one before
    draws = np.unique(headings.round(9))
    assert abs(np.exp(1j * draws).mean()) < 0.25  # all headings are equally likely


def test_a_wall_reflects_a_mover_like_a_mirror_reflects_light() -> None:
    people = _people(_room(3.0, 3.0), _disc(0.2, 1.5), seed=2)
    before, theta = people.states[0], people.states[0].pose.theta
    assert math.cos(theta) < -0.2
    track = [state for (state,) in _watch(people, 1.9)]
    assert min(state.pose.x for state in track) == pytest.approx(0.15, abs=1e-3)
    assert wrap_angle(track[-1].pose.theta - (math.pi - theta)) == pytest.approx(0.0, abs=1e-9)
    assert track[-1].pose.y - before.pose.y == pytest.approx(0.15 * 1.9 * math.sin(theta), abs=1e-3)


@pytest.mark.parametrize("seed", range(6))
def test_a_mover_that_is_hit_bounces_back_like_the_one_that_hits_it(seed: int) -> None:
    def pair(place: tuple[float, float]) -> SimulatedPeople:
        return _people(
            _room(6.0, 6.0),
            _disc(3.0, 3.0),
            _disc(*place, speed=1e-6),
            seed=seed,
        )

    first, second = (state.pose.theta for state in pair((1.0, 1.0)).states)
    ahead = np.array([math.cos(first), math.sin(first)])
    people = pair((3.0 + 0.4 * ahead[0], 3.0 + 0.4 * ahead[1]))
    *_, (hitting, hit) = _watch(people, 1.9)
    assert wrap_angle(hitting.pose.theta - first - math.pi) == pytest.approx(0.0, abs=1e-3)
    came = np.array([math.cos(second), math.sin(second)])
    goes = came - 2.0 * min(float(came @ ahead), 0.0) * ahead
    assert wrap_angle(hit.pose.theta - math.atan2(goes[1], goes[0])) == pytest.approx(0.0, abs=1e-3)


def test_a_mover_may_touch_the_robot_but_bounces_back() -> None:
    people = _movers(10, seed=1)
    robot = Pose2(1.5, 1.85, 0.3)
    near = math.inf
    for crowd in _watch(people, 120.0, robot):
        near = min(near, *(_gap_to_chair(state, robot, ROBOT) for state in crowd))
    assert -2e-9 <= near < CONTACT_GAP
