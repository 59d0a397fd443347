"""Multi-point turns: from one pose to another where the path over the cells has no room for the footprint.

Hybrid A*: Dolgov, Thrun, Montemerlo and Diebel, "Path Planning for Autonomous Vehicles in Unknown Semi-structured
Environments", Int. J. Robotics Research 29(5), 2010. States are continuous poses, one kept per bin of place and
heading. Steps are straight lines and arcs, forwards and backwards, and, unlike a car's, turns on the spot. In place of
their Reeds-Shepp curve to the goal, the chair tries turn, straight, turn. The cost-to-go estimate is their second
heuristic, the path around obstacles for the axle's middle alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.angles import wrapped
from waychair.calibration.chair_body import ChairBody
from waychair.errors import NoPath
from waychair.geometry import compose
from waychair.maps.grid.distance_field import DistanceField, interpolated
from waychair.planning.body.clearance import COMFORTABLE_MANOEUVRE, PLANNED
from waychair.planning.body.footprint import Footprint, along_arc, footprint, free_time, in_cells, room
from waychair.planning.grid.grid_graph import NO_BARS
from waychair.planning.route.speed_profile import BLIND_SPEED, turn_rate
from waychair.planning.window.motion_limits import DwaSettings
from waychair.resumable import Resumable, finished
from waychair.types import Bytes, Float32Array, FloatArray, Pose2

_LIMITS = DwaSettings()

_STEP = 2.0
"""Length of one step in sides of a bin: longer than a bin's diagonal."""
_SPACING = 0.05
"""Distance [m] of the poses of the path."""

_SWEEP, _CONNECTION = 4, 40
"""Times of checking a whole step, and of trying the goal forwards and backwards, in units of one pose's check."""


CLOSE_PRICE = 1.5
"""A step without any of the comfortable clearance costs this much more, per its price."""

SPEED, GEAR_PRICE = 0.4, 0.5
"""[m/s] About the speed of a metre driven forwards, and the price in such metres of a change between forwards, backwards and
turning. Reversing and turning have the price of the time for which the rear corners, which no sensor sees, move outwards."""

STEER_PRICE = 0.3
"""[m/rad] Price of changing a step's turn while driving: the chair follows such changes late."""

GREED = 1.2
"""Weight of the cost-to-go estimate: larger is faster, and paths get longer."""

MOST_STATES = 60_000
"""Number of states after which the search gives up."""

POLISH = 8000
"""States expanded for a better path once one is known."""

CHECKS_PER_STEP = 8000
"""Pose checks in one control period."""


@dataclass(frozen=True, slots=True)
class ManoeuvreAttempt:
    """One attempt to find a multi-point turn."""

    clearance: float = PLANNED
    """[m] Kept around the footprint."""
    bin: float = 0.05
    """[m] Side of a bin of places, half a step."""
    headings: int = 72
    """Number of bins of the heading."""


def manoeuvre(
    field: DistanceField,
    body: ChairBody,
    start: Pose2,
    goal: Pose2,
    attempt: ManoeuvreAttempt = ManoeuvreAttempt(),
    barred: Bytes = NO_BARS,
    polish: int = POLISH,
) -> FloatArray:
    """Return poses (N, 3) [m, m, rad] in map from a start to a goal, with the footprint free all along.

    Headings are the body's: movement against the heading is reversing, and two poses at one place are a turn on the
    spot. The field bounds the search. `barred` on its cells holds the directions barred by one-way zones, as bits as in
    `grid_graph`; (0, 0) where there is none. polish: states expanded for a better path once one is known.

    Raises:
        NoPath: the chair does not fit at one of the ends, or no such path was found.
    """
    return finished(
        manoeuvre_resumably(
            field=field, body=body, start=start, goal=goal, attempt=attempt, barred=barred, polish=polish
        )
    )


