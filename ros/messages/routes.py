"""Messages about a building's graph: routes as Nav2's route server gives them, and the graph as markers for RViz."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waychair.errors import BuildingError
from waychair.maps.building.costs import CLOSED_MM
from waychair.maps.building.graph_arrays import NO_HEADING, Int32Array
from waychair.maps.building.hgraph import HGraph, NodeKind, SubmapFrame
from waychair.maps.building.indexed import IndexedGraph
from waychair.recordings.bags.ros_messages import MAP_FRAME, header, make, point
from waychair.ros.messages.motion import pose
from waychair.types import FloatArray, Path, Pose2

MOST_IDS = 65_535
"""Largest number of a node or edge in nav2_msgs, whose ids are uint16."""

PATH_STEP_M = 0.05
"""Distance [m] between the poses of a route's path: Nav2's `path_density`."""

_LINE_LIST, _SPHERE_LIST, _TEXT = 5, 7, 9
_ADD, _DELETE_ALL = 0, 3
_NODE_M, _LINE_M, _TEXT_M = 0.2, 0.05, 0.3
_NODES, _OPEN, _CLOSED, _NAMES = (0.1, 0.4, 0.9, 1.0), (0.2, 0.7, 0.3, 1.0), (0.9, 0.1, 0.1, 1.0), (0.0, 0.0, 0.0, 1.0)
"""Colours: red, green, blue, opacity."""


def require_ids(built: IndexedGraph) -> None:
    """Refuse a graph whose nodes and arcs have more numbers than nav2_msgs.

    Raises:
        BuildingError: it has more than 65,535 nodes or directed arcs.
    """
    nodes, arcs = len(built.refs), len(built.graph.cost)
    if max(nodes, arcs) > MOST_IDS:
        raise BuildingError(
            f"the building has {nodes} nodes and {arcs} directed arcs, and the ids of nav2_msgs end at {MOST_IDS}: ask "
            "for the route with waychair building route"
        )


def route(stamp_ns: int, built: IndexedGraph, frame: SubmapFrame, start: int, arcs: Int32Array, cost: int) -> Any:
    """Return a nav2_msgs/Route along directed arcs (K,) from a node; the cost [mm] is given there in metres.

    `frame` is that of the navigator's map in the building's.
    """
    nodes = [start, *built.graph.head[arcs].tolist()]
    places = [_point(xy) for xy in _on_map(frame, built.graph.xy[nodes])]
    stops = [make("nav2_msgs/msg/RouteNode", node, place) for node, place in zip(nodes, places, strict=True)]
    edges = [make("nav2_msgs/msg/RouteEdge", int(arc), places[k], places[k + 1]) for k, arc in enumerate(arcs)]
    return make("nav2_msgs/msg/Route", header(stamp_ns, MAP_FRAME), cost / 1000.0, stops, edges)


def route_path(built: IndexedGraph, frame: SubmapFrame, start: int, arcs: Int32Array) -> Path:
    """Return the path [m, m, rad] along directed arcs (K,) up to the first lift, whose other storeys have other maps."""
    graph = built.graph
    rides = np.flatnonzero(graph.heading[arcs] == NO_HEADING)
    driven = arcs[: rides[0]] if len(rides) else arcs
    corners = _on_map(frame, graph.xy[[start, *graph.head[driven].tolist()]])
    rows = []
    for one, other in pairwise(corners):
        count = max(1, int(np.ceil(np.hypot(*(other - one)) / PATH_STEP_M)))
        shares = np.arange(count)[:, None] / count
        heading = np.full((count, 1), np.arctan2(*(other - one)[::-1]))
        rows.append(np.hstack([one + shares * (other - one), heading]))
    last = rows[-1][-1, 2] if rows else 0.0
    return Path(np.vstack([*rows, [[*corners[-1], last]]]))


def graph_markers(stamp_ns: int, hgraph: HGraph, built: IndexedGraph, storey: str) -> Any:
    """Return a visualization_msgs/MarkerArray of a storey's graph: nodes, open and closed arcs, names of goals."""
    graph, frame = built.graph, hgraph.storey_frame(storey)
    here = np.array([not ref.submap.startswith("@") and hgraph.storey_of(ref.submap) == storey for ref in built.refs])
    inside = np.flatnonzero(here[graph.tail] & here[graph.head]) if len(here) else np.empty(0, np.int64)
    is_open = graph.cost[inside] < CLOSED_MM
    markers = [
        _marker(stamp_ns, "", 0, _SPHERE_LIST, action=_DELETE_ALL),
        _marker(
            stamp_ns, "nodes", 0, _SPHERE_LIST, _NODE_M, _NODES, _on_map(frame, graph.xy[here]) if len(here) else None
        ),
        _marker(stamp_ns, "arcs", 0, _LINE_LIST, _LINE_M, _OPEN, _ends(built, frame, inside[is_open])),
        _marker(stamp_ns, "closed", 0, _LINE_LIST, _LINE_M, _CLOSED, _ends(built, frame, inside[~is_open])),
    ]
    for node in np.flatnonzero(here).tolist() if len(here) else ():
        known = hgraph.node(built.refs[node])
        if known is not None and known.kind is NodeKind.END:
            at = _on_map(frame, graph.xy[node : node + 1])
            markers.append(_marker(stamp_ns, "names", node, _TEXT, _TEXT_M, _NAMES, at, known.name or known.id))
    return make("visualization_msgs/msg/MarkerArray", markers)


def _ends(built: IndexedGraph, frame: SubmapFrame, arcs: NDArray[np.integer[Any]]) -> FloatArray:
    """Return the points (2 K, 2) [m] of lines along directed arcs (K,)."""
    graph = built.graph
    lines: FloatArray = np.stack([graph.xy[graph.tail[arcs]], graph.xy[graph.head[arcs]]], axis=1).reshape(-1, 2)
    return _on_map(frame, lines)


def _on_map(frame: SubmapFrame, xy: FloatArray) -> FloatArray:
    """Return points (N, 2) [m] of the building's frame in that of a map, whose frame in the building's is given."""
    return np.array([frame.inside(x, y) for x, y in xy.tolist()]).reshape(-1, 2)


def _point(xy: FloatArray) -> Any:
    return point(np.array([*xy, 0.0]))


def _marker(
    stamp_ns: int,
    name: str,
    number: int,
    kind: int,
    size: float = 0.0,
    colour: tuple[float, float, float, float] = _NAMES,
    points: FloatArray | None = None,
    text: str = "",
    action: int = _ADD,
) -> Any:
    """Return a visualization_msgs/Marker; a text stands at its only point."""
    at = Pose2() if points is None or not text else Pose2(*points[0].tolist())
    no_image = make("sensor_msgs/msg/CompressedImage", header(0, ""), "", np.empty(0, np.uint8))
    no_mesh = make("visualization_msgs/msg/MeshFile", "", np.empty(0, np.uint8))
    return make(
        "visualization_msgs/msg/Marker",
        header=header(stamp_ns, MAP_FRAME),
        ns=name,
        id=number,
        type=kind,
        action=action,
        pose=pose(at),
        scale=make("geometry_msgs/msg/Vector3", size, size, size),
        color=make("std_msgs/msg/ColorRGBA", *colour),
        lifetime=make("builtin_interfaces/msg/Duration", 0, 0),
        frame_locked=False,
        points=[] if points is None or text else [_point(xy) for xy in points],
        colors=[],
        texture_resource="",
        texture=no_image,
        uv_coordinates=[],
        text=text,
        mesh_resource="",
        mesh_file=no_mesh,
        mesh_use_embedded_materials=False,
    )
