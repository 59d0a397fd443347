"""Gaps of a doorway's width are found in wall lines, and their jambs measured to the centimetre."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.planning.seen.lidar_rooms import drive_past, view_of, wall_with_door
from waychair.planning.seen.doorway_gaps import FARTHEST, Gap, find_gaps, measure_gap
from waychair.planning.seen.wall_lines import straight_stretches, wall_lines
from waychair.types import FloatArray, Pose2


def _gaps(faces: FloatArray) -> list[Gap]:
    views = [view for view, _ in drive_past(faces)]
    stretches = np.concatenate([straight_stretches(view, FARTHEST) for view in views])
    return [gap for gaps in find_gaps(views, stretches) for gap in gaps]


def test_an_open_door_in_a_wall_is_one_gap_with_its_middle_direction_and_width() -> None:
    near = [gap for gap in _gaps(wall_with_door(0.9)) if abs(gap.pose.y) < 0.3 and abs(gap.pose.x) < 0.3]
    assert near
    for gap in near:
        assert math.hypot(gap.pose.x, gap.pose.y) < 0.06
        assert abs(math.remainder(gap.pose.theta, math.pi)) < math.radians(1.5)
        assert gap.width == pytest.approx(0.9, abs=0.08)
        assert max(gap.walls) > 0.8


def test_a_closed_leaf_within_the_walls_thickness_leaves_no_gap() -> None:
    assert not [gap for gap in _gaps(wall_with_door(0.9, recess=0.1)) if abs(gap.pose.x) < 0.3]


def test_one_view_measures_both_jambs_within_its_doubt_even_aslant() -> None:
    faces = wall_with_door(0.9, thick=0.2)
    for seat in (Pose2(-2.0, 0.3, 0.0), Pose2(-1.2, 1.2, -0.8), Pose2(-2.5, -1.0, 0.3)):
        sight = measure_gap(view_of(faces, seat), Pose2(0.02, 0.05, 0.01), 0.85)
        assert sight is not None
        assert sight.right[1] + 0.05 == pytest.approx(-0.45, abs=sight.right_doubt + 0.01)
        assert sight.left[1] + 0.05 == pytest.approx(0.45, abs=sight.left_doubt + 0.01)
        assert max(sight.right_doubt, sight.left_doubt) < 0.04
        assert sight.through > 10
        assert sight.stopped == 0


def test_one_view_from_along_the_wall_shows_a_gap_by_its_far_reveal() -> None:
    seat = Pose2(-0.6, 2.7, -math.pi / 2)
    view = view_of(wall_with_door(0.9, thick=0.3), seat, step=1.0)
    gaps = [gap for found in find_gaps([view], straight_stretches(view, FARTHEST)) for gap in found]
    near = [gap for gap in gaps if math.hypot(gap.pose.x, gap.pose.y) < 0.1]
    assert near
    sight = measure_gap(view, Pose2(), 0.9)
    assert sight is not None
    assert sight.right[1] == pytest.approx(-0.45, abs=0.05)
    assert math.isnan(sight.depth)


def test_beams_to_a_closed_leaf_are_counted_as_stopped() -> None:
    sight = measure_gap(view_of(wall_with_door(0.9, recess=0.06), Pose2(-2.0, 0.2, 0.0)), Pose2(), 0.9)
    assert sight is not None
    assert sight.through == 0
    assert sight.stopped > 10


def test_the_stretches_of_a_wall_on_both_sides_of_a_door_lie_on_one_line() -> None:
    views = [view for view, _ in drive_past(wall_with_door(0.9))]
    lines = wall_lines(np.concatenate([straight_stretches(view, FARTHEST) for view in views]), 1.0)
    walls = [line for line in lines if abs(line.pose.x) < 0.05 and abs(math.sin(line.pose.theta)) > 0.99]
    assert len(walls) == 1
    assert len(walls[0].stretches) == 2
