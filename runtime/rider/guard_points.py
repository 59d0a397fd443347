"""What no scan shows, told by the program that sees it to the one that guards the rider's stick, where these are two."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from waychair.control.safety.guard import Unscanned
from waychair.types import FloatArray, Pose2

SENT_BEYOND = 1.0
"""m beyond the points that matter now; the chair drives less until points are told anew."""

STALE_NS = 1_000_000_000
"""ns; points told longer ago are not those round the chair any more."""

IN_ODOM = -1
"""In the place of the map's revision: the points are in odom."""

_Points: TypeAlias = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class GuardPoints:
    """Points near a chair [m], in the map of a revision or in odom: drop-offs, other things that no scan shows, and what the map shows."""

    stamp_ns: int
    revision: int
    drops: _Points = ()
    things: _Points = ()
    mapped: _Points = ()

    @classmethod
    def near(cls, stamp_ns: int, revision: int, unscanned: Unscanned, map_from_base: Pose2) -> GuardPoints:
        """Return those of all points in map that are near the chair."""
        near = unscanned.near((map_from_base.x, map_from_base.y), SENT_BEYOND)
        return cls(stamp_ns, revision, *map(_plain, (near.drops, near.things, near.mapped)))

    def unscanned(self) -> Unscanned:
        """Return the points in map."""
        return Unscanned(*(np.array(points).reshape(-1, 2) for points in (self.drops, self.things, self.mapped)))


class ToldPoints:
    """The points that were told last."""

    def __init__(self) -> None:
        self._told: tuple[GuardPoints, int] | None = None

    def take(self, told: GuardPoints, now_ns: int) -> None:
        """Take points; `now_ns` of the clock of `seen_from`."""
        self._told = told, now_ns

    def seen_from(self, map_from_base: Pose2, revision: int, now_ns: int) -> Unscanned | None:
        """Return the points in base of a chair on the map of this revision; None if they are of another map, or stale."""
        if self._told is None:
            return None
        told, heard_ns = self._told
        stale = not 0 <= now_ns - heard_ns <= STALE_NS
        return None if stale or told.revision != revision else told.unscanned().seen_from(map_from_base)


def _plain(points: FloatArray) -> _Points:
    return tuple((round(float(x), 3), round(float(y), 3)) for x, y in points)
