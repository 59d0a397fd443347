"""The ground in a depth image: where it continues, where an obstacle stands on it, where it drops off or is missing.

The ground is followed up each column of the image, from the footrest outwards. It may rise and fall as ramps do; points
above the cone of such slopes are obstacles, points below it lie beyond a drop-off. So the foot of a ramp is no obstacle
and its top no drop-off, however the chair leans.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.types import BoolArray, Bytes, Float32Array, FloatArray, Pose3, RgbdFrame

NOTHING, GROUND, STANDS, BELOW, MISSING = range(5)
"""Kinds of beams: no information; the beam met ground, an obstacle, or a point below the ground; ground is missing."""


LARGEST_STEP = 0.06
"""The largest step [m], up or down, that still counts as ground."""

STEEPEST_SLOPE = 0.12
"""The steepest slope [1] against the plane under the chair that still counts as ground (a ramp of 1:12, and noise)."""

FARTHEST_GROUND = 3.5
"""Farther from the camera [m], beams are too flat to tell ground from a drop-off."""

LEAST_MISSING = 0.3
"""The least unseen stretch of ground [m], across and along, that counts as missing."""


@dataclass(frozen=True, slots=True)
class GroundView:
    """Beams (H, W) of a picture, bottom row first: the `kind` of each, and its end (H, W, 3) [m] in base.

    `foot` (H, W) [m] is the distance over ground from the camera at which a beam meets the plane of the last ground
    below it in its column, nan where that means nothing. `rim` (H, W): the beam met the last ground before a drop-off.
    `directions` (H, W, 2) are unit vectors over ground; `lens` (3,) [m] is in base; `half_angle` [rad] is a beam's.
    """

    stamp_ns: int
    kind: Bytes
    ends: FloatArray
    foot: FloatArray
    rim: BoolArray
    directions: FloatArray
    lens: FloatArray
    half_angle: float


def ground_view(frame: RgbdFrame, base_from_camera: Pose3, front: float, step: int = 4) -> GroundView:
    """Return the ground in every `step`-th pixel of a depth image, for a chair that reaches `front` [m] ahead.

    `base_from_camera` is the mount of the optical frame (z forward, x right, y down). If it is levelled by the chair's
    roll and pitch, the result is level too.
    """
    depth = np.ascontiguousarray(frame.depth[::step, ::step][::-1], np.float32)
    height, width = depth.shape
    pixels = np.ones((height, width, 3))
    pixels[..., 0], pixels[..., 1] = step * np.arange(width), step * np.arange(height)[::-1, None]
    rays: FloatArray = pixels @ (base_from_camera.rotation @ np.linalg.inv(frame.camera_matrix)).T
    lens = base_from_camera.translation
    ends, directions, away, falls = _beams(depth, rays, lens)
    begin = max(front - float(lens[0]), 0.0)
    kind, foot, rim = follow_ground(
        away, ends[..., 2], falls, lens_z=float(lens[2]), begin=begin, least=LARGEST_STEP, slope=STEEPEST_SLOPE,
        reach=FARTHEST_GROUND, missing=LEAST_MISSING,
    )  # fmt: skip
    _keep_wide(kind, foot, LEAST_MISSING, step / float(frame.camera_matrix[0, 0]))
    half_angle = step / (2 * float(frame.camera_matrix[0, 0]))
    return GroundView(
        stamp_ns=frame.stamp_ns,
        kind=kind,
        ends=ends,
        foot=foot,
        rim=rim,
        directions=directions,
        lens=lens,
        half_angle=half_angle,
    )


@njit(cache=True, nogil=True)
def _beams(
    depth: Float32Array, rays: FloatArray, lens: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return `ends` and `directions` of a `GroundView`, and `away` and `falls` for `follow_ground`.

    `depth` (H, W) [m] is measured along `rays` (H, W, 3), of length 1 along the camera's axis, from the lens (3,).
    """
    height, width = depth.shape
    ends, directions = np.empty((height, width, 3)), np.empty((height, width, 2))
    away, falls = np.empty((height, width)), np.empty((height, width))
    for row in range(height):
        for column in range(width):
            x, y, z = rays[row, column, 0], rays[row, column, 1], rays[row, column, 2]
            far = float(depth[row, column])
            if not (far > 0.0 and far < np.inf):
                far = np.nan
            flat = math.hypot(x, y)
            ends[row, column, 0] = lens[0] + far * x
            ends[row, column, 1] = lens[1] + far * y
            ends[row, column, 2] = lens[2] + far * z
            directions[row, column, 0], directions[row, column, 1] = x / flat, y / flat
            away[row, column], falls[row, column] = flat * far, -z / flat
    return ends, directions, away, falls


