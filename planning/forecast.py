"""Where people will be: occupancy over a time window, and whether to wait for them or to go round.

The source paper names as its own weakness that somebody who crosses far ahead re-routes the chair sideways or even
backwards, and as its remedy an occupancy that reflects a time window into the future. Here each cell holds the share of
that window for which somebody is expected on it; it makes the cell dearer, never impassable. And a way round is taken
only where it costs less time than waiting does.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from waychair.config import Settings, setting
from waychair.geometry import transform_points
from waychair.planning.costmap import Costmap
from waychair.planning.grid_graph import MAX_PRICE
from waychair.planning.tracks import Track
from waychair.types import Float32Array, FloatArray, OccupancyGrid


@dataclass(frozen=True, slots=True)
class ForecastSettings(Settings):
    """How far ahead people are expected to go on, and what being in their way is worth."""

    window: float = setting(4.0, "s", "of time looked ahead", low=0.1, high=60.0)
    step: float = setting(0.2, "s", "between two looks", low=0.02, high=5.0)
    room: float = setting(0.3, "m", "kept round a person, beyond the chair's half width", low=0.0, high=2.0)
    dearer: float = setting(20.0, "", "times the price where somebody is expected all the time", low=0.0, high=900.0)


def predicted_occupancy(
    tracks: Iterable[Track], grid: OccupancyGrid, radius: float, settings: ForecastSettings = ForecastSettings()
) -> Float32Array:
    """(H, W) in [0, 1]: the share of the window for which somebody is within `radius` [m] of a cell's middle.

    `tracks` are in the grid's map; they go on as they go. How uncertain their speed is widens what they may take up by
    one sigma; the share is less by as much as the disc is larger, as they are somewhere in it.
    """
    share = np.zeros(grid.cells.shape, np.float32)
    looks = np.arange(0.0, settings.window + 1e-9, settings.step)
    grid_from_map = grid.map_from_grid.inverse()
    for track in tracks:
        taken = np.zeros_like(share)
        for seconds in looks:
            x, y, _, _, _, grows = track.row(float(seconds)).tolist()
            middle = transform_points(grid_from_map, np.array([[x, y]]))[0] / grid.resolution
            wide = radius + seconds * grows
            _add_disc(taken, middle, wide / grid.resolution, (radius / wide) ** 2 / len(looks))
        share = 1 - (1 - share) * (1 - np.minimum(taken, 1))
    return share.astype(np.float32)


def _add_disc(into: Float32Array, middle: FloatArray, radius: float, value: float) -> None:
    low = np.maximum(np.floor(middle - radius).astype(int), 0)
    high = np.minimum(np.ceil(middle + radius).astype(int) + 1, into.shape[::-1])
    if (low >= high).any():
        return
    x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
    within = np.hypot(x - middle[0], y - middle[1]) <= radius
    into[low[1] : high[1], low[0] : high[0]] += np.float32(value) * within


def with_forecast(
    costmap: Costmap, occupancy: Float32Array, settings: ForecastSettings = ForecastSettings()
) -> Costmap:
    """The costmap with cells (H, W) dearer by how much of the time somebody is expected there; none gets impassable.

    The harmonic field takes the price as absorption, so that the prediction bends it as it bends D* Lite's way.
    """
    dearer = costmap.prices * (1.0 + settings.dearer * occupancy.astype(np.float64))
    return replace(costmap, prices=np.minimum(np.rint(dearer), MAX_PRICE).astype(np.int32))


def waits(direct_m: float, round_m: float, wait_s: float, cruise: float) -> bool:
    """Whether to wait `wait_s` [s] and go the direct way [m] rather than the way round [m], both at `cruise` [m/s].

    With no way round (infinite) it waits; for a wait without end (infinite) it does not, unless there is no other way.
    """
    return math.isinf(round_m) or wait_s <= (round_m - direct_m) / cruise


def passing_time(tracks: Iterable[Track], points: FloatArray, radius: float, settings: ForecastSettings) -> float:
    """Time [s] until nobody is expected within `radius` [m] of a path's points (N, 2) in map, inf beyond the window.

    0 where nobody is in the way now or in the window.
    """
    clear_at = 0.0
    looks = np.arange(0.0, settings.window + 1e-9, settings.step)
    for track in tracks:
        for seconds in looks:
            at = track.row(float(seconds))[:2]
            if np.hypot(*(points - at).T).min(initial=math.inf) <= radius:
                clear_at = max(clear_at, float(seconds) + settings.step)
    return math.inf if clear_at > settings.window else clear_at
