"""The default model of a chair's joystick lines: both axes with their dead bands, and their coupling.

With v_f and w_t the speeds of the two axes alone (`AxisModel`),

    v = v_f (1 - speed_cut |w_t|)         a controller slows down into a turn
    w = w_t (1 - turn_fade |v_f|)         and turns less at speed
    [v, omega] = [v + v_per_turn w, w + turn_per_v v]       unlike motors: a curve when driving straight

Both steps are inverted exactly: the 2x2 system first, then the two cuts. With a = |v_f| and b = |w_t|, putting b = |w|
/ (1 - turn_fade a) into the first line gives a quadratic in a; its smaller root is a = |v| without cuts. The inverse is
unique as long as 1 - speed_cut b - turn_fade a, the determinant of the two lines' derivatives, stays positive up to
both limits (Gale and Nikaido, 1965). A model must fulfil this.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TypeAlias

from waychair.calibration.fits.axis_model import AxisModel, AxisSide
from waychair.calibration.fits.dac import nearest, refuse_outside, refuse_unless_finite
from waychair.calibration.measured import Measured, measured
from waychair.errors import ConfigError, NotMonotone
from waychair.types import Twist, WheelSpeeds

LEAST_LEFT = 0.2
"""Least remaining share of the turn at top speed, and of the speed at the fastest turn; a model with less was fitted to
wrong data."""

LEAST_TOGETHER = 0.05
"""Least value of 1 - speed_cut |w_t| - turn_fade |v_f| at both limits; at 0 more stick gives no more motion."""

Sides: TypeAlias = tuple[int, int]
"""Directions (1, -1, or 0 for neither) in which the forward and the turn axis are beyond their dead bands."""

_TURN = AxisSide(gain=2.5, limit=2.6)


@dataclass(frozen=True, slots=True)
class FittedDac(Measured):
    """A `DacModel` fitted to one chair and one converter."""

    bits: int = measured(12, "", "resolution of the converter", low=8, high=16)
    volts_max: float = measured(3.3, "V", "output at the largest count", low=0.5, high=12.0)
    volts_min: float = measured(0.0, "V", "output at count 0: above 0 behind a gain stage", low=0.0, high=11.0)
    track: float = measured(0.54, "m", "between the wheels whose speeds are given", low=0.1, high=1.5)
    forward: AxisModel = field(default_factory=AxisModel)
    turn: AxisModel = field(default_factory=lambda: AxisModel(sign=-1, above=_TURN, below=_TURN))
    v_per_turn: float = measured(0.0, "m", "speed that comes with each rad/s of turning", low=-0.5, high=0.5)
    turn_per_v: float = measured(0.0, "rad/m", "turning that comes with each m/s of driving", low=-2.0, high=2.0)
    turn_fade: float = measured(0.0, "s/m", "part of the turn lost per m/s of driving", low=-2.0, high=2.0)
    speed_cut: float = measured(0.0, "s/rad", "part of the speed lost per rad/s of turning", low=-2.0, high=2.0)

    def __post_init__(self) -> None:
        Measured.__post_init__(self)
        if self.volts_min >= self.volts_max:
            raise ConfigError(f"volts_min = {self.volts_min:g} V must lie below volts_max = {self.volts_max:g} V")
        if abs(1.0 - self.v_per_turn * self.turn_per_v) < LEAST_LEFT:
            raise NotMonotone("the axes' effects on each other cannot be separated: sweep both axes again")
        fastest = max(self.forward.above.limit, self.forward.below.limit)
        sharpest = max(self.turn.above.limit, self.turn.below.limit)
        turn_lost, speed_lost = self.turn_fade * fastest, self.speed_cut * sharpest
        if 1.0 - turn_lost < LEAST_LEFT:
            raise NotMonotone(
                f"turn_fade = {self.turn_fade:g} s/m leaves no turn at {fastest:g} m/s: sweep both axes together again"
            )
        if 1.0 - speed_lost < LEAST_LEFT:
            raise NotMonotone(
                f"speed_cut = {self.speed_cut:g} s/rad leaves no speed at {sharpest:g} rad/s: sweep both axes together "
                "again"
            )
        if 1.0 - turn_lost - speed_lost < LEAST_TOGETHER:
            raise NotMonotone(
                f"turn_fade = {self.turn_fade:g} s/m and speed_cut = {self.speed_cut:g} s/rad together leave nothing "
                f"at {fastest:g} m/s and {sharpest:g} rad/s: sweep both axes together again, with less swing"
            )

    @property
    def counts_max(self) -> int:
        """Largest value of the converter."""
        return int(2**self.bits - 1)

    @property
    def volts_per_count(self) -> float:
        """Step of the converter [V]."""
        return (self.volts_max - self.volts_min) / self.counts_max

    def twist_from_volts(self, forward: float, turn: float) -> Twist:
        """Return the steady twist [m/s, rad/s] at line volts."""
        return self.twist_from_axis_speeds(self.forward.speed(forward), self.turn.speed(turn))

    def twist_from_axis_speeds(self, v_f: float, w_t: float) -> Twist:
        """Return the twist [m/s, rad/s] for the speeds of the axes alone."""
        v, omega = v_f * (1.0 - self.speed_cut * abs(w_t)), w_t * (1.0 - self.turn_fade * abs(v_f))
        return Twist(v + self.v_per_turn * omega, omega + self.turn_per_v * v)

    def axis_speeds(self, twist: Twist) -> tuple[float, float]:
        """Return the axes' speeds (m/s, rad/s) for a twist, scaled down together to the axes' reach.

        One factor on both keeps v over omega, and so the arc.
        """
        determinant = 1.0 - self.v_per_turn * self.turn_per_v
        v = (twist.v - self.v_per_turn * twist.omega) / determinant
        omega = (twist.omega - self.turn_per_v * twist.v) / determinant
        fastest, sharpest = self.forward.reach(v), self.turn.reach(omega)
        # With one axis at its reach, the other axis' cut is known, and both lines are linear in the scale.
        speed_kept, turn_kept = 1.0 - self.speed_cut * sharpest, 1.0 - self.turn_fade * fastest
        scale = min(
            1.0,
            fastest / max(abs(v) + fastest * self.speed_cut * abs(omega) / turn_kept, 1e-12),
            sharpest / max(abs(omega) + sharpest * self.turn_fade * abs(v) / speed_kept, 1e-12),
        )
        return self._before_cuts(scale * v, scale * omega)

    def _before_cuts(self, v: float, omega: float) -> tuple[float, float]:
        """Return the axes' speeds (m/s, rad/s) that give these speeds after the cuts."""
        b = 1.0 - self.speed_cut * abs(omega) + self.turn_fade * abs(v)
        root = math.sqrt(max(b * b - 4.0 * self.turn_fade * abs(v), 0.0))
        v_f = 2.0 * v / (b + root)
        return v_f, omega / (1.0 - self.turn_fade * abs(v_f))

    def counts_from_axis_speeds(self, v: float, omega: float, sides: Sides | None = None) -> tuple[int, int]:
        """Return the counts for the axes' speeds, each on a given side of its dead band.

        An axis without a side (0) rests at neutral. An axis with a side (1 or -1, by the sign of its speed) but no
        speed towards it waits at the last count that does not move it. By default the speed's sign gives the side, and
        a speed of less than half a count gives none.
        """
        taken = (self._side(self.forward, v), self._side(self.turn, omega)) if sides is None else sides
        return self._counts(self.forward, v, taken[0]), self._counts(self.turn, omega, taken[1])

    def counts_from_wheel_speeds(self, speeds: WheelSpeeds) -> tuple[int, int]:
        """Return the counts for wheel speeds [m/s]; see `DacModel`."""
        twist = self.twist_from_wheel_speeds(speeds)
        refuse_unless_finite(speeds, twist.v, twist.omega)
        return self.counts_from_axis_speeds(*self.axis_speeds(twist))

    def wheel_speeds_from_counts(self, forward: int, turn: int) -> WheelSpeeds:
        """Wheel speeds [m/s] for counts; see `DacModel`."""
        twist = self.twist_from_volts(self._volts(forward), self._volts(turn))
        half = 0.5 * twist.omega * self.track
        return WheelSpeeds(twist.v - half, twist.v + half)

    def twist_from_wheel_speeds(self, speeds: WheelSpeeds) -> Twist:
        """Return the base's twist [m/s, rad/s] at wheel speeds [m/s]."""
        return Twist(0.5 * (speeds.left + speeds.right), (speeds.right - speeds.left) / self.track)

    def volts_from_counts(self, forward: int, turn: int) -> tuple[float, float]:
        """Volts for counts; see `DacModel`."""
        refuse_outside(self.counts_max, forward, turn)
        return self._volts(forward), self._volts(turn)

    def neutral_counts(self) -> tuple[int, int]:
        """Counts of rest."""
        return self._count(self.forward.neutral), self._count(self.turn.neutral)

    def _side(self, axis: AxisModel, speed: float) -> int:
        if abs(speed) < 0.5 * self.volts_per_count * axis.side(speed).gain:
            return 0
        return 1 if speed > 0.0 else -1

    def _counts(self, axis: AxisModel, speed: float, side: int) -> int:
        if side == 0:
            return self._count(axis.neutral)
        if side * speed > 0.0:
            return self._count(axis.volts(speed))
        edge = (axis.edge(side) - self.volts_min) / self.volts_per_count
        return self._within(math.floor(edge) if axis.edge(side) > axis.neutral else math.ceil(edge))

    def _volts(self, count: int) -> float:
        return self.volts_min + count * self.volts_per_count

    def _count(self, volts: float) -> int:
        return self._within(nearest((volts - self.volts_min) / self.volts_per_count))

    def _within(self, count: int) -> int:
        return min(max(count, 0), self.counts_max)


