"""The costmap: passable cells and their prices."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, BodyLayer
from waychair.errors import NoFreeSpace
from waychair.maps.drawn.zones import Rule, Zone
from waychair.maps.grid.cells import cells_from_points, inside
from waychair.maps.grid.distance_field import distances
from waychair.planning.body.clearance import COMFORTABLE, PLANNED
from waychair.planning.grid.costmap import (
    WALL_PRICE,
    LiveCostmap,
    check_free_space,
    costmap_from_grid,
    costmap_in_bands,
)
from waychair.planning.route.global_planner import plan
from waychair.types import BoolArray, FloatArray, OccupancyGrid, Pose2


def corridor(width: float, resolution: float = 0.05, length: float = 4.0) -> OccupancyGrid:
    """Free floor of a width between two walls along x."""
    rows = round(width / resolution)
    cells = np.zeros((rows + 2, round(length / resolution)), np.int8)
    cells[[0, -1]] = 100
    return OccupancyGrid(cells, resolution)


@pytest.mark.parametrize(
    ("width", "passable"), [(0.60, False), (0.65, False), (0.70, True), (0.75, True), (0.80, True)]
)
def test_a_corridor_is_passable_from_the_width_of_the_chair_and_its_margins_on(width: float, passable: bool) -> None:
    assert bool((costmap_from_grid(corridor(width), CHAIR_A).prices[:, 40] > 0).any()) is passable


@pytest.mark.parametrize("resolution", [0.02, 0.03, 0.05])
@pytest.mark.parametrize("turned", [False, True])
def test_a_corridor_of_any_number_of_cells_is_judged_by_its_width(resolution: float, turned: bool) -> None:
    for count in range(round(0.55 / resolution), round(0.85 / resolution)):
        grid = corridor(count * resolution, resolution)
        cells = grid.cells.T.copy() if turned else grid.cells
        prices = costmap_from_grid(OccupancyGrid(cells, resolution), CHAIR_A).prices
        assert prices.any() == (count * resolution >= CHAIR_A.width + 2 * PLANNED - 1e-6)


def test_beside_one_wall_no_cell_nearer_than_the_planned_clearance_is_passable() -> None:
    cells = np.zeros((80, 60), np.int8)
    cells[0] = 100
    costmap = costmap_from_grid(OccupancyGrid(cells, 0.05), CHAIR_A)
    assert (costmap.clearance[costmap.prices > 0] >= CHAIR_A.width / 2 + PLANNED + 0.025 - 1e-5).all()


def test_a_wider_chair_needs_a_wider_corridor() -> None:
    assert not costmap_from_grid(corridor(0.75), CHAIR_B).prices.any()


def test_the_middle_of_a_corridor_is_the_cheapest_place() -> None:
    prices = costmap_from_grid(corridor(1.55), CHAIR_A).prices[:, 40]
    passable = np.flatnonzero(prices)
    assert int(passable[np.argmin(prices[passable])]) == len(prices) // 2
    middle = prices[len(prices) // 2 : passable[-1] + 1]
    assert (np.diff(middle) > 0).all()


def test_open_floor_has_the_price_of_a_free_cell() -> None:
    costmap = costmap_from_grid(corridor(4.0), CHAIR_A)
    assert costmap.prices[42, 40] == 1000
    assert costmap.clearance[42, 40] > 1.0


def test_unknown_cells_are_passable_at_a_price() -> None:
    grid = OccupancyGrid(np.full((9, 9), -1, np.int8), 0.1)
    costmap = costmap_from_grid(grid, CHAIR_A)
    assert (costmap.prices == 10_000).all()


def test_live_points_close_cells_and_points_off_the_map_are_ignored() -> None:
    grid = OccupancyGrid(np.zeros((60, 60), np.int8), 0.05, Pose2(1.0, 2.0))
    points = np.array([[2.5, 3.5], [-90.0, 0.0], [1.0, 50.0]])
    costmap = costmap_from_grid(grid, CHAIR_A, live_points=points)
    assert (costmap.clearance == 0).sum() == 1
    assert costmap.clearance[30, 30] == 0
    assert costmap.prices[30, 30] == 0
    assert costmap.grid.cells[30, 30] == 100
    assert grid.cells[30, 30] == 0
    assert costmap.prices[30, 37] == 0
    assert costmap.prices[30, 38] > 0


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_the_price_never_rises_with_clearance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = OccupancyGrid(np.where(rng.random((40, 40)) < 0.005, 100, 0).astype(np.int8), 0.05)
    costmap = costmap_from_grid(grid, CHAIR_A)
    order = np.argsort(costmap.clearance, axis=None)
    prices = costmap.prices.ravel()[order]
    passable = prices[prices > 0]
    assert (np.diff(passable) <= 0).all()
    assert (costmap.clearance[costmap.prices == 0] < 0.36).all()


def box(x0: float, y0: float, x1: float, y1: float) -> FloatArray:
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def floor(rows: int = 100, columns: int = 160) -> OccupancyGrid:
    return OccupancyGrid(np.zeros((rows, columns), np.int8), 0.05)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_an_updated_costmap_equals_a_new_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = OccupancyGrid(np.where(rng.random((60, 70)) < 0.01, 100, 0).astype(np.int8), 0.1, Pose2(1.0, -2.0, 0.4))
    body = dataclasses.replace(
        CHAIR_A, layers=(BodyLayer(0.0, 0.3, 0.75, 0.2, 0.2), BodyLayer(0.3, 1.4, 0.6, 0.25, 0.3))
    )
    zones = (Zone("slow", Rule.SLOW, box(1, -1, 4, 2), 0.2), Zone("out", Rule.KEEP_OUT, box(4, 2, 5, 3)))
    kept = LiveCostmap(grid, body, zones)
    for _ in range(4):
        points = rng.uniform(-2, 8, (int(rng.integers(0, 6)), 2))
        layered = [(layer, rng.uniform(-2, 8, (int(rng.integers(0, 4)), 2))) for layer in body.layers]
        now = kept.costmap(points, layered)
        anew = LiveCostmap(grid, body, zones).costmap(points, layered)
        np.testing.assert_array_equal(now.prices, anew.prices)
        np.testing.assert_array_equal(now.clearance, anew.clearance)
        np.testing.assert_array_equal(now.grid.cells, anew.grid.cells)


def on_middle_line(side: FloatArray, needed: float, cell: float) -> BoolArray:
    """Return which cells have the middle of a gap on a border: the plain reference."""
    found = np.zeros(side.shape, np.bool_)
    height, width = side.shape
    for i, j in np.argwhere((side < needed) & (side >= needed - cell / 2)).tolist():
        for down, right in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            line = [(i + k * down, j + k * right) for k in (-1, 0, 1, 2)]
            if all(0 <= row < height and 0 <= column < width for row, column in line):
                a, b, c, d = (float(side[each]) for each in line)
                rises = b - a > cell / 2 and c - d > cell / 2
                found[i, j] |= rises and min(1.5 * b - 0.5 * a, 1.5 * c - 0.5 * d) >= needed
    return found


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_a_change_at_some_heights_updates_the_costmap_like_a_new_one(seed: int) -> None:
    """Only cells near the change are updated; on a much larger map, a plain reference checks every cell."""
    rng = np.random.default_rng(seed)
    grid = OccupancyGrid(np.where(rng.random((120, 140)) < 0.002, 100, 0).astype(np.int8), 0.1)
    layer = BodyLayer(0.0, 0.3, 0.6, 0.2, 0.22)
    body = dataclasses.replace(CHAIR_A, layers=(layer, BodyLayer(0.3, 1.4, 0.75, 0.25, 0.3)))
    points = rng.uniform(-1, 1, (4, 2)) + rng.uniform(0, 12, 2)
    kept = LiveCostmap(grid, body)
    before, after = kept.costmap(), kept.costmap(None, [(layer, points)])
    cells = cells_from_points(grid, points)
    solid = np.zeros(grid.cells.shape, np.bool_)
    solid[tuple(cells[inside(grid, cells)].T)] = True
    away = distances(solid, grid.resolution) if solid.any() else np.full(solid.shape, 99.0)
    inset = min(body.front - layer.front, body.rear - layer.rear, body.width / 2 - layer.half_width)
    np.testing.assert_allclose(after.clearance, np.minimum(before.clearance, away + inset), atol=1e-5)
    side = away + body.width / 2 - layer.half_width
    needed = body.width / 2 + PLANNED + grid.resolution / 2
    missing = np.clip((COMFORTABLE - side) / (COMFORTABLE - needed), 0.0, 1.0)
    narrow = (side < needed - 1e-5) & ~on_middle_line(side, needed - 1e-5, grid.resolution)
    prices = np.where(narrow, 0.0, 1000.0 + WALL_PRICE * missing**2)
    expected = np.where((before.prices == 0) | (prices == 0), 0, np.maximum(before.prices, prices))
    np.testing.assert_allclose(after.prices, expected, atol=1.0)


def test_a_costmap_is_unchanged_when_the_next_one_is_made() -> None:
    kept = LiveCostmap(floor(), CHAIR_A)
    first = kept.costmap()
    prices, clearance = first.prices.copy(), first.clearance.copy()
    kept.costmap(np.array([[4.0, 2.5]]))
    kept.costmap(None, [(CHAIR_A.height_layers()[0], np.array([[4.0, 2.5]]))])
    np.testing.assert_array_equal(first.prices, prices)
    np.testing.assert_array_equal(first.clearance, clearance)


def test_no_part_of_the_chair_enters_a_keep_out_zone() -> None:
    costmap = costmap_from_grid(floor(), CHAIR_A, zones=[Zone("stairs", Rule.KEEP_OUT, box(3, 1, 4, 4))])
    rows, columns = np.nonzero(costmap.prices)
    x, y = (columns + 0.5) * 0.05, (rows + 0.5) * 0.05
    away = np.hypot(np.clip(x, 3, 4) - x, np.clip(y, 1, 4) - y)
    assert away.min() >= CHAIR_A.width / 2
    closed = np.zeros((100, 160), np.bool_)
    closed[20:80, 60:80] = True
    np.testing.assert_array_equal(costmap.grid.cells == 100, closed)
    path = plan(costmap, Pose2(1.0, 2.5), Pose2(6.0, 2.5))
    assert path.length() > 5.5


def test_a_slow_zone_costs_its_driving_time_and_is_avoided_where_a_detour_is_quicker() -> None:
    costmap = costmap_from_grid(floor(), CHAIR_A, zones=[Zone("ward", Rule.SLOW, box(3, 1, 4, 4), 0.2)])
    assert costmap.prices[50, 70] == 4000
    assert costmap.prices[50, 20] == 1000
    path = plan(costmap, Pose2(1.0, 2.5), Pose2(6.0, 2.5))
    inside = (np.abs(path.poses[:, 0] - 3.5) < 0.5) & (np.abs(path.poses[:, 1] - 2.5) < 1.45)
    assert not inside.any()


@pytest.mark.parametrize("turned", [0.0, 0.6])
def test_a_one_way_zone_is_passed_along_its_heading_only(turned: float) -> None:
    """Two corridors between the same rooms, one of them one-way: there by the near one, back by the far one."""
    cells = np.zeros((100, 160), np.int8)
    cells[30:70, 40:120] = 100
    grid = OccupancyGrid(cells, 0.05, Pose2(0.0, 0.0, turned))
    c, s = math.cos(turned), math.sin(turned)
    corners = box(2.5, 0.0, 5.5, 1.5) @ np.array([[c, s], [-s, c]])
    costmap = costmap_from_grid(grid, CHAIR_A, zones=[Zone("ramp", Rule.ONE_WAY, corners, turned)])
    west, east = (Pose2(0.0, 0.0, turned) @ Pose2(x, 1.2) for x in (1.0, 7.0))
    there, back = plan(costmap, west, east), plan(costmap, east, west)
    assert there.length() < 7.0
    assert back.length() > 9.0


def test_a_chair_with_narrow_feet_passes_a_low_obstacle() -> None:
    layers = (BodyLayer(0.0, 0.3, 0.5, 0.2, 0.2), BodyLayer(0.3, 1.4, 0.75, 0.25, 0.3))
    body = dataclasses.replace(CHAIR_A, layers=layers)
    gap = np.array([[2.0, y] for y in np.concatenate([np.arange(0, 2.2, 0.02), np.arange(2.75, 5.0, 0.02)])])
    kept = LiveCostmap(floor(), body)
    through = [bool(kept.costmap(None, [(layer, gap)]).prices[:, 40].any()) for layer in layers]
    assert through == [True, False]
    assert not kept.costmap(gap).prices[:, 40].any()


def test_a_map_without_space_for_the_chair_is_refused() -> None:
    check_free_space(costmap_from_grid(floor(), CHAIR_A))
    with pytest.raises(NoFreeSpace, match=r"no free space for a chair 0\.60 m wide"):
        check_free_space(costmap_from_grid(corridor(0.6), CHAIR_A))


@pytest.mark.parametrize("one", [-1, 100])
def test_a_map_without_a_known_free_cell_is_refused(one: int) -> None:
    cells = np.full((100, 80), -1, np.int8)
    cells[5, 5] = one
    with pytest.raises(NoFreeSpace, match="no cell of the map is known to be free"):
        check_free_space(costmap_from_grid(OccupancyGrid(cells, 0.05), CHAIR_A))
    cells[5, 5] = 0
    check_free_space(costmap_from_grid(OccupancyGrid(cells, 0.05), CHAIR_A))


def test_a_clearance_above_the_kept_one_is_limited_but_not_below_that_of_the_prices() -> None:
    wide = corridor(12.0)
    assert costmap_from_grid(wide, CHAIR_A).clearance.max() == 2.0
    costmap = costmap_from_grid(wide, CHAIR_A, comfortable=4.0)
    assert costmap.clearance.max() == 4.0
    assert costmap.prices[60, 40] > 1000


def test_a_costmap_made_in_bands_is_the_same_one() -> None:
    rng = np.random.default_rng(5)
    cells = np.where(rng.random((900, 700)) < 0.002, 100, 0).astype(np.int8)
    cells[rng.random(cells.shape) < 0.05] = -1
    grid = OccupancyGrid(cells, 0.05, Pose2(1.0, -2.0, 0.3))
    work, parts = costmap_in_bands(grid, CHAIR_A), 0
    while True:
        try:
            next(work)
        except StopIteration as done:
            found = done.value
            break
        parts += 1
    whole = costmap_from_grid(grid, CHAIR_A)
    assert parts >= 3
    np.testing.assert_array_equal(found.prices, whole.prices)
    np.testing.assert_array_equal(found.clearance, whole.clearance)
    assert found.barred is None
