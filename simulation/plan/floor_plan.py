"""The file format of floor plans: one YAML file for a building; `plan_file.py` reads it and names the line of an error.

    name: flat
    size: [6.0, 4.0]            # x and y; the origin is the lower left corner
    start: [1.0, 1.0, 0.0]      # x, y, yaw
    finish: {floor: wood, walls: plaster, ceiling: panels, height: 2.6}
    light: {ambient: 0.3, power: 1.0, spacing: 3.0}
    poster_density: 0.2         # per metre of wall, on both of its sides
    walls:
      - {start: [0.0, 2.0], end: [6.0, 2.0], doors: [{name: kitchen, at: 4.0, width: 0.9}]}
    boxes:
      - {centre: [3.0, 0.4], size: [0.8, 0.4], yaw: 0.3, high: 1.8, material: wood}
    places:
      sink: [4.0, 3.0, 1.57]
    routes:
      mapping: [[1.0, 1.0], [4.0, 1.0], [4.0, 3.0]]
    people:
      - {behaviour: path, path: [[2.5, 1.5], [5.0, 1.5]], speed: 0.8}

Further sections are `tables`, `ramps`, `thresholds`, `stairs`, `pits`, `lamps` and `lifts`. A building of several
levels has a `name` and `levels`, a list of such plans with their own names. Units are metres and radians, or degrees as
in `90deg`; `scene.MATERIALS` lists the materials and `scene.Behaviour` the behaviours.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, TypeAlias

import msgspec
from msgspec import Meta

from waychair.maps.building.april_tags import MOST
from waychair.simulation.scene.scene import Finish

Keys: TypeAlias = tuple[str | int, ...]
"""The keys that lead to a value in a plan, such as ("walls", 0, "start")."""

Point: TypeAlias = tuple[float, float]
Planar: TypeAlias = tuple[float, float, float]
Length: TypeAlias = Annotated[float, Meta(gt=0.0, le=500.0)]
Height: TypeAlias = Annotated[float, Meta(ge=0.0, le=20.0)]
Share: TypeAlias = Annotated[float, Meta(ge=0.0, le=1.0)]
Power: TypeAlias = Annotated[float, Meta(ge=0.0, le=100.0)]


LEAF_THICKNESS = 0.04
"""m; of a door's leaf that stands open; a closed one is as thick as its wall."""


