"""A calibration drive of a real chair: volts through the board, speeds from the chair's own sensors.

The board decides. It arms after the stick rested for two seconds, gives the lines back to the rider at once when the
joystick is touched, and within 100 ms after this computer's last command. Here every irregularity ends the drive: the
lines are released and the error states the cause.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Protocol, Self

import numpy as np

from waychair.calibration.sweep import Sample, SweepSettings
from waychair.config import Settings, setting
from waychair.errors import BridgeError, CalibrationError, CalibrationMismatch, TransportError
from waychair.firmware_bridge.advice import fault_names, refusal
from waychair.firmware_bridge.protocol import (
    BoardState,
    BoardTelemetry,
    Command,
    CommandFlag,
    Decoder,
    Family,
    Hello,
    HelloReply,
    Message,
    encode,
    hello,
    setpoint_from_millivolts,
)
from waychair.firmware_bridge.transports import Transport
from waychair.geometry import arc
from waychair.trials.measured_speeds import SpeedMeter
from waychair.trials.sensor_lines import SensorLines
from waychair.types import Pose2

PERIOD_NS = 20_000_000
"""Time between two commands (50 Hz)."""

_GOODBYES = 3
_BEYOND_MV = 5.0  # about one count of most converters


class Clock(Protocol):
    """The source of time of a drive; tests replace it by a simulated clock."""

    def now_ns(self) -> int:
        """Return a time [ns] that never steps back."""

    def wait_until(self, moment_ns: int) -> None:
        """Return at this moment, or at once if it has passed."""


class MonotonicClock:
    """The computer's monotonic clock."""

    def now_ns(self) -> int:
        """Return the monotonic time [ns]."""
        return time.monotonic_ns()

    def wait_until(self, moment_ns: int) -> None:
        """Sleep until this moment."""
        time.sleep(max(0.0, (moment_ns - self.now_ns()) * 1e-9))


