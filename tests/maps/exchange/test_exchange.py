"""Buildings from Open-RMF, Nav2 and CSV files, and back."""

from __future__ import annotations

import json
import math
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from waychair.errors import BuildingError
from waychair.maps.building.building import Building, load_building, save_building
from waychair.maps.building.checks.hgraph_checks import check
from waychair.maps.building.hgraph import Arc, HGraph, Node, NodeKind
from waychair.maps.building.hgraph_edits import with_nodes, with_submap, without_node
from waychair.maps.exchange.exchange import read_exchange, write_exchange
from waychair.maps.exchange.flat_graph import flat_graph, write_imported
from waychair.maps.exchange.floor_csv import building_from_floor_csv
from waychair.maps.exchange.open_rmf import building_from_open_rmf
from waychair.maps.exchange.route_graph import building_from_route_graph


def feature(kind: str, coordinates: list[Any], **properties: Any) -> dict[str, Any]:
    """Return a GeoJSON feature."""
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def two_rooms() -> dict[str, Any]:
    """Return a route graph: a one-way loop of three nodes, and a way there and back, with things nobody here knows."""
    points = [(0, 0.0, 0.0), (1, 4.0, 0.0), (2, 4.0, 3.0), (7, 9.0, 0.0)]
    nodes = [feature("Point", [x, y], id=key, frame="map", colour="blue") for key, x, y in points]
    nodes[3]["properties"]["metadata"] = {"name": "Kitchen", "lamps": [1, 2]}
    ends = [(0, 1), (1, 2), (2, 0), (1, 7), (7, 1)]
    edges = [feature("LineString", [], id=20 + k, startid=a, endid=b, cost=2.5) for k, (a, b) in enumerate(ends)]
    edges[0]["properties"]["metadata"] = {"abs_speed_limit": 0.4}
    edges[1]["properties"]["operations"] = {"door": {"type": "open_door", "trigger": "ON_ENTER", "metadata": {"id": 3}}}
    outline = feature("Polygon", [[[0, 0], [1, 0], [1, 1], [0, 0]]], title="not understood")
    return {"type": "FeatureCollection", "made_by": "a person", "features": [outline, *nodes, *edges]}


def as_bytes(document: Any) -> bytes:
    """Return JSON."""
    return json.dumps(document).encode()


def exported(tmp_path: Path, hgraph: HGraph, name: str) -> Path:
    """Save another graph into an imported building's folder, and export it."""
    folder = tmp_path / "building"
    save_building(replace(load_building(folder), hgraph=hgraph))
    write_exchange(load_building(folder), tmp_path / name)
    return tmp_path / name


def imported(tmp_path: Path, data: bytes, name: str) -> HGraph:
    """Import a file's content into a folder, and return its graph."""
    (tmp_path / name).write_bytes(data)
    found = read_exchange(tmp_path / name, "", None, 0.1)
    write_imported(tmp_path / "building", found)
    return load_building(tmp_path / "building").hgraph


def test_a_route_graph_becomes_nodes_and_arcs(tmp_path: Path) -> None:
    hgraph = imported(tmp_path, as_bytes(two_rooms()), "rooms.geojson")

    submap = hgraph.submaps["map"]
    assert {key: (node.x, node.y) for key, node in submap.nodes.items()} == {
        "n0": (0.0, 0.0),
        "n1": (4.0, 0.0),
        "n2": (4.0, 3.0),
        "n7": (9.0, 0.0),
    }
    assert submap.nodes["n7"].name == "Kitchen"
    assert submap.nodes["n7"].kind is NodeKind.END
    ways = {(arc.start, arc.end): arc.way for arc in submap.arcs}
    assert {ends: way.one_way for ends, way in ways.items()} == {
        ("n0", "n1"): True,
        ("n1", "n2"): True,
        ("n2", "n0"): True,
        ("n1", "n7"): False,
    }
    assert ways["n0", "n1"].speed == 0.4


