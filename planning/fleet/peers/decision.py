"""The decision of a warden, as every peer knows it without the warden's planner, which is large to load."""

from __future__ import annotations

from dataclasses import dataclass

from waychair.planning.fleet.peers import messages
from waychair.planning.fleet.peers.messages import Answer, Electorate
from waychair.types import Json

SILENT_NS = 2_500_000_000
"""A chair that was not heard for so long may have begun to drive by its own eyes."""


@dataclass(frozen=True, slots=True)
class WardenDecision:
    """What a warden sends: answers to chairs, and the order if it is time to tell it; `grants`: whether it may grant.

    `begins_again`: a majority follows it that has forgotten whom it followed before; another term counts them. `electorate`: the
    one to which it goes on. `records` are the waits that have ended, for the audit's log.
    """

    grants: bool = False
    begins_again: bool = False
    answers: tuple[Answer, ...] = ()
    order: messages.Order | None = None
    electorate: Electorate | None = None
    records: tuple[Json, ...] = ()
