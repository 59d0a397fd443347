"""A chair with lag follows lines to the centimetre, forwards and backwards, as fast as their room and bends allow."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.drive import way_follower as following
from waychair.control.drive.way_follower import WayFollower
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.footprint import along_arc
from waychair.planning.route.legs import DoorPassage, PathLeg
from waychair.planning.window.dwa import DwaResult
from waychair.planning.window.motion_limits import (
    ERROR_PER_SPEED,
    ERROR_STANDING,
    MIN_SPEED,
    PERIOD,
    CommandedMotion,
    DwaSettings,
    GoalTolerances,
    motion_after,
)
from waychair.types import FloatArray, Path, Pose2, Twist

LIMITS = DwaSettings()
OPEN = DistanceField(np.full((600, 600), 5.0, np.float32), 0.02, Pose2(-6.0, -6.0, 0.0))


def follower(line: FloatArray, backwards: bool = False, room: float = 0.16) -> WayFollower:
    return WayFollower(PathLeg(Path(line), np.full(len(line), room), backwards), CHAIR_A)


def step(
    follow: WayFollower, pose: Pose2, command: Twist, field: DistanceField = OPEN, limits: DwaSettings = LIMITS
) -> DwaResult:
    return follow.step(Pose2(), pose, command, field, limits, None)


def straight(length: float, backwards: bool = False) -> FloatArray:
    x = np.linspace(0.0, -length if backwards else length, max(2, round(length / 0.05) + 1))
    return np.column_stack([x, np.zeros((len(x), 2))])


def drive(
    pose: Pose2, line: FloatArray, backwards: bool = False, field: DistanceField = OPEN, room: float = 0.16
) -> tuple[list[Pose2], list[float]]:
    """Drive a chair with the simulated delay and lag to the end of the line or for 40 s; return its poses and speeds."""
    poses, command, motion, v, omega = [pose], Twist(), CommandedMotion(), 0.0, 0.0
    follow, limits, delayed, speeds = follower(line, backwards, room), DwaSettings(), deque([Twist()]), [0.0]
    for _ in range(800):
        choice = follow.step(Pose2(), poses[-1], command, field, limits, motion)
        motion, command = motion_after(motion, command, choice.twist, limits), choice.twist
        if choice.arrived or choice.blocked:
            break
        delayed.append(command)
        told = delayed.popleft()
        v += (told.v - v) * 0.05 / 0.14
        omega += (told.omega - omega) * 0.05 / 0.14
        p = poses[-1]
        poses.append(Pose2(*along_arc(p.x, p.y, p.theta, v, omega, 0.05)))
        speeds.append(command.v)
    return poses, speeds


@given(st.floats(-0.12, 0.12), st.floats(-0.3, 0.3), st.booleans())
@settings(max_examples=15)
def test_initial_errors_are_gone_after_two_metres(lateral: float, heading: float, backwards: bool) -> None:
    poses, _ = drive(Pose2(0.0, lateral, heading), straight(3.0, backwards), backwards)
    late = [pose for pose in poses if abs(pose.x) > 2.2]
    assert late
    assert max(abs(pose.y) for pose in late) < 0.015
    assert abs(poses[-1].x) == pytest.approx(3.0, abs=0.04)
    assert abs(poses[-1].theta) < 0.04


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("radius", [-1.0, 0.6, 2.0])
def test_an_arc_without_room_is_followed_to_two_centimetres(radius: float, backwards: bool) -> None:
    way = np.linspace(0.0, -1.2 if backwards else 1.2, 25)
    line = np.array([along_arc(0.0, 0.0, 0.0, s, s / radius, 1.0) for s in way])
    poses, _ = drive(Pose2(), line, backwards, room=0.02)
    off = [abs(math.hypot(pose.x, pose.y - radius) - abs(radius)) for pose in poses]
    assert max(off) < 0.02


def test_a_wall_across_the_line_stops_the_chair_before_it() -> None:
    columns = (np.arange(600) + 0.5) * 0.02 - 6.0
    metres = np.repeat(np.abs(columns - 1.5)[None], 600, axis=0).astype(np.float32)
    poses, _ = drive(Pose2(), straight(2.0), field=DistanceField(metres, 0.02, OPEN.map_from_grid))
    assert 1.3 < poses[-1].x + CHAIR_A.front < 1.5


@pytest.mark.parametrize("backwards", [False, True])
def test_beside_things_the_chair_is_as_fast_as_its_error_stays_within_its_room(backwards: bool) -> None:
    for room in (0.03, 0.02):
        _, speeds = drive(Pose2(), straight(2.0, backwards), backwards, room=room)
        most = max((room - ERROR_STANDING) / ERROR_PER_SPEED, 0.15)
        top = DwaSettings().max_reverse if backwards else DwaSettings().max_speed
        assert max(map(abs, speeds)) == pytest.approx(min(most, top), rel=0.05)


def test_with_room_a_long_line_is_driven_at_full_speed_and_ended_exactly() -> None:
    poses, speeds = drive(Pose2(), straight(5.0))
    assert max(speeds) > 0.95 * DwaSettings().max_speed
    assert poses[-1].x == pytest.approx(5.0, abs=0.03)


@pytest.mark.parametrize("backwards", [False, True])
def test_on_the_way_down_the_jerk_is_limited(backwards: bool) -> None:
    limits, sign = DwaSettings(reaction_time=0.0), -1.0 if backwards else 1.0
    follow, pose, motion = follower(straight(2.5, backwards), backwards), Pose2(0.0, 0.02, 0.0), CommandedMotion()
    speeds, command = [0.0, 0.0], Twist()
    for _ in range(800):
        choice = follow.step(Pose2(), pose, command, OPEN, limits, motion)
        motion, command = motion_after(motion, command, choice.twist, limits), choice.twist
        speeds.append(command.v)
        pose = Pose2(*along_arc(pose.x, pose.y, pose.theta, command.v, command.omega, PERIOD))
        if choice.arrived:
            break
    assert choice.arrived
    steps = np.diff(np.abs(speeds))
    slows = (steps[1:] < 0.0) & (steps[:-1] <= 0.0) & (np.abs(speeds)[2:] > 2 * MIN_SPEED)
    assert slows.sum() > 8
    assert np.abs(np.diff(steps)[slows]).max() <= 1.1 * limits.jerk * PERIOD**2
    assert abs(pose.x - sign * 2.5) < 0.03


def test_a_line_with_half_a_centimetre_of_clearance_is_followed_to_its_end() -> None:
    rows = (np.arange(300) + 0.5) * 0.01 - 1.5
    columns = (np.arange(400) + 0.5) * 0.01 - 1.0
    gap = CHAIR_A.width / 2 + np.where(columns < 1.0, 0.05, 0.016)  # of which one cell is kept for safety
    metres = np.maximum(gap[None] - np.abs(rows)[:, None], 0.0).astype(np.float32)
    tube = DistanceField(metres, 0.01, Pose2(-1.0, -1.5, 0.0))
    poses, _ = drive(Pose2(), straight(1.0), field=tube, room=0.01)
    assert poses[-1].x == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(("lateral", "goes"), [(0.01, True), (0.03, False)])
def test_off_its_line_a_chair_does_not_touch_obstacles_beside_the_line(lateral: float, goes: bool) -> None:
    rows = (np.arange(300) + 0.5) * 0.01 - 1.5
    metres = np.repeat(np.maximum(rows + CHAIR_A.width / 2 + 0.016 + lateral, 0.0)[:, None], 400, axis=1)
    wall = DistanceField(metres.astype(np.float32), 0.01, Pose2(-1.0, -1.5, 0.0))  # 1.6 cm from the chair's right side
    choice = step(follower(straight(1.0), room=0.02), Pose2(0.2, -lateral, 0.0), Twist(), wall)
    assert choice.blocked is not goes


def test_a_chair_with_a_wall_behind_turns_while_driving_and_not_on_the_spot() -> None:
    columns = (np.arange(400) + 0.5) * 0.01 - 1.0
    metres = np.repeat(np.maximum(columns + CHAIR_A.rear + 0.03, 0.0)[None], 300, axis=0)
    wall = DistanceField(metres.astype(np.float32), 0.01, Pose2(-1.0, -1.5, 0.0))
    along = np.linspace(0.0, 1.2, 25)
    line = np.column_stack([along * math.cos(0.25), along * math.sin(0.25), np.full(25, 0.25)])
    end = drive(Pose2(), line, field=wall)[0][-1]
    assert math.hypot(end.x, end.y) == pytest.approx(1.2, abs=0.03)
    assert abs(end.y * math.cos(0.25) - end.x * math.sin(0.25)) < 0.02


def test_before_a_sharp_bend_the_chair_slows_to_what_it_can_steer() -> None:
    line = [np.zeros(3)]
    for turn in np.repeat([0.0, 1.7, -1.7, 0.0], [40, 6, 6, 20]) * 0.05:
        line.append(np.array(along_arc(*line[-1], 0.05, float(turn), 1.0)))
    poses, speeds = drive(Pose2(), np.array(line))
    assert max(speeds) > 0.6
    off = [min(math.dist((pose.x, pose.y), at[:2]) for at in line) for pose in poses]
    assert max(off) < 0.05


@pytest.mark.parametrize("way", [0.1, 0.2, 0.3, 0.5])
def test_a_chair_that_still_accelerates_stops_at_the_end_of_the_line(way: float) -> None:
    assert abs(drive(Pose2(), straight(way))[0][-1].x - way) < 0.025


@pytest.mark.parametrize("backwards", [False, True])
def test_a_line_is_driven_no_faster_than_the_speed_limit(backwards: bool) -> None:
    limits, follow = DwaSettings(max_speed=0.15, max_reverse=0.12), follower(straight(2.0, backwards), backwards)
    command, pose, speeds = Twist(), Pose2(), [0.0]
    for _ in range(100):
        command = step(follow, pose, command, limits=limits).twist
        pose = Pose2(*along_arc(pose.x, pose.y, pose.theta, command.v, command.omega, 0.05))
        speeds.append(command.v)
    assert max(speeds) == pytest.approx(0.0 if backwards else 0.15, abs=0.01)
    assert min(speeds) == pytest.approx(-0.12 if backwards else 0.0, abs=0.01)


def test_a_chair_that_may_not_reverse_now_does_not_reverse_on_a_line() -> None:
    begun = step(follower(straight(2.0, True), True), Pose2(), Twist(-0.2), limits=DwaSettings(max_reverse=0.0))
    assert begun.blocked
    assert -0.2 < begun.twist.v < -0.1
    resting = step(follower(straight(2.0, True), True), Pose2(), Twist(), limits=DwaSettings(max_reverse=0.0))
    assert resting.twist == Twist()


def test_the_line_moves_onto_the_axis_of_a_door_that_is_seen_beside_the_mapped_one() -> None:
    door, line = DoorPassage(Pose2(3.0, 0.0, 0.0), 0.8), straight(6.0)
    leg = PathLeg(Path(line), np.full(len(line), 0.05), doors=(door,))
    follow, pose, command = WayFollower(leg, CHAIR_A), Pose2(), Twist()
    seen = [(door, Pose2(3.0, 0.05, 0.0))]
    at_the_door = []
    for _ in range(800):
        choice = follow.step(Pose2(), pose, command, OPEN, DwaSettings(), None, seen)
        command = choice.twist
        pose = Pose2(*along_arc(pose.x, pose.y, pose.theta, command.v, command.omega, PERIOD))
        if abs(pose.x - 3.0) < 0.1:
            at_the_door.append(pose)
        if choice.arrived:
            break
    assert at_the_door
    assert max(abs(at.y - 0.05) for at in at_the_door) < 0.02
    assert abs(pose.y) < 0.02, "beyond the door the line is the planned one"


def test_without_a_dead_band_a_line_is_driven_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(following, "MIN_SPEED", 0.0)
    follow, command, pose = follower(straight(1.0)), Twist(), Pose2()
    for _ in range(600):
        choice = step(follow, pose, command)
        command = choice.twist
        pose = Pose2(*along_arc(pose.x, pose.y, pose.theta, command.v, command.omega, 0.05))
        if choice.arrived:
            return
    pytest.fail("the chair has not arrived")


def test_a_leg_without_its_room_is_not_followed() -> None:
    with pytest.raises(ValueError, match="room"):
        WayFollower(PathLeg(Path(straight(1.0))), CHAIR_A)


def test_a_chair_that_strays_from_its_line_is_slower_beside_things() -> None:
    follow = follower(straight(6.0), room=0.06)
    step(follow, Pose2(0.9, 0.0, 0.0), Twist(0.5, 0.0))
    assert follow.top_speed(LIMITS) > 0.7
    step(follow, Pose2(1.0, 0.07, 0.0), Twist(0.5, 0.0))
    assert follow.top_speed(LIMITS) == pytest.approx(0.5, abs=0.02)  # a tenth of a metre for each m/s, 5 cm of room
    step(follow, Pose2(1.1, 0.0, 0.3), Twist(0.5, 0.0))  # its front swings out
    assert follow.top_speed(LIMITS) == pytest.approx(0.15, abs=0.02)


def test_a_chair_that_begins_beside_its_line_does_not_stray() -> None:
    follow = follower(straight(6.0), room=0.06)
    step(follow, Pose2(1.0, 0.06, 0.0), Twist(0.5, 0.0))
    assert follow.top_speed(LIMITS) > 0.7


def test_what_a_sharp_bend_swings_a_slow_chair_off_its_line_does_not_slow_it_down_on_the_straight() -> None:
    turned = np.linspace(0.0, math.pi / 2, 12)
    bend = np.column_stack([0.3 * np.sin(turned), 0.3 - 0.3 * np.cos(turned), turned])
    ahead = straight(4.0)[1:]
    line = np.concatenate([bend, np.column_stack([0.3 + ahead[:, 1], 0.3 + ahead[:, 0], ahead[:, 2] + math.pi / 2])])
    follow = follower(line, room=0.06)
    x, y, theta = bend[5].tolist()
    step(follow, Pose2(x, y, theta), Twist(0.2, 0.6))
    step(follow, Pose2(x, y, theta - 0.1), Twist(0.2, 0.6))  # its front is 5 cm off at 0.7 m/s
    for y in np.arange(0.4, 1.2, 0.1).tolist():
        step(follow, Pose2(0.3, y, math.pi / 2), Twist(0.2, 0.0))
    assert follow.top_speed(LIMITS) > 0.7


@pytest.mark.parametrize(
    ("allowed", "error", "arrives"), [(0.04, 0.035, True), (0.01, 0.035, False), (0.01, 0.025, True)]
)
def test_at_the_end_the_chair_turns_no_more_exactly_than_its_goal_asks_and_it_can(
    allowed: float, error: float, arrives: bool
) -> None:
    limits = replace(LIMITS, tolerances=GoalTolerances(heading=allowed))
    choice = step(follower(straight(1.0)), Pose2(1.0, 0.0, error), Twist(), limits=limits)
    assert choice.arrived == arrives
    assert (choice.twist == Twist()) == arrives


def test_a_line_is_begun_only_at_a_speed_at_which_the_chair_stays_on_it() -> None:
    bend = np.array([along_arc(0.0, 0.0, 0.0, s, 1.5 * s, 1.0) for s in np.linspace(0.0, 1.0, 11)])
    then = bend[-1, :2] + np.linspace(0.1, 3.0, 30)[:, None] * (math.cos(1.5), math.sin(1.5))
    line = np.concatenate([bend, np.column_stack([then, np.full(30, 1.5)])])
    assert not follower(line).can_be_begun(Twist(0.8, 0.0), LIMITS)
    assert follower(line).can_be_begun(Twist(0.3, 0.0), LIMITS)
    assert follower(straight(3.0)).can_be_begun(Twist(0.8, 0.0), LIMITS)
    turn = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    assert not follower(turn).can_be_begun(Twist(0.3, 0.0), LIMITS)
    assert follower(turn).can_be_begun(Twist(), LIMITS)
