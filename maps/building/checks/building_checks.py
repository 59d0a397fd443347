"""The checks of a whole building: lifts, tree, reachability, names across storeys, tables (E8 to E11, E13, E15, E16, E18, W2, W3)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

import numpy as np

from waychair.maps.building.checks.graph_findings import GraphFinding, GraphSurroundings, error, warning
from waychair.maps.building.connections import ConnectedSubmap, Connections, folded, special_arcs
from waychair.maps.building.hgraph import ROOT, HGraph, Lift, NodeKind, NodeRef, ancestors, inner_end, parent_path
from waychair.maps.building.hgraph_edits import arc_ref

BESIDE_M = 0.05
"""Room on each side of the chair in a door [m]."""

_IN_LINE_M = 0.3
"""Most by which the stops of a lift may lie beside each other, seen from above [m]."""

_DEEPEST, _MOST_ITEMS = 4, 7
"""Most menus one below the other, and most goals and children of a sub-map in one menu."""

_SHOWN = 5


def building_findings(hgraph: HGraph, linked: Connections, around: GraphSurroundings) -> Iterator[GraphFinding]:
    """Yield the faults of the whole building, given how it is connected."""
    yield from _tree(hgraph)
    yield from _menus(hgraph)
    for lift in hgraph.lifts.values():
        yield from _lift(hgraph, lift, around)
        yield from _lift_doors(lift, around)
    yield from _levels(hgraph)
    yield from _names(hgraph, linked.parts)
    yield from _maps(hgraph, around)
    if around.stale_tables:
        yield error(
            "E15", hgraph.name, "the tables are older than the graph", "make them with waychair building tables"
        )
    yield from _reach(hgraph, linked)
    yield from _undriven(linked)


def _tree(hgraph: HGraph) -> Iterator[GraphFinding]:
    entered = {inner_end(submap, doorway).submap for submap in hgraph.submaps.values() for doorway in submap.doorways}
    for lift in hgraph.lifts.values():
        for stop in lift.stops:
            entered.update(ancestors(stop.at.submap))
    only = hgraph.children(ROOT)
    for path in hgraph.submaps:
        if not path:
            continue
        if parent_path(path) not in hgraph.submaps:
            remedy = f"add '{parent_path(path)}', or take it out"
            yield error("E10", path, f"sub-map '{path}' has no parent, so a level is missing", remedy)
        elif path not in entered and only != (path,):
            yield error("E10", path, f"sub-map '{path}' has neither doorway nor lift", "add a doorway from its parent")
        if path.count("/") + 1 > _DEEPEST:
            sentence = f"'{path}' lies {path.count('/') + 1} menus deep"
            yield warning("W2", path, sentence, f"use at most {_DEEPEST} levels")


def _menus(hgraph: HGraph) -> Iterator[GraphFinding]:
    children = Counter(parent_path(path) for path in hgraph.submaps if path)
    for path, submap in hgraph.submaps.items():
        items = children[path] + sum(node.kind is NodeKind.END for node in submap.nodes.values())
        if items > _MOST_ITEMS:
            sentence = f"the menu of '{submap.title or hgraph.name}' has {items} items"
            yield warning("W2", path, sentence, f"group them in sub-maps, at most {_MOST_ITEMS} in each")


def _lift(hgraph: HGraph, lift: Lift, around: GraphSurroundings) -> Iterator[GraphFinding]:
    place = f"lift {lift.id}"
    if len(lift.stops) < 2:
        yield error("E8", place, f"lift '{lift.id}' has {len(lift.stops)} stops", "add stops, or delete it")
    storeys: dict[str, NodeRef] = {}
    known = {storey.id for storey in hgraph.storeys}
    points = []
    for stop in lift.stops:
        if stop.storey not in known:
            sentence = f"lift '{lift.id}' stops at storey '{stop.storey}', which is not there"
            yield error("E8", place, sentence, "add the storey, or correct the stop")
        if stop.storey in storeys:
            sentence = f"lift '{lift.id}' has two stops on storey '{stop.storey}'"
            yield error("E8", stop.at, sentence, "take one out, or make it a lift of its own")
        storeys[stop.storey] = stop.at
        node = hgraph.node(stop.at)
        if node is None:
            yield error("E8", stop.at, f"lift '{lift.id}' stops at {stop.at}, which is no node", "add the node")
            continue
        if node.kind is not NodeKind.LIFT:
            sentence = f"lift '{lift.id}' stops at {stop.at}, which is of kind '{node.kind}'"
            yield error("E8", stop.at, sentence, f"make it of kind '{NodeKind.LIFT}'")
        points.append((stop, hgraph.frame_of(stop.at.submap).point(node.x, node.y)))
    for stop, point in points[1:]:
        beside = math.dist(point, points[0][1])
        if beside > _IN_LINE_M + 1e-9:
            sentence = f"the stops of lift '{lift.id}' at '{points[0][0].storey}' and '{stop.storey}' are {beside:.1f} m out of line"
            yield error("E8", stop.at, sentence, "align the storeys' frames, or move the stop")
            break
    for name, size, body in (("width", lift.cabin_width, around.width), ("depth", lift.cabin_depth, around.length)):
        if size is not None and body is not None and size < body:
            sentence = f"the cabin of lift '{lift.id}' has a {name} of {size:.2f} m, and the chair one of {body:.2f} m"
            yield error("E8", place, sentence, "take the lift out for this chair")


def _lift_doors(lift: Lift, around: GraphSurroundings) -> Iterator[GraphFinding]:
    """Yield the doors of a lift that are too narrow for this chair."""
    for stop in lift.stops:
        width = lift.door_width if stop.door_width is None else stop.door_width
        if width is not None and around.width is not None and width < around.width + 2 * BESIDE_M:
            sentence = (
                f"the door of lift '{lift.id}' at storey '{stop.storey}' is {width:.2f} m wide, and this chair is "
                f"{around.width:.2f} m"
            )
            fits = width - 2 * BESIDE_M
            yield error("E6", stop.at, sentence, f"take the stop out for this chair: one of at most {fits:.2f} m fits")


def _levels(hgraph: HGraph) -> Iterator[GraphFinding]:
    """Yield doorways between storeys that a lift joins, unless they are ramps."""
    by_lift: dict[frozenset[str], str] = {}
    for lift in hgraph.lifts.values():
        for lower in lift.stops:
            for upper in lift.stops:
                by_lift.setdefault(frozenset((lower.storey, upper.storey)), lift.id)
    for submap in hgraph.submaps.values():
        for doorway in submap.doorways:
            end = inner_end(submap, doorway)
            two = frozenset((hgraph.storey_of(submap.path), hgraph.storey_of(end.submap)))
            if len(two) == 2 and "" not in two and not doorway.way.ramp and two in by_lift:
                ref = arc_ref(submap, doorway)
                sentence = f"{ref} joins storeys that lift '{by_lift[two]}' joins, too"
                yield error("E9", ref, sentence, "mark it ramp=yes if it is one, else take it out")


def _names(hgraph: HGraph, parts: dict[str, ConnectedSubmap]) -> Iterator[GraphFinding]:
    """Yield goals of different storeys, and sub-maps of one parent, that people cannot tell apart by name."""
    goals: dict[tuple[str, str], NodeRef] = {}
    for path, part in parts.items():
        if not part.goals:
            continue
        titles = [hgraph.submaps[each].title for each in ancestors(path)[2:] if each in hgraph.submaps]
        within = folded("/".join(titles))
        for key, name in part.goals:
            ref = NodeRef(path, key)
            first = goals.setdefault((within, name), ref)
            if name and first.submap != path:
                sentence = f"'{hgraph.submaps[path].nodes[key].name}' is a goal on two storeys, {first} and {ref}"
                yield warning("E13", ref, sentence, "add the storey to one of the names")
    siblings: dict[tuple[str, str], str] = {}
    for path, submap in hgraph.submaps.items():
        if path:
            first_path = siblings.setdefault((parent_path(path), folded(submap.title)), path)
            if first_path != path:
                yield error("E13", path, f"'{first_path}' and '{path}' are named alike", "rename one")


def _maps(hgraph: HGraph, around: GraphSurroundings) -> Iterator[GraphFinding]:
    for storey in hgraph.storeys:
        if storey.id in around.missing:
            yield error("E16", f"storey {storey.id}", f"the map of storey '{storey.id}' is missing", "restore it")
        if storey.id in around.moved:
            sentence = f"the map of storey '{storey.id}' has moved since the graph was saved"
            yield warning(
                "E16", f"storey {storey.id}", sentence, "load and save the building, so that its nodes follow"
            )


def _reach(hgraph: HGraph, linked: Connections) -> Iterator[GraphFinding]:
    goals = [
        (NodeRef(path, key), linked.first[path] + part.index[key])
        for path, part in linked.parts.items()
        for key, _ in part.goals
    ]
    component = linked.component
    main = int(np.bincount(component[[number for _, number in goals]]).argmax()) if goals else -1
    for ref, number in goals:
        if component[number] != main:
            island = np.flatnonzero(component == component[number])
            names = ", ".join(map(str, linked.refs(island[:_SHOWN])))
            more = f" and {len(island) - _SHOWN} more" if len(island) > _SHOWN else ""
            node = hgraph.node(ref)
            name = node.name if node is not None and node.name else str(ref)
            sentence = f"the goal '{name}' cannot be reached from all others and back: its island is {names}{more}"
            yield error("E11", ref, sentence, "join it by an arc that a chair can drive both ways")
    for arc, way, ends in special_arcs(hgraph, linked):
        if component[ends[0]] != component[ends[1]]:
            what = "closed" if way.closure is not None else "one-way"
            yield warning("E18", arc, f"the {what} arc {arc} leaves no way back", "open it, or add a way back")
    for lift in hgraph.lifts.values():
        parts = {stop.at: component[at] for stop in lift.stops if (at := linked.number(stop.at)) is not None}
        for stop in lift.stops:
            if stop.closure is not None and stop.at in parts and set(parts.values()) != {parts[stop.at]}:
                sentence = f"the closed stop of lift '{lift.id}' at storey '{stop.storey}' leaves no way back"
                yield warning("E18", stop.at, sentence, "open it, or add another lift")


def _undriven(linked: Connections) -> Iterator[GraphFinding]:
    """Yield nodes that nobody has driven past, once some drives have been measured."""
    if any(part.driven.any() for part in linked.parts.values()):
        for path, part in linked.parts.items():
            for key, at in part.index.items():
                if not part.driven[at]:
                    ref = NodeRef(path, key)
                    yield warning("W3", ref, f"nobody has driven past {ref}", "drive there once")
