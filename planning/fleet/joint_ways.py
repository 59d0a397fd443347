"""A way for all chairs at once over the spots of a building, by LaCAM: for exchanges, and when reality broke the order."""

from __future__ import annotations

from collections.abc import Mapping
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


def joint_way(
    order: Order, goals: Mapping[int, str], rng: np.random.Generator
) -> tuple[dict[int, tuple[int, ...]], dict[int, list[Turn]]] | None:
    """Return the spots of each chair to its goal, and the turns at each resource in order; None if none was found.

    The search goes over resources, in each of which is one chair after each step.
    """
    ways = order.ways
    chairs = list(order.chains)
    neighbours = _neighbours(ways, order.closed)
    starts = np.array([ways.resource[order.chains[chair].spots[0]] for chair in chairs], np.int32)
    ends = _goals(order, chairs, goals)
    if ends is None or len(set(starts.tolist())) < len(starts):
        return None
    task = Task(neighbours, starts, ends)
    towards = steps_to(neighbours, ends)
    reserved = np.full(ways.resources, NOBODYS)
    reserved[ways.resource[ways.reserved != NOBODYS]] = ways.reserved[ways.reserved != NOBODYS]
    for agent in range(len(chairs)):
        allowed = [NOBODYS, reserved[starts[agent]], reserved[ends[agent]]]
        towards[agent, ~np.isin(reserved, allowed)] = NONE
    if (towards[np.arange(len(chairs)), starts] < 0).any():
        return None
    for _ in range(_TRIES):
        left = count(_CONFIGURATIONS, -1)
        try:
            paths = first_answer(task, towards, rng, lambda left=left: next(left) > 0)  # type: ignore[misc]
        except NoPath:
            return None
        found = _spots(order, chairs, paths)
        if found is not None:
            return found
    return None


def _neighbours(ways: Ways, closed: frozenset[int]) -> Numbers:
    """Return the resources (R, D) beside each one, -1 where there are fewer; none beside closed ones."""
    beside: list[dict[int, None]] = [{} for _ in range(ways.resources)]
    for spot, resource in enumerate(ways.resource.tolist()):
        for other in ways.resource[ways.after[ways.first[spot] : ways.first[spot + 1]]].tolist():
            if other != resource and other not in closed:
                beside[resource][other] = None
    table = np.full((ways.resources, max(map(len, beside))), NONE, np.int32)
    for resource, others in enumerate(beside):
        table[resource, : len(others)] = list(others)
    return table


def _goals(order: Order, chairs: list[int], goals: Mapping[int, str]) -> Numbers | None:
    """Return a slot's resource for each chair, its own one if it stays; None if a refuge has too few.

    A chair whose goal is no refuge is one that stopped on its way: it stays where it is.
    """
    ways = order.ways
    taken: set[int] = set()
    found: dict[int, int] = {}
    stays_first = sorted(chairs, key=lambda chair: ways.names[order.chains[chair].spots[-1]] != goals[chair])
    for chair in stays_first:
        own = int(ways.resource[order.chains[chair].spots[-1]])
        slots = ways.resource[list(ways.slots[goals[chair]])].tolist() if goals[chair] in ways.slots else [own]
        free = [slot for slot in sorted(slots, key=lambda slot: slot != own) if slot not in taken]
        if not free:
            return None
        found[chair] = free[0]
        taken.add(free[0])
    return np.array([found[chair] for chair in chairs], np.int32)


def _spots(
    order: Order, chairs: list[int], paths: Numbers
) -> tuple[dict[int, tuple[int, ...]], dict[int, list[Turn]]] | None:
    """Return spots and turns of paths (A, T) over resources; None if the directions of sections do not fit together."""
    ways = order.ways
    spots: dict[int, tuple[int, ...]] = {}
    turns: dict[int, list[tuple[int, Turn]]] = {}
    for chair, path in zip(chairs, paths.tolist(), strict=True):
        chain = order.chains[chair]
        steps = [0, *(step for step, (one, other) in enumerate(pairwise(path), start=1) if one != other)]
        options = [{chain.spots[0]: NONE}]
        for step in steps[1:]:
            after = {
                other: spot
                for spot in options[-1]
                for other in ways.after[ways.first[spot] : ways.first[spot + 1]].tolist()
                if ways.resource[other] == path[step]
            }
            options.append(after)
        if not options[-1]:
            return None
        spot = next(iter(options[-1]))
        way = [spot]
        for before in reversed(options[1:]):
            spot = before[spot]
            way.append(spot)
        spots[chair] = tuple(reversed(way))
        for k, step in enumerate(steps):
            turns.setdefault(path[step], []).append((step, Turn(chair, chain.visit + k)))
    return spots, {resource: [turn for _, turn in sorted(each)] for resource, each in turns.items()}
