"""A chair with lag follows lines to the centimetre, forwards and backwards."""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.drive import line_tracking as tracking
from waychair.control.drive.line_tracking import on_line, track
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.footprint import along_arc
from waychair.planning.window.motion_limits import PERIOD, CommandedMotion, DwaSettings, motion_after
from waychair.types import FloatArray, Pose2, Twist

OPEN = DistanceField(np.full((600, 600), 5.0, np.float32), 0.02, Pose2(-6.0, -6.0, 0.0))


def drive(
    pose: Pose2, line: FloatArray, backwards: bool, field: DistanceField = OPEN, eased: bool = False
) -> list[Pose2]:
    """Drive a chair with the simulated delay and lag to the end of the line or for 40 s; jerk is limited if eased."""
    poses, command, motion, v, omega = [pose], Twist(), CommandedMotion() if eased else None, 0.0, 0.0
    delayed = deque([Twist()])
    in_position, limits = False, DwaSettings()
    for _ in range(800):
        choice = track(
            poses[-1], command, line, backwards, field, CHAIR_A, limits, in_position=in_position, motion=motion
        )
        motion = None if motion is None else motion_after(motion, command, choice.twist, limits)
        in_position, command = choice.in_position, choice.twist
        if choice.arrived or choice.blocked:
            break
        delayed.append(command)
        told = delayed.popleft()
        v += (told.v - v) * 0.05 / 0.14
        omega += (told.omega - omega) * 0.05 / 0.14
        p = poses[-1]
        poses.append(Pose2(*along_arc(p.x, p.y, p.theta, v, omega, 0.05)))
    return poses


@given(st.floats(-0.12, 0.12), st.floats(-0.3, 0.3), st.booleans())
@settings(max_examples=25)
def test_initial_errors_are_gone_after_a_metre(lateral: float, heading: float, backwards: bool) -> None:
    x = np.linspace(0.0, -2.0 if backwards else 2.0, 41)
    line = np.column_stack([x, np.zeros((41, 2))])
    poses = drive(Pose2(0.0, lateral, heading), line, backwards)
    late = [pose for pose in poses if abs(pose.x) > 1.3]
    assert late
    assert max(abs(pose.y) for pose in late) < 0.012
    assert abs(poses[-1].x) == pytest.approx(2.0, abs=0.03)
    assert abs(poses[-1].theta) < 0.03


@pytest.mark.parametrize("backwards", [False, True])
def test_on_the_way_back_to_a_line_the_far_end_swings_little_more_than_the_error(backwards: bool) -> None:
    """A tail 0.8 m from the axle: held critically damped it would swing out by 1.7 times the error."""
    x, error = np.linspace(0.0, -2.0 if backwards else 2.0, 41), 0.02
    poses = drive(Pose2(0.0, error, 0.0), np.column_stack([x, np.zeros((41, 2))]), backwards)
    far = 0.8 if backwards else -0.8
    sideways = np.array([pose.y + far * math.sin(pose.theta) for pose in poses])
    assert sideways.max() - error < 1.2 * error
    assert sideways.min() > -0.1 * error


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("radius", [-1.0, 0.6, 2.0])
def test_an_arc_is_followed(radius: float, backwards: bool) -> None:
    way = np.linspace(0.0, -1.2 if backwards else 1.2, 25)
    line = np.array([along_arc(0.0, 0.0, 0.0, s, s / radius, 1.0) for s in way])
    poses = drive(Pose2(), line, backwards)
    off = [abs(on_line(line, pose, backwards).lateral) for pose in poses]
    assert max(off) < 0.02
    assert math.dist((poses[-1].x, poses[-1].y), line[-1, :2]) < 0.03


def test_a_wall_across_the_line_stops_the_chair_before_it() -> None:
    columns = (np.arange(600) + 0.5) * 0.02 - 6.0
    metres = np.repeat(np.abs(columns - 1.5)[None], 600, axis=0).astype(np.float32)
    line = np.column_stack([np.linspace(0.0, 2.0, 41), np.zeros((41, 2))])
    poses = drive(Pose2(), line, False, DistanceField(metres, 0.02, OPEN.map_from_grid))
    assert 1.3 < poses[-1].x + CHAIR_A.front < 1.5


