"""The ends of a route as people type them: a place, a node, or a pose on a storey, which joins the graph by driving."""

from __future__ import annotations

from dataclasses import dataclass

from waychair.calibration.chair_body import ChairBody
from waychair.errors import BuildingError
from waychair.maps.building.building import Building
from waychair.maps.building.hgraph import NodeRef
from waychair.maps.drawn.zones import load_zones
from waychair.maps.folders.map_files import load_map
from waychair.planning.building.hierarchical import RoutePlanner
from waychair.planning.building.pose_ends import nearest_node
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.pose_text import POSE_SHAPE, NoPoseText, is_like_pose, pose_from_text


@dataclass(frozen=True, slots=True)
class RouteEnd:
    """An end of a route: its node, and the cost [m of straight driving] between the pose and the node; 0 at a node."""

    node: NodeRef
    aside: float = 0.0


def route_end(building: Building, planner: RoutePlanner, text: str, body: ChairBody) -> RouteEnd:
    """Return the end that a text names: `X,Y@STOREY`, a place such as `Ground/West/Bed`, or a node such as `g/west:n3`.

    A building of one storey needs no `@STOREY`. The node of a pose is the nearest one by driving, never through a wall.

    Raises:
        BuildingError: there is no such place, node or storey, the storey has no map, or the pose is none.
        MapError, ZoneError: the storey's map folder is damaged.
        PlanningError: the chair cannot stand at the pose.
        NoPath: no node can be reached from there.
    """
    point, at, storey = text.rpartition("@")
    if not at:
        point, storey = text, ""
    if not is_like_pose(point):
        return RouteEnd(planner.node(text))
    try:
        pose = pose_from_text(point.strip())
    except NoPoseText as error:
        raise BuildingError(f"'{text}' is no pose: write {POSE_SHAPE}, then @STOREY") from error
    key = _storey(building, text, storey.strip())
    folder = building.map_folder(key)
    if folder is None:
        raise BuildingError(f"storey '{key}' has no map in which {point} lies: add one, or name a place")
    costmap = costmap_from_grid(load_map(folder), body, zones=load_zones(folder))
    return RouteEnd(*nearest_node(planner.hgraph, key, pose, costmap))


def _storey(building: Building, text: str, named: str) -> str:
    """Return the id of the storey of that id or name; the only one if none is named."""
    storeys = building.hgraph.storeys
    known = [each.id for each in storeys if not named or named in (each.id, each.name)]
    if len(known) == 1:
        return known[0]
    names = ", ".join(each.id for each in storeys)
    if named:
        raise BuildingError(f"there is no storey '{named}': it has {names}")
    raise BuildingError(f"'{text}' names no storey: write {text}@STOREY with one of {names}")
