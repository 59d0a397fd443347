"""Exact border tables of a building: costs and ways between any two nodes, repaired when arcs close or are re-priced.

The tables hold the costs between the borders of the sub-maps at every level of the tree, within each and around it, so
that ways which leave a sub-map and return are exact, too. They are what became of the pre-calculated trajectories of
"TetraNauta" (section 2, groups 1 to 5): entries go from one crossing arc to another instead of from node to node, so
that no turn at a joint is lost, and lifts are arcs like others.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from waychair.maps.building.costs import CLOSED_MM, DEAREST_MM
from waychair.maps.building.graph_arrays import GraphArrays, Int32Array
from waychair.planning.building.border_costs import SEARCHED, costs_between, new_plan, searched, table_cost
from waychair.planning.building.border_kernels import make, make_around, make_within
from waychair.planning.building.border_ways import query_room, table_way, way_between, ways_between
from waychair.planning.building.graph_search import ArcWay
from waychair.planning.building.overlay import Tables, laid_out, net_of
from waychair.types import IntArray

_PARTS = 100  # of all sub-maps, after each of which progress is told


class BorderTables:
    """The exact tables of a graph. `graph.cost` belongs to them from now on: change it by `reprice` only."""

    def __init__(
        self,
        graph: GraphArrays,
        tables: Tables | None = None,
        progress: Callable[[float], None] = lambda share: None,
    ) -> None:
        """`tables` None: they are made, while `progress` is called with the share (0 to 1) of the sub-maps that is done."""
        self.graph = graph
        self.tables = made(graph, progress) if tables is None else tables
        self._net = net_of(graph)
        self._room = query_room(self.tables)
        self._plan = new_plan()
        self._way = np.empty(1024, np.int32)

    def cost(self, start: int, goal: int) -> int:
        """Return the cost between two nodes [mm], `CLOSED_MM` if there is no way."""
        book, numbers, sums = self.tables.book, self.tables.numbers, self._room.sums
        cost: int = table_cost(self._net.node_submap, book, numbers, start, goal, self._plan, sums)
        if cost == SEARCHED:
            cost = searched(self._net, self.tables, start, goal, sums)[0]
        return cost

    def costs(self, starts: IntArray | Int32Array, goals: IntArray | Int32Array) -> Int32Array:
        """Return the costs of many ways (Q,) [mm]."""
        ends = starts.astype(np.int32), goals.astype(np.int32)
        found: Int32Array = costs_between(self._net, self.tables, *ends, self._room.sums)
        return found

    def costs_from(self, start: int, goals: IntArray | Int32Array) -> Int32Array:
        """Return the costs from a node to many goals (Q,) [mm], for menus."""
        return self.costs(np.full(len(goals), start), goals)

    def way(self, start: int, goal: int) -> ArcWay:
        """Return the cheapest way between two nodes."""
        while True:
            cost, count = table_way(self._net.node_submap, *self.tables, *self._room, start, goal, self._way)
            if cost == SEARCHED:
                cost, count = way_between(self._net, self.tables, self._room, start, goal, self._way)
            if count <= len(self._way):
                return ArcWay(cost, self._way[:count].copy())
            self._way = np.empty(2 * count, np.int32)

    def ways(self, starts: Int32Array, goals: Int32Array) -> tuple[Int32Array, Int32Array]:
        """Write out many ways, one after the other into the same memory; return their costs [mm] and lengths [arcs]."""
        found: tuple[Int32Array, Int32Array] = ways_between(
            self._net, self.tables, self._room, starts, goals, self._way
        )
        return found

    def reprice(self, arcs: IntArray | Int32Array, costs: IntArray | Int32Array) -> Int32Array:
        """Give arcs (K,) new costs [mm], `CLOSED_MM` to close them, and make exact again what depends on them.

        Return how many sub-maps were made anew within and around (2,).

        Raises:
            ValueError: a cost is negative, or more than `DEAREST_MM` and not `CLOSED_MM`.
        """
        if ((costs < 0) | ((costs > DEAREST_MM) & (costs != CLOSED_MM))).any():
            raise ValueError(f"costs must lie in [0, {DEAREST_MM}] or be {CLOSED_MM}")
        self.graph.cost[arcs] = costs
        changed = np.zeros(len(self.graph.parent), np.bool_)
        changed[self.graph.node_submap[self.graph.tail[arcs]]] = True
        again: Int32Array = make(self._net, self.tables, changed, False)
        return again

    @property
    def nbytes(self) -> int:
        """Size of all tables [bytes], lists of the tree included, the graph's own arrays not."""
        return sum(array.nbytes for array in self.tables)


def made(graph: GraphArrays, progress: Callable[[float], None] = lambda share: None) -> Tables:
    """Return the tables of a graph; `progress` is called with the share (0 to 1) of the sub-maps that is done."""
    tables, net = laid_out(graph), net_of(graph)
    maps = len(graph.parent)
    within, around, climbing = (np.ones(maps, np.bool_) for _ in range(3))
    parts = list(pairwise(np.linspace(0, maps, min(maps, _PARTS) + 1).round().astype(int).tolist()))
    for done, (begin, end) in enumerate(reversed(parts), start=1):
        make_within(net, tables, within, around, climbing, begin, end)
        progress(0.5 * done / len(parts))
    for done, (begin, end) in enumerate(parts, start=1):
        make_around(tables, around, climbing, begin, end)
        progress(0.5 + 0.5 * done / len(parts))
    return tables
