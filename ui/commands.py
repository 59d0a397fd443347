"""The commands of a page in one table: name on the wire, arguments, and call of the `ChairPort`.

Arguments that are missing, unknown, of the wrong type or not finite are refused before the chair is called.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import msgspec
import numpy as np

from waychair.control.haptics.next_door import DoorSide
from waychair.errors import WaychairError
from waychair.geometry import wrap_angle
from waychair.maps.drawn.zones import SLOWEST, Rule, Zone
from waychair.runtime.pages.chair_port import ChairPort, PortAnswer
from waychair.types import HelpLevel, Place, Pose2

STOP = "stop"
RELEASE = "release"
STICK = ("steer", RELEASE)
"""Commands of the page's joystick; only the newest position counts."""

_FAR = 1e5
Metres = Annotated[float, msgspec.Meta(ge=-_FAR, le=_FAR)]
Angle = Annotated[float, msgspec.Meta(ge=-1e3, le=1e3)]
Axis = Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)]
NewName = Annotated[str, msgspec.Meta(min_length=1, max_length=60)]
"""A name that a page gives; existing names from other sources may be longer."""

Corners = Annotated[list[tuple[Metres, Metres]], msgspec.Meta(min_length=3, max_length=200)]
Tolerance = Annotated[float, msgspec.Meta(gt=0.0, le=5.0)]
Speed = Annotated[float, msgspec.Meta(ge=SLOWEST, le=5.0)]


