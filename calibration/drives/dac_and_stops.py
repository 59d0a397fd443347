"""Calibrate a chair's joystick volts and stops, by a drive that holds its lines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.fit_dac import DacFit, LeastData, fit_dac
from waychair.calibration.fits.fit_steps import StepResponse
from waychair.calibration.fits.fitted_dac import FittedDac
from waychair.calibration.fits.stopping import (
    MeasuredStop,
    StopSettings,
    StopTable,
    stop_from_motion,
    stop_table,
    stops_to_measure,
)
from waychair.calibration.fits.sweep import LineDrive, SweepSettings, sweep
from waychair.control.speed.kinematics import wheel_speeds_from_twist
from waychair.types import Twist

_REST_S = 4.0


@dataclass(frozen=True, slots=True)
class ChairUnderTest:
    """A chair to calibrate: its drive, its measured neutral (forward, turn) [V] and its body."""

    drive: LineDrive
    neutral: tuple[float, float]
    body: ChairBody


def calibrate_dac(
    chair: ChairUnderTest,
    plan: SweepSettings | None = None,
    fitting: LeastData | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> DacFit:
    """Sweep a chair's volts and return the model fitted to its speeds.

    Raises:
        CalibrationError: the sweep cannot be fitted; see `fit_dac`.
    """
    log = sweep(chair.drive, chair.neutral, plan, progress)
    return fit_dac(log, chair.neutral, chair.body.track, fitting)


def calibrate_stops(
    chair: ChairUnderTest,
    model: FittedDac,
    settings: StopSettings | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[StopTable, tuple[MeasuredStop, ...]]:
    """Drive a chair by its model, set neutral and measure until it rests; return the worst case and all stops.

    Raises:
        ThinData: see `stop_from_motion` and `stop_table`.
    """
    settings = settings or StopSettings()
    plan = list(stops_to_measure(settings, max(model.forward.reach(1.0), model.forward.reach(-1.0))))
    stops = []
    for done, (v, omega) in enumerate(plan):
        stops.append(_stop(chair, model, Twist(v, omega)))
        progress((done + 1) / len(plan))
    return stop_table(stops, chair.body.circumscribed_radius, settings), tuple(stops)


def _stop(chair: ChairUnderTest, model: FittedDac, twist: Twist) -> MeasuredStop:
    """Measure one stop. A chair that is slower in reverse drives back for longer, so that it does not drift away."""
    counts = model.counts_from_wheel_speeds(wheel_speeds_from_twist(twist, chair.body.track))
    expected = model.twist_from_wheel_speeds(model.wheel_speeds_from_counts(*counts))
    seconds = 1.0 + max(
        StepResponse(axis.delay_s, axis.lag_s, axis.ramp).settling_s(speed)
        for axis, speed in ((model.forward, twist.v), (model.turn, twist.omega))
    )
    seconds *= max(1.0, abs(twist.v) / abs(expected.v) if expected.v else 1.0)
    samples = chair.drive.hold(*model.volts_from_counts(*counts), seconds)
    stopped_ns = chair.drive.now_ns
    samples += chair.drive.hold(*model.volts_from_counts(*model.neutral_counts()), _REST_S)
    since = np.array([(sample.stamp_ns - stopped_ns) * 1e-9 for sample in samples])
    return stop_from_motion(since, np.array([(sample.v, sample.omega) for sample in samples]))
