"""The overlay of a sub-map: its own arcs, and the arcs that enter and leave it and its children.

A state is a directed arc, just after driving it, so that the turn into the next arc is known. An arc leaves a sub-map
(is one of its exits) if its tail lies in it, at any depth, and its head does not; entries are the opposite. A child is
jumped over: from each of its entries to each of its exits at the cost in the child's own table.

States of the overlay of M are numbered: entries of M; exits of each child; entries of each child; exits of M; own arcs.
The first two are the rows of its table, the next two its columns.

Kernels are handed three arrays instead of one for each list: numba compiles them several times faster so, and a query
that reads one line of memory for each sub-map waits less.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.maps.building.costs import CLOSED_MM
from waychair.maps.building.graph_arrays import NO_HEADING, GraphArrays, Int16Array, Int32Array

Int64Array = NDArray[np.int64]
StateArray = NDArray[np.uint16] | NDArray[np.int32]

(
    DEPTH,
    NODES,
    EXITS,
    OUT,
    ENTRIES,
    INTO,
    EXITS_IN,
    ENTRIES_IN,
    PARENT,
    NODES_END,
    CHILDREN,
    CHILDREN_END,
    ROWS,
    COLUMNS,
    STATES,
    EXITS_AT,
    ARCS,
    OWNERS,
    WITHIN,
    AROUND,
    BEFORE,
    AFTER,
    OUT_STATE,
    INTO_STATE,
    ANCESTOR,
) = range(25)
"""Columns of `Tables.book`, those of a query first. The last one begins a group of three for each depth d, from the root's
on: the ancestor there, and where the costs up to it and down from it begin (`UP`, `DOWN`)."""

UP, DOWN, LEVEL = ANCESTOR + 1, ANCESTOR + 2, 3
"""Column d of a group is `UP + LEVEL * d`."""

_MOST_UINT16 = 65_534
"""Largest number of states of an overlay for which the ways are kept in 16 bits each."""

_STRAIGHT, _TURN = 8192, 24576
"""Changes of heading [parts of a turn] up to which there is no turn, and only one to the side (45 and 135 degrees)."""


class Net(NamedTuple):
    """The arrays of a graph that kernels of the tables read, as in `GraphArrays`."""

    node_submap: Int32Array
    first: Int32Array
    head: Int32Array
    cost: Int32Array
    heading: Int16Array
    turns: Int32Array


class Tables(NamedTuple):
    """All tables of M sub-maps.

    `book` (M, 25 + 3 D) int64 says of each sub-map, for a tree of D levels:
    - `DEPTH`, `PARENT`, its nodes `NODES` to `NODES_END`, and its ancestor at each depth, -1 below itself;
    - how many `EXITS`, `ENTRIES`, `ROWS`, `COLUMNS`, `STATES` it has, and the state `EXITS_AT` at which its exits begin;
    - the states `EXITS_IN`, `ENTRIES_IN` at which its exits and entries begin in its parent's overlay;
    - where its parts of the other arrays begin.

    `numbers` int32 begins with the position (A,) of each arc among those of its kind in the sub-map of its tail, then the
    children of all sub-maps. Then come each sub-map's parts:
    - `OUT`, `INTO`: costs [mm] between each node and the exits (nodes, exits), entries (nodes, entries);
    - `UP`, `DOWN`: costs within an ancestor from the exits to its exits, from its entries to the entries, (own, its);
    - `WITHIN`: the table within the sub-map (rows, columns);
    - `AROUND`: the part between children (their exits, their entries), by any way, also one that leaves and returns;
    - `ARCS`: the arc of each state; `OWNERS`: the child of each state from `ENTRIES` to `EXITS_AT`.

    `steps` holds states, the ways behind these costs: `OUT_STATE` the first and `INTO_STATE` the last on the way between a
    node and a border, `AFTER` the next one on the way to an exit (exits, states), and `BEFORE` the one before on the way
    from a row (rows, states).
    """

    book: Int64Array
    numbers: Int32Array
    steps: StateArray


def net_of(graph: GraphArrays) -> Net:
    """Return the arrays of a graph that kernels read."""
    return Net(graph.node_submap, graph.first, graph.head, graph.cost, graph.heading, graph.turns)


def laid_out(graph: GraphArrays, only_within: bool = False) -> Tables:
    """Return the tables of a graph with all lists filled, costs and ways not; `only_within` leaves room for no others."""
    book = _tree(graph.parent, graph.node_submap)
    order = np.argsort(graph.parent[1:], kind="stable").astype(np.int32) + np.int32(1)
    begin = len(graph.tail) + np.searchsorted(graph.parent[order], np.arange(len(book) + 1))
    book[:, CHILDREN], book[:, CHILDREN_END] = begin[:-1], begin[1:]
    net = net_of(graph)
    _count(net, graph.tail, book, order)
    size = _place(book, len(graph.tail) + len(order), only_within)
    steps = _place_steps(book) if not only_within else 0
    kept = book[(book[:, ROWS] > 0) | (book[:, EXITS] > 0), STATES]
    ways: StateArray = np.empty(steps, np.uint16) if kept.max(initial=0) <= _MOST_UINT16 else np.empty(steps, np.int32)
    tables = Tables(book, np.empty(size + 1, np.int32), ways)
    tables.numbers[-1] = 0  # an empty part at the end can be looked at, too
    tables.numbers[len(graph.tail) : len(graph.tail) + len(order)] = order
    _list_arcs(net, graph.tail, tables)
    return tables


def _tree(parent: Int32Array, node_submap: Int32Array) -> Int64Array:
    """Return a book with depths, parents, ancestors and nodes."""
    count = len(parent)
    depth, up = np.zeros(count, np.int64), parent.astype(np.int64)
    while (up >= 0).any():
        depth += up >= 0
        up = np.where(up >= 0, parent[up], -1)
    levels = int(depth.max()) + 1
    book = np.zeros((count, ANCESTOR + LEVEL * levels), np.int64)
    book[:, ANCESTOR::LEVEL] = -1
    up = np.arange(count)
    for d in range(levels - 1, -1, -1):
        here = depth[up] == d
        book[here, ANCESTOR + LEVEL * d] = up[here]
        up = np.where(here & (d > 0), parent[up], up)
    begin = np.searchsorted(node_submap, np.arange(count + 1))
    book[:, DEPTH], book[:, PARENT], book[:, NODES], book[:, NODES_END] = depth, parent, begin[:-1], begin[1:]
    return book


@njit(cache=True)
def _count(net: Net, tail: Int32Array, book: Int64Array, child: Int32Array) -> None:
    """Count exits, entries and own arcs of all sub-maps, and number the states."""
    for a in range(len(tail)):
        one, other = wide(net.node_submap[tail[a]]), wide(net.node_submap[net.head[a]])
        if one == other:
            book[one, STATES] += 1
            continue
        top = meeting_depth(book, one, other)
        for d in range(top + 1, book[one, DEPTH] + 1):
            book[book[one, ANCESTOR + LEVEL * d], EXITS] += 1
        for d in range(top + 1, book[other, DEPTH] + 1):
            book[book[other, ANCESTOR + LEVEL * d], ENTRIES] += 1
    for m in range(len(book)):
        at = book[m, ENTRIES]
        for k in range(book[m, CHILDREN] - len(tail), book[m, CHILDREN_END] - len(tail)):
            book[child[k], EXITS_IN] = at
            at += book[child[k], EXITS]
        book[m, ROWS] = at
        for k in range(book[m, CHILDREN] - len(tail), book[m, CHILDREN_END] - len(tail)):
            book[child[k], ENTRIES_IN] = at
            at += book[child[k], ENTRIES]
        book[m, EXITS_AT] = at
        book[m, COLUMNS] = at + book[m, EXITS] - book[m, ROWS]
        book[m, STATES] += at + book[m, EXITS]


def _place(book: Int64Array, begin: int, only_within: bool) -> int:
    """Set where each sub-map's parts of the numbers begin; return the size of all."""
    nodes, exits, entries = book[:, NODES_END] - book[:, NODES], book[:, EXITS], book[:, ENTRIES]
    sizes = {
        WITHIN: book[:, ROWS] * book[:, COLUMNS],
        ARCS: book[:, STATES],
        OWNERS: book[:, EXITS_AT] - entries,
    }
    if not only_within:
        sizes = {OUT: nodes * exits, INTO: nodes * entries, **_climb_sizes(book), **sizes}
        sizes[AROUND] = (book[:, ROWS] - entries) * (book[:, EXITS_AT] - book[:, ROWS])
    return _begun(book, sizes, begin)


