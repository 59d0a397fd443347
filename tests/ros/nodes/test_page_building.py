"""The page over ROS in a building: its goals by storey, a journey by its path, and what the page shows meanwhile."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.maps.building.buildings import two_storeys
from tests.maps.building.test_lift_cabins import with_cabins
from waychair.calibration.chair_body import CHAIR_A
from waychair.config import Settings
from waychair.maps.building.building import Building, save_with_map
from waychair.maps.drawn.places import save_places
from waychair.maps.folders.map_files import save_map
from waychair.ros import topics
from waychair.ros.messages.floor import (
    Floor,
    JourneyReport,
    StoreyGoal,
    floor,
    journey_state,
    read_storey_goal,
    storey_goal,
)
from waychair.ros.messages.guidance import read_guidance
from waychair.runtime.pages.chair_port import ChairView, PortAnswer
from waychair.slam.localising.localisation import LocalisationState
from waychair.types import DriveMode, OccupancyGrid, Place, Pose2, Twist

if TYPE_CHECKING:
    from tests.ros.harness import Harness

VIEW = ChairView(0, Pose2(4.0, 0.0), LocalisationState.OK, 1.0, DriveMode.MANUAL, Twist(), goal="4.0, 0.1", waits=True)
"""A chair whose first drive, to the lobby, waits for the yes."""


@dataclass(frozen=True, slots=True)
class NoSettings(Settings):
    """None."""


class Page:
    """A node with the part of a page's port, told by the test what the nodes say."""

    def __init__(self, ros: Harness, folder: Path) -> None:
        from waychair.ros.nodes.node import ChairNode
        from waychair.ros.nodes.page_parts.page_building import PageBuilding

        self.ros, self.folder = ros, folder
        self.node: Any = ChairNode("page_building", NoSettings)
        self.port = PageBuilding()
        self.port._drive_view = lambda: VIEW  # type: ignore[method-assign]
        self.port._listen_to_building(self.node, CHAIR_A)
        self.port._enter_storey(Floor(0, str(folder / "maps" / "g"), 1, "Clinic", "g"))

    def tell(self, phase: str, said: str, *asks: str) -> None:
        self.port._take_journey(JourneyReport(1, "First/Ward/Bed 1", phase, said, "g", asks))

    def shown(self) -> ChairView:
        return self.port._with_journey(VIEW)


@pytest.fixture
def page(ros: Harness, tmp_path: Path) -> Iterator[Page]:
    save_map(tmp_path / "map", OccupancyGrid(np.zeros((120, 200), np.int8), 0.1, Pose2(0.0, -6.0)))
    building = Building(tmp_path / "clinic", with_cabins(two_storeys()))
    for storey in ("g", "1"):
        save_places(tmp_path / "map", {f"Bed {storey}": Place(f"Bed {storey}", Pose2(10.0, 3.25))})
        building = save_with_map(building, storey, tmp_path / "map")
    found = Page(ros, tmp_path / "clinic")
    with ros.serving(found.node):
        ros.spin_until(lambda: found.port.goals(), "the building's goals")
        yield found


def test_goals_have_their_menus_and_once_the_chair_is_known_their_times_and_lifts(page: Page) -> None:
    names = {goal.name: goal for goal in page.port.goals()}
    assert names["First/Ward/Bed 1"].path[0] == "First"
    assert names["First/Ward/Bed 1"].seconds is None
    page.port._time_goals(VIEW.map_from_base)
    page.ros.spin_until(lambda: page.port.goals()[0].seconds is not None, "the times")
    timed = {goal.name: goal for goal in page.port.goals()}["First/Ward/Bed 1"]
    assert timed.lifts == 1
    assert page.port._is_goal("First/Ward/Bed 1")
    assert not page.port._is_goal("First/Ward/Bed 9")


