"""The interface between a page and a chair, with its data types. A chair in this program and one behind ROS offer it.

Calls come from the web server's threads, return within `ANSWER_S` and never raise: a refusal is a `PortAnswer` with the
reason and the remedy.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from waychair.control.haptics.next_door import DoorSide
from waychair.maps.drawn.zones import Zone
from waychair.runtime.haptics.haptic_state import HapticState
from waychair.runtime.pages.guide_view import GuideView
from waychair.runtime.pages.perception_view import PerceptionView
from waychair.runtime.rider.guard_view import GuardView
from waychair.slam.localising.localisation import LocalisationState
from waychair.types import DriveMode, FloatArray, HelpLevel, OccupancyGrid, Place, Pose2, Twist

ANSWER_S = 2.0
"""A call returns within this; Stop has taken effect at the lines within 0.1 s of its call."""

STEER_S = 0.3
"""The page repeats the joystick's position within this time; silence counts as letting go."""


def _no_points() -> FloatArray:
    return np.empty((0, 2))


@dataclass(frozen=True, slots=True)
class PortAnswer:
    """The answer to a request: whether it was done, and a plain sentence for the rider."""

    done: bool
    sentence: str


@dataclass(frozen=True, slots=True)
class Hindrance:
    """A reason why the chair does not drive or stands: the stop's id, a plain sentence, and its remedy."""

    stop_id: str
    sentence: str
    remedy: str


@dataclass(frozen=True, slots=True)
class OthersView:
    """The other chairs of the building as a page shows them.

    `waits`: why this chair waits for its turn, as a sentence without the time; empty while it does not. `seconds`: the time [s]
    that is left of the wait, None where no end is foreseen. `others`: number and state in words of each other chair. `tones`: the
    times that people on the way were to be warned by a tone. `first`: why this chair goes before others, as a sentence; empty if
    it does not. `lit`: it goes before all others, and shows a light.
    """

    waits: str = ""
    seconds: float | None = None
    others: tuple[tuple[int, str], ...] = ()
    tones: int = 0
    first: str = ""
    lit: bool = False


@dataclass(frozen=True, slots=True)
class ChairView:
    """A chair as a page shows it, at `stamp_ns`.

    `map_from_base`, `scan` (N, 2), `path` (M, 2) and `people` (K, 2) [m] are in map; the pose is None while unknown.
    `goal`: the requested place or point, empty without one; `waits`: it waits for the rider's yes; `countdown_s`: time
    until the first motion, None outside the countdown. `next_action` and `last_stop` are plain sentences: the chair's
    next action and the reason of its last stop. `map_revision` changes with the grid, `layout_revision` with places and
    zones. `panel` is for engineers: figures by name, units in the names. `stamp_ns` and `free_since_ns` are of the
    computer's steady clock (`time.monotonic_ns`); the latter is the time since which the rider's own joystick has the
    lines, None while the computer holds them. `steered`: a page's joystick drives. `paused`: the drive stands until
    somebody lets it go on. `offers`: it waits at a doorway, and another way is taken once somebody lets it go on.
    `storey`: the name of the storey whose map this is, empty for a chair that knows one map only. `asks`: the storeys
    among which the rider chooses, since the chair in a lift is not certain where it is; see `answer_storey`.
    `guide`: step guidance, None without. `guard`: the level of help while the rider drives, None for a chair without levels.
    `others`: the other chairs, None for a chair that shares no building.
    """

    stamp_ns: int
    map_from_base: Pose2 | None
    localisation: LocalisationState
    health: float
    mode: DriveMode
    twist: Twist
    goal: str = ""
    waits: bool = False
    countdown_s: float | None = None
    next_action: str = ""
    last_stop: str = ""
    obstacles: tuple[Hindrance, ...] = ()
    scan: FloatArray = field(default_factory=_no_points)
    path: FloatArray = field(default_factory=_no_points)
    people: FloatArray = field(default_factory=_no_points)
    map_revision: int = 0
    layout_revision: int = 0
    panel: Mapping[str, float] = field(default_factory=dict)
    free_since_ns: int | None = None
    steered: bool = False
    paused: bool = False
    offers: bool = False
    storey: str = ""
    asks: tuple[str, ...] = ()
    guide: GuideView | None = None
    guard: GuardView | None = None
    others: OthersView | None = None


@dataclass(frozen=True, slots=True)
class LayoutView:
    """The drawn part of a map: places by name, zones, and whether there is a change to undo."""

    places: Mapping[str, Place] = field(default_factory=dict)
    zones: tuple[Zone, ...] = ()
    undoable: bool = False


@dataclass(frozen=True, slots=True)
class GoalView:
    """A goal of the building for menus: the name that `go` takes, the menus that lead to it, its time and lifts from here.

    `path`: names from the storey down to the goal itself, in the order of the building. `seconds` and `lifts`: the driving
    time [s] and the number of lift rides from the chair's place, None while they are unknown.
    """

    name: str
    path: tuple[str, ...]
    seconds: float | None = None
    lifts: int | None = None