def manoeuvre_resumably(
    field: DistanceField,
    body: ChairBody,
    start: Pose2,
    goal: Pose2,
    attempt: ManoeuvreAttempt = ManoeuvreAttempt(),
    barred: Bytes = NO_BARS,
    polish: int = POLISH,
) -> Resumable[FloatArray]:
    """Do `manoeuvre` resumably, with a bounded part of the search at each step for use in a control loop."""
    shape = footprint(body, attempt.clearance, field)
    begin, end = in_cells(field, start), in_cells(field, goal)
    for name, at, pose in (("start", begin, start), ("end", end, goal)):
        if room(shape, at[0], at[1], at[2], 0.0) < 0.0:
            raise NoPath(
                f"the chair has no room at the {name} of a tight turn ({pose.x:.2f}, {pose.y:.2f}); "
                "clear the way or choose another goal"
            )
    cell = field.resolution
    axle = min(body.width / 2, body.rear, body.front) / cell
    ways = _distances_to((field.metres / cell).astype(np.float32), end, attempt.bin / cell, axle)
    yield
    prices = np.array(
        [
            SPEED / BLIND_SPEED,
            SPEED / turn_rate(body, _LIMITS),
            GEAR_PRICE,
            GREED,
            COMFORTABLE_MANOEUVRE,
            CLOSE_PRICE,
            math.tau / attempt.headings,
            STEER_PRICE,
            body.width / 2,
        ]
    )
    side = attempt.bin / cell
    known = _new_search(begin, ways, side, attempt.headings, MOST_STATES)
    while _search(shape, barred, end, ways, side, prices, MOST_STATES, polish, CHECKS_PER_STEP, *known):
        yield
    if known.tally[_PARENT] < 0:
        raise NoPath(
            f"the chair cannot turn from ({start.x:.2f}, {start.y:.2f}) to ({goal.x:.2f}, {goal.y:.2f}): it does not "
            "fit; clear the way or choose another goal"
        )
    chain = _chain(known.states, known.parents, int(known.tally[_PARENT]), end, int(known.tally[_KIND]))
    return _poses(field, chain, start, goal)


class _SearchState(NamedTuple):
    """The state of a search.

    best (rows, columns, headings): price of each bin, 0 for unknown (untouched pages then take no memory). states
    (N, 6): x, y [cells], theta [rad], gear, and the distance [cells] and turn [rad] that led there, with costs and
    parents. A binary heap of states. tally: `_COUNT` of states, `_QUEUED` in the heap, `_COST`, `_PARENT` and `_KIND`
    of the best connection to the goal, and the number of states `_LEFT` to expand.
    """

    best: Float32Array
    states: FloatArray
    costs: FloatArray
    parents: NDArray[np.int64]
    heap_keys: FloatArray
    heap_ids: NDArray[np.int64]
    tally: FloatArray


_COUNT, _QUEUED, _COST, _PARENT, _KIND, _LEFT = range(6)


def _new_search(start: FloatArray, ways: FloatArray, side: float, headings: int, most: int) -> _SearchState:
    """Return the state of a search with the start alone; nothing is queued if the start is not connected."""
    capacity = most + 64
    states = np.empty((capacity, 6))
    states[0] = (*start, 2.0, 0.0, 0.0)
    reachable = ways[math.floor(start[1] / side), math.floor(start[0] / side)] < np.inf
    return _SearchState(
        best=np.zeros((*ways.shape, headings), np.float32),
        states=states,
        costs=np.zeros(capacity),
        parents=np.full(capacity, -1, np.int64),
        heap_keys=np.zeros(capacity),
        heap_ids=np.zeros(capacity, np.int64),
        tally=np.array([1.0, float(reachable), np.inf, -1.0, 0.0, np.inf]),
    )


def _poses(field: DistanceField, chain: FloatArray, start: Pose2, goal: Pose2) -> FloatArray:
    """Return poses every 5 cm through a chain of states (N, 6), turns on the spot as two poses."""
    cell, rows = field.resolution, [start.array()]
    for before, state in pairwise(chain):
        way, turn = state[4] * cell, state[5]
        if way == 0.0:
            x, y, theta = rows[-1]
            if len(rows) > 1 and np.array_equal(rows[-1][:2], rows[-2][:2]):
                rows.pop()  # consecutive turning steps are one turn
            rows.append(np.array([x, y, theta + turn]))
            continue
        count = max(1, math.ceil(abs(way) / _SPACING))
        origin = compose(field.map_from_grid.array(), np.array([before[0] * cell, before[1] * cell, before[2]]))
        for k in range(1, count + 1):
            x, y, theta = along_arc(origin[0], origin[1], origin[2], way, turn, k / count)
            rows.append(np.array([x, y, theta]))
    poses = np.array(rows)
    poses[-1] = goal.array()
    if len(poses) > 1 and chain[-1, 4] == 0.0:
        poses[-2, :2] = poses[-1, :2]
    return poses


