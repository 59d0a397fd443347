"""Edges of a pose graph: measured relative poses between nodes, and their residuals."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.types import BoolArray, FloatArray, IntArray, Pose2


class EdgeKind(enum.Enum):
    """Source of a relative pose."""

    ODOMETRY = "odometry"
    MATCH = "match"
    LOOP = "loop"
    UNKNOWN = "torn"
    """The motion is unknown: the chair was kidnapped, or another drive begins."""


@dataclass(frozen=True, slots=True)
class Edge:
    """Measured pose of node `j` in node `i`, with information (3, 3) of x, y [1/m^2], theta [1/rad^2] in j's frame."""

    i: int
    j: int
    i_from_j: Pose2
    information: FloatArray
    kind: EdgeKind


@dataclass(frozen=True, slots=True)
class EdgeArrays:
    """E edges as arrays: nodes `i` and `j` (E,), `i_from_j` (E, 3), `information` (E, 3, 3), and whether each edge is a
    `loop` (E,) or one of unknown motion, `torn` (E,)."""

    i: IntArray
    j: IntArray
    i_from_j: FloatArray
    information: FloatArray
    loop: BoolArray
    torn: BoolArray

    def __len__(self) -> int:
        return len(self.i)

    def take(self, kept: IntArray | slice) -> EdgeArrays:
        """Return some of the edges."""
        return EdgeArrays(
            self.i[kept], self.j[kept], self.i_from_j[kept], self.information[kept], self.loop[kept], self.torn[kept]
        )


class EdgeTable:
    """Edges as arrays that grow; each edge is converted once."""

    def __init__(self) -> None:
        self._count = 0
        self._rows = edge_arrays(())

    def append(self, edges: Sequence[Edge]) -> None:
        """Add edges at the end."""
        end, fresh = self._count + len(edges), edge_arrays(edges)
        if end > len(self._rows):
            rows = np.minimum(np.arange(max(64, 2 * end)), max(0, self._count - 1))
            self._rows = self._rows.take(rows) if self._count else fresh.take(np.zeros(len(rows), np.int64))
        self._put(slice(self._count, end), fresh)
        self._count = end

    def replace(self, index: int, edge: Edge) -> None:
        """Put an edge in the place of another."""
        self._put(slice(index, index + 1), edge_arrays([edge]))

    def keep(self, kept: Sequence[int]) -> None:
        """Remove all edges except these."""
        self._rows, self._count = self._rows.take(np.array(kept, np.int64)), len(kept)

    @property
    def arrays(self) -> EdgeArrays:
        """The edges in their order; valid until the next change."""
        return self._rows.take(slice(0, self._count))

    def _put(self, rows: slice, edges: EdgeArrays) -> None:
        own = self._rows
        own.i[rows], own.j[rows], own.loop[rows], own.torn[rows] = edges.i, edges.j, edges.loop, edges.torn
        own.i_from_j[rows], own.information[rows] = edges.i_from_j, edges.information


def edge_arrays(edges: Sequence[Edge]) -> EdgeArrays:
    """Return the edges as arrays, in their order."""
    return EdgeArrays(
        np.array([edge.i for edge in edges], np.int64),
        np.array([edge.j for edge in edges], np.int64),
        np.array([(e.i_from_j.x, e.i_from_j.y, e.i_from_j.theta) for e in edges]).reshape(-1, 3),
        np.array([edge.information for edge in edges]).reshape(-1, 3, 3),
        np.array([edge.kind is EdgeKind.LOOP for edge in edges], bool),
        np.array([edge.kind is EdgeKind.UNKNOWN for edge in edges], bool),
    )


def residuals(poses: FloatArray, edges: Sequence[Edge] | EdgeArrays) -> FloatArray:
    """Return the difference (E, 3) between each edge's measured and present relative pose, in the frame of node j.

    It is the SE(2) logarithm, the twist that covers the difference in unit time. The plain difference of coordinates is
    not good enough: with an ill-conditioned information matrix (1e8 : 1 occurs in the Manhattan graph) the few
    millimetres between the two become hundreds of sigmas.
    """
    a = edges if isinstance(edges, EdgeArrays) else edge_arrays(edges)
    return _residuals(poses, a.i, a.j, a.i_from_j, a.information)[0]


def chi_square(poses: FloatArray, edges: Sequence[Edge] | EdgeArrays) -> FloatArray:
    """Return the squared Mahalanobis length (E,) of the residuals (3 degrees of freedom)."""
    a = edges if isinstance(edges, EdgeArrays) else edge_arrays(edges)
    return _residuals(poses, a.i, a.j, a.i_from_j, a.information)[1]


@njit(cache=True)
def _residuals(
    poses: FloatArray, i: IntArray, j: IntArray, measured: FloatArray, information: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the residuals (E, 3) and their squared Mahalanobis lengths (E,)."""
    away, lengths = np.empty((len(i), 3)), np.empty(len(i))
    for e in range(len(i)):
        c, s = math.cos(poses[i[e], 2]), math.sin(poses[i[e], 2])
        dx, dy = poses[j[e], 0] - poses[i[e], 0], poses[j[e], 1] - poses[i[e], 1]
        bx, by = c * dx + s * dy - measured[e, 0], c * dy - s * dx - measured[e, 1]
        c, s = math.cos(measured[e, 2]), math.sin(measured[e, 2])
        gx, gy = c * bx + s * by, c * by - s * bx
        w = poses[j[e], 2] - poses[i[e], 2] - measured[e, 2]
        w -= 2.0 * math.pi * math.floor((w + math.pi) / (2.0 * math.pi))
        half = 0.5 * w
        along = 1.0 if abs(half) < 1e-6 else half / math.tan(half)
        x, y = along * gx + half * gy, along * gy - half * gx
        away[e, 0], away[e, 1], away[e, 2] = x, y, w
        own = information[e]
        lengths[e] = (
            x * (own[0, 0] * x + own[0, 1] * y + own[0, 2] * w)
            + y * (own[1, 0] * x + own[1, 1] * y + own[1, 2] * w)
            + w * (own[2, 0] * x + own[2, 1] * y + own[2, 2] * w)
        )
    return away, lengths
