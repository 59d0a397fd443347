"""Simulated chairs under the speed loop: they drive straight on 8 bits, and stop when their response has changed."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from evaluation.scenes.straight import LoopDrive, drive_straight

from tests.trials.known_chairs import known_model
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.speed import following_faults as following
from waychair.control.speed import gain_watch
from waychair.simulation.plan.world import World
from waychair.simulation.plant.mujoco_model import MujocoSettings
from waychair.simulation.plant.plant import PlantSettings, randomised
from waychair.simulation.plant.plant_families import PlantFamily
from waychair.simulation.scene.scene import Slope
from waychair.simulation.simulator import SimulatorSettings
from waychair.types import OccupancyGrid, Pose2, SentCommand, Twist, WheelSpeeds

PLANT = PlantSettings()
TICK_S = 0.05


@pytest.fixture
def deaf(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the gain watch ignore every gain, so that only F20 can stop the chair."""
    monkeypatch.setattr(gain_watch, "SLOW_OUTSIDE", 10.0)
    monkeypatch.setattr(gain_watch, "STOP_OUTSIDE", 10.0)


def lopsided(plant: PlantSettings, skew: float) -> PlantSettings:
    """Return the chair with unequal motors: the left one is faster by `skew`, the right one slower."""
    return dataclasses.replace(plant, forward_skew=plant.forward_skew + skew)


def drive_of(plant: PlantSettings, known: PlantSettings | None = None) -> LoopDrive:
    """Return a drive of a chair that was calibrated with the plant `known`."""
    return LoopDrive(known_model(known or plant), CHAIR_A, SimulatorSettings(plant=plant), 1)


def until_fault(drive: LoopDrive, command: Twist, seconds: float) -> tuple[float, str]:
    """Return the time [s] at this command until the loop stops the chair, and the reason."""
    for k in range(round(seconds / TICK_S)):
        part = min(1.0, (k + 1) * TICK_S * 0.5 / max(abs(command.v), abs(command.omega), 1e-9))
        drive.tick(Twist(part * command.v, part * command.omega))
        if drive.loop.fault:
            return k * TICK_S, drive.loop.fault
    return seconds, ""


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", range(4))
def test_eight_bits_and_an_uncalibrated_asymmetry_still_drive_ten_metres_straight(seed: int) -> None:
    plant = randomised(PLANT, seed)
    drive = drive_of(lopsided(plant, 0.03 if seed % 2 else -0.03), plant)
    result = drive_straight(drive)
    assert abs(result.left_m) <= 0.05
    assert result.widest_m <= 0.10
    assert result.ahead_m == pytest.approx(10.0, abs=0.15)
    assert result.speed_rms < 0.03
    assert result.fault == ""
    assert drive.loop.speed_limit == math.inf


def test_without_the_speed_loop_the_same_chair_leaves_its_line_by_metres() -> None:
    result = drive_straight(drive_of(lopsided(PLANT, 0.03), PLANT), closed=False)
    assert abs(result.left_m) > 1.0


def test_in_reverse_the_line_is_held_too() -> None:
    drive = drive_of(lopsided(dataclasses.replace(PLANT, family=PlantFamily(caster_flip=0.12)), 0.03), PLANT)
    start = drive.simulator.truth()
    for k in range(400):
        drive.tick(Twist(-min(0.4, 0.025 * k), 0.0))
    end = start.inverse() @ drive.simulator.truth()
    assert end.x < -5.0
    assert abs(end.theta) < 0.03
    assert abs(end.y) < 0.15


def test_the_loop_waits_for_a_brake_that_opens_late() -> None:
    plant = dataclasses.replace(PLANT, family=PlantFamily(brake_release_s=0.5))
    result = drive_straight(drive_of(plant, PLANT), 4.0)
    assert result.fault == ""
    assert abs(result.left_m) < 0.02
    assert result.jerk_max < 8.0


@pytest.mark.usefixtures("deaf")
@pytest.mark.parametrize("gain", [0.5, 2.0])
def test_f20_a_chair_of_half_or_twice_the_gain_is_stopped(gain: float) -> None:
    changed = dataclasses.replace(
        PLANT, forward_gain=gain * PLANT.forward_gain, turn_gain=gain * PLANT.turn_gain, swing_volts=1.2
    )
    drive = drive_of(changed, PLANT)
    seconds, fault = until_fault(drive, Twist(0.9, 0.0), 6.0)
    assert "does not follow (F20)" in fault
    assert seconds < 4.0
    for _ in range(60):
        drive.tick(Twist(0.9, 0.0))  # the chair does not move in spite of repeated commands
    assert abs(drive.simulator.twist().v) < 0.01


