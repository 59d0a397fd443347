"""Rows of the fault table, each injected into a complete chair that drives in the simulator."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from tests.runtime.riding import FAR, Ride
from waychair.calibration.calibration_file import ChairCalibration
from waychair.control.drive.navigator import Stage
from waychair.control.safety.collision_monitor import SILENT_MS
from waychair.control.safety.fitness import FitnessSettings
from waychair.control.safety.supervisor import SupervisorSettings
from waychair.firmware_bridge.bridge import BridgeSettings
from waychair.firmware_bridge.transports import Reconnecting
from waychair.runtime.chair import Chair, ChairSettings
from waychair.runtime.drive_base import ChairMessage
from waychair.simulation.scene.scene import PersonBehaviour, PersonPlan
from waychair.simulation.sensors.imu import ImuSettings
from waychair.simulation.simulator import SimulatorSettings
from waychair.trials.drive import advance_tick
from waychair.types import ChairStatus, DriveMode, ImuSample, JoystickInput, Scan, Twist, WheelTicks

IMU_HZ = 100.0
UP = np.array([0.0, 0.0, 9.81])


@pytest.fixture
def ride() -> Iterator[Ride]:
    with Ride() as ride:
        yield ride


def only(*kinds: type) -> Callable[[tuple[ChairMessage, ...]], tuple[ChairMessage, ...]]:
    """Pass messages of these kinds and lose the others."""
    return lambda messages: tuple(message for message in messages if isinstance(message, kinds))


def ended_by(ride: Ride, within: int) -> str:
    """Return the stop that ends the drive within this number of ticks; the chair rests then and stays at rest."""
    states = [ride.tick() for _ in range(within)]
    ended = next(state for state in states if not state.verdict.computer_drives)
    assert ended.verdict.halt is not None
    assert ended.navigation.stage is Stage.FAILED
    ride.tick(70)
    assert ride.stands
    assert not ride.states[-1].sent.active
    return ended.verdict.halt.stop.id


def test_f11_a_late_scan_slows_the_chair_and_half_a_second_ends_the_drive(ride: Ride) -> None:
    ride.drive()
    before = ride.speed
    ride.change = only(WheelTicks)
    states = [ride.tick() for _ in range(12)]
    slowed = next(i for i, state in enumerate(states) if state.command is not None and state.command.v == 0.0)
    ended = next(i for i, state in enumerate(states) if not state.verdict.computer_drives)
    assert before > 0.6
    assert 4 <= slowed <= 6
    assert 8 <= ended <= 10
    halted = states[ended].verdict.halt
    assert halted is not None
    assert halted.stop.id == "lidar_stale"
    ride.tick(30)
    assert ride.stands
    ride.change = lambda messages: messages
    assert not ride.tick(40).sent.active  # it is back, but nothing resumes by itself


def test_f17_a_delayed_control_loop_ends_the_drive_and_needs_no_reset(ride: Ride) -> None:
    ride.drive()
    base, now_ns = ride.chair._base, ride.simulator.now_ns + 3_000_000_000
    before = base._monitor.verdict
    assert before is not None
    assert now_ns - before.stamp_ns > SILENT_MS * 1_000_000
    verdict, _ = base.supervise(now_ns, active=True)
    assert not verdict.computer_drives
    assert "monitor_silent" not in {halted.stop.id for halted in base.halts}
    assert base._halts._latched is None


def test_a_monitor_that_stays_silent_after_a_delay_is_named_half_a_second_later(ride: Ride) -> None:
    ride.drive()
    base, now_ns = ride.chair._base, ride.simulator.now_ns + 3_000_000_000
    named = []
    for tick in range(14):
        base.supervise(now_ns + tick * 50_000_000, active=True)
        named.append("monitor_silent" in {halted.stop.id for halted in base.halts})
    assert named.index(True) == 11


def test_f11_a_scan_that_comes_back_within_half_a_second_lets_the_drive_go_on(ride: Ride) -> None:
    ride.drive()
    ride.change = only(WheelTicks)
    ride.tick(7)
    ride.change = lambda messages: messages
    assert ride.tick(30).verdict.mode is DriveMode.AUTONOMOUS
    assert ride.speed > 0.2


def told(value: float, half_angle: float = math.pi) -> Callable[[tuple[ChairMessage, ...]], tuple[ChairMessage, ...]]:
    """Give all beams within this angle [rad] of straight ahead one value."""

    def change(message: ChairMessage) -> ChairMessage:
        if not isinstance(message, Scan):
            return message
        ahead = np.abs(message.angles()) <= half_angle
        return replace(message, ranges=np.where(ahead, np.float32(value), message.ranges))

    return lambda messages: tuple(map(change, messages))


@pytest.mark.parametrize("value", [math.inf, math.nan, 65.533])
def test_f12_a_blind_lidar_ends_the_drive_within_half_a_second_and_a_tick(ride: Ride, value: float) -> None:
    ride.drive()
    ride.change = told(value)
    assert ended_by(ride, within=13) == "lidar_blind"


@pytest.mark.parametrize("value", [math.inf, 65.533])
def test_f12_a_chair_with_a_covered_lidar_front_drives_into_nobody(value: float) -> None:
    """Some drivers send 65.533 for a beam without an echo; it is not a measurement."""
    sits = PersonPlan(PersonBehaviour.SEATED, np.array([[6.0, 2.5]]), radius=0.25)
    with Ride(people=(sits,)) as ride:
        ride.drive(55)
        ride.change = told(value, math.radians(80.0))
        assert ended_by(ride, within=13) == "lidar_blind"
        assert ride.simulator.contacts == 0


def test_a_chair_that_does_not_see_ahead_crawls(ride: Ride) -> None:
    """Fewer beams than make a lidar blind, but those that look ahead."""
    ride.drive()
    assert ride.speed > 0.3
    ride.change = told(math.nan, math.radians(20.0))
    ride.tick(40)
    assert ride.states[-1].verdict.computer_drives
    assert 0.05 < ride.speed < 0.2


@pytest.mark.parametrize("asked", [Twist(math.nan, 0.0), Twist(0.3, math.inf), Twist(1e6, 0.0)])
def test_f5_an_invalid_speed_brakes_in_the_same_tick(ride: Ride, asked: Twist, monkeypatch: pytest.MonkeyPatch) -> None:
    """The planner asks for an impossible speed: the chair brakes at once, hard, and comes to rest."""
    before = ride.drive().command
    assert before is not None
    navigator = ride.chair._pilot.navigator
    sane = navigator.step
    monkeypatch.setattr(navigator, "step", lambda **given: replace(sane(**given), twist=asked))
    after = ride.tick().command
    assert after is not None
    assert after.v == pytest.approx(before.v - ride.setup.chair.limiter.emergency * 0.05, abs=1e-6)
    ride.tick(40)
    assert ride.stands


def test_a_wheel_that_would_turn_too_fast_slows_the_chair_and_does_not_end_the_drive() -> None:
    with Ride(ChairSettings(bridge=BridgeSettings(max_wheel_speed=0.4))) as ride:
        ride.drive()
        states = [ride.tick() for _ in range(60)]
        assert all(state.sent.active for state in states)
        assert 0.3 < ride.speed < 0.45


def test_f12_a_lidar_that_repeats_one_scan_ends_the_drive(ride: Ride) -> None:
    ride.drive()
    frozen = None

    def repeated(messages: tuple[ChairMessage, ...]) -> tuple[ChairMessage, ...]:
        nonlocal frozen
        changed: list[ChairMessage] = []
        for message in messages:
            if isinstance(message, Scan):
                frozen = frozen if frozen is not None else message.ranges
                changed.append(replace(message, ranges=frozen))
            else:
                changed.append(message)
        return tuple(changed)

    ride.change = repeated
    states = [ride.tick() for _ in range(14)]
    ended = next(state for state in states if not state.verdict.computer_drives)
    assert ended.verdict.halt is not None
    assert ended.verdict.halt.stop.id in ("lidar_frozen", "lost", "pose_jump")
    assert "lidar_frozen" in {halted.stop.id for state in states for halted in state.halts}


def test_f13_silent_wheels_end_the_drive(ride: Ride) -> None:
    ride.drive()
    ride.change = only(Scan)
    assert ended_by(ride, within=5) == "wheels_stale"


def test_f13_an_imu_that_falls_silent_slows_the_drive(ride: Ride) -> None:
    ride.change = lambda messages: (*messages, ImuSample(ride.simulator.now_ns, UP, np.zeros(3)))
    ride.drive()
    assert ride.speed > 0.6
    ride.change = lambda messages: messages
    ride.tick(45)
    assert ride.speed == pytest.approx(0.3, abs=0.06)


def test_f14_the_chair_stops_for_a_person_who_steps_out_and_keeps_a_hands_breadth_away() -> None:
    steps_out = PersonPlan(
        PersonBehaviour.SUDDEN, np.array([[6.0, 3.1], [6.0, 2.5]]), speed=1.0, yields=True, radius=0.25, trigger=1.6
    )
    with Ride(people=(steps_out,), width=2.0) as ride:
        ride.drive(60)
        nearest = math.inf
        for _ in range(100):
            ride.tick()
            if abs(ride.speed) > 0.02:
                nearest = min(nearest, ride.simulator.person_distance())
        assert ride.simulator.contacts == 0
        assert nearest >= 0.1
        assert "obstacle" in {halted.stop.id for state in ride.states for halted in state.halts} or nearest < 1.0


def test_f15_a_chair_that_is_carried_away_stops_and_says_that_it_is_lost(ride: Ride) -> None:
    ride.drive()
    plant = ride.simulator._chair
    plant.pose = replace(plant.pose, y=plant.pose.y + 1.2, theta=plant.pose.theta + 2.0)  # type: ignore[misc]
    states = [ride.tick() for _ in range(30)]
    ended = next(state for state in states if not state.verdict.computer_drives)
    assert ended.verdict.halt is not None
    assert ended.verdict.halt.stop.id in ("lost", "pose_jump")
    assert ended.navigation.stage is Stage.FAILED
    ride.tick(70)
    assert ride.stands
    ride.simulator.rider = JoystickInput(ride.simulator.now_ns, -0.6, 0.0)
    ride.tick(20)
    assert ride.speed < -0.2  # the joystick stays usable


def test_f15_a_pose_that_jumps_by_more_than_half_a_metre_ends_the_drive(ride: Ride) -> None:
    ride.drive()
    localiser = ride.chair._localiser
    honest = localiser.process

    def elsewhere(*told: object) -> object:
        found = honest(*told)  # type: ignore[arg-type]
        shifted = replace(found.map_from_odom, x=found.map_from_odom.x + 0.6)
        return replace(found, map_from_odom=shifted)

    localiser.process = elsewhere  # type: ignore[method-assign, assignment]
    assert ended_by(ride, within=4) == "pose_jump"


def test_f17_a_control_loop_that_misses_two_periods_commands_zero_and_then_lets_go(ride: Ride) -> None:
    ride.drive()
    for _ in range(3):
        advance_tick(ride.simulator, ride.chair)
    state = ride.tick()
    assert not state.sent.active or state.sent.wheel_speeds.left == 0.0
    for _ in range(4):
        advance_tick(ride.simulator, ride.chair)
    ride.tick(2)
    assert not ride.tick(40).sent.active


def test_f19_a_push_of_the_stick_lets_go_within_a_tick_and_ends_the_drive(ride: Ride) -> None:
    ride.drive()
    ride.simulator.rider = JoystickInput(ride.simulator.now_ns, 0.0, 0.5)
    state = ride.tick()
    assert (state.verdict.mode, state.sent.active, state.command) == (DriveMode.MANUAL, False, None)


def test_f20_a_chair_that_is_blocked_is_stopped_until_a_person_resets_it(
    ride: Ride, monkeypatch: pytest.MonkeyPatch
) -> None:
    ride.drive()
    monkeypatch.setattr(ride.simulator._contacts, "is_free", lambda pose: False)
    assert ended_by(ride, within=20) == "disobeys"
    monkeypatch.undo()
    ride.chair.go(FAR)
    ride.chair.confirm()
    assert not ride.tick(10).verdict.computer_drives
    ride.chair.reset()
    assert ride.tick(2).navigation.stage is Stage.FAILED


def test_f23_a_slope_beyond_the_limit_ends_the_drive_and_a_steep_ramp_slows_it() -> None:
    lean, felt = 0.0, 0.0

    def tilted(messages: tuple[ChairMessage, ...]) -> tuple[ChairMessage, ...]:
        """Add gravity and turn rate of a chair tilted back by `lean`; the first sample of a tick has the change."""
        nonlocal felt
        changed: list[ChairMessage] = []
        for message in messages:
            if isinstance(message, ImuSample):
                rate, felt = (felt - lean) * IMU_HZ, lean
                gravity = 9.81 * np.array([math.sin(lean), 0.0, math.cos(lean) - 1.0])
                message = replace(
                    message, accel=message.accel + gravity, gyro=message.gyro + np.array([0.0, rate, 0.0])
                )
            changed.append(message)
        return tuple(changed)

    with Ride(simulator=SimulatorSettings(imu=ImuSettings(rate_hz=IMU_HZ))) as ride:
        ride.change = tilted
        ride.drive()
        lean = 0.11
        ride.tick(50)
        assert ride.states[-1].verdict.computer_drives
        assert ride.speed == pytest.approx(0.3, abs=0.06)
        lean = 0.20
        assert ended_by(ride, within=7) == "tilt"


def test_f24_a_charger_ends_a_drive_and_prevents_new_ones(ride: Ride) -> None:
    ride.drive()
    ride.change = lambda messages: (*messages, ChairStatus(ride.simulator.now_ns, charging=True))
    assert ended_by(ride, within=2) == "charging"
    ride.chair.go(FAR)
    ride.chair.confirm()
    assert not any(ride.tick().sent.active for _ in range(20))
    assert "unplug" in ride.states[-1].halts[0].text


def test_f24_a_low_battery_lets_a_drive_finish_and_no_new_one_begin(ride: Ride) -> None:
    ride.drive()
    ride.change = lambda messages: (*messages, ChairStatus(ride.simulator.now_ns, battery=0.1))
    assert ride.tick(10).verdict.mode is DriveMode.AUTONOMOUS
    ride.chair.go(FAR)
    ride.chair.confirm()
    state = ride.tick()
    assert state.verdict.mode is DriveMode.MANUAL
    assert "battery is low (10 %)" in state.verdict.reason
    assert state.navigation.stage is Stage.FAILED


def test_a_goal_requested_during_a_fault_does_not_start_when_the_fault_clears(ride: Ride) -> None:
    ride.change = only(WheelTicks)
    ride.tick(10)
    ride.chair.go(FAR)
    ride.chair.confirm()
    assert "lidar is silent" in ride.tick().verdict.reason
    ride.change = lambda messages: messages
    ride.tick(60)
    assert ride.states[-1].verdict.mode is DriveMode.MANUAL
    assert not any(state.sent.active for state in ride.states)


def test_a_goal_requested_while_the_rider_steers_does_not_start_when_the_stick_is_released(ride: Ride) -> None:
    ride.tick(10)
    ride.simulator.rider = JoystickInput(0, 0.0, 0.5)
    ride.tick(4)
    ride.chair.go(FAR)
    ride.chair.confirm()
    ride.tick(2)
    ride.simulator.rider = JoystickInput(0)
    ride.tick(60)
    assert not any(state.sent.active for state in ride.states)


def test_a_goal_waits_for_the_riders_confirmation_for_a_limited_time() -> None:
    with Ride(ChairSettings(supervisor=SupervisorSettings(confirm_s=2.0))) as ride:
        ride.tick(10)
        assert ride.chair.ready
        ride.chair.go(FAR)
        assert "press Drive" in ride.tick(30).verdict.reason
        assert ride.tick(20).navigation.stage is Stage.FAILED
        ride.chair.confirm()
        assert not any(ride.tick().verdict.computer_drives for _ in range(10))


def test_a_new_goal_stops_the_drive_until_it_is_confirmed(ride: Ride) -> None:
    ride.drive()
    ride.chair.go(FAR)
    states = [ride.tick() for _ in range(60)]
    assert {state.verdict.mode for state in states} == {DriveMode.MANUAL}
    assert states[0].sent.active  # by comfort, not by letting go
    assert ride.stands
    assert not states[-1].sent.active
    ride.chair.confirm()
    assert ride.tick(60).sent.active


def test_a_chair_with_a_seat_switch_does_not_drive_without_a_rider() -> None:
    with Ride(ChairSettings(fitness=FitnessSettings(seat_switch=True))) as ride:
        ride.tick(10)
        assert not ride.chair.ready  # no message has come
        ride.change = lambda messages: (*messages, ChairStatus(ride.simulator.now_ns, seated=True))
        ride.drive()
        ride.change = lambda messages: (*messages, ChairStatus(ride.simulator.now_ns, seated=False))
        assert ended_by(ride, within=2) == "seat_empty"


def test_a_chair_without_measured_stops_crawls() -> None:
    with Ride() as ride:
        board = ride.simulator._lines._board
        assert board is not None
        ride.chair = Chair(
            ride.setup.grid,
            {},
            ChairCalibration("A", ""),
            Reconnecting(lambda: board.transport),
            ride.simulator.truth(),
        )
        ride.drive(90)
        ride.tick(20)
        assert 0.2 < ride.speed < 0.34


def test_a_silent_monitor_stops_the_chair_until_a_reset(ride: Ride) -> None:
    ride.drive()
    monitor = ride.chair._base._monitor
    monitor.judge = lambda command, measured, now_ns: None  # type: ignore[method-assign]
    states = [ride.tick() for _ in range(14)]
    stopped = next(i for i, state in enumerate(states) if state.sent.wheel_speeds.left == 0.0)
    assert stopped <= 6  # 150 ms, and the way of the lines to neutral
    assert states[-1].verdict.halt is not None
    assert states[-1].verdict.halt.stop.id == "monitor_silent"
    del monitor.judge
    ride.tick(20)
    assert "monitor_silent" in {halted.stop.id for halted in ride.states[-1].halts}  # it is back, and latched
    ride.chair.reset()
    ride.tick(4)
    assert ride.chair.ready
    assert not ride.states[-1].verdict.computer_drives
