"""A lift on one storey's map: its cabin, its doorway, and where a chair waits for it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from waychair.calibration.chair_body import ChairBody
from waychair.types import Pose2

LOBBY_AHEAD = 1.6
"""m; a chair waits with its axle so far before the doorway ..."""

LOBBY_ASIDE = 1.1
"""m; ... and so far beside its middle, so that people can leave the lift."""


WAITING_MARGIN = 0.3
"""m; people wait up to so far beyond cabin and lobby."""

STALE_M = 0.5
"""m; a chair that drives into a lift is so far from the pose that was kept last: 0.5 m/s, and a pose each second."""

TURN_ROOM = 0.12
"""m; room round a chair that turns in a cabin."""


@dataclass(frozen=True, slots=True)
class LiftSite:
    """A lift on a storey: `cabin` is the pose of its middle in that storey's map, facing its door, `length` along that
    direction and `width` [m]; the doorway is `door_ahead` [m] of the middle and `door_width` wide.

    `lobby` is the pose in map in which a chair waits.
    """

    lift: str
    storey: str
    cabin: Pose2
    length: float
    width: float
    door_ahead: float
    door_width: float
    lobby: Pose2

    @property
    def door(self) -> Pose2:
        """The middle of the doorway in map, facing out of the cabin."""
        return self.cabin @ Pose2(self.door_ahead, 0.0)

    @property
    def waiting(self) -> tuple[float, float, float]:
        """The circle x, y, radius [m] in map in which people stand and wait: the cabin, and the ground before its door."""
        door = self.door
        cabin, lobby = math.hypot(self.length + 0.1, self.width / 2), math.hypot(LOBBY_AHEAD, LOBBY_ASIDE)
        return door.x, door.y, max(cabin, lobby) + WAITING_MARGIN

    def is_near(self, cabin_from_base: Pose2) -> bool:
        """Return whether a chair may be in the cabin or its doorway, its pose being half a metre old."""
        return (
            abs(cabin_from_base.x) <= self.length / 2 + STALE_M and abs(cabin_from_base.y) <= self.width / 2 + STALE_M
        )

    def holds(self, cabin_from_base: Pose2) -> bool:
        """Return whether a chair's axle is in the cabin."""
        return abs(cabin_from_base.x) <= self.length / 2 and abs(cabin_from_base.y) <= self.width / 2


def lift_holding(sites: Iterable[LiftSite], storey: str, map_from_base: Pose2) -> tuple[LiftSite, Pose2] | None:
    """Return the lift in which a chair is, by its pose on a storey's map, with cabin_from_base; None if it is in none."""
    for site in sites:
        cabin_from_base = site.cabin.inverse() @ map_from_base
        if site.storey == storey and site.holds(cabin_from_base):
            return site, cabin_from_base
    return None


def pose_in_same_lift(sites: Sequence[LiftSite], storey: str, map_from_base: Pose2, other: str) -> Pose2 | None:
    """Return the pose on another storey's map of a chair in a lift that stops there; None if it is in none."""
    held = lift_holding(sites, storey, map_from_base)
    if held is None:
        return None
    lift, cabin_from_base = held[0].lift, held[1]
    return next((each.cabin @ cabin_from_base for each in sites if (each.lift, each.storey) == (lift, other)), None)


def stand_in(site: LiftSite, body: ChairBody) -> Pose2:
    """Return where a chair stands in a cabin, in its frame: facing the door, as far back as it can turn."""
    back = max(0.0, site.length / 2 - body.circumscribed_radius - TURN_ROOM)
    return Pose2(-back, 0.0)
