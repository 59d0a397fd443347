"""Two drives through one building give one map; a drive that cannot be joined leaves the map unchanged."""

from __future__ import annotations

import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.slam.conftest import cast
from tests.slam.flat_pictures import BASE_FROM_CAMERA, picture_at
from waychair.errors import SessionError, WaychairError
from waychair.geometry import compose, invert
from waychair.maps.folders.map_files import load_map
from waychair.offline.mapping import Mapping, MappingSettings, join_recording, map_recording, save_mapping
from waychair.offline.memory_file import MEMORY
from waychair.offline.sessions import SESSION, load_state, replaced_folder
from waychair.recordings.recording import Recording, read_tum
from waychair.slam.graph.edges import EdgeKind
from waychair.slam.localising.localiser import Localisation, LocalisationState, Localiser
from waychair.slam.mapping.depth_mapping import DepthMappingSettings
from waychair.slam.mapping.loop_candidates import LoopSettings
from waychair.slam.mapping.mapper import MapperSettings
from waychair.slam.memory.memory_manager import NodeMemory
from waychair.types import FloatArray, Odometry, Pose2, Scan, SensorFrame, Trajectory

Drive = tuple[list[SensorFrame], FloatArray]

SETTINGS = MappingSettings(vision="off")
FLAT = DepthMappingSettings(use="off")
SEEING = MappingSettings(mapper=MapperSettings(loops=LoopSettings(submap_spacing=100.0)), depth=FLAT)
"""The lidar does not look for submaps in a drive that is shorter."""


def part(drive: Drive, first: int, last: int, day: int) -> tuple[Recording, Trajectory]:
    """Frames of the drive as if on another day, its odometry from anywhere; and the truth."""
    moved, later = Pose2(3.0 * day, -2.0, 0.7 * day), day * 86_400 * 10**9
    frames = []
    for frame in drive[0][first:last]:
        own, scan = frame.wheels[-1], frame.scan
        assert isinstance(own, Odometry)
        assert scan is not None
        stamp = frame.stamp_ns + later
        reading = Odometry(stamp, moved @ own.odom_from_base)
        frames.append(SensorFrame(stamp, replace(scan, stamp_ns=stamp), wheels=(reading,)))
    truth = Trajectory(np.array([frame.stamp_ns for frame in frames]), drive[1][first:last])
    return Recording(Path(f"day-{day}"), tuple(frames), Pose2(), "made"), truth


def with_pictures(recording: Recording, truth: Trajectory) -> Recording:
    """One every 0.9 s."""
    pictures = [
        picture_at(Pose2(*pose.tolist()), frame.stamp_ns)
        for frame, pose in zip(recording.frames[::3], truth.poses[::3], strict=True)
    ]
    return replace(recording, pictures=lambda: iter(pictures), camera_mount=lambda: BASE_FROM_CAMERA)


def mapped(recording: Recording, folder: Path, settings: MappingSettings = SETTINGS) -> Mapping:
    keep_in = None if recording.camera_mount() is None else folder
    mapping = map_recording(recording, settings, keep_in=keep_in)
    save_mapping(folder, mapping, settings)
    return mapping


def joined(recording: Recording, folder: Path, settings: MappingSettings = SETTINGS) -> Mapping:
    with replaced_folder(folder, folder) as aside:
        mapping = join_recording(recording, settings, folder, aside)
        save_mapping(aside, mapping, settings)
    return mapping


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def across(first: Mapping, then: Trajectory, second: Mapping, now: Trajectory) -> float:
    """Return the largest error [m] of the second drive on the map of both, relative to the start of the first one.

    The start of the first trajectory is the origin of both maps.
    """
    assert np.allclose(first.result.trajectory.poses[0], 0.0, atol=1e-6)
    true = compose(invert(then.poses[:1]), now.poses)
    return float(np.hypot(*(second.result.drive_trajectory.poses - true)[:, :2].T).max())