ENTER_V, ENTER_OMEGA = 0.010, 0.025
"""m/s, rad/s; speed to the other side at which an axis crosses its dead band."""


class DeadBand:
    """A `DacModel` with hysteresis at each axis' dead band.

    At a crawl a heading loop asks for small turns left and right in alternation. Each change of side would take the
    stick through the whole dead band, a delay without any turning. So an axis waits at the present side's edge, where
    it does nothing, until a larger speed to the other side is asked for. Rest on both axes is neutral at once.
    """

    def __init__(self, model: FittedDac) -> None:
        self.model = model
        self._sides: Sides = (0, 0)

    @property
    def counts_max(self) -> int:
        """Largest value of the converter."""
        return self.model.counts_max

    def counts_from_wheel_speeds(self, speeds: WheelSpeeds) -> tuple[int, int]:
        """Return the counts for wheel speeds [m/s], given the sides of the call before; see `DacModel`."""
        model = self.model
        if speeds == WheelSpeeds():
            self._sides = (0, 0)
            return model.neutral_counts()
        twist = model.twist_from_wheel_speeds(speeds)
        refuse_unless_finite(speeds, twist.v, twist.omega)
        v, omega = model.axis_speeds(twist)
        self._sides = _side_after(self._sides[0], v, ENTER_V), _side_after(self._sides[1], omega, ENTER_OMEGA)
        return model.counts_from_axis_speeds(v, omega, self._sides)

    def wheel_speeds_from_counts(self, forward: int, turn: int) -> WheelSpeeds:
        """Wheel speeds [m/s] for counts; see `DacModel`."""
        return self.model.wheel_speeds_from_counts(forward, turn)

    def volts_from_counts(self, forward: int, turn: int) -> tuple[float, float]:
        """Volts for counts; see `DacModel`."""
        return self.model.volts_from_counts(forward, turn)

    def neutral_counts(self) -> tuple[int, int]:
        """Counts of rest."""
        return self.model.neutral_counts()


def _side_after(before: int, speed: float, enter: float) -> int:
    """Return an axis' side after a demand: the present side, unless the speed to the other one reaches `enter`."""
    if before * speed > 0.0 or abs(speed) < enter:
        return before
    return 1 if speed > 0.0 else -1
