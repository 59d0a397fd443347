"""Door leaves and frames proposed in one colour picture: two upright edges with a lintel between their upper ends.

Straight edges are found by the line segment detector (Grompone von Gioi et al., LSD, IPOL 2012). Every pair of upright
edges that could stand on both sides of a door is rated by what a door's picture has: edges without gaps, a lintel, the
shape of a door, few uprights and no drawers between. A picture proposes only: cupboards and refrigerators look the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np

from waychair.types import BoolArray, Bytes, FloatArray, Pose3

UPRIGHT, LEVEL = math.radians(14.0), math.radians(40.0)
"""rad; largest turn of an upright edge from the vertical, and of a lintel seen aslant from the horizontal."""

SHORTEST = 0.04
"""Share of the picture's height; shorter edges are texture."""

TALLEST_GAP, ASIDE = 0.30, 0.015
"""Shares of the picture's height; pieces of one upright edge are at most this far apart along it and beside it."""

ENLARGED = 1.5
"""Factor by which pictures grow before edges are looked for: the detector misses those a pixel or two apart."""

LOWEST_DOOR = 0.18
"""Share of the picture's height that a door fills at least: farther doors are not yet the chair's business."""

SHAPES = (1.2, 9.0)
"""Height by width of a door in the picture, from facing a wide one near by to passing a narrow one."""

OVERLAP = 0.4
"""Share of the taller edge beside which the other edge stands."""

STEP = 24.0
"""Grey levels (Sobel sum) by which a picture steps at an edge."""

LINTEL_OFF = 0.07
"""Share of the door's height within which its lintel lies at its upper end."""

SAME_BOX = 0.45
"""Intersection by union above which two boxes show the same door."""


WEIGHTS = np.array(
    [
        -7.32, 0.319, 2.42, 0.449, 1.75, 0.121, -0.782, -0.00534, 3.26, -1.03, 5.88, -5.74, 3.63, -5.27, -0.325, -0.0472,
        -3.28, -44.8, 0.0491, 3.86, -2.52, -2.27,
    ]
)  # fmt: skip
"""Weights of the features in `candidates`, by logistic regression on fifty photographs of rooms (32 with doors)."""

LEAST_SCORE, MOST_FRAMES = 1.4, 3
"""Least score of a proposal, and the number of proposals of one picture."""


SAME_COLUMNS, LEAST_DEPTH = 0.5, 0.3
"""Shared part of the columns of a box and of a doorway that range has found, and the nearest [m] it can be seen."""

Box: TypeAlias = tuple[float, float, float, float]
"""x0, y0, x1, y1 [pixels], y down."""


@dataclass(frozen=True, slots=True)
class DoorFrame:
    """A box of pixels, x0, y0, x1, y1 with y down, that may show a door, and its score (higher: more like one)."""

    box: Box
    score: float


def door_frames(picture: Bytes) -> list[DoorFrame]:
    """Return the boxes of a colour picture (H, W, 3; blue, green, red) that most look like a door, the best first."""
    boxes, features = candidates(picture, edges_in_picture(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).astype(np.uint8)))
    scores = features @ WEIGHTS
    found: list[DoorFrame] = []
    for k in np.argsort(-scores):
        if len(found) == MOST_FRAMES or scores[k] < LEAST_SCORE:
            break
        box = (float(boxes[k, 0]), float(boxes[k, 1]), float(boxes[k, 2]), float(boxes[k, 3]))
        if all(overlap(box, other.box) < SAME_BOX for other in found):
            found.append(DoorFrame(box, float(scores[k])))
    return found


def overlap(one: Box, other: Box) -> float:
    """Return the intersection of two boxes by their union."""
    wide = min(one[2], other[2]) - max(one[0], other[0])
    tall = min(one[3], other[3]) - max(one[1], other[1])
    shared = max(0.0, wide) * max(0.0, tall)
    areas = sum((box[2] - box[0]) * (box[3] - box[1]) for box in (one, other))
    return shared / max(areas - shared, 1e-9)


