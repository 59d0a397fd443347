"""Figures of the chair's page for engineers."""

from __future__ import annotations

import resource

from waychair.ros.messages.chair import DriveReport, DriveRequest
from waychair.slam.localising.localisation import Localisation
from waychair.types import OccupancyGrid


def figures(
    now_ns: int,
    request: DriveRequest,
    located: tuple[int, Localisation] | None,
    state: DriveReport | None,
    grid: OccupancyGrid | None,
) -> dict[str, float]:
    """Return the figures by their names with units, of the latest messages."""
    found = {
        "plans of this drive": float(request.plans),
        "memory of this page's process, peak [MB]": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
    }
    if located is not None:
        found["place, age [ms]"] = (now_ns - located[0]) * 1e-6
        found["share of the scan on walls"] = located[1].inliers
    if state is not None:
        found["bridge, age [ms]"] = (now_ns - state.stamp_ns) * 1e-6
        found["lean, sideways [rad]"], found["lean, ahead [rad]"] = state.tilt
    if grid is not None:
        found["cells of the map"] = float(grid.cells.size)
    return found
