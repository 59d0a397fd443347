"""Doubts about the scale of depth pictures and about the camera of a folder, from a sample of its pictures.

Neither is stated by the pictures themselves. A wrong scale makes everything larger or smaller, and a camera of another
picture size bends it; both give a map that looks right.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from waychair.types import FloatArray

SAMPLE = 6
"""Depth pictures that are looked at, evenly spread over the recording."""

SCALES = (1000.0, 5000.0, 10000.0, 256.0, 100.0, 4000.0)
"""Units of depth in a metre that are in use: RealSense, Azure and Orbbec recorders; TUM; finer RealSense; KITTI; others."""

_NEAR, _MIDDLE, _FAR = 0.05, 0.5, 0.95  # quantiles of the depth
_LEAST = (0.25, 0.5, 0.75)  # m; a hand-held depth camera, which sees from 0.3 m on, sees farther at these quantiles
_MOST = (3.0, 8.0, 20.0)  # m; beyond 8 m depth cameras see next to nothing
_TYPICAL = 1.8  # m; middle depth of rooms; only the order of scales by likelihood hangs on it
_OFF_CENTRE = 0.12  # of the picture's width or height; lenses are off by 0.05 at most


class DepthSample(NamedTuple):
    """Quantiles (near, middle, far) of the units in the sampled depth pictures, and the size (width, height) [px].

    `metres`: the pictures hold floats, which are metres and need no scale.
    """

    units: tuple[float, float, float]
    size: tuple[int, int]
    metres: bool = False


def sampled(pictures: Sequence[Any]) -> DepthSample | None:
    """Return the sample of decoded depth pictures (H, W) in units, 0 or 65535 for none; None without any depth."""
    values = [picture[(picture > 0) & (picture != 65535)] for picture in pictures]
    units = np.concatenate([each.ravel()[::17] for each in values]) if values else np.zeros(0)
    units = units[np.isfinite(units)]
    if len(units) == 0:
        return None
    near, middle, far = np.quantile(units.astype(np.float64), (_NEAR, _MIDDLE, _FAR)).tolist()
    height, width = pictures[0].shape
    return DepthSample((near, middle, far), (width, height), pictures[0].dtype.kind == "f")


def doubt_about_scale(sample: DepthSample, scale: float) -> str:
    """Return a warning where a room would be unlikely near or far by this scale; an empty text otherwise."""
    if _likely(sample, scale):
        return ""
    middle = sample.units[1]
    others = sorted(
        (each for each in SCALES if _likely(sample, each)), key=lambda each: abs(np.log(middle / each / _TYPICAL))
    )
    better = f" ({others[0]:g} would make it {middle / others[0]:.2f} m)" if others else ""
    return (
        f"the middle depth is {middle / scale:.2f} m at {scale:g} units to a metre, which is unlikely: if the scale is "
        f"wrong, so are all distances, by one factor; give the right one with --depth-scale{better}"
    )


def doubt_about_centre(size: tuple[int, int], matrix: FloatArray) -> str:
    """Return a warning where the camera's centre lies far from the middle of the pictures; an empty text otherwise."""
    (width, height), (cx, cy) = size, (float(matrix[0, 2]), float(matrix[1, 2]))
    if abs(cx - width / 2) <= _OFF_CENTRE * width and abs(cy - height / 2) <= _OFF_CENTRE * height:
        return ""
    factor = width / (2 * cx) if cx > 0 else 1.0
    fx, fy = float(matrix[0, 0]) * factor, float(matrix[1, 1]) * factor
    return (
        f"the camera's centre ({cx:g}, {cy:g}) is far from the middle of the pictures of {width} x {height} pixels: it is "
        f"that of another picture size; for this size it may be --camera {fx:.1f},{fy:.1f},{cx * factor:.1f},{cy * factor:.1f}"
    )


def scaled_matrix(matrix: FloatArray, factor: float) -> FloatArray:
    """Return the camera matrix for pictures that are `factor` times as large; pixel centres are at whole numbers."""
    scaled = matrix.copy()
    scaled[:2] *= factor
    scaled[:2, 2] += 0.5 * (factor - 1.0)
    return scaled


def _likely(sample: DepthSample, scale: float) -> bool:
    return all(low <= units / scale <= high for units, low, high in zip(sample.units, _LEAST, _MOST, strict=True))
