"""The geometry of a floor plan: blocks, slopes and pits, and the grid of cells that a chair cannot enter."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from waychair.geometry import rectangle, transform_points
from waychair.maps.grid.cells import cells_from_points, points_from_cells
from waychair.simulation.plan.floor_plan import (
    LEAF_THICKNESS,
    FloorPlan,
    PlanBox,
    PlanDoor,
    PlanStairs,
    PlanTable,
    PlanThreshold,
    PlanWall,
    Point,
)
from waychair.simulation.scene.contact import HIGHEST, LOWEST
from waychair.simulation.scene.scene import DOOR_HEIGHT, Block, Pit, Slope
from waychair.simulation.scene.seeds import seed_from_names
from waychair.types import BoolArray, Cells, FloatArray, IntArray, OccupancyGrid, Pose2


def blocks_from_plan(plan: FloorPlan, building: str) -> tuple[Block, ...]:
    """Return all fixed solids: walls, lintels, leaves of doors, furniture, thresholds, steps of stairways.

    A seed is made of the names of building and level and the item's index, unless the plan gives one.
    """
    parts: list[tuple[str, int, int | None, list[Block]]] = []
    for i, wall in enumerate(plan.walls):
        parts.append(("walls", i, wall.seed, _wall(wall, wall.material or plan.finish.walls, plan.finish.height)))
    parts += [("boxes", i, box.seed, [_box(box)]) for i, box in enumerate(plan.boxes)]
    parts += [("tables", i, table.seed, _table(table)) for i, table in enumerate(plan.tables)]
    parts += [("thresholds", i, None, [_threshold(sill)]) for i, sill in enumerate(plan.thresholds)]
    parts += [("stairs", i, None, _steps(stairs)) for i, stairs in enumerate(plan.stairs)]
    blocks = []
    for section, i, seed, pieces in parts:
        names = (building, plan.name, section, i) if seed is None else ("seed", seed)
        blocks += [replace(piece, seed=seed_from_names(*names, k)) for k, piece in enumerate(pieces)]
    return tuple(blocks)


def slopes_from_plan(plan: FloorPlan, building: str) -> tuple[Slope, ...]:
    """Return ramps and platforms."""
    return tuple(
        Slope(
            *_strip(r.start, r.end),
            r.width,
            r.low,
            r.high,
            r.material,
            seed_from_names(building, plan.name, "ramps", i),
        )
        for i, r in enumerate(plan.ramps)
    )


def pits_from_plan(plan: FloorPlan) -> tuple[Pit, ...]:
    """Return stairways and other holes in the floor."""
    stairs = [Pit(*_strip(s.start, s.end), s.width, s.steps * s.rise) for s in plan.stairs]
    return (*stairs, *(Pit(Pose2(*pit.centre, pit.yaw), *pit.size, pit.depth) for pit in plan.pits))


def solid_pieces(wall: PlanWall) -> list[tuple[float, float]]:
    """Return the wall's solid stretches [m] from its start: all but its doors, open or closed."""
    doors = sorted(wall.doors, key=lambda door: door.at)
    begins = [0.0, *(door.at + door.width / 2 for door in doors)]
    ends = [*(door.at - door.width / 2 for door in doors), wall.length]
    return [(begin, end) for begin, end in zip(begins, ends, strict=True) if end - begin > 1e-6]


def pose_on_wall(wall: PlanWall, at: float) -> Pose2:
    """Return the pose on the wall's centre line, `at` [m] from its start, facing along it."""
    (ax, ay), (bx, by) = wall.start, wall.end
    theta = math.atan2(by - ay, bx - ax)
    return Pose2(ax + at * math.cos(theta), ay + at * math.sin(theta), theta)


def door_block(middle: Pose2, width: float, thickness: float, ceiling: float, material: str, seed: int = 0) -> Block:
    """Return the leaf of a closed door, as thick as its wall."""
    return Block(
        middle=middle,
        length=width,
        width=thickness,
        low=0.0,
        high=min(DOOR_HEIGHT, ceiling),
        material=material,
        seed=seed,
    )


def leaf_block(wall: PlanWall, door: PlanDoor, ceiling: float) -> Block:
    """Return the leaf of a door that stands open, beyond the hinge's side of the opening."""
    side = 1.0 if door.opens == "left" else -1.0
    from_start = door.hinge == "start"
    hinge = pose_on_wall(wall, door.at + (-door.width / 2 if from_start else door.width / 2))
    turned = side * door.leaf if from_start else math.pi - side * door.leaf
    off = side if from_start else -side
    along = Pose2(0.0, side * wall.thickness / 2, turned) @ Pose2(door.width / 2, off * LEAF_THICKNESS / 2)
    high = min(DOOR_HEIGHT, ceiling)
    return Block(hinge @ along, door.width, LEAF_THICKNESS, 0.0, high, door.material)


def _wall(wall: PlanWall, material: str, ceiling: float) -> list[Block]:
    """Return a wall's pieces between the doors, then a lintel above each door, then the leaves of closed doors and of open ones."""
    blocks = [
        Block(
            middle=pose_on_wall(wall, (begin + end) / 2),
            length=end - begin,
            width=wall.thickness,
            low=0.0,
            high=ceiling,
            material=material,
        )
        for begin, end in solid_pieces(wall)
    ]
    if ceiling > DOOR_HEIGHT:
        blocks += [
            Block(
                middle=pose_on_wall(wall, door.at),
                length=door.width,
                width=wall.thickness,
                low=DOOR_HEIGHT,
                high=ceiling,
                material=material,
            )
            for door in wall.doors
        ]
    return (
        blocks
        + [
            door_block(pose_on_wall(wall, door.at), door.width, wall.thickness, ceiling, door.material)
            for door in wall.doors
            if door.closed
        ]
        + [leaf_block(wall, door, ceiling) for door in wall.doors if door.leaf]
    )


