"""The behaviour cell: typed ports, a behavioural function, and storage (paper section 2.1.1, with our readings).

A cell has the ports EB (excitatory), IB (inhibitory), DI (data), RS (reset) and IS (innervation) in, and AB
(activation), EO (effect) and AO (actuator) out. Whenever IS fires, five steps run in this order (`runtime.py`):

1. EB false: AB = 0, return. EB true: AB = 1. (The printed text leaves AB as it was; `Runtime(literal=True)` keeps that.)
2. IB true: AB = 0, write the declared `inhibited_output` to EO, return.
3. RS true: clear all or the named dynamic data. A reset that comes while step 3 is not reached is kept until it is.
4. The function of DI gives EO. 5. The function of DI gives AO. A cell with both ports writes EO, then AO, then returns.

Unconnected ports: EB true, IB and RS false, DI none. A DI port that needs a value and has none gives EO no value.

A behavioural function is a plain function. Its parameters are the DI ports, typed by their annotations:

    def decode_packet(packet: SonarPacket) -> Ranges: ...                # needs a packet
    def way_finder(ranges: Ranges, depth: Depth | None, constants: Limits, dynamic: Seen) -> tuple[Way, Seen]: ...

`static`, `constants` and `dynamic` are the three storages, `now_ns` is the stamp of the innervation, and `effect` the EO
just written (for AO). A function with dynamic data returns its output and the new data; after an exception the old stay.
"""

from __future__ import annotations

import dataclasses
import inspect
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, TypeAlias, TypeVar, Union

from waychair.control.behaviours.conditions import ALWAYS, NEVER, Condition, PortSource
from waychair.errors import WiringError

T = TypeVar("T")

STORAGES = ("static", "constants", "dynamic")
_SPECIAL = (*STORAGES, "now_ns", "effect")
"""Parameters of a behavioural function that are not DI ports."""


@dataclass(frozen=True, slots=True)
class Reading(Generic[T]):
    """A value with the stamp at which it was written, and whether its cell was active then (a sensor always is).

    Annotate a DI port with `Reading[T]` to get the stamp beside the value.
    """

    value: T
    stamp_ns: int
    active: bool = True


@dataclass(frozen=True, slots=True)
class Sensor:
    """A source of data outside all networks, such as a sonar's packets; `kind` is the type of its values."""

    name: str
    kind: Any


@dataclass(frozen=True, slots=True)
class DataPort:
    """A DI port: the type of its values; whether the function needs one; whether it gets a `Reading`."""

    kind: Any
    needed: bool = True
    with_stamp: bool = False


@dataclass(frozen=True, slots=True)
class Behaviour:
    """A behavioural function with its ports: `gives` is the type of its output, `passes` the special parameters.

    `keeps`: the function returns its output and the new dynamic data.
    """

    call: Callable[..., Any]
    ports: Mapping[str, DataPort]
    gives: Any
    passes: tuple[str, ...] = ()
    keeps: bool = False


def behaviour_from(function: Callable[..., Any] | Behaviour) -> Behaviour:
    """Return a plain function as a behavioural function, its ports read from its annotations.

    Raises:
        WiringError: a parameter or the result has no annotation.
    """
    if isinstance(function, Behaviour):
        return function
    name = getattr(function, "__name__", repr(function))
    try:
        hints = typing.get_type_hints(function)
        parameters = inspect.signature(function).parameters
    except (TypeError, NameError, ValueError) as error:
        raise WiringError(f"the ports of {name} cannot be read: {error}; annotate a plain function") from error
    missing = [each for each in (*parameters, "return") if each not in hints and each not in _SPECIAL]
    if missing:
        raise WiringError(f"{name} has no annotation for {missing[0]}: give the type of each port")
    ports = {each: _port_from(hints[each]) for each in parameters if each not in _SPECIAL}
    gives, keeps = hints["return"], "dynamic" in parameters
    if keeps:
        arguments = typing.get_args(gives)
        if typing.get_origin(gives) is not tuple or len(arguments) != 2:
            raise WiringError(f"{name} takes dynamic data, so it must return a tuple of its output and the new data")
        gives = arguments[0]
    passes = tuple(each for each in parameters if each in _SPECIAL)
    return Behaviour(function, ports, gives, passes, keeps)


