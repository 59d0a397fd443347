"""The graph of a drawn ward: rooms, doorways, corridor, and what stays when it is made again."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from tests.maps.rooms.drawn_plans import DrawnPlan, ward
from waychair.calibration.chair_body import BODIES
from waychair.errors import BuildingError
from waychair.maps.building.building import Building, add_storey, load_building, new_building
from waychair.maps.building.checks.hgraph_checks import FindingSeverity, GraphSurroundings, check
from waychair.maps.building.hgraph import Arc, Closure, HGraph, Node, NodeKind, Origin, Storey, SubMap, full_name
from waychair.maps.building.hgraph_edits import with_nodes, with_submap, without_node, without_submap
from waychair.maps.drawn.places import load_places, save_places
from waychair.maps.folders.map_files import load_map, save_map
from waychair.planning.building.generation.storey_generation import (
    Generation,
    generated_storey,
    save_generation,
    with_lift_stop,
)
from waychair.types import Place, Pose2

BODY = BODIES["A"]
PLACES = {"Desk": (5.5, 8.0), "Bed": (2.0, 2.0), "Lift": (13.8, 5.5)}


def mapped(tmp_path: Path, plan: DrawnPlan | None = None) -> Building:
    """Return a building with one storey, its map and its places."""
    folder = tmp_path / "house"
    building = add_storey(new_building(folder, "house"), Storey("ground", "Ground", 0.0, "maps/ground"))
    save_map(folder / "maps" / "ground", (plan or ward()).grid())
    save_places(folder / "maps" / "ground", {name: Place(name, Pose2(x, y)) for name, (x, y) in PLACES.items()})
    return building


def made(building: Building) -> Generation:
    """Make the graph of the storey and write it."""
    generation = generated_storey(building, "ground", BODY)
    save_generation(generation, "ground")
    return generation


def again(building: Building, hgraph: HGraph) -> HGraph:
    """Return the graph after somebody has edited it and it was made once more."""
    made(replace(building, hgraph=hgraph))
    return load_building(building.folder).hgraph


def goal(hgraph: HGraph, name: str) -> Node:
    """Return the End node of a name."""
    return next(node for _, node in hgraph.nodes() if node.name == name)


def test_a_ward_has_a_sub_map_for_each_room_and_a_doorway_for_each_door(tmp_path: Path) -> None:
    hgraph = made(mapped(tmp_path)).building.hgraph

    assert len(hgraph.children("ground")) == 7
    doorways = hgraph.submaps["ground"].doorways
    assert sorted(each.way.width or 0.0 for each in doorways) == pytest.approx([0.9] * 4 + [1.2] * 3, abs=0.051)
    assert {each.child for each in doorways} == {path.rpartition("/")[2] for path in hgraph.children("ground")}


def test_a_generated_graph_has_no_faults(tmp_path: Path) -> None:
    building = mapped(tmp_path)
    hgraph = made(building).building.hgraph
    folder = building.folder / "maps" / "ground"
    around = GraphSurroundings(BODY.width, BODY.length, {"ground": load_map(folder)}, {"ground": load_places(folder)})

    assert [finding for finding in check(hgraph, around) if finding.severity is FindingSeverity.ERROR] == []


def test_every_place_is_an_end_node_where_it_stands_and_other_rooms_get_one(tmp_path: Path) -> None:
    building = mapped(tmp_path)

    hgraph = made(building).building.hgraph

    for name, (x, y) in PLACES.items():
        assert (goal(hgraph, name).x, goal(hgraph, name).y, goal(hgraph, name).kind) == (x, y, NodeKind.END)
    ends = {node.name for _, node in hgraph.nodes() if node.kind is NodeKind.END}
    assert len(ends) == 8  # seven rooms, two of them with a place, and the place in the corridor
    assert ends == set(load_places(building.folder / "maps" / "ground"))
    assert "Ground/Desk/Desk" in {full_name(hgraph, ref) for ref, node in hgraph.nodes() if node.name == "Desk"}


def test_no_node_has_more_than_four_arcs_and_no_arc_is_shorter_than_the_straight_line(tmp_path: Path) -> None:
    hgraph = made(mapped(tmp_path)).building.hgraph

    for submap in hgraph.submaps.values():
        for node in submap.nodes.values():
            doors = sum(each.start == node.id for each in submap.doorways)
            assert sum(node.id in (arc.start, arc.end) for arc in submap.arcs) + doors <= 4
        for arc in submap.arcs:
            start, end = submap.nodes[arc.start], submap.nodes[arc.end]
            assert arc.way.length is not None
            assert math.dist((start.x, start.y), (end.x, end.y)) - 0.001 <= arc.way.length
            assert arc.way.length <= 1.3 * math.dist((start.x, start.y), (end.x, end.y)) + 0.1


def test_a_door_that_is_too_narrow_for_the_chair_is_no_doorway(tmp_path: Path) -> None:
    plan = ward().fill(5.05, 6.5, 5.45, 6.6, 100)

    generation = generated_storey(mapped(tmp_path, plan), "ground", BODY)

    assert [opening.width for opening in generation.sketch.shut] == [pytest.approx(0.5, abs=0.051)]
    assert generation.sketch.lost == ("Desk",)
    assert len(generation.sketch.doorways) == 6


def test_made_again_from_the_same_map_it_is_the_same(tmp_path: Path) -> None:
    building = mapped(tmp_path)
    first = made(building)
    before = {path: path.read_bytes() for path in sorted(building.folder.rglob("*")) if path.is_file()}

    again(building, first.building.hgraph)

    assert {path: path.read_bytes() for path in sorted(building.folder.rglob("*")) if path.is_file()} == before


def test_nodes_that_people_moved_named_or_added_stay(tmp_path: Path) -> None:
    building = mapped(tmp_path)
    hgraph = made(building).building.hgraph
    submap = hgraph.submaps["ground"]
    moved = next(node for node in submap.nodes.values() if node.id.startswith("c"))
    named = with_nodes(
        submap,
        [
            replace(moved, x=moved.x + 0.1, name="Kiosk", origin=Origin.HAND),
            Node("bench", NodeKind.CROSS, 7.0, 5.0),
        ],
    )
    edited = with_submap(hgraph, replace(named, arcs=(*named.arcs, Arc("bench", moved.id))))

    after = again(building, edited).submaps["ground"]

    assert after.nodes[moved.id] == named.nodes[moved.id]
    assert after.nodes["bench"] == named.nodes["bench"]
    assert Arc("bench", moved.id) in after.arcs
    assert len(after.nodes) == len(named.nodes)


def test_nodes_arcs_and_rooms_that_people_took_away_stay_away(tmp_path: Path) -> None:
    building = mapped(tmp_path)
    hgraph = made(building).building.hgraph
    submap = hgraph.submaps["ground"]
    gone = next(node.id for node in submap.nodes.values() if node.id.startswith("c"))
    arc = next(arc for arc in submap.arcs if gone not in (arc.start, arc.end))
    edited = without_node(submap, gone)
    edited = replace(edited, arcs=tuple(each for each in edited.arcs if each != arc))
    room = hgraph.children("ground")[0]
    fewer = without_submap(with_submap(hgraph, edited), room)

    once = again(building, fewer)
    twice = again(building, once)

    for after in (once, twice):
        assert gone not in after.submaps["ground"].nodes
        assert {frozenset((each.start, each.end)) for each in after.submaps["ground"].arcs} == {
            frozenset((each.start, each.end)) for each in edited.arcs
        }
        assert room not in after.submaps
        assert len(after.children("ground")) == 6


def test_closures_prices_and_room_names_stay(tmp_path: Path) -> None:
    building = mapped(tmp_path)
    hgraph = made(building).building.hgraph
    submap, room = hgraph.submaps["ground"], hgraph.children("ground")[2]
    closed = replace(submap.arcs[0], way=replace(submap.arcs[0].way, closure=Closure("wet floor")))
    door = replace(submap.doorways[0], way=replace(submap.doorways[0].way, price=12.0))
    edited = replace(submap, arcs=(closed, *submap.arcs[1:]), doorways=(door, *submap.doorways[1:]))
    hgraph = with_submap(hgraph, edited)
    hgraph = with_submap(hgraph, replace(hgraph.submaps[room], name="Radiology"))

    after = again(building, hgraph)

    assert closed in after.submaps["ground"].arcs
    assert door in after.submaps["ground"].doorways
    assert after.submaps[room].name == "Radiology"


def test_a_new_wall_moves_only_what_it_concerns(tmp_path: Path) -> None:
    building = mapped(tmp_path)
    before = made(building).building.hgraph
    save_map(building.folder / "maps" / "ground", ward().fill(12.05, 6.5, 12.95, 6.6, 100).grid())

    after = again(building, before)

    gone = set(before.children("ground")) - set(after.children("ground"))
    assert len(gone) == 1
    kept = [path for path in before.children("ground") if path not in gone]
    assert [after.submaps[path] for path in kept] == [before.submaps[path] for path in kept]


def test_a_place_becomes_the_stop_of_a_lift_and_stays_one(tmp_path: Path) -> None:
    building = mapped(tmp_path)
    hgraph = with_lift_stop(made(building).building.hgraph, "ground", "A", "Lift")

    after = again(building, hgraph)

    (stop,) = after.lifts["A"].stops
    assert after.node(stop.at) == replace(goal(hgraph, "Lift"), kind=NodeKind.LIFT, origin=Origin.HAND)
    assert any(stop.at.node in (arc.start, arc.end) for arc in after.submaps["ground"].arcs)
    with pytest.raises(BuildingError, match="no place 'Roof'"):
        with_lift_stop(after, "ground", "A", "Roof")


@pytest.mark.parametrize("text", ["{", "[]", '{"maps": {"ground": {"nodes": {"a": 3}}}}'])
def test_a_damaged_record_is_one_sentence(tmp_path: Path, text: str) -> None:
    building = mapped(tmp_path)
    (building.folder / "generated").mkdir()
    (building.folder / "generated" / "ground.json").write_text(text)

    with pytest.raises(BuildingError, match=r"^[^\n]*is damaged: remove it[^\n]*$"):
        generated_storey(building, "ground", BODY)


def test_a_storey_without_a_map_or_name_is_refused(tmp_path: Path) -> None:
    building = mapped(tmp_path)
    with pytest.raises(BuildingError, match="no storey 'attic'"):
        generated_storey(building, "attic", BODY)
    bare = replace(building.hgraph, storeys=(Storey("ground"),), submaps={"": SubMap(""), "ground": SubMap("ground")})
    with pytest.raises(BuildingError, match="has no map"):
        generated_storey(replace(building, hgraph=bare), "ground", BODY)


def test_the_record_lists_what_was_made(tmp_path: Path) -> None:
    building = mapped(tmp_path)
    hgraph = made(building).building.hgraph

    record = json.loads((building.folder / "generated" / "ground.json").read_text())

    assert set(record["maps"]) == {"ground", *hgraph.children("ground")}
    assert set(record["maps"]["ground"]["nodes"]) == set(hgraph.submaps["ground"].nodes)
