"""The leaf of a door: the straight thing that begins at a jamb and is about as long as the opening is wide."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.types import FloatArray

STEPS = np.radians(np.arange(4.0, 141.0, 2.0))
"""rad; angles from the closed position that are tried; farther open a leaf leaves everything and looks like the wall."""

THICK = 0.04
"""m; half the thickness of the band around a leaf in which its points lie: leaf, noise and error of the hinge."""

FROM_HINGE = 0.15
"""m; points nearer to the hinge belong to the jamb."""

HINGES = ((0.0, 0.0), (0.0, 0.05), (0.1, 0.0))
"""m; the hinge may stand so far behind the near face of the wall and beside the jamb's edge."""

LEAST_POINTS = 6
"""Points in the way of somebody who goes through, without which no leaf is looked for."""

FILLED = 0.75
"""Share of a leaf's length on which points must be seen."""

UNEVEN = 6.0
"""1/m; spread of the points beside a leaf counts against it, so that the right angle and hinge win."""

PIECE = 0.05
"""m; step along a leaf in which its points are counted."""

LENGTHS = (0.8, 1.15)
"""Shares of the opening's width between which a leaf's length lies."""


@dataclass(frozen=True, slots=True)
class Leaf:
    """A leaf hung at the jamb on the `side` ("left" is positive y), turned by `angle` [rad] from closed.

    A positive angle is towards positive x of the doorway. `length` [m] is from the hinge to the free edge.
    """

    side: str
    angle: float
    length: float

    def clear(self, width: float) -> float:
        """Return the part [m] of an opening of `width` [m] that the leaf leaves to somebody who goes straight through."""
        return min(width, max(0.0, width - self.length * math.cos(self.angle)))


def find_leaf(points: FloatArray, width: float) -> Leaf | None:
    """Return the leaf among points (N, 2) [m] in the frame of a doorway of `width` [m], None if there is none.

    Of several the best filled counts. Furniture that stands by chance where a leaf would, as long and as straight, is
    taken for one: the chair then has less room than it may have, never more.
    """
    best, most = None, 0.0
    in_way = (np.abs(points[:, 0]) > FROM_HINGE) & (np.abs(points[:, 1]) < width / 2 + THICK)
    if np.count_nonzero(in_way & (np.abs(points[:, 0]) < LENGTHS[1] * width)) < LEAST_POINTS:
        return None
    for side, name in ((1.0, "left"), (-1.0, "right")):
        for way in (1.0, -1.0):
            for behind, outside in HINGES:
                off = points * np.array([way, side]) - np.array([behind, width / 2 + outside])
                found, filled = _best_angle(off, width)
                if filled > most:
                    best, most = Leaf(name, way * found[0], found[1]), filled
    return best


def _best_angle(off: FloatArray, width: float) -> tuple[tuple[float, float], float]:
    """Return angle [rad] and length [m] of the best filled leaf from a hinge at the origin, closed along negative y and
    opening towards positive x, with its rating: the share of it on which points (N, 2) lie, less their spread."""
    reach = LENGTHS[1] * width
    off = off[(np.hypot(off[:, 0], off[:, 1]) < reach + PIECE) & (off[:, 0] > 0.0)]
    if len(off) < 4:
        return (0.0, 0.0), 0.0
    along = off[:, :1] * np.sin(STEPS) - off[:, 1:] * np.cos(STEPS)
    beside = off[:, :1] * np.cos(STEPS) + off[:, 1:] * np.sin(STEPS)
    on = (np.abs(beside) < THICK) & (along > FROM_HINGE)
    pieces = np.zeros((len(STEPS), math.ceil((reach + 2 * PIECE) / PIECE)), np.bool_)
    point, step = np.nonzero(on)
    pieces[step, np.minimum((along[point, step] / PIECE).astype(np.int64), pieces.shape[1] - 1)] = True
    first = math.ceil(FROM_HINGE / PIECE)
    filled = np.cumsum(pieces, axis=1).T
    spread = np.sqrt((beside**2 * on).sum(axis=0) / np.maximum(on.sum(axis=0), 1))
    lasts = np.arange(math.ceil(LENGTHS[0] * width / PIECE), len(filled))
    if not len(lasts):
        return (0.0, 0.0), 0.0
    shares = (filled[lasts - 1] - filled[first - 1]) / (lasts - first)[:, None]  # (lengths, angles)
    ratings = np.where(shares >= FILLED, shares - UNEVEN * spread, 0.0)
    length, angle = np.unravel_index(np.argmax(ratings), ratings.shape)
    best = max(0.0, float(ratings[length, angle]))
    return (float(STEPS[angle]), float(lasts[length] * PIECE)), best
