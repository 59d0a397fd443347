"""Where the chair is on a saved map: odometry between scans, each scan matched against the map's walls."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from waychair.config import Settings, setting
from waychair.maps.grid import occupied, points_from_cells
from waychair.slam.reference import reference_from_points
from waychair.slam.scan_matching import MatchSettings, Window, match
from waychair.slam.scan_points import scan_points
from waychair.types import FloatArray, OccupancyGrid, Pose2, Scan, Twist


@dataclass(frozen=True, slots=True)
class LocaliserSettings(Settings):
    """How far a scan may correct the odometry, and when the chair is lost."""

    search_distance: float = setting(0.25, "m", "half window of the search round the odometry", low=0.05, high=5.0)
    search_angle: float = setting(0.15, "rad", "half window of the search round the odometry", low=0.02, high=3.1)
    position_noise: float = setting(0.03, "m", "trust in the odometry since the last scan", low=0.001, high=1.0)
    angle_noise: float = setting(0.02, "rad", "trust in the odometry since the last scan", low=0.001, high=1.0)
    ok_inliers: float = setting(0.5, "", "share of points on the map's walls when all is well", low=0.0, high=1.0)
    lost_inliers: float = setting(0.25, "", "below this share the scan says nothing about the pose", low=0.0, high=1.0)
    lost_scans: int = setting(5, "", "so many scans in a row that say nothing: lost", low=1, high=1000)
    max_points: int = setting(360, "", "points of a scan that are matched", low=20, high=10_000)
    matching: MatchSettings = field(default_factory=MatchSettings)


@dataclass(frozen=True, slots=True)
class Localisation:
    """Pose at a scan, the share of its points on the map's walls, and whether the chair still knows where it is."""

    map_from_base: Pose2
    map_from_odom: Pose2
    inliers: float
    lost: bool


class Localiser:
    """Follows the chair on a map from a known start."""

    def __init__(self, grid: OccupancyGrid, base_from_laser: Pose2, start: Pose2, settings: LocaliserSettings) -> None:
        points, normals = walls(grid)
        matching = settings.matching
        self._reference = reference_from_points(points, normals, matching.resolution, matching.sigma)
        self._base_from_laser = base_from_laser
        self._settings = settings
        self._start: Pose2 | None = start
        self._map_from_odom = Pose2()
        self._silent_scans = 0

    def process(self, scan: Scan, odom_from_base: Pose2, twist: Twist | None = None) -> Localisation:
        """Corrects `map_from_odom` by a scan that began where the odometry says `odom_from_base`, at this twist."""
        settings = self._settings
        if self._start is not None:
            self._map_from_odom, self._start = self._start @ odom_from_base.inverse(), None
        guess = self._map_from_odom @ odom_from_base
        points = scan_points(scan, self._base_from_laser, settings.matching.range_max, twist)
        points = points.thinned(settings.max_points)
        trust = np.diag([settings.position_noise**-2, settings.position_noise**-2, settings.angle_noise**-2])
        window = Window(settings.search_distance, settings.search_angle)
        found = match(points, self._reference, guess, trust, window, settings.matching)
        if found.inliers < settings.lost_inliers:
            self._silent_scans += 1
            return Localisation(guess, self._map_from_odom, found.inliers, self._silent_scans >= settings.lost_scans)
        self._silent_scans = 0 if found.inliers >= settings.ok_inliers else self._silent_scans
        self._map_from_odom = found.pose @ odom_from_base.inverse()
        return Localisation(found.pose, self._map_from_odom, found.inliers, False)


def walls(grid: OccupancyGrid) -> tuple[FloatArray, FloatArray]:
    """Points (N, 2) [m] and normals (N, 2) in the map of the occupied cells that border on known free ones.

    A point is the centre of its cell: a lidar's hits are spread over the cells they made occupied, so the centre is
    where the surface is on average. The normal is that of a line through the nearest such cells, on the free side.
    """
    solid = np.pad(occupied(grid), 1)
    free = np.pad((grid.cells >= 0) & ~occupied(grid), 1)
    points, facing = [], []
    for row, col in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        cells = np.argwhere(solid & np.roll(free, (-row, -col), axis=(0, 1))) - 1
        centres = points_from_cells(grid, cells)
        normal = grid.map_from_grid @ Pose2(col, row)
        normal_xy = np.array([normal.x - grid.map_from_grid.x, normal.y - grid.map_from_grid.y])
        points.append(centres)
        facing.append(np.broadcast_to(normal_xy, centres.shape))
    every, normals = np.concatenate(points), np.concatenate(facing)
    if len(every) < 3:
        return every, normals
    count = min(9, len(every))
    distances, near = cKDTree(every).query(every, k=count)
    weights = (distances < 4 * grid.resolution) * (np.einsum("nd,nkd->nk", normals, normals[near]) > -0.5)
    total = weights.sum(axis=1)
    offsets = every[near] - (weights[..., None] * every[near]).sum(axis=1)[:, None] / total[:, None, None]
    spread = np.einsum("nk,nki,nkj->nij", weights.astype(float), offsets, offsets)
    line = np.linalg.eigh(spread)[1][:, :, 0]
    mean_facing = np.einsum("nk,nkd->nd", weights.astype(float), normals[near])
    line *= np.where(np.einsum("nd,nd->n", line, mean_facing) < 0, -1.0, 1.0)[:, None]
    return every, line
