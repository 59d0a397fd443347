"""Legs of a planned path: each is driven without a stop, in its own manner."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np

from waychair.geometry import compose
from waychair.types import FloatArray, Path, Pose2


class DrivingManner(enum.Enum):
    """How a leg is to be driven."""

    FREE = "free"  # by the dynamic window, which may leave the line
    EXACT = "exact"  # on the line to the centimetre, slowly: there is no room beside it
    DOOR = "door"  # exactly, on the axis of a door that is tracked in the scan
    LINE = "line"  # on a line that flows, as fast as its bends and its room allow


@dataclass(frozen=True, slots=True)
class DoorPassage:
    """A narrow place to drive straight through: the pose of its middle, x along the drive, and its width [m]."""

    map_from_door: Pose2
    width: float


@dataclass(frozen=True, slots=True)
class PathLeg:
    """Poses in map with the body's headings; at its end the chair turns on the spot to the last heading.

    `backwards`: the leg is driven in reverse. `door`: the door of a door leg, which is straight and on the door's axis.
    `flows`: the chair does not stop at its end; the next leg goes on in the same direction.
    """

    path: Path
    manner: DrivingManner = DrivingManner.FREE
    backwards: bool = False
    door: DoorPassage | None = None
    flows: bool = False
    doors: tuple[DoorPassage, ...] = ()

    def poses_in(self, frame_from_map: Pose2) -> FloatArray:
        """Return (N, 3) the leg's poses in another frame."""
        return compose(frame_from_map.array(), self.path.poses)


def joined_legs(legs: tuple[PathLeg, ...]) -> Path:
    """Return the legs joined to one path: two poses at one place are a stop, and a turn where their headings differ."""
    return Path(np.concatenate([leg.path.poses for leg in legs]))