@pytest.mark.usefixtures("deaf")
def test_f20_the_loop_stops_on_a_slope_too_steep_for_the_motors() -> None:
    start = Pose2(5.0, 10.0, 0.3)
    hill = World(
        "hill",
        OccupancyGrid(np.zeros((400, 400), np.int8), 0.05),
        start,
        slopes=(Slope(start @ Pose2(4.2, 0.0), 6.0, 2.0, 0.0, 1.0),),
    )
    weak = MujocoSettings(motor_torque=14.0)
    settings = SimulatorSettings(plant_model="mujoco", plant=PLANT, mujoco=weak)
    drive = LoopDrive(known_model(PLANT), CHAIR_A, settings, 1, world=hill)
    for k in range(300):
        drive.tick(Twist(min(0.6, 0.025 * k), 0.0))
        if drive.loop.fault:
            break
    assert "F20" in drive.loop.fault
    assert (start.inverse() @ drive.simulator.truth()).x > 0.5  # it did follow on the level


def test_f20_a_brake_that_never_opens_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    shut = dataclasses.replace(PLANT, family=PlantFamily(brake_release_s=2.0))
    monkeypatch.setattr(following, "STUCK_S", 1.5)
    seconds, fault = until_fault(drive_of(shut, PLANT), Twist(0.25, 0.0), 3.0)
    assert "does not move (F20)" in fault
    assert seconds < 2.0


def test_f21_a_neutral_that_has_moved_beyond_the_dead_band_is_a_fault_until_it_is_acknowledged() -> None:
    moved = dataclasses.replace(PLANT, neutral_volts=PLANT.neutral_volts - PLANT.forward_dead_band - 0.06)
    drive = drive_of(moved, PLANT)
    seconds, fault = until_fault(drive, Twist(), 3.0)
    assert "moves at neutral (F21)" in fault
    assert seconds < 1.5
    assert drive.loop.step(Twist(0.5, 0.0), Twist(), drive.simulator.now_ns, drive.sent) == Twist()
    drive.loop.acknowledge()
    assert drive.loop.fault == ""


def test_f21_a_chair_that_coasts_at_neutral_is_no_fault() -> None:
    drive = drive_of(PLANT)
    assert until_fault(drive, Twist(1.0, 0.0), 4.0)[1] == ""
    assert until_fault(drive, Twist(), 4.0)[1] == ""
    assert abs(drive.simulator.twist().v) < 1e-3


@pytest.mark.parametrize(("dial", "known"), [(0.3, 1.0), (0.55, 1.0), (1.0, 0.6)])
def test_a_turned_speed_dial_stops_the_chair_within_three_metres(dial: float, known: float) -> None:
    turned, calibrated = (dataclasses.replace(PLANT, family=PlantFamily(dial=value)) for value in (dial, known))
    drive = drive_of(turned, calibrated)
    start = drive.simulator.truth()
    _, fault = until_fault(drive, Twist(0.5, 0.0), 8.0)
    assert "speed dial or drive profile changed" in fault
    assert (start.inverse() @ drive.simulator.truth()).x < 3.0


def test_a_slightly_turned_speed_dial_slows_the_chair() -> None:
    drive = drive_of(dataclasses.replace(PLANT, family=PlantFamily(dial=0.7)), PLANT)
    assert until_fault(drive, Twist(0.8, 0.0), 8.0)[1] == ""
    assert drive.measured.v == pytest.approx(0.3, abs=0.03)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", range(20))
def test_an_unchanged_chair_gives_no_false_alarm(seed: int) -> None:
    drive = drive_of(randomised(PLANT, seed))
    rng = np.random.default_rng(seed)
    v = omega = 0.0
    for _ in range(4):
        wanted_v, wanted_omega = float(rng.uniform(-0.3, 0.9)), float(rng.uniform(-0.8, 0.8))
        for _ in range(40):
            v += min(0.03, max(-0.03, wanted_v - v))
            omega += min(0.06, max(-0.06, wanted_omega - omega))
            drive.tick(Twist(v, omega))
            assert drive.loop.fault == ""
            assert drive.loop.speed_limit == math.inf
    assert drive.loop.gains == pytest.approx((1.0, 1.0), abs=0.12)


def test_a_rider_who_drives_is_neither_watched_nor_trimmed() -> None:
    drive = drive_of(PLANT)
    released = SentCommand(0, WheelSpeeds(), 0, 0, 0.0, 0.0, active=False, reason="the rider drives")
    for k in range(200):
        assert drive.loop.step(None, Twist(1.0, 0.5), k * 50_000_000, released) == Twist()
    assert drive.loop.fault == ""
    assert drive.loop.gains == (1.0, 1.0)
