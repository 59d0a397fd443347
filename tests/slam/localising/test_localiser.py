"""Localisation: drift is corrected, a degraded pose is reported, lookalike places are not accepted."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.slam.conftest import WALLS, cast, scan_at
from waychair.maps.grid.cells import cells_from_points
from waychair.recordings.recording import read_recording
from waychair.slam.localising.localiser import (
    Localisation,
    LocalisationState,
    Localiser,
    LocaliserSettings,
    prepared_map,
    wall_points,
)
from waychair.types import FloatArray, OccupancyGrid, Odometry, Pose2, Scan


@pytest.fixture(scope="module")
def flat() -> OccupancyGrid:
    """The synthetic flat as a grid of 5 cm: walls occupied, the rest free."""
    grid = OccupancyGrid(np.zeros((200, 260), np.int8), 0.05, Pose2(-0.5, -0.5, 0.0))
    for x0, y0, x1, y1 in WALLS:
        share = np.linspace(0, 1, round(math.hypot(x1 - x0, y1 - y0) / 0.01) + 1)[:, None]
        cells = cells_from_points(grid, np.array([x0, y0]) + share * np.array([x1 - x0, y1 - y0]))
        grid.cells[cells[:, 0], cells[:, 1]] = 100
    return grid


def test_drifting_odometry_is_corrected_scan_by_scan(flat: OccupancyGrid) -> None:
    start = Pose2(1.5, 1.5, 0.0)
    localiser = Localiser(flat, Pose2(), start, LocaliserSettings())
    odometry = Pose2(7.0, -3.0, 1.0)  # odom is not map
    for k in range(80):
        truth = Pose2(1.5 + 0.1 * k, 1.5, 0.0)
        odometry = odometry @ Pose2(0.105 if k else 0.0, 0.0, 0.006 if k else 0.0)
        found = localiser.process(scan_at(truth, noise=0.01, seed=k), odometry)
        assert not found.lost
        assert math.hypot(found.map_from_base.x - truth.x, found.map_from_base.y - truth.y) < 0.06
        assert abs(found.map_from_base.theta) < 0.02
        assert (found.map_from_odom @ odometry).array() == pytest.approx(found.map_from_base.array(), abs=1e-9)


def test_with_a_blind_lidar_the_chair_is_lost_after_the_stated_number_of_scans(flat: OccupancyGrid) -> None:
    settings = LocaliserSettings(lost_scans=5)
    localiser = Localiser(flat, Pose2(), Pose2(1.5, 1.5, 0.0), settings)
    blind = Scan(0, np.full(181, np.inf, np.float32), -math.pi / 2, math.pi / 180, range_max=30.0)
    lost = [localiser.process(blind, Pose2(0.05 * k, 0, 0)).lost for k in range(6)]
    assert lost == [False] * 4 + [True] * 2


def drive_on(
    localiser: Localiser, truth: list[Pose2], odom_from_map: Pose2, beams: int = 181
) -> list[tuple[Localisation, float]]:
    """The localiser's output along true poses, with the distance [m] to them."""
    said = []
    for k, pose in enumerate(truth):
        found = localiser.process(scan_at(pose, noise=0.01, seed=k, beams=beams + k % 2), odom_from_map @ pose)
        said.append((found, math.hypot(found.map_from_base.x - pose.x, found.map_from_base.y - pose.y)))
    return said


def straight(start: Pose2, metres: float, step: float = 0.05) -> list[Pose2]:
    return [start @ Pose2(step * k, 0, 0) for k in range(round(metres / step))]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("start", [Pose2(1.5, 1.5, 0.0), Pose2(10.5, 7.5, math.pi), Pose2(10.3, 2.0, math.pi / 2)])
def test_a_chair_without_a_start_finds_its_place_within_three_metres_and_reports_ok_only_there(
    flat: OccupancyGrid, start: Pose2
) -> None:
    localiser = Localiser(flat, Pose2(), None, LocaliserSettings())
    said = drive_on(localiser, straight(start, 3.0), Pose2(-3.0, 8.0, 2.0))
    assert said[0][0].lost
    assert said[0][0].health == 0.0
    assert said[-1][0].state is LocalisationState.OK
    assert all(error < 0.1 for found, error in said if found.state is LocalisationState.OK)
    assert sum(found.jumped for found, _ in said) == 1


def test_a_blinded_chair_that_drove_on_searches_for_its_place_and_finds_it(flat: OccupancyGrid) -> None:
    localiser = Localiser(flat, Pose2(), Pose2(1.5, 1.5, 0.0), LocaliserSettings())
    blind = Scan(0, np.full(181, np.inf, np.float32), -math.pi / 2, math.pi / 180, range_max=30.0)
    for k in range(20):
        localiser.process(blind, Pose2(1.5 + 0.05 * k, 1.5, 0))
    said = drive_on(localiser, straight(Pose2(2.5, 1.5, 0.0), 3.0), Pose2())
    assert said[0][0].lost
    assert said[-1][0].state is LocalisationState.OK
    assert said[-1][1] < 0.1


