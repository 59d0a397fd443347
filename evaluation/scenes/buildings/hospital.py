"""Seeded hospitals as graphs: storeys, wings, rooms, lifts, as large as the tables must cope with.

A storey has a spine of corridor nodes, from which wings lead to both sides; half of the wings meet a second spine at their
far end, so that they are ways through, and some of these are cut in the middle: between their halves every way leaves
the wing and returns. A third of the wings have a second corridor with one-way parts; an eighth of the rooms have two
doors. A third of the lifts serve half of the storeys only, so that some ways change lifts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.maps.building.costs import CostSettings, millimetres
from waychair.maps.building.graph_arrays import GraphArrays, Int32Array, assembled, turn_costs
from waychair.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Size:
    """The size of a hospital: storeys, wings a storey, rooms a wing (at most), lifts."""

    storeys: int
    wings: int
    rooms: int
    lifts: int


SIZES = {
    "H1": Size(4, 10, 20, 3),
    "H2": Size(10, 20, 40, 6),
    "H3": Size(20, 50, 100, 9),
    "H4": Size(100, 60, 100, 12),
}
"""About 13 thousand, 130 thousand, 1.6 million and 10 million nodes."""


@dataclass(frozen=True, slots=True)
class Hospital:
    """A hospital: its graph, and its goals (G,), the indices of End nodes."""

    graph: GraphArrays
    goals: IntArray


def hospital(size: Size, seed: int = 1) -> Hospital:
    """Return a seeded hospital."""
    costs = CostSettings()
    doors = np.array([0, millimetres(costs.door_m), millimetres(costs.narrow_door_m)])
    lift = np.array([millimetres(each) for each in (costs.lift_wait_m, costs.lift_board_m, costs.lift_storey_m)])
    drawn = _drawn(size.storeys, size.wings, size.rooms, size.lifts, np.random.default_rng(seed), doors, lift)
    node_submap, xy, level, is_goal, parent, ends, cost, is_lift = drawn
    graph, _ = assembled(node_submap, xy, level, parent, ends, cost, is_lift, turn_costs(costs))
    return Hospital(graph, np.flatnonzero(is_goal))


_SMALLEST, _LARGEST, _MORE = 12, 40, 5.6
"""Nodes of a room: the least, the most, and the mean of those beyond the least."""

_SPINE_STEP, _STEP, _GRID, _APART = 30.0, 4.0, 1.2, 12.0
"""Distances [m] of wings, of doors along a corridor, of nodes in a room, and between two corridors of a wing."""


class _Sheet(NamedTuple):
    """The arrays of a hospital in the making, and how many nodes, sub-maps and arcs there are, `at` (3,)."""

    node_submap: Int32Array
    xy: FloatArray
    level: Int32Array
    parent: Int32Array
    ends: Int32Array
    cost: Int32Array
    is_lift: BoolArray
    at: IntArray


@njit(cache=True)
def _node(sheet: _Sheet, rng: np.random.Generator, m: int, x: float, y: float, f: int, jitter: float) -> int:
    k = sheet.at[0]
    sheet.node_submap[k], sheet.level[k] = m, f
    sheet.xy[k, 0] = x + jitter * (rng.random() - 0.5)
    sheet.xy[k, 1] = y + jitter * (rng.random() - 0.5)
    sheet.at[0] += 1
    return int(k)


@njit(cache=True)
def _submap(sheet: _Sheet, p: int) -> int:
    sheet.parent[sheet.at[1]] = p
    sheet.at[1] += 1
    return int(sheet.at[1] - 1)


@njit(cache=True)
def _arc(sheet: _Sheet, i: int, j: int, more: int, both: bool) -> None:
    length = np.hypot(sheet.xy[j, 0] - sheet.xy[i, 0], sheet.xy[j, 1] - sheet.xy[i, 1])
    price, k = int(np.ceil(1000.0 * length)) + more, sheet.at[2]
    sheet.ends[k, 0], sheet.ends[k, 1], sheet.cost[k] = i, j, price
    if both:
        sheet.ends[k + 1, 0], sheet.ends[k + 1, 1], sheet.cost[k + 1] = j, i, price
    sheet.at[2] += 2 if both else 1


@njit(cache=True)
def _lift_arc(sheet: _Sheet, i: int, j: int, price: int) -> None:
    k = sheet.at[2]
    sheet.ends[k, 0], sheet.ends[k, 1], sheet.cost[k], sheet.is_lift[k] = i, j, price, True
    sheet.at[2] += 1


@njit(cache=True)
def _drawn(
    storeys: int, wings: int, rooms: int, lifts: int, rng: np.random.Generator, doors: IntArray, lift_costs: IntArray
) -> tuple[Int32Array, FloatArray, Int32Array, BoolArray, Int32Array, Int32Array, Int32Array, BoolArray]:
    most = storeys * (wings * (rooms * 22 + 16) + 4 * wings + 4 * lifts + 64) + 4096
    node_submap, level = np.empty(most, np.int32), np.empty(most, np.int32)
    xy, is_goal = np.empty((most, 2)), np.zeros(most, np.bool_)
    parent = np.empty(1 + storeys * (1 + wings * (2 + rooms)), np.int32)
    ends, cost, is_lift = np.empty((4 * most, 2), np.int32), np.empty(4 * most, np.int32), np.zeros(4 * most, np.bool_)
    at = np.zeros(3, np.int64)  # nodes, sub-maps, arcs
    sheet = _Sheet(node_submap, xy, level, parent, ends, cost, is_lift, at)
    free, none, yes = (
        doors[0],
        int(np.int64(-1)),
        storeys > 0,
    )  # variables: numba compiles a function anew for each literal
    root = _submap(sheet, none)
    cabin = np.full((lifts, storeys), -1, np.int64)
    rows = (wings + 1) // 2
    for k in range(lifts):
        low, high = 0, storeys
        if k % 3 == 2 and storeys > 2:  # zoned: to the lower half and back, or the upper
            middle = storeys // 2
            low, high = (0, middle + 1) if (k // 3) % 2 == 0 else (middle, storeys)
        y = _SPINE_STEP * ((k * rows) // max(lifts, 1)) + 12.0
        for f in range(low, high):
            cabin[k, f] = _node(sheet, rng, root, 3.0, y, f, 0.0)
            if f > low:
                _lift_arc(sheet, cabin[k, f - 1], cabin[k, f], lift_costs[2])
                _lift_arc(sheet, cabin[k, f], cabin[k, f - 1], lift_costs[2])
    for f in range(storeys):
        s = _submap(sheet, root)
        spine = np.empty(rows, np.int64)
        for r in range(rows):
            spine[r] = _node(sheet, rng, s, 0.0, _SPINE_STEP * r, f, 0.4)
        is_stop = np.zeros(rows, np.bool_)
        hall = spine.copy()
        for r in range(rows):
            for k in range(lifts):
                is_stop[r] |= (k * rows) // max(lifts, 1) == r
            if is_stop[r]:
                hall[r] = _node(sheet, rng, s, 0.0, _SPINE_STEP * r + 12.0, f, 0.4)
        for r in range(rows):
            if hall[r] != spine[r]:
                _arc(sheet, spine[r], hall[r], free, yes)
            if r + 1 < rows:
                _arc(sheet, hall[r], spine[r + 1], free, yes)
        lobby = hall.copy()
        for k in range(lifts):
            if cabin[k, f] < 0:
                continue
            r = (k * rows) // max(lifts, 1)
            stop = _node(sheet, rng, s, 1.5, _SPINE_STEP * r + 12.0 + 0.5 * (k % 3), f, 0.0)
            _arc(sheet, lobby[r], stop, free, yes)  # further lifts of this hall stand behind the first
            lobby[r] = stop
            _lift_arc(sheet, stop, cabin[k, f], lift_costs[0] + lift_costs[1])
            _lift_arc(sheet, cabin[k, f], stop, lift_costs[1])
        far = np.full((2, rows), -1, np.int64)
        length = (rooms + 1) // 2 + 2
        for w in range(wings):
            if rng.random() < 0.5:
                side = w % 2
                far[side, w // 2] = _node(
                    sheet, rng, s, (2 * side - 1) * (_STEP * (length + 1)), _SPINE_STEP * (w // 2), f, 0.4
                )
        is_joined = np.zeros(2, np.bool_)
        for side in range(2):
            last = -1
            for r in range(rows):
                if far[side, r] >= 0:
                    if last >= 0:
                        _arc(sheet, last, far[side, r], free, yes)
                    last = far[side, r]
        for w in range(wings):
            side, r = w % 2, w // 2
            sign = 2 * side - 1
            m = _submap(sheet, s)
            double = rng.random() < 0.33
            through = far[side, r] >= 0
            cut = -1
            if through:
                if is_joined[side] and rng.random() < 0.25:
                    cut = length // 2
                is_joined[side] = True  # the first way through stays whole, and joins the far spine
            first = at[0]
            for i in range(length):
                _node(sheet, rng, m, sign * _STEP * (i + 1), _SPINE_STEP * r, f, 0.4)
            second = at[0]
            if double:
                for i in range(length):
                    _node(sheet, rng, m, sign * _STEP * (i + 1), _SPINE_STEP * r + _APART, f, 0.4)
            _arc(sheet, spine[r], first, free, yes)
            if through:
                _arc(sheet, first + length - 1, far[side, r], free, yes)
            else:
                is_goal[first + length - 1] = True  # a dead end: a seat by the window
            for i in range(length - 1):
                if i != cut:
                    _arc(sheet, first + i, first + i + 1, free, yes)
                if double:
                    one_way = rng.random() < 0.05
                    if i != cut:
                        _arc(sheet, second + i, second + i + 1, free, not one_way)
            if double:
                _arc(sheet, first, second, free, yes)
                _arc(sheet, first + length - 1, second + length - 1, free, yes)
            for band in range(2):
                i, count = 1, 0
                while i < length - 1 and count < (rooms + 1) // 2:
                    count += 1
                    c = _submap(sheet, m)
                    nodes = min(_LARGEST, _SMALLEST + int(rng.exponential(_MORE)))
                    across = int(np.ceil(np.sqrt(nodes)))
                    up = 1.0 if band == 0 else -1.0
                    x, y = sign * _STEP * (i + 1), _SPINE_STEP * r + up * 1.5
                    base = at[0]
                    for j in range(nodes):
                        _node(sheet, rng, c, x + sign * _GRID * (j % across), y + up * _GRID * (j // across), f, 0.3)
                        column, row = j % across, j // across
                        if column > 0:
                            _arc(sheet, base + j - 1, base + j, free, yes)
                        if row > 0 and (column == 0 or rng.random() < 0.4):
                            _arc(sheet, base + j - across, base + j, free, yes)
                        is_goal[base + j] = j == nodes - 1 or (j > 0 and rng.random() < 0.1)
                    door = doors[min(2, int(3.0 * rng.random()))]
                    _arc(sheet, first + i, base, door, yes)
                    chance = rng.random()
                    if chance < 0.125:
                        door = doors[min(2, int(3.0 * rng.random()))]
                        if double and band == 0:
                            _arc(sheet, second + i, base + across * ((nodes - 1) // across), door, yes)
                        elif i + 1 < length - 1 and nodes >= across:
                            i += 1
                            _arc(sheet, first + i, base + across - 1, door, yes)
                    i += 1
    n, m, a = at[0], at[1], at[2]
    return (
        node_submap[:n].copy(),
        xy[:n].copy(),
        level[:n].copy(),
        is_goal[:n].copy(),
        parent[:m].copy(),
        ends[:a].copy(),
        cost[:a].copy(),
        is_lift[:a].copy(),
    )
