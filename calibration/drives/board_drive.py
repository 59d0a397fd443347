"""A calibration drive of a real chair: volts through the board, speeds from the chair's own sensors.

The board decides. It arms after the stick rested for two seconds, gives the lines back to the rider at once when the
joystick is touched, and within 100 ms after this computer's last command. Here every irregularity ends the drive: the
lines are released and the error states the cause.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Self

import numpy as np

from waychair.calibration.drives.board_talk import BoardTalk, Clock, MonotonicClock
from waychair.calibration.drives.measured_speeds import SpeedMeter
from waychair.calibration.drives.sensor_lines import SensorLines
from waychair.calibration.fits.sweep import Sample, SweepSettings
from waychair.config import Settings, setting
from waychair.errors import BridgeError, CalibrationError, TransportError
from waychair.firmware_bridge.advice import fault_names
from waychair.firmware_bridge.protocol import BoardState, BoardTelemetry, Family, setpoint_from_millivolts
from waychair.firmware_bridge.transports import Transport
from waychair.geometry import arc
from waychair.install_advice import document
from waychair.types import Pose2

ARM_S = 8.0  # the board arms within this time, after two seconds of rest; the sensors deliver by then
TELEMETRY_TIMEOUT_S = 0.2  # the drive ends after this time without telemetry, which comes at 50 Hz
SPEEDS_TIMEOUT_S = 0.6  # the drive ends after this time without speeds; a lidar gives 10 a second

_TOLERANCE_MV = 5.0  # about one count of most converters


@dataclass(frozen=True, slots=True)
class DriveLimits(Settings):
    """Limits of a calibration drive of a real chair."""

    max_distance: float = setting(
        6.0,
        "m",
        "distance from the start at which a calibration drive ends; larger: it needs a larger hall",
        low=0.5,
        high=100,
    )
    max_speed: float = setting(
        2.0,
        "m/s",
        "speed above which a calibration drive ends; larger: a faster chair can be calibrated",
        low=0.1,
        high=4.0,
    )
    max_turn_rate: float = setting(
        4.0,
        "rad/s",
        "turn rate above which a calibration drive ends; larger: a faster chair can be calibrated",
        low=0.1,
        high=10.0,
    )


class _SensedSpeeds:
    """The speeds that a chair's own sensors give; the last ones came at `heard_ns`."""

    def __init__(self, sensors: Transport, meter: SpeedMeter, now_ns: int) -> None:
        self.heard_ns = now_ns
        self._sensors = sensors
        self._meter = meter
        self._lines = SensorLines()

    @property
    def closed(self) -> bool:
        """Whether the cable was lost."""
        return self._sensors.closed

    @property
    def ready(self) -> bool:
        """Whether the sensors deliver speeds."""
        return self._meter.ready

    def read(self, now_ns: int) -> list[Sample]:
        """Return the speeds that arrived."""
        found = self._meter.add_messages(self._lines.feed(self._sensors.read(), now_ns))
        if found:
            self.heard_ns = now_ns
        return found

    def silence(self, seconds: float) -> str:
        """Return why no speeds came for so long."""
        if self._lines.bad:
            return (
                f"{self._lines.bad} lines of the sensors are invalid, the last one '{self._lines.last_bad}': see "
                "calibration/drives/sensor_lines.py"
            )
        return f"no speeds came from the sensors for {seconds:.1f} s: check their cable, or change --speeds-from"


class _MotionGuard:
    """Ends a drive that is too fast, or too far from its start by dead reckoning."""

    def __init__(self, limits: DriveLimits) -> None:
        self._limits = limits
        self._pose = Pose2()
        self._last: Sample | None = None

    def check(self, samples: list[Sample]) -> None:
        """Take in the speeds of a period.

        Raises:
            CalibrationError: a speed or the distance from the start is beyond the limits.
        """
        limits = self._limits
        for sample in samples:
            last, self._last = self._last or sample, sample
            if abs(sample.v) > limits.max_speed or abs(sample.omega) > limits.max_turn_rate:
                raise CalibrationError(
                    f"the chair moved at {sample.v:.2f} m/s and {sample.omega:.2f} rad/s, above the limits of "
                    f"{limits.max_speed:g} and {limits.max_turn_rate:g}: reduce --swing, or check the sensors"
                )
            seconds = (sample.stamp_ns - last.stamp_ns) * 1e-9
            self._pose = self._pose @ arc(sample.v * seconds, sample.omega * seconds)
        away = math.hypot(self._pose.x, self._pose.y)
        if away > limits.max_distance:
            raise CalibrationError(
                f"the chair is {away:.1f} m from its start, beyond the limit of {limits.max_distance:g} m: reduce "
                "--swing, or raise --room"
            )


