"""The overlay of a sub-map: its own arcs, and the arcs that enter and leave it and its children.

A state is a directed arc, just after driving it, so that the turn into the next arc is known. An arc leaves a sub-map
(is one of its exits) if its tail lies in it, at any depth, and its head does not; entries are the opposite. A child is
jumped over: from each of its entries to each of its exits at the cost in the child's own table.

States of the overlay of M are numbered: entries of M; exits of each child; entries of each child; exits of M; own arcs.
The first two are the rows of its table, the next two its columns.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.maps.building.costs import CLOSED_MM
from waychair.maps.building.graph_arrays import NO_HEADING, GraphArrays, Int32Array

Int64Array = NDArray[np.int64]

ROWS, COLUMNS, STATES, EXITS_AT = range(4)
"""Columns of `Layout.sizes`: rows and columns of the table, states of the overlay, and the first state of its exits."""

_STRAIGHT, _TURN = 8192, 24576
"""Changes of heading [parts of a turn] up to which there is no turn, and only one to the side (45 and 135 degrees)."""


class Layout(NamedTuple):
    """The tree and each sub-map's lists, for M sub-maps of depth below D, and A arcs.

    `depth` (M,), `ancestor` (M, D) at each depth, -1 below itself; `node_first` (M + 1,); `child_first` (M + 1,) into
    `child`; `exit_first`, `entry_first`, `own_first` (M + 1,) into the arcs `exit`, `entry`, `own`, each ascending;
    `position` (A,) of an arc in the list in which its tail's sub-map finds it; `exits_at`, `entries_at` (M,) first state of
    its exits and entries in the parent's overlay; `sizes` (M, 4).
    """

    depth: Int32Array
    ancestor: Int32Array
    node_first: Int32Array
    child_first: Int32Array
    child: Int32Array
    exit_first: Int64Array
    exit: Int32Array
    entry_first: Int64Array
    entry: Int32Array
    own_first: Int64Array
    own: Int32Array
    position: Int32Array
    exits_at: Int32Array
    entries_at: Int32Array
    sizes: Int32Array


def layout(graph: GraphArrays) -> Layout:
    """Return the lists of all sub-maps' overlays."""
    parent = graph.parent
    order = np.argsort(parent[1:], kind="stable").astype(np.int32) + np.int32(1)
    child_first = np.searchsorted(parent[order], np.arange(len(parent) + 1)).astype(np.int32)
    node_first = np.searchsorted(graph.node_submap, np.arange(len(parent) + 1)).astype(np.int32)
    depth, ancestor = _tree(parent)
    lists = _lists(graph.node_submap, graph.tail, graph.head, depth, ancestor)
    exit_first, exits, entry_first, entries, own_first, own, position = lists
    exits_at, entries_at, sizes = _numbered(child_first, order, exit_first, entry_first, own_first)
    return Layout(
        depth,
        ancestor,
        node_first,
        child_first,
        order,
        exit_first,
        exits,
        entry_first,
        entries,
        own_first,
        own,
        position,
        exits_at,
        entries_at,
        sizes,
    )


@njit(cache=True)
def _tree(parent: Int32Array) -> tuple[Int32Array, Int32Array]:
    count = len(parent)
    depth = np.zeros(count, np.int32)
    for m in range(1, count):
        depth[m] = depth[parent[m]] + 1
    ancestor = np.full((count, depth.max() + 1), -1, np.int32)
    for m in range(count):
        if m > 0:
            for d in range(depth[m]):
                ancestor[m, d] = ancestor[parent[m], d]
        ancestor[m, depth[m]] = m
    return depth, ancestor


@njit(cache=True)
def meeting_depth(depth: Int32Array, ancestor: Int32Array, one: int, other: int) -> int:
    """Return the depth of the deepest sub-map that holds two sub-maps."""
    d = min(depth[one], depth[other])
    while ancestor[one, d] != ancestor[other, d]:
        d -= 1
    return int(d)


