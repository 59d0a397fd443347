"""The people: each behaviour, and no person walks through an obstacle."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A, ChairBody
from waychair.errors import WorldError
from waychair.geometry import transform_points, wrap_angle
from waychair.simulation.people.people import CONTACT_GAP, STRIDE, SimulatedPeople
from waychair.simulation.people.walking import STOP_DISTANCE, TURN_RATE, WAIT_LIMIT
from waychair.simulation.scene.scene import PersonBehaviour, PersonPlan, PersonState
from waychair.types import FloatArray, OccupancyGrid, Pose2, Twist

TICK_NS = 50_000_000
TICK = 0.05
AWAY = Pose2(1000.0, 1000.0, 0.0)
"""A place at which a chair is in no person's way."""
STILL = Twist()


def _room(length: float, width: float) -> OccupancyGrid:
    """Free ground [0, length] x [0, width] within walls of 0.2 m."""
    cells = np.full((round(width / 0.05) + 8, round(length / 0.05) + 8), 100, np.int8)
    cells[4:-4, 4:-4] = 0
    return OccupancyGrid(cells, 0.05, Pose2(-0.2, -0.2, 0.0))


def _with_wall(grid: OccupancyGrid, x: float, door: tuple[float, float]) -> OccupancyGrid:
    """The room with a wall of 0.1 m across it at x, except for a door from y to y."""
    cells = grid.cells.copy()
    column = round((x + 0.2) / 0.05)
    low, high = (round((y + 0.2) / 0.05) for y in door)
    cells[:low, column : column + 2] = 100
    cells[high:, column : column + 2] = 100
    return OccupancyGrid(cells, grid.resolution, grid.map_from_grid)


def _plan(behaviour: PersonBehaviour, *points: tuple[float, float], **more: float | bool) -> PersonPlan:
    return PersonPlan(behaviour, np.array(points, float), **more)  # type: ignore[arg-type]


def _people(grid: OccupancyGrid, *plans: PersonPlan, seed: int = 0, body: ChairBody = CHAIR_A) -> SimulatedPeople:
    return SimulatedPeople(plans, grid, body, np.random.default_rng(seed))


def _watch(
    people: SimulatedPeople, seconds: float, pose: Pose2 = AWAY, twist: Twist = STILL
) -> Iterator[tuple[PersonState, ...]]:
    for _ in range(round(seconds / TICK)):
        people.step(TICK_NS, pose, twist)
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


def _gap_to_chair(state: PersonState, chair: Pose2, body: ChairBody = CHAIR_A) -> float:
    """Distance [m] of the disc from the outline; as deep as the disc at most where it is inside."""
    x, y = transform_points(chair.inverse(), np.array([[state.pose.x, state.pose.y]]))[0]
    outside = math.hypot(max(x - body.front, -body.rear - x, 0.0), max(abs(y) - body.width / 2, 0.0))
    return outside - state.radius


def _gap_to_walls(state: PersonState, grid: OccupancyGrid) -> float:
    """Distance [m] of the disc from the nearest solid cell, and from the border of the grid, by a search of all."""
    point = transform_points(grid.map_from_grid.inverse(), np.array([[state.pose.x, state.pose.y]]))[0]
    low = np.argwhere(grid.cells >= 65)[:, ::-1] * grid.resolution
    to_cells = np.hypot(*(point - np.clip(point, low, low + grid.resolution)).T).min(initial=math.inf)
    to_border = min(*point, *(np.array(grid.cells.shape)[::-1] * grid.resolution - point))
    return float(min(to_cells, to_border)) - state.radius


def _assert_plausible(tracks: list[FloatArray]) -> None:
    """No faster than 1.5 m/s and no acceleration above 3 m/s^2, from positions (T, N, 2) at every tick."""
    velocities = np.diff(np.array(tracks), axis=0) / TICK
    assert np.hypot(velocities[..., 0], velocities[..., 1]).max() <= 1.5 + 1e-9
    accelerations = np.diff(velocities, axis=0) / TICK
    assert np.hypot(accelerations[..., 0], accelerations[..., 1]).max() <= 3.0


# ---- along a path


