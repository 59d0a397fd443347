"""The traffic graph: sections that chairs share, the nodes between them, and the refuges where a chair is in nobody's way.

A section is a piece of corridor between two nodes, at most 8 m long. Two chairs pass each other on it where it is wide
enough for two lanes; a section of one lane takes chairs of one direction at a time. A node is the turning circle of one
chair. A refuge hangs on a node of its own and has slots. A lift is one cabin: its sections are used by one chair at a
time, whichever stops they join.

The graph is plain data over names. `maps/traffic/single_file.py` derives the runs and districts, `well_formed.py` tells
which places shut off others, and `corridors.py` and `mapped_floor.py` make graphs.
"""

from __future__ import annotations

import enum
import hashlib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import NamedTuple, TypeAlias

from waychair.errors import TrafficError

LONGEST_SECTION = 8.0
"""m; a longer piece of corridor is cut, so that a chair behind another waits for a part of it only."""

PASSING_ROOM = 0.30
"""m; two chairs pass in twice their width, this, and a cell of their map: 10 cm on either side and between them.

Chairs A of 0.60 m pass in 1.525 m, the passing width of the ADA, on cells of 2.5 cm, and in 1.55 m on cells of 5 cm.
"""

CELL = 0.05
"""m; side of the cells of the chairs' maps: walls may take half a cell of the clear width on either side."""

_WAY_ERROR = 0.01
"""m; the way of a section may differ by so much from its nodes, length and width, as texts are rounded."""

SINGLE_FILE_ROOM = 0.10
"""m; a chair needs its width and this to drive through a section at all, 5 cm on either side."""


class RefugeKind(enum.Enum):
    """The purpose of a refuge."""

    PLACE = "place"
    """a goal in a room"""
    DOCK = "dock"
    """the home of one chair, where it is charged"""
    BAY = "bay"
    """room beside a corridor, made for waiting"""


@dataclass(frozen=True, slots=True)
class TrafficNode:
    """A point where sections meet: `x`, `y` [m] in the map of its storey.

    `capacity` is the number of chairs that can be at the node at once; 1 is the turning circle of one chair.
    """

    name: str
    x: float
    y: float
    storey: str = "ground"
    capacity: int = 1


class WayPoint(NamedTuple):
    """A point of a section's way in the map of its storey: `x`, `y` [m], and the clear `width` [m] across the way there."""

    x: float
    y: float
    width: float


@dataclass(frozen=True, slots=True)
class Section:
    """A piece of way between two nodes.

    Attributes:
        name: its name in orders, logs and sentences.
        start, end: the names of its nodes.
        length: metres along the way that a chair drives.
        width: least clear width [m] along that way.
        lanes: 2 where two chairs pass each other (both keep right), else 1.
        one_way: whether it may be driven from start to end only.
        delay_s: fixed time [s] that it takes beside driving: a door, or a lift's waiting and ride.
        lift: the name of the lift that it belongs to; the sections of one lift are used by one chair at a time.
        points: the way from node to node, where it is bent or not equally wide; empty for a straight way of one width.
    """

    name: str
    start: str
    end: str
    length: float
    width: float
    lanes: int = 1
    one_way: bool = False
    delay_s: float = 0.0
    lift: str | None = None
    points: tuple[WayPoint, ...] = ()

    @property
    def resource(self) -> str:
        """The name under which it is shared: the lift's for a lift, else its own."""
        return self.name if self.lift is None else self.lift

    def other(self, node: str) -> str:
        """Return the node at the other end."""
        return self.end if node == self.start else self.start

    def seconds(self, speed: float) -> float:
        """Return the time [s] that a chair at a speed [m/s] takes through it when nobody is in its way."""
        return self.length / speed + self.delay_s


@dataclass(frozen=True, slots=True)
class Refuge:
    """A place where a chair stands in nobody's way.

    Attributes:
        name: the place's name.
        node: the name of its node. Nothing else is on the way through that node, unless `well_formed` says so.
        slots: the number of chairs that have room in it.
        kind: place, dock or bay.
        waiting: whether a chair may step aside into it although it is not the chair's goal.
        owner: the number of the chair to which a dock belongs; none: everybody's.
    """

    name: str
    node: str
    slots: int = 1
    kind: RefugeKind = RefugeKind.PLACE
    waiting: bool = False
    owner: int | None = None


@dataclass(frozen=True, slots=True)
class TrafficLift:
    """One cabin and its stops, from the lowest up; `stops` are names of nodes, its lobbies, which are refuges."""

    name: str
    stops: tuple[str, ...]


_Part: TypeAlias = TrafficNode | Section | Refuge | TrafficLift


class DirectedSection(NamedTuple):
    """A section in one direction, from node to node."""

    section: str
    start: str
    end: str


