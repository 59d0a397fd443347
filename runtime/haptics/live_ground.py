"""The map with everything that the latest scan shows beside it, for steps that lead round new things."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.control.safety.collision_monitor import points_now, valid_beams
from waychair.errors import PlanningError
from waychair.geometry import transform_points
from waychair.maps.drawn.zones import Zone
from waychair.maps.grid.cells import cells_from_points, inside
from waychair.planning.grid.costmap import Costmap, LiveCostmap
from waychair.planning.grid.drawn_map import DrawnMap
from waychair.planning.route.refused_plans import cause_of
from waychair.resumable import finished
from waychair.types import FloatArray, OccupancyGrid, Pose2, Scan, Twist

NEW = 0.15
"""m; points farther from everything on the map than this are new, and the steps lead round them."""


class LiveGround:
    """One map, and the latest scan on it. `ask` is called where scans come in, its answer in any one thread."""

    def __init__(self, body: ChairBody, grid: OccupancyGrid, zones: Sequence[Zone] = ()) -> None:
        self._body, self._grid, self._zones = body, grid, tuple(zones)
        self._live: LiveCostmap | None = None
        self._seen: tuple[Scan, Pose2, Twist] | None = None

    def redraw(self, grid: OccupancyGrid, zones: Sequence[Zone]) -> None:
        """Take another map; what was seen on the last one is forgotten."""
        self._grid, self._zones, self._live, self._seen = grid, tuple(zones), None, None

    def see(self, scan: Scan, map_from_base: Pose2, twist: Twist) -> None:
        """Take in a scan without the beams that hit the chair itself, with the chair's pose and motion at it."""
        self._seen = scan, map_from_base, twist

    def ask_mapped(self) -> Callable[[], Costmap]:
        """Return the work of making the costmap of the map alone."""
        return self._work(None)

    def ask(self) -> Callable[[], Costmap]:
        """Return the work of making the costmap as it is now; it takes a while."""
        return self._work(self._seen)

    def ask_why(self) -> Callable[[PlanningError, Pose2, Pose2], str]:
        """Return the work of finding why no steps lead from a start to a goal now, in words for somebody who sees no map."""
        grid, zones, seen = self._grid, self._zones, self._seen

        def why(error: PlanningError, start: Pose2, goal: Pose2) -> str:
            drawn = DrawnMap(grid, self._body, zones)
            points = np.empty((0, 2)) if seen is None else _new_points(drawn.costmap(), *seen, self._body)
            cause = finished(cause_of(error, drawn, start, goal, points))
            return cause.spoken if cause is not None and cause.spoken else str(error)

        return why

    def _work(self, seen: tuple[Scan, Pose2, Twist] | None) -> Callable[[], Costmap]:
        grid, zones = self._grid, self._zones

        def costmap() -> Costmap:
            live = self._live
            if live is None:
                live = LiveCostmap(grid, self._body, zones)
                self._live = live if grid is self._grid else None
            if seen is None:
                return live.costmap()
            return live.costmap(_new_points(live.costmap(), *seen, self._body))

        return costmap


def _new_points(plain: Costmap, scan: Scan, map_from_base: Pose2, twist: Twist, body: ChairBody) -> FloatArray:
    """Return what a scan shows that is not on the map, points (N, 2) [m] in map; pose and motion are those at the scan's stamp."""
    beams = valid_beams(scan, np.zeros(len(scan.ranges), np.bool_))
    points = transform_points(map_from_base, points_now(scan, beams, body, twist, scan.stamp_ns))
    cells = cells_from_points(plain.grid, points)
    new = inside(plain.grid, cells)
    new[new] = plain.clearance[tuple(cells[new].T)] > NEW
    return points[new]