def test_an_unchanged_route_graph_is_written_back_as_it_was(tmp_path: Path) -> None:
    data = as_bytes(two_rooms())
    imported(tmp_path, data, "rooms.geojson")

    write_exchange(load_building(tmp_path / "building"), tmp_path / "back.geojson")

    assert (tmp_path / "back.geojson").read_bytes() == data


def test_an_edited_route_graph_keeps_all_that_nobody_edited(tmp_path: Path) -> None:
    before = two_rooms()
    hgraph = imported(tmp_path, as_bytes(before), "rooms.geojson")
    submap = with_nodes(
        hgraph.submaps["map"], [Node("n2", NodeKind.CROSS, 4.0, 3.5), Node("new", NodeKind.END, 1, 1, "Bed")]
    )
    arcs = [arc for arc in submap.arcs if {arc.start, arc.end} != {"n1", "n7"}]
    edited = with_submap(hgraph, replace(submap, arcs=(*arcs, Arc("new", "n0"))))

    after = json.loads(exported(tmp_path, edited, "back.geojson").read_text())

    assert after["made_by"] == "a person"
    old = {json.dumps(each) for each in before["features"]}
    changed = [each for each in after["features"] if json.dumps(each) not in old]
    assert [each["geometry"]["coordinates"] for each in changed if each["geometry"]["type"] == "Point"] == [
        [4.0, 3.5],
        [1.0, 1.0],
    ]
    assert changed[0]["properties"] == {"id": 2, "frame": "map", "colour": "blue"}
    lines = [each["properties"] for each in changed if each["geometry"]["type"] == "LineString"]
    assert sorted((line["startid"], line["endid"]) for line in lines) == [(0, 8), (8, 0)]
    kept = {each["properties"].get("id") for each in after["features"] if json.dumps(each) in old}
    assert kept == {None, 0, 1, 7, 20, 21, 22}


def changed_feature(position: int, **properties: Any) -> dict[str, Any]:
    """Return the route graph with properties of one feature changed."""
    document = two_rooms()
    document["features"][position]["properties"] |= properties
    return document


def at(x: Any, y: Any) -> dict[str, Any]:
    """Return the route graph with its first node elsewhere."""
    document = two_rooms()
    document["features"][1]["geometry"]["coordinates"] = [x, y]
    return document


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"{", "is no GeoJSON"),
        (b"\xff", "is no GeoJSON"),
        (b"[1]", "no list 'features'"),
        (as_bytes({"features": [3]}), "feature 0 of x has no geometry"),
        (as_bytes(changed_feature(5, endid=99)), "edge 20 of x has the endid 99, which is no node"),
        (as_bytes(changed_feature(2, id=0)), "two nodes with the id 0"),
        (as_bytes(changed_feature(1, id=-4)), "no whole number as its id"),
        (as_bytes(changed_feature(1, metadata={"storey": "a b"})), "has the storey 'a b'"),
        (as_bytes(at(math.nan, 0.0)), "NaN is no number"),
        (as_bytes(at(1e300, 0.0)), "lies at 1e+300 m, which is in no building"),
        (as_bytes(at("left", 0.0)), "lies at 'left', which is no number"),
        (as_bytes(at(True, 0.0)), "which is no number"),
    ],
)
def test_a_broken_route_graph_is_one_sentence(data: bytes, sentence: str) -> None:
    with pytest.raises(BuildingError, match=r"^[^\n]+$") as raised:
        building_from_route_graph(data, "x")
    assert sentence in str(raised.value)


NODES = """nodeID,xcoord,ycoord,floor,building,nodeType,longName,shortName
AHALL001L1,100,200,L1,East,HALL,Hall,Hall
AELEV00A0L1,130,200,L1,East,ELEV,Lift A,A
AELEV00A001,130,200,1,East,ELEV,Lift A,A
ADEPT00101,130,240,1,East,DEPT,"Eyes, ears",Eyes
ASTAI00101,100,240,1,East,STAI,Stairs,Stairs
ASTAI001L1,100,240,L1,East,STAI,Stairs,Stairs
"""
EDGES = """edgeID,startNode,endNode
a,AHALL001L1,AELEV00A0L1
b,AELEV00A0L1,AELEV00A001
c,AELEV00A001,ADEPT00101
d,ASTAI00101,ADEPT00101
e,ASTAI00101,ASTAI001L1
f,AELEV00A001,AELEV00A0L1
"""