def test_erased_parts_of_the_map_no_longer_lower_the_health(flat: OccupancyGrid) -> None:
    haunted = replace(flat, cells=flat.cells.copy())
    low, high = cells_from_points(flat, np.array([[2.6, 0.6], [3.4, 2.4]]))
    haunted.cells[low[0] : high[0], low[1] : high[1]] = 100  # a removed cupboard, right ahead
    settings, way = LocaliserSettings(), straight(Pose2(1.2, 1.5, 0.0), 1.0)
    localiser = Localiser(haunted, Pose2(), way[0], settings)
    before = [found.health for found, _ in drive_on(localiser, way[:10], Pose2())]
    localiser.replace_map(prepared_map(flat, settings))
    after = [found.health for found, _ in drive_on(localiser, way[10:], Pose2())]
    assert after[0] > max(before) + 0.05
    assert min(after) > 0.9


def test_a_lost_chair_searches_on_the_present_map(flat: OccupancyGrid) -> None:
    settings, bare = LocaliserSettings(), replace(flat, cells=np.zeros_like(flat.cells))
    localiser = Localiser(bare, Pose2(), None, settings)
    way = straight(Pose2(1.5, 1.5, 0.0), 3.5)
    assert all(found.lost for found, _ in drive_on(localiser, way[:10], Pose2()))
    localiser.replace_map(prepared_map(flat, settings))
    assert drive_on(localiser, way[10:], Pose2())[-1][0].state is LocalisationState.OK


def test_a_chair_lifted_to_another_place_is_never_ok_with_a_wrong_pose(flat: OccupancyGrid) -> None:
    localiser = Localiser(flat, Pose2(), Pose2(1.5, 1.5, 0.0), LocaliserSettings())
    before = straight(Pose2(1.5, 1.5, 0.0), 1.0)
    drive_on(localiser, before, Pose2())
    there = Pose2(10.5, 7.5, math.pi)
    said = drive_on(localiser, straight(there, 3.0), before[-1] @ there.inverse())
    assert all(error < 0.3 for found, error in said if found.state is LocalisationState.OK)
    assert any(found.lost for found, _ in said)
    assert said[-1][0].state is LocalisationState.OK


def test_a_pose_in_a_room_with_the_same_view_from_both_ends_is_never_accepted() -> None:
    grid = OccupancyGrid(np.zeros((120, 160), np.int8), 0.05)
    for edge in (grid.cells[:2], grid.cells[-2:], grid.cells[:, :2], grid.cells[:, -2:]):
        edge[:] = 100
    room = np.array(
        [[0.05, 0.05, 7.95, 0.05], [7.95, 0.05, 7.95, 5.95], [7.95, 5.95, 0.05, 5.95], [0.05, 5.95, 0.05, 0.05]]
    )
    angles = np.linspace(-math.pi / 2, math.pi / 2, 181)
    localiser = Localiser(grid, Pose2(), None, LocaliserSettings())
    for pose in straight(Pose2(2.0, 2.0, 0.3), 3.0):
        ranges = cast(room, pose, angles).astype(np.float32)
        found = localiser.process(Scan(0, ranges, -math.pi / 2, math.pi / 180, range_max=30.0), pose)
        assert found.lost
    assert len(found.candidates) >= 2


def test_a_pose_in_another_building_is_never_accepted(flat: OccupancyGrid, data_dir: Path) -> None:
    localiser = Localiser(flat, Pose2(), None, LocaliserSettings())
    for frame in read_recording(data_dir / "lidar_fr079" / "fr079_laser.clf.gz").frames[:120]:
        odometry = frame.wheels[-1]
        assert isinstance(odometry, Odometry)
        assert frame.scan is not None
        assert localiser.process(frame.scan, odometry.odom_from_base).lost


def test_a_map_without_walls_leaves_the_chair_lost_and_says_so() -> None:
    for start in (None, Pose2()):
        localiser = Localiser(OccupancyGrid(np.zeros((50, 50), np.int8), 0.05), Pose2(), start, LocaliserSettings())
        said = drive_on(localiser, straight(Pose2(1.0, 1.0, 0.0), 1.0), Pose2())
        assert said[-1][0].lost
        assert all(found.state is not LocalisationState.OK for found, _ in said)


