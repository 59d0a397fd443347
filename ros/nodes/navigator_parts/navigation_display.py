"""Topics that RViz and Foxglove display during a drive, under Nav2's names; no node of the chair uses them to drive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.control.drive.navigator import Navigation, Navigator
from waychair.geometry import transform_points
from waychair.maps.grid.cells import OCCUPIED_FROM
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.grid.costmap import Costmap
from waychair.planning.grid.grid_graph import MAX_PRICE
from waychair.ros import topics
from waychair.ros.messages.maps import occupancy_grid
from waychair.ros.messages.motion import path, points, polygon
from waychair.ros.nodes.node import ChairNode
from waychair.types import UNKNOWN, OccupancyGrid, Path, Pose2

_PEOPLE_EVERY, _NEAR_EVERY = 2, 10  # ticks
_LOOK_HZ, _PLAN_NS = 1.0, 1_000_000_000
_EMPTY_PATH = Path(np.empty((0, 3)))
_OCCUPIED, _CLOSED, _DEAREST = 100, 99, 98
_SCALING, _INFLATION = 3.0, 0.7
"""Decay of the cost with distance [1/m], and inflation radius [m]: the values of nav2_bringup."""


class NavigationDisplay:
    """The topics plan, local_plan, people, global_costmap/costmap, local_costmap/costmap and .../published_footprint.

    The costmaps, which are expensive, are made only while there are subscribers.
    """

    def __init__(self, node: ChairNode[Any], body: ChairBody) -> None:
        self._node, self._body = node, body
        self._ticks = 0
        self._plan, self._plan_ns, self._has_local = _EMPTY_PATH, 0, False  # as published last
        self._make_costmap: Callable[[], Costmap] | None = None  # makes the costmap that was not published yet
        self._send_plan, self._send_local = node.publisher(topics.PLAN), node.publisher(topics.LOCAL_PLAN)
        self._send_people, self._send_costmap = node.publisher(topics.PEOPLE), node.publisher(topics.GLOBAL_COSTMAP)
        self._send_footprint = node.publisher(topics.FOOTPRINT)
        self._send_near = node.publisher(topics.LOCAL_COSTMAP)
        node.every(_LOOK_HZ, self._update_costmap)

    def draw(self, make_costmap: Callable[[], Costmap]) -> None:
        """Take the function that makes the costmap of a changed map; it runs in the worker once there is a subscriber."""
        self._make_costmap = make_costmap

    def show(
        self, navigation: Navigation, navigator: Navigator, map_from_odom: Pose2, odom_from_base: Pose2 | None
    ) -> None:
        """Publish the result of a tick of the navigator."""
        self._ticks += 1
        now_ns, odom = self._node.now_ns(), topics.ODOMETRY.frame
        self._publish_plan(now_ns, navigation.path if navigator.active else None)
        if self._ticks % _PEOPLE_EVERY == 0:
            self._send_people(points(now_ns, transform_points(map_from_odom, navigator.people)))
        if self._ticks % _NEAR_EVERY == 0 and self._is_watched(topics.LOCAL_COSTMAP):
            near = grid_from_distances(navigator.local_distances, self._body)
            near = replace(near, map_from_grid=map_from_odom.inverse() @ near.map_from_grid)
            self._send_near(occupancy_grid(now_ns, near, odom))
        if odom_from_base is not None:
            self._send_footprint(polygon(now_ns, transform_points(odom_from_base, self._body.outline()), odom))
        choice = navigation.choice
        if choice is not None and navigation.driving and len(choice.arc) > 1:
            self._send_local(path(now_ns, Path(np.asarray(choice.arc, np.float64)), odom))
            self._has_local = True
        if not navigator.active:
            self.clear()

    def clear(self) -> None:
        """Publish empty plans, since no drive is in progress."""
        now_ns = self._node.now_ns()
        self._publish_plan(now_ns, None)
        if self._has_local:
            self._send_local(path(now_ns, _EMPTY_PATH, topics.ODOMETRY.frame))
            self._has_local = False

    def _publish_plan(self, now_ns: int, way: Path | None) -> None:
        """Publish the plan on change and periodically for late subscribers; an empty one after the drive."""
        way = way or _EMPTY_PATH
        again = len(way.poses) > 0 and abs(now_ns - self._plan_ns) > _PLAN_NS
        if way is not self._plan or again:
            self._send_plan(path(now_ns, way))
            self._plan, self._plan_ns = way, now_ns

    def _update_costmap(self) -> None:
        """Make and publish the costmap if it has a subscriber; it is latched for later ones."""
        make_costmap = self._make_costmap
        if make_costmap is None or not self._is_watched(topics.GLOBAL_COSTMAP):
            return
        self._make_costmap = None
        self._node.worker.submit(lambda: grid_from_costmap(make_costmap()), self._publish_costmap)

    def _is_watched(self, topic: topics.RosTopic) -> bool:
        return bool(self._node.count_subscribers(self._node.resolve_topic_name(topic.name)) > 0)

    def _publish_costmap(self, grid: OccupancyGrid) -> None:
        self._send_costmap(occupancy_grid(self._node.now_ns(), grid))


def grid_from_costmap(costmap: Costmap) -> OccupancyGrid:
    """Return a costmap in the percentages of Nav2's Costmap2DPublisher, for which RViz has a colour map.

    100 is a wall, 99 a cell that the chair's centre cannot occupy, -1 unknown, and 0 to 98 the cost, scaled from the
    cheapest to the most expensive cell (nav2_costmap_2d, Costmap2DPublisher).
    """
    prices, known = costmap.prices, costmap.grid.cells
    cheapest, dearest = int(prices[prices > 0].min(initial=MAX_PRICE)), int(prices.max(initial=0))
    shares = (prices - cheapest) / max(dearest - cheapest, 1)
    cells = np.where(prices > 0, np.rint(_DEAREST * shares), _CLOSED).astype(np.int8)
    cells[known == UNKNOWN] = UNKNOWN
    cells[known >= OCCUPIED_FROM] = _OCCUPIED
    return OccupancyGrid(cells, costmap.grid.resolution, costmap.grid.map_from_grid)


def grid_from_distances(near: DistanceField, body: ChairBody) -> OccupancyGrid:
    """Return the obstacles around the chair as a costmap like that of Nav2's inflation layer, on the field's grid.

    100 is an obstacle, 99 a cell where the chair's inscribed circle (radius r) does not fit. Beyond r, the cost at
    distance d is 98 exp(-k (d - r)), and 0 from the inflation radius on (nav2_costmap_2d, `InflationLayer::computeCost`,
    in the percentages of `Costmap2DPublisher`). As in Nav2, distances are between cell centres.
    """
    inscribed, metres = min(body.front, body.rear, body.width / 2), near.to_anything()
    falling = np.rint(_DEAREST * np.exp(-_SCALING * (metres - inscribed)))
    cells = np.where(metres < _INFLATION, falling.clip(0, _DEAREST), 0).astype(np.int8)
    cells[metres <= inscribed] = _CLOSED
    cells[metres == 0.0] = _OCCUPIED
    return OccupancyGrid(cells, near.resolution, near.map_from_grid)
