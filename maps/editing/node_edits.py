"""Operations on nodes, arcs and doorways: add, move, join, split, merge, delete, and what an arc costs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime

import msgspec

from waychair.errors import BuildingError
from waychair.maps.building.hgraph import (
    Arc,
    Closure,
    Doorway,
    HGraph,
    Node,
    NodeKind,
    NodeRef,
    Origin,
    SubMap,
    Way,
    inner_end,
    parent_path,
)
from waychair.maps.building.hgraph_edits import arc_ref, with_nodes, with_submap, without_node
from waychair.maps.building.storey_checks import SAME_M
from waychair.maps.building.text_forms import arc_line, arc_of, doorway_line, doorway_of, node_line, node_of
from waychair.maps.editing.addresses import (
    PREFIXES,
    arc_at,
    checked_line_of,
    free_id,
    node_at,
    node_ref,
    ref_of_arc,
    submap_at,
)
from waychair.maps.editing.draft import Draft, moved_place
from waychair.types import Place, Pose2


class Operation(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", omit_defaults=True):
    """An edit as data: its JSON has the class's tag as `do` and its fields."""


class AddNode(Operation, tag="add_node"):
    """Add a node at x, y [m] in its storey's map; `joined` names nodes to join it to."""

    submap: str
    x: float
    y: float
    kind: str = "cross"
    name: str = ""
    joined: tuple[str, ...] = ()


class ChangeNode(Operation, tag="change_node"):
    """Change a node's kind or name, or its id; a goal's place takes its name, too."""

    node: str
    kind: str | None = None
    name: str | None = None
    id: str | None = None


class MoveNodes(Operation, tag="move_nodes"):
    """Move nodes by x, y [m] in their storey's map; goals take their places with them."""

    nodes: tuple[str, ...]
    x: float
    y: float


class DeleteNodes(Operation, tag="delete_nodes"):
    """Delete nodes, the arcs and doorways at them, and the places of goals."""

    nodes: tuple[str, ...]


class MergeNodes(Operation, tag="merge_nodes"):
    """Make two nodes of one sub-map one, which keeps the first one's id and place."""

    kept: str
    gone: str


class SplitNode(Operation, tag="split_node"):
    """Split a node with many arcs: those to one side go to a new node, `apart` metres from it."""

    node: str
    apart: float = 0.6


class Join(Operation, tag="join"):
    """Join two nodes: by an arc in one sub-map, by a doorway between a sub-map and its parent or between two rooms."""

    one: str
    other: str
    one_way: bool = False
    width: float | None = None


class ChangeArc(Operation, tag="change_arc"):
    """Change an arc's or doorway's properties, all of them; None where unknown.

    `direction`: "both", "there" (from the first of its two ends as named) or "back". `until`: a time in UTC.
    """

    arc: str
    length: float | None = None
    width: float | None = None
    speed: float | None = None
    drive_s: float | None = None
    price: float | None = None
    direction: str = "both"
    ramp: bool = False
    closed: str = ""
    until: str = ""


class DeleteArcs(Operation, tag="delete_arcs"):
    """Delete arcs and doorways."""

    arcs: tuple[str, ...]


class SplitArc(Operation, tag="split_arc"):
    """Put a cross node on an arc, at x, y [m] in its storey's map or in its middle."""

    arc: str
    x: float | None = None
    y: float | None = None


class CrossArcs(Operation, tag="cross_arcs"):
    """Put a cross node where two arcs of one sub-map cross."""

    one: str
    other: str


def add_node(draft: Draft, asked: AddNode) -> Draft:
    """Return the draft with a node, joined to others; a goal gets a place if there is none of its name."""
    hgraph, kind = draft.hgraph, _kind(asked.kind)
    submap = submap_at(hgraph, asked.submap)
    node = Node(
        free_id(PREFIXES[kind], submap.nodes), kind, *_inside(hgraph, submap.path, asked.x, asked.y), asked.name
    )
    storey = hgraph.storey_of(submap.path)
    if kind is NodeKind.END and not asked.name:
        node = replace(node, name=free_id("Place ", draft.places_of(storey)))
    draft = _with_node(draft, submap, node)
    if kind is NodeKind.END and node.name not in draft.places_of(storey):
        draft = with_place(draft, storey, Place(node.name, Pose2(asked.x, asked.y)))
    for other in asked.joined:
        draft = join(draft, Join(other, str(NodeRef(submap.path, node.id))))
    return draft