def test_the_published_pose_moves_by_small_steps_and_reports_the_remaining_correction(
    flat: OccupancyGrid, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("waychair.slam.localising.localiser._STEP_DISTANCE", 0.01)
    monkeypatch.setattr("waychair.slam.localising.localiser._STEP_ANGLE", 0.005)
    localiser = Localiser(flat, Pose2(), Pose2(1.5, 1.5, 0.0), LocaliserSettings())
    slip, before, remaining = Pose2(0.12, -0.05, 0.05), None, []
    for k, pose in enumerate(straight(Pose2(1.5, 1.5, 0.0), 2.0)):
        odometry = pose if k < 10 else pose @ slip
        found = localiser.process(scan_at(pose, noise=0.01, seed=k), odometry)
        if before is not None:
            moved = (before @ odometry).inverse() @ found.map_from_base
            assert math.hypot(moved.x, moved.y) <= 0.01 + 1e-9
            assert abs(moved.theta) <= 0.005 + 1e-9
        told = found.map_from_base @ found.remaining
        assert math.hypot(told.x - pose.x, told.y - pose.y) < 0.05
        before = found.map_from_odom
        remaining.append(math.hypot(found.remaining.x, found.remaining.y))
    assert max(remaining) > 0.05
    assert remaining[-1] < 0.02


def test_a_start_with_an_error_of_half_a_metre_is_corrected_at_once(flat: OccupancyGrid) -> None:
    localiser = Localiser(flat, Pose2(), Pose2(1.9, 1.2, 0.3), LocaliserSettings())
    (first, error), *_ = drive_on(localiser, [Pose2(1.5, 1.5, 0.0)], Pose2())
    assert error < 0.05
    assert first.jumped
    assert first.state is LocalisationState.OK
    assert first.covariance is not None


def test_a_place_outside_of_the_map_is_not_accepted(flat: OccupancyGrid) -> None:
    localiser = Localiser(flat, Pose2(), Pose2(1.5, 1.5, 0.0), LocaliserSettings(lost_scans=1))
    elsewhere = np.array([[-40, -1.2, 40, -1.2], [-40, 9.7, 40, 9.7], [6.3, -30, 6.3, 30]], float)
    angles = np.linspace(-math.pi / 2, math.pi / 2, 181)
    ranges = cast(elsewhere, Pose2(0, 0.0, 0.35), angles).astype(np.float32)
    scan = Scan(0, ranges, -math.pi / 2, math.pi / 180, range_max=80.0)
    assert localiser.process(scan, Pose2()).inliers < 0.5


def test_walls_are_the_cells_next_to_free_ground_and_their_normals_point_there() -> None:
    cells = np.full((20, 20), -1, np.int8)
    cells[:, 10:] = 0
    cells[:, 9] = 100
    points, normals = wall_points(OccupancyGrid(cells, 0.1, Pose2(2.0, 3.0, 0.0)))
    assert points[:, 0] == pytest.approx(np.full(20, 2.95))
    assert normals == pytest.approx(np.tile([1.0, 0.0], (20, 1)), abs=1e-6)


def test_normals_of_an_oblique_wall_are_smooth() -> None:
    cells = np.zeros((60, 60), np.int8)
    for k in range(60):
        cells[k // 2 + 10, k] = 100
        cells[: k // 2 + 10, k] = -1
    _, normals = wall_points(OccupancyGrid(cells, 0.05, Pose2()))
    angles = np.degrees(np.arctan2(normals[10:-10, 1], normals[10:-10, 0]))
    assert np.median(angles) == pytest.approx(90 + math.degrees(math.atan(0.5)), abs=6)


def among(scan: Scan, people: FloatArray) -> Scan:
    """The scan with people (N, 2) [m] in front of the lidar, discs of 0.2 m."""
    bearings = scan.angle_min + scan.angle_step * np.arange(len(scan.ranges))
    ranges = scan.ranges.copy()
    for away, bearing in zip(np.hypot(*people.T), np.arctan2(*people.T[::-1]), strict=True):
        across, along = away * np.sin(bearings - bearing), away * np.cos(bearings - bearing)
        met = (np.abs(across) < 0.2) & (along > 0)
        ranges[met] = np.minimum(ranges[met], (along - np.sqrt(np.maximum(0.04 - across**2, 0.0)))[met])
    return replace(scan, ranges=ranges)


def crowd(rng: np.random.Generator, count: int) -> FloatArray:
    away, bearing = rng.uniform(0.6, 2.0, count), rng.uniform(-math.pi / 2, math.pi / 2, count)
    return np.column_stack([away * np.cos(bearing), away * np.sin(bearing)])


RING = np.array([[(0.7 + 0.5 * (k % 2)) * math.cos(a), (0.7 + 0.5 * (k % 2)) * math.sin(a)]
                 for k, a in enumerate(np.arange(-1.8, 1.81, 0.3))])  # fmt: skip
"""People in two rows that hide all walls."""


@pytest.mark.sampled(1)
@pytest.mark.parametrize("count", [3, 6, 10])
def test_a_chair_in_a_crowd_follows_the_visible_walls(flat: OccupancyGrid, count: int) -> None:
    localiser, rng = Localiser(flat, Pose2(), Pose2(1.5, 1.5, 0.0), LocaliserSettings()), np.random.default_rng(count)
    odometry = Pose2()
    for k, pose in enumerate(straight(Pose2(1.5, 1.5, 0.0), 8.0, 0.1)):
        odometry = odometry @ Pose2(0.102 if k else 0.0, 0.0, 0.002 if k else 0.0)
        found = localiser.process(among(scan_at(pose, noise=0.01, seed=k), crowd(rng, count)), odometry)
        assert not found.lost
        assert math.hypot(found.map_from_base.x - pose.x, found.map_from_base.y - pose.y) < 0.08


def test_a_chair_hidden_from_all_walls_is_degraded_and_lost_after_the_stated_distance(flat: OccupancyGrid) -> None:
    settings = LocaliserSettings(max_degraded_distance=2.0)
    localiser = Localiser(flat, Pose2(), Pose2(1.5, 1.5, 0.0), settings)
    localiser.process(scan_at(Pose2(1.5, 1.5, 0.0)), Pose2(1.5, 1.5, 0.0))
    for pose in straight(Pose2(1.5, 1.5, 0.0), 3.0):
        found = localiser.process(among(scan_at(pose), RING), pose)
        assert found.state is (LocalisationState.LOST if pose.x > 3.5 + 1e-6 else LocalisationState.DEGRADED)


def test_a_standing_chair_in_a_crowd_that_hides_all_walls_keeps_its_pose(flat: OccupancyGrid) -> None:
    here = Pose2(1.5, 1.5, 0.0)
    localiser = Localiser(flat, Pose2(), here, LocaliserSettings())
    localiser.process(scan_at(here), here)
    said = [localiser.process(among(scan_at(here, seed=k), RING), here) for k in range(100)]
    assert {found.state for found in said} == {LocalisationState.DEGRADED}
    assert localiser.process(scan_at(here), here).state is LocalisationState.OK


def test_changes_round_a_standing_chair_are_judged_when_it_drives_on(
    flat: OccupancyGrid,
) -> None:
    here, there = Pose2(1.5, 1.5, 0.0), Pose2(5.0, 5.0, 1.0)
    settings = LocaliserSettings()
    localiser = Localiser(flat, Pose2(), here, settings)
    localiser.process(scan_at(here), here)
    said = [localiser.process(scan_at(there, noise=0.01, seed=k), here) for k in range(100)]
    assert {found.state for found in said} == {LocalisationState.DEGRADED}
    on = [
        localiser.process(scan_at(there @ Pose2(way, 0.0, 0.0)), here @ Pose2(way, 0.0, 0.0))
        for way in np.arange(0.02, 0.3, 0.02)
    ]
    lost = [found.lost for found in on]
    assert lost.index(True) == round(0.05 / 0.02) + settings.lost_scans - 1


def test_a_chair_lifted_in_a_crowd_is_noticed(flat: OccupancyGrid) -> None:
    localiser, rng = Localiser(flat, Pose2(), Pose2(1.5, 1.5, 0.0), LocaliserSettings()), np.random.default_rng(0)
    for k, pose in enumerate(straight(Pose2(1.5, 1.5, 0.0), 1.0)):
        localiser.process(among(scan_at(pose, noise=0.01, seed=k), crowd(rng, 4)), pose)
    there = Pose2(10.5, 7.5, math.pi)
    here = Pose2(2.45, 1.5, 0.0)
    said = [
        localiser.process(among(scan_at(pose, noise=0.01), crowd(rng, 4)), here @ there.inverse() @ pose)
        for pose in straight(there, 1.0)
    ]
    assert any(found.lost for found in said[:10])
    assert all(found.state is not LocalisationState.OK for found in said)


def test_an_edge_drawn_as_a_wall_and_never_seen_does_not_lower_the_health(flat: OccupancyGrid) -> None:
    cells = flat.cells.copy()
    ends = np.column_stack([np.linspace(1.5, 10.5, 900), np.full(900, 0.5)])  # along the way, 1 m beside it
    drawn = cells_from_points(flat, ends)
    cells[drawn[:, 0], drawn[:, 1]] = 100
    localiser = Localiser(replace(flat, cells=cells), Pose2(), Pose2(1.5, 1.5, 0.0), LocaliserSettings())
    for found, error in drive_on(localiser, straight(Pose2(1.5, 1.5, 0.0), 5.0, 0.1), Pose2()):
        assert found.state is LocalisationState.OK
        assert error < 0.08
