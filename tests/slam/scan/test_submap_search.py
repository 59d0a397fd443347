"""Submaps with a jump of the odometry in them."""

from __future__ import annotations

import numpy as np

from waychair.slam.scan.scan_points import ScanPoints, ScanStore
from waychair.slam.scan.submap_search import SubmapPyramids


def test_a_jump_of_100_km_within_a_submap_takes_no_memory_and_keeps_the_key_scans_before_it() -> None:
    corner = np.concatenate([np.column_stack([np.arange(0.0, 4.0, 0.05), np.full(80, y)]) for y in (-1.0, 1.0)])
    store = ScanStore()
    for _ in range(40):
        store.append(ScanPoints(corner, np.zeros_like(corner)))
    poses = np.column_stack([0.2 * np.arange(40), np.zeros((40, 2))])
    whole = SubmapPyramids().pyramid(0, store, poses, np.arange(30))
    poses[30:, :2] += (1e5, -1e5)
    torn = SubmapPyramids().pyramid(0, store, poses, np.arange(40))
    np.testing.assert_array_equal(torn.standing, whole.standing)
    assert torn.likelihood[0].size < 1e6
