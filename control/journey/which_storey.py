"""Which storey a lift has stopped at, by all that is known: the stop asked for, the ride, the map, other words, the rider's.

Each kind of evidence adds log-odds to each stop. None may decide alone against all the others, and the map may not decide
between storeys that look alike.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from waychair.types import FloatArray, OccupancyGrid, Pose2

ASKED = 0.6
"""Probability, before any other evidence, that the lift stops next where it was asked to; others share the rest."""

OUTLIER = 1e-3
"""Probability that the measured climb means nothing."""

MISFIT = math.log(2.0 * OUTLIER)
"""Log-likelihood below which a climb leads to no stop: 3.7 standard deviations away from it."""

WORD = 1000.0
"""Odds by which the word of the rider, an adapter or a tag counts."""

MOST_BY_MAP = 500.0
"""Largest odds between two storeys by what is seen through the door."""

ALIKE = 1.5
"""Log-odds within which two storeys look alike, so that the map tells nothing between them."""

DECIDED, MARGIN = 0.99, 0.95
"""A chair goes on by itself at this probability and this margin over the second stop."""

_AGREES, _SHORT, _LONG = math.log(0.7), math.log(0.25), math.log(0.05)
"""Log-likelihoods of a beam that ends on the map's wall, before it on something new, or beyond it."""

_INDEPENDENT = 12.0
"""Beams through a doorway count as so many independent ones at most: neighbours see the same things."""


@dataclass(frozen=True, slots=True)
class StopEvidence:
    """What is known of a lift's stop: the heights [m] of all its stops, also of those without a map, the one where the ride
    began and the one asked for.

    `climb` and `pressure`: height and deviation [m] by the IMU and by a barometer; None without. `match`: log-likelihoods
    of the storeys by what the lidar sees through the door. `told`: a lift adapter's or a tag's word. `rider`: the rider's.
    """

    heights: Mapping[str, float]
    began: str
    asked: str
    climb: tuple[float, float] | None = None
    pressure: tuple[float, float] | None = None
    match: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    told: str | None = None
    rider: str | None = None


def probabilities(known: StopEvidence) -> dict[str, float]:
    """Return the probability of each stop; all are equal, but for words, if a measured climb leads to none of them.

    Such a lift stands where nobody knows a stop, and neither a wish nor a likeness of walls may decide.
    """
    stops = list(known.heights)
    others = max(len(stops) - 1, 1)
    odds = {stop: math.log(ASKED if stop == known.asked else (1.0 - ASKED) / others) for stop in stops}
    is_known = True
    for measured in (known.climb, known.pressure):
        if measured is not None:
            of_climb = {s: _of_climb(known.heights[s] - known.heights[known.began], measured) for s in stops}
            is_known = is_known and max(of_climb.values()) > MISFIT
            odds = {stop: odds[stop] + of_climb[stop] for stop in stops}
    for stop, seen in without_alike(known.match).items():
        odds[stop] += seen
    if not is_known:
        odds = dict.fromkeys(stops, 0.0)
    for word in (known.told, known.rider):
        if word in odds:
            odds[word] += math.log(WORD)
    most = max(odds.values())
    weights = {stop: math.exp(each - most) for stop, each in odds.items()}
    total = sum(weights.values())
    return {stop: weight / total for stop, weight in weights.items()}


def decided(chances: Mapping[str, float]) -> str | None:
    """Return the stop that is certain enough to drive on its map; None: ask the rider."""
    ranked = sorted(chances, key=lambda stop: -chances[stop])
    if not ranked or chances[ranked[0]] < DECIDED:
        return None
    second = chances[ranked[1]] if len(ranked) > 1 else 0.0
    return ranked[0] if chances[ranked[0]] - second >= MARGIN else None


def without_alike(match: Mapping[str, float]) -> dict[str, float]:
    """Return log-likelihoods within the largest odds, and equal where storeys look alike to the best one."""
    if not match:
        return {}
    best = max(match.values())
    return {
        stop: 0.0 if best - each < ALIKE else max(each - best, -math.log(MOST_BY_MAP)) for stop, each in match.items()
    }


def seen_through_door(
    grid: OccupancyGrid, map_from_laser: Pose2, angles: FloatArray, ranges: FloatArray, reach: float = 10.0
) -> float:
    """Return the log-likelihood of beams, angles (N,) [rad] and ranges (N,) [m], from a pose on a storey's map."""
    if not len(angles):
        return 0.0
    expected = _expected(grid, map_from_laser, angles, reach)
    read = np.minimum(ranges, reach)
    slack = 0.15 + 0.03 * expected
    each = np.where(np.abs(read - expected) <= slack, _AGREES, np.where(read < expected, _SHORT, _LONG))
    return float(each.mean() * min(_INDEPENDENT, len(angles) / 2))


def _expected(grid: OccupancyGrid, map_from_laser: Pose2, angles: FloatArray, reach: float) -> FloatArray:
    """Return the ranges (N,) [m] to the map's first occupied or unknown cell, at most `reach`."""
    from_map = grid.map_from_grid.inverse() @ map_from_laser
    step = grid.resolution / 2
    ways = np.arange(0.3, reach, step)
    heading = angles[:, None] + from_map.theta
    cols = np.floor((from_map.x + ways * np.cos(heading)) / grid.resolution).astype(np.int64)
    rows = np.floor((from_map.y + ways * np.sin(heading)) / grid.resolution).astype(np.int64)
    inside = (rows >= 0) & (cols >= 0) & (rows < grid.cells.shape[0]) & (cols < grid.cells.shape[1])
    cells = np.full(rows.shape, 100, np.int8)
    cells[inside] = grid.cells[rows[inside], cols[inside]]
    solid = (cells >= 65) | (cells < 0)
    first = np.where(solid.any(axis=1), solid.argmax(axis=1), len(ways) - 1)
    found: FloatArray = ways[first]
    return found


def _of_climb(height: float, measured: tuple[float, float]) -> float:
    """Return the log-likelihood of a measured climb if the true one is `height` [m]."""
    climb, sigma = measured
    inlier = math.exp(-0.5 * min(((climb - height) / sigma) ** 2, 1400.0))
    return math.log((1.0 - OUTLIER) * inlier + OUTLIER)


def climb_from_pressure(before: float, now: float, seconds: float) -> tuple[float, float]:
    """Return the climb [m] and its deviation from two pressures [Pa], `seconds` apart: 12 Pa a metre, and weather drifts."""
    return -(now - before) / 12.0, 0.3 + 0.002 * seconds
