"""Operations on nodes: add, change, move, split, merge, delete."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import msgspec

from waychair.errors import BuildingError
from waychair.maps.building.hgraph import (
    Arc,
    HGraph,
    Node,
    NodeKind,
    NodeRef,
    Origin,
    SubMap,
    inner_end,
    parent_path,
)
from waychair.maps.building.hgraph_edits import with_nodes, with_submap, without_node
from waychair.maps.editing.addresses import (
    PREFIXES,
    free_id,
    node_at,
    node_ref,
    submap_at,
)
from waychair.maps.editing.arc_edits import Join, Operation, join, point_inside, with_node
from waychair.maps.editing.draft import Draft, moved_place
from waychair.types import Place, Pose2


class AddNode(Operation, frozen=True, tag="add_node"):
    """Add a node at x, y [m] in its storey's map; `joined` names nodes to join it to. `id`: "" for a free one."""

    submap: str
    x: float
    y: float
    kind: str = "cross"
    name: str = ""
    joined: tuple[str, ...] = ()
    id: str = ""


class ChangeNode(Operation, frozen=True, tag="change_node"):
    """Change a node's kind or name, or its id; a goal's place takes its name, too."""

    node: str
    kind: str | None = None
    name: str | None = None
    id: str | None = None


class MoveNodes(Operation, frozen=True, tag="move_nodes"):
    """Move nodes by x, y [m] in their storey's map; goals take their places with them."""

    nodes: tuple[str, ...]
    x: float
    y: float


class DeleteNodes(Operation, frozen=True, tag="delete_nodes"):
    """Delete nodes, the arcs and doorways at them, and the places of goals."""

    nodes: tuple[str, ...]


class MergeNodes(Operation, frozen=True, tag="merge_nodes"):
    """Make two nodes of one sub-map one, which keeps the first one's id and place."""

    kept: str
    gone: str


class SplitNode(Operation, frozen=True, tag="split_node"):
    """Split a node with many arcs: those to one side go to a new node, `apart` metres from it."""

    node: str
    apart: float = 0.6


def add_node(draft: Draft, asked: AddNode) -> Draft:
    """Return the draft with a node, joined to others; a goal gets a place if there is none of its name."""
    hgraph, kind = draft.hgraph, kind_of(asked.kind)
    submap = submap_at(hgraph, asked.submap)
    if asked.id in submap.nodes:
        raise BuildingError(f"there is a node '{asked.id}' in this sub-map already: choose another id")
    node = Node(
        asked.id or free_id(PREFIXES[kind], submap.nodes),
        kind,
        *point_inside(hgraph, submap.path, asked.x, asked.y),
        asked.name,
    )
    storey = hgraph.storey_of(submap.path)
    if kind is NodeKind.END and not asked.name:
        node = replace(node, name=free_id("Place ", draft.places_of(storey)))
    draft = with_node(draft, submap, node)
    if kind is NodeKind.END and node.name not in draft.places_of(storey):
        draft = with_place(draft, storey, Place(node.name, Pose2(asked.x, asked.y)))
    for other in asked.joined:
        draft = join(draft, Join(other, str(NodeRef(submap.path, node.id))))
    return draft


def with_id(draft: Draft, asked: AddNode) -> AddNode:
    """Return the operation with the id that its node gets, so that done again later it means the same node."""
    if asked.id:
        return asked
    taken = submap_at(draft.hgraph, asked.submap).nodes
    return msgspec.structs.replace(asked, id=free_id(PREFIXES[kind_of(asked.kind)], taken))


def change_node(draft: Draft, asked: ChangeNode) -> Draft:
    """Return the draft with a node's kind, name or id changed."""
    ref = node_ref(asked.node)
    node, submap = node_at(draft.hgraph, ref), draft.hgraph.submaps[ref.submap]
    changed = replace(
        node,
        kind=node.kind if asked.kind is None else kind_of(asked.kind),
        name=node.name if asked.name is None else asked.name.strip(),
        origin=Origin.HAND,
    )
    draft = _with_place_of(draft, ref, node, changed)
    draft = with_node(draft, submap, changed)
    if changed.kind is not NodeKind.LIFT and node.kind is NodeKind.LIFT:
        draft = replace(draft, hgraph=_without_stops(draft.hgraph, {ref}))
    if asked.id is None or asked.id == node.id:
        return draft
    if asked.id in submap.nodes:
        raise BuildingError(f"there is a node '{asked.id}' in this sub-map already: choose another id")
    renamed = NodeRef(ref.submap, asked.id)
    draft = with_node(draft, draft.hgraph.submaps[ref.submap], replace(changed, id=asked.id))
    return replace(draft, hgraph=without(relinked(draft.hgraph, {ref: renamed}), {ref}))


