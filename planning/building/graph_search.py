"""Searches of a building's whole graph: Dijkstra, A*, and brute force. The tables are compared with them.

All work on arc states, as the tables do: a state is a directed arc just after driving it, so that turns are counted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.maps.building.costs import CLOSED_MM
from waychair.maps.building.graph_arrays import NO_HEADING, GraphArrays, Int32Array
from waychair.planning.building.overlay import Int64Array, turn
from waychair.planning.building.packed_heap import SHIFT, pop, push
from waychair.types import BoolArray

_MASK = (1 << SHIFT) - 1
_VERTICAL_M = 0.01
"""Lift cabins whose stops are farther apart than this [m] seen from above give no bound across storeys."""


@dataclass(frozen=True, slots=True)
class ArcWay:
    """A way: its cost [mm], `CLOSED_MM` if there is none, and its arcs (K,) int32 in the order of driving."""

    cost: int
    arcs: Int32Array


class SearchMemory(NamedTuple):
    """Memory of a search over A arcs: costs and states before (A,), the number of the search that wrote them (A,), that
    number (1,), and a heap."""

    cost: Int32Array
    before: Int32Array
    written: Int32Array
    search: Int32Array
    heap: Int64Array


class Bound(NamedTuple):
    """The lower bound of A*: cost a metre of air line, a storey, into and out of a lift [mm], and cabin nodes (N,)."""

    per_metre: float
    per_storey: int
    boarding: int
    alighting: int
    is_cabin: BoolArray


def search_room(graph: GraphArrays, heap: int = 2) -> SearchMemory:
    """Return memory for searches of a graph, with a queue of `heap` entries an arc."""
    arcs = len(graph.tail)
    return SearchMemory(
        np.empty(arcs, np.int32),
        np.empty(arcs, np.int32),
        np.zeros(arcs, np.int32),
        np.zeros(1, np.int32),
        np.empty(arcs * heap + 64, np.int64),
    )


def lower_bound(graph: GraphArrays) -> Bound:
    """Return the strongest bound that no arc of the graph undercuts, closed arcs included at their open cost or more."""
    is_cabin = np.zeros(len(graph.xy), np.bool_)
    lifts = graph.heading == NO_HEADING
    is_cabin[graph.tail[lifts]] = True
    is_cabin[graph.tail[~lifts]] = False
    length = np.hypot(*(graph.xy[graph.head] - graph.xy[graph.tail]).T)
    far = length > 1e-6
    rise = np.abs(graph.level[graph.head] - graph.level[graph.tail])
    shafts = rise > 0
    per_metre = float((graph.cost[far] / length[far]).min(initial=1000.0))
    if (length[shafts] > _VERTICAL_M).any() or (shafts & ~lifts).any():
        return Bound(per_metre, 0, 0, 0, is_cabin)
    flat = ~shafts & far
    per_metre = float((graph.cost[flat] / length[flat]).min(initial=1000.0))
    per_storey = int((graph.cost[shafts] // rise[shafts]).min(initial=CLOSED_MM)) if shafts.any() else 0
    boarding = lifts & ~shafts & is_cabin[graph.head]
    alighting = lifts & ~shafts & is_cabin[graph.tail]
    least = [int(graph.cost[each].min()) if each.any() else 0 for each in (boarding, alighting)]
    return Bound(per_metre, per_storey, least[0], least[1], is_cabin)


@njit(cache=True)
def estimate(graph: GraphArrays, bound: Bound, node: int, goal: int) -> int:
    """Return a cost [mm] that no way from node to goal undercuts."""
    away = np.hypot(graph.xy[goal, 0] - graph.xy[node, 0], graph.xy[goal, 1] - graph.xy[node, 1])
    least = int(bound.per_metre * away)
    storeys = abs(graph.level[goal] - graph.level[node])
    if storeys > 0:
        least += storeys * bound.per_storey + bound.alighting
        if not bound.is_cabin[node]:
            least += bound.boarding
    return least


@njit(cache=True)
def search(
    graph: GraphArrays, bound: Bound, room: SearchMemory, start: int, goal: int, guided: bool, shut: BoolArray
) -> tuple[int, int, int]:
    """Return the cost from node to node, the last arc, and the states taken from the queue; A* if guided, else Dijkstra.

    `shut` (M,) are the sub-maps that are not entered, (0,) for none. The cost is -1 if the queue has no room.
    """
    if start == goal:
        return 0, -1, 0
    room.search[0] += 1
    now, size, pops = room.search[0], 0, 0
    least, last = CLOSED_MM, -1
    for b in range(graph.first[start], graph.first[start + 1]):
        if graph.cost[b] < CLOSED_MM:
            room.cost[b], room.before[b], room.written[b] = graph.cost[b], -1, now
            h = estimate(graph, bound, graph.head[b], goal) if guided else 0
            size = push(room.heap, size, int((np.int64(graph.cost[b] + h) << SHIFT) | b))
    while size > 0:
        item = room.heap[0]
        size = pop(room.heap, size)
        a = item & _MASK
        if (item >> SHIFT) >= least:
            break
        here, node = room.cost[a], graph.head[a]
        h = estimate(graph, bound, node, goal) if guided else 0
        if (item >> SHIFT) > here + h:
            continue
        pops += 1
        if node == goal:
            least, last = here, a
            continue
        if size + graph.first[node + 1] - graph.first[node] >= len(room.heap):
            return -1, -1, pops
        for b in range(graph.first[node], graph.first[node + 1]):
            if graph.cost[b] >= CLOSED_MM or (len(shut) and shut[graph.node_submap[graph.head[b]]]):
                continue
            new = here + turn(graph.heading, graph.turns, a, b) + graph.cost[b]
            if room.written[b] != now or new < room.cost[b]:
                room.cost[b], room.before[b], room.written[b] = new, a, now
                h = estimate(graph, bound, graph.head[b], goal) if guided else 0
                size = push(room.heap, size, int((np.int64(new + h) << SHIFT) | b))
    return least, last, pops


@njit(cache=True)
def costs_to_all(graph: GraphArrays, room: SearchMemory, start: int) -> Int32Array:
    """Return the costs from a node to all nodes (N,) [mm] by Dijkstra, `CLOSED_MM` where there is no way.

    They are empty if the queue has no room.
    """
    found = np.full(len(graph.xy), CLOSED_MM, np.int32)
    found[start] = 0
    room.search[0] += 1
    now, size = room.search[0], 0
    for b in range(graph.first[start], graph.first[start + 1]):
        if graph.cost[b] < CLOSED_MM:
            room.cost[b], room.written[b] = graph.cost[b], now
            size = push(room.heap, size, int((np.int64(graph.cost[b]) << SHIFT) | b))
    while size > 0:
        item = room.heap[0]
        size = pop(room.heap, size)
        a, here = item & _MASK, item >> SHIFT
        if here > room.cost[a]:
            continue
        node = graph.head[a]
        found[node] = min(found[node], here)
        if size + graph.first[node + 1] - graph.first[node] >= len(room.heap):
            return found[:0]
        for b in range(graph.first[node], graph.first[node + 1]):
            if graph.cost[b] >= CLOSED_MM:
                continue
            new = here + turn(graph.heading, graph.turns, a, b) + graph.cost[b]
            if room.written[b] != now or new < room.cost[b]:
                room.cost[b], room.written[b] = new, now
                size = push(room.heap, size, int((np.int64(new) << SHIFT) | b))
    return found


@njit(cache=True)
def brute_force(graph: GraphArrays, start: int, goal: int) -> tuple[int, int, Int32Array]:
    """Return the cost from node to node, the last arc, and the arc before each (A,): all are relaxed until none changes."""
    cost, before = np.full(len(graph.tail), CLOSED_MM, np.int32), np.full(len(graph.tail), -1, np.int32)
    for b in range(graph.first[start], graph.first[start + 1]):
        cost[b] = graph.cost[b]
    busy = True
    while busy:
        busy = False
        for a in range(len(cost)):
            if cost[a] >= CLOSED_MM:
                continue
            node = graph.head[a]
            for b in range(graph.first[node], graph.first[node + 1]):
                new = cost[a] + turn(graph.heading, graph.turns, a, b) + graph.cost[b]
                if new < cost[b]:
                    cost[b], before[b], busy = new, a, True
    if start == goal:
        return 0, -1, before
    least, last = CLOSED_MM, -1
    for a in range(len(cost)):
        if graph.head[a] == goal and cost[a] < least:
            least, last = cost[a], a
    return least, last, before


@njit(cache=True)
def traced(before: Int32Array, last: int) -> Int32Array:
    """Return the arcs of the way that ends with `last`."""
    count, a = 0, last
    while a >= 0:
        count += 1
        a = before[a]
    way, a = np.empty(count, np.int32), last
    for k in range(count - 1, -1, -1):
        way[k] = a
        a = before[a]
    return way


@njit(cache=True)
def with_arc(way: Int32Array, count: int, arc: int) -> tuple[Int32Array, int]:
    """Append an arc to the first `count`, unless it is the last of them; return the way, longer if it was full, and count."""
    if count > 0 and way[count - 1] == arc:
        return way, count
    if count == len(way):
        longer = np.empty(2 * len(way), np.int32)
        for k in range(count):
            longer[k] = way[k]
        way = longer
    way[count] = arc
    return way, count + 1


@njit(cache=True)
def with_arcs(way: Int32Array, count: int, part: Int32Array) -> tuple[Int32Array, int]:
    """Append arcs as `with_arc` does."""
    for k in range(len(part)):
        way, count = with_arc(way, count, part[k])
    return way, count


@njit(cache=True)
def in_driving_order(way: Int32Array, count: int) -> Int32Array:
    """Return the first arcs of a way that was found from its end, in the order of driving."""
    turned = np.empty(count, np.int32)
    for k in range(count):
        turned[k] = way[count - 1 - k]
    return turned


@njit(cache=True)
def cost_of_way(graph: GraphArrays, way: Int32Array) -> int:
    """Return the cost of arcs driven one after the other [mm]; -1 if they do not join, `CLOSED_MM` if one is closed."""
    total = 0
    for k in range(len(way)):
        if graph.cost[way[k]] >= CLOSED_MM:
            return CLOSED_MM
        total += graph.cost[way[k]]
        if k > 0:
            if graph.head[way[k - 1]] != graph.tail[way[k]]:
                return -1
            total += turn(graph.heading, graph.turns, way[k - 1], way[k])
    return total


_NOTHING_SHUT = np.zeros(0, np.bool_)


class GraphSearch:
    """Dijkstra and A* on a graph, with the memory they need; the bound of A* is that of the costs given here or dearer."""

    def __init__(self, graph: GraphArrays) -> None:
        self.graph = graph
        self._bound = lower_bound(graph)
        self._room = search_room(graph)
        self._heap = 2
        self._is_leaf = np.ones(len(graph.parent), np.bool_)
        self._is_leaf[graph.parent[1:]] = False
        self.pops = 0
        """States taken from the queue by the last search."""

    def way(self, start: int, goal: int, guided: bool) -> ArcWay:
        """Return the cheapest way between two nodes, by A* if guided, else by Dijkstra."""
        cost, last = self._searched(start, goal, guided, _NOTHING_SHUT)
        return ArcWay(cost, traced(self._room.before, last))

    def cost(self, start: int, goal: int, guided: bool) -> int:
        """Return the cost between two nodes [mm], `CLOSED_MM` if there is no way."""
        return self._searched(start, goal, guided, _NOTHING_SHUT)[0]

    def way_past_rooms(self, start: int, goal: int) -> ArcWay:
        """Return the cheapest way by A* that enters no leaf of the tree but the first and the last: the paper's method
        without tables, where rooms are no short cut."""
        ends = self.graph.node_submap[[start, goal]]
        kept = self._is_leaf[ends]
        self._is_leaf[ends] = False
        cost, last = self._searched(start, goal, True, self._is_leaf)
        self._is_leaf[ends] = kept
        return ArcWay(cost, traced(self._room.before, last))

    def costs_to_all(self, start: int) -> Int32Array:
        """Return the costs from a node to all nodes (N,) [mm], `CLOSED_MM` where there is no way."""
        found = costs_to_all(self.graph, self._room, start)
        if not len(found):
            self._grow()
            return self.costs_to_all(start)
        return found

    def _searched(self, start: int, goal: int, guided: bool, shut: BoolArray) -> tuple[int, int]:
        """Return the cost and the last arc of the cheapest way."""
        cost, last, self.pops = search(self.graph, self._bound, self._room, start, goal, guided, shut)
        if cost < 0:
            self._grow()
            return self._searched(start, goal, guided, shut)
        return int(cost), int(last)

    def _grow(self) -> None:
        self._heap *= 2
        self._room = search_room(self.graph, self._heap)
