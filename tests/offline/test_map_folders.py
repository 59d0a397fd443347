"""A map's folder is copied completely, and places and zones of one map never get onto another."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from waychair import config
from waychair.errors import OutputError
from waychair.maps.drawn.anchors import GRAPH
from waychair.maps.drawn.places import load_places
from waychair.maps.drawn.zones import Rule, Zone, load_zones
from waychair.maps.folders.depth_layer import DROP_OFF, drop_offs, load_depth_layer, save_depth_layer
from waychair.maps.folders.map_drawing import DrawingEditor
from waychair.maps.folders.map_files import load_map, save_map
from waychair.offline.map_folders import copy_map, refuse_drawn, refuse_other, set_aside
from waychair.offline.mapping import MappingSettings
from waychair.recordings.recording import write_tum
from waychair.types import OccupancyGrid, Place, Pose2, SensorFrame, Trajectory

SQUARE = np.array([[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]])


def grid(first: int) -> OccupancyGrid:
    cells = np.zeros((80, 100), np.int8)
    cells[first : first + 6, 20:30] = 100
    return OccupancyGrid(cells, 0.05)


@pytest.fixture
def known(tmp_path: Path) -> Path:
    """A map with a drop-off, nodes, a place, a zone and an erased part."""
    folder = tmp_path / "known"
    save_map(folder, grid(22))
    layer = np.zeros((80, 100), np.int8)
    layer[70:75, 50:60] = DROP_OFF
    save_depth_layer(folder, OccupancyGrid(layer, 0.05))
    (folder / GRAPH).write_text("VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 3 0 0\n")
    (folder / "session.npz").write_bytes(b"session")
    layout = DrawingEditor(folder)
    layout.set_place(Place("lift", Pose2(3.0, 3.0, 0.5)))
    layout.set_zone(Zone("stairs", Rule.KEEP_OUT, SQUARE + 1.5))
    layout.erase(SQUARE)
    return folder


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_copy_has_all_files_of_the_map(known: Path, tmp_path: Path) -> None:
    copy_map(known, tmp_path / "copy")
    copy = tmp_path / "copy"
    assert names(copy) == names(known)
    assert not load_map(copy).cells.any(), "erased parts are in the copy, too"
    layer = load_depth_layer(copy, load_map(copy))
    assert layer is not None
    assert drop_offs(layer).sum() == 50
    assert load_places(copy) == load_places(known)
    assert [zone.name for zone in load_zones(copy)] == ["stairs"]
    DrawingEditor(copy).undo()
    assert load_map(copy).cells.any(), "a change before the copy is undone in it"


def test_no_file_of_an_earlier_map_stays_beside_a_copy(known: Path, tmp_path: Path) -> None:
    folder = tmp_path / "old"
    save_map(folder, grid(2))
    save_depth_layer(folder, OccupancyGrid(np.full((80, 100), 100, np.int8), 0.05))
    (folder / "memory.db").write_bytes(b"places of another building")
    for name in ("depth.yaml", "depth.pgm", "session.npz"):
        (known / name).unlink()
    copy_map(known, folder)
    assert names(folder) == names(known)


def test_a_map_does_not_replace_another_one_with_drawings(known: Path, tmp_path: Path) -> None:
    folder = tmp_path / "other"
    save_map(folder, grid(2))
    DrawingEditor(folder).erase(SQUARE)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(OutputError, match="those of another map: choose another folder"):
        copy_map(known, folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_an_existing_copy_gets_later_drawings_and_they_can_be_undone(known: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    copy_map(known, copy)
    DrawingEditor(known).set_place(Place("desk", Pose2(1.0, 3.0, 0.0)))
    copy_map(known, copy)
    assert set(load_places(copy)) == {"lift", "desk"}
    DrawingEditor(copy).undo()
    assert set(load_places(copy)) == {"lift"}


def test_a_map_given_by_its_yaml_is_copied_as_map_yaml(tmp_path: Path) -> None:
    save_map(tmp_path, grid(2))
    save_map(tmp_path, grid(40), mode="scale", name="lab")
    copy_map(tmp_path / "lab.yaml", tmp_path / "copy")
    np.testing.assert_array_equal(load_map(tmp_path / "copy").cells, load_map(tmp_path / "lab.yaml").cells)


def test_a_map_is_not_copied_onto_itself(known: Path) -> None:
    before = {path.name: path.read_bytes() for path in known.iterdir()}
    copy_map(known / "map.yaml", known)
    assert {path.name: path.read_bytes() for path in known.iterdir()} == before


def test_an_impossible_folder_is_named(known: Path) -> None:
    with pytest.raises(OutputError, match=r"Not a directory"):
        copy_map(known, known / "map.yaml")


def test_a_folder_with_empty_lists_may_be_replaced_and_one_with_a_zone_may_not(known: Path, tmp_path: Path) -> None:
    layout = DrawingEditor(known)
    layout.remove_place("lift")
    layout.undo()
    with pytest.raises(OutputError, match="places, zones or erased parts"):
        refuse_drawn(known)
    for name, text in (("places.yaml", "{}\n"), ("zones.yaml", ""), ("erased.yaml", "[]\n")):
        (known / name).write_text(text)
    refuse_drawn(known)
    assert "anchors.yaml" not in names(known)


def test_a_map_of_the_same_drive_may_be_replaced_and_one_of_another_may_not(known: Path) -> None:
    settings = MappingSettings()
    config.save(settings, known / "config.yaml")
    stamps = np.arange(1, 6) * 1_000_000_001
    write_tum(known / "trajectory.tum", Trajectory(stamps, np.zeros((5, 3))))
    (known / "report.json").write_text('{"frames": 5}')
    frames = [SensorFrame(int(stamp)) for stamp in stamps]
    refuse_other(known, frames, settings)
    for others, other in (
        ([SensorFrame(frame.stamp_ns + 1) for frame in frames], settings),
        (frames, MappingSettings(vision="off")),
        ([], settings),
    ):
        with pytest.raises(OutputError, match="with --out, or join the drive to that map with --session"):
            refuse_other(known, others, other)
    (known / "report.json").write_text('{"session": {"number": 2}}')
    with pytest.raises(OutputError, match="another map"):
        refuse_other(known, frames, settings)
    assert set(load_places(known)) == {"lift"}


def test_a_map_with_drawings_is_set_aside_completely_under_a_free_name(known: Path, tmp_path: Path) -> None:
    shutil.copytree(known, tmp_path / "again")
    assert set_aside(known) == tmp_path / "known-1"
    assert set(load_places(tmp_path / "known-1")) == {"lift"}
    (tmp_path / "again").rename(known)
    assert set_aside(known) == tmp_path / "known-2"
    save_map(known, grid(2))
    assert set_aside(known) is None
