"""The ways of a building as a rider meets them: junctions of each storey's map, and a plan from one of them to a goal.

Both sides of a doorway are two nodes of the graph at one point; a rider passes them as one. Nodes that are joined and nearer
to each other than `JOINED_M` are one junction here. Plans come from the route planner, in microseconds, from any junction:
so another way than the proposed one is planned from in the tick in which it is recognised.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from waychair.errors import BuildingError
from waychair.maps.building.costs import CLOSED_MM, TURN_UP_TO
from waychair.maps.building.graph_arrays import NO_HEADING
from waychair.maps.building.hgraph import Arc, HGraph, NodeRef, full_name, inner_end
from waychair.maps.building.indexed import lift_node
from waychair.maps.grid.cells import OCCUPIED_FROM, cells_from_points
from waychair.maps.grid.cells import inside as inside_grid
from waychair.planning.building.graph_search import ArcWay
from waychair.planning.building.hierarchical import RoutePlanner
from waychair.planning.building.movements import lift_title, storey_title
from waychair.planning.building.way_movements import ToldMovement, told_along
from waychair.types import FloatArray, IntArray, OccupancyGrid, Pose2

JOINED_M = 0.3
"""m; joined nodes nearer than this are one junction."""

PASSED_M, STRAIGHT = 0.35, 1.15
"""m: an arc passes a node so near to its line, if its length is no more than so many times the line's."""

CABIN_M = 1.2
"""m; the chair is in a cabin if its axle is so near to the middle, where the building does not tell the size."""


@dataclass(frozen=True, slots=True)
class Junction:
    """Nodes of a storey at one point [m] of its map, and the junctions joined to it.

    `sides`: on which side of a doorway at this point each way begins; one that goes over to another side passes the door.
    `name` is its address for people and for habits: sub-map and node, never coordinates.
    """

    nodes: tuple[NodeRef, ...]
    x: float
    y: float
    ways: tuple[int, ...]
    sides: tuple[int, ...]
    name: str

    @property
    def door(self) -> bool:
        """Whether a doorway is at this point."""
        return len(set(self.sides)) > 1


@dataclass(frozen=True, slots=True)
class StoreyWays:
    """The junctions of a storey, their points (N, 2) [m] in its map, the ways between them (E, 2), and those with a door."""

    storey: str
    junctions: tuple[Junction, ...]
    points: FloatArray
    ways: IntArray
    doors: frozenset[tuple[int, int]]

    def has_door(self, one: int, other: int) -> bool:
        """Return whether a door is on the way between two junctions."""
        return (min(one, other), max(one, other)) in self.doors

    def passes_door(self, before: int, here: int, after: int) -> bool:
        """Return whether a doorway at a junction is passed on the way from one to another."""
        junction = self.junctions[here]
        sides = dict(zip(junction.ways, junction.sides, strict=True))
        return sides.get(before) != sides.get(after)


@dataclass(frozen=True, slots=True)
class StoreyPart:
    """A part of a plan on one storey: its junctions, its movements, and the lift at its end, with the storey to press.

    `points` (K, 2) [m] in the storey's map and `along` (K,) [m] are those of the junctions. `title` and `to_title` are the
    lift's and the storey's names for people.
    """

    storey: str
    junctions: tuple[int, ...]
    points: FloatArray
    along: FloatArray
    told: tuple[ToldMovement, ...]
    lift: str = ""
    to: str = ""
    title: str = ""
    to_title: str = ""


@dataclass(frozen=True, slots=True)
class Plan:
    """A plan to a goal: its parts, one a storey, its cost [m of straight driving], and the goal's name."""

    goal: NodeRef
    name: str
    parts: tuple[StoreyPart, ...]
    cost: float