class ChairPort(Protocol):
    """The calls of a page to a chair."""

    @property
    def outline(self) -> FloatArray:
        """Corners of the chair's footprint in base, (N, 2) [m]."""

    def view(self) -> ChairView:
        """Return the chair's present state; cheap."""

    def grid(self) -> OccupancyGrid | None:
        """Return the map of `view().map_revision`; None while there is none."""

    def layout(self) -> LayoutView:
        """Return places and zones of `view().layout_revision`."""

    def goals(self) -> Sequence[GoalView]:
        """Return the goals of a building in its order; empty for a chair that knows one map only, with its places."""

    def picture(self) -> bytes | None:
        """Return the camera's latest picture as JPEG; None without a camera."""

    def perception(self) -> PerceptionView | None:
        """Return what the behaviour cells perceive; None without them. It is asked for only while a page shows it."""

    def network(self, name: str) -> str | None:
        """Return the picture (SVG) of one network of cells; None if there is none of this name."""

    def haptics(self) -> HapticState | None:
        """Return the advice for a rider without sight, and the state of glove and voice; None without them."""

    def go(self, goal: str | Pose2) -> PortAnswer:
        """Ask for a drive to a place or a pose in map; it waits for `confirm`."""

    def confirm(self, goal: str = "") -> PortAnswer:
        """Begin the drive by the rider's yes: tone and phrase, 3 s in which `cancel` and `stop` prevent it, the drive.

        `goal` is the one that the page showed (`ChairView.goal`): a yes to it does not count for another goal that has
        replaced it meanwhile. Empty: the yes counts for any waiting goal.
        """

    def pause(self) -> PortAnswer:
        """Come to rest and stand, the goal kept, until `go_on`, or until something ends the drive."""

    def go_on(self) -> PortAnswer:
        """Let the paused drive go on, or a drive that offers another way take it."""

    def cancel(self) -> PortAnswer:
        """Come to rest and drop the goal."""

    def answer_storey(self, storey: str) -> PortAnswer:
        """Take the rider's word for the storey at which the lift stands, one of `ChairView.asks`."""

    def start_at(self, goal: str) -> PortAnswer:
        """Take the rider's word that the chair stands at a place, here or on another storey; it is localised anew there."""

    def guide(self, goal: str, level: int) -> PortAnswer:
        """Guide the driving rider step by step to a goal of the building, at a level of prompting from 0 to 3."""

    def end_guide(self) -> PortAnswer:
        """End step guidance."""

    def choose_level(self, level: HelpLevel) -> PortAnswer:
        """Take a level of help while the rider drives by the chair's own joystick, by the rider's own act, at once."""

    def override_guard(self) -> PortAnswer:
        """Let the rider creep against the guard for a while, by the rider's own act; never towards a drop-off."""

    def lead(self, goal: str) -> PortAnswer:
        """Lead the driving rider to a place by touch and voice."""

    def lead_through(self, side: DoorSide) -> PortAnswer:
        """Lead the driving rider through the next doorway on a side by touch and voice, without a map."""

    def end_lead(self) -> PortAnswer:
        """Lead the rider no longer."""

    def say_again(self) -> PortAnswer:
        """Say the present step again, by glove and voice."""

    def say_where(self) -> PortAnswer:
        """Tell the rider the chair's place and its surroundings."""

    def stop(self) -> PortAnswer:
        """Obey the rider's Stop: the computer lets go of the lines at once."""

    def reset(self) -> PortAnswer:
        """Reset latched faults, once somebody has dealt with their cause."""

    def steer(self, forward: float, turn: float) -> PortAnswer:
        """Steer by the page's joystick: each axis in [-1, 1], left positive, walking speed at most.

        The position is repeated within `STEER_S`, or the joystick counts as let go. Steering ends a drive. After Stop,
        or any other end of steering, the joystick counts again only once it was let go.
        """

    def release(self) -> PortAnswer:
        """Let the page's joystick go."""

    def place_here(self, name: str, tolerance_m: float, tolerance_rad: float, replaces: bool = False) -> PortAnswer:
        """Save the chair's pose as a place; an existing place of that name is kept unless this `replaces` it."""

    def set_place(self, place: Place, replaces: bool = False) -> PortAnswer:
        """Add a place, or change the existing one that this `replaces`."""

    def rename_place(self, name: str, new_name: str) -> PortAnswer:
        """Give a place another name that is free."""

    def remove_place(self, name: str) -> PortAnswer:
        """Forget a place."""

    def set_zone(self, zone: Zone, replaces: bool = False) -> PortAnswer:
        """Draw a zone, or redraw the existing one that this `replaces`."""

    def remove_zone(self, name: str) -> PortAnswer:
        """Forget a zone."""

    def erase(self, polygon: FloatArray) -> PortAnswer:
        """Erase the obstacles of the map within a polygon (N, 2) [m] in map, such as a ghost of a removed thing."""

    def undo(self) -> PortAnswer:
        """Undo the latest change of places, zones or map."""

    def relocalise(self, map_from_base: Pose2 | None = None) -> PortAnswer:
        """Localise anew, near a pose in map if one is given."""

    def watched(self, pages: Sequence[str]) -> None:
        """Take the ids of the pages that are open and answer; called at 10 Hz or more.

        A drive that was begun from a page ends within 1 s of the last answer of the last page with a Stop button, or
        when these calls cease for 0.7 s.
        """
