"""Operations on the tree, the storeys and the costs of a building."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path

import msgspec

from waychair.errors import BuildingError
from waychair.maps.building.building import HIGHEST_M, Building, add_storey
from waychair.maps.building.costs import CostSettings
from waychair.maps.building.hgraph import (
    Arc,
    GraphDoorway,
    HGraph,
    Lift,
    Node,
    NodeKind,
    NodeRef,
    Storey,
    SubMap,
    SubmapFrame,
    child_path,
    parent_path,
)
from waychair.maps.building.hgraph_edits import with_storey, with_submap, without_submap
from waychair.maps.building.hgraph_files import ROOT_FILE
from waychair.maps.building.records import line_of
from waychair.maps.building.text_forms import (
    costs_of,
    is_id,
    storey_line,
    storey_of,
    submap_line,
    submap_of,
)
from waychair.maps.editing.addresses import PREFIXES, checked_line_of, free_id, node_at, node_ref, submap_at
from waychair.maps.editing.arc_edits import Operation
from waychair.maps.editing.draft import Draft
from waychair.maps.editing.lift_edits import with_stops_in_order
from waychair.maps.editing.node_edits import without_place


class ChangeBuilding(Operation, frozen=True, tag="change_building"):
    """Change the building's name, or what turns, doors and lifts cost (`CostSettings`)."""

    name: str | None = None
    costs: dict[str, float] = msgspec.field(default_factory=dict)


class AddStorey(Operation, frozen=True, tag="add_storey"):
    """Add a storey and its sub-map; `map`: its map folder, relative to the building's, which must be there."""

    id: str
    name: str = ""
    height: float = 0.0
    map: str = ""


class ChangeStorey(Operation, frozen=True, tag="change_storey"):
    """Change a storey's name and height above the ground [m]."""

    id: str
    name: str
    height: float


class DeleteStorey(Operation, frozen=True, tag="delete_storey"):
    """Delete a storey with its sub-maps and its stops; its map folder stays."""

    id: str


class AddSubmap(Operation, frozen=True, tag="add_submap"):
    """Add a sub-map below another, its origin at x, y [m] in its parent's frame; `storey` where it is not the parent's."""

    parent: str
    id: str
    name: str = ""
    x: float = 0.0
    y: float = 0.0
    storey: str = ""


class ChangeSubmap(Operation, frozen=True, tag="change_submap"):
    """Change a sub-map's name and its frame in its parent's: x, y [m], theta [rad], scale."""

    path: str
    name: str
    x: float
    y: float
    theta: float
    scale: float


class MoveSubmap(Operation, frozen=True, tag="move_submap"):
    """Move a sub-map in the tree, or rename its id: `to` is its new path. Its place in the building stays."""

    path: str
    to: str


class DeleteSubmap(Operation, frozen=True, tag="delete_submap"):
    """Delete a sub-map, everything below it, and the doorways and stops that lead there."""

    path: str


class SplitSubmap(Operation, frozen=True, tag="split_submap"):
    """Make a room of some nodes of a sub-map: they go into a new child; arcs that lead out become doorways."""

    nodes: tuple[str, ...]
    id: str
    name: str = ""


class MergeSubmap(Operation, frozen=True, tag="merge_submap"):
    """Dissolve a sub-map without children into its parent: its nodes go there, and its doorways become arcs."""

    path: str


def change_building(draft: Draft, asked: ChangeBuilding) -> Draft:
    """Return the draft with the building's name or costs changed."""
    hgraph = draft.hgraph
    if asked.name is not None:
        if not asked.name.strip() or not asked.name.isprintable():
            raise BuildingError("the building's name is empty or has a line break: give another one")
        hgraph = replace(hgraph, name=asked.name.strip())
    known = {entry.name for entry in fields(CostSettings)}
    for key in asked.costs:
        if key not in known:
            raise BuildingError(f"'{key}' is no cost: choose {', '.join(sorted(known))}")
    values = {key: getattr(hgraph.costs, key) for key in known} | asked.costs
    checked_line_of(line_of("cost", list(values.items())), costs_of)
    return replace(draft, hgraph=replace(hgraph, costs=CostSettings(**values)))


