"""The goals of a building for menus, with times and lifts from the chair's place."""

from __future__ import annotations

import pytest

from waychair.maps.building.hgraph import (
    ROOT,
    Arc,
    GraphDoorway,
    HGraph,
    Lift,
    Node,
    NodeKind,
    NodeRef,
    Stop,
    Storey,
    SubMap,
    Way,
)
from waychair.planning.building.hierarchical import Method, RoutePlanner
from waychair.runtime.pages.building_goals import goal_views
from waychair.runtime.pages.chair_port import GoalView


def building() -> HGraph:
    """Two storeys, the upper one written first: a bed and a bench below, a ward 8 m from the lift above."""
    ground = SubMap(
        "g",
        "Ground",
        storey="g",
        nodes={
            "bench": Node("bench", NodeKind.END, 0.0, 0.0, "Bench"),
            "x": Node("x", NodeKind.CROSS, 4.0, 0.0),
            "lobby": Node("lobby", NodeKind.LIFT, 8.0, 0.0),
        },
        arcs=(Arc("bench", "x"), Arc("x", "lobby")),
        doorways=(GraphDoorway("x", "bed", "d", Way(width=1.2)),),
    )
    bed = SubMap(
        "g/bed",
        "Bed",
        nodes={"d": Node("d", NodeKind.BRIDGE, 4.0, 2.0), "e": Node("e", NodeKind.END, 4.0, 4.0, "Bed")},
        arcs=(Arc("d", "e"),),
    )
    upper = SubMap(
        "u",
        "Upper",
        storey="u",
        nodes={
            "ward": Node("ward", NodeKind.END, 16.0, 0.0, "Ward"),
            "cell": Node("cell", NodeKind.END, 30.0, 0.0, "Cell"),
            "attic": Node("attic", NodeKind.CROSS, 31.0, 0.0),
            "lobby": Node("lobby", NodeKind.LIFT, 8.0, 0.0),
        },
        arcs=(Arc("lobby", "ward"), Arc("cell", "attic")),
    )
    lift = Lift("l", "Lift", (Stop("g", NodeRef("g", "lobby")), Stop("u", NodeRef("u", "lobby"))))
    submaps = {ROOT: SubMap(ROOT), "u": upper, "g": ground, "g/bed": bed}
    return HGraph("house", (Storey("g", "Ground"), Storey("u", "Upper", 3.0)), submaps, {"l": lift})


@pytest.fixture(scope="module")
def planner() -> RoutePlanner:
    return RoutePlanner(building(), Method.ASTAR)


def test_goals_come_by_storey_with_times_and_lifts_from_the_chairs_place(planner: RoutePlanner) -> None:
    found = {each.path: each for each in goal_views(planner, NodeRef("g", "bench"), aside_m=0.8)}
    assert list(found) == [("Ground", "Bench"), ("Ground", "Bed"), ("Upper", "Ward"), ("Upper", "Cell")]
    assert found["Ground", "Bench"].seconds == pytest.approx(1.0)  # 0.8 m at 0.8 m/s
    bed = found["Ground", "Bed"]
    assert (bed.name, bed.lifts) == ("Ground/Bed/Bed", 0)
    assert bed.seconds == pytest.approx((0.8 + 4.0 + 0.8 + 4.0) / 0.8)  # 8 m, and a turn that counts 0.8 m
    ward = found["Upper", "Ward"]
    assert ward.lifts == 1
    assert ward.seconds == pytest.approx(
        (0.8 + 8.0 + 16.0 + 4.0 + 2.4 + 4.0 + 8.0) / 0.8
    )  # drive, wait, board, ride, leave


def test_a_goal_without_a_way_and_a_chair_without_a_place_have_unknown_times(planner: RoutePlanner) -> None:
    cell = goal_views(planner, NodeRef("g", "bench"))[-1]
    assert cell == GoalView("Upper/Cell", ("Upper", "Cell"))
    assert all((each.seconds, each.lifts) == (None, None) for each in goal_views(planner))
