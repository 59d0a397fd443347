"""New surfaces for the key scans whose surroundings have changed since they were recorded."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from waychair.slam.mapping.mapper import Mapper
from waychair.slam.scan.scan_points import ScanPoints, scan_points
from waychair.types import BoolArray, FloatArray, Pose2, Scan

_NEAR, _ALIKE = 0.15, 0.85  # [m] greatest distance to the same surface; least share of such points without a change


def renewed_surfaces(mapper: Mapper, scans: Mapping[int, tuple[Scan, Pose2]]) -> dict[int, ScanPoints]:
    """Return new surfaces of the key scans whose surroundings have changed, from the latest scan that each covered.

    `scans`: the mapper's kept scans by the numbers of their frames, with the lidar's poses from their key scans at the
    first beam. Points that are no longer seen are left out, new ones are added.
    """
    renewed = {}
    for key, latest in enumerate(mapper.covered_frames):
        if not latest or latest[-1] < mapper.earlier_frames:
            continue
        scan, key_from_laser = scans[latest[-1]]
        seen = scan_points(scan, key_from_laser, mapper.settings.matching.range_max)
        before = mapper.keys.store[key]
        if not len(before) or not len(seen):
            continue
        there = _beside(before.points, seen.points)
        known = _beside(seen.points, before.points)
        if min(there.mean(), known.mean()) < _ALIKE:
            # unchanged points keep their place: placed anew each day they would drift
            points = np.concatenate([before.points[there], seen.points[~known]])
            renewed[key] = ScanPoints(points, np.concatenate([before.normals[there], seen.normals[~known]]))
    return renewed


def _beside(points: FloatArray, surface: FloatArray) -> BoolArray:
    """Return (N,) whether points (N, 2) lie near a point of a surface (M, 2)."""
    from scipy.spatial import cKDTree

    away, _ = cKDTree(surface).query(points, distance_upper_bound=_NEAR)
    near: BoolArray = away <= _NEAR
    return near
