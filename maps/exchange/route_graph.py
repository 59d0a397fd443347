"""Graphs of Nav2's route server in GeoJSON: read as a building, and written.

Format as in `geojson_graph_file_loader.cpp` of Nav2: Points are nodes with an `id`, LineStrings are directed edges with
`id`, `startid` and `endid`; `metadata` and `operations` are free. Nav2 knows no storeys: `metadata` gives the `storey` of a
node and the `lift` of an edge with the class "lift". What is not understood stays in the kept file and is written back.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

from waychair.errors import BuildingError
from waychair.maps.building.hgraph import (
    Arc,
    HGraph,
    Lift,
    Node,
    NodeKind,
    NodeRef,
    Stop,
    Storey,
    SubMap,
    Way,
)
from waychair.maps.building.hgraph_edits import with_lift, with_submap
from waychair.maps.building.text_forms import is_id
from waychair.maps.exchange.flat_graph import (
    NOTHING,
    FlatGraph,
    FlatNode,
    Imported,
    checked_coordinates,
    flat_graph,
    speed_way,
)
from waychair.types import Json
from waychair.yaml_files import quoted

KEPT_NAME = "route_graph.geojson"
STOREY = "map"
"""The storey of nodes that name none: Nav2's frame."""

_LINES = ("LineString", "MultiLineString")
_EMPTY: dict[str, Any] = {"type": "FeatureCollection", "name": "graph", "features": []}


def building_from_route_graph(data: bytes, name: str) -> Imported:
    """Return the building of a GeoJSON file; nodes are at metres of the frame map.

    Two edges there and back, with the same limit of speed, are one arc both ways; one alone is a one-way arc.

    Raises:
        BuildingError: it is no such file, or a node or edge is impossible; the sentence names it.
    """
    nodes, edges = _features(_document(data, name), name)
    storeys = {key: _metadata(feature).get("storey", STOREY) for key, feature in nodes.items()}
    for key, storey in storeys.items():
        if not isinstance(storey, str) or not is_id(storey):
            raise BuildingError(
                f"node {key} of {name} has the storey {quoted(storey)}: use letters, digits, _, - and ."
            )
    names = list(dict.fromkeys(storeys.values())) or [STOREY]
    heights = {storey: _height(nodes, storeys, storey, position) for position, storey in enumerate(names)}
    hgraph = HGraph(name, tuple(sorted((Storey(key, key, heights[key]) for key in names), key=lambda s: s.height)))
    lifts, notes, arcs = _lifts_and_arcs(nodes, edges, storeys)
    ends = {ref.node for lift in lifts.values() for ref in lift}
    for storey in names:
        inside = [_node(key, feature, name, ends) for key, feature in nodes.items() if storeys[key] == storey]
        submap = SubMap(storey, storey, storey=storey, nodes={node.id: node for node in inside})
        hgraph = with_submap(hgraph, replace(submap, arcs=tuple(arcs.get(storey, ()))))
    for lift, refs in lifts.items():
        stops = sorted((Stop(ref.submap, ref) for ref in refs), key=lambda stop: heights[stop.storey])
        hgraph = with_lift(hgraph, Lift(lift, lift, tuple(stops)))
    return Imported(hgraph, {KEPT_NAME: data}, tuple(notes))


def route_graph_of(hgraph: HGraph, kept: bytes | None) -> str:
    """Return a building's graph as GeoJSON; unchanged features are those of the `kept` file.

    Every arc both ways is two features. Coordinates are in the building's frame.

    Raises:
        BuildingError: the kept file is damaged.
    """
    current = flat_graph(hgraph)
    document: dict[str, Any]
    if kept is None:
        document, before = {**_EMPTY, "name": hgraph.name}, NOTHING
    else:
        document, before = _document(kept, KEPT_NAME), flat_graph(building_from_route_graph(kept, hgraph.name).hgraph)
        if before == current:
            return kept.decode()
    taken = {int(feature["properties"]["id"]) for feature in document["features"] if _is_point(feature)}
    ids = {ref: int(ref.node[1:]) for ref in before.nodes}
    free = max(taken, default=-1) + 1
    for ref in current.nodes:
        if ref not in ids:
            ids[ref] = free
            free += 1
    features = _kept_features(document["features"], ids, before, current)
    shown = {int(feature["properties"]["id"]) for feature in features if _is_point(feature)}
    new = [_point(ids[ref], node, hgraph) for ref, node in current.nodes.items() if ids[ref] not in shown]
    features += new
    drawn = {(_end(f, "startid"), _end(f, "endid")) for f in features if _is_line(f)}
    free = max((int(f["properties"]["id"]) for f in features if _is_point(f) or _is_line(f)), default=-1) + 1
    lines: list[tuple[tuple[NodeRef, NodeRef], Way | str]] = [*current.directed().items(), *current.rides().items()]
    for (start, end), way in lines:
        if start in ids and end in ids and (ids[start], ids[end]) not in drawn:
            features.append(_line(free, ids, (start, end), way, current))
            free += 1
    return json.dumps({**document, "features": features}, indent=1, allow_nan=False) + "\n"


