"""Stops of a simulated chair, measured on its plant, as `waychair calibrate stop` does on a real chair."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from waychair.calibration.calibration_file import ChairCalibration
from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.dac import DEFAULT, counts_from_wheel_speeds, neutral_counts, volts_from_counts
from waychair.calibration.fits.stopping import (
    MeasuredStop,
    StopSettings,
    StopTable,
    stop_from_motion,
    stop_table,
    stops_to_measure,
)
from waychair.control.speed.kinematics import wheel_speeds_from_twist
from waychair.simulation.plant.kinematic_chair import KinematicChair
from waychair.simulation.plant.plant import PlantSettings
from waychair.types import Twist

_PLAN = StopSettings(slowest=0.2, step=0.2, fastest=1.2, repetitions=1)
_HELD_S = 4.0
_REST_S = 3.0


@lru_cache(maxsize=8)
def simulated_stops(body: ChairBody, plant: PlantSettings | None = None) -> StopTable:
    """Return the stop table of a chair of this body, driven by the default calibration, measured without noise."""
    plan = stops_to_measure(_PLAN, _PLAN.fastest)
    stops = tuple(_stop(body, plant or PlantSettings(), Twist(v, omega)) for v, omega in plan)
    return stop_table(stops, body.circumscribed_radius, _PLAN)


def simulated_calibration(body: ChairBody, stops: StopTable | None = None) -> ChairCalibration:
    """Return the content of a simulated chair's calibration file; the stops are measured unless given."""
    return ChairCalibration(body.chair_id, "", body, stops=stops or simulated_stops(body), simulated=True)


def _stop(body: ChairBody, plant: PlantSettings, twist: Twist) -> MeasuredStop:
    """Measure one stop from a settled speed, with the lines set to neutral."""
    chair = KinematicChair(body, plant, np.random.default_rng(0))
    counts = counts_from_wheel_speeds(DEFAULT, wheel_speeds_from_twist(twist, body.track))
    driven, neutral = volts_from_counts(DEFAULT, *counts), volts_from_counts(DEFAULT, *neutral_counts(DEFAULT))
    step_s = plant.step_ms / 1000.0
    seconds, twists = [], []
    for k in range(1 - round(_HELD_S / step_s), 1 + round(_REST_S / step_s)):
        chair.step(*(driven if k <= 0 else neutral), lambda pose: True)
        seconds.append(k * step_s)
        twists.append((chair.twist.v, chair.twist.omega))
    return stop_from_motion(np.array(seconds), np.array(twists))