def _box(box: PlanBox) -> Block:
    return Block(Pose2(*box.centre, box.yaw), *box.size, box.low, box.high, box.material)


def _threshold(sill: PlanThreshold) -> Block:
    return Block(Pose2(*sill.centre, sill.yaw), *sill.size, 0.0, sill.height, sill.material)


def _table(table: PlanTable) -> list[Block]:
    """Return the table top, then the legs at its corners."""
    middle, under = Pose2(*table.centre, table.yaw), table.height - table.top
    out_x, out_y = ((side - table.legs) / 2 for side in table.size)
    return [
        Block(middle, *table.size, under, table.height, table.material),
        *(
            Block(
                middle=middle @ Pose2(x, y),
                length=table.legs,
                width=table.legs,
                low=0.0,
                high=under,
                material=table.material,
            )
            for x in (-out_x, out_x)
            for y in (-out_y, out_y)
        ),
    ]


def _steps(stairs: PlanStairs) -> list[Block]:
    """Return all steps but the last, which is the floor of the pit."""
    middle, length = _strip(stairs.start, stairs.end)
    tread, depth = length / stairs.steps, stairs.steps * stairs.rise
    return [
        Block(
            middle=middle @ Pose2((k + 0.5) * tread - length / 2, 0.0),
            length=tread,
            width=stairs.width,
            low=-depth,
            high=-(k + 1) * stairs.rise,
            material=stairs.material,
        )
        for k in range(stairs.steps - 1)
    ]


def _strip(start: Point, end: Point) -> tuple[Pose2, float]:
    """Return the middle pose and the length of the strip from start to end."""
    (ax, ay), (bx, by) = start, end
    return Pose2((ax + bx) / 2, (ay + by) / 2, math.atan2(by - ay, bx - ax)), math.dist(start, end)


def grid_from_plan(
    plan: FloorPlan, margin: float, blocks: Iterable[Block], slopes: Sequence[Slope], pits: Iterable[Pit]
) -> OccupancyGrid:
    """Return the grid of cells that a chair cannot enter, without unknown cells; it reaches `margin` [m] past the plan.

    A cell is occupied if its centre lies in a block between `LOWEST` and `HIGHEST` above the floor, in a pit, or on the
    upper side of a slope's edge that is higher than `LOWEST`.
    """
    # round() first: 15.0 / 0.05 must not become 301 cells by an error in the last place
    shape = tuple(math.ceil(round((length + 2 * margin) / plan.resolution, 6)) for length in reversed(plan.size))
    grid = OccupancyGrid(np.zeros(shape, np.int8), plan.resolution, Pose2(-margin, -margin, 0.0))
    for block in blocks:
        fill_block(grid.cells, grid, block)
    for pit in pits:
        fill_rectangle(grid.cells, grid, pit.middle, pit.length, pit.width)
    if slopes:
        grid.cells[_edges(grid, slopes)] = 100
    return grid


def fill_block(cells: Cells, grid: OccupancyGrid, block: Block) -> None:
    """Mark the cells that a block at the height of a chair takes as occupied."""
    if block.high > LOWEST and block.low < HIGHEST:
        fill_rectangle(cells, grid, block.middle, block.length, block.width)


def fill_rectangle(cells: Cells, grid: OccupancyGrid, middle: Pose2, length: float, width: float) -> None:
    """Mark each of `cells` whose centre lies in the rectangle as occupied."""
    covered, _ = cells_in_rectangle(grid, middle, length, width)
    cells[tuple(covered.T)] = 100


def cells_in_rectangle(grid: OccupancyGrid, middle: Pose2, length: float, width: float) -> tuple[IntArray, FloatArray]:
    """Return row and column (N, 2) of the cells with centres in a rectangle, and the centres (N, 2) [m] in its frame."""
    corners = cells_from_points(grid, transform_points(middle, rectangle(length / 2, length / 2, width / 2)))
    low = np.maximum(corners.min(axis=0) - 1, 0)
    high = np.maximum(np.minimum(corners.max(axis=0) + 2, grid.cells.shape), low)
    window = low + np.argwhere(np.ones(high - low, np.bool_))  # only these can lie in it
    local = transform_points(middle.inverse(), points_from_cells(grid, window))
    within = np.all(np.abs(local) <= np.array([length / 2, width / 2]) + 1e-9, axis=1)
    return window[within], local[within]


def _edges(grid: OccupancyGrid, slopes: Sequence[Slope]) -> BoolArray:
    """Return the cells (H, W) from which the ground drops by more than `LOWEST` to one of the four neighbours."""
    ground = np.zeros(grid.cells.shape)
    for slope in slopes:
        cells, local = cells_in_rectangle(grid, slope.middle, slope.length, slope.width)
        tops = slope.low + (local[:, 0] / slope.length + 0.5) * (slope.high - slope.low)
        ground[tuple(cells.T)] = np.maximum(ground[tuple(cells.T)], tops)
    padded = np.pad(ground, 1, mode="edge")
    lowest = np.minimum.reduce([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])
    falls: BoolArray = ground - lowest > LOWEST + 1e-9
    return falls