class GuidedWays:
    """The ways of a building, and plans over them. Nothing in it changes by a call.

    Raises (constructor):
        BuildingError: a doorway's other side is missing, or the graph cannot be compiled.
    """

    def __init__(self, hgraph: HGraph, grids: Mapping[str, OccupancyGrid] = MappingProxyType({})) -> None:
        """`grids`: the storeys' maps, so that nobody is led to a way behind a wall; all is in sight without them."""
        hgraph = joined_where_they_pass(hgraph)
        self._planner, self._grids = RoutePlanner(hgraph), grids
        self._storeys = {storey.id: _storey_ways(hgraph, storey.id) for storey in hgraph.storeys}
        self._at = {
            ref: number
            for known in self._storeys.values()
            for number, junction in enumerate(known.junctions)
            for ref in junction.nodes
        }

    @property
    def speed(self) -> float:
        """The building's usual speed [m/s]."""
        return self._planner.hgraph.costs.speed_mps

    def node(self, goal: str) -> NodeRef:
        """Return the node of a goal's name; see `RoutePlanner.node`."""
        return self._planner.node(goal)

    def storey(self, storey: str) -> StoreyWays:
        """Return the ways of a storey.

        Raises:
            BuildingError: there is no such storey, or it has no node.
        """
        known = self._storeys.get(storey)
        if known is None or not known.junctions:
            raise BuildingError(f"storey '{storey}' has no graph to guide by: generate it, or draw one")
        return known

    def cabin_of(self, storey: str, pose: Pose2, margin: float = 0.0) -> str:
        """Return the lift in whose cabin, larger by a margin [m] on each side, the chair's axle is on a storey; "" in none."""
        for lift in self._planner.hgraph.lifts.values():
            for stop in lift.stops:
                if stop.storey == storey and stop.cabin is not None:
                    at = stop.cabin.inverse() @ pose
                    length, width = lift.cabin_depth or 2.0 * CABIN_M, lift.cabin_width or 2.0 * CABIN_M
                    if abs(at.x) < length / 2 + margin and abs(at.y) < width / 2 + margin:
                        return lift.id
        return ""

    def cabin_pose(self, lift: str, storey: str) -> Pose2 | None:
        """Return the pose of a lift's cabin in a storey's map, facing the door; None where it is unknown."""
        stops = self._planner.hgraph.lifts[lift].stops
        return next((stop.cabin for stop in stops if stop.storey == storey), None)

    def lifts(self) -> tuple[str, ...]:
        """Return the ids of the lifts."""
        return tuple(self._planner.hgraph.lifts)

    def lobby(self, lift: str, storey: str) -> int:
        """Return the junction before a lift's door on a storey where it stops."""
        return next(self._at[stop.at] for stop in self._planner.hgraph.lifts[lift].stops if stop.storey == storey)

    def junction(self, ref: NodeRef) -> int:
        """Return the junction of a node on its storey."""
        return self._at[ref]

    def storey_title(self, storey: str) -> str:
        """Return a storey's name for people."""
        return storey_title(self._planner.hgraph, storey)

    def lift_title(self, lift: str) -> str:
        """Return a lift's name for people."""
        return lift_title(self._planner.hgraph.lifts[lift])

    def stops(self, lift: str) -> tuple[str, ...]:
        """Return the storeys at which a lift stops."""
        return tuple(stop.storey for stop in self._planner.hgraph.lifts[lift].stops)

    def in_sight(self, storey: str, one: FloatArray, other: FloatArray) -> bool:
        """Return whether no wall of the storey's map is between two points (2,) [m]."""
        grid = self._grids.get(storey)
        if grid is None:
            return True
        count = max(2, int(np.hypot(*(other - one)) / grid.resolution * 1.5))
        cells = cells_from_points(grid, one + np.linspace(0.0, 1.0, count)[:, None] * (other - one))
        cells = cells[inside_grid(grid, cells)]
        return not bool((grid.cells[cells[:, 0], cells[:, 1]] >= OCCUPIED_FROM).any())

    def plan(self, storey: str, behind: int | None, ahead: int, goal: NodeRef) -> Plan:
        """Return the cheapest plan from a junction `ahead`, with the way to it from the one `behind`, None for none.

        Raises:
            BuildingError: there is no such goal.
            NoPath: there is no way.
        """
        nodes = self.storey(storey).junctions[ahead].nodes
        start = min(nodes, key=lambda ref: self._planner.cost(ref, goal))
        return self._planned(storey, start, goal, () if behind is None else (behind,))

    def plan_in_lift(self, lift: str, storey: str, goal: NodeRef) -> Plan:
        """Return the cheapest plan from a lift's cabin at a storey; its first part has no junction if it is a ride. Raises as `plan`."""
        return self._planned(storey, lift_node(lift, storey), goal)

    def cost(self, storey: str, junction: int, goal: NodeRef) -> float:
        """Return the cost from a junction to a goal [m of straight driving]; infinite where there is no way."""
        least = min(self._planner.cost(ref, goal) for ref in self.storey(storey).junctions[junction].nodes)
        return math.inf if least >= CLOSED_MM else least * 1e-3

    def turn_cost(self, angle: float) -> float:
        """Return the cost of a turn by an angle [rad], in metres of straight driving."""
        costs = self._planner.hgraph.costs
        return costs.turn_round_m if abs(angle) > TURN_UP_TO else costs.turn_m if abs(angle) > math.pi / 4 else 0.0

    def _planned(self, storey: str, start: NodeRef, goal: NodeRef, before: tuple[int, ...] = ()) -> Plan:
        way: ArcWay = self._planner.way(start, goal)
        hgraph, built = self._planner.hgraph, self._planner.built
        name = full_name(hgraph, goal)
        parts: list[StoreyPart] = []
        here, passed, lift, to = storey, list[int](), "", ""
        if start.submap.startswith("@"):
            lift, to = start.submap[1:], storey
        else:
            passed = [*before, self._at[start]]
        for arc in way.arcs.tolist():
            head = built.refs[built.graph.head[arc]]
            if head.submap.startswith("@"):
                lift, to = head.submap[1:], head.node
            else:
                if built.graph.heading[arc] == NO_HEADING:  # out of a cabin
                    if passed or to != here:
                        parts.append(self._part(here, passed, name, lift, to))
                    here, passed, lift, to = to, [], "", ""
                if not passed or passed[-1] != self._at[head]:
                    passed.append(self._at[head])
        parts.append(self._part(here, passed, name, lift, to))
        return Plan(goal, name, tuple(parts), way.cost * 1e-3)

    def _part(self, storey: str, passed: Sequence[int], name: str, lift: str, to: str) -> StoreyPart:
        known, hgraph = self._storeys[storey], self._planner.hgraph
        points = known.points[list(passed)].reshape(-1, 2)
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))]) if len(points) else np.empty(0)
        title = lift_title(hgraph.lifts[lift]) if lift else ""
        told = told_along(known, passed, points, along, title or name.rpartition("/")[2], is_lift=bool(lift))
        to_title = storey_title(hgraph, to) if to else ""
        return StoreyPart(storey, tuple(passed), points, along, told, lift, to, title, to_title)


