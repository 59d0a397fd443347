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
    against = np.einsum("ei,eij,ej->e", away, edges.information[loops[b]], away)
    a, b = a[against < _AGREE], b[against < _AGREE]
    groups[loops] = connected_parts(a, b, len(loops))
    return groups


def _near_pairs(low: IntArray, high: IntArray) -> tuple[IntArray, IntArray]:
    """Return the pairs (P,), (P,) of loops whose ends, low (L,) and high (L,), are near: for each loop the nearest ones."""
    order = np.argsort(low, kind="stable")
    first, end = (
        np.searchsorted(low[order], low + reach, side) for reach, side in ((-_NEAR, "left"), (_NEAR, "right"))
    )
    a = np.repeat(np.arange(len(low)), end - first)
    within = np.arange(len(a)) - np.repeat(np.cumsum(end - first) - (end - first), end - first)
    b = order[first[a] + within]
    away = np.maximum(np.abs(low[a] - low[b]), np.abs(high[a] - high[b]))
    a, b, away = a[away <= _NEAR], b[away <= _NEAR], away[away <= _NEAR]
    nearest = np.lexsort((away, a))
    a, b = a[nearest], b[nearest]
    rank = np.arange(len(a)) - np.searchsorted(a, a)
    return a[rank < _COMPARED], b[rank < _COMPARED]


def group_cost(groups: IntArray, left_out: IntArray, single: float) -> float:
    """Return the cost of leaving out the edges `left_out` (K,): `single` per group, more by the logarithm of its size."""
    _, sizes = np.unique(groups[left_out], return_counts=True)
    return float(single * (1.0 + np.log(sizes)).sum())
