"""The next doorway on a side of the chair, as a goal in odom: for a rider who wants to go through it where no map leads."""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import wrap_angle
from waychair.planning.seen.doorways import SPARE, DoorState, Doorway
from waychair.types import Place, Pose2


class DoorSide(enum.Enum):
    """Where a doorway leads, seen from the chair."""

    LEFT = "left"
    AHEAD = "ahead"
    RIGHT = "right"


FARTHEST = 6.0
"""m; doorways farther away are not next."""

BEHIND = 1.5
"""m; a doorway aside counts as long as its middle is not farther than this behind the drive axle: it was just passed."""

BEYOND = 0.5
"""m from the door to the chair's rear end once it is through; the leaf, which may be open to that side, may be wider."""

_TURNED = math.radians(45.0)


def next_door(doorways: Iterable[Doorway], odom_from_base: Pose2, side: DoorSide, body: ChairBody) -> Place | None:
    """Return the place behind the nearest doorway that leads to a side and is wide enough; None if none is seen there.

    Doorways that range has borne out come first: a candidate may be a gap between two things.
    """
    base_from_odom = odom_from_base.inverse()
    onward = [(each, _through(base_from_odom @ each.pose)) for each in doorways if _may_pass(each, body)]
    found = [each for each in onward if _leads(side, each[1])]
    if not found:
        return None
    _, through = min(found, key=lambda each: (not each[0].validated, _away(each[1])))
    goal = odom_from_base @ through @ Pose2(body.axle_from_rear + BEYOND, 0.0, 0.0)
    return Place(door_words(side), goal, _NEAR, _NEAR_TURN)


NO_DOORWAYS = "this chair does not look for doorways: start it with the setting `perceive`"
"""The sentence for a rider whose chair has no behaviour cells."""


def door_words(side: DoorSide) -> str:
    """Return what a doorway on a side is called."""
    return f"the door {_where(side)}"


def no_door(side: DoorSide) -> str:
    """Return the sentence for a rider who asks for a doorway that nobody sees."""
    return f"no doorway that is wide enough is seen {_where(side)}: go on a little, or look round, and ask again"


def _where(side: DoorSide) -> str:
    return "ahead" if side is DoorSide.AHEAD else f"on the {side.value}"


_NEAR, _NEAR_TURN = 0.5, math.radians(30.0)
"""m, rad; so near to its goal the chair is through."""


def _may_pass(door: Doorway, body: ChairBody) -> bool:
    """Whether the chair may fit: beside a leaf that stands ajar only through the part that is free, and where it is shut not at all."""
    width = door.clear if door.state is DoorState.AJAR else door.width
    return door.state is not DoorState.CLOSED and width >= body.width + SPARE


def _through(base_from_door: Pose2) -> Pose2:
    """Return the doorway's middle with x leading through it, away from the chair."""
    return base_from_door if base_from_door.inverse().x < 0.0 else base_from_door @ Pose2(0.0, 0.0, math.pi)


def _leads(side: DoorSide, base_from_door: Pose2) -> bool:
    """Whether a doorway leads to a side, and is still to come."""
    x, turned = base_from_door.x, wrap_angle(base_from_door.theta)
    if _away(base_from_door) > FARTHEST:
        return False
    if side is DoorSide.AHEAD:
        return x > 0.0 and abs(turned) <= _TURNED
    turned = turned if side is DoorSide.LEFT else -turned
    return x > -BEHIND and _TURNED < turned <= math.pi - _TURNED


def _away(base_from_door: Pose2) -> float:
    return math.hypot(base_from_door.x, base_from_door.y)
