"""Model of how one axis of the chair follows its command: a delay, a ramp and a first-order lag.

A calibration identifies the same three figures from steps (`calibration.fits.fit_steps`). The control loops compare the
measured speed with the speed that this model expects by now, so that they do not fight the chair's own slowness.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from waychair.calibration.fits.axis_model import AxisModel

_SUBSTEP_S = 0.005
LONGEST_STEP_S = 0.2
"""s; the model advances by at most this after a pause, because the chair's motion during the pause is unknown."""


@dataclass(frozen=True, slots=True)
class AxisResponse:
    """Response of one axis: delay [s], time constant of the lag [s] and steepest change of speed [m/s^2] or [rad/s^2].

    `doubt_s` [s] is by how much the true delay may be longer, 0 for a measured one. The defaults suit a common chair that
    was not measured.
    """

    delay_s: float = 0.06
    lag_s: float = 0.18
    ramp: float = 100.0
    doubt_s: float = 0.2


def response_from_axis(axis: AxisModel, longest_s: float = math.inf) -> AxisResponse | None:
    """Return the identified response of an axis, its delay at most `longest_s`; None if no step of it was measured."""
    if axis.lag_s == 0.0:
        return None
    return AxisResponse(min(axis.delay_s, longest_s), max(axis.lag_s, 0.005), axis.ramp, doubt_s=0.0)


class ExpectedSpeed:
    """The speed that one axis should have by now.

    A command holds until the next one and takes effect after `delay_s`. A reference speed then follows the command
    along the ramp, and the chair's speed follows that reference with the lag.
    """

    def __init__(self, response: AxisResponse) -> None:
        self._response = response
        self.restart(0.0, 0.0)

    @property
    def now(self) -> float:
        """Expected speed at the last call of `advance`."""
        return self._speed

    @property
    def asked(self) -> float:
        """The command in effect, after the delay and before the ramp."""
        return self._in_effect

    def answer_by(self, response: AxisResponse) -> None:
        """Go on by another response; commands on the way take effect by its delay."""
        self._response = response

    def restart(self, speed: float, in_effect: float) -> None:
        """Start again from a speed, with a command already in effect."""
        self._speed, self._ramped, self._in_effect = speed, speed, in_effect
        self._on_the_way: deque[tuple[int, float]] = deque()
        self._now_ns: int | None = None

    def command(self, value: float, now_ns: int) -> None:
        """Set the commanded speed from now on; a second command at the same time replaces the first."""
        if self._on_the_way and self._on_the_way[-1][0] >= now_ns:
            self._on_the_way.pop()
        self._on_the_way.append((now_ns, value))

    def advance(self, now_ns: int) -> float:
        """Advance to a time and return the mean speed since the last call, as encoders measure it over a tick."""
        last_ns, self._now_ns = self._now_ns, now_ns
        seconds = 0.0 if last_ns is None else min(max((now_ns - last_ns) * 1e-9, 0.0), LONGEST_STEP_S)
        steps = math.ceil(seconds / _SUBSTEP_S - 1e-9)
        if steps == 0:
            return self._speed
        step_s = seconds / steps
        delay_ns = round(self._response.delay_s * 1e9)
        share = -math.expm1(-step_s / self._response.lag_s)
        total = 0.0
        for k in range(steps):
            middle_ns = now_ns - round((steps - k - 0.5) * step_s * 1e9)
            while self._on_the_way and self._on_the_way[0][0] + delay_ns <= middle_ns:
                self._in_effect = self._on_the_way.popleft()[1]
            reach = self._response.ramp * step_s
            self._ramped += min(reach, max(-reach, self._in_effect - self._ramped))
            before = self._speed
            self._speed += share * (self._ramped - self._speed)
            total += 0.5 * (before + self._speed)
        return total / steps
