"""The linear model from wheel speeds to converter counts on the joystick's two axes, and back.

It is the model of Pai et al. (2026), Development of an Intelligent Wheelchair System, Eqs (1) and (2), with 8 bits:

    Dac_left  = 28.2122 V_left + 30.1732 V_right
    Dac_right = 57.0194 V_left - 58.6717 V_right        (counts, m/s)

Written in v = (V_left + V_right) / 2 and d = V_right - V_left they are

    Dac_left = 58.385 v + 0.981 d        Dac_right = -1.652 v - 57.846 d

- So they are the *forward* and the *turn* axis of a joystick, not a left and a right wheel; turn is positive to the
right
  (clockwise). The cross terms are 1.7 % and 2.9 %: the motors or the stick's axes differ a little.
- They have no neutral: rest is 0 counts. With counts of 0..255 the equations as printed allow no reverse, no left turn
  and no exactly straight line (they need V_left >= 1.029 V_right). Here they are offsets from a neutral, by default the
  middle of the converter, 127.5 counts = 1.65 V.
- They have no dead band: a real chair does not move until the stick has left its neutral by some counts, so a slow
  command would cause no motion at all. `dead_band_*` adds those counts to every command but rest.

One count is 12.94 mV or 17 mm/s, so counts are rounded to nearest: truncation would bias v by 9 mm/s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from waychair.calibration.measured import Measured, measured
from waychair.errors import CalibrationError, ConfigError
from waychair.types import WheelSpeeds


class DacModel(Protocol):
    """The interface of every model of a chair's joystick lines; axes are in the order forward, turn."""

    @property
    def counts_max(self) -> int:
        """Largest value of the converter."""

    def counts_from_wheel_speeds(self, speeds: WheelSpeeds) -> tuple[int, int]:
        """Return the counts for wheel speeds [m/s], rounded to nearest, always within 0..counts_max.

        Speeds beyond an axis' reach are scaled down together, so that the chair drives the same arc more slowly.

        Raises:
            CalibrationError: a speed is not a finite number.
        """

    def wheel_speeds_from_counts(self, forward: int, turn: int) -> WheelSpeeds:
        """Return the wheel speeds [m/s] that the model expects of counts: zero on an axis within its dead band."""

    def volts_from_counts(self, forward: int, turn: int) -> tuple[float, float]:
        """Return the volts on the lines for counts.

        Raises:
            CalibrationError: a count lies outside 0..counts_max.
        """

    def neutral_counts(self) -> tuple[int, int]:
        """Counts of rest."""


