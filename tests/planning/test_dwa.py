"""The chair gets there, never touches anything, and can always stop."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair import CHAIR_A
from waychair.geometry import wrap_angle
from waychair.maps.distance_field import DistanceField, distance_field, distances
from waychair.planning.costmap import costmap_from_grid
from waychair.planning.critics import Features, paper_score
from waychair.planning.dwa import DwaResult, DwaSettings, braking, choose, rotate_to_heading
from waychair.planning.dwa_kernels import local_section, measure
from waychair.planning.footprint import along_arc, fits, footprint, free_time, in_cells
from waychair.planning.global_planner import legs_of, plan
from waychair.types import BoolArray, FloatArray, OccupancyGrid, Path, Pose2, Twist

CELL = 0.05
PROMPT = DwaSettings(reaction_time=0.0)


def hall(blocks: tuple[tuple[float, float, float, float], ...] = ()) -> OccupancyGrid:
    """12 x 8 m inside walls, with blocks x0, y0, x1, y1 [m]."""
    cells = np.zeros((160, 240), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    for x0, y0, x1, y1 in blocks:
        cells[round(y0 / CELL) : round(y1 / CELL), round(x0 / CELL) : round(x1 / CELL)] = 100
    return OccupancyGrid(cells, CELL)


def straight(start: Pose2, length: float) -> Path:
    """A straight path from a pose along its heading."""
    along = np.linspace(0, length, round(length / 0.1) + 1)
    x, y = start.x + along * math.cos(start.theta), start.y + along * math.sin(start.theta)
    return Path(np.column_stack([x, y, np.full(len(along), start.theta)]))


def moved(pose: Pose2, twist: Twist, seconds: float = 0.05) -> Pose2:
    x, y, theta = along_arc(pose.x, pose.y, pose.theta, twist.v, twist.omega, seconds)
    return Pose2(x, y, wrap_angle(theta))


def drive(grid: OccupancyGrid, start: Pose2, goal: Pose2, ticks: int = 900) -> tuple[DwaResult, Pose2, list[Twist]]:
    """Drive on a plan, leg by leg, with a chair that does as told; every pose must be free."""
    costmap = costmap_from_grid(grid, CHAIR_A)
    legs = legs_of(plan(costmap, start, goal))
    pose, sent = start, [Twist()]
    for _ in range(ticks):
        result = choose(pose, sent[-1], legs[0], costmap.field, CHAIR_A, PROMPT)
        sent.append(result.twist)
        pose = moved(pose, result.twist)
        assert fits(CHAIR_A, 0.0, costmap.field, pose)
        if result.arrived and len(legs) == 1:
            break
        legs = legs[1:] if result.arrived else legs
    return result, pose, sent


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, math.pi])
def test_the_chair_drives_through_an_80_cm_door_to_the_goals_pose(heading: float) -> None:
    wall = ((5, 0, 5.15, 3.6), (5, 4.4, 5.15, 8))
    goal = Pose2(9.0, 5.5, -math.pi / 2)
    result, pose, sent = drive(hall(wall), Pose2(2.0, 2.0, heading), goal)
    assert result.arrived
    assert math.hypot(pose.x - goal.x, pose.y - goal.y) < 0.16
    assert abs(wrap_angle(pose.theta - goal.theta)) < 0.06
    v, omega = np.array([(t.v, t.omega) for t in sent]).T
    assert np.diff(v)[v[:-1] >= 0].max() <= 0.5 * 0.05 + 1e-9  # backwards, rising is braking
    assert np.diff(v).min() >= -0.6 * 0.05 - 1e-9
    assert np.abs(np.diff(omega)).max() <= 0.8 * 0.05 + 1e-9
    assert np.abs(v * omega).max() <= 0.5 + 1e-9
    assert v.max() <= 0.8
    assert v.max() > 0.7


@pytest.mark.parametrize("x", [2.0, 10.0])
def test_the_chair_enters_a_90_cm_door_off_a_corridor_of_2_m(x: float) -> None:
    walls = ((0, 0.9, 12, 1.0), (0, 3.0, 5.55, 3.1), (6.45, 3.0, 12, 3.1))
    result, pose, _ = drive(hall(walls), Pose2(x, 2.0, 0.0), Pose2(6.0, 5.0, math.pi / 2), 1200)
    assert result.arrived
    assert math.hypot(pose.x - 6.0, pose.y - 5.0) < 0.16


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=12, deadline=None)
def test_from_every_commanded_speed_a_full_stop_touches_nothing(seed: int) -> None:
    """Random clutter and random paths through it, even bad ones; at each tick brake to a stand in thought."""
    rng = np.random.default_rng(seed)
    obstacles: BoolArray = rng.random((120, 120)) < 0.004
    obstacles[50:70, 40:66] = False
    field = DistanceField(distances(obstacles, CELL), CELL)
    pose, command = Pose2(2.6, 3.0, 0.0), Twist()
    path = Path(
        np.column_stack(
            [np.linspace(2.6, rng.uniform(0.5, 5.5), 20), np.linspace(3, rng.uniform(0.5, 5.5), 20), np.zeros(20)]
        )
    )
    for _ in range(60):
        command = choose(pose, command, path, field, CHAIR_A, PROMPT).twist
        pose = moved(pose, command)
        thought, braked = pose, command
        while abs(braked.v) > 1e-6 or abs(braked.omega) > 1e-6:
            braked = braking(braked, PROMPT)
            thought = moved(thought, braked)
            assert fits(CHAIR_A, 0.0, field, thought)


def test_from_a_stand_the_command_starts_to_grow_whatever_the_motor_does() -> None:
    """The window follows the last command: a chair held by its dead band is asked for more each tick."""
    field = distance_field(hall())
    pose, command = Pose2(2.0, 4.0), Twist()
    speeds = []
    for _ in range(20):
        command = choose(pose, command, straight(pose, 6.0), field, CHAIR_A).twist
        speeds.append(command.v)
    assert speeds == sorted(speeds)
    assert speeds[-1] > 0.4


def test_a_wall_ahead_stops_the_chair_before_it() -> None:
    grid = hall(((6, 0, 6.2, 8),))
    field = distance_field(grid)
    pose, command, path = Pose2(2.0, 4.0), Twist(), straight(Pose2(2.0, 4.0), 8.0)
    for _ in range(300):
        result = choose(pose, command, path, field, CHAIR_A, PROMPT)
        command = result.twist
        pose = moved(pose, command)
        assert fits(CHAIR_A, 0.0, field, pose)
    assert abs(command.v) < 0.02
    assert result.blocked
    assert 5.6 < pose.x + CHAIR_A.front < 6.0


def test_when_nothing_is_admissible_the_chair_brakes_on_its_arc_and_says_so() -> None:
    field = DistanceField(np.zeros((100, 100), np.float32), CELL)
    result = choose(Pose2(2.5, 2.5), Twist(0.6, 0.3), straight(Pose2(2.5, 2.5), 2.0), field, CHAIR_A)
    assert result.blocked
    assert not np.isfinite(result.scores).any()
    assert result.twist.v == pytest.approx(0.6 - 0.6 * 0.05)
    assert result.twist.omega / result.twist.v == pytest.approx(0.3 / 0.6)
    assert choose(Pose2(2.5, 2.5), Twist(), straight(Pose2(2.5, 2.5), 2.0), field, CHAIR_A).twist == Twist()


@pytest.mark.parametrize("command", [Twist(), Twist(0.8, 0.0), Twist(0.4, -0.8), Twist(-0.2, 0.5), Twist(1.5, 2.0)])
def test_candidates_stay_inside_the_window_and_the_limits(command: Twist) -> None:
    field = distance_field(hall())
    candidates = choose(Pose2(4.0, 4.0), command, straight(Pose2(4.0, 4.0), 5.0), field, CHAIR_A, PROMPT).candidates
    v, omega = candidates.T
    assert len(candidates) > 200 or command.v > 1
    assert v.min() >= min(-0.2, command.v - 0.6) - 1e-9
    assert v.max() <= 0.9 + 1e-9
    assert np.abs(omega).max() <= max(0.8, abs(command.omega) - 0.8) + 1e-9
    assert (np.abs(v) + np.abs(omega) * 0.27).max() <= 1.0
    assert np.abs(v * omega).max() <= 0.5


def test_the_window_speeds_up_and_brakes_at_different_rates() -> None:
    settings_ = DwaSettings(window_time=0.1, acceleration=0.5, braking=1.0)
    field = distance_field(hall())
    v = choose(Pose2(3, 4), Twist(0.4, 0.0), straight(Pose2(3, 4), 6), field, CHAIR_A, settings_).candidates[:, 0]
    assert (v.min(), v.max()) == (pytest.approx(0.3), pytest.approx(0.45))


def test_admissible_candidates_are_those_that_can_stop() -> None:
    """Eq. (10) with its units repaired: the free way must hold v^2 / 2b, the free angle omega^2 / 2 alpha."""
    field = distance_field(hall(((4.3, 0, 4.5, 8),)))
    pose, command = Pose2(3.0, 4.0), Twist(0.4, 0.0)
    result = choose(pose, command, straight(pose, 6.0), field, CHAIR_A, PROMPT)
    shape = footprint(CHAIR_A, PROMPT.margin, field)
    start = in_cells(field, pose)
    admissible = np.isfinite(result.scores)
    assert 0 < admissible.sum() < len(admissible)
    for (v, omega), ok in zip(result.candidates, admissible, strict=True):
        free = free_time(shape, start, v / CELL, omega, 2.5, 2.5)
        if ok:
            assert abs(v) <= math.sqrt(2 * 0.6 * abs(v) * free) + 1e-9
            assert abs(omega) <= math.sqrt(2 * 0.8 * abs(omega) * free) + 1e-9
        else:
            assert free < 0.05 + max(abs(v) / 0.6, abs(omega) / 0.8) / 2 + 1e-9


@pytest.mark.parametrize("heading", [0.6, -1.5, 3.0, -3.1])
def test_turning_in_place_takes_the_short_way_and_stops_at_the_heading(heading: float) -> None:
    field = distance_field(hall())
    pose, command, turned = Pose2(4.0, 4.0, 0.0), Twist(), 0.0
    for _ in range(300):
        result = rotate_to_heading(pose, command, heading, field, CHAIR_A, PROMPT)
        command = result.twist
        turned += command.omega * 0.05
        pose = moved(pose, command)
        if result.arrived:
            break
    assert result.arrived
    assert command == Twist()
    assert turned == pytest.approx(heading, abs=0.06)


def test_turning_goes_the_long_way_round_when_a_wall_bars_the_short_one() -> None:
    """A pillar ahead on the left is inside the circle of the front corner, which sweeps it only when turning left."""
    pose = Pose2(4.0, 4.0, 0.0)
    pillar = (4.35, 4.45, 4.45, 4.55)
    assert fits(CHAIR_A, 0.01, distance_field(hall((pillar,))), pose)
    result = rotate_to_heading(pose, Twist(), 1.4, distance_field(hall((pillar,))), CHAIR_A, PROMPT)
    assert result.blocked or result.twist.omega < 0
    right = rotate_to_heading(pose, Twist(), -0.8, distance_field(hall((pillar,))), CHAIR_A, PROMPT)
    assert right.twist.omega < 0
    assert not right.blocked


def test_turning_between_two_walls_is_blocked() -> None:
    field = distance_field(hall(((0, 4.5, 12, 4.6), (0, 3.4, 12, 3.5))))
    result = rotate_to_heading(Pose2(4.0, 4.0), Twist(), math.pi / 2, field, CHAIR_A, PROMPT)
    assert result.blocked
    assert result.twist == Twist()


def test_a_rolling_chair_brakes_before_it_turns_in_place() -> None:
    result = rotate_to_heading(Pose2(4.0, 4.0), Twist(0.5, 0.1), 2.0, distance_field(hall()), CHAIR_A, PROMPT)
    assert 0 < result.twist.v < 0.5
    assert result.twist.omega / result.twist.v == pytest.approx(0.2)


def test_what_lies_beyond_the_field_is_not_driven_into() -> None:
    field = DistanceField(np.full((40, 40), 9.0, np.float32), CELL)
    pose, command = Pose2(0.5, 1.0), Twist()
    for _ in range(200):
        command = choose(pose, command, straight(Pose2(0.5, 1.0), 5.0), field, CHAIR_A, PROMPT).twist
        pose = moved(pose, command)
    assert pose.x + CHAIR_A.front < 2.0
    assert pose.x > 0.8


def features(**changes: FloatArray) -> Features:
    some = np.array([0.2, 0.4, 0.6])
    fields: dict[str, FloatArray] = dict.fromkeys(
        ("free_time", "clearance", "path_error", "heading_error", "bearing", "progress", "target_distance", "change"),
        some,
    )
    candidates = np.column_stack([some, np.zeros(3)])
    return Features(candidates=changes.pop("candidates", candidates), admissible=np.ones(3, bool), **(fields | changes))


def test_the_papers_score_sums_three_terms_of_equal_weight() -> None:
    score = paper_score(features(bearing=np.array([0.0, math.pi, math.pi / 2])))
    heading = np.array([math.pi, 0.0, math.pi / 2]) / (1.5 * math.pi)
    dist = np.array([0.04, 0.16, 0.36]) / 0.56
    vel = np.array([0.2, 0.4, 0.6]) / 1.2
    np.testing.assert_allclose(score, heading + dist + vel)


def test_the_papers_score_is_defined_where_its_eta_is_zero_over_zero() -> None:
    score = paper_score(features(candidates=np.zeros((3, 2)), bearing=np.full(3, math.pi)))
    np.testing.assert_array_equal(score, np.zeros(3))


def test_the_papers_score_drives_the_chair_forward_too() -> None:
    pose = Pose2(2.0, 4.0)
    result = choose(pose, Twist(0.3, 0.0), straight(pose, 6.0), distance_field(hall()), CHAIR_A, score=paper_score)
    assert result.twist.v > 0.3
    assert abs(result.twist.omega) < 0.1


def test_measures_equal_a_plain_reference() -> None:
    field = distance_field(hall(((4, 3.2, 4.2, 3.4),)))
    pose = Pose2(3.0, 4.0, 0.2)
    curve = np.column_stack([np.linspace(2, 8, 60), 4 + 0.3 * np.sin(np.linspace(0, 5, 60)), np.zeros(60)])
    section, _ = local_section(curve, pose.array(), 2.5)
    candidates = np.array([[0.5, 0.2], [0.3, -0.5], [-0.1, 0.0], [0.0, 0.0]])
    shape = footprint(CHAIR_A, 0.01, field)
    start = in_cells(field, pose)
    rows = measure(shape, start, pose.array(), candidates, section, np.full(4, 2.5), 2.5)
    nose = (shape.discs[0, 0] + shape.discs[0, 3]) * CELL
    for (v, omega), row in zip(candidates, rows, strict=True):
        free = free_time(shape, start, v / CELL, omega, 2.5, 2.5)
        arc = np.array([along_arc(pose.x, pose.y, pose.theta, v, omega, free * k / 10) for k in range(1, 11)])
        away = np.hypot(arc[:, None, 0] - section[:, 0], arc[:, None, 1] - section[:, 1])
        front = arc[:, :2] + nose * np.column_stack([np.cos(arc[:, 2]), np.sin(arc[:, 2])])
        front_away = np.hypot(front[:, None, 0] - section[:, 0], front[:, None, 1] - section[:, 1]).min(axis=1)
        nearest = away[-1].argmin()
        bearing = math.atan2(section[-1, 1] - arc[-1, 1], section[-1, 0] - arc[-1, 0])
        spacing = math.dist(section[0, :2], section[1, :2])
        assert row[0] == pytest.approx(free)
        assert row[2] == pytest.approx((away.min(axis=1).mean() + front_away.mean()) / 2)
        assert row[3] == pytest.approx(abs(wrap_angle(arc[-1, 2] - section[nearest, 2])))
        assert row[4] == pytest.approx(abs(wrap_angle(bearing - arc[-1, 2])))
        assert row[5] == pytest.approx(spacing * nearest)
        assert row[6] == pytest.approx(np.hypot(*(arc[:, :2] - section[-1, :2]).T).min())


def test_a_front_past_the_end_of_the_path_is_no_error() -> None:
    """At the goal, the front reaches over it; only its distance from the prolonged path counts."""
    field = distance_field(hall())
    path = straight(Pose2(2.0, 4.0), 2.0)
    section, _ = local_section(path.poses, np.array([4.0, 4.0, 0.0]), 2.5)
    for theta, error in ((0.0, 0.0), (0.3, 0.55 * math.sin(0.3) / 2)):
        shape = footprint(CHAIR_A, 0.0, field)
        pose = Pose2(4.0, 4.0, theta)
        rows = measure(shape, in_cells(field, pose), pose.array(), np.zeros((1, 2)), section, np.array([2.5]), 2.5)
        assert rows[0, 2] == pytest.approx(error, abs=1e-9)


def test_a_section_begins_at_the_nearest_point_and_ends_after_its_length() -> None:
    path = straight(Pose2(0.0, 0.0), 10.0)
    section, remaining = local_section(path.poses, np.array([3.33, 0.4, 0.0]), 2.0)
    np.testing.assert_allclose(section[0], [3.33, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(section[-1], [5.33, 0.0, 0.0], atol=1e-9)
    assert remaining == pytest.approx(6.67 + 0.4)
    assert np.diff(section[:, 0]).max() <= 0.05 + 1e-9
    one, left = local_section(np.array([[1.0, 1.0, 0.5]]), np.array([1.0, 4.0, 0.0]), 2.0)
    np.testing.assert_array_equal(one, [[1.0, 1.0, 0.5]])
    assert left == 3.0
