"""Exact border tables of a building: costs and ways between any two nodes, repaired when arcs close or are re-priced.

The tables hold the costs between the borders of the sub-maps at every level of the tree, within each and around it, so
that ways which leave a sub-map and return are exact, too. They are what became of the pre-calculated trajectories of
"TetraNauta" (section 2, groups 1 to 5): entries go from one crossing arc to another instead of from node to node, so
that no turn at a joint is lost, and lifts are arcs like others.
"""

from __future__ import annotations

import numpy as np

from waychair.maps.building.costs import CLOSED_MM, DEAREST_MM
from waychair.maps.building.graph_arrays import GraphArrays, Int32Array
from waychair.planning.building.border_costs import costs_between, room
from waychair.planning.building.border_kernels import Borders, Climbs, Labels, Steps, Tables, build, repair
from waychair.planning.building.border_ways import unpacking, way_between, ways_between
from waychair.planning.building.graph_search import Way
from waychair.planning.building.overlay import COLUMNS, EXITS_AT, ROWS, STATES, Int64Array, Layout, layout
from waychair.types import IntArray

_MOST_UINT16 = 65_534
"""Largest number of states of an overlay for which the ways are kept in 16 bits each."""


class BorderTables:
    """The exact tables of a graph. `graph.cost` belongs to them from now on: change it by `reprice` only."""

    def __init__(self, graph: GraphArrays, tables: Tables | None = None) -> None:
        self.graph = graph
        self.tables = made(graph) if tables is None else tables
        self._out, self._into = room(self.tables.layout)
        self._unpacking = unpacking(self.tables)
        self._way = np.empty(1024, np.int32)

    def cost(self, start: int, goal: int) -> int:
        """Return the cost between two nodes [mm], `CLOSED_MM` if there is no way."""
        return int(self.costs(np.array([start]), np.array([goal]))[0])

    def costs(self, starts: IntArray | Int32Array, goals: IntArray | Int32Array) -> Int32Array:
        """Return the costs of many ways (Q,) [mm]."""
        return costs_between(self.graph, self.tables, starts.astype(np.int32), goals.astype(np.int32))

    def costs_from(self, start: int, goals: IntArray | Int32Array) -> Int32Array:
        """Return the costs from a node to many goals (Q,) [mm], for menus."""
        return self.costs(np.full(len(goals), start), goals)

    def way(self, start: int, goal: int) -> Way:
        """Return the cheapest way between two nodes."""
        while True:
            cost, count = way_between(
                self.graph, self.tables, self._unpacking, start, goal, self._out, self._into, self._way
            )
            if count <= len(self._way):
                return Way(int(cost), self._way[:count].copy())
            self._way = np.empty(2 * count, np.int32)

    def ways(self, starts: Int32Array, goals: Int32Array) -> tuple[Int32Array, Int32Array]:
        """Write out many ways, one after the other into the same memory; return their costs [mm] and lengths [arcs]."""
        return ways_between(self.graph, self.tables, starts, goals, self._way)

    def reprice(self, arcs: IntArray | Int32Array, costs: IntArray | Int32Array) -> Int32Array:
        """Give arcs (K,) new costs [mm], `CLOSED_MM` to close them, and make exact again what depends on them.

        Return how many sub-maps were made anew within and around (2,).

        Raises:
            ValueError: a cost is negative, or more than `DEAREST_MM` and not `CLOSED_MM`.
        """
        if ((costs < 0) | ((costs > DEAREST_MM) & (costs != CLOSED_MM))).any():
            raise ValueError(f"costs must lie in [0, {DEAREST_MM}] or be {CLOSED_MM}")
        self.graph.cost[arcs] = costs
        return repair(self.graph, self.tables, arcs.astype(np.int32))

    @property
    def nbytes(self) -> int:
        """Size of all tables [bytes], lists of the tree included, the graph's own arrays not."""
        return sum(array.nbytes for part in self.tables for array in part)


def made(graph: GraphArrays) -> Tables:
    """Return the tables of a graph."""
    tables = _empty(graph, layout(graph))
    build(graph, tables)
    return tables


def _empty(graph: GraphArrays, lay: Layout) -> Tables:
    """Return tables of the right sizes, not filled."""
    rows, columns, states, exits_at = (lay.sizes[:, at].astype(np.int64) for at in (ROWS, COLUMNS, STATES, EXITS_AT))
    exits, entries, nodes = np.diff(lay.exit_first), np.diff(lay.entry_first), np.diff(lay.node_first).astype(np.int64)
    kept = states[(rows > 0) | (exits > 0)]
    kind = np.uint16 if kept.max(initial=0) <= _MOST_UINT16 else np.int32

    def firsts(sizes: Int64Array) -> Int64Array:
        return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)

    first, around_first = firsts(rows * columns), firsts((rows - entries) * (exits_at - rows))
    borders = Borders(first, np.empty(first[-1], np.int32), around_first, np.empty(around_first[-1], np.int32))
    before, after = firsts(rows * states), firsts(exits * states)
    at = firsts(states)
    ways = np.empty(before[-1], kind), after, np.empty(after[-1], kind)
    steps = Steps(before, *ways, at, np.empty(at[-1], np.int32))
    out, into = firsts(nodes * exits), firsts(nodes * entries)
    labels = Labels(
        out,
        np.empty(out[-1], np.int32),
        np.empty(out[-1], kind),
        into,
        np.empty(into[-1], np.int32),
        np.empty(into[-1], kind),
    )
    up, down = _climb_firsts(lay, exits), _climb_firsts(lay, entries)
    climbs = Climbs(up[0], np.empty(up[1], np.int32), down[0], np.empty(down[1], np.int32))
    return Tables(lay, borders, steps, labels, climbs)


def _climb_firsts(lay: Layout, borders: Int64Array) -> tuple[Int64Array, int]:
    """Return where the climbs of each sub-map to its ancestors begin (M, D), and the size of all."""
    sizes = np.zeros(lay.ancestor.shape, np.int64)
    for d in range(1, lay.ancestor.shape[1]):
        deep = lay.depth >= d + 2
        sizes[deep, d] = borders[deep] * borders[lay.ancestor[deep, d]]
    ends = np.cumsum(sizes).reshape(sizes.shape)
    return ends - sizes, int(ends[-1, -1]) if ends.size else 0
