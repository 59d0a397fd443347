"""Making the graph of a storey, and making it again: records that people made or changed stay as they are.

`generated/STOREY.json` in the building's folder lists the last generated records. A record that is missing from the graph
since then was taken away by somebody and is not made again; a node that somebody moved or named has the origin `hand`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.errors import BuildingError
from waychair.files import is_file, read_bytes
from waychair.maps.building.building import Building, place_of, save_building, texts_of_places
from waychair.maps.building.hgraph import (
    Arc,
    GraphDoorway,
    HGraph,
    Lift,
    Node,
    NodeKind,
    NodeRef,
    Origin,
    Stop,
    SubMap,
    SubmapFrame,
    Way,
)
from waychair.maps.building.hgraph_edits import with_lift, with_submap, without_submap
from waychair.maps.drawn.places import load_places
from waychair.maps.drawn.zones import Zone, load_zones
from waychair.maps.folders.map_files import load_map
from waychair.maps.rooms.floor_rooms import FloorRooms, rooms_of_grid
from waychair.planning.building.generation.floor_graph import Sketch, sketch_of
from waychair.planning.building.generation.sketch_parts import SketchArc, SketchMap
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.types import Json, Place, Pose2

GENERATED = "generated"
NEAR = 0.75
"""[m] A generated node is the one of the last time if it is no farther from it; a room, if its middle is within a metre."""

ROOM_NEAR = 1.5

IN_LINE, APART = 0.3, 1.0
"""[m] Stops of a lift this near to each other, seen from above, are in line; lifts this far apart tell a map's heading."""


@dataclass(frozen=True, slots=True)
class Generation:
    """A building with the graph of a storey made, what it was made of, and the new places of its goals."""

    building: Building
    record: Json
    rooms: FloorRooms
    sketch: Sketch
    places: Mapping[str, Place]


def generated_storey(
    building: Building,
    storey: str,
    body: ChairBody,
    places: Mapping[str, Place] | None = None,
    zones: Sequence[Zone] | None = None,
    last: Json | None = None,
    progress: Callable[[str, float], None] = lambda part, share: None,
) -> Generation:
    """Return the building with the graph of a storey made from its map and places, not written yet.

    `places`, `zones` and the record `last` of a generation are a draft's; None for those in the building's folder.
    `progress` is called with what is done at present, and the share (0 to 1) of it that is done.

    Raises:
        BuildingError: there is no such storey, it has no map, or its last record is damaged.
        MapError, PlaceError, ZoneError: the storey's map folder is damaged.
    """
    if storey not in building.hgraph.submaps or not any(each.id == storey for each in building.hgraph.storeys):
        raise BuildingError(f"there is no storey '{storey}': add it with waychair building add")
    folder = building.map_folder(storey)
    if folder is None:
        raise BuildingError(f"storey '{storey}' has no map: add one with waychair building add --map")
    grid = load_map(folder)
    costmap = costmap_from_grid(grid, body, zones=load_zones(folder) if zones is None else zones)
    progress("finding the rooms", 0.0)
    rooms = rooms_of_grid(costmap.grid)
    last = _last_record(building.folder, storey) if last is None else last
    places = load_places(folder) if places is None else places
    known = last.get("places", {})
    new_places = {name: place for name, place in places.items() if name not in known}
    sketch = sketch_of(costmap, rooms, new_places, partial(progress, "laying out the ways"))
    hgraph, record = regenerated_storey(building.hgraph, storey, sketch, last)
    new = _new_places(hgraph, storey, places)
    kept = {name: point for name, point in known.items() if name in places}
    record["places"] = {**kept, **{name: [place.pose.x, place.pose.y] for name, place in new.items()}}
    return Generation(replace(building, hgraph=hgraph), record, rooms, sketch, new)


def save_generation(generation: Generation, storey: str) -> None:
    """Write a generated graph with its new places and its record, all or nothing; raises OutputError."""
    building, folder = generation.building, generation.building.map_folder(storey)
    record = json.dumps(generation.record, indent=2, allow_nan=False) + "\n"
    texts = {building.folder / GENERATED / f"{storey}.json": record}
    if generation.places and folder is not None:
        texts |= texts_of_places(building, storey, {**load_places(folder), **generation.places})
    save_building(building, texts)