@pytest.mark.parametrize("backwards", [False, True])
def test_with_a_motion_the_jerk_along_a_line_is_limited_from_its_entry_at_speed_to_its_end(backwards: bool) -> None:
    """Entered faster than it is driven; left as exactly as without a limit."""
    limits, sign = DwaSettings(reaction_time=0.0), -1.0 if backwards else 1.0
    line = np.column_stack([np.linspace(0.0, sign * 2.0, 41), np.zeros((41, 2))])
    pose, command, motion, in_position = Pose2(0.0, 0.05, 0.0), Twist(sign * 0.4), CommandedMotion(), False
    speeds = [command.v, command.v]
    for _ in range(800):
        choice = track(pose, command, line, backwards, OPEN, CHAIR_A, limits, in_position=in_position, motion=motion)
        in_position = choice.in_position
        motion, command = motion_after(motion, command, choice.twist, limits), choice.twist
        speeds.append(command.v)
        pose = Pose2(*along_arc(pose.x, pose.y, pose.theta, command.v, command.omega, PERIOD))
        if choice.arrived:
            break
    assert choice.arrived
    assert np.abs(np.diff(speeds, 2)).max() <= 1.05 * limits.jerk * PERIOD**2
    assert abs(pose.x) == pytest.approx(2.0, abs=0.03)
    assert abs(pose.y) < 0.005


def test_a_line_with_half_a_centimetre_of_clearance_is_followed_to_its_end() -> None:
    rows = (np.arange(300) + 0.5) * 0.01 - 1.5
    columns = (np.arange(400) + 0.5) * 0.01 - 1.0
    gap = CHAIR_A.width / 2 + np.where(columns < 1.0, 0.05, 0.016)  # of which one cell is kept for safety
    metres = np.maximum(gap[None] - np.abs(rows)[:, None], 0.0).astype(np.float32)
    tube = DistanceField(metres, 0.01, Pose2(-1.0, -1.5, 0.0))
    line = np.column_stack([np.linspace(0.0, 1.0, 21), np.zeros((21, 2))])
    assert drive(Pose2(), line, False, tube)[-1].x == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(("lateral", "goes"), [(0.01, True), (0.03, False)])
def test_off_its_line_a_chair_does_not_touch_obstacles_beside_the_line(lateral: float, goes: bool) -> None:
    rows = (np.arange(300) + 0.5) * 0.01 - 1.5
    metres = np.repeat(np.maximum(rows + CHAIR_A.width / 2 + 0.016 - lateral, 0.0)[:, None], 400, axis=1)
    wall = DistanceField(metres.astype(np.float32), 0.01, Pose2(-1.0, -1.5, 0.0))  # 1.6 cm from the chair's right side
    line = np.column_stack([np.linspace(0.0, 1.0, 21), np.zeros((21, 2))])
    choice = track(Pose2(0.2, lateral, 0.0), Twist(), line, False, wall, CHAIR_A, DwaSettings())
    assert choice.blocked is not goes


def test_a_chair_with_a_wall_behind_turns_while_driving_and_not_on_the_spot() -> None:
    columns = (np.arange(400) + 0.5) * 0.01 - 1.0
    metres = np.repeat(np.maximum(columns + CHAIR_A.rear + 0.03, 0.0)[None], 300, axis=0)
    wall = DistanceField(metres.astype(np.float32), 0.01, Pose2(-1.0, -1.5, 0.0))
    along = np.linspace(0.0, 1.0, 21)
    line = np.column_stack([along * math.cos(0.25), along * math.sin(0.25), np.full(21, 0.25)])
    end = drive(Pose2(), line, False, wall)[-1]
    assert math.hypot(end.x, end.y) == pytest.approx(1.0, abs=0.03)
    assert abs(end.y * math.cos(0.25) - end.x * math.sin(0.25)) < 0.01