@njit(cache=True, nogil=True)
def _distances_to(clearance: Float32Array, goal: FloatArray, side: float, least: float) -> FloatArray:
    """Return (rows, columns) each bin's distance [cells] to the goal over bins with a clearance [cells] of `least`.

    Eight neighbours, relaxed repeatedly in both directions until nothing changes; infinite where not connected.
    """
    height, width = clearance.shape
    rows, columns = math.ceil(height / side), math.ceil(width / side)
    ways = np.full((rows, columns), np.inf)
    free = np.zeros((rows, columns), np.bool_)
    for i in range(rows):
        for j in range(columns):
            free[i, j] = interpolated(clearance, (j + 0.5) * side, (i + 0.5) * side) + side >= least
    ways[int(goal[1] / side), int(goal[0] / side)] = 0.0
    changed = True
    while changed:
        changed = False
        for sweep in range(2):
            for a in range(rows):
                i = a if sweep == 0 else rows - 1 - a
                for b in range(columns):
                    j = b if sweep == 0 else columns - 1 - b
                    if not free[i, j]:
                        continue
                    least_way = ways[i, j]
                    for di in range(-1, 2):
                        for dj in range(-1, 2):
                            if 0 <= i + di < rows and 0 <= j + dj < columns:
                                step = side * math.sqrt(di * di + dj * dj)
                                least_way = min(least_way, ways[i + di, j + dj] + step)
                    if least_way < ways[i, j] - 1e-9:
                        ways[i, j] = least_way
                        changed = True
    return ways


@njit(cache=True, nogil=True)
def _search(
    shape: Footprint,
    barred: Bytes,
    goal: FloatArray,
    ways: FloatArray,
    side: float,
    prices: FloatArray,
    most: int,
    polish: int,
    slice_: int,
    best: Float32Array,
    states: FloatArray,
    costs: FloatArray,
    parents: NDArray[np.int64],
    heap_keys: FloatArray,
    heap_ids: NDArray[np.int64],
    tally: FloatArray,
) -> bool:
    """Expand states until `slice_` pose checks have been done; return whether there are more states to expand.

    The state is that of `_SearchState`. At most `most` states are made, and at most `polish` expanded once a path is
    known. prices: reverse, turn, gear, greed, roomy, close (see the constants), the angle of a bin of headings, steer, and half
    the chair's width [m], the lever of a rear corner.
    """
    cell, greed, angle = shape.cell, prices[3], prices[6]
    rows, columns = ways.shape
    count, queued, checked = int(tally[_COUNT]), int(tally[_QUEUED]), 0
    while checked < slice_ and queued > 0:
        key, here = heap_keys[0], heap_ids[0]
        queued = _pop(heap_keys, heap_ids, queued)
        tally[_LEFT] -= 1.0
        checked += 1
        if key >= tally[_COST] or tally[_LEFT] < 0.0:
            queued = 0
            break
        x, y, theta, gear = states[here, 0], states[here, 1], states[here, 2], states[here, 3]
        i, j, k = _bin(x, y, theta - goal[2], side, angle)
        if costs[here] > best[i, j, k] + 1e-4 and here != 0:
            continue
        left = math.hypot(goal[0] - x, goal[1] - y) * cell
        if left < 0.4 or here % 8 == 0:  # far from the goal a direct connection is tried rarely
            checked += _CONNECTION
            for kind in (1, -1):
                cost = costs[here] + _connection(shape, barred, states[here], goal, kind, prices)
                if cost < tally[_COST]:
                    tally[_COST], tally[_PARENT], tally[_KIND] = cost, here, kind
                    tally[_LEFT] = min(tally[_LEFT], polish)
        for move in range(12):
            way, turn = _move(move, side, angle)
            nx, ny, ntheta = along_arc(x, y, theta, way, turn, 1.0)
            i, j, k = _bin(nx, ny, ntheta - goal[2], side, angle)
            if not (0 <= i < rows and 0 <= j < columns) or ways[i, j] == np.inf:
                continue
            if _is_barred(barred, x, y, theta, way, turn):
                continue
            # the expensive check of the whole step comes last
            known = best[i, j, k] - 1e-4 if best[i, j, k] > 0.0 else np.inf
            least = costs[here] + _least_price(way * cell, turn, gear, prices)
            if way != 0.0 and gear == _gear(way):
                least += prices[7] * abs(turn - states[here, 5])
            if least >= known or count >= most:
                continue
            checked += 1
            spare = room(shape, nx, ny, ntheta, prices[4] / cell) * cell
            cost = least + _tight_price(spare, way * cell, turn, prices)
            if cost >= known or (spare < 0.0 and room(shape, nx, ny, ntheta, 0.0) < 0.0):
                continue
            checked += _SWEEP
            if free_time(shape, states[here, :3], way, turn, 1.0, 1.0) < 1.0:
                continue
            best[i, j, k] = cost
            _note(states, count, nx, ny, ntheta, _gear(way), way, turn)
            costs[count], parents[count] = cost, here
            off = abs(wrapped(goal[2] - ntheta))
            estimate = max(ways[i, j] * cell, prices[1] * off)
            queued = _push(heap_keys, heap_ids, queued, cost + greed * estimate, count)
            count += 1
    tally[_COUNT], tally[_QUEUED] = count, queued
    return queued > 0


