"""The visual map: key frames, and landmarks with the picture in which each was first seen."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

from waychair.slam.camera.bundle_adjustment import Bundle, adjust
from waychair.slam.camera.features import ImageFeatures
from waychair.slam.camera.reprojection import OUTLIER_CHI_SQUARE, NoiseModel
from waychair.types import BoolArray, Bytes, Float32Array, FloatArray, IntArray, Pose3

LEVELS = 5
"""Levels of a picture's pyramid, each half the size of the one before."""

DEPTH_STEP = 4
"""Step [px] between the depth pixels that a key frame keeps."""

_EDGE = 0.03  # relative step of neighbouring depths at an edge between two objects


@dataclass(slots=True)
class KeyFrame:
    """A kept picture: its pose (camera_from_map), and the landmarks (K,) that it saw, with their observations (K, 4).

    `observed` holds u, v [px], inverse depth [1/m], nan where depth is missing, and the factor on the pixel's error.
    `depth` [m] is every fourth pixel of every fourth row. `features` locate a camera nearby; `sized` are those of
    places, which look alike from near and far. `piece` is the piece of the map; the motion between two
    pieces is unobserved.
    """

    stamp_ns: int
    camera_from_map: Pose3
    pyramid: tuple[Bytes, ...]
    landmarks: IntArray
    observed: FloatArray
    features: ImageFeatures
    sized: ImageFeatures
    depth: Float32Array
    piece: int = 0