@pytest.mark.parametrize("speed", [0.3, 1.0, 1.5])
def test_a_walker_goes_back_and_forth_along_its_path_with_smooth_turns(speed: float) -> None:
    people = _people(
        _room(8.0, 6.0), _plan(PersonBehaviour.PATH, (1.0, 1.0), (6.0, 1.0), (6.0, 5.0), (2.0, 3.0), speed=speed)
    )
    states = [state for (state,) in _watch(people, 60.0 / speed)]
    tracks = [np.array([[state.pose.x, state.pose.y]]) for state in states]
    _assert_plausible(tracks)
    to_end, to_begin = (np.hypot(*(np.array(tracks)[:, 0] - end).T) for end in ((2.0, 3.0), (1.0, 1.0)))
    there = int(np.argmax(to_end < 0.01))
    assert 0 < there < 13.5 / speed / TICK * 1.3 + 100
    assert to_begin[there:].min() < 0.01
    headings = [state.pose.theta for state in states]
    turns = [abs(wrap_angle(b - a)) for a, b in pairwise(headings)]
    assert max(turns) <= TURN_RATE * TICK + 1e-9
    for before, after in pairwise(states):
        ahead = transform_points(before.pose.inverse(), np.array([[after.pose.x, after.pose.y]]))[0, 0]
        assert ahead >= -1e-9  # never backwards
    assert max(state.speed for state in states) == pytest.approx(speed)


def test_a_yielding_walker_and_a_standing_chair_head_on_in_a_corridor_never_touch() -> None:
    chair = Pose2(6.0, 1.0, math.pi)
    people = _people(_room(12.0, 2.0), _plan(PersonBehaviour.PATH, (1.0, 1.0), (11.0, 1.0)))
    states = [state for (state,) in _watch(people, 40.0, chair)]
    _assert_plausible([np.array([[state.pose.x, state.pose.y]]) for state in states])
    gaps = [_gap_to_chair(state, chair) for state in states]
    assert STOP_DISTANCE < min(gaps) < STOP_DISTANCE + 0.2
    # It waits, and then goes back to where it began.
    nearest = int(np.argmin(gaps))
    assert states[nearest].pose.x == pytest.approx(states[nearest + int((WAIT_LIMIT - 1.0) / TICK)].pose.x)
    assert min(state.pose.x for state in states[nearest:]) < 1.05


def test_a_yielding_walker_walks_on_when_the_chair_has_gone() -> None:
    people = _people(_room(12.0, 2.0), _plan(PersonBehaviour.PATH, (1.0, 1.0), (11.0, 1.0)))
    for _ in _watch(people, 7.0, Pose2(6.0, 1.0, math.pi)):
        pass
    assert people.states[0].speed == 0.0
    assert max(state.pose.x for (state,) in _watch(people, 10.0)) > 10.9


def test_a_yielding_walker_passes_a_chair_that_leaves_room() -> None:
    people = _people(_room(12.0, 2.0), _plan(PersonBehaviour.PATH, (1.0, 1.5), (11.0, 1.5)))
    states = [state for (state,) in _watch(people, 14.0, Pose2(6.0, 0.5, math.pi))]
    assert max(state.pose.x for state in states) > 10.9
    assert min(state.speed for state in states[40:160]) > 0.9


def test_a_walker_that_does_not_yield_walks_up_to_the_chair_and_touches_but_does_not_enter_it() -> None:
    chair = Pose2(6.0, 1.1, 2.8)
    people = _people(_room(12.0, 2.0), _plan(PersonBehaviour.PATH, (1.0, 1.0), (11.0, 1.0), yields=False, speed=1.3))
    gaps = np.array([_gap_to_chair(state, chair) for (state,) in _watch(people, 20.0, chair)])
    assert -2e-9 <= gaps.min() < CONTACT_GAP
    assert (gaps < CONTACT_GAP).sum() >= WAIT_LIMIT / TICK
    # After that it goes home.
    assert gaps[np.argmin(gaps) :].max() > 3.0


def test_two_walkers_who_meet_stop_before_contact_and_turn_back() -> None:
    people = _people(
        _room(12.0, 2.0),
        _plan(PersonBehaviour.PATH, (1.0, 1.0), (11.0, 1.0)),
        _plan(PersonBehaviour.PATH, (11.0, 1.0), (1.0, 1.0), speed=0.8),
    )
    states = list(_watch(people, 30.0))
    assert min(map(_smallest_gap, states)) > 0.1
    assert max(pair[0].pose.x for pair in states) < 9.0
    turned_back = max(range(len(states)), key=lambda i: states[i][0].pose.x)
    assert min(pair[0].pose.x for pair in states[turned_back:]) < 1.05


