"""Random behaviour networks: nested, with shared cells, rates, triggers, resets, loops, faults and stale values."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from waychair.control.behaviours.activations import bypass, gaussian, sigmoid, weighted_sum
from waychair.control.behaviours.cell import Behaviour, Cell, Link, Reading, Sensor
from waychair.control.behaviours.cell_network import Network
from waychair.control.behaviours.conditions import ALWAYS, NEVER, Active, AtLeast, Below, Condition, PortSource

MOST_CELLS = 60
SENSORS = tuple(Sensor(f"s{k}", float) for k in range(4))
_DEEPEST = 5


@dataclass(frozen=True)
class Tally:
    """Dynamic data of the random cells."""

    runs: int = 0
    total: float = 0.0


def tally(x: float | None, y: Reading[float] | None, dynamic: Tally, now_ns: int) -> tuple[float, Tally]:
    """Count, sum, and depend on the stamp and activation of y."""
    age = 0.0 if y is None else (now_ns - y.stamp_ns) * 1e-9 + (0.25 if y.active else 0.0)
    new = Tally(dynamic.runs + 1, 0.5 * dynamic.total + (x or 0.0))
    return new.total + age + 0.001 * new.runs, new


def inverse(x: float) -> float:
    """Return 1 / x; raises at 0."""
    return 1.0 / round(x)


def needs_both(x: float, y: float) -> float | None:
    """Return no value below a limit."""
    return x * y if x > 0.2 else None


def act(effect: float, x: float | None) -> float:
    """Return an action from the effect and a port."""
    return effect - (x or 0.0)


@dataclass
class _Making:
    rng: random.Random
    known: list[str] = field(default_factory=list)  # nodes in running order that have run before
    valued: list[str] = field(default_factory=list)  # those with EO
    cells: list[Cell] = field(default_factory=list)
    promised: list[str] = field(default_factory=list)  # names of all cells, for links to values before
    count: int = 0
    effectors: int = 0


def random_network(seed: int) -> Network:
    """Return a network of at most 60 cells; the same for the same seed."""
    rng = random.Random(seed)
    making = _Making(rng)
    size = rng.randint(3, MOST_CELLS)
    making.promised = [f"c{k}" for k in range(size)]
    members: list[Cell | Network] = []
    while making.count < size:
        members.append(_node(making, size, 0))
    return Network(
        "root", members, output=members[-1].name if making.cells and members[-1].name in making.valued else ""
    )


def _node(making: _Making, size: int, depth: int) -> Cell | Network:
    rng = making.rng
    if depth < _DEEPEST and rng.random() < 0.22 and size - making.count >= 2:
        return _network(making, size, depth)
    return _cell(making)


def _network(making: _Making, size: int, depth: int) -> Network:
    rng = making.rng
    name = f"n{len(making.known)}_{making.count}"
    gates: dict[str, Any] = _gates(making, loops=True)
    earlier = list(making.cells)
    making.known.append(name)
    members: list[Cell | Network] = []
    for _ in range(rng.randint(1, 6)):
        if making.count >= size:
            break
        members.append(_node(making, size, depth + 1))
    if earlier and rng.random() < 0.6:
        members.insert(rng.randint(0, len(members)), rng.choice(earlier))
    names = {member.name for member in members}
    valued = sorted(names & set(making.valued))
    output = rng.choice(valued) if valued and rng.random() < 0.8 else ""
    if output:
        making.valued.append(name)
    cleared = (rng.choice(sorted(names)),) if rng.random() < 0.3 else ()
    return Network(name, members, output=output, cleared=cleared, **gates)


def _cell(making: _Making) -> Cell:
    rng = making.rng
    name = making.promised[min(making.count, len(making.promised) - 1)]
    making.count += 1
    function, ports = _function(rng)
    links = {port: _link(making) for port in ports if rng.random() < 0.85}
    actions: dict[str, Callable[..., Any] | Behaviour] = {}
    if rng.random() < 0.2:
        making.effectors += 1
        actions[f"e{making.effectors}"] = act
        links.setdefault("x", _link(making))
    takes_memory = function is tally
    declared: dict[str, Any] = _gates(making, loops=True)
    if rng.random() < 0.25:
        declared["inhibited_output"] = round(rng.uniform(-2, 0), 3)
    if takes_memory:
        declared["dynamic"] = Tally()
        declared["cleared"] = rng.choice([(), (), ("runs",), ("total",)])
    if links and rng.random() < 0.3:
        declared["fresh_ns"] = {rng.choice(sorted(links)): rng.choice([0, 50_000_000, 400_000_000])}
    cell = Cell(name, function, actions, links=links, **declared)
    making.known.append(name)
    making.valued.append(name)
    making.cells.append(cell)
    return cell


def _function(rng: random.Random) -> tuple[Callable[..., Any] | Behaviour, tuple[str, ...]]:
    kinds: list[tuple[Callable[..., Any] | Behaviour, tuple[str, ...]]] = [
        (tally, ("x", "y")),
        (tally, ("x", "y")),
        (needs_both, ("x", "y")),
        (inverse, ("x",)),
        (bypass(float, "x"), ("x",)),
        (weighted_sum({"x": round(rng.uniform(-2, 2), 2), "y": 1.0}, 0.1), ("x", "y")),
        (sigmoid({"x": 1.0, "y": -2.0}, 0.2, 3.0), ("x", "y")),
        (gaussian("x", 0.5, 0.4), ("x",)),
    ]
    return rng.choice(kinds)


def _gates(making: _Making, loops: bool) -> dict[str, Any]:
    """Return random EB, IB, RS, and a rate or triggers."""
    rng = making.rng
    gates: dict[str, Any] = {
        "excited_by": _condition(making) if rng.random() < 0.45 else ALWAYS,
        "inhibited_by": _condition(making) if rng.random() < 0.25 else NEVER,
        "reset_by": _condition(making) if rng.random() < 0.2 else NEVER,
    }
    pace = rng.random()
    if pace < 0.15:
        gates["every_ns"] = rng.choice([70_000_000, 130_000_000, 500_000_000])
    elif pace < 0.25:
        gates["triggers"] = tuple(sorted({_source(making) for _ in range(rng.randint(1, 2))}))
    return gates


def _source(making: _Making) -> str:
    rng = making.rng
    return rng.choice(making.valued) if making.valued and rng.random() < 0.75 else rng.choice(SENSORS).name


def _link(making: _Making) -> Link:
    rng = making.rng
    if rng.random() < 0.15:
        return PortSource(rng.choice(making.promised), before=True)
    return _source(making)


def _condition(making: _Making, depth: int = 0) -> Condition:
    rng = making.rng
    kind = rng.random()
    if depth < 3 and kind < 0.3:
        first, second = _condition(making, depth + 1), _condition(making, depth + 1)
        return first & second if rng.random() < 0.4 else first | second
    if kind < 0.4:
        return ~_condition(making, depth + 1) if depth < 3 else ALWAYS
    if kind < 0.65 and making.known:
        if rng.random() < 0.25:
            return Active(rng.choice(making.promised), before=True)
        return Active(rng.choice(making.known))
    limit = round(rng.uniform(-0.5, 1.2), 2)
    before = rng.random() < 0.2
    name = rng.choice(making.promised) if before else _source(making)
    return AtLeast(name, limit, before=before) if rng.random() < 0.6 else Below(name, limit, before=before)


def random_values(rng: random.Random, now_ns: int) -> dict[str, Any]:
    """Return what the sensors say at a stamp: often nothing, sometimes late, sometimes not a number."""
    heard: dict[str, Any] = {}
    for sensor in SENSORS:
        if rng.random() < 0.5:
            value = rng.choice([float("nan"), 0.0, 1.0]) if rng.random() < 0.15 else round(rng.uniform(-0.5, 1.5), 3)
            late_ns = rng.choice([30_000_000, 300_000_000, -20_000_000])
            heard[sensor.name] = Reading(value, now_ns - late_ns) if rng.random() < 0.2 else value
    return heard