def add_storey_to(draft: Draft, asked: AddStorey) -> Draft:
    """Return the draft with a storey; the caller adds the places and zones of its map."""
    storey = Storey(asked.id, asked.name.strip(), asked.height, asked.map)
    checked_line_of(storey_line(storey), storey_of)
    return replace(draft, hgraph=add_storey(Building(Path(), draft.hgraph), storey).hgraph)


def change_storey(draft: Draft, asked: ChangeStorey) -> Draft:
    """Return the draft with a storey's name and height changed; its sub-map has the same name."""
    storey = _storey_at(draft.hgraph, asked.id)
    if not -HIGHEST_M <= asked.height <= HIGHEST_M:
        raise BuildingError(f"a storey {asked.height:g} m above the ground is impossible: give at most {HIGHEST_M:g} m")
    changed = replace(storey, name=asked.name.strip(), height=asked.height)
    checked_line_of(storey_line(changed), storey_of)
    hgraph = with_storey(draft.hgraph, changed)
    submap = hgraph.submaps.get(asked.id)
    if submap is not None and submap.name == storey.name:
        hgraph = with_submap(hgraph, replace(submap, name=changed.name))
    return replace(draft, hgraph=with_stops_in_order(hgraph))


def delete_storey(draft: Draft, asked: DeleteStorey) -> Draft:
    """Return the draft without a storey."""
    _storey_at(draft.hgraph, asked.id)
    hgraph = draft.hgraph
    for path in [each for each, submap in hgraph.submaps.items() if submap.storey == asked.id and each]:
        if path in hgraph.submaps:
            hgraph = without_submap(hgraph, path)
    lifts = {
        key: replace(lift, stops=tuple(stop for stop in lift.stops if stop.storey != asked.id))
        for key, lift in hgraph.lifts.items()
    }
    storeys = tuple(each for each in hgraph.storeys if each.id != asked.id)
    places = {key: value for key, value in draft.places.items() if key != asked.id}
    zones = {key: value for key, value in draft.zones.items() if key != asked.id}
    texts = {key: value for key, value in draft.texts.items() if key != f"generated/{asked.id}.json"}
    return Draft(replace(hgraph, storeys=storeys, lifts=lifts), places, zones, texts)


def add_submap(draft: Draft, asked: AddSubmap) -> Draft:
    """Return the draft with a sub-map."""
    submap_at(draft.hgraph, asked.parent)
    path = _free_path(draft.hgraph, child_path(asked.parent, asked.id))
    if asked.storey:
        _storey_at(draft.hgraph, asked.storey)
    storey = "" if asked.storey == draft.hgraph.storey_of(asked.parent) else asked.storey
    submap = SubMap(path, asked.name.strip(), SubmapFrame(asked.x, asked.y), storey)
    checked_line_of(submap_line(submap), submap_of)
    return replace(draft, hgraph=with_submap(draft.hgraph, submap))


def change_submap(draft: Draft, asked: ChangeSubmap) -> Draft:
    """Return the draft with a sub-map's name and frame changed."""
    if not asked.path:
        raise BuildingError("the root's frame is the building's: change the frames of the sub-maps below it")
    submap = submap_at(draft.hgraph, asked.path)
    changed = replace(submap, name=asked.name.strip(), frame=SubmapFrame(asked.x, asked.y, asked.theta, asked.scale))
    checked_line_of(submap_line(changed), submap_of)
    return replace(draft, hgraph=with_submap(draft.hgraph, changed))


