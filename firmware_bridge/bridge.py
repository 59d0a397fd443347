"""The last gate before the joystick lines: a fresh, finite, allowed command drives them, anything else lets them go.

Fails silent: whatever is wrong, the lines are released, so that the rider's own joystick is live, and the caller is
told why. Nothing here raises on account of a command.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from waychair.calibration.dac import (
    DacModel,
    counts_from_wheel_speeds,
    neutral_counts,
    volts_from_counts,
    wheel_speeds_from_counts,
)
from waychair.config import Settings, setting
from waychair.errors import CalibrationError
from waychair.types import Sent, WheelSpeeds


class Lines(Protocol):
    """The two joystick lines of the chair's own controller."""

    def drive(self, forward_volts: float, turn_volts: float) -> None:
        """Hold the lines at these volts instead of the rider's joystick; turn above neutral is to the right."""

    def release(self) -> None:
        """Let go: the rider's joystick passes through."""


@dataclass(frozen=True, slots=True)
class BridgeSettings(Settings):
    """What the bridge lets through."""

    max_age_ms: int = setting(150, "ms", "age beyond which a command is stale", low=10, high=1000)
    max_wheel_speed: float = setting(1.6, "m/s", "a wheel command beyond this is a fault", low=0.1, high=4.0)
    slew: int = setting(24, "counts", "largest change of either axis per tick", low=1, high=255)


class Bridge:
    """From wheel speeds to the lines, one call a tick. Starts with the lines released."""

    def __init__(self, lines: Lines, calibration: DacModel, settings: BridgeSettings | None = None) -> None:
        self._lines = lines
        self._calibration = calibration
        self._settings = settings or BridgeSettings()
        self._rest = neutral_counts(calibration)
        self._counts = self._rest
        self._now_ns: int | None = None
        lines.release()

    def send(self, speeds: WheelSpeeds | None, stamp_ns: int, now_ns: int) -> Sent:
        """Drive the lines at wheel speeds [m/s] decided at `stamp_ns`, or release them; what was really sent.

        None means that the computer does not want to drive. `stamp_ns` and `now_ns` are of one monotonic clock. A
        change larger than `slew` is spread over the following ticks, both axes in step.
        """
        fault = self._fault(speeds, stamp_ns, now_ns)
        self._now_ns = now_ns
        if speeds is None or fault:
            return self._let_go(now_ns, fault)
        try:
            wanted = counts_from_wheel_speeds(self._calibration, speeds)
        except CalibrationError as error:
            return self._let_go(now_ns, str(error))
        if not all(isinstance(count, int) and 0 <= count <= self._calibration.counts_max for count in wanted):
            return self._let_go(now_ns, f"the calibration gave {wanted}, which are no counts")
        self._counts = _towards(self._counts, wanted, self._settings.slew)
        volts = volts_from_counts(self._calibration, *self._counts)
        self._lines.drive(*volts)
        reached = wheel_speeds_from_counts(self._calibration, *self._counts)
        return Sent(now_ns, reached, *self._counts, *volts, active=True)

    def _fault(self, speeds: WheelSpeeds | None, stamp_ns: int, now_ns: int) -> str:
        """Why this command must not be sent; empty when it may be."""
        if speeds is None:
            return "no command"
        if self._now_ns is not None and now_ns < self._now_ns:
            return f"the clock went back by {(self._now_ns - now_ns) / 1e6:g} ms"
        if stamp_ns > now_ns:
            return f"the command is {(stamp_ns - now_ns) / 1e6:g} ms from the future"
        if now_ns - stamp_ns > self._settings.max_age_ms * 1_000_000:
            return f"the command is {(now_ns - stamp_ns) / 1e6:g} ms old"
        if not (math.isfinite(speeds.left) and math.isfinite(speeds.right)):
            return f"wheel speeds {speeds.left}, {speeds.right} are not finite"
        if max(abs(speeds.left), abs(speeds.right)) > self._settings.max_wheel_speed:
            return f"wheel speeds {speeds.left:g}, {speeds.right:g} m/s are beyond {self._settings.max_wheel_speed:g}"
        return ""

    def _let_go(self, now_ns: int, reason: str) -> Sent:
        self._lines.release()
        self._counts = self._rest
        volts = volts_from_counts(self._calibration, *self._rest)
        return Sent(now_ns, WheelSpeeds(), *self._rest, *volts, active=False, reason=reason)


def _towards(counts: tuple[int, int], wanted: tuple[int, int], slew: int) -> tuple[int, int]:
    """Counts after one tick: on the straight line to `wanted`, neither axis changed by more than `slew`."""
    forward, turn = wanted[0] - counts[0], wanted[1] - counts[1]
    fraction = min(1.0, slew / max(abs(forward), abs(turn), 1))
    return counts[0] + round(fraction * forward), counts[1] + round(fraction * turn)
