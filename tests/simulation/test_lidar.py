"""The lidar: exact rays against a plain reference, and REP-117's codes."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.simulation.contact import Solid, solid_from_grid
from waychair.simulation.lidar import Lidar, LidarSettings, cast_rays
from waychair.types import BoolArray, FloatArray, OccupancyGrid, Pose2

RESOLUTION = 0.05
CLEAN = LidarSettings(sigma=0.0, drop_out=0.0)


def _plain_rays(cells: BoolArray, x: float, y: float, angles: FloatArray, range_max: float) -> FloatArray:
    """Nearest entry into any solid square, by slabs."""
    low = np.argwhere(cells)[:, ::-1] * RESOLUTION
    ranges = np.full(len(angles), math.inf)
    for i, angle in enumerate(angles):
        direction = np.array([math.cos(angle), math.sin(angle)])
        faces = (np.stack([low, low + RESOLUTION]) - (x, y)) / direction
        enter, leave = faces.min(axis=0).max(axis=1), faces.max(axis=0).min(axis=1)
        hits = enter[(enter <= leave) & (leave >= 0.0)]
        if len(hits):
            ranges[i] = max(hits.min(), 0.0)
    ranges[ranges > range_max] = math.inf
    return ranges


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.5, 10.0))
def test_rays_equal_a_plain_reference(seed: int, range_max: float) -> None:
    rng = np.random.default_rng(seed)  # places by chance, not by search: along a corner, hit or miss are both right
    cells = rng.random((40, 60)) < rng.uniform(0.0, 0.06)
    x, y = rng.uniform((-1.0, -1.0), (4.0, 3.0))
    angles = rng.uniform(-math.pi, math.pi, 64)
    ranges = cast_rays(cells, RESOLUTION, x, y, angles, range_max)
    np.testing.assert_allclose(ranges, _plain_rays(cells, x, y, angles, range_max), atol=1e-9)


@pytest.mark.parametrize(
    ("angle", "expected"),
    [(0.0, 1.95 - 1.03), (math.pi / 2, 0.95 - 0.52), (math.pi, 1.03 - 0.05), (-math.pi / 2, 0.47)],
)
def test_rays_along_the_axes_end_at_the_face_of_the_wall(angle: float, expected: float) -> None:
    cells = np.zeros((20, 40), np.bool_)
    cells[[0, -1]] = True
    cells[:, [0, -1]] = True
    assert cast_rays(cells, RESOLUTION, 1.03, 0.52, np.array([angle]), 25.0)[0] == pytest.approx(expected, abs=1e-9)


def _room() -> Solid:
    cells = np.zeros((200, 200), np.int8)
    cells[[0, -1]] = 100
    cells[:, [0, -1]] = 100
    return solid_from_grid(OccupancyGrid(cells, RESOLUTION))


def _lidar(settings: LidarSettings, seed: int = 0, mount: Pose2 | None = None) -> Lidar:
    return Lidar(settings, mount or Pose2(), np.random.default_rng(seed))


def test_a_scan_covers_its_field_of_view_from_edge_to_edge() -> None:
    scan = _lidar(CLEAN).scan(_room(), Pose2(5.0, 5.0, 0.0), 7)
    assert scan.stamp_ns == 7
    assert scan.ranges.dtype == np.float32
    assert scan.ranges.shape == (720,)
    assert scan.angles()[[0, -1]] == pytest.approx(np.radians([-135.0, 135.0]))


def test_a_scan_is_taken_from_where_the_laser_is_mounted() -> None:
    settings = dataclasses.replace(CLEAN, beams=3, field_of_view=math.pi)
    scan = _lidar(settings, mount=Pose2(0.6, 0.1, math.pi / 2)).scan(_room(), Pose2(5.0, 4.0, 0.0), 0)
    # The laser is at (5.6, 4.1) and looks to +y; its first beam points at +x, its last at -x.
    assert scan.ranges == pytest.approx([9.95 - 5.6, 9.95 - 4.1, 5.6 - 0.05], abs=1e-5)


def test_beyond_the_range_reads_plus_infinity_and_too_close_minus_infinity() -> None:
    far = _lidar(dataclasses.replace(CLEAN, range_max=3.0)).scan(_room(), Pose2(5.0, 5.0, 0.0), 0)
    assert (far.ranges == math.inf).all()
    close = _lidar(CLEAN).scan(_room(), Pose2(9.92, 5.0, 0.0), 0)
    assert close.ranges[360] == -math.inf
    inside = _lidar(CLEAN).scan(_room(), Pose2(9.97, 5.0, 0.0), 0)
    assert (inside.ranges == -math.inf).all()


def test_noise_and_drop_outs_are_as_large_as_they_say() -> None:
    noisy = _lidar(LidarSettings(sigma=0.03, drop_out=0.1))
    truth = _lidar(CLEAN).scan(_room(), Pose2(5.0, 5.0, 0.3), 0).ranges
    scans = np.array([noisy.scan(_room(), Pose2(5.0, 5.0, 0.3), 0).ranges for _ in range(50)])
    assert np.isnan(scans).mean() == pytest.approx(0.1, abs=0.01)
    assert np.nanstd(scans - truth) == pytest.approx(0.03, rel=0.03)
    assert np.nanmean(scans - truth) == pytest.approx(0.0, abs=0.001)


def test_the_random_stream_does_not_depend_on_what_is_seen() -> None:
    first, second = _lidar(LidarSettings()), _lidar(LidarSettings())
    first.scan(_room(), Pose2(5.0, 5.0, 0.0), 0)
    second.scan(_room(), Pose2(-900.0, 5.0, 0.0), 0)
    np.testing.assert_array_equal(
        first.scan(_room(), Pose2(5.0, 5.0, 0.0), 1).ranges, second.scan(_room(), Pose2(5.0, 5.0, 0.0), 1).ranges
    )
