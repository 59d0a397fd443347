"""Where the spots of a traffic graph lie on the floor: the polyline of a chain, and the stop lines across it.

Sections follow the course that their graph gives them: straight on a floor plan, bent where the graph was made of a mapped
floor, with the clear width along it, so that a stop line lies across the way wherever it ends. A node reaches so far along its sections that
a chair before it leaves room for another one to turn there; a refuge begins at the edge of the corridor.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import arc_lengths, transform_points
from waychair.maps.drawn.zones import Rule, Zone
from waychair.maps.traffic.traffic_graph import Section, TrafficGraph
from waychair.planning.fleet.ways import MOST_AT_A_NODE, Ways
from waychair.types import BoolArray, FloatArray, Pose2

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
    """The way of a spot: points (N, 2) [m] in map, all equal for nodes and slots, and the clear `widths` (N,) [m] there."""

    points: FloatArray
    widths: FloatArray
    node: str | None
    section: str | None

    @property
    def length(self) -> float:
        """The length [m] of the way."""
        return float(arc_lengths(self.points)[-1])

    def at(self, way: float) -> tuple[FloatArray, float, float]:
        """Return the point (2,) [m], the heading [rad] and the clear width [m] at a way [m] from its start."""
        along = arc_lengths(self.points)
        return *_place_at(self.points, along, way), float(np.interp(way, along, self.widths))


@dataclass(frozen=True)
class ChainLine:
    """The spots of a chair's chain as a polyline (N, 2) [m] in map with the way (N,) along it.

    Spot k reaches up to `until[k]` [m] along the way; there lies its stop line, where the way is `widths[k]` [m] wide. `folds` are
    the indices of the points at which the chain turns back on itself: in a bay, or where a chair backs out again.
    """

    points: FloatArray
    along: FloatArray
    until: FloatArray
    widths: FloatArray
    folds: tuple[int, ...]

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
        return _place_at(self.points, self.along, way)

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
        line, begins = self.points[part.start : part.stop + 1], self.along[:-1][part]
        long = np.maximum(np.hypot(*np.diff(line, axis=0).T), 1e-9)
        kept = (begins + long > near - _NEAR) & (begins < near + _NEAR)
        return ways_along(line, begins, points, kept if kept.any() else None)


def spot_places(ways: Ways) -> tuple[SpotPlace, ...]:
    """Return the place of each spot, in the order in which `ways_of` numbers them."""
    graph = ways.graph
    found: list[SpotPlace] = []
    for node in graph.nodes:
        at = np.array([[node.x, node.y]] * 2)
        found += [SpotPlace(at, np.zeros(2), node.name, None)] * min(graph.capacity(node.name), MOST_AT_A_NODE)
    for section in graph.sections:
        way = np.array(graph.way(section.name))
        way[[0, -1], :2] = [(graph.node[each].x, graph.node[each].y) for each in (section.start, section.end)]
        found.append(SpotPlace(way[:, :2], way[:, 2], None, section.name))
        if not section.one_way:
            found.append(SpotPlace(way[::-1, :2], way[::-1, 2], None, section.name))
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
                beside = [_width_at(graph, each, name) / 2 for each in sections if each.name != section.name]
                room = max(beside, default=section.width / 2)
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
        leaving = range(ways.first[spot], ways.first[spot + 1])
        begins_at = {k for k in leaving if _is_at(places, ways, k, place.points[0])}
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
    return bool(np.hypot(*(places[ways.after[edge]].points[0] - point)) < 1e-9)


def bars_off(ways: Ways, places: Sequence[SpotPlace], rings: frozenset[str], spots: Sequence[int]) -> tuple[Zone, ...]:
    """Return keep-out bars across the long sections that are off a chain and by which a chair could go round it.

    `rings` are the sections of `ring_sections`. One more lies at the far end of each section that a chair backs out of again, if that is as long: it goes no farther.
    """
    graph = ways.graph
    used = {places[spot].section for spot in spots}
    found = []
    for section in graph.sections:
        if section.name in used or section.name not in rings or section.length < SHORTEST_BARRED:
            continue
        way = next(place for place in places if place.section == section.name)
        found.append(_bar(f"another way: {section.name}", way, way.length / 2))
    for before, spot, after in zip(spots, spots[1:], spots[2:], strict=False):
        here = places[spot]
        if here.section is None or places[before].node != places[after].node:
            continue
        if here.length >= SHORTEST_BARRED:
            found.append(_bar(f"beyond the place to wait: {here.section}", here, here.length - BAR / 2))
    return tuple(found)


def _bar(name: str, place: SpotPlace, way: float) -> Zone:
    """Return a bar across a section, its middle at a way [m] from its start."""
    middle, heading, width = place.at(way)
    along = np.array([math.cos(heading), math.sin(heading)])
    across = np.array([-along[1], along[0]]) * (width / 2 + LINE_BEYOND)
    half = along * BAR / 2
    corners = np.array([middle - half - across, middle + half - across, middle + half + across, middle - half + across])
    return Zone(name, Rule.KEEP_OUT, corners)


def ring_sections(graph: TrafficGraph) -> frozenset[str]:
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
) -> ChainLine:
    """Return the chain of some spots on the floor."""
    line, marks, folds = _line_along(places, spots)
    along = arc_lengths(line)
    until, widths = np.zeros(len(spots)), np.zeros(len(spots))
    for k, spot in enumerate(spots):
        here = places[spot]
        end = float(along[marks[k]])
        if k + 1 == len(spots):
            until[k], widths[k] = math.inf, here.widths[-1]
            continue
        after = places[spots[k + 1]]
        if here.node is not None:  # from a node into a section
            assert after.section is not None
            room = rooms[here.node, after.section]
            until[k], widths[k] = end + room, after.at(room)[2]
        else:
            assert after.node is not None
            assert here.section is not None
            room = rooms[after.node, here.section]
            backs_out = _meets(after.points[0], here.points[0])
            until[k] = end + (here.length - room if backs_out else -room)
            widths[k] = here.at(room if backs_out else here.length - room)[2]
    return ChainLine(line, along, np.maximum.accumulate(until), widths, folds)


def _line_along(places: Sequence[SpotPlace], spots: Sequence[int]) -> tuple[FloatArray, list[int], tuple[int, ...]]:
    """Return a polyline (N, 2) [m] along some spots, the index of its point at the end of each, and those at which it turns back."""
    points: list[FloatArray] = []
    marks: list[int] = []
    folds: list[int] = []
    before: SpotPlace | None = None
    for spot in spots:
        here = places[spot]
        way = here.points if here.section is not None else here.points[:1]
        if before is not None and before.section is not None and _meets(before.points[0], way[0]):
            way = before.points[::-1]  # it backs out to the node by which it came
        if len(way) > 1 and len(points) > 1 and _meets(points[-1], way[0]) and _meets(points[-2], way[1]):
            folds.append(len(points) - 1)
        for point in way:
            if not points or not _meets(points[-1], point):
                points.append(point)
        marks.append(len(points) - 1)
        before = here
    if len(points) == 1:  # a chair at rest in its refuge
        points.append(points[0] + (1.0, 0.0))
    return np.array(points), marks, tuple(folds)


def goes_straight(graph: TrafficGraph, name: str) -> bool:
    """Return whether a node only divides a straight corridor."""
    ends = {end for move in graph.moves[name] for end in (move.start, move.end)} - {name}
    if len(graph.moves[name]) != 2 or len(ends) != 2:
        return False
    a, b = (_heading_from(graph, graph.section[move.section], name) for move in graph.moves[name])
    return abs(abs(math.remainder(a - b, math.tau)) - math.pi) < _STRAIGHT


def _width_at(graph: TrafficGraph, section: Section, node: str) -> float:
    """Return the clear width [m] of a section at one of its nodes."""
    return graph.way(section.name)[0 if node == section.start else -1].width


def _heading_from(graph: TrafficGraph, section: Section, node: str) -> float:
    """Return the direction [rad] in which a section leaves a node."""
    way = graph.way(section.name)
    here, ahead = way[:2] if node == section.start else way[:-3:-1]
    return math.atan2(ahead.y - here.y, ahead.x - here.x)


def _meets(a: FloatArray, b: FloatArray) -> bool:
    return bool(np.hypot(*(a - b)) < 1e-9)


def ways_along(line: FloatArray, along: FloatArray, points: FloatArray, kept: BoolArray | None = None) -> FloatArray:
    """Return the way (M,) [m] of the nearest place on a polyline (N, 2), which begins at ways (N - 1,), for points (M, 2).

    Only the `kept` (N - 1,) of its pieces are looked at. The way goes on straight before its first and beyond its last point.
    """
    a, steps = line[:-1], np.diff(line, axis=0)
    long = np.maximum(np.hypot(*steps.T), 1e-9)
    share = ((points[:, None] - a) * steps).sum(axis=2) / long**2
    within = np.clip(share, 0.0, 1.0)
    off = np.hypot(*np.moveaxis(points[:, None] - a - within[..., None] * steps, 2, 0))
    best = (off if kept is None else np.where(kept, off, np.inf)).argmin(axis=1)
    rows = np.arange(len(points))
    free = within[rows, best]
    free = np.where(best == 0, np.minimum(share[rows, best], free), free)
    free = np.where(best == len(long) - 1, np.maximum(share[rows, best], free), free)
    ways: FloatArray = along[best] + free * long[best]
    return ways


def _place_at(points: FloatArray, along: FloatArray, way: float) -> tuple[FloatArray, float]:
    """Return the point (2,) and the heading [rad] at a way along a polyline (N, 2), which goes on straight beyond its ends."""
    k = int(np.clip(np.searchsorted(along, way, side="right") - 1, 0, len(along) - 2))
    step = points[k + 1] - points[k]
    length = max(float(np.hypot(*step)), 1e-9)
    share = (way - along[k]) / length
    return points[k] + share * step, math.atan2(step[1], step[0])