def test_a_walker_before_a_closed_door_turns_back() -> None:
    room = _room(8.0, 3.0)
    closed = _with_wall(room, 4.0, (1.5, 1.5))
    people = _people(closed, _plan(PersonBehaviour.PATH, (1.0, 1.5), (7.0, 1.5), yields=False))
    states = [state for (state,) in _watch(people, 30.0)]
    _assert_plausible([np.array([[state.pose.x, state.pose.y]]) for state in states])
    nearest = max(state.pose.x for state in states)
    assert 3.6 < nearest <= 3.75
    assert min(state.pose.x for state in states[int(10.0 / TICK) :]) < 1.05


def test_a_standing_walker_hit_by_a_chair_can_walk_away() -> None:
    people = _people(_room(12.0, 2.0), _plan(PersonBehaviour.PATH, (1.0, 1.0), (11.0, 1.0)))
    for _ in _watch(people, 6.0, Pose2(6.0, 1.0, math.pi)):
        pass
    state = people.states[0]
    driven_into = Pose2(state.pose.x + CHAIR_A.front + 0.1, 1.0, math.pi)
    gaps = np.array([_gap_to_chair(state, driven_into) for (state,) in _watch(people, 12.0, driven_into)])
    assert gaps[0] == pytest.approx(-0.15, abs=0.01)
    away = int(np.argmax(gaps > 1.0))
    assert away > 0
    assert (np.diff(gaps[:away]) >= -1e-9).all()


# ---- with social forces


@pytest.mark.parametrize("width", [1.5, 2.0, 3.0])
@pytest.mark.parametrize("seed", range(3))
def test_social_walkers_pass_each_other_in_a_corridor_without_overlap(width: float, seed: int) -> None:
    middle = width / 2
    people = _people(
        _room(12.0, width),
        _plan(PersonBehaviour.SOCIAL, (1.0, middle), (11.0, middle)),
        _plan(PersonBehaviour.SOCIAL, (11.0, middle), (1.0, middle)),
        seed=seed,
    )
    states = list(_watch(people, 13.0))
    _assert_plausible([_positions(pair) for pair in states])
    assert min(map(_smallest_gap, states)) > 0.0
    assert max(first.pose.x for first, _ in states) > 10.5
    assert min(second.pose.x for _, second in states) < 1.5


def test_two_streams_of_social_walkers_pass_through_each_other() -> None:
    plans = [_plan(PersonBehaviour.SOCIAL, (1.0 + i, 1.25), (18.0, 1.25)) for i in range(4)]
    plans += [_plan(PersonBehaviour.SOCIAL, (19.0 - i, 1.25), (2.0, 1.25)) for i in range(4)]
    people = _people(_room(20.0, 2.5), *plans)
    states = list(_watch(people, 25.0))
    tracks = np.array([_positions(crowd) for crowd in states])
    assert min(map(_smallest_gap, states)) >= -2e-9
    assert (tracks[:, :4, 0].max(axis=0) > 17.0).all()
    assert (tracks[:, 4:, 0].min(axis=0) < 3.0).all()


def test_a_social_walker_goes_round_a_chair_that_stands_in_its_way() -> None:
    chair = Pose2(6.0, 1.5, math.pi)
    people = _people(_room(12.0, 3.0), _plan(PersonBehaviour.SOCIAL, (1.0, 1.5), (11.0, 1.5)))
    states = [state for (state,) in _watch(people, 14.0, chair)]
    _assert_plausible([np.array([[state.pose.x, state.pose.y]]) for state in states])
    assert min(_gap_to_chair(state, chair) for state in states) > 0.1
    assert max(state.pose.x for state in states) > 10.5


def test_a_social_walker_makes_way_for_an_approaching_chair_only_if_it_yields() -> None:
    nearest = {}
    for yields in (True, False):
        people = _people(_room(12.0, 3.0), _plan(PersonBehaviour.SOCIAL, (2.0, 1.5), (11.0, 1.5), yields=yields))
        gaps = []
        for i in range(round(5.0 / TICK)):
            chair = Pose2(9.0 - 0.5 * i * TICK, 1.5, math.pi)
            people.step(TICK_NS, chair, Twist(0.5, 0.0))
            gaps.append(_gap_to_chair(people.states[0], chair))
        nearest[yields] = min(gaps)
    assert nearest[True] > 0.1
    assert nearest[False] < 0.05


