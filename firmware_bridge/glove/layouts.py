"""Layouts of motors on the body, as data: `layouts.yaml`.

A motor's place is given on the unrolled skin of its site [mm], so that distances over the skin need no body model. Its number in
the layout is also the number of the board's output when the device sits straight; `fitting.py` turns it.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from waychair.errors import GloveError
from waychair.geometry import wrap_angle
from waychair.yaml_files import load_yaml

LAYOUTS_FILE = Path(__file__).with_name("layouts.yaml")

MOTORS_MAX = 16
"""Most motors of one board: a step names them by 16 bits."""


@dataclass(frozen=True, slots=True)
class Tactor:
    """A motor on the skin: its site, its place [mm] on the unrolled skin, and the direction [rad] that it stands for.

    x is forward (on a belt: up), y to the left. `direction` is to the left of straight ahead, or None.
    """

    site: str
    x_mm: float
    y_mm: float
    direction: float | None = None


@dataclass(frozen=True, slots=True)
class TactorLayout:
    """The motors of one kind of device.

    `rings`: motors in order to the left, each beginning with the one that sits where `rings_begin` says in words; `girths` [mm]:
    round of closed sites.
    """

    name: str
    number: int
    about: str
    tactors: tuple[Tactor, ...]
    rings: tuple[tuple[int, ...], ...]
    rings_begin: str
    girths: Mapping[str, float] = field(default_factory=dict)

    def skin_distance_mm(self, first: int, second: int) -> float:
        """Return the distance between two motors over the skin; infinite between different sites."""
        a, b = self.tactors[first], self.tactors[second]
        if a.site != b.site:
            return math.inf
        across = abs(a.y_mm - b.y_mm)
        girth = self.girths.get(a.site)
        if girth is not None:
            across = min(across, girth - across)
        return math.hypot(a.x_mm - b.x_mm, across)

    @property
    def spacing_mm(self) -> float:
        """The least distance between two motors over the skin."""
        count = len(self.tactors)
        return min(self.skin_distance_mm(a, b) for a in range(count) for b in range(a))

    def towards(self, direction: float) -> int:
        """Return the motor that stands for the direction [rad] nearest to this one."""
        pointing = [(k, tactor.direction) for k, tactor in enumerate(self.tactors) if tactor.direction is not None]
        return min(pointing, key=lambda each: (round(abs(wrap_angle(each[1] - direction)), 9), each[0]))[0]


class _Motor(msgspec.Struct, forbid_unknown_fields=True):
    site: str
    at: tuple[float, float]
    points: float | None = None


class _Layout(msgspec.Struct, forbid_unknown_fields=True):
    number: int
    about: str
    motors: list[_Motor]
    rings: list[list[int]]
    rings_begin: str
    girths: dict[str, float] = msgspec.field(default_factory=dict)


@functools.cache
def layouts(path: Path = LAYOUTS_FILE) -> Mapping[str, TactorLayout]:
    """Return the layouts of a file by name.

    Raises:
        GloveError: the file cannot be read, or a layout in it is impossible.
    """
    values = load_yaml(path, GloveError)
    try:
        read = msgspec.convert(values, dict[str, _Layout])
    except msgspec.ValidationError as error:
        raise GloveError(f"{path}: {error}; write the layout as the shipped ones are") from error
    result = {name: _checked(name, layout, path) for name, layout in read.items()}
    numbers = [layout.number for layout in result.values()]
    if len(set(numbers)) < len(numbers):
        raise GloveError(
            f"{path}: two layouts have the same number: a board names its layout by it, so give each its own"
        )
    return result


def layout_named(name: str) -> TactorLayout:
    """Return a shipped layout.

    Raises:
        GloveError: there is no such layout.
    """
    known = layouts()
    if name not in known:
        raise GloveError(f"there is no layout '{name}': choose among {', '.join(known)}")
    return known[name]


def layout_numbered(number: int) -> TactorLayout | None:
    """Return the shipped layout with the number that a board reports; None for an unknown one."""
    return next((layout for layout in layouts().values() if layout.number == number), None)


def _checked(name: str, read: _Layout, path: Path) -> TactorLayout:
    count = len(read.motors)
    problem = _problem(read, count)
    if problem:
        raise GloveError(f"{path}: layout '{name}' {problem}")
    tactors = tuple(
        Tactor(each.site, *each.at, None if each.points is None else wrap_angle(math.radians(each.points)))
        for each in read.motors
    )
    return TactorLayout(
        name, read.number, read.about, tactors, tuple(map(tuple, read.rings)), read.rings_begin, dict(read.girths)
    )


def _problem(read: _Layout, count: int) -> str:
    """Return why a layout is impossible, with a remedy; empty if it is possible."""
    numbers: list[Any] = [*(v for each in read.motors for v in (*each.at, each.points or 0.0)), *read.girths.values()]
    ringed = [motor for ring in read.rings for motor in ring]
    if not 2 <= count <= MOTORS_MAX:
        return f"has {count} motors: a board drives 2 to {MOTORS_MAX}"
    if not 1 <= read.number <= 255:
        return f"has the number {read.number}: give one from 1 to 255"
    if not all(map(math.isfinite, numbers)) or any(girth <= 0 for girth in read.girths.values()):
        return "holds a place, direction or girth that is no possible number: give millimetres and degrees"
    if any(not 0 <= motor < count for motor in ringed) or len(set(ringed)) < len(ringed):
        return f"has a ring with a motor twice, or one that is not from 0 to {count - 1}: name each once"
    if all(each.points is None for each in read.motors):
        return "has no motor that points anywhere: give `points` in degrees"
    return ""
