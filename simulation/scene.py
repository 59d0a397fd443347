"""The nouns of a simulated building: what it is made of, who walks in it, and what sensors may ask of it.

Everything solid is an upright block of one material on a level's floor; ramps are slopes and stairways down are pits.
Lidar and sonars see a `Slice` of the blocks at their height, the camera and the physics see the blocks themselves.
All poses are in the level's map frame, z is above its floor; colours are linear, 0 to 1.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias

from waychair.types import FloatArray, IntArray, Pose2

Colour: TypeAlias = tuple[float, float, float]

DOOR_HEIGHT = 2.05
"""Height [m] of an open door; the wall goes on above it."""


class Reflection(enum.IntEnum):
    """How a surface answers the light of a lidar."""

    DIFFUSE = 0  # from any angle
    DARK = 1  # diffuse but weak: lost beyond a few metres
    GLASS = 2  # lets it through but for a beam that falls nearly straight on it
    MIRROR = 3  # sends it on, as if the room went on behind


@dataclass(frozen=True, slots=True)
class Material:
    """What a surface looks like to the camera (pattern and mean colour) and to the lidar."""

    pattern: str
    colour: Colour
    reflection: Reflection = Reflection.DIFFUSE


PATTERNS = ("plaster", "concrete", "tiles", "panels", "wood", "cloth", "leather", "metal", "glass", "mirror", "skin")
"""What the renderer can draw; each surface has its own, by its place in the world."""

MATERIALS: Mapping[str, Material] = MappingProxyType(
    {
        "plaster": Material("plaster", (0.72, 0.69, 0.62)),
        "concrete": Material("concrete", (0.36, 0.36, 0.35)),
        "tiles": Material("tiles", (0.52, 0.50, 0.46)),
        "panels": Material("panels", (0.78, 0.78, 0.76)),
        "wood": Material("wood", (0.45, 0.29, 0.16)),
        "cloth": Material("cloth", (0.30, 0.38, 0.52)),
        "black_leather": Material("leather", (0.02, 0.02, 0.02), Reflection.DARK),
        "metal": Material("metal", (0.50, 0.52, 0.55)),
        "glass": Material("glass", (0.80, 0.88, 0.86), Reflection.GLASS),
        "mirror": Material("mirror", (0.85, 0.87, 0.88), Reflection.MIRROR),
    }
)
"""By the names that floor plans use."""


@dataclass(frozen=True, slots=True)
class Block:
    """An upright box: `middle` its pose in map (x along `length`), from `low` to `high` [m] above the floor.

    `material` is a key of MATERIALS. `seed` tells its surface from all others; blocks with equal seeds look alike.
    """

    middle: Pose2
    length: float
    width: float
    low: float
    high: float
    material: str = "plaster"
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Slope:
    """A ramp: its top rises along the x axis of `middle` from `low` to `high` [m] over `length`, `width` across."""

    middle: Pose2
    length: float
    width: float
    low: float
    high: float
    material: str = "concrete"
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Pit:
    """Where the floor is missing, `depth` [m] down: a stairway, whose steps are blocks that end below the floor."""

    middle: Pose2
    length: float
    width: float
    depth: float


@dataclass(frozen=True, slots=True)
class Poster:
    """A picture on a wall: `middle` its pose in map, theta the way it looks; its middle `height` [m] above the floor."""

    middle: Pose2
    height: float
    length: float
    width: float
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Lamp:
    """A lamp that is fixed in the world, at (x, y, z) [m]; `power` 1 lights an office."""

    x: float
    y: float
    z: float
    power: float = 1.0
    colour: Colour = (1.0, 0.96, 0.9)


@dataclass(frozen=True, slots=True)
class Finish:
    """What a level is finished with: materials of floor and ceiling, its height [m], light from everywhere (0 to 1)."""

    floor: str = "tiles"
    ceiling: str = "panels"
    height: float = 2.7
    ambient: float = 0.35


@dataclass(frozen=True, slots=True)
class Lift:
    """A cabin that stops at several levels, `middle` its pose in each level's map, looking out of its door."""

    name: str
    middle: Pose2
    length: float
    width: float
    levels: tuple[str, ...]


class Behaviour(enum.Enum):
    """What moves a person."""

    PATH = "path"  # to and fro along a path, whatever comes; stops only for what stands in the way if it yields
    SOCIAL = "social"  # along a path, pushed aside by walls, people and the chair (social force)
    SEATED = "seated"  # stays where it is
    SUDDEN = "sudden"  # steps out along its path when the chair comes near, and back after a while
    BOUNCE = "bounce"  # a disc with a new heading every 2 s, thrown back by walls


@dataclass(frozen=True, slots=True)
class PersonPlan:
    """A person of the plan: `path` (N, 2) [m, map] starts where it stands; `yields` to the chair or not."""

    behaviour: Behaviour
    path: FloatArray
    speed: float = 1.0
    yields: bool = True
    radius: float = 0.25
    trigger: float = 3.0


@dataclass(frozen=True, slots=True)
class PersonState:
    """A person at one moment: pose in map, speed [m/s], `stride` [rad] the phase of its gait, as the sensors need it."""

    pose: Pose2
    speed: float
    stride: float
    radius: float
    behaviour: Behaviour
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Slice:
    """What stands at one height: segments (N, 4) [m, map] x0 y0 x1 y1 and their `Reflection`, (N,)."""

    segments: FloatArray
    reflections: IntArray
