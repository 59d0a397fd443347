from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.journey.pressure_climb import PressureClimb
from waychair.errors import WorldError
from waychair.simulation.lifts.car import DoorKind
from waychair.simulation.lifts.lifts import Lifts
from waychair.simulation.lifts.passengers import (
    PASSES_S,
    RADIUS,
    SPOT_AHEAD,
    SPOT_ASIDE,
    Doing,
    Passenger,
    slots_of,
)
from waychair.simulation.plan.world import World, load_levels
from waychair.simulation.sensors.renderer import renderer_problem
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.types import ImuSample, Pose2, PressureSample, RgbdFrame, Scan, SensorMessage

TICK = 50_000_000
CABIN, LOBBY = Pose2(9.0, 3.5, math.pi), Pose2(6.5, 3.5, 0.0)


@pytest.fixture(scope="module")
def levels() -> tuple[World, ...]:
    return tuple(world.without_people() for world in load_levels("two_floors"))


def at(levels: tuple[World, ...], pose: Pose2, kind: DoorKind = DoorKind.CURTAIN, passengers: int = 0) -> Simulator:
    settings = SimulatorSettings()
    settings = replace(settings, barometer_hz=10.0)
    settings = replace(
        settings, imu=replace(settings.imu, rate_hz=200.0), lidar=replace(settings.lidar, faults=False, sigma=0.0)
    )
    lifts = Lifts(levels, 3, passengers, kind)
    return Simulator(replace(levels[0], start=pose), CHAIR_A, settings, 1, lifts=lifts)


def run(simulator: Simulator, seconds: float) -> list[SensorMessage]:
    return [each for _ in range(round(seconds / 0.05)) for each in simulator.advance(TICK)]