class _Arguments(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of the arguments of commands."""


class _NoArguments(_Arguments, frozen=True):
    pass


class _GoArguments(_Arguments, frozen=True):
    place: str = ""
    pose: tuple[Metres, Metres, Angle] | None = None


class _ConfirmArguments(_Arguments, frozen=True):
    goal: str = ""


class _StoreyArguments(_Arguments, frozen=True):
    storey: str


class _PlaceNameArguments(_Arguments, frozen=True):
    goal: str


class _SideArguments(_Arguments, frozen=True):
    side: DoorSide


class _GuideArguments(_Arguments, frozen=True):
    goal: str
    level: Annotated[int, msgspec.Meta(ge=0, le=3)] = 2


class _LevelArguments(_Arguments, frozen=True):
    level: HelpLevel


class _SteerArguments(_Arguments, frozen=True):
    forward: Axis
    turn: Axis


class _PlaceHereArguments(_Arguments, frozen=True):
    name: NewName
    tolerance_m: Tolerance
    tolerance_rad: Tolerance
    replaces: bool = False


class _PlaceArguments(_Arguments, frozen=True):
    name: NewName
    pose: tuple[Metres, Metres, Angle]
    tolerance_m: Tolerance
    tolerance_rad: Tolerance
    replaces: bool = False


class _NameArguments(_Arguments, frozen=True):
    name: str


class _RenameArguments(_NameArguments, frozen=True):
    new_name: NewName


class _ZoneArguments(_Arguments, frozen=True):
    name: NewName
    rule: Rule
    polygon: Corners
    speed: Speed = 0.3
    heading: Angle = 0.0
    replaces: bool = False


class _EraseArguments(_Arguments, frozen=True):
    polygon: Corners


class _RelocaliseArguments(_Arguments, frozen=True):
    pose: tuple[Metres, Metres, Angle] | None = None


def _pose(values: tuple[float, float, float]) -> Pose2:
    x, y, theta = values
    return Pose2(x, y, wrap_angle(theta))


def _go(port: ChairPort, asked: _GoArguments) -> PortAnswer:
    if bool(asked.place) == (asked.pose is not None):
        return PortAnswer(False, "a drive leads to a place or to a point: choose one")
    return port.go(asked.place if asked.pose is None else _pose(asked.pose))


def _set_place(port: ChairPort, asked: _PlaceArguments) -> PortAnswer:
    place = Place(asked.name, _pose(asked.pose), asked.tolerance_m, asked.tolerance_rad)
    return port.set_place(place, asked.replaces)


def _set_zone(port: ChairPort, asked: _ZoneArguments) -> PortAnswer:
    value = {Rule.KEEP_OUT: 0.0, Rule.SLOW: asked.speed, Rule.ONE_WAY: wrap_angle(asked.heading)}[asked.rule]
    polygon = np.array(asked.polygon, np.float64)
    x, y = (polygon - polygon[0]).T
    if not math.fabs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) > 1e-6:
        return PortAnswer(False, "the corners of this zone enclose no area: set them in order around it")
    return port.set_zone(Zone(asked.name, asked.rule, polygon, value), asked.replaces)


@dataclass(frozen=True, slots=True)
class _Command:
    asked: type[_Arguments]
    call: Callable[[ChairPort, Any], PortAnswer]


COMMANDS: Mapping[str, _Command] = {
    STOP: _Command(_NoArguments, lambda port, _: port.stop()),
    "steer": _Command(_SteerArguments, lambda port, asked: port.steer(asked.forward, asked.turn)),
    RELEASE: _Command(_NoArguments, lambda port, _: port.release()),
    "go": _Command(_GoArguments, _go),
    "confirm": _Command(_ConfirmArguments, lambda port, asked: port.confirm(asked.goal)),
    "pause": _Command(_NoArguments, lambda port, _: port.pause()),
    "go_on": _Command(_NoArguments, lambda port, _: port.go_on()),
    "storey": _Command(_StoreyArguments, lambda port, asked: port.answer_storey(asked.storey)),
    "start_at": _Command(_PlaceNameArguments, lambda port, asked: port.start_at(asked.goal)),
    "guide": _Command(_GuideArguments, lambda port, asked: port.guide(asked.goal, asked.level)),
    "lead": _Command(_PlaceNameArguments, lambda port, asked: port.lead(asked.goal)),
    "lead_through": _Command(_SideArguments, lambda port, asked: port.lead_through(asked.side)),
    "end_lead": _Command(_NoArguments, lambda port, _: port.end_lead()),
    "say_again": _Command(_NoArguments, lambda port, _: port.say_again()),
    "say_where": _Command(_NoArguments, lambda port, _: port.say_where()),
    "end_guide": _Command(_NoArguments, lambda port, _: port.end_guide()),
    "level": _Command(_LevelArguments, lambda port, asked: port.choose_level(asked.level)),
    "override": _Command(_NoArguments, lambda port, _: port.override_guard()),
    "cancel": _Command(_NoArguments, lambda port, _: port.cancel()),
    "reset": _Command(_NoArguments, lambda port, _: port.reset()),
    "place_here": _Command(
        _PlaceHereArguments, lambda port, at: port.place_here(at.name, at.tolerance_m, at.tolerance_rad, at.replaces)
    ),
    "set_place": _Command(_PlaceArguments, _set_place),
    "rename_place": _Command(_RenameArguments, lambda port, asked: port.rename_place(asked.name, asked.new_name)),
    "remove_place": _Command(_NameArguments, lambda port, asked: port.remove_place(asked.name)),
    "set_zone": _Command(_ZoneArguments, _set_zone),
    "remove_zone": _Command(_NameArguments, lambda port, asked: port.remove_zone(asked.name)),
    "erase": _Command(_EraseArguments, lambda port, asked: port.erase(np.array(asked.polygon, np.float64))),
    "undo": _Command(_NoArguments, lambda port, _: port.undo()),
    "relocalise": _Command(
        _RelocaliseArguments, lambda port, at: port.relocalise(None if at.pose is None else _pose(at.pose))
    ),
}
"""Every command by its name on the wire."""


def obey(port: ChairPort, name: str, asked: object) -> PortAnswer:
    """Run a page's command with its JSON arguments `asked`, and return the answer. Never raises."""
    command = COMMANDS.get(name)
    if command is None:
        return PortAnswer(False, f"unknown command '{name[:40]}': reload this page")
    try:
        return command.call(port, msgspec.convert(asked, command.asked))
    except msgspec.ValidationError as error:
        return PortAnswer(False, f"the command is invalid: {error}")
    except WaychairError as error:
        return PortAnswer(False, str(error))
    except Exception:  # every press of a button gets an answer
        logging.getLogger(__name__).exception("'%s' failed", name)
        return PortAnswer(False, "the chair's program failed at this command: see its log, then restart it")
