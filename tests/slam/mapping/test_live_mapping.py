"""A live map is available at any time of the drive, and finally equals the map of the recording."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.full_disk import content, files_up_to
from waychair.calibration.chair_body import ChairBody
from waychair.errors import NoScans, OutputError
from waychair.geometry import compose
from waychair.maps.folders.map_files import load_map
from waychair.maps.grid.cells import cells_from_points
from waychair.maps.grid.occupancy import build_grid
from waychair.maps.layers import grid_assembly
from waychair.offline.mapping import MappingSettings, live_result, map_recording, save_mapping
from waychair.recordings.recording import Recording, read_recording
from waychair.slam.graph.graph_optimisation import EdgeKind
from waychair.slam.mapping.live_mapping import LiveMapping
from waychair.types import FloatArray, ImuSample, OccupancyGrid, Odometry, Pose2, Scan, SensorFrame, Twist, WheelTicks

Drive = tuple[list[SensorFrame], FloatArray]


def anew(live: LiveMapping, frames: list[SensorFrame]) -> OccupancyGrid:
    """Return the mapper's kept scans, newly drawn at their poses; each scan is taken at one instant."""
    mapper = live.mapper
    numbers = sorted([*mapper.key_frames, *(n for latest in mapper.covered_frames for n in latest)])
    hung = [mapper.frames[number] for number in numbers]
    nodes = mapper.keys.poses[[frame.key for frame in hung]]
    key_from_laser = np.array([(frame.key_from_base @ live.base_from_laser).array() for frame in hung])
    scans = [scan for scan in (frames[number].scan for number in numbers) if scan is not None]
    return build_grid(compose(nodes, key_from_laser), scans, live.settings.grid)


def assert_same(found: OccupancyGrid, expected: OccupancyGrid) -> None:
    np.testing.assert_array_equal(found.cells, expected.cells)
    assert found.map_from_grid == expected.map_from_grid


def test_the_grid_follows_the_chair_and_after_loop_closures_equals_a_newly_drawn_one(drive: Drive) -> None:
    frames = drive[0]
    live = LiveMapping(MappingSettings(), Pose2())
    seen = []
    for k, frame in enumerate(frames):
        pose = live.process(frame)
        if k % 40 == 0:
            grid = live.grid()
            row, column = cells_from_points(grid, np.array([[pose.x, pose.y]]))[0]
            assert 0 <= grid.cells[row, column] < 50, "the chair stands on cells that it has seen free"
            seen.append(int((grid.cells >= 0).sum()))
    assert seen == sorted(seen)
    result = live.settle()
    assert any(edge.kind is EdgeKind.LOOP for edge in result.edges)
    assert live.pending == 0
    assert_same(live.grid(), anew(live, frames))


