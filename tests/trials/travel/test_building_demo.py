"""The demo over storeys: the rider's way, and, at night, the whole of it."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import transform_points
from waychair.maps.grid.distance_field import are_within, distance_field
from waychair.simulation.lifts.lifts import Lifts
from waychair.simulation.plan.world import World, load_levels
from waychair.trials.demo.demo_page import DemoPage
from waychair.trials.travel.building_demo import is_building, riders_route, run_building_demo
from waychair.trials.travel.building_demo_report import write_building_report
from waychair.trials.travel.journeys import sites_of


@pytest.fixture(scope="module")
def levels() -> tuple[World, ...]:
    return load_levels("two_floors")


def test_only_worlds_whose_levels_a_lift_joins_have_a_demo_over_storeys() -> None:
    assert is_building("two_floors")
    assert not is_building("small_clinic")


def test_the_rider_enters_the_room_and_the_lift_without_coming_near_a_wall(levels: tuple[World, ...]) -> None:
    ground = levels[0]
    site = next(each for each in sites_of(Lifts(levels), CHAIR_A) if each.storey == "ground")
    route = riders_route(ground, "entrance", site)
    place = next(each.pose for each in ground.places if each.name == "entrance")
    assert np.hypot(*(route - (place.x, place.y)).T).min() < 0.15
    in_cabin = transform_points(site.cabin.inverse(), route)
    assert (np.abs(in_cabin) < (site.length / 2, site.width / 2)).all(axis=1).any()
    np.testing.assert_allclose(route[-4:], ground.route())
    ways = np.concatenate([np.linspace(a, b, 50) for a, b in pairwise(route)])
    assert not are_within(distance_field(ground.grid).metres, ground.grid, ways, CHAIR_A.width / 2).any()


@pytest.mark.nightly
@pytest.mark.parametrize(("world", "storeys"), [("two_floors", {"ground", "upper"}), ("hospital", {"0", "1"})])
def test_two_storeys_mapped_by_joystick_are_joined_and_the_chair_travels_between_them(
    tmp_path: Path, world: str, storeys: set[str]
) -> None:
    demo = run_building_demo(tmp_path, seed=1, world=world, surprises=world == "hospital", watcher=DemoPage())
    assert (demo.record.arrived, demo.record.contacts, demo.record.wrong_map_s) == (True, 0, 0.0), demo.record.why
    assert demo.record.rides == 1
    assert max(error.rmse_m for error in demo.errors.values()) < 0.1
    write_building_report(tmp_path, demo)
    told = json.loads((tmp_path / "report.json").read_text())
    assert set(told["storeys"]) == storeys
    assert (tmp_path / "journey.png").stat().st_size > 10_000
    assert demo.record.start.partition("/")[2] in (tmp_path / "report.html").read_text()
