"""Worlds made from other data: maps in map_server's format, and the environments of the BARN benchmark."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from waychair.errors import WorldError
from waychair.files import read_text
from waychair.geometry import MAX_COORDINATE
from waychair.maps.drawn.places import load_places
from waychair.maps.folders.map_files import load_map, yaml_path
from waychair.simulation.plan.world import World, world_from_grid
from waychair.types import BoolArray, FloatArray, OccupancyGrid, Place, Pose2

BARN_RESOLUTION = 0.025
"""Cell size [m]: a cylinder of 7.5 cm radius is six cells wide."""

BARN_MARGIN = 2.0
"""Free margin [m] round the cylinders, the start and the goal of a BARN world."""


def world_from_map(path: Path, start: Pose2) -> World:
    """Return the world of a map folder or its map.yaml, with the places stored beside it.

    Raises:
        MapError: the map cannot be read.
        PlaceError: its places cannot be read.
        WorldError: the start or a place lies outside the map or in an occupied cell.
    """
    folder = yaml_path(path).parent
    return world_from_grid(load_map(path), start, tuple(load_places(folder).values()), folder.resolve().name)


@dataclass(frozen=True, slots=True)
class BarnEnvironment:
    """One BARN environment: cylinders (N, 3) of x, y, radius, and poses [m, rad]; the goal has the start's heading.

    `path_length` [m] is the length of the benchmark's reference path; its score derives the optimal time from it.
    """

    name: str
    cylinders: FloatArray
    start: Pose2
    goal: Pose2
    path_length: float


def read_barn(path: Path, scale: float = 1.0) -> BarnEnvironment:
    """Return one BARN environment, read from `key value` lines, then `grid` and its rows, the largest y first.

    Every `#` is a cylinder on a lattice (Perille, Truong, Xiao, Stone, Benchmarking Metric Ground Navigation, SSRR
    2020). Poses and sizes come from the header; `scale` multiplies all of them, for robots of another size.

    Raises:
        WorldError: the file cannot be read, lacks something or holds impossible numbers; or `scale` is not in [0.1, 10].
    """
    if not 0.1 <= scale <= 10.0:
        raise WorldError(f"a scale of {scale:g} is impossible: give one in [0.1, 10]")
    lines = read_text(path, WorldError, "give a BARN text grid").splitlines()
    if "grid" not in lines:
        raise WorldError(f"{path} has no line `grid`: give a BARN text grid")
    begin = lines.index("grid")
    header = {key: values for key, *values in (line.split() for line in lines[:begin] if line.strip())}
    (x, y, theta), goal = _numbers(path, header, "start", 3), _numbers(path, header, "goal", 2)
    (cell,), (radius,), (length,) = (_numbers(path, header, key, 1) for key in ("cell", "radius", "path_length"))
    origin = np.array([*_numbers(path, header, "origin_x", 1), *_numbers(path, header, "origin_y", 1)])
    if min(cell, radius, length) <= 0.0:
        raise WorldError(
            f"{path}: cell {cell:g}, radius {radius:g} and path_length {length:g} must be greater than 0; correct the header"
        )
    rows, cols = np.nonzero(_lattice(path, header, lines, begin))
    centres = origin + cell * np.column_stack([cols, rows])
    return BarnEnvironment(
        path.stem,
        scale * np.column_stack([centres, np.full(len(centres), radius)]),
        Pose2(scale * x, scale * y, theta),
        Pose2(scale * goal[0], scale * goal[1], theta),
        scale * length,
    )


def world_from_barn(path: Path, scale: float = 1.0) -> World:
    """Return the world of one BARN environment, as `read_barn` reads it.

    The cylinders are the only obstacles. The grid ends two metres beyond the outermost cylinder, the start and the
    goal; there is nothing solid outside it either. The goal is the place `goal`.

    Raises:
        WorldError: as `read_barn`.
    """
    barn = read_barn(path, scale)
    poses = np.array([[barn.start.x, barn.start.y], [barn.goal.x, barn.goal.y]])
    radius = float(barn.cylinders[0, 2]) if len(barn.cylinders) else 0.0
    grid = _cylinders(barn.cylinders[:, :2], radius, poses)
    return world_from_grid(grid, barn.start, (Place("goal", barn.goal),), barn.name)


def _numbers(path: Path, header: Mapping[str, list[str]], key: str, count: int) -> list[float]:
    try:
        values = [float(text) for text in header.get(key, [])]
    except ValueError:
        values = []
    if len(values) != count or not all(abs(value) <= MAX_COORDINATE for value in values):
        given = " ".join(header.get(key, [])) or "missing"
        raise WorldError(f"{path}: `{key}` is {given}: give {count} number{'s' * (count > 1)} up to {MAX_COORDINATE:g}")
    return values


def _lattice(path: Path, header: Mapping[str, list[str]], lines: list[str], begin: int) -> BoolArray:
    """Return the lattice points (rows, cols) with a cylinder, row 0 at the bottom."""
    rows, cols = (_numbers(path, header, key, 1)[0] for key in ("rows", "cols"))
    drawn = [line for line in lines[begin + 1 :] if line.strip()]
    if not drawn:
        raise WorldError(f"{path}: the grid has no lines; give the whole grid")
    if len(drawn) != rows:
        raise WorldError(f"{path}: the grid has {len(drawn)} lines instead of {rows:g}; give the whole grid")
    for i, line in enumerate(drawn):
        if len(line) != cols or set(line) - {"#", "."}:
            raise WorldError(
                f"{path}, line {begin + 2 + i}: '{line}' is not a row of the grid; give {cols:g} characters of # and ."
            )
    return np.array([[char == "#" for char in line] for line in reversed(drawn)])


def _cylinders(centres: FloatArray, radius: float, poses: FloatArray) -> OccupancyGrid:
    """Return the grid round cylinders (N, 2) and poses (M, 2) [m]; cells whose centre is in a cylinder are solid."""
    every = np.concatenate([centres, poses])
    low, high = every.min(axis=0) - BARN_MARGIN - radius, every.max(axis=0) + BARN_MARGIN + radius
    cells = np.zeros(np.ceil((high - low)[::-1] / BARN_RESOLUTION).astype(int), np.int8)
    reach = math.ceil(radius / BARN_RESOLUTION)
    window = np.argwhere(np.ones((2 * reach + 1, 2 * reach + 1), np.bool_)) - reach
    for x, y in (centres - low) / BARN_RESOLUTION:
        near = window + np.array([int(y), int(x)])
        solid = np.hypot(near[:, 0] + 0.5 - y, near[:, 1] + 0.5 - x) <= radius / BARN_RESOLUTION
        cells[tuple(near[solid].T)] = 100
    return OccupancyGrid(cells, BARN_RESOLUTION, Pose2(float(low[0]), float(low[1]), 0.0))
