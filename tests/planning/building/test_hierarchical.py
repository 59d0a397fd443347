"""Routes through a building, their legs and movements."""

from __future__ import annotations

import pytest

from tests.maps.building.buildings import two_storeys
from waychair.errors import BuildingError, NoPath
from waychair.maps.building.hgraph import ArcRef, Closure, NodeRef
from waychair.maps.building.hgraph_edits import closed, with_drives, with_lift, with_way
from waychair.planning.building.hierarchical import Method, RoutePlanner
from waychair.planning.movements import MovementKind


@pytest.mark.parametrize("method", list(Method))
def test_a_route_over_two_storeys_costs_its_metres_turns_doors_and_lift(method: Method) -> None:
    planner = RoutePlanner(two_storeys(), method)
    route = planner.route(planner.node("Ground/Ward/Bed g"), planner.node("First/Store/Bed 1"))
    driven = 3.0 + 0.25 + 5.0 + 2.0 + 2.0 + 5.0 + 5.0 + 0.25 + 3.0
    doors, turns, lift = 2.0 + 5.0, 2 * 0.8, 16.0 + 4.0 + 2.4 + 4.0
    assert route.cost == round(1000 * (driven + doors + turns + lift))
    assert route.length == pytest.approx(driven)
    assert [(leg.storey, leg.lift) for leg in route.legs] == [("g", ""), ("1", "A"), ("1", "")]
    assert sum(leg.cost for leg in route.legs) == route.cost


def test_movements_are_told_in_order_and_their_costs_add_up() -> None:
    planner = RoutePlanner(two_storeys())
    route = planner.route(planner.node("Ground/Ward/Bed g"), planner.node("First/Store/Bed 1"))
    kinds = [movement.kind for movement in route.movements]
    assert kinds == [
        MovementKind.STRAIGHT,
        MovementKind.DOOR,
        MovementKind.RIGHT,
        MovementKind.STRAIGHT,
        MovementKind.WAIT,
        MovementKind.INTO_LIFT,
        MovementKind.PRESS,
        MovementKind.LEAVE_LIFT,
        MovementKind.STRAIGHT,
        MovementKind.LEFT,
        MovementKind.STRAIGHT,
        MovementKind.DOOR,
        MovementKind.STRAIGHT,
        MovementKind.ARRIVED,
    ]
    assert sum(movement.cost for movement in route.movements) == route.cost
    sentences = [movement.sentence() for movement in route.movements]
    assert "Lift A to First" in sentences
    assert "straight 12 m" in sentences


def test_a_closed_arc_is_named_with_its_reason_where_there_is_no_other_way() -> None:
    hgraph = closed(two_storeys(), ArcRef("g", "c2", "c3"), "wet floor")
    planner = RoutePlanner(hgraph)
    with pytest.raises(NoPath, match=r"g:c2>c3 is closed \(wet floor\): open it"):
        planner.route(planner.node("Ground/Ward/Bed g"), planner.node("Ground/Store/Bed g"))


def test_a_closure_ends_at_its_time() -> None:
    hgraph = with_way(two_storeys(), ArcRef("g", "c2", "c3"), closure=Closure("cleaning", 1_000))
    ends = NodeRef("g/ward", "e"), NodeRef("g/store", "e")
    with pytest.raises(NoPath):
        RoutePlanner(hgraph, now_ns=999).route(*ends)
    assert RoutePlanner(hgraph, now_ns=1_000).route(*ends).cost > 0


def test_avoiding_the_only_lift_names_it_and_a_second_one_is_taken_instead() -> None:
    hgraph = two_storeys()
    ends = NodeRef("g/ward", "e"), NodeRef("1/ward", "e")
    with pytest.raises(NoPath, match="Lift A is to be avoided"):
        RoutePlanner(hgraph).route(*ends, avoid=["A"])
    lift = hgraph.lifts["A"]
    slow = type(lift)("B", "Lift B", lift.stops, wait=60.0)
    route = RoutePlanner(with_lift(hgraph, slow)).route(*ends, avoid=["A"])
    assert [leg.lift for leg in route.legs if leg.lift] == ["B"]


def test_costs_to_all_goals_of_a_menu_equal_single_ones() -> None:
    planner = RoutePlanner(two_storeys())
    ends = [NodeRef(f"{storey}/{room}", "e") for storey in ("g", "1") for room in ("ward", "store")]
    costs = planner.costs_from(ends[0], ends)
    assert costs == {end: planner.cost(ends[0], end) for end in ends}


def test_an_unknown_or_ambiguous_goal_is_answered_with_names() -> None:
    planner = RoutePlanner(two_storeys())
    with pytest.raises(BuildingError, match="there are 2 goals 'Bed g': write one in full"):
        planner.node("Bed g")
    with pytest.raises(BuildingError, match="there is no goal 'Bath'; did you mean"):
        planner.node("Bath")
    assert planner.node("ward/bed g") == NodeRef("g/ward", "e")


@pytest.mark.parametrize("method", [Method.TABLES, Method.ASTAR])
def test_a_closure_is_a_call_that_ends_by_itself_and_a_price_changes_the_way(method: Method) -> None:
    planner = RoutePlanner(two_storeys(), method)
    ends, arc = (NodeRef("g/ward", "e"), NodeRef("g/store", "e")), ArcRef("g", "c2", "c3")
    before = planner.cost(*ends)
    planner.close(arc, "wet floor", until_ns=5_000)
    with pytest.raises(NoPath, match=r"g:c2>c3 is closed \(wet floor\)"):
        planner.route(*ends)
    assert planner.reopen_ended(4_999) == ()
    assert planner.reopen_ended(5_000) == (arc,)
    assert planner.cost(*ends) == before
    planner.reprice(arc, 12.5)
    assert planner.cost(*ends) == before + 7_500
    planner.reprice(arc, None)
    assert planner.cost(*ends) == before
    with pytest.raises(BuildingError, match="there is no arc g:c1>c3"):
        planner.close(ArcRef("g", "c1", "c3"), "wet floor")
    with pytest.raises(BuildingError, match="the price of g:c2>c3 is -1 m"):
        planner.reprice(arc, -1.0)


def test_five_measured_drives_replace_the_estimate_and_four_do_not() -> None:
    arc, ends = ArcRef("g", "c2", "c3"), (NodeRef("g/ward", "e"), NodeRef("g/store", "e"))
    before = RoutePlanner(two_storeys()).cost(*ends)
    few = with_drives(two_storeys(), {arc: [10.0, 11.0, 12.0, 13.0]})
    assert RoutePlanner(few).cost(*ends) == before
    many = with_drives(two_storeys(), {arc: [10.0, 11.0, 12.0, 13.0, 50.0]})
    assert RoutePlanner(many).cost(*ends) == before - 5_000 + round(1000 * 12.0 * 0.8)
    with pytest.raises(BuildingError, match="took 0 s, which is impossible"):
        with_drives(two_storeys(), {arc: [0.0]})
