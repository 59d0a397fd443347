"""Robust fit of `FittedDac` to the log of a sweep; logs that allow no fit are refused.

All parameters of both axes are fitted together to the steady speeds of the holds, with a loss that grows only linearly
for outliers (soft l1). Each side of an axis is parametrised by its slopes at the edge and at the farthest level, both
positive. So it is monotone as far as it was measured, and the top speed is the one reached there. The dead band's edge
starts between the last level at rest and the first moving one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waychair.calibration.fits.axis_model import AxisModel, AxisSide
from waychair.calibration.fits.drive_log import Holds, SweepLog, steady_holds
from waychair.calibration.fits.fit_steps import AXES, StepResponse, fit_steps
from waychair.calibration.fits.fitted_dac import LEAST_LEFT, FittedDac
from waychair.calibration.fits.stick_levels import (
    MOVING,
    SideLevels,
    SweepLevel,
    refuse_creeping,
    sides_of,
    sweep_levels,
)
from waychair.calibration.fits.sweep import MEASURE_S, NEAR_NEUTRAL
from waychair.errors import NotRepeatable, ThinData
from waychair.types import FloatArray

_PER_SIDE = 4  # edge, slope at the edge, slope at the far end, limit
_BRISK = 0.25  # share of the top speed above which a level counts for the drift
_COMPARED = 4  # levels at either end of the sweep
_MOST_DRIFT = 0.10
_COUPLING = slice(4 * _PER_SIDE, 4 * _PER_SIDE + 4)  # v_per_turn, turn_per_v, turn_fade, speed_cut


STEADY = (0.08, 0.20)
"""m/s, rad/s; a larger change within a hold's measured part means that the chair had not settled."""

NOISE = (0.012, 0.025)
"""m/s, rad/s; a speed begins to count as an outlier beyond this residual."""


@dataclass(frozen=True, slots=True)
class LeastData:
    """The least data for a fit: levels on each axis alone, and their mean number of repetitions."""

    levels: int = 45
    repetitions: int = 3


@dataclass(frozen=True, slots=True)
class LevelResidual:
    """One level of one axis alone: volts, number of repetitions, mean speed, and the model's residual."""

    axis: str
    volts: float
    repetitions: int
    speed: float
    residual: float


@dataclass(frozen=True, slots=True)
class DacFit:
    """The fitted model and its quality: each level's residual, rms of all holds (m/s, rad/s), number of holds.

    `unsettled` counts holds left out because the chair was still speeding up when they ended. `outliers` counts holds
    off by more than five times the noise; `rms` leaves them out.
    """

    model: FittedDac
    levels: tuple[LevelResidual, ...]
    rms: tuple[float, float]
    holds: int
    unsettled: int
    outliers: int
    steps: tuple[StepResponse, StepResponse]

    @property
    def margins(self) -> tuple[float, float]:
        """Drift of each axis' neutral [V] at which the chair would creep."""
        return self.model.forward.margin, self.model.turn.margin


def fit_dac(log: SweepLog, neutral: tuple[float, float], track: float, least: LeastData | None = None) -> DacFit:
    """Fit the model of a chair on the floor whose neutral (forward, turn) [V] was measured on the original stick.

    Raises:
        ThinData: too few levels, repetitions, or steps out of rest.
        NotMonotone: more stick gave less speed.
        NotRepeatable: the chair was faster or slower at the beginning or the end of the sweep than in between.
        CalibrationError: the chair moves at its neutral, or an axis does not move at all.
    """
    from scipy.optimize import least_squares

    least = least or LeastData()
    refuse_creeping(log, neutral, NEAR_NEUTRAL)
    holds = steady_holds(log, MEASURE_S, STEADY)
    levels = tuple(sweep_levels(holds, axis, neutral, NEAR_NEUTRAL) for axis in (0, 1))
    for axis, found in enumerate(levels):
        _refuse_thin(axis, found, holds, least)
    sides = [side for axis in (0, 1) for side in sides_of(levels[axis], axis, neutral[axis])]
    start, low, high = _bounds(sides)
    noise = np.array(NOISE)

    def residuals(p: FloatArray) -> FloatArray:
        missed: FloatArray = ((_predicted(p, sides, holds.volts, neutral) - holds.twists) / noise).ravel()
        return missed

    fit = least_squares(residuals, start, bounds=(low, high), x_scale=high - low, loss="soft_l1")
    steps = (fit_steps(log, 0, neutral, NEAR_NEUTRAL), fit_steps(log, 1, neutral, NEAR_NEUTRAL))
    model = _model(p=fit.x, sides=sides, log=log, neutral=neutral, track=track, steps=steps)
    _refuse_drift(model, holds, neutral)
    return _report(model=model, levels=levels, holds=holds, neutral=neutral, noise=noise, steps=steps)


