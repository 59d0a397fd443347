"""Occupancy from scans at known poses: against a plain reference, at the limits, and on a real corrected log."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from waychair.errors import MapError
from waychair.maps.grid import occupancy
from waychair.maps.grid.cells import cells_from_points
from waychair.maps.grid.occupancy import EvidenceGrid, OccupancySettings, build_grid
from waychair.recordings.recording import read_recording
from waychair.types import FloatArray, OccupancyGrid, Odometry, Pose2, Scan

SETTINGS = OccupancySettings(resolution=0.1)
Cell = tuple[int, int]


def scan_of(ranges: list[float], angle_min: float = 0.0, angle_step: float = 0.1, reach: float = math.inf) -> Scan:
    return Scan(0, np.array(ranges, np.float32), angle_min, angle_step, range_min=0.05, range_max=reach)


def value_at(grid: OccupancyGrid, x: float, y: float) -> int:
    row, column = cells_from_points(grid, np.array([[x, y]]))[0]
    return int(grid.cells[row, column])


def line(start: Cell, end: Cell) -> list[Cell]:
    """Return Bresenham's line; a test below checks it."""
    (x, y), (to_x, to_y) = start, end
    dx, dy = abs(to_x - x), -abs(to_y - y)
    cells, error = [(x, y)], dx + dy
    while (x, y) != (to_x, to_y):
        twice = 2 * error
        if twice >= dy:
            error += dy
            x += 1 if to_x > x else -1
        if twice <= dx:
            error += dx
            y += 1 if to_y > y else -1
        cells.append((x, y))
    return cells


def reference(poses: FloatArray, scans: list[Scan], s: OccupancySettings, *, forgets: bool = False) -> dict[Cell, int]:
    """Percent by absolute cell (x, y), with sets and dictionaries; limited scan by scan if it forgets, else at the end."""

    def logit(p: float) -> float:
        return math.log(p / (1 - p))

    def limited(value: float) -> float:
        return min(logit(occupancy.PROB_MAX), max(logit(occupancy.PROB_MIN), value))

    log_odds: dict[Cell, float] = {}
    for (px, py, theta), scan in zip(poses.tolist(), scans, strict=True):
        hits: set[Cell] = set()
        rays: list[Cell] = []
        for r, angle in zip(scan.ranges.tolist(), scan.angles().tolist(), strict=True):
            if math.isnan(r) or r == -math.inf:
                continue
            open_beam = r > scan.range_max or r == math.inf
            length = min(s.open_range, scan.range_max, s.range_max) if open_beam else min(r, s.range_max)
            is_hit = not open_beam and r <= s.range_max
            if length <= 0 or (is_hit and r < scan.range_min):
                continue
            end = (px + length * math.cos(theta + angle), py + length * math.sin(theta + angle))
            cell = (math.floor(end[0] / s.resolution), math.floor(end[1] / s.resolution))
            rays.append(cell)
            if is_hit:
                hits.add(cell)
        missed: set[Cell] = set()
        for cell in rays:
            for passed in line((math.floor(px / s.resolution), math.floor(py / s.resolution)), cell):
                if passed in hits:
                    break
                missed.add(passed)
        for cell in hits | missed:
            value = log_odds.get(cell, 0.0) + logit(occupancy.PROB_HIT if cell in hits else occupancy.PROB_MISS)
            log_odds[cell] = limited(value) if forgets else value
    return {cell: round(100 / (1 + math.exp(-limited(value)))) for cell, value in log_odds.items()}


def off_borders(pose: list[float], scan: Scan, s: OccupancySettings) -> bool:
    """Whether no beam, cut at any of the limits, ends within a nanometre of the border between two cells."""
    lengths = np.minimum(np.nan_to_num(scan.ranges.astype(float), posinf=math.inf, neginf=0.0), s.range_max)
    angles = pose[2] + scan.angles()
    for length in (lengths, s.open_range):
        ends = np.array(pose[:2])[:, None] + length * np.array([np.cos(angles), np.sin(angles)])
        if (np.abs(ends / s.resolution - np.rint(ends / s.resolution)) < 1e-9).any():
            return False
    return True


