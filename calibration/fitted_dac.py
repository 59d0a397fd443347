"""The default model of a chair's joystick lines: both axes with their dead bands, and how they act on each other.

With v_f and w_t the speeds that the two axes ask for by themselves (`AxisModel`),

    v = v_f (1 - speed_cut |w_t|)         a controller slows down into a turn
    w = w_t (1 - turn_fade |v_f|)         and turns less at speed
    [v, omega] = [v + v_per_turn w, w + turn_per_v v]       unlike motors: a curve when driving straight

Both steps are undone exactly: the 2x2 system first, then the two cuts. With a = |v_f| and b = |w_t|, putting
b = |w| / (1 - turn_fade a) into the first line leaves a quadratic in a, whose smaller root is the one that is a = |v|
without cuts. There is one answer as long as 1 - speed_cut b - turn_fade a, the determinant of the two lines'
derivatives, stays positive up to both limits (Gale and Nikaido, 1965), which is what a model must fulfil.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TypeAlias

from waychair.calibration.axis_model import AxisModel, AxisSide
from waychair.calibration.dac import nearest, refuse_outside, refuse_unless_finite
from waychair.config import Settings, setting
from waychair.errors import ConfigError, NotMonotone
from waychair.types import Twist, WheelSpeeds

LEAST_LEFT = 0.2
"""Part of the turn that must be left at the greatest speed, and of the speed at the sharpest turn: a model that leaves
less was fitted to something else."""

LEAST_TOGETHER = 0.05
"""What 1 - speed_cut |w_t| - turn_fade |v_f| must be at least, at both limits: at 0 more stick gives no more motion."""

Sides: TypeAlias = tuple[int, int]
"""Direction (1, -1 or 0: neither) in which the forward and the turn axis are beyond their dead bands."""

_TURN = AxisSide(gain=2.5, limit=2.6)


@dataclass(frozen=True, slots=True)
class FittedDac(Settings):
    """A `DacModel` that was fitted to one chair and one converter."""

    bits: int = setting(12, "", "resolution of the converter", low=8, high=16)
    volts_max: float = setting(3.3, "V", "output at the largest count", low=0.5, high=12.0)
    volts_min: float = setting(0.0, "V", "output at count 0: above 0 behind a gain stage", low=0.0, high=11.0)
    track: float = setting(0.54, "m", "between the wheels whose speeds are given", low=0.1, high=1.5)
    forward: AxisModel = field(default_factory=AxisModel)
    turn: AxisModel = field(default_factory=lambda: AxisModel(sign=-1, above=_TURN, below=_TURN))
    v_per_turn: float = setting(0.0, "m", "speed that comes with each rad/s of turning", low=-0.5, high=0.5)
    turn_per_v: float = setting(0.0, "rad/m", "turning that comes with each m/s of driving", low=-2.0, high=2.0)
    turn_fade: float = setting(0.0, "s/m", "part of the turn lost per m/s of driving", low=-2.0, high=2.0)
    speed_cut: float = setting(0.0, "s/rad", "part of the speed lost per rad/s of turning", low=-2.0, high=2.0)

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.volts_min >= self.volts_max:
            raise ConfigError(f"volts_min = {self.volts_min:g} V must lie below volts_max = {self.volts_max:g} V")
        if abs(1.0 - self.v_per_turn * self.turn_per_v) < LEAST_LEFT:
            raise NotMonotone("the axes' effects on each other cannot be told apart: sweep both axes again")
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
        """Twist [m/s, rad/s] that line volts settle at."""
        return self.twist_from_axis_speeds(self.forward.speed(forward), self.turn.speed(turn))

    def twist_from_axis_speeds(self, v_f: float, w_t: float) -> Twist:
        """Twist [m/s, rad/s] of what the axes ask for by themselves."""
        v, omega = v_f * (1.0 - self.speed_cut * abs(w_t)), w_t * (1.0 - self.turn_fade * abs(v_f))
        return Twist(v + self.v_per_turn * omega, omega + self.turn_per_v * v)

    def axis_speeds(self, twist: Twist) -> tuple[float, float]:
        """What to ask of the axes (m/s, rad/s) for a twist, scaled down together to what both can do.

        The one factor on both keeps v over omega, hence the arc, as it was.
        """
        determinant = 1.0 - self.v_per_turn * self.turn_per_v
        v = (twist.v - self.v_per_turn * twist.omega) / determinant
        omega = (twist.omega - self.turn_per_v * twist.v) / determinant
        fastest, sharpest = self.forward.reach(v), self.turn.reach(omega)
        # With one axis at its reach, the other one's cut is known: then both lines are linear in the scale.
        speed_kept, turn_kept = 1.0 - self.speed_cut * sharpest, 1.0 - self.turn_fade * fastest
        scale = min(
            1.0,
            fastest / max(abs(v) + fastest * self.speed_cut * abs(omega) / turn_kept, 1e-12),
            sharpest / max(abs(omega) + sharpest * self.turn_fade * abs(v) / speed_kept, 1e-12),
        )
        return self._before_cuts(scale * v, scale * omega)

    def _before_cuts(self, v: float, omega: float) -> tuple[float, float]:
        """What the axes must ask for (m/s, rad/s) so that these speeds are left."""
        b = 1.0 - self.speed_cut * abs(omega) + self.turn_fade * abs(v)
        root = math.sqrt(max(b * b - 4.0 * self.turn_fade * abs(v), 0.0))
        v_f = 2.0 * v / (b + root)
        return v_f, omega / (1.0 - self.turn_fade * abs(v_f))

    def counts_from_axis_speeds(self, v: float, omega: float, sides: Sides | None = None) -> tuple[int, int]:
        """Counts for what is asked of the axes, each on its side of its dead band.

        An axis without a side (0) rests at neutral; one that is asked for nothing on its side (1 or -1, by the sign of
        its speed) waits at the last count that does not move it. By default an axis takes the side that it is asked
        for, and none when that is less than half a count's worth.
        """
        taken = (self._side(self.forward, v), self._side(self.turn, omega)) if sides is None else sides
        return self._counts(self.forward, v, taken[0]), self._counts(self.turn, omega, taken[1])

    def counts_from_wheel_speeds(self, speeds: WheelSpeeds) -> tuple[int, int]:
        """Counts for wheel speeds [m/s]; see `DacModel`."""
        twist = self.twist_from_wheel_speeds(speeds)
        refuse_unless_finite(speeds, twist.v, twist.omega)
        return self.counts_from_axis_speeds(*self.axis_speeds(twist))

    def wheel_speeds_from_counts(self, forward: int, turn: int) -> WheelSpeeds:
        """Wheel speeds [m/s] for counts; see `DacModel`."""
        twist = self.twist_from_volts(self._volts(forward), self._volts(turn))
        half = 0.5 * twist.omega * self.track
        return WheelSpeeds(twist.v - half, twist.v + half)

    def twist_from_wheel_speeds(self, speeds: WheelSpeeds) -> Twist:
        """Twist of the base at these wheel speeds [m/s]."""
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


@dataclass(frozen=True, slots=True)
class DeadBandSettings(Settings):
    """What it takes to send an axis across its dead band."""

    enter_v: float = setting(0.010, "m/s", "speed asked for at which the forward axis leaves a side", low=0.0, high=0.2)
    enter_omega: float = setting(0.025, "rad/s", "as above, of the turn axis", low=0.0, high=0.5)


class DeadBand:
    """A `DacModel` that remembers on which side of its dead band each axis is, and does not hop across.

    At a crawl a heading loop asks for a little left, a little right; each change of side would take the stick through
    the whole dead band, a delay without any turning. Here an axis that is on one side waits at that side's edge, where
    it does nothing, until the other side is asked for in earnest. Rest on both axes is neutral at once.
    """

    def __init__(self, model: FittedDac, settings: DeadBandSettings | None = None) -> None:
        self.model = model
        self._settings = settings or DeadBandSettings()
        self._sides: Sides = (0, 0)

    @property
    def counts_max(self) -> int:
        """Largest value of the converter."""
        return self.model.counts_max

    def counts_from_wheel_speeds(self, speeds: WheelSpeeds) -> tuple[int, int]:
        """Counts for wheel speeds [m/s], by the sides of the call before; see `DacModel`."""
        model, s = self.model, self._settings
        if speeds == WheelSpeeds():
            self._sides = (0, 0)
            return model.neutral_counts()
        twist = model.twist_from_wheel_speeds(speeds)
        refuse_unless_finite(speeds, twist.v, twist.omega)
        v, omega = model.axis_speeds(twist)
        self._sides = _side_after(self._sides[0], v, s.enter_v), _side_after(self._sides[1], omega, s.enter_omega)
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
    """Side of an axis after this demand: the one it was on, unless another one is asked for in earnest."""
    if before * speed > 0.0 or abs(speed) < enter:
        return before
    return 1 if speed > 0.0 else -1