def _port_from(hint: Any) -> DataPort:
    kinds = members_of(hint)
    needed = type(None) not in kinds
    kinds = tuple(kind for kind in kinds if kind is not type(None))
    if len(kinds) == 1 and typing.get_origin(kinds[0]) is Reading:
        return DataPort(typing.get_args(kinds[0])[0], needed, with_stamp=True)
    return DataPort(hint, needed)


def members_of(hint: Any) -> tuple[Any, ...]:
    """Return the members of a union, or the type itself."""
    return typing.get_args(hint) if typing.get_origin(hint) in (Union, types.UnionType) else (hint,)


def fits(given: Any, taken: Any) -> bool:
    """Return whether values of one type may go to a port of another; None is a missing value and may go anywhere."""
    wanted = members_of(taken)
    return all(
        kind is type(None) or any(_member_fits(kind, each) for each in wanted if each is not type(None))
        for kind in members_of(given)
    )


def _member_fits(given: Any, taken: Any) -> bool:
    if taken in (Any, object) or given == taken:
        return True
    if given is int and taken is float:
        return True
    return isinstance(given, type) and isinstance(taken, type) and given is not bool and issubclass(given, taken)


def checked_classes(kind: Any) -> tuple[type, ...] | None:
    """Return the classes of which a value of this type is an instance; None if it cannot be told."""
    classes: list[type] = []
    for member in members_of(kind):
        plain = typing.get_origin(member) or member
        if not isinstance(plain, type):
            return None
        classes += [int, float] if plain is float else [plain]
    return None if object in classes else tuple(classes)


class _Unset:
    def __repr__(self) -> str:
        return "nothing"


UNSET = _Unset()
"""No `inhibited_output`: an inhibited cell leaves its EO as it is."""

Link: TypeAlias = str | PortSource
"""The source of a DI port: the name of a cell, network or sensor, or `before(name)`."""


def before(name: str) -> PortSource:
    """Return a link to the EO of a cell as it was before this innervation; a loop between cells needs one."""
    return PortSource(name, before=True)


def port_source(link: Link) -> PortSource:
    """Return a link as the port that it reads."""
    return PortSource(link) if isinstance(link, str) else link


@dataclass(frozen=True, eq=False)
class Cell:
    """A behaviour cell as it is declared; cells are told apart by their names.

    `effect` gives EO; `actions` give AO, by the effector's name. `links` say where each DI port reads. `fresh_ns`: the
    greatest age of a DI port's value; an older one counts as missing. `cleared` names the dynamic data that a reset
    clears; empty: all. `every_ns`: the period of the cell; 0: at every innervation. `triggers`: sources; the cell runs
    only after one of them has written. `actions` and `effect` are plain functions or `Behaviour`s.
    """

    name: str
    effect: Callable[..., Any] | Behaviour | None = None
    actions: Mapping[str, Callable[..., Any] | Behaviour] = field(default_factory=dict)
    links: Mapping[str, Link] = field(default_factory=dict)
    excited_by: Condition = ALWAYS
    inhibited_by: Condition = NEVER
    reset_by: Condition = NEVER
    static: Any = None
    constants: Any = None
    dynamic: Any = None
    cleared: tuple[str, ...] = ()
    inhibited_output: Any = UNSET
    fresh_ns: Mapping[str, int] = field(default_factory=dict)
    every_ns: int = 0
    triggers: tuple[str, ...] = ()

    def functions(self) -> tuple[Behaviour, ...]:
        """Return the behavioural functions: that of EO, if there is one, then those of AO.

        Raises:
            WiringError: a function's ports cannot be read.
        """
        given = ((self.effect,) if self.effect is not None else ()) + tuple(self.actions.values())
        return tuple(behaviour_from(each) for each in given)

    def reset_data(self, dynamic: Any) -> Any:
        """Return the dynamic data after a reset: as declared, or with only the fields `cleared` as declared."""
        if not self.cleared:
            return self.dynamic
        return dataclasses.replace(dynamic, **{name: getattr(self.dynamic, name) for name in self.cleared})
