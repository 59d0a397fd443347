"""Where the spots of a traffic graph lie on the floor: the polyline of a chain, and the stop lines across it.

Sections are straight between their nodes, as corridors of a floor plan are. A node reaches so far along its sections that
a chair before it leaves room for another one to turn there; a refuge begins at the edge of the corridor.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import arc_lengths, transform_points
from waychair.maps.drawn.zones import Rule, Zone
from waychair.maps.traffic.traffic_graph import Section, TrafficGraph
from waychair.planning.fleet.ways import MOST_AT_A_NODE, Ways
from waychair.types import FloatArray, Pose2

TURNING_ROOM = 0.90
"""m; from the middle of a node where chairs turn to a chair that waits before it."""

TURN_AT_DOOR_MS = 9_000
"""ms that a chair takes to turn into a room, or out of it, beside the way."""

LINE_BEYOND = 0.10
"""m; a stop line reaches so far into the walls on both sides."""

SHORTEST_BARRED, BAR = 2.5, 0.4
"""m; sections off a chain that are as long as the first get a bar across their middle that is as thick as the second."""

_STRAIGHT = math.radians(20.0)
"""rad; corridors that meet at a smaller bend go straight on."""

_NEAR = 3.0
"""m; a chair has not moved farther along its chain since it was last looked for."""

_IN_PARTS = 8
"""Points on each side of the outline by which a chair's place on its chain is found."""


@dataclass(frozen=True, slots=True)
class SpotPlace:
    """The ends of a spot (2, 2) [m] in map, equal for nodes and slots, and its clear width [m]."""

    ends: FloatArray
    width: float
    node: str | None
    section: str | None