def move_submap(draft: Draft, asked: MoveSubmap) -> Draft:
    """Return the draft with a sub-map and everything below it at another path; doorways from another parent go."""
    hgraph, old, new = draft.hgraph, asked.path, asked.to
    submap_at(hgraph, old)
    if old == new:
        return draft
    if not old or new.startswith(f"{old}/"):
        raise BuildingError(f"'{old}' cannot be moved to '{new}', below itself: choose another parent")
    if parent_path(new) not in hgraph.submaps:
        raise BuildingError(f"there is no sub-map '{parent_path(new)}' to put it in: add it first")
    if hgraph.submaps[old].storey:
        raise BuildingError(f"'{old}' is a storey's sub-map, named as the storey: it stays where it is")
    if hgraph.storey_of(parent_path(new)) != hgraph.storey_of(old):
        raise BuildingError(f"'{new}' lies on another storey: delete the sub-map here, and make it there")
    _free_path(hgraph, new)
    same_parent = parent_path(old) == parent_path(new)
    frame = hgraph.submaps[old].frame if same_parent else _relative(hgraph, parent_path(new), old)

    def path_of(path: str) -> str:
        return new + path[len(old) :] if path == old or path.startswith(f"{old}/") else path

    submaps = {}
    for path, each in hgraph.submaps.items():
        moved = replace(each, path=path_of(path), source=each.source if path_of(path) == path else None)
        submaps[path_of(path)] = (
            replace(moved, frame=frame) if path == old else moved if path_of(path) != path else each
        )
    parent, last = submaps[parent_path(old)], old.rpartition("/")[2]
    doors = [
        replace(door, child=new.rpartition("/")[2]) if door.child == last else door
        for door in parent.doorways
        if same_parent or door.child != last
    ]
    submaps[parent.path] = replace(parent, doorways=tuple(doors))
    lifts = _with_refs(hgraph.lifts, lambda ref: NodeRef(path_of(ref.submap), ref.node))
    order = sorted(submaps, key=lambda path: path.count("/") + bool(path))
    return replace(draft, hgraph=replace(hgraph, submaps={path: submaps[path] for path in order}, lifts=lifts))


def delete_submap(draft: Draft, asked: DeleteSubmap) -> Draft:
    """Return the draft without a sub-map and what is below it, and without the places of its goals."""
    submap = submap_at(draft.hgraph, asked.path)
    if not asked.path or submap.storey == asked.path:
        raise BuildingError("the root and the storeys' own sub-maps stay: delete the storey instead")
    for path in draft.hgraph.submaps:
        if path == asked.path or path.startswith(f"{asked.path}/"):
            storey = draft.hgraph.storey_of(path)
            for node in draft.hgraph.submaps[path].nodes.values():
                if node.kind is NodeKind.END and node.name in draft.places_of(storey):
                    draft = without_place(draft, storey, node.name)
    return replace(draft, hgraph=without_submap(draft.hgraph, asked.path))


def split_submap(draft: Draft, asked: SplitSubmap) -> Draft:
    """Return the draft with nodes of a sub-map in a new child.

    Where an arc led out of them, a door stands at the arc's outer end: a doorway there, and an arc from it in the room.
    """
    refs = [node_ref(text) for text in asked.nodes]
    if not refs or len({ref.submap for ref in refs}) != 1:
        raise BuildingError("choose one or more nodes of one sub-map to make a room of")
    path = refs[0].submap
    for ref in refs:
        node_at(draft.hgraph, ref)
    hgraph = add_submap(draft, AddSubmap(path, asked.id, asked.name)).hgraph
    submap, going = hgraph.submaps[path], {ref.node for ref in refs}
    if any(door.start in going for door in submap.doorways):
        raise BuildingError("a node with a doorway to another room stays in the corridor: choose other nodes")
    nodes = {key: node for key, node in submap.nodes.items() if key in going}
    arcs: list[Arc] = []
    kept: list[Arc] = []
    doors = list(submap.doorways)
    for arc in submap.arcs:
        own = arc.start if arc.start in going else arc.end
        other = arc.end if own == arc.start else arc.start
        if other in going or own not in going:
            (arcs if own in going else kept).append(arc)
            continue
        outer = submap.nodes[other]
        door = Node(free_id("d", nodes), NodeKind.BRIDGE, outer.x, outer.y)
        nodes[door.id] = door
        arcs.append(replace(arc, start=door.id if arc.start == other else own, end=own if arc.end == own else door.id))
        way = replace(arc.way, length=None, drive_s=None, price=None)
        doors.append(GraphDoorway(other, asked.id, door.id, way, way.one_way and arc.start == own))
    rest = replace(
        submap,
        nodes={key: node for key, node in submap.nodes.items() if key not in going},
        arcs=tuple(kept),
        doorways=tuple(doors),
        beacons=tuple(replace(tag, node="") if tag.node in going else tag for tag in submap.beacons),
    )
    room = child_path(path, asked.id)
    hgraph = with_submap(hgraph, rest)
    hgraph = with_submap(hgraph, replace(hgraph.submaps[room], nodes=nodes, arcs=tuple(arcs)))
    moved = {ref: NodeRef(room, ref.node) for ref in refs}
    return replace(draft, hgraph=replace(hgraph, lifts=_with_refs(hgraph.lifts, lambda ref: moved.get(ref, ref))))


