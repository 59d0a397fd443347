"""The walls of a floor plan of corridors (`maps/traffic/corridors.py`), so that whole chairs can be simulated in it."""

from __future__ import annotations

from itertools import pairwise

from waychair.errors import WorldError
from waychair.maps.traffic.corridors import NARROW, CorridorPlan, corridor_graph, room_doors
from waychair.simulation.plan.floor_plan import FloorPlan, PlanWall
from waychair.simulation.plan.floor_plan_checks import plan_problems
from waychair.simulation.plan.world import World, world_from_plan

WALL = 0.1
"""m; thickness of a wall. Its inner side is at the edge of the corridor."""

ROOM_SIDE = 1.5
"""m; side of a room beside a corridor: the turning circle of one chair."""

_Box = tuple[float, float, float, float]


def corridor_world(plan: CorridorPlan, width: float = NARROW, *, rooms: bool = False, cell: float = 0.05) -> World:
    """Return the world of a plan whose corridors have a clear width [m], with a place at every node of its graph.

    `cell` [m] is the side of the map's cells. With `rooms`, each room of the cell map is a square of 1.5 m beside its corridor.

    Raises:
        TrafficError: no chair fits in the width.
        WorldError: the corridors reach beyond the plan.
    """
    graph = corridor_graph(plan, width, rooms=rooms)
    half = width / 2 + WALL / 2
    boxes = [
        (min(x0, x1) - half, min(y0, y1) - half, max(x0, x1) + half, max(y0, y1) + half)
        for x0, y0, x1, y1 in plan.corridors
    ]
    if rooms:
        side = (ROOM_SIDE + WALL) / 2
        for (x0, y0), (x1, y1) in room_doors(plan).values():
            boxes.append((x1 - side, y1 - side, x1 + side, y1 + side))
            boxes.append((min(x0, x1) - side, min(y0, y1) - side, max(x0, x1) + side, max(y0, y1) + side))
    first = graph.nodes[0]
    floor = FloorPlan(
        name=plan.name,
        size=plan.size,
        start=(first.x, first.y, 0.0),
        walls=[PlanWall(start=start, end=end, thickness=WALL) for start, end in outline(boxes)],
        resolution=cell,
        places={node.name: (node.x, node.y, 0.0) for node in graph.nodes},
    )
    for keys, problem in plan_problems(floor):
        raise WorldError(f"{plan.name}: {' '.join(map(str, keys))}: {problem}")
    return world_from_plan(floor, plan.name)


def outline(boxes: list[_Box]) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Return the straight pieces of the outline of a union of boxes x0, y0, x1, y1, along x first, then along y."""
    xs = sorted({round(x, 6) for box in boxes for x in (box[0], box[2])})
    ys = sorted({round(y, 6) for box in boxes for y in (box[1], box[3])})

    def solid(i: int, j: int) -> bool:
        if not (0 <= i < len(xs) - 1 and 0 <= j < len(ys) - 1):
            return False
        x, y = (xs[i] + xs[i + 1]) / 2, (ys[j] + ys[j + 1]) / 2
        return any(x0 < x < x1 and y0 < y < y1 for x0, y0, x1, y1 in boxes)

    walls: list[tuple[tuple[float, float], tuple[float, float]]] = []
    for j, y in enumerate(ys):
        edge = [solid(i, j) != solid(i, j - 1) for i in range(len(xs) - 1)]
        walls += [((xs[a], y), (xs[b], y)) for a, b in _stretches(edge)]
    for i, x in enumerate(xs):
        edge = [solid(i, j) != solid(i - 1, j) for j in range(len(ys) - 1)]
        walls += [((x, ys[a]), (x, ys[b])) for a, b in _stretches(edge)]
    return walls


def _stretches(edge: list[bool]) -> list[tuple[int, int]]:
    """Return the first and last-but-one index of each run of True."""
    changes = [i for i, (a, b) in enumerate(pairwise([False, *edge, False])) if a != b]
    return list(zip(changes[::2], changes[1::2], strict=True))