def test_csv_files_become_storeys_arcs_and_lifts() -> None:
    found = building_from_floor_csv(NODES.encode(), EDGES.encode(), "east", 0.1)

    hgraph = found.hgraph
    assert [storey.id for storey in hgraph.storeys] == ["L1", "1"]
    goal = hgraph.submaps["1"].nodes["ADEPT00101"]
    assert (goal.x, goal.y, goal.name, goal.kind) == (13.0, -24.0, "Eyes, ears", NodeKind.END)
    (lift,) = hgraph.lifts.values()
    assert [str(stop.at) for stop in lift.stops] == ["L1:AELEV00A0L1", "1:AELEV00A001"]
    ways = {(arc.start, arc.end): arc.way for submap in hgraph.submaps.values() for arc in submap.arcs}
    assert ways["ASTAI00101", "ADEPT00101"].closure is not None
    assert ways["AELEV00A001", "ADEPT00101"].closure is None
    assert len(found.notes) == 2
    assert any("stairs" in note for note in found.notes)


def test_edited_csv_files_keep_the_other_lines(tmp_path: Path) -> None:
    folder = tmp_path / "east"
    folder.mkdir()
    (folder / "nodes.csv").write_text(NODES)
    (folder / "edges.csv").write_text(EDGES)
    write_imported(tmp_path / "building", read_exchange(folder, "", None, 0.1))
    hgraph = load_building(tmp_path / "building").hgraph
    write_exchange(load_building(tmp_path / "building"), tmp_path / "same")
    moved = with_nodes(hgraph.submaps["L1"], [replace(hgraph.submaps["L1"].nodes["AHALL001L1"], x=10.5)])

    out = exported(tmp_path, with_submap(hgraph, moved), "back")

    assert (tmp_path / "same" / "nodes.csv").read_text() == NODES
    assert (tmp_path / "same" / "edges.csv").read_text() == EDGES
    assert (out / "nodes.csv").read_text() == NODES.replace("AHALL001L1,100,", "AHALL001L1,105,")
    assert (out / "edges.csv").read_text() == EDGES


@pytest.mark.parametrize(
    ("nodes", "edges", "sentence"),
    [
        (NODES.replace("floor", "flur"), EDGES, "nodes.csv has no column 'floor'"),
        (NODES.replace("100,240,1", "wide,240,1"), EDGES, "nodes.csv, line 6"),
        (NODES.replace("100,240,1", "nan,240,1"), EDGES, "which is in no building"),
        (NODES.replace("AHALL001L1,", "ADEPT00101,"), EDGES, "a node 'ADEPT00101' already"),
        (NODES, EDGES.replace("e,ASTAI00101", "e,nobody"), "edges.csv, line 6: 'nobody' is no node"),
        (NODES, EDGES + "g,AHALL001L1\n", "too few or too many values"),
    ],
)
def test_broken_csv_files_are_one_sentence(nodes: str, edges: str, sentence: str) -> None:
    with pytest.raises(BuildingError, match=r"^[^\n]+$") as raised:
        building_from_floor_csv(nodes.encode(), edges.encode(), "east")
    assert sentence in str(raised.value)


