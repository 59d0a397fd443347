"""Features of an image: keypoints, their descriptors and, where depth is known, their points in space.

Three detectors: `gftt_orb` (corners by minimum eigenvalue, Shi and Tomasi 1994, with ORB's binary descriptor, Rublee et
al. 2011; RTAB-Map's default without OpenCV's contributed modules), `orb` (oriented FAST corners on an image pyramid)
and `sift` (Lowe 2004). The wheelchair paper names SURF (Pai et al. 2026, section 3.2), which OpenCV 5 lacks: it is
refused by name, and `sift` is the closest alternative.

A blank image (black, overexposed, a bare wall) has no features: every detector has an absolute threshold. A threshold
relative to the strongest corner alone finds more than 400 corners in the noise of a bare wall, and two bare walls then
count as one place (measured on RTAB-Map's sample photographs).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.config import Settings, setting
from waychair.errors import ConfigError, SensorError
from waychair.types import BoolArray, Bytes, Float32Array, FloatArray, IntArray, RgbdFrame

Descriptors: TypeAlias = NDArray[Any]
"""(N, 32) bytes of ORB or (N, 128) floats of SIFT."""

DETECTORS = ("gftt_orb", "orb", "sift")
"""The possible values of `FeatureSettings.detector`."""

_PATCH_RADIUS = 15  # [px] radius of the patch of ORB's orientation and descriptor
_BORDER = 19  # [px] margin along the image border without ORB descriptors

# gftt_orb, RTAB-Map's GFTT/* but for the strength
_QUALITY = 0.001  # weakest corner as a share of the strongest
_MIN_DISTANCE = 7.0  # [px] between corners
_BLOCK_SIZE = 3  # [px] side of the window of the eigenvalues
_MIN_STRENGTH = 2e-4  # smallest eigenvalue of any corner, about six grey levels of contrast

FAST_THRESHOLD = 10
"""Contrast [grey levels] of the faintest `orb` corner."""

_SCALE_FACTOR, _LEVELS = 1.2, 8  # of the pyramid of `orb`


@dataclass(frozen=True, slots=True)
class FeatureSettings(Settings):
    """The detector of features (RTAB-Map's Kp/*)."""

    detector: str = setting("gftt_orb", "", "detector of image features: gftt_orb, orb or sift")
    max_features: int = setting(
        500,
        "",
        "number of strongest features kept of an image; more: it recognises more places and takes more time",
        low=1,
        high=20_000,
    )
    upright: bool = setting(
        True,
        "",
        "true: gftt_orb describes images of a camera that does not roll; false: descriptors turn with the image",
    )

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.detector == "surf":
            raise ConfigError("the detector 'surf' is not in OpenCV 5: choose sift, the closest alternative, or orb")
        if self.detector not in DETECTORS:
            raise ConfigError(f"there is no detector '{self.detector}': choose one of {', '.join(DETECTORS)}")

    @property
    def binary(self) -> bool:
        """Whether descriptors are bits (Hamming distance) and not floats (Euclidean distance)."""
        return self.detector != "sift"


@dataclass(frozen=True, slots=True)
class ImageFeatures:
    """N keypoints of one image, strongest first.

    pixels (N, 2) f32 [px] column, row; descriptors (N, 32) u8 or (N, 128) f32; points (N, 3) f32 [m] in the camera's
    optical frame (x right, y down, z forward), nan where depth is missing; response (N,) f32, the
    detector's strength; octave (N,) u8, level of the pyramid; angle (N,) f32 [rad] of the patch, nan if upright.
    """

    pixels: Float32Array
    descriptors: Descriptors
    points: Float32Array
    response: Float32Array
    octave: Bytes
    angle: Float32Array

    def __len__(self) -> int:
        return len(self.pixels)

    def take(self, chosen: IntArray | BoolArray) -> ImageFeatures:
        """Return the keypoints of an index (K,) or a mask (N,)."""
        return ImageFeatures(
            pixels=self.pixels[chosen],
            descriptors=self.descriptors[chosen],
            points=self.points[chosen],
            response=self.response[chosen],
            octave=self.octave[chosen],
            angle=self.angle[chosen],
        )


def extract(frame: RgbdFrame, settings: FeatureSettings | None = None) -> ImageFeatures:
    """Return the features of a frame.

    Features without depth are left out where the frame has any; without depth (empty, or nan everywhere) all `points`
    are nan.

    Raises:
        SensorError: the image is not (H, W) or (H, W, 3) bytes, or the depth has another size.
    """
    settings = settings or FeatureSettings()
    gray = gray_image(frame.image)
    depth = _checked_depth(frame.depth, gray)
    mask = None if depth is None else (depth > 0).view(np.uint8)
    features = features_of_image(gray, settings, mask)
    if depth is None or len(features) == 0:
        return features
    points = points_in_space(features.pixels, depth, frame.camera_matrix)
    found = replace(features, points=points)
    # A keypoint of a coarse level is found on a shrunken mask, and may lie beside the pixels with depth.
    return found.take(np.isfinite(points[:, 2]))


def features_of_image(gray: Bytes, settings: FeatureSettings, mask: Bytes | None = None) -> ImageFeatures:
    """Return the features of a grey image (H, W) where `mask` (H, W) is not 0; all points are nan."""
    if settings.detector == "gftt_orb":
        keypoints, descriptors = _gftt_orb(gray, settings, mask)
    else:
        keypoints, descriptors = _detector(settings).detectAndCompute(gray, mask)
    if descriptors is None or len(keypoints) == 0:
        return no_features(settings)
    count = len(keypoints)
    table = np.array([(*k.pt, k.response, k.octave & 255, k.angle) for k in keypoints], np.float32)
    angle = np.deg2rad(table[:, 4])
    found = ImageFeatures(
        pixels=table[:, :2],
        descriptors=descriptors,
        points=np.full((count, 3), np.nan, np.float32),
        response=table[:, 2],
        octave=table[:, 3].astype(np.uint8),
        angle=np.where(table[:, 4] < 0, np.float32(np.nan), angle),
    )
    strongest = np.argsort(-found.response, kind="stable")[: settings.max_features]
    return found.take(strongest)


def no_features(settings: FeatureSettings) -> ImageFeatures:
    """Return the empty features of a blank image."""
    descriptors = np.empty((0, 32), np.uint8) if settings.binary else np.empty((0, 128), np.float32)
    none, nothing = np.empty(0, np.float32), np.empty((0, 2), np.float32)
    points = np.empty((0, 3), np.float32)
    return ImageFeatures(
        pixels=nothing, descriptors=descriptors, points=points, response=none, octave=np.empty(0, np.uint8), angle=none
    )


def gray_image(image: Bytes) -> Bytes:
    """Return the grey image (H, W) of a grey or colour (red, green, blue) image.

    Raises:
        SensorError: the image is neither.
    """
    if image.dtype == np.uint8 and image.size and image.ndim == 2:
        return image
    if image.dtype == np.uint8 and image.size and image.ndim == 3 and image.shape[2] == 3:
        return cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.uint8, copy=False)
    raise SensorError(f"an image of {image.dtype} {image.shape} cannot be used: give (H, W) or (H, W, 3) bytes")


