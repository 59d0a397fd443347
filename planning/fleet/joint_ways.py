"""A way for all chairs at once over the spots of a building, by LaCAM: for exchanges, and when reality broke the order."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import count, pairwise

import numpy as np

from waychair.errors import NoPath
from waychair.planning.fleet.agents import NONE, Numbers, Task
from waychair.planning.fleet.lacam import first_answer
from waychair.planning.fleet.order import Order, Turn
from waychair.planning.fleet.space_time import steps_to
from waychair.planning.fleet.ways import NOBODYS, Ways

_CONFIGURATIONS = 1000
"""Configurations that a search looks at before it gives up."""

_TRIES = 4
"""Searches; a ring of chairs that all move at once gives an order that cannot be kept, and another search may not."""


def joint_ways(
    order: Order, goals: Mapping[int, str], rng: np.random.Generator
) -> Iterator[tuple[dict[int, tuple[int, ...]], dict[int, list[Turn]]]]:
    """Yield a few times the spots of each chair to its goal, and the turns at each resource in order; nothing if none is found.

    The search goes over spots; one chair is in a resource after each step.
    """
    ways = order.ways
    chairs = list(order.chains)
    starts = np.array([order.chains[chair].spots[0] for chair in chairs], np.int32)
    ends = _goals(order, chairs, goals)
    if ends is None or len(set(ways.resource[starts].tolist())) < len(starts):
        return
    after, before = _neighbours(ways, order.closed)
    towards = steps_to(before, ends)
    for agent in range(len(chairs)):
        allowed = [NOBODYS, ways.reserved[starts[agent]], ways.reserved[ends[agent]]]
        towards[agent, ~np.isin(ways.reserved, allowed)] = NONE
    if (towards[np.arange(len(chairs)), starts] < 0).any():
        return
    task, rooms = Task(after, starts, ends), ways.resource.astype(np.int32)
    for _ in range(_TRIES):
        left = count(_CONFIGURATIONS, -1)
        try:
            paths = first_answer(task, towards, rng, lambda left=left: next(left) > 0, rooms)  # type: ignore[misc]
        except NoPath:
            return
        yield _chains(order, chairs, paths)


def _neighbours(ways: Ways, closed: frozenset[int]) -> tuple[Numbers, Numbers]:
    """Return the spots (V, D) after each one, and those before it, -1 where there are fewer; closed ones are beside none."""
    after: list[list[int]] = [[] for _ in ways.names]
    before: list[list[int]] = [[] for _ in ways.names]
    for spot in range(len(ways.names)):
        for other in ways.after[ways.first[spot] : ways.first[spot + 1]].tolist():
            if int(ways.resource[other]) not in closed:
                after[spot].append(other)
                before[other].append(spot)
    return _table(after), _table(before)


def _table(beside: list[list[int]]) -> Numbers:
    table = np.full((len(beside), max(map(len, beside))), NONE, np.int32)
    for spot, others in enumerate(beside):
        table[spot, : len(others)] = others
    return table


def _goals(order: Order, chairs: list[int], goals: Mapping[int, str]) -> Numbers | None:
    """Return a slot for each chair, its own spot if it stays; None if a refuge has too few.

    A chair whose goal is no refuge is one that stopped on its way: it stays where it is.
    """
    ways = order.ways
    taken: set[int] = set()
    found: dict[int, int] = {}
    stays_first = sorted(chairs, key=lambda chair: ways.names[order.chains[chair].spots[-1]] != goals[chair])
    for chair in stays_first:
        own = order.chains[chair].spots[-1]
        slots = ways.slots.get(goals[chair], (own,))
        free = [slot for slot in sorted(slots, key=lambda slot: slot != own) if slot not in taken]
        if not free:
            return None
        found[chair] = free[0]
        taken.add(free[0])
    return np.array([found[chair] for chair in chairs], np.int32)


def _chains(
    order: Order, chairs: list[int], paths: Numbers
) -> tuple[dict[int, tuple[int, ...]], dict[int, list[Turn]]]:
    """Return the spots of paths (A, T) over spots, and the turns at each resource in the order in which it is entered."""
    spots: dict[int, tuple[int, ...]] = {}
    turns: dict[int, list[tuple[int, Turn]]] = {}
    for chair, path in zip(chairs, paths.tolist(), strict=True):
        steps = [0, *(step for step, (one, other) in enumerate(pairwise(path), start=1) if one != other)]
        spots[chair] = tuple(path[step] for step in steps)
        for k, step in enumerate(steps):
            turn = Turn(chair, order.chains[chair].visit + k)
            turns.setdefault(int(order.ways.resource[path[step]]), []).append((step, turn))
    return spots, {resource: [turn for _, turn in sorted(each)] for resource, each in turns.items()}
