"""A traffic graph by numbers, as the planners of several chairs need it: spots, and what of the building each one uses.

A spot is a place in which a chair is, as a whole, while it does not change over to the next: a node, one slot of a
refuge, or a section in one direction. Each uses one resource, which has room for one chair: both directions of a
section of one lane share theirs, and so do all sections of a lift. A chair uses the resources of two spots while it
changes over, so that two chairs can never exchange their spots.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from waychair.errors import TaskError
from waychair.maps.traffic.traffic_graph import TrafficGraph
from waychair.types import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

_MS = 1e3

NEVER = 1 << 50
"""ms; later than anything that is planned."""

NOBODYS = -1
"""A spot that is reserved for no goal."""

MOST_AT_A_NODE = 64
"""Chairs for which a node of more capacity has spots; no corridor's end holds more."""


@dataclass(frozen=True)
class Ways:
    """V spots that use R resources.

    Attributes:
        graph: the traffic graph.
        names: (V,) the name of the node, refuge or section, for sentences.
        resource: (V,) the resource that a spot uses.
        passing_ms: (V,) int64 least time from entering a spot to entering the next one; 1 for nodes.
        first: (E's offsets, V + 1): the spots after spot v are after[first[v] : first[v + 1]].
        after: (E,).
        at_home: (V,) bool: slots of refuges, in which a chair is in nobody's way.
        reserved: (V,) the number of the refuge that must be a chair's goal before it may enter the spot, -1 for none: slots of
            refuges at dead ends that are not for waiting, and the sections that lead into them: nobody waits in a door.
        speed: m/s of an undisturbed chair.
    """

    graph: TrafficGraph
    names: tuple[str, ...]
    resource: IntArray
    passing_ms: IntArray
    first: IntArray
    after: IntArray
    at_home: BoolArray
    reserved: IntArray
    speed: float

    @cached_property
    def resources(self) -> int:
        return int(self.resource.max()) + 1

    @cached_property
    def dead_ends(self) -> frozenset[str]:
        """The nodes of refuges to which one section leads: nobody waits in a door."""
        ends = Counter(end for section in self.graph.sections for end in (section.start, section.end))
        return frozenset(node for node in self.graph.refuge_at if ends[node] == 1)

    @cached_property
    def slots(self) -> dict[str, tuple[int, ...]]:
        """The spots of each refuge, by its name."""
        found: dict[str, tuple[int, ...]] = {}
        for spot in np.flatnonzero(self.at_home).tolist():
            found[self.names[spot]] = (*found.get(self.names[spot], ()), spot)
        return found

    @cached_property
    def _backwards(self) -> csr_array:
        """The spots before each spot, with the time of passing the earlier one."""
        from scipy.sparse import csr_array  # late: a peer that is no warden does without

        before = np.repeat(np.arange(len(self.names)), np.diff(self.first))
        prices = self.passing_ms[before].astype(np.float64)
        shape = (len(self.names), len(self.names))
        return csr_array((prices, (self.after, before)), shape=shape)

    @cached_property
    def _known(self) -> dict[str, Towards]:
        return {}

    def towards(self, refuge: str) -> Towards:
        """Return the use of the spots to a chair that goes to a refuge."""
        if refuge not in self._known:
            from scipy.sparse.csgraph import dijkstra

            slots = list(self.slots[refuge])
            found: FloatArray = dijkstra(self._backwards, indices=slots, min_only=True)
            least_ms = np.where(np.isfinite(found), np.floor(found), NEVER).astype(np.int64)
            is_goal = np.zeros(len(self.names), bool)
            is_goal[slots] = True
            number = next(k for k, each in enumerate(self.graph.refuges) if each.name == refuge)
            is_barred = (self.reserved != NOBODYS) & (self.reserved != number)
            self._known[refuge] = Towards(least_ms, is_goal, is_barred)
        return self._known[refuge]

    def is_barred(self, refuge: str) -> BoolArray:
        """Return the spots (V,) that a chair with this goal must not enter, as they are reserved for other goals."""
        return self.towards(refuge).is_barred

    def least_ms(self, refuge: str) -> IntArray:
        """Return the least time (V,) [ms] from entering each spot to entering a slot of a refuge; `NEVER` if there is no way.

        Reserved spots are passed through here, which makes the time smaller at most.
        """
        return self.towards(refuge).least_ms


class Towards(NamedTuple):
    """The spots (V,) for one goal: the least time [ms] to it, whether they are its slots, and whether they are barred."""

    least_ms: IntArray
    is_goal: BoolArray
    is_barred: BoolArray


def ways_of(graph: TrafficGraph, speed: float) -> Ways:
    """Return the spots of a graph for chairs of a speed [m/s].

    Raises:
        TaskError: the speed is no number above 0.
    """
    if not (np.isfinite(speed) and speed > 0.0):
        raise TaskError(f"chairs cannot share a building at {speed:g} m/s: give a speed above 0")
    names: list[str] = []
    resource: list[int] = []
    passing: list[int] = []
    numbers: dict[str, int] = {}
    spots: dict[str, list[int]] = {}
    at_home: list[bool] = []
    reserved: list[int] = []
    ends = Counter(end for section in graph.sections for end in (section.start, section.end))
    rooms = {each.node: k for k, each in enumerate(graph.refuges) if not each.waiting and ends[each.node] == 1}
    for node in graph.nodes:
        refuge = graph.refuge_at.get(node.name)
        for _ in range(min(graph.capacity(node.name), MOST_AT_A_NODE)):
            spots.setdefault(node.name, []).append(len(names))
            names.append(node.name if refuge is None else refuge.name)
            resource.append(numbers.setdefault(f"node {len(names)}", len(numbers)))
            passing.append(1)
            at_home.append(refuge is not None)
            reserved.append(rooms.get(node.name, NOBODYS))
    edges: list[tuple[int, int]] = []
    for section in graph.sections:
        lanes = section.lanes == 2 and section.lift is None
        entered = []
        for way, (start, end) in enumerate(((section.start, section.end), (section.end, section.start))):
            if way == 1 and section.one_way:
                continue
            spot = len(names)
            entered.append((spot, start))
            names.append(section.resource)
            key = f"section {section.resource} {way if lanes else 0}"
            resource.append(numbers.setdefault(key, len(numbers)))
            passing.append(round(_MS * section.seconds(speed)))
            at_home.append(False)
            reserved.append(rooms.get(end, NOBODYS))
            edges += [(before, spot) for before in spots[start]]
            edges += [(spot, after) for after in spots[end]]
        if not lanes and section.lift is None:  # a chair may back out of it
            edges += [(spot, before) for spot, start in entered for before in spots[start]]
    edges.sort()
    first = np.searchsorted([edge[0] for edge in edges], np.arange(len(names) + 1)).astype(np.int64)
    return Ways(
        graph=graph,
        names=tuple(names),
        resource=np.array(resource, np.int64),
        passing_ms=np.array(passing, np.int64),
        first=first,
        after=np.array([edge[1] for edge in edges], np.int64),
        at_home=np.array(at_home),
        reserved=np.array(reserved, np.int64),
        speed=speed,
    )