def merge_submap(draft: Draft, asked: MergeSubmap) -> Draft:
    """Return the draft with a sub-map's nodes in its parent, its doorways as arcs."""
    hgraph = draft.hgraph
    submap = submap_at(hgraph, asked.path)
    if not asked.path or submap.storey or hgraph.children(asked.path):
        raise BuildingError("a room without rooms of its own can be dissolved: the root, storeys and wings stay")
    parent, last = hgraph.submaps[parent_path(asked.path)], asked.path.rpartition("/")[2]
    taken, ids = set(parent.nodes), dict[str, str]()
    for key, node in submap.nodes.items():
        ids[key] = key if key not in taken else free_id(PREFIXES[node.kind], taken)
        taken.add(ids[key])
    nodes = dict(parent.nodes)
    for key, node in submap.nodes.items():
        x, y = submap.frame.point(node.x, node.y)
        kind = NodeKind.CROSS if node.kind is NodeKind.BRIDGE else node.kind
        nodes[ids[key]] = replace(node, id=ids[key], kind=kind, x=round(x, 4), y=round(y, 4))
    arcs = [*parent.arcs, *(replace(arc, start=ids[arc.start], end=ids[arc.end]) for arc in submap.arcs)]
    for door in parent.doorways:
        if door.child == last and door.node in ids:
            ends = (ids[door.node], door.start) if door.outwards else (door.start, ids[door.node])
            arcs.append(Arc(*ends, door.way))
    moved = {NodeRef(asked.path, key): NodeRef(parent.path, new) for key, new in ids.items()}
    hgraph = replace(hgraph, lifts=_with_refs(hgraph.lifts, lambda ref: moved.get(ref, ref)))
    hgraph = without_submap(hgraph, asked.path)
    merged = replace(hgraph.submaps[parent.path], nodes=nodes, arcs=tuple(arcs))
    return replace(draft, hgraph=with_submap(hgraph, merged))


def _storey_at(hgraph: HGraph, key: str) -> Storey:
    found = next((each for each in hgraph.storeys if each.id == key), None)
    if found is None:
        raise BuildingError(f"there is no storey '{key}': somebody has deleted it")
    return found


def _free_path(hgraph: HGraph, path: str) -> str:
    last = path.rpartition("/")[2]
    if not is_id(last):
        raise BuildingError(f"'{last}' cannot name a sub-map: use letters, digits, _, - and .")
    if path in hgraph.submaps:
        raise BuildingError(f"there is a sub-map '{path}' already: choose another id")
    if path == ROOT_FILE:
        raise BuildingError(f"'{ROOT_FILE}' is the name of the root's own file: choose another id")
    return path


def _relative(hgraph: HGraph, parent: str, path: str) -> SubmapFrame:
    """Return the frame of a sub-map in that of another one, both where they are in the building."""
    outer, inner = hgraph.frame_of(parent), hgraph.frame_of(path)
    x, y = outer.inside(inner.x, inner.y)
    theta = math.remainder(inner.theta - outer.theta, math.tau)
    return SubmapFrame(round(x, 4), round(y, 4), round(theta, 6), inner.scale / outer.scale)


def _with_refs(lifts: Mapping[str, Lift], moved: Callable[[NodeRef], NodeRef]) -> dict[str, Lift]:
    return {
        key: replace(lift, stops=tuple(replace(stop, at=moved(stop.at)) for stop in lift.stops))
        for key, lift in lifts.items()
    }