@dataclass(frozen=True, slots=True)
class LinearDac(Measured):
    """Counts of the forward and turn axes as a linear function of the wheel speeds, about a neutral."""

    forward_left: float = measured(28.2122, "counts s/m", "forward axis per left wheel speed", low=-1e4, high=1e4)
    forward_right: float = measured(30.1732, "counts s/m", "forward axis per right wheel speed", low=-1e4, high=1e4)
    turn_left: float = measured(57.0194, "counts s/m", "turn axis per left wheel speed", low=-1e4, high=1e4)
    turn_right: float = measured(-58.6717, "counts s/m", "turn axis per right wheel speed", low=-1e4, high=1e4)
    neutral: float = measured(127.5, "counts", "both axes at rest", low=0.0, high=65535.0)
    dead_band_forward: float = measured(7.3, "counts", "from neutral to where the chair starts to drive", low=0.0)
    dead_band_turn: float = measured(7.3, "counts", "from neutral to where the chair starts to turn", low=0.0)
    swing: float = measured(92.7, "counts", "farthest from neutral on either axis (1.2 V)", low=1.0, high=65535.0)
    counts_max: int = measured(255, "counts", "largest value of the converter (8 bit)", low=1, high=65535)
    volts_max: float = measured(3.3, "V", "output at the largest value", low=0.5, high=12.0)

    def __post_init__(self) -> None:
        Measured.__post_init__(self)
        if abs(self.determinant) < 1e-6:
            raise ConfigError("the four counts-per-speed coefficients cannot be inverted: measure both axes again")
        for name, dead_band in (("forward", self.dead_band_forward), ("turn", self.dead_band_turn)):
            if dead_band >= self.reach:
                raise ConfigError(
                    f"dead_band_{name} = {dead_band} leaves no room: neutral +- swing within 0..{self.counts_max} "
                    f"reaches only {self.reach:g} counts"
                )

    @property
    def determinant(self) -> float:
        """Determinant of the four coefficients [counts^2 s^2/m^2]; negative, since the turn axis is positive right."""
        return self.forward_left * self.turn_right - self.forward_right * self.turn_left

    @property
    def reach(self) -> float:
        """Greatest distance from neutral on either axis [counts]: the swing, limited by the converter's range."""
        return min(self.swing, self.neutral, self.counts_max - self.neutral)

    def counts_from_wheel_speeds(self, speeds: WheelSpeeds) -> tuple[int, int]:
        """Counts for wheel speeds [m/s]; see `DacModel`."""
        forward = self.forward_left * speeds.left + self.forward_right * speeds.right
        turn = self.turn_left * speeds.left + self.turn_right * speeds.right
        refuse_unless_finite(speeds, forward, turn)
        scale = min(
            1.0,
            (self.reach - self.dead_band_forward) / max(abs(forward), 1e-12),
            (self.reach - self.dead_band_turn) / max(abs(turn), 1e-12),
        )
        return (
            nearest(self.neutral + _past_dead_band(scale * forward, self.dead_band_forward)),
            nearest(self.neutral + _past_dead_band(scale * turn, self.dead_band_turn)),
        )

    def wheel_speeds_from_counts(self, forward: int, turn: int) -> WheelSpeeds:
        """Wheel speeds [m/s] for counts; see `DacModel`."""
        f = _within_dead_band(forward - self.neutral, self.dead_band_forward)
        t = _within_dead_band(turn - self.neutral, self.dead_band_turn)
        determinant = self.determinant
        return WheelSpeeds(
            left=(self.turn_right * f - self.forward_right * t) / determinant,
            right=(self.forward_left * t - self.turn_left * f) / determinant,
        )

    def volts_from_counts(self, forward: int, turn: int) -> tuple[float, float]:
        """Volts for counts; see `DacModel`."""
        refuse_outside(self.counts_max, forward, turn)
        return forward * self.volts_max / self.counts_max, turn * self.volts_max / self.counts_max

    def neutral_counts(self) -> tuple[int, int]:
        """Counts of rest."""
        return self.counts_from_wheel_speeds(WheelSpeeds())


DEFAULT = LinearDac()
"""The paper's gains about a neutral, with the dead band and the 1.2 V swing of a common chair controller."""

PAPER = LinearDac(dead_band_forward=0.0, dead_band_turn=0.0, swing=127.5)
"""The paper's equations about a neutral: no dead band, the converter's whole range."""


def counts_from_wheel_speeds(model: DacModel, speeds: WheelSpeeds) -> tuple[int, int]:
    """Return the counts (forward, turn) for wheel speeds [m/s]; see `DacModel`."""
    return model.counts_from_wheel_speeds(speeds)


def wheel_speeds_from_counts(model: DacModel, forward: int, turn: int) -> WheelSpeeds:
    """Return the wheel speeds [m/s] that the model expects of counts; see `DacModel`."""
    return model.wheel_speeds_from_counts(forward, turn)


def volts_from_counts(model: DacModel, forward: int, turn: int) -> tuple[float, float]:
    """Return the volts (forward, turn) on the lines for counts; see `DacModel`."""
    return model.volts_from_counts(forward, turn)


def neutral_counts(model: DacModel) -> tuple[int, int]:
    """Return the counts (forward, turn) of rest."""
    return model.neutral_counts()


def refuse_unless_finite(speeds: WheelSpeeds, *derived: float) -> None:
    """Raise `CalibrationError` if wheel speeds, or numbers derived from them, are not finite."""
    if not all(math.isfinite(value) for value in (speeds.left, speeds.right, *derived)):
        raise CalibrationError(f"wheel speeds {speeds.left}, {speeds.right} m/s have no counts: give finite numbers")


def refuse_outside(counts_max: int, *counts: int) -> None:
    """Raise `CalibrationError` for counts outside a converter's 0..counts_max."""
    for count in counts:
        if not 0 <= count <= counts_max:
            raise CalibrationError(f"{count} counts cannot be converted: they must lie in 0..{counts_max}")


def nearest(value: float) -> int:
    """Return the nearest count, halves rounded up."""
    return math.floor(value + 0.5)


def _past_dead_band(offset: float, dead_band: float) -> float:
    """Return an offset moved beyond the dead band; less than half a count is rest, not worth the jump."""
    return 0.0 if dead_band and abs(offset) < 0.5 else math.copysign(dead_band + abs(offset), offset)


def _within_dead_band(offset: float, dead_band: float) -> float:
    return math.copysign(max(abs(offset) - dead_band, 0.0), offset)