@pytest.fixture(scope="module")
def day_one(drive: Drive, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Mapping, Trajectory]:
    """The map of the first lap and the first leg of the second."""
    recording, truth = part(drive, 0, len(drive[0]) // 2 + 60, 0)
    folder = tmp_path_factory.mktemp("one") / "map"
    return folder, mapped(recording, folder), truth


@pytest.fixture
def folder(day_one: tuple[Path, Mapping, Trajectory], tmp_path: Path) -> Path:
    """A copy of the map of day one, with a list of places."""
    shutil.copytree(day_one[0], tmp_path / "map")
    (tmp_path / "map" / "places.yaml").write_text("door: [1.0, 0.0, 0.0]\n")
    return tmp_path / "map"


@pytest.mark.parametrize("first", [0, *(pytest.param(k, marks=pytest.mark.nightly) for k in (130, 215))])
def test_a_drive_of_another_day_becomes_part_of_the_map(
    drive: Drive, day_one: tuple[Path, Mapping, Trajectory], folder: Path, first: int
) -> None:
    half = len(drive[0]) // 2
    recording, truth = part(drive, half + first - 60, len(drive[0]), 1)
    both = joined(recording, folder)
    _, one, then = day_one
    assert both.report["session"]["began_on_known_ground"]
    assert both.report["session"]["number"] == 2
    assert len(both.result.key_poses) <= 1.3 * len(one.result.key_poses)
    assert both.result.edges
    assert not any(edge.kind is EdgeKind.UNKNOWN for edge in both.result.edges)
    assert across(one, then, both, truth) < 0.15
    assert len(read_tum(folder / "trajectory.tum").stamps_ns) == len(recording.frames)
    assert (folder / "places.yaml").exists()
    assert len(load_map(folder).cells) == len(both.grid.cells)


@pytest.mark.nightly
def test_a_drive_that_begins_outside_of_the_map_is_joined_where_it_meets_the_map(drive: Drive, tmp_path: Path) -> None:
    lap = len(drive[0]) // 2
    recording, then = part(drive, 0, lap // 2, 0)
    one = mapped(recording, tmp_path / "map")
    further, truth = part(drive, lap - 60, lap + lap // 2, 1)
    both = joined(further, tmp_path / "map")
    pieces = [edge for edge in both.result.edges if edge.kind is EdgeKind.LOOP]
    assert pieces or both.report["session"]["began_on_known_ground"]
    assert across(one, then, both, truth) < 0.25
    assert both.report["grid"]["known_m2"] > one.report["grid"]["known_m2"]


@pytest.mark.nightly
@pytest.mark.parametrize("days", [2, pytest.param(3, marks=pytest.mark.nightly)])
def test_day_after_day_the_map_does_not_grow(
    drive: Drive, folder: Path, day_one: tuple[Path, Mapping, Trajectory], days: int
) -> None:
    half, count = len(drive[0]) // 2, len(day_one[1].result.key_poses)
    for day in range(1, days + 1):
        recording, truth = part(drive, half - 40 * day, len(drive[0]) - 30, day)
        both = joined(recording, folder)
        assert len(both.result.key_poses) <= 1.3 * count
        assert across(day_one[1], day_one[2], both, truth) < 0.15
    assert load_state(folder).sessions == days + 1
    assert len(load_state(folder).scans) <= 4 * len(both.result.key_poses)  # a key scan and three that it covers


@pytest.fixture
def lidar_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """By scans alone the chair never finds its place."""
    lost = Localisation(Pose2(), Pose2(), 0.0, LocalisationState.LOST, 0.0)
    monkeypatch.setattr(Localiser, "process", lambda *_: lost)


@pytest.mark.usefixtures("lidar_lost")
@pytest.mark.nightly
def test_two_days_are_joined_by_pictures_and_their_nodes_merge(drive: Drive, tmp_path: Path) -> None:
    every = (drive[0][::3], drive[1][::3])
    lap = len(every[0]) // 2
    recording, then = part(every, 0, lap + 10, 0)
    one = mapped(with_pictures(recording, then), tmp_path / "map", SEEING)
    further, truth = part(every, lap, 2 * lap, 1)
    both = joined(with_pictures(further, truth), tmp_path / "map", SEEING)
    assert across(one, then, both, truth) < 0.25
    assert both.report["memory"]["links"]["by appearance"] > 0
    assert "camera" in both.report
    memory = NodeMemory.opened(tmp_path / "map" / MEMORY)
    assert len(memory.skeleton.ids()) <= 1.3 * one.report["memory"]["memory"]["frames"]
    assert set(memory.skeleton.rows["map_id"][memory.skeleton.ids()].tolist()) >= {0}
    np.testing.assert_allclose(memory.anchors, both.result.key_poses, atol=1e-5)
    memory.close()


def test_a_drive_without_pictures_keeps_the_memory_of_the_places(drive: Drive, tmp_path: Path) -> None:
    every = (drive[0][::3], drive[1][::3])
    lap = len(every[0]) // 2
    recording, truth = part(every, 0, lap + 10, 0)
    one = mapped(with_pictures(recording, truth), tmp_path / "map", MappingSettings(depth=FLAT))
    both = joined(part(every, lap, 2 * lap, 1)[0], tmp_path / "map", MappingSettings(depth=FLAT))
    memory = NodeMemory.opened(tmp_path / "map" / MEMORY)
    assert len(memory.skeleton.ids()) == one.report["memory"]["memory"]["frames"]
    np.testing.assert_allclose(memory.anchors, both.result.key_poses, atol=1e-5)
    memory.close()


@pytest.mark.nightly
def test_a_damaged_memory_is_set_aside_and_reported_and_the_map_stays_usable(drive: Drive, tmp_path: Path) -> None:
    every = (drive[0][::3], drive[1][::3])
    lap = len(every[0]) // 2
    recording, truth = part(every, 0, lap + 10, 0)
    mapped(with_pictures(recording, truth), tmp_path / "map", MappingSettings(depth=FLAT))
    (tmp_path / "map" / MEMORY).write_bytes(b"no database" * 100)
    further, truth = part(every, lap, 2 * lap, 1)
    both = joined(with_pictures(further, truth), tmp_path / "map", MappingSettings(depth=FLAT))
    assert [warning for warning in both.report["warnings"] if "is damaged" in warning]
    assert (tmp_path / "map" / f"{MEMORY}.damaged-1").exists()
    assert both.report["memory"]["pictures"] > 10


def elsewhere() -> Recording:
    """A drive through another building."""
    walls = np.array(
        [[0, 0, 6, 0], [6, 0, 7, 4], [7, 4, 3, 7], [3, 7, 0, 5], [0, 5, 0, 0], [2, 0, 2.5, 1], [5, 5, 4.5, 4]], float
    )
    frames, angles = [], np.linspace(-math.pi / 2, math.pi / 2, 181)
    for k in range(120):
        turn = 0.05 * k
        pose = Pose2(3.0 + 1.2 * math.sin(turn), 1.8 + 1.2 * (1.0 - math.cos(turn)), turn)
        scan = Scan(k, cast(walls, pose, angles).astype(np.float32), -math.pi / 2, math.pi / 180, range_max=30.0)
        frames.append(SensorFrame(k * 10**8, scan, wheels=(Odometry(k * 10**8, pose),)))
    return Recording(Path("elsewhere"), tuple(frames), Pose2(), "made")


def refusals(drive: Drive) -> dict[str, tuple[Recording, MappingSettings, str]]:
    recording, _ = part(drive, 100, 200, 1)
    return {
        "another building": (elsewhere(), SETTINGS, "recognised nowhere on the map"),
        "another laser": (replace(recording, base_from_laser=Pose2(0.3)), SETTINGS, "map it by itself"),
        "another height": (recording, replace(SETTINGS, laser_height=0.6), "0.60 m"),
        "pictures alone": (recording, replace(SETTINGS, depth=replace(SETTINGS.depth, use="only")), "--depth only"),
        "no scan": (replace(recording, frames=()), SETTINGS, "no laser scan"),
    }


@pytest.mark.sampled(2)
@pytest.mark.parametrize("why", ["another building", "another laser", "another height", "pictures alone", "no scan"])
def test_a_drive_that_cannot_be_joined_is_refused_and_the_map_stays_unchanged(
    drive: Drive, folder: Path, why: str
) -> None:
    recording, settings, told = refusals(drive)[why]
    before = contents(folder)
    with pytest.raises(WaychairError, match=told):
        joined(recording, folder, settings)
    assert contents(folder) == before
    assert [path.name for path in folder.parent.iterdir()] == ["map"]


@pytest.mark.parametrize("damage", [None, b"", b"PK\x03\x04 nonsense", "short"])
def test_a_map_without_data_to_continue_from_is_refused_with_advice(
    drive: Drive, folder: Path, damage: bytes | str | None
) -> None:
    path = folder / SESSION
    whole = path.read_bytes()
    path.unlink()
    if damage is not None:
        path.write_bytes(damage if isinstance(damage, bytes) else whole[: len(whole) // 2])
    with pytest.raises(SessionError, match="map its recording again"):
        joined(part(drive, 100, 200, 1)[0], folder)


def test_an_interrupted_join_leaves_the_map_unchanged(drive: Drive, folder: Path) -> None:
    before = contents(folder)

    def stop(share: float) -> None:
        if share > 0.5:
            raise KeyboardInterrupt

    recording, _ = part(drive, 100, 300, 1)
    with pytest.raises(KeyboardInterrupt), replaced_folder(folder, folder) as aside:
        join_recording(recording, SETTINGS, folder, aside, stop)
    assert contents(folder) == before
    assert [path.name for path in folder.parent.iterdir()] == ["map"]


def test_the_map_of_both_may_be_written_elsewhere(drive: Drive, folder: Path) -> None:
    before = contents(folder)
    with replaced_folder(folder.parent / "both", folder) as aside:
        mapping = join_recording(part(drive, 100, 250, 1)[0], SETTINGS, folder, aside)
        save_mapping(aside, mapping, SETTINGS)
    assert contents(folder) == before
    assert load_state(folder.parent / "both").sessions == 2
