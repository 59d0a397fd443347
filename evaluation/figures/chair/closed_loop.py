"""The speed loop's bars: straight drives on 8 bits with unequal motors, margins, detection of a turned dial."""

from __future__ import annotations

import dataclasses
import itertools
import math
from pathlib import Path

import numpy as np

from evaluation.scenes.chair_score import acceptance_chairs
from evaluation.scenes.straight import LoopDrive, drive_straight
from evaluation.speed.loop_margins import TrueAxis, phase_margin, slowest_decay
from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.drives.dac_and_stops import calibrate_dac, calibrate_stops
from waychair.calibration.fits.fitted_dac import FittedDac
from waychair.calibration.fits.stopping import StopSettings, StopTable
from waychair.calibration.fits.sweep import SweepSettings
from waychair.control.speed.axis_response import AxisResponse
from waychair.control.speed.speed_loop import FASTEST_CROSSOVER, PERIOD_S, PHASE_MARGIN, gains, gains_of
from waychair.simulation.plant.plant import PlantSettings
from waychair.simulation.simulator import SimulatorSettings
from waychair.trials.simulated_calibration import chair_in_hall
from waychair.types import FloatArray, Json, Twist

BAR_M = 0.05
SKEW = 0.03
"""Share by which the left motor leads and the right one lags after the calibration."""

SEEDS = 3
BITS = 8
DELAYS = (0.05, 0.10, 0.15, 0.20, 0.25, 0.30)
LAGS = (0.1, 0.2, 0.3, 0.4, 0.5)
GAINS = (0.5, 1.0, 2.0)
DIALS = (0.2, 0.3, 0.4, 0.5, 0.55, 0.65, 0.7, 0.75, 0.85, 0.9, 1.0)

_FEW_STOPS = StopSettings(repetitions=1, step=0.6, fastest=0.8)


def straight(out: Path) -> Json:
    """10 m at 0.8 m/s with the 20 acceptance chairs, calibrated on 8 bits before their motors changed by 3 %."""
    rows: Json = {}
    for index, (name, plant) in enumerate(acceptance_chairs().items()):
        model, stops = _calibrated(plant, index)
        rows[name] = _straight_row(plant, model, stops)
        print(f"straight, {name}: {rows[name]}", flush=True)
    worst = max(rows.values(), key=lambda row: row["lateral_cm"])
    return {
        "passed": all(row["lateral_cm"] <= 100.0 * BAR_M and not row["faults"] for row in rows.values()),
        "bar_cm": 100.0 * BAR_M,
        "drives": len(rows) * 2 * SEEDS,
        "worst_lateral_cm": worst["lateral_cm"],
        "median_lateral_cm": float(np.median([row["lateral_cm"] for row in rows.values()])),
        "least_open_loop_cm": min(row["open_loop_cm"] for row in rows.values()),
        "false_alarms_of_the_watch": sum(row["alarms"] for name, row in rows.items() if name != "thermal_fade"),
        "chairs": rows,
    }


def closed_loop_margins(out: Path) -> Json:
    """Phase margin [deg] and stability over delay, lag and gain, also of a Smith predictor."""
    period = PERIOD_S
    table: Json = {}
    stable = True
    for held, gain in itertools.product((False, True), GAINS):
        margins = []
        for delay, lag in itertools.product(DELAYS, LAGS):
            tuned = gains(delay + period, lag, PHASE_MARGIN, FASTEST_CROSSOVER)
            axis = TrueAxis(gain, delay, lag)
            margins.append(math.degrees(phase_margin(tuned, axis, period, held=held)))
            stable = stable and slowest_decay(tuned, axis, period, held=held) < 1.0
        name = f"gain {gain:g}, {'with' if held else 'without'} heading hold"
        table[name] = {"least_deg": round(min(margins), 1), "most_deg": round(max(margins), 1)}
    cautious = gains_of(AxisResponse())
    unidentified = max(
        slowest_decay(cautious, TrueAxis(gain, delay, lag), period, held=held)
        for held, gain, delay, lag in itertools.product((False, True), GAINS, DELAYS, LAGS)
    )
    least = min(row["least_deg"] for name, row in table.items() if name.startswith("gain 1,"))
    return {
        "passed": stable and unidentified < 1.0 and least >= 45.0,
        "stable": stable,
        "least_at_identified_gain_deg": least,
        "least_at_gain_2_deg": min(row["least_deg"] for name, row in table.items() if name.startswith("gain 2,")),
        "largest_pole_without_identification": round(unidentified, 4),
        "margins": table,
        "pi_or_smith": _pi_or_smith(),
    }


def gain_watch(out: Path) -> Json:
    """A speed dial turned after the calibration: distance [m] until the chair slows down, or stops with a fault."""
    plant = next(iter(acceptance_chairs(1).values()))
    model, stops = _calibrated(plant, 0)
    rows: Json = {}
    right = True
    for dial in DIALS:
        turned = dataclasses.replace(plant, family=dataclasses.replace(plant.family, dial=dial))
        drive = LoopDrive(model, CHAIR_A, SimulatorSettings(plant=turned), 0, stops=stops)
        slow_m, stop_m = _weave(drive, 40.0)
        rows[f"{100 * dial:.0f} %"] = {"slow_m": slow_m, "stop_m": stop_m, "why": drive.loop.fault[:45]}
        found = stop_m if dial < 0.6 else slow_m
        right = right and (found is None if dial > 0.8 else found is not None and found <= 3.0)
        right = right and (dial < 0.6 or stop_m is None)
    return {"passed": right, "dials": rows}


