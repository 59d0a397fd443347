"""Exact 3D ray casting of a lidar that tilts with the chair, among blocks, slopes, floor and ceiling.

On a ramp the plane of the beams tilts with the chair, so that a slice at the lidar's height is not enough: on the way
down the beams hit the level floor beyond the foot of the ramp. A solid is the intersection of its faces' half spaces; a
ray is inside where it is inside all of them (Kay and Kajiya, SIGGRAPH 1986).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.simulation.plan.world import World
from waychair.simulation.scene.scene import MATERIALS, Block, Pit, Reflection, Slope
from waychair.simulation.sensors.rays import nearest_circle
from waychair.types import FloatArray, IntArray, Pose3

FLOOR, NOTHING = -1, -2
"""Indices for a hit on the floor or ceiling, and for no hit."""

_MOST_SURFACES = 16  # ends a beam between two panes of glass
_ONWARD = 1e-7  # m; a beam that continues does not hit the same surface again
_DARK, _GLASS, _MIRROR = (int(kind) for kind in (Reflection.DARK, Reflection.GLASS, Reflection.MIRROR))


class Terrain(NamedTuple):
    """A level in 3D, prepared for rays.

    `solids` (N, 9): x, y [m, map], cosine and sine of the heading, half length, half width, low, top in the middle [m],
    rise of the top per metre of length. `reflections` (N,) are their `Reflection`s. `pits` (M, 6) have the first six of
    these columns. `ceiling` is its height [m].
    """

    solids: FloatArray
    reflections: IntArray
    pits: FloatArray
    ceiling: float


class TiltedPose(NamedTuple):
    """The terrain, and the 3D pose of a tilting chair (map_from_base)."""

    terrain: Terrain
    map_from_base: Pose3


def terrain_from_world(world: World) -> Terrain | None:
    """Return the level in 3D; None without slopes, where a chair does not tilt for long and a slice is enough."""
    if not world.slopes:
        return None
    things: list[Block | Slope] = [*world.blocks, *world.slopes]
    solids = np.array([_solid(thing) for thing in things])
    reflections = np.array([MATERIALS[thing.material].reflection for thing in things], np.int64)
    pits = np.array([_outline(pit) for pit in world.pits]).reshape(-1, 6)
    return Terrain(solids, reflections, pits, world.finish.height)


def row_from_pose(pose: Pose3) -> FloatArray:
    """Return a pose as a row (12,): rotation row by row, then translation, for interpolation."""
    return np.concatenate([pose.rotation.ravel(), pose.translation])


def _solid(thing: Block | Slope) -> tuple[float, ...]:
    if isinstance(thing, Block):
        return *_outline(thing), thing.low, thing.high, 0.0
    # a ramp is filled down to the floor, or to its lower end if that is below the floor
    bottom = min(0.0, thing.low, thing.high)
    return *_outline(thing), bottom, 0.5 * (thing.low + thing.high), (thing.high - thing.low) / thing.length


def _outline(thing: Block | Slope | Pit) -> tuple[float, ...]:
    middle = thing.middle
    return middle.x, middle.y, math.cos(middle.theta), math.sin(middle.theta), thing.length / 2, thing.width / 2


@njit(cache=True, nogil=True)
def cast_tilted(
    terrain: Terrain,
    circles_begin: FloatArray,
    circles_end: FloatArray,
    times: FloatArray,
    poses: FloatArray,
    mount: FloatArray,
    angles: FloatArray,
    delays: FloatArray,
    optics: tuple[float, float, float],
    most_mirrors: int,
) -> FloatArray:
    """Return true ranges (N,) [m] of beams at `angles` [rad], each leaving `delays` [s] after the scan's stamp.

    `poses` (M, 12) are rows of `row_from_pose`: map_from_base at ascending `times` (M,) [s]; `mount` (12,) is base_from_laser.
    Circles (K, 3) are upright cylinders; `optics` are `lidar.LidarOptics`.
    """
    ranges = np.empty(angles.shape[0])
    last = times.shape[0] - 1
    sweep = delays[-1]
    k = 0
    for i in range(angles.shape[0]):
        while k < last - 1 and times[k + 1] < delays[i]:
            k += 1
        nxt = min(k + 1, last)
        span = times[nxt] - times[k]
        part = min(max((delays[i] - times[k]) / span, 0.0), 1.0) if span > 0.0 else 0.0
        # between poses a few milliseconds apart, linear interpolation of a rotation is accurate enough
        base = poses[k] + part * (poses[nxt] - poses[k])
        rotation = base[:9].copy().reshape(3, 3)
        start = rotation @ mount[9:] + base[9:]
        beam = np.array([math.cos(angles[i]), math.sin(angles[i]), 0.0])
        ahead = rotation @ (mount[:9].copy().reshape(3, 3) @ beam)
        ahead /= math.sqrt(ahead[0] ** 2 + ahead[1] ** 2 + ahead[2] ** 2)
        moved = delays[i] / sweep if sweep > 0.0 else 0.0
        ranges[i] = _trace(
            terrain=terrain,
            begin=circles_begin,
            end=circles_end,
            moved=moved,
            start=start,
            ahead=ahead,
            optics=optics,
            most_mirrors=most_mirrors,
        )
    return ranges


@njit(cache=True, nogil=True)
def _trace(
    terrain: Terrain,
    begin: FloatArray,
    end: FloatArray,
    moved: float,
    start: FloatArray,
    ahead: FloatArray,
    optics: tuple[float, float, float],
    most_mirrors: int,
) -> float:
    """Return the length of a beam up to the surface that returns it, like `lidar._trace` in the plane."""
    reach, dark_reach, straight = optics
    x, y, z = start
    dx, dy, dz = ahead
    way, after, mirrors = 0.0, 0.0, 0
    for _ in range(_MOST_SURFACES):
        flat = math.hypot(dx, dy)
        circle = (
            nearest_circle(begin=begin, end=end, part=moved, x=x, y=y, dx=dx / flat, dy=dy / flat, after=after) / flat
        )
        distance, hit, nx, ny, nz = nearest_face(
            terrain=terrain, x=x, y=y, z=z, dx=dx, dy=dy, dz=dz, after=after, limit=min(reach - way, circle)
        )
        if hit == NOTHING:
            return way + circle if way + circle <= reach else math.inf
        way += distance
        if hit == FLOOR:
            return way
        kind = terrain.reflections[hit]
        along = dx * nx + dy * ny + dz * nz
        if kind == _DARK and way > dark_reach * math.sqrt(abs(along)):
            return math.inf
        if kind != _MIRROR and (kind != _GLASS or abs(along) >= straight):
            return way
        x, y, z, after = x + distance * dx, y + distance * dy, z + distance * dz, _ONWARD
        if kind == _MIRROR:
            mirrors += 1
            if mirrors > most_mirrors:
                return math.inf
            dx, dy, dz = dx - 2.0 * along * nx, dy - 2.0 * along * ny, dz - 2.0 * along * nz
    return math.inf


@njit(cache=True, nogil=True)
def nearest_face(
    terrain: Terrain, x: float, y: float, z: float, dx: float, dy: float, dz: float, after: float, limit: float
) -> tuple[float, int, float, float, float]:
    """Return the distance [m] from (x, y, z) along the unit vector to the first solid, its index and the face's normal.

    Faces nearer than `after` are ignored; faces are also hit from inside. Without a hit up to `limit` [m] the answer is
    (+inf, NOTHING, 0, 0, 0).
    """
    best, hit, bx, by, bz = math.inf, NOTHING, 0.0, 0.0, 0.0
    for i in range(terrain.solids.shape[0]):
        mx, my, c, s, half_length, half_width, low, top, rise = terrain.solids[i]
        u, v = c * (x - mx) + s * (y - my), c * (y - my) - s * (x - mx)
        du, dv = c * dx + s * dy, c * dy - s * dx
        if abs(v) > half_width + limit or abs(u) > half_length + limit:
            continue
        entry, leaving, entry_face, leaving_face = -math.inf, math.inf, 0, 0
        for face in range(6):
            # distance of the ray's start outside the face's plane, and its outward speed
            if face < 2:
                sign = 1.0 - 2.0 * face
                out, speed = sign * u - half_length, sign * du
            elif face < 4:
                sign = 5.0 - 2.0 * face
                out, speed = sign * v - half_width, sign * dv
            elif face == 4:
                out, speed = low - z, -dz
            else:
                out, speed = z - top - rise * u, dz - rise * du
            if speed == 0.0:
                if out > 0.0:
                    entry = math.inf
            elif speed < 0.0:
                if -out / speed > entry:
                    entry, entry_face = -out / speed, face
            elif -out / speed < leaving:
                leaving, leaving_face = -out / speed, face
        if entry > leaving:
            continue
        distance, face = (entry, entry_face) if entry >= after else (leaving, leaving_face)
        if after <= distance < best:
            best, hit = distance, i
            nu, nv, bz = 0.0, 0.0, 0.0
            if face < 2:
                nu = 1.0
            elif face < 4:
                nv = 1.0
            elif face == 4:
                bz = 1.0
            else:
                bz = 1.0 / math.sqrt(1.0 + rise * rise)
                nu = -rise * bz
            bx, by = c * nu - s * nv, s * nu + c * nv
    if dz != 0.0:
        level = -z / dz if dz < 0.0 else (terrain.ceiling - z) / dz
        if after <= level < best and (dz > 0.0 or not _in_pit(terrain.pits, x + level * dx, y + level * dy)):
            best, hit, bx, by, bz = level, FLOOR, 0.0, 0.0, 1.0
    return (best, hit, bx, by, bz) if best <= limit else (math.inf, NOTHING, 0.0, 0.0, 0.0)


@njit(cache=True, nogil=True)
def _in_pit(pits: FloatArray, x: float, y: float) -> bool:
    for i in range(pits.shape[0]):
        mx, my, c, s, half_length, half_width = pits[i]
        if abs(c * (x - mx) + s * (y - my)) < half_length and abs(c * (y - my) - s * (x - mx)) < half_width:
            return True
    return False
