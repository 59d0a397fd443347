"""Branch and bound against exhaustive search, refinement against truth, and degenerate scans."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.slam.conftest import scan_at
from waychair.geometry import pose_from_array, wrap_angle
from waychair.recordings.recording import read_recording
from waychair.slam.mapping.mapper import Mapper, MapperSettings
from waychair.slam.scan.reference_surfaces import LEVELS, ScanReference, reference_from_points, reference_from_scans
from waychair.slam.scan.scan_matching import (
    ANGLE_PENALTY,
    BEAM_SIGMA,
    DISTANCE_PENALTY,
    MatchSettings,
    Window,
    correlative_search,
    match,
    nearest_surface,
    refine,
)
from waychair.slam.scan.scan_points import ScanPoints, ScanStore, scan_points
from waychair.types import FloatArray, Pose2, Scan

SETTINGS = MatchSettings()
HERE = Pose2(1.5, 1.5, 0.3)


def points_at(pose: Pose2, noise: float = 0.0) -> ScanPoints:
    return scan_points(scan_at(pose, noise=noise), Pose2(), 20.0)


def reference(noise: float = 0.0) -> ScanReference:
    store = ScanStore()
    poses = np.array([[1.5, 1.5, 0.3], [1.7, 1.5, 0.2], [1.9, 1.6, 0.1]])
    for pose in poses:
        store.append(points_at(Pose2(*pose), noise))
    return reference_from_scans(store, poses, [0, 1, 2], poses[0], 12.0, SETTINGS.resolution, BEAM_SIGMA)


def exhaustive(points: FloatArray, ref: ScanReference, guess: Pose2, cells: int, angles: FloatArray) -> float:
    """Best penalised score of the window, one pose after the other."""
    best = 0.0
    for angle in angles:
        c, s = math.cos(guess.theta + angle), math.sin(guess.theta + angle)
        x = guess.x + c * points[:, 0] - s * points[:, 1] - ref.origin[0]
        y = guess.y + s * points[:, 0] + c * points[:, 1] - ref.origin[1]
        cols, rows = np.floor(x / ref.resolution).astype(int), np.floor(y / ref.resolution).astype(int)
        for dr in range(-cells, cells + 1):
            for dc in range(-cells, cells + 1):
                r, k = rows + dr, cols + dc
                inside = (r >= 0) & (k >= 0) & (r < ref.bounds.shape[1]) & (k < ref.bounds.shape[2])
                score = ref.bounds[0][r[inside], k[inside]].sum() / (255 * len(points))
                away = math.hypot(dr, dc) * ref.resolution
                best = max(best, score - DISTANCE_PENALTY * away - ANGLE_PENALTY * abs(angle))
    return best


@settings(max_examples=15, deadline=None)
@given(
    dx=st.floats(-0.4, 0.4), dy=st.floats(-0.4, 0.4), turn=st.floats(-0.1, 0.1), reach=st.sampled_from([0.1, 0.3, 0.5])
)
def test_branch_and_bound_agrees_with_exhaustive_search(dx: float, dy: float, turn: float, reach: float) -> None:
    ref = reference()
    points = points_at(HERE).points[::6]
    guess = Pose2(HERE.x + dx, HERE.y + dy, HERE.theta + turn)
    found, response = correlative_search(points, ref, guess, Window(reach, 0.05))
    far = float(np.sort(np.hypot(*points.T))[len(points) - 1 - len(points) // 5])
    step = math.acos(1 - ref.resolution**2 / (2 * far**2))
    count = math.ceil(0.05 / step)
    cells = math.ceil(reach / ref.resolution)
    best = exhaustive(points, ref, guess, cells, np.arange(-count, count + 1) * step)
    away = math.hypot(found.x - guess.x, found.y - guess.y)
    penalised = response - DISTANCE_PENALTY * away - ANGLE_PENALTY * abs(found.theta - guess.theta)
    assert penalised == pytest.approx(best, abs=1e-9)


def test_the_search_is_exact_where_walls_touch_the_edges_of_the_reference() -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        store = ScanStore()
        walls = rng.uniform(-1.2, 1.2, (60, 2))
        store.append(ScanPoints(walls, np.zeros_like(walls)))
        ref = reference_from_scans(store, np.zeros((1, 3)), [0], np.zeros(2), 1.0, SETTINGS.resolution, BEAM_SIGMA)
        points, guess = rng.uniform(-1.5, 1.5, (8, 2)), Pose2(*rng.uniform(-0.5, 0.5, 3))
        found, response = correlative_search(points, ref, guess, Window(0.8, 0.01))
        away = math.hypot(found.x - guess.x, found.y - guess.y)
        turned = abs(math.remainder(found.theta - guess.theta, math.tau))
        value = response - DISTANCE_PENALTY * away - ANGLE_PENALTY * turned
        far = max(1.0, float(np.sort(np.hypot(*points.T))[7 - 8 // 5]))
        step = math.acos(1 - ref.resolution**2 / (2 * far**2))
        count = math.ceil(0.01 / step)
        assert value == pytest.approx(exhaustive(points, ref, guess, 16, np.arange(-count, count + 1) * step), abs=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_the_nearest_surface_equals_that_of_a_full_search(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-math.pi, math.pi, 400)
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ref = reference_from_points(rng.uniform(-1.0, 1.0, (400, 2)), normals, 0.05, 0.06)
    for _ in range(100):
        x, y, facing = *rng.uniform(-1.3, 1.3, 2), rng.uniform(-math.pi, math.pi)
        nx, ny, reach = math.cos(facing), math.sin(facing), int(rng.integers(0, 7))
        row, col = (math.floor((v - o) / ref.resolution) for v, o in ((y, ref.origin[1]), (x, ref.origin[0])))
        rows, cols, sides = np.nonzero(ref.slots)
        every = ref.slots[rows, cols, sides]
        counts = (np.abs(rows - row) <= reach) & (np.abs(cols - col) <= reach)
        counts &= ref.surfaces[every, 2:] @ (nx, ny) >= 0.7
        away = np.where(counts, np.hypot(*(ref.surfaces[every, :2] - (x, y)).T), math.inf)
        expected = int(every[np.argmin(away)]) if counts.any() else 0
        assert nearest_surface(ref.surfaces, ref.slots, ref.resolution, row, col, reach, x, y, nx, ny) == expected


def test_bounds_are_the_maxima_of_their_blocks() -> None:
    ref = reference()
    level0 = ref.bounds[0].astype(int)
    rng = np.random.default_rng(0)
    for h in range(1, LEVELS):
        for row, col in rng.integers(0, len(level0), (200, 2)):
            assert ref.bounds[h, row, col] == level0[row : row + 2**h, col : col + 2**h].max()


def test_likelihood_is_one_on_a_hit_and_falls_off_as_a_gaussian() -> None:
    ref = reference_from_points(np.array([[0.02, 0.02]]), np.array([[1.0, 0.0]]), 0.05, 0.06)
    row, col = np.argwhere(ref.bounds[0] == 255)[0]
    assert ref.bounds[0, row, col + 1] == round(255 * math.exp(-0.5 * (0.05 / 0.06) ** 2))
    assert ref.bounds[0, row + 10, col] == 0


def test_a_cell_keeps_both_sides_of_a_thin_wall() -> None:
    points = np.array([[0.01, 0.0], [0.01, 0.0], [0.03, 0.0]])
    ref = reference_from_points(points, np.array([[-1.0, 0.0], [-1.0, 0.0], [1.0, 0.0]]), 0.05, 0.06)
    assert len(ref.surfaces) == 3
    assert ref.surfaces[1:, 2].tolist() == [-1.0, 1.0]
    assert ref.surfaces[1:, 0] == pytest.approx([0.01, 0.03])


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize(("dx", "dy", "turn"), [(0.25, -0.2, 0.2), (-0.25, 0.25, -0.3), (0.0, 0.0, 0.34)])
def test_a_match_recovers_the_pose_from_a_bad_guess(dx: float, dy: float, turn: float, noise: float) -> None:
    guess = Pose2(HERE.x + dx, HERE.y + dy, HERE.theta + turn)
    found = match(points_at(HERE, noise), reference(), guess, np.eye(3), Window(0.3, 0.35), SETTINGS)
    assert math.hypot(found.pose.x - HERE.x, found.pose.y - HERE.y) < 0.005 + noise / 3
    assert abs(found.pose.theta - HERE.theta) < 0.002 + noise / 10
    assert found.inliers > 0.9
    assert found.response > 0.6


def corridor(length: float) -> tuple[FloatArray, FloatArray]:
    """Points and normals of two bare walls along x."""
    x = np.arange(-length, length, 0.02)
    points = np.concatenate([np.stack([x, np.full_like(x, 1.0)], 1), np.stack([x, np.full_like(x, -1.0)], 1)])
    normals = np.concatenate([np.tile([0.0, -1.0], (len(x), 1)), np.tile([0.0, 1.0], (len(x), 1))])
    return points, normals


def test_along_a_bare_corridor_the_odometry_decides() -> None:
    ref = reference_from_points(*corridor(15.0), 0.05, 0.06)
    scan = ScanPoints(*corridor(4.0))
    guess = Pose2(0.13, 0.1, 0.05)
    found = match(scan, ref, guess, np.diag([100.0, 100.0, 100.0]), Window(0.3, 0.2), SETTINGS)
    assert found.pose.x == pytest.approx(0.13, abs=0.02)
    assert found.pose.y == pytest.approx(0.0, abs=0.005)
    assert found.pose.theta == pytest.approx(0.0, abs=0.002)
    assert found.information[0, 0] < 1e-3 * found.information[1, 1]


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_noisy_normals_in_a_bare_corridor_give_no_information_along_it(noise: float) -> None:
    rng = np.random.default_rng(3)
    angles = np.linspace(-math.pi / 2, math.pi / 2, 361)

    def seen(x: float, y: float, theta: float) -> ScanPoints:
        sines = np.sin(angles + theta)
        with np.errstate(divide="ignore"):
            ranges = np.where(sines > 0, (1.0 - y) / sines, (-1.0 - y) / sines) + noise * rng.standard_normal(361)
        scan = Scan(0, ranges.astype(np.float32), -math.pi / 2, math.pi / 360, range_max=30.0)
        return scan_points(scan, Pose2(), 8.0)

    store, poses = ScanStore(), np.array([[0.2 * k, 0.0, 0.02 * math.cos(k)] for k in range(20)])
    for x, y, theta in poses:
        store.append(seen(x, y, theta))
    ref = reference_from_scans(store, poses, range(20), poses[-1], 12.0, SETTINGS.resolution, BEAM_SIGMA)
    found = match(seen(4.0, 0.0, 0.0), ref, Pose2(4.1, 0.05, 0.02), np.eye(3), Window(0.3, 0.2), SETTINGS)
    assert found.degenerate
    assert found.pose.x == pytest.approx(4.1, abs=0.01)
    assert found.pose.y == pytest.approx(0.0, abs=0.01)
    assert math.sqrt(found.covariance[0, 0]) > 1.0
    assert math.sqrt(found.covariance[1, 1]) < 0.05


def test_a_room_is_not_degenerate_and_has_no_rival() -> None:
    scan, ref, window = points_at(HERE, 0.01), reference(0.01), Window(0.8, 0.35)
    found = match(scan, ref, HERE, np.eye(3), window, SETTINGS)
    assert not found.degenerate
    assert found.complexity > 0.05
    best, response = correlative_search(scan.points, ref, HERE, window)
    _, runner_up = correlative_search(scan.points, ref, HERE, window, excluded=best)
    assert 0.0 < runner_up < 0.8 * response


def test_a_repeating_place_has_a_second_match_as_good_as_the_best() -> None:
    x = np.arange(0, 6, 0.02)
    comb = np.concatenate([np.stack([x, np.zeros_like(x)], 1)] + [
        np.stack([np.full(20, float(k)), np.linspace(0, 1, 20)], 1) for k in range(7)
    ])  # fmt: skip
    ref = reference_from_points(comb, np.tile([0.0, 1.0], (len(comb), 1)), 0.05, 0.06)
    part = comb[(comb[:, 0] > 2.5) & (comb[:, 0] < 3.5)] - (3.0, 0.0)
    best, response = correlative_search(part, ref, Pose2(3.0, 0.0, 0.0), Window(1.5, 0.1))
    _, runner_up = correlative_search(part, ref, Pose2(3.0, 0.0, 0.0), Window(1.5, 0.1), excluded=best)
    assert response > 0.9
    assert runner_up > 0.85 * response


def test_without_a_match_above_the_minimum_score_the_guess_and_zero_are_returned() -> None:
    guess = Pose2(30.0, 30.0, 0.0)
    assert correlative_search(points_at(HERE).points, reference(), guess, Window(0.3, 0.1), floor=0.5) == (
        guess,
        0.0,
    )


def test_an_empty_scan_has_no_match() -> None:
    nothing = ScanPoints(np.empty((0, 2)), np.empty((0, 2)))
    found = match(nothing, reference(), HERE, np.eye(3), Window(0.3, 0.1), SETTINGS)
    assert (found.pose, found.response, found.inliers) == (HERE, 0.0, 0.0)


def test_points_beyond_the_end_of_a_known_wall_do_not_pull_the_chair_along_it() -> None:
    """A chair that backs along a wall sees new wall beside it: many near points, next to the one with the worst normal."""
    ahead, beside = np.arange(0.3, 8.0, 0.02), np.arange(0.12, 0.3, 0.005)
    across = np.arange(-0.9, 0.27, 0.15)
    walls = [
        (np.column_stack([ahead, np.full(len(ahead), 0.27)]), (0.0, -1.0)),
        (np.column_stack([ahead, np.full(len(ahead), -1.0)]), (0.0, 1.0)),
        (np.column_stack([np.full(len(across), 8.0), across]), (-1.0, 0.0)),
    ]
    new = np.column_stack([beside, np.full(len(beside), 0.27)])
    points, normals = np.concatenate([wall for wall, _ in walls]), np.concatenate([[n] * len(w) for w, n in walls])
    seen = ScanPoints(np.concatenate([points, new]), np.concatenate([normals, [(0.0, -1.0)] * len(new)]))
    normals[0] = math.sqrt(0.5), -math.sqrt(0.5)  # at the end of a view a few beams tell the normal
    ref, prior = reference_from_points(points, normals, 0.05, 0.06), np.diag([900.0, 900.0, 10_000.0])
    pose, *_ = refine(seen, ref, Pose2(), Pose2(), prior, SETTINGS)
    assert abs(pose.x) < 0.01


def test_refinement_far_from_any_surface_stays_at_the_guess() -> None:
    away = Pose2(100.0, 100.0, 0.5)
    pose, information, inliers, _ = refine(points_at(HERE), reference(), away, away, np.eye(3), SETTINGS)
    assert (pose.x, pose.y, pose.theta) == pytest.approx((100.0, 100.0, 0.5), abs=1e-6)
    assert inliers == 0.0
    assert not information.any()


def disagreement(store: ScanStore, poses: FloatArray, nodes: Iterable[int], settings: MatchSettings) -> FloatArray:
    """Squared Mahalanobis distances (M,) between two matches of each key scan that have no beam in common.

    One is of the even beams against the even ones of the 40 key scans before, the other of the odd ones, each from its
    own perturbed guess. With true covariances their mean is 3. Degenerate and failed matches are left out.
    """
    rng, squares = np.random.default_rng(0), []
    for node in nodes:
        earlier, found = np.arange(max(0, node - 40), node), []
        for half in range(2):
            scan = store[node]
            mine = ScanPoints(scan.points[half::2].copy(), scan.normals[half::2].copy())
            reference = reference_from_scans(
                store, poses, earlier[half::2], poses[node], 12.0, settings.resolution, BEAM_SIGMA
            )
            guess = pose_from_array(poses[node] + rng.normal(size=3) * (0.1, 0.1, 0.05))
            found.append(match(mine, reference, guess, np.eye(3), Window(0.3, 0.35), settings))
        if any(one.degenerate or one.inliers < 0.5 for one in found):
            continue
        apart = found[0].pose.array() - found[1].pose.array()
        apart[2] = wrap_angle(float(apart[2]))
        squares.append(float(apart @ np.linalg.solve(found[0].covariance + found[1].covariance, apart)))
    return np.array(squares)


@pytest.mark.parametrize(
    "log",
    [
        "lidar_intel/intel_first1088s.clf.gz",
        pytest.param("lidar_fr079/fr079_laser.clf.gz", marks=pytest.mark.nightly),
    ],
)
def test_the_covariance_covers_the_disagreement_of_disjoint_halves_of_real_scans(data_dir: Path, log: str) -> None:
    frames = read_recording(data_dir / log).frames[:600]
    mapper = Mapper(MapperSettings(), Pose2())
    for frame in frames:
        mapper.process(frame)
    result, store = mapper.result(), ScanStore()
    for index in result.key_frames:
        scan = frames[index].scan
        assert scan is not None
        store.append(scan_points(scan, Pose2(), SETTINGS.range_max))
    squares = disagreement(store, result.key_poses, range(20, len(store)), SETTINGS)
    assert len(squares) > 20
    assert np.mean(squares) / 3.0 < 1.5  # not too small
    assert np.mean(squares) / 3.0 > 0.02  # nor far too large


@pytest.mark.parametrize("beams", [359, 360, 361])
def test_scans_of_any_length_match_a_reference_of_another_length(beams: int) -> None:
    scan = scan_points(scan_at(HERE, beams=beams), Pose2(), 20.0)
    found = match(scan, reference(), Pose2(1.6, 1.4, 0.35), np.eye(3), Window(0.3, 0.35), SETTINGS)
    assert math.hypot(found.pose.x - HERE.x, found.pose.y - HERE.y) < 0.01
