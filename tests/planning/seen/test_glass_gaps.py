"""Gaps of the map along a path."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from waychair.geometry import transform_points
from waychair.planning.seen.glass_gaps import openings
from waychair.types import FloatArray, OccupancyGrid, Pose2

CELL, WALL, MIDDLE = 0.05, 6.0, 4.0
WIDEST = 1.8
HERE = Pose2()


def walled(width: float, deep: float = 0.15, map_from_grid: Pose2 = HERE) -> OccupancyGrid:
    """12 x 8 m with a wall of a thickness [m] from x = 6 m on, and a gap of a width [m] in it round y = 4 m."""
    cells = np.zeros((160, 240), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    wall = slice(round(WALL / CELL), round((WALL + deep) / CELL))
    cells[:, wall] = 100
    half = round(width / CELL / 2)
    cells[80 - half : 80 + half, wall] = 0
    return OccupancyGrid(cells, CELL, map_from_grid)


def line(start: tuple[float, float], end: tuple[float, float], frame: Pose2 = HERE) -> FloatArray:
    """Poses every 5 cm on a straight way, given in the grid's frame."""
    count = round(math.dist(start, end) / CELL) + 1
    points = np.linspace(start, end, count)
    heading = math.atan2(end[1] - start[1], end[0] - start[0])
    return np.column_stack([transform_points(frame, points), np.full(count, heading + frame.theta)])


@pytest.mark.parametrize("width", [0.8, 1.2, 1.7])
@pytest.mark.parametrize("frame", [Pose2(), Pose2(-3.0, 7.0, 2.1)])
@pytest.mark.parametrize("slant", [-1.0, 0.0, 1.0])
def test_a_gap_is_found_where_the_path_passes_through_it(width: float, frame: Pose2, slant: float) -> None:
    poses = line((2.0, MIDDLE - slant), (10.0, MIDDLE + slant), frame)
    (found,) = openings(walled(width, map_from_grid=frame), poses, WIDEST)
    x, y = transform_points(frame.inverse(), poses[found, :2][None])[0].tolist()
    assert abs(x - WALL - 0.075) < 0.3
    assert abs(y - MIDDLE) < 0.3


def test_a_path_along_a_wall_to_a_gap_has_only_that_gap() -> None:
    grid = walled(1.2)
    along, turn, through = line((5.3, 1.0), (5.3, 3.3)), line((5.3, 3.3), (6.0, 4.0)), line((6.0, 4.0), (9.0, 4.0))
    poses = np.concatenate([along, turn[1:], through[1:]])
    (found,) = openings(grid, poses, WIDEST)
    assert 5.7 < poses[found, 0] < 6.4


@pytest.mark.parametrize("width", [1.9, 3.0])
def test_a_wider_opening_is_no_gap(width: float) -> None:
    assert not len(openings(walled(width), line((2.0, MIDDLE), (10.0, MIDDLE)), WIDEST))


def test_beside_one_wall_and_across_unknown_cells_there_is_no_gap() -> None:
    grid = walled(8.0)
    assert not len(openings(grid, line((2.0, 0.5), (10.0, 0.5)), WIDEST))
    unknown = replace(grid, cells=np.full_like(grid.cells, -1))
    assert not len(openings(unknown, line((2.0, MIDDLE), (10.0, MIDDLE)), WIDEST))


def test_both_ends_of_a_corridor_count_as_gaps() -> None:
    poses = line((2.0, MIDDLE), (11.0, MIDDLE))
    found = openings(walled(1.2, deep=3.0), poses, WIDEST)
    np.testing.assert_allclose(poses[found, 0], [WALL, WALL + 3.0], atol=0.6)


def test_outside_of_the_map_and_on_a_path_of_one_pose_no_gap_is_found() -> None:
    assert not len(openings(walled(1.2), line((-9.0, MIDDLE), (-3.0, MIDDLE)), WIDEST))
    assert not len(openings(walled(1.2), line((2.0, 2.0), (2.0, 2.0)), WIDEST))


def test_widths_equal_those_of_a_plain_search() -> None:
    """A pose is in a gap exactly if a line across it, at no flatter an angle, meets two walls that near."""
    rng = np.random.default_rng(5)
    cells = (rng.random((60, 60)) < 0.02).astype(np.int8) * 100
    grid = OccupancyGrid(cells, CELL)
    for x, y, heading in rng.uniform((0.5, 0.5, -3.0), (2.5, 2.5, 3.0), (60, 3)).tolist():
        poses = np.array([[x, y, heading]])
        assert bool(len(openings(grid, poses, 0.6))) == _in_gap(cells, x, y, heading, 0.6)


def _in_gap(cells: FloatArray, x: float, y: float, heading: float, widest: float) -> bool:
    for turn in np.linspace(-math.radians(50.0), math.radians(50.0), 11).tolist():
        met = []
        for side in (math.pi / 2, -math.pi / 2):
            steps = np.arange(0.0, widest, CELL / 2)
            points = np.array([x, y]) + steps[:, None] * (
                (1 if side > 0 else -1) * np.array([-math.sin(heading + turn), math.cos(heading + turn)])
            )
            columns, rows = np.floor(points / CELL).astype(int).T
            inside = (rows >= 0) & (columns >= 0) & (rows < 60) & (columns < 60)
            blocked = inside & (cells[rows.clip(0, 59), columns.clip(0, 59)] > 0)
            left_map = np.flatnonzero(~inside)
            first = np.flatnonzero(blocked)
            if len(first) and not (len(left_map) and left_map[0] < first[0]):
                met.append(steps[first[0]])
        if len(met) == 2 and sum(met) < widest:
            return True
    return False
