"""Calibrate a chair's joystick volts and stops, and score the model of a simulated chair against its true plant."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from waychair.calibration.chair_body import CHAIR_A, ChairBody
from waychair.calibration.fits.dac import DEFAULT, DacModel
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
from waychair.errors import CalibrationError
from waychair.simulation.plant.kinematic_chair import KinematicChair
from waychair.simulation.plant.plant import PlantSettings, families, randomised, volts_from_joystick
from waychair.simulation.plant.plant_families import PlantFamily
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.trials.halls import open_hall
from waychair.trials.measured_speeds import EncoderSpeeds, ScanSpeeds
from waychair.trials.simulated_drive import SimulatedDrive, with_few_beams, with_gyro
from waychair.types import FloatArray, Pose2, Twist

_READING_SIGMA = 0.003  # [V] noise of one reading of the stick's lines
_READINGS = 50
_SETTLED_S = 5.0
_REST_S = 4.0
_ROUNDING = 0.05  # [m/s]: a larger error of a wheel is saturation, not rounding


def measured_neutral(plant: PlantSettings, seed: int) -> tuple[float, float]:
    """Return neutral (forward, turn) [V] as a voltmeter reads it on the original stick at rest."""
    readings = np.random.default_rng(seed).normal(volts_from_joystick(plant, 0.0, 0.0), _READING_SIGMA, (_READINGS, 2))
    forward, turn = readings.mean(axis=0).tolist()
    return forward, turn


@dataclass(frozen=True, slots=True)
class ChairUnderTest:
    """A chair to calibrate: its drive, its measured neutral (forward, turn) [V] and its body."""

    drive: LineDrive
    neutral: tuple[float, float]
    body: ChairBody


def chair_in_hall(settings: SimulatorSettings, body: ChairBody, seed: int, *, encoders: bool = True) -> ChairUnderTest:
    """Return a simulated chair in an open hall. Its speeds come from encoders or, without them, from lidar and gyro."""
    if encoders:
        drive = SimulatedDrive(Simulator(open_hall(), body, with_few_beams(settings), seed), EncoderSpeeds(body))
    else:
        drive = SimulatedDrive(Simulator(open_hall(24.0), body, with_gyro(settings), seed), ScanSpeeds(body))
    return ChairUnderTest(drive, measured_neutral(settings.plant, seed), body)


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


@dataclass(frozen=True, slots=True)
class InverseError:
    """Errors of a chair's settled speeds against the commands: greatest and rms [m/s, rad/s].

    `commands` counts the commands within the model's reach, `beyond` the others, which are left out.
    """

    max_v: float
    max_omega: float
    rms_v: float
    rms_omega: float
    commands: int
    beyond: int


def command_grid() -> FloatArray:
    """Return commands (N, 2) [m/s, rad/s]: slow to brisk, forward and reverse, with turns to both sides."""
    v = [-0.8, -0.5, -0.25, -0.1, -0.05, 0.0, 0.05, 0.1, 0.25, 0.5, 0.8, 1.1]
    omega = [-1.2, -0.8, -0.4, -0.15, 0.0, 0.15, 0.4, 0.8, 1.2]
    return np.array([(a, b) for a in v for b in omega])


def inverse_error(
    model: DacModel,
    plant: PlantSettings,
    body: ChairBody,
    commands: FloatArray | None = None,
    within: DacModel | None = None,
) -> InverseError:
    """Return the errors of a chair without ripple and slip that is commanded through the inverse of `model`.

    `commands` is (N, 2) [m/s, rad/s]. A command counts if `within` (by default `model`) reaches it: its own counts
    give the commanded wheel speeds up to rounding.
    """
    commands = command_grid() if commands is None else commands
    quiet = dataclasses.replace(plant, speed_noise=0.0, slip_noise=0.0)
    missed = []
    for v, omega in commands.tolist():
        command = Twist(v, omega)
        if not _can_hold(within or model, command, body.track):
            continue
        counts = model.counts_from_wheel_speeds(wheel_speeds_from_twist(command, body.track))
        settled = settled_twist(quiet, body, *model.volts_from_counts(*counts))
        missed.append((settled.v - v, settled.omega - omega))
    off = np.abs(np.array(missed).reshape(-1, 2))
    largest = off.max(axis=0, initial=0.0)
    rms = np.sqrt((off**2).mean(axis=0)) if len(off) else np.zeros(2)
    return InverseError(
        max_v=float(largest[0]),
        max_omega=float(largest[1]),
        rms_v=float(rms[0]),
        rms_omega=float(rms[1]),
        commands=len(off),
        beyond=len(commands) - len(off),
    )


def _can_hold(model: DacModel, command: Twist, track: float) -> bool:
    speeds = wheel_speeds_from_twist(command, track)
    expected = model.wheel_speeds_from_counts(*model.counts_from_wheel_speeds(speeds))
    return max(abs(expected.left - speeds.left), abs(expected.right - speeds.right)) < _ROUNDING


def settled_twist(plant: PlantSettings, body: ChairBody, forward_volts: float, turn_volts: float) -> Twist:
    """Return the twist of a chair on a level floor after five seconds at these volts."""
    chair = KinematicChair(body, plant, np.random.default_rng(0))
    for _ in range(round(_SETTLED_S * 1000.0 / plant.step_ms)):
        chair.step(forward_volts, turn_volts, _anywhere)
    return chair.twist


def _anywhere(pose: Pose2) -> bool:
    return True


@dataclass(frozen=True, slots=True)
class ChairScore:
    """One chair of the acceptance test: errors of the fitted and of the linear model, on the same commands.

    `inside`: the chair's electronics have the form of the fitted model. If the sweep was refused, `fitted` is None and
    `refused` holds the reason.
    """

    name: str
    inside: bool
    fitted: InverseError | None
    linear: InverseError
    refused: str = ""


def acceptance_chairs(inside: int = 12) -> Mapping[str, PlantSettings]:
    """Return, by name, `inside` chairs of the form of the fitted model and one chair of each other plant family."""
    chairs = {f"chair {seed}": randomised(PlantSettings(), seed) for seed in range(inside)}
    for index, (name, plant) in enumerate(families().items()):
        chairs[name] = randomised(plant, inside + index)
    return MappingProxyType(chairs)


def score_chair(name: str, plant: PlantSettings, seed: int, bits: int, body: ChairBody = CHAIR_A) -> ChairScore:
    """Calibrate one chair with a converter of `bits` bits, command it through the model's inverse, and score it."""
    inside = plant.family == PlantFamily()
    try:
        fit = calibrate_dac(chair_in_hall(SimulatorSettings(plant=plant), body, seed), SweepSettings(bits=bits))
    except CalibrationError as error:
        return ChairScore(name, inside, None, inverse_error(DEFAULT, plant, body), str(error))
    linear = inverse_error(DEFAULT, plant, body, within=fit.model)
    return ChairScore(name, inside, inverse_error(fit.model, plant, body), linear)
