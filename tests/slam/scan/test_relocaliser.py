"""Global search against exhaustive search, lookalikes against beams, submaps, and a lost chair that finds its place."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.slam.conftest import WALLS, scan_at
from waychair.maps.grid.cells import cells_from_points
from waychair.recordings.recording import read_recording
from waychair.slam.scan.reference_surfaces import block_maxima
from waychair.slam.scan.relocaliser import (
    APART_DISTANCE,
    Pyramid,
    _likelihood,
    begin_global_search,
    global_search,
    heading_count,
    pyramid_from_grid,
    pyramid_from_points,
    standing_room,
    thinned,
)
from waychair.slam.scan.scan_points import ScanStore, scan_points
from waychair.slam.scan.submap_search import SubmapPyramids, global_candidates
from waychair.types import FloatArray, OccupancyGrid, Pose2


def flat(theta: float = 0.0) -> OccupancyGrid:
    """The synthetic flat as a grid of 5 cm with axes rotated by theta against the map's."""
    grid = OccupancyGrid(np.full((200, 260), -1, np.int8), 0.05, Pose2(-0.5, -0.5, 0.0))
    grid.cells[10:190, 10:250] = 0
    for x0, y0, x1, y1 in WALLS:
        share = np.linspace(0, 1, round(math.hypot(x1 - x0, y1 - y0) / 0.01) + 1)[:, None]
        cells = cells_from_points(grid, np.array([x0, y0]) + share * np.array([x1 - x0, y1 - y0]))
        grid.cells[cells[:, 0], cells[:, 1]] = 100
    return OccupancyGrid(grid.cells, grid.resolution, Pose2(0, 0, theta) @ grid.map_from_grid)


def points_at(pose: Pose2, seed: int = 0) -> FloatArray:
    return scan_points(scan_at(pose, noise=0.01, seed=seed), Pose2(), 20.0).points


def exhaustive(points: FloatArray, pyramid: Pyramid) -> float:
    """Best response over every standing cell and heading, one after the other."""
    level, standing = pyramid.likelihood[0].astype(int), np.argwhere(pyramid.standing & 1)
    count, best = heading_count(points, pyramid.resolution), 0.0
    for heading in np.arange(count) * math.tau / count:
        c, s = math.cos(heading), math.sin(heading)
        cols = np.floor((c * points[:, 0] - s * points[:, 1]) / pyramid.resolution + 0.5).astype(int)
        rows = np.floor((s * points[:, 0] + c * points[:, 1]) / pyramid.resolution + 0.5).astype(int)
        r, k = standing[:, :1] + rows, standing[:, 1:] + cols
        on_grid = (r >= 0) & (k >= 0) & (r < level.shape[0]) & (k < level.shape[1])
        values = np.where(on_grid, level[np.where(on_grid, r, 0), np.where(on_grid, k, 0)], 0)
        best = max(best, float(values.sum(axis=1).max()) / (255.0 * len(points)))
    return best


@settings(max_examples=20)
@given(seed=st.integers(0, 2**31), levels=st.integers(1, 6), height=st.integers(5, 30), width=st.integers(5, 30))
def test_the_best_place_is_that_of_exhaustive_search_even_at_the_edges(
    seed: int, levels: int, height: int, width: int
) -> None:
    rng = np.random.default_rng(seed)
    likelihood = np.where(rng.random((height, width)) < 0.1, rng.integers(1, 256, (height, width)), 0).astype(np.uint8)
    standing = (rng.random((height, width)) < 0.7).astype(np.uint8)
    pyramid = Pyramid(block_maxima(likelihood, levels), standing_room(standing, levels), 0.1)
    points = thinned(rng.uniform(-1.5, 1.5, (12, 2)), 0.1, 12)
    found = global_search(points, pyramid, floor=0.05)
    best = exhaustive(points, pyramid)
    assert (found[0].response if found else 0.0) == pytest.approx(best if best > 0.05 else 0.0, abs=1e-12)


@pytest.mark.parametrize("most", [1, 3000])
def test_a_search_in_pieces_finds_the_same_places_as_one_at_once(most: int) -> None:
    points, pyramid = points_at(Pose2(1.5, 1.5, 0.3)), pyramid_from_grid(flat())
    search, pieces = begin_global_search(points, pyramid), 1
    while not search.go_on(pyramid, most):
        pieces += 1
    assert pieces > 10
    assert search.hypotheses(pyramid) == global_search(points, pyramid)


def test_a_level_is_never_below_the_sum_of_any_pose_that_it_bounds() -> None:
    levels = block_maxima(np.random.default_rng(0).integers(0, 256, (37, 23)).astype(np.uint8), 5)
    for h in range(5):
        for row, col in np.ndindex(37, 23):
            assert levels[h, row, col] == levels[0, row : row + 2**h, col : col + 2**h].max()


