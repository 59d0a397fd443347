"""The traffic graph of a building: sections, refuges, lifts and what is left out of it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.maps.building.buildings import two_storeys
from waychair.errors import TrafficError
from waychair.maps.building.building_traffic import LOBBY_SLOTS, building_traffic
from waychair.maps.building.hgraph import Arc, ArcRef, HGraph, Lift, Node, NodeKind, SubMap, Way
from waychair.maps.building.hgraph_edits import closed as closed_arc
from waychair.maps.traffic.single_file import districts
from waychair.maps.traffic.well_formed import pieces, well_formed


def test_places_lobbies_doors_and_lifts_become_refuges_and_sections() -> None:
    graph = building_traffic(two_storeys()).graph
    assert set(graph.refuge) >= {"Ground/Ward/Bed g", "First/Store/Bed 1", "lobby of Lift A on g"}
    assert graph.refuge["lobby of Lift A on 1"].slots == LOBBY_SLOTS
    assert graph.refuge["lobby of Lift A on 1"].waiting
    assert not graph.refuge["Ground/Ward/Bed g"].waiting
    assert graph.section["g:c1>c2"].length == pytest.approx(5.0)
    ward = graph.section["g:c2>ward:d"]
    assert (ward.width, ward.lanes) == (0.9, 1)
    assert ward.delay_s == pytest.approx(2.0 / 0.8)
    ride = graph.section["lift A g 1"]
    assert ride.resource == "A"
    assert ride.delay_s == pytest.approx((16.0 + 2.4) / 0.8)
    assert graph.lift["A"].stops == ("g:v", "1:v")
    assert {each.storey for each in districts(graph)} == {"g", "1", ""}
    assert len(pieces(graph)) == 1
    assert well_formed(graph) == ()


def test_a_long_arc_is_cut_and_two_chairs_pass_where_the_clear_width_is_known() -> None:
    ends = {"a": Node("a", NodeKind.END, 0.0, 0.0, "A"), "b": Node("b", NodeKind.END, 20.0, 0.0, "B")}
    hgraph = HGraph("Hall", submaps={"": SubMap("", nodes=ends, arcs=(Arc("a", "b", Way(speed=0.4)),))})
    traffic = building_traffic(hgraph)
    assert [round(each.length, 3) for each in traffic.graph.sections] == [6.667] * 3
    assert sum(each.delay_s for each in traffic.graph.sections) == pytest.approx(20 / 0.4 - 20 / 0.8)
    assert all(each.lanes == 1 for each in traffic.graph.sections)
    assert traffic.notes == ("the clear width of 1 of 1 arcs is unknown: they are taken as single file",)
    wide = building_traffic(hgraph, widths={ArcRef("", "a", "b"): 1.6})
    assert all(each.lanes == 2 for each in wide.graph.sections)
    assert wide.notes == ()


def test_closed_and_narrow_parts_are_left_out_and_told() -> None:
    hgraph = two_storeys()
    door = ArcRef("g", "c3", "store:d")
    closed = closed_arc(hgraph, door, "painting", 100)
    (apart,) = well_formed(building_traffic(closed, now_ns=50).graph)
    assert apart.others == ("Ground/Store/Bed g",)
    assert well_formed(building_traffic(closed, now_ns=200).graph) == ()
    traffic = building_traffic(hgraph, chair_width=0.75)
    assert any("g:c3>store:d is 0.80 m wide, too narrow" in note for note in traffic.notes)
    lift = replace(hgraph.lifts["A"], stops=hgraph.lifts["A"].stops[:1])
    alone = building_traffic(replace(hgraph, lifts={"A": lift}))
    assert alone.graph.lifts == ()
    assert "lift A has fewer than two open stops and is left out" in alone.notes
    assert [each.refuge for each in well_formed(alone.graph)] == [""]
    tight = Lift("A", stops=hgraph.lifts["A"].stops, door_width=0.6)
    assert any("lift A is 0.60 m wide" in note for note in building_traffic(replace(hgraph, lifts={"A": tight})).notes)


def test_a_building_without_an_open_way_is_refused() -> None:
    with pytest.raises(TrafficError, match="'Empty' has no open way for a chair"):
        building_traffic(HGraph("Empty"))


def test_a_place_on_the_way_to_another_is_named() -> None:
    nodes = {name: Node(name, NodeKind.END, x, 0.0, name) for name, x in (("ward", 0.0), ("desk", 5.0), ("bed", 10.0))}
    hgraph = HGraph("House", submaps={"": SubMap("", nodes=nodes, arcs=(Arc("ward", "desk"), Arc("desk", "bed")))})
    (found,) = well_formed(building_traffic(hgraph).graph)
    assert found.refuge == "desk"
    assert found.sentence.startswith("A chair at desk shuts off ")