def test_a_social_walker_that_does_not_yield_passes_the_side_of_a_chair_in_contact() -> None:
    chair = Pose2(6.0, 1.05, 0.1)
    people = _people(_room(12.0, 3.0), _plan(PersonBehaviour.SOCIAL, (1.0, 1.5), (11.0, 1.5), yields=False))
    states = [state for (state,) in _watch(people, 14.0, chair)]
    assert -2e-9 <= min(_gap_to_chair(state, chair) for state in states) < 0.02
    assert max(state.pose.x for state in states) > 10.5


@pytest.mark.parametrize("aside", [-0.2, 0.2])
def test_a_social_walker_leaves_the_outline_of_a_chair_that_drove_over_it(aside: float) -> None:
    people = _people(_room(12.0, 3.0), _plan(PersonBehaviour.SOCIAL, (6.0, 1.5), (11.0, 1.5)))
    chair = Pose2(5.8, 1.5 - aside, 0.0)
    gaps = [_gap_to_chair(state, chair) for (state,) in _watch(people, 0.9, chair)]
    assert gaps[-1] > 0.0


def test_a_social_walker_keeps_away_from_a_wall_along_its_path() -> None:
    people = _people(_room(12.0, 3.0), _plan(PersonBehaviour.SOCIAL, (1.0, 0.3), (11.0, 0.3)))
    aside = [state.pose.y for (state,) in _watch(people, 8.0)]
    assert 0.45 < aside[-1] < 0.65


@pytest.mark.parametrize("speed", [0.6, 1.0, 1.3])
def test_a_social_walker_goes_through_a_narrow_door(speed: float) -> None:
    grid = _with_wall(_room(8.0, 3.0), 4.0, (1.1, 1.9))
    people = _people(grid, _plan(PersonBehaviour.SOCIAL, (1.0, 1.5), (7.0, 1.5), speed=speed))
    states = [state for (state,) in _watch(people, 10.0 / speed)]
    _assert_plausible([np.array([[state.pose.x, state.pose.y]]) for state in states])
    assert max(state.pose.x for state in states) > 6.5
    assert min(_gap_to_walls(state, grid) for state in states) > 0.05


# ---- seated, sudden


def test_a_seated_person_does_not_move_at_a_table() -> None:
    grid = _with_wall(_room(8.0, 3.0), 4.0, (1.5, 1.5))
    people = _people(grid, _plan(PersonBehaviour.SEATED, (3.9, 1.5), (4.0, 2.5)))
    (before,) = people.states
    assert before.pose.theta == pytest.approx(math.atan2(1.0, 0.1))
    assert all(state == before for (state,) in _watch(people, 5.0, Pose2(3.0, 1.5, 0.0), Twist(0.5, 0.0)))


def _sudden(trigger: float = 2.0) -> SimulatedPeople:
    return _people(_room(12.0, 4.0), _plan(PersonBehaviour.SUDDEN, (8.0, 0.5), (8.0, 3.0), trigger=trigger, speed=1.2))


@pytest.mark.parametrize("trigger", [1.0, 2.0, 3.5])
def test_a_sudden_person_steps_out_when_the_chair_is_within_the_trigger_distance_of_its_path(trigger: float) -> None:
    people = _sudden(trigger)
    for i in range(300):
        x = 1.0 + 0.5 * i * TICK
        people.step(TICK_NS, Pose2(x, 2.0, 0.0), Twist(0.5, 0.0))
        if people.states[0].speed > 0.0:
            break
    assert 8.0 - x - CHAIR_A.front == pytest.approx(trigger, abs=0.03)
    states = [state for (state,) in _watch(people, 6.0)]
    _assert_plausible([np.array([[state.pose.x, state.pose.y]]) for state in states])
    assert states[-1].pose.y == pytest.approx(3.0)
    assert states[-1].speed == 0.0
    assert max(state.speed for state in states) == pytest.approx(1.2, abs=0.05)


@pytest.mark.parametrize(
    ("pose", "twist"),
    [
        (Pose2(4.0, 2.0, 0.0), Twist(0.5, 0.0)),  # too far
        (Pose2(6.5, 2.0, 0.0), Twist(0.0, 0.0)),  # near, but standing
        (Pose2(6.5, 2.0, 0.0), Twist(-0.5, 0.0)),  # near, but driving away
    ],
)
def test_a_sudden_person_stays_in_place_for_a_chair_that_does_not_come_near(pose: Pose2, twist: Twist) -> None:
    assert all(state.pose == Pose2(8.0, 0.5, math.pi / 2) for (state,) in _watch(_sudden(), 3.0, pose, twist))


