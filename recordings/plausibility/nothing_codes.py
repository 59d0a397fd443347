"""Codes for "nothing seen" among the ranges of a lidar: values that no surface can have produced.

REP-117 says +inf, but drivers also send `range_max`, a little less, or any constant such as 8.01 m. A code is a value that
very many beams share to the last bit in scan after scan, wherever the chair is. Ranges of real surfaces repeat as well
where a lidar rounds them: a wall seen at a right angle gives one rounded value over several beams. Hence the three tests
of `codes_for_nothing`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from waychair.types import BoolArray, Float32Array

_LEAST_SHARE = 0.002  # of all finite ranges: a rarer value changes no map
_LEAST_ROUNDED_SHARE = 0.01  # the same where the ranges are rounded
_LEAST_COUNT = 40
_VIEWS = 400  # views that are looked at, at most
_LEAST_VIEWS = 3  # fewer different views do not tell a code from a surface
_VIEW_CHANGE = 0.1  # m; median change of the ranges from one view to the next
_VIEW_SHARE = 0.02  # of the views hold the code: a chair passes any one place in fewer
_SPIKE = 5.0  # times as often as the second of the values near it (a lidar may have two codes); a rounded wall at a
# right angle gives 1 / (sqrt(3) - sqrt(2)) = 3.1
_NEAR = 0.05  # m; values as near as this are compared
_UNEXPLAINED = 0.2  # share of the beams that a flat surface cannot explain
_SELDOM, _CHANGING = (
    0.3,
    0.5,
)  # share of the views with the value at one beam; share of the beams at which it is that rare
_OWN_PARTS = 1.2  # m; parts of the chair are nearer
_JUMP = 0.3  # m; a lone beam that is so far from both its neighbours
_FINE = 0.005  # m; with coarser steps, real surfaces share values as well
_STEPS = 20_000  # different values; more mean that ranges are not rounded


def codes_for_nothing(scans: Sequence[Float32Array], angle_step: float, range_max: float) -> tuple[float, ...]:
    """Return the values that stand for "nothing seen" among the finite ranges of one lidar's scans, most frequent first.

    A value is a code if, in different views,

    1. it is frequent, and far more frequent than the values near it;
    2. it is in many views of the drive;
    3. its beams form arcs about the lidar that no flat surface can; or the beams change, and they lie alone, far from both
       neighbours, or no other range is farther. Near arcs at unchanging beams are parts of the chair.

    Args:
        scans: ranges (N,) [m] of each scan, in order of time.
        angle_step: [rad] between beams.
        range_max: [m] reach as told; inf if unknown.
    """
    views = _different_views(scans)
    if len(views) < _LEAST_VIEWS:
        return ()
    flat = np.concatenate([view[_usable(view)] for view in views])
    if not len(flat):
        return ()
    values, counts = np.unique(flat, return_counts=True)
    rounding = _rounding(values)
    share = _LEAST_SHARE if rounding < _FINE else _LEAST_ROUNDED_SHARE
    frequent = np.flatnonzero(counts >= max(_LEAST_COUNT, share * len(flat)))
    codes = []
    for index in frequent[np.argsort(-counts[frequent])].tolist():
        value = values[index]
        if not _is_spike(values, counts, index, rounding):
            continue
        holds = [view == value for view in views]
        if sum(bool(hold.any()) for hold in holds) < max(_LEAST_VIEWS, _VIEW_SHARE * len(views)):
            continue
        change = _beams_change(holds)
        arcs, lone = _arcs_and_lone(views, holds, float(value), rounding, angle_step)
        farthest = float(np.delete(values, index).max(initial=0.0))
        beyond = float(value) >= min(range_max, farthest) - 2.0 * rounding
        if (arcs and (change or value > _OWN_PARTS)) or (change and (lone or beyond)):
            codes.append(float(value))
    return tuple(codes)


def without_codes(ranges: Float32Array, codes: Sequence[float]) -> Float32Array:
    """Return the ranges with +inf (nothing seen) in place of each code."""
    coded = np.isin(ranges, np.array(codes, np.float32))
    return np.where(coded, np.float32(np.inf), ranges) if coded.any() else ranges


def _usable(ranges: Float32Array) -> BoolArray:
    usable: BoolArray = np.isfinite(ranges) & (ranges > 0.0)
    return usable


def _different_views(scans: Sequence[Float32Array]) -> list[Float32Array]:
    """Return scans that differ from the one before: a chair that stands repeats its scan as often as it likes."""
    views: list[Float32Array] = []
    for scan in scans[:: max(1, len(scans) // (4 * _VIEWS))]:
        if not views or _change(views[-1], scan) > _VIEW_CHANGE:
            views.append(scan)
    return views[:: max(1, -(-len(views) // _VIEWS))]


def _change(before: Float32Array, after: Float32Array) -> float:
    """Return the median change [m] of those ranges that are not the same in both."""
    if len(before) != len(after):
        return math.inf
    moved = _usable(before) & _usable(after) & (before != after)
    if moved.sum() < 0.05 * len(before):
        return 0.0
    # the upper quartile: along a wall, most ranges stay as they are
    return float(np.quantile(np.abs(after[moved] - before[moved]), 0.75))


def _rounding(values: Float32Array) -> float:
    """Return the step [m] of rounded ranges; 0 if they are not rounded."""
    if len(values) > _STEPS or len(values) < 2:
        return 0.0
    gaps = np.diff(values.astype(np.float64))
    step = float(np.median(gaps))
    return step if step > 1e-4 else 0.0


def _is_spike(values: Float32Array, counts: np.ndarray, index: int, rounding: float) -> bool:
    """Return whether a value is far more frequent than all values near it but one."""
    reach = max(_NEAR, 3.0 * rounding)
    first, last = np.searchsorted(values, [values[index] - reach, values[index] + reach])
    near = np.sort(np.concatenate([[0, 0], counts[first:index], counts[index + 1 : last]]))
    return bool(counts[index] >= _SPIKE * near[-2])


def _beams_change(holds: Sequence[BoolArray]) -> bool:
    """Return whether a value is at changing beams; the chair's own parts, and the walls of a straight corridor, are not."""
    seen = [hold for hold in holds if hold.any()]
    size = min(len(hold) for hold in seen)
    share = np.mean([hold[:size] for hold in seen], axis=0)
    return bool(share[share < _SELDOM].sum() >= _CHANGING * share.sum())