def _refuse_drift(model: FittedDac, holds: Holds, neutral: tuple[float, float]) -> None:
    """Compare the first and the last brisk levels of each axis with the model, which is of the whole sweep.

    Motors that heat up lose power within minutes. Nearly all levels then agree with each other, and their model would
    start a cold chair too fast. The few levels of the cold chair are no basis for a model either.
    """
    expected = np.array([_twist(model, volts) for volts in holds.volts])
    beyond = np.abs(holds.volts - np.asarray(neutral)) > NEAR_NEUTRAL
    for axis in (0, 1):
        brisk = ~beyond[:, 1 - axis] & (np.abs(expected[:, axis]) > _BRISK * np.abs(expected[:, axis]).max())
        ratios = holds.twists[brisk, axis] / expected[brisk, axis]
        first, last = (float(np.median(part)) for part in (ratios[:_COMPARED], ratios[-_COMPARED:]))
        if max(abs(first - 1.0), abs(last - 1.0)) > _MOST_DRIFT:
            raise NotRepeatable(f"the {AXES[axis]} axis {_drift(first, last)}")


def _drift(first: float, last: float) -> str:
    """Return the sentence about speeds that were off by these factors at the beginning and at the end."""
    gained = last / first - 1.0
    if gained < -0.5 * _MOST_DRIFT:
        return (
            f"was {-100 * gained:.0f} % slower at the end of the sweep than at its beginning, because of hot motors or "
            "a sinking battery, so that no single model fits: charge the battery, let the motors cool, and sweep again "
            "with longer rests or less swing"
        )
    if gained > 0.5 * _MOST_DRIFT:
        return (
            f"was {100 * gained:.0f} % faster at the end of the sweep than at its beginning, as if its speed dial or "
            "drive profile had changed meanwhile: set them as they will stay, and sweep again"
        )
    return (
        f"was {100 * abs(first - 1.0):.0f} % {'faster' if first > 1.0 else 'slower'} at both ends of the sweep than in "
        "between: keep to one drive profile and one floor, and sweep again"
    )


def _refuse_thin(axis: int, levels: tuple[SweepLevel, ...], holds: Holds, least: LeastData) -> None:
    if len(levels) < least.levels:
        raise ThinData(
            f"{len(levels)} levels on the {AXES[axis]} axis alone are too few ({holds.unsettled} holds had not "
            f"settled, {holds.short} stretches were too short for one): drive at least {least.levels}"
        )
    driven = sum(level.repetitions for level in levels) / len(levels)
    if driven < least.repetitions - 0.2:  # the steps that a sweep begins with are driven once
        raise ThinData(
            f"each level of the {AXES[axis]} axis was driven {driven:.1f} times on average: drive it at least "
            f"{least.repetitions} times"
        )


