"""The rules of a storey's zones as properties of its arcs, for routes: slow zones, one-way zones, keep-out zones.

The building's text files do not hold them: `zones.yaml` of the storey's map does, so a zone that is removed leaves no trace.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.errors import MapError
from waychair.files import is_folder
from waychair.maps.building.building import Building
from waychair.maps.building.hgraph import Arc, Closure, GraphDoorway, HGraph, Way, inner_end
from waychair.maps.drawn.zones import Rule, Zone, load_zones, zone_contains
from waychair.types import BoolArray, FloatArray

STEP_M = 0.05
"""Distance [m] between the points of an arc that are looked up in the zones: a cell of the usual map."""

SIDEWAYS = math.sin(math.radians(10.0))
"""An arc within 10 degrees of a right angle to a one-way zone's heading is driven sideways to it, in both directions."""


@dataclass(slots=True)
class _Rules:
    """The rules along one arc: the limits [m/s] at its points (N,), and the zones that close one direction or both."""

    limits: FloatArray
    forwards: str = ""
    backwards: str = ""
    both: str = ""


@dataclass(slots=True)
class _Segments:
    """The arcs and doorways of a storey: starts and ends [m] in its map, by sub-map and position there."""

    keys: list[tuple[str, int]] = field(default_factory=list)
    rows: list[tuple[float, float, float, float]] = field(default_factory=list)


def with_zones(building: Building) -> HGraph:
    """Return a building's graph with the rules of the zones of all storeys' maps; it is for routes, not for writing.

    Raises:
        MapError, ZoneError: the zones of a storey's map are damaged.
    """
    hgraph = building.hgraph
    for storey in hgraph.storeys:
        folder = building.map_folder(storey.id)
        if folder is not None and is_folder(folder, MapError):
            hgraph = with_zones_of(hgraph, storey.id, load_zones(folder))
    return hgraph


def with_zones_of(hgraph: HGraph, storey: str, zones: Sequence[Zone]) -> HGraph:
    """Return the graph with the rules of zones in the frame of a storey's map.

    A slow zone limits the speed on its part of an arc. In a one-way zone, an arc is driven along the zone's heading or
    sideways to it. An arc through a keep-out zone is closed.
    """
    if not zones:
        return hgraph
    segments = _segments(hgraph, storey)
    rules = _rules(np.array(segments.rows).reshape(-1, 4), zones)
    changed = dict(hgraph.submaps)
    for index, found in rules.items():
        path, at = segments.keys[index]
        submap, speed = changed[path], hgraph.costs.speed_mps
        if at < len(submap.arcs):
            arcs = list(submap.arcs)
            arcs[at] = _ruled_arc(arcs[at], found, speed)
            changed[path] = replace(submap, arcs=tuple(arcs))
        else:
            doorways = list(submap.doorways)
            doorways[at - len(submap.arcs)] = _ruled_doorway(doorways[at - len(submap.arcs)], found, speed)
            changed[path] = replace(submap, doorways=tuple(doorways))
    return replace(hgraph, submaps=changed)


def _segments(hgraph: HGraph, storey: str) -> _Segments:
    found = _Segments()
    for path, submap in hgraph.submaps.items():
        if hgraph.storey_of(path) != storey:
            continue
        frame = hgraph.map_frame_of(path)
        points = {key: frame.point(node.x, node.y) for key, node in submap.nodes.items()}
        for at, arc in enumerate(submap.arcs):
            found.keys.append((path, at))
            found.rows.append((*points[arc.start], *points[arc.end]))
        for at, doorway in enumerate(submap.doorways, start=len(submap.arcs)):
            end = inner_end(submap, doorway)
            node = hgraph.node(end)
            if node is not None:
                found.keys.append((path, at))
                found.rows.append((*points[doorway.start], *hgraph.map_frame_of(end.submap).point(node.x, node.y)))
    return found


def _rules(segments: FloatArray, zones: Sequence[Zone]) -> dict[int, _Rules]:
    """Return the rules along those segments (N, 4) [m] that meet a zone, by their position."""
    low, high = np.minimum(segments[:, :2], segments[:, 2:]), np.maximum(segments[:, :2], segments[:, 2:])
    found: dict[int, _Rules] = {}
    for zone in zones:
        least, most = zone.polygon.min(axis=0), zone.polygon.max(axis=0)
        for index in np.flatnonzero(((high >= least) & (low <= most)).all(axis=1)).tolist():
            start, end = segments[index, :2], segments[index, 2:]
            count = max(2, math.ceil(math.dist(start, end) / STEP_M) + 1)
            within = zone_contains(zone, np.linspace(start, end, count))
            if within.any():
                _apply(zone, found.setdefault(index, _Rules(np.full(count, np.inf))), within, end - start)
    return found


def _apply(zone: Zone, rules: _Rules, within: BoolArray, along: FloatArray) -> None:
    if zone.rule is Rule.KEEP_OUT:
        rules.both = f"keep-out zone '{zone.name}'"
    elif zone.rule is Rule.SLOW:
        rules.limits[within] = np.minimum(rules.limits[within], zone.value)
    else:
        heading = np.array([math.cos(zone.value), math.sin(zone.value)])
        share = float(along @ heading) / max(math.hypot(*along), 1e-9)
        if share < -SIDEWAYS:
            rules.forwards = f"one-way zone '{zone.name}'"
        elif share > SIDEWAYS:
            rules.backwards = f"one-way zone '{zone.name}'"


def _ruled_arc(arc: Arc, rules: _Rules, speed: float) -> Arc:
    only = rules.forwards if arc.way.one_way else ""
    reason = rules.both or only or (rules.forwards if rules.backwards else "")
    way = _limited(arc.way, rules, speed, reason)
    if reason or not (rules.forwards or rules.backwards):
        return replace(arc, way=way)
    ends = (arc.end, arc.start) if rules.forwards else (arc.start, arc.end)
    return replace(arc, start=ends[0], end=ends[1], way=replace(way, one_way=True))


def _ruled_doorway(doorway: GraphDoorway, rules: _Rules, speed: float) -> GraphDoorway:
    only = (rules.backwards if doorway.outwards else rules.forwards) if doorway.way.one_way else ""
    reason = rules.both or only or (rules.forwards if rules.backwards else "")
    way = _limited(doorway.way, rules, speed, reason)
    if reason or not (rules.forwards or rules.backwards):
        return replace(doorway, way=way)
    return replace(doorway, way=replace(way, one_way=True), outwards=bool(rules.forwards))


def _limited(way: Way, rules: _Rules, speed: float, reason: str) -> Way:
    """Return a way with the limits along it as one mean speed, and closed if there is a reason."""
    if reason and way.closure is None:
        way = replace(way, closure=Closure(reason))
    if not np.isfinite(rules.limits).any():
        return way
    limits = rules.limits if way.speed is None else np.minimum(rules.limits, way.speed)
    return replace(way, speed=speed / float(np.maximum(1.0, speed / limits).mean()))