def test_a_sudden_person_may_step_out_before_the_corner_of_a_chair_that_turns() -> None:
    # Turning left it swings its left front corner towards the path, turning right away from it.
    for omega, steps_out in ((0.5, True), (-0.5, False)):
        people = _people(_room(12.0, 4.0), _plan(PersonBehaviour.SUDDEN, (8.0, 2.6), (8.0, 3.4), trigger=0.6))
        people.step(TICK_NS, Pose2(7.0, 2.0, 0.0), Twist(0.0, omega))
        assert (people.states[0].speed > 0.0) == steps_out


# ---- everybody


def _crowd() -> list[PersonPlan]:
    return [
        _plan(PersonBehaviour.PATH, (0.5, 0.5), (5.0, 0.6), (5.2, 3.0), speed=1.2),
        _plan(PersonBehaviour.PATH, (5.5, 0.5), (0.5, 0.7), yields=False),
        _plan(PersonBehaviour.SOCIAL, (0.5, 3.2), (5.5, 3.2)),
        _plan(PersonBehaviour.SOCIAL, (5.5, 2.5), (0.5, 2.5), yields=False, speed=1.4),
        _plan(PersonBehaviour.SOCIAL, (1.2, 3.4), (1.5, 0.6)),
        _plan(PersonBehaviour.SEATED, (2.5, 3.6)),
        _plan(PersonBehaviour.SUDDEN, (3.8, 3.6), (3.8, 0.4), speed=1.3),
        _plan(PersonBehaviour.BOUNCE, (2.0, 1.2), speed=0.4, radius=0.15),
        _plan(PersonBehaviour.BOUNCE, (4.4, 1.8), speed=0.15, radius=0.15),
    ]


@pytest.mark.nightly
@settings(max_examples=12)
@given(
    st.integers(0, 2**31),
    st.lists(st.tuples(st.integers(0, 79), st.integers(0, 119)), max_size=25),
    st.sampled_from([Pose2(), Pose2(-3.0, 2.0, 0.0), Pose2(1.0, -1.0, 0.6)]),
)
def test_no_person_walks_through_a_wall_or_the_chair_or_another_person(
    seed: int, pillars: list[tuple[int, int]], origin: Pose2
) -> None:
    cells = np.zeros((80, 120), np.int8)
    for cell in pillars:
        cells[cell] = 100
    for plan in _crowd():
        col, row = (plan.path[0] / 0.05).astype(int)
        cells[max(row - 7, 0) : row + 8, max(col - 7, 0) : col + 8] = 0
    grid = OccupancyGrid(cells, 0.05, origin)
    plans = [PersonPlan(p.behaviour, transform_points(origin, p.path), p.speed, p.yields, p.radius) for p in _crowd()]
    chair = origin @ Pose2(3.0, 1.7, 0.4)
    people = _people(grid, *plans, seed=seed)
    free_of_chair = [_gap_to_chair(state, chair) >= 0.0 for state in people.states]
    assert sum(free_of_chair) == len(plans)
    for tick, crowd in enumerate(_watch(people, 15.0, chair, Twist(0.3, 0.2))):
        assert _smallest_gap(crowd) >= -2e-9
        assert min(_gap_to_chair(state, chair) for state in crowd) >= -2e-9
        if tick % 5 == 0:
            assert min(_gap_to_walls(state, grid) for state in crowd) >= -2e-9


def _drive_by(people: SimulatedPeople, chair: Callable[[int], Pose2], ticks: int = 400) -> bytes:
    for i in range(ticks):
        people.step(TICK_NS, chair(i), Twist(0.5, 0.0))
    return repr(people.states).encode()


def test_the_same_seed_gives_the_same_people_and_another_seed_does_not() -> None:
    def chair(i: int) -> Pose2:
        return Pose2(0.5 + 0.01 * i, 1.9, 0.0)

    once, again, other = (_drive_by(_people(_room(6.0, 4.0), *_crowd(), seed=seed), chair) for seed in (5, 5, 6))
    assert once == again
    assert once != other


def test_the_motion_of_the_chair_changes_no_random_number() -> None:
    streams = []
    for chair in (AWAY, Pose2(3.0, 1.7, 0.4)):
        rng = np.random.default_rng(3)
        people = SimulatedPeople(_crowd(), _room(6.0, 4.0), CHAIR_A, rng)
        _drive_by(people, lambda _, chair=chair: chair)  # type: ignore[misc]
        streams.append(rng.bit_generator.state)
    assert streams[0] == streams[1]