@dataclass(frozen=True)
class Chain:
    """The spots of a chair's chain as a polyline (N, 2) [m] in map with the way (N,) along it.

    Spot k, of `count`, reaches up to `until[k]` [m] along the way; there lies its stop line.
    """

    points: FloatArray
    along: FloatArray
    until: FloatArray
    widths: FloatArray

    def stop_line(self, k: int) -> FloatArray:
        """Return the line (2, 2) [m] in map across the end of spot k."""
        return self.line_at(float(self.until[k]), float(self.widths[k]))

    def line_at(self, way: float, width: float) -> FloatArray:
        """Return the line (2, 2) [m] in map across the chain at a way along it, where it has a width [m]."""
        at, heading = self.place_at(way)
        half = width / 2 + LINE_BEYOND
        across = np.array([-math.sin(heading), math.cos(heading)]) * half
        return np.array([at - across, at + across])

    def place_at(self, way: float) -> tuple[FloatArray, float]:
        """Return the point (2,) [m] and the heading [rad] at a way along the chain."""
        k = int(np.clip(np.searchsorted(self.along, way, side="right") - 1, 0, len(self.along) - 2))
        step = self.points[k + 1] - self.points[k]
        length = max(float(np.hypot(*step)), 1e-9)
        share = (way - self.along[k]) / length
        return self.points[k] + share * step, math.atan2(step[1], step[0])

    @cached_property
    def folds(self) -> tuple[int, ...]:
        """Indices of the points at which the chain turns back on itself: in a bay, or where a chair backs out again."""
        steps = np.diff(self.points, axis=0)
        ahead = (steps[:-1] * steps[1:]).sum(axis=1)
        return tuple((np.flatnonzero(ahead < 0.0) + 1).tolist())

    def ends_at(self, piece: int) -> float:
        """Return the way [m] at which a piece ends, between two folds; +inf for the last one."""
        return float(self.along[self.folds[piece]]) if piece < len(self.folds) else math.inf

    def reach_of(self, body: ChairBody, pose: Pose2, near: float, piece: int) -> tuple[float, float]:
        """Return the way of the rearmost and of the foremost point of a chair on a piece, near a way [m] known before."""
        corners = transform_points(pose, body.outline())
        shares = np.linspace(0.0, 1.0, _IN_PARTS, endpoint=False)[:, None]
        sides = [a + shares * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
        ways = self._ways_of(np.concatenate(sides), near, piece)
        return float(ways.min()), float(ways.max())

    def _ways_of(self, points: FloatArray, near: float, piece: int) -> FloatArray:
        """Return the way (M,) of the nearest place on a piece within 3 m of way from `near`, for points (M, 2).

        Before the first and beyond the last point of the piece the way goes on straight.
        """
        bounds = [0, *self.folds, len(self.points) - 1]
        part = slice(bounds[piece], bounds[piece + 1])
        a, steps, begins = self.points[:-1][part], np.diff(self.points, axis=0)[part], self.along[:-1][part]
        long = np.maximum(np.hypot(*steps.T), 1e-9)
        kept = (begins + long > near - _NEAR) & (begins < near + _NEAR)
        kept = kept if kept.any() else np.ones(len(long), np.bool_)
        share = ((points[:, None] - a) * steps).sum(axis=2) / long**2
        within = np.clip(share, 0.0, 1.0)
        off = np.hypot(*np.moveaxis(points[:, None] - a - within[..., None] * steps, 2, 0))
        best = np.where(kept, off, np.inf).argmin(axis=1)
        rows = np.arange(len(points))
        free = within[rows, best]
        free = np.where(best == 0, np.minimum(share[rows, best], free), free)
        free = np.where(best == len(long) - 1, np.maximum(share[rows, best], free), free)
        ways: FloatArray = begins[best] + free * long[best]
        return ways


def spot_places(ways: Ways) -> tuple[SpotPlace, ...]:
    """Return the place of each spot, in the order in which `ways_of` numbers them."""
    graph = ways.graph
    found: list[SpotPlace] = []
    for node in graph.nodes:
        at = np.array([[node.x, node.y]] * 2)
        found += [SpotPlace(at, 0.0, node.name, None)] * min(graph.capacity(node.name), MOST_AT_A_NODE)
    for section in graph.sections:
        ends = np.array([[graph.node[each].x, graph.node[each].y] for each in (section.start, section.end)])
        found.append(SpotPlace(ends, section.width, None, section.name))
        if not section.one_way:
            found.append(SpotPlace(ends[::-1], section.width, None, section.name))
    assert len(found) == len(ways.names)
    return tuple(found)


def node_rooms(graph: TrafficGraph) -> dict[tuple[str, str], float]:
    """Return how far [m] each node reaches along each of its sections, by the names of node and section."""
    at: dict[str, list[Section]] = {node.name: [] for node in graph.nodes}
    for section in graph.sections:
        at[section.start].append(section)
        at[section.end].append(section)
    ends = Counter(end for section in graph.sections for end in (section.start, section.end))
    found: dict[tuple[str, str], float] = {}
    for name, sections in at.items():
        for section in sections:
            other = section.other(name)
            if other in graph.refuge_at and ends[other] == 1:  # a door: up to the edge of the corridor
                room = max(
                    (each.width / 2 for each in sections if each.name != section.name), default=section.width / 2
                )
            elif name in graph.refuge_at and ends[name] == 1:
                room = max(0.0, section.length - 0.5 * section.width)
            else:
                room = 0.0 if goes_straight(graph, name) else TURNING_ROOM
            found[name, section.name] = (
                min(room, 0.45 * section.length) if other not in graph.refuge_at else min(room, section.length)
            )
    return found


def drivable(ways: Ways, body: ChairBody) -> Ways:
    """Return the ways as a whole chair drives them.

    It stands aside only in sections in which it can also turn, so not in doors or narrow corridors, and it turns at a door.
    """
    places, rooms = spot_places(ways), node_rooms(ways.graph)
    kept = np.ones(len(ways.after), np.bool_)
    for spot, place in enumerate(places):
        if place.section is None:
            continue
        section = ways.graph.section[place.section]
        begins_at = {k for k in range(ways.first[spot], ways.first[spot + 1]) if _is_at(places, ways, k, place.ends[0])}
        room = section.length - sum(rooms[end, section.name] for end in (section.start, section.end))
        if room < body.length or section.width < 2 * body.circumscribed_radius:
            kept[list(begins_at)] = False
    before = np.repeat(np.arange(len(places)), np.diff(ways.first))[kept]
    first = np.searchsorted(before, np.arange(len(places) + 1)).astype(np.int64)
    ends = Counter(end for section in ways.graph.sections for end in (section.start, section.end))
    doors = {
        section.name
        for section in ways.graph.sections
        if any(end in ways.graph.refuge_at and ends[end] == 1 for end in (section.start, section.end))
    }
    turning = np.array([TURN_AT_DOOR_MS if place.section in doors else 0 for place in places], np.int64)
    return replace(ways, first=first, after=ways.after[kept], passing_ms=ways.passing_ms + turning)


def _is_at(places: Sequence[SpotPlace], ways: Ways, edge: int, point: FloatArray) -> bool:
    return bool(np.hypot(*(places[ways.after[edge]].ends[0] - point)) < 1e-9)


def bars_off(ways: Ways, places: Sequence[SpotPlace], spots: Sequence[int]) -> tuple[Zone, ...]:
    """Return keep-out bars across the long sections that are off a chain and by which a chair could go round it.

    One more lies at the far end of each section that a chair backs out of again, if that is as long: it goes no farther.
    """
    graph = ways.graph
    used = {places[spot].section for spot in spots}
    rings = _ring_sections(graph)
    found = []
    for section in graph.sections:
        if section.name in used or section.name not in rings or section.length < SHORTEST_BARRED:
            continue
        a, b = (np.array([graph.node[end].x, graph.node[end].y]) for end in (section.start, section.end))
        found.append(_bar(f"another way: {section.name}", a, b, float(np.hypot(*(b - a))) / 2, section.width))
    for before, spot, after in zip(spots, spots[1:], spots[2:], strict=False):
        here = places[spot]
        if here.section is None or places[before].node != places[after].node:
            continue
        a, b = here.ends
        if (long := float(np.hypot(*(b - a)))) >= SHORTEST_BARRED:
            found.append(_bar(f"beyond the place to wait: {here.section}", a, b, long - BAR / 2, here.width))
    return tuple(found)


def _bar(name: str, a: FloatArray, b: FloatArray, way: float, width: float) -> Zone:
    """Return a bar across the section from a to b, its middle at a way [m] from a."""
    along = (b - a) / np.hypot(*(b - a))
    across = np.array([-along[1], along[0]]) * (width / 2 + LINE_BEYOND)
    middle, half = a + way * along, along * BAR / 2
    corners = np.array([middle - half - across, middle + half - across, middle + half + across, middle - half + across])
    return Zone(name, Rule.KEEP_OUT, corners)


def _ring_sections(graph: TrafficGraph) -> frozenset[str]:
    """Return the sections without which their ends are still joined: those of a ring."""
    numbers = {node.name: k for k, node in enumerate(graph.nodes)}
    pairs = [(numbers[section.start], numbers[section.end]) for section in graph.sections]
    found = []
    for k, section in enumerate(graph.sections):
        others = np.array([pair for j, pair in enumerate(pairs) if j != k], np.int64).reshape(-1, 2)
        shape = (len(numbers), len(numbers))
        joined = csr_array((np.ones(len(others)), (others[:, 0], others[:, 1])), shape=shape)
        _, parts = connected_components(joined, directed=False)
        if parts[pairs[k][0]] == parts[pairs[k][1]]:
            found.append(section.name)
    return frozenset(found)


def chain_of(
    ways: Ways, places: Sequence[SpotPlace], rooms: dict[tuple[str, str], float], spots: Sequence[int]
) -> Chain:
    """Return the chain of some spots on the floor."""
    points: list[FloatArray] = []
    marks: list[int] = []  # index of the point at the end of each spot
    for spot in spots:
        start, end = places[spot].ends
        for point in (start, end) if places[spot].section is not None else (start,):
            if not points or np.hypot(*(points[-1] - point)) > 1e-9:
                points.append(point)
        marks.append(len(points) - 1)
    if len(points) == 1:  # a chair at rest in its refuge
        points.append(points[0] + (1.0, 0.0))
    line = np.array(points)
    along = arc_lengths(line)
    until, widths = np.zeros(len(spots)), np.zeros(len(spots))
    for k, spot in enumerate(spots):
        here = places[spot]
        way = float(along[marks[k]])
        if k + 1 == len(spots):
            until[k], widths[k] = math.inf, here.width
            continue
        after = places[spots[k + 1]]
        if here.node is not None:  # from a node into a section
            assert after.section is not None
            until[k], widths[k] = way + rooms[here.node, after.section], after.width
        else:
            assert after.node is not None
            assert here.section is not None
            room = rooms[after.node, here.section]
            backs_out = np.hypot(*(after.ends[0] - here.ends[0])) < 1e-9
            until[k] = way + (float(np.hypot(*(here.ends[1] - here.ends[0]))) - room if backs_out else -room)
            widths[k] = here.width
    return Chain(line, along, np.maximum.accumulate(until), widths)


def goes_straight(graph: TrafficGraph, name: str) -> bool:
    """Return whether a node only divides a straight corridor."""
    ends = {end for move in graph.moves[name] for end in (move.start, move.end)} - {name}
    if len(graph.moves[name]) != 2 or len(ends) != 2:
        return False
    here = graph.node[name]
    a, b = (math.atan2(graph.node[end].y - here.y, graph.node[end].x - here.x) for end in sorted(ends))
    return abs(abs(math.remainder(a - b, math.tau)) - math.pi) < _STRAIGHT
