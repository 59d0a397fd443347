"""Where people will be: occupancy over a time window, and whether to wait for them or to go round.

The source paper names as its own weakness that somebody who crosses far ahead re-routes the chair sideways or even
backwards, and as its remedy an occupancy that reflects a time window into the future. Here each cell holds the share of
that window for which somebody is expected on it; it makes the cell dearer, never impassable. And a way round is taken
only where it gets there sooner than waiting does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from waychair.config import Settings, setting
from waychair.geometry import arc_lengths, transform_points
from waychair.maps.grid import cells_where
from waychair.planning.costmap import Costmap
from waychair.planning.grid_graph import MAX_PRICE
from waychair.planning.tracks import Track
from waychair.types import Float32Array, FloatArray, OccupancyGrid


@dataclass(frozen=True, slots=True)
class ForecastSettings(Settings):
    """How far ahead people are expected to go on, and what being in their way is worth."""

    window: float = setting(4.0, "s", "of time looked ahead; 0: nobody is foreseen", low=0.0, high=60.0)
    step: float = setting(0.2, "s", "between two looks", low=0.02, high=5.0)
    stays: float = setting(
        10.0, "s", "who is in the way all the time is expected to be for so long", low=0.0, high=600.0
    )
    dearer: float = setting(20.0, "", "times the price where somebody is expected all the time", low=0.0, high=900.0)

    def looks(self) -> FloatArray:
        """(T,) the times [s] in the window that are looked at, from now on."""
        return np.arange(0.0, self.window + 1e-9, self.step) if self.window else np.empty(0)


@dataclass(frozen=True, slots=True)
class People:
    """Those who are on their way, as `tracks` in map, and the distance [m] to be kept from the middle of each."""

    tracks: tuple[Track, ...]
    radius: float


def predicted_occupancy(
    people: People, grid: OccupancyGrid, settings: ForecastSettings = ForecastSettings()
) -> Float32Array:
    """(H, W) in [0, 1]: the share of the window for which somebody is within their radius of a cell's middle.

    They go on as they go. How uncertain their speed is widens what they may take up by one sigma; the share is less by
    as much as the disc is larger, as they are somewhere in it.
    """
    share = np.zeros(grid.cells.shape, np.float32)
    grid_from_map = grid.map_from_grid.inverse()
    looks = settings.looks()
    for track in people.tracks:
        middles = transform_points(grid_from_map, track.after(looks)) / grid.resolution
        radii = (people.radius + looks * track.speed_sigma) / grid.resolution
        low = np.clip(np.floor((middles - radii[:, None]).min(axis=0)).astype(int), 0, share.shape[::-1])
        high = np.clip(np.ceil((middles + radii[:, None]).max(axis=0)).astype(int) + 1, low, share.shape[::-1])
        x, y = np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1])[:, None] + 0.5
        taken = np.zeros((high[1] - low[1], high[0] - low[0]))
        for (middle_x, middle_y), radius in zip(middles.tolist(), radii.tolist(), strict=True):
            within = (x - middle_x) ** 2 + (y - middle_y) ** 2 <= radius**2
            taken += within * ((people.radius / (radius * grid.resolution)) ** 2 / len(looks))
        part = share[low[1] : high[1], low[0] : high[0]]
        part[:] = 1 - (1 - part) * (1 - np.minimum(taken, 1))
    return share


def with_forecast(
    costmap: Costmap, occupancy: Float32Array, settings: ForecastSettings = ForecastSettings()
) -> Costmap:
    """The costmap with cells (H, W) dearer by how much of the time somebody is expected there; none gets impassable.

    The harmonic field takes the price as absorption, so that the prediction bends it as it bends D* Lite's way.
    """
    prices, expected = costmap.prices.copy(), tuple(cells_where(occupancy > 0.0).T)
    dearer = prices[expected] * (1.0 + settings.dearer * occupancy[expected].astype(np.float64))
    prices[expected] = np.minimum(np.rint(dearer), MAX_PRICE).astype(np.int32)
    return replace(costmap, prices=prices)


def arrival(
    people: People, points: FloatArray, cruise: float, settings: ForecastSettings = ForecastSettings()
) -> tuple[float, float]:
    """When a path of points (N, 2) [m] in map is done at a speed [m/s], and how much of that is waiting at its start [s].

    One waits until the whole way can be gone without meeting anybody, who go on as they go. Of whoever is met however
    long one waits within the window nothing is known but that: they are waited for as long as somebody `stays`.
    """
    along = arc_lengths(points) / cruise
    longest = float(along[-1])
    if not people.tracks or not settings.window:
        return longest, 0.0
    for wait in settings.looks().tolist():
        if not _meets(people, points, wait + along):
            return longest + wait, wait
    return longest + settings.stays, settings.stays


def _meets(people: People, points: FloatArray, seconds: FloatArray) -> bool:
    """Whether somebody is too near to one of points (N, 2) after so many seconds (N,)."""
    return any(bool((np.hypot(*(points - each.after(seconds)).T) <= people.radius).any()) for each in people.tracks)
