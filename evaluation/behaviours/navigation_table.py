"""The paper's rules of the Navigation command manager as a table in whole degrees, and the network beside it.

The table is written from section 3.5 and our readings of it; it shares no code with `control/behaviours/managers.py`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

from waychair.control.behaviours.activations import bypass
from waychair.control.behaviours.cell import Cell, Sensor
from waychair.control.behaviours.cell_network import Network, Wiring, wire
from waychair.control.behaviours.commands import DoorCommand, FreeCommand, FreeKind, Move, Signal, SignalKind
from waychair.control.behaviours.conditions import AtLeast
from waychair.control.behaviours.free_space import WayFound
from waychair.control.behaviours.managers import StickDirection
from waychair.control.behaviours.paper import paper_network
from waychair.control.behaviours.runtime import Runtime
from waychair.control.behaviours.sonar import Obstacle, ObstacleClasses

DEGREES = (0, 45, 90, 135, 180, -135, -90, -45)
DOORS: tuple[tuple[str, int] | None, ...] = (
    None,
    *(("go", degrees) for degrees in DEGREES),
    ("swivel", 60),
    ("swivel", -60),
)
STICKS: tuple[int | None, ...] = (None, *DEGREES)


@dataclass(frozen=True, slots=True)
class Case:
    """A row: classes of the eight sonars, Command_free (degrees, "stop" or "null"), door's command, and the stick."""

    classes: tuple[int, ...]
    free: tuple[int, ...] | str
    door: tuple[str, int] | None = None
    stick: int | None = None


def expected(case: Case) -> tuple[str, str, int | None]:
    """Return the kind of the signal, its word, and its orientation in degrees if it has one."""
    listed = case.free if isinstance(case.free, tuple) else ()
    if case.free == "stop":
        return "warning", "no way is free", None
    if case.door is not None:
        word, wanted = case.door
        if case.free == "null":
            return "direction", word, wanted
        gaps = {degrees: _apart(degrees, wanted) for degrees in listed}
        if min(gaps.values()) > 45:
            return "warning", "door blocked", None
        return "direction", word, wanted if word == "swivel" else _fittest(listed, wanted)
    if listed and sum(each == Obstacle.IMMEDIATE for each in case.classes) > 2:
        return "direction", "go", _fittest(listed, 0 if case.stick is None else case.stick)
    if all(each == Obstacle.UNKNOWN for each in case.classes):
        return "warning", "no sonar is heard", None
    return "space", "", None


def _apart(first: int, second: int) -> int:
    gap = abs(first - second) % 360
    return min(gap, 360 - gap)


def _fittest(listed: tuple[int, ...], wanted: int) -> int:
    nearest = min(_apart(each, wanted) for each in listed)
    tied = [each for each in listed if _apart(each, wanted) == nearest]
    widest = max(_part(listed, each) for each in tied)
    return max(each for each in tied if _part(listed, each) == widest)


def _part(listed: tuple[int, ...], degrees: int) -> int:
    """Return how many neighbouring orientations of the list belong to the free part around one."""
    part, grown = {degrees}, True
    while grown:
        found = {each for each in listed if any(_apart(each, other) == 45 for other in part)} - part
        part |= found
        grown = bool(found)
    return len(part)


def manager() -> Wiring:
    """Return the paper's Navigation command manager with stand-ins for the three behaviours that it hears."""
    whole = paper_network()
    members = {node.name: node for node in whole.root.cells}
    doorway = Network(
        "Doorway navigation",
        [Cell("Path planner", bypass(DoorCommand, "command"), links={"command": "door"})],
        output="Path planner",
        excited_by=AtLeast("door on", 1),
    )
    sensors = (
        Sensor("Obstacle notification", ObstacleClasses),
        Sensor("Free-space finding", WayFound),
        Sensor("door", DoorCommand),
        Sensor("door on", bool),
        Sensor("stick", StickDirection),
    )
    manager = members["Navigation command manager"]
    return wire(Network("stand-ins", [doorway, manager], output=manager.name), sensors)


class TableRun:
    """The manager's network, asked for one case after another."""

    def __init__(self) -> None:
        self._runtime, self._now_ns = Runtime(manager()), 0

    def signal(self, case: Case) -> Signal:
        """Return the network's signal."""
        self._now_ns += 2_000_000_000  # nothing of the case before is fresh
        kinds = {"stop": FreeKind.STOP, "null": FreeKind.NULL}
        listed = case.free if isinstance(case.free, tuple) else ()
        kind = kinds[case.free] if isinstance(case.free, str) else FreeKind.LIST
        free = FreeCommand(kind, tuple(math.radians(each) for each in listed))
        heard: dict[str, object] = {
            "Obstacle notification": ObstacleClasses(tuple(map(Obstacle, case.classes))),
            "Free-space finding": WayFound(free),
            "door on": case.door is not None,
        }
        if case.door is not None:
            heard["door"] = DoorCommand(Move(case.door[0]), math.radians(case.door[1]))
        if case.stick is not None:
            angle = math.radians(case.stick)
            heard["stick"] = StickDirection(math.cos(angle), math.sin(angle))
        signal = self._runtime.innervate(self._now_ns, heard).ports["encode_packet"].eo
        assert isinstance(signal, Signal)
        return signal


def found(signal: Signal) -> tuple[str, str, int | None]:
    """Return a signal in the form of `expected`."""
    if signal.kind is SignalKind.WARNING:
        return "warning", signal.reason, None
    if signal.kind is SignalKind.SPACE:
        return "space", "", None
    return "direction", signal.move.value, round(math.degrees(signal.orientation))


def obstacle_cases() -> Iterator[Case]:
    """Yield all combinations of the classes of eight sonars that are not mirror images, with each Command_free and door.

    The list is one of three: ahead free, behind free, all free. Sonars are numbered from the right to the left.
    """
    frees: tuple[tuple[int, ...] | str, ...] = ("stop", "null", (0, 45, -45), (135, 180), DEGREES)
    for classes in itertools.product(range(5), repeat=8):
        if classes <= classes[::-1]:
            for free in frees:
                for door in (None, ("go", 0)):
                    yield Case(classes, free, door)


def list_cases() -> Iterator[Case]:
    """Yield every list of free orientations, stop and null, with every door command, stick, and few or many obstacles."""
    subsets = [tuple(each for k, each in enumerate(DEGREES) if mask >> k & 1) for mask in range(1, 256)]
    many, few = (4, 4, 1, 1, 4, 2, 3, 1), (4, 4, 1, 1, 3, 2, 3, 1)
    frees: tuple[tuple[int, ...] | str, ...] = ("stop", "null", *subsets)
    for free in frees:
        for door in DOORS:
            for stick in STICKS if door is None else (None, 180):
                for classes in (many, few):
                    yield Case(classes, free, door, stick)
