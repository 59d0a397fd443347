"""A first way between two poses: A* over (x, y, heading, gear) by a rough time, with the chair's exact outline.

The states are continuous; one is kept for each cell of place, heading and gear (hybrid A*: Dolgov, Thrun, Montemerlo
and Diebel, IJRR 2010). Moves are arcs of both gears and turns on the spot. A move costs its length over the speed that
comfort allows on it; starting and stopping cost what their ramps lose. From states near the goal, a turn, a straight
line and a turn are tried as the end.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from evaluation.best_time.comfort import Comfort
from evaluation.best_time.gaps import BoxesRound, is_free
from waychair.errors import NoPath
from waychair.maps.grid.distance_field import distances
from waychair.simulation.scene.boxes import touch
from waychair.types import BoolArray, Float32Array, FloatArray, IntArray, Pose2

_RASTER = 0.05
"""[m] Side of the cells on which distances to the boxes and to the goal are measured."""

_ROOM_ROUND = 3.0
"""[m] Without walls, the search may leave the rectangle of start and goal by so much."""

_CELLS = (0.1, 0.05)
"""[m] Side of a cell of places, in turn: the second where the first finds no way."""

_HEADINGS = 72
"""Cells of heading in a full turn."""

_STEP = 0.15
"""[m] Length of an arc: it leaves a cell of the larger side along either diagonal."""

_CHECKED = 0.04
"""[m] Distance that the farthest corner moves between two checked poses."""

_GREED = 1.2
"""Weight of the distance left: a way up to so much longer is found much sooner, and smoothed anyway."""

_END_FROM = 2.5
"""[m] From states nearer to the goal than this, a straight end is tried."""

_AT_GOAL, _AT_GOAL_HEADING = 0.05, 0.05
"""[m], [rad] A state so near is the goal: less than the tolerances of a drive, and smoothing moves it there."""

_MOST_STATES = 2_000_000
"""States after which a search gives up: some 130 MB."""

_ROUNDING = 1e-3
"""[s] Two times that differ by less are the same: the best times are stored in single precision."""

_STAND, _FORWARD, _BACK = 0, 1, 2
_NO_STATE = -1


@dataclass(frozen=True, slots=True)
class FirstWay:
    """A way as arcs from its start: moves (M, 2) of signed length [m] and turn [rad], and its rough time [s]."""

    start: Pose2
    moves: FloatArray
    seconds: float


class _Raster(NamedTuple):
    """Distances (H, W) [m] to the boxes and along the floor to the goal, in cells of `_RASTER` from (x, y) [m]."""

    x: float
    y: float
    clear: Float32Array
    left: Float32Array


class _Costs(NamedTuple):
    """Moves (M, 2), their seconds (M,) and gear (M,); seconds lost by starting and stopping in each gear (3,)."""

    moves: FloatArray
    seconds: FloatArray
    gears: IntArray
    begin: FloatArray
    end: FloatArray
    speed: float
    reverse: float
    turn_rate: float


def first_way(around: BoxesRound, start: Pose2, goal: Pose2, comfort: Comfort) -> FirstWay:
    """Return a way between two poses for the exact outline; its last pose is within 5 cm and 0.05 rad of the goal.

    Raises:
        NoPath: the chair touches something at the start or the goal, or no way was found between them.
    """
    for name, pose in (("start", start), ("goal", goal)):
        if not is_free(around, pose.x, pose.y, pose.theta):
            raise NoPath(f"the chair touches something at the {name} ({pose.x:g}, {pose.y:g}): choose another one")
    raster = _raster(around, start, goal)
    costs = _costs(comfort)
    for side in _CELLS:
        moves, seconds = _search(around, raster, costs, side, start.array(), goal.array())
        if len(moves):
            return FirstWay(start, moves[::-1].copy(), seconds)
    raise NoPath(f"no way was found to ({goal.x:g}, {goal.y:g}) on cells of {_CELLS[-1]:g} m: choose another goal")


def _costs(comfort: Comfort) -> _Costs:
    moves, seconds, gears = [], [], []
    widest = comfort.speed**2 / comfort.lateral  # m; radius at which full speed is still comfortable
    for curvature in (0.0, 1 / widest, 1.6, 3.2):
        for bend in {curvature, -curvature}:
            turning = comfort.turn_rate / max(abs(bend), 1e-9)
            ahead = min(comfort.speed, math.sqrt(comfort.lateral / max(abs(bend), 1e-9)), turning)
            for gear, sign, speed in ((_FORWARD, 1.0, ahead), (_BACK, -1.0, min(comfort.reverse, turning))):
                if speed > 0.0:
                    moves.append((sign * _STEP, _STEP * bend))
                    seconds.append(_STEP / speed)
                    gears.append(gear)
    turn = 2 * math.pi / _HEADINGS
    for angle in (turn, -turn, 3 * turn, -3 * turn):
        moves.append((0.0, angle))
        seconds.append(abs(angle) / comfort.turn_rate)
        gears.append(_STAND)
    share = 0.7  # of a full ramp: short moves do not reach full speed
    begin = [share * speed / comfort.acceleration / 2 + 0.3 for speed in (0.0, comfort.speed, comfort.reverse)]
    end = [share * speed / comfort.braking / 2 + 0.3 for speed in (0.0, comfort.speed, comfort.reverse)]
    begin[_STAND] = end[_STAND] = 0.0
    return _Costs(
        np.array(moves),
        np.array(seconds),
        np.array(gears, np.int64),
        np.array(begin),
        np.array(end),
        comfort.speed,
        comfort.reverse,
        comfort.turn_rate,
    )


def _raster(around: BoxesRound, start: Pose2, goal: Pose2) -> _Raster:
    points = np.array([(start.x, start.y), (goal.x, goal.y)])
    low, high = points.min(axis=0) - _ROOM_ROUND, points.max(axis=0) + _ROOM_ROUND
    if len(around.boxes):
        reach = np.hypot(around.boxes[:, 4], around.boxes[:, 5])[:, None]
        low = np.minimum(low, (around.boxes[:, :2] - reach).min(axis=0))
        high = np.maximum(high, (around.boxes[:, :2] + reach).max(axis=0))
    columns, rows = (int(count) for count in np.ceil((high - low) / _RASTER) + 1)
    clear = distances(_solid_cells(around.boxes, low[0], low[1], rows, columns), _RASTER)
    inner = min(around.half_width, around.half_length - abs(around.ahead))  # of the body, round the axle's middle
    open_floor = clear > inner - 1.5 * _RASTER
    left = _floor_distances(open_floor, int((goal.y - low[1]) / _RASTER), int((goal.x - low[0]) / _RASTER))
    return _Raster(float(low[0]), float(low[1]), clear, left)


@njit(cache=True, nogil=True)
def _solid_cells(boxes: FloatArray, x: float, y: float, rows: int, columns: int) -> BoolArray:
    """Return (rows, columns) the cells that a box touches."""
    solid = np.zeros((rows, columns), np.bool_)
    for k in range(len(boxes)):
        box = boxes[k]
        reach_x = box[4] * abs(box[2]) + box[5] * abs(box[3])
        reach_y = box[4] * abs(box[3]) + box[5] * abs(box[2])
        for row in range(max(int((box[1] - reach_y - y) / _RASTER), 0), rows):
            if y + row * _RASTER > box[1] + reach_y:
                break
            for column in range(max(int((box[0] - reach_x - x) / _RASTER), 0), columns):
                if x + column * _RASTER > box[0] + reach_x:
                    break
                half = _RASTER / 2
                cell = np.array([x + column * _RASTER + half, y + row * _RASTER + half, 1.0, 0.0, half, half])
                if touch(cell, box):
                    solid[row, column] = True
    return solid


@njit(cache=True, nogil=True)
def _floor_distances(open_floor: BoolArray, row: int, column: int) -> Float32Array:
    """Return (H, W) distances [m] to a cell over open cells, in eight directions (Dijkstra); +inf where there is none."""
    height, width = open_floor.shape
    left = np.full((height, width), np.inf, np.float32)
    left[row, column] = 0.0
    heap = [(np.float32(0.0), row * width + column)]
    while heap:
        far, cell = heapq.heappop(heap)
        i, j = cell // width, cell % width
        if far > left[i, j]:
            continue
        for di in range(-1, 2):
            for dj in range(-1, 2):
                a, b = i + di, j + dj
                if 0 <= a < height and 0 <= b < width and open_floor[a, b]:
                    farther = np.float32(far + _RASTER * math.sqrt(di * di + dj * dj))
                    if farther < left[a, b]:
                        left[a, b] = farther
                        heapq.heappush(heap, (farther, a * width + b))
    return left


@njit(cache=True, nogil=True)
def after(x: float, y: float, theta: float, length: float, turn: float) -> tuple[float, float, float]:
    """Return the pose after an arc of a signed length [m] and a turn [rad]; theta is not wrapped."""
    half = turn / 2
    chord = length * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    return x + chord * math.cos(theta + half), y + chord * math.sin(theta + half), theta + turn


@njit(cache=True, nogil=True)
def _is_clear(
    around: BoxesRound, raster: _Raster, x: float, y: float, theta: float, length: float, turn: float
) -> bool:
    """Return whether the chair is free along an arc, its end included."""
    reach = abs(around.ahead) + math.hypot(around.half_length, around.half_width)
    steps = max(1, math.ceil((abs(length) + reach * abs(turn)) / _CHECKED))
    height, width = raster.clear.shape
    k = 1
    while k <= steps:
        share = k / steps
        px, py, heading = after(x, y, theta, share * length, share * turn)
        row, column = int((py - raster.y) / _RASTER), int((px - raster.x) / _RASTER)
        if not (0 <= row < height and 0 <= column < width):
            return False
        spare = raster.clear[row, column] - 1.5 * _RASTER - reach
        if spare > 0.0:  # the circle that the chair turns in is free: so are the next poses up to so far away
            k += 1 + int(spare / _CHECKED)
        elif is_free(around, px, py, heading):
            k += 1
        else:
            return False
    return True


@njit(cache=True, nogil=True)
def _search(
    around: BoxesRound, raster: _Raster, costs: _Costs, side: float, start: FloatArray, goal: FloatArray
) -> tuple[FloatArray, float]:
    """Return the moves (M, 2) from the goal back to the start, and their rough time [s]; no moves: no way."""
    height, width = raster.left.shape
    rows, columns = int(height * _RASTER / side) + 1, int(width * _RASTER / side) + 1
    best = np.full(rows * columns * _HEADINGS * 3, np.inf, np.float32)
    states = np.empty((1024, 3))
    seconds, gears = np.empty(1024), np.empty(1024, np.int64)
    parents, arrived = np.empty(1024, np.int64), np.empty((1024, 2))
    states[0], seconds[0], gears[0], parents[0] = start, 0.0, _STAND, _NO_STATE
    count = 1
    heap = [(0.0, 0)]
    end_state, end_seconds = _NO_STATE, math.inf
    end_moves = np.zeros((3, 2))
    while heap and count < _MOST_STATES:
        guess, here = heapq.heappop(heap)
        if guess >= end_seconds:
            break
        x, y, theta = states[here]
        key = _cell(raster, side, columns, x, y, theta) * 3 + gears[here]
        if seconds[here] > best[key] + _ROUNDING:
            continue
        away = math.hypot(goal[0] - x, goal[1] - y)
        turn_left = abs(_wrapped(goal[2] - theta))
        if away < _AT_GOAL and turn_left < _AT_GOAL_HEADING:
            arrives = seconds[here] + costs.end[gears[here]]
            if arrives < end_seconds:
                end_state, end_seconds, end_moves[:] = here, arrives, 0.0
        if away < _END_FROM:
            for backwards in range(2):
                time, end = _straight_end(around, raster, costs, x, y, theta, gears[here], goal, backwards == 1)
                if seconds[here] + time < end_seconds:
                    end_state, end_seconds, end_moves = here, seconds[here] + time, end
        for move in range(len(costs.moves)):
            length, turn = costs.moves[move]
            gear = costs.gears[move]
            time = seconds[here] + costs.seconds[move]
            if gear != gears[here]:
                time += costs.end[gears[here]] + costs.begin[gear]
            nx, ny, heading = after(x, y, theta, length, turn)
            heading = _wrapped(heading)
            row, column = int((ny - raster.y) / _RASTER), int((nx - raster.x) / _RASTER)
            if not (0 <= row < height and 0 <= column < width) or not raster.left[row, column] < np.inf:
                continue
            key = _cell(raster, side, columns, nx, ny, heading) * 3 + gear
            if time > best[key] - _ROUNDING or not _is_clear(around, raster, x, y, theta, length, turn):
                continue
            best[key] = time
            if count == len(seconds):
                states, arrived = np.concatenate((states, states)), np.concatenate((arrived, arrived))
                seconds, gears = np.concatenate((seconds, seconds)), np.concatenate((gears, gears))
                parents = np.concatenate((parents, parents))
            states[count, 0], states[count, 1], states[count, 2] = nx, ny, heading
            arrived[count, 0], arrived[count, 1] = length, turn
            seconds[count], gears[count], parents[count] = time, gear, here
            left = max(raster.left[row, column] / costs.speed, abs(_wrapped(goal[2] - heading)) / costs.turn_rate)
            heapq.heappush(heap, (time + _GREED * left + costs.end[gear], count))
            count += 1
    if end_state == _NO_STATE:
        return np.empty((0, 2)), end_seconds
    return _moves_back(end_moves, end_state, parents, arrived), end_seconds


@njit(cache=True, nogil=True)
def _moves_back(end_moves: FloatArray, end_state: int, parents: IntArray, arrived: FloatArray) -> FloatArray:
    """Return the moves (M, 2), at least one, from the goal back to the start: the end's, then those of the states."""
    moves = [end_moves[2], end_moves[1], end_moves[0]]
    while parents[end_state] != _NO_STATE:
        moves.append(arrived[end_state])
        end_state = parents[end_state]
    back = np.zeros((len(moves), 2))
    count = 0
    for move in moves:
        if move[0] != 0.0 or move[1] != 0.0:
            back[count] = move
            count += 1
    return back[: max(count, 1)].copy()


