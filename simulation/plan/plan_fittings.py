"""The fittings of a floor plan: finish, lamps, posters, tags and people."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import cv2
import numpy as np

from waychair.geometry import transform_points
from waychair.maps.grid.cells import cells_from_points, points_from_cells
from waychair.maps.grid.distance_field import distance_field
from waychair.simulation.plan.floor_plan import FloorPlan, PlanWall
from waychair.simulation.plan.plan_blocks import pose_on_wall, solid_pieces
from waychair.simulation.scene.scene import (
    MATERIALS,
    Block,
    Finish,
    Lamp,
    PersonBehaviour,
    PersonPlan,
    Poster,
    Reflection,
    WallTag,
)
from waychair.simulation.scene.seeds import seed_from_names
from waychair.types import BoolArray, FloatArray, OccupancyGrid, Pose2

POSTER_WIDTHS = (0.4, 0.9)
"""Least and greatest width [m] of posters placed by density."""

CLEAR_OF_START = 0.5
"""Least distance [m] between the start and movers that are placed at random."""

_BELOW_CEILING = 0.05
_OFF_WALL = 0.004


def finish_from_plan(plan: FloorPlan) -> Finish:
    """Return the finish of the level."""
    return Finish(plan.finish.floor, plan.finish.ceiling, plan.finish.height, plan.light.ambient)


def lamps_from_plan(plan: FloorPlan, blocks: Sequence[Block]) -> tuple[Lamp, ...]:
    """Return the plan's lamps, or else a lattice of lamps under the ceiling, except points inside a block."""
    under = plan.finish.height - _BELOW_CEILING
    if plan.lamps:
        return tuple(Lamp(*lamp.at, under if lamp.height is None else lamp.height, lamp.power) for lamp in plan.lamps)
    columns, rows = (max(1, round(side / plan.light.spacing)) for side in plan.size)
    x, y = np.meshgrid(
        (np.arange(columns) + 0.5) * plan.size[0] / columns, (np.arange(rows) + 0.5) * plan.size[1] / rows
    )
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, under)])
    return tuple(Lamp(x, y, z, plan.light.power) for x, y, z in points[~within_any(points, blocks)].tolist())


def tags_from_plan(plan: FloorPlan) -> tuple[WallTag, ...]:
    """Return the AprilTags on the plan's walls."""
    return tuple(
        WallTag(tag.number, _pose_on_face(wall, tag.at, tag.side == "left"), tag.height, tag.size)
        for wall in plan.walls
        for tag in wall.tags
    )


def within_any(points: FloatArray, blocks: Sequence[Block]) -> BoolArray:
    """Return whether points (N, 3) [m] lie in a block, (N,)."""
    if not blocks:
        return np.zeros(len(points), np.bool_)
    x, y, theta, length, width, low, high = np.array(
        [(*b.middle.array(), b.length, b.width, b.low, b.high) for b in blocks]
    ).T
    dx, dy, z = points[:, :1] - x, points[:, 1:2] - y, points[:, 2:]
    along, across = np.cos(theta) * dx + np.sin(theta) * dy, np.cos(theta) * dy - np.sin(theta) * dx
    within = (np.abs(along) <= length / 2) & (np.abs(across) <= width / 2) & (low <= z) & (z < high)
    result: BoolArray = within.any(axis=1)
    return result


def posters_from_plan(plan: FloorPlan, building: str, blocks: Sequence[Block]) -> tuple[Poster, ...]:
    """Return the plan's posters and those placed by its density, which are the same at every reading."""
    given = [poster for i, wall in enumerate(plan.walls) for poster in _listed_posters(plan, building, i, wall)]
    drawn = [
        poster
        for i, wall in enumerate(plan.walls)
        if _may_have_posters(wall, plan)
        for poster in _random_posters(plan, building, i, wall)
    ]
    if not drawn:
        return tuple(given)
    # None of five points just in front of a poster may lie in a block, outside the plan or above the ceiling.
    before = np.array(
        [
            (*transform_points(poster.middle, np.array([[0.05, y]]))[0], poster.height + z)
            for poster in drawn
            for y, z in ((0, 0), *((a * poster.length / 2, b * poster.width / 2) for a in (-1, 1) for b in (-1, 1)))
        ]
    )
    hidden = within_any(before, blocks) | np.any((before < 0.0) | (before > (*plan.size, plan.finish.height)), axis=1)
    return (*given, *(poster for poster, h in zip(drawn, hidden.reshape(-1, 5).any(axis=1), strict=True) if not h))