def _new_places(hgraph: HGraph, storey: str, places: Mapping[str, Place]) -> dict[str, Place]:
    """Return a place for each generated goal of a storey that has none."""
    found = {}
    for ref, node in hgraph.nodes():
        new = node.kind is NodeKind.END and node.origin is Origin.AUTO and node.name not in places
        if new and hgraph.storey_of(ref.submap) == storey:
            x, y = hgraph.map_frame_of(ref.submap).point(node.x, node.y)
            found[node.name] = Place(node.name, Pose2(x, y, 0.0))
    return found


def with_lift_stop(hgraph: HGraph, storey: str, lift: str, place: str) -> HGraph:
    """Return the graph with the place of a storey as a stop of a lift, which is made if there is none of this id.

    Raises:
        BuildingError: no End node of the storey has this name.
    """
    for ref, node in hgraph.nodes():
        if hgraph.storey_of(ref.submap) == storey and node.name == place:
            break
    else:
        raise BuildingError(
            f"storey '{storey}' has no place '{place}' that the chair can drive to: name one of its places"
        )
    submap = hgraph.submaps[ref.submap]
    stop_node = replace(node, kind=NodeKind.LIFT, origin=Origin.HAND)
    hgraph = with_submap(hgraph, replace(submap, nodes={**submap.nodes, ref.node: stop_node}))
    heights = {each.id: each.height for each in hgraph.storeys}
    before = hgraph.lifts.get(lift, Lift(lift, lift))
    others = [stop for stop in before.stops if stop.storey != storey]
    stop = next((each for each in before.stops if each.storey == storey), Stop(storey, ref))
    stops = sorted([*others, replace(stop, at=ref)], key=lambda stop: heights[stop.storey])
    return with_lift(hgraph, replace(before, stops=tuple(stops)))


