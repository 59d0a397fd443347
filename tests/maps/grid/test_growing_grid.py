"""The growing grid keeps obstacles that stay, forgets those that are gone, and grows with the drive."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.maps.grid.cells import occupied
from waychair.maps.grid.growing_grid import GridMemory
from waychair.maps.grid.occupancy import OccupancySettings, build_grid
from waychair.types import FloatArray, Pose2, Scan

SETTINGS = OccupancySettings(resolution=0.05, range_max=4.0, open_range=4.0)


def scan_of(at: Pose2, posts: FloatArray) -> Scan:
    """Exact ranges to posts of 10 cm radius, one degree apart; nothing else is there."""
    ranges = np.full(360, math.inf)
    for i in range(360):
        c, s = math.cos(at.theta + math.radians(i)), math.sin(at.theta + math.radians(i))
        for x, y in posts - (at.x, at.y):
            along, across = c * x + s * y, c * y - s * x
            if along > 0 and abs(across) < 0.1:
                ranges[i] = min(ranges[i], along - math.sqrt(0.01 - across**2))
    return Scan(0, ranges.astype(np.float32), 0.0, math.radians(1.0), 0.0, 0.05, 25.0)


POSTS = np.array([[1.0, 0.3], [2.0, -1.0], [-1.5, 1.0], [5.0, 0.5]])
POSES = [Pose2(0.4 * k, 0.1 * k, 0.2 * k) for k in range(12)]


def test_still_obstacles_are_remembered_as_in_a_map() -> None:
    memory = GridMemory(POSES[0], SETTINGS)
    scans = [scan_of(pose, POSTS) for pose in POSES]
    for pose, scan in zip(POSES, scans, strict=True):
        memory.see(scan, pose)
    grid = build_grid(np.array([pose.array() for pose in POSES]), scans, SETTINGS)
    row, col = (round(getattr(grid.map_from_grid, a) / 0.05) - round(getattr(memory.corner, a) / 0.05) for a in "yx")
    expected, found = np.argwhere(occupied(grid)) + np.array([row, col]), np.argwhere(memory.occupied())
    assert len(expected) > 20
    np.testing.assert_array_equal(found, expected)


def test_the_grid_grows_and_forgets_nothing() -> None:
    memory = GridMemory(Pose2(), SETTINGS)
    memory.see(scan_of(Pose2(), POSTS), Pose2())
    before, corner, size = memory.occupied().sum(), memory.corner, memory.occupied().shape
    memory.include(Pose2(-7.0, 9.0, 0.0))
    assert memory.occupied().sum() == before > 0
    assert memory.corner.x < corner.x
    assert memory.corner.y == corner.y
    assert memory.occupied().shape[0] > size[0] + 9.0 / 0.05
    within = memory.occupied().shape
    memory.include(Pose2(-6.5, 8.0, 0.0))
    assert memory.occupied().shape == within


@pytest.mark.parametrize("reading", [math.nan, -math.inf])
def test_invalid_beams_change_nothing(reading: float) -> None:
    memory = GridMemory(Pose2(), SETTINGS)
    memory.see(scan_of(Pose2(), POSTS), Pose2())
    before = memory.occupied()
    memory.see(Scan(0, np.full(360, reading, np.float32), 0.0, math.radians(1.0), 0.0, 0.05, 25.0), Pose2())
    np.testing.assert_array_equal(memory.occupied(), before)
    assert before.any()


def test_a_cell_seen_through_ten_times_is_free_again_however_long_it_was_occupied() -> None:
    memory = GridMemory(Pose2(), SETTINGS)
    scan = scan_of(Pose2(), POSTS)
    for _ in range(100):
        memory.see(scan, Pose2())
    for _ in range(10):
        memory.see(scan_of(Pose2(), POSTS[1:]), Pose2())
    solid = np.argwhere(memory.occupied())[:, ::-1] * 0.05 + (memory.corner.x, memory.corner.y)
    assert len(solid)
    assert np.hypot(*(solid - POSTS[0]).T).min() > 0.5


def test_points_near_a_pose_are_the_occupied_cells_there() -> None:
    memory = GridMemory(POSES[0], SETTINGS)
    for pose in POSES:
        memory.see(scan_of(pose, POSTS), pose)
    rows, cols = np.nonzero(memory.occupied())
    middles = np.column_stack([memory.corner.x + (cols + 0.5) * 0.05, memory.corner.y + (rows + 0.5) * 0.05])
    near = (np.abs(middles - (1.0, 0.3)) < 0.5).all(axis=1)
    assert 0 < near.sum() < len(middles)
    assert memory.points_near(Pose2(1.0, 0.3, 2.0), 0.5) == pytest.approx(middles[near])
    assert len(memory.points_near(Pose2(100.0, 100.0), 0.5)) == len(memory.points_near(Pose2(-100.0, -100.0), 0.5)) == 0


def test_a_coarser_grid_is_occupied_where_any_part_of_a_cell_is() -> None:
    memory = GridMemory(POSES[0], SETTINGS)
    memory.see(scan_of(POSES[0], POSTS), POSES[0])
    fine, coarse = memory.occupied(), memory.grid(3)
    assert coarse.resolution == pytest.approx(0.15)
    assert coarse.map_from_grid == memory.corner
    found = {(int(row), int(col)) for row, col in np.argwhere(coarse.cells == 100)}
    assert found == {(int(row) // 3, int(col) // 3) for row, col in np.argwhere(fine)}
