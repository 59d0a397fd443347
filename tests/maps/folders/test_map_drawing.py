"""Drawings on a map: kept as text, undone, and moved with the map's nodes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.errors import MapError, PlaceError, UnknownPlace, WaychairError, ZoneError
from waychair.maps.drawn.anchors import ANCHORS_YAML, GRAPH, load_anchors, load_nodes
from waychair.maps.drawn.erased import ERASED_YAML, load_erased
from waychair.maps.drawn.places import load_places, save_places
from waychair.maps.drawn.zones import Rule, Zone, load_zones
from waychair.maps.folders.depth_layer import DROP_OFF, save_depth_layer
from waychair.maps.folders.map_drawing import MOST_UNDONE, DrawingEditor
from waychair.maps.folders.map_files import load_map, save_map
from waychair.types import FloatArray, OccupancyGrid, Place, Pose2

SQUARE = np.array([[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]])
ASIDE, ALONG = np.array([3.5, -1.5]), np.array([1.0, 0.0, 0.0])
NODES = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.3], [5.0, 5.0, 1.6]])


def write_graph(folder: Path, nodes: FloatArray) -> None:
    lines = [f"VERTEX_SE2 {k} {x!r} {y!r} {theta!r}" for k, (x, y, theta) in enumerate(nodes.tolist())]
    (folder / GRAPH).write_text("\n".join([*lines, "EDGE_SE2 0 1 5 0 0.3 1 0 0 1 0 1"]))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    cells = np.zeros((120, 120), np.int8)
    cells[30:34, 30:34] = 100
    save_map(tmp_path, OccupancyGrid(cells, 0.05))
    write_graph(tmp_path, NODES)
    return tmp_path


def test_places_and_zones_are_read_back_as_they_were_drawn(folder: Path) -> None:
    layout = DrawingEditor(folder)
    layout.set_place(Place("bed", Pose2(1.0, 2.0, 0.5), 0.05, math.radians(2.0)))
    layout.set_zone(Zone("ward", Rule.SLOW, SQUARE, 0.3))
    layout.set_zone(Zone("ramp", Rule.ONE_WAY, SQUARE + 2.0, 1.5))
    again = DrawingEditor(folder).drawing
    assert again.places == layout.drawing.places == load_places(folder)
    assert [(zone.name, zone.rule, zone.value) for zone in again.zones] == [
        ("ward", Rule.SLOW, 0.3),
        ("ramp", Rule.ONE_WAY, 1.5),
    ]
    assert np.array_equal(load_zones(folder)[0].polygon, SQUARE)


def test_erased_parts_are_free_floor_for_every_reader_of_the_map(folder: Path) -> None:
    before = load_map(folder)
    DrawingEditor(folder).erase(SQUARE)
    after = load_map(folder / "map.yaml")
    assert before.cells[31, 31] == 100
    assert not after.cells.any()
    assert "P5" in (folder / "map.pgm").read_bytes()[:2].decode()


def test_a_drop_off_cannot_be_erased(folder: Path) -> None:
    cells = np.zeros((120, 120), np.int8)
    cells[32, 32] = DROP_OFF
    save_depth_layer(folder, OccupancyGrid(cells, 0.05))
    layout = DrawingEditor(folder)
    with pytest.raises(ZoneError, match="drop-off in this part"):
        layout.erase(SQUARE)
    assert load_erased(folder) == ()
    layout.erase(SQUARE + 1.0)
    assert len(load_erased(folder)) == 1


def test_parts_are_erased_from_a_map_given_by_its_yaml(folder: Path) -> None:
    save_map(folder, load_map(folder), name="lab")
    (folder / "map.yaml").unlink()
    DrawingEditor(folder / "lab.yaml").erase(SQUARE)
    assert not load_map(folder / "lab.yaml").cells.any()


def test_every_change_is_undone_in_reverse_order(folder: Path) -> None:
    save_places(folder, {"door": Place("door", Pose2(3.0, 3.0))})
    layout = DrawingEditor(folder)
    texts = []
    for change in (
        lambda: layout.set_place(Place("bed", Pose2(1.0, 2.0))),
        lambda: layout.set_zone(Zone("stairs", Rule.KEEP_OUT, SQUARE)),
        lambda: layout.erase(SQUARE),
        lambda: layout.remove_place("door"),
        lambda: layout.remove_zone("stairs"),
    ):
        texts.append({path.name: path.read_text() for path in folder.glob("*.yaml") if path.name != "undo.yaml"})
        change()
    assert layout.undoable
    for before in reversed(texts):
        layout = DrawingEditor(folder)  # also after a new start
        layout.undo()
        now = {path.name: path.read_text() for path in folder.glob("*.yaml") if path.name != "undo.yaml"}
        assert now == before
    assert not layout.undoable
    with pytest.raises(PlaceError, match="nothing to undo"):
        layout.undo()


def test_an_empty_list_means_no_places_or_zones_and_an_empty_file_is_damaged(folder: Path) -> None:
    layout = DrawingEditor(folder)
    layout.set_zone(Zone("stairs", Rule.KEEP_OUT, SQUARE))
    layout.remove_zone("stairs")
    for name, text, load in (
        ("places.yaml", "{}\n", load_places),
        ("zones.yaml", "{}\n", load_zones),
        (ERASED_YAML, "[]\n", load_erased),
    ):
        path = folder / name
        assert path.read_text() == text
        assert not load(folder)
        path.write_bytes(b"")
        with pytest.raises(WaychairError, match=f"{name} is empty, as after a power cut: restore a copy"):
            load(folder)
        path.write_text(text)


def test_a_change_from_a_version_without_empty_lists_is_undone(folder: Path) -> None:
    layout = DrawingEditor(folder)
    layout.set_place(Place("lift", Pose2(1.0, 1.0, 0.0)))
    (folder / "undo.yaml").write_text("- {places.yaml: '', zones.yaml: ''}\n")
    layout.undo()
    assert DrawingEditor(folder).drawing.places == {}


@pytest.mark.nightly
def test_the_number_of_kept_changes_is_limited(folder: Path) -> None:
    layout = DrawingEditor(folder)
    for k in range(MOST_UNDONE + 5):
        layout.set_place(Place(f"p{k}", Pose2(1.0, 1.0)))
    for _ in range(MOST_UNDONE):
        layout.undo()
    assert not layout.undoable
    assert list(layout.drawing.places) == [f"p{k}" for k in range(5)]


@pytest.mark.parametrize(
    ("change", "error"),
    [
        (lambda layout: layout.remove_place("nowhere"), UnknownPlace),
        (lambda layout: layout.remove_zone("nowhere"), ZoneError),
        (lambda layout: layout.set_place(Place(" ", Pose2())), PlaceError),
        (lambda layout: layout.set_place(Place("a", Pose2(math.nan))), PlaceError),
        (lambda layout: layout.set_zone(Zone("a", Rule.SLOW, SQUARE, 0.0)), ZoneError),
        (lambda layout: layout.set_zone(Zone("a\n", Rule.KEEP_OUT, SQUARE)), ZoneError),
        (lambda layout: layout.set_zone(Zone("a", Rule.ONE_WAY, SQUARE, math.inf)), ZoneError),
        (lambda layout: layout.erase(SQUARE[:2]), ZoneError),
        (lambda layout: layout.erase(np.zeros((4, 2))), ZoneError),
    ],
)
def test_a_refused_change_alters_nothing(folder: Path, change: object, error: type[WaychairError]) -> None:
    layout = DrawingEditor(folder)
    layout.set_place(Place("bed", Pose2(1.0, 2.0)))
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(error):
        change(layout)  # type: ignore[operator]
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_drawings_follow_the_nodes_of_a_corrected_map(folder: Path) -> None:
    layout = DrawingEditor(folder)
    layout.set_place(Place("bed", Pose2(5.2, 4.8, 0.5)))
    layout.set_place(Place("door", Pose2(0.3, 0.1, 0.0)))
    layout.set_zone(Zone("ramp", Rule.ONE_WAY, SQUARE + 3.0, 0.2))
    layout.erase(SQUARE + ASIDE)
    bent = Pose2(0.4, -0.2, 0.1)
    moved = [Pose2(*NODES[0])] + [bent @ Pose2(*node) for node in NODES[1:]]
    write_graph(folder, np.array([pose.array() for pose in moved]))
    places, (ramp,), (erased,) = load_places(folder), load_zones(folder), load_erased(folder)
    assert places["bed"].pose.array() == pytest.approx((bent @ Pose2(5.2, 4.8, 0.5)).array(), abs=1e-9)
    assert places["door"].pose.array() == pytest.approx([0.3, 0.1, 0.0], abs=1e-9)
    assert ramp.value == pytest.approx(0.3)
    assert ramp.polygon == pytest.approx(_moved(bent, SQUARE + 3.0))
    assert erased == pytest.approx(_moved(bent, SQUARE + ASIDE))
    assert DrawingEditor(folder).drawing.places == places


def test_a_change_after_a_correction_writes_all_present_positions(folder: Path) -> None:
    layout = DrawingEditor(folder)
    layout.set_place(Place("bed", Pose2(5.2, 4.8, 0.5)))
    write_graph(folder, NODES + ALONG)
    DrawingEditor(folder).set_place(Place("door", Pose2(1.0, 1.0)))
    (folder / ANCHORS_YAML).unlink()
    assert load_places(folder)["bed"].pose.array() == pytest.approx([6.2, 4.8, 0.5], abs=1e-9)


def test_a_place_edited_by_hand_stays_where_it_was_put(folder: Path) -> None:
    DrawingEditor(folder).set_place(Place("bed", Pose2(5.2, 4.8, 0.5)))
    text = (folder / "places.yaml").read_text()
    (folder / "places.yaml").write_text(text.replace("5.2", "5.3"))
    write_graph(folder, NODES + ALONG)
    assert load_places(folder)["bed"].pose.x == 5.3


def test_a_map_without_nodes_or_with_fewer_nodes_keeps_drawings_in_place(folder: Path) -> None:
    layout = DrawingEditor(folder)
    layout.set_place(Place("bed", Pose2(5.2, 4.8, 0.5)))
    for nodes in (NODES[:1] + 1.0, NODES[:0]):
        write_graph(folder, nodes)
        assert load_places(folder)["bed"].pose == Pose2(5.2, 4.8, 0.5)
    (folder / GRAPH).unlink()
    assert load_places(folder)["bed"].pose == Pose2(5.2, 4.8, 0.5)
    assert load_nodes(folder).shape == (0, 3)


@pytest.mark.parametrize("text", ["[", "a: b", "places: {bed: [[1, 2]]}", "places: {bed: [[0, 0, 0, 0, 0, 0, .nan]]}"])
def test_damaged_anchors_give_one_sentence(folder: Path, text: str) -> None:
    (folder / ANCHORS_YAML).write_text(text)
    with pytest.raises(MapError, match=ANCHORS_YAML):
        load_anchors(folder)


@pytest.mark.parametrize("line", ["VERTEX_SE2 0 a 0 0", "VERTEX_SE2 5 0 0 0", "VERTEX_SE2 0 nan 0 0"])
def test_a_damaged_graph_gives_one_sentence(folder: Path, line: str) -> None:
    (folder / GRAPH).write_text(line)
    with pytest.raises(MapError, match="damaged"):
        load_nodes(folder)


@pytest.mark.parametrize("text", ["[", "a: 1", "- [[1, 2], [3, 4]]", "- 5"])
def test_an_invalid_file_of_erased_parts_is_refused_with_its_name(folder: Path, text: str) -> None:
    (folder / ERASED_YAML).write_text(text)
    with pytest.raises(ZoneError, match=ERASED_YAML):
        load_map(folder)


@pytest.mark.parametrize("replaces", [False, True])
def test_a_known_name_is_replaced_only_on_request(folder: Path, replaces: bool) -> None:
    layout = DrawingEditor(folder)
    layout.set_place(Place("bed", Pose2(1.0, 2.0)))
    layout.set_zone(Zone("ward", Rule.KEEP_OUT, SQUARE))
    if replaces:
        layout.set_place(Place("bed", Pose2(2.0, 2.0)), replaces=True)
        layout.set_zone(Zone("ward", Rule.SLOW, SQUARE, 0.3), replaces=True)
    else:
        with pytest.raises(PlaceError, match="already"):
            layout.set_place(Place("bed", Pose2(2.0, 2.0)))
        with pytest.raises(ZoneError, match="already"):
            layout.set_zone(Zone("ward", Rule.SLOW, SQUARE, 0.3))
    assert load_places(folder)["bed"].pose.x == (2.0 if replaces else 1.0)
    assert [zone.rule for zone in load_zones(folder)] == [Rule.SLOW if replaces else Rule.KEEP_OUT]


def test_a_history_that_is_not_text_is_ignored(folder: Path) -> None:
    (folder / "undo.yaml").write_bytes(b"\xff\xfe")
    layout = DrawingEditor(folder)
    assert not layout.undoable
    layout.set_place(Place("bed", Pose2(1.0, 2.0)))
    assert layout.undoable


@given(st.text(max_size=200))
def test_a_damaged_history_is_ignored(text: str) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "undo.yaml").write_text(text, encoding="utf-8", errors="replace")
        layout = DrawingEditor(Path(name))
        if not layout.undoable:
            layout.set_place(Place("bed", Pose2(1.0, 2.0)))
            assert layout.undoable


def _moved(by: Pose2, polygon: FloatArray) -> FloatArray:
    return np.array([[(by @ Pose2(x, y)).x, (by @ Pose2(x, y)).y] for x, y in polygon.tolist()])