@njit(cache=True, nogil=True)
def _cell(raster: _Raster, side: float, columns: int, x: float, y: float, theta: float) -> int:
    """Return the index of the cell of place and heading that a state lies in."""
    place = int((y - raster.y) / side) * columns + int((x - raster.x) / side)
    return place * _HEADINGS + math.floor(theta * _HEADINGS / (2 * math.pi) + 0.5) % _HEADINGS


@njit(cache=True, nogil=True)
def _straight_end(
    around: BoxesRound,
    raster: _Raster,
    costs: _Costs,
    x: float,
    y: float,
    theta: float,
    gear: int,
    goal: FloatArray,
    backwards: bool,
) -> tuple[float, FloatArray]:
    """Return the time [s] and moves (3, 2) of a turn, a straight line and a turn to the goal; +inf where it is not free."""
    moves = np.zeros((3, 2))
    away = math.hypot(goal[0] - x, goal[1] - y)
    if away < 1e-6:
        moves[0, 1] = _wrapped(goal[2] - theta)
    else:
        bearing = math.atan2(goal[1] - y, goal[0] - x) + (math.pi if backwards else 0.0)
        moves[0, 1] = _wrapped(bearing - theta)
        moves[1, 0] = -away if backwards else away
        moves[2, 1] = _wrapped(goal[2] - bearing)
    drives = _BACK if backwards else _FORWARD
    speed = costs.reverse if backwards else costs.speed
    if speed <= 0.0:
        return math.inf, moves
    time = (abs(moves[0, 1]) + abs(moves[2, 1])) / costs.turn_rate + away / speed + costs.end[drives]
    if abs(moves[0, 1]) > 0.02 or gear != drives:
        time += costs.end[gear] + costs.begin[drives]
    for k in range(3):
        if not _is_clear(around, raster, x, y, theta, moves[k, 0], moves[k, 1]):
            return math.inf, moves
        x, y, theta = after(x, y, theta, moves[k, 0], moves[k, 1])
    return time, moves


