"""Newer drives outweigh older ones in the grid: moved furniture fades, and cells that were not seen again stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.maps.depth_rooms import picture, scan_of_picture
from tests.maps.layers.test_grid_assembly import CELLS, HERE, NOBODY, POSES, assembled, assert_same, scan_from
from waychair.maps.grid.cells import cells_from_points, occupied
from waychair.maps.grid.occupancy import EvidenceGrid, OccupancySettings, build_grid
from waychair.maps.layers.grid_assembly import GridAssembly
from waychair.maps.layers.session_grid import SessionDepth, SessionGrid
from waychair.types import BoolArray, Scan

PIECE = np.array([[5.0, 4.5]])
EMPTY, FURNISHED = ([scan_from(pose, things) for pose in POSES] for things in (NOBODY, PIECE))


def lived(*drives: list[Scan], cells: OccupancySettings = CELLS) -> SessionGrid:
    """Sessions with one scan on each node, all drawn."""
    grid, number = SessionGrid(cells), 0
    for session, scans in enumerate(drives):
        grid.begin(session)
        for k, scan in enumerate(scans):
            grid.add(number, scan, k, HERE, HERE)
            number += 1
    grid.move_nodes(POSES, POSES[-1, :2])
    grid.settle()
    return grid


def at_piece(grid: SessionGrid) -> int:
    """Occupied cells where the piece stood."""
    seen = grid.grid()
    around = PIECE + 0.35 * np.stack(np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)), axis=-1).reshape(-1, 2)
    cells = np.unique(cells_from_points(seen, around), axis=0)
    solid: BoolArray = occupied(seen)[tuple(cells.T)]
    return int(solid.sum())


def test_one_session_gives_the_grid_of_its_scans() -> None:
    assert_same(lived(EMPTY).grid(), build_grid(POSES, EMPTY, CELLS))
    assert_same(SessionGrid(CELLS).grid(), EvidenceGrid(CELLS).grid())


@pytest.mark.parametrize("often", [1, 10])
def test_moved_furniture_is_gone_however_often_it_was_seen(often: int) -> None:
    before = SessionGrid(CELLS)
    for number in range(often * len(POSES)):
        before.add(number, FURNISHED[number % len(POSES)], number % len(POSES), HERE, HERE)
    before.move_nodes(POSES, POSES[-1, :2])
    before.settle()
    assert at_piece(before) > 0
    before.begin(1)
    for k, scan in enumerate(EMPTY):
        before.add(10_000 + k, scan, k, HERE, HERE)
    before.settle()
    assert at_piece(before) == 0


def test_new_furniture_is_shown_though_many_drives_saw_free_floor() -> None:
    assert at_piece(lived(EMPTY, EMPTY, EMPTY)) == 0
    assert at_piece(lived(EMPTY, EMPTY, EMPTY, FURNISHED)) > 0
    assert at_piece(lived(EMPTY, FURNISHED, EMPTY, FURNISHED)) > 0
    assert at_piece(lived(FURNISHED, EMPTY, FURNISHED, EMPTY)) == 0


def test_cells_that_a_later_drive_has_not_seen_stay_unchanged() -> None:
    blind = [Scan(0, np.full(72, np.nan, np.float32), 0.0, 0.1, range_max=30.0)] * len(POSES)
    assert_same(lived(FURNISHED, blind).grid(), lived(FURNISHED).grid())


def test_a_grid_that_is_drawn_anew_with_larger_cells_is_as_if_it_had_had_them_from_the_beginning() -> None:
    large = replace(CELLS, resolution=2 * CELLS.resolution)
    grid, expected = lived(FURNISHED, EMPTY), lived(FURNISHED, EMPTY, cells=large)
    for each in (grid, expected):
        each.drop(3)
    grid.draw_anew(lambda: GridAssembly(large))
    assert grid.pending > 0
    for each in (grid, expected):
        each.settle()
    assert_same(grid.grid(), expected.grid())
    assert (grid.session, len(grid)) == (1, len(expected))


def test_scans_of_any_session_are_counted_and_dropped() -> None:
    grid = lived(FURNISHED, EMPTY)
    session, scan, node, places = grid.attached(3)
    assert (session, node) == (0, 3)
    assert scan is FURNISHED[3]
    assert places.shape == (2, 3)
    for number in range(len(POSES), 2 * len(POSES)):
        grid.drop(number)
    grid.settle()
    assert len(grid) == len(POSES)
    assert_same(grid.grid(), build_grid(POSES, FURNISHED, CELLS))


def test_all_sessions_move_with_the_graph() -> None:
    grid, moved = lived(FURNISHED, EMPTY), POSES + np.array([1.0, 0.0, 0.0])
    grid.move_nodes(moved, moved[0, :2])
    assert grid.pending > 0
    while grid.pending:
        assert grid.draw() > 0
    assert grid.draw() == 0
    assert grid.grid().map_from_grid.x == pytest.approx(lived(FURNISHED, EMPTY).grid().map_from_grid.x + 1.0)


values = st.lists(st.integers(-30_000, 30_000), min_size=6, max_size=6)


@given(values, values)
def test_older_evidence_is_limited_only_where_newer_evidence_has_the_cell(older: list[int], newer: list[int]) -> None:
    hits = [EvidenceGrid(CELLS), EvidenceGrid(CELLS)]
    for grid, counts in zip(hits, (older, newer), strict=True):
        for column, count in enumerate(counts):
            cells = np.array([[column, 0]])
            for _ in range(abs(count) // 3000):
                grid.put(cells, np.array([count > 0]))
    seen = hits[0].overlaid(hits[1]).grid()
    for column in range(6):
        above, under = abs(newer[column]) // 3000, abs(older[column]) // 3000
        if not above and not under:
            continue
        cell = cells_from_points(seen, np.array([[(column + 0.5) * CELLS.resolution, 0.5 * CELLS.resolution]]))[0]
        percent = int(seen.cells[tuple(cell)])
        assert percent >= 0, "a known cell stays known"
        if above >= 10:
            assert (percent > 50) == (newer[column] > 0), "ten looks outweigh all earlier evidence"
        if not above:
            assert (percent > 50) == (older[column] > 0)


def test_a_session_grid_of_one_session_equals_an_assembly() -> None:
    assert_same(lived(EMPTY).grid(), assembled(POSES, EMPTY).grid())


def seen_by_depth(often: int) -> tuple[BoolArray, BoolArray]:
    """Return whether a low box, seen this often by a first session, and a stairwell remain after nine looks of a second
    session that sees floor there."""
    before = scan_of_picture(picture(boxes=[(2.4, 2.8, -0.3, 0.1, 0.0, 0.3)], holes=[(2.2, 3.2, 0.4, 1.2, 0.5)]))
    floor = scan_of_picture(picture())
    grid, here = SessionDepth(), np.zeros(3)
    for number in range(often):
        grid.add(number, before, 0, here, here)
    grid.begin(1)
    for number in range(9):
        grid.add(often + number, floor, 0, here, here)
    grid.move_nodes(np.zeros((1, 3)), np.zeros(2))
    grid.settle()
    obstacles, drops = grid.grids()
    return occupied(obstacles), occupied(drops)


def test_an_obstacle_that_only_the_camera_saw_fades_and_a_stairwell_does_not() -> None:
    for often in (8, 30):
        obstacles, drops = seen_by_depth(often)
        assert not obstacles.any()
        assert drops.any()


def test_within_a_session_depth_evidence_is_one_sum() -> None:
    grid, here = SessionDepth(), np.zeros(3)
    box = scan_of_picture(picture(boxes=[(2.4, 2.8, -0.3, 0.1, 0.0, 0.3)]))
    for number, scan in enumerate([*[box] * 8, *[scan_of_picture(picture())] * 3]):
        grid.add(number, scan, 0, here, here)
    grid.move_nodes(np.zeros((1, 3)), np.zeros(2))
    grid.settle()
    assert occupied(grid.grids()[0]).any()
