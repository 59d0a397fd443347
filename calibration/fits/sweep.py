"""The sweep that a calibration is fitted to: levels of the stick, each held until the chair has settled.

Every level is followed by its opposite, so that the chair returns to about its start. A sweep needs the distance that
its fastest level takes to settle and be measured.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from waychair.calibration.fits.dac import nearest
from waychair.calibration.fits.drive_log import SweepLog
from waychair.calibration.fits.fit_steps import StepResponse, fit_steps
from waychair.calibration.fits.stick_levels import refuse_creeping
from waychair.config import Settings, setting
from waychair.errors import CalibrationError

NEAR_NEUTRAL = 0.03
"""V; an axis so near to its measured neutral is at rest, because every chair's dead band is wider."""


MEASURE_S = 1.0
"""s; last part of each hold, in which the speed is measured."""


class Sample(NamedTuple):
    """One measurement of the chair's speed: ns, m/s, rad/s."""

    stamp_ns: int
    v: float
    omega: float


class LineDrive(Protocol):
    """The interface to a chair, real or simulated, whose joystick lines can be held."""

    @property
    def now_ns(self) -> int:
        """Time, by the clock of the samples' stamps."""

    def hold(self, forward_volts: float, turn_volts: float, seconds: float) -> list[Sample]:
        """Hold the lines at these volts for `seconds`; return the samples that arrived meanwhile, by rising stamps.

        A late sample may belong to an earlier moment, even to the hold before.
        """


@dataclass(frozen=True, slots=True)
class SweepSettings(Settings):
    """The converter, and the levels to drive."""

    bits: int = setting(
        12, "", "resolution of the digital-to-analogue converter in bits; more: finer speeds", low=8, high=16
    )
    volts_max: float = setting(
        3.3, "V", "converter's output at its largest count; larger: each count is a larger step", low=0.5, high=12.0
    )
    volts_min: float = setting(
        0.0,
        "V",
        "converter's output at count 0, above 0 behind a gain stage; larger: each count is a smaller step",
        low=0.0,
        high=11.0,
    )
    swing: float = setting(
        1.2,
        "V",
        "largest voltage from neutral on either joystick axis; larger: the sweep goes up to higher speeds",
        low=0.2,
        high=5.0,
    )
    levels: int = setting(
        89,
        "",
        "levels of each joystick axis, both directions together; more: a finer model, a longer sweep",
        low=5,
        high=1001,
    )
    repetitions: int = setting(
        3,
        "",
        "number of times that each level of a joystick axis is driven; more: less noise, a longer sweep",
        low=1,
        high=100,
    )
    combined: int = setting(
        4,
        "",
        "levels of each joystick axis driven together with the other axis; more: a longer sweep with more curves",
        low=0,
        high=20,
    )
    rest_s: float = setting(
        1.6,
        "s",
        "rest at neutral between two holds of the joystick lines; larger: cooler motors, a longer sweep",
        low=0.1,
        high=10.0,
    )


