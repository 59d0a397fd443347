"""The unit and the limits of a lidar's ranges, from what it measures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.recordings.plausibility.told_scans import ToldScan
from waychair.types import Float32Array

UNITS = {1.0: "metres", 1e-3: "millimetres", 1e-2: "centimetres", 1e3: "kilometres"}
"""Metres in a unit, and its name; the likelier unit first."""

FAR_UNITS = {0.3048: "feet", 0.0254: "inches", **{unit: UNITS[unit] for unit in (1e-2, 1e-3)}}
"""Units that are tried where the usual range in metres is that of a hall: only motion tells them from metres."""

FAR = 25.0
"""m; a median range from which on another unit is tried."""

_TYPICAL = (0.15, 100.0)  # m; a median range outside is that of no lidar in a building
_LONGEST_REACH = 300.0  # m; a longer `range_max` is in another unit
_SAMPLE = 200  # scans that are looked at
_CODE_SHARE = 0.1  # of all ranges; a value that frequent is a code, and tells nothing about the unit
_BEYOND = 0.5  # share of different ranges outside a limit that refute it
_CODES = 3  # different ranges at most in a scan that saw nothing
_WITHIN = 0.9  # share of the ranges between two limits that are exchanged
_ODD = 50.0  # times the median; a scan of which nine tenths are so far off is of another unit than the others


@dataclass(frozen=True, slots=True)
class RangeLimits:
    """The least and largest range [m], and how they differ from the fields; an empty text if they do not."""

    least: float
    most: float
    text: str = ""


def sampled_ranges(told: Sequence[ToldScan]) -> Float32Array:
    """Return finite ranges (N,) as told of a sample of the scans, without values that very many beams share."""
    sample = told[:: max(1, len(told) // _SAMPLE)]
    ranges = np.concatenate([scan.distances() for scan in sample]) if sample else np.zeros(0, np.float32)
    values, inverse, counts = np.unique(ranges, return_inverse=True, return_counts=True)
    rare: Float32Array = ranges[counts[inverse] <= max(_CODE_SHARE * len(ranges), 10)]
    return rare if len(rare) else values


def possible_units(ranges: Float32Array, range_max: float) -> tuple[float, ...]:
    """Return the units of `UNITS` in which ranges (N,) are those of a lidar, the likelier first; metres alone if they fit."""
    if not len(ranges):
        return (1.0,)
    typical, far = float(np.median(ranges)), float(np.quantile(ranges, 0.99))
    fitting = [unit for unit in UNITS if _TYPICAL[0] <= typical * unit <= _TYPICAL[1]]
    reach = range_max if 0.0 < range_max <= _LONGEST_REACH else math.inf
    within = [unit for unit in fitting if far * unit <= 1.1 * reach]
    if math.isfinite(reach):
        within.sort(reverse=True)  # most lidars are bought for about the reach that is used
    if 1.0 in within or (1.0 in fitting and not within):
        return (1.0,)
    return tuple(within or fitting)


def range_limits(ranges: Float32Array, range_min: float, range_max: float, unit: float) -> RangeLimits:
    """Return the limits that hold for ranges (N,) [m]; `unit` is the one in which the ranges were told."""
    least = range_min if math.isfinite(range_min) and range_min > 0.0 else 0.0
    most = range_max if range_max > 0.0 else math.inf
    texts: list[str] = []
    if not len(ranges):
        return RangeLimits(least, most) if least <= most else RangeLimits(0.0, math.inf)
    if unit < 1.0 and (most > _LONGEST_REACH or least > 1.0):
        least, most = least * unit, most * unit  # in the same unit as the ranges
    elif _LONGEST_REACH < most <= 1e3 * _LONGEST_REACH and float(np.quantile(ranges, 0.99)) <= 1.1e-3 * most:
        least, most = (least * 1e-3 if least > 1.0 else least), most * 1e-3
        texts.append("range_max is in millimetres")
    if least > most and float(((ranges >= most) & (ranges <= least)).mean()) >= _WITHIN:
        least, most = most, least
        texts.append("range_min and range_max are exchanged")
    if least > 1.0 and float((ranges < least).mean()) >= _BEYOND and least <= 1e3:
        least *= 1e-3
        texts.append("range_min is in millimetres")
    if least > most:
        least, most = 0.0, math.inf
        texts.append("range_min and range_max are contradictory, and left out of account")
    if float((ranges < least).mean()) >= _BEYOND:
        texts.append(f"most ranges are below range_min of {least:g} m, which is left out of account")
        least = 0.0
    if float((ranges > most).mean()) >= _BEYOND:
        texts.append(f"most ranges are above range_max of {most:g} m, which is left out of account")
        most = math.inf
    return RangeLimits(least, most, "; ".join(texts))


def is_odd(scan: ToldScan, typical: float) -> bool:
    """Return whether a scan's ranges are of another unit than those of a topic with the `typical` median."""
    distances = scan.distances()
    if len(np.unique(distances)) <= _CODES:  # codes only
        return False
    low, high = np.quantile(distances, (0.1, 0.9)).tolist()
    return bool(low > typical * _ODD or high < typical / _ODD)
