"""The places of a lift on a level: its cabin, its doorway and the two leaves of its door."""

from __future__ import annotations

import math
from dataclasses import dataclass

from waychair.errors import WorldError
from waychair.simulation.plan.world import World
from waychair.simulation.scene.moving import SlidingLeaf
from waychair.simulation.scene.scene import LiftCabin
from waychair.types import Pose2

_NEAR = 0.4
"""m; a door so near to the middle of a cabin's front is the lift's."""


@dataclass(frozen=True, slots=True)
class LiftDoor:
    """A lift's doorway on one level: `middle` in map, facing out of the cabin, `width` [m], and its two leaves."""

    middle: Pose2
    width: float
    leaves: tuple[SlidingLeaf, SlidingLeaf]


def door_of(lift: LiftCabin, world: World) -> LiftDoor:
    """Return a lift's doorway on a level: the door with a name in the wall before its cabin.

    Raises:
        WorldError: there is none.
    """
    front = lift.middle @ Pose2(lift.length / 2, 0.0)
    near = [door for door in world.doors if math.dist((door.middle.x, door.middle.y), (front.x, front.y)) < _NEAR]
    if not near:
        raise WorldError(
            f"the lift '{lift.name}' has no door on '{world.level}': give the wall before its cabin a door with a name"
        )
    door = near[0]
    middle = Pose2(door.middle.x, door.middle.y, lift.middle.theta)
    half = door.width / 2
    left = middle @ Pose2(0.0, half, -math.pi / 2)
    right = middle @ Pose2(0.0, -half, math.pi / 2)
    return LiftDoor(middle, door.width, (SlidingLeaf(left, half), SlidingLeaf(right, half)))