class BoardDrive:
    """A `Drive` of a chair through its board; a context manager that always releases the lines at the end.

    `neutral` (forward, turn) [V] is the reading of the rider's stick at rest while the board was armed. `reply` holds
    the board's description of its converter. Volts refer to the nominal reference; the board scales them to its own.
    """

    def __init__(
        self,
        board: Transport,
        sensors: Transport,
        meter: SpeedMeter,
        chair_id: str,
        *,
        family: Family | None = None,
        clock: Clock | None = None,
        limits: DriveLimits | None = None,
    ) -> None:
        """Greet the board; the board takes the lines only in `arm`. `family` None takes the board's joystick family.

        Raises:
            BridgeError: the board does not answer, or it refuses (with its reason).
            CalibrationMismatch: the board belongs to another chair.
            TransportError: the cable was lost.
        """
        self._clock = clock or MonotonicClock()
        self._talk = BoardTalk(board, self._clock)
        self._speeds = _SensedSpeeds(sensors, meter, self._clock.now_ns())
        self._guard = _MotionGuard(limits or DriveLimits())
        self._armed = False
        self.neutral = (0.0, 0.0)
        self.reply = self._talk.greet(chair_id, family)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    @property
    def now_ns(self) -> int:
        """Time [ns] of the clock that stamps commands and sensors."""
        return self._clock.now_ns()

    @property
    def family(self) -> Family:
        """The joystick family for which the board was flashed."""
        return Family(self.reply.family)

    def arm(self) -> None:
        """Stand still, with the rider's stick on the lines, until the board is armed and the sensors deliver speeds.

        Raises:
            BridgeError, TransportError, CalibrationError: this did not happen in time, or see `hold`.
        """
        deadline_ns = self._clock.now_ns() + round(ARM_S * 1e9)
        stick: list[tuple[float, float]] = []
        while not (self._armed and self._speeds.ready):
            if self._clock.now_ns() > deadline_ns:
                raise BridgeError(self._not_armed_reason())
            self._tick(0, 0)
            telemetry = self._talk.telemetry
            if telemetry is not None:
                self._armed = telemetry.state == BoardState.ARMED
                stick.append(self._scaled_stick(telemetry))
        self._speeds.heard_ns = self._clock.now_ns()
        forward, turn = np.median(stick, axis=0).tolist()
        self.neutral = forward / 1e3, turn / 1e3

    def hold(self, forward_volts: float, turn_volts: float, seconds: float) -> list[Sample]:
        """Hold the lines at these volts for `seconds`; see `Drive`.

        Raises:
            BridgeError: the rider took over, the board reported a fault or sent no telemetry, or it is not armed.
            TransportError: a cable was lost.
            CalibrationError: no speeds arrived, the chair left its area or went too fast, or the board does not allow
                these volts.
        """
        if not self._armed:
            raise BridgeError("the board is not armed: arm it before holding the lines")
        setpoints = [self._setpoint(volts) for volts in (forward_volts, turn_volts)]
        samples: list[Sample] = []
        end_ns = self._clock.now_ns() + round(seconds * 1e9)
        while self._clock.now_ns() < end_ns:
            found = self._tick(setpoints[0], setpoints[1])
            self._check_holder()
            self._check_motion(found)
            samples += found
        return samples

    def _setpoint(self, volts: float) -> int:
        reply = self.reply
        if abs(1e3 * volts - reply.reference_mv) > reply.swing_mv + _TOLERANCE_MV:
            raise CalibrationError(
                f"{volts:.3f} V is outside the {reply.swing_mv} mV round {reply.reference_mv} mV that the board "
                "allows: reduce --swing"
            )
        return setpoint_from_millivolts(reply, 1e3 * volts)

    def release(self) -> None:
        """Release the lines to the rider's joystick. May be called twice, and after the cable was lost."""
        self._armed = False
        self._talk.release()

    def _tick(self, forward: int, turn: int) -> list[Sample]:
        """Send one command, wait a period, and return the speeds that arrived."""
        self._talk.exchange(forward, turn)
        now_ns = self._clock.now_ns()
        found = self._speeds.read(now_ns)
        if self._talk.closed:
            raise TransportError("the cable to the board was lost and the joystick is live: plug it in and start again")
        if self._speeds.closed:
            raise TransportError("the cable to the sensors was lost: plug it in and start again")
        if now_ns - self._talk.heard_ns > TELEMETRY_TIMEOUT_S * 1e9:
            raise BridgeError(
                f"the board sent nothing for {(now_ns - self._talk.heard_ns) * 1e-9:.2f} s: check its cable and power"
            )
        return found

    def _check_holder(self) -> None:
        """Raise BridgeError with the cause if the board no longer holds the lines for this computer."""
        telemetry = self._talk.telemetry
        assert telemetry is not None
        if telemetry.faults:
            raise BridgeError(
                f"the board stopped the chair: {_fault_text(telemetry.faults)}; see {document('firmware_bridge/README.md')}"
            )
        if telemetry.state in (BoardState.ARMED, BoardState.DRIVE):
            return
        forward, turn = (value - telemetry.reference_mv for value in _stick(telemetry))
        if 10 * max(abs(forward), abs(turn)) < self.reply.swing_mv:
            raise BridgeError(
                "the board released the lines with the joystick at rest, as the joystick was touched briefly or the "
                "board restarted: start again"
            )
        raise BridgeError(
            f"the joystick was touched ({forward:+d} and {turn:+d} mV off its rest) and took over: start again when "
            "the chair may drive by itself"
        )

    def _check_motion(self, samples: list[Sample]) -> None:
        silent_ns = self._clock.now_ns() - self._speeds.heard_ns
        if silent_ns > SPEEDS_TIMEOUT_S * 1e9:
            raise CalibrationError(self._speeds.silence(silent_ns * 1e-9))
        self._guard.check(samples)

    def _not_armed_reason(self) -> str:
        seconds, telemetry = ARM_S, self._talk.telemetry
        if telemetry is None:
            return f"the board was not armed within {seconds:g} s and sends nothing: check its cable and power"
        if telemetry.faults:
            return (
                f"the board was not armed within {seconds:g} s because of {_fault_text(telemetry.faults)}: see "
                f"{document('firmware_bridge/README.md')}, then switch it off and on"
            )
        if self._armed:
            return self._speeds.silence(seconds)
        forward, turn = (value - telemetry.reference_mv for value in _stick(telemetry))
        return (
            f"the board was not armed within {seconds:g} s; the stick is {forward:+d} and {turn:+d} mV off the "
            "reference: take the hand off the joystick and start again"
        )

    def _scaled_stick(self, telemetry: BoardTelemetry) -> tuple[float, float]:
        """Return the rider's stick (forward, turn) [mV], scaled to the nominal reference."""
        scale = self.reply.reference_mv / max(telemetry.reference_mv, 1)
        forward, turn = _stick(telemetry)
        return forward * scale, turn * scale


def _stick(telemetry: BoardTelemetry) -> tuple[int, int]:
    return telemetry.joystick_forward_mv, telemetry.joystick_turn_mv


def _fault_text(faults: int) -> str:
    return ", ".join(fault_names(faults))


def plan_for_board(plan: SweepSettings, drive: BoardDrive) -> SweepSettings:
    """Return the plan in counts of the board's converter, within the swing that the board allows."""
    reply = drive.reply
    off = max(abs(volts - reply.reference_mv / 1e3) for volts in drive.neutral)
    return replace(
        plan,
        bits=reply.dac_bits,
        volts_min=reply.dac_low_mv / 1e3,
        volts_max=reply.dac_high_mv / 1e3,
        swing=min(plan.swing, reply.swing_mv / 1e3 - off),
    )