def _keep_wide(kind: Bytes, foot: FloatArray, width: float, beam: float) -> None:
    """Clear missing ground that is narrower than `width` [m]; beams are `beam` [rad] apart."""
    missing = kind == MISSING
    if not missing.any():
        return
    import cv2  # here, since settings of depth are read without pictures, too

    across = max(3, round(width / (beam * float(np.median(foot[missing])))))
    kernel = np.ones((1, min(across, kind.shape[1])), np.uint8)
    # close speckles before opening removes narrow parts
    filled = cv2.morphologyEx(missing.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    wide = cv2.morphologyEx(filled, cv2.MORPH_OPEN, kernel).astype(np.bool_)
    kind[missing & ~wide] = NOTHING


_ROUGH = 0.012
"""Heights of consecutive beams differ by this much [m] through depth noise."""


@njit(cache=True, nogil=True)
def follow_ground(
    away: FloatArray,
    z: FloatArray,
    falls: FloatArray,
    lens_z: float,
    begin: float,
    least: float,
    slope: float,
    reach: float,
    missing: float,
) -> tuple[Bytes, FloatArray, BoolArray]:
    """Return `kind`, `foot` and `rim` of a `GroundView` for beams that end `away` over ground at height `z` (H, W) [m].

    nan: a beam without depth. `falls` (H, W) is a beam's drop [m] per metre over ground, from `lens_z` [m]. The ground
    is level and at height 0 up to `begin` [m] from the camera; beams that meet it beyond `reach` [m] do not count.
    """
    height, width = away.shape
    kind = np.zeros((height, width), np.uint8)
    foot = np.full((height, width), np.nan)
    rim = np.zeros((height, width), np.bool_)
    for column in range(width):
        last, level, high, low = begin, 0.0, 0.0, 0.0  # of the ground followed so far
        last_row, lost, hidden = -1, False, np.inf
        before, before_z, first_missing = begin, 0.0, -1
        for row in range(height):
            fall = falls[row, column]
            meets = (lens_z - level) / fall if fall > 0.0 else np.inf
            d, here = away[row, column], z[row, column]
            if np.isnan(d):
                if max(meets, last) < min(reach, hidden):
                    foot[row, column] = max(meets, last)
                    first_missing = row if first_missing < 0 else first_missing
                continue
            further = max(d - last, 0.0)
            upper = high + slope * further
            lower = low if lost else low - slope * further  # beyond a drop-off: the ground's last height
            # the far wall of a pit is no ground below its top
            rises = lost and here < level + least and here - before_z > slope * max(d - before, 0.0) + _ROUGH
            before, before_z = d, here
            if here > upper + least:
                kind[row, column] = STANDS
                hidden = min(hidden, d)
                where = d
            elif here < lower - least or rises:
                where = max(meets, last)
                if where < reach:
                    kind[row, column] = BELOW
                    foot[row, column] = where
                    if not lost and last_row >= 0:
                        rim[last_row, column] = True
                    lost = True
            else:
                where = d
                kind[row, column] = GROUND
                if d < reach:
                    foot[row, column] = d
                low = max(low - slope * further, here)  # also over a drop-off, now that the ground goes on
                last, level, high = max(d, last), here, min(upper, here)
                last_row, lost = row, False
            if first_missing >= 0:
                _mark_missing(kind, column, first_missing, row, foot, min(where, reach), missing)
                first_missing = -1
        if first_missing >= 0:
            _mark_missing(kind, column, first_missing, height, foot, min(hidden, reach), missing)
    return kind, foot, rim


@njit(cache=True, nogil=True)
def _mark_missing(
    kind: Bytes, column: int, first: int, after: int, foot: FloatArray, until: float, missing: float
) -> None:
    """Mark beams without depth as missing ground if they span at least `missing` [m]."""
    if until - foot[first, column] < missing:
        return
    for row in range(first, after):
        if not np.isnan(foot[row, column]) and kind[row, column] == NOTHING:
            kind[row, column] = MISSING