def move_nodes(draft: Draft, asked: MoveNodes) -> Draft:
    """Return the draft with nodes moved."""
    for text in asked.nodes:
        ref = node_ref(text)
        node = node_at(draft.hgraph, ref)
        x, y = draft.map_point(ref)
        x, y = round(x + asked.x, 4), round(y + asked.y, 4)
        inside = point_inside(draft.hgraph, ref.submap, x, y)
        draft = with_node(
            draft, draft.hgraph.submaps[ref.submap], replace(node, x=inside[0], y=inside[1], origin=Origin.HAND)
        )
        storey = draft.hgraph.storey_of(ref.submap)
        place = draft.places_of(storey).get(node.name)
        if node.kind is NodeKind.END and place is not None:
            draft = with_place(draft, storey, moved_place(place, x, y))
    return draft


def delete_nodes(draft: Draft, asked: DeleteNodes) -> Draft:
    """Return the draft without nodes, and without the places of goals."""
    refs = {node_ref(text) for text in asked.nodes}
    for ref in refs:
        node, storey = node_at(draft.hgraph, ref), draft.hgraph.storey_of(ref.submap)
        if node.kind is NodeKind.END and node.name in draft.places_of(storey):
            draft = without_place(draft, storey, node.name)
    return replace(draft, hgraph=without(draft.hgraph, refs))


def merge_nodes(draft: Draft, asked: MergeNodes) -> Draft:
    """Return the draft with one node in place of two; arcs between them and doubled arcs go."""
    kept, gone = node_ref(asked.kept), node_ref(asked.gone)
    node_at(draft.hgraph, kept), node_at(draft.hgraph, gone)
    if kept == gone or kept.submap != gone.submap:
        raise BuildingError("two different nodes of one sub-map can become one: join others by a doorway")
    hgraph = relinked(draft.hgraph, {gone: kept})
    submap = hgraph.submaps[kept.submap]
    seen: set[frozenset[str]] = set()
    arcs = []
    for arc in submap.arcs:
        ends = frozenset((arc.start, arc.end))
        if len(ends) == 2 and ends not in seen:
            arcs.append(arc)
        seen.add(ends)
    hgraph = with_submap(hgraph, replace(submap, arcs=tuple(arcs)))
    return delete_nodes(replace(draft, hgraph=hgraph), DeleteNodes((asked.gone,)))


