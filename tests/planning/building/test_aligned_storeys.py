"""Storeys that were mapped apart from each other are laid on each other by the lifts that they share."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.maps.building.buildings import two_storeys
from waychair.maps.building.building import Building, load_building, save_building
from waychair.maps.building.checks.hgraph_checks import check
from waychair.maps.building.hgraph import Arc, HGraph, Lift, Node, NodeKind, NodeRef, Stop, SubmapFrame
from waychair.maps.building.hgraph_edits import with_lift, with_submap
from waychair.maps.drawn.places import load_places, save_places
from waychair.planning.building.generation.storey_generation import aligned_storey
from waychair.planning.building.hierarchical import Method, RoutePlanner
from waychair.types import Place, Pose2

TURNED = SubmapFrame(4.0, -7.0, 2.0)
"""The first floor's map in the building's frame."""


def mapped_apart(second_lift: bool) -> HGraph:
    """Return the small building; the coordinates of its first floor are those of a map that began elsewhere, turned."""
    hgraph = two_storeys()
    first = hgraph.submaps["1"]
    nodes = {
        key: replace(node, x=x, y=y) for key, node in first.nodes.items() for x, y in [TURNED.inside(node.x, node.y)]
    }
    hgraph = with_submap(hgraph, replace(first, nodes=nodes))
    for path in hgraph.children("1"):
        frame = hgraph.submaps[path].frame
        x, y = TURNED.inside(frame.x, frame.y)
        hgraph = with_submap(hgraph, replace(hgraph.submaps[path], frame=SubmapFrame(x, y, frame.theta - TURNED.theta)))
    if not second_lift:
        return hgraph
    for storey in ("g", "1"):
        submap = hgraph.submaps[storey]
        x, y = (15.0, -1.0) if storey == "g" else TURNED.inside(15.0, -1.0)
        lobby = Node("w", NodeKind.LIFT, x, y)
        hgraph = with_submap(
            hgraph, replace(submap, nodes={**submap.nodes, "w": lobby}, arcs=(*submap.arcs, Arc("c3", "w")))
        )
    return with_lift(hgraph, Lift("B", stops=(Stop("g", NodeRef("g", "w")), Stop("1", NodeRef("1", "w")))))


def test_two_lifts_tell_where_a_storeys_map_lies_and_how_it_is_turned(tmp_path: Path) -> None:
    apart = mapped_apart(second_lift=True)
    assert [each.code for each in check(apart) if each.code == "E8"] != []
    aligned = aligned_storey(Building(tmp_path, apart), "1")
    frame = aligned.submaps["1"].frame
    assert (frame.x, frame.y, frame.theta) == pytest.approx((4.0, -7.0, 2.0), abs=2e-3)
    assert [each.sentence for each in check(aligned) if each.severity == "error"] == []
    assert aligned_storey(Building(tmp_path, aligned), "1") == aligned
    assert aligned_storey(Building(tmp_path, aligned), "g") == aligned
    ends = NodeRef("g/ward", "e"), NodeRef("1/store", "e")
    by_the_first = RoutePlanner(aligned, Method.ASTAR).route(*ends, avoid=["B"])
    assert by_the_first.cost == pytest.approx(RoutePlanner(two_storeys(), Method.ASTAR).cost(*ends), abs=3)


def test_one_lift_tells_it_by_the_headings_of_the_places_in_front_of_its_doors(tmp_path: Path) -> None:
    hgraph = mapped_apart(second_lift=False)
    storeys = tuple(replace(each, map=f"maps/{each.id}") for each in hgraph.storeys)
    hgraph = replace(hgraph, storeys=storeys)
    for storey, pose in (("g", Pose2(3.0, 0.0, 0.5)), ("1", Pose2(*TURNED.inside(3.0, 0.0), 0.5 - TURNED.theta))):
        submap = hgraph.submaps[storey]
        lobby = replace(submap.nodes["v"], name="Lift")
        hgraph = with_submap(hgraph, replace(submap, nodes={**submap.nodes, "v": lobby}))
        save_places(tmp_path / "maps" / storey, {"Lift": Place("Lift", pose)})
    aligned = aligned_storey(Building(tmp_path, hgraph), "1")
    frame = aligned.submaps["1"].frame
    assert (frame.x, frame.y, frame.theta) == pytest.approx((4.0, -7.0, 2.0), abs=2e-3)


def test_the_places_of_a_turned_storey_stay_where_they_are_in_its_map(tmp_path: Path) -> None:
    aligned = aligned_storey(Building(tmp_path, mapped_apart(second_lift=True)), "1")
    storeys = tuple(replace(each, map=f"maps/{each.id}") for each in aligned.storeys)
    ward = aligned.submaps["1/ward"]
    named = replace(ward.nodes["e"], name="Window")
    aligned = replace(with_submap(aligned, replace(ward, nodes={**ward.nodes, "e": named})), storeys=storeys)
    at = aligned.map_frame_of("1/ward").point(0.0, 3.0)
    assert at == pytest.approx(TURNED.inside(10.0, 3.25))
    save_places(tmp_path / "maps" / "1", {"Window": Place("Window", Pose2(*at, 1.0))})
    save_building(Building(tmp_path, aligned))

    assert load_building(tmp_path).hgraph == aligned
    moved = {"Window": Place("Window", Pose2(at[0] + 1.0, at[1], 1.0))}
    save_places(tmp_path / "maps" / "1", moved)
    node = load_building(tmp_path).hgraph.submaps["1/ward"].nodes["e"]
    assert aligned.map_frame_of("1/ward").point(node.x, node.y) == pytest.approx((at[0] + 1.0, at[1]))
    assert np.hypot(node.x, node.y - 3.0) == pytest.approx(1.0)
    assert load_places(tmp_path / "maps" / "1") == moved
