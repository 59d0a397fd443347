"""New surfaces for the key scans whose surroundings have changed since they were recorded."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numba import njit

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


@njit(cache=True)
def _beside(points: FloatArray, surface: FloatArray) -> BoolArray:
    """Return (N,) whether points (N, 2) lie within `_NEAR` of a point of a surface (M, 2).

    The surface's points are ordered by x, so that only those in a narrow strip are compared.
    """
    order = np.argsort(surface[:, 0])
    ordered, near = surface[order], np.zeros(len(points), np.bool_)
    for k in range(len(points)):
        x, y = points[k, 0], points[k, 1]
        for other in range(np.searchsorted(ordered[:, 0], x - _NEAR), len(ordered)):
            if ordered[other, 0] > x + _NEAR:
                break
            if (ordered[other, 0] - x) ** 2 + (ordered[other, 1] - y) ** 2 <= _NEAR**2:
                near[k] = True
                break
    return near
