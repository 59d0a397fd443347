"""Door frames in pictures keep their number while the camera turns, and are forgotten when nothing shows them."""

from __future__ import annotations

import math

import numpy as np

from waychair.control.drive.doors.door_frame_tracker import LOST, STEADY, DoorFrameTracker
from waychair.planning.seen.door_frames import DoorFrame

CAMERA = np.array([[400.0, 0.0, 256.0], [0.0, 400.0, 192.0], [0.0, 0.0, 1.0]])


def _frame(x: float) -> DoorFrame:
    return DoorFrame((x, 60.0, x + 90.0, 300.0), 2.0)


def test_a_frame_keeps_its_number_while_the_camera_turns() -> None:
    tracker, turn = DoorFrameTracker(), math.radians(8.0)
    for k in range(STEADY):
        tracker.see([_frame(200.0 + 400.0 * math.tan(k * turn))], CAMERA, turn if k else 0.0)
    (frame,) = tracker.frames
    assert (frame.number, frame.seen, frame.steady) == (0, STEADY, True)


def test_two_frames_side_by_side_stay_two() -> None:
    tracker = DoorFrameTracker()
    for _ in range(3):
        tracker.see([_frame(100.0), _frame(240.0)], CAMERA, 0.0)
    assert [(frame.number, frame.seen) for frame in tracker.frames] == [(0, 3), (1, 3)]


def test_a_frame_is_forgotten_when_no_picture_shows_it_or_range_refutes_it() -> None:
    tracker = DoorFrameTracker()
    tracker.see([_frame(100.0), _frame(300.0)], CAMERA, 0.0)
    tracker.refute(0)
    assert [frame.number for frame in tracker.frames] == [1]
    for _ in range(LOST):
        tracker.see([], CAMERA, 0.0)
    assert tracker.frames == ()
