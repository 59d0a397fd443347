"""Following the chair on a map: drift is corrected, blindness is named."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.slam.conftest import WALLS, cast, scan_at
from waychair.maps.grid import cells_from_points
from waychair.slam.localiser import Localiser, LocaliserSettings, walls
from waychair.types import OccupancyGrid, Pose2, Scan


@pytest.fixture(scope="module")
def flat() -> OccupancyGrid:
    """The synthetic flat as a grid of 5 cm: walls occupied, the rest free."""
    grid = OccupancyGrid(np.zeros((200, 260), np.int8), 0.05, Pose2(-0.5, -0.5, 0.0))
    for x0, y0, x1, y1 in WALLS:
        share = np.linspace(0, 1, round(math.hypot(x1 - x0, y1 - y0) / 0.01) + 1)[:, None]
        cells = cells_from_points(grid, np.array([x0, y0]) + share * np.array([x1 - x0, y1 - y0]))
        grid.cells[cells[:, 0], cells[:, 1]] = 100
    return grid


def test_drifting_odometry_is_corrected_scan_by_scan(flat: OccupancyGrid) -> None:
    start = Pose2(1.5, 1.5, 0.0)
    localiser = Localiser(flat, Pose2(), start, LocaliserSettings())
    odometry = Pose2(7.0, -3.0, 1.0)  # odom is not map
    for k in range(80):
        truth = Pose2(1.5 + 0.1 * k, 1.5, 0.0)
        odometry = odometry @ Pose2(0.105 if k else 0.0, 0.0, 0.006 if k else 0.0)
        found = localiser.process(scan_at(truth, noise=0.01, seed=k), odometry)
        assert not found.lost
        assert math.hypot(found.map_from_base.x - truth.x, found.map_from_base.y - truth.y) < 0.06
        assert abs(found.map_from_base.theta) < 0.02
        assert (found.map_from_odom @ odometry).array() == pytest.approx(found.map_from_base.array(), abs=1e-9)


def test_a_blind_lidar_is_lost_after_the_stated_number_of_scans(flat: OccupancyGrid) -> None:
    settings = LocaliserSettings(lost_scans=5)
    localiser = Localiser(flat, Pose2(), Pose2(1.5, 1.5, 0.0), settings)
    blind = Scan(0, np.full(181, np.inf, np.float32), -math.pi / 2, math.pi / 180, range_max=30.0)
    lost = [localiser.process(blind, Pose2(0.05 * k, 0, 0)).lost for k in range(6)]
    assert lost == [False] * 4 + [True] * 2
    found = localiser.process(scan_at(Pose2(1.75, 1.5, 0.0)), Pose2(0.25, 0, 0))
    assert not found.lost


def test_a_place_that_is_not_on_the_map_is_not_believed(flat: OccupancyGrid) -> None:
    localiser = Localiser(flat, Pose2(), Pose2(1.5, 1.5, 0.0), LocaliserSettings(lost_scans=1))
    elsewhere = np.array([[-40, -1.2, 40, -1.2], [-40, 9.7, 40, 9.7], [6.3, -30, 6.3, 30]], float)
    angles = np.linspace(-math.pi / 2, math.pi / 2, 181)
    ranges = cast(elsewhere, Pose2(0, 0.0, 0.35), angles).astype(np.float32)
    scan = Scan(0, ranges, -math.pi / 2, math.pi / 180, range_max=80.0)
    assert localiser.process(scan, Pose2()).inliers < 0.5


def test_walls_are_the_cells_that_border_on_free_ground_and_their_normals_point_there() -> None:
    cells = np.full((20, 20), -1, np.int8)
    cells[:, 10:] = 0
    cells[:, 9] = 100
    points, normals = walls(OccupancyGrid(cells, 0.1, Pose2(2.0, 3.0, 0.0)))
    assert points[:, 0] == pytest.approx(np.full(20, 2.95))
    assert normals == pytest.approx(np.tile([1.0, 0.0], (20, 1)), abs=1e-6)


def test_normals_of_a_slanted_wall_are_not_stairs() -> None:
    cells = np.zeros((60, 60), np.int8)
    for k in range(60):
        cells[k // 2 + 10, k] = 100
        cells[: k // 2 + 10, k] = -1
    _, normals = walls(OccupancyGrid(cells, 0.05, Pose2()))
    angles = np.degrees(np.arctan2(normals[10:-10, 1], normals[10:-10, 0]))
    assert np.median(angles) == pytest.approx(90 + math.degrees(math.atan(0.5)), abs=6)
