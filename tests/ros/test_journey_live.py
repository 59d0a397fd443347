"""A journey over two storeys by the complete stack of `waychair up`, in real time: page, lift, change of map, arrival."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.ros.realtime import ALONE
from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.building.building import goals
from waychair.simulation.plan.world import load_levels
from waychair.trials.travel.world_building import building_of_world

if importlib.util.find_spec("rclpy") is None:
    pytest.skip("ROS is not installed (no rclpy)", allow_module_level=True)

from evaluation.runs.live_stack import LiveStack, SeenMessages

from tests.ports import free_port
from tests.ros.test_page import Page, sets_off
from waychair.ros import topics
from waychair.ros.messages.floor import read_floor, read_journey_state

if TYPE_CHECKING:
    from tests.ros.harness import Harness

pytestmark = [ALONE, pytest.mark.nightly]

JOURNEY_S = 240.0


def test_a_goal_of_the_page_on_another_storey_is_reached_by_lift(ros: Harness, tmp_path: Path) -> None:
    levels = tuple(level.without_people() for level in load_levels("two_floors"))
    building = building_of_world(levels, tmp_path / "clinic", CHAIR_A)
    goal = next(name for name in goals(building.hgraph) if name.endswith("office"))
    office = next(place.pose for place in levels[1].places if place.name == "office")
    start, port = levels[0].start, free_port()
    options = ("--no-camera", "--no-people", "--page", "--page-port", str(port))
    options += ("--map", str(tmp_path / "clinic" / "maps" / "ground"), "--start", f"{start.x},{start.y},{start.theta}")
    floors, told = SeenMessages(), SeenMessages()
    with (
        LiveStack(tmp_path / "up", ros.domain, *options, world="two_floors") as stack,
        Page(port, "tests") as page,
    ):
        stack.listen(topics.FLOOR, read_floor, floors)
        stack.listen(topics.JOURNEY, read_journey_state, told)
        stack.until(lambda: page.view.get("localisation") == "ok", "the page")
        stack.until(lambda: page.view.get("storey") == "Ground", "the building")
        sets_off(stack, page, lambda: told.last is not None and told.last.phase == "drive", place=goal)
        stack.until(lambda: told.last.phase in ("arrived", "failed", "held"), "the end of the journey", JOURNEY_S)
        phases = [report.phase for _, report in told.all]
        assert told.last.phase == "arrived", [(report.phase, report.sentence) for _, report in told.all]
        assert [each for each in ("call", "enter", "ride", "leave") if each not in phases] == []
        assert not any(report.asks for _, report in told.all)
        assert floors.last.storey == "upper"
        assert page.view["storey"] == "Upper"
        really = stack.really
        assert really is not None
        assert math.dist((really.odom_from_base.x, really.odom_from_base.y), (office.x, office.y)) < 0.3
