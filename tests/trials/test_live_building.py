"""The building in which a page's chair travels, of a world or of a folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import BuildingError
from waychair.maps.building.building import goals
from waychair.planning.building.hierarchical import Method, RoutePlanner
from waychair.simulation.plan.world import load_levels
from waychair.trials.live.live_building import live_building
from waychair.trials.travel.world_building import building_of_world


def test_a_world_of_several_levels_is_a_building_whose_folder_can_be_travelled_in(tmp_path: Path) -> None:
    made = building_of_world(load_levels("two_floors"), tmp_path, CHAIR_A)
    assert {"Ground/Room 1/entrance", "Upper/office/office"} <= goals(made.hgraph).keys()
    with live_building("two_floors", tmp_path) as site:
        assert site is not None
        planner = RoutePlanner(site.building.hgraph, Method.ASTAR)
        route = planner.route(planner.node("entrance"), planner.node("office"))
        assert [leg.lift for leg in route.legs] == ["", "lift", ""]
        assert [(world.level, len(world.lifts)) for world in site.levels] == [("ground", 1), ("upper", 1)]
        assert site.lifts(0).heights["upper"] == pytest.approx(3.2)
        assert {*site.maps()["upper"].drawing.places} >= {"office", "lift"}


def test_one_level_or_a_map_is_no_building_and_a_building_beside_a_map_is_refused(tmp_path: Path) -> None:
    with live_building("small_clinic") as site:
        assert site is None
    with live_building("two_floors", map_folder=tmp_path) as site:
        assert site is None
    with pytest.raises(BuildingError, match="--building or --map"), live_building("two_floors", tmp_path, tmp_path):
        pass
