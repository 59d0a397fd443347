"""A page's chair travels over the storeys of a building, in real time over the shipped firmware."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from waychair.runtime.pages.chair_port import ChairView
from waychair.slam.localising.localisation import LocalisationState
from waychair.trials.live.live_building import live_building
from waychair.trials.live.live_chair import LiveChair
from waychair.types import DriveMode, JoystickInput

PATIENCE_S = 300.0
OFFICE = "Upper/office/office"


@pytest.fixture
def chair() -> Iterator[LiveChair]:
    with (
        live_building("two_floors", people=False) as site,
        LiveChair("two_floors", people=False, countdown_s=0.0, urgently=True, building=site) as chair,
    ):
        until(chair, lambda view: view.localisation is LocalisationState.OK and not view.obstacles)
        yield chair


def until(chair: LiveChair, true: Callable[[ChairView], bool]) -> ChairView:
    """Return the first view that satisfies a condition, while a page is open."""
    ends = time.monotonic() + PATIENCE_S
    while not true(chair.view()):
        assert time.monotonic() < ends, chair.view()
        assert chair.alive, chair.view().last_stop
        chair.watched(("page",))
        time.sleep(0.02)
    return chair.view()


def sets_off(chair: LiveChair) -> None:
    assert chair.go(OFFICE).done
    begun = chair.confirm(OFFICE)
    assert begun.done, begun.sentence


def test_goals_on_all_storeys_have_times_and_lifts_and_wait_for_a_yes(chair: LiveChair) -> None:
    found = {each.path: each for each in chair.goals()}
    near, far = found["Ground", "Room 1", "entrance"], found["Upper", "office"]
    assert (far.name, far.lifts, near.lifts) == (OFFICE, 1, 0)
    assert far.seconds is not None
    assert far.seconds > 30.0  # the lift alone takes so long
    assert "did you mean 'Upper/office/office'" in chair.go("ofice").sentence
    assert chair.view().storey == "Ground"
    assert chair.go(OFFICE).done
    asked = until(chair, lambda view: view.waits and len(view.path) > 1)
    assert (asked.goal, asked.asks) == (OFFICE, ())
    assert chair.answer_storey("upper").sentence == "the chair does not ask which storey this is"
    assert chair.cancel().done
    assert chair.pause().sentence == "there is no drive to pause"
    sets_off(chair)
    until(chair, lambda view: view.twist.v > 0.1)
    assert "did you mean 'Upper/office/office'" in chair.start_at("ofice").sentence
    assert chair.start_at(OFFICE).sentence.startswith("the chair is on its way: cancel the drive first")
    assert chair.stop().done
    held = until(chair, lambda view: view.paused)
    assert held.mode is DriveMode.STOPPED
    assert (held.goal, held.next_action) == (OFFICE, "Stop was pressed; press Go on to continue.")
    assert chair.go_on().done
    until(chair, lambda view: view.mode is DriveMode.AUTONOMOUS)
    assert chair.cancel().done
    ended = until(chair, lambda view: not view.goal)
    assert ended.last_stop == "The journey was cancelled: choose a goal to drive on."


@pytest.mark.nightly
def test_the_page_follows_the_chair_to_another_storey_and_back_to_its_own_map(chair: LiveChair) -> None:
    ground, first = chair.grid(), chair.view()
    sets_off(chair)
    until(chair, lambda view: "Press upper" in view.next_action)
    assert "in a lift" in chair.go("entrance").sentence
    assert chair.pause().done
    assert until(chair, lambda view: view.paused).next_action == "Paused; press Go on to continue."
    assert chair.go_on().done
    changed = until(chair, lambda view: view.storey == "Upper")
    upper = chair.grid()
    assert ground is not None
    assert upper is not None
    assert not np.array_equal(ground.cells, upper.cells)
    assert changed.map_revision > first.map_revision
    assert changed.layout_revision > first.layout_revision
    assert {*chair.layout().places} >= {"office"}
    chair.simulator.rider = JoystickInput(0, 0.0, 0.4)
    until(chair, lambda view: view.paused)
    chair.simulator.rider = JoystickInput(0)
    let_go_ns = chair.simulator.now_ns
    until(chair, lambda view: chair.simulator.now_ns > let_go_ns + 500_000_000)  # the board has told so
    assert "joystick" in chair.view().next_action
    assert chair.go_on().done
    over = until(chair, lambda view: not view.goal)
    assert over.last_stop == f"Arrived at {OFFICE}."
    assert (chair.simulator.world.level, chair.simulator.contacts) == ("upper", 0)
