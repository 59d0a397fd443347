"""Writing a building to a full disk: all of it is written, or nothing is changed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.full_disk import content, files_up_to
from tests.maps.building.buildings import two_storeys
from waychair.errors import OutputError
from waychair.maps.building.building import Building, add_storey, new_building, save_building, save_with_map
from waychair.maps.building.hgraph import ArcRef, Node, NodeKind, Storey
from waychair.maps.building.hgraph_edits import closed, with_nodes, with_submap
from waychair.maps.building.hgraph_files import read_hgraph, write_hgraph
from waychair.maps.exchange.exchange import read_exchange
from waychair.maps.exchange.flat_graph import write_imported
from waychair.maps.folders.map_files import save_map
from waychair.types import OccupancyGrid, Pose2

NODES = "nodeID,xcoord,ycoord,floor,building,nodeType,longName,shortName\n" + "".join(
    f"N{k},{10 * k},0,1,B,CONF,Room {k},R{k}\n" for k in range(30)
)
EDGES = "edgeID,startNode,endNode\n" + "".join(f"E{k},N{k},N{k + 1}\n" for k in range(29))


@pytest.mark.parametrize("size", [0, 100, 500, 700, 1000])
def test_an_edit_is_written_whole_or_not_at_all(tmp_path: Path, size: int) -> None:
    folder = tmp_path / "clinic"
    write_hgraph(folder, two_storeys())
    before = content(folder)
    edited = closed(two_storeys(), ArcRef("g/ward", "d", "e"), "wet floor " * 10)
    rows = [Node(f"x{k}", NodeKind.CROSS, float(k), 9.0) for k in range(40)]
    edited = with_submap(edited, with_nodes(edited.submaps["1"], rows))

    with files_up_to(size), pytest.raises(OutputError, match="cannot write"):
        save_building(Building(folder, edited))

    assert content(folder) == before
    save_building(Building(folder, edited))
    assert read_hgraph(folder) == edited


@pytest.mark.parametrize("size", [0, 20])
def test_a_new_building_leaves_nothing_on_a_full_disk(tmp_path: Path, size: int) -> None:
    with files_up_to(size), pytest.raises(OutputError):
        new_building(tmp_path / "towns" / "house", "House")
    assert content(tmp_path) == {}


@pytest.mark.parametrize("size", [0, 300, 900, 1500])
def test_an_import_leaves_nothing_on_a_full_disk(tmp_path: Path, size: int) -> None:
    source = tmp_path / "csv"
    source.mkdir()
    (source / "nodes.csv").write_text(NODES)
    (source / "edges.csv").write_text(EDGES)
    imported = read_exchange(source, "", None, 0.1)
    before = content(tmp_path)

    with files_up_to(size), pytest.raises(OutputError):
        write_imported(tmp_path / "house", imported)

    assert content(tmp_path) == before
    assert len(write_imported(tmp_path / "house", imported).hgraph.submaps["1"].nodes) == 30


@pytest.mark.parametrize("size", [0, 200, 1000])
def test_a_storey_is_added_with_its_map_or_not_at_all(tmp_path: Path, size: int) -> None:
    save_map(tmp_path / "map", OccupancyGrid(np.zeros((40, 50), np.int8), 0.05, Pose2()))
    building = new_building(tmp_path / "house", "House " * 50)
    before = content(tmp_path)

    with files_up_to(size), pytest.raises(OutputError):
        save_with_map(add_storey(building, Storey("g", "Ground " * 200)), "g", tmp_path / "map")

    assert content(tmp_path) == before
    made = save_with_map(add_storey(building, Storey("g", "Ground")), "g", tmp_path / "map")
    assert made.map_folder("g") == tmp_path / "house" / "maps" / "g"
