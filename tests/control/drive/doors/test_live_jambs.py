"""A door is found in the scan to the centimetre; where there is none, none is found."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.control.drive.doors.live_jambs import DoorWatch, find_doorway
from waychair.types import FloatArray, Pose2

WIDTH = 0.8
FROM = Pose2(-1.4, 0.0, 0.0)


def wall_with_door(seed: int, away: float = 1.4, width: float = WIDTH, noise: float = 0.01) -> FloatArray:
    """A lidar's points (N, 2) [m] of a wall of 0.15 m with a door round the origin, x through it, seen from `away`."""
    rng = np.random.default_rng(seed)
    points = []
    for bearing in np.linspace(-1.3, 1.3, 400):
        slope = math.tan(bearing)
        at_face = slope * (away - 0.075)
        if abs(at_face) > width / 2:
            hit = (-0.075, at_face)
        elif abs(slope) * (away + 0.075) > width / 2:
            hit = (width / 2 / abs(slope) - away, math.copysign(width / 2, slope))
        else:
            continue
        length = math.hypot(hit[0] + away, hit[1]) + rng.normal(0.0, noise)
        points.append((length * math.cos(bearing) - away, length * math.sin(bearing)))
    return np.array(points)


@given(st.integers(0, 10_000), st.floats(-0.12, 0.12), st.floats(-0.1, 0.1), st.floats(0.9, 2.0))
def test_a_door_is_found_at_its_true_place_and_not_at_that_of_the_map(
    seed: int, off: float, turned: float, away: float
) -> None:
    found = find_doorway(wall_with_door(seed, away), Pose2(0.0, off, turned), WIDTH)
    assert found is not None
    assert abs(found.pose.theta) < math.radians(1.0)
    # the point where the found axis crosses the wall; along the wall the assumed place is kept
    assert abs(found.pose.y - math.tan(found.pose.theta) * found.pose.x) < 0.02
    assert found.width == pytest.approx(WIDTH, abs=0.04)


@pytest.mark.parametrize(
    "points",
    [
        np.empty((0, 2)),
        wall_with_door(0)[wall_with_door(0)[:, 1] > 0],  # one jamb only
        wall_with_door(0, width=1.6),  # far too wide
        np.column_stack([np.full(200, -0.075), np.linspace(-2.0, 2.0, 200)]),  # closed
    ],
    ids=["nothing", "one jamb", "too wide", "closed"],
)
def test_openings_unlike_the_door_are_not_found(points: FloatArray) -> None:
    assert find_doorway(points, Pose2(), WIDTH) is None


def test_a_watch_is_certain_after_some_scans_and_averages_their_noise() -> None:
    watch = DoorWatch(Pose2(0.0, 0.06, 0.05), WIDTH)
    assert not watch.sure
    for seed in range(20):
        watch.see(wall_with_door(seed), FROM)
    assert watch.sure
    at = watch.odom_from_door
    assert abs(at.y - math.tan(at.theta) * at.x) < 0.007
    assert abs(at.theta) < math.radians(0.4)


def test_a_certain_watch_is_not_moved_by_the_map_or_by_another_opening() -> None:
    watch = DoorWatch(Pose2(), WIDTH)
    for seed in range(5):
        watch.see(wall_with_door(seed), FROM)
    before = watch.odom_from_door
    watch.believe(Pose2(0.0, 0.2, 0.1))
    watch.see(wall_with_door(9) + np.array([0.0, 0.15]), FROM)
    assert watch.odom_from_door == before


def test_scans_from_inside_of_the_door_do_not_change_its_place() -> None:
    """There the wall is seen end on; its place is known from before, and odometry keeps it."""
    watch = DoorWatch(Pose2(), WIDTH)
    slanting = wall_with_door(0) @ np.array([[1.0, 0.1], [-0.1, 1.0]])
    for seed in range(5):
        watch.see(wall_with_door(seed), FROM)
    before = watch.odom_from_door
    watch.see(slanting, Pose2(-0.1, 0.0, 0.0))
    assert watch.odom_from_door == before
    watch.see(slanting, Pose2(-0.5, 0.0, 0.0))
    assert abs(watch.odom_from_door.theta - before.theta) > 0.005


def test_a_chair_that_is_switched_on_at_the_door_may_measure_it_from_there() -> None:
    watch = DoorWatch(Pose2(), WIDTH)
    for seed in range(5):
        watch.see(wall_with_door(seed), Pose2(-0.1, 0.0, 0.0))
    assert watch.sure