def _document(data: bytes, name: str) -> dict[str, Any]:
    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no number")

    try:
        document: Any = json.loads(data.decode(), parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise BuildingError(f"{name} is no GeoJSON: {error}; export it again") from error
    features = document.get("features") if isinstance(document, dict) else None
    if not isinstance(features, list):
        raise BuildingError(f"{name} has no list 'features': it must be a GeoJSON FeatureCollection")
    for position, feature in enumerate(features):
        if not isinstance(feature, dict) or not all(
            isinstance(feature.get(k), dict) for k in ("geometry", "properties")
        ):
            raise BuildingError(f"feature {position} of {name} has no geometry or properties: it must have both")
        if (_is_point(feature) or _is_line(feature)) and not _is_number(feature["properties"].get("id")):
            raise BuildingError(f"feature {position} of {name} has no whole number as its id: give it one from 0")
    found: dict[str, Any] = document
    return found


def _features(document: dict[str, Any], name: str) -> tuple[dict[int, Json], list[Json]]:
    """Return the nodes by id and the edges, whose ends exist."""
    nodes: dict[int, Json] = {}
    edges = []
    for feature in document["features"]:
        if _is_point(feature):
            key = feature["properties"]["id"]
            if key in nodes:
                raise BuildingError(f"{name} has two nodes with the id {key}: give each its own")
            nodes[key] = feature
        elif _is_line(feature):
            edges.append(feature)
    for edge in edges:
        for end in ("startid", "endid"):
            named = edge["properties"].get(end)
            if isinstance(named, list | dict) or named not in nodes:
                raise BuildingError(
                    f"edge {edge['properties']['id']} of {name} has the {end} {quoted(edge['properties'].get(end))}, "
                    "which is no node: correct it, or take the edge away"
                )
    return nodes, edges


def _lifts_and_arcs(
    nodes: dict[int, Json], edges: list[Json], storeys: dict[int, Any]
) -> tuple[dict[str, list[NodeRef]], list[str], dict[str, list[Arc]]]:
    """Return the stops of each lift, notes on edges that are not used, and the arcs of each storey."""
    notes: list[str] = []
    lifts: dict[str, list[NodeRef]] = {}
    ways: dict[tuple[int, int], Way] = {}
    for edge in edges:
        start, end = _end(edge, "startid"), _end(edge, "endid")
        metadata, number = _metadata(edge), edge["properties"]["id"]
        if metadata.get("class") == "lift" and isinstance(metadata.get("lift"), str) and is_id(metadata["lift"]):
            stops = lifts.setdefault(metadata["lift"], [])
            stops += [ref for ref in (_ref(start, storeys), _ref(end, storeys)) if ref not in stops]
        elif storeys[start] != storeys[end]:
            notes.append(f"edge {number} joins two storeys and is no lift: it is kept, but not driven")
        elif start == end or (start, end) in ways:
            notes.append(f"edge {number} is {'a loop' if start == end else 'doubled'}: it is kept, but not driven")
        else:
            ways[start, end] = speed_way(metadata.get("abs_speed_limit"))
    arcs: dict[str, list[Arc]] = {}
    for (start, end), way in ways.items():
        back = ways.get((end, start))
        if back == way and end < start:
            continue  # it is written with its other direction
        if back is not None and back != way and end < start:
            continue  # one arc cannot have two limits: that of the direction from the smaller id holds
        one_way = replace(way, one_way=back is None)
        arcs.setdefault(storeys[start], []).append(Arc(f"n{start}", f"n{end}", one_way))
    return lifts, notes, arcs


def _node(key: int, feature: Json, name: str, stops: set[str]) -> Node:
    where = f"node {key} of {name}"
    coordinates = feature["geometry"].get("coordinates")
    if not isinstance(coordinates, list) or len(coordinates) < 2:
        raise BuildingError(f"{where} has no coordinates: give x and y in metres")
    x, y = checked_coordinates(where, coordinates[0], coordinates[1])
    title = _metadata(feature).get("name")
    title = title if isinstance(title, str) else ""
    kind = NodeKind.END if title else NodeKind.CROSS
    return Node(f"n{key}", NodeKind.LIFT if f"n{key}" in stops else kind, x, y, title)


def _kept_features(features: list[Json], ids: dict[NodeRef, int], before: FlatGraph, current: FlatGraph) -> list[Json]:
    """Return the features that still stand, nodes where they are now."""
    refs = {number: ref for ref, number in ids.items()}
    directed = {(ids[a], ids[b]) for a, b in current.directed()} | {(ids[a], ids[b]) for a, b in current.rides()}
    used = {(ids[a], ids[b]) for a, b in before.directed()} | {(ids[a], ids[b]) for a, b in before.rides()}
    left = []
    for feature in features:
        if _is_point(feature):
            ref = refs[feature["properties"]["id"]]
            if ref not in current.nodes:
                continue
            feature = _moved(feature, before.nodes[ref], current.nodes[ref])
        elif _is_line(feature):
            ends = _end(feature, "startid"), _end(feature, "endid")
            gone = any(refs[end] not in current.nodes for end in ends)
            if gone or (ends in used and ends not in directed):
                continue
        left.append(feature)
    return left


def _moved(feature: Json, before: FlatNode, now: FlatNode) -> Json:
    if (before.x, before.y) != (now.x, now.y):
        rest = feature["geometry"]["coordinates"][2:]
        feature = {**feature, "geometry": {**feature["geometry"], "coordinates": [now.x, now.y, *rest]}}
    if before.node.name != now.node.name:
        properties = feature["properties"]
        metadata = {**_metadata(feature), "name": now.node.name}
        feature = {**feature, "properties": {**properties, "metadata": metadata}}
    return feature


def _point(number: int, node: FlatNode, hgraph: HGraph) -> Json:
    metadata = {"storey": node.storey or STOREY}
    if node.node.name:
        metadata["name"] = node.node.name
    heights = {storey.id: storey.height for storey in hgraph.storeys}
    if node.storey in heights:
        metadata["storey_height"] = heights[node.storey]  # type: ignore[assignment]
    properties = {"id": number, "frame": "map", "metadata": metadata}
    geometry = {"type": "Point", "coordinates": [node.x, node.y]}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _line(
    number: int, ids: dict[NodeRef, int], ends: tuple[NodeRef, NodeRef], way: Way | str, graph: FlatGraph
) -> Json:
    properties: Json = {"id": number, "startid": ids[ends[0]], "endid": ids[ends[1]]}
    points = [[graph.nodes[end].x, graph.nodes[end].y] for end in ends]
    if isinstance(way, str):
        storey = graph.nodes[ends[1]].storey
        properties["metadata"] = {"class": "lift", "lift": way}
        ride = {"type": "take_lift", "trigger": "ON_ENTER", "metadata": {"lift": way, "storey": storey}}
        properties["operations"] = {"take_lift": ride}
    elif way.speed is not None:
        properties["metadata"] = {"abs_speed_limit": way.speed}
    return {"type": "Feature", "properties": properties, "geometry": {"type": "LineString", "coordinates": points}}


def _height(nodes: dict[int, Json], storeys: dict[int, Any], storey: str, position: int) -> float:
    """Return a storey's height [m]: that of its nodes, else 4 m for each storey named before it."""
    for key, feature in nodes.items():
        height = _metadata(feature).get("storey_height")
        if storeys[key] == storey and isinstance(height, int | float) and math.isfinite(height):
            return float(height)
    return 4.0 * position


def _metadata(feature: Json) -> dict[str, Any]:
    metadata = feature["properties"].get("metadata")
    return metadata if isinstance(metadata, dict) else {}


def _ref(number: int, storeys: dict[int, Any]) -> NodeRef:
    return NodeRef(storeys[number], f"n{number}")


def _end(feature: Json, key: str) -> int:
    return int(feature["properties"][key])


def _is_number(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _is_point(feature: Json) -> bool:
    return bool(feature["geometry"].get("type") == "Point")


def _is_line(feature: Json) -> bool:
    return bool(feature["geometry"].get("type") in _LINES)
