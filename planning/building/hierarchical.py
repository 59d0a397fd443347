"""Routes through a whole building: from a place, pose or node to another, over doorways and lifts.

One interface, `RoutePlanner`, for the border tables and the searches they are compared with (`Method`). On one storey the
grid planner stays the planner: the route says which doorway, lift and storey come next, and what the way costs.
"""

from __future__ import annotations

import difflib
import enum
import re
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from waychair.errors import BuildingError, NoPath
from waychair.maps.building.building import goals
from waychair.maps.building.costs import CLOSED_MM, millimetres
from waychair.maps.building.graph_arrays import NO_HEADING, Int32Array
from waychair.maps.building.hgraph import Arc, ArcRef, Closure, GraphDoorway, HGraph, NodeRef, SubMap, full_name
from waychair.maps.building.hgraph_edits import arc_ref, with_way
from waychair.maps.building.indexed import IndexedGraph, arc_cost_m, indexed
from waychair.maps.building.text_forms import LONGEST_M
from waychair.planning.building.border_tables import BorderTables
from waychair.planning.building.graph_search import (
    ArcWay,
    GraphSearch,
    brute_force,
    cost_of_way,
    traced,
)
from waychair.planning.building.movements import lift_title, movements, record_of
from waychair.planning.building.tetranauta import Tetranauta
from waychair.planning.movements import Movement


class Method(enum.StrEnum):
    """The methods that find a way: the exact tables, the paper's two, and three searches of the whole graph."""

    TABLES = "tables"
    TETRANAUTA = "tetranauta"
    TETRANAUTA_WITHOUT_TABLES = "tetranauta-without-tables"
    ASTAR = "astar"
    DIJKSTRA = "dijkstra"
    BRUTE_FORCE = "brute-force"


@dataclass(frozen=True, slots=True)
class RouteLeg:
    """A part of a route on one storey, or a ride in a lift: the storey's id, the lift's ("" on a storey), the nodes, the
    length driven [m] and the cost [mm] with its turns."""

    storey: str
    lift: str
    nodes: tuple[NodeRef, ...]
    length: float
    cost: int


@dataclass(frozen=True, slots=True)
class Route:
    """A route: its cost [mm of straight driving], legs, movements, and the addresses of its arcs (None for lifts')."""

    start: NodeRef
    goal: NodeRef
    cost: int
    legs: tuple[RouteLeg, ...]
    movements: tuple[Movement, ...]
    arcs: tuple[ArcRef | None, ...]

    @property
    def length(self) -> float:
        """The length driven [m], without lifts."""
        return sum(leg.length for leg in self.legs)


