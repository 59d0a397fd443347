"""Alone mode: how a chair drives that hears no warden, by its own eyes alone.

It drives slowly, enters a run only where it sees it free to its end or for ten metres, and of two that meet face to face in a run
the less one backs out. Both decide by the same numbers, so that never both do.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from waychair.planning.fleet.ways import NEVER, Ways

ALONE_SPEED = 0.3
"""m/s in runs."""

SEEN_AHEAD = 10.0
"""m of a run that have to be seen free before it is entered."""


class Standing(NamedTuple):
    """What decides between two chairs face to face: priority, way [m] back to a place aside, and number.

    The number is unknown (-1) for a chair that cannot be heard; then the side of the run on which it is takes its place.
    """

    priority: int
    way_back: float
    number: int


SAME_WAY = 0.5
"""m; ways back that differ by less count as equal, as the two chairs measure them apart."""


def backs_out(own: Standing, other: Standing) -> bool:
    """Return whether the own chair backs out for another one: the lower priority, else the shorter way back, else the higher
    number.
    """
    if own.priority != other.priority:
        return own.priority < other.priority
    if abs(own.way_back - other.way_back) > SAME_WAY:
        return own.way_back < other.way_back
    return own.number > other.number


def way_by_eye(ways: Ways, front: int, goal: str, taken: Collection[int]) -> tuple[int, ...]:
    """Return the next spots of the shortest way to a goal as far as a place aside, if all are seen free; else none.

    `taken` are resources in which something is seen. The way leads round them where it can. Only the first `SEEN_AHEAD`
    metres of single file have to be seen.
    """
    path = shortest_way(ways, front, goal, taken)
    found: list[int] = []
    metres = 0.0
    for spot in path:
        found.append(spot)
        metres += 1e-3 * float(ways.passing_ms[spot]) * ways.speed
        if ways.at_home[spot] or metres >= SEEN_AHEAD:
            break
    return tuple(found)


def shortest_way(ways: Ways, front: int, goal: str, taken: Collection[int]) -> tuple[int, ...]:
    """Return the spots after the front one on the shortest way to a free slot of a goal; none if there is no way."""
    towards = ways.towards(goal)
    shut = np.isin(ways.resource, list(taken)) | towards.is_barred
    left = np.full(len(ways.names), NEVER, np.int64)
    before = np.full(len(ways.names), -1, np.int64)
    left[front] = 0
    open_spots = [front]
    for _ in range(len(ways.names)):
        if not open_spots:
            return ()
        spot = min(open_spots, key=lambda each: int(left[each]))
        open_spots.remove(spot)
        if towards.is_goal[spot]:
            path: list[int] = []
            while spot != front:
                path.append(spot)
                spot = int(before[spot])
            return tuple(path[::-1])
        reached = int(left[spot]) + int(ways.passing_ms[spot])
        for after in ways.after[ways.first[spot] : ways.first[spot + 1]].tolist():
            if not shut[after] and reached < left[after]:
                if left[after] == NEVER:
                    open_spots.append(after)
                left[after], before[after] = reached, spot
    return ()