def shows(box: Box, camera_matrix: FloatArray, camera_from_door: Pose3, width: float) -> bool:
    """Return whether a box of a picture shows the doorway of `width` [m] that range has found.

    `camera_from_door` is the doorway's pose in the optical frame (z forward, x right, y down); its own x leads through
    it and z is up. The columns of both jambs decide: range tells nothing of the lintel.
    """
    jambs = np.array([[0.0, -width / 2, 1.0], [0.0, width / 2, 1.0]])
    points = jambs @ camera_from_door.rotation.T + camera_from_door.translation
    if (points[:, 2] < LEAST_DEPTH).any():
        return False
    columns = np.sort(camera_matrix[0, 0] * points[:, 0] / points[:, 2] + camera_matrix[0, 2])
    shared = min(columns[1], box[2]) - max(columns[0], box[0])
    return bool(shared > SAME_COLUMNS * (max(columns[1], box[2]) - min(columns[0], box[0])))


def edges_in_picture(grey: Bytes) -> FloatArray:
    """Return (K, 4) [pixels] the ends x, y, x, y of the straight edges of a grey picture (H, W)."""
    large = cv2.resize(grey, None, fx=ENLARGED, fy=ENLARGED, interpolation=cv2.INTER_CUBIC)
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(large)[0]
    return np.zeros((0, 4)) if found is None else np.asarray(found, np.float64).reshape(-1, 4) / ENLARGED


def uprights(edges: FloatArray, height: int) -> FloatArray:
    """Return (V, 5) the upright edges of edges (K, 4): x at the upper and lower end, y of both, and the length seen.

    Pieces that continue each other are joined, the longest first.
    """
    down = np.where((edges[:, 1] <= edges[:, 3])[:, None], edges, edges[:, [2, 3, 0, 1]])
    rise, aside = down[:, 3] - down[:, 1], down[:, 2] - down[:, 0]
    down = down[(np.abs(aside) < math.tan(UPRIGHT) * rise) & (rise > SHORTEST * height)]
    left = down[np.argsort(down[:, 1] - down[:, 3])]
    found = []
    while len(left):
        x, top, low_x, bottom, seen = left[0, 0], left[0, 1], left[0, 2], left[0, 3], left[0, 3] - left[0, 1]
        mine = np.zeros(len(left), np.bool_)
        mine[0] = True
        for i in range(1, len(left)):
            slope = (low_x - x) / (bottom - top)
            off = np.abs(left[i, [0, 2]] - (x + slope * (left[i, [1, 3]] - top)))
            reach = max(top - left[i, 3], left[i, 1] - bottom)
            if off.max() < ASIDE * height and reach < TALLEST_GAP * height:
                mine[i] = True
                seen += max(0.0, left[i, 3] - left[i, 1]) if reach > 0.0 else 0.0
                if left[i, 1] < top:
                    x, top = left[i, 0], left[i, 1]
                if left[i, 3] > bottom:
                    low_x, bottom = left[i, 2], left[i, 3]
        found.append((x, low_x, top, bottom, seen))
        left = left[~mine]
    return np.array(found).reshape(-1, 5)


