"""The node that is nearest to a pose by driving, never through a wall: where a route from or to a pose joins the graph."""

from __future__ import annotations

import math

from waychair.errors import NoPath, PlanningError
from waychair.maps.building.hgraph import HGraph, NodeRef
from waychair.planning.grid.costmap import Costmap
from waychair.planning.grid.dstar_lite import DStarLite
from waychair.planning.grid.grid_graph import STRAIGHT
from waychair.planning.route.path_ends import cell_at, start_cell
from waychair.types import Pose2

START_REACH = 0.3
"""[m] How far off the chair may stand from the nearest cell on which it can drive."""


def nearest_node(hgraph: HGraph, storey: str, pose: Pose2, costmap: Costmap) -> tuple[NodeRef, float]:
    """Return the node of a storey that is nearest to a pose by driving, and the cost there [m of straight driving].

    `pose` and `costmap` are in the storey's map. Nodes are asked in the order of their air line, which no drive undercuts,
    so that only a few searches are needed.

    Raises:
        PlanningError: the chair cannot stand at the pose.
        NoPath: no node of the storey can be reached from there.
    """
    here = start_cell(costmap, pose, START_REACH)
    lines = sorted(_air_lines(hgraph, storey, pose))
    search: DStarLite | None = None
    best: tuple[float, NodeRef] | None = None
    for line, point, ref in lines:
        if best is not None and line >= best[0]:
            break
        cell = cell_at(costmap, Pose2(*point))
        if cell is None or costmap.prices[cell] == 0:
            continue
        if search is None:
            search = DStarLite(costmap.prices, here, cell, costmap.barred)
        search.move_start(cell)
        try:
            cost = search.replan() / STRAIGHT * costmap.grid.resolution
        except NoPath:
            continue
        if best is None or cost < best[0]:
            best = cost, ref
    if best is None:
        where = f"({pose.x:.2f}, {pose.y:.2f}) on storey '{storey}'"
        raise NoPath(f"no node of the graph can be reached from {where}: add a node there, or clear the way")
    return best[1], best[0]


def _air_lines(hgraph: HGraph, storey: str, pose: Pose2) -> list[tuple[float, tuple[float, float], NodeRef]]:
    """Return the nodes of a storey with their distances [m] and points in the storey's map.

    Raises:
        PlanningError: the storey has no node.
    """
    found = []
    for path, submap in hgraph.submaps.items():
        if hgraph.storey_of(path) == storey:
            frame = hgraph.map_frame_of(path)
            for node in submap.nodes.values():
                point = frame.point(node.x, node.y)
                found.append((math.dist(point, (pose.x, pose.y)), point, NodeRef(path, node.id)))
    if not found:
        raise PlanningError(f"storey '{storey}' has no node: generate its graph, or draw one")
    return found
