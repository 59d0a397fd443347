"""What a planned way is made of: legs, each driven in one go, in its own manner, from one stop to the next."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np

from waychair.geometry import compose
from waychair.types import FloatArray, Path, Pose2


class Manner(enum.Enum):
    """How a leg is to be driven."""

    FREE = "free"  # the local planner may leave it as it sees fit
    EXACT = "exact"  # kept to the centimetre, slowly: there is no room for anything else
    DOOR = "door"  # exact, on the axis of a door that is looked for in the scan


@dataclass(frozen=True, slots=True)
class Door:
    """A narrow place that is gone through straight: its middle, x through it and onwards, and its clear width [m]."""

    map_from_door: Pose2
    width: float


@dataclass(frozen=True, slots=True)
class Leg:
    """Poses in map whose headings are the body's; at its end the chair turns in place to the last heading.

    `backwards`: it is driven in reverse. `door` is that of a door's leg, which is straight and on the door's axis.
    `flows`: the chair does not stop at its end, the next leg goes on in the same direction.
    """

    path: Path
    manner: Manner = Manner.FREE
    backwards: bool = False
    door: Door | None = None
    flows: bool = False

    def poses_in(self, frame_from_map: Pose2) -> FloatArray:
        """(N, 3) the leg's poses in another frame."""
        return compose(frame_from_map.array(), self.path.poses)


def whole(legs: tuple[Leg, ...]) -> Path:
    """The legs one after the other: two poses at one place are a stop, and a turn where their headings differ."""
    return Path(np.concatenate([leg.path.poses for leg in legs]))