@dataclass(frozen=True)
class TrafficGraph:
    """Nodes, sections, refuges and lifts by name, in the order of the file; `chair_width` and `cell` [m] decide the lanes.

    `revision` counts the versions of one building's graph, and `changes_since` tells what differs. `fingerprint` is
    equal for equal graphs.

    Raises:
        TrafficError: a name is used twice or unknown, a number is impossible, or a section joins a node to itself.
    """

    name: str
    nodes: tuple[TrafficNode, ...]
    sections: tuple[Section, ...]
    refuges: tuple[Refuge, ...] = ()
    lifts: tuple[TrafficLift, ...] = ()
    chair_width: float = 0.60
    revision: int = 0
    cell: float = CELL

    def __post_init__(self) -> None:
        _check(self)

    @cached_property
    def node(self) -> Mapping[str, TrafficNode]:
        """The nodes by name."""
        return MappingProxyType({node.name: node for node in self.nodes})

    @cached_property
    def section(self) -> Mapping[str, Section]:
        """The sections by name."""
        return MappingProxyType({section.name: section for section in self.sections})

    @cached_property
    def refuge(self) -> Mapping[str, Refuge]:
        """The refuges by name."""
        return MappingProxyType({refuge.name: refuge for refuge in self.refuges})

    @cached_property
    def refuge_at(self) -> Mapping[str, Refuge]:
        """The refuge of each node that has one, by the node's name."""
        return MappingProxyType({refuge.node: refuge for refuge in self.refuges})

    @cached_property
    def lift(self) -> Mapping[str, TrafficLift]:
        """The lifts by name."""
        return MappingProxyType({lift.name: lift for lift in self.lifts})

    @cached_property
    def moves(self) -> Mapping[str, tuple[DirectedSection, ...]]:
        """The moves that leave each node, in the order of the sections; a one-way section gives one only."""
        leaving: dict[str, list[DirectedSection]] = {node.name: [] for node in self.nodes}
        for section in self.sections:
            leaving[section.start].append(DirectedSection(section.name, section.start, section.end))
            if not section.one_way:
                leaving[section.end].append(DirectedSection(section.name, section.end, section.start))
        return MappingProxyType({name: tuple(moves) for name, moves in leaving.items()})

    def way(self, section: str) -> tuple[WayPoint, ...]:
        """Return the way of a section, by its name, from its start to its end."""
        here = self.section[section]
        ends = (self.node[here.start], self.node[here.end])
        return here.points or tuple(WayPoint(node.x, node.y, here.width) for node in ends)

    def capacity(self, node: str) -> int:
        """Return the number of chairs that may be at a node: its refuge's slots, or its own capacity."""
        refuge = self.refuge_at.get(node)
        return self.node[node].capacity if refuge is None else max(refuge.slots, self.node[node].capacity)

    @property
    def storeys(self) -> tuple[str, ...]:
        """The storeys, in the order in which the nodes name them."""
        return tuple(dict.fromkeys(node.storey for node in self.nodes))

    @cached_property
    def fingerprint(self) -> str:
        """A short hash over everything but the revision: equal for equal graphs, on every computer."""
        values = [self.name, repr(self.chair_width), repr(self.cell)]
        values.extend(repr(part) for part in _all_parts(self))
        return hashlib.sha256("\x1e".join(values).encode()).hexdigest()[:12]


@dataclass(frozen=True, slots=True)
class TrafficChange:
    """The names that differ between two revisions of a graph: nodes, sections, refuges and lifts."""

    added: tuple[str, ...]
    removed: tuple[str, ...]
    altered: tuple[str, ...]

    def __bool__(self) -> bool:
        return bool(self.added or self.removed or self.altered)


def changes_since(old: TrafficGraph, new: TrafficGraph) -> TrafficChange:
    """Return the names of the parts that are in one graph only, or that differ."""
    before, after = _parts(old), _parts(new)
    return TrafficChange(
        tuple(part.name for key, part in after.items() if key not in before),
        tuple(part.name for key, part in before.items() if key not in after),
        tuple(part.name for key, part in after.items() if key in before and before[key] != part),
    )


def passing_width(chair_width: float, cell: float = CELL) -> float:
    """Return the clear width [m] in which two chairs of a width [m] pass each other by a map whose cells are `cell` [m] wide."""
    return 2 * chair_width + PASSING_ROOM + cell


def lanes_for(width: float, chair_width: float, cell: float = CELL) -> int:
    """Return 2 where two chairs pass each other in a clear width [m], 1 where one drives, and 0 where none fits."""
    if width >= passing_width(chair_width, cell) - 1e-9:
        return 2
    return 1 if width >= chair_width + SINGLE_FILE_ROOM - 1e-9 else 0


def _all_parts(graph: TrafficGraph) -> tuple[_Part, ...]:
    return (*graph.nodes, *graph.sections, *graph.refuges, *graph.lifts)


