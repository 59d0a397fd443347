"""The recorded drive: a hall with an unmapped obstacle, a person who steps out, and a rider."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from evaluation.runs.replay import Tape, record_tape

from tests.runtime.riding import LIDAR, hall
from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.dac import DEFAULT
from waychair.runtime.chair import Chair, ChairSettings
from waychair.simulation.scene.scene import Block, PersonBehaviour, PersonPlan
from waychair.simulation.sensors.imu import ImuSettings
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.trials.drive import DriveSetup
from waychair.types import Goal, JoystickInput, Pose2

TICKS = 560
_STEPS_OUT = PersonPlan(
    PersonBehaviour.SUDDEN, np.array([[8.0, 4.3], [8.0, 2.6]]), speed=1.0, yields=True, radius=0.25, trigger=2.0
)
_CRATE = Block(Pose2(5.2, 1.9, 0.3), 0.5, 0.6, 0.0, 1.0)


def setup() -> DriveSetup:
    """The hall on the chair's map."""
    return DriveSetup(hall().grid, {}, CHAIR_A, DEFAULT, chair=ChairSettings())


def taped() -> Tape:
    """Drive there, past a crate and a person, and back, until the rider takes the stick."""
    plain = hall((_STEPS_OUT,))
    settings = SimulatorSettings(lidar=replace(LIDAR, beams=180), imu=ImuSettings(rate_hz=100.0))
    settings = replace(settings, plant=replace(settings.plant, step_ms=10))
    simulator = Simulator(replace(plain, blocks=(*plain.blocks, _CRATE)), CHAIR_A, settings, 1)
    acts = {
        10: lambda _, chair: _go(chair, Pose2(10.0, 2.5, 0.0)),
        380: lambda _, chair: _go(chair, Pose2(3.0, 3.2, 3.0)),
        500: lambda simulator, _: _push(simulator, 0.5),
        520: lambda simulator, _: _push(simulator, 0.0),
        540: lambda _, chair: chair.stop(),
    }
    return record_tape(setup(), simulator, acts, TICKS)


def _go(chair: Chair, pose: Pose2) -> None:
    chair.go(Goal(pose, 0.3, 0.3))
    chair.confirm()


def _push(simulator: Simulator, forward: float) -> None:
    simulator.rider = JoystickInput(0, forward, 0.0)
