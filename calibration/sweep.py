"""The drive that a calibration is fitted to: levels of the stick, there and back, each held until the chair has settled.

Every level is driven with its opposite right after it, so that the chair ends about where it began: a sweep needs as
much room as its fastest level takes to settle and be measured.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from waychair.calibration.dac import nearest
from waychair.calibration.drive_log import DriveLog
from waychair.calibration.fit_steps import StepResponse, fit_steps
from waychair.calibration.levels import refuse_creeping
from waychair.config import Settings, setting
from waychair.errors import CalibrationError

NEAR_NEUTRAL = 0.03
"""An axis within so many volts of its measured neutral is at rest: every chair's dead band is wider."""


class Sample(NamedTuple):
    """One measurement of how fast the chair goes: ns, m/s, rad/s."""

    stamp_ns: int
    v: float
    omega: float


class Drive(Protocol):
    """A chair, real or simulated, whose lines can be held."""

    @property
    def now_ns(self) -> int:
        """Time, by the clock of the samples' stamps."""

    def hold(self, forward_volts: float, turn_volts: float, seconds: float) -> list[Sample]:
        """Hold the lines at these volts for so long; the speeds that became known meanwhile, by rising stamps.

        A sample may be of an earlier moment than it is known at, even of the hold before.
        """


@dataclass(frozen=True, slots=True)
class SweepSettings(Settings):
    """Which levels are driven, and with which converter."""

    bits: int = setting(12, "", "resolution of the converter", low=8, high=16)
    volts_max: float = setting(3.3, "V", "output at the largest count", low=0.5, high=12.0)
    swing: float = setting(1.2, "V", "farthest from neutral on either axis", low=0.2, high=5.0)
    levels: int = setting(89, "", "levels on each axis, both directions together", low=5, high=1001)
    repetitions: int = setting(3, "", "times that each level is driven", low=1, high=100)
    combined: int = setting(4, "", "levels of each axis that are driven together", low=0, high=20)
    measure_s: float = setting(1.0, "s", "of each hold that is measured", low=0.1, high=10.0)
    rest_s: float = setting(1.6, "s", "at neutral between two holds", low=0.1, high=10.0)


def sweep(
    drive: Drive,
    neutral: tuple[float, float],
    settings: SweepSettings | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> DriveLog:
    """Drives the whole sweep about the measured neutral [V]: steps first, which tell how long each level settles.

    Raises:
        CalibrationError: the converter does not reach around the neutral, the chair creeps there, or it does not answer to
            a step.
    """
    settings = settings or SweepSettings()
    reach = min(settings.swing, *neutral, *(settings.volts_max - volts for volts in neutral))
    if reach < 0.2:
        raise CalibrationError(
            f"neutral = {neutral} V leaves {reach:.2f} V of swing within 0..{settings.volts_max:g} V: the converter "
            "needs a gain stage for this stick"
        )
    recorder = _Recorder(drive, neutral, reach, settings)
    for axis in (0, 1):
        for part in (0.35, 0.7):
            recorder.pair(part * (1 - axis), part * axis, 4.0)
    log = recorder.log()
    refuse_creeping(log, neutral, NEAR_NEUTRAL)
    responses = [fit_steps(log, axis, neutral, NEAR_NEUTRAL) for axis in (0, 1)]
    fastest = np.abs(log.twists).max(axis=0) / 0.6
    plan = list(_levels(settings))
    for done, (forward, turn) in enumerate(plan):
        recorder.pair(forward, turn, _settling_s(responses, fastest.tolist(), forward, turn) + settings.measure_s)
        progress((done + 1) / len(plan))
    return recorder.log()


def _levels(settings: SweepSettings) -> Iterator[tuple[float, float]]:
    """Parts of the swing on both axes; the opposite of each is driven with it.

    Small and large levels and both axes take turns: motors that grow hot or a battery that sinks meanwhile then show as
    noise, and not as a bend of the curve.
    """
    per_side = -(-settings.levels // 2)
    stride = next(k for k in range(max(1, round(0.618 * per_side)), 2 * per_side + 1) if math.gcd(k, per_side) == 1)
    for _ in range(settings.repetitions):
        for index in range(per_side):
            part = (index * stride % per_side + 1) / per_side
            yield part, 0.0
            yield 0.0, part
    parts = [(k + 1) / (settings.combined + 1) for k in range(settings.combined)]
    for forward in parts:
        for turn in parts:
            yield forward, turn
            yield -forward, turn  # begun in reverse, for in a curve the way back is not quite the way there


def _settling_s(responses: list[StepResponse], fastest: list[float], forward: float, turn: float) -> float:
    parts = (abs(forward), abs(turn))
    return max(
        response.settling_s(part * speed) for response, part, speed in zip(responses, parts, fastest, strict=True)
    )


class _Recorder:
    """Keeps what was put on the lines and measured."""

    def __init__(self, drive: Drive, neutral: tuple[float, float], reach: float, settings: SweepSettings) -> None:
        self._drive = drive
        self._neutral = neutral
        self._reach = reach
        self._settings = settings
        self._began: list[tuple[int, int, int]] = []
        self._samples: list[Sample] = []
        self.hold(0.0, 0.0, settings.rest_s)

    def pair(self, forward: float, turn: float, seconds: float) -> None:
        """A level, given in parts of the swing, and its opposite, with a rest after each."""
        for direction in (1.0, -1.0):
            self.hold(direction * forward, direction * turn, max(seconds, 2.0 * self._settings.measure_s))
            self.hold(0.0, 0.0, self._settings.rest_s)

    def hold(self, forward: float, turn: float, seconds: float) -> None:
        """Hold a level, given in parts of the swing."""
        per_count = self._settings.volts_max / (2**self._settings.bits - 1)
        forward_counts, turn_counts = (
            min(max(nearest((neutral + part * self._reach) / per_count), 0), 2**self._settings.bits - 1)
            for neutral, part in zip(self._neutral, (forward, turn), strict=True)
        )
        self._began.append((self._drive.now_ns, forward_counts, turn_counts))
        self._samples += self._drive.hold(
            forward_counts * per_count, turn_counts * per_count, math.ceil(seconds * 10.0) / 10.0
        )

    def log(self) -> DriveLog:
        """All that was recorded so far, each sample with the counts of its own moment."""
        began = np.array(self._began, np.int64)
        stamps = np.array([sample.stamp_ns for sample in self._samples], np.int64)
        held = np.maximum(np.searchsorted(began[:, 0], stamps, side="right") - 1, 0)
        return DriveLog(
            stamps_ns=stamps,
            counts=began[held, 1:],
            twists=np.array([(sample.v, sample.omega) for sample in self._samples], float),
            bits=self._settings.bits,
            volts_max=self._settings.volts_max,
        )