def test_a_zigzag_is_driven_as_slowly_as_the_chair_can_steer_it() -> None:
    turns = np.repeat([-1.7, 0.9, -1.7, 0.9, -1.7, 0.9], 2) * 0.05
    line = [np.zeros(3)]
    for turn in turns:
        line.append(np.array(along_arc(*line[-1], 0.05, float(turn), 1.0)))
    poses = drive(Pose2(), np.array(line), False)
    off = [abs(on_line(np.array(line), pose).lateral) for pose in poses if pose.x < line[-1][0]]
    assert max(off) < 0.01


def test_the_speed_before_a_sharp_bend_is_one_at_which_it_can_be_steered() -> None:
    turns = np.repeat([0.0, 1.7, -1.7, 0.0], [12, 3, 3, 4]) * 0.05
    line = [np.zeros(3)]
    for turn in turns:
        line.append(np.array(along_arc(*line[-1], 0.05, float(turn), 1.0)))
    poses = drive(Pose2(), np.array(line), False, eased=True)
    speeds = [math.dist((a.x, a.y), (b.x, b.y)) / 0.05 for a, b in pairwise(poses) if 0.56 < a.x < 0.6]
    steered = math.sqrt(DwaSettings().alpha * 0.05**2 / (1.7 * 0.05))  # v^2 times the change of curvature is alpha
    assert max(speeds) < 1.05 * steered


@pytest.mark.parametrize("way", [0.1, 0.2, 0.3, 0.5])
def test_a_chair_that_still_accelerates_stops_at_the_end_of_the_line(way: float) -> None:
    line = np.column_stack([np.linspace(0.0, way, round(way / 0.05) + 1), np.zeros((round(way / 0.05) + 1, 2))])
    poses = drive(Pose2(), line, False, eased=True)
    assert abs(poses[-1].x - way) < 0.01


@pytest.mark.parametrize("backwards", [False, True])
def test_a_line_is_driven_no_faster_than_the_speed_limit(backwards: bool) -> None:
    x = np.linspace(0.0, -2.0 if backwards else 2.0, 41)
    line, limits = np.column_stack([x, np.zeros((41, 2))]), DwaSettings(max_speed=0.15, max_reverse=0.12)
    command, pose, speeds = Twist(), Pose2(), [0.0]
    for _ in range(100):
        command = track(pose, command, line, backwards, OPEN, CHAIR_A, limits).twist
        pose = Pose2(*along_arc(pose.x, pose.y, pose.theta, command.v, command.omega, 0.05))
        speeds.append(command.v)
    assert max(speeds) == pytest.approx(0.0 if backwards else 0.15)
    assert min(speeds) == pytest.approx(-0.12 if backwards else 0.0)


def test_a_chair_that_may_not_reverse_now_does_not_reverse_on_a_line() -> None:
    line = np.column_stack([np.linspace(0.0, -2.0, 41), np.zeros((41, 2))])
    begun = track(Pose2(), Twist(-0.2, 0.0), line, True, OPEN, CHAIR_A, DwaSettings(max_reverse=0.0))
    assert begun.blocked
    assert -0.2 < begun.twist.v < -0.1
    assert track(Pose2(), Twist(), line, True, OPEN, CHAIR_A, DwaSettings(max_reverse=0.0)).twist == Twist()


def test_without_a_dead_band_a_line_is_driven_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracking, "MIN_SPEED", 0.0)
    line = np.column_stack([np.linspace(0.0, 1.0, 21), np.zeros((21, 2))])
    command, pose = Twist(), Pose2()
    for _ in range(400):
        choice = track(pose, command, line, False, OPEN, CHAIR_A, DwaSettings())
        command = choice.twist
        pose = Pose2(*along_arc(pose.x, pose.y, pose.theta, command.v, command.omega, 0.05))
    assert choice.arrived
    assert pose.x == pytest.approx(1.0, abs=0.02)
