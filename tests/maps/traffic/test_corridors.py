"""Floor plans of corridors, and the graphs, cells and worlds made of them."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import pytest

from waychair.errors import TrafficError
from waychair.maps.traffic.corridors import corridor_graph, floor_plan_names, load_corridors, room_doors
from waychair.maps.traffic.well_formed import well_formed

SHAPES = {
    "Rectangle": (12, 12, 1, 96),
    "I": (12, 11, 0, 72),
    "T": (8, 7, 0, 48),
    "2bconR": (8, 7, 0, 48),
    "3tie": (16, 18, 3, 51),
    "4cross": (16, 16, 1, 96),
    "9cube": (16, 24, 9, 192),
    "2d-grid": (49, 84, 36, 336),
    "fig8": (7, 7, 1, 20),
}


def test_the_shipped_plans_are_the_eight_of_the_paper_and_its_real_floor() -> None:
    assert set(floor_plan_names()) == set(SHAPES)


@pytest.mark.parametrize("name", SHAPES)
def test_a_plan_has_its_nodes_edges_circles_and_metres(name: str) -> None:
    graph = corridor_graph(load_corridors(name))
    circles = len(graph.sections) - len(graph.nodes) + 1
    metres = sum(section.length for section in graph.sections)
    assert (len(graph.nodes), len(graph.sections), circles, metres) == SHAPES[name]
    assert max(section.length for section in graph.sections) <= 8


@pytest.mark.parametrize("name", SHAPES)
def test_rooms_stand_apart_and_shut_nobody_off(name: str) -> None:
    plan = load_corridors(name)
    graph = corridor_graph(plan, rooms=True)
    places = [place for _, place in room_doors(plan).values()]
    assert len(graph.refuges) == len(places) >= 5
    assert min(math.dist(a, b) for i, a in enumerate(places) for b in places[:i]) >= 3
    assert well_formed(graph) == ()


def test_one_chair_drives_in_a_narrow_corridor_and_two_in_a_wide_one() -> None:
    plan = load_corridors("T")
    assert {section.lanes for section in corridor_graph(plan, 1.2).sections} == {1}
    assert {section.lanes for section in corridor_graph(plan, 1.8).sections} == {2}
    with pytest.raises(TrafficError, match="no room for a chair"):
        corridor_graph(plan, 0.6)
    with pytest.raises(TrafficError, match="no room for a chair"):
        corridor_graph(plan, float("nan"))


def test_the_first_way_of_the_real_floor_is_shorter_than_the_second() -> None:
    graph = corridor_graph(load_corridors("fig8"))
    length = {frozenset((section.start, section.end)): section.length for section in graph.sections}
    first = ("10", "05", "03", "02", "00")
    second = ("10", "11", "12", "00")
    ways = [sum(length[frozenset(pair)] for pair in pairwise(way)) for way in (first, second)]
    assert ways == [9.0, 11.0]


@pytest.mark.parametrize(
    ("corridors", "told"),
    [
        ("[[3, 3, 31, 3]]", "leaves the plan"),
        ("[[3, 3, 9, 4]]", "lies at an angle"),
        ("[[3, 3, 3, 3]]", "has no length"),
        ("[[3, 3, .nan, 3]]", "not finite"),
        ("[[3, 3, 9, 3], [3, 9, 9, 9]]", "2 pieces"),
        ("[]", "no corridors"),
        ("[[3, 3, 9]]", "no floor plan"),
        ("[[3, 3, 9, 3]]\nwidth: 3", "no floor plan"),
    ],
)
def test_an_impossible_plan_is_refused_in_one_sentence(tmp_path: Path, corridors: str, told: str) -> None:
    path = tmp_path / "plan.yaml"
    path.write_text(f"name: plan\nsize: [30, 30]\ncorridors: {corridors}\n")
    with pytest.raises(TrafficError, match=told):
        corridor_graph(load_corridors(path))


def test_an_unknown_plan_is_told_with_those_there_are() -> None:
    with pytest.raises(TrafficError, match="2bconR"):
        load_corridors("nowhere")
