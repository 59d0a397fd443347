"""A depth image shows the floor, obstacles that stand or hang in the chair's way, and drop-offs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.maps.depth_rooms import EVERY, picture, scan_of_picture
from waychair.maps.depth.depth_scan import (
    DROP_OFF,
    FLOOR,
    OBSTACLE,
    DepthScan,
    find_stretches,
    frame_problem,
    planar_scan,
    stretch_cells,
)
from waychair.maps.depth.ground import BELOW, GROUND, MISSING, STANDS
from waychair.slam.odometry.tilt import Tilt
from waychair.types import FloatArray, Pose2

SIDE = 0.05
leans = st.builds(Tilt, st.just(1), st.floats(-0.06, 0.06), st.floats(-0.06, 0.06))


def told(scan: DepthScan, x: float, y: float) -> int:
    """Return the kind of the cell at a point of the base frame; 0: none."""
    lens = Pose2(float(scan.origin[0]), float(scan.origin[1]))
    cells, what = stretch_cells(lens.x, lens.y, 0.0, scan.bearings, scan.near, scan.far, scan.kinds, SIDE)
    here = np.all(cells == np.floor(np.array([x, y]) / SIDE).astype(int), axis=1)
    return int(what[here][0]) if here.any() else 0


@given(leans)
@settings(max_examples=15, deadline=None)
def test_a_level_floor_is_floor_at_any_lean_of_the_chair(tilt: Tilt) -> None:
    scan = scan_of_picture(picture(tilt=tilt), tilt)
    assert set(scan.kinds.tolist()) == {FLOOR}
    assert told(scan, 3.0, 0.2) == FLOOR


@given(leans, st.floats(0.12, 0.25))
@settings(max_examples=10, deadline=None)
def test_a_thing_lower_than_the_lidar_is_an_obstacle(tilt: Tilt, height: float) -> None:
    scan = scan_of_picture(picture([(2.62, 2.9, 0.0, 0.5, 0.0, height)], tilt=tilt), tilt)
    assert told(scan, 2.63, 0.25) == OBSTACLE
    assert told(scan, 2.3, 0.25) == FLOOR


@pytest.mark.parametrize(("low", "expected"), [(0.5, OBSTACLE), (0.7, OBSTACLE), (1.3, OBSTACLE), (1.5, 0), (1.9, 0)])
def test_a_thing_that_hangs_at_head_height_is_an_obstacle_and_one_above_is_none(low: float, expected: int) -> None:
    scan = scan_of_picture(picture([(3.02, 3.4, -0.5, 0.9, low, low + 0.08)]))
    assert (OBSTACLE in scan.kinds) == (expected == OBSTACLE)
    if expected:
        assert told(scan, 3.03, 0.2) == OBSTACLE


@pytest.mark.parametrize("depth", [0.17, 0.34, 1.5])
@pytest.mark.parametrize("lean", [0.0, 0.04, -0.04])
def test_a_hole_in_the_floor_is_a_drop_off_and_never_floor(depth: float, lean: float) -> None:
    tilt = Tilt(1, lean / 2, lean)
    scan = scan_of_picture(picture(holes=[(2.6, 3.4, -0.4, 0.8, depth)], tilt=tilt), tilt)
    inside = [told(scan, x, y) for x in np.arange(2.68, 3.2, 0.1) for y in (-0.2, 0.2, 0.6)]
    assert FLOOR not in inside
    assert inside.count(DROP_OFF) >= 0.8 * len(inside)
    assert told(scan, 2.4, 0.2) == FLOOR


def test_expected_ground_that_is_not_seen_is_a_drop_off() -> None:
    frame = picture()
    frame.depth[85:95, 50:110] = np.nan
    assert DROP_OFF in scan_of_picture(frame).kinds


def test_a_column_that_begins_within_a_stairwell_gives_no_floor_there() -> None:
    """A landing 0.3 m down just before the footrest could be taken for the end of a ramp."""
    scan = scan_of_picture(picture(holes=[(0.9, 6.0, -2.0, 2.0, 0.3)]))
    assert FLOOR not in scan.kinds


def test_the_floor_behind_a_thing_at_the_edge_of_the_picture_is_no_drop_off() -> None:
    scan = scan_of_picture(picture([(1.9, 2.2, -1.0, 1.0, 0.0, 0.14)]))
    assert DROP_OFF not in scan.kinds


def test_the_scan_from_depth_has_the_nearest_obstacles() -> None:
    scan = planar_scan(scan_of_picture(picture([(3.0, 3.2, -5.0, 5.0, 0.0, 2.0)])))
    straight = scan.ranges[round(-scan.angle_min / scan.angle_step)]
    assert straight == pytest.approx(2.6, abs=0.03)


def test_a_picture_without_information_is_refused_with_the_reason() -> None:
    frame = picture()
    blank = np.full_like(frame.depth, np.nan)
    few = blank.copy()
    few[:10, :10] = 2.0
    cases = {
        "no depth at all": replace(frame, depth=blank),
        "hardly any depth": replace(frame, depth=few),
        "covered": replace(frame, depth=np.full_like(frame.depth, 0.2)),
        "no depth image": replace(frame, depth=np.empty((0, 0), np.float32)),
        "camera matrix": replace(frame, camera_matrix=np.zeros((3, 3))),
    }
    for reason, case in cases.items():
        assert reason in (frame_problem(case, EVERY) or "")
    assert frame_problem(replace(frame, depth=np.full_like(frame.depth, np.inf)), EVERY) is not None
    assert frame_problem(frame, EVERY) is None


def plain_column(
    kind: list[int], away: list[float], z: list[float], foot: list[float], row: dict[str, float]
) -> list[tuple[int, float, float]]:
    """Return kind, near and far of the floor and drop-off stretches of one column on a level floor."""
    found: list[tuple[int, float, float]] = []
    going = 0
    first = next((k for k, what in enumerate(kind) if what == GROUND), None)
    deep = False
    for k, what in enumerate(kind):
        doubt = first is not None and k >= first and abs(z[first]) > 0.5 * row["least"] + 0.01 * away[first]
        if what == STANDS and (not doubt or z[k] > row["slope"] * away[k] + row["least"]):
            going = going if z[k] > row["tallest"] else 0
        if what == STANDS or doubt:
            continue
        deep = deep or (what == BELOW and z[k] < -row["least"] - 0.01 * away[k])
        deep = deep and what != GROUND
        if what == BELOW and not deep:
            going = 0
        new = FLOOR if what == GROUND else DROP_OFF if what == MISSING or (what == BELOW and deep) else 0
        where = away[k] if new == FLOOR else foot[k]
        if not new or not where < row["range_max"]:
            continue
        gap = max(0.1, 2.0 * where * where * row["beam"] / row["lens_z"])
        last = found[-1][2] if found else math.nan
        if going == new and last - 0.02 <= where <= last + gap:
            found[-1] = (new, found[-1][1], max(last, where))
        else:
            found.append((new, where, where))
        going = new
    return found


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_the_kernel_finds_the_same_stretches_as_plain_python(seed: int) -> None:
    rng, count = np.random.default_rng(seed), 40
    kind = rng.choice([0, GROUND, GROUND, GROUND, STANDS, BELOW, MISSING], count).astype(np.uint8)
    away = np.sort(rng.uniform(1.0, 5.5, count))
    z = np.where(kind == STANDS, rng.uniform(0.1, 2.0, count), rng.choice([0.0, 0.0, -0.1, -0.4], count))
    foot = np.where((kind == BELOW) | (kind == MISSING), away + rng.uniform(-0.05, 0.05, count), np.nan)
    row = {"lens_z": 0.95, "beam": 0.02, "range_max": 4.5, "tallest": 1.4, "least": 0.06, "slope": 0.12}

    def column(values: FloatArray) -> FloatArray:
        return values[:, None]

    bearings = np.zeros((count, 1), np.float32)
    found = find_stretches(
        kind[:, None], column(away), column(z), np.zeros((count, 1)), column(foot), bearings, row["lens_z"],
        row["beam"], row["range_max"], row["tallest"], 1, row["least"], row["slope"],
    )  # fmt: skip
    used = [k for k in range(found.used) if found.kinds[k] != OBSTACLE]
    stretches = [(int(found.kinds[k]), float(found.near[k]), float(found.far[k])) for k in used]
    expected = plain_column(kind.tolist(), away.tolist(), z.tolist(), foot.tolist(), row)
    assert [each[0] for each in stretches] == [each[0] for each in expected]
    np.testing.assert_allclose(np.array(stretches).reshape(-1, 3), np.array(expected).reshape(-1, 3), atol=1e-5)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_the_kernel_touches_the_same_cells_as_plain_python(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count, x, y, theta = 20, *rng.uniform(-5.0, 5.0, 3).tolist()
    bearings = rng.uniform(-0.6, 0.6, count).astype(np.float32)
    near = rng.uniform(0.5, 3.0, count).astype(np.float32)
    far = near + rng.uniform(0.0, 1.0, count).astype(np.float32)
    kinds = rng.integers(1, 4, count).astype(np.uint8)
    expected: dict[tuple[int, int], int] = {}
    for bearing, begin, end, what in zip(
        bearings.astype(float).tolist(), near.tolist(), far.tolist(), kinds.tolist(), strict=True
    ):
        c, s = math.cos(theta + bearing), math.sin(theta + bearing)
        steps = math.ceil(float(np.float32(end) - np.float32(begin)) / (0.5 * SIDE))
        for k in range(steps + 1):
            d = begin + float(np.float32(end) - np.float32(begin)) * (k / steps if steps else 0.0)
            cell = math.floor((x + d * c) / SIDE), math.floor((y + d * s) / SIDE)
            expected[cell] = max(expected.get(cell, 0), what)
    cells, what_told = stretch_cells(x, y, theta, bearings, near, far, kinds, SIDE)
    found = {(int(col), int(row)): int(what) for (col, row), what in zip(cells, what_told, strict=True)}
    different = {cell for cell in found.keys() | expected.keys() if found.get(cell) != expected.get(cell)}
    assert len(different) <= 2, "except points on a line of the grid by rounding"


@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
@settings(max_examples=30, deadline=None)
def test_the_kernel_finds_the_same_obstacles_as_plain_python(seed: int, support: int) -> None:
    rng, shape = np.random.default_rng(seed), (12, 6)
    away, nothing = rng.uniform(0.5, 1.2, shape), np.full(shape, np.nan)
    bearings = rng.uniform(-0.5, 0.5, shape).astype(np.float32)
    kind = np.where(rng.random(shape) < 0.4, STANDS, 0).astype(np.uint8)
    found = find_stretches(
        kind, away, np.full(shape, 0.5), np.zeros(shape), nothing, bearings, 0.95, 0.02, 1.1, 1.4, support, 0.06, 0.12
    )
    bins: dict[tuple[int, int], list[float]] = {}
    for row, column in np.argwhere((kind == STANDS) & (away < 1.1)).tolist():
        bins.setdefault((column, int(away[row, column] / 0.05)), []).append(float(away[row, column]))
    expected = [
        sum(bins[column, place]) / len(bins[column, place])
        for column, place in sorted(bins)
        if sum(len(bins.get((column + i, place + j), [])) for i in (-1, 0, 1) for j in (-1, 0, 1)) >= support
    ]
    np.testing.assert_allclose(found.far[: found.used], expected, rtol=1e-6)
    assert set(found.kinds[: found.used].tolist()) <= {OBSTACLE}