@njit(cache=True)
def _note(states: FloatArray, k: int, x: float, y: float, theta: float, gear: float, way: float, turn: float) -> None:
    states[k, 0], states[k, 1], states[k, 2], states[k, 3], states[k, 4], states[k, 5] = x, y, theta, gear, way, turn


@njit(cache=True)
def _gear(way: float) -> float:
    """Return 1 forwards, -1 backwards, 0 for a turn on the spot; the start has 2: any gear is free there."""
    return 0.0 if way == 0.0 else math.copysign(1.0, way)


@njit(cache=True)
def _move(move: int, side: float, angle: float) -> tuple[float, float]:
    """Return distance [cells] and turn [rad] of a step: five forwards, five backwards, two on the spot."""
    if move >= 10:
        return 0.0, angle if move == 10 else -angle
    return _STEP * side if move < 5 else -_STEP * side, (move % 5 - 2) * angle


@njit(cache=True)
def _bin(x: float, y: float, off: float, side: float, angle: float) -> tuple[int, int, int]:
    """Return row, column and heading of a state's bin; headings are counted from the goal's."""
    heading = round(off / angle) % round(math.tau / angle)
    return math.floor(y / side), math.floor(x / side), heading


@njit(cache=True)
def _price(
    shape: Footprint, x: float, y: float, theta: float, way: float, turn: float, gear: float, prices: FloatArray
) -> float:
    """Return the price [m] of a step that ends at a pose."""
    spare = room(shape, x, y, theta, prices[4] / shape.cell) * shape.cell
    return float(_least_price(way, turn, gear, prices) + _tight_price(spare, way, turn, prices))


@njit(cache=True)
def _tight_price(spare: float, way: float, turn: float, prices: FloatArray) -> float:
    """Return the extra price [m] of a step that ends with so much room [m]."""
    return float(_drive_price(way, turn, prices) * prices[5] * (1.0 - min(max(spare, 0.0) / prices[4], 1.0)))


@njit(cache=True)
def _least_price(way: float, turn: float, gear: float, prices: FloatArray) -> float:
    """Return the price [m] of a step where there is room, its lower bound."""
    return float(_drive_price(way, turn, prices) + (prices[2] if gear != _gear(way) and gear != 2.0 else 0.0))


@njit(cache=True)
def _drive_price(way: float, turn: float, prices: FloatArray) -> float:
    if way == 0.0:
        return float(prices[1] * abs(turn))
    driven = way if way > 0.0 else prices[0] * (prices[8] * abs(turn) - way)
    return float(max(driven, prices[1] * abs(turn)))


