"""Depth from a stereo pair: two rectified pictures of the same stamp become one frame with depth.

Matching is OpenCV's semi-global block matching (Hirschmueller, PAMI 2008); depth is focal length times baseline over
disparity. Pairs come from `message_sets.ExactSets`.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from waychair.config import Settings, setting
from waychair.errors import SensorError
from waychair.types import Bytes, Float32Array, FloatArray, RgbdFrame

_UNITS = 16.0
"""OpenCV gives disparities in sixteenths of a pixel."""


@dataclass(frozen=True, slots=True)
class CameraImage:
    """One rectified picture (H, W, 3) or (H, W) u8."""

    stamp_ns: int
    image: Bytes


@dataclass(frozen=True, slots=True)
class StereoSettings(Settings):
    """What the matcher looks for. The penalties are per pixel of a block, as OpenCV's manual proposes them."""

    depth_min: float = setting(0.4, "m", "nearer things are not searched for", low=0.05, high=10.0)
    depth_max: float = setting(8.0, "m", "farther depths are dropped", low=0.1, high=200.0)
    block: int = setting(5, "pixels", "side of a block, odd", low=1, high=21)
    small_penalty: float = setting(8.0, "", "of a disparity that changes by one", low=1.0, high=1000.0)
    large_penalty: float = setting(32.0, "", "of one that changes by more", low=1.0, high=10_000.0)
    uniqueness: int = setting(10, "%", "by which the best must be better than the others", low=0, high=50)
    left_right: int = setting(1, "pixels", "most that both ways round may differ by", low=0, high=10)
    speckle: int = setting(100, "pixels", "smaller patches are dropped", low=0, high=10_000)


def rgbd_from_stereo(
    left: CameraImage,
    right: CameraImage,
    camera_matrix: FloatArray,
    baseline: float,
    settings: StereoSettings | None = None,
) -> RgbdFrame:
    """The left picture with its depth (H, W) f32 [m], nan where the matcher finds none.

    `camera_matrix` (3, 3) [pixels] is that of both rectified pictures, `baseline` [m] how far the right camera is to the
    right of the left one.

    Raises:
        SensorError: stamps or sizes differ, or the baseline is not positive.
    """
    s = settings or StereoSettings()
    if left.stamp_ns != right.stamp_ns:
        apart = abs(left.stamp_ns - right.stamp_ns) * 1e-6
        raise SensorError(f"the stereo pictures are {apart:.3f} ms apart: synchronise them exactly first")
    if left.image.shape != right.image.shape:
        raise SensorError(
            f"the stereo pictures are of {left.image.shape} and {right.image.shape}: set both cameras alike"
        )
    if not baseline > 0.0:
        raise SensorError(
            f"a stereo baseline of {baseline:g} m is impossible: give the right camera's distance in metres"
        )
    scale = float(camera_matrix[0, 0]) * baseline
    disparity = _disparity(_grey(left.image), _grey(right.image), scale / s.depth_min, s)
    depth = np.full(disparity.shape, np.nan, np.float32)
    found = disparity >= max(scale / s.depth_max, 1.0 / _UNITS)
    found &= np.arange(disparity.shape[1]) >= disparity  # what the right camera does not see is guesswork
    depth[found] = np.float32(scale) / disparity[found]
    return RgbdFrame(left.stamp_ns, left.image, depth, camera_matrix)


def _grey(image: Bytes) -> Bytes:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8) if image.ndim == 3 else image


def _disparity(left: Bytes, right: Bytes, largest: float, s: StereoSettings) -> Float32Array:
    """(H, W) [pixels] from 0 to about `largest`, negative where there is none.

    The matcher leaves out a margin on the left as wide as the largest disparity, although the right camera sees most of
    it: so the pictures are extended there.
    """
    count = 16 * max(1, int(np.ceil(largest / 16.0)))
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=count,
        blockSize=s.block,
        P1=round(s.small_penalty * s.block**2),
        P2=round(s.large_penalty * s.block**2),
        disp12MaxDiff=s.left_right,
        uniquenessRatio=s.uniqueness,
        speckleWindowSize=s.speckle,
        speckleRange=1,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    wide = [cv2.copyMakeBorder(image, 0, 0, count, 0, cv2.BORDER_REPLICATE) for image in (left, right)]
    return matcher.compute(*wide)[:, count:].astype(np.float32) / np.float32(_UNITS)
