"""A complete chair travels from storey to storey: the shipped firmware, moving lifts, everything by its sensors."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.runtime.riding import coarse_arcs
from waychair.control.journey.journey import JourneyPhase
from waychair.errors import UnknownPlace
from waychair.runtime.journeys import TravelState
from waychair.simulation.lifts.car import LiftFault
from waychair.simulation.plan.world import World, load_levels
from waychair.simulation.simulator import Simulator
from waychair.trials.travel.journey_runs import random_ends, summary
from waychair.trials.travel.journeys import journey
from waychair.types import JoystickInput


@pytest.fixture(scope="module")
def levels() -> tuple[World, ...]:
    return load_levels("two_floors")


@pytest.mark.nightly
def test_a_chair_rides_to_another_storey_and_drives_on_there(levels: tuple[World, ...]) -> None:
    phases: list[JourneyPhase] = []

    def note(state: TravelState, simulator: Simulator) -> None:
        assert state.journey is not None
        phases.append(state.journey.phase)

    with coarse_arcs():
        record = journey(levels, ("ground", "lift"), ("upper", "lift"), seed=1, people=False, on_tick=note)
    assert (record.arrived, record.contacts, record.near_leaf, record.wrong_map_s) == (True, 0, 0, 0.0), record.why
    assert (record.rides, record.asked) == (1, 0)
    assert max(record.ok_s) <= 2.0
    expected = [
        "drive",
        "call",
        "wait",
        "enter",
        "ride",
        "which storey",
        "switch",
        "relocalise",
        "leave",
        "drive",
        "arrived",
    ]
    assert [str(phase) for phase in dict.fromkeys(phases)] == list(dict.fromkeys(expected))
    counted = summary([record], [1])
    assert (counted["arrived"], counted["contact_below"]) == (1, 0.95)


@pytest.mark.nightly
def test_a_push_of_the_joystick_in_the_car_holds_the_journey(levels: tuple[World, ...]) -> None:
    def push(state: TravelState, simulator: Simulator) -> None:
        if state.journey is not None and state.journey.phase is JourneyPhase.RIDE:
            simulator.rider = JoystickInput(simulator.now_ns, 0.0, 0.9)

    record = journey(levels, ("ground", "lift"), ("upper", "lift"), seed=1, people=False, on_tick=push)
    assert not record.arrived
    assert record.why == "you drive by the joystick; press Go on to continue"
    assert record.wrong_map_s == 0.0


@pytest.mark.nightly
def test_a_lift_that_never_comes_ends_at_rest_with_its_sentence(levels: tuple[World, ...]) -> None:
    faults = {"lift": LiftFault.NEVER_COMES}
    record = journey(levels, ("ground", "lift"), ("upper", "lift"), seed=1, people=False, faults=faults)
    assert not record.arrived
    assert record.why.startswith("the lift does not come")


def test_wrong_ends_and_worlds_without_a_lift_there_are_named(levels: tuple[World, ...]) -> None:
    with pytest.raises(UnknownPlace, match="no level 'cellar': take one of ground, upper"):
        journey(levels, ("cellar", "x"), ("upper", "office"))
    with pytest.raises(UnknownPlace, match="no place 'x' on 'ground': take one of entrance, lift"):
        journey(levels, ("ground", "x"), ("upper", "office"))
    alone = tuple(replace(world, lifts=()) for world in levels)
    with pytest.raises(UnknownPlace, match="no lift leads from 'ground' to 'upper'"):
        journey(alone, ("ground", "entrance"), ("upper", "office"))


def test_ends_are_places_on_different_storeys_and_never_the_lifts(levels: tuple[World, ...]) -> None:
    ends = [random_ends(levels, seed) for seed in range(20)]
    assert all(start[0] != goal[0] for start, goal in ends)
    assert {place for pair in ends for _, place in pair} == {"entrance", "office"}
    assert random_ends(levels, 3) == random_ends(levels, 3)
