"""Shortcuts through a multi-point turn: bands between its poses where they take less time than the search's steps.

The search keeps one state for each bin, so its way wanders and stops more often than need be. A band from one of its poses
to a later one, forwards or backwards, after a turn on the spot or without one, is one drive in place of several. The
soonest chain of drives is found by dynamic programming over the poses.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import arc_lengths, wrap_angle
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.clearance import PLANNED, PLANNED_TURN
from waychair.planning.body.footprint import fits
from waychair.planning.grid.fine_distances import fine_field
from waychair.planning.route.flowing_line import flowing
from waychair.planning.route.manoeuvres import gear_changes
from waychair.planning.route.rooms import NO_TURN, free_turn
from waychair.planning.route.speed_profile import BLIND_SPEED, rooms_along, time_along, turn_rate, turn_time
from waychair.planning.route.way_pieces import FIRM_PRICE, SHARPEST, Ground, Piece, is_against_one_way, sharpest
from waychair.resumable import CountedSteps
from waychair.types import FloatArray, Pose2

_NODES_EVERY = 0.4
"""[m] Distance of the poses of a drive between which shortcuts are tried, besides its ends."""

_SIDEWAYS = 1.3
"""[rad] A band whose end is farther than this off the heading in which the chair leaves or arrives is not tried."""

_STRAIGHT_ON = 0.2
"""[rad] A band whose end lies no farther off the heading is tried without a turn on the spot before it only."""

_LEAST = 0.01
"""[m] Least room of a shortcut, as the way itself may begin in contact with what the map shows."""

_STOP_S = 1.0
"""[s] About the time that each drive loses by starting and stopping."""

_AHEAD, _ASIDE, _MOST_PLACES = (-0.2, -0.4, -0.7, -1.0, 0.3, 0.6), (0.0, 0.1, -0.1, 0.2, -0.2), 6
"""[m], [m] and count: places round the start at which the chair may turn right round."""

_CELLS, _CELLS_OF_A_BAND = 40_000, 200_000
"""Work of one candidate beside its band, and of its judgement, in visited grid cells."""


@dataclass(frozen=True, slots=True)
class _Node:
    """A pose of the search's way: its drive's number, its index in that drive, and the room [m] up to it from the node before."""

    pose: Pose2
    drive: int
    index: int
    room: float


@dataclass(slots=True)
class _Chains:
    """The soonest chain to each node: its time [s], the node before, and the piece from there; None for a mere turn."""

    seconds: list[float]
    before: list[int] = field(default_factory=list)
    pieces: list[Piece | None] = field(default_factory=list)

    def offer(self, i: int, j: int, seconds: float, piece: Piece | None) -> None:
        """Take the chain to node i and on to node j, if it is the soonest to j."""
        if self.seconds[i] + seconds < self.seconds[j]:
            self.seconds[j], self.before[j], self.pieces[j] = self.seconds[i] + seconds, i, piece


def shortened(ground: Ground, poses: FloatArray) -> CountedSteps[list[Piece]]:
    """Return the drives of a multi-point turn (N, 3) between its ends, with shortcuts where they are sooner.

    A shortcut keeps the planned clearance, or as much as the way has that it replaces, but at least `_LEAST`.
    """
    body, costmap = ground.costmap.body, ground.costmap
    middle = (poses[:, :2].min(axis=0) + poses[:, :2].max(axis=0)) / 2
    reach = float(np.hypot(*(poses[:, :2] - middle).T).max()) + 2 * body.circumscribed_radius
    near = fine_field(costmap.grid, Pose2(float(middle[0]), float(middle[1])), reach)
    yield _CELLS * 10
    drives = [(line, rooms_along(body, near, line), back) for line, back in gear_changes(poses)]
    first, *rest = _nodes(poses, drives)
    nodes = [first, *_turning_places(body, near, first.pose), *rest]
    count = len(nodes)
    chains = _Chains([0.0, *[math.inf] * (count - 1)], [0] * count, [None] * count)
    for j in range(1, count):
        for i in range(j):
            if nodes[i].drive == nodes[j].drive:
                line, rooms, back = drives[nodes[i].drive]
                part = slice(nodes[i].index, nodes[j].index + 1)
                known = _piece(ground, line[part], rooms[part], back)
                yield _CELLS
                chains.offer(i, j, known.seconds + _STOP_S / 2, known)
            elif math.dist((nodes[i].pose.x, nodes[i].pose.y), (nodes[j].pose.x, nodes[j].pose.y)) < 1e-6:
                turn = wrap_angle(nodes[j].pose.theta - nodes[i].pose.theta)
                chains.offer(i, j, turn_time(turn, body, ground.limits), None)
        for i in range(j):
            least = max(_LEAST, min(PLANNED, *(node.room for node in nodes[i : j + 1])))
            yield from _offer_bands(ground, near, nodes[i].pose, nodes[j].pose, least, chains, i, j)
    found: list[Piece] = []
    at = count - 1
    while at > 0:
        piece = chains.pieces[at]
        if piece is not None:
            found.insert(0, piece)
        at = chains.before[at]
    return found or [Piece(poses[-1:], drives[-1][1][-1:], 0.0)]  # a turn on the spot alone


def _turning_places(body: ChairBody, near: DistanceField, start: Pose2) -> list[_Node]:
    """Return the first of the poses round a start at which the chair can turn right round; each is a drive of its own."""
    found: list[_Node] = []
    for ahead, aside in product(_AHEAD, _ASIDE):
        pose = start @ Pose2(ahead, aside, 0.0)
        if fits(body, PLANNED, near, pose) and free_turn(body, PLANNED_TURN, near, pose, math.pi) is not None:
            found.append(_Node(pose, -2 - len(found), 0, PLANNED))
        if len(found) == _MOST_PLACES:
            break
    return found


def _nodes(poses: FloatArray, drives: list[tuple[FloatArray, FloatArray, bool]]) -> list[_Node]:
    """Return the first pose, poses of each drive with both its ends, and the last pose; -1 is no drive."""
    nodes = [_Node(Pose2(*poses[0]), -1, 0, float(drives[0][1][0]))]
    for number, (line, rooms, _) in enumerate(drives):
        along = arc_lengths(line[:, :2])
        marks = np.linspace(0.0, along[-1], max(1, round(float(along[-1]) / _NODES_EVERY)) + 1)
        before = 0
        for index in np.unique(np.searchsorted(along, marks - 1e-9)).tolist():
            nodes.append(_Node(Pose2(*line[index]), number, index, float(rooms[before : index + 1].min())))
            before = index
    nodes.append(_Node(Pose2(*poses[-1]), len(drives), 0, float(drives[-1][1][-1])))
    return nodes


def _piece(ground: Ground, poses: FloatArray, rooms: FloatArray, backwards: bool, turning: float = 0.0) -> Piece:
    gear = -1.0 if backwards else 1.0
    seconds = time_along(poses, rooms, ground.costmap.body, ground.limits, gear)
    return Piece(poses, rooms, seconds + turning, backwards, turning)


def _offer_bands(
    ground: Ground, near: DistanceField, begin: Pose2, end: Pose2, least: float, chains: _Chains, i: int, j: int
) -> CountedSteps[None]:
    """Offer the bands from node i to node j, with at least so much room [m], in both gears, after a turn on the spot or not."""
    body, limits = ground.costmap.body, ground.limits
    margin = PLANNED_TURN if least >= PLANNED else least
    for backwards, leaves in _ways(begin, end):
        away = math.dist((begin.x, begin.y), (end.x, end.y))
        turned = 0.0 if leaves is None else abs(wrap_angle(end.theta - begin.theta)) / turn_rate(body, limits)
        soonest = max(away / (BLIND_SPEED if backwards else limits.max_speed), turned) + _STOP_S
        if chains.seconds[i] + soonest >= chains.seconds[j] or (backwards and limits.max_reverse == 0.0):
            continue
        line = np.array([(begin.x, begin.y), (end.x, end.y)])
        poses = yield from flowing(
            line=line,
            field=ground.costmap.field,
            body=body,
            leaves=leaves,
            arrives=end.theta,
            backwards=backwards,
            price=FIRM_PRICE,
            from_zones=ground.from_zones,
        )
        yield _CELLS_OF_A_BAND
        if sharpest(poses) > SHARPEST or is_against_one_way(ground.costmap, poses[:, :2]):
            continue
        rooms = rooms_along(body, near, poses)
        if rooms.min() < least:
            continue
        short = wrap_angle(float(poses[0, 2]) - begin.theta)
        turn = short if abs(short) <= NO_TURN else free_turn(body, margin, near, begin, short)
        if turn is None:
            continue
        turning = turn_time(turn, body, limits) if leaves is None else 0.0
        piece = _piece(ground, poses, rooms, backwards, turning)
        chains.offer(i, j, piece.seconds + _STOP_S / 2, piece)


def _ways(begin: Pose2, end: Pose2) -> Iterator[tuple[bool, float | None]]:
    """Yield gears in which a band may lead from one pose to another, with the heading [rad] in which it leaves, if fixed."""
    for backwards in (False, True):
        bearing = math.atan2(end.y - begin.y, end.x - begin.x) + (math.pi if backwards else 0.0)
        if math.dist((begin.x, begin.y), (end.x, end.y)) < _NODES_EVERY / 4:
            return
        if abs(wrap_angle(bearing - end.theta)) > _SIDEWAYS:
            continue
        off = abs(wrap_angle(bearing - begin.theta))
        if off < _SIDEWAYS:
            yield backwards, begin.theta
        if off > _STRAIGHT_ON:
            yield backwards, None
