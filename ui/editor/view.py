"""A session as JSON for its pages: the whole of it, or what has changed between two drafts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields

from waychair.maps.building.hgraph import GraphDoorway, HGraph, Lift, SubMap, Way
from waychair.maps.building.hgraph_edits import arc_ref
from waychair.maps.building.records import time_text
from waychair.maps.drawn.zones import Zone
from waychair.maps.editing.draft import Draft
from waychair.types import Json, Place
from waychair.ui.editor.session import Session


def whole(session: Session) -> Json:
    """Return everything that a page shows. Coordinates of nodes are metres in their storey's map."""
    return {**_general(session), "submaps": _submaps(session.draft, None), "drawn": _drawn(session.draft, None)}


def changes(session: Session, before: Draft) -> Json:
    """Return what a page shows, of sub-maps, places and zones only those that differ from a draft before."""
    return {**_general(session), "submaps": _submaps(session.draft, before), "drawn": _drawn(session.draft, before)}


def _general(session: Session) -> Json:
    hgraph = session.draft.hgraph
    return {
        "revision": session.revision,
        "name": hgraph.name,
        "folder": session.folder.resolve().name,
        "costs": {entry.name: getattr(hgraph.costs, entry.name) for entry in fields(hgraph.costs)},
        "storeys": [
            {"id": each.id, "name": each.name, "height": each.height, "map": each.map} for each in hgraph.storeys
        ],
        "lifts": [_lift(each) for each in hgraph.lifts.values()],
        "paths": list(hgraph.submaps),
        "findings": [
            {
                "code": each.code,
                "severity": str(each.severity),
                "place": each.place,
                "sentence": each.sentence,
                "remedy": each.remedy,
            }
            for each in session.findings
        ],
        "undoes": session.history.undoes,
        "redoes": session.history.redoes,
        "saved": session.is_saved,
        "blocked": sum(session.forbids(each) for each in session.findings),
        "foreign": list(session.foreign),
        "notes": session.taken_notes(),
    }


def _submaps(draft: Draft, before: Draft | None) -> Json:
    hgraph, found = draft.hgraph, {}
    for path, submap in hgraph.submaps.items():
        if before is not None and _is_same(hgraph, before.hgraph, path):
            continue
        found[path] = _submap(hgraph, submap)
    return found


def _is_same(now: HGraph, before: HGraph, path: str) -> bool:
    return (
        now.submaps[path] is before.submaps.get(path)
        and now.map_frame_of(path) == before.map_frame_of(path)
        and now.storey_of(path) == before.storey_of(path)
    )


def _submap(hgraph: HGraph, submap: SubMap) -> Json:
    frame, on_map = submap.frame, hgraph.map_frame_of(submap.path)
    nodes = []
    for node in submap.nodes.values():
        x, y = on_map.point(node.x, node.y)
        nodes.append([node.id, str(node.kind), round(x, 4), round(y, 4), node.name, str(node.origin)])
    return {
        "name": submap.name,
        "storey": hgraph.storey_of(submap.path),
        "own": submap.storey,
        "frame": [frame.x, frame.y, frame.theta, frame.scale],
        "nodes": nodes,
        "arcs": [
            {"ref": str(arc_ref(submap, arc)), "ends": [arc.start, arc.end], **_way(arc.way)} for arc in submap.arcs
        ],
        "doors": [_door(submap, door) for door in submap.doorways],
        "beacons": [
            {"id": each.id, "x": each.pose.x, "y": each.pose.y, "theta": each.pose.theta, "node": each.node}
            for each in submap.beacons
        ],
    }


def _door(submap: SubMap, door: GraphDoorway) -> Json:
    ends = [door.start, f"{door.child}:{door.node}"]
    return {"ref": str(arc_ref(submap, door)), "ends": ends, "outwards": door.outwards, **_way(door.way)}


def _way(way: Way) -> Json:
    """Return an arc's properties that it has."""
    values: Json = {
        "length": way.length,
        "width": way.width,
        "speed": way.speed,
        "drive_s": way.drive_s,
        "price": way.price,
        "oneWay": way.one_way,
        "ramp": way.ramp,
    }
    if way.closure is not None:
        values |= {
            "closed": way.closure.reason or "closed",
            "until": (time_text(way.closure.until_ns) or "").removesuffix("Z"),
        }
    return {key: value for key, value in values.items() if value is not None and value is not False}


def _lift(lift: Lift) -> Json:
    return {
        "id": lift.id,
        "name": lift.name,
        "cabin_width": lift.cabin_width,
        "cabin_depth": lift.cabin_depth,
        "door_width": lift.door_width,
        "wait": lift.wait,
        "board": lift.board,
        "per_storey": lift.per_storey,
        "stops": [
            {
                "storey": each.storey,
                "at": str(each.at),
                "door_width": each.door_width,
                "closed": "" if each.closure is None else each.closure.reason or "closed",
                "cabin": None if each.cabin is None else [each.cabin.x, each.cabin.y, each.cabin.theta],
            }
            for each in lift.stops
        ],
    }


def _drawn(draft: Draft, before: Draft | None) -> Json:
    """Return places and zones by storey."""
    found = {}
    for storey, places in draft.places.items():
        zones = draft.zones_of(storey)
        if before is not None and before.places.get(storey) is places and before.zones.get(storey) is zones:
            continue
        found[storey] = {"places": _places(places), "zones": [_zone(each) for each in zones]}
    return found


def _places(places: Mapping[str, Place]) -> Json:
    return {
        name: [place.pose.x, place.pose.y, place.pose.theta, place.tolerance_m, place.tolerance_rad]
        for name, place in places.items()
    }


def _zone(zone: Zone) -> Json:
    return {"name": zone.name, "rule": zone.rule.value, "polygon": zone.polygon.tolist(), "value": float(zone.value)}
