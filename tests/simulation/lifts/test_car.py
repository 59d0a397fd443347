from __future__ import annotations

import math
from itertools import pairwise

import pytest

from waychair.simulation.lifts.car import DWELL_S, Car, DoorKind, LeafObstruction, LiftFault
from waychair.simulation.lifts.lifts import STEP_NS
from waychair.simulation.lifts.ride_profile import ACCELERATION, JERK, SPEED, ride_profile


def car(**changes: object) -> Car:
    return Car((0.0, 3.3, 6.6), 1.1, **changes)  # type: ignore[arg-type]


def run(lift: Car, seconds: float, begin_s: float = 0.0, obstruction: LeafObstruction = LeafObstruction.NONE) -> float:
    now_ns = round(begin_s * 1e9)
    for _ in range(round(seconds * 1e9 / STEP_NS)):
        now_ns += STEP_NS
        lift.step(now_ns, STEP_NS * 1e-9, obstruction)
    return now_ns * 1e-9


@pytest.mark.parametrize("height", [0.2, 3.3, -3.3, 9.9])
def test_a_ride_ends_at_its_height_at_rest_and_keeps_its_limits(height: float) -> None:
    ride = ride_profile(height)
    samples = [ride.at(ride.seconds * k / 400) for k in range(401)]
    assert samples[-1] == (height, 0.0, 0.0)
    before = ride.at(ride.seconds - 1e-6)
    assert before[0] == pytest.approx(height, abs=1e-6)
    assert max(abs(v) for _, v, _ in samples) <= SPEED + 1e-9
    assert max(abs(a) for _, _, a in samples) <= ACCELERATION + 1e-9
    steps = [abs(b[2] - a[2]) for a, b in pairwise(samples[:-1])]
    assert max(steps) <= JERK * ride.seconds / 400 + 1e-9


def test_a_ride_of_one_storey_takes_as_long_as_its_seven_parts() -> None:
    # up to 1 m/s within 0.5 m/s2 and 0.8 m/s3: 2 s + 0.625 s, over 2.625 m with the way back; the rest at 1 m/s
    assert ride_profile(3.3).seconds == pytest.approx(2 * 2.625 + (3.3 - 2.625))


def test_a_called_car_comes_opens_waits_and_closes() -> None:
    lift = car()
    lift.call(2, 0)
    t = run(lift, ride_profile(6.6).seconds + 0.5)
    assert lift.ride is not None
    t = run(lift, 3.0, t)
    assert (lift.at, lift.opened, lift.moves) == (2, 1.0, 0)
    t = run(lift, DWELL_S + 2.5, t)
    assert lift.opened == 0.0


def test_a_held_door_stays_open_and_a_released_one_closes() -> None:
    lift = car()
    lift.holds.add("chair")
    lift.call(0, 0)
    t = run(lift, 60.0)
    assert lift.opened == 1.0
    lift.holds.clear()
    run(lift, 12.0, t)
    assert lift.opened == 0.0


@pytest.mark.parametrize(
    ("kind", "obstruction", "reopens"),
    [
        (DoorKind.CURTAIN, LeafObstruction.BETWEEN, True),
        (DoorKind.CONTACT, LeafObstruction.BETWEEN, False),
        (DoorKind.CONTACT, LeafObstruction.TOUCHED, True),
        (DoorKind.BAD, LeafObstruction.TOUCHED, False),
    ],
)
def test_a_closing_door_reopens_by_its_kind(kind: DoorKind, obstruction: LeafObstruction, reopens: bool) -> None:
    lift = car(kind=kind)
    lift.call(0, 0)
    t = run(lift, 2.0 + DWELL_S + 0.6)
    assert lift.moves == -1
    before = lift.opened
    run(lift, 0.5, t, obstruction)
    assert (lift.opened > before) is reopens


def test_a_bad_door_presses_on_what_it_touches_without_going_on() -> None:
    lift = car(kind=DoorKind.BAD)
    lift.call(0, 0)
    t = run(lift, 2.0 + DWELL_S + 0.6)
    before = lift.opened
    run(lift, 3.0, t, LeafObstruction.TOUCHED)
    assert (lift.opened, lift.moves) == (before, -1)


def test_a_car_serves_the_calls_on_its_way_first() -> None:
    lift = car()
    lift.call(2, 0)
    lift.call(1, 0)
    stops = []
    t = 0.0
    for _ in range(60):
        t = run(lift, 1.0, t)
        if lift.ride is None and (not stops or stops[-1] != lift.at):
            stops.append(lift.at)
    assert stops == [1, 2]


def test_faulty_lifts_do_not_come_or_stop_elsewhere() -> None:
    dead, wrong = car(fault=LiftFault.NEVER_COMES), car(fault=LiftFault.STOPS_ELSEWHERE)
    dead.call(1, 0)
    run(dead, 30.0)
    assert (dead.at, dead.opened) == (0, 0.0)
    wrong.call(2, 0)
    t = run(wrong, 30.0)
    assert wrong.at == 2
    wrong.call(1, round(t * 1e9))
    run(wrong, 30.0, t)
    assert wrong.at == 0


def test_the_felt_acceleration_is_that_of_the_height() -> None:
    lift = car()
    lift.call(1, 0)
    t, dt = run(lift, 0.5), STEP_NS
    for _ in range(100):
        now_ns = round(t * 1e9)
        a = lift.acceleration(now_ns)
        bend = (lift.height(now_ns + dt) - 2 * lift.height(now_ns) + lift.height(now_ns - dt)) / (dt * 1e-9) ** 2
        assert math.isclose(a, bend, abs_tol=0.02)
        t += 0.02
