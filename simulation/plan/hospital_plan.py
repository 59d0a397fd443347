"""A hospital of several storeys, drawn from a seed: two wings, a hall with three lifts, a ramp, and more than sixty rooms.

    load_levels("hospital")     load_levels("hospital:7")

Each storey is 44 x 26 m: two corridors along x, a hall between them with lifts A and B on its west side and C on its
east side, and a narrower way between the wings over a ramp at the east end. Lift C does not reach the top. The two highest
storeys are alike to the cell, as wards are; the others differ in rooms and furniture.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from waychair.simulation.plan.floor_plan import (
    BuildingPlan,
    FloorPlan,
    Planar,
    PlanBox,
    PlanDoor,
    PlanFinish,
    PlanLift,
    PlanLight,
    PlanPerson,
    PlanRamp,
    PlanWall,
)
from waychair.simulation.scene.seeds import random_stream

LENGTH, WIDTH = 44.0, 26.0
"""m; of a storey."""

SOUTH, NORTH = (5.6, 8.4), (17.6, 20.4)
"""m; y of the two corridors' walls."""

MIDDLE = 13.0
"""m; y of the wall between the inner rooms of both wings."""

HALL = (18.0, 26.0)
"""m; x of the hall's walls."""

EAST_WAY = (41.2, 44.0)
"""m; x of the walls of the way with the ramp."""

SHAFT = 2.3
"""m; side of a lift's shaft, from wall to wall; its cabin is a wall's thickness smaller."""

LIFTS = (("A", HALL[0], 10.15, 0.0), ("B", HALL[0], 15.85, 0.0), ("C", HALL[1], 13.0, math.pi))
"""Lifts: name, x of the wall with the door, y of its middle, heading out of the cabin."""

GAPS = {"A": 0.03, "B": 0.02, "C": 0.01}
"""m; slits between the cars and the sills."""

STOREYS = 4


def hospital_plan(seed: int = 0, storeys: int = STOREYS) -> BuildingPlan:
    """Return the plan of a hospital; same seed, same plan."""
    levels = [_storey(k, min(k, storeys - 2), storeys, seed) for k in range(storeys)]
    return BuildingPlan(name="hospital" if seed == 0 else f"hospital:{seed}", levels=levels)


def _storey(number: int, alike: int, storeys: int, seed: int) -> FloorPlan:
    """Return a storey; `alike` numbers what it looks like."""
    rng = random_stream(seed, 1000 + alike)
    walls, boxes, places = _outer_walls(), list[PlanBox](), dict[str, Planar]()
    rooms = 0
    for y0, y1, door_y, spans in _bands(rng):
        for x0, x1 in spans:
            rooms += 1
            _room(rng, walls, boxes, places, f"room {number}{rooms:02d}", (x0, y0, x1, y1), door_y)
    lifts = []
    for name, x, y, theta in LIFTS:
        _shaft(walls, name, x, y, theta)
        if name == "C" and number == storeys - 1:
            continue
        inner = SHAFT - 0.1
        out = math.cos(theta)
        lifts.append(PlanLift(name=name, middle=(x - out * SHAFT / 2, y, theta), size=(inner, inner), gap=GAPS[name]))
        places[f"lift {name}"] = (x + out * 2.0, y, math.pi if theta == 0.0 else 0.0)
    boxes += _hall_furniture(rng, alike)
    return FloorPlan(
        name=str(number),
        size=(LENGTH, WIDTH),
        start=(22.0, 9.8, 0.0),
        walls=walls,
        finish=PlanFinish(floor="tiles", height=3.0),
        light=PlanLight(spacing=6.0),
        boxes=boxes,
        ramps=_ramps(),
        people=_people(rng, number),
        lifts=lifts,
        places=places,
        routes={
            "mapping": [
                (22.0, 9.8),
                (22.0, 7.0),
                (2.0, 7.0),
                (42.6, 7.0),
                (42.6, 19.0),
                (2.0, 19.0),
                (22.0, 19.0),
                (22.0, 9.8),
            ]
        },
    )


def _outer_walls() -> list[PlanWall]:
    corners = [(0.0, 0.0), (LENGTH, 0.0), (LENGTH, WIDTH), (0.0, WIDTH), (0.0, 0.0)]
    return [PlanWall(start=a, end=b, material="concrete") for a, b in pairwise(corners)]


def _bands(rng: np.random.Generator) -> list[tuple[float, float, float, list[tuple[float, float]]]]:
    """Return rows of rooms: y from and to, the y of the wall with their doors, and x from and to of each room."""
    shaft_west, shaft_east = HALL[0] - SHAFT, HALL[1] + SHAFT
    return [
        (0.0, SOUTH[0], SOUTH[0], _spans(rng, 0.0, LENGTH, 8)),
        (SOUTH[1], MIDDLE, SOUTH[1], _spans(rng, 0.0, shaft_west, 3) + _spans(rng, shaft_east, EAST_WAY[0], 2)),
        (MIDDLE, NORTH[0], NORTH[0], _spans(rng, 0.0, shaft_west, 3) + _spans(rng, shaft_east, EAST_WAY[0], 2)),
        (NORTH[1], WIDTH, NORTH[1], _spans(rng, 0.0, LENGTH, 8)),
    ]


