"""Doorways are followed over a drive: found ahead, kept under one identity, closed and opened, forgotten when refuted."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.planning.seen.lidar_rooms import drive_past, leaf, view_of, wall_with_door
from waychair.control.drive.doorway_tracker import DoorwayTracker
from waychair.planning.seen.doorways import DoorState
from waychair.types import FloatArray, Pose2


def _seen(faces: FloatArray, seed: int = 0) -> DoorwayTracker:
    tracker = DoorwayTracker()
    for view, pose in drive_past(faces, seed=seed):
        tracker.see(view, pose)
    return tracker


def _stay(tracker: DoorwayTracker, faces: FloatArray, count: int = 4) -> None:
    pose = drive_past(faces)[-1][1]
    for _ in range(count):
        tracker.see(view_of(faces, pose), pose)


@pytest.mark.parametrize("width", [0.8, 0.9, 1.1])
def test_an_open_door_is_found_with_its_width_before_the_chair_is_near(width: float) -> None:
    tracker, first = DoorwayTracker(), None
    for view, pose in drive_past(wall_with_door(width)):
        tracker.see(view, pose)
        first = pose if first is None and tracker.doorways else first
    (door,) = tracker.doorways
    assert first is not None
    assert first.x < -1.5
    assert math.hypot(door.pose.x, door.pose.y) < 0.03
    assert abs(math.remainder(door.pose.theta, math.pi)) < math.radians(1.5)
    assert door.width == pytest.approx(width, abs=0.03)
    assert door.state is DoorState.OPEN
    assert door.wide_enough(width - 0.12)
    assert not door.wide_enough(width - 0.03)


@pytest.mark.parametrize("recess", [0.0, 0.06, 0.12])
def test_a_closed_door_is_not_offered(recess: float) -> None:
    assert _seen(wall_with_door(0.9, recess=recess)).doorways == ()


def test_a_door_that_is_closed_before_the_chair_keeps_its_number_and_opens_again() -> None:
    tracker = _seen(wall_with_door(0.9))
    (before,) = tracker.doorways
    _stay(tracker, wall_with_door(0.9, recess=0.05))
    (shut,) = tracker.doorways
    assert (shut.number, shut.state, shut.clear) == (before.number, DoorState.CLOSED, 0.0)
    assert not shut.wide_enough(0.6)
    _stay(tracker, wall_with_door(0.9))
    assert tracker.doorways[0].state is DoorState.OPEN


def test_a_leaf_at_40_degrees_leaves_the_door_ajar_and_names_its_side() -> None:
    faces = wall_with_door(0.9)
    tracker = _seen(faces)
    _stay(tracker, np.concatenate([faces, leaf(0.9, math.radians(40.0), side=-1.0)]))
    (door,) = tracker.doorways
    assert door.leaf is not None
    assert (door.leaf.side, door.state) == ("right", DoorState.AJAR)
    assert math.degrees(abs(door.leaf.angle)) == pytest.approx(40.0, abs=8.0)


def test_an_echo_within_the_opening_says_glass() -> None:
    tracker = _seen(wall_with_door(0.9))
    tracker.hear(np.array([[2.0, 0.0], [0.0, 0.8]]))
    assert [door.state for door in tracker.doorways] == [DoorState.OPEN]
    tracker.hear(np.array([[0.05, 0.1]]))
    assert [door.state for door in tracker.doorways] == [DoorState.CLOSED]


def test_a_doorway_is_forgotten_when_its_jambs_are_gone() -> None:
    tracker = _seen(wall_with_door(0.9))
    empty = wall_with_door(0.9)[6:]
    for x in np.linspace(-1.0, -2.6, 12):
        tracker.see(view_of(empty, Pose2(float(x), 0.0, 0.0)), Pose2(float(x), 0.0, 0.0))
    assert tracker.doorways == ()


def test_seen_again_from_the_other_side_it_is_the_same_doorway() -> None:
    faces = wall_with_door(0.9)
    tracker = _seen(faces)
    number = tracker.doorways[0].number
    for x in np.linspace(-0.9, 3.0, 20):
        pose = Pose2(float(x), 0.0, 0.0 if x < 2.0 else math.pi)
        tracker.see(view_of(faces, pose), pose)
    for x in np.linspace(3.0, 0.8, 12):
        pose = Pose2(float(x), 0.4, math.pi)
        tracker.see(view_of(faces, pose), pose)
    assert [door.number for door in tracker.doorways] == [number]