def points_in_space(pixels: Float32Array, depth: Float32Array, camera_matrix: FloatArray) -> Float32Array:
    """Return points (N, 3) f32 [m] in the optical frame for pixels (N, 2), by the nearest depth [m], or nan."""
    column, row = np.rint(pixels).astype(np.int64).T
    column, row = column.clip(0, depth.shape[1] - 1), row.clip(0, depth.shape[0] - 1)
    z = depth[row, column].astype(np.float64)
    z = np.where(np.isfinite(z) & (z > 0), z, np.nan)
    x = (pixels[:, 0] - camera_matrix[0, 2]) / camera_matrix[0, 0]
    y = (pixels[:, 1] - camera_matrix[1, 2]) / camera_matrix[1, 1]
    return (np.stack([x, y, np.ones_like(x)], axis=1) * z[:, None]).astype(np.float32)


def _checked_depth(depth: Float32Array, gray: Bytes) -> Float32Array | None:
    if depth.size == 0:
        return None
    if depth.shape != gray.shape:
        raise SensorError(f"the depth image is {depth.shape} but the image {gray.shape}: register depth to colour")
    return depth if np.isfinite(depth).any() and np.nanmax(depth) > 0 else None


def _detector(settings: FeatureSettings) -> cv2.Feature2D:
    if settings.detector == "sift":
        return cv2.SIFT.create(settings.max_features)
    return cv2.ORB.create(settings.max_features, _SCALE_FACTOR, _LEVELS, fastThreshold=FAST_THRESHOLD)


def _gftt_orb(gray: Bytes, settings: FeatureSettings, mask: Bytes | None) -> tuple[Sequence[cv2.KeyPoint], Descriptors]:
    anywhere: Any = mask  # None is allowed; OpenCV's stubs do not say so
    corners, strengths = cv2.goodFeaturesToTrackWithQuality(
        gray, settings.max_features, _QUALITY, _MIN_DISTANCE, anywhere, blockSize=_BLOCK_SIZE
    )
    if corners is None:
        return (), np.empty((0, 32), np.uint8)
    strengths = strengths.ravel()
    strong = strengths >= _MIN_STRENGTH
    pixels = corners.reshape(-1, 2)[strong].astype(np.float32, copy=False)
    angles = np.full(len(pixels), -1.0) if settings.upright else patch_angles(gray, pixels)
    keypoints = [
        cv2.KeyPoint(float(x), float(y), 2.0 * _PATCH_RADIUS + 1, float(angle), float(strength))
        for (x, y), angle, strength in zip(pixels, angles, strengths[strong], strict=True)
    ]
    kept, descriptors = cv2.ORB.create(settings.max_features, edgeThreshold=_BORDER, nlevels=1).compute(gray, keypoints)
    return kept, descriptors


@njit(cache=True)
def patch_angles(gray: Bytes, pixels: Float32Array) -> FloatArray:
    """Return directions (N,) [degrees, 0..360) from pixels (N, 2) to the intensity centroids there (Rosin 1999)."""
    height, width = gray.shape
    angles = np.zeros(len(pixels))
    for i in range(len(pixels)):
        column, row = round(pixels[i, 0]), round(pixels[i, 1])
        sum_x = sum_y = 0
        for dy in range(-_PATCH_RADIUS, _PATCH_RADIUS + 1):
            y = row + dy
            if y < 0 or y >= height:
                continue
            reach = int(math.sqrt(_PATCH_RADIUS * _PATCH_RADIUS - dy * dy))
            for x in range(max(column - reach, 0), min(column + reach, width - 1) + 1):
                value = int(gray[y, x])
                sum_x += (x - column) * value
                sum_y += dy * value
        angles[i] = math.degrees(math.atan2(sum_y, sum_x)) % 360.0
    return angles