@njit(cache=True)
def _lists(
    node_submap: Int32Array, tail: Int32Array, head: Int32Array, depth: Int32Array, ancestor: Int32Array
) -> tuple[Int64Array, Int32Array, Int64Array, Int32Array, Int64Array, Int32Array, Int32Array]:
    maps, arcs = len(depth), len(tail)
    exit_first, entry_first = np.zeros(maps + 1, np.int64), np.zeros(maps + 1, np.int64)
    own_first = np.zeros(maps + 1, np.int64)
    for a in range(arcs):
        one, other = node_submap[tail[a]], node_submap[head[a]]
        if one == other:
            own_first[one + 1] += 1
            continue
        top = meeting_depth(depth, ancestor, one, other)
        for d in range(top + 1, depth[one] + 1):
            exit_first[ancestor[one, d] + 1] += 1
        for d in range(top + 1, depth[other] + 1):
            entry_first[ancestor[other, d] + 1] += 1
    exit_first, entry_first, own_first = exit_first.cumsum(), entry_first.cumsum(), own_first.cumsum()
    exits, entries = np.empty(exit_first[-1], np.int32), np.empty(entry_first[-1], np.int32)
    own, position = np.empty(own_first[-1], np.int32), np.empty(arcs, np.int32)
    exit_at, entry_at, own_at = exit_first.copy(), entry_first.copy(), own_first.copy()
    for a in range(arcs):
        one, other = node_submap[tail[a]], node_submap[head[a]]
        if one == other:
            own[own_at[one]] = a
            position[a] = own_at[one] - own_first[one]
            own_at[one] += 1
            continue
        top = meeting_depth(depth, ancestor, one, other)
        for d in range(top + 1, depth[other] + 1):
            m = ancestor[other, d]
            entries[entry_at[m]] = a
            if d == top + 1:
                position[a] = entry_at[m] - entry_first[m]
            entry_at[m] += 1
        for d in range(top + 1, depth[one] + 1):
            m = ancestor[one, d]
            exits[exit_at[m]] = a
            if m == one:
                position[a] = exit_at[m] - exit_first[m]
            exit_at[m] += 1
    return exit_first, exits, entry_first, entries, own_first, own, position


@njit(cache=True)
def _numbered(
    child_first: Int32Array, child: Int32Array, exit_first: Int64Array, entry_first: Int64Array, own_first: Int64Array
) -> tuple[Int32Array, Int32Array, Int32Array]:
    maps = len(child_first) - 1
    exits_at, entries_at = np.zeros(maps, np.int32), np.zeros(maps, np.int32)
    sizes = np.zeros((maps, 4), np.int32)
    for m in range(maps):
        at = entry_first[m + 1] - entry_first[m]
        for k in range(child_first[m], child_first[m + 1]):
            c = child[k]
            exits_at[c] = at
            at += exit_first[c + 1] - exit_first[c]
        rows = at
        for k in range(child_first[m], child_first[m + 1]):
            c = child[k]
            entries_at[c] = at
            at += entry_first[c + 1] - entry_first[c]
        sizes[m, EXITS_AT] = at
        at += exit_first[m + 1] - exit_first[m]
        sizes[m, ROWS], sizes[m, COLUMNS] = rows, at - rows
        sizes[m, STATES] = at + own_first[m + 1] - own_first[m]
    return exits_at, entries_at, sizes


@njit(cache=True, inline="always")
def turn(heading: NDArray[np.int16], turns: Int32Array, arc: int, onto: int) -> int:
    """Return the cost of the turn from one arc onto another [mm]."""
    one, other = np.int32(heading[arc]), np.int32(heading[onto])
    if one == NO_HEADING or other == NO_HEADING:
        return 0
    change = abs(((other - one + 32768) & 65535) - 32768)
    if change <= _STRAIGHT:
        return 0
    return int(turns[0] if change <= _TURN else turns[1])


@njit(cache=True)
def _found(arcs: Int32Array, low: int, high: int, arc: int) -> int:
    """Return the position of an arc in an ascending part of a list, counted from `low`."""
    start = low
    while low < high:
        middle = (low + high) >> 1
        if arcs[middle] < arc:
            low = middle + 1
        else:
            high = middle
    return int(low - start)


@njit(cache=True)
def state_of_arc(graph: GraphArrays, lay: Layout, m: int, arc: int) -> int:
    """Return the state of an arc whose tail is a node of `m` itself."""
    to = graph.node_submap[graph.head[arc]]
    d = lay.depth[m]
    if to == m:
        return int(lay.sizes[m, EXITS_AT] + lay.exit_first[m + 1] - lay.exit_first[m] + lay.position[arc])
    if lay.depth[to] > d and lay.ancestor[to, d] == m:
        return int(lay.entries_at[lay.ancestor[to, d + 1]] + lay.position[arc])
    return int(lay.sizes[m, EXITS_AT] + lay.position[arc])


@njit(cache=True)
def arc_of_state(lay: Layout, m: int, state: int) -> int:
    """Return the arc of a state of the overlay of `m`."""
    entries = lay.entry_first[m + 1] - lay.entry_first[m]
    if state < entries:
        return int(lay.entry[lay.entry_first[m] + state])
    exits_at = lay.sizes[m, EXITS_AT]
    if state >= exits_at:
        exits = lay.exit_first[m + 1] - lay.exit_first[m]
        if state < exits_at + exits:
            return int(lay.exit[lay.exit_first[m] + state - exits_at])
        return int(lay.own[lay.own_first[m] + state - exits_at - exits])
    c = child_of_state(lay, m, state)
    if state < lay.sizes[m, ROWS]:
        return int(lay.exit[lay.exit_first[c] + state - lay.exits_at[c]])
    return int(lay.entry[lay.entry_first[c] + state - lay.entries_at[c]])


