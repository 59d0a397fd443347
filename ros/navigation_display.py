"""What RViz and Foxglove show of a drive, under Nav2's names; no node of the chair obeys any of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.control.navigator import Navigation
from waychair.geometry import transform_points
from waychair.maps.grid import OCCUPIED_FROM
from waychair.planning.costmap import Costmap
from waychair.planning.grid_graph import MAX_PRICE
from waychair.ros import topics
from waychair.ros.messages.maps import occupancy_grid
from waychair.ros.messages.motion import path, points, polygon
from waychair.ros.node import ChairNode
from waychair.types import UNKNOWN, FloatArray, OccupancyGrid, Path, Pose2

_PEOPLE_EVERY = 2  # ticks
_LOOK_HZ = 1.0
_OCCUPIED, _CLOSED, _DEAREST = 100, 99, 98


class NavigationDisplay:
    """The topics plan, local_plan, people, global_costmap/costmap and local_costmap/published_footprint."""

    def __init__(self, node: ChairNode[Any], body: ChairBody) -> None:
        self._node, self._body = node, body
        self._ticks = 0
        self._shown: Path | None = None
        self._priced: Callable[[], Costmap] | None = None  # what has not been shown yet
        self._send_plan, self._send_local = node.publisher(topics.PLAN), node.publisher(topics.LOCAL_PLAN)
        self._send_people, self._send_costmap = node.publisher(topics.PEOPLE), node.publisher(topics.GLOBAL_COSTMAP)
        self._send_footprint = node.publisher(topics.FOOTPRINT)
        self._costmap_name = node.resolve_topic_name(topics.GLOBAL_COSTMAP.name)
        node.every(_LOOK_HZ, self._look)

    def draw(self, priced: Callable[[], Costmap]) -> None:
        """Another map, or other zones on it: what makes its costmap, in the worker's thread, once somebody looks."""
        self._priced = priced

    def show(
        self, navigation: Navigation, people: FloatArray, map_from_odom: Pose2, odom_from_base: Pose2 | None
    ) -> None:
        """A tick of the navigator; `people` (K, 2) [m] in odom."""
        self._ticks += 1
        now_ns, odom = self._node.now_ns(), topics.ODOMETRY.frame
        if navigation.path is not None and navigation.path is not self._shown:
            self._shown = navigation.path
            self._send_plan(path(now_ns, navigation.path))
        if self._ticks % _PEOPLE_EVERY == 0:
            self._send_people(points(now_ns, transform_points(map_from_odom, people)))
        if odom_from_base is not None:
            self._send_footprint(polygon(now_ns, transform_points(odom_from_base, self._body.outline()), odom))
        choice = navigation.choice
        if choice is not None and navigation.driving and len(choice.arc) > 1:
            self._send_local(path(now_ns, Path(np.asarray(choice.arc, np.float64)), odom))

    def _look(self) -> None:
        """Whether somebody wants the costmap; who comes later than others gets the same, for it is latched."""
        priced = self._priced
        if priced is None or self._node.count_subscribers(self._costmap_name) == 0:
            return
        self._priced = None
        self._node.worker.submit(lambda: grid_from_costmap(priced()), self._show_costmap)

    def _show_costmap(self, grid: OccupancyGrid) -> None:
        self._send_costmap(occupancy_grid(self._node.now_ns(), grid))


def grid_from_costmap(costmap: Costmap) -> OccupancyGrid:
    """A costmap in the percentages that Nav2's publisher of costmaps uses, which RViz has colours for.

    100 is a wall, 99 where the chair's middle cannot be, -1 unknown, and 0 to 98 what it costs from the cheapest cell to
    the dearest (nav2_costmap_2d, Costmap2DPublisher).
    """
    prices, known = costmap.prices, costmap.grid.cells
    cheapest, dearest = int(prices[prices > 0].min(initial=MAX_PRICE)), int(prices.max(initial=0))
    shares = (prices - cheapest) / max(dearest - cheapest, 1)
    cells = np.where(prices > 0, np.rint(_DEAREST * shares), _CLOSED).astype(np.int8)
    cells[known == UNKNOWN] = UNKNOWN
    cells[known >= OCCUPIED_FROM] = _OCCUPIED
    return OccupancyGrid(cells, costmap.grid.resolution, costmap.grid.map_from_grid)