class VisualMap:
    """Key frames in order, and landmarks: points (M, 3) [m] in map, alive (M,), and the first observation of each."""

    def __init__(self, camera: FloatArray) -> None:
        self.camera = camera
        self.key_frames: list[KeyFrame] = []
        self.points: FloatArray = np.empty((0, 3))
        self.anchor: IntArray = np.empty(0, np.int64)  # key frame whose picture shows the landmark's patch
        self.anchor_pixel: FloatArray = np.empty((0, 2))
        self.alive: BoolArray = np.empty(0, bool)
        self.expected: IntArray = np.empty(0, np.int64)  # times that each should have been seen
        self.found: IntArray = np.empty(0, np.int64)  # times that each was seen

    def add_landmarks(self, points: FloatArray, pixels: FloatArray, key: int) -> IntArray:
        """Add landmarks at points (K, 3), seen at pixels (K, 2) of a key frame; return their numbers (K,)."""
        first, count = len(self.points), len(points)
        self.points = np.concatenate([self.points, points])
        self.anchor = np.concatenate([self.anchor, np.full(count, key)])
        self.anchor_pixel = np.concatenate([self.anchor_pixel, pixels])
        self.alive = np.concatenate([self.alive, np.ones(count, bool)])
        self.expected = np.concatenate([self.expected, np.ones(count, np.int64)])
        self.found = np.concatenate([self.found, np.ones(count, np.int64)])
        return np.arange(first, first + count)

    def move(self, map_from_camera: Sequence[Pose3]) -> None:
        """Move every key frame to a new pose; landmarks move with the key frame that saw them first."""
        for key, (own, pose) in enumerate(zip(self.key_frames, map_from_camera, strict=True)):
            correction = pose @ own.camera_from_map
            mine = self.anchor == key
            self.points[mine] = self.points[mine] @ correction.rotation.T + correction.translation
            own.camera_from_map = pose.inverse()

    def join(self, piece: int, into: int) -> None:
        """Join two pieces of the map."""
        for own in self.key_frames:
            own.piece = into if own.piece == piece else own.piece

    def count(self, expected: IntArray, found: IntArray, share: float, at_least: int) -> None:
        """Count landmarks that should have been seen and those found; remove those found too seldom."""
        self.expected[expected] += 1
        self.found[found] += 1
        poor = (self.expected >= at_least) & (self.found < share * self.expected)
        self.alive &= ~poor

    def sharing(self, landmarks: IntArray) -> IntArray:
        """Return how many (K,) of the landmarks each key frame has seen."""
        wanted = np.zeros(len(self.points), bool)
        wanted[landmarks] = True
        return np.array([int(wanted[key.landmarks].sum()) for key in self.key_frames], np.int64)

    def landmarks_of(self, keys: Iterable[int]) -> IntArray:
        """Return the living landmarks that any of the key frames has seen, ascending."""
        seen = np.zeros(len(self.points), bool)
        for key in keys:
            seen[self.key_frames[key].landmarks] = True
        return np.flatnonzero(seen & self.alive)

    def adjust(self, free: Sequence[int], noise: NoiseModel, iterations: int, most_fixed: int = 30) -> int:
        """Adjust some key frames and their landmarks; return the number of observations removed as outliers.

        Other key frames with the same landmarks stay fixed; without any, the oldest of `free` stays fixed.
        """
        moving = set(free)
        landmarks = self.landmarks_of(free)
        shared = self.sharing(landmarks)
        others = [key for key in np.argsort(-shared, kind="stable").tolist() if shared[key] >= 5 and key not in moving]
        fixed = sorted(others[:most_fixed])
        if not fixed:
            fixed = [min(moving)]
            moving.discard(fixed[0])
        keys = sorted({*moving, *fixed})
        if not moving or len(landmarks) == 0:
            return 0
        bundle, sources = self._bundle(keys, moving, landmarks)
        adjusted, chi = adjust(bundle, self.camera, noise, iterations)
        for slot, key in enumerate(keys):
            if key in moving:
                self.key_frames[key].camera_from_map = Pose3(adjusted.rotations[slot], adjusted.translations[slot])
        self.points[landmarks] = adjusted.landmarks
        return self._give_up(keys, sources, bundle.frame, chi > OUTLIER_CHI_SQUARE)

    def _bundle(self, keys: Sequence[int], moving: set[int], landmarks: IntArray) -> tuple[Bundle, IntArray]:
        """Return the bundle of landmarks in key frames, and for each observation its index in its key frame's list."""
        place = np.full(len(self.points), -1)
        place[landmarks] = np.arange(len(landmarks))
        frames, marks, sights, sources = [], [], [], []
        for slot, key in enumerate(keys):
            own = self.key_frames[key]
            inside = np.flatnonzero(place[own.landmarks] >= 0)
            frames.append(np.full(len(inside), slot))
            marks.append(place[own.landmarks[inside]])
            sights.append(own.observed[inside])
            sources.append(inside)
        frame, mark, source = np.concatenate(frames), np.concatenate(marks), np.concatenate(sources)
        order = np.argsort(mark, kind="stable")
        bundle = Bundle(
            rotations=np.array([self.key_frames[key].camera_from_map.rotation for key in keys]),
            translations=np.array([self.key_frames[key].camera_from_map.translation for key in keys]),
            free=np.array([key in moving for key in keys]),
            landmarks=self.points[landmarks],
            frame=frame[order],
            landmark=mark[order],
            observed=np.concatenate(sights)[order],
        )
        return bundle, source[order]

    def _give_up(self, keys: Sequence[int], sources: IntArray, frame: IntArray, outlying: BoolArray) -> int:
        for slot, key in enumerate(keys):
            gone = sources[(frame == slot) & outlying]
            if len(gone):
                own = self.key_frames[key]
                kept = np.ones(len(own.landmarks), bool)
                kept[gone] = False
                own.landmarks, own.observed = own.landmarks[kept], own.observed[kept]
        return int(outlying.sum())


def pyramid_of(gray: Bytes) -> tuple[Bytes, ...]:
    """Return the pyramid of a picture: itself and its halved copies."""
    levels = [gray]
    for _ in range(LEVELS - 1):
        levels.append(np.asarray(cv2.pyrDown(levels[-1]), np.uint8))
    return tuple(levels)


@njit(cache=True)
def inverse_depths(depth: Float32Array, pixels: FloatArray) -> FloatArray:
    """Return 1/z (N,) [1/m] at pixels (N, 2), the mean of 3 x 3 pixels; nan at holes, edges and the border."""
    height, width = depth.shape
    found = np.full(len(pixels), np.nan)
    for n in range(len(pixels)):
        column, row = round(pixels[n, 0]), round(pixels[n, 1])
        if not (1 <= column < width - 1 and 1 <= row < height - 1):
            continue
        low, high, total, count = np.inf, 0.0, 0.0, 0
        for r in range(row - 1, row + 2):
            for c in range(column - 1, column + 2):
                z = depth[r, c]
                if z > 0.0:  # false for nan
                    low, high = min(low, z), max(high, z)
                    total += 1.0 / z
                    count += 1
        if count >= 6 and high - low < _EDGE * low:
            found[n] = total / count
    return found