def test_a_long_step_equals_many_short_ones() -> None:
    long, short = (_people(_room(6.0, 4.0), *_crowd(), seed=1) for _ in range(2))
    chair = Pose2(3.0, 1.7, 0.4)
    for _ in range(20):
        long.step(10 * TICK_NS, chair, Twist(0.2, 0.0))
        for _ in range(10):
            short.step(TICK_NS, chair, Twist(0.2, 0.0))
    assert long.states == short.states


def test_finer_steps_change_little() -> None:
    plans = [
        _plan(PersonBehaviour.PATH, (1.0, 1.0), (6.0, 1.0), (6.0, 5.0)),
        _plan(PersonBehaviour.SOCIAL, (1.0, 3.0), (4.0, 3.0), (4.5, 5.0)),
    ]
    fine, coarse = (_people(_room(8.0, 6.0), *plans, seed=1) for _ in range(2))
    for _ in range(round(20.0 / TICK)):
        coarse.step(TICK_NS, AWAY, STILL)
        for _ in range(10):
            fine.step(TICK_NS // 10, AWAY, STILL)
        assert np.hypot(*(_positions(fine.states) - _positions(coarse.states)).T).max() < 0.3


def test_the_gait_advances_one_cycle_for_every_stride() -> None:
    people = _people(_room(12.0, 2.0), _plan(PersonBehaviour.PATH, (1.0, 1.0), (11.0, 1.0)))
    before = people.states[0]
    for state, *_ in _watch(people, 8.0):
        turns = (state.pose.x - before.pose.x) / STRIDE
        assert wrap_angle(state.stride - before.stride - turns * math.tau) == pytest.approx(0.0, abs=1e-6)
        assert 0.0 <= state.stride < math.tau


def test_a_world_without_people_has_none() -> None:
    people = _people(_room(3.0, 3.0))
    people.step(TICK_NS, AWAY, STILL)
    assert people.states == ()


@pytest.mark.parametrize("behaviour", [PersonBehaviour.PATH, PersonBehaviour.SOCIAL, PersonBehaviour.SUDDEN])
def test_a_walker_without_a_path_stands(behaviour: PersonBehaviour) -> None:
    people = _people(_room(3.0, 3.0), _plan(behaviour, (1.0, 1.5)))
    assert all(state.pose == Pose2(1.0, 1.5, 0.0) for (state,) in _watch(people, 12.0))


@pytest.mark.parametrize(
    "behaviour", [PersonBehaviour.PATH, PersonBehaviour.SOCIAL, PersonBehaviour.SUDDEN, PersonBehaviour.BOUNCE]
)
@pytest.mark.parametrize(
    ("begin", "problem"), [((0.2, 1.0), "something solid"), ((-0.1, 1.0), "something solid"), ((9.0, 1.0), "outside")]
)
def test_a_walker_with_an_impossible_start_is_refused_with_advice(
    behaviour: PersonBehaviour, begin: tuple[float, float], problem: str
) -> None:
    with pytest.raises(WorldError, match=rf"person 1 \({behaviour.value}\) .*{problem}.*start its path"):
        _people(_room(3.0, 3.0), _plan(behaviour, begin, (2.0, 1.0)))


@pytest.mark.parametrize("speed", [0.0, -1.0, 1.6, math.nan, math.inf])
def test_an_impossible_speed_is_refused_with_advice(speed: float) -> None:
    with pytest.raises(WorldError, match="give a speed"):
        _people(_room(3.0, 3.0), _plan(PersonBehaviour.PATH, (1.0, 1.0), speed=speed))


def test_time_does_not_go_backwards_for_people() -> None:
    with pytest.raises(ValueError, match="at least 0"):
        _people(_room(3.0, 3.0)).step(-1, AWAY, STILL)


def test_a_person_with_errands_stays_at_each_end_of_its_way() -> None:
    people = _people(_room(6.0, 2.0), _plan(PersonBehaviour.PATH, (1.0, 1.0), (4.0, 1.0), speed=1.0, rest=12.0))
    at = [float(states[0].pose.x) for states in _watch(people, 60.0)]
    ends = [round(sum(abs(x - end) < 1e-6 for x in at) * TICK, 1) for end in (4.0, 1.0)]
    assert ends[0] == pytest.approx(24.0, abs=2.0)  # twice in a minute: 4 s of way, 12 s there, and a turn
    assert ends[1] == pytest.approx(19.0, abs=2.0)  # once, and the beginning of a second time