def _parts(graph: TrafficGraph) -> dict[tuple[type[_Part], str], _Part]:
    return {(type(part), part.name): part for part in _all_parts(graph)}


def _check(graph: TrafficGraph) -> None:
    _unique("node", (node.name for node in graph.nodes))
    _unique("section", (section.name for section in graph.sections))
    _unique("refuge", (refuge.name for refuge in graph.refuges))
    _unique("refuge at node", (refuge.node for refuge in graph.refuges))
    _unique("lift", (lift.name for lift in graph.lifts))
    nodes = {node.name for node in graph.nodes}
    lifts = {lift.name for lift in graph.lifts}
    for node in graph.nodes:
        if not (math.isfinite(node.x) and math.isfinite(node.y)):
            raise TrafficError(f"node {node.name} lies at x {node.x}, y {node.y}; give finite metres")
        if node.capacity < 1:
            raise TrafficError(f"node {node.name} has a capacity of {node.capacity}; it must be 1 or more")
    if not (math.isfinite(graph.cell) and graph.cell > 0):
        raise TrafficError(f"cells of {graph.cell} m are impossible; give a side above 0")
    for section in graph.sections:
        _check_section(section, nodes, lifts, graph)
        if section.points:
            _check_points(section, graph)
    for refuge in graph.refuges:
        if refuge.node not in nodes:
            raise TrafficError(f"refuge {refuge.name} names node {refuge.node}, which is not in the graph")
        if refuge.slots < 1:
            raise TrafficError(f"refuge {refuge.name} has {refuge.slots} slots; it must have 1 or more")
    for lift in graph.lifts:
        if len(set(lift.stops)) < 2:
            raise TrafficError(f"lift {lift.name} has fewer than two stops; name the lobby of each storey it serves")
        for stop in lift.stops:
            if stop not in nodes:
                raise TrafficError(f"lift {lift.name} stops at node {stop}, which is not in the graph")


def _check_section(section: Section, nodes: set[str], lifts: set[str], graph: TrafficGraph) -> None:
    for end in (section.start, section.end):
        if end not in nodes:
            raise TrafficError(f"section {section.name} names node {end}, which is not in the graph")
    if section.start == section.end:
        raise TrafficError(f"section {section.name} joins node {section.start} to itself; give two nodes")
    if not (math.isfinite(section.length) and section.length > 0):
        raise TrafficError(f"section {section.name} is {section.length} m long; its length must be above 0")
    if not (math.isfinite(section.width) and section.width > 0):
        raise TrafficError(f"section {section.name} has a clear width of {section.width} m; it must be above 0")
    if not (math.isfinite(section.delay_s) and section.delay_s >= 0):
        raise TrafficError(f"section {section.name} has a delay of {section.delay_s} s; it must be 0 or more")
    fit = lanes_for(section.width, graph.chair_width, graph.cell)
    if fit == 0:
        raise TrafficError(
            f"section {section.name} is {section.width:.2f} m wide, too narrow for a chair of {graph.chair_width:.2f} m; "
            "leave the section out or give a narrower chair"
        )
    if not 1 <= section.lanes <= fit:
        raise TrafficError(
            f"section {section.name} has {section.lanes} lanes, but its {section.width:.3f} m give room for {fit}: two chairs "
            f"of {graph.chair_width:.2f} m pass from {passing_width(graph.chair_width, graph.cell):.3f} m on"
        )
    if section.lift is not None and section.lift not in lifts:
        raise TrafficError(f"section {section.name} belongs to lift {section.lift}, which is not in the graph")


def _check_points(section: Section, graph: TrafficGraph) -> None:
    way = section.points
    if not all(math.isfinite(value) for point in way for value in point):
        raise TrafficError(f"the way of section {section.name} has a value that is not finite; give metres")
    ends = [(node.x, node.y) for node in (graph.node[section.start], graph.node[section.end])]
    if any(math.dist(end, point[:2]) > _WAY_ERROR for end, point in zip(ends, (way[0], way[-1]), strict=True)):
        raise TrafficError(
            f"the way of section {section.name} does not lead from node {section.start} to {section.end}; begin and end it there"
        )
    long = sum(math.dist(a[:2], b[:2]) for a, b in pairwise(way))
    if abs(long - section.length) > _WAY_ERROR:
        raise TrafficError(
            f"the way of section {section.name} is {long:.2f} m long, not {section.length:.2f} m; correct one"
        )
    if min(point.width for point in way) < section.width - _WAY_ERROR:
        raise TrafficError(
            f"the way of section {section.name} is narrower than {section.width:.2f} m; correct its width"
        )


def _unique(kind: str, names: Iterable[str]) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise TrafficError(f"the traffic graph names {kind} {name} twice; every {kind} needs a name of its own")
        seen.add(name)
