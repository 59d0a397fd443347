"""Buildings of Open-RMF's traffic editor (`*.building.yaml`): read as a building with maps, and written.

Format as in rmf_traffic_editor's building_map. Coordinates are pixels with y down (`reference_image`, the default) or
metres with y up (`cartesian_meters`). Metres a pixel are the mean over the reference level's measurements; other levels are
laid on it by fiducials of one name. One of the robots' graphs (`graph_idx`) becomes the arcs; all else is kept.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import yaml

from waychair.errors import BuildingError
from waychair.maps.building.hgraph import (
    PLAIN,
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
from waychair.maps.exchange.flat_graph import FARTHEST, NOTHING, FlatGraph, Imported, checked_coordinates, flat_graph
from waychair.maps.exchange.rmf_grid import grid_of_level
from waychair.types import FloatArray
from waychair.yaml_files import quoted, yaml_from_text

KEPT_NAME = "open_rmf.building.yaml"
METRES, IMAGE = "cartesian_meters", "reference_image"
_STRING, _INTEGER, _NUMBER, _TRUTH = 1, 2, 3, 4


@dataclass(frozen=True, slots=True)
class RmfLevel:
    """A level in metres: its vertices (N, 2) in the building's frame, and its part of the file."""

    name: str
    height: float
    points: FloatArray
    values: dict[str, Any]


def building_from_open_rmf(data: bytes, name: str, graph: int | None = None) -> Imported:
    """Return the building of a building.yaml file, with a map of each level that has walls.

    Args:
        data: content of the file.
        name: its name in errors.
        graph: the `graph_idx` whose lanes become arcs; None for the lowest.

    Raises:
        BuildingError: the file is damaged, has no scale, is in WGS 84, or lacks the graph.
    """
    values = _values(data, name)
    levels, notes = _levels(values, name)
    indices = sorted({_lane_graph(lane) for level in levels for lane in _edges(level, "lanes", name)})
    if graph is None:
        graph = indices[0] if indices else 0
    elif graph not in indices:
        known = ", ".join(map(str, indices)) or "none"
        raise BuildingError(f"{name} has no graph {graph}: choose among {known}")
    if len(indices) > 1:
        notes.append(f"graphs {', '.join(map(str, indices))}: {graph} is used, the others are kept")
    title = values.get("name") if isinstance(values.get("name"), str) and values["name"].strip() else name
    hgraph = HGraph(str(title), tuple(Storey(each.name, each.name, each.height) for each in levels))
    cabins: dict[str, list[NodeRef]] = {}
    grids = {}
    for level in levels:
        submap = _submap(level, graph, name, cabins)
        hgraph = with_submap(hgraph, submap)
        grid = grid_of_level(level.points, level.values)
        if grid is not None:
            grids[level.name] = grid
            storeys = [replace(s, map=f"maps/{s.id}") if s.id == level.name else s for s in hgraph.storeys]
            hgraph = replace(hgraph, storeys=tuple(storeys))
    for key, lift in _mapping(values, "lifts").items():
        stops = cabins.get(key, [])
        if len(stops) < 2:
            notes.append(f"lift '{key}' is reached by lanes on {len(stops)} levels: it is kept, but not driven")
            continue
        hgraph = with_lift(hgraph, _lift(key, lift if isinstance(lift, dict) else {}, stops, hgraph, name))
    return Imported(hgraph, {KEPT_NAME: data}, tuple(notes), grids)


def open_rmf_of(hgraph: HGraph, kept: bytes | None, graph: int | None = None) -> str:
    """Return a building as building.yaml; with a `kept` file, that file with the changes in it.

    A new file is in pixels of a metre with a measurement on each level, all levels in one frame.

    Raises:
        BuildingError: the kept file is damaged.
    """
    current, before = flat_graph(hgraph), NOTHING
    values: dict[str, Any] = {"name": hgraph.name, "coordinate_system": IMAGE, "levels": {}, "lifts": {}}
    if kept is not None:
        before = flat_graph(building_from_open_rmf(kept, KEPT_NAME, graph).hgraph)
        if before == current:
            return kept.decode()
        values = _values(kept, KEPT_NAME)
    pixels = {level.name: _to_file(values, level) for level in _levels(values, KEPT_NAME)[0]} if kept else {}
    for storey in hgraph.storeys:
        level = values["levels"].setdefault(storey.id, {"elevation": storey.height, "vertices": []})
        _write_level(level, storey.id, before, current, pixels.get(storey.id, _metres_down), graph or 0)
        if kept is None:
            _measure(level)
    if kept is None:
        values["lifts"] = {key: _lift_values(lift, current) for key, lift in hgraph.lifts.items()}
    return str(yaml.safe_dump(values, sort_keys=False, default_flow_style=None, width=1_000_000))


