"""The doorway's cells with today's sensors: doorways come found and measured; one is chosen, checked and led to."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from waychair.calibration.chair_body import ChairBody
from waychair.control.behaviours.commands import between
from waychair.control.behaviours.doorway import CandidateVerdict, DoorCheck, DoorwayJambs, FrameCandidate
from waychair.control.behaviours.paper_settings import DoorLimits
from waychair.control.behaviours.range_finder import LookRequest
from waychair.planning.seen.doorways import SPARE

_AHEAD = math.radians(75.0)
"""rad; a doorway is chosen within this angle of straight ahead."""


_PASSED = 0.3
"""m; behind the chair's rear end a doorway counts as passed, and the next one is chosen."""


@dataclass(frozen=True, slots=True)
class DoorSeen:
    """A doorway in base: its identity, its jambs, the least clear width [m] that was seen, and whether it is open.

    The jambs are left and right for one way through the door, always the same. `clear` is 0 before it was seen from near.
    A candidate is not `borne_out` by range yet.
    """

    number: int
    door: DoorwayJambs
    clear: float
    is_open: bool
    borne_out: bool = True


@dataclass(frozen=True, slots=True)
class DoorsSeen:
    """The doorways and candidates near the chair."""

    doors: tuple[DoorSeen, ...] = ()


@dataclass(frozen=True, slots=True)
class ChosenDoor:
    """Dynamic data of the detection: the number of the chosen doorway, and whether the way through it is the other one."""

    number: int | None = None
    turned: bool = False


def choose_door(seen: DoorsSeen, constants: ChairBody, dynamic: ChosenDoor) -> tuple[DoorSeen | None, ChosenDoor]:
    """Return the doorway chosen before until it is passed or no longer seen, else the nearest one ahead.

    Its jambs are left and right for the way by which the chair came to it. A candidate is chosen, and kept, only as long
    as range bears out no doorway ahead.
    """
    kept = next((each for each in seen.doors if each.number == dynamic.number), None)
    ahead = [each for each in seen.doors if between(math.atan2(*reversed(each.door.middle)), 0.0) <= _AHEAD]
    sure = [each for each in ahead if each.borne_out]
    if kept is not None and (kept.borne_out or not sure):
        chosen = _turned(kept) if dynamic.turned else kept
        if _along(chosen.door) >= -constants.rear - _PASSED:
            return chosen, dynamic
    if not ahead:
        return None, ChosenDoor()
    nearest = min(sure or ahead, key=lambda each: math.hypot(*each.door.middle))
    turned = _along(nearest.door) < 0.0
    return _turned(nearest) if turned else nearest, ChosenDoor(nearest.number, turned)


def _along(door: DoorwayJambs) -> float:
    """Return how far [m] the doorway lies ahead on its own way through."""
    x, y = door.middle
    return x * math.cos(door.through) + y * math.sin(door.through)


def _turned(seen: DoorSeen) -> DoorSeen:
    door = seen.door
    return replace(seen, door=DoorwayJambs(door.right_x, door.right_y, door.left_x, door.left_y))


def check_door(
    seen: DoorSeen | None, frame: FrameCandidate | None, constants: tuple[DoorLimits, ChairBody]
) -> DoorCheck | None:
    """Return a doorway as valid if it is open, of a door's width, and surely wide enough for this chair.

    A candidate, or one that was not yet seen from near, is neither valid nor refuted. The camera is asked to look at the
    doorway, and without one at a frame that a picture proposes: range decides.
    """
    limits, body = constants
    if seen is None:
        return (
            None
            if frame is None
            else DoorCheck(CandidateVerdict.LOOKING, request=LookRequest((frame.left + frame.right) / 2))
        )
    x, y = seen.door.middle
    request = LookRequest(math.atan2(y, x))
    if not seen.borne_out or (seen.is_open and seen.clear == 0.0):
        return DoorCheck(CandidateVerdict.LOOKING, request=request)
    passes = seen.is_open and seen.clear >= body.width + SPARE
    if passes and limits.narrowest <= seen.door.width <= limits.widest:
        return DoorCheck(CandidateVerdict.VALID, seen.door, request)
    return DoorCheck(CandidateVerdict.REFUTED, request=request)