def _listed_posters(plan: FloorPlan, building: str, i: int, wall: PlanWall) -> Iterator[Poster]:
    for k, poster in enumerate(wall.posters):
        seed = (
            seed_from_names(building, plan.name, "posters", i, k)
            if poster.seed is None
            else seed_from_names("seed", poster.seed)
        )
        yield Poster(_pose_on_face(wall, poster.at, poster.side == "left"), poster.height, *poster.size, seed)


def _random_posters(plan: FloorPlan, building: str, i: int, wall: PlanWall) -> Iterator[Poster]:
    """Yield posters at the plan's density on both faces of the wall, each at random within its own bay."""
    rng = np.random.default_rng(seed_from_names(building, plan.name, "poster places", i))
    for n, (begin, end) in enumerate(solid_pieces(wall)):
        for left in (True, False):
            count = int((end - begin) * plan.poster_density + rng.random())
            bay = (end - begin) / max(count, 1)
            for k in range(count):
                share, shape, shift, lift = rng.random(4)
                width = POSTER_WIDTHS[0] + share * (POSTER_WIDTHS[1] - POSTER_WIDTHS[0])
                play = bay - width - 0.1
                if play > 0.0:
                    middle = _pose_on_face(wall, begin + (k + 0.5) * bay + (shift - 0.5) * play, left)
                    seed = seed_from_names(building, plan.name, "posters", i, n, left, k)
                    yield Poster(middle, 1.3 + 0.3 * lift, width, width * (0.8 + 0.6 * shape), seed)


def _may_have_posters(wall: PlanWall, plan: FloorPlan) -> bool:
    """Return whether a wall may have posters: glass and mirrors have none."""
    return MATERIALS[wall.material or plan.finish.walls].reflection in (Reflection.DIFFUSE, Reflection.DARK)


def _pose_on_face(wall: PlanWall, at: float, left: bool) -> Pose2:
    """Return the pose on the left or right face of the wall, facing away from it."""
    side = 1.0 if left else -1.0
    return pose_on_wall(wall, at) @ Pose2(0.0, side * (wall.thickness / 2 + _OFF_WALL), side * math.pi / 2)


def people_from_plan(plan: FloorPlan, building: str, grid: OccupancyGrid) -> tuple[PersonPlan, ...]:
    """Return the people of the plan; movers without a path are placed at random on free floor, away from the start.

    If the free floor is too small for all of them, there are fewer.
    """
    people: list[PersonPlan] = []
    for i, person in enumerate(plan.people):
        paths = [np.array(person.path, float)]
        if not person.path:
            taken = [(*plan.start[:2], CLEAR_OF_START), *((*other.path[0], other.radius) for other in people)]
            rng = np.random.default_rng(seed_from_names(building, plan.name, "people", i))
            start = np.array(plan.start[:2])
            paths = list(
                _random_points(
                    grid=grid, start=start, taken=np.array(taken), radius=person.radius, count=person.count, rng=rng
                )[:, None]
            )
        people += [
            PersonPlan(
                behaviour=PersonBehaviour(person.behaviour),
                path=path,
                speed=person.speed,
                yields=person.yields,
                radius=person.radius,
                trigger=person.trigger,
            )
            for path in paths
        ]
    return tuple(people)


def _random_points(
    grid: OccupancyGrid, start: FloatArray, taken: FloatArray, radius: float, count: int, rng: np.random.Generator
) -> FloatArray:
    """Return up to `count` points (N, 2) [m] that a disc can reach from the start, clear of each other and of `taken`.

    `taken` (M, 3) are discs: x, y, radius [m].
    """
    roomy = distance_field(grid).metres > radius + grid.resolution
    _, regions = cv2.connectedComponents(roomy.astype(np.uint8), connectivity=4)
    cells = np.argwhere(roomy)
    if not len(cells):
        return np.empty((0, 2))
    row, col = cells[np.hypot(*(cells - cells_from_points(grid, start)).T).argmin()]  # the start may be too narrow
    free = points_from_cells(grid, np.argwhere(regions == regions[row, col]))
    free = free[np.all([np.hypot(*(free - disc[:2]).T) > disc[2] + radius for disc in taken], axis=0)]
    points = np.empty((0, 2))
    while len(points) < count and len(free):
        points = np.vstack([points, free[rng.integers(len(free))]])
        free = free[np.hypot(*(free - points[-1]).T) > 2 * radius]
    return points