def change_node(draft: Draft, asked: ChangeNode) -> Draft:
    """Return the draft with a node's kind, name or id changed."""
    ref = node_ref(asked.node)
    node, submap = node_at(draft.hgraph, ref), draft.hgraph.submaps[ref.submap]
    changed = replace(
        node,
        kind=node.kind if asked.kind is None else _kind(asked.kind),
        name=node.name if asked.name is None else asked.name.strip(),
        origin=Origin.HAND,
    )
    draft = _with_place_of(draft, ref, node, changed)
    draft = _with_node(draft, submap, changed)
    if changed.kind is not NodeKind.LIFT and node.kind is NodeKind.LIFT:
        draft = replace(draft, hgraph=_without_stops(draft.hgraph, {ref}))
    if asked.id is None or asked.id == node.id:
        return draft
    if asked.id in submap.nodes:
        raise BuildingError(f"there is a node '{asked.id}' in this sub-map already: choose another id")
    renamed = NodeRef(ref.submap, asked.id)
    draft = _with_node(draft, draft.hgraph.submaps[ref.submap], replace(changed, id=asked.id))
    return replace(draft, hgraph=without(relinked(draft.hgraph, {ref: renamed}), {ref}))


def move_nodes(draft: Draft, asked: MoveNodes) -> Draft:
    """Return the draft with nodes moved."""
    for text in asked.nodes:
        ref = node_ref(text)
        node = node_at(draft.hgraph, ref)
        x, y = draft.map_point(ref)
        x, y = round(x + asked.x, 4), round(y + asked.y, 4)
        inside = _inside(draft.hgraph, ref.submap, x, y)
        draft = _with_node(
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


def join(draft: Draft, asked: Join) -> Draft:
    """Return the draft with two nodes joined."""
    one, other = node_ref(asked.one), node_ref(asked.other)
    hgraph = draft.hgraph
    node_at(hgraph, one), node_at(hgraph, other)
    if one == other:
        raise BuildingError("an arc needs two nodes: choose another one")
    way = Way(width=asked.width, one_way=asked.one_way)
    if one.submap == other.submap:
        submap = hgraph.submaps[one.submap]
        if any({arc.start, arc.end} == {one.node, other.node} for arc in submap.arcs):
            raise BuildingError(f"{one} and {other} are joined already")
        arc = Arc(one.node, other.node, way)
        checked_line_of(arc_line(arc), arc_of)
        return replace(draft, hgraph=with_submap(hgraph, replace(submap, arcs=(*submap.arcs, arc))))
    if other.submap and parent_path(other.submap) == one.submap:
        return _with_doorway(draft, one, other, way, outwards=False)
    if one.submap and parent_path(one.submap) == other.submap:
        return _with_doorway(draft, other, one, way, outwards=asked.one_way)
    if one.submap and other.submap and parent_path(one.submap) == parent_path(other.submap):
        return _with_shared_door(draft, one, other, way)
    raise BuildingError(
        f"{one} and {other} cannot be joined: a doorway leads from a sub-map to its parent, or between two of one parent"
    )


def change_arc(draft: Draft, asked: ChangeArc) -> Draft:
    """Return the draft with an arc's or doorway's properties changed."""
    ref = ref_of_arc(asked.arc)
    submap, known = submap_at(draft.hgraph, ref.submap), arc_at(draft.hgraph, ref)
    if asked.direction not in ("both", "there", "back"):
        raise BuildingError(f"'{asked.direction}' is no direction: choose both, there or back")
    closure = Closure(asked.closed.strip(), _time_ns(asked.until)) if asked.closed.strip() else None
    one_way = asked.direction != "both"
    way = Way(asked.length, asked.width, asked.speed, asked.drive_s, asked.price, one_way, asked.ramp, closure)
    turned = one_way and (asked.direction == "back") == (ref.start == arc_ref(submap, known).start)
    changed: Arc | Doorway
    if isinstance(known, Arc):
        ends = (known.end, known.start) if turned else (known.start, known.end)
        changed = Arc(*ends, way, Origin.HAND)
        checked_line_of(arc_line(changed), arc_of)
    else:
        changed = replace(known, way=way, outwards=turned, origin=Origin.HAND)
        checked_line_of(doorway_line(changed), doorway_of)
    arcs = tuple(changed if each is known else each for each in submap.arcs)
    doors = tuple(changed if each is known else each for each in submap.doorways)
    return replace(draft, hgraph=with_submap(draft.hgraph, replace(submap, arcs=arcs, doorways=doors)))  # type: ignore[arg-type]


def delete_arcs(draft: Draft, asked: DeleteArcs) -> Draft:
    """Return the draft without arcs and doorways."""
    hgraph = draft.hgraph
    for text in asked.arcs:
        ref = ref_of_arc(text)
        gone, submap = arc_at(hgraph, ref), hgraph.submaps[ref.submap]
        arcs = tuple(each for each in submap.arcs if each is not gone)
        doors = tuple(each for each in submap.doorways if each is not gone)
        hgraph = with_submap(hgraph, replace(submap, arcs=arcs, doorways=doors))
    return replace(draft, hgraph=hgraph)


def split_arc(draft: Draft, asked: SplitArc) -> Draft:
    """Return the draft with an arc in two, with a cross node between them."""
    ref = ref_of_arc(asked.arc)
    arc, submap = arc_at(draft.hgraph, ref), draft.hgraph.submaps[ref.submap]
    if not isinstance(arc, Arc):
        raise BuildingError(f"{ref} is a doorway, whose two sides are at one place: split the arc before it")
    if asked.x is None or asked.y is None:
        one, other = submap.nodes[arc.start], submap.nodes[arc.end]
        point = (round((one.x + other.x) / 2, 4), round((one.y + other.y) / 2, 4))
    else:
        point = _inside(draft.hgraph, submap.path, asked.x, asked.y)
    new = Node(free_id(PREFIXES[NodeKind.CROSS], submap.nodes), NodeKind.CROSS, *point)
    return _with_node(
        replace(draft, hgraph=with_submap(draft.hgraph, _through(submap, arc, new))), submap, new, keep=True
    )


def cross_arcs(draft: Draft, asked: CrossArcs) -> Draft:
    """Return the draft with a cross node where two arcs of one sub-map cross."""
    refs = ref_of_arc(asked.one), ref_of_arc(asked.other)
    one, other = (arc_at(draft.hgraph, ref) for ref in refs)
    if refs[0].submap != refs[1].submap or not isinstance(one, Arc) or not isinstance(other, Arc):
        raise BuildingError("arcs of two sub-maps cannot share a node: move one, or join their rooms by a doorway")
    submap = draft.hgraph.submaps[refs[0].submap]
    point = _crossing(submap, one, other)
    if point is None:
        raise BuildingError(f"arcs {refs[0]} and {refs[1]} do not cross")
    new = Node(free_id(PREFIXES[NodeKind.CROSS], submap.nodes), NodeKind.CROSS, *point)
    return replace(draft, hgraph=with_submap(draft.hgraph, _through(_through(submap, one, new), other, new)))


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


def _with_node(draft: Draft, submap: SubMap, node: Node, *, keep: bool = False) -> Draft:
    """Return the draft with a node added or replaced, checked; `keep`: only checked, since the sub-map has it already."""
    checked_line_of(node_line(node), node_of)
    return draft if keep else replace(draft, hgraph=with_submap(draft.hgraph, with_nodes(submap, [node])))


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


def _with_doorway(draft: Draft, outer: NodeRef, inner: NodeRef, way: Way, outwards: bool) -> Draft:
    """Return the draft with a doorway; where its inner node is elsewhere, a door is made beside the outer one, and joined."""
    point = draft.map_point(outer)
    same_storey = draft.hgraph.storey_of(outer.submap) == draft.hgraph.storey_of(inner.submap)
    if same_storey and math.dist(point, draft.map_point(inner)) > SAME_M:
        room = draft.hgraph.submaps[inner.submap]
        place = _inside(draft.hgraph, room.path, *point)
        door_node = Node(free_id(PREFIXES[NodeKind.BRIDGE], room.nodes), NodeKind.BRIDGE, *place)
        ends = (inner.node, door_node.id) if outwards else (door_node.id, inner.node)
        room = replace(with_nodes(room, [door_node]), arcs=(*room.arcs, Arc(*ends, Way(one_way=way.one_way))))
        draft = replace(draft, hgraph=with_submap(draft.hgraph, room))
        inner = NodeRef(room.path, door_node.id)
    hgraph = draft.hgraph
    parent, child = hgraph.submaps[outer.submap], hgraph.submaps[inner.submap]
    door = Doorway(outer.node, inner.submap.rpartition("/")[2], inner.node, way, outwards)
    if any((each.start, inner_end(parent, each)) == (outer.node, inner) for each in parent.doorways):
        raise BuildingError(f"{outer} and {inner} are joined already")
    checked_line_of(doorway_line(door), doorway_of)
    hgraph = with_submap(hgraph, replace(parent, doorways=(*parent.doorways, door)))
    node = child.nodes[inner.node]
    if node.kind is NodeKind.CROSS:
        hgraph = with_submap(hgraph, with_nodes(child, [replace(node, kind=NodeKind.BRIDGE)]))
    return replace(draft, hgraph=hgraph)


def _with_shared_door(draft: Draft, one: NodeRef, other: NodeRef, way: Way) -> Draft:
    """Return the draft with a node of the parent between two rooms, and a doorway to each."""
    parent = draft.hgraph.submaps[parent_path(one.submap)]
    ends = [draft.map_point(ref) for ref in (one, other)]
    x, y = ((a + b) / 2 for a, b in zip(*ends, strict=True))
    new = Node(
        free_id(PREFIXES[NodeKind.CROSS], parent.nodes), NodeKind.CROSS, *_inside(draft.hgraph, parent.path, x, y)
    )
    draft = _with_node(draft, parent, new)
    middle = NodeRef(parent.path, new.id)
    draft = _with_doorway(draft, middle, one, way, outwards=way.one_way)
    return _with_doorway(draft, middle, other, way, outwards=False)


def _kind(text: str) -> NodeKind:
    if text not in ("end", "cross", "door", "lift"):
        raise BuildingError(f"'{text}' is no kind of node: choose end, cross, door or lift")
    return NodeKind(text)


def _inside(hgraph: HGraph, path: str, x: float, y: float) -> tuple[float, float]:
    """Return a point of the storey's map [m] in a sub-map's frame, to a tenth of a millimetre."""
    if not (math.isfinite(x) and math.isfinite(y)):
        raise BuildingError("a node needs two numbers of metres as its place")
    inner = hgraph.map_frame_of(path).inside(x, y)
    return round(inner[0], 4), round(inner[1], 4)


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


def _through(submap: SubMap, arc: Arc, node: Node) -> SubMap:
    """Return the sub-map with an arc led through a new node; its parts keep its rules, but no measured length or price."""
    way = replace(arc.way, length=None, drive_s=None, price=None)
    halves = (Arc(arc.start, node.id, way), Arc(node.id, arc.end, replace(way, width=None)))
    arcs = [part for each in submap.arcs for part in (halves if each is arc else (each,))]
    return replace(with_nodes(submap, [node]), arcs=tuple(arcs))


def _crossing(submap: SubMap, one: Arc, other: Arc) -> tuple[float, float] | None:
    a, b, c, d = (submap.nodes[each] for each in (one.start, one.end, other.start, other.end))
    across = (b.x - a.x) * (d.y - c.y) - (b.y - a.y) * (d.x - c.x)
    if abs(across) < 1e-12:
        return None
    s = ((c.x - a.x) * (d.y - c.y) - (c.y - a.y) * (d.x - c.x)) / across
    t = ((c.x - a.x) * (b.y - a.y) - (c.y - a.y) * (b.x - a.x)) / across
    if not (0.0 < s < 1.0 and 0.0 < t < 1.0):
        return None
    return round(a.x + s * (b.x - a.x), 4), round(a.y + s * (b.y - a.y), 4)


def _time_ns(text: str) -> int | None:
    if not text.strip():
        return None
    try:
        moment = datetime.fromisoformat(text.strip().removesuffix("Z"))
    except ValueError:
        moment = None
    if moment is None or moment.tzinfo is not None:
        raise BuildingError(f"'{text}' is no time: write one in UTC, such as 2026-03-01T08:00")
    return int(moment.replace(tzinfo=UTC).timestamp()) * 1_000_000_000