def aligned_storey(building: Building, storey: str, places: Mapping[str, Mapping[str, Place]] | None = None) -> HGraph:
    """Return the graph with a storey laid on the others by the lifts that they share.

    Two lifts or more tell how the storey's map is turned; one does by the headings of the places in front of its doors. A
    storey whose stops are in line already stays. `places` by storey are a draft's; None for those of the maps.

    Raises:
        PlaceError: the places of a storey's map are damaged.
    """
    hgraph = building.hgraph
    pairs = [
        (mine.at, other.at)
        for lift in hgraph.lifts.values()
        for mine in lift.stops
        for other in [each for each in lift.stops if each.storey != storey][:1]
        if mine.storey == storey
    ]
    here = np.array([_in_frame(hgraph, one, hgraph.map_frame_of(one.submap)) for one, _ in pairs]).reshape(-1, 2)
    there = np.array([_in_frame(hgraph, other, hgraph.frame_of(other.submap)) for _, other in pairs]).reshape(-1, 2)
    now = hgraph.storey_frame(storey)
    if (
        not pairs
        or max(math.dist(now.point(*p), q) for p, q in zip(here.tolist(), there.tolist(), strict=True)) <= IN_LINE
    ):
        return hgraph
    if len(pairs) > 1 and np.ptp(here, axis=0).max() > APART:
        p, q = here - here.mean(axis=0), there - there.mean(axis=0)
        cross, dot = float((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum()), float((p * q).sum())
        theta = math.atan2(cross, dot)
    else:
        turned = _heading(building, pairs[0][1], places) - _heading(building, pairs[0][0], places)
        theta = math.remainder(now.theta + turned, math.tau)
    c, s = math.cos(theta), math.sin(theta)
    x, y = there.mean(axis=0) - np.array([[c, -s], [s, c]]) @ here.mean(axis=0)
    frame = SubmapFrame(round(float(x), 3), round(float(y), 3), round(theta, 6), 1.0)
    return with_submap(hgraph, replace(hgraph.submaps[storey], frame=frame))


def _in_frame(hgraph: HGraph, ref: NodeRef, frame: SubmapFrame) -> tuple[float, float]:
    node = hgraph.submaps[ref.submap].nodes[ref.node]
    return frame.point(node.x, node.y)


def _heading(building: Building, ref: NodeRef, places: Mapping[str, Mapping[str, Place]] | None) -> float:
    """Return the heading [rad] of a node's place in the building's frame; that of the frame if it has no place."""
    hgraph, storey = building.hgraph, building.hgraph.storey_of(ref.submap)
    if places is None:
        place = place_of(building, ref)
    else:
        place = places.get(storey, {}).get(hgraph.submaps[ref.submap].nodes[ref.node].name)
    return hgraph.storey_frame(storey).theta + (0.0 if place is None else place.pose.theta)


def regenerated_storey(hgraph: HGraph, storey: str, sketch: Sketch, last: Json) -> tuple[HGraph, Json]:
    """Return the graph with a sketch in place of a storey's generated records, and the new record.

    Args:
        hgraph: the building.
        storey: id of the storey, whose sub-map has the same path.
        sketch: the new graph of the storey.
        last: the record of the last generation, {} if there was none.
    """
    maps = last.get("maps", {})
    paths = _room_paths(storey, sketch, maps, hgraph)
    record: Json = {"maps": {}}
    own, ids = _merged(hgraph.submaps[storey], sketch.storey, maps.get(storey, {}))
    record["maps"][storey] = _record_of(sketch.storey, ids)
    inner: list[list[str]] = []
    for path, room in zip(paths, sketch.rooms, strict=True):
        known = hgraph.submaps.get(path)
        if known is None and path in maps:  # somebody took the room away
            inner.append([])
            record["maps"][path] = maps[path]
            continue
        title = room.title or f"Room {path.rpartition('/r')[2]}"
        merged, room_ids = _merged(known or SubMap(path, title), room, maps.get(path, {}))
        hgraph = with_submap(hgraph, merged)
        record["maps"][path] = _record_of(room, room_ids)
        inner.append(room_ids)
    for path in maps:
        if path not in record["maps"] and path in hgraph.submaps and _is_untouched(hgraph.submaps[path]):
            hgraph = without_submap(hgraph, path)
    doorways, listed = _doorways(hgraph.submaps[storey], own, sketch, paths, ids, inner, last.get("doorways", []))
    record["doorways"] = listed
    return with_submap(hgraph, replace(own, doorways=doorways)), record


def _merged(known: SubMap, sketch: SketchMap, last: Json) -> tuple[SubMap, list[str]]:
    """Return a sub-map with a sketch's nodes and arcs in it, and the id of each node, also of those taken away."""
    before = {key: (role, x, y) for key, (role, x, y) in last.get("nodes", {}).items()}
    names = _matched(sketch, before, known)
    nodes = {key: node for key, node in known.nodes.items() if node.origin is Origin.HAND or key not in before}
    ids: dict[int, str] = {}
    for index, made in enumerate(sketch.nodes):
        key = names[index]
        if key in before and key not in known.nodes:
            continue  # somebody took it away
        ids[index] = key
        if key not in nodes:
            name = made.name or (_goal_name(known, key, made.role) if made.kind is NodeKind.END else "")
            x, y = (made.x, made.y) if made.role == "p" else (round(made.x, 3), round(made.y, 3))  # places stay
            nodes[key] = Node(key, made.kind, x, y, name, Origin.AUTO)
    gone = {frozenset(ends) for ends in last.get("arcs", [])} - {frozenset((a.start, a.end)) for a in known.arcs}
    kept = [arc for arc in known.arcs if arc.origin is Origin.HAND and {arc.start, arc.end} <= set(nodes)]
    old = {frozenset((arc.start, arc.end)): arc for arc in known.arcs}
    arcs = list(kept)
    taken = {frozenset((arc.start, arc.end)) for arc in kept}
    for made_arc in sketch.arcs:
        if made_arc.start not in ids or made_arc.end not in ids:
            continue
        ends = frozenset((ids[made_arc.start], ids[made_arc.end]))
        if len(ends) == 2 and ends not in gone and ends not in taken:
            arcs.append(_arc(made_arc, ids, nodes, old.get(ends)))
            taken.add(ends)
    return replace(known, nodes=nodes, arcs=tuple(arcs)), names


def _goal_name(submap: SubMap, key: str, role: str) -> str:
    """Return the name of a generated goal: that of its room, or the number of a hall, which is part of the storey."""
    return f"Hall {key.removeprefix(role)}" if submap.storey else submap.title


def _arc(made: SketchArc, ids: Mapping[int, str], nodes: Mapping[str, Node], old: Arc | None) -> Arc:
    """Return an arc; what people or drives have told about it before stays."""
    start, end = ids[made.start], ids[made.end]
    straight = math.dist((nodes[start].x, nodes[start].y), (nodes[end].x, nodes[end].y))
    way = old.way if old is not None else Way()
    length = round(max(made.length, straight), 3)
    return Arc(
        start, end, replace(way, length=length, width=made.width if way.width is None else way.width), Origin.AUTO
    )


def _matched(sketch: SketchMap, before: Mapping[str, tuple[str, float, float]], known: SubMap) -> list[str]:
    """Return an id for each node of a sketch: that of the last time if it is near, else a new one."""
    pairs = [
        (math.dist((node.x, node.y), (x, y)), index, key)
        for index, node in enumerate(sketch.nodes)
        for key, (role, x, y) in before.items()
        if role == node.role
    ]
    names: dict[int, str] = {}
    used: set[str] = set()
    for apart, index, key in sorted(pairs):
        if apart <= NEAR and index not in names and key not in used:
            names[index] = key
            used.add(key)
    taken = used | set(known.nodes) | set(before)
    for index, node in enumerate(sketch.nodes):
        if index not in names:
            names[index] = _free(node.role, taken)
            taken.add(names[index])
    return [names[index] for index in range(len(sketch.nodes))]


def _room_paths(storey: str, sketch: Sketch, maps: Mapping[str, Json], hgraph: HGraph) -> list[str]:
    """Return the path of each room of a sketch: that of the last time if its middle is near."""
    before = {path: values["middle"] for path, values in maps.items() if path != storey}
    pairs = [
        (math.dist(room.middle, middle), index, path)
        for index, room in enumerate(sketch.rooms)
        for path, middle in before.items()
    ]
    paths: dict[int, str] = {}
    for apart, index, path in sorted(pairs):
        if apart <= ROOM_NEAR and index not in paths and path not in paths.values():
            paths[index] = path
    taken = {*paths.values(), *before, *hgraph.submaps}
    for index in range(len(sketch.rooms)):
        if index not in paths:
            paths[index] = _free(f"{storey}/r", taken)
            taken.add(paths[index])
    return [paths[index] for index in range(len(sketch.rooms))]


def _doorways(
    known: SubMap,
    own: SubMap,
    sketch: Sketch,
    paths: list[str],
    ids: list[str],
    inner: list[list[str]],
    last: Iterable[list[str]],
) -> tuple[tuple[GraphDoorway, ...], list[list[str]]]:
    """Return the doorways of the storey's sub-map, and the list of those that were made."""
    old = {(each.start, each.child, each.node): each for each in known.doorways}
    gone = {tuple(each) for each in last} - set(old)
    made = {}
    for each in sketch.doorways:
        child = paths[each.room].rpartition("/")[2]
        if not inner[each.room]:
            continue
        key = ids[each.start], child, inner[each.room][each.node]
        way = old[key].way if key in old else Way(width=round(each.width, 3))
        made[key] = old.get(key) or GraphDoorway(*key, way, origin=Origin.AUTO)
    kept = {key: each for key, each in old.items() if each.origin is Origin.HAND and each.start in own.nodes}
    new = {key: each for key, each in made.items() if each.start in own.nodes}
    doorways = {key: each for key, each in {**kept, **new}.items() if key not in gone}
    return tuple(doorways.values()), [list(key) for key in made]


def _record_of(sketch: SketchMap, ids: list[str]) -> Json:
    nodes = {key: [node.role, node.x, node.y] for key, node in zip(ids, sketch.nodes, strict=True)}
    arcs = [[ids[arc.start], ids[arc.end]] for arc in sketch.arcs]
    return {"middle": list(sketch.middle), "nodes": nodes, "arcs": arcs}


def _is_untouched(submap: SubMap) -> bool:
    origins = [each.origin for each in submap.nodes.values()] + [arc.origin for arc in submap.arcs]
    return all(origin is Origin.AUTO for origin in origins)


def _free(prefix: str, taken: set[str]) -> str:
    number = 1
    while f"{prefix}{number}" in taken:
        number += 1
    return f"{prefix}{number}"


def _last_record(folder: Path, storey: str) -> Json:
    path = folder / GENERATED / f"{storey}.json"
    if not is_file(path, BuildingError):
        return {}
    try:
        record = json.loads(read_bytes(path, BuildingError))
        for values in record["maps"].values():
            for role, x, y in values["nodes"].values():
                math.dist((x, y), values["middle"])
                str(role)
            [frozenset((start, end)) for start, end in values["arcs"]]
        [(start, child, node) for start, child, node in record["doorways"]]
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise BuildingError(
            f"{path} is damaged: remove it; people's own records stay, removed ones are made anew"
        ) from error
    return dict(record)
