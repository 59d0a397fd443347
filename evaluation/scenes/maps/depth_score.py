"""Score a map with depth against its true world: the obstacles that it misses and the false ones that it holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.calibration.chair_body import TALLEST, ChairBody
from waychair.geometry import compose, transform_points, wrap_angles
from waychair.maps.grid.cells import cells_from_points, inside, occupied, occupied_points, points_from_cells
from waychair.simulation.plan.plan_blocks import cells_in_rectangle
from waychair.simulation.plan.world import World
from waychair.simulation.scene.scene import Block, Pit
from waychair.types import BoolArray, FloatArray, OccupancyGrid, Pose2

LEAST = 0.06
"""Lower objects on the floor [m] do not count as obstacles."""

NEAR = 0.10
"""A mapped cell within this distance [m] of a real object is right."""


@dataclass(frozen=True, slots=True)
class DepthScore:
    """Counts of the low and overhanging objects that the camera viewed, and of those among them that the map misses.

    `thing_share` and `drop_share` are the shares of viewed cells that are occupied in the map, of objects (which a
    camera sees from one side) and of pits; 1 without any. `false_cells` of the map's `cells` occupied cells lie away
    from every object.
    """

    low_missed: int
    low: int
    overhanging_missed: int
    overhanging: int
    thing_share: float
    drop_share: float
    false_cells: int
    cells: int


def depth_score(
    grid: OccupancyGrid, world: World, true_from_map: Pose2, way: FloatArray, body: ChairBody
) -> DepthScore:
    """Compare a map with the blocks and pits of its world.

    An object is low if it ends below the lidar's plane, overhanging if it begins above this plane and below the rider's
    head. It counts if the camera viewed `_FEWEST` of its cells on the true path `way` (N, 3) [m, m, rad, world]. It is
    missed if none of these cells, nor a cell beside them, is occupied in the map.
    """
    counts = {"low": [0, 0], "overhanging": [0, 0]}
    lenses = compose(way, np.array([body.camera_x, body.camera_y, body.camera_yaw]))
    tall = [block for block in world.blocks if block.high > body.camera_z and block.low < body.camera_z]
    things = np.empty((0, 2))
    for block in world.blocks:
        kind = _kind(block, body.laser_z)
        if kind is None:
            continue
        seen = _seen_cells(world, block, lenses, tall)
        if len(seen) >= _FEWEST:
            things = np.concatenate([things, seen])
            counts[kind][1] += 1
            counts[kind][0] += _share(grid, true_from_map, seen) == 0.0
    mouths = np.concatenate([np.empty((0, 2)), *(_seen_cells(world, pit, lenses, tall) for pit in world.pits)])
    shares = [_share(grid, true_from_map, points) if len(points) else 1.0 for points in (things, mouths)]
    (low_missed, low), (over_missed, over) = counts["low"], counts["overhanging"]
    wrong, cells = _made_up(grid, world, true_from_map)
    return DepthScore(
        low_missed=low_missed,
        low=low,
        overhanging_missed=over_missed,
        overhanging=over,
        thing_share=shares[0],
        drop_share=shares[1],
        false_cells=wrong,
        cells=cells,
    )


_NEAREST, _FARTHEST, _HALF_VIEW = 1.75, 3.2, 0.5  # [m, m, rad] from the lens: limits of the well visible ground
_FEWEST = 8  # viewed cells of an object that counts


def _kind(block: Block, laser_z: float) -> str | None:
    """Return "low", "overhanging", or None for a block that the lidar sees or that cannot touch the chair."""
    if LEAST <= block.high < laser_z and block.low >= 0.0:
        return "low"
    return "overhanging" if laser_z < block.low < TALLEST else None


def _seen_cells(world: World, thing: Block | Pit, lenses: FloatArray, tall: Sequence[Block]) -> FloatArray:
    """Return the centres (N, 2) [m] of an object's cells that a lens pose of (M, 3) viewed past all tall blocks."""
    cells, _ = cells_in_rectangle(world.grid, thing.middle, thing.length, thing.width)
    points = points_from_cells(world.grid, cells) if len(cells) else np.empty((0, 2))
    seen = np.zeros(len(points), np.bool_)
    for lens in lenses[:: max(1, len(lenses) // 1000)]:
        away = points - lens[:2]
        far, aside = np.hypot(*away.T), wrap_angles(np.arctan2(away[:, 1], away[:, 0]) - lens[2])
        before = ~seen & (far > _NEAREST) & (far < _FARTHEST) & (np.abs(aside) < _HALF_VIEW)
        seen[before] = [not _hidden(lens[:2], point, tall) for point in points[before]]
    found: FloatArray = points[seen]
    return found


def _hidden(eye: FloatArray, point: FloatArray, tall: Sequence[Block]) -> bool:
    """Return whether a tall block hides a point from the eye."""
    along = eye + np.linspace(0.0, 0.98, 40)[:, None] * (point - eye)
    return any(_within(block, along).any() for block in tall)


def _within(thing: Block | Pit, points: FloatArray, margin: float = 0.0) -> BoolArray:
    """Return (N,) whether points (N, 2) [m] lie within `margin` [m] of an object's rectangle."""
    local = np.abs(transform_points(thing.middle.inverse(), points)) - [thing.length / 2, thing.width / 2]
    result: BoolArray = np.hypot(*np.maximum(local, 0.0).T) <= margin + 1e-9
    return result


def _share(grid: OccupancyGrid, true_from_map: Pose2, points: FloatArray) -> float:
    """Return the share of points (N, 2) [m, world] in or beside an occupied map cell."""
    thick = np.pad(occupied(grid), 1)
    thick = np.logical_or.reduce(
        [thick[i : i + grid.cells.shape[0], j : j + grid.cells.shape[1]] for i, j in np.ndindex(3, 3)]
    )
    cells = cells_from_points(grid, transform_points(true_from_map.inverse(), points))
    within = inside(grid, cells)
    return float(thick[tuple(cells[within].T)].sum() / len(points))


def _made_up(grid: OccupancyGrid, world: World, true_from_map: Pose2) -> tuple[int, int]:
    """Return the counts of the map's occupied cells: away from every object at the chair's heights, and all."""
    points = transform_points(true_from_map, occupied_points(grid))
    things: list[Block | Pit] = [each for each in world.blocks if each.low < TALLEST and each.high > LEAST]
    things += world.pits
    right = np.zeros(len(points), np.bool_)
    for thing in things:
        right |= _within(thing, points, NEAR)
    return int((~right).sum()), len(points)
