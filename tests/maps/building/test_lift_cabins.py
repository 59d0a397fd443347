from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.maps.building.buildings import two_storeys
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.journey.building_legs import legs_of_route, sites_of_building
from waychair.errors import BuildingError
from waychair.maps.building.building import goals
from waychair.maps.building.hgraph import HGraph
from waychair.maps.building.hgraph_edits import with_lift
from waychair.maps.building.hgraph_files import read_hgraph, write_hgraph
from waychair.planning.building.hierarchical import RoutePlanner
from waychair.types import Goal, Pose2

CABIN = Pose2(4.0, -2.5, 1.5)


def with_cabins(hgraph: HGraph) -> HGraph:
    lift = hgraph.lifts["A"]
    stops = tuple(replace(stop, cabin=CABIN) for stop in lift.stops)
    return with_lift(hgraph, replace(lift, stops=stops, cabin_width=1.8, cabin_depth=2.0, door_width=1.1))


def test_cabins_are_written_and_read_again(tmp_path: Path) -> None:
    hgraph = with_cabins(two_storeys())
    write_hgraph(tmp_path, hgraph)
    assert [stop.cabin for stop in read_hgraph(tmp_path).lifts["A"].stops] == [CABIN, CABIN]
    text = (tmp_path / "hgraph.txt").read_text()
    write_hgraph(tmp_path, read_hgraph(tmp_path))
    assert (tmp_path / "hgraph.txt").read_text() == text
    (tmp_path / "hgraph.txt").write_text(text.replace("cabin_theta=1.5", "", 1))
    with pytest.raises(BuildingError, match="give all three, or none"):
        read_hgraph(tmp_path)


def test_a_route_over_a_lift_has_a_leg_on_each_storey() -> None:
    hgraph = with_cabins(two_storeys())
    planner, names = RoutePlanner(hgraph), goals(hgraph)
    ends = {hgraph.storey_of(ref.submap): ref for ref in names.values()}
    route = planner.route(ends["g"], ends["1"])
    legs = legs_of_route(hgraph, route, sites_of_building(hgraph), CHAIR_A, Goal("x"))
    assert [(leg.storey, leg.lift) for leg in legs] == [("g", "A"), ("1", "")]
    assert legs[1].goal == Goal("x")
    with pytest.raises(BuildingError, match="has no cabin on storey 'g': set it with waychair building cabin"):
        legs_of_route(hgraph, route, (), CHAIR_A, Goal("x"))


def test_a_lift_without_a_size_is_named() -> None:
    hgraph = with_cabins(two_storeys())
    with pytest.raises(BuildingError, match="has no size"):
        sites_of_building(with_lift(hgraph, replace(hgraph.lifts["A"], cabin_depth=None)))


def test_the_lobby_is_the_stops_node_if_that_is_before_the_door() -> None:
    hgraph = with_cabins(two_storeys())
    for site in sites_of_building(hgraph):
        before = site.door.inverse() @ site.lobby
        assert before.x >= 1.0
        assert abs((site.lobby.inverse() @ site.door).y) < 1e-6  # it faces the door
