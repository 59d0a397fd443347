"""Zones from a text file: their content, and one sentence with the line for each fault."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.errors import ZoneError
from waychair.maps.drawn.zones import (
    Rule,
    Zone,
    check_zones,
    keep_out_cells,
    load_zones,
    save_zones,
    zone_cells,
    zone_contains,
    zone_speed_limit,
)
from waychair.maps.grid.cells import cells_from_points, inside, points_from_cells
from waychair.types import OccupancyGrid, Pose2

SQUARE = np.array([[1.0, 1.0], [3.0, 1.0], [3.0, 3.0], [1.0, 3.0]])
POLYGON = "polygon: [[1, 1], [3, 1], [3, 3]]"


def written(folder: Path, text: str) -> Path:
    (folder / "zones.yaml").write_text(text, encoding="utf-8")
    return folder


def test_a_map_without_the_file_has_no_zones_and_an_empty_file_has_none_either(tmp_path: Path) -> None:
    assert load_zones(tmp_path) == ()
    assert load_zones(written(tmp_path, "# nothing yet\n")) == ()


def test_zones_are_read_back_as_they_were_written(tmp_path: Path) -> None:
    zones = (
        Zone("stairs", Rule.KEEP_OUT, SQUARE),
        Zone("Flur 007", Rule.SLOW, SQUARE + 5, 0.3),
        Zone("ramp", Rule.ONE_WAY, SQUARE[:3] - 9, math.pi / 2),
    )
    save_zones(tmp_path, zones)
    for place in (tmp_path, tmp_path / "map.yaml"):
        for read, zone in zip(load_zones(place), zones, strict=True):
            assert (read.name, read.rule, read.value) == (zone.name, zone.rule, zone.value)
            np.testing.assert_array_equal(read.polygon, zone.polygon)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            f"\nstairs: {{keep_out: true, {POLYGON}}}\nstairs: {{keep_out: true, {POLYGON}}}\n",
            "line 3: 'stairs' is given twice",
        ),
        (f"ward: {{slow: fast, {POLYGON}}}", "line 1: 'ward': slow is 'fast'"),
        (f"ward: {{slow: 0.0, {POLYGON}}}", "at least 0.05 m/s"),
        (f"ward: {{slow: .nan, {POLYGON}}}", "must be a number"),
        (f"ward: {{slow: true, {POLYGON}}}", "must be a number"),
        (f"ward: {{keep_out: maybe, {POLYGON}}}", "write `keep_out: true`"),
        (f"ward: {{one_way: 1, slow: 0.3, {POLYGON}}}", "one of keep_out, slow and one_way, it has 2"),
        (f"ward: {{{POLYGON}}}", "it has 0"),
        (f"ward: {{slwo: 0.3, {POLYGON}}}", "not 'slwo'"),
        (f"ward: {{slow: 2024-13-45, {POLYGON}}}", "line 1: '2024-13-45' is not a valid value"),
        (f"ward: {{slow: {'9' * 400}, {POLYGON}}}", "is not a valid value"),
        (f"ward: {{one_way: 1.0e+300, {POLYGON}}}", "more than a full turn"),
        (f"ward: {{slow: 1.0e+300, {POLYGON}}}", "no more than 1000"),
        (f"ward: {{slow: 0.3, {POLYGON}, {POLYGON}}}", "'polygon' is given twice"),
        (f"ward: {{slow: 0.3, polygon: [[{'9' * 5000}, 1], [2, 2], [3, 3]]}}", "is not a valid value"),
        (f"ward: {{slow: 0.3, polygon: [['{'9' * 400}', 1], [2, 2], [3, 3]]}}", r"numbers up to 1e\+06"),
        ("ward: {slow: 0.3, polygon: [[1.0e+19, 1], [2, 2], [3, 3]]}", r"numbers up to 1e\+06"),
        ("[" * 3000, "more than 50 nested lists or mappings"),
        ("ward: {slow: 0.3}", "three or more corners"),
        ("ward: {slow: 0.3, polygon: [[1, 1], [2, 2]]}", "three or more corners"),
        ("ward: {slow: 0.3, polygon: [[1, 1], [2, x], [3, 3]]}", "three or more corners"),
        ("ward: {slow: 0.3, polygon: [[1, 1], [2, .inf], [3, 3]]}", "three or more corners"),
        ("ward: {slow: 0.3, polygon: [[1, 1], [2, 2], [3, 3]]}", "no area"),
        ("ward: [1, 2]", "must be"),
        ("ward: {slow: !!python/name:os.system x}", "line 1: could not determine"),
        ("- ward", "must hold"),
        ("ward: {slow: [", "correct the YAML"),
    ],
)
def test_an_invalid_file_is_refused_with_its_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ZoneError, match=said):
        load_zones(written(tmp_path, text))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_points_in_a_triangle_lie_left_of_its_three_edges(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners, points = rng.uniform(-5, 5, (3, 2)), rng.uniform(-5, 5, (200, 2))
    sides = [
        (b[0] - a[0]) * (points[:, 1] - a[1]) - (b[1] - a[1]) * (points[:, 0] - a[0])
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]
    inside = (np.array(sides) > 0).all(axis=0) | (np.array(sides) < 0).all(axis=0)
    np.testing.assert_array_equal(zone_contains(Zone("z", Rule.KEEP_OUT, corners), points), inside)


def test_a_polygon_with_a_notch_does_not_contain_the_notch() -> None:
    notched = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 1.0], [0.0, 4.0]])
    zone = Zone("z", Rule.KEEP_OUT, notched)
    assert zone_contains(zone, np.array([[2.0, 0.5], [0.5, 2.0], [3.5, 2.0], [2.0, 3.0]])).tolist() == [
        True,
        True,
        True,
        False,
    ]


@pytest.mark.parametrize("origin", [Pose2(), Pose2(0.5, -1.5, 0.5)])
def test_the_cells_of_a_zone_are_all_that_it_touches_also_on_a_rotated_grid(origin: Pose2) -> None:
    grid = OccupancyGrid(np.zeros((100, 120), np.int8), 0.05, origin)
    zone = Zone("z", Rule.KEEP_OUT, SQUARE)
    mask = keep_out_cells(
        [zone, Zone("far", Rule.KEEP_OUT, SQUARE + 100), Zone("slow", Rule.SLOW, SQUARE + 1, 0.3)], grid
    )
    rows, columns = np.indices(mask.shape).reshape(2, -1)
    within = np.linspace(0.0, 1.0, 21)[1:-1] * 0.999 + 0.0005
    parts = np.stack(np.meshgrid(within, within), axis=-1).reshape(-1, 2)
    local = (np.stack([columns, rows], axis=-1)[:, None] + parts) * grid.resolution
    c, s = math.cos(origin.theta), math.sin(origin.theta)
    points = local.reshape(-1, 2) @ np.array([[c, s], [-s, c]]) + (origin.x, origin.y)
    seen = zone_contains(zone, points).reshape(len(rows), -1).any(axis=1).reshape(mask.shape)
    assert not (seen & ~mask).any()
    assert (mask & ~seen).sum() <= (0 if origin == Pose2() else 0.01 * mask.sum())  # slivers between the parts
    assert mask.sum() > 500
    assert zone_cells(Zone("far", Rule.KEEP_OUT, SQUARE + 100), grid)[1].size == 0


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=100, deadline=None)
def test_every_point_of_a_zone_lies_in_one_of_its_cells(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = OccupancyGrid(np.zeros((40, 50), np.int8), 0.05, Pose2(*rng.uniform(-1, 1, 3)))
    middle, wide = points_from_cells(grid, rng.integers(5, 35, (1, 2)))[0], rng.uniform(0.001, 0.6)
    corners = middle + rng.uniform(-1.0, 1.0, (3, 2)) * (0.6, wide)
    shares = rng.dirichlet((0.5, 0.5, 0.5), 300)
    cells = cells_from_points(grid, shares @ corners)
    mask = keep_out_cells([Zone("z", Rule.KEEP_OUT, corners)], grid)
    assert mask[tuple(cells[inside(grid, cells)].T)].all()


@pytest.mark.parametrize(("x", "columns"), [((1.53, 1.57), [30, 31]), ((1.521, 1.523), [30]), ((1.5, 1.55), [30])])
def test_a_zone_thinner_than_a_cell_still_blocks_the_way(x: tuple[float, float], columns: list[int]) -> None:
    grid = OccupancyGrid(np.zeros((20, 60), np.int8), 0.05)
    strip = np.array([[x[0], -1.0], [x[1], -1.0], [x[1], 9.0], [x[0], 9.0]])
    mask = keep_out_cells([Zone("z", Rule.KEEP_OUT, strip)], grid)
    assert np.flatnonzero(mask.all(axis=0)).tolist() == columns
    assert mask.sum() == 20 * len(columns)


def test_the_speed_limit_is_the_lowest_of_all_touched_slow_zones() -> None:
    zones = (
        Zone("a", Rule.SLOW, SQUARE, 0.4),
        Zone("b", Rule.SLOW, SQUARE + 1, 0.2),
        Zone("c", Rule.KEEP_OUT, SQUARE + 9),
    )
    assert zone_speed_limit(zones, np.array([[1.5, 1.5], [0.0, 0.0]])) == 0.4
    assert zone_speed_limit(zones, np.array([[1.5, 1.5], [3.5, 3.5]])) == 0.2
    assert zone_speed_limit(zones, np.array([[10.0, 10.0]])) == math.inf


@pytest.mark.parametrize("rule", list(Rule))
def test_a_zone_outside_of_the_map_is_named_and_one_that_reaches_onto_it_is_not(rule: Rule) -> None:
    grid = OccupancyGrid(np.zeros((80, 100), np.int8), 0.05, Pose2(-1.0, 0.5, 0.4))
    check_zones([Zone("here", rule, SQUARE, 0.3), Zone("half", rule, SQUARE - np.array([2.5, 0.0]), 0.3)], grid)
    for off in ((30.0, 0.0), (0.0, -9.0)):
        with pytest.raises(ZoneError, match=r"the zone 'there', round \(.*\), lies wholly outside the map: correct"):
            check_zones([Zone("here", rule, SQUARE, 0.3), Zone("there", rule, SQUARE + np.array(off), 0.3)], grid)