def rmf_values() -> dict[str, Any]:
    """Return two levels of 50 px a metre, the upper one turned by 90 degrees and twice as large, joined by a lift."""

    def upper(x: float, y: float) -> list[float]:
        return [2 * y + 30.0, -2 * x + 900.0]

    lane = {"bidirectional": [4, True], "graph_idx": [2, 2], "speed_limit": [3, 0.5]}
    cabin = {"lift_cabin": [1, "lift_a"]}
    corners = [(50.0, 50.0), (450.0, 50.0), (450.0, 250.0), (50.0, 250.0)]
    low = [[x, y, 0.0, ""] for x, y in corners] + [[100.0, 100.0, 0.0, "Desk"], [300.0, 100.0, 0.0, ""]]
    low += [[400.0, 100.0, 0.0, "", cabin], [200.0, 50.0, 0, ""], [200.0, 125.0, 0, ""], [200.0, 80.0, 0, ""]]
    high = [[*upper(400.0, 100.0), 0.0, "", cabin], [*upper(300.0, 100.0), 0.0, "Ward"]]
    marks = [(50.0, 50.0, "a"), (450.0, 50.0, "b"), (450.0, 250.0, "c")]
    return {
        "name": "house",
        "crowd_sim": {"enable": 0},
        "levels": {
            "L2": {
                "elevation": 4.0,
                "fiducials": [[*upper(x, y), key] for x, y, key in marks],
                "lanes": [[0, 1, lane]],
                "measurements": [[0, 1, {"distance": [3, 77.0]}]],
                "vertices": high,
            },
            "L1": {
                "doors": [[9, 8, {"name": [1, "door"], "type": [1, "hinged"]}]],
                "elevation": 0.0,
                "fiducials": [[x, y, key] for x, y, key in marks],
                "lanes": [[4, 5, lane], [5, 6, {**lane, "bidirectional": [4, False]}], [4, 0, {"graph_idx": [2, 7]}]],
                "measurements": [[0, 1, {"distance": [3, 8.0]}]],
                "models": [{"model_name": "Chair", "x": 1.0}],
                "vertices": low,
                "walls": [[0, 1, {}], [1, 2, {}], [2, 3, {}], [3, 0, {}], [7, 8, {}]],
            },
        },
        "lifts": {
            "lift_a": {"width": 1.6, "depth": 2.1, "doors": {"d": {"width": 0.95}}, "level_doors": {"L1": ["d"]}},
            "lift_b": {"width": 1.6},
        },
        "reference_level_name": "L1",
    }


def as_yaml(values: Any) -> bytes:
    """Return YAML."""
    return str(yaml.safe_dump(values, sort_keys=False)).encode()


def test_an_open_rmf_building_is_in_metres_of_one_frame() -> None:
    found = building_from_open_rmf(as_yaml(rmf_values()), "house")

    hgraph = found.hgraph
    assert [(storey.id, storey.height) for storey in hgraph.storeys] == [("L1", 0.0), ("L2", 4.0)]
    places = {
        str(ref): (round(n.x, 6), round(n.y, 6)) for ref, n in ((r, f) for r, f in flat_graph(hgraph).nodes.items())
    }
    assert places == {
        "L1:v4": (2.0, -2.0),
        "L1:v5": (6.0, -2.0),
        "L1:v6": (8.0, -2.0),
        "L2:v0": (8.0, -2.0),
        "L2:v1": (6.0, -2.0),
    }
    ways = {(arc.start, arc.end): arc.way for arc in hgraph.submaps["L1"].arcs}
    assert ways["v4", "v5"].width == pytest.approx(0.9)
    assert ways["v4", "v5"].speed == 0.5
    assert [way.one_way for way in ways.values()] == [False, True]
    (lift,) = hgraph.lifts.values()
    assert (lift.cabin_width, lift.cabin_depth, lift.stops[0].door_width, lift.stops[1].door_width) == (
        1.6,
        2.1,
        0.95,
        None,
    )
    assert any("lift_b" in note for note in found.notes)
    assert any("graphs 2, 7" in note for note in found.notes)


def test_walls_become_a_map_with_open_doors() -> None:
    found = building_from_open_rmf(as_yaml(rmf_values()), "house")

    grid = found.grids["L1"]
    assert set(found.grids) == {"L1"}

    def value(x: float, y: float) -> int:
        column, row = (np.array([x - grid.map_from_grid.x, y - grid.map_from_grid.y]) / grid.resolution).astype(int)
        return int(grid.cells[row, column])

    assert [value(5.0, -1.0), value(4.0, -1.2), value(4.0, -2.0), value(3.0, -3.0)] == [100, 100, 0, 0]
    assert value(0.5, -3.0) == -1