@njit(cache=True, nogil=True)
def _wrapped(angle: float) -> float:
    return angle - 2 * math.pi * math.floor((angle + math.pi) / (2 * math.pi))


def timed(way: FirstWay, comfort: Comfort, spacing_s: float, most: int) -> tuple[float, FloatArray]:
    """Return the rough time [s] of a way, and x, y, theta and the distance driven (N + 1, 4) at equal times on it.

    Speeds keep the limits of speed, acceleration and bends, without jerk; they are zero where a turn on the spot or the
    other gear begins. There is one row each `spacing_s` [s], at most `most` + 1.
    """
    parts = _parts(way, comfort)
    kinds, lengths, limits, rates = parts.T[:4]
    speeds = np.zeros(len(parts) + 1)
    speeds[1:-1] = np.where(kinds[1:] == kinds[:-1], np.minimum(limits[1:], limits[:-1]), 0.0)
    for k in range(len(parts)):
        speeds[k + 1] = min(speeds[k + 1], math.sqrt(speeds[k] ** 2 + 2 * rates[k] * lengths[k]))
    for k in range(len(parts) - 1, -1, -1):
        speeds[k] = min(speeds[k], math.sqrt(speeds[k + 1] ** 2 + 2 * rates[k] * lengths[k]))
    both = speeds[1:] + speeds[:-1]
    moves = both > 1e-9
    seconds = np.where(moves, 2 * lengths / np.where(moves, both, 1.0), 2 * np.sqrt(lengths / rates))
    times = np.concatenate([[0.0], np.cumsum(seconds)])
    total = max(float(times[-1]), _SHORTEST_S)
    count = min(max(_LEAST_KNOTS, math.ceil(total / spacing_s)), most)
    rows = np.vstack([[way.start.x, way.start.y, way.start.theta, 0.0], parts[:, 4:]])
    at = np.linspace(0.0, times[-1], count + 1)
    return total, np.column_stack([np.interp(at, times, column) for column in rows.T])


