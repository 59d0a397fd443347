"""Estimation of each axis' gain while driving, to notice that the chair no longer matches its calibration.

When somebody turns the speed dial or switches the drive profile, the same volts give another speed. The volts that were
really sent give an expected speed by the calibration and the axis' delay, ramp and lag; it is compared with the
measured speed. Only steady motion is informative, so an axis that is hardly used is not judged.
"""

from __future__ import annotations

import math

import numpy as np

from waychair.control.speed.axis_response import LONGEST_STEP_S, AxisResponse, ExpectedSpeed
from waychair.types import FloatArray, Twist

SLOW_OUTSIDE, BACK_WITHIN, STOP_OUTSIDE = 0.2, 0.15, 0.4
"""A gain farther than the first value from 1 slows the chair, one within the second frees it, the third stops it."""

SLOW_SPEED = 0.3
"""m/s; highest speed of a chair with a doubtful gain."""

LEAST_V, LEAST_OMEGA = 0.15, 0.25
"""m/s, rad/s; an axis is judged from this expected speed on."""

NOISE_V, NOISE_OMEGA = 0.08, 0.15
"""m/s, rad/s; one sigma of a calibration's error."""

FIRST_GAIN, FIRST_CROSS = 0.3, 0.15
"""One sigma of the gain and of the other axis' effect at first."""

DRIFT = 0.02
"""1/sqrt(s); drift of both coefficients, as a random walk."""

CERTAIN = 0.05
"""A gain is judged once its sigma is below this."""

_SETTLED = 0.15  # a settled axis is within this share of the speed asked of it
_CORRELATED_S = 0.3  # correlation time of ripple and rounding
_CLEAR = 0.25  # a gain's deviation is judged once its sigma is below this share of it


class AxisGain:
    """Gain of one axis and effect of the other axis on it, by recursive least squares.

    measured = gain own + cross other, `own` and `other` being expected speeds. Both coefficients drift slowly, so this
    is the Kalman filter of a random walk (Ljung, System Identification, section 11.2) and old data count less. Without
    the second term, a chair with unequal motors would look like a chair that turns too much.
    """

    def __init__(
        self, noise: float, first_gain: float = FIRST_GAIN, first_cross: float = FIRST_CROSS, drift: float = DRIFT
    ) -> None:
        """Start from a gain of 1; `noise` is one sigma of the measured speed's error."""
        self._drift = drift
        self._variance = noise * noise * _CORRELATED_S
        self._values: FloatArray = np.array([1.0, 0.0])
        self._covariance: FloatArray = np.diag([first_gain**2, first_cross**2])

    @property
    def gain(self) -> float:
        """Ratio of the speed to the speed that the calibration expects."""
        return float(self._values[0])

    @property
    def sigma(self) -> float:
        """Standard deviation of the gain."""
        return math.sqrt(float(self._covariance[0, 0]))

    def update(self, own: float, other: float, measured: float, seconds: float) -> None:
        """Update with mean speeds over `seconds` [s]; faster and longer samples weigh more."""
        row = np.array([own, other])
        covariance = self._covariance + np.eye(2) * self._drift**2 * seconds
        column = covariance @ row
        gain = column / (row @ column + self._variance / seconds)
        self._values = self._values + gain * (measured - row @ self._values)
        self._covariance = covariance - np.outer(gain, column)


class GainWatch:
    """Both axes' gains, with the speed limit and the fault that follow from them."""

    def __init__(self, forward: AxisResponse, turn: AxisResponse) -> None:
        self._expected = ExpectedSpeed(forward), ExpectedSpeed(turn)
        self._gains = AxisGain(NOISE_V), AxisGain(NOISE_OMEGA)
        self._last_ns: int | None = None
        self._slow = False
        self.expected = Twist()
        """The twist that the calibration expects now of the counts that were sent."""
        self.fault = ""

    @property
    def gains(self) -> tuple[float, float]:
        """Gains of the forward and the turn axis; 1 as calibrated."""
        return self._gains[0].gain, self._gains[1].gain

    @property
    def speed_limit(self) -> float:
        """Highest speed [m/s] that the gains allow; +inf as calibrated."""
        return SLOW_SPEED if self._slow else math.inf

    def step(self, sent: Twist, measured: Twist, now_ns: int, *, judged: bool = True) -> str:
        """Take in one tick; return the fault with its remedy, or "". A fault stays until a new watch is made.

        `sent` is the twist that the calibration expects of the counts sent at the tick before, `measured` the mean
        twist since. Ticks not to be `judged` (brake, casters, joystick) only keep the expected speeds up to date.
        """
        last_ns, self._last_ns = self._last_ns, now_ns
        if last_ns is None or now_ns <= last_ns:
            return self.fault
        for axis, value in zip(self._expected, (sent.v, sent.omega), strict=True):
            axis.command(value, last_ns)
        v, omega = (axis.advance(now_ns) for axis in self._expected)
        self.expected = Twist(v, omega)
        if judged and math.isfinite(measured.v) and math.isfinite(measured.omega):
            seconds = min((now_ns - last_ns) * 1e-9, LONGEST_STEP_S)
            forward, turn = self._gains
            if abs(v) > LEAST_V and self._settled(0, v):
                forward.update(v, math.copysign(abs(omega), v), measured.v, seconds)
            if abs(omega) > LEAST_OMEGA and self._settled(1, omega):
                turn.update(omega, v, measured.omega, seconds)
            self._judge()
        return self.fault

    def _settled(self, index: int, speed: float) -> bool:
        return abs(self._expected[index].asked - speed) < _SETTLED * abs(speed)

    def _judge(self) -> None:
        known = [axis.gain for axis in self._gains if axis.sigma < max(CERTAIN, _CLEAR * abs(axis.gain - 1.0))]
        farthest = max(known, key=lambda gain: abs(gain - 1.0), default=1.0)
        off = abs(farthest - 1.0)
        self._slow = off > (BACK_WITHIN if self._slow else SLOW_OUTSIDE)
        if off > STOP_OUTSIDE and not self.fault:
            self.fault = (
                f"speed dial or drive profile changed: the chair moves at {100.0 * farthest:.0f} % of its calibrated "
                "speed; set dial and profile back, or calibrate again"
            )
