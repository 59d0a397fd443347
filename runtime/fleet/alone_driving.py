"""A whole chair that hears no warden: the chain that it gives itself, as far as it sees it free.

It enters a spot only if it sees nothing in it and in ten metres of single file behind it, and gives one that it has not reached
back if something comes there. Where it stands face to face with something for a while, it backs out if it is the one that has to
(`planning/fleet/peers/meeting.py`), or if its own goal is taken: whoever stands there can leave only past it. It waits in the
place aside until the other one has had time to pass.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from waychair.planning.fleet.peers.alone import ALONE_SPEED, SEEN_AHEAD, shortest_way
from waychair.planning.fleet.peers.meeting import gives_way
from waychair.planning.fleet.ways import Ways, ways_of
from waychair.types import FloatArray, Pose2

FACES_MS = 25_000
"""ms that a chair stands before something in single file until one of the two backs out; people mostly go on sooner."""

STANDS_WITHIN = 0.10
"""m; a chair that moves by no more, as its pose does, stands."""

LETS_PASS_MS = 45_000
"""ms that a chair stays aside: the other one needs so long for the ten metres that were between them, and its length."""

_MOST_RETREATS = 2
"""Times that a chair backs out on one way: the other one may be held up the first time, and a thing that stays is none."""

FACED_WITHIN = SEEN_AHEAD + 4.0
"""m to a thing before which a chair stands: it does not enter within ten metres, and stands before the end of its spot."""


@dataclass(frozen=True, slots=True)
class Seen:
    """The chair's eyes at one moment: the resources taken, the things' points (M, 2) [m] in map, and `map_from_base`.

    `nose` is the way [m] from there to the chair's front.
    """

    pose: Pose2
    taken: frozenset[int] = frozenset()
    things: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    nose: float = 0.0

    def faced(self) -> tuple[FloatArray, FloatArray] | None:
        """Return the points (2,) [m] of the chair's front, and of the nearest thing before it; None if there is none near.

        A chair that comes out of a door has the other one beside it: with nothing before it, the nearest thing around counts.
        """
        ahead = np.array([math.cos(self.pose.theta), math.sin(self.pose.theta)])
        here = np.array([self.pose.x, self.pose.y]) + self.nose * ahead
        is_before = (self.things - here) @ ahead > 0.0
        things = self.things[is_before] if is_before.any() else self.things
        if not len(things):
            return None
        nearest: FloatArray = things[np.argmin(np.hypot(*(things - here).T))]
        return (here, nearest) if math.dist(nearest, here) <= FACED_WITHIN else None


@dataclass(frozen=True, slots=True)
class AloneWay:
    """The spots after the front one, how many of them the chair may enter now, and whether it sounds its tone before a run."""

    chain: tuple[int, ...] = ()
    free: int = 0
    tone: bool = False


class AloneDriver:
    """The way of one chair by its own eyes."""

    def __init__(self, ways: Ways) -> None:
        """`ways`: as the chair drives them; it may back out of any single file beside."""
        self._ways = ways
        self._back = ways_of(ways.graph, ways.speed)
        self._names = [refuge.name for refuge in ways.graph.refuges]
        self._chain: tuple[int, ...] = ()
        self._goal = ""
        self._stands_ms: int | None = None
        self._stood = Pose2()
        self._waits_until_ms = 0
        self._faced = 0  # times since it moved last
        self._backed = 0  # times on the way to this goal
        self.retreats = 0
        """Times that it has backed out."""

    def step(self, now_ms: int, front: int, goal: str | None, seen: Seen) -> AloneWay:
        """Return the way of this moment from the spot of the chair's front towards a goal."""
        if goal is None:
            self._chain, self._goal = (), ""
            return AloneWay()
        if front in self._chain:
            self._stands_ms = None
        self._chain = self._rest(front)
        if goal != self._goal:
            self._goal, self._faced, self._backed, self._waits_until_ms = goal, 0, 0, 0
            self._chain = ()
        if not self._chain and now_ms >= self._waits_until_ms:
            self._chain = self._chosen(front, seen)
        free = self._free(front, self._chain, seen.taken)
        moves = math.dist((seen.pose.x, seen.pose.y), (self._stood.x, self._stood.y)) > STANDS_WITHIN
        self._faced = 0 if moves else self._faced
        if free or moves or not self._chain or self._ways.at_home[front]:
            self._stands_ms, self._stood = None, seen.pose
        elif self._stands_ms is None:
            self._stands_ms = now_ms
        elif now_ms - self._stands_ms >= FACES_MS:
            self._stands_ms = None
            self._face(now_ms, front, seen)
            free = self._free(front, self._chain, seen.taken)
        mouth = bool(free) and bool(self._ways.at_home[front])
        return AloneWay(self._chain, free, mouth)

    def _chosen(self, front: int, seen: Seen) -> tuple[int, ...]:
        """Return the spots up to a place aside on the way to the goal, round what is taken if there is a way round."""
        own = int(self._ways.resource[front])
        way = shortest_way(self._ways, front, self._goal, seen.taken - {own})
        way = way or shortest_way(self._ways, front, self._goal, frozenset())
        end = next((k for k, spot in enumerate(way, start=1) if self._ways.at_home[spot]), len(way))
        return way[:end]

    def lost(self, entered: Sequence[int], reached: int, seen: Seen) -> int:
        """Return how many of the entered spots the chair gives back, if its front has reached the first `reached` of them.

        It keeps one that it has not reached as long as it might enter it.
        """
        ahead = (*entered[reached:], *self._rest(entered[-1]))
        kept = min(reached + self._free(entered[reached - 1], ahead, seen.taken), len(entered))
        if kept < len(entered):
            self._chain = ahead[kept - reached :]
        return len(entered) - kept

    def _rest(self, front: int) -> tuple[int, ...]:
        """Return the spots of the chain after the front one; none if it does not lead on from there."""
        if front in self._chain:
            return self._chain[self._chain.index(front) + 1 :]
        first, end = self._back.first[front : front + 2]
        return self._chain if self._chain and self._chain[0] in self._back.after[first:end] else ()

    def _free(self, front: int, chain: Sequence[int], taken: frozenset[int]) -> int:
        """Return how many spots of a chain may be entered: with nothing in them, nor in ten metres from there on."""
        resource, own = self._ways.resource, int(self._ways.resource[front])
        begins: list[float] = []
        metres = 0.0
        for spot in chain:
            if int(resource[spot]) in taken and int(resource[spot]) != own:
                return sum(begin + SEEN_AHEAD <= metres for begin in begins)
            begins.append(metres)
            metres += self._section_length(spot)
        return len(begins)

    def _goal_is_taken(self, seen: Seen) -> bool:
        return all(int(self._ways.resource[spot]) in seen.taken for spot in self._ways.slots[self._goal])

    def _section_length(self, spot: int) -> float:
        name = self._ways.names[spot]
        section = self._ways.graph.section.get(name)
        return 0.0 if section is None else section.length

    def _face(self, now_ms: int, front: int, seen: Seen) -> None:
        """Back out to the nearest place aside if this chair is the one that has to, and has not done so too often."""
        faced = seen.faced()
        if faced is None:
            return
        self._faced += 1
        is_shut_in = self._goal_is_taken(seen) and not self._backed
        if self._backed >= _MOST_RETREATS or not (is_shut_in or gives_way(self._ways.graph, *faced, self._faced)):
            return
        taken = seen.taken - {int(self._ways.resource[front])}
        times = {name: int(self._back.least_ms(name)[front]) for name in self._names if name != self._goal}
        for name in sorted(times, key=times.__getitem__):
            way = shortest_way(self._back, front, name, taken)
            if way:
                self._chain = way
                self._waits_until_ms = now_ms + LETS_PASS_MS + 2 * times[name]
                self.retreats += 1
                self._backed += 1
                return


def speed_by_eye(ways: Ways, spots: Iterable[int]) -> float:
    """Return the highest speed [m/s] of a chair alone in these spots: low in single file."""
    sections = [ways.graph.section.get(ways.names[spot]) for spot in spots]
    return ALONE_SPEED if any(each is not None and each.lanes == 1 for each in sections) else math.inf