def by_cell(grid: OccupancyGrid) -> dict[Cell, int]:
    """Percent by absolute cell (x, y) of the cells that are known."""
    low_x = round(grid.map_from_grid.x / grid.resolution)
    low_y = round(grid.map_from_grid.y / grid.resolution)
    known = np.argwhere(grid.cells >= 0).tolist()
    return {(column + low_x, row + low_y): int(grid.cells[row, column]) for row, column in known}


distances = st.one_of(
    st.floats(0.0, 12.0, width=32), st.sampled_from([math.inf, -math.inf, math.nan, 0.0, 0.05, 5.0, 8.0])
)
places = st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-3.14, 3.14))


@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(places, st.lists(distances, min_size=1, max_size=30)), min_size=1, max_size=6), st.booleans())
def test_the_kernel_equals_plain_python(
    rows: list[tuple[tuple[float, float, float], list[float]]], traces_open: bool
) -> None:
    chosen = replace(SETTINGS, range_max=5.0, open_range=3.0 if traces_open else 0.0)
    # Off the cells' borders, where the last bit of a sine decides which cell a beam ends in.
    poses = np.array([(x + 0.0371, y + 0.0437, theta) for (x, y, theta), _ in rows])
    scans = [scan_of(ranges, -1.5, 0.1, 8.0) for _, ranges in rows]
    assume(all(off_borders(pose, scan, chosen) for pose, scan in zip(poses.tolist(), scans, strict=True)))
    assert by_cell(build_grid(poses, scans, chosen)) == reference(poses, scans, chosen)
    memory = EvidenceGrid(chosen, forgets=True)
    for pose, scan in zip(poses, scans, strict=True):
        memory.add(pose[None], pose[None], [scan])
    low = np.rint(memory.area[0] / chosen.resolution).astype(int)
    solid = {(column, row) for row, column in (np.argwhere(memory.occupied()) + low[::-1]).tolist()}
    expected = reference(poses, scans, chosen, forgets=True)
    assert solid == {cell for cell, percent in expected.items() if percent >= 65}


@settings(max_examples=40)
@given(
    st.lists(st.tuples(places, st.lists(distances, min_size=1, max_size=30)), min_size=1, max_size=8),
    st.randoms(use_true_random=False),
)
def test_scans_are_added_and_removed_in_any_order(
    rows: list[tuple[tuple[float, float, float], list[float]]], random: Random
) -> None:
    poses, scans = np.array([pose for pose, _ in rows]), [scan_of(ranges, -1.5, 0.1, 8.0) for _, ranges in rows]
    evidence = EvidenceGrid(SETTINGS)
    come = random.sample(range(len(rows)), len(rows))
    for k in come:
        evidence.add(poses[[k]], poses[[k]], [scans[k]])
    assert_same(evidence.grid(), build_grid(poses, scans, SETTINGS))
    stay = random.sample(range(len(rows)), random.randint(1, len(rows)))
    for k in set(come) - set(stay):
        evidence.remove(poses[[k]], poses[[k]], [scans[k]])
    assert_same(evidence.grid(), build_grid(poses[stay], [scans[k] for k in stay], SETTINGS))


def assert_same(found: OccupancyGrid, expected: OccupancyGrid) -> None:
    np.testing.assert_array_equal(found.cells, expected.cells)
    if (expected.cells >= 0).any():  # nothing has no place
        assert found.map_from_grid == expected.map_from_grid


