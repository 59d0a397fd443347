"""Sensors that come too seldom or too late, and a joystick that does not rest: one clear state, by its own name."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
import pytest

from tests.runtime.riding import FAR, Ride
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.drive.navigator import Stage
from waychair.control.safety.fitness import Fitness
from waychair.control.safety.stops import Severity
from waychair.runtime.chair import ChairState
from waychair.runtime.drive_base import ChairMessage
from waychair.types import JoystickInput, Scan, Twist, WheelTicks

MS = 1_000_000


def every(nth: int) -> Callable[[tuple[ChairMessage, ...]], tuple[ChairMessage, ...]]:
    """Pass every nth scan of a lidar of 10 Hz."""
    heard = 0

    def change(messages: tuple[ChairMessage, ...]) -> tuple[ChairMessage, ...]:
        nonlocal heard
        kept: list[ChairMessage] = []
        for message in messages:
            heard += isinstance(message, Scan)
            if not isinstance(message, Scan) or heard % nth == 0:
                kept.append(message)
        return tuple(kept)

    return change


def delayed(
    ticks: int, kinds: tuple[type, ...] = (Scan,)
) -> Callable[[tuple[ChairMessage, ...]], tuple[ChairMessage, ...]]:
    """Pass messages of these kinds so many ticks of 50 ms late."""
    held: deque[tuple[ChairMessage, ...]] = deque()

    def change(messages: tuple[ChairMessage, ...]) -> tuple[ChairMessage, ...]:
        held.append(tuple(message for message in messages if isinstance(message, kinds)))
        due = held.popleft() if len(held) > ticks else ()
        return tuple(message for message in messages if not isinstance(message, kinds)) + due

    return change


def asked_after(ride: Ride, ticks: int) -> ChairState:
    """Run ticks at rest, ask for a drive and confirm it; return the state three seconds later."""
    ride.tick(ticks)
    ride.chair.go(FAR)
    ride.chair.confirm()
    return ride.tick(60)


def stops(state: ChairState) -> set[str]:
    return {halted.stop.id for halted in state.halts}


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("change", "stop_id", "told"),
    [
        (every(3), "lidar_slow", "3.3 scans a second, and 5 are needed"),
        (every(5), "lidar_slow", "2.0 scans a second"),
        (delayed(4), "lidar_delayed", "0.30 s after their first beam"),
        (delayed(6), "lidar_delayed", "0.40 s after their first beam"),
        (delayed(14), "lidar_delayed", "0.80 s after their first beam"),
    ],
    ids=["3.3 Hz", "2 Hz", "200 ms late", "300 ms late", "700 ms late"],
)
def test_a_lidar_too_slow_or_too_late_for_any_speed_refuses_the_drive_once_by_name(
    change: Callable[[tuple[ChairMessage, ...]], tuple[ChairMessage, ...]], stop_id: str, told: str
) -> None:
    with Ride() as ride:
        ride.change = change
        state = asked_after(ride, 60)
        assert not ride.chair.ready
        assert state.navigation.stage is Stage.FAILED
        (named,) = (halted for halted in state.halts if halted.stop.id == stop_id)
        assert told in named.text
        assert "cable" not in " ".join(halted.text for halted in state.halts)
        assert all(stop_id in stops(later) for later in ride.states[60:])  # it does not flicker
        assert ride.stands


@pytest.mark.parametrize("change", [every(2), delayed(2)], ids=["5 Hz", "100 ms late"])
def test_a_lidar_slow_or_late_enough_for_a_low_speed_drives_slowly_and_without_a_break(
    change: Callable[[tuple[ChairMessage, ...]], tuple[ChairMessage, ...]],
) -> None:
    with Ride() as ride:
        ride.change = change
        ride.tick(30)
        ride.drive(140)
        speeds = []
        for _ in range(40):
            assert not ride.tick().halts
            speeds.append(ride.speed)
        assert 0.25 < min(speeds) <= max(speeds) < 0.34


def test_a_lidar_that_becomes_slow_in_a_drive_ends_it_by_name_and_a_recovered_one_may_drive_again() -> None:
    with Ride() as ride:
        ride.drive()
        ride.change = every(3)
        ended = next(state for state in (ride.tick() for _ in range(60)) if not state.verdict.computer_drives)
        assert ended.verdict.halt is not None
        assert ended.verdict.halt.stop.id == "lidar_slow"
        ride.change = lambda messages: messages
        assert not ride.tick(130).halts
        assert ride.chair.ready


def test_a_lidar_that_was_silent_for_seconds_is_not_called_slow_once_it_is_back() -> None:
    with Ride() as ride:
        ride.drive()
        ride.change = lambda messages: tuple(each for each in messages if not isinstance(each, Scan))
        assert "lidar_stale" in stops(ride.tick(80))
        ride.change = lambda messages: messages
        assert all("lidar_slow" not in stops(ride.tick()) for _ in range(100))
        assert ride.chair.ready


def test_scans_and_wheels_late_alike_are_the_computers_fault_and_not_a_cables() -> None:
    with Ride() as ride:
        ride.change = delayed(5, (Scan, WheelTicks))
        state = asked_after(ride, 60)
        assert stops(state) == {"computer_slow", "lidar_late"} or stops(state) == {"computer_slow"}
        assert "cable" not in " ".join(halted.text for halted in state.halts)


def test_wheels_that_come_late_alone_are_not_called_silent() -> None:
    with Ride() as ride:
        ride.change = delayed(5, (WheelTicks,))
        state = asked_after(ride, 30)
        assert stops(state) == {"wheels_delayed"}


def scan_at(stamp_ns: int) -> Scan:
    return Scan(stamp_ns, np.full(3, 2.0, np.float32), -1.0, 1.0)


def told_fitness(scan_age_ns: int, ticks_ns: list[int]) -> set[str]:
    """Return the stops after ticks at which wheels and scans came, the scans with stamps of this age."""
    fitness, found = Fitness(CHAIR_A), set[str]()
    for now_ns in ticks_ns:
        if now_ns % (100 * MS) == 0:
            fitness.hear(scan_at(now_ns - scan_age_ns), Twist())
        fitness.hear(WheelTicks(now_ns - 5 * MS, 0, 0), Twist())
        found = {halted.stop.id for halted in fitness.halts(now_ns)}
    return found


@pytest.mark.parametrize(("age_s", "stop_id"), [(3.0, "lidar_clock"), (-3.0, "lidar_clock"), (0.45, "lidar_delayed")])
def test_scans_stamped_by_another_clock_are_told_from_late_ones(age_s: float, stop_id: str) -> None:
    ticks = [k * 50 * MS for k in range(200, 260)]
    assert told_fitness(round(age_s * 1e9), ticks) == {stop_id}


@pytest.mark.parametrize(("age_s", "said"), [(3600.0, "3600.0 s behind"), (-7.5, "7.5 s ahead of")])
def test_scans_that_were_dismissed_for_their_clock_are_not_called_silent(age_s: float, said: str) -> None:
    fitness = Fitness(CHAIR_A)
    for now_ns in range(0, 1000 * MS, 50 * MS):
        fitness.hear(WheelTicks(now_ns, 0, 0), Twist())
        fitness.dismiss(scan_at(now_ns - round(age_s * 1e9)), age_s, now_ns)
        (found,) = fitness.halts(now_ns)
        assert found.stop.id == "lidar_clock"
        assert said in found.text
    for now_ns in range(1000 * MS, 1700 * MS, 50 * MS):
        fitness.hear(WheelTicks(now_ns, 0, 0), Twist())
        (found,) = fitness.halts(now_ns)
    assert found.stop.id == "lidar_stale"  # now nothing comes


def test_a_cable_is_named_when_nothing_comes_and_the_computer_when_its_own_loop_was_held_up() -> None:
    fitness = Fitness(CHAIR_A)
    fitness.hear(scan_at(0), Twist())
    fitness.hear(WheelTicks(0, 0, 0), Twist())
    assert fitness.halts(0) == ()
    for now_ns in range(50 * MS, 700 * MS, 50 * MS):
        halts = fitness.halts(now_ns)
    assert [halted.stop.id for halted in halts] == ["lidar_stale", "wheels_stale"]
    assert all(
        "check the" in halted.text or "check its" in halted.text or "check their" in halted.text for halted in halts
    )

    busy = Fitness(CHAIR_A)
    busy.hear(scan_at(0), Twist())
    busy.hear(WheelTicks(0, 0, 0), Twist())
    busy.halts(0)
    halts = busy.halts(700 * MS)
    assert {halted.stop.id for halted in halts} == {"computer_slow"}
    assert all(halted.stop.severity is Severity.ENDS for halted in halts)


def test_a_stick_that_rests_between_rest_and_takeover_is_named_within_half_a_second_and_ends_the_drive() -> None:
    with Ride() as ride:
        ride.tick(10)
        ride.simulator.rider = JoystickInput(0, 0.0, -0.12)
        ride.chair.go(FAR)
        ride.chair.confirm()
        states = [ride.tick() for _ in range(130)]
        told = next(k for k, state in enumerate(states) if "stick_touched" in stops(state))
        ended = next(k for k, state in enumerate(states) if not state.verdict.computer_drives)
        assert told <= 13
        assert 95 <= ended <= 105  # 5 s
        assert not any(state.sent.active for state in states)
        named = states[ended].verdict.halt
        assert named is not None
        assert named.stop.id == "stick_off_rest"
        assert "0.12 of its swing" in named.text
        assert states[ended].navigation.stage is Stage.FAILED
        assert not ride.chair.ready
        ride.chair.go(FAR)
        ride.chair.confirm()
        assert not ride.tick(2).verdict.computer_drives  # refused at once
        ride.simulator.rider = JoystickInput(0, 0.0, 0.0)
        ride.tick(2)
        assert ride.chair.ready


def test_a_hand_that_lets_go_of_the_stick_in_time_keeps_its_drive() -> None:
    with Ride() as ride:
        ride.tick(10)
        ride.simulator.rider = JoystickInput(0, 0.15, 0.0)
        ride.chair.go(FAR)
        ride.chair.confirm()
        assert "stick_touched" in stops(ride.tick(40))
        ride.simulator.rider = JoystickInput(0, 0.0, 0.0)
        state = ride.tick(60)
        assert (state.sent.active, state.halts) == (True, ())


def test_a_board_that_never_arms_for_another_reason_ends_the_drive() -> None:
    with Ride() as ride:
        ride.tick(10)
        # a hand that trembles between rest and 0.12: never at rest for two seconds, never off rest for five
        ride.chair.go(FAR)
        ride.chair.confirm()
        for k in range(220):
            ride.simulator.rider = JoystickInput(0, 0.12 if k % 20 < 10 else 0.05, 0.0)
            state = ride.tick()
            if not state.verdict.computer_drives:
                break
        assert state.verdict.halt is not None
        assert state.verdict.halt.stop.id == "never_armed"
        assert 9.9 < 0.05 * (k + 1) < 10.4
