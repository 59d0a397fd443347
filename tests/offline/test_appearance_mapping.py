"""A recording with pictures gives a map with a memory of its places; one without gives a plain map."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.slam.flat_pictures import BASE_FROM_CAMERA, picture_at
from waychair.errors import MapError, MapNotFound, OutputError
from waychair.files import write_json
from waychair.offline.mapping import Mapping, MappingSettings, map_recording, save_mapping
from waychair.offline.memory_file import MEMORY
from waychair.offline.paper_tables import paper_tables, read_report
from waychair.recordings.recording import Recording
from waychair.slam.memory.memory_manager import NodeMemory
from waychair.types import FloatArray, Json, Pose2, SensorFrame

Drive = tuple[list[SensorFrame], FloatArray]

BLIND = MappingSettings(vision="off")


@pytest.fixture(scope="module")
def recording(drive: Drive) -> Recording:
    """Every third frame of two laps, with a picture every 0.9 s."""
    frames, truth = drive[0][::3], drive[1][::3]
    pictures = [
        picture_at(Pose2(*pose.tolist()), frame.stamp_ns)
        for frame, pose in zip(frames[::3], truth[::3], strict=True)
    ]  # fmt: skip
    return Recording(
        Path("flat"),
        tuple(frames),
        Pose2(),
        "made",
        pictures=lambda: iter(pictures),
        camera_mount=lambda: BASE_FROM_CAMERA,
    )


@pytest.fixture(scope="module")
def made(recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Mapping]:
    folder, settings = tmp_path_factory.mktemp("flat"), MappingSettings()
    mapping = map_recording(recording, replace(settings, depth=replace(settings.depth, use="off")), keep_in=folder)
    save_mapping(folder, mapping, settings)
    return folder, mapping


def test_the_memory_lies_in_the_map_folder_and_opens_again(made: tuple[Path, Mapping]) -> None:
    folder, mapping = made
    told = mapping.report["memory"]
    memory = NodeMemory.opened(folder / MEMORY)
    assert len(memory.skeleton.ids()) == told["memory"]["frames"] == told["pictures"] >= 70
    assert sum(told["links"].values()) >= 20
    np.testing.assert_allclose(memory.anchors, mapping.result.key_poses, atol=1e-5)
    memory.close()


def test_the_report_counts_words_nodes_and_times(made: tuple[Path, Mapping]) -> None:
    told = made[1].report["memory"]
    counts = told["memory"]
    assert counts["stm"] == 10
    assert counts["stm"] + counts["wm"] + counts["ltm"] == counts["frames"]
    assert counts["words"] <= told["words_made"] <= told["references"]
    assert 1 <= told["revisits"] <= 3
    assert 0.0 < told["per_picture"]["extraction_ms"] < told["per_picture"]["total_ms"]


def test_a_new_map_does_not_use_the_memory_of_another(recording: Recording, tmp_path: Path) -> None:
    short = replace(recording, frames=recording.frames[:30])
    counts = [map_recording(short, MappingSettings(), keep_in=tmp_path).report["memory"]["memory"] for _ in range(2)]
    assert counts[0] == counts[1]


def test_a_folder_that_is_a_file_is_named_before_anything_is_mapped(recording: Recording, tmp_path: Path) -> None:
    (tmp_path / "map").write_text("")
    with pytest.raises(OutputError, match="choose another folder"):
        map_recording(recording, MappingSettings(), keep_in=tmp_path / "map")


def test_pictures_after_the_last_scan_are_counted(recording: Recording) -> None:
    short = replace(recording, frames=recording.frames[:30])
    told = map_recording(short, MappingSettings()).report["memory"]
    assert told["pictures"] == 10
    assert told["left_out"]["pictures after the last scan"] == len(list(recording.pictures())) - 10


def test_without_vision_the_map_is_that_of_a_recording_without_pictures(recording: Recording) -> None:
    blind = replace(recording, pictures=lambda: iter(()), camera_mount=lambda: None)
    off = replace(BLIND, depth=replace(BLIND.depth, use="off"))
    maps = [map_recording(recording, off), map_recording(blind, MappingSettings())]
    for mapping in maps:
        assert "memory" not in mapping.report
    np.testing.assert_array_equal(maps[0].result.trajectory.poses, maps[1].result.trajectory.poses)
    np.testing.assert_array_equal(maps[0].grid.cells, maps[1].grid.cells)


def test_tables_of_two_maps_are_shown_beside_the_published_ones(made: tuple[Path, Mapping]) -> None:
    report = read_report(made[0])
    second, basement, per_frame = paper_tables([report, report])
    assert [row[3] for row in second.rows if row[3]] == ["203.243", "630525", "1050", "10", "1498", "427", "3"]
    assert [row[3] for row in basement.rows if row[3]] == ["140.414", "354702", "550", "10", "870", "132", "4"]
    assert [row[3] for row in per_frame.rows] == ["+0.00"] * 4
    assert all(len(row) == len(table.heads) for table in (second, basement, per_frame) for row in table.rows)


def test_a_single_map_has_no_growth(made: tuple[Path, Mapping]) -> None:
    tables = paper_tables([read_report(made[0])])
    assert len(tables) == 2
    assert [row[2:4] for row in tables[-1].rows] == [("", "")] * 4


@pytest.mark.parametrize(
    ("report", "error", "told"),
    [
        (None, MapNotFound, "report.json"),
        ({"distance_m": 1.0}, MapError, "without pictures"),
        ([], MapError, "without pictures"),
    ],
)
def test_a_folder_without_a_memory_is_refused_with_advice(
    report: Json | None, error: type[Exception], told: str, tmp_path: Path
) -> None:
    if report is not None:
        write_json(tmp_path / "report.json", report)
    with pytest.raises(error, match=told):
        read_report(tmp_path)


def test_a_report_that_is_no_json_is_refused(tmp_path: Path) -> None:
    (tmp_path / "report.json").write_text("{")
    with pytest.raises(MapError, match="cannot read"):
        read_report(tmp_path)
