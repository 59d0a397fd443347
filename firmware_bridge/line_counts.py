"""A calibration's counts as volts on the joystick lines, and back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from waychair.calibration.fits.dac import (
    DacModel,
    counts_from_wheel_speeds,
    nearest,
    neutral_counts,
    volts_from_counts,
    wheel_speeds_from_counts,
)
from waychair.errors import CalibrationError
from waychair.firmware_bridge.protocol import HelloReply
from waychair.types import WheelSpeeds

CREEP = 0.05
"""Greatest speed [m/s] at the board's neutral by the calibration; the limit of F21."""


@dataclass(frozen=True, slots=True)
class LineCounts:
    """A calibration with its counts (forward, turn) at rest, and its counts' scale in volts."""

    calibration: DacModel
    rest: tuple[int, int]
    volts_low: float
    volts_per_count: float

    @classmethod
    def of(cls, calibration: DacModel) -> Self:
        """Return the counts of a calibration."""
        low, high = volts_from_counts(calibration, 0, calibration.counts_max)
        return cls(calibration, neutral_counts(calibration), low, (high - low) / calibration.counts_max)

    def counts(self, speeds: WheelSpeeds) -> tuple[int, int]:
        """Return the counts (forward, turn) of wheel speeds [m/s].

        Raises:
            CalibrationError: the calibration gives no valid counts for these speeds.
        """
        counts = counts_from_wheel_speeds(self.calibration, speeds)
        if not all(isinstance(count, int) and 0 <= count <= self.calibration.counts_max for count in counts):
            raise CalibrationError(f"the calibration gave {counts}, which are not counts")
        return counts

    def speeds(self, counts: tuple[int, int]) -> WheelSpeeds:
        """Return the wheel speeds [m/s] of counts (forward, turn)."""
        return wheel_speeds_from_counts(self.calibration, *counts)

    def count(self, volts: float) -> int:
        """Return the nearest count to a line's volts."""
        count = nearest((volts - self.volts_low) / self.volts_per_count)
        return min(max(count, 0), self.calibration.counts_max)

    def volts(self, counts: tuple[int, int], neutral: float | None = None) -> tuple[float, float]:
        """Return the volts of counts; an axis at rest is at `neutral` [V], the board's, unless it is None."""
        volts = volts_from_counts(self.calibration, *counts)
        if neutral is None:
            return volts
        forward, turn = (neutral if counts[axis] == self.rest[axis] else volts[axis] for axis in (0, 1))
        return forward, turn

    def neutral_problem(self, reply: HelloReply) -> str:
        """Return why a board's neutral does not fit the calibration, by which the chair would then move (F22)."""
        volts = reply.reference_mv / 1000.0
        count = self.count(volts)
        speeds = self.speeds((count, count))
        reached = abs(volts - self.volts_low - count * self.volts_per_count) <= self.volts_per_count
        if reached and max(abs(speeds.left), abs(speeds.right)) <= CREEP:
            return ""
        return (
            f"the board rests the lines at {reply.reference_mv / 1000.0:g} V, where this calibration expects motion: "
            "load the calibration of this chair and its joystick family"
        )
