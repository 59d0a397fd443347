"""What a page needs of a chair: looked at, told, asked. A chair in this program and one behind ROS both offer it.

Calls come from the web server's threads, return within `ANSWER_S`, and never raise: what is refused is answered with a
sentence that says why and what to do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from waychair.maps.zones import Zone
from waychair.slam.localisation import LocalisationState
from waychair.types import DriveMode, FloatArray, OccupancyGrid, Place, Pose2, Twist

ANSWER_S = 2.0
"""A call returns within this; Stop has taken effect at the lines within 0.1 s of its call."""

STEER_S = 0.3
"""The page's joystick must be told again within this: silence is letting go."""


def _no_points() -> FloatArray:
    return np.empty((0, 2))


@dataclass(frozen=True, slots=True)
class Answer:
    """Whether something was done, and a plain sentence for the rider."""

    done: bool
    sentence: str


@dataclass(frozen=True, slots=True)
class Obstacle:
    """What stands against a drive or holds it up: the stop's id, why in a plain sentence, and what helps."""

    stop_id: str
    sentence: str
    remedy: str


@dataclass(frozen=True, slots=True)
class ChairView:
    """A chair as a page shows it, at `stamp_ns`.

    `map_from_base`, `scan` (N, 2), `path` (M, 2) and `people` (K, 2) [m] are in map; the pose is None while unknown.
    `goal` is the place or the point that was asked for, empty without one; `waits`: for the rider's yes;
    `countdown_s`: until the first motion, None when nothing is about to begin. `next_action` is what the chair will do
    next and `last_stop` why it stopped last, in plain sentences. `map_revision` and `layout_revision` change with the
    grid, and with places and zones. `panel` is for engineers: figures by name, units in the names. `stamp_ns` is of the
    computer's steady clock (`time.monotonic_ns`), and so is `free_since_ns`: since when the lines are the rider's own
    joystick's, None while the computer holds them. `steered`: a page's joystick does. `paused`: the drive stands until
    somebody has it go on.
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
    obstacles: tuple[Obstacle, ...] = ()
    scan: FloatArray = field(default_factory=_no_points)
    path: FloatArray = field(default_factory=_no_points)
    people: FloatArray = field(default_factory=_no_points)
    map_revision: int = 0
    layout_revision: int = 0
    panel: Mapping[str, float] = field(default_factory=dict)
    free_since_ns: int | None = None
    steered: bool = False
    paused: bool = False


@dataclass(frozen=True, slots=True)
class Layout:
    """What people have drawn on a map: places by name, zones, and whether there is something to undo."""

    places: Mapping[str, Place] = field(default_factory=dict)
    zones: tuple[Zone, ...] = ()
    undoable: bool = False


class ChairPort(Protocol):
    """A chair, as a page has it."""

    @property
    def outline(self) -> FloatArray:
        """Corners of the chair's outline in base, (N, 2) [m]."""

    def view(self) -> ChairView:
        """The chair now; costs next to nothing."""

    def grid(self) -> OccupancyGrid | None:
        """The map of `view().map_revision`; None while there is none."""

    def layout(self) -> Layout:
        """Places and zones of `view().layout_revision`."""

    def picture(self) -> bytes | None:
        """The camera's latest picture as JPEG; None without a camera."""

    def go(self, goal: str | Pose2) -> Answer:
        """Ask for a drive to a place or a pose in map; it waits for `confirm`."""

    def confirm(self, goal: str = "") -> Answer:
        """The rider's yes: tone and phrase, 3 s in which `cancel` and `stop` prevent it, then the drive.

        `goal` is what the page showed (`ChairView.goal`): a yes to it is none to another that has come meanwhile. Empty:
        to whatever waits.
        """

    def pause(self) -> Answer:
        """Come to rest and stand, the goal kept, until `go_on`, or until something ends the drive."""

    def go_on(self) -> Answer:
        """Have the paused drive go on."""

    def cancel(self) -> Answer:
        """Come to rest and give the goal up."""

    def stop(self) -> Answer:
        """The rider's Stop: the computer lets go of the lines at once."""

    def reset(self) -> Answer:
        """Somebody has seen to what was wrong."""

    def steer(self, forward: float, turn: float) -> Answer:
        """The page's joystick, each in [-1, 1], left positive, at walking speed at most; told again within `STEER_S` or
        let go. It ends a drive. After Stop, and after whatever else has ended it, it counts once it was let go."""

    def release(self) -> Answer:
        """The page's joystick was let go."""

    def place_here(self, name: str, tolerance_m: float, tolerance_rad: float, replaces: bool = False) -> Answer:
        """Save where the chair stands as a place; one of that name stays as it is unless this `replaces` it."""

    def set_place(self, place: Place, replaces: bool = False) -> Answer:
        """Add a place, or change the one that this `replaces`."""

    def rename_place(self, name: str, new_name: str) -> Answer:
        """Give a place another name, which no other has."""

    def remove_place(self, name: str) -> Answer:
        """Forget a place."""

    def set_zone(self, zone: Zone, replaces: bool = False) -> Answer:
        """Draw a zone, or draw the one anew that this `replaces`."""

    def remove_zone(self, name: str) -> Answer:
        """Forget a zone."""

    def erase(self, polygon: FloatArray) -> Answer:
        """Clear what the map shows within a polygon (N, 2) [m] in map: a ghost of something that is gone."""

    def undo(self) -> Answer:
        """Take the latest change of places, zones or map back."""

    def relocalise(self, map_from_base: Pose2 | None = None) -> Answer:
        """Find out anew where the chair stands, near a pose in map if one is given."""

    def watched(self, pages: Sequence[str]) -> None:
        """Called at 10 Hz or more with the ids of the pages that are open and answer.

        A drive that a page has begun ends within 1 s of the last answer of the last page to press Stop on, or when
        these calls cease for 0.7 s.
        """
