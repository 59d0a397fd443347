"""The messages between the nodes of the paper's network and its chairs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True, slots=True)
class Command:
    """Phase 1, from the rider to the chair's nearest node: bring the chair to the target."""

    chair: int
    target: str
    priority: int
    speed: float
    start_s: float


@dataclass(frozen=True, slots=True)
class Query:
    """Phase 2, from node to node: from the source to `sender` it takes `label` s over `hops` sections; `section` is next."""

    search: int
    command: Command
    sender: str
    section: str
    label: float
    hops: int
    until_s: float


@dataclass(frozen=True, slots=True)
class Asked:
    """Phase 2, to a neighbour: does one of your filters know the target? The answer is a `Hint`."""

    search: int
    sender: str
    command: Command


@dataclass(frozen=True, slots=True)
class Hint:
    """Phase 2, the answer: whether one of the sender's filters knows the target."""

    search: int
    sender: str
    command: Command
    known: bool


@dataclass(frozen=True, slots=True)
class Confirm:
    """Phase 3, back from the target: the chair goes on from the addressee over `section` to `ahead`, where it is at `ahead_s`.

    `way` holds node, section before it and time of day [s] of every node from `ahead` to the target.
    """

    search: int
    command: Command
    ahead: str
    section: str
    ahead_s: float
    way: tuple[tuple[str, str, float], ...]


@dataclass(frozen=True, slots=True)
class Late:
    """Phase 4, along the committed nodes: the chair comes `by_s` later than it said."""

    chair: int
    by_s: float


@dataclass(frozen=True, slots=True)
class Cancel:
    """Phase 4, along the committed nodes: the chair does not come, because it searches again."""

    chair: int


Message: TypeAlias = Command | Query | Asked | Hint | Confirm | Late | Cancel
