"""Door frames proposed in pictures, followed from picture to picture until range confirms or nothing shows them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from waychair.planning.seen.door_frames import Box, DoorFrame, overlap
from waychair.types import FloatArray

SAME = 0.35
"""Intersection by union of a box with the predicted one, above which it shows the same frame."""

LOST = 4
"""Pictures in a row without a frame after which it is forgotten."""

STEADY = 3
"""Pictures in which a frame must have been seen before range is asked about it."""


@dataclass(frozen=True, slots=True)
class FollowedFrame:
    """A frame with its identity: the last box [pixels], in how many pictures it was seen, in how many since not."""

    number: int
    box: Box
    seen: int = 1
    missed: int = 0

    @property
    def steady(self) -> bool:
        """Whether it was seen often enough to look at it with range."""
        return self.seen >= STEADY


class DoorFrameTracker:
    """The door frames of a camera's last pictures. A frame is a proposal only: it is never offered to a rider."""

    def __init__(self) -> None:
        self._frames: list[FollowedFrame] = []
        self._count = 0

    @property
    def frames(self) -> tuple[FollowedFrame, ...]:
        """The frames that are followed."""
        return tuple(self._frames)

    def see(self, proposals: Iterable[DoorFrame], camera_matrix: FloatArray, turn: float) -> None:
        """Take in the proposals of one picture, taken after the camera turned to the left by `turn` [rad]."""
        left = sorted(proposals, key=lambda frame: -frame.score)
        followed = []
        for frame in self._frames:
            expected = _turned(frame.box, camera_matrix, turn)
            best = max(left, key=lambda proposal: overlap(proposal.box, expected), default=None)
            if best is not None and overlap(best.box, expected) > SAME:
                left.remove(best)
                followed.append(replace(frame, box=best.box, seen=frame.seen + 1, missed=0))
            elif frame.missed + 1 < LOST:
                followed.append(replace(frame, box=expected, missed=frame.missed + 1))
        for proposal in left:
            followed.append(FollowedFrame(self._count, proposal.box))
            self._count += 1
        self._frames = followed

    def refute(self, number: int) -> None:
        """Forget a frame that range has refuted: no opening is there."""
        self._frames = [frame for frame in self._frames if frame.number != number]


def _turned(box: Box, camera_matrix: FloatArray, turn: float) -> Box:
    """Return where a box lies after the camera has turned to the left by `turn` [rad]: its columns move to the right."""
    focal, middle = float(camera_matrix[0, 0]), float(camera_matrix[0, 2])
    x0, x1 = (middle + focal * math.tan(math.atan2(x - middle, focal) + turn) for x in (box[0], box[2]))
    return x0, box[1], x1, box[3]
