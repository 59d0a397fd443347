"""A traveller between two storeys: maps drawn anew during a ride, stops without a map, the rider's word for the start."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.maps.building.buildings import two_storeys
from tests.maps.building.test_lift_cabins import with_cabins
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.journey.building_legs import sites_of_building, stops_without_map
from waychair.control.journey.journey import DOUBTED, JourneyPhase, Leg
from waychair.runtime.chair import ChairSettings
from waychair.runtime.journeys import BEGINS_WITHIN_S, StoreyMap, Traveller
from waychair.types import DriveMode, Goal, OccupancyGrid, Pose2, Scan

BLIND = Scan(0, np.full(720, np.nan, np.float32), -2.356, 4.712 / 719)


class Chair:
    """The part of a chair that takes maps and places, and keeps them for the test."""

    def __init__(self) -> None:
        self.told: list[Any] = []
        self.halts: list[str] = []
        self.ready, self.waits = False, False
        self.settings, self.odom_from_base = ChairSettings(), Pose2()
        self.pose = Pose2(3.0, 0.0)

    def prepared_storey(self, grid: OccupancyGrid, *_: Any) -> OccupancyGrid:
        return grid

    def change_storey(self, storey: str, prepared: OccupancyGrid, pose: Pose2 | None) -> None:
        self.told.append((storey, int(prepared.cells[0, 0]), pose))

    def relocalise(self, pose: Pose2 | None) -> None:
        self.told.append(pose)

    def doubt_storey(self, *, certain: bool) -> None:
        self.told.append(certain)

    def pause(self) -> bool:
        return False

    def stop(self) -> None:
        """Nothing drives."""

    def step(self, now_ns: int, messages: Any, halts: Any = ()) -> Any:
        self.halts = [each.stop.id for each in halts]
        still, stage = (
            SimpleNamespace(v=0.0, omega=0.0),
            SimpleNamespace(stage=SimpleNamespace(value="idle"), reason=""),
        )
        verdict = SimpleNamespace(
            mode=DriveMode.MANUAL, reason="the board is silent", steered=False, computer_drives=False
        )
        return SimpleNamespace(
            stamp_ns=now_ns,
            map_from_base=self.pose,
            twist=still,
            localisation=None,
            telemetry=None,
            verdict=verdict,
            navigation=stage,
        )


def floor_of(value: int) -> OccupancyGrid:
    return OccupancyGrid(np.full((4, 4), value, np.int8), 0.1)


@pytest.fixture
def chair() -> Chair:
    return Chair()


@pytest.fixture
def traveller(chair: Chair) -> Traveller:
    sites = sites_of_building(with_cabins(two_storeys()))
    maps = [StoreyMap("g", floor_of(0), {}), StoreyMap("1", floor_of(1), {}, 3.5)]
    lifts: Any = SimpleNamespace(hold=lambda lift, held: None, call=lambda lift, storey: None, said=lambda lift: None)
    return Traveller(chair, CHAIR_A, maps, sites, lifts, "g")  # type: ignore[arg-type]


def test_a_map_that_is_drawn_anew_during_the_ride_is_the_one_that_is_taken(chair: Chair, traveller: Traveller) -> None:
    traveller.prepare("1")  # as a journey does before it sets off
    traveller.replace_map(StoreyMap("1", floor_of(100), {}, 3.5))
    assert traveller.take_storey("1", Pose2(1.0, 2.0))
    assert chair.told == [("1", 100, Pose2(1.0, 2.0))]
    assert traveller.storey == "1"


def test_the_rider_says_where_the_chair_stands_on_this_storey_or_another(chair: Chair, traveller: Traveller) -> None:
    assert traveller.start_at("g", Pose2(3.0, 0.0))
    assert chair.told == [Pose2(3.0, 0.0), True]
    chair.told.clear()
    assert traveller.start_at("1", Pose2(4.0, 0.0))
    assert chair.told == [("1", 1, Pose2(4.0, 0.0))]


def test_a_lifts_stops_without_a_map_or_a_cabin_are_known_by_their_heights() -> None:
    bare, cabins = two_storeys(), with_cabins(two_storeys())
    (lift,) = cabins.lifts
    heights = {storey.id: storey.height for storey in cabins.storeys}
    sites = sites_of_building(cabins)
    assert stops_without_map(cabins, sites, {"g": 0, "1": 0}) == {lift: {}}
    assert stops_without_map(cabins, sites, {"g": 0}) == {lift: {"1": heights["1"]}}
    assert stops_without_map(bare, (), {"g": 0, "1": 0}) == {lift: heights}


def test_a_chair_in_a_lift_without_a_journey_doubts_its_storey_once_the_door_is_not_seen_open(
    chair: Chair, traveller: Traveller
) -> None:
    (site,) = (each for each in sites_of_building(with_cabins(two_storeys())) if each.storey == "g")

    def tick() -> bool:
        traveller.step(0, (BLIND,))
        return traveller.shut_in

    assert not tick()
    chair.pose = site.cabin
    assert tick()
    assert tick()
    assert (chair.told, chair.halts) == ([False], ["floor_uncertain"])  # told once, and no drive begins
    chair.pose = Pose2(3.0, 0.0)
    assert not tick()
    assert chair.halts == ["floor_uncertain"]  # until somebody has said which storey it is
    assert traveller.start_at("g", chair.pose)
    assert not tick()
    assert chair.halts == []


def test_a_journey_whose_drive_cannot_begin_is_held_after_a_while_with_the_reason(
    chair: Chair, traveller: Traveller
) -> None:
    traveller.go((Leg("g", Goal(Pose2(5.0, 0.0))),), 0)
    phases = []
    for tenth in range(120):
        state = traveller.step(tenth * 100_000_000, ())
        assert state.journey is not None
        phases.append(state.journey.phase)
    assert phases.index(JourneyPhase.HELD) == pytest.approx(10 * BEGINS_WITHIN_S, abs=3)
    assert state.order.sentence == "the board is silent; press Go on to continue"


@pytest.mark.parametrize("held", [False, True])
def test_a_journey_ends_where_the_chair_is_in_a_lift_that_it_does_not_take_and_the_door_is_not_seen_open(
    chair: Chair, traveller: Traveller, held: bool
) -> None:
    (site,) = (each for each in sites_of_building(with_cabins(two_storeys())) if each.storey == "g")
    traveller.go((Leg("g", Goal(Pose2(5.0, 0.0))),), 0)
    if held:
        traveller.pause()
        traveller.step(0, (BLIND,))
    chair.pose = site.cabin
    traveller.step(50_000_000, (BLIND,))
    state = traveller.step(100_000_000, (BLIND,))
    assert state.journey is not None
    assert (state.journey.phase, state.order.sentence) == (JourneyPhase.FAILED, DOUBTED)
    assert (chair.told, chair.halts) == ([False], ["floor_uncertain"])


def test_a_held_chair_that_its_rider_drives_into_the_lift_is_aboard_though_it_does_not_see_the_door(
    chair: Chair, traveller: Traveller
) -> None:
    (site,) = (each for each in sites_of_building(with_cabins(two_storeys())) if each.storey == "g")
    traveller.go((Leg("g", Goal(site.lobby), site.lift, Goal(site.cabin)), Leg("1", Goal(Pose2(5.0, 0.0)))), 0)
    traveller.stop()
    traveller.step(0, (BLIND,))
    chair.pose = site.cabin
    for tick in range(1, 4):
        state = traveller.step(tick * 50_000_000, (BLIND,))
    assert state.journey is not None
    assert (state.journey.phase, state.journey.resume, traveller.aboard) == (JourneyPhase.HELD, JourneyPhase.RIDE, True)
    assert (chair.told, chair.halts) == ([False], [])  # no drive begins, but the journey finds the storey out


def test_a_chair_that_is_held_in_the_cabin_feels_a_ride_from_then_on(chair: Chair, traveller: Traveller) -> None:
    (site,) = (each for each in sites_of_building(with_cabins(two_storeys())) if each.storey == "g")
    legs = Leg("g", Goal(site.lobby), site.lift, Goal(site.cabin)), Leg("1", Goal(Pose2(5.0, 0.0)))
    traveller.go(legs, 0)
    assert traveller.journey is not None
    traveller.journey = replace(traveller.journey, phase=JourneyPhase.ENTER)
    chair.pose = site.cabin
    traveller.stop()
    state = traveller.step(0, (BLIND,))
    assert state.journey is not None
    assert (state.journey.phase, state.journey.resume, traveller.aboard) == (JourneyPhase.HELD, JourneyPhase.RIDE, True)
    traveller.step(50_000_000, (BLIND,))
    assert traveller.journey.phase is JourneyPhase.HELD  # the journey knows of this lift
    traveller.go_on(100_000_000)
    traveller.step(100_000_000, (BLIND,))
    assert (chair.told, chair.halts) == ([False], [])
