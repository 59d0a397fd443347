"""The map with everything that the latest scan shows beside it, for steps that lead round new things."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.control.safety.collision_monitor import points_now, valid_beams
from waychair.geometry import transform_points
from waychair.maps.drawn.zones import Zone
from waychair.maps.grid.cells import cells_from_points, inside
from waychair.planning.grid.costmap import Costmap, LiveCostmap
from waychair.types import OccupancyGrid, Pose2, Scan, Twist

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

    def _work(self, seen: tuple[Scan, Pose2, Twist] | None) -> Callable[[], Costmap]:
        grid, zones = self._grid, self._zones

        def costmap() -> Costmap:
            live = self._live
            if live is None:
                live = LiveCostmap(grid, self._body, zones)
                self._live = live if grid is self._grid else None
            if seen is None:
                return live.costmap()
            scan, pose, twist = seen
            return _with_new(live, scan, self._body, pose, twist, scan.stamp_ns)

        return costmap


def _with_new(
    live: LiveCostmap, scan: Scan, body: ChairBody, map_from_base: Pose2, twist: Twist, now_ns: int
) -> Costmap:
    """Return the costmap with everything in a scan that is not on the map; pose and motion are those of `now_ns`."""
    plain = live.costmap()
    beams = valid_beams(scan, np.zeros(len(scan.ranges), np.bool_))
    points = transform_points(map_from_base, points_now(scan, beams, body, twist, now_ns))
    cells = cells_from_points(plain.grid, points)
    new = inside(plain.grid, cells)
    new[new] = plain.clearance[tuple(cells[new].T)] > NEW
    return live.costmap(points[new])