def joined_where_they_pass(hgraph: HGraph) -> HGraph:
    """Return the graph with every arc cut at the nodes of its sub-map that it passes, as a rider can turn off there."""
    changed = dict(hgraph.submaps)
    for path, submap in hgraph.submaps.items():
        if len(submap.nodes) < 3:
            continue
        names = list(submap.nodes)
        points = np.array([(node.x, node.y) for node in submap.nodes.values()])
        arcs: dict[frozenset[str], Arc] = {}
        for arc in submap.arcs:
            for one, other in pairwise([arc.start, *_passed(arc, names, points), arc.end]):
                is_whole = (one, other) == (arc.start, arc.end)
                part = arc if is_whole else replace(arc, start=one, end=other, way=replace(arc.way, length=None))
                arcs.setdefault(frozenset((one, other)), part)
        if len(arcs) != len(submap.arcs) or set(arcs.values()) != set(submap.arcs):
            changed[path] = replace(submap, arcs=tuple(arcs.values()))
    return replace(hgraph, submaps=changed)


def _passed(arc: Arc, names: list[str], points: FloatArray) -> list[str]:
    """Return the nodes that an arc passes, in order; none where something on it has a place of its own."""
    way = arc.way
    if (
        way.width is not None
        or way.one_way
        or way.drive_s is not None
        or way.price is not None
        or way.closure is not None
    ):
        return []
    start, line = points[names.index(arc.start)], points[names.index(arc.end)] - points[names.index(arc.start)]
    length = float(np.hypot(*line))
    if length < 2.0 * PASSED_M or (way.length is not None and way.length > STRAIGHT * length):
        return []
    along = (points - start) @ line / length
    aside = np.abs((points - start) @ np.array([-line[1], line[0]]) / length)
    near = np.flatnonzero((aside < PASSED_M) & (along > PASSED_M) & (along < length - PASSED_M))
    return [names[k] for k in near[np.argsort(along[near])] if names[k] not in (arc.start, arc.end)]