@njit(cache=True)
def child_of_state(lay: Layout, m: int, state: int) -> int:
    """Return the child whose exit or entry a state of the overlay of `m` is; -1 for other states."""
    entries = lay.entry_first[m + 1] - lay.entry_first[m]
    if state < entries or state >= lay.sizes[m, EXITS_AT]:
        return -1
    at = lay.exits_at if state < lay.sizes[m, ROWS] else lay.entries_at
    low, high = lay.child_first[m], lay.child_first[m + 1] - 1
    while low < high:  # the last child whose states begin at or before this one
        middle = (low + high + 1) >> 1
        if at[lay.child[middle]] <= state:
            low = middle
        else:
            high = middle - 1
    return int(lay.child[low])


@njit(cache=True)
def _onward(graph: GraphArrays, lay: Layout, m: int, arc: int, to: Int32Array, weight: Int32Array, count: int) -> int:
    """Append the states that follow an arc which has just been driven; return the new count."""
    node = graph.head[arc]
    at, d = graph.node_submap[node], lay.depth[m]
    if at == m:
        for b in range(graph.first[node], graph.first[node + 1]):
            if graph.cost[b] < CLOSED_MM:
                to[count] = state_of_arc(graph, lay, m, b)
                weight[count] = graph.cost[b] + turn(graph.heading, graph.turns, arc, b)
                count += 1
        return count
    if lay.depth[at] > d and lay.ancestor[at, d] == m:
        c = lay.ancestor[at, d + 1]
        to[count] = lay.entries_at[c] + _found(lay.entry, lay.entry_first[c], lay.entry_first[c + 1], arc)
    else:
        to[count] = lay.sizes[m, EXITS_AT] + _found(lay.exit, lay.exit_first[m], lay.exit_first[m + 1], arc)
    weight[count] = 0
    return count + 1


@njit(cache=True)
def _most_onward(graph: GraphArrays, m: int, arc: int) -> int:
    node = graph.head[arc]
    if graph.node_submap[node] != m:
        return 1
    return int(graph.first[node + 1] - graph.first[node])


@njit(cache=True)
def overlay(
    graph: GraphArrays, lay: Layout, table_first: Int64Array, within: Int32Array, m: int
) -> tuple[Int32Array, Int32Array, Int32Array]:
    """Return the transitions between the states of the overlay of `m`: first (S + 1,), to and weight (T,) [mm].

    `within` holds the tables of all sub-maps, from `table_first` on; those of the children of `m` are used.
    """
    states, exits_at = lay.sizes[m, STATES], lay.sizes[m, EXITS_AT]
    own_at = exits_at + lay.exit_first[m + 1] - lay.exit_first[m]
    room = 0
    for k in range(lay.entry_first[m], lay.entry_first[m + 1]):
        room += _most_onward(graph, m, lay.entry[k])
    for j in range(lay.child_first[m], lay.child_first[m + 1]):
        c = lay.child[j]
        for k in range(lay.exit_first[c], lay.exit_first[c + 1]):
            room += _most_onward(graph, m, lay.exit[k])
        room += (lay.entry_first[c + 1] - lay.entry_first[c]) * (lay.exit_first[c + 1] - lay.exit_first[c])
    for k in range(lay.own_first[m], lay.own_first[m + 1]):
        room += _most_onward(graph, m, lay.own[k])
    first, to, weight = np.empty(states + 1, np.int32), np.empty(room, np.int32), np.empty(room, np.int32)
    count, state = 0, 0
    for k in range(lay.entry_first[m], lay.entry_first[m + 1]):
        first[state] = count
        count = _onward(graph, lay, m, lay.entry[k], to, weight, count)
        state += 1
    for j in range(lay.child_first[m], lay.child_first[m + 1]):
        c = lay.child[j]
        for k in range(lay.exit_first[c], lay.exit_first[c + 1]):
            first[state] = count
            count = _onward(graph, lay, m, lay.exit[k], to, weight, count)
            state += 1
    for j in range(lay.child_first[m], lay.child_first[m + 1]):
        c = lay.child[j]
        columns, exits = lay.sizes[c, COLUMNS], lay.exit_first[c + 1] - lay.exit_first[c]
        for e in range(lay.entry_first[c + 1] - lay.entry_first[c]):
            first[state] = count
            at = table_first[c] + e * columns + columns - exits
            for x in range(exits):
                if within[at + x] < CLOSED_MM:
                    to[count], weight[count] = lay.exits_at[c] + x, within[at + x]
                    count += 1
            state += 1
    for _ in range(exits_at, own_at):  # beyond its exits, M ends
        first[state] = count
        state += 1
    for k in range(lay.own_first[m], lay.own_first[m + 1]):
        first[state] = count
        count = _onward(graph, lay, m, lay.own[k], to, weight, count)
        state += 1
    first[state] = count
    return first, to[:count], weight[:count]