_LISTS = ("vertices", "lanes", "walls", "doors", "floors", "measurements", "fiducials")
"""The parts of a level that are lists."""


def _values(data: bytes, name: str) -> dict[str, Any]:
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        raise BuildingError(f"{name} is not UTF-8 text: save it again with the traffic editor") from error
    values = yaml_from_text(text, name, BuildingError)
    if not isinstance(values, dict) or not isinstance(values.get("levels"), dict) or not values["levels"]:
        raise BuildingError(f"{name} has no levels: it must be a building.yaml of Open-RMF's traffic editor")
    system = values.get("coordinate_system", IMAGE)
    if system not in (IMAGE, METRES):
        raise BuildingError(
            f"{name} is in the coordinate system {quoted(system)}: save it as {IMAGE} or {METRES}, which are read"
        )
    return values


def _levels(values: dict[str, Any], name: str) -> tuple[list[RmfLevel], list[str]]:
    """Return the levels from the lowest, in metres of one frame, and notes."""
    raw = values["levels"]
    for key, level in raw.items():
        if not isinstance(key, str) or not is_id(key):
            raise BuildingError(f"{name} has a level {quoted(key)}: use letters, digits, _, - and . in its name")
        if not isinstance(level, dict):
            raise BuildingError(f"level '{key}' of {name} is empty: draw it, or take it away")
        for part in _LISTS:
            if not isinstance(level.get(part) or [], list):
                raise BuildingError(f"the {part} of level '{key}' of {name} are no list: save it again")
    vertices = {key: _vertices(level, key, name) for key, level in raw.items()}
    if values.get("coordinate_system", IMAGE) == METRES:
        points = {key: each * (1.0, -1.0) for key, each in vertices.items()}
        notes: list[str] = []
    else:
        named = values.get("reference_level_name")
        reference = named if isinstance(named, str) and named in raw else next(iter(raw))
        points, notes = _laid(raw, vertices, reference, name)
    levels = []
    for position, (key, level) in enumerate(raw.items()):
        height = level.get("elevation", 0.0)
        _, height = checked_coordinates(f"level '{key}' of {name}", 0.0, height)
        levels.append((height, position, RmfLevel(key, height, points[key], level)))
    return [level for *_, level in sorted(levels, key=lambda each: each[:2])], notes


def _laid(
    raw: dict[str, Any], vertices: dict[str, FloatArray], reference: str, name: str
) -> tuple[dict[str, FloatArray], list[str]]:
    """Return the vertices of all levels in metres of the reference level, y up, and notes."""
    scale = _scale(raw[reference], vertices[reference])
    if scale is None:
        raise BuildingError(f"level '{reference}' of {name} has no measurement: measure a length in the traffic editor")
    points, notes = {}, []
    base = _fiducials(raw[reference])
    for key, level in raw.items():
        if key == reference:
            points[key] = vertices[key] * scale
            continue
        own = _fiducials(level)
        pairs = _pairs(own, base)
        if pairs:
            points[key] = _similar(vertices[key], own, base, pairs) * scale
            continue
        measured = _scale(level, vertices[key])
        notes.append(
            f"level '{key}' has fewer than two fiducials of '{reference}': its place is a guess, its scale from "
            + ("its own measurements" if measured else f"'{reference}'")
        )
        points[key] = vertices[key] * (measured or scale)
    return points, notes


def _pairs(own: dict[str, complex], base: dict[str, complex]) -> list[tuple[str, str]]:
    """Return the pairs of fiducials that both levels have, at different points of each."""
    common = sorted(set(base) & set(own))
    return [(a, b) for i, a in enumerate(common) for b in common[:i] if own[a] != own[b] and base[a] != base[b]]