def test_an_edited_open_rmf_building_keeps_all_that_nobody_edited(tmp_path: Path) -> None:
    data = as_yaml(rmf_values())
    hgraph = imported(tmp_path, data, "house.building.yaml")
    write_exchange(load_building(tmp_path / "building"), tmp_path / "same.building.yaml")
    submap = hgraph.submaps["L2"]
    edited = with_nodes(
        submap, [replace(submap.nodes["v1"], x=5.0, y=-2.0, name="Ward 1"), Node("bed", NodeKind.END, 5, -3)]
    )
    edited = replace(edited, arcs=(*edited.arcs, Arc("bed", "v1")))

    after = yaml.safe_load(exported(tmp_path, with_submap(hgraph, edited), "back.building.yaml").read_text())

    assert (tmp_path / "same.building.yaml").read_bytes() == data
    wanted = rmf_values()
    level, new = wanted["levels"]["L2"], after["levels"]["L2"]
    assert new["vertices"][1][:2] == pytest.approx([2 * 100.0 + 30.0, -2 * 250.0 + 900.0])
    assert new["vertices"][2][:2] == pytest.approx([2 * 150.0 + 30.0, -2 * 250.0 + 900.0])
    assert new["vertices"][1][3] == "Ward 1"
    assert new["lanes"][0] == level["lanes"][0]
    assert new["lanes"][1][:2] == [2, 1]
    assert new["lanes"][1][2]["graph_idx"] == [2, 2]
    del after["levels"]["L2"], wanted["levels"]["L2"]
    assert after == wanted


def test_a_new_file_of_each_format_gives_the_same_graph(tmp_path: Path) -> None:
    hgraph = building_from_open_rmf(as_yaml(rmf_values()), "house").hgraph
    building = Building(tmp_path / "nothing_kept", hgraph)
    wanted = flat_graph(hgraph)

    for name in ("new.building.yaml", "new.geojson", "new"):
        write_exchange(building, tmp_path / name)
        found = flat_graph(read_exchange(tmp_path / name, "", None, 0.1).hgraph)

        assert sorted((n.storey, round(n.x, 6), round(n.y, 6)) for n in found.nodes.values()) == sorted(
            (n.storey, round(n.x, 6), round(n.y, 6)) for n in wanted.nodes.values()
        )
        assert len(found.ways) == len(wanted.ways)
        assert [len(lift.stops) for lift in found.lifts.values()] == [2]


def without(path: list[str]) -> bytes:
    """Return the Open-RMF building without one key."""
    values = rmf_values()
    inner = values
    for key in path[:-1]:
        inner = inner[key]
    del inner[path[-1]]
    return as_yaml(values)


def broken(kind: str, row: list[Any]) -> bytes:
    """Return the Open-RMF building with one more lane, wall or vertex on L1."""
    values = rmf_values()
    values["levels"]["L1"][kind].append(row)
    return as_yaml(values)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"a: [", "house"),
        (b"levels: {}", "has no levels"),
        (without(["levels", "L1", "measurements"]), "level 'L1' of house has no measurement"),
        (as_yaml({**rmf_values(), "coordinate_system": "wgs84"}), "coordinate system 'wgs84'"),
        (broken("lanes", [3, 99, {}]), "number 3 of the lanes of level 'L1' of house has an end that is no vertex"),
        (broken("walls", [0]), "number 5 of the walls"),
        (broken("vertices", [math.nan, 1.0, 0.0, ""]), "vertex 10 of level 'L1' of house lies at nan m"),
        (broken("vertices", [1e300, 1.0, 0.0, ""]), "in no building"),
        (as_yaml({"levels": {"L 1": {}}}), "has a level 'L 1'"),
        (as_yaml({"levels": {"L1": None}}), "level 'L1' of house is empty"),
    ],
)
def test_a_broken_open_rmf_building_is_one_sentence(data: bytes, sentence: str) -> None:
    with pytest.raises(BuildingError) as raised:
        building_from_open_rmf(data, "house")
    assert sentence in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_level_without_fiducials_is_laid_by_its_own_measurements_and_says_so() -> None:
    found = building_from_open_rmf(without(["levels", "L2", "fiducials"]), "house")

    assert any("level 'L2' has fewer than two fiducials of 'L1'" in note for note in found.notes)
    assert math.dist(*[(n.x, n.y) for n in found.hgraph.submaps["L2"].nodes.values()]) == pytest.approx(77.0)


