"""The checks of a building's graph, a test for each number."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.maps.building.buildings import two_storeys
from waychair.maps.building.checks.graph_findings import GraphFinding, GraphSurroundings
from waychair.maps.building.checks.hgraph_checks import Checker, check
from waychair.maps.building.hgraph import (
    Arc,
    ArcRef,
    Closure,
    GraphDoorway,
    HGraph,
    Lift,
    Node,
    NodeKind,
    NodeRef,
    Stop,
    Storey,
    SubMap,
    SubmapFrame,
    Way,
)
from waychair.maps.building.hgraph_edits import closed, with_lift, with_nodes, with_submap, with_way
from waychair.maps.drawn.zones import Rule, Zone
from waychair.types import OccupancyGrid, Place, Pose2


def in_ground(change: Callable[[SubMap], SubMap]) -> HGraph:
    """Return the small building with its ground floor changed."""
    hgraph = two_storeys()
    return with_submap(hgraph, change(hgraph.submaps["g"]))


def node(key: str, x: float, y: float, kind: NodeKind = NodeKind.CROSS, name: str = "") -> Node:
    """Return a node."""
    return Node(key, kind, x, y, name)


def with_arcs(submap: SubMap, *arcs: Arc, nodes: tuple[Node, ...] = ()) -> SubMap:
    """Return a sub-map with more nodes and arcs."""
    return replace(with_nodes(submap, nodes), arcs=(*submap.arcs, *arcs))


def codes(found: tuple[GraphFinding, ...]) -> list[str]:
    """Return the codes of findings, in order."""
    return [each.code for each in found]


def only(hgraph: HGraph, code: str, around: GraphSurroundings | None = None) -> GraphFinding:
    """Return the one finding of this code that the small building does not have by itself."""
    known = set(check(two_storeys()))
    found = check(hgraph) if around is None else check(hgraph, around)
    new = [each for each in found if each.code == code and each not in known]
    assert len(new) == 1, [(each.code, each.sentence) for each in found]
    return new[0]


def test_the_small_building_has_no_error() -> None:
    assert [each for each in check(two_storeys()) if each.severity == "error"] == []


def test_e1_a_node_without_arc() -> None:
    found = only(in_ground(lambda ground: with_nodes(ground, [node("x", 40.0, 40.0)])), "E1")
    assert (found.place, found.sentence) == ("g:x", "node g:x has no arc")


def test_e2_a_node_with_five_arcs_and_e3_two_arcs_in_one_direction() -> None:
    more = [node(f"x{i}", 10.0 + 3.0 * math.cos(a), 3.0 * math.sin(a)) for i, a in enumerate((-1.2, -1.9))]
    hgraph = in_ground(lambda ground: with_arcs(ground, Arc("c2", "x0"), Arc("c2", "x1"), nodes=tuple(more)))
    assert only(hgraph, "E2").sentence == "node g:c2 has 5 arcs"
    assert only(hgraph, "E3").sentence == "two arcs of node g:c2 are only 40 degrees apart"


@pytest.mark.parametrize(
    ("arc", "sentence"),
    [(Arc("c1", "c1"), "both ends of arc g:c1>c1 are at one point"), (Arc("c2", "c1"), "arc g:c2>c1 is there twice")],
)
def test_e4_an_arc_to_itself_and_a_doubled_arc(arc: Arc, sentence: str) -> None:
    assert only(in_ground(lambda ground: with_arcs(ground, arc)), "E4").sentence == sentence


@pytest.mark.parametrize("length", [4.4, 15.1])
def test_e5_a_length_that_does_not_fit_the_distance(length: float) -> None:
    found = only(with_way(two_storeys(), ArcRef("g", "c1", "c2"), length=length), "E5")
    assert found.sentence == f"arc g:c1>c2 is {length:.1f} m long between ends 5.0 m apart"


def test_e5_an_arc_through_a_wall_that_the_planner_cannot_drive() -> None:
    cells = np.zeros((100, 200), np.int8)
    cells[:, 75] = 100
    around = GraphSurroundings(
        width=0.6, grids={"g": OccupancyGrid(cells, 0.1, Pose2(0.0, -5.0))}, driven=lambda storey, one, other: None
    )
    found = only(two_storeys(), "E5", around)
    assert found.place == "g:c1>c2"
    assert "crosses a wall: the planner finds no way" in found.sentence


def test_e6_a_door_too_narrow_for_this_chair() -> None:
    found = [each for each in check(two_storeys(), GraphSurroundings(width=0.72)) if each.code == "E6"]
    assert [each.place for each in found] == ["g:c3>store:d", "1:c3>store:d"]
    assert found[0].remedy == "take it out for this chair: one of at most 0.70 m fits"


def test_e6_a_lift_door_too_narrow_for_this_chair() -> None:
    lift = replace(two_storeys().lifts["A"], door_width=0.75)
    wide = replace(lift, stops=(replace(lift.stops[0], door_width=0.9), lift.stops[1]))
    found = [each for each in check(with_lift(two_storeys(), wide), GraphSurroundings(width=0.7)) if each.code == "E6"]
    assert [each.place for each in found] == ["1:v"]
    assert "the door of lift 'A' at storey '1' is 0.75 m wide, and this chair is 0.70 m" in found[0].sentence


def test_e7_a_doorway_without_its_other_side_or_too_far_from_it() -> None:
    hgraph = in_ground(lambda ground: replace(ground, doorways=(*ground.doorways, GraphDoorway("c1", "bath", "d"))))
    assert only(hgraph, "E7").sentence == "the doorway g:c1>bath:d leads to g/bath:d, which is no node"
    ward = two_storeys().submaps["g/ward"]
    moved = with_submap(two_storeys(), replace(ward, frame=SubmapFrame(10.0, 0.6)))
    assert "0.60 m apart" in only(moved, "E7").sentence
    alone = with_submap(two_storeys(), with_arcs(ward, Arc("x", "e"), nodes=(node("x", 3.0, 3.0, NodeKind.BRIDGE),)))
    assert only(alone, "E7").sentence == "the doorway of g/ward:x has no other side"


def test_e8_faults_of_lifts() -> None:
    lift = two_storeys().lifts["A"]
    one = with_lift(two_storeys(), replace(lift, stops=lift.stops[:1]))
    assert [each.sentence for each in check(one) if each.code == "E8"] == [
        "1:v stands in front of no lift",
        "lift 'A' has 1 stops",
    ]
    doubled = with_lift(two_storeys(), replace(lift, stops=(*lift.stops, Stop("1", NodeRef("1", "c1")))))
    sentences = [each.sentence for each in check(doubled) if each.code == "E8"]
    assert "lift 'A' has two stops on storey '1'" in sentences
    assert "lift 'A' stops at 1:c1, which is of kind 'cross'" in sentences
    small = with_lift(two_storeys(), replace(lift, cabin_width=0.9, cabin_depth=1.0))
    assert "depth of 1.00 m, and the chair one of 1.10 m" in only(small, "E8", GraphSurroundings(length=1.1)).sentence
    aside = with_submap(two_storeys(), replace(two_storeys().submaps["1"], frame=SubmapFrame(0.5, 0.0)))
    assert "are 0.5 m out of line" in only(aside, "E8").sentence
    nowhere = with_lift(two_storeys(), Lift("B", stops=(Stop("g", NodeRef("g", "q")), lift.stops[1])))
    assert "lift 'B' stops at g:q, which is no node" in [each.sentence for each in check(nowhere)]


def test_e9_a_doorway_between_storeys_that_a_lift_joins_is_an_error_unless_it_is_a_ramp() -> None:
    def ramp(is_ramp: bool) -> HGraph:
        hgraph = with_submap(
            two_storeys(), SubMap("g/up", storey="1", nodes={"d": node("d", 5.0, 0.2, NodeKind.BRIDGE)})
        )
        door = GraphDoorway("c1", "up", "d", Way(ramp=is_ramp))
        return with_submap(hgraph, replace(hgraph.submaps["g"], doorways=(*hgraph.submaps["g"].doorways, door)))

    assert only(ramp(is_ramp=False), "E9").sentence == "g:c1>up:d joins storeys that lift 'A' joins, too"
    assert "E9" not in codes(check(ramp(is_ramp=True)))


def test_e10_a_sub_map_without_doorway_and_one_without_parent() -> None:
    bath = SubMap("g/bath", nodes={"a": node("a", 0.0, 0.0), "b": node("b", 1.0, 0.0)}, arcs=(Arc("a", "b"),))
    assert only(with_submap(two_storeys(), bath), "E10").sentence == "sub-map 'g/bath' has neither doorway nor lift"
    orphan = replace(two_storeys(), submaps={**two_storeys().submaps, "x/y": replace(bath, path="x/y")})
    assert only(orphan, "E10").sentence == "sub-map 'x/y' has no parent, so a level is missing"


def test_e11_and_e18_a_goal_behind_a_one_way_arc_and_the_arc_itself() -> None:
    hgraph = with_way(two_storeys(), ArcRef("g/ward", "d", "e"), one_way=True)
    found = only(hgraph, "E11")
    assert found.place == "g/ward:e"
    assert "cannot be reached from all others and back: its island is g/ward:e" in found.sentence
    assert only(hgraph, "E18").sentence == "the one-way arc g/ward:d>e leaves no way back"
    shut = closed(two_storeys(), ArcRef("g/ward", "d", "e"), "cleaning")
    assert only(shut, "E18").sentence == "the closed arc g/ward:d>e leaves no way back"


def test_e12_nodes_that_almost_touch_and_arcs_that_cross() -> None:
    near = in_ground(lambda ground: with_arcs(ground, Arc("c3", "x"), nodes=(node("x", 5.2, 0.1),)))
    assert "nodes g:c1 and x are 0.22 m apart and not joined" in [each.sentence for each in check(near)]
    across = (node("x", 7.0, -2.0), node("y", 8.0, 2.0))
    crossing = in_ground(lambda ground: with_arcs(ground, Arc("x", "y"), nodes=across))
    assert only(crossing, "E12").sentence == "arcs g:c1>c2 and x>y cross without a node"


def test_e12_nodes_and_arcs_of_two_sub_maps_that_touch_or_cross_without_a_doorway() -> None:
    shed = SubMap(
        "g/shed",
        frame=SubmapFrame(15.0, 0.25),
        nodes={"d": node("d", 0.0, 0.0, NodeKind.BRIDGE), "x": node("x", -5.1, 3.1)},
    )
    doors = (*two_storeys().submaps["g"].doorways, GraphDoorway("c3", "shed", "d"))
    touching = with_submap(in_ground(lambda ground: replace(ground, doorways=doors)), with_arcs(shed, Arc("d", "x")))
    sentences = [each.sentence for each in check(touching) if each.code == "E12"]
    assert sentences == ["nodes g/ward:e and g/shed:x are 0.14 m apart and not joined"]  # the two doors of c3 meet
    crossing = replace(shed, nodes={**shed.nodes, "x": node("x", -7.0, 3.1)})
    sentences = [
        each.sentence for each in check(with_submap(touching, with_arcs(crossing, Arc("d", "x")))) if each.code == "E12"
    ]
    assert sentences == ["arcs g/ward:d>e and g/shed:d>x cross without a node"]


def test_e13_empty_names_and_names_that_differ_by_case_and_accents() -> None:
    goals = (node("x", 10.0, -3.0, NodeKind.END, "Café"), node("y", 12.0, -3.0, NodeKind.END, "CAFE"))
    hgraph = in_ground(lambda ground: with_arcs(ground, Arc("c2", "x"), Arc("x", "y"), nodes=goals))
    assert only(hgraph, "E13").sentence == "the goals 'Café' and 'CAFE' of 'g' are named alike"
    unnamed = (node("x", 10.0, -3.0, NodeKind.END),)
    assert only(in_ground(lambda ground: with_arcs(ground, Arc("c2", "x"), nodes=unnamed)), "E13").place == "g:x"


def test_e14_a_goal_in_a_wall_and_one_without_place() -> None:
    cells = np.zeros((100, 200), np.int8)
    cells[82:, 90:110] = 100
    around = GraphSurroundings(grids={"g": OccupancyGrid(cells, 0.1, Pose2(0.0, -5.0))}, places={"g": {}})
    sentences = [each.sentence for each in check(two_storeys(), around) if each.code == "E14"]
    assert "the goal 'Bed g' lies in a wall or off the map" in sentences
    assert "the goal 'Bed g' is no place of storey 'g'" in sentences
    placed = GraphSurroundings(places={"g": {"Bed g": Place("Bed g", Pose2())}})
    assert "E14" not in codes(check(two_storeys(), placed))


def test_e14_a_goal_in_a_keep_out_zone_without_room_to_turn_and_a_place_that_is_no_goal() -> None:
    corners = np.array([(9.0, 2.0), (11.0, 2.0), (11.0, 4.0), (9.0, 4.0)])
    around = GraphSurroundings(
        grids={"g": OccupancyGrid(np.zeros((100, 200), np.int8), 0.1, Pose2(0.0, -5.0))},
        places={"g": {name: Place(name, Pose2()) for name in ("Bed g", "Desk")}},
        zones={"g": [Zone("stairs", Rule.KEEP_OUT, corners), Zone("ward", Rule.SLOW, corners, 0.3)]},
        turns=lambda storey, point: point[0] < 12.0,
    )
    sentences = [(each.severity, each.sentence) for each in check(two_storeys(), around) if each.code == "E14"]
    assert sentences == [
        ("error", "the goal 'Bed g' lies in the keep-out zone 'stairs'"),
        ("warning", "the chair has no room to turn at the goal 'Bed g'"),
        ("warning", "the place 'Desk' of storey 'g' is no goal"),
    ]


def test_e15_and_e16_stale_tables_and_maps_that_are_missing_or_moved() -> None:
    around = GraphSurroundings(stale_tables=True, missing=frozenset(["g"]), moved=frozenset(["1"]))
    found = [each for each in check(two_storeys(), around) if each.code in ("E15", "E16")]
    assert [each.sentence for each in found] == [
        "the map of storey 'g' is missing",
        "the map of storey '1' has moved since the graph was saved",
        "the tables are older than the graph",
    ]


def test_e17_a_door_of_three_metres_and_a_storey_of_five_kilometres() -> None:
    assert only(with_way(two_storeys(), ArcRef("g", "c1", "c2"), width=3.0), "E17").place == "g:c1>c2"
    far = in_ground(lambda ground: with_arcs(ground, Arc("c3", "x"), nodes=(node("x", 5000.0, 0.0),)))
    assert only(far, "E17").sentence == "'Ground' is 5.0 km across"


def test_e17_a_door_of_nine_centimetres_and_rooms_five_kilometres_apart() -> None:
    assert only(with_way(two_storeys(), ArcRef("g", "c1", "c2"), width=0.09), "E17").place == "g:c1>c2"
    ward = replace(two_storeys().submaps["g/ward"], frame=SubmapFrame(5000.0, 0.0))
    far = [each.sentence for each in check(with_submap(two_storeys(), ward)) if each.code == "E17"]
    assert far == ["storey 'g' is 5.0 km across"]


def test_e18_a_closed_stop_that_cuts_a_storey_off() -> None:
    lift = two_storeys().lifts["A"]
    shut = replace(lift, stops=(lift.stops[0], replace(lift.stops[1], closure=Closure("repair"))))
    found = [each for each in check(with_lift(two_storeys(), shut)) if each.code == "E18"]
    assert [each.place for each in found] == ["1:v"]
    assert found[0].sentence == "the closed stop of lift 'A' at storey '1' leaves no way back"


def test_w1_a_long_way_between_neighbouring_rooms() -> None:
    nodes = (node("p", 20.0, 0.0), node("q", 20.0, -20.0), node("r", 12.0, -20.0), node("s", 12.0, 0.8))
    arcs = (Arc("c3", "p"), Arc("p", "q"), Arc("q", "r"), Arc("r", "s"))
    hgraph = in_ground(
        lambda ground: replace(
            with_arcs(ground, *arcs, nodes=nodes), doorways=(*ground.doorways, GraphDoorway("s", "bath", "d"))
        )
    )
    bath = SubMap("g/bath", "Bath", SubmapFrame(12.0, 1.0), nodes={"d": node("d", 0.0, 0.0, NodeKind.BRIDGE)})
    assert "W1" in codes(check(with_submap(hgraph, bath)))
    assert "W1" not in codes(check(two_storeys()))


def test_w1_a_short_way_through_another_sub_map_is_no_detour() -> None:
    # the corridors of two wings end wall to wall; a link between them is a sub-map of its own
    def wing(path: str, x: float) -> SubMap:
        rooms = (GraphDoorway("a", "room", "d"),)
        return SubMap(
            path, nodes={"a": node("a", x, 0.0), "b": node("b", x, 60.0)}, arcs=(Arc("a", "b"),), doorways=rooms
        )

    def room(path: str, x: float) -> SubMap:
        return SubMap(path, frame=SubmapFrame(x, 0.2), nodes={"d": node("d", 0.0, 0.0, NodeKind.BRIDGE)})

    both = {"": SubMap(""), "g": SubMap("g", storey="g"), "g/w": wing("g/w", 0.0), "g/e": wing("g/e", 3.0)}
    both |= {"g/w/room": room("g/w/room", 0.0), "g/e/room": room("g/e/room", 3.0)}
    apart = HGraph("House", (Storey("g"),), both)
    found = [each.sentence for each in check(apart) if each.code == "W1"]
    assert found == ["from g/w/room:d to g/e/room:d, 3.0 m away, the way is more than 3 times as long"]
    link = SubMap(
        "g", storey="g", nodes={"x": node("x", 0.0, 0.1), "y": node("y", 3.0, 0.1)}, arcs=(Arc("x", "y"),),
        doorways=(GraphDoorway("x", "w", "a"), GraphDoorway("y", "e", "a")),
    )  # fmt: skip
    assert "W1" not in codes(check(with_submap(apart, link)))


def test_w2_a_menu_of_eight_and_w3_nodes_nobody_has_driven_past() -> None:
    goals = tuple(node(f"x{i}", 20.0 + 2.0 * i, 0.0, NodeKind.END, f"Seat {i}") for i in range(6))
    arcs = (Arc("c3", "x0"), *(Arc(f"x{i}", f"x{i + 1}") for i in range(5)))
    assert only(in_ground(lambda ground: with_arcs(ground, *arcs, nodes=goals)), "W2").place == "g"
    driven = check(with_way(two_storeys(), ArcRef("g", "c1", "c2"), drive_s=7.0))
    places = {each.place for each in driven if each.code == "W3"}
    assert "g:c3" in places
    assert "g:c2" not in places


def test_a_check_after_an_edit_equals_a_new_one() -> None:
    checker, hgraph = Checker(), two_storeys()
    checker.check(hgraph)
    edits = [
        lambda graph: with_submap(graph, with_nodes(graph.submaps["g/ward"], [node("x", 1.0, 1.0)])),
        lambda graph: with_submap(graph, replace(graph.submaps["g"], frame=SubmapFrame(0.0, 2.0))),
        lambda graph: with_lift(graph, replace(graph.lifts["A"], stops=())),
        lambda graph: with_submap(graph, replace(graph.submaps["1"], doorways=())),
    ]
    for edit in edits:
        hgraph = edit(hgraph)
        assert checker.check(hgraph) == check(hgraph)


def test_a_building_of_one_storey_without_lifts_is_a_building_too() -> None:
    nodes = {"a": node("a", 0.0, 0.0, NodeKind.END, "Desk"), "b": node("b", 4.0, 0.0, NodeKind.END, "Door")}
    submap = SubMap("g", "Ground", storey="g", nodes=nodes, arcs=(Arc("a", "b"),))
    assert check(HGraph("House", (Storey("g"),), {"": SubMap(""), "g": submap})) == ()