@pytest.mark.parametrize("theta", [0.0, 0.7])
@pytest.mark.parametrize("pose", [Pose2(1.5, 1.5, 0.3), Pose2(10.5, 7.0, -2.0), Pose2(6.0, 7.5, 3.0)])
def test_a_scan_is_found_on_the_whole_map_at_any_heading(pose: Pose2, theta: float) -> None:
    best = global_search(points_at(pose), pyramid_from_grid(flat(theta)))[0].pose
    true = Pose2(0, 0, theta) @ pose
    assert math.hypot(best.x - true.x, best.y - true.y) < 0.15
    assert abs(math.remainder(best.theta - true.theta, math.tau)) < 0.05


def test_places_are_distinct_and_in_order_of_their_score() -> None:
    found = global_search(points_at(Pose2(1.5, 1.5, 0.3)), pyramid_from_grid(flat()))
    responses = [place.response for place in found]
    assert responses == sorted(responses, reverse=True)
    for k, place in enumerate(found):
        for other in found[:k]:
            near = math.hypot(place.pose.x - other.pose.x, place.pose.y - other.pose.y) < APART_DISTANCE / 2
            assert not (near and abs(math.remainder(place.pose.theta - other.pose.theta, math.tau)) < 0.1)


@pytest.mark.parametrize("value", [-1, 0])
def test_a_map_without_walls_and_a_scan_without_points_offer_no_place(value: int) -> None:
    empty = OccupancyGrid(np.full((50, 50), value, np.int8), 0.05)
    assert global_search(points_at(Pose2(1.5, 1.5, 0.3)), pyramid_from_grid(empty)) == ()
    assert global_search(np.empty((0, 2)), pyramid_from_grid(flat())) == ()


def test_a_query_is_found_in_its_submap_at_any_drift() -> None:
    store, true = ScanStore(), [Pose2(1.5 + 0.3 * k, 1.5, 0.0) for k in range(10)]
    true += [Pose2(10.5, 2.5 + 0.3 * k, math.pi / 2) for k in range(10)]
    for k, pose in enumerate(true):
        store.append(scan_points(scan_at(pose, noise=0.01, seed=k), Pose2(), 20.0))
    drift = Pose2(25.0, -40.0, 1.0)
    poses = np.array([(drift @ pose if k >= 10 else pose).array() for k, pose in enumerate(true)])
    members = {3: np.arange(10), 8: np.arange(10, 20)}
    pyramids = SubmapPyramids()
    query = Pose2(10.4, 3.9, 1.7)
    found = global_candidates(store, poses, members, points_at(query), pyramids)
    expected = drift @ query
    assert found[0].submap == 8
    assert math.hypot(found[0].map_from_base.x - expected.x, found[0].map_from_base.y - expected.y) < 0.2
    kept = pyramids.pyramid(8, store, poses, members[8])
    assert pyramids.pyramid(8, store, poses + np.array([5.0, 5.0, 0.0]), members[8]) is kept
    poses[19, :2] += 1.0
    assert pyramids.pyramid(8, store, poses, members[8]) is not kept


def test_scans_of_360_and_361_beams_of_a_real_log_are_both_found(data_dir: Path) -> None:
    frames = read_recording(data_dir / "lidar_fr079" / "fr079_laser.clf.gz").frames[:40]
    scan = frames[0].scan
    assert scan is not None
    assert len(scan.ranges) == 360
    points = scan_points(scan, Pose2(), 20.0).points
    pyramid = pyramid_from_points(points, np.zeros((1, 2)), 3.0)
    longer = np.append(scan.ranges, scan.ranges[-1])
    more = type(scan)(scan.stamp_ns, longer, scan.angle_min, scan.angle_step, range_max=scan.range_max)
    for query in (points, scan_points(more, Pose2(), 20.0).points):
        best = global_search(query, pyramid)[0]
        assert math.hypot(best.pose.x, best.pose.y) < 0.15
        assert best.response > 0.8


def test_points_of_any_layout_need_one_kernel() -> None:
    """A second one would be compiled in the middle of a drive."""
    points, standing = np.random.default_rng(0).uniform(-3.0, 3.0, (50, 2)), np.zeros((1, 2))
    pyramids = [pyramid_from_points(each, standing, 3.0) for each in (points, np.asfortranarray(points))]
    pyramids.append(pyramid_from_points(np.repeat(points, 2, axis=1)[:, ::2], np.asfortranarray(standing), 3.0))
    assert (pyramids[0].likelihood == pyramids[1].likelihood).all()
    assert (pyramids[0].likelihood == pyramids[2].likelihood).all()
    assert len(_likelihood.signatures) == 1
