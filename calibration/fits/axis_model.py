"""Model of one joystick axis: line volts to the steady speed, and back in closed form.

On either side of neutral there is a dead band up to an edge, then a monotone quadratic up to a top speed:

    |speed| = min(gain s + curve s^2, limit),   s = |volts - neutral| - dead band > 0

Plain polynomials and lines through neutral miss a chair's dead band by far more than its noise. Speeds show the edges
but not the neutral of the chair's electronics, so the neutral is measured on the original stick at rest, and the edges
are kept relative to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from waychair.calibration.measured import Measured, measured
from waychair.errors import NotMonotone

WITHIN_LIMIT = 0.98
"""Largest share of the top speed to ask for: beyond it the speed hardly depends on the volts."""


@dataclass(frozen=True, slots=True)
class AxisSide(Measured):
    """One direction of an axis; its speeds are in m/s (forward) or rad/s (turn), all positive."""

    dead_band: float = measured(0.0945, "V", "from neutral to where it starts to move", low=0.0, high=5.0)
    gain: float = measured(1.3, "speed/V", "slope at the edge of the dead band", low=1e-3, high=1e3)
    curve: float = measured(0.0, "speed/V^2", "half the change of slope per volt", low=-1e3, high=1e3)
    limit: float = measured(1.4, "speed", "greatest speed", low=1e-3, high=100.0)

    def __post_init__(self) -> None:
        Measured.__post_init__(self)
        if self.gain * self.gain + 4.0 * self.curve * self.limit <= 0.0:
            raise NotMonotone(
                f"the speed curve with gain = {self.gain:g} and curve = {self.curve:g} turns back before it reaches "
                f"limit = {self.limit:g}: sweep this side of the axis again"
            )

    def speed(self, beyond_neutral: float) -> float:
        """Return the speed at a distance [V] from neutral towards this side."""
        s = beyond_neutral - self.dead_band
        if s <= 0.0:
            return 0.0
        return self.gain * s + self.curve * s * s if s < self.knee else self.limit

    def beyond_neutral(self, speed: float) -> float:
        """Return the volts from neutral that hold a speed, at most `WITHIN_LIMIT` of the limit.

        This form of the quadratic's root is also right for curve = 0.
        """
        a = min(speed, WITHIN_LIMIT * self.limit)
        return self.dead_band + 2.0 * a / (self.gain + math.sqrt(self.gain * self.gain + 4.0 * self.curve * a))

    @property
    def knee(self) -> float:
        """Volts beyond the edge at which the speed reaches the limit."""
        root = math.sqrt(self.gain * self.gain + 4.0 * self.curve * self.limit)
        return 2.0 * self.limit / (self.gain + root)


@dataclass(frozen=True, slots=True)
class AxisModel(Measured):
    """Both directions of one axis, and its response to a step of the stick: a delay, a ramp and a first-order lag.

    `sign` is 1 if volts above neutral drive forward or turn left, and -1 if they do the opposite.
    """

    neutral: float = measured(1.65, "V", "measured on the original stick at rest", low=0.0, high=12.0)
    sign: int = measured(1, "", "1: volts above neutral are forward or left; -1: below", low=-1, high=1)
    above: AxisSide = field(default_factory=AxisSide)
    below: AxisSide = field(default_factory=AxisSide)
    delay_s: float = measured(0.0, "s", "from the stick to the first effect", low=0.0, high=1.0)
    lag_s: float = measured(0.0, "s", "time constant after the ramp", low=0.0, high=2.0)
    ramp: float = measured(100.0, "speed/s", "steepest change of speed when speeding up", low=0.01, high=100.0)

    def __post_init__(self) -> None:
        Measured.__post_init__(self)
        if self.sign == 0:
            raise NotMonotone("sign = 0 gives the axis no direction: it must be 1 or -1")

    def speed(self, volts: float) -> float:
        """Return the steady speed at line volts, [m/s] or [rad/s], forward and left positive."""
        beyond = volts - self.neutral
        return self.sign * (self.above.speed(beyond) if beyond > 0.0 else -self.below.speed(-beyond))

    def volts(self, speed: float) -> float:
        """Return the line volts that hold a speed: neutral for 0, near the dead band's edge for very small speeds."""
        beyond = 0.0 if speed == 0.0 else self.side(speed).beyond_neutral(abs(speed))
        return self.neutral + self.sign * math.copysign(beyond, speed)

    def edge(self, direction: float) -> float:
        """Return the line volts at which the axis begins to move in a direction (its sign)."""
        return self.neutral + self.sign * math.copysign(self.side(direction).dead_band, direction)

    def side(self, direction: float) -> AxisSide:
        """Return the side of neutral for speeds of a sign."""
        return self.above if direction * self.sign > 0.0 else self.below

    def reach(self, speed: float) -> float:
        """Return the highest speed to ask for in the direction of `speed`, positive."""
        return WITHIN_LIMIT * self.side(speed).limit

    @property
    def margin(self) -> float:
        """Drift of the neutral [V] at which the chair would creep: the distance to the nearer edge."""
        return min(self.above.dead_band, self.below.dead_band)
