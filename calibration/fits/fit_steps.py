"""Identification of an axis' step response: delay, ramp and lag from steps out of rest.

The chair's own controller first waits, then ramps up to the speed asked for, and the motors follow that with a
first-order lag. Without the ramp, a large step would look like a slow motor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waychair.calibration.fits.drive_log import SweepLog
from waychair.errors import ThinData
from waychair.types import FloatArray

AXES = ("forward", "turn")

_AT_REST = (0.03, 0.05)  # m/s, rad/s
_LEAST_STEP = (0.10, 0.15)
_LONGEST_S = 4.0


@dataclass(frozen=True, slots=True)
class StepResponse:
    """Delay [s], time constant of the lag [s], ramp [m/s^2] or [rad/s^2], and the rms of the residuals."""

    delay_s: float
    lag_s: float
    ramp: float
    rms: float = 0.0

    def settling_s(self, speed: float) -> float:
        """Return the time [s] from the stick's step until the speed is within 1 %."""
        return self.delay_s + 5.0 * self.lag_s + abs(speed) / self.ramp


def step_response(seconds: FloatArray, final: FloatArray, delay_s: float, lag_s: float, ramp: float) -> FloatArray:
    """Return the speeds (N,) at `seconds` (N,) after a step of the stick from rest to `final` (N,), all positive.

    The ramp r t through a lag T is r (t - T (1 - exp(-t / T))); after the ramp's end the missing speed decays with T.
    """
    since = np.maximum(seconds - delay_s, 0.0)
    end = final / ramp
    on_ramp = np.minimum(since, end)
    reached = ramp * (on_ramp - lag_s * -np.expm1(-on_ramp / lag_s))
    missing = (final - reached) * np.exp(-(since - on_ramp) / lag_s)
    return np.where(since < end, reached, final - missing)


def fit_steps(log: SweepLog, axis: int, neutral: tuple[float, float], near: float) -> StepResponse:
    """Fit the response of one axis (0 forward, 1 turn) to all steps out of rest on it alone.

    An axis within `near` [V] of its neutral is at rest.

    Raises:
        ThinData: there is no such step.
    """
    from scipy.optimize import least_squares

    seconds, speeds, final = _steps(log, axis, neutral, near)

    def residuals(p: FloatArray) -> FloatArray:
        missed: FloatArray = (step_response(seconds, final, p[0], p[1], p[2]) - speeds) / _AT_REST[axis]
        return missed

    fit = least_squares(
        residuals,
        [0.08, 0.15, 1.0 + axis],
        bounds=([0.0, 0.005, 0.05], [1.0, 2.0, 100.0]),
        x_scale=[0.1, 0.1, 1.0],
        loss="soft_l1",
    )
    rms = float(np.sqrt(np.mean(residuals(fit.x) ** 2)) * _AT_REST[axis])
    return StepResponse(float(fit.x[0]), float(fit.x[1]), float(fit.x[2]), rms)


def _steps(
    log: SweepLog, axis: int, neutral: tuple[float, float], near: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return seconds since the step, speeds and final speeds (N,), positive, of all samples of all steps."""
    beyond = np.abs(log.volts - np.asarray(neutral)) > near
    changed = np.flatnonzero((np.diff(log.counts, axis=0) != 0).any(axis=1)) + 1
    parts: list[FloatArray] = []
    for first, last in zip(changed.tolist(), [*changed[1:].tolist(), len(log.counts)], strict=True):
        alone = beyond[first, axis] and not beyond[first, 1 - axis] and not beyond[first - 1].any()
        began_ns = 0.5 * float(log.stamps_ns[first] + log.stamps_ns[first - 1])
        seconds = (log.stamps_ns[first:last] - began_ns) * 1e-9
        held = log.twists[first:last, axis]
        final = held[seconds > seconds[-1] - 0.5].mean()
        rested = np.abs(log.twists[max(first - 5, 0) : first].mean(axis=0))
        if not alone or seconds[-1] < 1.0 or abs(final) < _LEAST_STEP[axis] or (rested > _AT_REST).any():
            continue
        kept = seconds < _LONGEST_S
        values = np.stack([seconds, held * np.sign(final), np.full(len(held), abs(final))])
        parts.append(values[:, kept])
    if not parts:
        raise ThinData(
            f"there is no step from rest on the {AXES[axis]} axis alone: let the chair rest at neutral between levels"
        )
    seconds, speeds, finals = np.concatenate(parts, axis=1)
    return seconds, speeds, finals