def _climb_sizes(book: Int64Array) -> dict[int, Int64Array]:
    sizes = {}
    for d in range(1, (book.shape[1] - ANCESTOR) // LEVEL):
        deep, ancestor = book[:, DEPTH] > d, book[:, ANCESTOR + LEVEL * d]
        sizes[UP + LEVEL * d] = np.where(deep, book[:, EXITS] * book[ancestor, EXITS], 0)
        sizes[DOWN + LEVEL * d] = np.where(deep, book[:, ENTRIES] * book[ancestor, ENTRIES], 0)
    return sizes


def _place_steps(book: Int64Array) -> int:
    nodes, states = book[:, NODES_END] - book[:, NODES], book[:, STATES]
    sizes = {
        OUT_STATE: nodes * book[:, EXITS],
        INTO_STATE: nodes * book[:, ENTRIES],
        AFTER: book[:, EXITS] * states,
        BEFORE: book[:, ROWS] * states,
    }
    return _begun(book, sizes, 0)


def _begun(book: Int64Array, sizes: dict[int, Int64Array], begin: int) -> int:
    """Write into the columns where parts of these sizes begin, all those of a sub-map together; return the end."""
    stacked = np.stack(list(sizes.values()), axis=1)
    ends = begin + np.cumsum(stacked).reshape(stacked.shape)
    book[:, list(sizes)] = ends - stacked
    return int(ends[-1, -1])


@njit(cache=True)
def _list_arcs(net: Net, tail: Int32Array, tables: Tables) -> None:
    """Fill the arcs of all states, their positions, and the children of states."""
    book, numbers = tables.book, tables.numbers
    listed = np.zeros((len(book), 3), np.int64)  # exits, entries, own arcs
    for a in range(len(tail)):
        one, other = wide(net.node_submap[tail[a]]), wide(net.node_submap[net.head[a]])
        if one == other:
            numbers[a] = listed[one, 2]
            numbers[book[one, ARCS] + book[one, EXITS_AT] + book[one, EXITS] + listed[one, 2]] = a
            listed[one, 2] += 1
            continue
        top = meeting_depth(book, one, other)
        for d in range(top + 1, book[other, DEPTH] + 1):
            m, p = book[other, ANCESTOR + LEVEL * d], book[other, ANCESTOR + LEVEL * (d - 1)]
            k = listed[m, 1]
            numbers[book[m, ARCS] + k] = a
            numbers[book[p, ARCS] + book[m, ENTRIES_IN] + k] = a
            numbers[book[p, OWNERS] + book[m, ENTRIES_IN] + k - book[p, ENTRIES]] = m
            if d == top + 1:
                numbers[a] = k
            listed[m, 1] += 1
        for d in range(top + 1, book[one, DEPTH] + 1):
            m, p = book[one, ANCESTOR + LEVEL * d], book[one, ANCESTOR + LEVEL * (d - 1)]
            k = listed[m, 0]
            numbers[book[m, ARCS] + book[m, EXITS_AT] + k] = a
            numbers[book[p, ARCS] + book[m, EXITS_IN] + k] = a
            numbers[book[p, OWNERS] + book[m, EXITS_IN] + k - book[p, ENTRIES]] = m
            if m == one:
                numbers[a] = k
            listed[m, 0] += 1


@njit(cache=True)
def wide(value: Any) -> int:
    """Return a number as int64, so that a kernel is compiled for one kind of number only."""
    return int(np.int64(value))


@njit(cache=True)
def meeting_depth(book: Int64Array, one: int, other: int) -> int:
    """Return the depth of the deepest sub-map that holds two sub-maps."""
    d, least = 0, min(book[one, DEPTH], book[other, DEPTH])
    while d < least and book[one, ANCESTOR + LEVEL * (d + 1)] == book[other, ANCESTOR + LEVEL * (d + 1)]:
        d += 1
    return d


@njit(cache=True, inline="always")
def turn(heading: Int16Array, turns: Int32Array, arc: int, onto: int) -> int:
    """Return the cost of the turn from one arc onto another [mm]."""
    one, other = np.int32(heading[arc]), np.int32(heading[onto])
    if one == NO_HEADING or other == NO_HEADING:
        return 0
    change = abs(((other - one + 32768) & 65535) - 32768)
    if change <= _STRAIGHT:
        return 0
    return int(turns[0] if change <= _TURN else turns[1])


@njit(cache=True)
def _found(numbers: Int32Array, begin: int, count: int, arc: int) -> int:
    """Return the position of an arc in an ascending list."""
    low, high = begin, begin + count
    while low < high:
        middle = (low + high) >> 1
        if numbers[middle] < arc:
            low = middle + 1
        else:
            high = middle
    return low - begin


@njit(cache=True)
def state_of_arc(net: Net, tables: Tables, m: int, arc: int) -> int:
    """Return the state of an arc whose tail is a node of `m` itself."""
    book, at = tables.book, tables.numbers[arc]
    to = net.node_submap[net.head[arc]]
    if to == m:
        return int(book[m, EXITS_AT] + book[m, EXITS] + at)
    d = book[m, DEPTH]
    if book[to, ANCESTOR + LEVEL * d] == m:
        return int(book[book[to, ANCESTOR + LEVEL * (d + 1)], ENTRIES_IN] + at)
    return int(book[m, EXITS_AT] + at)


@njit(cache=True)
def is_child_entry(book: Int64Array, m: int, state: int) -> bool:
    """Return whether a state of the overlay of `m` is an entry of a child."""
    return bool(book[m, ROWS] <= state < book[m, EXITS_AT])


@njit(cache=True)
def followers(net: Net, tables: Tables, m: int, s: int, to: Int32Array, weight: Int32Array, count: int) -> int:
    """Append the states that follow one in the overlay of `m`, and their costs [mm]; return the new count."""
    book, numbers = tables.book, tables.numbers
    exits_at = book[m, EXITS_AT]
    if is_child_entry(book, m, s):  # over the child
        c = numbers[book[m, OWNERS] + s - book[m, ENTRIES]]
        columns, exits = book[c, COLUMNS], book[c, EXITS]
        at = book[c, WITHIN] + (s - book[c, ENTRIES_IN] + 1) * columns - exits
        for x in range(exits):
            if numbers[at + x] < CLOSED_MM:
                to[count], weight[count] = book[c, EXITS_IN] + x, numbers[at + x]
                count += 1
        return count
    if exits_at <= s < exits_at + book[m, EXITS]:  # beyond its exits, M ends
        return count
    arc = numbers[book[m, ARCS] + s]
    node = net.head[arc]
    at = wide(net.node_submap[node])
    if at == m:
        for b in range(net.first[node], net.first[node + 1]):
            if net.cost[b] < CLOSED_MM:
                to[count] = state_of_arc(net, tables, m, wide(b))
                weight[count] = net.cost[b] + turn(net.heading, net.turns, arc, b)
                count += 1
        return count
    d = book[m, DEPTH]
    if book[at, ANCESTOR + LEVEL * d] == m:
        c = book[at, ANCESTOR + LEVEL * (d + 1)]
        to[count] = book[c, ENTRIES_IN] + _found(numbers, book[c, ARCS], book[c, ENTRIES], wide(arc))
    else:
        to[count] = exits_at + _found(numbers, book[m, ARCS] + exits_at, book[m, EXITS], wide(arc))
    weight[count] = 0
    return count + 1


@njit(cache=True)
def most_followers(net: Net, tables: Tables, m: int, s: int) -> int:
    """Return how many states follow one at most."""
    book = tables.book
    if is_child_entry(book, m, s):
        return int(book[tables.numbers[book[m, OWNERS] + s - book[m, ENTRIES]], EXITS])
    node = net.head[tables.numbers[book[m, ARCS] + s]]
    return max(1, wide(net.first[node + 1] - net.first[node]))


@njit(cache=True)
def overlay(net: Net, tables: Tables, m: int) -> tuple[Int32Array, Int32Array, Int32Array]:
    """Return the transitions between the states of the overlay of `m`: first (S + 1,), to and weight (T,) [mm].

    The tables within the children of `m` are used.
    """
    states, room = tables.book[m, STATES], 0
    for s in range(states):
        room += most_followers(net, tables, m, s)
    first, to, weight = np.empty(states + 1, np.int32), np.empty(room, np.int32), np.empty(room, np.int32)
    count = wide(0)
    for s in range(states):
        first[s] = count
        count = followers(net, tables, m, s, to, weight, count)
    first[states] = count
    return first, to[:count], weight[:count]
