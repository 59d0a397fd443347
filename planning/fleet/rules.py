"""Rules of precedence: priorities with ageing, inheritance towards chairs and people, and how often one is overtaken."""

from __future__ import annotations

import enum
from collections.abc import Mapping

MOST_OVERTAKINGS = 2
"""Later requests of no higher priority that may delay a request by going first."""

AGEING_MS = 120_000
"""A request counts as one priority higher, below people, each time it has waited so long."""

_DOUBLING_MS = 300_000.0
"""Five minutes since its request double the weight of a chair's time; a shorter time costs all chairs delay in the mean."""


class Priority(enum.IntEnum):
    """From low to high. People are no chairs: they give no requests, but they come between the chairs."""

    ROUTINE = 0
    APPOINTMENT = 1
    PEOPLE = 2
    TOP = 3


_WEIGHTS = {Priority.ROUTINE: 1.0, Priority.APPOINTMENT: 4.0, Priority.PEOPLE: 16.0, Priority.TOP: 1000.0}


def weight(priority: Priority, waited_ms: int) -> float:
    """Return how much a second of a chair's delay counts, by its priority and the time since its request."""
    return _WEIGHTS[priority] * (1.0 + max(waited_ms, 0) / _DOUBLING_MS)


def aged(priority: Priority, waited_ms: int) -> Priority:
    """Return the priority of a request that has waited; ageing leads up to appointments, never above people."""
    if priority >= Priority.PEOPLE:
        return priority
    return Priority(min(priority + max(waited_ms, 0) // AGEING_MS, Priority.APPOINTMENT))


def inherited(own: Mapping[str, Priority], waits_for: Mapping[str, frozenset[str]]) -> dict[str, Priority]:
    """Return everybody's priority, at least that of all who wait for them, directly or over others.

    Names are those of chairs and people alike, so that a routine chair in front of a top-level chair goes before a person
    who would otherwise stand in its way for ever. (As in PIBT; the flexible rule of the paper locks up without it.)
    """
    found = dict(own)
    changed = True
    while changed:
        changed = False
        for who, others in waits_for.items():
            for other in others:
                if other in found and who in found and found[other] < found[who]:
                    found[other] = found[who]
                    changed = True
    return found
