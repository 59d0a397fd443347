"""Rooms, corridors and doors of drawn plans."""

from __future__ import annotations

import numpy as np
import pytest

from tests.maps.rooms.drawn_plans import RESOLUTION, DrawnPlan, ward
from waychair.geometry import transform_points
from waychair.maps.grid.cells import cells_from_points
from waychair.maps.rooms.basins import basins_of, clearance_from_walls
from waychair.maps.rooms.floor_rooms import FloorRooms, RoomKind, rooms_of_grid
from waychair.types import UNKNOWN, BoolArray, OccupancyGrid, Pose2

MIDDLES = [(2.0, 8.5), (5.5, 8.5), (9.0, 8.5), (12.5, 8.5), (2.5, 2.5), (7.5, 2.5), (12.0, 2.5)]
DOORS = [(2.0, 6.55, 0.9), (5.5, 6.55, 0.9), (9.0, 6.55, 0.9), (12.5, 6.55, 0.9)]
DOORS += [(2.5, 4.45, 1.2), (7.5, 4.45, 1.2), (12.0, 4.45, 1.2)]


def numbers_at(found: FloorRooms, grid: OccupancyGrid, points: list[tuple[float, float]]) -> list[int]:
    """Return the numbers of the rooms that hold points."""
    return [int(found.labels[row, column]) for row, column in cells_from_points(grid, np.array(points))]


def test_a_ward_has_seven_rooms_and_a_corridor() -> None:
    grid = ward().grid()

    found = rooms_of_grid(grid)

    assert sorted(room.kind.value for room in found.rooms) == ["corridor", *["room"] * 7]
    assert len({*numbers_at(found, grid, MIDDLES), *numbers_at(found, grid, [(7.5, 5.5)])}) == 8
    corridor = next(room for room in found.rooms if room.kind is RoomKind.CORRIDOR)
    assert corridor.area == pytest.approx(28.0, abs=1.0)
    assert corridor.elongation == pytest.approx(7.0, abs=1.0)


def test_doors_are_found_with_their_places_and_widths() -> None:
    found = rooms_of_grid(ward().grid())

    measured = sorted((round(float(x), 2), round(float(y), 2), d.width) for d in found.doors for x, y in [d.middle])
    for (x, y, width), (true_x, true_y, true_width) in zip(measured, sorted(DOORS), strict=True):
        assert (x, y) == pytest.approx((true_x, true_y), abs=0.06)
        assert width == pytest.approx(true_width, abs=0.051)


def test_a_door_joins_its_room_to_the_corridor() -> None:
    grid = ward().grid()
    found = rooms_of_grid(grid)
    (corridor,) = numbers_at(found, grid, [(7.5, 5.5)])

    pairs = {frozenset(door.rooms) for door in found.doors}

    assert pairs == {frozenset((room, corridor)) for room in numbers_at(found, grid, MIDDLES)}


def test_free_standing_furniture_changes_no_room_and_no_door() -> None:
    plan = ward()
    for x, y in MIDDLES[:4]:
        for seat in (-0.9, 0.0, 0.9):
            plan.chair(x + seat, y + 0.8)
        plan.solid(x, y - 0.2, 1.6, 0.8)
    plan.solid(7.5, 2.2, 2.0, 0.9).solid(2.2, 2.0, 0.5, 0.5).chair(12.0, 2.0)
    bare, grid = rooms_of_grid(ward().grid()), plan.grid()

    found = rooms_of_grid(grid)

    np.testing.assert_array_equal(found.labels, bare.labels)
    assert [door.width for door in found.doors] == [door.width for door in bare.doors]
    assert found.furniture.sum() == (grid.cells != ward().cells).sum()


def test_a_short_wall_between_two_doors_is_no_furniture() -> None:
    plan = DrawnPlan(10.0, 6.0).room(0.5, 0.5, 5.0, 5.5).room(5.1, 0.5, 9.5, 5.5)
    plan.fill(5.0, 0.6, 5.1, 1.6, 0).fill(5.0, 3.2, 5.1, 4.2, 0)  # a piece of 1.6 m is left between them
    grid = plan.grid()

    found = rooms_of_grid(grid)

    assert len(found.rooms) == 2
    assert [door.rooms for door in found.doors] == [(1, 2), (1, 2)]
    assert not found.furniture.any()


def test_a_corridor_with_pilasters_stays_one_and_its_fire_door_is_found() -> None:
    plan = ward()
    for x in (3.6, 10.0):
        plan.fill(x, 4.5, x + 0.4, 4.75, 100).fill(x, 6.25, x + 0.4, 6.5, 100)
    plan.fill(6.6, 4.5, 6.7, 4.7, 100).fill(6.6, 6.3, 6.7, 6.5, 100)
    grid = plan.grid()

    found = rooms_of_grid(grid)

    assert len(set(numbers_at(found, grid, [(1.0, 5.5), (5.0, 5.5), (8.0, 5.5), (14.0, 5.5)]))) == 1
    across = [door for door in found.doors if abs(door.middle[0] - 6.65) < 0.1 and 5.4 < door.middle[1] < 5.6]
    assert [door.width for door in across] == [pytest.approx(1.6, abs=0.051)]
    assert across[0].rooms[0] == across[0].rooms[1]


