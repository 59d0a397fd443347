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

from waychair.errors import SensorError
from waychair.slam.camera.feature_settings import FeatureSettings
from waychair.types import BoolArray, Bytes, Float32Array, FloatArray, IntArray, RgbdFrame

Descriptors: TypeAlias = NDArray[Any]
"""(N, 32) bytes of ORB or (N, 128) floats of SIFT."""

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

# gftt_orb with depth
_PATCH_WIDTH = 0.24  # [m] of a described patch; 31 px at 4 m for a camera of 525 px, nearer things on shrunken pictures
_DEPTH_FACTOR, _DEPTH_LEVELS = math.sqrt(2.0), 6  # of that pyramid, from 4 m down to 0.7 m for that camera
_LEAST_SHARE = 0.002  # of the depths in a level that is searched
_LEAST_CORNERS = 20  # searched in such a level


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
    return features if depth is None else _with_points(features, depth, frame.camera_matrix)


def extract_sized(frame: RgbdFrame, settings: FeatureSettings) -> ImageFeatures:
    """Return features for which a place twice as near looks the same: `gftt_orb` by depth, other detectors as `extract`.

    Those of near things are less precise than those of `extract`.

    Raises:
        SensorError: the image is not (H, W) or (H, W, 3) bytes, or the depth has another size.
    """
    gray = gray_image(frame.image)
    depth = _checked_depth(frame.depth, gray)
    if depth is None or settings.detector != "gftt_orb":
        return extract(frame, settings)
    found = _gftt_orb_of_depth(gray, depth, float(frame.camera_matrix[0, 0]), settings)
    return _with_points(_of_keypoints(*found, settings), depth, frame.camera_matrix)


def _with_points(features: ImageFeatures, depth: Float32Array, camera_matrix: FloatArray) -> ImageFeatures:
    """Return the features that have depth, with their points in space."""
    if len(features) == 0:
        return features
    points = points_in_space(features.pixels, depth, camera_matrix)
    found = replace(features, points=points)
    # A keypoint of a coarse level is found on a shrunken mask, and may lie beside the pixels with depth.
    return found.take(np.isfinite(points[:, 2]))


def features_of_image(gray: Bytes, settings: FeatureSettings, mask: Bytes | None = None) -> ImageFeatures:
    """Return the features of a grey image (H, W) where `mask` (H, W) is not 0; all points are nan."""
    if settings.detector == "gftt_orb":
        keypoints, descriptors = _gftt_orb(gray, settings, mask)
    else:
        keypoints, descriptors = _detector(settings).detectAndCompute(gray, mask)
    return _of_keypoints(keypoints, descriptors, settings)


def _of_keypoints(
    keypoints: Sequence[cv2.KeyPoint], descriptors: Descriptors | None, settings: FeatureSettings
) -> ImageFeatures:
    """Return the strongest features of these keypoints (N,) and descriptors (N, W); all points are nan."""
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
    pixels, strengths = _strong_corners(gray, settings.max_features, mask)
    if len(pixels) == 0:
        return (), np.empty((0, 32), np.uint8)
    angles = np.full(len(pixels), -1.0) if settings.upright else patch_angles(gray, pixels)
    keypoints = [
        cv2.KeyPoint(float(x), float(y), 2.0 * _PATCH_RADIUS + 1, float(angle), float(strength))
        for (x, y), angle, strength in zip(pixels, angles, strengths, strict=True)
    ]
    kept, descriptors = cv2.ORB.create(settings.max_features, edgeThreshold=_BORDER, nlevels=1).compute(gray, keypoints)
    return kept, descriptors


def _gftt_orb_of_depth(
    gray: Bytes, depth: Float32Array, focal: float, settings: FeatureSettings
) -> tuple[Sequence[cv2.KeyPoint], Descriptors | None]:
    """Return corners whose patches have one size in metres, so that a place twice as near looks the same.

    Each level of a pyramid is searched where the depth fits it. A keypoint's octave counts in steps of the pyramid of
    `orb`, as everywhere.
    """
    full_depth = _PATCH_WIDTH * focal / (2.0 * _PATCH_RADIUS + 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        level = np.rint(np.log(full_depth / depth) / math.log(_DEPTH_FACTOR))
    known = np.isfinite(level) & (depth > 0)
    level = np.where(known, level.clip(0, _DEPTH_LEVELS - 1), -1).astype(np.int8)
    keypoints: list[cv2.KeyPoint] = []
    for k in range(_DEPTH_LEVELS):
        here = (level == k).view(np.uint8)
        share = float(np.count_nonzero(here)) / max(int(np.count_nonzero(known)), 1)
        if share >= _LEAST_SHARE:
            most = max(_LEAST_CORNERS, round(share * settings.max_features))
            keypoints += _corners_of_level(gray, here, k, most, settings.upright)
    if not keypoints:
        return (), None
    compute = cv2.ORB.create(settings.max_features, _DEPTH_FACTOR, _DEPTH_LEVELS, edgeThreshold=_BORDER).compute
    kept, descriptors = compute(gray, keypoints)
    for keypoint in kept:
        keypoint.octave = round(keypoint.octave * math.log(_DEPTH_FACTOR) / math.log(_SCALE_FACTOR))
    return kept, descriptors


def _corners_of_level(gray: Bytes, mask: Bytes, level: int, most: int, upright: bool) -> list[cv2.KeyPoint]:
    """Return at most `most` corners where `mask` (H, W) is not 0, found on the picture shrunken to a level."""
    scale = _DEPTH_FACTOR**level
    if level:
        size = (round(gray.shape[1] / scale), round(gray.shape[0] / scale))
        gray = np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), np.uint8)
        mask = np.asarray(cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST), np.uint8)
    pixels, strengths = _strong_corners(gray, most, mask)
    angles = np.full(len(pixels), -1.0) if upright else patch_angles(gray, pixels)
    full = (pixels + 0.5) * scale - 0.5
    diameter = (2.0 * _PATCH_RADIUS + 1) * scale
    return [
        cv2.KeyPoint(float(x), float(y), diameter, float(angle), float(strength), level)
        for (x, y), angle, strength in zip(full, angles, strengths, strict=True)
    ]


def _strong_corners(gray: Bytes, most: int, mask: Bytes | None) -> tuple[Float32Array, Float32Array]:
    """Return pixels (N, 2) and strengths (N,) of the strongest corners of a picture where `mask` is not 0."""
    anywhere: Any = mask  # None is allowed; OpenCV's stubs do not say so
    corners, strengths = cv2.goodFeaturesToTrackWithQuality(
        gray, most, _QUALITY, _MIN_DISTANCE, anywhere, blockSize=_BLOCK_SIZE
    )
    if corners is None:
        return np.empty((0, 2), np.float32), np.empty(0, np.float32)
    strengths = np.asarray(strengths, np.float32).ravel()
    strong = strengths >= _MIN_STRENGTH
    return corners.reshape(-1, 2)[strong].astype(np.float32, copy=False), strengths[strong]


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