def candidates(picture: Bytes, edges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return boxes (N, 4) [pixels] that may show a door in a colour picture (H, W, 3), and their features (N, F).

    Each pair of uprights gives up to four boxes: with the higher or the lower of their upper ends, and of their lower
    ends. The picture's sides count as uprights, because they cut doors.
    """
    height, width = picture.shape[:2]
    posts = uprights(edges, height)
    sides = np.array([[0.0, 0.0, 0.0, height, 0.0], [width - 1.0, width - 1.0, 0.0, height, 0.0]])
    posts = np.vstack([posts, sides])
    cut = np.arange(len(posts)) >= len(posts) - 2
    left, right = np.nonzero(posts[:, None, :2].mean(axis=2) < posts[None, :, :2].mean(axis=2))
    keep = ~(cut[left] & cut[right])
    left, right = left[keep], right[keep]
    parts = []
    for upper in (np.minimum, np.maximum):
        for lower in (np.maximum, np.minimum):
            top = np.where(
                cut[left], posts[right, 2], np.where(cut[right], posts[left, 2], upper(posts[left, 2], posts[right, 2]))
            )
            bottom = np.where(
                cut[left], posts[right, 3], np.where(cut[right], posts[left, 3], lower(posts[left, 3], posts[right, 3]))
            )
            parts.append(np.stack([left, right, top, bottom], axis=1))
    pairs = np.unique(np.concatenate(parts), axis=0)
    left, right = pairs[:, 0].astype(np.int64), pairs[:, 1].astype(np.int64)
    top, bottom = pairs[:, 2], pairs[:, 3]
    ends = [_at(posts[k], y) for k in (left, right) for y in (top, bottom)]
    x0, x1 = (ends[0] + ends[1]) / 2, (ends[2] + ends[3]) / 2
    tall, wide = bottom - top, x1 - x0
    shared = np.minimum(posts[left, 3], posts[right, 3]) - np.maximum(posts[left, 2], posts[right, 2])
    shape = tall / np.maximum(wide, 1.0)
    keep = (tall > LOWEST_DOOR * height) & (shape > SHAPES[0]) & (shape < SHAPES[1])
    keep &= (shared > OVERLAP * tall) | cut[left] | cut[right]
    left, right, top, bottom, x0, x1, tall, shape = (a[keep] for a in (left, right, top, bottom, x0, x1, tall, shape))
    ends = [end[keep] for end in ends]
    boxes = np.stack([x0, top, x1, bottom], axis=1)
    is_cut = cut[left] | cut[right]
    upright, level = _steps(picture)
    at_left = np.where(cut[left], 0.6, _along(upright, ends[0], top, ends[1], bottom))
    at_right = np.where(cut[right], 0.6, _along(upright, ends[2], top, ends[3], bottom))
    lintel, foot, drawers = _levels(edges, boxes)
    features = np.stack(
        [
            np.ones(len(boxes)),
            np.minimum(at_left, at_right),
            np.maximum(at_left, at_right),
            lintel,
            _along(level, ends[0], top, ends[2], top),
            foot,
            np.minimum(drawers, 3.0),
            np.minimum(_inner_posts(posts[:-2], boxes), 3.0),
            np.log(shape),
            np.log(shape) ** 2,
            tall / height,
            (tall / height) ** 2,
            bottom / height,
            top / height,
            (top < 0.02 * height).astype(np.float64),
            is_cut.astype(np.float64),
            *_tones(picture, boxes),
        ],
        axis=1,
    )
    return boxes, features


def _at(posts: FloatArray, y: FloatArray) -> FloatArray:
    """Return x (N,) of posts (N, 5) at the heights y (N,)."""
    slope = (posts[:, 1] - posts[:, 0]) / np.maximum(posts[:, 3] - posts[:, 2], 1.0)
    found: FloatArray = posts[:, 0] + slope * (y - posts[:, 2])
    return found


def _steps(picture: Bytes) -> tuple[Bytes, Bytes]:
    """Return (H, W) where the picture steps from side to side, and from top to bottom, within a few pixels."""
    smooth = cv2.GaussianBlur(picture, (0, 0), 1.0)
    across = np.abs(cv2.Sobel(smooth, cv2.CV_32F, 1, 0)).max(axis=2)
    down = np.abs(cv2.Sobel(smooth, cv2.CV_32F, 0, 1)).max(axis=2)
    upright = ((across > STEP) & (across > 1.5 * down)).astype(np.uint8)
    level = ((down > STEP) & (down > 0.8 * across)).astype(np.uint8)
    return (
        np.asarray(cv2.dilate(upright, np.ones((1, 7), np.uint8)), np.uint8),
        np.asarray(cv2.dilate(level, np.ones((9, 1), np.uint8)), np.uint8),
    )


def _along(marks: Bytes, x0: FloatArray, y0: FloatArray, x1: FloatArray, y1: FloatArray) -> FloatArray:
    """Return (N,) the share of marked pixels on lines between points, from 32 samples of each."""
    part = (np.arange(32) + 0.5) / 32
    x = x0[:, None] + (x1 - x0)[:, None] * part
    y = y0[:, None] + (y1 - y0)[:, None] * part
    rows = np.clip(np.rint(y), 0, marks.shape[0] - 1).astype(np.int64)
    columns = np.clip(np.rint(x), 0, marks.shape[1] - 1).astype(np.int64)
    return np.asarray(marks[rows, columns].mean(axis=1), np.float64)


def _levels(edges: FloatArray, boxes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (N,) the share of each box's width with a level edge at its top, at its bottom, and the number of level
    edges between, each as wide as the box."""
    right = np.where((edges[:, 0] <= edges[:, 2])[:, None], edges, edges[:, [2, 3, 0, 1]])
    run = right[:, 2] - right[:, 0]
    right = right[(np.abs(right[:, 3] - right[:, 1]) < math.tan(LEVEL) * run) & (run > 3.0)]
    x0, top, x1, bottom = (boxes[:, c][:, None] for c in range(4))
    inside = np.clip(np.minimum(right[:, 2], x1) - np.maximum(right[:, 0], x0), 0.0, None) / np.maximum(x1 - x0, 1.0)
    y = (right[:, 1] + right[:, 3]) / 2
    off = LINTEL_OFF * (bottom - top)
    at_top = np.minimum(1.0, (inside * (np.abs(y - top) < off)).sum(axis=1))
    at_foot = np.minimum(1.0, (inside * (np.abs(y - bottom) < off)).sum(axis=1))
    between = (inside * ((y > top + 1.5 * off) & (y < bottom - 1.5 * off) & (inside > 0.6))).sum(axis=1)
    return at_top, at_foot, between


def _inner_posts(posts: FloatArray, boxes: FloatArray) -> FloatArray:
    """Return (N,) how many upright edges, in shares of each box's height, stand within the box."""
    if not len(posts):
        return np.zeros(len(boxes))
    x = posts[:, :2].mean(axis=1)
    x0, top, x1, bottom = (boxes[:, c][:, None] for c in range(4))
    margin = 0.12 * (x1 - x0)
    within: BoolArray = (x > x0 + margin) & (x < x1 - margin)
    shared = np.clip(np.minimum(posts[:, 3], bottom) - np.maximum(posts[:, 2], top), 0.0, None) / (bottom - top)
    found: FloatArray = (shared * within).sum(axis=1)
    return found


def _tones(picture: Bytes, boxes: FloatArray) -> list[FloatArray]:
    """Return features (N,) of tone and colour: roughness within, and contrast to the strips at left, right and above."""
    colours = cv2.cvtColor(picture, cv2.COLOR_BGR2LAB).astype(np.float64) / 255.0
    sums = np.pad(colours.cumsum(0).cumsum(1), ((1, 0), (1, 0), (0, 0)))
    squares = np.pad((colours**2).cumsum(0).cumsum(1), ((1, 0), (1, 0), (0, 0)))
    height, width = picture.shape[:2]

    def mean(table: FloatArray, x0: FloatArray, y0: FloatArray, x1: FloatArray, y1: FloatArray) -> FloatArray:
        a, b = np.clip(x0, 0, width - 1).astype(np.int64), np.clip(x1, 1, width).astype(np.int64)
        c, d = np.clip(y0, 0, height - 1).astype(np.int64), np.clip(y1, 1, height).astype(np.int64)
        b, d = np.maximum(b, a + 1), np.maximum(d, c + 1)
        total: FloatArray = table[d, b] - table[c, b] - table[d, a] + table[c, a]
        return total / ((b - a) * (d - c))[:, None]

    x0, top, x1, bottom = boxes.T
    strip, above, inner = 0.15 * (x1 - x0), 0.08 * (bottom - top), 0.08 * (x1 - x0)
    inside = mean(sums, x0 + inner, top + above, x1 - inner, bottom - above)
    rough = np.sqrt(np.maximum(mean(squares, x0 + inner, top + above, x1 - inner, bottom - above) - inside**2, 0.0))
    beside = [
        mean(sums, x0 - strip, top, x0, bottom),
        mean(sums, x1, top, x1 + strip, bottom),
        mean(sums, x0, top - above, x1, top),
    ]
    apart = [np.sqrt(np.sum((part - inside) ** 2, axis=1)) for part in beside]
    # the upper and the lower half of a leaf have one colour
    middle = (top + bottom) / 2
    halves = mean(sums, x0 + inner, top + above, x1 - inner, middle) - mean(
        sums, x0 + inner, middle, x1 - inner, bottom - above
    )
    return [
        rough[:, 0],
        np.hypot(rough[:, 1], rough[:, 2]),
        np.minimum(apart[0], apart[1]),
        np.maximum(apart[0], apart[1]),
        apart[2],
        np.sqrt(np.sum(halves**2, axis=1)),
    ]