class RoutePlanner:
    """Finds routes through a building by one method.

    Raises (constructor):
        BuildingError: the graph cannot be compiled (see `indexed`).
    """

    def __init__(
        self,
        hgraph: HGraph,
        method: Method = Method.TABLES,
        now_ns: int | None = None,
        tables: BorderTables | None = None,
        built: IndexedGraph | None = None,
    ) -> None:
        self.hgraph = hgraph
        self.built = indexed(hgraph, now_ns) if built is None else built
        self._method = method
        needs = method is Method.TABLES and tables is None
        self.tables = BorderTables(self.built.graph) if needs else tables
        self._search = GraphSearch(self.built.graph)
        self._preset = Tetranauta(self.built.graph) if method is Method.TETRANAUTA else None
        self._goals = {name.casefold(): ref for name, ref in goals(hgraph).items()}

    def node(self, text: str) -> NodeRef:
        """Return a node given as `PATH:NODE`, as a goal's full name, as the end of one if only one goal has it, or as a
        room with one goal.

        Raises:
            BuildingError: there is none, or more than one.
        """
        path, colon, node = text.rpartition(":")
        if colon and NodeRef(path, node) in self.built.index:
            return NodeRef(path, node)
        wanted = text.strip().casefold()
        if wanted in self._goals:
            return self._goals[wanted]
        found = [ref for name, ref in self._goals.items() if name.endswith(f"/{wanted}")]
        if not found:  # a room stands for its only goal
            found = [ref for name, ref in self._goals.items() if f"/{wanted}/" in f"/{name}"]
        if len(found) == 1:
            return found[0]
        if found:
            names = ", ".join(f"'{full_name(self.hgraph, ref)}'" for ref in found[:3])
            raise BuildingError(f"there are {len(found)} goals '{text}': write one in full, such as {names}")
        near = difflib.get_close_matches(wanted, self._goals, n=3, cutoff=0.0)
        names = ", ".join(f"'{full_name(self.hgraph, self._goals[each])}'" for each in near)
        raise BuildingError(
            f"there is no goal '{text}'" + (f"; did you mean {names}?" if near else " in this building")
        )

    def cost(self, start: NodeRef, goal: NodeRef) -> int:
        """Return the cost between two nodes [mm], `CLOSED_MM` if there is no way."""
        return self._way(self._index(start), self._index(goal)).cost

    def costs_from(self, start: NodeRef, ends: Collection[NodeRef]) -> dict[NodeRef, int]:
        """Return the costs from a node to many [mm], for menus."""
        indices = np.array([self._index(end) for end in ends], np.int64)
        if self.tables is not None:
            costs = self.tables.costs_from(self._index(start), indices)
        else:
            costs = self._search.costs_to_all(self._index(start))[indices]
        return dict(zip(ends, costs.tolist(), strict=True))

    def way(self, start: NodeRef, goal: NodeRef) -> ArcWay:
        """Return the cheapest way as directed arcs of `built`.

        Raises:
            BuildingError: there is no such node.
            NoPath: there is no way; the sentence names what is closed on the way that there would be.
        """
        one, other = self._index(start), self._index(goal)
        way = self._way(one, other)
        if way.cost >= CLOSED_MM:
            raise NoPath(self._no_way(one, other, np.empty(0, np.int32)))
        return way

    def route(self, start: NodeRef, goal: NodeRef, avoid: Collection[str | ArcRef] = ()) -> Route:
        """Return the cheapest route that avoids the given lifts (by id or name), nodes (`PATH:NODE`) and arcs.

        Raises:
            BuildingError: there is no such node, lift or arc.
            NoPath: there is no way; the sentence names what is closed or avoided on the way that there would be.
        """
        one, other = self._index(start), self._index(goal)
        shut = self._avoided(avoid)
        way = self._way(one, other) if not len(shut) else self._way_without(one, other, shut)
        if way.cost >= CLOSED_MM:
            raise NoPath(self._no_way(one, other, shut))
        return self._route(start, goal, way)

    def close(self, ref: ArcRef, reason: str, until_ns: int | None = None) -> None:
        """Close an arc or doorway, for a reason and until a time [ns UTC]; routes avoid it from now on.

        Raises:
            BuildingError: there is no such arc.
        """
        self._change(ref, closure=Closure(reason, until_ns))

    def reopen(self, ref: ArcRef) -> None:
        """Open an arc or doorway again; raises as `close`."""
        self._change(ref, closure=None)

    def reopen_ended(self, now_ns: int) -> tuple[ArcRef, ...]:
        """Open all arcs and doorways whose closure has ended by a time [ns UTC]; return them."""
        ended = [
            arc_ref(submap, each)
            for submap in self.hgraph.submaps.values()
            for each in _ways_of(submap)
            if each.way.closure is not None and not each.way.closure.holds(now_ns)
        ]
        for ref in ended:
            self.reopen(ref)
        return tuple(ended)

    def reprice(self, ref: ArcRef, metres: float | None) -> None:
        """Give an arc or doorway a price [m of straight driving] in place of its cost, None for its own again.

        Raises:
            BuildingError: there is no such arc, or the price is impossible.
        """
        if metres is not None and not 0.0 <= metres <= LONGEST_M:
            raise BuildingError(f"the price of {ref} is {metres:g} m: give 0 to {LONGEST_M:g} m, or close it")
        self._change(ref, price=metres)

    def _change(self, ref: ArcRef, **changes: object) -> None:
        self.hgraph = with_way(self.hgraph, ref, **changes)
        ref = self._stored(ref)
        record = record_of(self.hgraph, ref)
        assert record is not None  # `with_way` has changed it
        arcs = np.array([arc for arc in self.built.arcs[ref] if arc >= 0])
        graph = self.built.graph
        distance = float(np.hypot(*(graph.xy[graph.head[arcs[0]]] - graph.xy[graph.tail[arcs[0]]])))
        cost = max(1, millimetres(arc_cost_m(record.way, distance, self.hgraph.costs)))
        self.built.open_cost[arcs] = cost
        shown = np.full(len(arcs), cost if record.way.closure is None else CLOSED_MM)
        if self.tables is not None:
            self.tables.reprice(arcs, shown)
        else:
            graph.cost[arcs] = shown
        self._search = GraphSearch(graph)  # its bound is that of the new costs
        if self._preset is not None:
            self._preset = Tetranauta(graph)

    def _way(self, start: int, goal: int) -> ArcWay:
        if self._method is Method.TABLES and self.tables is not None:
            return self.tables.way(start, goal)
        if self._preset is not None:
            return self._preset.way(start, goal)
        if self._method is Method.TETRANAUTA_WITHOUT_TABLES:
            return self._search.way_past_rooms(start, goal)
        if self._method is Method.BRUTE_FORCE:
            cost, last, before = brute_force(self.built.graph, start, goal)
            return ArcWay(int(cost), traced(before, last))
        return self._search.way(start, goal, guided=self._method is Method.ASTAR)

    def _way_without(self, start: int, goal: int, shut: Int32Array) -> ArcWay:
        costs = self.built.graph.cost.copy()
        costs[shut] = CLOSED_MM
        return GraphSearch(self.built.graph._replace(cost=costs)).way(start, goal, guided=True)

    def _index(self, ref: NodeRef) -> int:
        if ref not in self.built.index:
            raise BuildingError(f"there is no node {ref} in this building: see waychair building stats")
        return self.built.index[ref]

    def _stored(self, ref: ArcRef) -> ArcRef:
        """Return the address of an arc or doorway as its record has it, given its ends in either order.

        Raises:
            BuildingError: there is none.
        """
        for each in (ref, ArcRef(ref.submap, ref.end, ref.start)):
            if each in self.built.arcs:
                return each
        raise BuildingError(f"there is no arc {ref}: name the sub-map, then its two ends, as in ground/west:n1>n2")

    def _avoided(self, avoid: Collection[str | ArcRef]) -> Int32Array:
        """Return the directed arcs that lifts, nodes and arcs to avoid stand for."""
        graph, found = self.built.graph, []
        for each in avoid:
            ref = arc_named(each) if isinstance(each, str) else each
            if ref is not None:
                found += [arc for arc in self.built.arcs[self._stored(ref)] if arc >= 0]
                continue
            assert isinstance(each, str)
            lifts = [lift for lift in self.hgraph.lifts.values() if each in (lift.id, lift.name)]
            if lifts:
                cabins = [index for ref, index in self.built.index.items() if ref.submap == f"@{lifts[0].id}"]
                found += np.flatnonzero(np.isin(graph.head, cabins)).tolist()
                continue
            node = self._index(self.node(each))
            found += np.flatnonzero((graph.head == node) | (graph.tail == node)).tolist()
        return np.array(found, np.int32)

    def _no_way(self, start: int, goal: int, shut: Int32Array) -> str:
        """Return the sentence of a way that there is not: the closed and avoided arcs on the way that there would be."""
        ends = f"from {self._title(start)} to {self._title(goal)}"
        way = GraphSearch(self.built.graph._replace(cost=self.built.open_cost)).way(start, goal, guided=False)
        if way.cost >= CLOSED_MM:
            return f"there is no way {ends}, even were nothing closed: see waychair building check"
        blocked = [arc for arc in way.arcs.tolist() if self.built.graph.cost[arc] >= CLOSED_MM or arc in shut]
        names = list(dict.fromkeys(self._closed_text(arc) for arc in blocked))
        return f"there is no way {ends}, as {' and '.join(names[:3])}: open it, or choose another goal"

    def _closed_text(self, arc: int) -> str:
        graph, owner = self.built.graph, self.built.owners[arc]
        if owner is None:
            ends = self.built.refs[graph.tail[arc]], self.built.refs[graph.head[arc]]
            cabin = ends[0] if ends[0].submap.startswith("@") else ends[1]
            lift = self.hgraph.lifts[cabin.submap[1:]]
            stop = next(each for each in lift.stops if each.storey == cabin.node)
            if stop.closure is None:
                return f"{lift_title(lift)} is to be avoided"
            return f"{lift_title(lift)} does not serve storey '{cabin.node}' ({stop.closure.reason})"
        record = record_of(self.hgraph, owner)
        closure = None if record is None else record.way.closure
        return f"{owner} is closed ({closure.reason})" if closure is not None else f"{owner} is to be avoided"

    def _title(self, node: int) -> str:
        return f"'{full_name(self.hgraph, self.built.refs[node])}'"

    def _route(self, start: NodeRef, goal: NodeRef, way: ArcWay) -> Route:
        told = movements(self.hgraph, self.built, way.arcs)
        owners = tuple(self.built.owners[arc] for arc in way.arcs.tolist())
        return Route(start, goal, way.cost, self._legs(start, way), told, owners)

    def _legs(self, start: NodeRef, way: ArcWay) -> tuple[RouteLeg, ...]:
        """Return the parts of a way on one storey each, and the rides between them; turns belong to the later part."""
        graph, refs = self.built.graph, self.built.refs
        legs: list[RouteLeg] = []
        arcs = way.arcs
        k = 0
        while k < len(arcs):
            riding, last = bool(graph.heading[arcs[k]] == NO_HEADING), k
            lift = self._lift(int(arcs[k])) if riding else ""
            while last + 1 < len(arcs) and self._lift(int(arcs[last + 1])) == lift:
                last += 1
            part = arcs[k : last + 1]
            with_turn = cost_of_way(graph, arcs[: last + 1]) - cost_of_way(graph, arcs[:k])
            nodes = (refs[graph.tail[part[0]]], *(refs[head] for head in graph.head[part].tolist()))
            length = 0.0 if riding else float(sum(self._length(arc) for arc in part.tolist()))
            storey = self._storey(nodes[-1])
            legs.append(RouteLeg(storey, lift, nodes, length, int(with_turn)))
            k = last + 1
        return tuple(legs) or (RouteLeg(self._storey(start), "", (start,), 0.0, 0),)

    def _lift(self, arc: int) -> str:
        """Return the id of the lift that a directed arc belongs to, "" for one that is driven."""
        graph, refs = self.built.graph, self.built.refs
        if graph.heading[arc] != NO_HEADING:
            return ""
        ends = refs[graph.tail[arc]].submap, refs[graph.head[arc]].submap
        return str(next(each[1:] for each in ends if each.startswith("@")))

    def _storey(self, ref: NodeRef) -> str:
        return ref.node if ref.submap.startswith("@") else self.hgraph.storey_of(ref.submap)

    def _length(self, arc: int) -> float:
        """Return the length driven along a directed arc [m]."""
        graph, owner = self.built.graph, self.built.owners[arc]
        record = None if owner is None else record_of(self.hgraph, owner)
        if record is not None and record.way.length is not None:
            return record.way.length
        return float(np.hypot(*(graph.xy[graph.head[arc]] - graph.xy[graph.tail[arc]])))


def arc_named(text: str) -> ArcRef | None:
    """Return the address in a text such as `ground/west:n1>n2` or `ground:n1>ward:d`; None if it has another form."""
    found = _ARC.fullmatch(text.strip())
    return None if found is None else ArcRef(*found.groups())


_ARC = re.compile(r"([^:>]*):([^:>]+)>([^>]+)")


def _ways_of(submap: SubMap) -> tuple[Arc | GraphDoorway, ...]:
    return (*submap.arcs, *submap.doorways)
