"""Only floor that beams have crossed is free for somebody who goes through a doorway."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.planning.seen.lidar_rooms import leaf, view_of, wall_with_door
from waychair.planning.seen.swing_space import NO_SPACE, free_width, looked_at
from waychair.types import FloatArray, Pose2

MIDDLE = Pose2(0.06, 0.0, 0.0)


def _free(faces: FloatArray, *seats: Pose2) -> float:
    space = NO_SPACE
    for seat in seats:
        space = looked_at(space, view_of(faces, seat, step=0.25), MIDDLE)
    return free_width(space, 0.9)


def test_an_empty_doorway_seen_from_ahead_is_free_in_its_whole_width() -> None:
    assert _free(wall_with_door(0.9), Pose2(-2.0, 0.0, 0.0), Pose2(-1.5, 0.1, 0.0)) == pytest.approx(0.9)


def test_nothing_is_free_before_anything_was_seen() -> None:
    assert free_width(NO_SPACE, 0.9) == 0.0


@pytest.mark.parametrize("angle", [20.0, 40.0, 60.0])
def test_a_leaf_leaves_no_more_than_beside_its_edge(angle: float) -> None:
    faces = np.concatenate([wall_with_door(0.9), leaf(0.9, math.radians(angle))])
    left = 0.9 * (1.0 - math.cos(math.radians(angle)))
    for y in (-0.8, 0.0, 0.8):
        assert _free(faces, Pose2(-2.0, y, 0.0), Pose2(-1.6, y, 0.0)) <= left + 0.06


def test_floor_behind_the_wall_that_an_oblique_view_does_not_reach_is_not_free() -> None:
    assert _free(wall_with_door(0.9), Pose2(-0.8, 1.8, -1.0)) < 0.5
