"""Positions against headings within odometry: mirrored ones are told, whichever way the chair drives."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.slam.odometry.heading_check import track_turns_against_headings
from waychair.types import FloatArray

MIRROR = (1.0, 1.0, -1.0)
STEP = 0.05


def driven(legs: list[tuple[float, float]], mount: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
    """Poses (N, 3) of a point on a chair that drives legs of metres (negative: backward) and radians on the way."""
    rows = [np.zeros(3)]
    for ahead, turn in legs:
        count = max(1, round(max(abs(ahead), abs(turn)) / STEP))
        for _ in range(count):
            x, y, theta = rows[-1]
            middle = theta + 0.5 * turn / count
            way = ahead / count
            rows.append(np.array([x + way * math.cos(middle), y + way * math.sin(middle), theta + turn / count]))
    poses = np.array(rows)
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    poses[:, 0] += c * mount[0] - s * mount[1]
    poses[:, 1] += s * mount[0] + c * mount[1]
    poses[:, 2] = np.remainder(poses[:, 2] + math.pi, math.tau) - math.pi
    return poses


RIGHT = math.pi / 2
DRIVES = {
    "corners": driven([(9.0, 0.0), (0.0, RIGHT), (6.0, 0.0), (0.0, RIGHT), (9.0, 0.0), (0.0, RIGHT), (6.0, 0.0)]),
    "arcs": driven([(4.0, 1.0), (3.0, -1.5), (4.0, 2.0), (2.0, 0.0), (3.0, 1.0)]),
    "backward": driven([(-4.0, 1.0), (-3.0, -1.8), (-4.0, 2.5), (-2.0, 0.0)]),
    "forward and backward": driven([(4.0, 0.7), (-3.0, 0.9), (4.0, 0.8), (-3.0, 1.0), (4.0, -0.5)]),
    "beside the middle": driven([(9.0, 0.0), (0.0, RIGHT), (6.0, 0.0), (0.0, RIGHT), (9.0, 0.0)], (0.25, 0.05)),
}


@pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)
def test_mirrored_headings_and_exchanged_axes_are_told_from_sound_ones(drive: FloatArray) -> None:
    assert not track_turns_against_headings(drive)
    assert track_turns_against_headings(drive * MIRROR)
    assert track_turns_against_headings(drive[:, [1, 0, 2]])


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_wheels_that_are_exchanged_agree_with_themselves(turn: float) -> None:
    assert not track_turns_against_headings(driven([(4.0, turn), (3.0, -1.5 * turn), (4.0, 2.0 * turn)]))


def test_a_straight_drive_a_rest_and_turns_on_the_spot_tell_nothing() -> None:
    for legs in ([(8.0, 0.05)], [(0.0, 3.0)], [(8.0, 0.0), (0.0, math.pi), (8.0, 0.0)]):
        drive = driven(legs)
        assert not track_turns_against_headings(drive)
        assert not track_turns_against_headings(drive * MIRROR)
    assert not track_turns_against_headings(np.zeros((50, 3)))


def test_a_chair_that_drives_in_all_directions_tells_nothing() -> None:
    angles = np.linspace(0.0, 4.0, 400)
    poses = np.stack([3.0 * np.cos(5.0 * angles), 3.0 * np.sin(5.0 * angles), 0.3 * np.sin(angles)], axis=1)
    assert not track_turns_against_headings(poses)
    assert not track_turns_against_headings(poses * MIRROR)
