"""Leaves that slide: blocks whose place among static boxes and segments changes without new bins.

The bins list a leaf wherever it may ever be, so that only its own numbers change as it moves.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from waychair.geometry import rectangle, transform_points
from waychair.simulation.scene.scene import DOOR_HEIGHT, Block, Pit
from waychair.types import FloatArray, Pose2


@dataclass(frozen=True, slots=True)
class SlidingLeaf:
    """A leaf of a sliding door, which slides into its wall: `jamb` is the pose of its fixed end in map, x towards the
    opening; closed it is `length` [m] long.
    """

    jamb: Pose2
    length: float
    thickness: float = 0.04
    material: str = "metal"
    seed: int = 0

    def block(self, opened: float) -> Block:
        """Return the part of the leaf that shows when it is `opened` by this part, 0 to 1."""
        shown = self.length * (1.0 - opened)
        middle = self.jamb @ Pose2(shown / 2, 0.0)
        return Block(middle, shown, self.thickness, 0.0, DOOR_HEIGHT, self.material, self.seed)


def boxes_of(solid: Iterable[Block | Pit]) -> FloatArray:
    """Return blocks and pits as boxes (N, 6), see `boxes.py`."""
    boxes = [
        (s.middle.x, s.middle.y, math.cos(s.middle.theta), math.sin(s.middle.theta), s.length / 2, s.width / 2)
        for s in solid
    ]
    return np.array(boxes, np.float64).reshape(-1, 6)


def sides_of(blocks: Sequence[Block]) -> FloatArray:
    """Return the four sides of each block as segments (4 N, 4), counter-clockwise."""
    corners = [
        transform_points(block.middle, rectangle(block.length / 2, block.length / 2, block.width / 2))
        for block in blocks
    ]
    at = np.array(corners).reshape(-1, 4, 2)
    return np.ascontiguousarray(np.concatenate([at, np.roll(at, -1, axis=1)], axis=2).reshape(-1, 4))
