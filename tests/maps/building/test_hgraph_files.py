"""The text files of a building."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.maps.building.buildings import two_storeys
from waychair.errors import BuildingError, BuildingNotFound, OutputError
from waychair.maps.building import rewriting
from waychair.maps.building.building import Building, add_storey, load_building, new_building, save_building
from waychair.maps.building.hgraph import Arc, ArcRef, Closure, Node, NodeKind, Storey, SubMap
from waychair.maps.building.hgraph_edits import (
    closed,
    with_nodes,
    with_storey,
    with_submap,
    without_node,
    without_submap,
)
from waychair.maps.building.hgraph_files import (
    GENERAL,
    general_from_text,
    read_hgraph,
    submap_file,
    submap_from_text,
    submap_text,
    write_hgraph,
)


def test_a_building_comes_back_as_it_was_written(tmp_path: Path) -> None:
    hgraph = closed(two_storeys(), ArcRef("g", "c1", "c2"), 'wet "floor"', 1_800_000_000_123_000_000)
    write_hgraph(tmp_path, hgraph)
    read = read_hgraph(tmp_path)
    assert read == hgraph
    assert read.submaps["g"].arcs[1].way.closure == Closure('wet "floor"', 1_800_000_000_123_000_000)


def test_reading_and_writing_keeps_every_byte_with_comments_and_spacing(tmp_path: Path) -> None:
    write_hgraph(tmp_path, two_storeys())
    file = submap_file(tmp_path, "g")
    file.write_text(
        f"# drawn in May\n\n{file.read_text()}".replace("node id=c1", "node   id=c1").replace("x=5 ", "x=5.00 ")
    )
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.txt")}
    write_hgraph(tmp_path, read_hgraph(tmp_path))
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.txt")} == before


def test_an_edit_changes_its_line_and_keeps_the_others_and_the_comments(tmp_path: Path) -> None:
    write_hgraph(tmp_path, two_storeys())
    file = submap_file(tmp_path, "g/ward")
    file.write_text("# by the window\n" + file.read_text())
    read = read_hgraph(tmp_path)
    moved = with_nodes(
        read.submaps["g/ward"], [Node("e", NodeKind.END, 0.0, 4.0, "Bed g"), Node("f", NodeKind.CROSS, 1.0, 4.0)]
    )
    edited = with_submap(read, replace(moved, arcs=(*moved.arcs, Arc("e", "f"))))
    write_hgraph(tmp_path, edited)
    lines = file.read_text().splitlines()
    assert lines == [
        "# by the window",
        "node id=d kind=door x=0 y=0",
        'node id=e kind=end x=0 y=4 name="Bed g"',
        "node id=f kind=cross x=1 y=4",
        "arc from=d to=e",
        "arc from=e to=f",
        "end",
    ]
    assert read_hgraph(tmp_path) == edited


def test_a_deleted_sub_map_takes_its_file_and_its_doorways_with_it(tmp_path: Path) -> None:
    write_hgraph(tmp_path, two_storeys())
    left = without_submap(read_hgraph(tmp_path), "g/ward")
    write_hgraph(tmp_path, left)
    assert not submap_file(tmp_path, "g/ward").exists()
    assert [doorway.child for doorway in read_hgraph(tmp_path).submaps["g"].doorways] == ["store"]


def test_a_file_cut_off_at_any_line_is_refused(tmp_path: Path) -> None:
    write_hgraph(tmp_path, two_storeys())
    general, submap = tmp_path / GENERAL, submap_file(tmp_path, "g")
    lines = general.read_text().splitlines(keepends=True)
    for count in range(len(lines)):
        with pytest.raises(BuildingError, match="cut off"):
            general_from_text(general, "".join(lines[:count]))
    lines = submap.read_text().splitlines(keepends=True)
    for count in range(len(lines)):
        with pytest.raises(BuildingError, match="cut off"):
            submap_from_text(submap, "".join(lines[:count]), SubMap("g"))


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("node id=a kind=cross x=nan y=0", r"g.txt, line 1: x is nan; it must lie in"),
        ("node id=a kind=cross x=1e300 y=0", r"x is 1e300; it must lie in"),
        ("node id=a kind=corner x=0 y=0", "kind is 'corner': write end, cross, door, lift"),
        ("node id=a kind=cross x=0", "'node' lacks y=...: add it"),
        ("node id=a kind=cross x=0 y=0 hight=2", "'hight' is no keyword of 'node'"),
        ("node id=a id=b kind=cross x=0 y=0", "id is given twice"),
        ('node id="a b" kind=cross x=0 y=0', "id is 'a b': use letters"),
        ("wall from=a to=b", "'wall' is no kind of record here"),
        ("arc from=a to=b", "there is no node 'a' in this sub-map"),
        ("node id=a kind=cross x=0 y=0\nnode id=a kind=cross x=1 y=0", "line 2: there is a node 'a' already"),
        ("node a cross", "is no record"),
        ("node id=a kind=cross x=0 y=0\narc from=a to=a until=2026-01-01T00:00:00Z", "until is given without closed"),
        ("node id=a kind=cross x=0 y=0\narc from=a to=a closed=x until=soon", "until is 'soon': write a time"),
    ],
)
def test_a_broken_line_is_named_with_its_file_and_number(line: str, sentence: str) -> None:
    with pytest.raises(BuildingError, match=sentence):
        submap_from_text(Path("g.txt"), f"{line}\nend\n", SubMap("g"))


@pytest.mark.parametrize(
    ("lines", "sentence"),
    [
        ("building name=A\nstop lift=A storey=g at=g:v", "line 2: there is no lift 'A' above this line"),
        ("building name=A\nlift id=A\nstop lift=A storey=g at=g:v", "line 3: there is no storey 'g' above"),
        ("building name=A\nsubmap path=g/ward", "sub-map 'g/ward' has no parent above it"),
        ("building name=A\nsubmap path=g\nsubmap path=g", "there is a sub-map 'g' already"),
        ("building name=A\nsubmap path=g/../x", "path is 'g/../x'"),
        ("storey id=g", "has 0 records 'building name=...'"),
        ("building name=A\ncost turn_m=-1", "turn_m is -1; it must lie in"),
    ],
)
def test_a_broken_general_file_is_refused_with_a_sentence(lines: str, sentence: str) -> None:
    with pytest.raises(BuildingError, match=sentence):
        general_from_text(Path("hgraph.txt"), f"{lines}\nend\n")


def test_a_missing_sub_map_file_and_a_missing_building_are_two_sentences(tmp_path: Path) -> None:
    with pytest.raises(BuildingNotFound, match="there is no building in"):
        read_hgraph(tmp_path)
    write_hgraph(tmp_path, two_storeys())
    submap_file(tmp_path, "1/ward").unlink()
    with pytest.raises(BuildingError, match=r"ward.txt is missing, though .* names '1/ward'"):
        read_hgraph(tmp_path)


def test_a_full_disk_leaves_the_old_building_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_hgraph(tmp_path, two_storeys())
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    def full(paths: list[Path]) -> None:
        raise OSError(28, "No space left on device", str(paths[0]))

    monkeypatch.setattr(rewriting, "_flush", full)
    changed = read_hgraph(tmp_path)
    changed = with_submap(changed, without_node(changed.submaps["g"], "c3"))
    with pytest.raises(OutputError, match="No space left on device; make room"):
        write_hgraph(tmp_path, changed)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_a_name_with_a_line_break_cannot_be_written(tmp_path: Path) -> None:
    ward = with_nodes(SubMap("g"), [Node("a", NodeKind.END, 0.0, 0.0, "Bed\nwindow")])
    with pytest.raises(BuildingError, match="the name of node 'a' has a line break"):
        submap_text(ward)


@given(
    st.text(
        st.characters(exclude_categories=("Cc", "Cs", "Zl", "Zp", "Cn", "Co", "Cf", "Zs")) | st.just(" "), max_size=20
    )
)
def test_any_printable_name_comes_back(name: str) -> None:
    ward = with_nodes(SubMap("g"), [Node("a", NodeKind.END, 0.1, -2.5e-7, name)])
    assert submap_from_text(Path("g.txt"), submap_text(ward), SubMap("g")) == ward


def test_a_new_building_gets_storeys_and_refuses_doubles(tmp_path: Path) -> None:
    building = add_storey(new_building(tmp_path, "Clinic"), Storey("g", "Ground"))
    building = add_storey(building, Storey("cellar", "Cellar", -3.0))
    save_building(building)
    assert [storey.id for storey in load_building(tmp_path).hgraph.storeys] == ["cellar", "g"]
    assert load_building(tmp_path).hgraph.submaps["g"].storey == "g"
    with pytest.raises(BuildingError, match="there is a storey 'g' already"):
        add_storey(building, Storey("g"))
    with pytest.raises(BuildingError, match="there is a building in"):
        new_building(tmp_path, "Other")


def test_nodes_follow_the_storeys_map_when_it_bends_as_places_do(tmp_path: Path) -> None:
    folder = tmp_path / "maps" / "g"
    folder.mkdir(parents=True)
    (folder / "graph.g2o").write_text("VERTEX_SE2 0 5 0 0\nVERTEX_SE2 1 15 0 0\n")
    hgraph = with_storey(two_storeys(), Storey("g", "Ground", map="maps/g"))
    save_building(Building(tmp_path, hgraph))
    (folder / "graph.g2o").write_text("VERTEX_SE2 0 5 0 0\nVERTEX_SE2 1 15 0.5 0\n")
    loaded = load_building(tmp_path).hgraph
    assert (loaded.submaps["g"].nodes["c3"].y, loaded.submaps["g"].nodes["c1"].y) == (0.5, 0.0)
    assert loaded.submaps["g/store"].nodes["e"].y == pytest.approx(3.5)
    assert loaded.submaps["1"] == hgraph.submaps["1"]
    save_building(Building(tmp_path, loaded))
    assert load_building(tmp_path).hgraph == loaded


def test_a_goal_stands_where_its_place_is(tmp_path: Path) -> None:
    folder = tmp_path / "maps" / "g"
    folder.mkdir(parents=True)
    (folder / "places.yaml").write_text("Bed 7: [10.5, 4.0, 0.0]\nBed g: [1.0, 1.0, 0.0]\n")
    hgraph = with_storey(two_storeys(), Storey("g", "Ground", map="maps/g"))
    shelf = with_nodes(hgraph.submaps["g/store"], [Node("f", NodeKind.END, 1.0, 3.0, "Bed g")])
    ward = with_nodes(hgraph.submaps["g/ward"], [Node("e", NodeKind.END, 0.0, 3.0, "Bed 7")])
    hgraph = with_submap(with_submap(hgraph, shelf), ward)
    save_building(Building(tmp_path, hgraph))
    loaded = load_building(tmp_path).hgraph
    bed = loaded.submaps["g/ward"].nodes["e"]
    assert (bed.x, bed.y) == pytest.approx((0.5, 3.75))
    assert loaded.submaps["g/store"] == shelf  # two goals are named like this place
    assert loaded.submaps["1"] == hgraph.submaps["1"]
