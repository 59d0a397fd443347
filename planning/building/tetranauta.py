"""The preset `tetranauta`: the five groups of pre-calculated trajectories as printed in "TetraNauta", sections 2 and 3.

Trajectories lead from bridge node to bridge node within one sub-map: (1) between its horizontal bridges, (2) from them to
those of the parent, (3) and (4) the same to vertical bridges, (5) between brothers. The ends are node to node, so that a turn
where two of them meet is not counted in the choice, and the parts in the first and last sub-map are estimated by air
line, as the paper says; both make its ways a little longer than the shortest. The skeleton is then completed by A* in
these two sub-maps. A lift's rides, for which the paper has no group, are trajectories of the root.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from waychair.maps.building.costs import CLOSED_MM
from waychair.maps.building.graph_arrays import GraphArrays, Int32Array
from waychair.planning.building.graph_search import ArcWay, GraphSearch, in_driving_order, with_arc, with_arcs
from waychair.planning.building.overlay import (
    ANCESTOR,
    ARCS,
    CHILDREN,
    CHILDREN_END,
    COLUMNS,
    DEPTH,
    ENTRIES,
    ENTRIES_IN,
    EXITS,
    EXITS_AT,
    EXITS_IN,
    LEVEL,
    OWNERS,
    PARENT,
    ROWS,
    STATES,
    WITHIN,
    Int64Array,
    Net,
    Tables,
    followers,
    is_child_entry,
    laid_out,
    meeting_depth,
    most_followers,
    net_of,
    overlay,
    state_of_arc,
    turn,
    wide,
)
from waychair.planning.building.packed_heap import SHIFT, pop, push
from waychair.types import FloatArray

_MASK = (1 << SHIFT) - 1


BRIDGE, END, COST, BEFORE, OWN_AT = range(5)
"""Columns of `Trajectories.book`."""


class Trajectories(NamedTuple):
    """The trajectories of M sub-maps.

    `book` (M + 1, 5) int64 says where each sub-map's part begins: `BRIDGE` of `bridge`, the nodes with arcs into or out of
    it; `END` of `end`, the ends of its trajectories, its own bridges, then those of each child; `COST` of `cost`
    [mm] and `last`, the last state, both (ends, ends); `BEFORE` of `before`, the state before in its overlay (ends, states).
    `OWN_AT` is the place of its bridges among its parent's ends. `xy` and `tail` are the graph's. Group 1 is in `WITHIN` of
    the tables as well, in the form of a border table.
    """

    book: Int64Array
    bridge: Int32Array
    end: Int32Array
    cost: Int32Array
    last: Int32Array
    before: Int32Array
    xy: FloatArray
    tail: Int32Array


class Tetranauta:
    """Finds ways by the paper's trajectories; with `brothers=False` without group 5, as in its first experiment.

    Where every way leaves a sub-map and returns, no trajectory helps; A* then searches the whole graph.
    """

    def __init__(self, graph: GraphArrays, brothers: bool = True) -> None:
        self.graph = graph
        self.tables = laid_out(graph, only_within=True)
        self.trajectories = _prepared(graph, self.tables)
        self._brothers = brothers
        self._search = GraphSearch(graph)
        self._net = net_of(graph)
        for m in range(len(graph.parent) - 1, -1, -1):
            _solve(self._net, self.tables, self.trajectories, m)

    def way(self, start: int, goal: int) -> ArcWay:
        """Return the way between two nodes, not always the cheapest; its cost [mm] is that of its arcs."""
        cost, arcs = _priced_way(start, goal, self._brothers, *self._net, *self.tables, *self.trajectories)
        if start != goal and not len(arcs):
            return self._search.way(start, goal, guided=True)
        return ArcWay(cost, arcs)

    @property
    def nbytes(self) -> int:
        """Size of the trajectories [bytes]."""
        return sum(array.nbytes for array in (*self.tables, *self.trajectories[:-2]))


def _prepared(graph: GraphArrays, tables: Tables) -> Trajectories:
    """Return trajectories of the right sizes, not filled; the tables within get no entries yet."""
    maps, numbers = len(graph.parent), tables.numbers
    bridge = _bridges(net_of(graph), tables, graph.tail)
    book = np.zeros((maps + 1, 5), np.int64)
    book[:, BRIDGE] = np.searchsorted(graph.node_submap[bridge], np.arange(maps + 1))
    counts = np.diff(book[:, BRIDGE])
    ends = counts.copy()
    lists: list[Int32Array] = []
    for m in range(maps):
        parts = [bridge[book[m, BRIDGE] : book[m + 1, BRIDGE]]]
        for c in numbers[tables.book[m, CHILDREN] : tables.book[m, CHILDREN_END]].tolist():
            book[c, OWN_AT] = ends[m]
            ends[m] += counts[c]
            parts.append(bridge[book[c, BRIDGE] : book[c + 1, BRIDGE]])
        lists.append(np.concatenate(parts))
    states = tables.book[:, STATES]
    for column, sizes in ((END, ends), (COST, ends**2), (BEFORE, ends * states)):
        book[1:, column] = np.cumsum(sizes)
    end, count, states_before = np.concatenate(lists).astype(np.int32), int(book[-1, COST]), int(book[-1, BEFORE])
    cost, last = np.full(count, CLOSED_MM, np.int32), np.full(count, -1, np.int32)
    before = np.full(states_before, -1, np.int32)
    return Trajectories(book, bridge, end, cost, last, before, graph.xy, graph.tail)


@njit(cache=True)
def _bridges(net: Net, tables: Tables, tail: Int32Array) -> Int32Array:
    """Return the nodes with an arc out of their sub-map or into it that does not belong to a child, ascending."""
    book, is_bridge = tables.book, np.zeros(len(net.node_submap), np.bool_)
    for arc in range(len(tail)):
        for node, other in ((tail[arc], net.head[arc]), (net.head[arc], tail[arc])):
            m, to = net.node_submap[node], net.node_submap[other]
            if book[to, ANCESTOR + LEVEL * book[m, DEPTH]] != m:
                is_bridge[node] = True
    return np.flatnonzero(is_bridge).astype(np.int32)


@njit(cache=True)
def _ancestor(tables: Tables, m: int, d: int) -> int:
    return int(tables.book[m, ANCESTOR + LEVEL * d])


@njit(cache=True)
def _exit(tables: Tables, m: int, x: int) -> int:
    return wide(tables.numbers[tables.book[m, ARCS] + tables.book[m, EXITS_AT] + x])


@njit(cache=True)
def _entry(tables: Tables, m: int, e: int) -> int:
    return wide(tables.numbers[tables.book[m, ARCS] + e])


@njit(cache=True)
def _solve(net: Net, tables: Tables, tra: Trajectories, m: int) -> None:
    """Find all trajectories of one sub-map, each end in turn, and put group 1 into the form of a border table."""
    columns, exits, begin = tables.book[m, COLUMNS], tables.book[m, EXITS], tables.book[m, WITHIN]
    within = tables.numbers[begin : begin + tables.book[m, ROWS] * columns]
    within[:] = CLOSED_MM
    first, to, weight = overlay(net, tables, m)
    states, low, high = tables.book[m, STATES], tra.book[m, END], tra.book[m + 1, END]
    ends, own = high - low, tra.book[m + 1, BRIDGE] - tra.book[m, BRIDGE]
    heap, cost = np.empty(states + len(to) + 64, np.int64), np.empty(states, np.int32)
    node_of = np.empty(states, np.int32)
    for s in range(states):
        node_of[s] = net.head[tables.numbers[tables.book[m, ARCS] + s]]
    for i in range(ends):
        node, at = tra.end[low + i], tra.book[m, BEFORE] + i * states
        cost[:] = CLOSED_MM
        size = wide(0)
        c = wide(-1) if i < own else _ancestor(tables, wide(net.node_submap[node]), tables.book[m, DEPTH] + 1)
        for b in range(net.first[node], net.first[node + 1]):
            if net.cost[b] >= CLOSED_MM:
                continue
            s = -1
            if c < 0:
                s = state_of_arc(net, tables, m, wide(b))
            else:
                for x in range(tables.book[c, EXITS]):
                    if _exit(tables, c, x) == b:
                        s = tables.book[c, EXITS_IN] + x
            if s >= 0:
                cost[s] = net.cost[b]
                size = push(heap, size, (wide(cost[s]) << SHIFT) | s)
        while size > 0:
            item = heap[0]
            size = pop(heap, size)
            here, s = item >> SHIFT, item & _MASK
            if here > cost[s]:
                continue
            for k in range(first[s], first[s + 1]):
                b = to[k]
                if here + weight[k] < cost[b]:
                    cost[b], tra.before[at + b] = here + weight[k], s
                    size = push(heap, size, (wide(cost[b]) << SHIFT) | b)
        row = tra.book[m, COST] + i * ends
        for j in range(ends):
            if i == j:
                tra.cost[row + j] = 0
                continue
            for s in range(states):
                if node_of[s] == tra.end[low + j] and cost[s] < tra.cost[row + j]:
                    tra.cost[row + j], tra.last[row + j] = cost[s], s
    for e in range(tables.book[m, ENTRIES]):
        i = _end_of(tra, m, net.head[_entry(tables, m, e)], own)
        for x in range(exits):
            arc = _exit(tables, m, x)
            j = _end_of(tra, m, tra.tail[arc], own)
            if i >= 0 and j >= 0 and net.cost[arc] < CLOSED_MM:
                part = tra.cost[tra.book[m, COST] + i * ends + j]
                if part < CLOSED_MM:
                    within[e * columns + columns - exits + x] = part + net.cost[arc]


@njit(cache=True)
def _end_of(tra: Trajectories, m: int, node: int, count: int) -> int:
    for i in range(count):
        if tra.end[tra.book[m, END] + i] == node:
            return i
    return -1


@njit(cache=True)
def _line(tra: Trajectories, one: int, other: int) -> int:
    dx, dy = tra.xy[one, 0] - tra.xy[other, 0], tra.xy[one, 1] - tra.xy[other, 1]
    return int(1000.0 * math.sqrt(dx * dx + dy * dy))


@njit(cache=True)
def _climbed(
    net: Net, tables: Tables, tra: Trajectories, node: int, d: int, outwards: int
) -> tuple[Int32Array, Int32Array]:
    """Return the costs to the bridges of the ancestor below depth d, and the bridge chosen at each level, (levels, all).

    Bridges count within their sub-map; the first level is estimated by air line.
    """
    m = wide(net.node_submap[node])
    count = tra.book[m + 1, BRIDGE] - tra.book[m, BRIDGE]
    most = count
    for k in range(d + 1, tables.book[m, DEPTH] + 1):
        a = _ancestor(tables, m, k)
        most = max(most, tra.book[a + 1, BRIDGE] - tra.book[a, BRIDGE])
    chosen = np.full((tables.book[m, DEPTH] - d, most), -1, np.int32)
    costs = np.empty(count, np.int32)
    for i in range(count):
        costs[i] = _line(tra, node, wide(tra.bridge[tra.book[m, BRIDGE] + i]))
    for level in range(1, tables.book[m, DEPTH] - d):
        p = tables.book[m, PARENT]
        ends, own = tra.book[p + 1, END] - tra.book[p, END], tra.book[p + 1, BRIDGE] - tra.book[p, BRIDGE]
        above = np.full(own, CLOSED_MM, np.int32)
        for j in range(own):
            for i in range(count):
                one, other = (tra.book[m, OWN_AT] + i, j) if outwards > 0 else (j, tra.book[m, OWN_AT] + i)
                part = tra.cost[tra.book[p, COST] + one * ends + other]
                if part < CLOSED_MM and costs[i] + part < above[j]:
                    above[j], chosen[level, j] = costs[i] + part, i
        costs, count, m = above, own, p
    return costs, chosen


@njit(cache=True)
def _priced_way(start: int, goal: int, brothers: bool, *arrays: Any) -> tuple[int, Int32Array]:
    """Return a way and its cost; Python hands on single arrays faster than tuples of them."""
    net, tables, tra = Net(*arrays[:6]), Tables(*arrays[6:9]), Trajectories(*arrays[9:])
    way, cost = _way(net, tables, tra, start, goal, brothers), 0
    for k in range(len(way)):
        cost += net.cost[way[k]]
        if k > 0:
            cost += turn(net.heading, net.turns, way[k - 1], way[k])
    return cost, way


@njit(cache=True)
def _way(net: Net, tables: Tables, tra: Trajectories, start: int, goal: int, brothers: bool) -> Int32Array:
    """Return the arcs of a way, none if there is none."""
    none = np.empty(0, np.int32)
    if start == goal:
        return none
    one, other = wide(net.node_submap[start]), wide(net.node_submap[goal])
    d = meeting_depth(tables.book, one, other)
    if tables.book[one, DEPTH] == d or tables.book[other, DEPTH] == d:
        return _inside(net, tables, tra, _ancestor(tables, one, d), start, goal)
    top, left, right = _ancestor(tables, one, d), _ancestor(tables, one, d + 1), _ancestor(tables, other, d + 1)
    out, chosen_out = _climbed(net, tables, tra, start, d, wide(1))
    into, chosen_in = _climbed(net, tables, tra, goal, d, wide(0))
    ends = tra.book[top + 1, END] - tra.book[top, END]
    least, u, v = CLOSED_MM, -1, -1
    if not brothers:
        u, v, middle = _linked(net, tables, tra, top, left, right, goal, out, into)
    else:
        for i in range(len(out)):
            for j in range(len(into)):
                part = tra.cost[tra.book[top, COST] + (tra.book[left, OWN_AT] + i) * ends + tra.book[right, OWN_AT] + j]
                if part < CLOSED_MM and np.int64(out[i]) + part + into[j] < least:
                    least, u, v = out[i] + part + into[j], i, j
        middle = none
    if u < 0:
        return none
    way, count = np.empty(512, np.int32), wide(0)
    skeleton = np.empty(tables.book[one, DEPTH] - d, np.int32)
    q = u
    for level in range(tables.book[one, DEPTH] - d - 1, -1, -1):
        skeleton[level] = q
        q = chosen_out[level, q]
    first = wide(tra.bridge[tra.book[one, BRIDGE] + skeleton[0]])
    way, count = with_arcs(way, count, _inside(net, tables, tra, one, start, first))
    m = one
    for level in range(1, len(skeleton)):
        p = tables.book[m, PARENT]
        part = _unpacked(net, tables, tra, p, tra.book[m, OWN_AT] + skeleton[level - 1], wide(skeleton[level]))
        way, count = with_arcs(way, count, part)
        m = p
    if brothers:
        middle = _unpacked(net, tables, tra, top, tra.book[left, OWN_AT] + u, tra.book[right, OWN_AT] + v)
    way, count = with_arcs(way, count, middle)
    q, m = v, right
    for level in range(tables.book[other, DEPTH] - d - 1, 0, -1):
        below = _ancestor(tables, other, tables.book[other, DEPTH] - level + 1)
        z = chosen_in[level, q]
        way, count = with_arcs(way, count, _unpacked(net, tables, tra, m, q, tra.book[below, OWN_AT] + z))
        q, m = z, below
    last = wide(tra.bridge[tra.book[other, BRIDGE] + q])
    way, count = with_arcs(way, count, _inside(net, tables, tra, other, last, goal))
    return way[:count]


@njit(cache=True)
def _inside(net: Net, tables: Tables, tra: Trajectories, m: int, start: int, goal: int) -> Int32Array:
    """Return the arcs from node to node by A* within `m`; children are jumped over, or entered at the ends only."""
    if start == goal:
        return np.empty(0, np.int32)
    states = tables.book[m, STATES]
    cost = np.full(states, CLOSED_MM, np.int32)
    if net.node_submap[start] != m or net.node_submap[goal] != m:
        return np.empty(0, np.int32)
    for b in range(net.first[start], net.first[start + 1]):
        if net.cost[b] < CLOSED_MM:
            cost[state_of_arc(net, tables, m, wide(b))] = net.cost[b]
    last, before = _guided(net, tables, tra, m, cost, goal, np.zeros(0, np.int32))
    return _arcs_back(net, tables, tra, m, before, last)


@njit(cache=True)
def _linked(
    net: Net,
    tables: Tables,
    tra: Trajectories,
    top: int,
    left: int,
    right: int,
    goal: int,
    out: Int32Array,
    into: Int32Array,
) -> tuple[int, int, Int32Array]:
    """Return the bridges of two brothers and the arcs between, by a search of their parent without group 5."""
    states = tables.book[top, STATES]
    cost, ending = np.full(states, CLOSED_MM, np.int32), np.full(states, CLOSED_MM, np.int32)
    for x in range(tables.book[left, EXITS]):
        arc = _exit(tables, left, x)
        i = _end_of(tra, left, tra.tail[arc], len(out))
        if i >= 0 and net.cost[arc] < CLOSED_MM and out[i] < CLOSED_MM:
            cost[tables.book[left, EXITS_IN] + x] = out[i] + net.cost[arc]
    for e in range(tables.book[right, ENTRIES]):
        j = _end_of(tra, right, net.head[_entry(tables, right, e)], len(into))
        if j >= 0:
            ending[tables.book[right, ENTRIES_IN] + e] = into[j]
    last, before = _guided(net, tables, tra, top, cost, goal, ending)
    if last < 0:
        return -1, -1, np.empty(0, np.int32)
    arcs = _arcs_back(net, tables, tra, top, before, last)
    return _end_of(tra, left, tra.tail[arcs[0]], len(out)), _end_of(tra, right, net.head[arcs[-1]], len(into)), arcs


@njit(cache=True)
def _guided(
    net: Net, tables: Tables, tra: Trajectories, m: int, cost: Int32Array, goal: int, ending: Int32Array
) -> tuple[int, Int32Array]:
    """Search the overlay of `m` by A* from the states with a cost to a node, or towards it to states with an ending cost."""
    states, size, arcs = len(cost), wide(0), tables.book[m, ARCS]
    heap, before = np.empty(states + 64, np.int64), np.full(states, -1, np.int32)
    to, weight = np.empty(16, np.int32), np.empty(16, np.int32)
    for s in range(states):
        if cost[s] < CLOSED_MM:
            h = _line(tra, wide(net.head[tables.numbers[arcs + s]]), goal)
            size = push(heap, size, (wide(cost[s] + h) << SHIFT) | s)
    least, last = CLOSED_MM, -1
    while size > 0:
        item = heap[0]
        size = pop(heap, size)
        s = item & _MASK
        node = wide(net.head[tables.numbers[arcs + s]])
        h = _line(tra, node, goal)
        if (item >> SHIFT) >= least:
            break
        if (item >> SHIFT) > cost[s] + h:
            continue
        if len(ending) == 0 and node == goal:
            least, last = cost[s], s
        elif len(ending) > 0 and ending[s] < CLOSED_MM and cost[s] + ending[s] < least:
            least, last = cost[s] + ending[s], s
        most = most_followers(net, tables, m, s)
        if most > len(to):
            to, weight = np.empty(most, np.int32), np.empty(most, np.int32)
        if size + most > len(heap):
            longer = np.empty(2 * len(heap) + most, np.int64)
            for k in range(size):
                longer[k] = heap[k]
            heap = longer
        for k in range(followers(net, tables, m, s, to, weight, wide(0))):
            b = to[k]
            if cost[s] + weight[k] < cost[b]:
                cost[b], before[b] = cost[s] + weight[k], s
                h = _line(tra, wide(net.head[tables.numbers[arcs + b]]), goal)
                size = push(heap, size, (wide(cost[b] + h) << SHIFT) | b)
    return last, before


@njit(cache=True)
def _unpacked(net: Net, tables: Tables, tra: Trajectories, m: int, one: int, other: int) -> Int32Array:
    """Return the arcs of a trajectory between two ends of `m`, in the order of driving."""
    way, count = _trajectory_back(net, tables, tra, m, one, other, np.empty(256, np.int32), wide(0))
    return in_driving_order(way, count)


@njit(cache=True)
def _child_jumped(tables: Tables, m: int, state: int, before: int) -> int:
    """Return the child that is jumped over on the way to a state, -1 for none."""
    entries = tables.book[m, ENTRIES]
    if not is_child_entry(tables.book, m, before) or not entries <= state < tables.book[m, ROWS]:
        return -1
    return wide(tables.numbers[tables.book[m, OWNERS] + state - entries])


@njit(cache=True)
def _bridges_of_jump(
    net: Net, tables: Tables, tra: Trajectories, m: int, c: int, state: int, before: int
) -> tuple[int, int]:
    own = int(tra.book[c + 1, BRIDGE] - tra.book[c, BRIDGE])
    one = _end_of(tra, c, net.head[tables.numbers[tables.book[m, ARCS] + before]], own)
    return one, _end_of(tra, c, tra.tail[tables.numbers[tables.book[m, ARCS] + state]], own)


@njit(cache=True)
def _trajectory_back(
    net: Net, tables: Tables, tra: Trajectories, m: int, one: int, other: int, way: Int32Array, count: int
) -> tuple[Int32Array, int]:
    """Append the arcs of a trajectory from its last one back; children that are jumped over are unpacked."""
    maps, befores, lasts, depth = np.empty(64, np.int64), np.empty(64, np.int64), np.empty(64, np.int64), 0
    at, s = _trajectory(tables, tra, m, one, other)
    while True:
        if s < 0:
            if depth == 0:
                return way, count
            depth -= 1
            m, at, s = maps[depth], befores[depth], lasts[depth]
            continue
        way, count = with_arc(way, count, tables.numbers[tables.book[m, ARCS] + s])
        b = int(tra.before[at + s])
        c = _child_jumped(tables, m, s, b)
        if c < 0:
            s = b
            continue
        i, j = _bridges_of_jump(net, tables, tra, m, c, s, b)
        maps[depth], befores[depth], lasts[depth] = m, at, b
        depth += 1
        m = c
        at, s = _trajectory(tables, tra, m, i, j)


@njit(cache=True)
def _trajectory(tables: Tables, tra: Trajectories, m: int, one: int, other: int) -> tuple[int, int]:
    """Return where the states before each begin on the trajectories from an end, and the last state of one of them."""
    ends = tra.book[m + 1, END] - tra.book[m, END]
    last = -1 if one == other else tra.last[tra.book[m, COST] + one * ends + other]
    return int(tra.book[m, BEFORE] + one * tables.book[m, STATES]), int(last)


@njit(cache=True)
def _arcs_back(net: Net, tables: Tables, tra: Trajectories, m: int, before: Int32Array, last: int) -> Int32Array:
    """Return the arcs up to a state of a search of `m`, in the order of driving; children are unpacked."""
    way, count, s = np.empty(256, np.int32), wide(0), last
    while s >= 0:
        way, count = with_arc(way, count, tables.numbers[tables.book[m, ARCS] + s])
        b = int(before[s])
        c = _child_jumped(tables, m, s, b)
        if c >= 0:
            i, j = _bridges_of_jump(net, tables, tra, m, c, s, b)
            way, count = _trajectory_back(net, tables, tra, c, i, j, way, count)
        s = b
    return in_driving_order(way, count)
