"""The chair arrives, never touches an obstacle, and can always stop."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import wrap_angle
from waychair.maps.grid.distance_field import DistanceField, distance_field, distances
from waychair.planning.body.footprint import along_arc, fits, footprint, free_time, in_cells, poses_in_cells
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.planning.route.global_planner import plan
from waychair.planning.window import dwa
from waychair.planning.window.dwa import DwaResult, choose, rotate_to_heading
from waychair.planning.window.dwa_kernels import first_free, fits_after, local_section, measure, meetings_with_people
from waychair.planning.window.motion_limits import (
    MIN_OMEGA,
    PERIOD,
    CommandedMotion,
    DwaSettings,
    braking,
    motion_after,
    slowing_speed,
    towards,
)
from waychair.types import BoolArray, OccupancyGrid, Path, Pose2, Twist

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
    """Drive an ideal chair on a plan that leaves the rectangle to the window; every pose must be free."""
    costmap = costmap_from_grid(grid, CHAIR_A)
    path = plan(costmap, start, goal, check_footprint=False)
    pose, sent = start, [Twist()]
    for _ in range(ticks):
        result = choose(pose, sent[-1], path, costmap.field, CHAIR_A, PROMPT)
        sent.append(result.twist)
        pose = moved(pose, result.twist)
        assert fits(CHAIR_A, 0.0, costmap.field, pose)
        if result.arrived:
            break
    return result, pose, sent


@pytest.mark.sampled(1)
@pytest.mark.parametrize("heading", [0.0, math.pi / 2, math.pi])
def test_the_chair_drives_through_an_opening_to_the_pose_of_the_goal(heading: float) -> None:
    wall = ((5, 0, 5.15, 3.4), (5, 4.6, 5.15, 8))
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


def test_the_chair_drives_straight_through_an_80_cm_door_in_front_of_it() -> None:
    field = distance_field(hall(((5, 0, 5.15, 3.6), (5, 4.4, 5.15, 8))))
    pose, command = Pose2(3.0, 4.0), Twist()
    for _ in range(300):
        result = choose(pose, command, straight(Pose2(3.0, 4.0), 5.0), field, CHAIR_A, PROMPT)
        command = result.twist
        pose = moved(pose, command)
        assert fits(CHAIR_A, 0.0, field, pose)
    assert result.arrived
    assert pose.y == pytest.approx(4.0, abs=0.02)


@pytest.mark.nightly
def test_in_a_u_the_window_alone_gets_stuck_and_with_dstar_lite_it_does_not() -> None:
    """Section 2.3 of the source paper."""
    trap = hall(((6.5, 2.5, 6.7, 5.5), (4.5, 5.5, 6.7, 5.7), (4.5, 2.3, 6.7, 2.5)))
    start, goal = Pose2(2.0, 4.1), Pose2(9.5, 4.1)
    field, pose, command = distance_field(trap), start, Twist()
    for _ in range(300):
        result = choose(pose, command, straight(start, 7.5), field, CHAIR_A, PROMPT)
        command = result.twist
        pose = moved(pose, command)
        assert fits(CHAIR_A, 0.0, field, pose)
    assert result.blocked
    assert pose.x < 6.5
    planned, end, _ = drive(trap, start, goal)
    assert planned.arrived
    assert math.hypot(end.x - goal.x, end.y - goal.y) < 0.16


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=12, deadline=None)
def test_from_every_commanded_speed_a_full_stop_touches_nothing(seed: int) -> None:
    """Random clutter and random paths through it, even bad ones; at each tick a simulated stop must be free."""
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


def test_from_standstill_the_command_grows_even_if_the_motor_does_not_move() -> None:
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


def test_without_an_admissible_command_the_chair_brakes_on_its_arc_and_says_so() -> None:
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


def test_a_turn_on_the_spot_within_the_dead_band_is_no_candidate() -> None:
    """Commanded again and again, it would count as driving: the chair neither moved nor waited."""
    field, pose = distance_field(hall()), Pose2(4.0, 4.0)
    turns = choose(pose, Twist(), straight(pose, 6.0), field, CHAIR_A, PROMPT).candidates
    on_the_spot = np.abs(turns[turns[:, 0] == 0.0, 1])
    assert on_the_spot.min() == 0.0
    assert np.sort(on_the_spot)[1] >= MIN_OMEGA


def test_the_window_speeds_up_and_brakes_at_different_rates(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dwa, "WINDOW_TIME", 0.1)
    settings_ = DwaSettings(acceleration=0.5, braking=1.0)
    field = distance_field(hall())
    v = choose(Pose2(3, 4), Twist(0.4, 0.0), straight(Pose2(3, 4), 6), field, CHAIR_A, settings_).candidates[:, 0]
    assert (v.min(), v.max()) == (pytest.approx(0.3), pytest.approx(0.45))


def test_admissible_candidates_are_those_that_can_stop() -> None:
    """Eq. (10) with its units repaired: the free way must hold v^2 / 2b, the free angle omega^2 / 2 alpha."""
    field = distance_field(hall(((4.3, 0, 4.5, 8),)))
    pose, command = Pose2(3.0, 4.0), Twist(0.4, 0.0)
    result = choose(pose, command, straight(pose, 6.0), field, CHAIR_A, PROMPT)
    shape = footprint(CHAIR_A, PROMPT.clearance, field)
    start = in_cells(field, pose)
    admissible = np.isfinite(result.scores)
    assert 0 < admissible.sum() < len(admissible)
    for (v, omega), ok in zip(result.candidates, admissible, strict=True):
        free = free_time(shape, start, v / CELL, omega, 2.5, 2.5)
        if ok:
            assert abs(v) <= math.sqrt(2 * 0.6 * abs(v) * free) + 1e-9
            assert abs(omega) <= math.sqrt(2 * 0.8 * abs(omega) * free) + 1e-9
        else:
            assert free < 0.05 + max(abs(v) / 0.6, abs(omega) / 0.8) / 2 + 0.02


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


def test_the_chair_does_not_drive_beyond_the_field() -> None:
    field = DistanceField(np.full((40, 40), 9.0, np.float32), CELL)
    pose, command = Pose2(0.5, 1.0), Twist()
    for _ in range(200):
        command = choose(pose, command, straight(Pose2(0.5, 1.0), 5.0), field, CHAIR_A, PROMPT).twist
        pose = moved(pose, command)
    assert pose.x + CHAIR_A.front < 2.0
    assert pose.x > 0.8


STILL = CommandedMotion()


def test_from_standstill_the_acceleration_grows_by_the_jerk_only() -> None:
    field, pose, command, motion = distance_field(hall()), Pose2(2.0, 4.0), Twist(), STILL
    speeds = [0.0]
    for _ in range(80):
        following = choose(pose, command, straight(pose, 6.0), field, CHAIR_A, PROMPT, motion=motion).twist
        motion, command = motion_after(motion, command, following, PROMPT), following
        pose = moved(pose, command)
        speeds.append(command.v)
    acceleration = np.diff(speeds) / PERIOD
    assert np.abs(np.diff(acceleration)).max() <= PROMPT.jerk * PERIOD + 1e-9
    assert acceleration.max() <= PROMPT.acceleration + 1e-9
    assert speeds[-1] > 0.7


@given(st.floats(-0.2, 0.8), st.floats(-0.2, 0.8), st.floats(-0.5, 0.5))
@settings(max_examples=100, deadline=None)
def test_jerk_limited_speeds_reach_their_target_with_the_least_overshoot(v: float, target: float, a: float) -> None:
    command, motion = Twist(v), CommandedMotion(Twist(a))
    speeds = [v]
    for _ in range(200):
        following = towards(command, Twist(target), PROMPT, motion)
        motion, command = motion_after(motion, command, following, PROMPT), following
        speeds.append(command.v)
    assert speeds[-1] == pytest.approx(target, abs=1e-3)
    # The initial acceleration takes a^2 / 2 jerk, and half a period's step, to vanish.
    spare = a**2 / (2 * PROMPT.jerk) + abs(a) * PERIOD + 1e-3
    assert min(v, target) - spare <= min(speeds)
    assert max(speeds) <= max(v, target) + spare


def test_without_room_to_stop_the_jerk_limit_delays_no_brake() -> None:
    field = DistanceField(np.zeros((100, 100), np.float32), CELL)
    motion = CommandedMotion(Twist(0.5, 0.0), 1)
    result = choose(Pose2(2.5, 2.5), Twist(0.6), straight(Pose2(2.5, 2.5), 2.0), field, CHAIR_A, motion=motion)
    assert result.twist.v == pytest.approx(0.6 - 0.6 * 0.05)


def test_a_chair_that_rolls_back_and_may_not_reverse_only_slows_to_rest() -> None:
    field, pose = distance_field(hall()), Pose2(4.0, 4.0)
    limits = replace(PROMPT, max_reverse=0.0)
    result = choose(pose, Twist(-0.1), straight(pose, 6.0), field, CHAIR_A, limits)
    assert (result.candidates[:, 0] >= 0.0).all()
    assert result.twist.v > -0.1


def test_predicted_gaps_equal_a_plain_reference() -> None:
    field, pose = distance_field(hall()), Pose2(4.0, 4.0, 0.3)
    shape = footprint(CHAIR_A, 0.0, field)
    people = np.array([[5.5 / CELL, 4.5 / CELL, -0.5 / CELL, -0.2 / CELL, 0.3, 0.2]])
    candidates = np.array([[0.5, 0.2], [0.0, 0.0], [-0.2, -0.4]])
    rows = meetings_with_people(shape, in_cells(field, pose), candidates, people, 2.5)
    for (v, omega), (when, least) in zip(candidates, rows, strict=True):
        gaps = []
        for t in np.linspace(0.0, 2.5, 33):
            at = Pose2(*along_arc(pose.x, pose.y, pose.theta, v, omega, t))
            local = at.inverse() @ Pose2(5.5 - 0.5 * t, 4.5 - 0.2 * t)
            beyond = max(local.x - CHAIR_A.front, -CHAIR_A.rear - local.x, 0.0)
            gaps.append(math.hypot(beyond, max(abs(local.y) - 0.3, 0.0)) - 0.3 - min(0.2 * t, 0.3))
            if gaps[-1] <= 0:
                break
        assert least == pytest.approx(max(min(gaps), 0.0), abs=1e-9)
        assert when == (pytest.approx(t) if gaps[-1] <= 0 else math.inf)


def test_driving_on_is_preferred_to_turning_back() -> None:
    field, pose = distance_field(hall()), Pose2(4.0, 4.0)
    results = [
        choose(pose, Twist(), straight(pose, 6.0), field, CHAIR_A, PROMPT, motion=CommandedMotion(direction=direction))
        for direction in (1, -1)
    ]
    forwards, backwards = (result.candidates[:, 0] > 0 for result in results)
    assert results[0].scores[forwards].max() - results[1].scores[backwards | forwards].max() > 0.05


def test_measures_equal_a_plain_reference() -> None:
    field = distance_field(hall(((4, 3.2, 4.2, 3.4),)))
    pose = Pose2(3.0, 4.0, 0.2)
    curve = np.column_stack([np.linspace(2, 8, 60), 4 + 0.3 * np.sin(np.linspace(0, 5, 60)), np.zeros(60)])
    section, _ = local_section(curve, pose.array(), 2.5)
    candidates = np.array([[0.5, 0.2], [0.3, -0.5], [-0.1, 0.0], [0.0, 0.0]])
    shape = footprint(CHAIR_A, 0.01, field)
    start = in_cells(field, pose)
    rows = measure(shape, start, candidates, poses_in_cells(field, section), np.full(4, 1.0), 2.5)
    nose = (shape.discs[0, 0] + shape.discs[0, 3]) * CELL
    for (v, omega), row in zip(candidates, rows, strict=True):
        free = row[0]
        arc = np.array([along_arc(pose.x, pose.y, pose.theta, v, omega, free * k / 10) for k in range(1, 11)])
        away = np.hypot(arc[:, None, 0] - section[:, 0], arc[:, None, 1] - section[:, 1])
        front = arc[:, :2] + nose * np.column_stack([np.cos(arc[:, 2]), np.sin(arc[:, 2])])
        front_away = np.hypot(front[:, None, 0] - section[:, 0], front[:, None, 1] - section[:, 1]).min(axis=1)
        nearest = away[-1].argmin()
        spacing = math.dist(section[0, :2], section[1, :2])
        # looks are at the nearest of 256 fine steps
        assert free == pytest.approx(free_time(shape, start, v / CELL, omega, 2.5, 2.5), abs=0.15)
        assert row[2] == pytest.approx((away.min(axis=1).mean() + front_away.mean()) / 2, abs=0.002)
        assert row[3] == pytest.approx(abs(wrap_angle(arc[-1, 2] - section[nearest, 2])), abs=0.01)
        assert row[4] == pytest.approx(spacing * nearest)
        assert row[5] == pytest.approx(np.hypot(*(arc[:, :2] - section[-1, :2]).T).min(), abs=0.005)


def test_the_fit_of_the_body_after_an_arc_equals_a_plain_reference() -> None:
    rng = np.random.default_rng(4)
    mask = rng.random((160, 160)) < 0.002
    field = DistanceField(distances(mask, 0.05), 0.05, Pose2(-1.0, 0.5, 0.2))
    pose = field.map_from_grid @ Pose2(4.0, 4.0, 0.7)
    candidates, times = rng.uniform((-0.3, -0.8), (0.8, 0.8), (200, 2)), rng.uniform(0.0, 2.5, 200)
    candidates[:3] = 0.0
    found = fits_after(footprint(CHAIR_A, 0.02, field), in_cells(field, pose), candidates, times)
    for (v, omega), time, fit in zip(candidates.tolist(), times.tolist(), found, strict=True):
        end = Pose2(*along_arc(pose.x, pose.y, pose.theta, v, omega, time))
        assert fit == ((v == 0.0 and omega == 0.0) or fits(CHAIR_A, 0.02, field, end))
    assert 20 < found.sum() < 180


def test_the_first_drivable_twist_equals_a_plain_reference() -> None:
    rng = np.random.default_rng(6)
    found = []
    for _ in range(60):
        field = DistanceField(distances(rng.random((120, 120)) < 0.004, 0.05), 0.05)
        shape, start = footprint(CHAIR_A, 0.02, field), in_cells(field, Pose2(3.0, 3.0, rng.uniform(-3.0, 3.0)))
        twists = rng.uniform((-0.3, -0.8), (0.8, 0.8), (6, 2))[rng.integers(6, size=30)]  # most of them several times
        times = rng.uniform(0.3, 1.5, 6)[np.unique(twists, axis=0, return_inverse=True)[1]]
        free = [
            free_time(shape, start, v / 0.05, omega, time, time) >= time
            for (v, omega), time in zip(twists.tolist(), times.tolist(), strict=True)
        ]
        found.append(first_free(shape, start, twists, times))
        assert found[-1] == (free.index(True) if any(free) else len(twists))
    assert {0, 30} < set(found)


def test_an_undrivable_arc_is_measured_no_further_than_its_free_length() -> None:
    field = distance_field(hall(((5.0, 0, 5.2, 8),)))
    pose = Pose2(3.0, 4.0)
    section, _ = local_section(straight(pose, 4.0).poses, pose.array(), 2.5)
    shape, start = footprint(CHAIR_A, 0.0, field), in_cells(field, pose)
    rows = measure(shape, start, np.array([[0.8, 0.0]]), poses_in_cells(field, section), np.array([2.0]), 2.5)
    assert 1.2 < rows[0, 0] < 2.0
    assert not rows[0, 1:].any()


def test_a_front_past_the_end_of_the_path_causes_no_error() -> None:
    """At the goal, the front reaches over it; only its distance from the prolonged path counts."""
    field = distance_field(hall())
    path = straight(Pose2(2.0, 4.0), 2.0)
    section, _ = local_section(path.poses, np.array([4.0, 4.0, 0.0]), 2.5)
    for theta, error in ((0.0, 0.0), (0.3, 0.55 * math.sin(0.3) / 2)):
        shape = footprint(CHAIR_A, 0.0, field)
        pose = Pose2(4.0, 4.0, theta)
        local = poses_in_cells(field, section)
        rows = measure(shape, in_cells(field, pose), np.zeros((1, 2)), local, np.array([2.5]), 2.5)
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


def test_a_stop_before_a_turn_is_comfortable_but_before_a_wall_it_is_immediate() -> None:
    pose, command, motion = Pose2(4.0, 4.0), Twist(0.5), CommandedMotion()
    free = rotate_to_heading(pose, command, 2.0, distance_field(hall()), CHAIR_A, PROMPT, motion)
    assert free.twist.v == pytest.approx(0.5 - PROMPT.jerk * PERIOD**2)
    front = 4.0 + CHAIR_A.front
    wall = distance_field(hall(((front + 0.22, 2.0, front + 0.32, 6.0),)))
    near = rotate_to_heading(pose, command, 2.0, wall, CHAIR_A, PROMPT, motion)
    assert near.twist.v == pytest.approx(0.5 - PROMPT.braking * PERIOD)


def test_the_speed_before_a_slow_place_falls_with_limited_jerk() -> None:
    field, pose, command, motion = distance_field(hall()), Pose2(2.0, 4.0), Twist(), STILL
    speeds = [0.0]
    for _ in range(200):
        fastest = slowing_speed(6.0 - pose.x, 0.25, PROMPT)
        path = straight(pose, 6.0)
        following = choose(pose, command, path, field, CHAIR_A, PROMPT, motion=motion, fastest=fastest).twist
        motion, command = motion_after(motion, command, following, PROMPT), following
        pose = moved(pose, command)
        speeds.append(command.v)
        if pose.x > 6.0:
            break
    assert max(speeds) > 0.6
    assert speeds[-1] == pytest.approx(0.25, abs=0.04)
    assert np.abs(np.diff(speeds, 2)).max() <= PROMPT.jerk * PERIOD**2 + 1e-9