def _bounds(sides: list[SideLevels]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return start and bounds of all parameters: four of each side, then the four of the coupling."""
    start, low, high = [], [], []
    for side in sides:
        start += [side.edge, side.gain, side.gain, side.limit]
        # Just beyond its edge an axis is slower than the speed that counts as moving.
        unseen = 1.5 * MOVING[side.axis] / side.gain
        low += [max(side.still - unseen, 1e-3), 0.02 * side.gain, 0.02 * side.gain, 0.5 * side.limit]
        high += [side.moving, 10.0 * side.gain, 10.0 * side.gain, 1.5 * side.limit]
    most_fade, most_cut = (
        (1.0 - 1.1 * LEAST_LEFT) / (1.5 * max(side.limit for side in sides if side.axis == axis)) for axis in (0, 1)
    )
    return (
        np.array([*start, 0.0, 0.0, 0.0, 0.0]),
        np.array([*low, -0.4, -1.5, -most_fade, -most_cut]),
        np.array([*high, 0.4, 1.5, most_fade, most_cut]),
    )


def _predicted(p: FloatArray, sides: list[SideLevels], volts: FloatArray, neutral: tuple[float, float]) -> FloatArray:
    """Return the twists (K, 2) of parameters `p` at volts (K, 2): `FittedDac.twist_from_volts` on arrays."""
    speeds = np.zeros_like(volts)
    for k, side in enumerate(sides):
        edge, near, far, limit = p[_PER_SIDE * k : _PER_SIDE * (k + 1)]
        beyond = side.direction * (volts[:, side.axis] - neutral[side.axis]) - edge
        s = np.maximum(beyond, 0.0)
        amount = np.minimum(near * s + _curve(near, far, side, edge) * s * s, limit)
        speeds[:, side.axis] += side.sign * amount
    v_per_turn, turn_per_v, fade, cut = p[_COUPLING]
    v = speeds[:, 0] * (1.0 - cut * np.abs(speeds[:, 1]))
    omega = speeds[:, 1] * (1.0 - fade * np.abs(speeds[:, 0]))
    return np.stack([v + v_per_turn * omega, omega + turn_per_v * v], axis=1)


def _curve(near: float, far: float, side: SideLevels, edge: float) -> float:
    return (far - near) / (2.0 * (side.farthest - edge))


def _model(
    p: FloatArray,
    sides: list[SideLevels],
    log: SweepLog,
    neutral: tuple[float, float],
    track: float,
    steps: tuple[StepResponse, StepResponse],
) -> FittedDac:
    fitted = []
    for k, side in enumerate(sides):
        edge, near, far, limit = (float(value) for value in p[_PER_SIDE * k : _PER_SIDE * (k + 1)])
        curve, span = _curve(near, far, side, edge), side.farthest - edge
        # Beyond the farthest level nothing is known, so the top speed is the one reached there.
        reached = min(limit, near * span + curve * span * span)
        fitted.append(AxisSide(dead_band=edge, gain=near, curve=curve, limit=reached))
    axes = [
        AxisModel(
            neutral=neutral[axis],
            sign=sides[2 * axis].sign * sides[2 * axis].direction,
            above=fitted[2 * axis],
            below=fitted[2 * axis + 1],
            delay_s=steps[axis].delay_s,
            lag_s=steps[axis].lag_s,
            ramp=min(steps[axis].ramp, 100.0),
        )
        for axis in (0, 1)
    ]
    v_per_turn, turn_per_v, fade, cut = (float(value) for value in p[_COUPLING])
    return FittedDac(
        bits=log.bits,
        volts_max=log.volts_max,
        volts_min=log.volts_min,
        track=track,
        forward=axes[0],
        turn=axes[1],
        v_per_turn=v_per_turn,
        turn_per_v=turn_per_v,
        turn_fade=fade,
        speed_cut=cut,
    )


def _report(
    model: FittedDac,
    levels: tuple[tuple[SweepLevel, ...], ...],
    holds: Holds,
    neutral: tuple[float, float],
    noise: FloatArray,
    steps: tuple[StepResponse, StepResponse],
) -> DacFit:
    expected = np.array([_twist(model, volts) for volts in holds.volts])
    missed = holds.twists - expected
    outlier = (np.abs(missed) > 5.0 * noise).any(axis=1)
    rms = np.sqrt((missed[~outlier] ** 2).mean(axis=0)) if (~outlier).any() else np.full(2, np.inf)
    rows = []
    for axis, found in enumerate(levels):
        for level in found:
            volts = np.array(neutral)
            volts[axis] = level.volts
            rows.append(
                LevelResidual(
                    AXES[axis],
                    level.volts,
                    level.repetitions,
                    level.speed,
                    level.speed - float(_twist(model, volts)[axis]),
                )
            )
    return DacFit(
        model=model,
        levels=tuple(rows),
        rms=(float(rms[0]), float(rms[1])),
        holds=len(holds),
        unsettled=holds.unsettled,
        outliers=int(outlier.sum()),
        steps=steps,
    )


def _twist(model: FittedDac, volts: FloatArray) -> FloatArray:
    twist = model.twist_from_volts(float(volts[0]), float(volts[1]))
    return np.array([twist.v, twist.omega])