def ahead(messages: list[SensorMessage]) -> float:
    scan = next(each for each in reversed(messages) if isinstance(each, Scan))
    return float(scan.ranges[len(scan.ranges) // 2])


def test_the_lidar_sees_the_door_closed_half_open_and_open(levels: tuple[World, ...]) -> None:
    simulator = at(levels, LOBBY)
    assert simulator.lifts is not None
    assert ahead(run(simulator, 1.0)) == pytest.approx(7.98 - 7.1, abs=0.01)
    assert simulator.clearance() == pytest.approx(7.98 - 7.25, abs=0.01)
    simulator.lifts.call("lift", "ground")
    run(simulator, 0.5)
    scan = next(each for each in reversed(run(simulator, 0.4)) if isinstance(each, Scan))
    inside = scan.ranges[np.abs(scan.angles()) < 0.5] > 1.5
    assert 0 < inside.sum() < len(inside)
    assert ahead(run(simulator, 2.0)) == pytest.approx(9.95 - 7.1, abs=0.01)


@pytest.mark.skipif(renderer_problem() is not None, reason="no camera can be rendered here")
def test_the_camera_sees_the_door_closed_and_open(levels: tuple[World, ...]) -> None:
    settings = SimulatorSettings()
    small = replace(settings.camera, rate_hz=10.0, width=64, height=48, noise=0.0)
    lifts = Lifts(levels)
    simulator = Simulator(replace(levels[0], start=LOBBY), CHAIR_A, replace(settings, camera=small), lifts=lifts)

    def depth() -> float:
        frame = next(each for each in reversed(run(simulator, 0.3)) if isinstance(each, RgbdFrame))
        return float(np.nanmedian(frame.depth[10:20, 28:36]))

    closed = depth()
    lifts.call("lift", "ground")
    run(simulator, 2.5)
    assert closed == pytest.approx(7.98 - 6.9, abs=0.1)
    assert depth() == pytest.approx(9.95 - 6.9, abs=0.2)


def test_a_ride_takes_the_chair_up_and_its_imu_feels_it(levels: tuple[World, ...]) -> None:
    simulator = at(levels, CABIN)
    assert simulator.lifts is not None
    simulator.lifts.call("lift", "upper")
    messages = run(simulator, 9.0)
    assert simulator.world.level == "upper"
    assert simulator.contacts == 0
    up = np.array([each.accel[2] for each in messages if isinstance(each, ImuSample)])
    up = up - up[-100:].mean()
    climbed = np.cumsum(np.cumsum(up) * 0.005)[-1] * 0.005
    assert climbed == pytest.approx(simulator.lifts.heights["upper"], abs=0.3)
    assert up[:600].max() == pytest.approx(0.5, abs=0.1)


def test_a_barometer_tells_the_climb_of_a_ride_by_means_before_and_after(levels: tuple[World, ...]) -> None:
    simulator, climb = at(levels, CABIN), PressureClimb()
    assert simulator.lifts is not None

    def hear(seconds: float) -> list[PressureSample]:
        heard = [each for each in run(simulator, seconds) if isinstance(each, PressureSample)]
        for each in heard:
            climb.hear(each)
        return heard

    assert len(hear(2.0)) == 20
    climb.begin(simulator.now_ns)
    simulator.lifts.call("lift", "upper")
    hear(9.0)
    known = climb.climb(simulator.now_ns)
    assert known is not None
    assert known[0] == pytest.approx(simulator.lifts.heights["upper"], abs=2 * known[1])
    assert known[1] < 0.5


def test_a_door_that_closes_on_the_chair_touches_it_unless_it_sees_it(levels: tuple[World, ...]) -> None:
    in_doorway = Pose2(7.7, 3.5, 0.0)
    seen, struck = at(levels, LOBBY), at(levels, LOBBY, DoorKind.BAD)
    for simulator in (seen, struck):
        assert simulator.lifts is not None
        simulator.lifts.call("lift", "ground")
        run(simulator, 3.0)
        simulator.place(simulator.world, in_doorway)
        run(simulator, 12.0)
    assert (seen.contacts, struck.contacts) == (0, 1)
    assert struck.lifts is not None
    assert struck.lifts.view("lift").opened > 0.3  # it does not go through the chair


@pytest.mark.nightly
def test_passengers_are_seen_ride_and_leave(levels: tuple[World, ...]) -> None:
    simulator = at(levels, Pose2(1.5, 1.5, 0.0), passengers=2)
    assert simulator.lifts is not None
    doings = set()
    for _ in range(240):
        run(simulator, 0.5)
        doings |= {each.doing.name for each in simulator.lifts._passengers}
    assert doings == {"AWAY", "WAITS", "ENTERS", "RIDES", "LEAVES"}
    assert simulator.contacts == 0


def test_the_same_seed_gives_the_same_bytes(levels: tuple[World, ...]) -> None:
    def told() -> list[bytes]:
        simulator = at(levels, CABIN, passengers=2)
        assert simulator.lifts is not None
        simulator.lifts.call("lift", "upper")
        found = run(simulator, 20.0)
        return [each.ranges.tobytes() for each in found if isinstance(each, Scan)] + [
            each.accel.tobytes() for each in found if isinstance(each, ImuSample)
        ]

    assert told() == told()


def test_wrong_lifts_and_levels_are_named(levels: tuple[World, ...]) -> None:
    lifts = Lifts(levels)
    with pytest.raises(WorldError, match="no lift 'goods': take lift"):
        lifts.call("goods", "upper")
    with pytest.raises(WorldError, match="does not stop at 'cellar': take one of ground, upper"):
        lifts.call("lift", "cellar")
    no_door = tuple(replace(world, doors=()) for world in levels)
    with pytest.raises(WorldError, match="no door on 'ground'"):
        Lifts(no_door)
    mujoco = replace(SimulatorSettings(), plant_model="mujoco")
    with pytest.raises(WorldError, match="kinematic"):
        Simulator(levels[0], CHAIR_A, mujoco, lifts=lifts)


def test_the_hospital_has_its_storeys_lifts_and_rooms_and_is_drawn_alike() -> None:
    hospital = load_levels("hospital")
    assert [world.level for world in hospital] == ["0", "1", "2", "3"]
    assert [[lift.name for lift in world.lifts] for world in hospital] == [list("ABC")] * 3 + [["A", "B"]]
    assert sum(place.name.startswith("room") for world in hospital for place in world.places) >= 60
    assert (hospital[2].grid.cells == hospital[3].grid.cells).all()
    assert (hospital[1].grid.cells != hospital[2].grid.cells).mean() > 0.01
    again = load_levels("hospital")
    assert all((a.grid.cells == b.grid.cells).all() for a, b in zip(hospital, again, strict=True))
    assert all(world.slopes for world in hospital)


def test_passengers_let_others_out_before_they_enter_so_that_no_doorway_is_blocked_for_good() -> None:
    lifts = Lifts(load_levels("hospital"), seed=101, passengers=3)
    lifts.step(40_000_000_000)
    lifts.call("A", "0")
    came = 0
    for k in range(40, 160):
        lifts.step(k * 1_000_000_000)
        came += lifts.view("A").level == "0" and lifts.view("A").opened == 1.0
    assert came


def test_a_passenger_whose_way_out_is_taken_is_past_after_a_while(levels: tuple[World, ...]) -> None:
    lifts = Lifts(levels, passengers=1)
    who, known = lifts._passengers[0], next(iter(lifts.lifts.values()))
    door = known.doors[known.stops[0]].middle
    begin, spot = door @ Pose2(0.6, 0.0), door @ Pose2(SPOT_AHEAD, SPOT_ASIDE)
    who.lift, who.stop, who.doing, who.x, who.y, who.way = 0, 0, Doing.LEAVES, begin.x, begin.y, [(spot.x, spot.y)]
    lifts.note_chair("chair", known.stops[0], Pose2(spot.x, spot.y, door.theta), CHAIR_A)
    lifts.step(round(2.0 * 1e9))
    assert who.here
    lifts.step(round((2.0 + PASSES_S) * 1e9))
    assert not who.here


def test_passengers_beside_each_other_get_out_one_after_another(levels: tuple[World, ...]) -> None:
    lifts = Lifts(levels, seed=1, passengers=3)
    riders = _aboard(lifts)
    lifts.call("lift", lifts.view("lift").level)
    for _ in range(200):
        lifts.step(lifts._now_ns + 100_000_000)
        at = [(each.x, each.y) for each in riders if each.here]
        assert all(math.dist(a, b) > 1.8 * RADIUS for a, b in itertools.combinations(at, 2))  # shoulders may brush
    assert not any(each.here for each in riders)


def test_a_passenger_gets_out_past_one_that_stays(levels: tuple[World, ...]) -> None:
    lifts = Lifts(levels, seed=1, passengers=3)
    _, stays, leaves = _aboard(lifts)[::-1]
    lifts._passengers = [stays, leaves]
    known = lifts.lifts["lift"]
    cabin = known.cabins[known.stops[0]]
    place = cabin.middle @ Pose2(*slots_of(cabin.length, cabin.width)[2])  # beside the door
    stays.x, stays.y, stays.wants = place.x, place.y, 1
    lifts.call("lift", known.stops[0])
    lifts.step(8_000_000_000)
    assert (stays.doing, leaves.here) == (Doing.RIDES, False)


def test_a_passenger_that_the_door_shuts_in_is_seen_where_the_lift_takes_it(levels: tuple[World, ...]) -> None:
    lifts = Lifts(levels, seed=1, passengers=1)
    (rider,), known = _aboard(lifts), lifts.lifts["lift"]
    here, there = known.stops
    lifts.note_chair("chair", here, known.cabins[here].middle, CHAIR_A)  # in its way out
    lifts.call("lift", here)
    lifts.step(3_000_000_000)
    assert rider.doing is Doing.LEAVES
    lifts.call("lift", there)
    lifts.step(12_000_000_000)
    assert lifts.view("lift").level == there
    assert rider.doing is Doing.RIDES
    assert (len(lifts.people(here)), len(lifts.people(there))) == (0, 1)


@pytest.mark.parametrize("seed", [2, 3])
def test_passengers_travel_and_none_is_stuck(seed: int) -> None:
    lifts = Lifts(load_levels("hospital"), seed=seed, passengers=3)
    since = dict.fromkeys(range(3), ((Doing.AWAY, 0), 0))
    for second in range(420):
        lifts.step(second * 1_000_000_000)
        for k, who in enumerate(lifts._passengers):
            if since[k][0] != (who.doing, who.lift):
                since[k] = ((who.doing, who.lift), second)
            assert second - since[k][1] < 120, who


def _aboard(lifts: Lifts) -> list[Passenger]:
    """Put all passengers into the cabin, for the stop at which it stands; return them."""
    known = lifts.lifts["lift"]
    cabin = known.cabins[known.stops[0]]
    for who, (x, y) in zip(lifts._passengers, slots_of(cabin.length, cabin.width), strict=False):
        at = cabin.middle @ Pose2(x, y)
        who.lift, who.stop, who.wants, who.doing, who.x, who.y = 0, 0, 0, Doing.RIDES, at.x, at.y
    return lifts._passengers