@pytest.mark.parametrize(("hit", "miss"), [(0.7, 0.4), (0.6, 0.4), (0.51, 0.49), (0.99, 0.01), (0.8, 0.2)])
def test_a_seen_cell_is_never_unknown_again(hit: float, miss: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Hits and misses of equal weight give an even chance, which is not unknown."""
    monkeypatch.setattr(occupancy, "PROB_HIT", hit)
    monkeypatch.setattr(occupancy, "PROB_MISS", miss)
    pose = np.array([[0.05, 0.05, 0.0]])
    for hits, misses in product(range(1, 12), range(1, 12)):
        scans = [scan_of([1.0])] * hits + [scan_of([2.0])] * misses
        grid = build_grid(np.repeat(pose, hits + misses, axis=0), scans, SETTINGS)
        assert value_at(grid, 1.05, 0.05) >= 0
    both = build_grid(np.repeat(pose, 2, axis=0), [scan_of([1.0]), scan_of([2.0])], SETTINGS)
    assert value_at(both, 1.05, 0.05) in (
        round(100 / (1 + (1 - hit) / hit * (1 - miss) / miss)) + d for d in (-1, 0, 1)
    )


@settings(max_examples=80, deadline=None)
@given(st.floats(-3.14, 3.14), st.floats(0.3, 12.0))
def test_a_beam_is_a_line_of_single_cells_to_its_end(angle: float, length: float) -> None:
    grid = build_grid(np.array([[0.05, 0.05, angle]]), [scan_of([length])], SETTINGS)
    (end,) = (np.array(cell) for cell, value in by_cell(grid).items() if value == 70)
    cells = np.array(list(by_cell(grid)))
    longer = int(np.abs(end).argmax())
    assert sorted((cells[:, longer] * np.sign(end[longer])).tolist()) == list(range(abs(end[longer]) + 1))
    ideal = cells[:, longer] * end[1 - longer] / end[longer]
    assert (np.abs(cells[:, 1 - longer] - ideal) <= 0.5 + 1e-9).all()


def test_a_beam_is_free_along_its_way_and_occupied_at_its_end() -> None:
    grid = build_grid(np.array([[0.05, 0.05, 0.0]]), [scan_of([1.0])], SETTINGS)
    assert value_at(grid, 1.05, 0.05) == 70, "one hit counts as occupied for map_server's threshold of 65 %"
    assert [value_at(grid, x + 0.05, 0.05) for x in (0.0, 0.5, 0.9)] == [40, 40, 40]
    assert value_at(grid, 1.15, 0.05) == -1
    assert (grid.cells >= 0).sum() == 11


def test_the_margin_surrounds_all_seen_cells() -> None:
    grid = build_grid(np.array([[0.05, 0.05, 0.0]]), [scan_of([1.0])], SETTINGS)
    assert grid.cells.shape == (21, 31)
    assert grid.map_from_grid == Pose2(-1.0, -1.0, 0.0)
    inner = grid.cells[occupancy.MARGIN : -occupancy.MARGIN, occupancy.MARGIN : -occupancy.MARGIN]
    assert inner.tolist() == [[40] * 10 + [70]]


def test_a_scan_counts_a_cell_once_and_a_hit_beats_a_miss() -> None:
    twenty_alike = scan_of([1.0] * 20, 0.0, 1e-6)
    grid = build_grid(np.array([[0.05, 0.05, 0.0]]), [twenty_alike], SETTINGS)
    assert value_at(grid, 1.05, 0.05) == 70
    assert value_at(grid, 0.55, 0.05) == 40
    behind = scan_of([1.0, 2.0], 0.0, 1e-6)
    grid = build_grid(np.array([[0.05, 0.05, 0.0]]), [behind], SETTINGS)
    assert value_at(grid, 1.05, 0.05) == 70
    assert value_at(grid, 1.55, 0.05) == -1, "a beam stops where the same scan hit a cell"
    assert value_at(grid, 2.05, 0.05) == 70


def test_evidence_is_clamped_at_both_ends() -> None:
    pose = np.array([[0.05, 0.05, 0.0]])
    grid = build_grid(np.repeat(pose, 50, axis=0), [scan_of([1.0])] * 50, SETTINGS)
    assert value_at(grid, 1.05, 0.05) == 97
    assert value_at(grid, 0.55, 0.05) == 12


@pytest.mark.parametrize(("open_range", "range_max", "known"), [(0.0, 20.0, 0), (2.0, 20.0, 21), (2.0, 1.0, 11)])
def test_beams_without_a_return_clear_only_on_request(open_range: float, range_max: float, known: int) -> None:
    pose = np.array([[0.05, 0.05, 0.0]])
    for scan in (scan_of([math.inf]), scan_of([9.5], reach=9.0)):
        grid = build_grid(pose, [scan], replace(SETTINGS, open_range=open_range, range_max=range_max))
        assert (grid.cells >= 0).sum() == known
        assert grid.cells.max() == (40 if known else -1)


def test_longer_beams_only_clear_up_to_the_limit() -> None:
    grid = build_grid(np.array([[0.05, 0.05, 0.0]]), [scan_of([7.0])], replace(SETTINGS, range_max=3.0))
    assert value_at(grid, 3.05, 0.05) == 40
    assert value_at(grid, 3.15, 0.05) == -1
    assert not (grid.cells >= 65).any()


@pytest.mark.parametrize("nothing", [math.nan, -math.inf, 0.0, -1.0, 0.04])
def test_an_invalid_range_changes_nothing(nothing: float) -> None:
    grid = build_grid(np.array([[0.0, 0.0, 0.0]]), [scan_of([nothing])], SETTINGS)
    assert (grid.cells == -1).all()


def test_impossible_input_is_refused_with_advice() -> None:
    good = scan_of([1.0])
    with pytest.raises(MapError, match="no scans"):
        build_grid(np.zeros((0, 3)), [])
    with pytest.raises(MapError, match="do not match 2 scans"):
        build_grid(np.zeros((1, 3)), [good, good])
    with pytest.raises(MapError, match="pose 1 is not finite"):
        build_grid(np.array([[0.0, 0.0, 0.0], [math.nan, 0.0, 0.0]]), [good, good])


@pytest.mark.parametrize("far", [1e5, 1e18, 1e300])
def test_an_impossible_extent_is_refused(far: float) -> None:
    poses = np.array([[0.0, 0.0, 0.0], [far, far, 0.0]])
    with pytest.raises(MapError, match="that can be planned on: check the poses for jumps"):
        build_grid(poses, [scan_of([1.0])] * 2)
    evidence = EvidenceGrid()
    evidence.add(poses[:1], poses[:1], [scan_of([1.0])])
    before = evidence.grid()
    with pytest.raises(MapError, match="check the poses for jumps"):
        evidence.add(poses, poses, [scan_of([1.0])] * 2)
    assert_same(evidence.grid(), before)


def test_in_the_map_of_a_real_log_its_own_scans_end_on_walls(data_dir: Path) -> None:
    recording = read_recording(data_dir / "lidar_radish_corrected" / "aces-corrected.log.gz")
    scans, poses = [], []
    for frame in recording.frames:
        assert frame.scan is not None
        assert isinstance(frame.wheels[0], Odometry)
        scans.append(frame.scan)
        poses.append(frame.wheels[0].odom_from_base.array())
    grid = build_grid(np.array(poses), scans, OccupancySettings(range_max=10.0))
    on_wall = in_free = 0
    for (x, y, theta), scan in zip(poses, scans, strict=True):
        near = scan.ranges < 5.0
        angles = scan.angles()[near] + theta
        ends = np.stack([x + scan.ranges[near] * np.cos(angles), y + scan.ranges[near] * np.sin(angles)], axis=1)
        values = grid.cells[tuple(cells_from_points(grid, ends).T)]
        on_wall += int((values >= 65).sum())
        in_free += int((values < 50).sum())
    assert on_wall > 0.75 * (on_wall + in_free)
    driven = grid.cells[tuple(cells_from_points(grid, np.array(poses)[:, :2]).T)]
    assert (driven < 50).all()
    assert (driven >= 0).all()


def test_each_beam_of_a_moving_sweep_is_drawn_from_its_own_pose() -> None:
    """A laser that drives 1 m along x while it sweeps: beam i of 11 leaves at 0.1 i, straight to the left."""
    scan = Scan(0, np.full(11, 2.0, np.float32), math.pi / 2, 1e-9, range_min=0.05, range_max=30.0)
    first, last = np.array([[0.05, 0.05, 0.0]]), np.array([[1.05, 0.05, 0.0]])
    hits = {cell for cell, value in by_cell(build_grid(first, [scan], SETTINGS, last)).items() if value == 70}
    assert hits == {(i, 20) for i in range(11)}


def test_a_turn_across_the_angle_pi_takes_the_short_way() -> None:
    scan = Scan(0, np.full(3, 2.0, np.float32), 0.0, 1e-9, range_min=0.05, range_max=30.0)
    first, last = np.array([[0.05, 0.05, math.pi - 0.1]]), np.array([[0.05, 0.05, 0.1 - math.pi]])
    assert value_at(build_grid(first, [scan], SETTINGS, last), -1.95, 0.05) == 70
