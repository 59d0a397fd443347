"""Prediction of people: occupancy over a time window, and whether to wait for them or to drive around.

The source paper names a weakness: somebody crossing far ahead re-routes the chair sideways or even backwards. Its
remedy is an occupancy over a time window into the future. Here each cell holds the share of that window for which
somebody is expected on it; that raises the cell's price but never makes it impassable. A path around people is taken
only where it is faster than waiting.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from waychair.config import Settings, setting
from waychair.geometry import arc_lengths, transform_points
from waychair.maps.grid.cells import cells_where
from waychair.planning.grid.costmap import Costmap
from waychair.planning.grid.grid_graph import MAX_PRICE
from waychair.planning.seen.person_tracks import Track
from waychair.types import Float32Array, FloatArray, OccupancyGrid


@dataclass(frozen=True, slots=True)
class ForecastSettings(Settings):
    """How far ahead people are predicted."""

    window: float = setting(
        4.0,
        "s",
        "time over which the global planner predicts people, 0 for never; larger: detours round farther people",
        low=0.0,
        high=60.0,
    )

    def times(self) -> FloatArray:
        """Return (T,) the sampled times [s] in the window, from now on."""
        return np.arange(0.0, self.window + 1e-9, STEP_S) if self.window else np.empty(0)


STEP_S = 0.2
"""[s] Time between two predicted places: somebody walks less than the radius kept from them."""

STAYS_S = 10.0
"""[s] Expected wait for somebody who blocks the path over the whole window."""

PRICE_FACTOR = 20.0
"""A cell's price rises by this times the share of the window for which somebody is expected there."""


@dataclass(frozen=True, slots=True)
class ExpectedPeople:
    """Moving people as `tracks` in map, and the distance [m] to keep between the path and the middle of each."""

    tracks: tuple[Track, ...]
    radius: float


def predicted_occupancy(
    people: ExpectedPeople, grid: OccupancyGrid, settings: ForecastSettings = ForecastSettings()
) -> Float32Array:
    """Return (H, W) in [0, 1]: the share of the window for which somebody is within their radius of a cell's middle.

    People move at constant velocity. Their disc grows by one sigma of their speed; the share falls as the disc's area
    grows, since they are somewhere in it.
    """
    share = np.zeros(grid.cells.shape, np.float32)
    grid_from_map = grid.map_from_grid.inverse()
    times = settings.times()
    for track in people.tracks:
        middles = transform_points(grid_from_map, track.after(times)) / grid.resolution
        radii = (people.radius + times * track.speed_sigma) / grid.resolution
        low = np.clip(np.floor((middles - radii[:, None]).min(axis=0)).astype(int), 0, share.shape[::-1])
        high = np.clip(np.ceil((middles + radii[:, None]).max(axis=0)).astype(int) + 1, low, share.shape[::-1])
        x, y = np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1])[:, None] + 0.5
        taken = np.zeros((high[1] - low[1], high[0] - low[0]))
        for (middle_x, middle_y), radius in zip(middles.tolist(), radii.tolist(), strict=True):
            within = (x - middle_x) ** 2 + (y - middle_y) ** 2 <= radius**2
            taken += within * ((people.radius / (radius * grid.resolution)) ** 2 / len(times))
        part = share[low[1] : high[1], low[0] : high[0]]
        part[:] = 1 - (1 - part) * (1 - np.minimum(taken, 1))
    return share


def with_forecast(costmap: Costmap, occupancy: Float32Array) -> Costmap:
    """Return the costmap with prices raised by the expected occupancy (H, W); no cell becomes impassable.

    The harmonic field takes prices as absorption, so the prediction bends its paths as it bends D* Lite's.
    """
    prices, expected = costmap.prices.copy(), tuple(cells_where(occupancy > 0.0).T)
    dearer = prices[expected] * (1.0 + PRICE_FACTOR * occupancy[expected].astype(np.float64))
    prices[expected] = np.minimum(np.rint(dearer), MAX_PRICE).astype(np.int32)
    return replace(costmap, prices=prices)


def arrival(
    people: ExpectedPeople, points: FloatArray, cruise: float, settings: ForecastSettings = ForecastSettings()
) -> tuple[float, float]:
    """Return the time [s] to drive a path (N, 2) [m] in map at a speed [m/s], and the wait [s] at its start in that.

    The chair waits until it can drive the whole path without meeting any predicted person. If no wait within the window
    is enough, it is expected to wait for `STAYS_S`.
    """
    along = arc_lengths(points) / cruise
    longest = float(along[-1])
    if not people.tracks or not settings.window:
        return longest, 0.0
    for wait in settings.times().tolist():
        if not _meets(people, points, wait + along):
            return longest + wait, wait
    return longest + STAYS_S, STAYS_S


def meets_soon(people: ExpectedPeople, points: FloatArray, cruise: float, settings: ForecastSettings) -> bool:
    """Return whether a drive along a path (N, 2) [m] in map at a speed [m/s] is expected to meet somebody in the window."""
    seconds = arc_lengths(points) / cruise
    within = seconds <= settings.window
    return _meets(people, points[within], seconds[within])


def _meets(people: ExpectedPeople, points: FloatArray, seconds: FloatArray) -> bool:
    """Return whether somebody is too near to one of points (N, 2) at its time (N,) [s]."""
    return any(bool((np.hypot(*(points - each.after(seconds)).T) <= people.radius).any()) for each in people.tracks)