def _calibrated(plant: PlantSettings, seed: int) -> tuple[FittedDac, StopTable]:
    """Return a chair's calibration, swept with cold motors, as hot ones are refused."""
    cold = dataclasses.replace(plant, family=dataclasses.replace(plant.family, thermal_fade=0.0))
    chair = chair_in_hall(SimulatorSettings(plant=cold), CHAIR_A, seed)
    model = calibrate_dac(chair, SweepSettings(bits=BITS)).model
    stops, _ = calibrate_stops(chair, model, _FEW_STOPS)
    return model, stops


def _straight_row(plant: PlantSettings, model: FittedDac, stops: StopTable) -> Json:
    """Return the figures of one chair: both asymmetries and all seeds, and a drive on curves without a change."""
    closed, opened = [], []
    for skew, seed in itertools.product((SKEW, -SKEW), range(SEEDS)):
        unlike = SimulatorSettings(plant=dataclasses.replace(plant, forward_skew=plant.forward_skew + skew))
        closed.append(drive_straight(LoopDrive(model, CHAIR_A, unlike, seed, stops=stops)))
        opened.append(drive_straight(LoopDrive(model, CHAIR_A, unlike, seed, stops=stops), closed=False))
    unchanged = LoopDrive(model, CHAIR_A, SimulatorSettings(plant=plant), 100, stops=stops)
    slow_m, stop_m = _weave(unchanged, 60.0)
    return {
        "lateral_cm": round(100.0 * max(abs(drive.left_m) for drive in closed), 2),
        "widest_cm": round(100.0 * max(drive.widest_m for drive in closed), 2),
        "open_loop_cm": round(100.0 * min(abs(drive.left_m) for drive in opened), 1),
        "length_off_cm": round(100.0 * max(abs(drive.ahead_m - 10.0) for drive in closed), 1),
        "speed_rms_mm_s": _worst(1000.0 * np.array([drive.speed_rms for drive in closed])),
        "jerk_rms": _worst(np.array([drive.jerk_rms for drive in closed])),
        "open_loop_jerk_rms": _worst(np.array([drive.jerk_rms for drive in opened])),
        "jerk_max": _worst(np.array([drive.jerk_max for drive in closed])),
        "faults": sorted({drive.fault for drive in closed if drive.fault}),
        "alarms": int(slow_m is not None) + int(stop_m is not None),
        "gains": [round(gain, 3) for gain in unchanged.loop.gains],
    }


def _worst(values: FloatArray) -> float | None:
    return None if np.isnan(values).all() else round(float(np.nanmax(values)), 2)


def _weave(drive: LoopDrive, seconds: float) -> tuple[float | None, float | None]:
    """Return the distances [m] on curves, forward and in reverse, until the speed limit and until the stop."""
    legs = (Twist(0.8, 0.0), Twist(0.5, 0.5), Twist(0.5, -0.5), Twist(0.8, 0.15), Twist(0.0, 0.7), Twist(-0.25, 0.0))
    v = omega = way = 0.0
    slow_m = None
    for k in range(round(seconds / 0.05)):
        leg = legs[k // 60 % len(legs)]
        v += min(0.03, max(-0.03, leg.v - v))
        omega += min(0.05, max(-0.05, leg.omega - omega))
        way += 0.05 * abs(drive.tick(Twist(v, omega)).v)
        if slow_m is None and drive.loop.speed_limit < math.inf:
            slow_m = round(way, 2)
        if drive.loop.fault:
            return slow_m, round(way, 2)
    return slow_m, None


def _pi_or_smith() -> Json:
    """Return the least phase margins [deg] of both at the same integral gain, hence equal speed against asymmetries.

    The Smith predictor is C / (1 + C (P0 - P)) with the same PI controller C; P0 is the model P without its delay. Its
    integral gain is w / (1 + w delay) for a crossover w of the loop without delay.
    """
    s = 1j * np.geomspace(0.01, math.pi / PERIOD_S, 4000)
    cases = {"as identified": (1.0, 1.0, 1.0), "gain 2": (2.0, 1.0, 1.0), "gain 2, delay +50 %": (2.0, 1.5, 1.0),
             "gain 2, lag -50 %": (2.0, 1.0, 0.5)}  # fmt: skip
    found: dict[str, dict[str, list[float]]] = {name: {"pi": [], "smith": []} for name in cases}
    for (name, (gain, more_delay, more_lag)), delay, lag in itertools.product(cases.items(), DELAYS, LAGS):
        whole = delay + PERIOD_S
        crossover = gains(whole, lag, PHASE_MARGIN, FASTEST_CROSSOVER).integral
        chair = gain * np.exp(-(delay * more_delay + PERIOD_S) * s) / (lag * more_lag * s + 1.0)
        pi = crossover * (lag * s + 1.0) / s
        faster = pi / (1.0 - crossover * whole)
        smith = faster / (1.0 + faster * (1.0 - np.exp(-whole * s)) / (lag * s + 1.0))
        for which, loop in (("pi", pi * chair), ("smith", smith * chair)):
            size, phase = np.abs(loop), np.unwrap(np.angle(loop))
            falls = np.flatnonzero((size[:-1] >= 1.0) & (size[1:] < 1.0))
            found[name][which].append(180.0 + math.degrees(float(phase[falls].min())))
    return {name: {which: round(min(values), 1) for which, values in rows.items()} for name, rows in found.items()}