@dataclass(frozen=True, slots=True)
class BoardDriveSettings(Settings):
    """Limits of a drive, and timeouts of board and sensors."""

    room: float = setting(6.0, "m", "farthest from where the drive began, by the chair's own speeds", low=0.5, high=100)
    fastest: float = setting(2.0, "m/s", "a chair that is faster than this is stopped", low=0.1, high=4.0)
    fastest_turn: float = setting(4.0, "rad/s", "as above, of turning", low=0.1, high=10.0)
    answer_s: float = setting(2.0, "s", "within which the board answers a greeting", low=0.1, high=30.0)
    arm_s: float = setting(8.0, "s", "within which it is armed: stick at rest, sensors there", low=2.5, high=60.0)
    silence_s: float = setting(0.2, "s", "without telemetry, after which the drive ends", low=0.05, high=2.0)
    blind_s: float = setting(0.6, "s", "without speeds, after which the drive ends", low=0.1, high=5.0)


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
        family: Family = Family.HALL_5V,
        clock: Clock | None = None,
        settings: BoardDriveSettings | None = None,
    ) -> None:
        """Greet the board; the board takes the lines only in `arm`.

        Raises:
            BridgeError: the board does not answer, or it refuses (with its reason).
            CalibrationMismatch: the board belongs to another chair.
            TransportError: the cable was lost.
        """
        self._board = board
        self._sensors = sensors
        self._meter = meter
        self._clock = clock or MonotonicClock()
        self._settings = settings or BoardDriveSettings()
        self._decoder = Decoder()
        self._lines = SensorLines()
        self._sequence = 0
        self._due_ns = self._clock.now_ns()
        self._heard_ns = self._seen_ns = self._due_ns
        self._telemetry: BoardTelemetry | None = None
        self._armed = False
        self._pose = Pose2()
        self._last: Sample | None = None
        self.neutral = (0.0, 0.0)
        self.reply = self._greet(chair_id, family)

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

    def arm(self) -> None:
        """Stand still, with the rider's stick on the lines, until the board is armed and the sensors deliver speeds.

        Raises:
            BridgeError, TransportError, CalibrationError: this did not happen in time, or see `hold`.
        """
        patience_ns = self._clock.now_ns() + round(self._settings.arm_s * 1e9)
        stick: list[tuple[float, float]] = []
        while not (self._armed and self._meter.ready):
            if self._clock.now_ns() > patience_ns:
                raise BridgeError(self._why_not_armed())
            self._tick(0, 0)
            telemetry = self._telemetry
            if telemetry is not None:
                self._armed = telemetry.state == BoardState.ARMED
                stick.append(self._stick_millivolts(telemetry))
        self._seen_ns = self._clock.now_ns()
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
            raise BridgeError("the board is not armed: arm it before the lines are held")
        setpoints = [self._setpoint(volts) for volts in (forward_volts, turn_volts)]
        samples: list[Sample] = []
        end_ns = self._clock.now_ns() + round(seconds * 1e9)
        while self._clock.now_ns() < end_ns:
            found = self._tick(setpoints[0], setpoints[1])
            self._refuse_unless_ours()
            self._refuse_astray(found)
            samples += found
        return samples

    def _setpoint(self, volts: float) -> int:
        reply = self.reply
        if abs(1e3 * volts - reply.reference_mv) > reply.swing_mv + _BEYOND_MV:
            raise CalibrationError(
                f"{volts:.3f} V lies beyond the {reply.swing_mv} mV about {reply.reference_mv} mV that the board lets "
                "through: take less swing"
            )
        return setpoint_from_millivolts(reply, 1e3 * volts)

    def release(self) -> None:
        """Release the lines to the rider's joystick. May be called twice, and after the cable was lost."""
        self._armed = False
        for _ in range(_GOODBYES):
            self._send(Command(0, 0, 0, 0))

    def _tick(self, forward: int, turn: int) -> list[Sample]:
        """Send one command, wait a period, and return the speeds that arrived."""
        now_ns = self._clock.now_ns()
        self._send(Command(forward, turn, CommandFlag.ENABLE, now_ns // 1000 & 0xFFFFFFFF))
        self._due_ns = max(self._due_ns + PERIOD_NS, now_ns)
        self._clock.wait_until(self._due_ns)
        self._listen()
        now_ns = self._clock.now_ns()
        found = self._meter.take_in(self._lines.feed(self._sensors.read(), now_ns))
        if found:
            self._seen_ns = now_ns
        if self._board.closed:
            raise TransportError("the cable to the board was lost; the joystick is live: plug it in and begin again")
        if self._sensors.closed:
            raise TransportError("the cable to the sensors was lost: plug it in and begin again")
        if now_ns - self._heard_ns > self._settings.silence_s * 1e9:
            raise BridgeError(
                f"the board has said nothing for {(now_ns - self._heard_ns) * 1e-9:.2f} s: look at its cable and power"
            )
        return found

    def _listen(self) -> list[Message]:
        messages = [received.message for received in self._decoder.feed(self._board.read())]
        for message in messages:
            if isinstance(message, BoardTelemetry):
                self._telemetry = message
                self._heard_ns = self._clock.now_ns()
        return messages

    def _refuse_unless_ours(self) -> None:
        """Raise BridgeError with the cause if the board no longer holds the lines for this computer."""
        telemetry = self._telemetry
        assert telemetry is not None
        if telemetry.faults:
            raise BridgeError(f"the board stopped the chair: {_names(telemetry.faults)}; see firmware_bridge/README.md")
        if telemetry.state in (BoardState.ARMED, BoardState.DRIVE):
            return
        forward, turn = (value - telemetry.reference_mv for value in _stick(telemetry))
        if 10 * max(abs(forward), abs(turn)) < self.reply.swing_mv:
            raise BridgeError(
                "the board let go of the lines with the joystick at rest, as it does when the joystick was touched for "
                "a moment or the board was restarted: begin again"
            )
        raise BridgeError(
            f"the joystick was touched ({forward:+d} and {turn:+d} mV off its rest), so that it took over: begin again "
            "when the chair may drive by itself"
        )

    def _refuse_astray(self, samples: list[Sample]) -> None:
        settings, now_ns = self._settings, self._clock.now_ns()
        if now_ns - self._seen_ns > settings.blind_s * 1e9:
            raise CalibrationError(self._why_blind((now_ns - self._seen_ns) * 1e-9))
        for sample in samples:
            last, self._last = self._last or sample, sample
            if abs(sample.v) > settings.fastest or abs(sample.omega) > settings.fastest_turn:
                raise CalibrationError(
                    f"the chair went at {sample.v:.2f} m/s and {sample.omega:.2f} rad/s, the limits are "
                    f"{settings.fastest:g} and {settings.fastest_turn:g}: take less swing, or look at the sensors"
                )
            seconds = (sample.stamp_ns - last.stamp_ns) * 1e-9
            self._pose = self._pose @ arc(sample.v * seconds, sample.omega * seconds)
        away = math.hypot(self._pose.x, self._pose.y)
        if away > settings.room:
            raise CalibrationError(
                f"the chair is {away:.1f} m from where it began, its room is {settings.room:g} m: take less swing, or "
                "give it more --room"
            )

    def _greet(self, chair_id: str, family: Family) -> HelloReply:
        ours = hello(chair_id, family)
        self._send(ours)
        patience_ns = self._clock.now_ns() + round(self._settings.answer_s * 1e9)
        while self._clock.now_ns() < patience_ns and not self._board.closed:
            self._due_ns = self._clock.now_ns() + PERIOD_NS
            self._clock.wait_until(self._due_ns)
            replies = [message for message in self._listen() if isinstance(message, HelloReply)]
            if replies:
                self._heard_ns = self._clock.now_ns()
                _refuse_stranger(replies[-1], ours)
                return replies[-1]
        if self._board.closed:
            raise TransportError("the cable to the board was lost: plug it in and begin again")
        raise BridgeError(
            f"no board has answered within {self._settings.answer_s:g} s: is this its port, and is it switched on?"
        )

    def _why_not_armed(self) -> str:
        seconds, telemetry = self._settings.arm_s, self._telemetry
        if telemetry is None:
            return f"the board was not armed within {seconds:g} s, for it says nothing: look at its cable and power"
        if telemetry.faults:
            return (
                f"the board was not armed within {seconds:g} s because of {_names(telemetry.faults)}: see "
                "firmware_bridge/README.md, then switch it off and on"
            )
        if self._armed:
            return self._why_blind(seconds)
        forward, turn = (value - telemetry.reference_mv for value in _stick(telemetry))
        return (
            f"the board was not armed within {seconds:g} s; the stick is {forward:+d} and {turn:+d} mV off the "
            "reference: take the hand off the joystick and begin again"
        )

    def _why_blind(self, seconds: float) -> str:
        if self._lines.bad:
            return (
                f"{self._lines.bad} lines of the sensors are not of their form, the last one '{self._lines.last_bad}'"
            )
        return f"no speeds came from the sensors for {seconds:.1f} s: look at their cable, or take --speeds-from"

    def _stick_millivolts(self, telemetry: BoardTelemetry) -> tuple[float, float]:
        """Return the rider's stick (forward, turn) [mV], scaled to the nominal reference."""
        scale = self.reply.reference_mv / max(telemetry.reference_mv, 1)
        forward, turn = _stick(telemetry)
        return forward * scale, turn * scale

    def _send(self, message: Message) -> None:
        self._board.write(encode(message, self._sequence))
        self._sequence += 1


def _refuse_stranger(reply: HelloReply, ours: Hello) -> None:
    """Check the board's reply.

    Raises:
        CalibrationMismatch: the board belongs to another chair.
        BridgeError: the board is incompatible.
    """
    why = refusal(reply, ours)
    if why:
        raise CalibrationMismatch(why) if reply.chair_id != ours.chair_id else BridgeError(why)


def _stick(telemetry: BoardTelemetry) -> tuple[int, int]:
    return telemetry.joystick_forward_mv, telemetry.joystick_turn_mv


def _names(faults: int) -> str:
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