def _parts(way: FirstWay, comfort: Comfort) -> FloatArray:
    """Return a way in short parts (P, 8): kind, length, limit, acceleration; x, y, theta and distance at its end.

    The kind is 1 forwards, -1 backwards, 0 for a turn on the spot, whose lengths are angles.
    """
    parts = []
    x, y, theta, driven = way.start.x, way.start.y, way.start.theta, 0.0
    for length, turn in way.moves.tolist():
        if length:
            bend = max(abs(turn / length), 1e-9)
            fastest = comfort.speed if length > 0 else comfort.reverse
            limit = min(fastest, math.sqrt(comfort.lateral / bend), comfort.turn_rate / bend)
            kind, size, rate = math.copysign(1.0, length), abs(length), comfort.acceleration
        else:
            kind, size, rate, limit = 0.0, abs(turn), comfort.turn_acceleration, comfort.turn_rate
        count = max(1, math.ceil(size / _PART))
        for share in np.arange(1, count + 1) / count:
            end = after(x, y, theta, share * length, share * turn)
            parts.append((kind, size / count, limit, rate, *end, driven + share * length))
        x, y, theta = after(x, y, theta, length, turn)
        driven += length
    return np.array(parts)


_PART = 0.05
"""[m], [rad] Length of a short part of a way."""

_SHORTEST_S, _LEAST_KNOTS = 0.5, 24
"""[s] and count: a way that is hardly one still has so many intervals in so much time."""