@pytest.mark.nightly
def test_without_tolerance_the_grid_is_up_to_date_if_nothing_is_pending(
    drive: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also while the mapper drops the oldest of the scans attached to a key scan."""
    frames = drive[0]
    monkeypatch.setattr(grid_assembly, "TOLERANCE", 0.0)
    live, bends, compared, dropped, before = LiveMapping(MappingSettings(), Pose2()), 0, 0, 0, np.empty((0, 3))
    for k, frame in enumerate([*frames, *frames[::-1]]):
        kept = sum(map(len, live.mapper.covered_frames))
        covered = live.mapper.counts["covered"]
        live.process(frame)
        dropped += live.mapper.counts["covered"] > covered and sum(map(len, live.mapper.covered_frames)) == kept
        poses = live.mapper.keys.poses
        bent, before = not np.array_equal(poses[: len(before)], before), poses.copy()
        bends += bent
        if (bent or k % 60 == 0) and live.pending == 0:
            assert_same(live.grid(), anew(live, [*frames, *frames[::-1]]))
            compared += 1
    assert bends > 0
    assert dropped > 0
    assert compared > 10


@pytest.mark.nightly
def test_mapping_the_recording_gives_the_same_map(drive: Drive, tmp_path: Path) -> None:
    frames, settings = drive[0], MappingSettings()
    live = LiveMapping(settings, Pose2())
    for frame in frames:
        live.process(frame)
    mapped = map_recording(Recording(tmp_path / "drive", tuple(frames), Pose2(), "simulated"), settings)
    assert_same(live_result(live, tmp_path / "drive", "live").grid, mapped.grid)


def test_mapping_continues_after_the_map_was_settled(drive: Drive) -> None:
    frames = drive[0]
    live = LiveMapping(MappingSettings(), Pose2())
    for k, frame in enumerate(frames):
        live.process(frame)
        if k in (0, 100, 250):
            live.settle()
            assert_same(live.grid(), anew(live, frames))
    live.settle()
    assert_same(live.grid(), anew(live, frames))


def test_a_resumed_mapping_gives_the_same_map(drive: Drive) -> None:
    frames = drive[0]
    whole, part = LiveMapping(MappingSettings(), Pose2()), LiveMapping(MappingSettings(), Pose2())
    for frame in frames[:300]:
        part.process(frame)
    resumed = LiveMapping(MappingSettings(), Pose2())
    resumed.resume(part.mapper, [resumed.reckon(frame) for frame in frames[:300]])
    for frame in frames:
        whole.process(frame)
    for frame in frames[300:]:
        resumed.process(frame)
    for live in (whole, resumed):
        live.settle()
    assert_same(resumed.grid(), whole.grid())


def test_a_live_map_is_saved_like_any_other(drive: Drive, tmp_path: Path) -> None:
    settings = MappingSettings()
    live = LiveMapping(settings, Pose2())
    for frame in drive[0][:80]:
        live.process(frame)
    mapping = live_result(live, Path("hall"), "live")
    save_mapping(tmp_path, mapping, settings)
    loaded = load_map(tmp_path)
    np.testing.assert_array_equal(loaded.cells >= 65, mapping.grid.cells >= 65)
    report = json.loads((tmp_path / "report.json").read_text())
    assert (report["input"], report["source"], report["frames"]) == ("hall", "live", 80)
    assert set(report["cpu_seconds"]) >= {"odometry", "grid", "tracking", "total"}


@pytest.mark.parametrize("room", [4_000, 20_000])
def test_on_a_full_disk_all_files_of_the_map_before_stay(drive: Drive, tmp_path: Path, room: int) -> None:
    settings, live = MappingSettings(), LiveMapping(MappingSettings(), Pose2())
    for frame in drive[0][:20]:
        live.process(frame)
    save_mapping(tmp_path, live_result(live, Path("hall"), "live"), settings)
    before = content(tmp_path)
    for frame in drive[0][20:60]:
        live.process(frame)
    longer = live_result(live, Path("hall"), "live")
    with files_up_to(room), pytest.raises(OutputError, match=rf"cannot write {tmp_path}/[a-z]+\.[a-z0-9]+: "):
        save_mapping(tmp_path, longer, settings)
    assert content(tmp_path) == before
    (tmp_path / ".together.killed").mkdir()
    save_mapping(tmp_path, longer, settings)
    now = content(tmp_path)
    assert now.keys() == before.keys()
    assert all(now[name] != before[name] for name in ("trajectory.tum", "graph.g2o", "map.pgm"))


def test_before_the_first_scan_the_map_is_empty_and_the_chair_is_at_the_origin() -> None:
    live = LiveMapping(MappingSettings(), Pose2())
    assert live.pose() == live.process(SensorFrame(0, wheels=(Odometry(0, Pose2(3.0, 2.0, 1.0)),))) == Pose2()
    assert (live.grid().cells == -1).all()
    assert live.pending == 0
    with pytest.raises(NoScans, match="no laser scan has come"):
        live.settle()


@pytest.mark.parametrize("radius", [0.165, 0.2])
def test_wheel_counts_are_read_with_the_body_of_the_given_chair(radius: float) -> None:
    """Wheels and IMU of frames without a scan count, too."""
    body = ChairBody(wheel_radius=radius)
    live = LiveMapping(MappingSettings(), Pose2(), body)
    per_metre = body.ticks_per_turn / (2 * np.pi * radius)
    for k in range(21):
        stamp, way = k * 100_000_000, 0.03 * k
        ticks = WheelTicks(stamp, round(way * per_metre), round(way * per_metre))
        sample = ImuSample(stamp, np.array([0.0, 0.0, 9.81]), np.zeros(3))
        # with an empty scan the wheels decide
        scan = Scan(stamp, np.full(90, np.inf, np.float32), -1.5, 0.033) if k % 5 == 0 else None
        live.process(SensorFrame(stamp, scan, wheels=(ticks,), imu=(sample,)))
    assert live.pose().x == pytest.approx(0.6, abs=0.03)
    assert len(live.mapper.frames) == 5


def test_beams_are_drawn_from_the_pose_of_the_laser_at_their_time() -> None:
    """A chair that drives 1 m while it sweeps sees a wall ahead 1 m nearer at the end; drawn, it is one wall."""
    mount, beams = Pose2(0.3, 0.0, 0.0), 101
    ranges = 5.0 - np.linspace(0.0, 1.0, beams)
    scan = Scan(0, ranges.astype(np.float32), -1e-3, 2e-5, 1.0 / (beams - 1), 0.05, 30.0)
    live = LiveMapping(MappingSettings(), mount)
    live.process(SensorFrame(0, scan, wheels=(Odometry(0, Pose2(), Twist(1.0, 0.0)),)))
    grid = live.grid()
    _, columns = np.nonzero(grid.cells >= 65)
    x = grid.map_from_grid.x + (columns + 0.5) * grid.resolution
    assert x.min() == pytest.approx(5.3, abs=0.06)
    assert x.max() == pytest.approx(5.3, abs=0.06)


def test_a_person_who_walks_ahead_of_the_chair_leaves_no_trail(drive: Drive) -> None:
    """The person crosses the chair's way repeatedly, 1.5 m ahead, while it drives."""
    frames, empty = [], []
    for k, frame in enumerate(drive[0][:150]):
        assert frame.scan is not None
        ranges = frame.scan.ranges.copy()
        middle = 90 + round(60 * np.sin(0.35 * k))
        ranges[middle - 4 : middle + 5] = np.minimum(ranges[middle - 4 : middle + 5], 1.5)
        frames.append(replace(frame, scan=replace(frame.scan, ranges=ranges)))
        empty.append(frame)
    with_person, without = (LiveMapping(MappingSettings(), Pose2()) for _ in range(2))
    for one, other in zip(frames, empty, strict=True):
        with_person.process(one)
        without.process(other)
    truth = {tuple(cell) for cell in occupied_points(without)}
    near = {(x + dx, y + dy) for x, y in truth for dx in range(-3, 4) for dy in range(-3, 4)}
    trail = [cell for cell in occupied_points(with_person) if tuple(cell) not in near]
    assert len(truth) > 200
    assert len(trail) <= 3


def occupied_points(live: LiveMapping) -> list[list[int]]:
    """Columns and rows of occupied cells, counted from the origin of map."""
    live.settle()
    grid = live.grid()
    low = np.rint(np.array([grid.map_from_grid.x, grid.map_from_grid.y]) / grid.resolution).astype(int)
    cells: list[list[int]] = (np.argwhere(grid.cells >= 65)[:, ::-1] + low).tolist()
    return cells


@pytest.mark.nightly
def test_a_real_log_mapped_live_gives_the_same_map_as_mapping_it_offline(data_dir: Path) -> None:
    recording = read_recording(data_dir / "lidar_fr079" / "fr079_laser.clf.gz")
    part = replace(recording, frames=recording.frames[:1000])
    live, most, drawn = LiveMapping(MappingSettings(), recording.base_from_laser), 0, []
    for frame in part.frames:
        live.reckon(frame)
        live.include(frame)
        drawn.append(live.draw())
        most = max(most, live.pending)
    mapping = map_recording(part, MappingSettings())
    live.settle()
    assert_same(live.grid(), mapping.grid)
    assert_same(live.grid(), anew(live, list(part.frames)))
    assert most > 50, "the closures have moved the map"
    beams = len(scan.ranges) if (scan := part.frames[0].scan) else 0
    assert max(drawn) <= grid_assembly.BEAMS_PER_CALL + 2 * beams