def _arcs_and_lone(
    views: Sequence[Float32Array], holds: Sequence[BoolArray], value: float, rounding: float, angle_step: float
) -> tuple[bool, bool]:
    """Return whether a good part of a value's beams lie in runs too wide for a flat surface, and in runs too lonely for any.

    A flat surface at distance d gives rounded ranges of d over at most +-acos(d / (d + rounding)).
    """
    widest = 2.0 * math.acos(value / (value + max(rounding, 1e-4))) + 2.0 * abs(angle_step)
    total, arcs, lone = 0, 0, 0
    for view, hold in zip(views, holds, strict=True):
        if not hold.any():
            continue
        edges = np.flatnonzero(np.diff(np.concatenate([[False], hold, [False]]).astype(np.int8)))
        for first, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            count = end - first
            total += count
            arcs += count * (count * abs(angle_step) > widest)
            lone += count * (count <= 2 and _far(view, first - 1, value) and _far(view, end, value))
    return arcs >= _UNEXPLAINED * total, lone >= _UNEXPLAINED * total


def _far(view: Float32Array, index: int, value: float) -> bool:
    """Return whether a beam beside a value measures something far from it, or nothing; true at the ends of a scan."""
    if not 0 <= index < len(view) or not np.isfinite(view[index]):
        return True
    return abs(float(view[index]) - value) > _JUMP
