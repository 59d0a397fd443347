"""The data types of a simulated building: materials, blocks, slopes, pits, lamps, lifts, people and slices.

Everything solid is an upright block of one material on a level's floor; ramps are slopes and stairways down are pits.
Lidar and sonars see a `Slice` of the blocks at their height; the camera and the physics use the blocks themselves.
All poses are in the level's map frame, z is above its floor; colours are linear, 0 to 1.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias

from waychair.calibration.chair_body import ChairBody
from waychair.types import FloatArray, IntArray, Pose2

Colour: TypeAlias = tuple[float, float, float]

DOOR_HEIGHT = 2.05
"""Height [m] of a door; the wall continues above it."""


class Reflection(enum.IntEnum):
    """How a surface reflects the light of a lidar."""

    DIFFUSE = 0  # returns beams from any angle
    DARK = 1  # diffuse but weak: lost beyond a few metres
    GLASS = 2  # transparent, except to beams at nearly normal incidence
    MIRROR = 3  # reflects beams, as if the room continued behind it


@dataclass(frozen=True, slots=True)
class Material:
    """A surface's appearance to the camera (pattern and mean colour) and to the lidar."""

    pattern: str
    colour: Colour
    reflection: Reflection = Reflection.DIFFUSE


PATTERNS = ("plaster", "concrete", "tiles", "panels", "wood", "cloth", "leather", "metal", "glass", "mirror", "skin")
"""Patterns that the renderer can draw; each surface has its own variant, by its place in the world."""

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
"""Materials by their names in floor plans."""


@dataclass(frozen=True, slots=True)
class Block:
    """An upright box: `middle` is its pose in map (x along `length`), from `low` to `high` [m] above the floor.

    `material` is a key of MATERIALS. `seed` chooses the variant of its surface; blocks with equal seeds look alike.
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
    """A hole in the floor, `depth` [m] deep; a stairway is a pit whose steps are blocks below floor level."""

    middle: Pose2
    length: float
    width: float
    depth: float


@dataclass(frozen=True, slots=True)
class Poster:
    """A poster on a wall: `middle` is its pose in map, facing out; its centre is `height` [m] above the floor."""

    middle: Pose2
    height: float
    length: float
    width: float
    seed: int = 0


@dataclass(frozen=True, slots=True)
class WallTag:
    """An AprilTag on a wall: `middle` is its pose in map, facing out, `height` [m] above the floor; `side` [m] with its edge."""

    number: int
    middle: Pose2
    height: float
    side: float


@dataclass(frozen=True, slots=True)
class Lamp:
    """A fixed lamp at (x, y, z) [m]; power 1 gives the light of an office."""

    x: float
    y: float
    z: float
    power: float = 1.0
    colour: Colour = (1.0, 0.96, 0.9)


@dataclass(frozen=True, slots=True)
class Finish:
    """The finish of a level: materials of floor and ceiling, room height [m] and ambient light (0 to 1)."""

    floor: str = "tiles"
    ceiling: str = "panels"
    height: float = 2.7
    ambient: float = 0.35


SILL_AHEAD, SHAFT_DEPTH = 0.05, 1.0
"""m; a car ends half a usual wall before the middle of its doorway, and its slit shows so much of the shaft."""


@dataclass(frozen=True, slots=True)
class LiftCabin:
    """A lift's cabin that stops at several levels; `middle` is its pose in each level's map, facing its door.

    `gap` [m] is the width of the slit between the car's floor and the sill of its doorway.
    """

    name: str
    middle: Pose2
    length: float
    width: float
    levels: tuple[str, ...]
    gap: float = 0.0

    @property
    def sill(self) -> Pit:
        """The slit, in the middle of the wall before the car."""
        return Pit(self.middle @ Pose2(self.length / 2 + SILL_AHEAD, 0.0), self.gap, self.width, SHAFT_DEPTH)

    def holds(self, map_from_base: Pose2) -> bool:
        """Return whether a chair's axle is in the cabin."""
        inside = self.middle.inverse() @ map_from_base
        return abs(inside.x) <= self.length / 2 and abs(inside.y) <= self.width / 2


class PersonBehaviour(enum.Enum):
    """The way a person moves."""

    PATH = "path"  # to and fro along a path; one that yields stops for obstacles on it
    SOCIAL = "social"  # along a path, pushed aside by walls, people and the chair (social force)
    SEATED = "seated"  # does not move
    SUDDEN = "sudden"  # steps out along its path when the chair comes near, and back after a while
    BOUNCE = "bounce"  # a disc with a new heading every 2 s, reflected by walls


@dataclass(frozen=True, slots=True)
class PersonPlan:
    """A person of the plan at the start of `path` (N, 2) [m, map]; `yields` tells if it yields to the chair.

    One who walks to and fro stays for `rest` [s] at each end.
    """

    behaviour: PersonBehaviour
    path: FloatArray
    speed: float = 1.0
    yields: bool = True
    radius: float = 0.25
    trigger: float = 3.0
    rest: float = 0.0


@dataclass(frozen=True, slots=True)
class PersonState:
    """A person at one moment, for the sensors: pose in map, speed [m/s], and `stride` [rad], the phase of its gait."""

    pose: Pose2
    speed: float
    stride: float
    radius: float
    behaviour: PersonBehaviour
    seed: int = 0


@dataclass(frozen=True, slots=True)
class OtherChair:
    """Another wheelchair at one moment, for the sensors: pose in map (`map_from_base`), body and number in its level."""

    pose: Pose2
    body: ChairBody
    number: int


Mover: TypeAlias = PersonState | OtherChair
"""Anything that moves and that sensors see."""


@dataclass(frozen=True, slots=True)
class Slice:
    """The outline of a world at one height: segments (N, 4) [m, map] x0 y0 x1 y1 and their `Reflection`, (N,)."""

    segments: FloatArray
    reflections: IntArray
