"""What one depth image tells of the floor plan: where the ground was seen, where something stands or hangs, where it ends.

The image is levelled by the chair's roll and pitch and read for the ground (`ground.py`). What is told is kept as
stretches along the beams, a few hundred to an image: as exact as the image wherever the graph may put the chair later,
and a hundredth of its size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.calibration.chair import TALLEST
from waychair.config import Settings, setting
from waychair.maps.ground import BELOW, GROUND, MISSING, STANDS, GroundSettings, ground_view
from waychair.types import BoolArray, Bytes, Float32Array, FloatArray, IntArray, Pose3, RgbdFrame, Scan

FLOOR, OBSTACLE, DROP_OFF = 1, 2, 3
"""What a stretch tells of the cells along it; where an image tells two things of one cell, the greater counts."""

_BIN = 0.05  # [m] along a beam's way over ground, within which points stand on one place
_ROUGH = 0.01  # the lean is known so well [rad]


@dataclass(frozen=True, slots=True)
class DepthSettings(Settings):
    """Which beams of a depth image tell of the floor plan, and how much is kept."""

    step: int = setting(4, "pixels", "every so many columns and rows a beam is taken", low=1, high=32)
    range_max: float = setting(4.5, "m", "over ground; depth farther away is too rough", low=0.5, high=20.0)
    tallest: float = setting(TALLEST, "m", "what hangs higher does not concern the chair", low=0.2, high=3.0)
    support: int = setting(3, "beams", "that must meet something on one place for it to be there", low=1, high=100)
    least_share: float = setting(0.05, "", "with fewer beams that come back the camera is blind", low=0.0, high=1.0)
    near: float = setting(0.4, "m", "with half of all depths nearer, something covers the camera", low=0.0, high=5.0)
    ground: GroundSettings = field(default_factory=GroundSettings)


@dataclass(frozen=True, slots=True)
class DepthScan:
    """Stretches (R,) over ground from the lens at `origin` (2,) [m]: in the base's axes, those of the level floor plan.

    Stretch i lies on the bearing `bearings[i]` [rad] from `near[i]` to `far[i]` [m] and is of `kinds[i]`.
    """

    stamp_ns: int
    origin: FloatArray
    bearings: Float32Array
    near: Float32Array
    far: Float32Array
    kinds: Bytes

    def __len__(self) -> int:
        return len(self.kinds)


def scan_of(told: DepthScan, step: float = 0.01) -> Scan:
    """What a planar lidar at the lens would have met of the nearest obstacles of all heights, a beam every `step` [rad].

    It stands in for a lidar where there is none. Its frame is that of the base, moved to the lens.
    """
    low, high = float(told.bearings.min(initial=0.0)), float(told.bearings.max(initial=0.0))
    ranges = np.full(round((high - low) / step) + 1, np.inf, np.float32)
    stands = told.kinds == OBSTACLE
    beams = np.rint((told.bearings[stands] - low) / step).astype(np.int64)
    np.minimum.at(ranges, beams, told.far[stands])
    return Scan(told.stamp_ns, ranges, low, step, range_max=100.0)


class Stretches(NamedTuple):
    """Bearings, near and far ends and kinds of stretches, and how many there are; what comes after is unused."""

    bearings: Float32Array
    near: Float32Array
    far: Float32Array
    kinds: Bytes
    used: int


def frame_problem(frame: RgbdFrame, settings: DepthSettings) -> str | None:
    """Why a picture tells nothing of the floor plan; None when it does."""
    depth, camera = frame.depth, frame.camera_matrix
    if depth.ndim != 2 or depth.size == 0:
        return "pictures have no depth image"
    if camera.shape != (3, 3) or not np.isfinite(camera).all() or min(camera[0, 0], camera[1, 1]) <= 0.0:
        return "pictures have no usable camera matrix"
    few = depth[:: settings.step, :: settings.step]
    seen = few[np.isfinite(few) & (few > 0.0)]
    if not len(seen):
        return "pictures hold no depth at all"
    if len(seen) < settings.least_share * few.size:
        return "pictures hold hardly any depth"
    if float(np.median(seen)) < settings.near:
        return "pictures show something right before the camera, as if it were covered"
    return None


def levelled_mount(base_from_camera: Pose3, level_from_base: FloatArray) -> Pose3:
    """The mount in level axes, through the base's origin: `level_from_base` (3, 3) is the chair's lean."""
    return Pose3(level_from_base @ base_from_camera.rotation, level_from_base @ base_from_camera.translation)


def depth_scan(
    frame: RgbdFrame, base_from_camera: Pose3, level_from_base: FloatArray, front: float, settings: DepthSettings
) -> DepthScan:
    """The stretches of a picture for which `frame_problem` knows none.

    Args:
        frame: its depth in metres, nan where there is none.
        base_from_camera: mount of the optical frame (z forward, x right, y down).
        level_from_base: (3, 3) the chair's lean.
        front: reach of the chair ahead of its axle [m]; the ground under it is known to be there.
        settings: which beams count.
    """
    level_from_camera = levelled_mount(base_from_camera, level_from_base)
    view = ground_view(frame, level_from_camera, front, settings.ground, settings.step)
    up = level_from_base[:, 2]
    own = -(view.ends[..., 0] * up[0] + view.ends[..., 1] * up[1]) / up[2]  # height of what the chair stands on
    bearings = np.arctan2(view.directions[..., 1], view.directions[..., 0]).astype(np.float32)
    away = np.hypot(view.ends[..., 0] - view.lens[0], view.ends[..., 1] - view.lens[1])
    found = stretches_of(
        view.kind, away, view.ends[..., 2], own, view.foot, bearings, float(view.lens[2]), 2.0 * view.half_angle,
        settings.range_max, settings.tallest, settings.support, settings.ground.least, settings.ground.slope,
    )  # fmt: skip
    used = slice(found.used)
    return DepthScan(
        frame.stamp_ns,
        view.lens[:2].copy(),
        found.bearings[used].copy(),
        found.near[used].copy(),
        found.far[used].copy(),
        found.kinds[used].copy(),
    )


@njit(cache=True, nogil=True)
def stretches_of(
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
    """The stretches of beams (H, W), from the bottom row up, whose ends are `away` over ground [m] and `z` high [m].

    `kind` and `foot` are a `GroundView`'s; beams are `beam` [rad] apart. Ground between two beams of a column that
    met it is ground, as is a drop-off between two that tell of one, unless what lies between is not seen. Something
    stands where `support` beams of a column and its neighbours meet it within a bin and those beside it.

    A column whose first ground is neither level with the wheels nor on the plane that the chair stands on, `own` (H, W)
    high, may have begun on a stair: it tells only of what no ramp of `slope` could be.
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
        going, deep = 0, False  # kind of the last stretch, which may go on; whether beams went below the floor
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
            elif told == BELOW:  # the floor behind what is low enough to be taken for a ramp
                going = 0
            if what == 0 or not where < range_max:  # nan: beyond the reach within which ground is missed
                continue
            # twice as far as to where the next beam of the column meets level ground
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
    """Of each column (W,) the row from which it is doubtful, H for none, and whether its first ground is level."""
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
    """Add to `count` stretches one for each bin of a column that enough beams which `stands` (H, W) names end in."""
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
def cells_of(
    x: float,
    y: float,
    theta: float,
    bearings: Float32Array,
    near: Float32Array,
    far: Float32Array,
    kinds: Bytes,
    resolution: float,
) -> tuple[IntArray, Bytes]:
    """Columns and rows (K, 2), from x = y = 0, of the cells that stretches touch from a lens at a pose, and their kinds."""
    reach = resolution  # more than rounding takes
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


def told_of(cells: IntArray, what: Bytes, kind: int) -> tuple[IntArray, BoolArray]:
    """The cells (K, 2) that are told to be of a kind or to be floor, and which of them are of the kind."""
    tells = (what == kind) | (what == FLOOR)
    return cells[tells], what[tells] == kind
