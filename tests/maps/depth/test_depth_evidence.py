"""Depth evidence is a separate sum, moves with the graph, and keeps stairwells occupied against any lidar evidence."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.maps.depth_rooms import picture, scan_of_picture
from waychair.errors import MapError
from waychair.geometry import compose
from waychair.maps.depth.depth_evidence import DepthEvidence, merge_sensors
from waychair.maps.depth.depth_scan import DepthScan
from waychair.maps.grid import occupancy
from waychair.maps.grid.cells import cells_from_points, inside, occupied
from waychair.maps.grid.occupancy import EvidenceGrid
from waychair.maps.layers.grid_assembly import DepthAssembly
from waychair.types import FloatArray, OccupancyGrid, Pose2, Scan

HERE = np.zeros((1, 3))
STAIRS = scan_of_picture(picture(holes=[(2.6, 3.6, -0.6, 0.9, 1.2)]))
SHELF = scan_of_picture(picture([(2.62, 3.0, -0.4, 0.6, 0.66, 0.72)]))
LOW = scan_of_picture(picture([(2.22, 2.6, -0.4, 0.6, 0.0, 0.15)]))
poses = st.builds(lambda x, y, t: np.array([[x, y, t]]), *[st.floats(-3.0, 3.0)] * 3)


def value(grid: OccupancyGrid, x: float, y: float) -> int:
    cell = cells_from_points(grid, np.array([[x, y]]))
    return int(grid.cells[tuple(cell[0])]) if inside(grid, cell)[0] else -1


def lidar_that_sees_nothing_near(scans: int) -> EvidenceGrid:
    evidence = EvidenceGrid()
    scan = Scan(0, np.full(361, 6.0, np.float32), -math.pi / 2, math.radians(0.5))
    for _ in range(scans):
        evidence.add(HERE, HERE, [scan])
    return evidence


def drawn(*scans: DepthScan) -> DepthEvidence:
    evidence = DepthEvidence()
    for scan in scans:
        evidence.add(HERE, HERE, [scan])
    return evidence


def grids(evidence: DepthEvidence) -> tuple[OccupancyGrid, OccupancyGrid]:
    return evidence.obstacles.grid(), evidence.drops.grid()


@given(st.lists(st.tuples(poses, st.sampled_from([STAIRS, SHELF, LOW])), min_size=1, max_size=6), st.randoms())
@settings(max_examples=15, deadline=None)
def test_images_are_removed_exactly_in_any_order(looks: list[tuple[FloatArray, DepthScan]], rng: object) -> None:
    evidence = drawn(SHELF)
    before = grids(evidence)
    for pose, scan in looks:
        evidence.add(pose, pose, [scan])
    for pose, scan in reversed(looks):
        evidence.remove(pose, pose, [scan])
    for now, then in zip(grids(evidence), before, strict=True):
        np.testing.assert_array_equal(now.cells, then.cells)


@pytest.mark.parametrize(("scan", "x"), [(SHELF, 2.64), (LOW, 2.24)])
def test_a_lidar_that_sees_under_or_over_an_obstacle_a_hundred_times_does_not_erase_it(
    scan: DepthScan, x: float
) -> None:
    lidar = lidar_that_sees_nothing_near(100).grid()
    assert value(lidar, x, 0.2) < 20
    grid, drops = merge_sensors(lidar, *grids(drawn(scan)))
    assert value(grid, x, 0.2) >= 65
    assert not drops.any()


def test_a_stairwell_is_occupied_and_a_drop_off_even_if_the_lidar_sees_across_it() -> None:
    grid, drops = merge_sensors(lidar_that_sees_nothing_near(100).grid(), *grids(drawn(STAIRS)))
    well = cells_from_points(grid, np.array([[x, y] for x in (2.7, 3.0, 3.3) for y in (-0.3, 0.2, 0.7)]))
    assert drops[tuple(well.T)].all()
    assert occupied(grid)[tuple(well.T)].all()
    assert value(grid, 2.3, 0.2) < 50


def test_floor_beyond_a_drop_off_that_no_camera_has_seen_is_not_free() -> None:
    grid, drops = merge_sensors(lidar_that_sees_nothing_near(3).grid(), *grids(drawn(STAIRS)))
    seen = np.isin(grids(drawn(STAIRS))[1].cells, [100]).sum()
    assert drops.sum() > seen
    assert value(grid, 2.0, -1.6) < 50, "cells far from it stay as the lidar saw them"


def test_visible_floor_clears_obstacles_that_have_gone() -> None:
    floor = scan_of_picture(picture())
    grid, _ = merge_sensors(EvidenceGrid().grid(), *grids(drawn(LOW, floor, floor, floor)))
    assert value(grid, 2.24, 0.2) < 50


def test_drawn_evidence_follows_its_nodes_and_equals_newly_drawn_evidence() -> None:
    assembly = DepthAssembly()
    nodes = np.array([[0.0, 0.0, 0.0], [1.0, 0.3, 0.4]])
    off = np.array([0.1, 0.0, 0.05])
    for number, (scan, node) in enumerate([(STAIRS, 0), (SHELF, 1), (LOW, 1)]):
        assembly.add(number, scan, node, off, off)
    for bent in (nodes, nodes + np.array([[0.0, 0.0, 0.0], [0.4, -0.2, 0.1]])):
        assembly.move_nodes(bent, np.zeros(2))
        assembly.settle()
    assembly.drop(2)
    assembly.settle()
    anew, places = DepthEvidence(), compose(bent, off[None])
    for scan, node in ((STAIRS, 0), (SHELF, 1)):
        anew.add(places[node : node + 1], places[node : node + 1], [scan])
    for now, expected in zip(grids(assembly.cells), grids(anew), strict=True):
        np.testing.assert_array_equal(now.cells, expected.cells)
        assert now.map_from_grid == expected.map_from_grid


@given(st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9), st.booleans()), max_size=40))
@settings(max_examples=20, deadline=None)
def test_added_cells_are_summed(told: list[tuple[int, int, bool]]) -> None:
    evidence, expected = EvidenceGrid(), dict[tuple[int, int], float]()
    if told:
        evidence.put(np.array([each[:2] for each in told]), np.array([each[2] for each in told]))
    for col, row, hit in told:
        expected[col, row] = expected.get((col, row), 0.0) + (math.log(0.7 / 0.3) if hit else math.log(0.4 / 0.6))
    grid = evidence.grid()
    for (col, row), odds in expected.items():
        percent = round(100.0 / (1.0 + math.exp(-min(max(odds, -2.0), 3.511))))
        assert abs(value(grid, 0.05 * (col + 0.5), 0.05 * (row + 0.5)) - percent) <= 1


def test_a_pose_that_is_not_a_number_and_a_jump_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(MapError, match="not finite"):
        DepthEvidence().add(np.array([[math.nan, 0.0, 0.0]]), HERE, [LOW])
    monkeypatch.setattr(occupancy, "MOST_CELLS", 100_000)
    small = DepthEvidence()
    small.add(HERE, HERE, [LOW])
    with pytest.raises(MapError, match="jumps"):
        small.add(np.array([[1e4, 0.0, 0.0]]), HERE, [LOW])


def test_the_merged_grid_holds_all_parts() -> None:
    lidar = OccupancyGrid(np.array([[0, 100], [-1, 30]], np.int8), 0.05, Pose2(1.0, 1.0))
    none = OccupancyGrid(np.full((1, 1), -1, np.int8), 0.05, Pose2(-0.5, 0.0))
    grid, drops = merge_sensors(lidar, none, none)
    assert [value(grid, 1.0 + x, 1.0 + y) for x, y in ((0.02, 0.02), (0.07, 0.02), (0.02, 0.07), (0.07, 0.07))] == [
        0, 100, -1, 30,
    ]  # fmt: skip
    assert not drops.any()
