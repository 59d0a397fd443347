"""The score of a model of the joystick volts: errors of a simulated chair that is commanded through its inverse."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from waychair.calibration.chair_body import CHAIR_A, ChairBody
from waychair.calibration.drives.dac_and_stops import calibrate_dac
from waychair.calibration.fits.dac import DEFAULT, DacModel
from waychair.calibration.fits.sweep import SweepSettings
from waychair.control.speed.kinematics import wheel_speeds_from_twist
from waychair.errors import CalibrationError
from waychair.simulation.plant.kinematic_chair import KinematicChair
from waychair.simulation.plant.plant import PlantSettings, families, randomised
from waychair.simulation.plant.plant_families import PlantFamily
from waychair.simulation.simulator import SimulatorSettings
from waychair.trials.simulated_calibration import chair_in_hall
from waychair.types import FloatArray, Pose2, Twist

_SETTLED_S = 5.0
_ROUNDING = 0.05  # [m/s]: a larger error of a wheel is saturation, not rounding


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
