"""Leaving a tight spot: backwards along the way in, never nearer to an obstacle."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import transform_points
from waychair.maps.grid.distance_field import DistanceField, distances
from waychair.planning.body.clearance import EASE_STEP
from waychair.planning.body.footprint import along_arc, eased_footprint, fits
from waychair.planning.window.backing_out import back_up
from waychair.planning.window.dwa import choose
from waychair.planning.window.motion_limits import DwaSettings, crawling
from waychair.types import FloatArray, Path, Pose2, Twist

SETTINGS = DwaSettings(reaction_time=0.0)
CELL = 0.025


def hall(*boxes: tuple[float, float, float, float]) -> DistanceField:
    """8 x 6 m with walls round it and boxes (x0, y0, x1, y1) [m] in it."""
    mask = np.zeros((240, 320), np.bool_)
    mask[[0, -1]], mask[:, [0, -1]] = True, True
    for x0, y0, x1, y1 in boxes:
        mask[round(y0 / CELL) : round(y1 / CELL), round(x0 / CELL) : round(x1 / CELL)] = True
    return DistanceField(distances(mask, CELL), CELL, Pose2())


def backed(pose: Pose2, trail: FloatArray, field: DistanceField, ticks: int) -> tuple[list[Pose2], bool]:
    """Poses of an ideal chair that backs up, and whether it was blocked in the end."""
    poses, command, blocked = [pose], Twist(), False
    for _ in range(ticks):
        shape, _ = eased_footprint(CHAIR_A, SETTINGS.clearance, field, poses[-1])
        result = back_up(poses[-1], command, trail, field, shape, SETTINGS)
        command, blocked = result.twist, result.blocked
        p = poses[-1]
        poses.append(Pose2(*along_arc(p.x, p.y, p.theta, command.v, command.omega, 0.05)))
    return poses, blocked


def test_the_chair_backs_out_along_the_arc_it_came_in_on() -> None:
    arc = np.array([along_arc(2.0, 2.0, 0.0, 0.3, 0.3, t) for t in np.linspace(0, 4, 40)])
    poses, blocked = backed(Pose2(*arc[-1]), arc, hall(), 60)
    assert not blocked
    gone = math.hypot(poses[-1].x - arc[-1, 0], poses[-1].y - arc[-1, 1])
    assert 0.3 < gone < 0.5
    off = [np.hypot(*(arc[:, :2] - (pose.x, pose.y)).T).min() for pose in poses]
    assert max(off) < 0.06


def test_without_a_trail_it_backs_straight() -> None:
    poses, _ = backed(Pose2(4.0, 3.0, 1.0), np.empty((0, 3)), hall(), 40)
    assert abs(poses[-1].theta - 1.0) < 0.05
    assert (poses[-1].x - 4.0) * math.cos(1.0) + (poses[-1].y - 3.0) * math.sin(1.0) < -0.15


def test_a_wall_behind_stops_it_before_it_touches() -> None:
    field = hall((2.0, 0.0, 2.3, 6.0))
    poses, blocked = backed(Pose2(2.75, 3.0, 0.0), np.empty((0, 3)), field, 200)
    assert blocked
    assert all(fits(CHAIR_A, 0.0, field, pose) for pose in poses)
    assert poses[-1].x < 2.74


def test_a_violated_margin_is_reduced_just_enough() -> None:
    field, pose = hall((3.0, 3.36, 5.0, 3.5)), Pose2(4.0, 3.0, 0.0)  # 6 cm beside the chair
    for margin in (0.0, 0.03, 0.05, 0.06):
        shape, ease = eased_footprint(CHAIR_A, margin, field, pose)
        assert shape.cell == CELL
        assert fits(CHAIR_A, margin - ease, field, pose)
        # the discs of the tree overhang the outline by up to a fifth of a cell
        assert ease == 0.0 or not fits(CHAIR_A, margin - ease + EASE_STEP + 0.2 * CELL, field, pose)
    assert ease > 0.01


def test_beside_a_wall_the_chair_moves_on_but_comes_no_nearer_at_repeated_calls() -> None:
    field = hall((2.0, 3.38, 7.0, 3.5))
    path = Path(np.column_stack([np.linspace(3.0, 6.0, 31), np.linspace(3.0, 3.12, 31), np.zeros(31)]))
    pose, command, gaps = Pose2(3.0, 3.0, 0.0), Twist(), []
    for _ in range(200):
        command = choose(pose, command, path, field, CHAIR_A, replace(SETTINGS, clearance=0.06)).twist
        pose = Pose2(*along_arc(pose.x, pose.y, pose.theta, command.v, command.omega, 0.05))
        corners = transform_points(pose, CHAIR_A.outline())
        gaps.append(3.38 - corners[:, 1].max())
    assert min(gaps) > gaps[0] - 0.006
    assert pose.x > 3.3


def test_a_chair_deep_inside_an_obstacle_may_not_move() -> None:
    field = hall((3.9, 2.9, 4.1, 3.1))
    inside = Pose2(4.0, 3.0, 0.0)
    shape, ease = eased_footprint(CHAIR_A, 0.03, field, inside)
    assert ease == 0.0
    assert back_up(inside, Twist(), np.empty((0, 3)), field, shape, SETTINGS).blocked


def test_a_chair_beside_a_wall_crawls_away_from_it() -> None:
    field = hall((3.0, 3.33, 5.0, 3.5))  # 3 cm beside the chair
    path = Path(np.column_stack([np.linspace(4.0, 6.5, 26), np.linspace(3.0, 1.5, 26), np.full(26, -0.54)]))
    result = choose(Pose2(4.0, 3.0, 0.0), Twist(), path, field, CHAIR_A, SETTINGS)
    assert not result.blocked
    assert result.candidates[:, 0].max() <= 0.15 + 1e-9
    assert abs(result.twist.v) + abs(result.twist.omega) > 0.0


def test_a_chair_that_lacks_a_few_millimetres_of_its_margin_is_as_fast_as_its_room_allows() -> None:
    assert crawling(SETTINGS, 0.026).max_speed == pytest.approx(0.32)  # 1 cm, and 5 cm for each m/s
    for room in (-0.01, 0.0, 0.0175):
        assert crawling(SETTINGS, room).max_speed == pytest.approx(0.15)
        assert crawling(SETTINGS, room).max_omega == pytest.approx(0.4)
    assert crawling(SETTINGS, 1.0) == SETTINGS


def test_a_chair_that_may_not_reverse_does_not_back_out() -> None:
    shape, _ = eased_footprint(CHAIR_A, SETTINGS.clearance, hall(), Pose2(4.0, 3.0, 0.0))
    for most in (0.0, 0.1):
        limits = replace(SETTINGS, max_reverse=most)
        command = Twist()
        for _ in range(20):
            result = back_up(Pose2(4.0, 3.0, 0.0), command, np.empty((0, 3)), hall(), shape, limits)
            command = result.twist
        assert command.v == -most
        assert result.blocked is (most == 0.0)
