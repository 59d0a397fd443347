"""The preset `tetranauta`: the five groups of pre-calculated trajectories as printed in "TetraNauta", sections 2 and 3.

Trajectories lead from bridge node to bridge node within one sub-map: (1) between its horizontal bridges, (2) from them to
those of the parent, (3) and (4) the same to vertical bridges, (5) between brothers. The ends are node to node, so that a turn
where two of them meet is not counted in the choice, and the parts in the first and last sub-map are estimated by air
line, as the paper says; both make its ways a little longer than the shortest. The skeleton is then completed by A* in
these two sub-maps. A lift's rides, for which the paper has no group, are trajectories of the root.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.maps.building.costs import CLOSED_MM
from waychair.maps.building.graph_arrays import GraphArrays, Int32Array
from waychair.planning.building.graph_search import GraphSearch, Way, cost_of_way
from waychair.planning.building.overlay import (
    COLUMNS,
    ROWS,
    STATES,
    Int64Array,
    Layout,
    arc_of_state,
    child_of_state,
    layout,
    meeting_depth,
    overlay,
    state_of_arc,
)
from waychair.planning.building.packed_heap import SHIFT, pop, push

_MASK = (1 << SHIFT) - 1


class Trajectories(NamedTuple):
    """The trajectories of M sub-maps.

    `bridge_first` (M + 1,) into `bridge`: the nodes of a sub-map with arcs into or out of it. `end_first` (M + 1,) into
    `end`: the ends of its trajectories, its own bridges, then those of each child; `own_at` (M,) place of a child's bridges
    among its parent's ends. `cost[cost_first[m] + from * ends + to]` [mm], `last` its last state, and `before[before_first[m] + from * states +
    state]` the state before, in its overlay. `jump` holds group 1 in the form of border tables, from `jump_first` on.
    """

    bridge_first: Int64Array
    bridge: Int32Array
    end_first: Int64Array
    end: Int32Array
    own_at: Int32Array
    cost_first: Int64Array
    cost: Int32Array
    last: Int32Array
    before_first: Int64Array
    before: Int32Array
    jump_first: Int64Array
    jump: Int32Array


class Tetranauta:
    """Finds ways by the paper's trajectories; with `brothers=False` without group 5, as in its first experiment.

    Where every way leaves a sub-map and returns, no trajectory helps; A* then searches the whole graph.
    """

    def __init__(self, graph: GraphArrays, brothers: bool = True) -> None:
        self.graph = graph
        self.layout = layout(graph)
        self.trajectories = _prepared(graph, self.layout)
        self._brothers = brothers
        self._search = GraphSearch(graph)
        _solve_all(graph, self.layout, self.trajectories)

    def way(self, start: int, goal: int) -> Way:
        """Return the way between two nodes, not always the cheapest; its cost [mm] is that of its arcs."""
        arcs = _way(self.graph, self.layout, self.trajectories, start, goal, self._brothers)
        if start != goal and not len(arcs):
            return self._search.way(start, goal, guided=True)
        return Way(int(cost_of_way(self.graph, arcs)), arcs)

    @property
    def nbytes(self) -> int:
        """Size of the trajectories [bytes]."""
        return sum(array.nbytes for array in self.trajectories)


def _prepared(graph: GraphArrays, lay: Layout) -> Trajectories:
    """Return trajectories of the right sizes, not filled."""
    maps = len(graph.parent)
    outer = graph.node_submap[graph.tail] != graph.node_submap[graph.head]
    bridges = np.unique(np.concatenate([graph.tail[outer], graph.head[outer]]))
    is_bridge = [_leaves_its_submap(graph, lay, int(node)) for node in bridges]
    bridge = bridges[np.array(is_bridge, np.bool_)].astype(np.int32)
    bridge_first = np.searchsorted(graph.node_submap[bridge], np.arange(maps + 1)).astype(np.int64)
    counts = np.diff(bridge_first)
    ends, own_at = counts.copy(), np.zeros(maps, np.int32)
    lists: list[Int32Array] = []
    for m in range(maps):
        parts = [bridge[bridge_first[m] : bridge_first[m + 1]]]
        for c in lay.child[lay.child_first[m] : lay.child_first[m + 1]].tolist():
            own_at[c] = ends[m]
            ends[m] += counts[c]
            parts.append(bridge[bridge_first[c] : bridge_first[c + 1]])
        lists.append(np.concatenate(parts))
    states = lay.sizes[:, STATES].astype(np.int64)
    jumps = lay.sizes[:, ROWS].astype(np.int64) * lay.sizes[:, COLUMNS]
    end_first, cost_first, before_first, jump_first = (
        np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64) for sizes in (ends, ends**2, ends * states, jumps)
    )
    return Trajectories(
        bridge_first,
        bridge,
        end_first,
        np.concatenate(lists).astype(np.int32),
        own_at,
        cost_first,
        np.full(cost_first[-1], CLOSED_MM, np.int32),
        np.full(cost_first[-1], -1, np.int32),
        before_first,
        np.full(before_first[-1], -1, np.int32),
        jump_first,
        np.full(jump_first[-1], CLOSED_MM, np.int32),
    )


def _leaves_its_submap(graph: GraphArrays, lay: Layout, node: int) -> bool:
    """Return whether one of a node's arcs leads out of its sub-map, not into a child of it."""
    m = int(graph.node_submap[node])
    for b in range(graph.first[node], graph.first[node + 1]):
        to = int(graph.node_submap[graph.head[b]])
        if to != m and not (lay.depth[to] > lay.depth[m] and lay.ancestor[to, lay.depth[m]] == m):
            return True
    arriving = graph.reverse[graph.first[node] : graph.first[node + 1]]
    return bool((arriving < 0).any()) and m > 0


@njit(cache=True)
def _solve_all(graph: GraphArrays, lay: Layout, tra: Trajectories) -> None:
    for m in range(len(graph.parent) - 1, -1, -1):
        _solve(graph, lay, tra, m)


@njit(cache=True)
def _node_in_overlay(graph: GraphArrays, lay: Layout, m: int, node: int, of_end: int, own: int) -> int:
    """Return the child that an end of `m` belongs to, -1 for an own bridge."""
    if of_end < own:
        return -1
    return int(lay.ancestor[graph.node_submap[node], lay.depth[m] + 1])


@njit(cache=True)
def _solve(graph: GraphArrays, lay: Layout, tra: Trajectories, m: int) -> None:
    """Find all trajectories of one sub-map, each end in turn, and put group 1 into the form of a border table."""
    first, to, weight = overlay(graph, lay, tra.jump_first, tra.jump, m)
    states, low, high = lay.sizes[m, STATES], tra.end_first[m], tra.end_first[m + 1]
    ends, own = high - low, tra.bridge_first[m + 1] - tra.bridge_first[m]
    heap, cost = np.empty(states + len(to) + 64, np.int64), np.empty(states, np.int32)
    node_of = np.empty(states, np.int32)
    for s in range(states):
        node_of[s] = graph.head[arc_of_state(lay, m, s)]
    for i in range(ends):
        node, at = tra.end[low + i], tra.before_first[m] + i * states
        cost[:] = CLOSED_MM
        size = 0
        c = _node_in_overlay(graph, lay, m, node, i, own)
        for b in range(graph.first[node], graph.first[node + 1]):
            if graph.cost[b] >= CLOSED_MM:
                continue
            s = -1
            if c < 0:
                s = state_of_arc(graph, lay, m, b)
            else:
                for k in range(lay.exit_first[c], lay.exit_first[c + 1]):
                    if lay.exit[k] == b:
                        s = lay.exits_at[c] + k - lay.exit_first[c]
            if s >= 0:
                cost[s] = graph.cost[b]
                size = push(heap, size, int((np.int64(cost[s]) << SHIFT) | s))
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
                    size = push(heap, size, int((np.int64(cost[b]) << SHIFT) | b))
        row = tra.cost_first[m] + i * ends
        for j in range(ends):
            if i == j:
                tra.cost[row + j] = 0
                continue
            for s in range(states):
                if node_of[s] == tra.end[low + j] and cost[s] < tra.cost[row + j]:
                    tra.cost[row + j], tra.last[row + j] = cost[s], s
    columns, exits = lay.sizes[m, COLUMNS], lay.exit_first[m + 1] - lay.exit_first[m]
    for e in range(lay.entry_first[m + 1] - lay.entry_first[m]):
        i = _end_of(tra, m, graph.head[lay.entry[lay.entry_first[m] + e]], own)
        for x in range(exits):
            arc = lay.exit[lay.exit_first[m] + x]
            j = _end_of(tra, m, graph.tail[arc], own)
            if i >= 0 and j >= 0 and graph.cost[arc] < CLOSED_MM:
                part = tra.cost[tra.cost_first[m] + i * ends + j]
                if part < CLOSED_MM:
                    tra.jump[tra.jump_first[m] + e * columns + columns - exits + x] = part + graph.cost[arc]


@njit(cache=True)
def _end_of(tra: Trajectories, m: int, node: int, count: int) -> int:
    for i in range(count):
        if tra.end[tra.end_first[m] + i] == node:
            return i
    return -1


@njit(cache=True)
def _line(graph: GraphArrays, one: int, other: int) -> int:
    return int(1000.0 * np.hypot(graph.xy[one, 0] - graph.xy[other, 0], graph.xy[one, 1] - graph.xy[other, 1]))


@njit(cache=True)
def _climbed(
    graph: GraphArrays, lay: Layout, tra: Trajectories, node: int, d: int, outwards: bool
) -> tuple[Int32Array, Int32Array]:
    """Return the costs to the bridges of the ancestor below depth d, and the bridge chosen at each level, (levels, all).

    Bridges count within their sub-map; the first level is estimated by air line.
    """
    m = graph.node_submap[node]
    count = tra.bridge_first[m + 1] - tra.bridge_first[m]
    most = count
    for k in range(d + 1, lay.depth[m] + 1):
        a = lay.ancestor[m, k]
        most = max(most, tra.bridge_first[a + 1] - tra.bridge_first[a])
    chosen = np.full((lay.depth[m] - d, most), -1, np.int32)
    costs = np.empty(count, np.int32)
    for i in range(count):
        costs[i] = _line(graph, node, tra.bridge[tra.bridge_first[m] + i])
    for level in range(1, lay.depth[m] - d):
        p = graph.parent[m]
        ends, own = tra.end_first[p + 1] - tra.end_first[p], tra.bridge_first[p + 1] - tra.bridge_first[p]
        above = np.full(own, CLOSED_MM, np.int32)
        for j in range(own):
            for i in range(count):
                one, other = (tra.own_at[m] + i, j) if outwards else (j, tra.own_at[m] + i)
                part = tra.cost[tra.cost_first[p] + one * ends + other]
                if part < CLOSED_MM and costs[i] + part < above[j]:
                    above[j], chosen[level, j] = costs[i] + part, i
        costs, count, m = above, own, p
    return costs, chosen


@njit(cache=True)
def _way(graph: GraphArrays, lay: Layout, tra: Trajectories, start: int, goal: int, brothers: bool) -> Int32Array:
    """Return the arcs of a way, none if there is none."""
    none = np.empty(0, np.int32)
    if start == goal:
        return none
    one, other = graph.node_submap[start], graph.node_submap[goal]
    d = meeting_depth(lay.depth, lay.ancestor, one, other)
    if lay.depth[one] == d or lay.depth[other] == d:
        return _inside(graph, lay, tra, lay.ancestor[one, d], start, goal)
    top, left, right = lay.ancestor[one, d], lay.ancestor[one, d + 1], lay.ancestor[other, d + 1]
    out, chosen_out = _climbed(graph, lay, tra, start, d, True)
    into, chosen_in = _climbed(graph, lay, tra, goal, d, False)
    ends = tra.end_first[top + 1] - tra.end_first[top]
    least, u, v = CLOSED_MM, -1, -1
    if not brothers:
        u, v, middle = _linked(graph, lay, tra, top, left, right, out, into)
    else:
        for i in range(len(out)):
            for j in range(len(into)):
                part = tra.cost[tra.cost_first[top] + (tra.own_at[left] + i) * ends + tra.own_at[right] + j]
                if part < CLOSED_MM and np.int64(out[i]) + part + into[j] < least:
                    least, u, v = out[i] + part + into[j], i, j
        middle = none
    if u < 0:
        return none
    way, count = np.empty(4096, np.int32), 0
    skeleton = np.empty(lay.depth[one] - d, np.int32)
    q = u
    for level in range(lay.depth[one] - d - 1, -1, -1):
        skeleton[level] = q
        q = chosen_out[level, q]
    first = tra.bridge[tra.bridge_first[one] + skeleton[0]]
    way, count = _joined(way, count, _inside(graph, lay, tra, one, start, first))
    m = one
    for level in range(1, len(skeleton)):
        p = graph.parent[m]
        part = _unpacked(graph, lay, tra, p, tra.own_at[m] + skeleton[level - 1], skeleton[level])
        way, count = _joined(way, count, part)
        m = p
    if brothers:
        middle = _unpacked(graph, lay, tra, top, tra.own_at[left] + u, tra.own_at[right] + v)
    way, count = _joined(way, count, middle)
    q, m = v, right
    for level in range(lay.depth[other] - d - 1, 0, -1):
        below = lay.ancestor[other, lay.depth[other] - level + 1]
        z = chosen_in[level, q]
        way, count = _joined(way, count, _unpacked(graph, lay, tra, m, q, tra.own_at[below] + z))
        q, m = z, below
    last = tra.bridge[tra.bridge_first[other] + q]
    way, count = _joined(way, count, _inside(graph, lay, tra, other, last, goal))
    return way[:count].copy()


@njit(cache=True)
def _joined(way: Int32Array, count: int, part: Int32Array) -> tuple[Int32Array, int]:
    while count + len(part) > len(way):
        way = np.concatenate((way, np.empty(len(way), np.int32)))
    way[count : count + len(part)] = part
    return way, count + len(part)


@njit(cache=True)
def _inside(graph: GraphArrays, lay: Layout, tra: Trajectories, m: int, start: int, goal: int) -> Int32Array:
    """Return the arcs from node to node by A* within `m`; children are jumped over, or entered at the ends only."""
    if start == goal:
        return np.empty(0, np.int32)
    states = lay.sizes[m, STATES]
    cost = np.full(states, CLOSED_MM, np.int32)
    if graph.node_submap[start] != m or graph.node_submap[goal] != m:
        return np.empty(0, np.int32)
    for b in range(graph.first[start], graph.first[start + 1]):
        if graph.cost[b] < CLOSED_MM:
            cost[state_of_arc(graph, lay, m, b)] = graph.cost[b]
    last, before = _guided(graph, lay, tra, m, cost, goal, np.zeros(0, np.int32))
    return _arcs_back(graph, lay, tra, m, before, last)


@njit(cache=True)
def _linked(
    graph: GraphArrays,
    lay: Layout,
    tra: Trajectories,
    top: int,
    left: int,
    right: int,
    out: Int32Array,
    into: Int32Array,
) -> tuple[int, int, Int32Array]:
    """Return the bridges of two brothers and the arcs between, by a search of their parent without group 5."""
    states = lay.sizes[top, STATES]
    cost, ending = np.full(states, CLOSED_MM, np.int32), np.full(states, CLOSED_MM, np.int32)
    for x in range(lay.exit_first[left + 1] - lay.exit_first[left]):
        arc = lay.exit[lay.exit_first[left] + x]
        i = _end_of(tra, left, graph.tail[arc], len(out))
        if i >= 0 and graph.cost[arc] < CLOSED_MM and out[i] < CLOSED_MM:
            cost[lay.exits_at[left] + x] = out[i] + graph.cost[arc]
    for e in range(lay.entry_first[right + 1] - lay.entry_first[right]):
        j = _end_of(tra, right, graph.head[lay.entry[lay.entry_first[right] + e]], len(into))
        if j >= 0:
            ending[lay.entries_at[right] + e] = into[j]
    last, before = _guided(graph, lay, tra, top, cost, -1, ending)
    if last < 0:
        return -1, -1, np.empty(0, np.int32)
    arcs = _arcs_back(graph, lay, tra, top, before, last)
    return _end_of(tra, left, graph.tail[arcs[0]], len(out)), _end_of(tra, right, graph.head[arcs[-1]], len(into)), arcs


@njit(cache=True)
def _guided(
    graph: GraphArrays, lay: Layout, tra: Trajectories, m: int, cost: Int32Array, goal: int, ending: Int32Array
) -> tuple[int, Int32Array]:
    """Search the overlay of `m` from the states with a cost to a node, by A*, or to states with an ending cost."""
    first, to, weight = overlay(graph, lay, tra.jump_first, tra.jump, m)
    states, size = len(cost), 0
    heap, before = np.empty(states + len(to) + 64, np.int64), np.full(states, -1, np.int32)
    node_of = np.empty(states, np.int32)
    for s in range(states):
        node_of[s] = graph.head[arc_of_state(lay, m, s)]
        if cost[s] < CLOSED_MM:
            h = _line(graph, node_of[s], goal) if goal >= 0 else 0
            size = push(heap, size, int((np.int64(cost[s] + h) << SHIFT) | s))
    least, last = CLOSED_MM, -1
    while size > 0:
        item = heap[0]
        size = pop(heap, size)
        s = item & _MASK
        h = _line(graph, node_of[s], goal) if goal >= 0 else 0
        if (item >> SHIFT) >= least:
            break
        if (item >> SHIFT) > cost[s] + h:
            continue
        if goal >= 0 and node_of[s] == goal:
            least, last = cost[s], s
        elif goal < 0 and ending[s] < CLOSED_MM and cost[s] + ending[s] < least:
            least, last = cost[s] + ending[s], s
        for k in range(first[s], first[s + 1]):
            b = to[k]
            if cost[s] + weight[k] < cost[b]:
                cost[b], before[b] = cost[s] + weight[k], s
                h = _line(graph, node_of[b], goal) if goal >= 0 else 0
                size = push(heap, size, int((np.int64(cost[b] + h) << SHIFT) | b))
    return last, before


@njit(cache=True)
def _unpacked(graph: GraphArrays, lay: Layout, tra: Trajectories, m: int, one: int, other: int) -> Int32Array:
    """Return the arcs of a trajectory between two ends of `m`, in the order of driving."""
    way, count = _trajectory_back(graph, lay, tra, m, one, other, np.empty(256, np.int32), 0)
    return way[:count][::-1].copy()


@njit(cache=True)
def _child_jumped(lay: Layout, m: int, state: int, before: int) -> int:
    """Return the child that is jumped over on the way to a state, -1 for none."""
    if before < lay.sizes[m, ROWS] or state >= lay.sizes[m, ROWS]:
        return -1
    c = child_of_state(lay, m, state)
    return c if c >= 0 and child_of_state(lay, m, before) == c else -1


@njit(cache=True)
def _bridges_of_jump(
    graph: GraphArrays, lay: Layout, tra: Trajectories, m: int, c: int, state: int, before: int
) -> tuple[int, int]:
    own = int(tra.bridge_first[c + 1] - tra.bridge_first[c])
    one = _end_of(tra, c, graph.head[arc_of_state(lay, m, before)], own)
    return one, _end_of(tra, c, graph.tail[arc_of_state(lay, m, state)], own)


@njit(cache=True)
def _trajectory_back(
    graph: GraphArrays, lay: Layout, tra: Trajectories, m: int, one: int, other: int, way: Int32Array, count: int
) -> tuple[Int32Array, int]:
    """Append the arcs of a trajectory from its last one back; children that are jumped over are unpacked."""
    maps, befores, lasts, depth = np.empty(64, np.int64), np.empty(64, np.int64), np.empty(64, np.int64), 0
    at, s = _trajectory(lay, tra, m, one, other)
    while True:
        if s < 0:
            if depth == 0:
                return way, count
            depth -= 1
            m, at, s = maps[depth], befores[depth], lasts[depth]
            continue
        way, count = _with_arc(way, count, arc_of_state(lay, m, s))
        b = int(tra.before[at + s])
        c = _child_jumped(lay, m, s, b)
        if c < 0:
            s = b
            continue
        i, j = _bridges_of_jump(graph, lay, tra, m, c, s, b)
        maps[depth], befores[depth], lasts[depth] = m, at, b
        depth += 1
        m = c
        at, s = _trajectory(lay, tra, m, i, j)


@njit(cache=True)
def _trajectory(lay: Layout, tra: Trajectories, m: int, one: int, other: int) -> tuple[int, int]:
    """Return where the states before each begin on the trajectories from an end, and the last state of one of them."""
    ends = tra.end_first[m + 1] - tra.end_first[m]
    last = -1 if one == other else tra.last[tra.cost_first[m] + one * ends + other]
    return int(tra.before_first[m] + one * lay.sizes[m, STATES]), int(last)


@njit(cache=True)
def _with_arc(way: Int32Array, count: int, arc: int) -> tuple[Int32Array, int]:
    if count > 0 and way[count - 1] == arc:
        return way, count
    if count == len(way):
        way = np.concatenate((way, np.empty(len(way), np.int32)))
    way[count] = arc
    return way, count + 1


@njit(cache=True)
def _arcs_back(graph: GraphArrays, lay: Layout, tra: Trajectories, m: int, before: Int32Array, last: int) -> Int32Array:
    """Return the arcs up to a state of a search of `m`, in the order of driving; children are unpacked."""
    way, count, s = np.empty(256, np.int32), 0, last
    while s >= 0:
        way, count = _with_arc(way, count, arc_of_state(lay, m, s))
        b = int(before[s])
        c = _child_jumped(lay, m, s, b)
        if c >= 0:
            i, j = _bridges_of_jump(graph, lay, tra, m, c, s, b)
            way, count = _trajectory_back(graph, lay, tra, c, i, j, way, count)
        s = b
    return way[:count][::-1].copy()
