"""Calibration of a chair through the shipped firmware; every fault releases the lines."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from evaluation.scenes.chair_score import command_grid, inverse_error

from tests.calibration.drives.board_rig import PLANT, BoardRig
from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.drives.board_drive import BoardDrive, DriveLimits, plan_for_board
from waychair.calibration.drives.dac_and_stops import ChairUnderTest, calibrate_dac
from waychair.calibration.drives.measured_speeds import EncoderSpeeds, ScanSpeeds
from waychair.calibration.fits.fit_dac import LeastData
from waychair.calibration.fits.sweep import SweepSettings
from waychair.errors import BridgeError, CalibrationError, CalibrationMismatch, TransportError, WaychairError
from waychair.firmware_bridge.board import Defect, build_board
from waychair.firmware_bridge.protocol import FIRMWARE_VERSION, BoardState, Family, Holder
from waychair.simulation.simulator import SimulatorSettings
from waychair.trials.simulated_drive import with_gyro
from waychair.types import JoystickInput

SHORT = SweepSettings(levels=7, repetitions=1, combined=1)
ENOUGH = LeastData(levels=8, repetitions=1)
AHEAD = (PLANT.neutral_volts + 0.4, PLANT.neutral_volts)


@pytest.fixture(scope="session")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_board(tmp_path_factory.mktemp("board"))


@pytest.fixture
def rig(program: Path) -> Iterator[BoardRig]:
    with BoardRig(program) as rig:
        yield rig


@pytest.mark.nightly
def test_a_chair_calibrated_through_its_board_follows_its_commands(rig: BoardRig) -> None:
    with rig.drive(limits=DriveLimits(max_distance=12.0)) as drive:
        drive.arm()
        assert drive.neutral == pytest.approx([PLANT.neutral_volts] * 2, abs=0.001)
        plan = plan_for_board(SHORT, drive)
        assert (plan.bits, plan.volts_min, plan.volts_max) == (12, 0.0, 3.3)
        fit = calibrate_dac(ChairUnderTest(drive, drive.neutral, CHAIR_A), plan, ENOUGH)
    error = inverse_error(fit.model, PLANT, CHAIR_A, command_grid()[::2])
    assert error.max_v <= 0.015
    assert error.max_omega <= 0.025
    assert PLANT.delay_s < fit.model.forward.delay_s < PLANT.delay_s + 0.06  # plus the delay to the lines
    rig.wait_until(rig.now_ns() + 100_000_000)
    assert rig.lines[-1].holder is Holder.JOYSTICK


@pytest.mark.nightly
def test_a_chair_without_encoders_is_driven_by_lidar_and_gyro_lines(program: Path) -> None:
    with (
        BoardRig(program, with_gyro(SimulatorSettings(plant=PLANT)), side=16.0) as rig,
        rig.drive(ScanSpeeds(CHAIR_A)) as drive,
    ):
        drive.arm()
        samples = drive.hold(*AHEAD, 2.5)
    expected = rig.simulator.twist().v
    assert len(samples) > 20
    assert samples[-1].v == pytest.approx(expected, abs=0.05)


def test_nothing_moves_before_the_board_is_armed(rig: BoardRig) -> None:
    drive = rig.drive()
    with pytest.raises(BridgeError, match="not armed"):
        drive.hold(*AHEAD, 1.0)
    drive.arm()
    assert all(state.holder is Holder.JOYSTICK for state in rig.lines)
    assert rig.lines[-1].state is BoardState.ARMED
    assert rig.simulator.twist().v == 0.0


def _press(rig: BoardRig) -> None:
    rig.stick = JoystickInput(0, forward=-0.5)


def _estop(rig: BoardRig) -> None:
    rig.inputs["estop_released"] = False


def _freeze(rig: BoardRig) -> None:
    rig.inputs["defect"] = Defect.FROZEN


def _restart(rig: BoardRig) -> None:
    rig.inputs["defect"] = Defect.BROWN_OUT
    rig.events.append((810, lambda: rig.inputs.pop("defect")))


def _kill(rig: BoardRig) -> None:
    rig.board.kill()


def _pull(rig: BoardRig) -> None:
    rig.board.transport.close()


def _blind(rig: BoardRig) -> None:
    rig.silent_sensors = True


@pytest.mark.parametrize(
    ("event", "error", "says"),
    [
        (_press, BridgeError, "joystick was touched (-591 and +9 mV off its rest)"),
        (_estop, BridgeError, "the board stopped the chair: ESTOP"),
        (_freeze, BridgeError, "the board sent nothing for 0.2"),
        (_restart, BridgeError, "released the lines with the joystick at rest"),
        (_kill, TransportError, "cable to the board was lost"),
        (_pull, TransportError, "cable to the board was lost"),
        (BoardRig.pull_sensors, TransportError, "cable to the sensors was lost"),
        (_blind, CalibrationError, "no speeds came from the sensors for 0.6 s"),
    ],
)
def test_every_fault_is_named_and_gives_the_chair_to_the_rider(
    rig: BoardRig, event: Callable[[BoardRig], None], error: type[WaychairError], says: str
) -> None:
    rig.events.append((800, lambda: event(rig)))
    with rig.drive() as drive:
        drive.arm()
        with pytest.raises(error, match=re.escape(says)):
            drive.hold(*AHEAD, 5.0)
    rig.wait_until(rig.now_ns() + 200_000_000)
    assert rig.lines[-1].holder is not Holder.BOARD


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        (DriveLimits(max_distance=0.5), "beyond the limit of 0.5 m"),
        (DriveLimits(max_speed=0.2), "above the limits of 0.2"),
    ],
)
def test_a_chair_that_leaves_its_room_or_is_too_fast_is_stopped(rig: BoardRig, limits: DriveLimits, says: str) -> None:
    with rig.drive(limits=limits) as drive:
        drive.arm()
        with pytest.raises(CalibrationError, match=says):
            drive.hold(*AHEAD, 10.0)
    start = rig.simulator.truth()
    rig.wait_until(rig.now_ns() + 3_000_000_000)
    assert abs(rig.simulator.truth().x - start.x) < 0.4
    assert rig.simulator.twist().v == pytest.approx(0.0, abs=1e-3)


def test_a_hand_on_the_stick_keeps_the_board_from_being_armed(rig: BoardRig) -> None:
    rig.stick = JoystickInput(0, turn=0.3)
    with rig.drive() as drive, pytest.raises(BridgeError, match="hand off"):
        drive.arm()


def test_unreadable_sensor_output_is_quoted_in_the_error(rig: BoardRig) -> None:
    rig.silent_sensors = True
    with rig.drive() as drive:
        rig._printer.sendall(b"half a li\nspeed 3.5\n")
        with pytest.raises(BridgeError, match=r"1 lines of the sensors .* 'speed 3\.5'"):
            drive.arm()


def test_the_board_of_another_chair_is_refused_with_both_names(rig: BoardRig) -> None:
    with pytest.raises(CalibrationMismatch, match="into chair 'ward 3' and this calibration is of chair 'ward 4'"):
        BoardDrive(
            rig.board.transport,
            rig.sensors,
            EncoderSpeeds(CHAIR_A),
            "ward 4",
            family=Family.EIGHT_PIN_3V3,
            clock=rig,
        )


def test_another_joystick_family_is_refused(rig: BoardRig) -> None:
    with pytest.raises(BridgeError, match="made for joystick family"):
        BoardDrive(rig.board.transport, rig.sensors, EncoderSpeeds(CHAIR_A), "ward 3", family=Family.HALL_5V, clock=rig)


def test_a_drive_without_a_named_joystick_family_takes_that_of_the_board(rig: BoardRig) -> None:
    with BoardDrive(rig.board.transport, rig.sensors, EncoderSpeeds(CHAIR_A), "ward 3", clock=rig) as drive:
        assert drive.family == Family.EIGHT_PIN_3V3


def test_a_board_with_different_firmware_is_refused_by_its_hash(rig: BoardRig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("waychair.firmware_bridge.protocol.LAYOUT_HASH", 0x1234)
    with pytest.raises(BridgeError, match=r"layout [0-9a-f]{8} and this computer's 00001234: flash"):
        rig.drive()


def test_a_board_with_older_firmware_is_refused_with_both_versions(
    rig: BoardRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("waychair.firmware_bridge.advice.FIRMWARE_VERSION", FIRMWARE_VERSION + 0x100)
    with pytest.raises(BridgeError, match=r"runs firmware \d+\.\d+, and \d+\.\d+ is needed: flash"):
        rig.drive()


def test_a_port_without_a_board_is_refused(rig: BoardRig) -> None:
    rig.inputs["defect"] = Defect.FROZEN
    rig.wait_until(100_000_000)
    with pytest.raises(BridgeError, match="no board answered within 2 s"):
        rig.drive()
    rig.board.kill()
    with pytest.raises(TransportError, match="cable to the board was lost"):
        rig.drive()


def test_the_plan_stays_within_the_volts_that_the_board_permits(rig: BoardRig) -> None:
    with rig.drive() as drive:
        drive.arm()
        drive.neutral = (1.70, 1.65)
        assert plan_for_board(replace(SHORT, swing=3.0), drive).swing == pytest.approx(1.15)
        assert plan_for_board(replace(SHORT, swing=0.5), drive).swing == 0.5


@pytest.mark.parametrize("volts", [0.43, 2.87])
def test_volts_that_the_board_would_limit_are_refused(rig: BoardRig, volts: float) -> None:
    with rig.drive() as drive:
        drive.arm()
        with pytest.raises(CalibrationError, match="outside the 1200 mV round 1650 mV"):
            drive.hold(PLANT.neutral_volts, volts, 1.0)
