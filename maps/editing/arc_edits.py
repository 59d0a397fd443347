"""Operations on arcs and doorways: join two nodes, rules and costs, a node on an arc, delete."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import UTC, datetime

import msgspec

from waychair.errors import BuildingError
from waychair.maps.building.checks.storey_checks import SAME_M
from waychair.maps.building.hgraph import (
    Arc,
    Closure,
    GraphDoorway,
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
from waychair.maps.building.hgraph_edits import arc_ref, with_nodes, with_submap
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
from waychair.maps.editing.draft import Draft


class Operation(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", omit_defaults=True):
    """An edit as data: its JSON has the class's tag as `do` and its fields."""


class Join(Operation, frozen=True, tag="join"):
    """Join two nodes: by an arc in one sub-map, by a doorway between a sub-map and its parent or between two rooms."""

    one: str
    other: str
    one_way: bool = False
    width: float | None = None


class ChangeArc(Operation, frozen=True, tag="change_arc"):
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


class DeleteArcs(Operation, frozen=True, tag="delete_arcs"):
    """Delete arcs and doorways."""

    arcs: tuple[str, ...]


class SplitArc(Operation, frozen=True, tag="split_arc"):
    """Put a cross node on an arc, at x, y [m] in its storey's map or in its middle."""

    arc: str
    x: float | None = None
    y: float | None = None


class CrossArcs(Operation, frozen=True, tag="cross_arcs"):
    """Put a cross node where two arcs of one sub-map cross."""

    one: str
    other: str


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
    changed: Arc | GraphDoorway
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
        point = point_inside(draft.hgraph, submap.path, asked.x, asked.y)
    new = Node(free_id(PREFIXES[NodeKind.CROSS], submap.nodes), NodeKind.CROSS, *point)
    checked_line_of(node_line(new), node_of)
    return replace(draft, hgraph=with_submap(draft.hgraph, _through(submap, arc, new)))


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


def with_node(draft: Draft, submap: SubMap, node: Node) -> Draft:
    """Return the draft with a node added to a sub-map or replaced there; raises BuildingError for an impossible one."""
    checked_line_of(node_line(node), node_of)
    return replace(draft, hgraph=with_submap(draft.hgraph, with_nodes(submap, [node])))


def _with_doorway(draft: Draft, outer: NodeRef, inner: NodeRef, way: Way, outwards: bool) -> Draft:
    """Return the draft with a doorway; where its inner node is elsewhere, a door is made beside the outer one, and joined."""
    point = draft.map_point(outer)
    same_storey = draft.hgraph.storey_of(outer.submap) == draft.hgraph.storey_of(inner.submap)
    if same_storey and math.dist(point, draft.map_point(inner)) > SAME_M:
        room = draft.hgraph.submaps[inner.submap]
        place = point_inside(draft.hgraph, room.path, *point)
        door_node = Node(free_id(PREFIXES[NodeKind.BRIDGE], room.nodes), NodeKind.BRIDGE, *place)
        ends = (inner.node, door_node.id) if outwards else (door_node.id, inner.node)
        room = replace(with_nodes(room, [door_node]), arcs=(*room.arcs, Arc(*ends, Way(one_way=way.one_way))))
        draft = replace(draft, hgraph=with_submap(draft.hgraph, room))
        inner = NodeRef(room.path, door_node.id)
    hgraph = draft.hgraph
    parent, child = hgraph.submaps[outer.submap], hgraph.submaps[inner.submap]
    door = GraphDoorway(outer.node, inner.submap.rpartition("/")[2], inner.node, way, outwards)
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
        free_id(PREFIXES[NodeKind.CROSS], parent.nodes), NodeKind.CROSS, *point_inside(draft.hgraph, parent.path, x, y)
    )
    draft = with_node(draft, parent, new)
    middle = NodeRef(parent.path, new.id)
    draft = _with_doorway(draft, middle, one, way, outwards=way.one_way)
    return _with_doorway(draft, middle, other, way, outwards=False)


def point_inside(hgraph: HGraph, path: str, x: float, y: float) -> tuple[float, float]:
    """Return a point of the storey's map [m] in a sub-map's frame, to a tenth of a millimetre."""
    if not (math.isfinite(x) and math.isfinite(y)):
        raise BuildingError("a node needs two numbers of metres as its place")
    inner = hgraph.map_frame_of(path).inside(x, y)
    return round(inner[0], 4), round(inner[1], 4)


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
