"""Points and normals of a scan, and the store that keeps them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.slam.conftest import scan_at
from waychair.calibration.fits.self_mask import SelfMask
from waychair.geometry import arc
from waychair.slam.scan.scan_points import ScanPoints, ScanStore, beam_ends, scan_points
from waychair.types import FloatArray, Pose2, Scan, Twist


def wall_ahead(beams: int = 91) -> Scan:
    """A wall at x = 2, seen over 90 degrees."""
    angles = np.linspace(-math.pi / 4, math.pi / 4, beams)
    return Scan(0, (2 / np.cos(angles)).astype(np.float32), -math.pi / 4, math.pi / 2 / (beams - 1), range_max=30.0)


def test_normals_of_a_wall_point_towards_the_sensor() -> None:
    scan = scan_points(wall_ahead(), Pose2(), 20.0)
    assert scan.points[:, 0] == pytest.approx(np.full(91, 2.0), abs=1e-6)
    assert scan.normals == pytest.approx(np.tile([-1.0, 0.0], (91, 1)), abs=1e-5)


def test_points_and_normals_are_in_the_base_frame() -> None:
    mount = Pose2(0.6, 0.1, math.pi / 2)
    scan = scan_points(wall_ahead(), mount, 20.0)
    assert scan.points[:, 1] == pytest.approx(np.full(91, 2.1), abs=1e-6)
    assert scan.points[45] == pytest.approx([0.6, 2.1], abs=1e-6)
    assert scan.normals == pytest.approx(np.tile([0.0, -1.0], (91, 1)), abs=1e-5)


def test_invalid_near_and_far_beams_give_no_points() -> None:
    ranges = np.array([np.nan, np.inf, -np.inf, 0.0, 0.01, 25.0, 31.0, 3.0], np.float32)
    scan = Scan(0, ranges, 0.0, 0.1, range_min=0.02, range_max=30.0)
    assert len(scan_points(scan, Pose2(), 20.0)) == 1
    assert len(scan_points(scan, Pose2(), 100.0)) == 2


def test_every_beam_has_an_end() -> None:
    ranges = np.array([3.0, np.nan, 25.0, 2.0], np.float32)
    scan, mount = Scan(0, ranges, 0.0, 0.1, range_max=30.0, time_step=0.01), Pose2(0.6, 0.1, 1.0)
    ends, valid = beam_ends(scan, mount, 20.0, Twist(0.5, 0.4))
    assert valid.tolist() == [True, False, False, True]
    np.testing.assert_array_equal(ends[valid], scan_points(scan, mount, 20.0, Twist(0.5, 0.4)).points)


def test_a_corner_and_a_lone_point_have_no_normal() -> None:
    ranges = np.full(21, np.inf, np.float32)
    ranges[10] = 2.0
    assert not scan_points(Scan(0, ranges, 0.0, 0.02, range_max=30.0), Pose2(), 20.0).normals.any()


def test_normals_do_not_cross_a_gap_between_surfaces() -> None:
    scan = wall_ahead(181)
    ranges = scan.ranges.copy()
    ranges[90:] *= 1.5
    stepped = scan_points(Scan(0, ranges, scan.angle_min, scan.angle_step, range_max=30.0), Pose2(), 20.0)
    assert stepped.normals == pytest.approx(np.tile([-1.0, 0.0], (181, 1)), abs=1e-4)


def plain_points(scan: Scan, mount: Pose2, range_max: float, twist: Twist) -> tuple[FloatArray, FloatArray]:
    """A plain version of the kernels: points and normals beam by beam."""
    seen: list[FloatArray | None] = []
    for i, reach in enumerate(scan.ranges.astype(float)):
        at, angle = arc(twist.v * i * scan.time_step, twist.omega * i * scan.time_step), scan.angles()[i]
        end = (
            at @ mount @ Pose2(reach * math.cos(angle), reach * math.sin(angle)) if 0.05 < reach <= range_max else None
        )
        seen.append(None if end is None else np.array([end.x, end.y]))
    laser, points, normals = np.array([mount.x, mount.y]), [], []
    for i, point in enumerate(seen):
        if point is None:
            continue
        points.append(point)
        gap, cluster = 0.05 + 4.0 * scan.angle_step * float(np.hypot(*(point - laser))), [point]
        for side in (-1, 1):
            last = point
            for step in (1, 2, 3):
                other = seen[i + side * step] if 0 <= i + side * step < len(seen) else None
                if other is None or np.hypot(*(other - last)) > gap:
                    break
                cluster.append(other)
                last = other
        thin, wide = np.linalg.eigvalsh(np.cov(np.array(cluster).T, bias=True)) if len(cluster) > 2 else (1.0, 1.0)
        normal = np.zeros(2)
        if thin <= 0.15 * wide and thin <= 0.05**2:
            normal = np.linalg.eigh(np.cov(np.array(cluster).T, bias=True))[1][:, 0]
            normal = -normal if normal @ (point - laser) > 0 else normal
        normals.append(normal)
    return np.array(points).reshape(-1, 2), np.array(normals).reshape(-1, 2)


@pytest.mark.parametrize("seed", range(8))
def test_points_and_normals_equal_those_of_the_plain_computation(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ranges = (3.0 + np.cumsum(rng.normal(0.0, 0.02, 120))).astype(np.float32)
    ranges[rng.integers(0, 120, 12)] = rng.choice([np.nan, np.inf, -np.inf, 0.0, 0.04, 9.0], 12)
    scan = Scan(0, ranges, -1.0, math.radians(1.0), 2e-4, 0.02, 30.0)
    mount, twist = Pose2(*rng.uniform(-1.0, 1.0, 3)), Twist(0.7, -0.9)
    seen, (points, normals) = scan_points(scan, mount, 8.0, twist), plain_points(scan, mount, 8.0, twist)
    assert seen.points == pytest.approx(points, abs=1e-9)
    assert seen.normals == pytest.approx(normals, abs=1e-6)
    assert 20 < np.count_nonzero(normals.any(axis=1)) < len(points)


def test_the_store_returns_appended_scans_to_a_micrometre_at_any_size() -> None:
    store = ScanStore()
    scans = [scan_points(scan_at(Pose2(1.5 + 0.02 * k, 1.5, 0.0)), Pose2(), 20.0) for k in range(100)]
    assert [store.append(scan) for scan in scans] == list(range(100))
    assert len(store) == 100
    for k in (0, 50, 99):
        np.testing.assert_allclose(store[k].points, scans[k].points, atol=1e-6)  # single precision
        np.testing.assert_allclose(store[k].normals, scans[k].normals, atol=1e-6)


def test_thinning_keeps_at_most_the_given_number_of_points() -> None:
    scan = ScanPoints(np.zeros((101, 2)), np.zeros((101, 2)))
    assert len(scan.thinned(101)) == 101
    assert len(scan.thinned(50)) == 34


@given(st.floats(-0.8, 0.8), st.floats(-1.2, 1.2), st.floats(1e-5, 1.5e-4), st.booleans())
def test_a_moving_sweep_shows_the_same_wall_as_a_snapshot(
    v: float, omega: float, time_step: float, backwards: bool
) -> None:
    """Beams cast one by one at a wall x = 3 m from the chair's true pose at each beam's time."""
    time_step = -time_step if backwards else time_step
    laser, step = Pose2(0.6, 0.1, 0.05), math.radians(0.25)
    ranges = []
    for i in range(241):
        at = arc(v * time_step * i, omega * time_step * i) @ laser
        ranges.append((3.0 - at.x) / math.cos(at.theta - math.radians(30) + i * step))
    scan = Scan(0, np.array(ranges, np.float32), -math.radians(30), step, time_step, 0.05, 30.0)
    seen = scan_points(scan, laser, 20.0, Twist(v, omega))
    assert np.abs(seen.points[:, 0] - 3.0).max() < 1e-5
    assert seen.normals == pytest.approx(np.tile([-1.0, 0.0], (241, 1)), abs=1e-3)


def test_a_snapshot_is_not_corrected_for_motion() -> None:
    assert (
        scan_points(wall_ahead(), Pose2(), 10.0, Twist(1.0, 1.0)).points
        == scan_points(wall_ahead(), Pose2(), 10.0).points
    ).all()


def test_beams_that_end_on_the_chair_itself_give_no_points_and_spoil_no_normals() -> None:
    scan = wall_ahead()
    ranges = scan.ranges.copy()
    ranges[:10] = 0.2
    own = SelfMask(begins=(scan.angle_min - 0.001,), ends=(scan.angle_min + 9.5 * scan.angle_step,), reaches=(0.3,))
    points = scan_points(replace(scan, ranges=ranges), Pose2(), 20.0, mask=own)
    assert len(points) == 81
    assert points.points[:, 0] == pytest.approx(np.full(81, 2.0), abs=1e-6)


@pytest.mark.parametrize(
    ("beams", "away", "noise"), [(480, 0.25, 0.012), (1440, 0.25, 0.012), (720, 0.15, 0.02), (480, 0.25, 0.03)]
)
def test_noise_close_to_a_dense_lidar_does_not_turn_the_normals(beams: int, away: float, noise: float) -> None:
    """Noise lies along the beams: a line through beams that are closer together than it would show the noise."""
    angles = np.linspace(-1.2, 1.2, beams)
    ranges = away / np.cos(angles) + noise * np.random.default_rng(2).standard_normal(beams)
    seen = scan_points(Scan(0, ranges.astype(np.float32), -1.2, 2.4 / (beams - 1), range_max=30.0), Pose2(), 20.0)
    known = seen.normals.any(axis=1)
    off = np.degrees(np.arccos(np.clip(-seen.normals[known, 0], -1.0, 1.0)))
    assert known.mean() > 0.3
    assert np.quantile(off, 0.95) < 25.0


def test_rows_that_hold_no_scan_yet_are_zero_as_they_are_saved_with_the_others() -> None:
    for rows in (1024, 1280):
        np.full((rows, 2), np.nan, np.float32)  # memory that is used again below
    store = ScanStore()
    for _ in range(12):
        store.append(scan_points(wall_ahead(), Pose2(), 20.0))
    points, normals, offsets = store.arrays
    assert len(points) > offsets[12]
    assert not points[offsets[12] :].any()
    assert not normals[offsets[12] :].any()
