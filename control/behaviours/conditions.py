"""Logical conditions on the ports of cells: the values of EB, IB and RS as expression objects.

    Active("Door validation") & ~Active("Object tracker")
    AtLeast("Doorway detection", 0.5, of="confidence") | Below("Range finder", 1.0, of="metres")

Names are names of cells, networks or sensors. A threshold on a value that is missing or not a number is false, both for
`AtLeast` and for `Below`, so that nothing unknown excites a cell; `~AtLeast` is true there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias


class PortView(Protocol):
    """Access to the ports of the other cells."""

    def activation(self, name: str, before: bool) -> bool:
        """Return AB of a cell or network, or, with `before`, its value before this innervation."""

    def effect(self, name: str, before: bool) -> Any:
        """Return EO of a cell, network or sensor; None if nothing was written; `before` as for `activation`."""


class Condition:
    """Base class of all conditions; `&`, `|` and `~` combine them."""

    __slots__ = ()

    def __and__(self, other: Condition) -> Condition:
        return Both(self, other)

    def __or__(self, other: Condition) -> Condition:
        return Either(self, other)

    def __invert__(self) -> Condition:
        return Not(self)

    def holds(self, ports: PortView) -> bool:
        """Return whether the condition holds."""
        raise NotImplementedError

    def sources(self) -> Iterator[PortSource]:
        """Yield the ports that the condition reads."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class PortSource:
    """A port that a condition or a data link reads: AB, or EO with the path `of` to a number in it.

    `before`: the value before this innervation is read, which is how a loop between cells is closed.
    """

    name: str
    port: str = "EO"
    of: str = ""
    before: bool = False


@dataclass(frozen=True, slots=True)
class Always(Condition):
    """True, such as an unconnected EB."""

    def holds(self, ports: PortView) -> bool:
        return True

    def sources(self) -> Iterator[PortSource]:
        return iter(())

    def __str__(self) -> str:
        return "always"


@dataclass(frozen=True, slots=True)
class Never(Condition):
    """False, such as an unconnected IB or RS."""

    def holds(self, ports: PortView) -> bool:
        return False

    def sources(self) -> Iterator[PortSource]:
        return iter(())

    def __str__(self) -> str:
        return "never"


@dataclass(frozen=True, slots=True)
class Active(Condition):
    """A cell or network is active: its AB is 1."""

    name: str
    before: bool = False

    def holds(self, ports: PortView) -> bool:
        return ports.activation(self.name, self.before)

    def sources(self) -> Iterator[PortSource]:
        yield PortSource(self.name, "AB", before=self.before)

    def __str__(self) -> str:
        return f"{self.name} active{' before' if self.before else ''}"


@dataclass(frozen=True, slots=True)
class AtLeast(Condition):
    """The number at the path `of` in an EO is at least a limit; true counts as 1, false as 0."""

    name: str
    limit: float
    of: str = ""
    before: bool = False

    def holds(self, ports: PortView) -> bool:
        return number_at(ports.effect(self.name, self.before), self.of) >= self.limit

    def sources(self) -> Iterator[PortSource]:
        yield PortSource(self.name, of=self.of, before=self.before)

    def __str__(self) -> str:
        return f"{_named(self.name, self.of, self.before)} >= {self.limit:g}"


@dataclass(frozen=True, slots=True)
class Below(Condition):
    """The number at the path `of` in an EO is below a limit."""

    name: str
    limit: float
    of: str = ""
    before: bool = False

    def holds(self, ports: PortView) -> bool:
        return number_at(ports.effect(self.name, self.before), self.of) < self.limit

    def sources(self) -> Iterator[PortSource]:
        yield PortSource(self.name, of=self.of, before=self.before)

    def __str__(self) -> str:
        return f"{_named(self.name, self.of, self.before)} < {self.limit:g}"


@dataclass(frozen=True, slots=True)
class Both(Condition):
    """Both conditions hold."""

    first: Condition
    second: Condition

    def holds(self, ports: PortView) -> bool:
        return self.first.holds(ports) and self.second.holds(ports)

    def sources(self) -> Iterator[PortSource]:
        yield from self.first.sources()
        yield from self.second.sources()

    def __str__(self) -> str:
        return f"{_inner(self.first)} and {_inner(self.second)}"


@dataclass(frozen=True, slots=True)
class Either(Condition):
    """At least one of two conditions holds."""

    first: Condition
    second: Condition

    def holds(self, ports: PortView) -> bool:
        return self.first.holds(ports) or self.second.holds(ports)

    def sources(self) -> Iterator[PortSource]:
        yield from self.first.sources()
        yield from self.second.sources()

    def __str__(self) -> str:
        return f"{_inner(self.first)} or {_inner(self.second)}"


@dataclass(frozen=True, slots=True)
class Not(Condition):
    """A condition does not hold."""

    condition: Condition

    def holds(self, ports: PortView) -> bool:
        return not self.condition.holds(ports)

    def sources(self) -> Iterator[PortSource]:
        yield from self.condition.sources()

    def __str__(self) -> str:
        return f"not {_inner(self.condition)}"


ALWAYS, NEVER = Always(), Never()

Test: TypeAlias = Callable[[], bool]


def number_at(value: Any, path: str) -> float:
    """Return the number at a dotted path of attributes in a value; nan if there is none."""
    for name in path.split(".") if path else ():
        value = getattr(value, name, None)
    if value is None:
        return math.nan
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def test_from(
    condition: Condition, activation: Callable[[str, bool], Test], effect: Callable[[str, bool], Callable[[], Any]]
) -> Test:
    """Return a condition as a function without look-ups by name, for the loop that runs the cells.

    `activation` and `effect` return, for a name and `before`, a function that reads the port. The result is that of
    `Condition.holds`.
    """
    if isinstance(condition, Both):
        first, second = (test_from(each, activation, effect) for each in (condition.first, condition.second))
        return lambda: first() and second()
    if isinstance(condition, Either):
        first, second = (test_from(each, activation, effect) for each in (condition.first, condition.second))
        return lambda: first() or second()
    if isinstance(condition, Not):
        inner = test_from(condition.condition, activation, effect)
        return lambda: not inner()
    if isinstance(condition, Active):
        return activation(condition.name, condition.before)
    if isinstance(condition, AtLeast | Below):
        read, path, limit = effect(condition.name, condition.before), condition.of, condition.limit
        if isinstance(condition, AtLeast):
            return lambda: number_at(read(), path) >= limit
        return lambda: number_at(read(), path) < limit
    truth = isinstance(condition, Always)
    return lambda: truth


def _named(name: str, path: str, before: bool) -> str:
    return f"{name}{'.' + path if path else ''}{' before' if before else ''}"


def _inner(condition: Condition) -> str:
    return f"({condition})" if isinstance(condition, Both | Either) else str(condition)
