"""Groups of loops that say the same: they join the same two stretches of the drive and agree with each other.

A repeated corridor that is mistaken once yields many false loops that all agree. They are one mistake, so a group has one
voice: against it stands the odometry with all other groups, not the number of its loops.
"""

from __future__ import annotations

import numpy as np

from waychair.geometry import compose, invert, wrap_angles
from waychair.slam.graph.edges import EdgeArrays
from waychair.slam.graph.least_squares import connected_parts
from waychair.types import FloatArray, IntArray

_NEAR = 5  # nodes; two loops whose ends are not farther apart may belong to one group
_AGREE = 65.0  # chi-square of the difference of two such loops, four times the 99.9 % of 3 degrees of freedom
_MORE = 0.2  # share of the cost of one loop by which a group costs more, times the logarithm of its size
_COMPARED = 16  # loops with which a loop is compared, the nearest first


def loop_groups(poses: FloatArray, edges: EdgeArrays) -> IntArray:
    """Return the group (E,) of each edge, from 0 on; -1 for edges that are no loops.

    The short ways between the ends of two loops are taken from the poses (N, 3).
    """
    groups = np.full(len(edges), -1, np.int64)
    loops = np.flatnonzero(edges.loop)
    if not len(loops):
        return groups
    flipped = (edges.i > edges.j)[loops]
    low, high = np.minimum(edges.i, edges.j)[loops], np.maximum(edges.i, edges.j)[loops]
    measured = edges.i_from_j[loops]
    low_from_high = np.where(flipped[:, None], invert(measured), measured)
    a, b = _near_pairs(low, high)
    to_low = compose(invert(poses[low[b]]), poses[low[a]])
    to_high = compose(invert(poses[high[a]]), poses[high[b]])
    away = compose(invert(low_from_high[b]), compose(compose(to_low, low_from_high[a]), to_high))
    away[:, 2] = wrap_angles(away[:, 2])
    expected = _covariance(low_from_high[a], np.abs(low[a] - low[b]), np.abs(high[a] - high[b]), edges, loops[b])
    against = np.einsum("ei,ei->e", away, np.linalg.solve(expected, away[..., None])[..., 0])
    a, b = a[against < _AGREE], b[against < _AGREE]
    groups[loops] = connected_parts(a, b, len(loops))
    return groups


def _near_pairs(low: IntArray, high: IntArray) -> tuple[IntArray, IntArray]:
    """Return the pairs (P,), (P,) of loops whose ends, low (L,) and high (L,), are near: for each loop the nearest ones."""
    order = np.argsort(low, kind="stable")
    first = np.searchsorted(low[order], low - _NEAR, side="left")
    end = np.searchsorted(low[order], low + _NEAR, side="right")
    a = np.repeat(np.arange(len(low)), end - first)
    within = np.arange(len(a)) - np.repeat(np.cumsum(end - first) - (end - first), end - first)
    b = order[first[a] + within]
    away = np.maximum(np.abs(low[a] - low[b]), np.abs(high[a] - high[b]))
    a, b, away = a[away <= _NEAR], b[away <= _NEAR], away[away <= _NEAR]
    nearest = np.lexsort((away, a))
    a, b = a[nearest], b[nearest]
    rank = np.arange(len(a)) - np.searchsorted(a, a)
    return a[rank < _COMPARED], b[rank < _COMPARED]


def _covariance(loop: FloatArray, low: IntArray, high: IntArray, edges: EdgeArrays, other: IntArray) -> FloatArray:
    """Return the covariance (K, 3, 3) of the difference between two loops, with that of the steps between their ends.

    `loop` (K, 3) is the first loop, `other` (K,) the edge of the second; `low` and `high` (K,) count the steps. A step's
    turn moves the far end of a long loop.
    """
    covariance: FloatArray = np.asarray(np.linalg.inv(edges.information[other]), np.float64)
    steps = edges.information[~edges.loop]
    if not len(steps):
        return covariance
    step = np.linalg.inv(np.median(steps, axis=0))
    lever = np.tile(np.eye(3), (len(loop), 1, 1))
    lever[:, 0, 2], lever[:, 1, 2] = -loop[:, 1], loop[:, 0]
    back = np.tile(np.eye(3), (len(loop), 1, 1))
    back[:, 0, 0] = back[:, 1, 1] = np.cos(loop[:, 2])
    back[:, 0, 1], back[:, 1, 0] = np.sin(loop[:, 2]), -np.sin(loop[:, 2])
    turned = back @ lever
    covariance = covariance + low[:, None, None] * (turned @ step @ turned.transpose(0, 2, 1))
    return covariance + high[:, None, None] * step


def group_cost(groups: IntArray, left_out: IntArray, single: float) -> float:
    """Return the cost of leaving out the edges `left_out` (K,): `single` per group, more by the logarithm of its size."""
    _, sizes = np.unique(groups[left_out], return_counts=True)
    return float(single * (1.0 + _MORE * np.log(sizes)).sum())
