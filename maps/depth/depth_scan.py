"""The floor plan seen by one depth image: floor, obstacles that stand or hang, and drop-offs.

The image is levelled by the chair's roll and pitch and searched for the ground (`ground.py`). The result is a few
hundred stretches along the beams. They are as exact as the image at any pose that the graph later gives the chair, and
take a hundredth of its memory.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.calibration.chair_body import TALLEST
from waychair.config import Settings, setting
from waychair.maps.depth.ground import BELOW, GROUND, LARGEST_STEP, MISSING, STANDS, STEEPEST_SLOPE, ground_view
from waychair.types import BoolArray, Bytes, Float32Array, FloatArray, IntArray, Pose3, RgbdFrame, Scan

FLOOR, OBSTACLE, DROP_OFF = 1, 2, 3
"""Kinds of stretches. Where an image gives one cell two kinds, the greater number counts."""

_BIN = 0.05  # [m] of distance over ground; points in one bin of a column stand on one spot
_ROUGH = 0.01  # [rad] uncertainty of roll and pitch


@dataclass(frozen=True, slots=True)
class DepthSettings(Settings):
    """The beams of a depth image that are used."""

    step: int = setting(
        4, "pixels",
        "columns and rows of a depth image from one used pixel to the next; more: it is faster and coarser",
        low=1, high=32,
    )  # fmt: skip
    range_max: float = setting(
        4.5,
        "m",
        "farthest depth over ground that is used; larger: the camera sees farther, with rougher obstacles",
        low=0.5,
        high=20.0,
    )


_SUPPORT = 3  # beams that must meet an obstacle on one spot for it to count
_LEAST_SHARE = 0.05  # least share of pixels with depth; with fewer the camera is blind
_COVERED = 0.4  # [m] a median depth below this: something covers the camera


@dataclass(frozen=True, slots=True)
class DepthScan:
    """Stretches (R,) of floor, obstacle or drop-off, in the level base frame, seen from the lens at `origin` (2,) [m].

    Stretch i of kind `kinds[i]` lies on bearing `bearings[i]` [rad] from `near[i]` to `far[i]` [m] over ground.
    """

    stamp_ns: int
    origin: FloatArray
    bearings: Float32Array
    near: Float32Array
    far: Float32Array
    kinds: Bytes

    def __len__(self) -> int:
        return len(self.kinds)


def planar_scan(seen: DepthScan, step: float = 0.01) -> Scan:
    """Return a planar scan of the nearest obstacles of all heights, as seen from the lens, a beam every `step` [rad].

    It replaces a lidar on a chair without one. Its frame is the base frame moved to the lens.
    """
    low, high = float(seen.bearings.min(initial=0.0)), float(seen.bearings.max(initial=0.0))
    ranges = np.full(round((high - low) / step) + 1, np.inf, np.float32)
    stands = seen.kinds == OBSTACLE
    beams = np.rint((seen.bearings[stands] - low) / step).astype(np.int64)
    np.minimum.at(ranges, beams, seen.far[stands])
    return Scan(seen.stamp_ns, ranges, low, step, range_max=100.0)


class Stretches(NamedTuple):
    """Bearings, near and far ends and kinds of stretches; only the first `used` entries are valid."""

    bearings: Float32Array
    near: Float32Array
    far: Float32Array
    kinds: Bytes
    used: int


def frame_problem(frame: RgbdFrame, settings: DepthSettings) -> str | None:
    """Return why a picture cannot be used for the floor plan, or None when it can."""
    depth, camera = frame.depth, frame.camera_matrix
    if depth.ndim != 2 or depth.size == 0:
        return "pictures have no depth image"
    if camera.shape != (3, 3) or not np.isfinite(camera).all() or min(camera[0, 0], camera[1, 1]) <= 0.0:
        return "pictures have no usable camera matrix"
    few = depth[:: settings.step, :: settings.step]
    seen = few[np.isfinite(few) & (few > 0.0)]
    if not len(seen):
        return "pictures hold no depth at all"
    if len(seen) < _LEAST_SHARE * few.size:
        return "pictures hold hardly any depth"
    if float(np.median(seen)) < _COVERED:
        return "pictures show something right before the camera, as if it were covered"
    return None


def levelled_mount(base_from_camera: Pose3, level_from_base: FloatArray) -> Pose3:
    """Return the mount in level axes about the base's origin, for the chair's roll and pitch as a rotation (3, 3)."""
    return Pose3(level_from_base @ base_from_camera.rotation, level_from_base @ base_from_camera.translation)


def depth_scan(
    frame: RgbdFrame, base_from_camera: Pose3, level_from_base: FloatArray, front: float, settings: DepthSettings
) -> DepthScan:
    """Return the stretches of a picture for which `frame_problem` returns None.

    Args:
        frame: its depth in metres, nan where there is none.
        base_from_camera: mount of the optical frame (z forward, x right, y down).
        level_from_base: (3, 3) rotation by the chair's roll and pitch.
        front: reach of the chair ahead of its axle [m]; the ground under it is known to be there.
        settings: the beams that count.
    """
    level_from_camera = levelled_mount(base_from_camera, level_from_base)
    view = ground_view(frame, level_from_camera, front, settings.step)
    up = level_from_base[:, 2]
    own = -(view.ends[..., 0] * up[0] + view.ends[..., 1] * up[1]) / up[2]  # height of the chair's plane
    bearings = np.arctan2(view.directions[..., 1], view.directions[..., 0]).astype(np.float32)
    away = np.hypot(view.ends[..., 0] - view.lens[0], view.ends[..., 1] - view.lens[1])
    found = find_stretches(
        kind=view.kind, away=away, z=view.ends[..., 2], own=own, foot=view.foot, bearings=bearings,
        lens_z=float(view.lens[2]), beam=2.0 * view.half_angle, range_max=settings.range_max, tallest=TALLEST,
        support=_SUPPORT, least=LARGEST_STEP,
        slope=STEEPEST_SLOPE,
    )  # fmt: skip
    used = slice(found.used)
    return DepthScan(
        stamp_ns=frame.stamp_ns,
        origin=view.lens[:2].copy(),
        bearings=found.bearings[used].copy(),
        near=found.near[used].copy(),
        far=found.far[used].copy(),
        kinds=found.kinds[used].copy(),
    )


@njit(cache=True, nogil=True)
def find_stretches(
    kind: Bytes,
    away: FloatArray,
    z: FloatArray,
    own: FloatArray,
    foot: FloatArray,
    bearings: Float32Array,
    lens_z: float,
    beam: float,
    range_max: float,
    tallest: float,
    support: int,
    least: float,
    slope: float,
) -> Stretches:
    """Return the stretches of beams (H, W), bottom row first.

    Beams end `away` (H, W) [m] over ground from the lens, at heights `z` (H, W) [m].
    `kind` and `foot` are those of a `GroundView`; beams are `beam` [rad] apart. A stretch of floor or drop-off joins
    consecutive beams of a column that tell the same, unless the gap between them is unseen. An obstacle needs `support`
    beams of a column and its neighbours within one bin and the bins beside it.

    A column may begin on a stair: its first ground is then neither level with the wheels nor on the plane under the
    chair, whose height is `own` (H, W) [m]. In such a column only points above every ramp of `slope` are obstacles.
    """
    height, width = kind.shape
    room = 2 * height * width
    found = Stretches(
        np.empty(room, np.float32), np.empty(room, np.float32), np.empty(room, np.float32), np.empty(room, np.uint8), 0
    )
    out_bearings, near, far, kinds = found.bearings, found.near, found.far, found.kinds
    doubtful_from, on_level = _doubtful(kind, away, z, own, least)
    stands = np.zeros((height, width), np.bool_)
    count = 0
    for column in range(width):
        going, deep = 0, False  # kind of the last stretch, which may go on; whether beams have gone below the floor
        for row in range(height):
            what, told, where = 0, kind[row, column], away[row, column]
            if told == STANDS:
                ramp = slope * where + least if row >= doubtful_from[column] else 0.0
                if ramp < z[row, column] <= tallest:
                    stands[row, column], going = True, 0
                continue
            if row >= doubtful_from[column]:
                continue
            if told == BELOW:
                plane = 0.0 if on_level[column] else min(own[row, column], 0.0)
                deep = deep or z[row, column] < plane - least - _ROUGH * where
            if told == GROUND:
                what, deep = FLOOR, False
            elif told == MISSING or (told == BELOW and deep):
                what, where = DROP_OFF, foot[row, column]
            elif told == BELOW:  # the floor behind something low enough to pass for a ramp
                going = 0
            if what == 0 or not where < range_max:  # nan: beyond the reach within which missing ground counts
                continue
            # twice the distance to the point where the next beam of the column meets level ground
            gap = max(0.1, 2.0 * where * where * beam / lens_z)
            joins = going == what and far[count - 1] - 0.02 <= where <= far[count - 1] + gap
            if joins and abs(bearings[row, column] - out_bearings[count - 1]) < 0.5 * beam:
                far[count - 1] = max(where, far[count - 1])
            else:
                near[count] = min(where, far[count - 1]) if joins else where
                out_bearings[count], far[count], kinds[count] = bearings[row, column], where, what
                count += 1
            going = what
    count = _put_obstacles(found, count, stands, away, bearings, range_max, support)
    return Stretches(out_bearings, near, far, kinds, count)


@njit(cache=True, nogil=True)
def _doubtful(
    kind: Bytes, away: FloatArray, z: FloatArray, own: FloatArray, least: float
) -> tuple[IntArray, BoolArray]:
    """Return for each column (W,) the row from which it is doubtful (H: none), and if its first ground is level."""
    height, width = kind.shape
    doubtful_from, on_level = np.full(width, height), np.ones(width, np.bool_)
    for column in range(width):
        for row in range(height):
            if kind[row, column] == GROUND:
                rough, here, there = 0.5 * least + _ROUGH * away[row, column], z[row, column], own[row, column]
                if here < min(there, 0.0) - rough or here > max(there, 0.0) + rough:
                    doubtful_from[column] = row
                on_level[column] = abs(here) <= abs(here - there)
                break
    return doubtful_from, on_level


@njit(cache=True, nogil=True)
def _put_obstacles(
    found: Stretches,
    count: int,
    stands: BoolArray,
    away: FloatArray,
    bearings: Float32Array,
    range_max: float,
    support: int,
) -> int:
    """Append an obstacle for each bin of a column where enough beams of `stands` (H, W) end; return the new count."""
    height, width = stands.shape
    bins = math.ceil(range_max / _BIN) + 1
    counts = np.zeros((width, bins), np.int32)
    sums, first = np.zeros((width, bins)), np.zeros((width, bins), np.float32)
    for column in range(width):
        for row in range(height):
            if stands[row, column] and away[row, column] < range_max:
                place = int(away[row, column] / _BIN)
                if counts[column, place] == 0:
                    first[column, place] = bearings[row, column]
                counts[column, place] += 1
                sums[column, place] += away[row, column]
    for column in range(width):
        for place in range(bins):
            if counts[column, place] == 0:
                continue
            beside = 0
            for other in range(max(column - 1, 0), min(column + 2, width)):
                for near_by in range(max(place - 1, 0), min(place + 2, bins)):
                    beside += counts[other, near_by]
            if beside >= support:
                found.near[count] = found.far[count] = sums[column, place] / counts[column, place]
                found.bearings[count], found.kinds[count] = first[column, place], OBSTACLE
                count += 1
    return count


@njit(cache=True, nogil=True)
def stretch_cells(
    x: float,
    y: float,
    theta: float,
    bearings: Float32Array,
    near: Float32Array,
    far: Float32Array,
    kinds: Bytes,
    resolution: float,
) -> tuple[IntArray, Bytes]:
    """Return the cells (K, 2), column and row from x = y = 0, that the stretches from a lens touch, and their kinds."""
    reach = resolution  # covers rounding
    for i in range(len(far)):
        reach = max(reach, far[i] + resolution)
    low_col, low_row = math.floor((x - reach) / resolution), math.floor((y - reach) / resolution)
    width = math.floor((x + reach) / resolution) - low_col + 1
    height = math.floor((y + reach) / resolution) - low_row + 1
    marks = np.zeros((height, width), np.uint8)
    told = 0
    for i in range(len(kinds)):
        c, s = math.cos(theta + bearings[i]), math.sin(theta + bearings[i])
        steps = math.ceil((far[i] - near[i]) / (0.5 * resolution))
        for k in range(steps + 1):
            d = near[i] + (far[i] - near[i]) * (k / steps if steps > 0 else 0.0)
            col = math.floor((x + d * c) / resolution) - low_col
            row = math.floor((y + d * s) / resolution) - low_row
            told += marks[row, col] == 0
            marks[row, col] = max(marks[row, col], kinds[i])
    cells, what = np.empty((told, 2), np.int64), np.empty(told, np.uint8)
    count = 0
    for row in range(height):
        for col in range(width):
            if marks[row, col] != 0:
                cells[count, 0], cells[count, 1] = low_col + col, low_row + row
                what[count] = marks[row, col]
                count += 1
    return cells, what


def cells_of_kind(cells: IntArray, what: Bytes, kind: int) -> tuple[IntArray, BoolArray]:
    """Return the cells (K, 2) of a kind or of floor, and which of them are of the kind."""
    tells = (what == kind) | (what == FLOOR)
    return cells[tells], what[tells] == kind
