"""Extrinsics from planes, and the planes of a depth image."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from waychair.calibration.fits.camera_mount import PlaneView, extrinsics_from_planes
from waychair.calibration.fits.planes import planes_from_depth
from waychair.errors import CalibrationError, ThinData
from waychair.types import Float32Array, FloatArray, Pose3

OPTICAL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Optical axes of a camera that looks along the laser's x."""


def _mount(turn: tuple[float, float, float] = (0.05, -0.08, 0.03)) -> Pose3:
    return Pose3(Rotation.from_rotvec(turn).as_matrix() @ OPTICAL, np.array([0.2, 0.6, -0.1]))


def _views(true: Pose3, lean: float, noise: float = 0.0, count: int = 12, seed: int = 0) -> list[PlaneView]:
    """Boards in front of the laser, turned aside by up to 40 degrees and leaning by up to `lean` [rad]."""
    rng = np.random.default_rng(seed)
    views = []
    for _ in range(count):
        yaw, tilt = rng.uniform(-0.7, 0.7), rng.uniform(-lean, lean)
        normal = np.array([math.cos(yaw) * math.cos(tilt), math.sin(yaw) * math.cos(tilt), math.sin(tilt)])
        distance = rng.uniform(1.0, 3.0)
        angles = np.linspace(-0.15, 0.15, 40) + yaw
        ranges = distance / (normal[0] * np.cos(angles) + normal[1] * np.sin(angles)) + noise * rng.standard_normal(40)
        points = np.stack([ranges * np.cos(angles), ranges * np.sin(angles), np.zeros(40)], axis=1)
        there = true.rotation @ normal
        views.append(PlaneView(there, distance + float(there @ true.translation), points))
    return views


def _off(found: Pose3, true: Pose3) -> tuple[float, float]:
    """Metres and radians between two poses."""
    turn = Rotation.from_matrix(found.rotation @ true.rotation.T).magnitude()
    return float(np.linalg.norm(found.translation - true.translation)), float(turn)


@given(st.tuples(*[st.floats(-0.5, 0.5)] * 3), st.integers(0, 20))
def test_without_noise_the_camera_is_found_exactly_without_an_initial_guess(
    turn: tuple[float, float, float], seed: int
) -> None:
    true = _mount(turn)
    assert _off(extrinsics_from_planes(_views(true, 0.6, seed=seed)).camera_from_laser, true) < (1e-6, 1e-6)


def test_a_centimetre_of_noise_leaves_a_centimetre_and_half_a_degree() -> None:
    found = extrinsics_from_planes(_views(_mount(), 0.6, noise=0.01, count=20))
    metres, radians = _off(found.camera_from_laser, _mount())
    assert metres < 0.01
    assert radians < math.radians(0.5)
    assert found.rms_m == pytest.approx(0.01, rel=0.2)


def test_beams_that_miss_the_board_are_left_out() -> None:
    views = _views(_mount(), 0.6, noise=0.003, count=20)
    rng = np.random.default_rng(3)
    spoilt = []
    for view in views:
        points = view.points.copy()
        points[rng.choice(40, 4, replace=False)] *= 1.3
        spoilt.append(PlaneView(view.normal, view.distance, points))
    found = extrinsics_from_planes(spoilt)
    metres, radians = _off(found.camera_from_laser, _mount())
    assert metres < 0.01
    assert radians < math.radians(0.5)
    assert found.points <= 20 * 36


def test_upright_walls_leave_the_height_unknown_and_the_floor_gives_it() -> None:
    true = _mount()
    walls = _views(true, 0.0)
    guess = Pose3(Rotation.from_rotvec((0.0, 0.05, 0.0)).as_matrix() @ true.rotation, true.translation + 0.02)
    with pytest.raises(ThinData, match="too much alike"):
        extrinsics_from_planes(walls, guess)
    with pytest.raises(ThinData, match="too much alike"):
        extrinsics_from_planes(walls)
    up = true.rotation @ np.array([0.0, 0.0, 1.0])
    corners = np.array([[1.0, 1.0, -0.3], [3.0, -1.0, -0.3], [2.0, 1.0, -0.3]])
    floor = PlaneView(up, float(up @ true.translation) - 0.3, corners)
    assert _off(extrinsics_from_planes([*walls, floor], guess).camera_from_laser, true) < (1e-6, 1e-6)
    with pytest.raises(ThinData, match="guess"):
        extrinsics_from_planes([*walls, floor])


def test_too_few_views_are_refused() -> None:
    with pytest.raises(ThinData, match="4 views"):
        extrinsics_from_planes(_views(_mount(), 0.6, count=4))


def test_planes_with_different_stamps_are_refused() -> None:
    views = _views(_mount(), 0.6)
    mixed = [PlaneView(a.normal, b.distance, b.points) for a, b in zip(views, views[1:] + views[:1], strict=True)]
    with pytest.raises(CalibrationError, match="same moments"):
        extrinsics_from_planes(mixed)


CAMERA = np.array([[300.0, 0.0, 160.0], [0.0, 300.0, 120.0], [0.0, 0.0, 1.0]])


def _depth(planes: list[tuple[FloatArray, float]]) -> Float32Array:
    """Depth image (240, 320) of the nearest of the planes along each pixel's ray."""
    cols, rows = np.meshgrid(np.arange(320), np.arange(240))
    rays = np.stack([(cols - 160) / 300, (rows - 120.5) / 300, np.ones(cols.shape)], axis=-1)
    nearest = np.full(cols.shape, np.inf)
    for normal, distance in planes:
        z = distance / (rays @ normal)
        nearest = np.where((z > 0.0) & (z < nearest), z, nearest)
    depth: Float32Array = nearest.astype(np.float32)
    depth[~np.isfinite(depth) | (depth > 20.0)] = np.nan
    return depth


def test_the_planes_of_a_corner_are_found_in_noise() -> None:
    wall = np.array([math.sin(0.5), 0.0, math.cos(0.5)])
    side = np.array([-math.cos(0.5), 0.0, math.sin(0.5)])
    floor = np.array([0.0, 1.0, 0.0])
    true = [(wall, 2.5), (side, 0.8), (floor, 0.5)]
    depth = _depth(true)
    depth += (0.0012 * depth**2 * np.random.default_rng(0).standard_normal(depth.shape)).astype(np.float32)
    found = planes_from_depth(depth, CAMERA, np.random.default_rng(0))
    assert len(found) == 3
    for normal, distance in true:
        plane = max(found, key=lambda each: float(each.normal @ normal))
        assert float(plane.normal @ normal) > math.cos(math.radians(0.3))
        assert plane.distance == pytest.approx(distance, abs=0.005)
        low, high = plane.extent
        assert (low <= high).all()


def test_an_image_without_depths_has_no_planes() -> None:
    assert planes_from_depth(np.full((24, 32), np.nan, np.float32), CAMERA, np.random.default_rng(0)) == ()
