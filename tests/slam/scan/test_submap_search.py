"""Submaps with a jump of the odometry in them."""

from __future__ import annotations

import numpy as np

from waychair.slam.scan.scan_points import ScanPoints, ScanStore
from waychair.slam.scan.submap_search import SubmapPyramids, SubmapRound


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


def test_a_submap_that_bends_in_the_middle_of_its_search_is_searched_anew() -> None:
    corner = np.concatenate(
        [
            np.column_stack([np.arange(0.0, 4.0, 0.05), np.zeros(80)]),
            np.column_stack([np.zeros(80), np.arange(0.0, 4.0, 0.05)]),
        ]
    )
    store, members = ScanStore(), np.arange(10)
    for _ in range(10):
        store.append(ScanPoints(corner, np.zeros_like(corner)))
    poses = np.zeros((10, 3))
    poses[1:, 0] += 9.0  # of two places at first
    pyramids, round_ = SubmapPyramids(), SubmapRound(corner, [(0, members)])
    assert not round_.search(store, poses, pyramids, most=1)
    straight = np.zeros((10, 3))
    while not round_.search(store, straight, pyramids, most=10_000):
        pass
    whole = SubmapRound(corner, [(0, members)])
    assert whole.search(store, straight, SubmapPyramids())
    assert round_.found == whole.found
    assert len(whole.found) >= 1