@njit(cache=True)
def _connection_angles(state: FloatArray, goal: FloatArray, kind: int) -> tuple[float, float, float]:
    """Return turn [rad], distance [cells] and turn [rad] to the goal, forwards (kind 1) or backwards (-1)."""
    dx, dy = goal[0] - state[0], goal[1] - state[1]
    way = math.hypot(dx, dy)
    if way < 1e-6:
        return 0.0, 0.0, wrapped(goal[2] - state[2])
    heading = math.atan2(dy, dx) + (0.0 if kind == 1 else math.pi)
    return wrapped(heading - state[2]), kind * way, wrapped(goal[2] - heading)


@njit(cache=True)
def _connection(
    shape: Footprint, barred: Bytes, state: FloatArray, goal: FloatArray, kind: int, prices: FloatArray
) -> float:
    """Return the price [m] of turn, straight, turn to the goal; infinite where it is not free, or barred."""
    first, way, last = _connection_angles(state, goal, kind)
    x, y, theta, price, gear = state[0], state[1], state[2], 0.0, state[3]
    for part in range(3):
        v, turn = (way, 0.0) if part == 1 else (0.0, first if part == 0 else last)
        if abs(v) < 1e-9 and abs(turn) < 1e-6:
            continue
        at = np.array([x, y, theta])
        if _is_barred(barred, x, y, theta, v, turn) or free_time(shape, at, v, turn, 1.0, 1.0) < 1.0:
            return math.inf
        x, y, theta = along_arc(x, y, theta, v, turn, 1.0)
        price += _price(shape, x, y, theta, v * shape.cell, turn, gear, prices)
        gear = _gear(v)
    return price


@njit(cache=True)
def _is_barred(barred: Bytes, x: float, y: float, theta: float, way: float, turn: float) -> bool:
    """Return whether a step of a distance [cells] and turn [rad] from a pose goes in a direction barred under it."""
    if barred.size == 0 or way == 0.0:
        return False
    count = math.ceil(abs(way)) + 1
    for k in range(count):
        px, py, heading = along_arc(x, y, theta, way, turn, k / (count - 1))
        row, column = math.floor(py), math.floor(px)
        if 0 <= row < barred.shape[0] and 0 <= column < barred.shape[1]:
            travel = heading if way > 0.0 else heading + math.pi
            if barred[row, column] >> (round(travel / (math.pi / 4)) % 8) & 1:
                return True
    return False


@njit(cache=True)
def _chain(states: FloatArray, parents: NDArray[np.int64], last: int, goal: FloatArray, kind: int) -> FloatArray:
    """Return the states from the start to `last`, followed by turn, straight, turn to the goal."""
    length, here = 0, last
    while here >= 0:
        length, here = length + 1, parents[here]
    chain = np.empty((length + 3, 6))
    here = last
    for index in range(length - 1, -1, -1):
        for part in range(6):
            chain[index, part] = states[here, part]
        here = parents[here]
    first, way, turn = _connection_angles(states[last], goal, kind)
    used = length
    for part in range(3):
        v, omega = (way, 0.0) if part == 1 else (0.0, first if part == 0 else turn)
        if abs(v) < 1e-9 and abs(omega) < 1e-6:
            continue
        before = chain[used - 1]
        x, y, theta = along_arc(before[0], before[1], before[2], v, omega, 1.0)
        chain[used, 0], chain[used, 1], chain[used, 2] = x, y, theta
        chain[used, 3], chain[used, 4], chain[used, 5] = 0.0, v, omega
        used += 1
    return chain[:used].copy()


@njit(cache=True)
def _push(keys: FloatArray, ids: NDArray[np.int64], count: int, key: float, identity: int) -> int:
    """Push a state into a binary heap; return its new size."""
    place = count
    while place > 0 and keys[(place - 1) // 2] > key:
        keys[place], ids[place] = keys[(place - 1) // 2], ids[(place - 1) // 2]
        place = (place - 1) // 2
    keys[place], ids[place] = key, identity
    return count + 1


@njit(cache=True)
def _pop(keys: FloatArray, ids: NDArray[np.int64], count: int) -> int:
    """Pop the least state from a binary heap; return its new size."""
    count -= 1
    key, identity = keys[count], ids[count]
    place = 0
    while 2 * place + 1 < count:
        child = 2 * place + 1
        if child + 1 < count and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[place], ids[place] = keys[child], ids[child]
        place = child
    keys[place], ids[place] = key, identity
    return count
