"""The default model of a chair's joystick lines: both axes with their dead bands, and how they act on each other.

With v_f and w_t the speeds that the two axes ask for by themselves (`AxisModel`),

    w = w_t (1 - turn_fade |v_f|)         a controller turns less at speed
    [v, omega] = [v_f + v_per_turn w, w + turn_per_v v_f]       unlike motors: a curve when driving straight

Both steps are undone exactly: the 2x2 system first, then the fade, whose v_f is known by then.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TypeAlias

from waychair.calibration.axis_model import AxisModel, AxisSide
from waychair.calibration.dac import nearest, refuse_outside, refuse_unless_finite
from waychair.config import Settings, setting
from waychair.errors import NotMonotone
from waychair.types import Twist, WheelSpeeds

LEAST_TURN_LEFT = 0.2
"""Part of the turn that must be left at the greatest speed: a model that leaves less was fitted to something else."""

Sides: TypeAlias = tuple[int, int]
"""Direction (1, -1 or 0: neither) in which the forward and the turn axis are beyond their dead bands."""

_TURN = AxisSide(gain=2.5, limit=2.6)


@dataclass(frozen=True, slots=True)
class FittedDac(Settings):
    """A `DacModel` that was fitted to one chair and one converter."""

    bits: int = setting(12, "", "resolution of the converter", low=8, high=16)
    volts_max: float = setting(3.3, "V", "output at the largest count", low=0.5, high=12.0)
    track: float = setting(0.54, "m", "between the wheels whose speeds are given", low=0.1, high=1.5)
    forward: AxisModel = field(default_factory=AxisModel)
    turn: AxisModel = field(default_factory=lambda: AxisModel(sign=-1, above=_TURN, below=_TURN))
    v_per_turn: float = setting(0.0, "m", "speed that comes with each rad/s of turning", low=-0.5, high=0.5)
    turn_per_v: float = setting(0.0, "rad/m", "turning that comes with each m/s of driving", low=-2.0, high=2.0)
    turn_fade: float = setting(0.0, "s/m", "part of the turn lost per m/s of driving", low=-2.0, high=2.0)

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if abs(1.0 - self.v_per_turn * self.turn_per_v) < LEAST_TURN_LEFT:
            raise NotMonotone("the axes' effects on each other cannot be told apart: sweep both axes again")
        fastest = max(self.forward.above.limit, self.forward.below.limit)
        if 1.0 - self.turn_fade * fastest < LEAST_TURN_LEFT:
            raise NotMonotone(
                f"turn_fade = {self.turn_fade:g} s/m leaves no turn at {fastest:g} m/s: sweep both axes together again"
            )

    @property
    def counts_max(self) -> int:
        """Largest value of the converter."""
        return int(2**self.bits - 1)

    @property
    def volts_per_count(self) -> float:
        """Step of the converter [V]."""
        return self.volts_max / self.counts_max

    def twist_from_volts(self, forward: float, turn: float) -> Twist:
        """Twist [m/s, rad/s] that line volts settle at."""
        v = self.forward.speed(forward)
        omega = self.turn.speed(turn) * (1.0 - self.turn_fade * abs(v))
        return Twist(v + self.v_per_turn * omega, omega + self.turn_per_v * v)

    def axis_speeds(self, twist: Twist) -> tuple[float, float]:
        """What to ask of the axes (m/s, rad/s) for a twist, scaled down together to what both can do.

        The one factor on both keeps v over omega, hence the arc, as it was.
        """
        determinant = 1.0 - self.v_per_turn * self.turn_per_v
        v = (twist.v - self.v_per_turn * twist.omega) / determinant
        omega = (twist.omega - self.turn_per_v * twist.v) / determinant
        # The fade depends on the scaled speed: k |omega| = reach (1 - fade k |v|) is linear in k all the same.
        reach = self.turn.reach(omega)
        scale = min(
            1.0,
            self.forward.reach(v) / max(abs(v), 1e-12),
            reach / max(abs(omega) + reach * self.turn_fade * abs(v), 1e-12),
        )
        return scale * v, scale * omega / (1.0 - self.turn_fade * scale * abs(v))

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
        twist = self.twist_from_volts(forward * self.volts_per_count, turn * self.volts_per_count)
        half = 0.5 * twist.omega * self.track
        return WheelSpeeds(twist.v - half, twist.v + half)

    def twist_from_wheel_speeds(self, speeds: WheelSpeeds) -> Twist:
        """Twist of the base at these wheel speeds [m/s]."""
        return Twist(0.5 * (speeds.left + speeds.right), (speeds.right - speeds.left) / self.track)

    def volts_from_counts(self, forward: int, turn: int) -> tuple[float, float]:
        """Volts for counts; see `DacModel`."""
        refuse_outside(self.counts_max, forward, turn)
        return forward * self.volts_per_count, turn * self.volts_per_count

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
        edge = axis.edge(side) / self.volts_per_count
        return self._within(math.floor(edge) if axis.edge(side) > axis.neutral else math.ceil(edge))

    def _count(self, volts: float) -> int:
        return self._within(nearest(volts / self.volts_per_count))

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
