"""Zones from a text file: what they hold, and one sentence with the line for what is broken."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.errors import ZoneError
from waychair.maps.zones import Rule, Zone, cells_of, holds, keep_out_cells, load_zones, save_zones, speed_limit
from waychair.types import OccupancyGrid, Pose2

SQUARE = np.array([[1.0, 1.0], [3.0, 1.0], [3.0, 3.0], [1.0, 3.0]])
POLYGON = "polygon: [[1, 1], [3, 1], [3, 3]]"


def written(folder: Path, text: str) -> Path:
    (folder / "zones.yaml").write_text(text, encoding="utf-8")
    return folder


def test_a_map_without_the_file_has_no_zones_and_an_empty_file_has_none_either(tmp_path: Path) -> None:
    assert load_zones(tmp_path) == ()
    assert load_zones(written(tmp_path, "# nothing yet\n")) == ()


def test_zones_are_read_as_they_were_written(tmp_path: Path) -> None:
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
        (f"\nstairs: {{keep_out: true, {POLYGON}}}\nstairs: {{keep_out: true, {POLYGON}}}\n", "line 3.*there twice"),
        (f"ward: {{slow: fast, {POLYGON}}}", "line 1: 'ward': slow is 'fast'"),
        (f"ward: {{slow: 0.0, {POLYGON}}}", "at least 0.05 m/s"),
        (f"ward: {{slow: .nan, {POLYGON}}}", "must be a number"),
        (f"ward: {{slow: true, {POLYGON}}}", "must be a number"),
        (f"ward: {{keep_out: maybe, {POLYGON}}}", "write `keep_out: true`"),
        (f"ward: {{one_way: 1, slow: 0.3, {POLYGON}}}", "one of keep_out, slow and one_way, it has 2"),
        (f"ward: {{{POLYGON}}}", "it has 0"),
        (f"ward: {{slwo: 0.3, {POLYGON}}}", "not 'slwo'"),
        ("ward: {slow: 0.3}", "three or more corners"),
        ("ward: {slow: 0.3, polygon: [[1, 1], [2, 2]]}", "three or more corners"),
        ("ward: {slow: 0.3, polygon: [[1, 1], [2, x], [3, 3]]}", "three or more corners"),
        ("ward: {slow: 0.3, polygon: [[1, 1], [2, .inf], [3, 3]]}", "three or more corners"),
        ("ward: {slow: 0.3, polygon: [[1, 1], [2, 2], [3, 3]]}", "no area"),
        ("ward: [1, 2]", "must be"),
        ("ward: {slow: !!python/name:os.system x}", "line 1: 'ward'"),
        ("- ward", "must hold"),
        ("ward: {slow: [", "is not YAML"),
    ],
)
def test_a_broken_file_is_refused_with_its_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ZoneError, match=said):
        load_zones(written(tmp_path, text))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_points_in_a_triangle_are_those_left_of_its_three_edges(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners, points = rng.uniform(-5, 5, (3, 2)), rng.uniform(-5, 5, (200, 2))
    sides = [
        (b[0] - a[0]) * (points[:, 1] - a[1]) - (b[1] - a[1]) * (points[:, 0] - a[0])
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]
    inside = (np.array(sides) > 0).all(axis=0) | (np.array(sides) < 0).all(axis=0)
    np.testing.assert_array_equal(holds(Zone("z", Rule.KEEP_OUT, corners), points), inside)


def test_a_notched_polygon_does_not_hold_its_notch() -> None:
    notched = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 1.0], [0.0, 4.0]])
    zone = Zone("z", Rule.KEEP_OUT, notched)
    assert holds(zone, np.array([[2.0, 0.5], [0.5, 2.0], [3.5, 2.0], [2.0, 3.0]])).tolist() == [True, True, True, False]


@pytest.mark.parametrize("origin", [Pose2(), Pose2(0.5, -1.5, 0.5)])
def test_cells_of_a_zone_have_their_centre_in_it_also_on_a_turned_grid(origin: Pose2) -> None:
    grid = OccupancyGrid(np.zeros((100, 120), np.int8), 0.05, origin)
    zone = Zone("z", Rule.KEEP_OUT, SQUARE)
    mask = keep_out_cells(
        [zone, Zone("far", Rule.KEEP_OUT, SQUARE + 100), Zone("slow", Rule.SLOW, SQUARE + 1, 0.3)], grid
    )
    rows, columns = np.indices(mask.shape).reshape(2, -1)
    local = (np.stack([columns, rows], axis=-1) + 0.5) * grid.resolution
    c, s = math.cos(origin.theta), math.sin(origin.theta)
    points = local @ np.array([[c, s], [-s, c]]) + (origin.x, origin.y)
    np.testing.assert_array_equal(mask.ravel(), holds(zone, points))
    assert mask.sum() > 500
    assert cells_of(Zone("far", Rule.KEEP_OUT, SQUARE + 100), grid)[1].size == 0


def test_the_speed_limit_is_the_lowest_of_the_slow_zones_that_any_point_touches() -> None:
    zones = (
        Zone("a", Rule.SLOW, SQUARE, 0.4),
        Zone("b", Rule.SLOW, SQUARE + 1, 0.2),
        Zone("c", Rule.KEEP_OUT, SQUARE + 9),
    )
    assert speed_limit(zones, np.array([[1.5, 1.5], [0.0, 0.0]])) == 0.4
    assert speed_limit(zones, np.array([[1.5, 1.5], [3.5, 3.5]])) == 0.2
    assert speed_limit(zones, np.array([[10.0, 10.0]])) == math.inf
