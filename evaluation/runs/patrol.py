"""A patrol through a synthetic building at 1 Hz: scans, odometry and image features of a chair, without rendering.

Landmarks on the corridors' walls represent image corners. A view holds the landmarks before the camera, with misses,
false features, and noise on pixels, depth and bits, so that revisits look similar where they overlap. Odometry drifts.
Everything follows from the seed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import in_space
from waychair.slam.camera.features import ImageFeatures
from waychair.types import Bytes, Float32Array, FloatArray, IntArray, Odometry, Pose2, Scan, SensorFrame

SPACING = 20.0  # [m] between parallel corridors
COLUMNS, ROWS = 4, 3  # numbers of crossings
WIDTH = 2.4  # [m], of a corridor
_DENSITY = 40  # landmarks per metre of corridor
_REACH, _NEAREST = 7.0, 0.5  # [m] ahead of the camera
_FOCAL, _CENTRE = 525.0, np.array([320.0, 240.0])  # [px]
CAMERA = np.array([_FOCAL, _FOCAL, *_CENTRE])
_PIXEL, _DEPTH, _BITS = 0.5, 0.01, 8  # noise: [px], share of the depth, mean number of 256 bits
_MOST, _SEEN, _WRONG = 150, 0.85, 10  # words in a view, share of landmarks found, false words
_SPEED, _TURN = 0.8, math.radians(45)  # per second
_BEAMS = 180
_CUPBOARDS = 5  # per corridor
_SECOND = 1_000_000_000


@dataclass(frozen=True, slots=True)
class PatrolSecond:
    """One second of the patrol: true pose, scan with drifting odometry, and image features."""

    truth: Pose2
    frame: SensorFrame
    features: ImageFeatures


class Patrol:
    """An endless drive (`sights`) through one building."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        places = np.random.default_rng(7)  # the building is the same for every seed
        self._landmarks = np.concatenate([_along(a, b, places) for a, b in _corridors()])
        self._order = places.permutation(len(self._landmarks))  # clearest first
        self._cells: dict[tuple[int, int], list[int]] = {}
        for word, (x, y) in enumerate(self._landmarks.tolist()):
            self._cells.setdefault((int(x // _REACH), int(y // _REACH)), []).append(word)
        self._descriptors = places.integers(0, 256, (len(self._landmarks), 32), dtype=np.uint8)
        heights = places.uniform(0.2, 2.2, len(self._landmarks))
        self._points = np.column_stack([self._landmarks, heights])

    def sights(self) -> Iterator[PatrolSecond]:
        """Yield the sights, for ever."""
        odometry, before, rng = Pose2(), None, self._rng
        for second, truth in enumerate(self._poses()):
            if before is not None:
                step = before.inverse() @ truth
                slip = rng.standard_normal(2)
                driven = step.x * (1.01 + 0.01 * slip[0])
                odometry = odometry @ Pose2(driven, step.y, step.theta * 1.01 + abs(step.x) * (0.001 + 0.004 * slip[1]))
            before = truth
            stamp = second * _SECOND
            scan = Scan(stamp, _ranges(truth), -math.pi, math.tau / _BEAMS, range_max=25.0)
            yield PatrolSecond(truth, SensorFrame(stamp, scan, wheels=(Odometry(stamp, odometry),)), self._view(truth))

    def _poses(self) -> Iterator[Pose2]:
        """Yield poses along the corridors from crossing to crossing, with stops."""
        rng, at, heading = self._rng, (0, 0), 0.0
        came = at
        while True:
            ways = [(at[0] + dx, at[1] + dy) for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1))]
            ways = [way for way in ways if 0 <= way[0] < COLUMNS and 0 <= way[1] < ROWS and way != came]
            came, at = at, ways[int(rng.integers(len(ways)))]
            x, y = came[0] * SPACING, came[1] * SPACING
            towards = math.atan2(at[1] - came[1], at[0] - came[0])
            if rng.random() < 0.3:
                for _ in range(int(rng.integers(5, 60))):  # a rider gets on
                    yield Pose2(x, y, heading)
            turn = math.remainder(towards - heading, math.tau)
            for k in range(1, math.ceil(abs(turn) / _TURN) + 1):
                yield Pose2(x, y, heading + math.copysign(min(k * _TURN, abs(turn)), turn))
            heading, side = towards, rng.uniform(-0.4, 0.4)
            for k in range(1, int(SPACING / _SPEED) + 1):
                along, off = k * _SPEED, side * math.sin(math.pi * k * _SPEED / SPACING)
                c, s = math.cos(heading), math.sin(heading)
                yield Pose2(x + c * along - s * off, y + s * along + c * off, heading + rng.normal(0.0, 0.01))

    def _view(self, truth: Pose2) -> ImageFeatures:
        """Return the features of the landmarks before the camera, clearest first."""
        rng, camera = self._rng, (in_space(truth) @ CHAIR_A.base_from_camera).inverse()
        near = self._near(truth)
        at = self._points[near] @ camera.rotation.T + camera.translation
        pixels = _CENTRE + _FOCAL * at[:, :2] / np.maximum(at[:, 2:], _NEAREST)
        inside = (pixels >= 0).all(axis=1) & (pixels < 2 * _CENTRE).all(axis=1)
        inside &= (at[:, 2] > _NEAREST) & (at[:, 2] < _REACH) & (rng.random(len(near)) < _SEEN)
        seen = np.flatnonzero(inside)
        seen = seen[np.argsort(self._order[near[seen]])][:_MOST]
        count = len(seen)
        noisy = pixels[seen] + rng.normal(0.0, _PIXEL, (count, 2))
        depth = at[seen, 2] * (1.0 + rng.normal(0.0, _DEPTH, count))
        points = np.column_stack([(noisy - _CENTRE) / _FOCAL * depth[:, None], depth])
        flips = np.packbits(rng.random((count, 256)) < _BITS / 256, axis=1)
        descriptors = self._descriptors[near[seen]] ^ flips
        wrong = rng.permutation(count)[:_WRONG]
        descriptors[wrong] = rng.integers(0, 256, (len(wrong), 32), dtype=np.uint8)
        return _features(noisy, points, descriptors)

    def _near(self, pose: Pose2) -> IntArray:
        """Return the landmarks in the cells round the chair."""
        column, row = int(pose.x // _REACH), int(pose.y // _REACH)
        round_it = [(column + i, row + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        return np.array([word for cell in round_it for word in self._cells.get(cell, ())], np.int64)


def _features(pixels: FloatArray, points: FloatArray, descriptors: Bytes) -> ImageFeatures:
    count, single = len(pixels), np.float32
    return ImageFeatures(
        pixels.astype(single), descriptors, points.astype(single),
        np.ones(count, single), np.zeros(count, np.uint8), np.full(count, np.nan, single),
    )  # fmt: skip


def _corridors() -> list[tuple[FloatArray, FloatArray]]:
    crossings = [(i, j) for i in range(COLUMNS) for j in range(ROWS)]
    ends = [((i, j), (i + di, j + dj)) for i, j in crossings for di, dj in ((1, 0), (0, 1))]
    inside = [(a, b) for a, b in ends if b[0] < COLUMNS and b[1] < ROWS]
    return [(SPACING * np.array(a, float), SPACING * np.array(b, float)) for a, b in inside]


def _along(start: FloatArray, end: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return landmarks on both walls of a corridor."""
    count = int(_DENSITY * SPACING)
    side = rng.choice([-1.0, 1.0], count) * WIDTH / 2
    way = (end - start) / SPACING
    across = np.array([-way[1], way[0]])
    landmarks: FloatArray = start + rng.uniform(0.0, SPACING, count)[:, None] * way + side[:, None] * across
    return landmarks


def _blocks() -> FloatArray:
    """Return boxes (K, 4) of low x, low y, high x, high y: the blocks between the corridors, the four outer walls, and
    cupboards, without which all corridors would look alike."""
    half, far = WIDTH / 2, 1.0
    right, top = (COLUMNS - 1) * SPACING + half, (ROWS - 1) * SPACING + half
    inner = [
        (i * SPACING + half, j * SPACING + half, (i + 1) * SPACING - half, (j + 1) * SPACING - half)
        for i in range(COLUMNS - 1)
        for j in range(ROWS - 1)
    ]
    outer = [
        (-half - far, -half - far, right + far, -half),
        (-half - far, top, right + far, top + far),
        (-half - far, -half - far, -half, top + far),
        (right, -half - far, right + far, top + far),
    ]
    return np.concatenate([inner, outer, _cupboards(np.random.default_rng(8))])


def _cupboards(rng: np.random.Generator) -> FloatArray:
    """Return boxes (K, 4) of cupboards on both walls of each corridor; see `_blocks`."""
    blocks = []
    for start, end in _corridors():
        way = (end - start) / SPACING
        across = np.array([-way[1], way[0]])
        for _ in range(_CUPBOARDS):
            along, length, depth = rng.uniform(2.0, SPACING - 4.0), rng.uniform(0.4, 2.0), rng.uniform(0.15, 0.4)
            side = rng.choice([-1.0, 1.0]) * across
            corners = start + np.array([along, along + length])[:, None] * way
            wall, front = WIDTH / 2 * side, (WIDTH / 2 - depth) * side
            points = np.concatenate([corners + wall, corners + front])
            blocks.append([*points.min(axis=0), *points.max(axis=0)])
    return np.array(blocks)


_BLOCKS = _blocks()


def _ranges(pose: Pose2) -> Float32Array:
    """Return the ranges of a lidar in the chair's middle, by the slab method for each block."""
    angles = pose.theta - math.pi + math.tau / _BEAMS * np.arange(_BEAMS)
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        a = (_BLOCKS[None, :, :2] - (pose.x, pose.y)) / ways
        b = (_BLOCKS[None, :, 2:] - (pose.x, pose.y)) / ways
    into, out = np.minimum(a, b).max(axis=2), np.maximum(a, b).min(axis=2)
    hits = np.where((into <= out) & (into > 0), into, np.inf)
    ranges: Float32Array = hits.min(axis=1).astype(np.float32)
    return ranges
