"""Legs of a planned path: each is driven without a stop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waychair.geometry import compose
from waychair.types import FloatArray, Path, Pose2


@dataclass(frozen=True, slots=True)
class DoorPassage:
    """A narrow place to drive straight through: the pose of its middle, x along the drive, and its width [m]."""

    map_from_door: Pose2
    width: float


@dataclass(frozen=True, slots=True)
class PathLeg:
    """Poses in map with the body's headings; at its end the chair turns on the spot to the last heading.

    `rooms` (N,) [m] is the clearance of the outline at each pose, for a leg that is driven along its line; None for one
    that the dynamic window drives, for which only the half width was checked. `backwards`: it is driven in reverse.
    `doors` are those that the line passes straight, on their axes.
    """

    path: Path
    rooms: FloatArray | None = None
    backwards: bool = False
    doors: tuple[DoorPassage, ...] = ()

    @property
    def is_line(self) -> bool:
        """Whether the leg is driven along its line."""
        return self.rooms is not None

    def poses_in(self, frame_from_map: Pose2) -> FloatArray:
        """Return (N, 3) the leg's poses in another frame."""
        return compose(frame_from_map.array(), self.path.poses)


def joined_legs(legs: tuple[PathLeg, ...]) -> Path:
    """Return the legs joined to one path: two poses at one place are a stop, and a turn where their headings differ."""
    return Path(np.concatenate([leg.path.poses for leg in legs]))