@pytest.mark.parametrize("degrees", [17.0, 45.0, 71.0])
def test_a_turned_ward_has_the_same_rooms_and_doors(degrees: float) -> None:
    found = rooms_of_grid(ward().turned(degrees))

    assert sorted(room.kind.value for room in found.rooms) == ["corridor", *["room"] * 7]
    assert sorted(door.width for door in found.doors) == pytest.approx([0.9] * 4 + [1.2] * 3, abs=0.1)


def test_unknown_cells_belong_to_no_room() -> None:
    plan = ward().fill(1.5, 8.0, 3.0, 9.0, UNKNOWN)
    grid = plan.grid()

    found = rooms_of_grid(grid)

    assert not found.labels[grid.cells == UNKNOWN].any()


def test_floor_seen_through_a_window_is_no_room() -> None:
    plan = ward()
    for k in range(40):  # beams through a window at (14.5, 8.5) and away from it, unknown beside them
        plan.fill(14.5 + k * 0.01, 8.3, 14.6 + k * 0.01, 8.6, 0)
    wide = DrawnPlan(22.0, 11.0)
    wide.cells[:, : plan.cells.shape[1]] = plan.cells
    for k in range(100):
        y, half = 8.5, 0.2 + 0.01 * k
        wide.fill(14.6 + k * 0.05, y - half, 14.65 + k * 0.05, y + half, 0)
    grid = wide.grid()

    found = rooms_of_grid(grid)

    (seen,) = numbers_at(found, grid, [(18.0, 8.5)])
    assert found.rooms[seen - 1].kind is RoomKind.SEEN
    assert found.rooms[seen - 1].unknown_rim > 0.8


def test_points_are_in_map_not_in_the_grid() -> None:
    map_from_grid = Pose2(-3.0, 7.0, 0.6)
    here, there = rooms_of_grid(ward().grid()), rooms_of_grid(ward().grid(map_from_grid))

    for one, other in zip(here.doors, there.doors, strict=True):
        np.testing.assert_allclose(transform_points(map_from_grid, one.jambs), other.jambs, atol=1e-9)
    centres = np.array([room.centre for room in here.rooms])
    np.testing.assert_allclose(transform_points(map_from_grid, centres), [r.centre for r in there.rooms], atol=1e-9)


@pytest.mark.parametrize("value", [UNKNOWN, 100])
def test_a_map_without_floor_has_no_rooms(value: int) -> None:
    found = rooms_of_grid(OccupancyGrid(np.full((40, 30), value, np.int8), RESOLUTION))

    assert found.rooms == ()
    assert found.openings == ()


def test_a_map_that_is_all_floor_is_one_room() -> None:
    found = rooms_of_grid(OccupancyGrid(np.zeros((60, 80), np.int8), RESOLUTION))

    assert [room.area for room in found.rooms] == [pytest.approx(12.0)]


def plain_basin_peaks(walls: BoolArray, joined_from: float) -> list[float]:
    """Return the peaks of the basins, by plain sets of cells joined at falling clearance."""
    clearance = clearance_from_walls(walls, 1.0)
    owner: dict[tuple[int, int], int] = {}
    peaks: dict[int, float] = {}
    cells = [(-round(float(clearance[cell]) * 16), cell) for cell in np.ndindex(walls.shape) if clearance[cell] > 0]
    for _, cell in sorted(cells):
        row, column = cell
        near = {owner[r, c] for r in range(row - 1, row + 2) for c in range(column - 1, column + 2) if (r, c) in owner}
        here = float(clearance[cell])
        if not near:
            peaks[len(owner)] = here
            owner[cell] = len(owner)
            continue
        high = max(near, key=lambda basin: peaks[basin])
        owner[cell] = high
        for low in near - {high}:
            if here > joined_from * peaks[low]:
                owner |= {c: high for c, basin in owner.items() if basin == low}
                del peaks[low]
    return sorted(peaks.values())


@pytest.mark.parametrize("seed", range(4))
def test_the_flood_finds_the_basins_of_a_plain_one(seed: int) -> None:
    random = np.random.default_rng(seed)
    walls = np.zeros((40, 50), np.bool_)
    for _ in range(12):
        row, column = random.integers(0, (36, 46))
        walls[row : row + random.integers(1, 4), column : column + random.integers(1, 14)] = True

    basins = basins_of(clearance_from_walls(walls, 1.0), 1.0, joined_from=0.8, widest=100.0)

    assert sorted(basins.peaks[1:].tolist()) == pytest.approx(plain_basin_peaks(walls, 0.8))
    assert ((basins.labels > 0) == ~walls).all()