@pytest.mark.parametrize("name", ["plan.pdf", "plan.tar.gz"])
def test_a_name_of_no_format_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(BuildingError, match="no format"):
        write_exchange(Building(tmp_path, HGraph("x")), tmp_path / name)


def test_a_node_that_is_taken_away_takes_its_lanes_along(tmp_path: Path) -> None:
    hgraph = imported(tmp_path, as_yaml(rmf_values()), "house.building.yaml")
    edited = with_submap(hgraph, without_node(hgraph.submaps["L1"], "v4"))

    after = yaml.safe_load(exported(tmp_path, edited, "back.building.yaml").read_text())

    assert [lane[:2] for lane in after["levels"]["L1"]["lanes"]] == [[5, 6], [4, 0]]


def test_the_hospital_has_the_faults_that_its_readme_lists(data_dir: Path) -> None:
    folder = data_dir / "graph_bwh"
    found = building_from_floor_csv((folder / "nodes.csv").read_bytes(), (folder / "edges.csv").read_bytes(), "bwh")

    counts = Counter(finding.code for finding in check(found.hgraph))

    assert {code: counts[code] for code in ("E2", "E3", "E8", "E11", "E13")} == {
        "E2": 7,
        "E3": 38,
        "E8": 15,
        "E11": 7,
        "E13": 1,
    }
    assert len(found.hgraph.lifts) == 16
    assert sum(len(submap.arcs) for submap in found.hgraph.submaps.values()) == 682


@pytest.mark.parametrize(
    ("name", "graph", "level", "wanted"),
    [
        ("clinic", 0, "L1", (54, 55, 233.9, 9)),
        ("clinic", 0, "L2", (37, 37, 215.9, 4)),
        ("office", 0, "L1", (29, 30, 68.6, 2)),
        ("triple_H", 0, "L1", (23, 22, 58.4, 0)),
        ("battle_royale", 0, "L1", (21, 20, 61.1, 0)),
    ],
)
def test_buildings_of_open_rmf_have_their_counts_and_lengths(
    data_dir: Path, name: str, graph: int, level: str, wanted: tuple[int, int, float, int]
) -> None:
    data = (data_dir / "rmf_buildings" / f"{name}.building.yaml").read_bytes()
    submap = building_from_open_rmf(data, name, graph).hgraph.submaps[level]

    places = {key: (node.x, node.y) for key, node in submap.nodes.items()}
    length = sum(math.dist(places[arc.start], places[arc.end]) for arc in submap.arcs)
    crossings = sum(arc.way.width is not None for arc in submap.arcs)
    assert (len(places), len(submap.arcs), crossings) == (wanted[0], wanted[1], wanted[3])
    assert length == pytest.approx(wanted[2], abs=0.1)


@pytest.mark.parametrize("name", ["sample_graph", "aws_graph", "turtlebot3_graph", "error_codes"])
def test_nav2_graphs_come_back_with_every_value_after_an_edit(data_dir: Path, tmp_path: Path, name: str) -> None:
    data = (data_dir / "nav2_route_graphs" / f"{name}.geojson").read_bytes()
    hgraph = imported(tmp_path, data, f"{name}.geojson")
    submap = hgraph.submaps["map"]
    first = next(iter(submap.nodes.values()))

    edited = with_submap(hgraph, with_nodes(submap, [replace(first, x=first.x + 0.25)]))
    after = json.loads(exported(tmp_path, edited, "back.geojson").read_text())

    before = json.loads(data)
    assert {k: v for k, v in after.items() if k != "features"} == {k: v for k, v in before.items() if k != "features"}
    assert [new["properties"] for new in after["features"]] == [old["properties"] for old in before["features"]]
    assert sum(new != old for new, old in zip(after["features"], before["features"], strict=True)) == 1
