"""Chairs on a traffic graph in continuous time, from event to event: a thousand chairs for hours in seconds.

A chair enters a section at once when its caller says so, and leaves it at a time that is known then. Chairs behind each
other on a section keep their order and a gap. People do not walk here: they delay chairs by random stops.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from waychair.errors import TrafficError
from waychair.maps.traffic.indexed_traffic import indexed_traffic
from waychair.maps.traffic.traffic_graph import TrafficGraph


@dataclass(frozen=True, slots=True)
class StopModel:
    """Random stops of a driving chair: `per_second` begin while it drives, each of `mean_s` on average (exponential)."""

    per_second: float = 0.0
    mean_s: float = 15.0


class Left(NamedTuple):
    """A chair has left a section and is at its node."""

    now_s: float
    chair: int
    section: int
    node: int


class SectionEvents:
    """The positions of some chairs on a graph, and the queue of their arrivals.

    Args:
        graph: the building.
        starts: the node of each chair, by number.
        speed: m/s of every chair.
        gap_s: least time [s] between two chairs that leave a section in the same direction.
        stops: random delays by people.
        seed: of the random stops; the same seed gives the same ones.
    """

    def __init__(
        self,
        graph: TrafficGraph,
        starts: Sequence[int],
        *,
        speed: float,
        gap_s: float = 0.0,
        stops: StopModel | None = None,
        seed: int = 0,
    ) -> None:
        self.indexed = indexed_traffic(graph)
        self._names = [section.name for section in graph.sections]
        resources = list(dict.fromkeys(section.resource for section in graph.sections))
        self._resource = [resources.index(section.resource) for section in graph.sections]
        self._lift = [section.lift is not None for section in graph.sections]
        self._free_s = self.indexed.seconds(speed)
        self._gap_s = gap_s
        self._stops = stops or StopModel()
        self._random = np.random.default_rng(seed)
        self.now_s = 0.0
        self.node = [int(node) for node in starts]
        self.section = [-1] * len(self.node)
        self._users: list[dict[int, int]] = [{} for _ in resources]
        self._last: dict[tuple[int, int], float] = {}
        self._arrivals: list[tuple[float, int, int, int]] = []
        self._entered = 0

    def may_enter(self, chair: int, section: int) -> bool:
        """Return whether nobody drives on the section against a chair at one of its ends; a lift takes one chair."""
        users = self._users[self._resource[section]]
        if not users or self.indexed.lanes[section] > 1:
            return True
        direction = self._direction(chair, section)
        return not self._lift[section] and all(other == direction for other in users.values())

    def enter(self, chair: int, section: int) -> float:
        """Let a chair at a node into a section now, and return the time [s] at which it will be at the other end.

        Raises:
            TrafficError: the chair is not at an end of the section, or another chair drives against it.
        """
        if self.section[chair] >= 0 or self.node[chair] not in self.indexed.ends[section]:
            raise TrafficError(
                f"chair {chair} is not at an end of section {self._names[section]}, so it cannot enter it"
            )
        if not self.may_enter(chair, section):
            raise TrafficError(f"chair {chair} would meet another chair on section {self._names[section]}")
        direction = self._direction(chair, section)
        leaves = self.now_s + float(self._free_s[section]) + self._delay(float(self._free_s[section]))
        leaves = max(leaves, self._last.get((section, direction), -math.inf) + self._gap_s)
        self._last[section, direction] = leaves
        self._users[self._resource[section]][chair] = direction
        self.section[chair] = section
        heapq.heappush(self._arrivals, (leaves, self._entered, chair, int(self.indexed.ends[section, 1 - direction])))
        self._entered += 1
        return leaves

    def next_left(self, until_s: float = math.inf) -> Left | None:
        """Go on to the next chair that leaves a section, and return it; None if none does until then."""
        if not self._arrivals or self._arrivals[0][0] > until_s:
            if math.isfinite(until_s):
                self.now_s = max(self.now_s, until_s)
            return None
        self.now_s, _, chair, node = heapq.heappop(self._arrivals)
        section = self.section[chair]
        del self._users[self._resource[section]][chair]
        self.section[chair] = -1
        self.node[chair] = node
        return Left(self.now_s, chair, section, node)

    def _direction(self, chair: int, section: int) -> int:
        return 0 if self.indexed.ends[section, 0] == self.node[chair] else 1

    def _delay(self, driving_s: float) -> float:
        if self._stops.per_second <= 0.0:
            return 0.0
        count = int(self._random.poisson(self._stops.per_second * driving_s))
        return float(self._random.exponential(self._stops.mean_s, size=count).sum())
