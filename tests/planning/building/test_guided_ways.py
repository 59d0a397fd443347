"""Ways of a building as a rider meets them: junctions, plans, and the movements along them with landmarks."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.maps.building.buildings import two_storeys
from waychair.errors import BuildingError, NoPath
from waychair.maps.building.hgraph import Arc, ArcRef, Node, NodeKind, NodeRef
from waychair.maps.building.hgraph_edits import closed, with_submap
from waychair.planning.building.guided_ways import GuidedWays, joined_where_they_pass
from waychair.planning.movements import MovementKind
from waychair.types import OccupancyGrid, Pose2


def test_both_sides_of_a_doorway_are_one_junction_with_a_door() -> None:
    ways = GuidedWays(two_storeys())
    corner, inside = NodeRef("g", "c2"), NodeRef("g/ward", "d")
    assert ways.junction(corner) == ways.junction(inside)
    known = ways.storey("g")
    assert known.junctions[ways.junction(corner)].door
    assert len(known.junctions) == 6  # v, c1, c2 with its door, c3 with its door, two beds


def test_a_plan_over_two_storeys_has_a_part_on_each_and_names_the_lift_and_the_storey_to_press() -> None:
    ways = GuidedWays(two_storeys())
    plan = ways.plan("g", None, ways.junction(NodeRef("g/ward", "e")), NodeRef("1/store", "e"))
    first, second = plan.parts
    assert (first.storey, first.title, first.to_title) == ("g", "Lift A", "First")
    assert (second.storey, second.lift) == ("1", "")
    kinds = [each.movement.kind for each in second.told]
    assert kinds == [
        MovementKind.STRAIGHT,
        MovementKind.LEFT,
        MovementKind.DOOR,
        MovementKind.STRAIGHT,
        MovementKind.ARRIVED,
    ]
    assert second.told[0].movement.landmark == "to the second door on the left"


def test_movements_follow_each_other_without_gap_and_their_turns_have_the_poses_of_the_map() -> None:
    ways = GuidedWays(two_storeys())
    plan = ways.plan("g", None, ways.junction(NodeRef("g", "v")), NodeRef("g/ward", "e"))
    told = plan.parts[0].told
    for one, other in pairwise(told):
        assert other.begins == pytest.approx(one.ends, abs=0.81)  # a straight part this short is not told
    turn = next(each.movement for each in told if each.movement.kind is MovementKind.LEFT)
    assert turn.start is not None
    assert (turn.start.x, turn.start.y) == pytest.approx((10.0, 0.125))
    assert turn.angle == pytest.approx(np.pi / 2, abs=0.1)


def test_a_small_jog_of_the_graph_is_no_turn() -> None:
    hgraph = two_storeys()
    corridor = hgraph.submaps["g"]
    nodes = {**corridor.nodes, "k": Node("k", NodeKind.CROSS, 7.5, 0.3)}
    arcs = (Arc("v", "c1"), Arc("c1", "k"), Arc("k", "c2"), Arc("c2", "c3"))
    ways = GuidedWays(with_submap(hgraph, replace(corridor, nodes=nodes, arcs=arcs)))
    plan = ways.plan("g", None, ways.junction(NodeRef("g", "v")), NodeRef("g/ward", "e"))
    turns = [each.movement.kind for each in plan.parts[0].told if each.movement.angle]
    assert turns == [MovementKind.LEFT]


def test_an_arc_that_passes_a_node_is_cut_there_but_not_if_it_is_one_way_or_closed() -> None:
    hgraph = two_storeys()
    corridor = hgraph.submaps["g"]
    long = replace(corridor, arcs=(Arc("v", "c1"), Arc("c1", "c3"), Arc("c2", "c3")))
    cut = joined_where_they_pass(with_submap(hgraph, long)).submaps["g"]
    assert {frozenset((arc.start, arc.end)) for arc in cut.arcs} == {
        frozenset(pair) for pair in (("v", "c1"), ("c1", "c2"), ("c2", "c3"))
    }
    one_way = replace(long, arcs=(Arc("c1", "c3", replace(long.arcs[0].way, one_way=True)),))
    assert joined_where_they_pass(with_submap(hgraph, one_way)).submaps["g"].arcs == one_way.arcs


def test_a_closed_way_is_planned_round_or_named() -> None:
    hgraph = closed(two_storeys(), ArcRef("g", "c2", "c3"), "wet floor")
    ways = GuidedWays(hgraph)
    with pytest.raises(NoPath, match="wet floor"):
        ways.plan("g", None, ways.junction(NodeRef("g", "c1")), NodeRef("g/store", "e"))
    with pytest.raises(BuildingError, match="no graph to guide by"):
        ways.storey("cellar")


def test_a_wall_of_the_map_hides_a_way_and_a_cabin_is_where_its_lift_stops() -> None:
    cells = np.zeros((100, 400), np.int8)
    cells[50] = 100  # a wall along y = 0.5
    ways = GuidedWays(two_storeys(), {"g": OccupancyGrid(cells, 0.05, Pose2(0.0, -2.0, 0.0))})
    assert not ways.in_sight("g", np.array([5.0, 0.0]), np.array([5.0, 2.0]))
    assert ways.in_sight("g", np.array([5.0, 0.0]), np.array([9.0, 0.2]))
    assert ways.in_sight("1", np.array([5.0, 0.0]), np.array([5.0, 2.0]))
    assert ways.cabin_of("g", Pose2(1.0, 0.0, 0.0)) == ""
