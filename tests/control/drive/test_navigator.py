"""The navigator in a hall with an ideal chair: goals, obstacles that appear, and readable reasons."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.control.drive.navigator_hall import NOTHING, TICK_NS, drive, hall, navigator, segment
from tests.people import body, half_view, past
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.drive import path_making
from waychair.control.drive.navigator import Navigation, Navigator, NavigatorSettings, Stage
from waychair.control.drive.recovery import RecoverySettings
from waychair.errors import GoalTooExact, UnknownPlace
from waychair.geometry import arc, transform_points
from waychair.planning.body.footprint import along_arc
from waychair.planning.harmonic import harmonic_search
from waychair.planning.harmonic.harmonic_field import HarmonicSettings
from waychair.planning.route import global_planner
from waychair.planning.route import multi_point_turn as manoeuvre
from waychair.planning.route.global_planner import PlannerSettings
from waychair.planning.seen import person_tracks as tracks
from waychair.types import Goal, Pose2, Twist


def test_a_named_place_is_reached_within_its_tolerances() -> None:
    pilot = navigator(hall())
    pilot.go(Goal("lift"))
    states, poses = drive(pilot, Pose2(2.0, 2.0, 0.0), 40)
    assert states[-1].stage is Stage.ARRIVED
    assert math.hypot(poses[-1].x - 9.0, poses[-1].y - 5.0) < 0.15
    assert abs(poses[-1].theta - 1.0) < math.radians(5)
    assert not pilot.active


def test_the_papers_window_drives_the_chair_as_a_preset() -> None:
    ways = dict[str, list[Pose2]]()
    for window in ("own", "paper"):
        pilot = navigator(hall((5.0, 3.2, 6.0, 4.6)), NavigatorSettings(window=window))
        pilot.go(Goal("lift"))
        states, ways[window] = drive(pilot, Pose2(2.0, 3.0, 0.0), 60)
        assert states[-1].stage is Stage.ARRIVED
    assert np.hypot(ways["paper"][40].x - ways["own"][40].x, ways["paper"][40].y - ways["own"][40].y) > 0.02


def test_an_unknown_place_is_refused_at_once() -> None:
    with pytest.raises(UnknownPlace, match="lift"):
        navigator(hall()).go(Goal("lfit"))


@pytest.mark.parametrize(
    ("goal", "start", "said"),
    [
        (Pose2(50.0, 3.0), Pose2(2.0, 2.0), "outside the map"),
        (Pose2(6.0, 4.0), Pose2(2.0, 2.0), "does not fit at the goal"),
        (Pose2(9.0, 3.0), Pose2(-5.0, 2.0), "outside the map"),
        (Pose2(9.0, 3.0), Pose2(6.0, 4.0), "does not fit at its start"),
    ],
)
def test_impossible_goals_and_starts_fail_with_a_reason_and_no_motion(goal: Pose2, start: Pose2, said: str) -> None:
    pilot = navigator(hall((5.5, 3.5, 6.5, 4.5)))
    pilot.go(Goal(goal))
    state = pilot.step(0, start, NOTHING)
    assert state.stage is Stage.FAILED
    assert said in state.reason
    assert (state.twist.v, state.twist.omega) == (0.0, 0.0)


def test_a_walled_in_start_has_no_path_and_the_message_has_advice() -> None:
    pilot = navigator(hall((4.0, 0.0, 4.1, 8.0)))
    pilot.go(Goal("lift"))
    state = pilot.step(0, Pose2(2.0, 2.0), NOTHING)
    assert state.stage is Stage.FAILED
    assert "walls on the map close every way; map again" in state.reason


def test_the_chair_drives_round_a_board_across_the_planned_way() -> None:
    pilot = navigator(hall())
    pilot.go(Goal(Pose2(10.0, 4.0, 0.0)))
    board = segment(5.0, 3.0, 5.0, 5.0)
    states, poses = drive(pilot, Pose2(1.5, 4.0, 0.0), 60, board)
    assert states[-1].stage is Stage.ARRIVED
    nearest = min(np.hypot(*(board - (pose.x, pose.y)).T).min() for pose in poses)
    assert nearest > CHAIR_A.width / 2


def test_the_chair_waits_at_a_closed_way_and_then_gives_up_with_a_reason() -> None:
    grid = hall((6.0, 0.0, 6.1, 3.0), (6.0, 5.0, 6.1, 8.0))
    pilot = navigator(grid, NavigatorSettings(recovery=RecoverySettings(patience=5.0)))
    pilot.go(Goal(Pose2(10.0, 4.0, 0.0)))
    moving, poses = drive(pilot, Pose2(2.0, 4.0, 0.0), 2.0)
    assert moving[-1].stage is Stage.DRIVING
    states, poses = drive(pilot, poses[-1], 120, segment(6.05, 3.0, 6.05, 5.0), start_ns=2_000_000_000)
    assert any(state.stage is Stage.WAITING and "waiting" in state.reason for state in states)
    assert states[-1].stage is Stage.FAILED
    assert "choose another goal" in states[-1].reason
    assert max(pose.x for pose in poses) + CHAIR_A.front < 6.05


def test_the_chair_drives_on_when_the_way_opens_again() -> None:
    grid = hall((6.0, 0.0, 6.1, 3.0), (6.0, 5.0, 6.1, 8.0))
    pilot = navigator(grid)
    pilot.go(Goal(Pose2(10.0, 4.0, 0.0)))
    states, poses = drive(pilot, Pose2(2.0, 4.0, 0.0), 12.0, segment(6.05, 3.0, 6.05, 5.0))
    assert states[-1].stage is Stage.WAITING
    assert states[-1].reason.count("waiting") == 1
    states, poses = drive(pilot, poses[-1], 60, NOTHING, start_ns=12_000_000_000)
    assert states[-1].stage is Stage.ARRIVED
    assert min(pose.x for pose in poses) > 1.98  # it did not back out first


def test_the_chair_drives_near_an_occupied_goal_and_waits_for_it() -> None:
    pilot = navigator(hall())
    pilot.go(Goal(Pose2(10.0, 4.0, 0.0)))
    box = np.concatenate([segment(9.7, y, 10.3, y) for y in np.arange(3.7, 4.31, 0.1)])
    states, poses = drive(pilot, Pose2(2.0, 4.0, 0.0), 20.0, box)
    assert states[-1].stage is Stage.WAITING
    assert "stands where the goal is" in states[-1].reason
    away = math.hypot(poses[-1].x - 10.0, poses[-1].y - 4.0)
    assert CHAIR_A.front + 0.3 < away < NavigatorSettings().goal_wait_distance + 0.1
    states, _ = drive(pilot, poses[-1], 30.0, NOTHING, start_ns=20_000_000_000)
    assert states[-1].stage is Stage.ARRIVED


def test_cancelling_stops_the_chair_and_nothing_resumes() -> None:
    pilot = navigator(hall())
    pilot.go(Goal("lift"))
    _, poses = drive(pilot, Pose2(2.0, 2.0, 0.0), 3.0)
    pilot.cancel("the rider drives by joystick")
    state = pilot.step(10**10, poses[-1], NOTHING)
    assert (state.stage, state.twist.v, state.driving) == (Stage.FAILED, 0.0, False)
    assert state.reason == "the rider drives by joystick"


def test_a_chair_that_makes_no_progress_backs_out_and_finally_gives_up() -> None:
    pilot = navigator(hall(), NavigatorSettings(recovery=RecoverySettings(progress_time=2.0, tries=2, patience=20.0)))
    pilot.go(Goal("lift"))
    here = Pose2(2.0, 2.0, 0.0)
    for k in range(20 * 120):
        state = pilot.step(k * TICK_NS, here, NOTHING)
        if state.stage is Stage.FAILED:
            break
    assert state.stage is Stage.FAILED
    assert "2 tries" in state.reason


def test_goals_are_driven_to_one_after_the_other() -> None:
    pilot = navigator(hall())
    pilot.go(Goal(Pose2(5.0, 2.0, 0.0)), Goal("lift"))
    states, poses = drive(pilot, Pose2(2.0, 2.0, 0.0), 80)
    assert states[-1].stage is Stage.ARRIVED
    assert {state.goals for state in states} == {0, 1, 2}
    assert min(math.hypot(pose.x - 5.0, pose.y - 2.0) for pose in poses) < 0.1
    assert math.hypot(poses[-1].x - 9.0, poses[-1].y - 5.0) < 0.15


def test_an_unknown_place_later_in_a_sequence_is_refused_at_once_and_the_present_goal_stays() -> None:
    pilot = navigator(hall())
    pilot.go(Goal("lift"))
    with pytest.raises(UnknownPlace):
        pilot.go(Goal("lift"), Goal("lfit"))
    assert pilot.active


def test_a_goal_with_impossible_tolerances_is_refused_and_the_present_goal_stays() -> None:
    pilot = navigator(hall())
    pilot.go(Goal("lift"))
    _, poses = drive(pilot, Pose2(2.0, 2.0, 0.0), 5)
    for told in ((0.01, 0.1), (0.1, 0.01), (math.nan, 0.1)):
        for goals in ((Goal(Pose2(3.0, 6.0), *told),), (Goal("lift"), Goal(Pose2(3.0, 6.0), *told))):
            with pytest.raises(GoalTooExact, match="give it those or more"):
                pilot.go(*goals)
    states, poses = drive(pilot, poses[-1], 40, start_ns=100 * TICK_NS)
    assert states[-1].stage is Stage.ARRIVED
    assert math.hypot(poses[-1].x - 9.0, poses[-1].y - 5.0) < 0.15


def test_a_goal_with_the_smallest_tolerances_is_reached() -> None:
    pilot = navigator(hall())
    pilot.go(Goal(Pose2(5.0, 4.0, 1.0), 0.02, 0.02))
    states, poses = drive(pilot, Pose2(2.0, 2.0, 0.0), 40)
    assert states[-1].stage is Stage.ARRIVED
    assert math.hypot(poses[-1].x - 5.0, poses[-1].y - 4.0) <= 0.02
    assert abs(poses[-1].theta - 1.0) <= 0.02


@pytest.mark.parametrize(
    "nowhere",
    [
        Pose2(math.nan, 2.0, 0.0),
        *(
            pytest.param(pose, marks=pytest.mark.nightly)
            for pose in (Pose2(2.0, 2.0, math.nan), Pose2(math.inf, 2.0, 0.0))
        ),
    ],
)
@pytest.mark.parametrize("odom", [False, True])
def test_a_pose_that_is_not_a_number_stops_the_chair_and_does_not_raise(nowhere: Pose2, odom: bool) -> None:
    pilot = navigator(hall())
    pilot.go(Goal("lift"))
    states, poses = drive(pilot, Pose2(2.0, 2.0, 0.7), 4)
    assert states[-1].twist.v > 0.1
    pose, map_from_odom = (poses[-1], nowhere) if odom else (nowhere, Pose2())
    for k in range(80):
        state = pilot.step((80 + k) * TICK_NS, pose, NOTHING, map_from_odom)
    assert (state.stage, state.twist) == (Stage.WAITING, Twist())
    assert "where it is" in state.reason
    states, _ = drive(pilot, poses[-1], 60, start_ns=160 * TICK_NS)
    assert states[-1].stage is Stage.ARRIVED


@pytest.mark.parametrize("solver", ["gauss-siedel", "gpu"])
def test_a_missing_solver_ends_the_drive_with_a_reason(solver: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if solver == "gpu":
        monkeypatch.setitem(sys.modules, "numba.cuda", None)
    settings = PlannerSettings(planner="harmonic", harmonic=HarmonicSettings(solver=solver))
    pilot = navigator(hall(), NavigatorSettings(planner=settings))
    pilot.go(Goal("lift"))
    states, _ = drive(pilot, Pose2(2.0, 2.0, 0.0), 5)
    assert states[-1].stage is Stage.FAILED
    assert solver in states[-1].reason


def test_a_chair_that_has_slid_off_beside_the_end_of_its_line_has_not_arrived() -> None:
    pilot = navigator(hall())
    pilot.go(Goal(Pose2(4.5, 3.0, math.pi)))
    states, poses, slid = [], [Pose2(4.0, 3.0, 0.0)], False
    for k in range(1600):
        states.append(pilot.step(k * TICK_NS, poses[-1], NOTHING if k % 2 == 0 else None))
        if states[-1].stage in (Stage.ARRIVED, Stage.FAILED):
            break
        pose = poses[-1] @ arc(states[-1].twist.v * 0.05, states[-1].twist.omega * 0.05)
        if not slid and math.hypot(pose.x - 4.5, pose.y - 3.0) < 0.05 and states[-1].leg is not None:
            assert states[-1].leg.is_line
            pose, slid = Pose2(pose.x, pose.y + 0.35, pose.theta), True
        poses.append(pose)
    assert slid
    assert states[-1].stage is Stage.ARRIVED
    assert math.hypot(poses[-1].x - 4.5, poses[-1].y - 3.0) < 0.15


def test_a_paused_chair_stands_still_until_the_pause_ends() -> None:
    pilot = navigator(hall())
    pilot.go(Goal("lift"))
    _, poses = drive(pilot, Pose2(2.0, 2.0, 0.0), 4.0)
    pilot.pause()
    states, poses = drive(pilot, poses[-1], 60.0, start_ns=4 * 10**9)
    assert {state.stage for state in states} == {Stage.PAUSED}
    assert all(state.driving for state in states)
    assert (states[-1].twist.v, states[-1].twist.omega) == (0.0, 0.0)
    pilot.resume()
    states, _ = drive(pilot, poses[-1], 60.0, start_ns=70 * 10**9)
    assert states[-1].stage is Stage.ARRIVED


def test_a_goal_that_moves_during_the_drive_is_reached_without_a_stop() -> None:
    pilot = navigator(hall())
    pilot.go(Goal(Pose2(9.0, 2.0, 0.0)))
    moving, poses = drive(pilot, Pose2(2.0, 2.0, 0.0), 4.0)
    pilot.go(Goal(Pose2(9.0, 4.0, 0.0)))
    states, poses = drive(pilot, poses[-1], 60.0, start_ns=4 * 10**9)
    assert states[0].twist.v > 0.9 * moving[-1].twist.v > 0.3
    assert poses[-1].y == pytest.approx(4.0, abs=0.15)


@pytest.mark.parametrize("jump", [0.1, 0.5, *(pytest.param(m, marks=pytest.mark.nightly) for m in (0.05, 0.2))])
def test_a_jump_of_the_localisation_slows_the_chair_and_it_drives_on_from_its_new_pose(jump: float) -> None:
    """The odometry is perfect; its correction jumps sideways while the chair drives."""
    pilot = navigator(hall())
    pilot.go(Goal(Pose2(10.0, 4.0, 0.0)))
    map_from_odom, odom = Pose2(), Pose2(1.5, 4.0, 0.0)
    state, before, speeds = Navigation(Stage.IDLE), 0, []
    for k in range(20 * 60):
        if k == 100:
            map_from_odom, before = Pose2(0.0, jump + 0.005, 0.0), state.plans
        state = pilot.step(k * TICK_NS, map_from_odom @ odom, NOTHING if k % 2 == 0 else None, map_from_odom)
        speeds.append(state.twist.v)
        if state.stage in (Stage.ARRIVED, Stage.FAILED):
            break
        odom = Pose2(*along_arc(odom.x, odom.y, odom.theta, state.twist.v, state.twist.omega, 0.05))
    at = map_from_odom @ odom
    assert state.stage is Stage.ARRIVED
    assert math.hypot(at.x - 10.0, at.y - 4.0) < 0.15
    assert state.plans > before
    assert speeds[99] > 0.4
    assert min(speeds[100:122]) < 0.25
    assert max(speeds[130:170]) > 0.4, "and picks up speed again"
    assert np.abs(np.diff(speeds)).max() < 0.6 * 0.05 + 1e-6, "without a jerk"


def test_slow_drift_does_not_count_as_a_jump() -> None:
    pilot = navigator(hall())
    pilot.go(Goal(Pose2(10.0, 4.0, 0.0)))
    state, odom, speeds = Navigation(Stage.IDLE), Pose2(1.5, 4.0, 0.0), []
    for k in range(20 * 60):
        map_from_odom = Pose2(0.0, 0.0002 * k, 0.0)
        state = pilot.step(k * TICK_NS, map_from_odom @ odom, NOTHING if k % 2 == 0 else None, map_from_odom)
        speeds.append(state.twist.v)
        if state.stage in (Stage.ARRIVED, Stage.FAILED):
            break
        odom = Pose2(*along_arc(odom.x, odom.y, odom.theta, state.twist.v, state.twist.omega, 0.05))
    assert state.stage is Stage.ARRIVED
    assert state.plans == 1


@pytest.mark.nightly
def test_the_origin_of_odom_in_the_map_makes_no_difference() -> None:
    board = segment(5.0, 3.0, 5.0, 5.0)
    twists = []
    for map_from_odom in (None, Pose2(-3.0, 7.0, 2.0)):
        pilot, pose = navigator(hall()), Pose2(1.5, 4.0, 0.0)
        pilot.go(Goal(Pose2(10.0, 4.0, 0.0)))
        told = []
        for k in range(160):
            state = pilot.step(k * TICK_NS, pose, board if k % 2 == 0 else None, map_from_odom)
            told.append((state.twist.v, state.twist.omega))
            pose = Pose2(*along_arc(pose.x, pose.y, pose.theta, *told[-1], 0.05))
        twists.append(told)
    np.testing.assert_allclose(twists[0], twists[1], atol=0.05)


def test_a_mixed_pixel_between_two_surfaces_is_no_obstacle() -> None:
    pilot = navigator(hall())
    pilot.go(Goal(Pose2(10.0, 4.0, 0.0)))
    states, pose = [], Pose2(1.5, 4.0, 0.0)
    for k in range(1200):
        split = np.array([[1.5, 5.5], [2.5, 4.0], [6.0, 4.2]]) + np.array([pose.x, 0.0])
        states.append(pilot.step(k * TICK_NS, pose, split if k % 2 == 0 else None))
        if states[-1].stage is Stage.ARRIVED:
            break
        pose = Pose2(*along_arc(pose.x, pose.y, pose.theta, states[-1].twist.v, states[-1].twist.omega, 0.05))
        assert abs(pose.y - 4.0) < 0.1
    assert states[-1].stage is Stage.ARRIVED
    assert states[-1].plans == 1


def test_a_long_search_for_a_turn_is_spread_over_ticks_at_standstill(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(manoeuvre, "CHECKS_PER_STEP", 5)
    grid = hall((0.0, 0.0, 12.0, 3.0), (0.0, 4.5, 12.0, 8.0), (6.0, 0.0, 12.0, 8.0))
    pilot = navigator(grid)
    pilot.go(Goal(Pose2(1.5, 3.75, math.pi)))
    here, states = Pose2(5.0, 3.75, 0.0), []
    for k in range(2000):
        states.append(pilot.step(k * TICK_NS, here, NOTHING if k % 2 == 0 else None))
        if states[-1].path is not None:
            break
    assert len(states) > 5
    assert all(state.stage is Stage.DRIVING and state.twist == Twist() for state in states[:-1])
    assert states[-1].path is not None


@pytest.fixture
def slow_field(monkeypatch: pytest.MonkeyPatch) -> None:
    """Solve few cells a tick, so that a field takes many ticks."""
    for module in (global_planner, harmonic_search):
        monkeypatch.setattr(module, "CELLS_PER_STEP", 120_000)


def harmonic(**told: float) -> NavigatorSettings:
    """The harmonic planner."""
    return NavigatorSettings(planner=PlannerSettings(planner="harmonic"), **told)  # type: ignore[arg-type]


@pytest.mark.usefixtures("slow_field")
def test_while_a_field_is_solved_over_ticks_the_chair_follows_its_present_path() -> None:
    pilot = navigator(hall(), harmonic())
    pilot.go(Goal(Pose2(10.0, 4.0, 0.0)))
    states, _ = drive(pilot, Pose2(2.0, 4.0, 0.0), 12)
    first = next(k for k, state in enumerate(states) if state.path is not None)
    assert first > 5
    assert all(state.twist == Twist() for state in states[:first])
    board = segment(5.0, 2.5, 5.0, 4.5)
    replanned = drive(pilot, Pose2(2.5, 4.0, 0.0), 4, board, 12_000_000_000)[0]
    new = next(k for k, state in enumerate(replanned) if state.plans > states[-1].plans)
    assert new > 5
    assert all(state.path is states[-1].path and state.stage is Stage.DRIVING for state in replanned[:new])
    assert replanned[new - 1].twist.v > 0.2
    path = replanned[new].path
    assert path is not None
    assert np.hypot(*(path.poses[:, None, :2] - board[None]).transpose(2, 0, 1)).min() > CHAIR_A.width / 2


@pytest.mark.usefixtures("slow_field")
def test_a_field_not_found_in_time_leaves_the_present_path(monkeypatch: pytest.MonkeyPatch) -> None:
    pilot = navigator(hall(), harmonic())
    pilot.go(Goal(Pose2(10.0, 4.0, 0.0)))
    states, poses = drive(pilot, Pose2(2.0, 4.0, 0.0), 6)
    monkeypatch.setattr(path_making, "LONGEST_FIELD_S", 0.1)
    later = drive(pilot, poses[-1], 3, segment(8.0, 2.5, 8.0, 4.5), 6_000_000_000)[0]
    assert later[-1].plans == states[-1].plans == 1
    assert later[-1].path is states[-1].path
    assert all(state.stage is Stage.DRIVING for state in later[:20])


@pytest.mark.usefixtures("slow_field")
def test_a_field_that_does_not_converge_is_reported_with_its_residual(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(path_making, "LONGEST_FIELD_S", 0.1)
    pilot = navigator(hall(), harmonic())
    pilot.go(Goal(Pose2(10.0, 4.0, 0.0)))
    states, poses = drive(pilot, Pose2(2.0, 4.0, 0.0), 6)
    assert states[-1].stage is Stage.FAILED
    assert "the field's relative residual is" in states[-1].reason
    assert poses[-1] == poses[0]


@pytest.mark.parametrize("planner", ["harmonic", "dstar-lite"])
def test_a_person_who_crosses_far_ahead_neither_changes_the_route_nor_turns_the_chair_back(planner: str) -> None:
    """A person, seen all the way, crosses at a place that the chair reaches only later."""
    pilot = navigator(hall(), NavigatorSettings(planner=PlannerSettings(planner=planner)))
    pilot.go(Goal(Pose2(10.0, 4.0, 0.0)))
    pose, states = Pose2(2.0, 4.0, 0.0), []
    for k in range(20 * 6):
        at = 9.0, 7.0 - 0.9 * k * 0.05
        states.append(pilot.step(k * TICK_NS, pose, body(*at) if k % 2 == 0 else None, beyond=past(pose, *at, 0.05)))
        v, omega = states[-1].twist.v, states[-1].twist.omega
        pose = Pose2(*along_arc(pose.x, pose.y, pose.theta, v, omega, 0.05))
        assert abs(pose.y - 4.0) < 0.3
        assert v >= 0.0
    assert states[-1].plans <= 2
    assert pose.x > 4.5


def crossing(pilot: Navigator, seconds: float = 9.0) -> tuple[float, float]:
    """Return the least distance [m] to a person who crosses the chair's way at 0.7 m/s, and the chair's speed [m/s]
    then."""
    pilot.go(Goal(Pose2(10.0, 4.0, 0.0)))
    pose, command = Pose2(2.0, 4.0, 0.0), Twist()
    nearest, speed = math.inf, 0.0
    for k in range(round(20 * seconds)):
        middle = np.array([6.0, 8.0 - 0.7 * k * 0.05])
        command = pilot.step(k * TICK_NS, pose, body(*middle) if k % 2 == 0 else None).twist
        pose = Pose2(*along_arc(pose.x, pose.y, pose.theta, command.v, command.omega, 0.05))
        x, y = transform_points(pose.inverse(), middle[None])[0]
        off = math.hypot(max(x - CHAIR_A.front, -CHAIR_A.rear - x, 0.0), max(abs(y) - CHAIR_A.width / 2, 0.0))
        if off < nearest:
            nearest, speed = off, abs(command.v)
    return nearest, speed


@pytest.mark.nightly
def test_people_who_cross_are_predicted_and_pass_first(monkeypatch: pytest.MonkeyPatch) -> None:
    foreseen, _ = crossing(navigator(hall()))
    blind = replace(tracks.PEOPLE, walking=2.0, displacement=5.0)
    monkeypatch.setattr(tracks, "MODELS", {"people": blind})
    surprised, _ = crossing(navigator(hall()))
    assert foreseen > 0.25
    assert foreseen > surprised


def in_a_corridor(way: Callable[[float], tuple[float, float]], seconds: float) -> tuple[list[Navigation], list[Pose2]]:
    """Drive a chair along a corridor of 2 m, y from 3 m to 5 m, in which a person walks."""
    pilot = navigator(hall((0.0, 0.0, 12.0, 3.0), (0.0, 5.0, 12.0, 8.0)))
    pilot.go(Goal(Pose2(10.5, 4.0, 0.0)))
    poses, states = [Pose2(1.5, 4.0, 0.0)], []
    for k in range(round(20 * seconds)):
        pose = poses[-1]
        at = way(k * 0.05)
        free = past(pose, *at, half_view(pose, *at))
        states.append(pilot.step(k * TICK_NS, pose, body(*at) if k % 2 == 0 else None, beyond=free))
        if not pilot.active:
            break
        v, omega = states[-1].twist.v, states[-1].twist.omega
        poses.append(Pose2(*along_arc(pose.x, pose.y, pose.theta, v, omega, 0.05)))
    return states, poses


@pytest.mark.parametrize("begin", [11.0, *(pytest.param(x, marks=pytest.mark.nightly) for x in (10.97, 11.1))])
def test_the_chair_passes_an_oncoming_person_in_a_corridor_on_its_right(begin: float) -> None:
    states, poses = in_a_corridor(lambda s: (begin - 0.7 * s, 4.5), 30.0)
    assert states[-1].stage is Stage.ARRIVED
    met = next(pose for k, pose in enumerate(poses) if begin - 0.7 * 0.05 * k < pose.x)
    assert 3.4 < met.y < 3.8  # 10 cm from the wall, at least, and out of the room kept round a person
    assert abs(poses[-1].y - 4.0) < 0.15


@pytest.mark.nightly
def test_the_chair_passes_somebody_who_turns_round_and_comes_back_along_its_own_side_on_the_other() -> None:
    states, poses = in_a_corridor(lambda s: (10.5 - 0.7 * abs(s - 4.0), 3.5), 30.0)
    assert states[-1].stage is Stage.ARRIVED
    met = next(pose for k, pose in enumerate(poses) if k > 80 and 10.5 - 0.7 * abs(0.05 * k - 4.0) < pose.x)
    assert met.y > 4.1


@pytest.mark.nightly
def test_a_person_who_paces_beside_the_way_changes_no_plan() -> None:
    states, poses = in_a_corridor(lambda s: (6.0, 4.55 + 0.25 * math.sin(2.0 * s)), 60.0)
    assert states[-1].stage is Stage.ARRIVED
    assert states[-1].plans <= 6
    assert max(abs(pose.theta) for pose in poses) < 0.7