def _similar(
    points: FloatArray, own: dict[str, complex], base: dict[str, complex], pairs: list[tuple[str, str]]
) -> FloatArray:
    """Return points (N, 2) moved, turned and scaled as the fiducials of one name, by the mean over all pairs."""
    ratios = [(base[a] - base[b]) / (own[a] - own[b]) for a, b in pairs]
    scale = float(np.mean(np.abs(ratios)))
    turn = np.mean([ratio / abs(ratio) for ratio in ratios])
    factor = scale * turn / abs(turn)
    common = sorted({key for pair in pairs for key in pair})
    shift = np.mean([base[key] - factor * own[key] for key in common])
    moved = factor * (points[:, 0] + 1j * points[:, 1]) + shift
    return np.column_stack([moved.real, moved.imag])


def _fiducials(level: dict[str, Any]) -> dict[str, complex]:
    found = {}
    for row in level.get("fiducials") or []:
        good = isinstance(row, list) and len(row) >= 3 and all(isinstance(v, int | float) for v in row[:2])
        if good and abs(row[0]) <= FARTHEST and abs(row[1]) <= FARTHEST:  # False for nan
            found[str(row[2])] = complex(row[0], -row[1])
    return found


def _scale(level: dict[str, Any], points: FloatArray) -> float | None:
    """Return metres a pixel from a level's measurements; None without any."""
    ratios = []
    for row in level.get("measurements") or []:
        distance = _parameter(row, "distance")
        if not isinstance(distance, int | float) or len(row) < 3 or not all(isinstance(end, int) for end in row[:2]):
            continue
        if max(row[0], row[1]) < len(points) and min(row[0], row[1]) >= 0:
            length = float(np.hypot(*(points[row[0]] - points[row[1]])))
            if length > 0 and 0 < distance <= FARTHEST:
                ratios.append(distance / length)
    return float(np.mean(ratios)) if ratios else None


def _vertices(level: dict[str, Any], key: str, name: str) -> FloatArray:
    """Return the vertices (N, 2) as written, but with y up."""
    rows = level.get("vertices") or []
    points = np.zeros((len(rows), 2))
    for index, row in enumerate(rows):
        where = f"vertex {index} of level '{key}' of {name}"
        if not isinstance(row, list) or len(row) < 2:
            raise BuildingError(f"{where} has no x and y: give both")
        points[index] = checked_coordinates(where, row[0], row[1])
    return points * (1.0, -1.0) if len(rows) else points


def _edges(level: RmfLevel, kind: str, name: str) -> list[list[Any]]:
    """Return the lanes, walls or doors of a level, whose ends exist."""
    rows = level.values.get(kind) or []
    for number, row in enumerate(rows):
        ends = row[:2] if isinstance(row, list) else []
        good = [isinstance(end, int) and not isinstance(end, bool) and 0 <= end < len(level.points) for end in ends]
        if good != [True, True]:
            raise BuildingError(
                f"number {number} of the {kind} of level '{level.name}' of {name} has an end that is no vertex: draw it anew"
            )
    return list(rows)


def _submap(level: RmfLevel, graph: int, name: str, cabins: dict[str, list[NodeRef]]) -> SubMap:
    """Return the sub-map of a level: the vertices at lanes of a graph, and its lanes; adds stops to `cabins`."""
    doors = [(level.points[row[0]], level.points[row[1]]) for row in _edges(level, "doors", name)]
    _edges(level, "walls", name)
    arcs: dict[tuple[int, int], Arc] = {}
    for lane in _edges(level, "lanes", name):
        start, end = lane[:2]
        if _lane_graph(lane) != graph or start == end:
            continue
        way = _lane_way(lane, [level.points[start], level.points[end]], doors)
        if (end, start) in arcs and way.one_way and arcs[end, start].way.one_way:
            arcs[end, start] = replace(arcs[end, start], way=replace(arcs[end, start].way, one_way=False))
        elif (end, start) not in arcs:
            arcs.setdefault((start, end), Arc(f"v{start}", f"v{end}", way))
    nodes = {}
    for index in sorted({index for ends in arcs for index in ends}):
        row = level.values["vertices"][index]
        title = row[3] if len(row) > 3 and isinstance(row[3], str) else ""
        cabin = _parameter(row, "lift_cabin")
        kind = NodeKind.END if title else NodeKind.CROSS
        if isinstance(cabin, str) and cabin:
            kind = NodeKind.LIFT
            cabins.setdefault(cabin, []).append(NodeRef(level.name, f"v{index}"))
        x, y = level.points[index].tolist()
        nodes[f"v{index}"] = Node(f"v{index}", kind, x, y, title)
    return SubMap(level.name, level.name, storey=level.name, nodes=nodes, arcs=tuple(arcs.values()))


