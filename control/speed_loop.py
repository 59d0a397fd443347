"""Speeds as they were asked for: an integral trim over a chair controller that nobody documents.

A calibration is never quite right (dead band, gain, asymmetry), and the planner corrects positions, not speeds: without
a trim a chair that turns too little passes its goal at a hand's breadth. The measured speeds are compared with what the
command would have done through the chair's delay and lag, so that the trim does not fight the lag itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from waychair.config import Settings, setting
from waychair.types import Twist


@dataclass(frozen=True, slots=True)
class SpeedLoopSettings(Settings):
    """How fast and how far the trim goes."""

    lag: float = setting(0.25, "s", "time constant of the chair, its delay included", low=0.01, high=2.0)
    gain: float = setting(1.5, "1/s", "trim per second and unit of error; 0 switches it off", low=0.0, high=5.0)
    max_v: float = setting(0.2, "m/s", "largest trim", low=0.0, high=0.5)
    max_omega: float = setting(0.4, "rad/s", "largest trim", low=0.0, high=1.0)


class SpeedLoop:
    """Keeps the trims and the speeds the chair should have by now."""

    def __init__(self, settings: SpeedLoopSettings) -> None:
        self._settings = settings
        self._last_ns: int | None = None
        self._expected = Twist()
        self._trim = Twist()

    def step(self, command: Twist | None, measured: Twist, now_ns: int) -> Twist:
        """The command plus its trim; None means that nobody drives, and the trim is forgotten.

        A chair that is to stand gets exactly 0, and the trims decay instead of growing: there is nothing to learn in a
        dead band. While either axis moves, both are trimmed: driving straight on is a turning speed of 0 that a chair
        with unlike motors does not keep by itself. A measurement that is not finite changes nothing.
        """
        if command is None:
            self._last_ns, self._expected, self._trim = None, measured, Twist()
            return Twist()
        seconds = 0.0 if self._last_ns is None else min(max((now_ns - self._last_ns) * 1e-9, 0.0), 0.2)
        self._last_ns = now_ns
        s = self._settings
        share = 1.0 - math.exp(-seconds / s.lag)
        self._expected = Twist(
            self._expected.v + share * (command.v - self._expected.v),
            self._expected.omega + share * (command.omega - self._expected.omega),
        )
        gain = s.gain * seconds
        if command == Twist():
            self._trim = Twist(self._trim.v * (1.0 - gain), self._trim.omega * (1.0 - gain))
            return Twist()
        if math.isfinite(measured.v) and math.isfinite(measured.omega):
            self._trim = Twist(
                _limited(self._trim.v + gain * (self._expected.v - measured.v), s.max_v),
                _limited(self._trim.omega + gain * (self._expected.omega - measured.omega), s.max_omega),
            )
        return Twist(command.v + self._trim.v, command.omega + self._trim.omega)


def _limited(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
