"""The ground and the obstacles of the physical chair as MJCF: floor, pits, slopes and blocks at their exact places.

All geoms belong to the world body: MuJoCo then does not move them and skips contacts among them.
"""

from __future__ import annotations

import math

import numpy as np

from waychair.errors import WorldError
from waychair.geometry import transform_points, wrap_angle
from waychair.simulation.plan.world import World
from waychair.simulation.scene.rectangles import rectangles_from_cells
from waychair.simulation.scene.scene import Block, Pit, Slope
from waychair.types import FloatArray, OccupancyGrid, Pose2

FLOOR, WALL = 1, 2
"""Collision bits: wheels and body collide with the floor, only the body with walls; the chair's parts never collide."""

CLIMB = 0.10
"""Greatest height of a step [m] that the wheels may climb; higher ones are walls."""

BEYOND = 20.0
"""Margin [m] of a finite floor beyond the grid."""


def ground(world: World, floor_friction: float, wall_friction: float, reach: float) -> str:
    """Return the MJCF geoms of a level, without blocks that begin `reach` [m] above the highest ground.

    Blocks no higher than a step, such as thresholds and stairs, are ground to drive on. So are blocks up to a step above
    the highest slope, which leads up to them.

    Raises:
        WorldError: pits that are neither parallel nor at right angles to each other.
    """
    top = max((slope.high for slope in world.slopes), default=0.0)
    pieces = [_floor(world, floor_friction)] if world.pits else [_plane(0.0, floor_friction)]
    pieces += [_slope(slope, floor_friction) for slope in world.slopes]
    for block in world.blocks:
        if block.low >= top + reach:
            continue
        drivable = block.high <= top + CLIMB
        pieces.append(_block(block, *((floor_friction, FLOOR) if drivable else (wall_friction, WALL))))
    return "\n".join(pieces)


def _plane(height: float, friction: float) -> str:
    return (
        f'<geom name="floor" type="plane" size="0 0 1" pos="0 0 {height}" friction="{friction} 0 0"'
        f' contype="0" conaffinity="{FLOOR}"/>'
    )


def _floor(world: World, friction: float) -> str:
    """Return an endless floor at the depth of the deepest pit, and boxes on it everywhere but over the pits.

    The boxes are parallel to the pits; the floor is cut along all sides of the pits.
    """
    map_from_frame = Pose2(0.0, 0.0, world.pits[0].middle.theta)
    holes = np.array([_hole(map_from_frame.inverse(), pit, world.name) for pit in world.pits])
    area = transform_points(map_from_frame.inverse(), _corners(world.grid))
    low, high = area.min(axis=0) - BEYOND, area.max(axis=0) + BEYOND
    xs = np.unique(np.concatenate([[low[0], high[0]], holes[:, 0], holes[:, 2]]))
    ys = np.unique(np.concatenate([[low[1], high[1]], holes[:, 1], holes[:, 3]]))
    solid = np.ones((len(ys) - 1, len(xs) - 1), np.bool_)
    for x0, y0, x1, y1 in holes:
        solid[np.searchsorted(ys, y0) : np.searchsorted(ys, y1), np.searchsorted(xs, x0) : np.searchsorted(xs, x1)] = 0
    depth = max(pit.depth for pit in world.pits)
    pieces = [_plane(-depth, friction)]
    for row, col, height, width in rectangles_from_cells(solid).tolist():
        x0, x1, y0, y1 = xs[col], xs[col + width], ys[row], ys[row + height]
        middle = map_from_frame @ Pose2(float(x0 + x1) / 2, float(y0 + y1) / 2)
        pieces.append(_block(Block(middle, float(x1 - x0), float(y1 - y0), -depth, 0.0), friction, FLOOR))
    pieces += [
        _block(Block(pit.middle, pit.length, pit.width, -depth, -pit.depth), friction, FLOOR)
        for pit in world.pits
        if pit.depth < depth
    ]
    return "\n".join(pieces)


def _corners(grid: OccupancyGrid) -> FloatArray:
    """Return the grid's corners (4, 2) [m, map]."""
    rows, cols = grid.cells.shape
    return transform_points(
        grid.map_from_grid, grid.resolution * np.array([[0, 0], [cols, 0], [cols, rows], [0, rows]])
    )


def _hole(frame_from_map: Pose2, pit: Pit, name: str) -> FloatArray:
    """Return least x, y and greatest x, y [m] of a pit in a frame parallel to its sides."""
    middle = frame_from_map @ pit.middle
    quarters = round(middle.theta / (math.pi / 2))
    if abs(wrap_angle(middle.theta - quarters * math.pi / 2)) > 1e-6:
        raise WorldError(
            f"'{name}' has a pit that is turned by {math.degrees(middle.theta):g} degrees from another: make them "
            "parallel or at right angles"
        )
    across, along = (pit.length, pit.width) if quarters % 2 else (pit.width, pit.length)
    # rounded, so that touching sides give one cut
    return np.round([middle.x - along / 2, middle.y - across / 2, middle.x + along / 2, middle.y + across / 2], 9)


def _block(block: Block, friction: float, bit: int) -> str:
    middle = block.middle
    return (
        f'<geom type="box" pos="{middle.x} {middle.y} {0.5 * (block.low + block.high)}" euler="0 0 {middle.theta}"'
        f' size="{0.5 * block.length} {0.5 * block.width} {0.5 * (block.high - block.low)}"'
        f' friction="{friction} 0 0" contype="0" conaffinity="{bit}"/>'
    )


def _slope(slope: Slope, friction: float) -> str:
    """Return a tilted box whose upper face is the slope's, thick enough to leave no gap under it."""
    rise = slope.high - slope.low
    pitch, heading = math.atan2(rise, slope.length), slope.middle.theta
    thickness = CLIMB + max(slope.high, slope.low) - min(slope.high, slope.low, 0.0)
    (sp, cp), (sh, ch) = ((math.sin(angle), math.cos(angle)) for angle in (pitch, heading))
    along, across = (cp * ch, cp * sh, sp), (-sh, ch, 0.0)
    down = 0.5 * thickness
    x, y = slope.middle.x + down * sp * ch, slope.middle.y + down * sp * sh
    z = 0.5 * (slope.low + slope.high) - down * cp
    return (
        f'<geom type="box" pos="{x} {y} {z}" xyaxes="{" ".join(map(str, (*along, *across)))}"'
        f' size="{0.5 * math.hypot(slope.length, rise)} {0.5 * slope.width} {down}"'
        f' friction="{friction} 0 0" contype="0" conaffinity="{FLOOR}"/>'
    )