def _lane_way(lane: list[Any], ends: list[FloatArray], doors: list[tuple[FloatArray, FloatArray]]) -> Way:
    """Return a lane's way: its limit of speed, and the width of the narrowest door that it crosses."""
    widths = [float(np.hypot(*(b - a))) for a, b in doors if cross(ends[0], ends[1], a, b)]
    speed = _parameter(lane, "speed_limit")
    limit = float(speed) if isinstance(speed, int | float) and not isinstance(speed, bool) and speed > 0 else None
    one_way = _parameter(lane, "bidirectional") is not True
    return replace(PLAIN, speed=limit, width=min(widths, default=None), one_way=one_way)


def cross(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> bool:
    """Return whether the segments from a to b and from c to d (2,) cross."""

    def side(p: FloatArray, q: FloatArray, r: FloatArray) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return side(a, b, c) * side(a, b, d) <= 0 and side(c, d, a) * side(c, d, b) <= 0 and bool((a != b).any())


def _lift(key: str, values: dict[str, Any], stops: list[NodeRef], hgraph: HGraph, name: str) -> Lift:
    if not is_id(key):
        raise BuildingError(f"{name} has a lift '{key}': use letters, digits, _, - and . in its name")
    doors = values.get("doors")
    widths = {
        door: size
        for door, each in (doors if isinstance(doors, dict) else {}).items()
        if isinstance(each, dict) and (size := _size(each.get("width"))) is not None
    }
    at_level = values.get("level_doors") if isinstance(values.get("level_doors"), dict) else {}
    heights = {storey.id: storey.height for storey in hgraph.storeys}
    found = []
    for ref in sorted(stops, key=lambda each: heights[each.submap]):
        named = (at_level or {}).get(ref.submap)
        own = [
            widths[door]
            for door in (named if isinstance(named, list) else [])
            if isinstance(door, str) and door in widths
        ]
        found.append(Stop(ref.submap, ref, min(own, default=None)))
    width, depth = (_size(values.get(side)) for side in ("width", "depth"))
    return Lift(
        key,
        key,
        tuple(found),
        width,
        depth,
        min(widths.values(), default=None),
    )


def _size(value: object) -> float | None:
    """Return a width or depth [m]; None for a value that is none."""
    good = isinstance(value, int | float) and not isinstance(value, bool) and 0 < value <= _WIDEST
    return float(value) if good else None  # type: ignore[arg-type]


_WIDEST = 100.0
"""Largest width [m] that the text files hold."""


def _lane_graph(lane: list[Any]) -> int:
    index = _parameter(lane, "graph_idx")
    return index if isinstance(index, int) else 0


def _parameter(row: Any, key: str) -> Any:
    """Return the value of a typed parameter, `{key: [type, value]}` at the end of a row; None if there is none."""
    parameters = row[-1] if isinstance(row, list) and row and isinstance(row[-1], dict) else {}
    value = parameters.get(key)
    return value[1] if isinstance(value, list) and len(value) == 2 else None


def _mapping(values: dict[str, Any], key: str) -> dict[str, Any]:
    found = values.get(key)
    return found if isinstance(found, dict) else {}


def _metres_down(x: float, y: float) -> tuple[float, float]:
    return x, -y


def _to_file(values: dict[str, Any], level: RmfLevel) -> Any:
    """Return the function from metres of the building to a level's coordinates in the file."""
    if values.get("coordinate_system", IMAGE) == METRES:
        return lambda x, y: (x, y)
    raw = np.array([[row[0], -row[1]] for row in level.values.get("vertices") or []], float).reshape(-1, 2)
    if len(raw) < 2 or not np.ptp(raw, axis=0).any():
        raise BuildingError(f"level '{level.name}' has no two vertices apart, which give its scale: draw them first")
    metres = level.points[:, 0] + 1j * level.points[:, 1]
    pixels = raw[:, 0] + 1j * raw[:, 1]
    far = int(np.argmax(np.abs(pixels - pixels[0])))
    factor = (pixels[far] - pixels[0]) / (metres[far] - metres[0])

    def to_file(x: float, y: float) -> tuple[float, float]:
        point = pixels[0] + factor * (complex(x, y) - metres[0])
        return float(point.real), float(-point.imag)

    return to_file


def _write_level(
    level: dict[str, Any], storey: str, before: FlatGraph, current: FlatGraph, to_file: Any, graph: int
) -> None:
    """Bring the changes of a storey's nodes and arcs into its level: moved, new and missing ones."""
    vertices = level.setdefault("vertices", [])
    lanes = level.get("lanes") or []
    cabins = {stop.at: lift.id for lift in current.lifts.values() for stop in lift.stops}
    indices = {}
    for ref, node in current.nodes.items():
        if node.storey != storey:
            continue
        old = before.nodes.get(ref)
        if old is None:
            indices[ref] = len(vertices)
            row: list[Any] = [*to_file(node.x, node.y), 0.0, node.node.name]
            vertices.append([*row, {"lift_cabin": [_STRING, cabins[ref]]}] if ref in cabins else row)
            continue
        indices[ref] = int(ref.node[1:])
        row = vertices[indices[ref]]
        if (old.x, old.y) != (node.x, node.y):
            row[:2] = to_file(node.x, node.y)
        if old.node.name != node.node.name:
            row[3:4] = [node.node.name]
    kept = {frozenset((int(a.node[1:]), int(b.node[1:]))) for a, b in before.ways if a.submap == storey}
    wanted = {frozenset((indices[a], indices[b])) for a, b in current.ways if a in indices and b in indices}
    first = graph if not lanes else min(map(_lane_graph, lanes))
    left = [
        lane
        for lane in lanes
        if _lane_graph(lane) != first or frozenset(lane[:2]) not in kept or frozenset(lane[:2]) in wanted
    ]
    for (a, b), way in current.ways.items():
        if a in indices and b in indices and frozenset((indices[a], indices[b])) not in kept:
            parameters: dict[str, Any] = {
                "bidirectional": [_TRUTH, not way.one_way],
                "graph_idx": [_INTEGER, first],
                "orientation": [_STRING, ""],
                "speed_limit": [_NUMBER, way.speed or 0.0],
            }
            left.append([indices[a], indices[b], parameters])
    level["lanes"] = left


def _measure(level: dict[str, Any]) -> None:
    """Give a level in metres two vertices 10 m apart and the measurement between them."""
    count = len(level["vertices"])
    level["vertices"] += [[0.0, 0.0, 0.0, ""], [10.0, 0.0, 0.0, ""]]
    level["measurements"] = [[count, count + 1, {"distance": [_NUMBER, 10.0]}]]
    level["fiducials"] = [[0.0, 0.0, "origin"], [10.0, 0.0, "east"]]


def _lift_values(lift: Lift, graph: FlatGraph) -> dict[str, Any]:
    at = [graph.nodes[stop.at] for stop in lift.stops if stop.at in graph.nodes]
    width, depth, door = lift.cabin_width or 1.5, lift.cabin_depth or 1.5, lift.door_width or 0.9
    storeys = [stop.storey for stop in lift.stops]
    return {
        "x": at[0].x if at else 0.0,
        "y": -at[0].y if at else 0.0,
        "yaw": 0.0,
        "width": width,
        "depth": depth,
        "reference_floor_name": storeys[0] if storeys else "",
        "lowest_floor": storeys[0] if storeys else "",
        "highest_floor": storeys[-1] if storeys else "",
        "level_doors": {stop.storey: ["door"] for stop in lift.stops},
        "doors": {
            "door": {"door_type": 2, "motion_axis_orientation": 0.0, "width": door, "x": 0.0, "y": depth / 2 + 0.1}
        },
    }