def _spans(rng: np.random.Generator, start: float, end: float, count: int) -> list[tuple[float, float]]:
    """Return rooms side by side, of somewhat different widths."""
    parts = 1.0 + rng.uniform(-0.15, 0.15, count)
    ends = start + np.concatenate([[0.0], np.cumsum(parts) / parts.sum()]) * (end - start)
    return [(round(float(a), 2), round(float(b), 2)) for a, b in pairwise(ends)]


def _room(
    rng: np.random.Generator,
    walls: list[PlanWall],
    boxes: list[PlanBox],
    places: dict[str, Planar],
    name: str,
    sides: tuple[float, float, float, float],
    door_y: float,
) -> None:
    """Add a room with its door to the corridor, a bed, a cupboard and a place."""
    x0, y0, x1, y1 = sides
    inward = 1.0 if door_y == y0 else -1.0
    deep = y1 if inward > 0 else y0
    at = round(float(rng.uniform(0.35, 0.65)) * (x1 - x0), 2)
    door = PlanDoor(at=at, width=round(float(rng.uniform(1.0, 1.15)), 2))
    walls.append(PlanWall(start=(x0, door_y), end=(x1, door_y), doors=[door]))
    walls.append(PlanWall(start=(x1, door_y), end=(x1, deep)))
    if x0 > 0.0:
        walls.append(PlanWall(start=(x0, door_y), end=(x0, deep)))
    walls.append(PlanWall(start=(x0, deep), end=(x1, deep)))
    bed_x = x0 + 0.7 if rng.random() < 0.5 else x1 - 0.7
    boxes.append(
        PlanBox(centre=(round(bed_x, 2), round(deep - inward * 1.25, 2)), size=(1.0, 2.1), high=0.9, material="cloth")
    )
    other = x1 - 0.5 if bed_x < (x0 + x1) / 2 else x0 + 0.5
    boxes.append(PlanBox(centre=(round(other, 2), round(deep - inward * 0.4, 2)), size=(0.8, 0.5), high=1.8))
    places[name] = (round(x0 + at, 2), round(door_y + inward * 2.0, 2), inward * math.pi / 2)


def _shaft(walls: list[PlanWall], name: str, x: float, y: float, theta: float) -> None:
    """Add a shaft's walls, with the lift's door in the one to the hall."""
    back, half = x - math.cos(theta) * SHAFT, SHAFT / 2
    door = PlanDoor(name=f"lift {name}", at=half, width=1.2)
    walls.append(PlanWall(start=(x, y - half), end=(x, y + half), material="metal", doors=[door]))
    for at in (y - half, y + half):
        walls.append(PlanWall(start=(back, at), end=(x, at), material="concrete"))
    walls.append(PlanWall(start=(back, y - half), end=(back, y + half), material="concrete"))
    between = sorted(edge for name_, x_, y_, _ in LIFTS if x_ == x for edge in (y_ - half, y_ + half))
    ends = [SOUTH[1], *between, NORTH[0]]
    if y + half == between[1]:  # once for each side of the hall: the walls between the shafts
        for low, high in zip(ends[::2], ends[1::2], strict=True):
            walls.append(PlanWall(start=(x, low), end=(x, high)))


def _hall_furniture(rng: np.random.Generator, alike: int) -> list[PlanBox]:
    """Return a desk and benches in the hall, which tell one storey from another."""
    spots = [(22.0, 13.0), (25.4, 10.0), (25.4, 15.9), (20.4, 17.2), (24.0, 17.2), (20.6, 13.0)]
    chosen = rng.permutation(len(spots))[: 2 + alike % 2]
    boxes = []
    for k in chosen:
        x, y = spots[int(k)]
        size = (0.5, 1.6) if x > 25.0 else (1.6, 0.5)
        boxes.append(PlanBox(centre=(x, y), size=size, high=round(float(rng.uniform(0.5, 1.1)), 2)))
    return boxes


def _ramps() -> list[PlanRamp]:
    """Return the ramps up and down in the way between the wings."""
    x = (EAST_WAY[0] + EAST_WAY[1]) / 2
    width = EAST_WAY[1] - EAST_WAY[0] - 0.2
    return [
        PlanRamp(start=(x, 9.5), end=(x, 12.5), width=width, high=0.15),
        PlanRamp(start=(x, 12.5), end=(x, 13.5), width=width, low=0.15, high=0.15),
        PlanRamp(start=(x, 16.5), end=(x, 13.5), width=width, high=0.15),
    ]


def _people(rng: np.random.Generator, number: int) -> list[PlanPerson]:
    """Return two people who walk along the corridors."""
    people = []
    for y in ((SOUTH[0] + SOUTH[1]) / 2 - 0.6, (NORTH[0] + NORTH[1]) / 2 + 0.6):
        x0, x1 = float(rng.uniform(2.0, 12.0)), float(rng.uniform(30.0, 40.0))
        people.append(
            PlanPerson(
                behaviour="social",
                path=[(round(x0, 1), y), (round(x1, 1), y)],
                speed=round(float(rng.uniform(0.6, 1.0)), 2),
            )
        )
    return people