def sweep(
    drive: LineDrive,
    neutral: tuple[float, float],
    settings: SweepSettings | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> SweepLog:
    """Drive the whole sweep about the measured neutral [V]; first steps show how long each level takes to settle.

    Raises:
        CalibrationError: the converter's range about the neutral is too small, or the chair creeps at neutral.
        ThinData: the chair does not answer to a step.
    """
    settings = settings or SweepSettings()
    runner = _Runner(drive, neutral, _reach(neutral, settings), settings)
    for axis in (0, 1):
        for part in (0.35, 0.7):
            runner.pair(part * (1 - axis), part * axis, 4.0)
    log = runner.recorder.log()
    refuse_creeping(log, neutral, NEAR_NEUTRAL)
    responses = [fit_steps(log, axis, neutral, NEAR_NEUTRAL) for axis in (0, 1)]
    fastest = np.abs(log.twists).max(axis=0) / 0.6
    plan = list(_levels(settings))
    for done, (forward, turn) in enumerate(plan):
        runner.pair(forward, turn, _settling_s(responses, fastest.tolist(), forward, turn) + MEASURE_S)
        progress((done + 1) / len(plan))
    return runner.recorder.log()


def _reach(neutral: tuple[float, float], settings: SweepSettings) -> float:
    """Return the distance from neutral [V] that the converter reaches on both axes and to both sides."""
    low, high = settings.volts_min, settings.volts_max
    reach = min(settings.swing, *(volts - low for volts in neutral), *(high - volts for volts in neutral))
    if reach < 0.2:
        raise CalibrationError(
            f"neutral = {neutral} V leaves {reach:.2f} V of swing within {low:g}..{high:g} V: the converter needs a "
            "gain stage for this stick"
        )
    return reach


def _levels(settings: SweepSettings) -> Iterator[tuple[float, float]]:
    """Yield the levels as shares of the swing on both axes; each is driven with its opposite.

    Small and large levels and both axes alternate, so that heating motors or a sinking battery show as noise and not as
    a bend of the curve.
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
            yield -forward, turn  # begun in reverse, because in a curve the opposite level does not quite lead back


def _settling_s(responses: list[StepResponse], fastest: list[float], forward: float, turn: float) -> float:
    parts = (abs(forward), abs(turn))
    return max(
        response.settling_s(part * speed) for response, part, speed in zip(responses, parts, fastest, strict=True)
    )


class Recorder:
    """A `LineDrive` that records the volts on another drive's lines and its samples, so that an aborted sweep has a
    log.

    Volts are kept as counts of a converter.
    """

    def __init__(self, drive: LineDrive, bits: int, volts_max: float, volts_min: float = 0.0) -> None:
        self._drive = drive
        self._bits = bits
        self._range = (volts_min, volts_max)
        self._began: list[tuple[int, int, int]] = []
        self._samples: list[Sample] = []

    @property
    def now_ns(self) -> int:
        """Time of the recorded drive."""
        return self._drive.now_ns

    def hold(self, forward_volts: float, turn_volts: float, seconds: float) -> list[Sample]:
        """Hold the lines at these volts; see `LineDrive`."""
        self._began.append((self.now_ns, self._count(forward_volts), self._count(turn_volts)))
        samples = self._drive.hold(forward_volts, turn_volts, seconds)
        self._samples += samples
        return samples

    def log(self) -> SweepLog:
        """Return the log so far, each sample with the counts of its own time."""
        began = np.array(self._began, np.int64).reshape(-1, 3)
        stamps = np.array([sample.stamp_ns for sample in self._samples], np.int64)
        held = np.maximum(np.searchsorted(began[:, 0], stamps, side="right") - 1, 0)
        return SweepLog(
            stamps_ns=stamps,
            counts=began[held, 1:],
            twists=np.array([(sample.v, sample.omega) for sample in self._samples], float).reshape(-1, 2),
            bits=self._bits,
            volts_max=self._range[1],
            volts_min=self._range[0],
        )

    def _count(self, volts: float) -> int:
        low, high = self._range
        most = int(2**self._bits - 1)
        return min(max(nearest((volts - low) / (high - low) * most), 0), most)


class _Runner:
    """Drives levels given as shares of the swing, at counts of the converter."""

    def __init__(self, drive: LineDrive, neutral: tuple[float, float], reach: float, settings: SweepSettings) -> None:
        self.recorder = Recorder(drive, settings.bits, settings.volts_max, settings.volts_min)
        self._neutral = neutral
        self._reach = reach
        self._settings = settings
        self.hold(0.0, 0.0, settings.rest_s)

    def pair(self, forward: float, turn: float, seconds: float) -> None:
        """Drive a level and its opposite, with a rest after each."""
        for direction in (1.0, -1.0):
            self.hold(direction * forward, direction * turn, max(seconds, 2.0 * MEASURE_S))
            self.hold(0.0, 0.0, self._settings.rest_s)

    def hold(self, forward: float, turn: float, seconds: float) -> None:
        """Hold a level for at least `seconds`."""
        low, most = self._settings.volts_min, 2**self._settings.bits - 1
        per_count = (self._settings.volts_max - low) / most
        volts = [
            low + per_count * min(max(nearest((neutral + part * self._reach - low) / per_count), 0), most)
            for neutral, part in zip(self._neutral, (forward, turn), strict=True)
        ]
        self.recorder.hold(volts[0], volts[1], math.ceil(seconds * 10.0) / 10.0)