def test_a_journey_is_asked_for_by_its_path_and_a_refusal_is_the_answer(page: Page) -> None:
    asked = page.ros.heard(topics.STOREY_GOAL)
    page.ros.spin_until(lambda: page.node.count_subscribers(topics.STOREY_GOAL.name) > 0, "the subscription")

    def travel(phase: str, said: str) -> PortAnswer:
        page.port._ask_for = lambda message, send=page.port._ask_for: (send(message), page.tell(phase, said))
        return page.port._travel("First/Ward/Bed 1")

    assert travel("asked", "press Drive to go to First/Ward/Bed 1") == PortAnswer(
        True, "press Drive to go to First/Ward/Bed 1"
    )
    page.ros.spin_until(lambda: asked, "the goal")
    assert read_storey_goal(asked[-1]).goal == "First/Ward/Bed 1"
    assert travel("refused", "the chair is not localised: wait until it is, then ask for the goal again").done is False
    asked.close()


def test_the_page_shows_the_journeys_goal_question_and_end(page: Page) -> None:
    assert (page.shown().storey, page.shown().goal) == ("Ground", "4.0, 0.1")
    page.tell("asked", "press Drive to go to First/Ward/Bed 1")
    assert (page.shown().goal, page.shown().waits) == ("First/Ward/Bed 1", True)
    page.tell("call", "press the button for First")
    shown = page.shown()
    assert (shown.waits, shown.next_action, shown.paused) == (False, "Press the button for First.", False)
    page.tell("which storey", "which storey is this?", "g", "1")
    assert page.shown().asks == ("g", "1")
    page.tell("held", "you drive by the joystick; press Go on to continue")
    assert page.shown().paused
    page.tell("failed", "the lift does not come: choose another way")
    assert page.shown().goal == "4.0, 0.1"  # the next drive, of another goal


def test_a_rider_is_told_the_way_on_the_page_and_on_a_topic_until_an_empty_goal(page: Page) -> None:
    told = page.ros.heard(topics.GUIDANCE)
    assert page.port.guide("First/Ward/Bed 9", 2).done is False
    ask = page.ros.publisher(topics.GUIDE_TO)
    ask(storey_goal(StoreyGoal("First/Ward/Bed 1")))
    page.ros.spin_until(lambda: told and read_guidance(told[-1]) and read_guidance(told[-1]).kind, "the first movement")
    guide = page.shown().guide
    assert guide is not None
    assert (guide.goal, guide.level) == ("First/Ward/Bed 1", 2)
    assert guide.sentence == read_guidance(told[-1]).sentence != ""  # type: ignore[union-attr]
    assert page.port.guide("First/Ward/Bed 1", 0).done
    page.ros.spin_until(lambda: read_guidance(told[-1]).level == 0, "the level")  # type: ignore[union-attr]
    ask(storey_goal(StoreyGoal("")))
    page.ros.spin_until(lambda: read_guidance(told[-1]) is None, "the end")
    assert page.shown().guide is None
    assert page.port.end_guide().done is False
    told.close()


def test_no_callback_of_the_node_waits_for_a_plan_of_guidance_that_another_thread_makes(page: Page) -> None:
    guide = page.port._guide
    assert page.port.guide("First/Ward/Bed 1", 2).done
    with guide._lock:  # as while a first plan loads its kernels
        for call in (guide._tick, lambda: guide.enter("1"), page.shown):
            calls = Thread(target=call, daemon=True)
            calls.start()
            calls.join(5.0)
            assert not calls.is_alive()
        assert page.shown().guide is not None


def test_a_map_of_no_building_has_no_goals_and_keeps_the_view(page: Page, tmp_path: Path) -> None:
    page.port._enter_storey(Floor(0, str(tmp_path / "map"), 2))
    page.ros.spin_until(lambda: not page.port.goals(), "the map of no building")
    assert page.shown() == VIEW
    assert floor(Floor(0, "", 0)).map_folder == ""
    assert journey_state(JourneyReport(0)).phase == ""
