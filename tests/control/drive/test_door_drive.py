"""The gate before a door: a chair that may not enter stops there and says why."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from waychair.calibration.chair_body import CHAIR_A, CHAIR_A_FRONT, CHAIR_A_MID, ChairBody
from waychair.control.drive.door_drive import DoorDrive
from waychair.geometry import arc
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.route.legs import DoorPassage, DrivingManner, PathLeg
from waychair.planning.window.dwa import DwaResult
from waychair.planning.window.motion_limits import DwaSettings
from waychair.types import FloatArray, Path, Pose2, Twist

WIDTH = 0.8
OPEN = DistanceField(np.full((200, 200), 2.0, np.float32), 0.05, Pose2(-5.0, -5.0, 0.0))
PERIOD_S = 0.05


def leg() -> PathLeg:
    """Straight through a door round the origin, from 1.6 m before it."""
    xs = np.linspace(-1.6, 1.2, 29)
    return PathLeg(Path(np.column_stack([xs, np.zeros((29, 2))])), DrivingManner.DOOR, door=DoorPassage(Pose2(), WIDTH))


def jambs(seed: int) -> FloatArray:
    """Points of the near face of a wall on both sides of the door, with a centimetre of noise."""
    rng = np.random.default_rng(seed)
    ys = np.linspace(WIDTH / 2, 1.4, 60)
    points = np.concatenate([np.column_stack([np.full(60, -0.075), side * ys]) for side in (1.0, -1.0)])
    noisy: FloatArray = points + rng.normal(0.0, 0.005, points.shape)
    return noisy


def before_a_door_it_knows(body: ChairBody = CHAIR_A) -> DoorDrive:
    """A watch that has seen the door from 1.6 m."""
    drive = DoorDrive(leg(), Pose2(), body)
    for seed in range(20):
        drive.watch.see(jambs(seed), Pose2(-1.6, 0.0, 0.0))
    return drive


def driven(sees: bool, ticks: int = 400, late: int = 0) -> tuple[DoorDrive, Pose2, DwaResult]:
    """Drive a chair that follows commands `late` ticks late, until it is through, refused, or the ticks are over."""
    drive = DoorDrive(leg(), Pose2(), CHAIR_A)
    pose, commands = Pose2(-1.6, 0.0, 0.0), [Twist()] * (late + 1)
    for tick in range(ticks):
        if sees:
            drive.watch.see(jambs(tick), pose @ CHAIR_A.base_from_laser)
        choice = drive.step(pose, commands[-1], OPEN, DwaSettings())
        commands = [*commands[1:], choice.twist]
        pose = pose @ arc(commands[0].v * PERIOD_S, commands[0].omega * PERIOD_S)
        if choice.arrived or drive.refused:
            break
    return drive, pose, choice


def test_the_chair_drives_through_a_door_that_it_sees() -> None:
    drive, pose, choice = driven(sees=True)
    assert choice.arrived
    assert not drive.refused
    assert pose.x == pytest.approx(1.2, abs=0.03)


def test_the_chair_stops_at_the_gate_of_an_unseen_door_and_refuses_it() -> None:
    """It stops before the wall, even where it follows commands 0.2 s late."""
    drive, pose, choice = driven(sees=False, late=4)
    assert drive.refused
    assert not drive.entered
    assert choice.blocked
    assert pose.x + CHAIR_A.front < -0.1


@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_A_MID, CHAIR_A_FRONT], ids=lambda body: str(body.drive))
@pytest.mark.parametrize("moved", [0.02, -0.02])
def test_a_chair_inside_of_a_door_that_seems_to_have_moved_does_not_swing_its_tail(
    body: ChairBody, moved: float
) -> None:
    drive = before_a_door_it_knows(body)
    pose, command, offs = Pose2(-body.front - 0.15, 0.0, 0.0), Twist(), []
    for _ in range(240):
        seen = Pose2(pose.x, pose.y + (moved if pose.x > 0.3 * body.rear else 0.0), pose.theta)
        choice = drive.step(seen, command, OPEN, DwaSettings())
        command = choice.twist
        pose = pose @ arc(command.v * PERIOD_S, command.omega * PERIOD_S)
        if pose.x + body.front > 0.0 > pose.x - body.rear:
            offs.append(pose.y - pose.x * np.tan(pose.theta))  # of the middle line, in the door's plane
    assert drive.entered
    assert pose.x > body.rear
    assert np.abs(offs).max() < 0.009


@pytest.mark.parametrize(("off", "enters"), [(0.021, True), (0.027, False)])
def test_the_gate_judges_the_place_at_which_the_front_will_enter(off: float, enters: bool) -> None:
    """Both times the axle is on the axis, and the front nearer to it than a fifth of the room beside the chair."""
    drive = before_a_door_it_knows()
    pose = Pose2(-CHAIR_A.front - 0.15, 0.0, 0.0)
    door = drive.watch.odom_from_door
    drive._lined_up = True
    at = Pose2(pose.x, 0.0, np.arctan2(off, -pose.x))
    assert abs(CHAIR_A.front * np.sin(at.theta)) < 0.2 * (drive.watch.width - CHAIR_A.width) / 2
    drive.step(door @ at, Twist(), OPEN, DwaSettings())
    assert drive.entered is enters


@pytest.mark.parametrize(("turns", "enters"), [(0.0, True), (-0.05, True), (0.05, False)])
def test_a_chair_that_turns_away_at_the_gate_does_not_enter_even_within_the_tolerance(
    turns: float, enters: bool
) -> None:
    """A turn [rad/s] that leads the front off the axis, 1.2 cm off already, is not stopped before it enters."""
    drive = before_a_door_it_knows()
    door = drive.watch.odom_from_door
    drive._lined_up = True
    last = Pose2(-CHAIR_A.front - 0.245, 0.0, 0.012 / (CHAIR_A.front + 0.245))
    for ago in np.linspace(0.5, 0.0, 11).tolist():
        assert not drive.entered
        drive.step(door @ last @ arc(-0.25 * ago, -turns * ago), Twist(0.25, 0.0), OPEN, DwaSettings())
    assert drive.entered is enters


def test_it_backs_off_from_between_the_jambs_too() -> None:
    """Less room is free beside the chair than is kept behind it."""
    drive = before_a_door_it_knows()
    xs = -4.0 + 0.02 * (np.arange(400) + 0.5)
    wall = (np.abs(xs) < 0.075)[None] & (np.abs(xs) > CHAIR_A.width / 2 + 0.06)[:, None]
    metres = (0.02 * distance_transform_edt(~wall)).astype(np.float32)
    walls = DistanceField(metres, 0.02, Pose2(-4.0, -4.0, 0.0))
    pose, command = Pose2(-CHAIR_A.front - 0.02, 0.0, 0.035), Twist()
    drive._lined_up = True
    ways = [pose.x]
    for _ in range(100):
        command = drive.step(pose, command, walls, DwaSettings()).twist
        pose = pose @ arc(command.v * PERIOD_S, command.omega * PERIOD_S)
        ways.append(pose.x)
    assert min(ways) < ways[0] - 0.3


def test_a_retreat_stops_before_an_obstacle_behind_with_a_margin_for_localisation_errors() -> None:
    drive = before_a_door_it_knows()
    behind = -1.5  # [m] the place of a wall across the room
    xs = -5.0 + 0.05 * (np.arange(200) + 0.5)
    away = np.maximum(xs - behind, 0.0).astype(np.float32)
    room = DistanceField(np.tile(np.minimum(away, 2.0), (200, 1)), 0.05, Pose2(-5.0, -5.0, 0.0))
    pose, command = Pose2(-CHAIR_A.front - 0.15, 0.06, 0.0), Twist()  # at the gate, too far off the axis
    rear = [pose.x - CHAIR_A.rear]
    for _ in range(200):
        choice = drive.step(pose, command, room, DwaSettings())
        command = choice.twist
        pose = pose @ arc(command.v * PERIOD_S, command.omega * PERIOD_S)
        rear.append(pose.x - CHAIR_A.rear)
    assert drive.tries > 0
    assert min(rear) < rear[0] - 0.05, "it did back off"
    assert min(rear) > behind + 0.09


def test_it_does_not_back_off_while_a_person_may_be_behind() -> None:
    """Nor does waiting use up its tries."""
    drive = before_a_door_it_knows()
    drive._lined_up = True
    pose, command = Pose2(-CHAIR_A.front - 0.15, 0.06, 0.0), Twist()
    ways = []
    for tick in range(160):
        limits = DwaSettings(max_reverse=0.0) if tick < 80 else DwaSettings()
        command = drive.step(pose, command, OPEN, limits).twist
        pose = pose @ arc(command.v * PERIOD_S, command.omega * PERIOD_S)
        ways.append(pose.x)
    assert min(ways[:80]) == ways[0]
    assert min(ways) < ways[0] - 0.3
    assert drive.tries == 1