def _storey_ways(hgraph: HGraph, storey: str) -> StoreyWays:
    refs: list[NodeRef] = []
    points: list[tuple[float, float]] = []
    for path, submap in hgraph.submaps.items():
        if hgraph.storey_of(path) == storey:
            frame = hgraph.map_frame_of(path)
            refs += [NodeRef(path, node.id) for node in submap.nodes.values()]
            points += [frame.point(node.x, node.y) for node in submap.nodes.values()]
    index = {ref: number for number, ref in enumerate(refs)}
    pairs = list(_pairs(hgraph, storey, index))
    near = [(one, other, door) for one, other, door in pairs if math.dist(points[one], points[other]) < JOINED_M]
    group = _groups(len(refs), [(one, other) for one, other, _ in near])
    side = _groups(len(refs), [(one, other) for one, other, door in near if not door])
    number = {root: k for k, root in enumerate(dict.fromkeys(group))}
    members: list[list[int]] = [[] for _ in number]
    for each, root in enumerate(group):
        members[number[root]].append(each)
    ways: dict[tuple[int, int], bool] = {}
    beside: list[dict[int, int]] = [{} for _ in members]
    for one, other, is_door in pairs:
        a, b = number[group[one]], number[group[other]]
        if a == b:
            continue
        key = (min(a, b), max(a, b))
        ways[key] = ways.get(key, False) or is_door
        beside[a].setdefault(b, side[one])
        beside[b].setdefault(a, side[other])
    junctions = []
    for k, grouped in enumerate(members):
        x, y = np.mean([points[each] for each in grouped], axis=0)
        nodes = tuple(refs[each] for each in grouped)
        name = full_name(hgraph, nodes[0])
        junctions.append(Junction(nodes, float(x), float(y), tuple(beside[k]), tuple(beside[k].values()), name))
    own = frozenset(pair for pair, is_door in ways.items() if is_door and not any(junctions[k].door for k in pair))
    array = np.array([(each.x, each.y) for each in junctions], np.float64).reshape(-1, 2)
    return StoreyWays(storey, tuple(junctions), array, np.array(list(ways), np.int64).reshape(-1, 2), own)


def _groups(count: int, pairs: Sequence[tuple[int, int]]) -> list[int]:
    """Return a number for each of `count` things, the same for those that pairs join."""
    group = list(range(count))
    for one, other in pairs:
        low, high = sorted((_root(group, one), _root(group, other)))
        group[high] = low
    return [_root(group, each) for each in range(count)]


def _pairs(hgraph: HGraph, storey: str, index: dict[NodeRef, int]) -> Iterator[tuple[int, int, bool]]:
    """Yield the ends of the ways of a storey, and whether a door is on them."""
    for path, submap in hgraph.submaps.items():
        if hgraph.storey_of(path) != storey:
            continue
        for arc in submap.arcs:
            yield index[NodeRef(path, arc.start)], index[NodeRef(path, arc.end)], arc.way.width is not None
        for doorway in submap.doorways:
            inner = inner_end(submap, doorway)
            if inner not in index:
                raise BuildingError(f"a doorway of '{path}' leads to {inner}, which is no node of the storey: add it")
            yield index[NodeRef(path, doorway.start)], index[inner], True


def _root(group: list[int], each: int) -> int:
    while group[each] != each:
        each = group[each]
    return each
