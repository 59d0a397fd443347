"""Doorways are followed over a drive: found ahead, kept under one identity, closed and opened, forgotten when refuted."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.planning.seen.lidar_rooms import drive_past, leaf, view_of, wall_with_door
from waychair.control.drive.doors.doorway_tracker import DoorwayTracker
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


def test_with_sonars_a_door_is_open_only_when_one_that_faces_it_hears_nothing_in_it() -> None:
    tracker = _seen(wall_with_door(0.9))
    ahead = np.array([[-0.9, 0.0, 0.0]])
    tracker.hear(np.array([[-0.9, 0.0, 1.2]]), np.array([math.inf]))  # looks elsewhere
    assert [door.state for door in tracker.doorways] == [DoorState.UNKNOWN]
    for _ in range(2):
        tracker.hear(ahead, np.array([math.inf]))
    assert [door.state for door in tracker.doorways] == [DoorState.OPEN]
    tracker.hear(ahead, np.array([0.92]))  # one ping of another sonar
    assert [door.state for door in tracker.doorways] == [DoorState.OPEN]
    for _ in range(2):
        tracker.hear(ahead, np.array([0.92]))
    assert [door.state for door in tracker.doorways] == [DoorState.CLOSED]
    assert not tracker.doorways[0].wide_enough(0.5)


def test_a_door_seen_at_a_slant_is_a_candidate_of_unknown_state_and_keeps_its_number_when_validated() -> None:
    faces, tracker, seen = wall_with_door(0.9, thick=0.2), DoorwayTracker(), []
    for k, y in enumerate(np.linspace(3.6, 1.0, 24)):
        pose = Pose2(-0.9, float(y), -math.pi / 2)
        tracker.see(view_of(faces, pose), pose, 100 * k)
        seen += [(door.number, door.validated, door.state, float(y)) for door in tracker.doorways]
    assert {number for number, *_ in seen} == {0}
    assert not seen[0][1]
    assert seen[0][2] is DoorState.UNKNOWN
    assert seen[0][3] > 1.5
    assert seen[-1][1]
    assert seen[-1][2] is DoorState.OPEN
    assert tracker.doorways[0].seen_ns == 2300


def test_points_of_a_laser_line_find_a_door_as_a_scan_does() -> None:
    faces, tracker = wall_with_door(0.9), DoorwayTracker()
    for k, x in enumerate(np.linspace(-3.2, -1.2, 17)):
        pose = Pose2(float(x), 0.1, 0.0)
        view = view_of(faces, pose, step=0.2)
        ahead = np.abs(np.arctan2(view.ends[:, 1] - pose.y, view.ends[:, 0] - pose.x)) < math.radians(28.0)
        points = view.ends[ahead] - (pose.x, pose.y)
        doorways = tracker.update(points, pose, k, source="laser line")
    (door,) = [door for door in doorways if door.validated]
    assert math.hypot(door.pose.x, door.pose.y) < 0.05
    assert door.width == pytest.approx(0.9, abs=0.03)


def test_one_update_does_a_bounded_share_of_the_work_and_key_scans_have_theirs_done_at_once() -> None:
    live, leaping = DoorwayTracker(), DoorwayTracker()
    faces = wall_with_door(0.9)
    for x in np.linspace(-3.4, -1.0, 21):
        live.see(view_of(faces, Pose2(float(x), 0.2, 0.0)), Pose2(float(x), 0.2, 0.0))
    for x in np.linspace(-3.4, -1.0, 5):
        leaping.see(view_of(faces, Pose2(float(x), 0.2, 0.0)), Pose2(float(x), 0.2, 0.0))
    for tracker in (live, leaping):
        assert any(door.validated and math.hypot(door.pose.x, door.pose.y) < 0.05 for door in tracker.doorways)


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


def test_of_too_many_candidates_those_seen_longest_ago_are_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("waychair.control.drive.doors.doorway_tracker.MOST_CANDIDATES", 0)
    tracker = _seen(wall_with_door(0.9))
    assert [door.validated for door in tracker.doorways] == [True]
