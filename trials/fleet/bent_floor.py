"""A scene on a mapped floor: two chairs that meet in a corridor which bends through a right angle, with a niche in the bend.

Its traffic graph is made of the map, as that of any recorded floor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.grid.cells import joined_to, occupied
from waychair.maps.traffic.mapped_floor import mapped_floor_graph
from waychair.maps.traffic.traffic_graph import RefugeKind
from waychair.simulation.plan.floor_plan import FloorPlan, PlanWall
from waychair.simulation.plan.world import World, world_from_plan
from waychair.trials.fleet.fleet_drive import FleetScene
from waychair.types import UNKNOWN, Place, Pose2

WALL = 0.1
"""m; thickness of the walls."""

HALF_WIDTH = 0.7
"""m; half the corridor's clear width, in which two chairs do not pass."""

MIDDLE, RADIUS = (5.0, 9.0), 5.0
"""m; middle and radius of the bend, from (5, 4) to (10, 9)."""

NICHE_DEPTH, NICHE_HALF_WIDTH = 1.5, 0.7
"""m; a chair stands in the niche with its rear out of the corridor."""

_IN_NICHE = (RADIUS + 1.3) / math.sqrt(2.0)
"""m from the middle of the bend, along x and back along y, to a chair in the niche."""

_ARC_STEP = math.radians(5.0)

PLACES: Mapping[str, Pose2] = MappingProxyType(
    {
        "west 1": Pose2(1.75, 3.1, math.pi),
        "west 2": Pose2(1.75, 4.9, math.pi),
        "north 1": Pose2(9.1, 12.2, math.pi / 2),
        "north 2": Pose2(10.9, 12.2, math.pi / 2),
        "niche": Pose2(MIDDLE[0] + _IN_NICHE, MIDDLE[1] - _IN_NICHE, -math.pi / 4),
    }
)
"""Two places in the hall at each end, and one in the niche, where a chair may wait."""


BEND_WALK = (
    (3.5, 5.3),
    (3.4, 4.4),
    (4.3, 4.0),
    (5.0, 4.0),
    (7.5, 4.67),
    (9.33, 6.5),
    (10.0, 9.0),
    (10.2, 10.6),
    (11.3, 10.6),
)
"""m; the way of a person round the bend, from a corner of one hall to a corner of the other one, where chairs get past."""


def bent_world() -> World:
    """Return the floor: a hall in the west, a corridor that bends to the left, and a hall in the north."""
    aside = HALF_WIDTH + WALL / 2
    tangent, outwards = np.array([1.0, 1.0]) / math.sqrt(2.0), np.array([1.0, -1.0]) / math.sqrt(2.0)
    outer = RADIUS + aside
    half = NICHE_HALF_WIDTH + WALL / 2
    opening = math.asin(half / outer)
    jambs = [MIDDLE + outer * math.cos(opening) * outwards + side * half * tangent for side in (-1.0, 1.0)]
    niche = [jambs[0], *(jamb + NICHE_DEPTH * outwards for jamb in jambs), jambs[1]]
    west, north = (0.5, 2.25, 4.0, 5.75), (8.25, 10.0, 11.75, 13.5)
    lines = [
        [
            (4.0, 4.0 - aside),
            (west[2], west[1]),
            (west[0], west[1]),
            (west[0], west[3]),
            (west[2], west[3]),
            (4.0, 4.0 + aside),
        ],
        [(10.0 - aside, 10.0), (north[0], north[1]), (north[0], north[3]), (north[2], north[3]), (north[2], north[1])],
        [(north[2], north[1]), (10.0 + aside, 10.0)],
        [(4.0, 4.0 + aside), *_arc(RADIUS - aside, 0.0, math.pi / 2), (10.0 - aside, 10.0)],
        [(4.0, 4.0 - aside), *_arc(outer, 0.0, math.pi / 4 - opening)],
        [(float(x), float(y)) for x, y in niche],
        [*_arc(outer, math.pi / 4 + opening, math.pi / 2), (10.0 + aside, 10.0)],
    ]
    plan = FloorPlan(
        name="bent floor",
        size=(12.5, 14.5),
        start=(PLACES["west 1"].x, PLACES["west 1"].y, 0.0),
        walls=[PlanWall(start=a, end=b, thickness=WALL) for line in lines for a, b in pairwise(line)],
        places={name: (pose.x, pose.y, pose.theta) for name, pose in PLACES.items()},
    )
    return world_from_plan(plan, plan.name)


def bent_scene(seed: int, time_limit_s: float) -> FleetScene:
    """Return two chairs that each drive from one hall to the other, and meet on the way."""
    world = bent_world()
    places = {name: Place(name, pose) for name, pose in PLACES.items()}
    start = PLACES["west 1"]
    seen = joined_to(world.grid, start.x, start.y) | occupied(world.grid)  # not the ground beyond the walls
    grid = replace(world.grid, cells=np.where(seen, world.grid.cells, UNKNOWN))
    graph = mapped_floor_graph(grid, places.values(), name=world.level, chair_width=CHAIR_A.width)
    refuges = [
        replace(each, waiting=True, kind=RefugeKind.BAY) if each.name == "niche" else each for each in graph.refuges
    ]
    return FleetScene(
        world=world,
        graph=replace(graph, refuges=tuple(refuges)),
        places=places,
        starts=("west 1", "north 1"),
        goals=(("north 2",), ("west 2",)),
        seed=seed,
        time_limit_s=time_limit_s,
    )


def _arc(radius: float, start: float, end: float) -> list[tuple[float, float]]:
    """Return points along the bend at a radius [m], from an angle to another [rad], 0 where it begins."""
    angles = np.linspace(start, end, math.ceil((end - start) / _ARC_STEP) + 1)
    points = MIDDLE + radius * np.column_stack([np.sin(angles), -np.cos(angles)])
    return [(float(x), float(y)) for x, y in points]