def split_node(draft: Draft, asked: SplitNode) -> Draft:
    """Return the draft with about half of a node's arcs, those in neighbouring directions, at a new node joined to it."""
    ref = node_ref(asked.node)
    node, submap = node_at(draft.hgraph, ref), draft.hgraph.submaps[ref.submap]
    if not 0.05 <= asked.apart <= 20.0:
        raise BuildingError(f"{asked.apart:g} m is no distance between the two nodes: give 0.05 to 20 m")
    angles = _directions(draft.hgraph, submap, node)
    if len(angles) < 2:
        raise BuildingError(f"node {ref} has {len(angles)} arcs: only a node with two or more can be split")
    turned = sorted(angles, key=lambda other: angles[other])
    gaps = [(angles[turned[(i + 1) % len(turned)]] - angles[turned[i]]) % math.tau for i in range(len(turned))]
    first = (max(range(len(gaps)), key=gaps.__getitem__) + 1) % len(turned)
    turned = turned[first:] + turned[:first]
    going = turned[len(turned) // 2 :]
    middle = math.atan2(sum(math.sin(angles[each]) for each in going), sum(math.cos(angles[each]) for each in going))
    x, y = node.x + asked.apart * math.cos(middle), node.y + asked.apart * math.sin(middle)
    new = Node(free_id(PREFIXES[NodeKind.CROSS], submap.nodes), NodeKind.CROSS, round(x, 4), round(y, 4))
    arcs = [_redirected(arc, node.id, new.id) if _other(arc, node.id) in going else arc for arc in submap.arcs]
    doors = [
        replace(door, start=new.id) if door.start == node.id and f"{door.child}:{door.node}" in going else door
        for door in submap.doorways
    ]
    split = replace(with_nodes(submap, [new]), arcs=(*arcs, Arc(node.id, new.id)), doorways=tuple(doors))
    return replace(draft, hgraph=with_submap(draft.hgraph, split))


def with_place(draft: Draft, storey: str, place: Place) -> Draft:
    """Return the draft with a place added to a storey's map or replaced; storeys without a map have none."""
    if storey not in draft.places:
        return draft
    return replace(draft, places={**draft.places, storey: {**draft.places[storey], place.name: place}})


def without_place(draft: Draft, storey: str, name: str) -> Draft:
    """Return the draft without a place."""
    kept = {key: place for key, place in draft.places_of(storey).items() if key != name}
    return replace(draft, places={**draft.places, storey: kept})


def without(hgraph: HGraph, refs: set[NodeRef]) -> HGraph:
    """Return the graph without nodes and without arcs, doorways and stops at them."""
    for ref in refs:
        submap = hgraph.submaps[ref.submap]
        hgraph = with_submap(hgraph, without_node(submap, ref.node))
        if ref.submap:
            parent = hgraph.submaps[parent_path(ref.submap)]
            doors = tuple(door for door in parent.doorways if inner_end(parent, door) != ref)
            if len(doors) != len(parent.doorways):
                hgraph = with_submap(hgraph, replace(parent, doorways=doors))
    return _without_stops(hgraph, refs)


def relinked(hgraph: HGraph, moved: Mapping[NodeRef, NodeRef]) -> HGraph:
    """Return the graph with arcs, doorways, stops and beacons of nodes at other nodes of the same sub-map."""
    for old, new in moved.items():
        submap = hgraph.submaps[old.submap]
        arcs = tuple(_redirected(arc, old.node, new.node) for arc in submap.arcs)
        doors = tuple(replace(door, start=new.node) if door.start == old.node else door for door in submap.doorways)
        tags = tuple(replace(tag, node=new.node) if tag.node == old.node else tag for tag in submap.beacons)
        hgraph = with_submap(hgraph, replace(submap, arcs=arcs, doorways=doors, beacons=tags))
        if old.submap:
            parent = hgraph.submaps[parent_path(old.submap)]
            doors = tuple(
                replace(door, node=new.node) if inner_end(parent, door) == old else door for door in parent.doorways
            )
            hgraph = with_submap(hgraph, replace(parent, doorways=doors))
        lifts = {
            key: replace(lift, stops=tuple(replace(stop, at=new) if stop.at == old else stop for stop in lift.stops))
            for key, lift in hgraph.lifts.items()
        }
        hgraph = replace(hgraph, lifts=lifts)
    return hgraph


def _without_stops(hgraph: HGraph, refs: set[NodeRef]) -> HGraph:
    lifts = {
        key: replace(lift, stops=tuple(stop for stop in lift.stops if stop.at not in refs))
        for key, lift in hgraph.lifts.items()
    }
    return replace(hgraph, lifts=lifts)


def _with_place_of(draft: Draft, ref: NodeRef, before: Node, after: Node) -> Draft:
    """Return the draft with a goal's place under its new name; a node that becomes a goal gets a place."""
    storey = draft.hgraph.storey_of(ref.submap)
    places = draft.places_of(storey)
    if after.kind is not NodeKind.END or not after.name:
        return draft
    known = places.get(before.name)
    if before.kind is NodeKind.END and known is not None and before.name != after.name and after.name not in places:
        renamed = {after.name if key == before.name else key: place for key, place in places.items()}
        renamed[after.name] = replace(known, name=after.name)
        return replace(draft, places={**draft.places, storey: renamed})
    if after.name not in places:
        return with_place(draft, storey, Place(after.name, Pose2(*draft.map_point(ref))))
    return draft


def kind_of(text: str) -> NodeKind:
    if text not in ("end", "cross", "door", "lift"):
        raise BuildingError(f"'{text}' is no kind of node: choose end, cross, door or lift")
    return NodeKind(text)


def _redirected(arc: Arc, old: str, new: str) -> Arc:
    start, end = (new if each == old else each for each in (arc.start, arc.end))
    return arc if (start, end) == (arc.start, arc.end) else replace(arc, start=start, end=end)


def _other(arc: Arc, node: str) -> str:
    return arc.end if arc.start == node else arc.start if arc.end == node else ""


def _directions(hgraph: HGraph, submap: SubMap, node: Node) -> dict[str, float]:
    """Return the directions [rad] of a node's arcs and doorways in its sub-map's frame, by their other ends."""
    found = {}
    for arc in submap.arcs:
        if (other := _other(arc, node.id)) and other != node.id:
            end = submap.nodes[other]
            found[other] = math.atan2(end.y - node.y, end.x - node.x)
    for door in submap.doorways:
        child = hgraph.submaps.get(inner_end(submap, door).submap)
        if door.start == node.id and child is not None:
            ends = [each for each in child.nodes.values() if each.id != door.node] or list(child.nodes.values())
            x = sum(each.x for each in ends) / max(len(ends), 1)
            y = sum(each.y for each in ends) / max(len(ends), 1)
            px, py = child.frame.point(x, y)
            found[f"{door.child}:{door.node}"] = math.atan2(py - node.y, px - node.x)
    return found