class PlanDoor(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An opening in a wall; its middle is `at` [m] from the wall's start.

    A door with a name can be closed in the simulator. A `closed` door has a fixed leaf of `material`. One with a `leaf`
    [rad] stands open by this angle: its leaf hangs at the opening's `hinge`, the end nearer to the wall's start or end,
    and `opens` to the left or right seen along the wall; from 90 degrees on it leaves the whole width.
    """

    at: float
    width: Length
    name: str = ""
    closed: bool = False
    material: str = "wood"
    leaf: Annotated[float, Meta(ge=0.0, le=2.7)] = 0.0
    hinge: Literal["start", "end"] = "start"
    opens: Literal["left", "right"] = "left"


class PlanPoster(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A poster on a wall; its middle is `at` [m] from the wall's start, on the `left` or `right` seen along the wall.

    `size` is width along the wall and height; posters with equal `seed` look alike.
    """

    at: float
    side: Literal["left", "right"] = "left"
    height: Height = 1.4
    size: tuple[Length, Length] = (0.6, 0.8)
    seed: int | None = None


class PlanTag(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An AprilTag on a wall, placed as a poster; `size` [m] is its side with the white edge."""

    at: float
    number: Annotated[int, Meta(ge=0, lt=MOST)]
    side: Literal["left", "right"] = "left"
    height: Height = 1.2
    size: Length = 0.25


class PlanWall(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A straight wall between two points, up to the ceiling; at least two cells thick, so that a slanted wall has no
    holes. `material` defaults to that of the finish; walls with equal `seed` look alike.
    """

    start: Point
    end: Point
    thickness: Annotated[float, Meta(gt=0.0, le=5.0)] = 0.1
    doors: list[PlanDoor] = []
    posters: list[PlanPoster] = []
    tags: list[PlanTag] = []
    material: str = ""
    seed: int | None = None

    @property
    def length(self) -> float:
        """Length from start to end [m]."""
        return math.dist(self.start, self.end)


def walls_round(size: Point, corner: Point = (0.0, 0.0)) -> list[PlanWall]:
    """Return four walls along the sides of a rectangle; `corner` is its lower left one."""
    (low, deep), (high, far) = corner, (corner[0] + size[0], corner[1] + size[1])
    corners = [(low, deep), (high, deep), (high, far), (low, far)]
    return [PlanWall(start=a, end=b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]


class PlanBox(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A piece of furniture: its size along its own x and y, turned by `yaw` [rad], from `low` to `high` [m]."""

    centre: Point
    size: tuple[Length, Length]
    yaw: float = 0.0
    low: Height = 0.0
    high: Height = 0.9
    material: str = "wood"
    seed: int | None = None


class PlanTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table on four square legs of side `legs` [m]; its top is `top` thick, with the upper face at `height` [m]."""

    centre: Point
    size: tuple[Length, Length]
    yaw: float = 0.0
    height: Height = 0.74
    top: Length = 0.04
    legs: Length = 0.05
    material: str = "wood"
    seed: int | None = None


class PlanRamp(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A slope to drive on, from `low` [m] at its start to `high` [m] at its end; with equal heights a platform."""

    start: Point
    end: Point
    width: Length
    high: Height
    low: Height = 0.0
    material: str = "concrete"


class PlanThreshold(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A sill on the floor that wheels climb."""

    centre: Point
    size: tuple[Length, Length]
    yaw: float = 0.0
    height: Annotated[float, Meta(gt=0.0, le=0.03)] = 0.02
    material: str = "metal"


class PlanStairs(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A stairway down from its start to its end: `steps` of `rise` [m] each; the last step is the floor below."""

    start: Point
    end: Point
    width: Length
    steps: Annotated[int, Meta(ge=1, le=50)] = 8
    rise: Annotated[float, Meta(gt=0.0, le=0.5)] = 0.17
    material: str = "concrete"


class PlanPit(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A hole in the floor, `depth` [m] deep."""

    centre: Point
    size: tuple[Length, Length]
    yaw: float = 0.0
    depth: Length = 1.0


class PlanLamp(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A lamp; without `height` just under the ceiling."""

    at: Point
    height: Height | None = None
    power: Power = 1.0


class PlanLight(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Ambient light, and the spacing [m] of the lattice of lamps in a plan that lists no lamps."""

    ambient: Share = 0.35
    power: Power = 1.0
    spacing: Annotated[float, Meta(ge=0.5, le=100.0)] = 3.6


class PlanFinish(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Materials of floor, walls and ceiling, and the height of the rooms [m]."""

    floor: str = Finish().floor
    walls: str = "plaster"
    ceiling: str = Finish().ceiling
    height: Annotated[float, Meta(ge=1.5, le=20.0)] = Finish().height


class PlanPerson(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A person, or `count` movers that bounce; movers without a path are placed at random on free floor."""

    behaviour: str
    path: list[Point] = []
    speed: Annotated[float, Meta(gt=0.0, le=1.5)] = 1.0
    yields: bool = True
    radius: Annotated[float, Meta(ge=0.05, le=0.6)] = 0.25
    trigger: Annotated[float, Meta(gt=0.0, le=20.0)] = 3.0
    count: Annotated[int, Meta(ge=1, le=200)] = 1


class PlanLift(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A lift's cabin: pose of its `middle` (x, y, yaw) facing its door, `size` along that direction and across.

    `gap` [m] is the width of the slit between the car's floor and the sill of the doorway (EN 81-20: at most 35 mm).
    """

    name: str
    middle: Planar
    size: tuple[Length, Length]
    gap: Annotated[float, Meta(ge=0.0, le=0.05)] = 0.0


class FloorPlan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One level; `resolution` [m] is the cell size of its grid."""

    name: str
    size: tuple[Length, Length]
    start: Planar
    walls: list[PlanWall]
    resolution: Annotated[float, Meta(ge=0.005, le=0.1)] = 0.05
    finish: PlanFinish = PlanFinish()
    light: PlanLight = PlanLight()
    lamps: list[PlanLamp] = []
    poster_density: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.0
    boxes: list[PlanBox] = []
    tables: list[PlanTable] = []
    ramps: list[PlanRamp] = []
    thresholds: list[PlanThreshold] = []
    stairs: list[PlanStairs] = []
    pits: list[PlanPit] = []
    people: list[PlanPerson] = []
    lifts: list[PlanLift] = []
    places: dict[str, Planar] = {}
    routes: dict[str, list[Point]] = {}


class BuildingPlan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Several levels; a chair starts on the first."""

    name: str
    levels: list[FloorPlan]
