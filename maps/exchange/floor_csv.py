"""Floor graphs as two CSV files, nodes and edges of several storeys (course CS3733 of WPI): read as a building, written.

nodes.csv: nodeID, xcoord, ycoord, floor, building, nodeType, longName, shortName; x to the right and y down in pixels.
edges.csv: edgeID, startNode, endNode; all both ways. A lift is the first eight characters of the ID of an ELEV node. Edges
between storeys that join no lift are stairs and stay in the kept files. The arcs to a STAI node are closed: no chair drives
into a stairwell.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable

from waychair.errors import BuildingError
from waychair.maps.building.hgraph import (
    PLAIN,
    Arc,
    Closure,
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
from waychair.maps.exchange.flat_graph import NOTHING, FlatNode, Imported, checked_coordinates, flat_graph

NODES, EDGES = "nodes.csv", "edges.csv"
NODE_COLUMNS = ("nodeID", "xcoord", "ycoord", "floor", "building", "nodeType", "longName", "shortName")
EDGE_COLUMNS = ("edgeID", "startNode", "endNode")

METRES_A_PIXEL = 0.1
"""Assumed where nobody states the scale."""

STOREY_HEIGHT = 4.0
"""Assumed height [m] of a storey: the files state none."""

FLOORS = ("L3", "L2", "L1", "G")
"""Floors below the first, from the lowest; numbers follow."""

NO_CHAIR = Way(closure=Closure("stairs"))
"""The way of an arc to a stairwell."""

_LIFT, _STAIRS, _HALL, _LIFT_NAME = "ELEV", "STAI", "HALL", 8


def building_from_floor_csv(nodes: bytes, edges: bytes, name: str, scale: float = METRES_A_PIXEL) -> Imported:
    """Return the building of two CSV files.

    Args:
        nodes: content of nodes.csv.
        edges: content of edges.csv.
        name: the building's name.
        scale: metres a pixel.

    Raises:
        BuildingError: a column is missing, or a line is impossible; the sentence names the file and the line.
    """
    found = _read_nodes(nodes, scale)
    floors = sorted({storey for storey, _, _ in found.values()}, key=_floor_order)
    heights = {floor: STOREY_HEIGHT * position for position, floor in enumerate(floors)}
    hgraph = HGraph(name, tuple(Storey(floor, floor, heights[floor]) for floor in floors))
    arcs: dict[str, list[Arc]] = {floor: [] for floor in floors}
    lifts: dict[str, dict[str, None]] = {}
    for key, (_, kind, _) in found.items():
        if kind == _LIFT:
            lifts.setdefault(key[:_LIFT_NAME], {})[key] = None
    seen: set[frozenset[str]] = set()
    notes = []
    for line, row in _rows(edges, EDGES, EDGE_COLUMNS):
        start, end = row["startNode"], row["endNode"]
        for each in (start, end):
            if each not in found:
                raise BuildingError(f"{EDGES}, line {line}: '{each}' is no node of {NODES}: correct it")
        if start == end or frozenset((start, end)) in seen:
            notes.append(f"{EDGES}, line {line}: {start} to {end} again; it is kept, but not used")
        elif found[start][0] == found[end][0]:
            stairs = _STAIRS in (found[start][1], found[end][1])
            arcs[found[start][0]].append(Arc(start, end, NO_CHAIR if stairs else PLAIN))
        elif start[:_LIFT_NAME] != end[:_LIFT_NAME] or found[start][1] != _LIFT or found[end][1] != _LIFT:
            notes.append(f"{EDGES}, line {line}: {start} to {end} are stairs; they are kept, but not driven")
        seen.add(frozenset((start, end)))
    for floor in floors:
        inside = {key: node for key, (storey, _, node) in found.items() if storey == floor}
        hgraph = with_submap(hgraph, SubMap(floor, floor, storey=floor, nodes=inside, arcs=tuple(arcs[floor])))
    for key, stops in lifts.items():
        at = sorted((Stop(found[each][0], NodeRef(found[each][0], each)) for each in stops), key=_by_height(heights))
        hgraph = with_lift(hgraph, Lift(key, key, tuple(at)))
    return Imported(hgraph, {NODES: nodes, EDGES: edges}, tuple(notes))


def floor_csv_of(hgraph: HGraph, kept: tuple[bytes, bytes] | None, scale: float = METRES_A_PIXEL) -> tuple[str, str]:
    """Return nodes.csv and edges.csv of a building; lines that nobody changed are those of the kept files.

    Raises:
        BuildingError: the kept files are damaged.
    """
    current = flat_graph(hgraph)
    before = NOTHING
    node_lines, edge_lines = [",".join(NODE_COLUMNS)], [",".join(EDGE_COLUMNS)]
    ids = {ref: ref.node for ref in current.nodes}
    if kept is not None:
        before = flat_graph(building_from_floor_csv(*kept, hgraph.name, scale).hgraph)
        if before == current:
            return kept[0].decode(), kept[1].decode()
    own = {ref.node: ref for ref in before.nodes}
    used = {frozenset((a.node, b.node)) for a, b in before.ways}
    for ref in current.nodes:
        if ref not in before.nodes and (ref.node in own or sum(r.node == ref.node for r in current.nodes) > 1):
            ids[ref] = str(ref).replace("/", "_").replace(":", "_")
    for lift in current.lifts.values():
        for stop in lift.stops:
            if stop.at not in before.nodes:
                ids[stop.at] = f"{lift.id[:_LIFT_NAME]:_<{_LIFT_NAME}}{stop.storey}"
    ways = {frozenset((ids[a], ids[b])): (ids[a], ids[b]) for a, b in current.ways}
    if kept is not None:
        for _, row in _rows(kept[0], NODES, NODE_COLUMNS):
            ref = own[row["nodeID"]]
            if ref in current.nodes:
                node_lines.append(_line(_changed(row, before.nodes[ref], current.nodes[ref], scale)))
        for _, row in _rows(kept[1], EDGES, EDGE_COLUMNS):
            ends = frozenset((row["startNode"], row["endNode"]))
            if all(own[end] in current.nodes for end in ends) and (ends in ways or ends not in used):
                edge_lines.append(_line(row))
            ways.pop(ends, None)
    for ref, node in current.nodes.items():
        if ref not in before.nodes:
            kind = {NodeKind.LIFT: _LIFT, NodeKind.END: "DEPT"}.get(node.node.kind, _HALL)
            title = node.node.name or ids[ref]
            place = [f"{node.x / scale:g}", f"{-node.y / scale:g}"]
            values = [ids[ref], *place, node.storey, hgraph.name, kind, title, title]
            node_lines.append(_line(dict(zip(NODE_COLUMNS, values, strict=True))))
    rides = {frozenset((ids[a], ids[b])): (ids[a], ids[b]) for a, b in current.rides() if a not in before.nodes}
    for start, end in {**ways, **rides}.values():
        edge_lines.append(_line({"edgeID": f"{start}_{end}", "startNode": start, "endNode": end}))
    return "\n".join(node_lines) + "\n", "\n".join(edge_lines) + "\n"


def _read_nodes(data: bytes, scale: float) -> dict[str, tuple[str, str, Node]]:
    """Return the storey, type and node of each ID; places in metres, y up."""
    found: dict[str, tuple[str, str, Node]] = {}
    for line, row in _rows(data, NODES, NODE_COLUMNS):
        where, key, storey = f"{NODES}, line {line}", row["nodeID"], row["floor"]
        for what, value in (("nodeID", key), ("floor", storey)):
            if not is_id(value):
                raise BuildingError(f"{where}: '{value}' is no {what}: use letters, digits, _, - and .")
        if key in found:
            raise BuildingError(f"{where}: there is a node '{key}' already: give each its own ID")
        try:
            pixels = float(row["xcoord"]), float(row["ycoord"])
        except ValueError as error:
            raise BuildingError(f"{where}: {error}: give coordinates in pixels") from error
        x, y = checked_coordinates(f"{where}: '{key}'", pixels[0] * scale, -pixels[1] * scale)
        kind = {_LIFT: NodeKind.LIFT, _STAIRS: NodeKind.CROSS, _HALL: NodeKind.CROSS}.get(row["nodeType"], NodeKind.END)
        title = row["longName"] if kind is NodeKind.END else ""
        found[key] = storey, row["nodeType"], Node(key, kind, x, y, title)
    return found


def _rows(data: bytes, name: str, columns: tuple[str, ...]) -> list[tuple[int, dict[str, str]]]:
    """Return the lines of a CSV file with their numbers."""
    try:
        reader = csv.DictReader(io.StringIO(data.decode("utf-8-sig"), newline=""), strict=True)
        missing = [column for column in columns if column not in (reader.fieldnames or ())]
        if missing:
            raise BuildingError(f"{name} has no column '{missing[0]}': its first line must name {', '.join(columns)}")
        rows = []
        for row in reader:
            if None in row or None in row.values():
                raise BuildingError(f"{name}, line {reader.line_num} has too few or too many values: correct it")
            rows.append((reader.line_num, row))
    except UnicodeDecodeError as error:
        raise BuildingError(f"{name} is not UTF-8 text: write it again") from error
    except csv.Error as error:
        raise BuildingError(f"{name} is no CSV file: {error}; export it again") from error
    return rows


def _changed(row: dict[str, str], before: FlatNode, now: FlatNode, scale: float) -> dict[str, str]:
    if (before.x, before.y) != (now.x, now.y):
        row = {**row, "xcoord": f"{now.x / scale:g}", "ycoord": f"{-now.y / scale:g}"}
    return row if before.node.name == now.node.name else {**row, "longName": now.node.name}


def _line(row: dict[str, str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="").writerow(row.values())
    return text.getvalue()


def _floor_order(floor: str) -> tuple[int, int, str]:
    if floor in FLOORS:
        return 0, FLOORS.index(floor), floor
    return (1, int(floor), floor) if floor.isdecimal() else (2, 0, floor)


def _by_height(heights: dict[str, float]) -> Callable[[Stop], float]:
    return lambda stop: heights[stop.storey]
