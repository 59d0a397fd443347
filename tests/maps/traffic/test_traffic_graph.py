"""The traffic graph, its runs, districts, checks and files."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from waychair.calibration.chair_body import CHAIR_B
from waychair.errors import TrafficError
from waychair.maps.traffic.single_file import districts, runs
from waychair.maps.traffic.traffic_files import read_traffic, traffic_from_text, traffic_text, write_traffic
from waychair.maps.traffic.traffic_graph import (
    Refuge,
    RefugeKind,
    Section,
    TrafficGraph,
    TrafficLift,
    TrafficNode,
    WayPoint,
    changes_since,
    lanes_for,
)
from waychair.maps.traffic.well_formed import ShutOff, pieces, refuse_pieces, well_formed


def chain(*names: str, width: float = 1.2, **more: object) -> TrafficGraph:
    """A corridor from the first name to the last, 5 m between each two."""
    nodes = tuple(TrafficNode(name, 5.0 * i, 0.0) for i, name in enumerate(names))
    sections = tuple(Section(f"{a}-{b}", a, b, 5.0, width, lanes_for(width, 0.6)) for a, b in pairwise(names))
    return TrafficGraph("corridor", nodes, sections, **more)  # type: ignore[arg-type]


def two_storeys() -> TrafficGraph:
    """A room and a lobby on each of two storeys, joined by a lift."""
    nodes = tuple(
        TrafficNode(f"{kind} {storey}", x, 0.0, str(storey))
        for storey in (0, 1)
        for kind, x in (("ward", 0.0), ("hall", 4.0), ("lobby", 8.0))
    )
    sections = tuple(
        Section(f"{a} {storey}-{b} {storey}", f"{a} {storey}", f"{b} {storey}", 4.0, 1.2)
        for storey in (0, 1)
        for a, b in (("ward", "hall"), ("hall", "lobby"))
    )
    ride = Section("ride 0-1", "lobby 0", "lobby 1", 3.0, 1.1, delay_s=40.0, lift="north")
    refuges = tuple(Refuge(node.name, node.name, slots=2) for node in nodes if node.name[0] in "wl")
    lifts = (TrafficLift("north", ("lobby 0", "lobby 1")),)
    return TrafficGraph("two storeys", nodes, (*sections, ride), refuges, lifts, revision=3)


@pytest.mark.parametrize(
    ("width", "cell", "lanes"),
    [
        (0.69, 0.05, 0),
        (0.7, 0.05, 1),
        (1.5, 0.05, 1),
        (1.525, 0.05, 1),
        (1.55, 0.05, 2),
        (1.5, 0.025, 1),
        (1.525, 0.025, 2),
    ],
)
def test_two_chairs_a_pass_in_their_widths_and_thirty_centimetres_and_a_cell(
    width: float, cell: float, lanes: int
) -> None:
    assert lanes_for(width, 0.6, cell) == lanes


def test_two_chairs_b_pass_in_one_metre_eighty() -> None:
    assert [lanes_for(1.8, CHAIR_B.width, cell) for cell in (0.025, 0.05, 0.1)] == [2, 2, 2]
    assert (lanes_for(1.75, CHAIR_B.width), lanes_for(1.74, CHAIR_B.width)) == (2, 1)


def test_a_corridor_without_branches_is_one_run() -> None:
    (run,) = runs(chain("a", "b", "c", "d"))
    assert (run.sections, run.nodes) == (("a-b", "b-c", "c-d"), ("a", "b", "c", "d"))


def test_a_run_ends_at_a_refuge_and_a_wide_section_is_in_none() -> None:
    graph = chain("a", "b", "c", "d", refuges=(Refuge("niche", "b", kind=RefugeKind.BAY, waiting=True),))
    assert [run.sections for run in runs(graph)] == [("a-b",), ("b-c", "c-d")]
    assert runs(chain("a", "b", width=1.8)) == ()


def test_a_ring_is_one_run_that_ends_where_it_begins() -> None:
    graph = chain("a", "b", "c")
    ring = replace(graph, sections=(*graph.sections, Section("c-a", "c", "a", 5.0, 1.2)))
    (run,) = runs(ring)
    assert set(run.sections) == {"a-b", "b-c", "c-a"}
    assert run.nodes[0] == run.nodes[-1]


def test_a_lift_and_its_lobbies_part_the_districts() -> None:
    found = districts(two_storeys())
    assert [set(district.sections) for district in found] == [
        {"ride 0-1"},
        {"ward 0-hall 0", "hall 0-lobby 0"},
        {"ward 1-hall 1", "hall 1-lobby 1"},
    ]
    assert [district.storey for district in found] == ["", "0", "1"]


def test_a_lift_is_one_resource_that_takes_its_ride_and_waiting() -> None:
    ride = two_storeys().section["ride 0-1"]
    assert ride.resource == "north"
    assert ride.seconds(0.3) == pytest.approx(50.0)


def test_a_chair_at_a_desk_in_the_corridor_shuts_off_the_room_behind_it() -> None:
    graph = chain("lobby", "desk", "ward", refuges=tuple(Refuge(name, name) for name in ("lobby", "desk", "ward")))
    (found,) = well_formed(graph)
    assert found == ShutOff("desk", ("ward",)) or found == ShutOff("desk", ("lobby",))
    assert "desk shuts off" in found.sentence


def test_a_second_way_round_makes_the_desk_harmless() -> None:
    graph = chain("lobby", "desk", "ward", refuges=tuple(Refuge(name, name) for name in ("lobby", "desk", "ward")))
    around = replace(graph, sections=(*graph.sections, Section("round", "lobby", "ward", 30.0, 1.2)))
    assert well_formed(around) == ()


def test_corridors_without_any_place_are_shut_off_from_nobody() -> None:
    places = tuple(Refuge(name, name) for name in ("desk", "ward", "bed"))
    graph = chain("attic", "loft", "stairs", "hall", "desk", "ward", "bed", refuges=places)
    (found,) = well_formed(graph)
    assert found == ShutOff("ward", ("bed",)) or found == ShutOff("ward", ("desk",))


def test_a_one_way_section_without_a_way_back_is_named() -> None:
    graph = chain("lobby", "ward", refuges=(Refuge("lobby", "lobby"), Refuge("ward", "ward")))
    one_way = replace(graph, sections=(replace(graph.sections[0], one_way=True),))
    (found,) = well_formed(one_way)
    assert found.refuge == ""
    assert found.others in (("ward",), ("lobby",))
    assert len(pieces(one_way)) == 2


def test_a_graph_without_places_is_in_pieces_as_a_whole_and_two_of_them_are_named() -> None:
    graph = chain("attic", "hall", "ward")
    assert well_formed(graph) == ()
    parted = replace(graph, sections=(graph.sections[0], replace(graph.sections[1], one_way=True)))
    (found,) = well_formed(parted)
    assert found == ShutOff("", ("ward",))
    refuse_pieces(graph)
    refuse_pieces(parted, ["attic", "hall"])
    with pytest.raises(TrafficError, match="no way leads from attic at 0 0 to ward at 10 0 and back"):
        refuse_pieces(parted)


def test_changes_are_told_by_name_and_equal_graphs_have_one_fingerprint() -> None:
    old = two_storeys()
    new = replace(
        old,
        sections=(replace(old.sections[0], width=1.0), *old.sections[1:]),
        refuges=(*old.refuges[:-1], Refuge("bay", "hall 1")),
        revision=4,
    )
    change = changes_since(old, new)
    assert (change.added, change.removed, change.altered) == (("bay",), ("lobby 1",), ("ward 0-hall 0",))
    assert not changes_since(old, replace(old, revision=9))
    assert old.fingerprint == replace(old, revision=9).fingerprint != new.fingerprint


def test_a_graph_comes_back_equal_from_its_file(tmp_path: Path) -> None:
    graph = replace(two_storeys(), name='the "old" house # 1')
    write_traffic(tmp_path / "traffic.txt", graph)
    assert read_traffic(tmp_path / "traffic.txt") == graph


def bent() -> TrafficGraph:
    """A section of 10 m round a right angle, from 1.2 to 2 m wide."""
    nodes = (TrafficNode("a", 0.0, 0.0), TrafficNode("b", 6.0, 4.0))
    way = (WayPoint(0.0, 0.0, 1.2), WayPoint(6.0, 0.0, 1.5), WayPoint(6.0, 4.0, 2.0))
    return TrafficGraph("bent", nodes, (Section("a-b", "a", "b", 10.0, 1.2, points=way),), cell=0.025)


def test_a_bent_way_comes_back_equal_from_its_file_and_an_old_file_has_cells_of_5_cm() -> None:
    assert traffic_from_text(traffic_text(bent())) == bent()
    old = traffic_text(chain("a", "b")).replace(" cell 0.05", "")
    assert traffic_from_text(old) == chain("a", "b")
    assert chain("a", "b").way("a-b") == (WayPoint(0.0, 0.0, 1.2), WayPoint(5.0, 0.0, 1.2))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ((" 6.0 4.0 2.0", ""), "is 6.00 m long, not 10.00 m|does not lead from node a to b"),
        ((" 2.0\n", "\n"), "has 8 numbers"),
        (("6.0 0.0 1.5", "6.0 1.0 1.5"), "m long, not 10.00 m"),
        (("6.0 0.0 1.5", "6.0 0.0 1.0"), "narrower than 1.20 m"),
        (("6.0 0.0 1.5", "6.0 nan 1.5"), "not finite"),
        (("way a-b 0.0", "way a-b 0.5"), "does not lead from node a to b"),
        (("way a-b", "way a-c"), "does not follow its section"),
        (("cell 0.025", "cell 0"), "cells of 0.0 m are impossible"),
    ],
)
def test_an_impossible_way_is_refused_in_one_sentence(change: tuple[str, str], told: str) -> None:
    text = traffic_text(bent())
    assert change[0] in text
    with pytest.raises(TrafficError, match=told) as refused:
        traffic_from_text(text.replace(*change), "bent.txt")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("traffic-graph 1", "traffic"), "first line"),
        (("graph corridor chair_width", "graph corridor width"), "does not read"),
        (("node b ground 5.0", "node b ground five"), "line 4"),
        (("node b ground 5.0", "node b ground nan"), "finite"),
        (("node b", "node a"), "names node a twice"),
        (("section a-b a b", "section a-b a x"), "names node x"),
        (("section a-b a b", "section a-b a a"), "to itself"),
        (("length 5.0", "length 0"), "above 0"),
        (("width 1.2", "width 0.5"), "too narrow"),
        (("lanes 1", "lanes 2"), "room for 1"),
        (("both", "bath"), "neither both nor one_way"),
        (("delay 0.0", "delay -1"), "0 or more"),
        (("lift -", "lift north"), "belongs to lift north"),
        (("node a", "knot a"), "is no record"),
    ],
)
def test_an_impossible_file_is_refused_in_one_sentence(change: tuple[str, str], told: str) -> None:
    text = traffic_text(chain("a", "b"))
    assert change[0] in text
    with pytest.raises(TrafficError, match=told) as refused:
        traffic_from_text(text.replace(*change), "corridor.txt")
    assert "\n" not in str(refused.value)


def test_a_lift_of_one_stop_is_refused() -> None:
    with pytest.raises(TrafficError, match="fewer than two stops"):
        chain("a", "b", lifts=(TrafficLift("north", ("a",)),))
