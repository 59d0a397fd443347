"""A chair in a world, in lockstep: joystick lines in, stamped messages out, the same bytes for the same seed.

The simulator stands where the cable does: it implements the bridge's `Lines`, and time passes only in `advance`. Truth
(pose, twist, contact, clearance) is for scores and reports; what drives the chair must not read it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.config import Settings, setting
from waychair.errors import ConfigError, WorldError
from waychair.simulation.contact import clearance, in_contact, solid_from_grid
from waychair.simulation.lidar import Lidar, LidarSettings
from waychair.simulation.mujoco_chair import MujocoChair, substeps
from waychair.simulation.mujoco_model import MujocoSettings
from waychair.simulation.plant import KinematicChair, Plant, PlantSettings, volts_from_joystick
from waychair.simulation.world import World
from waychair.topics import WHEELS
from waychair.types import JoystickInput, Pose2, Scan, Twist, WheelTicks

SensorMessage: TypeAlias = WheelTicks | Scan

PLANT_MODELS = ("kinematic", "mujoco")
"""Bare wheels that do as they are told, or mass, motors, casters and slip."""

CONTACT_ENDS = 0.02
"""A contact is over once the chair is this far [m] from everything, so that pushing on counts once."""


@dataclass(frozen=True, slots=True)
class SimulatorSettings(Settings):
    """Plant, sensors and their rates; every period must be a whole number of the plant's steps."""

    plant_model: str = setting("kinematic", "", "kinematic or mujoco")
    plant: PlantSettings = field(default_factory=PlantSettings)
    mujoco: MujocoSettings = field(default_factory=MujocoSettings)
    lidar: LidarSettings = field(default_factory=LidarSettings)
    wheels_hz: float = setting(WHEELS.rate_hz, "Hz", "encoder readings per second", low=1.0, high=1000.0)

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.plant_model not in PLANT_MODELS:
            raise ConfigError(f"plant_model = '{self.plant_model}' is unknown: take {' or '.join(PLANT_MODELS)}")
        if self.plant_model == "mujoco":
            substeps(self.plant, self.mujoco)
        for name, rate in (("wheels_hz", self.wheels_hz), ("lidar rate_hz", self.lidar.rate_hz)):
            steps = 1000.0 / (rate * self.plant.step_ms)
            if steps < 1.0 or not math.isclose(steps, round(steps), rel_tol=1e-9):
                raise ConfigError(
                    f"{name} = {rate:g} is impossible: its period must be a whole number of steps of "
                    f"{self.plant.step_ms} ms"
                )


class Simulator:
    """One chair in one world; starts at `world.start`, at rest, at time 0, with the lines released."""

    def __init__(self, world: World, body: ChairBody, settings: SimulatorSettings | None = None, seed: int = 0) -> None:
        """
        Raises:
            WorldError: the chair does not fit at the world's start.
            MissingExtra: the plant is MuJoCo's, which is not installed.
        """
        settings = settings or SimulatorSettings()
        self.world = world
        self.rider = JoystickInput(0)
        self.now_ns = 0
        self.in_contact = False
        self.contacts = 0
        self._body = body
        self._settings = settings
        self._solid = solid_from_grid(world.grid)
        self._lidar = Lidar(settings.lidar, body.base_from_laser, _stream(seed, 1))
        self._lines: tuple[float, float] | None = None
        self._step_ns = settings.plant.step_ms * 1_000_000
        self._wheels_ns = round(1e9 / settings.wheels_hz)
        self._scan_ns = round(1e9 / settings.lidar.rate_hz)
        if not self._is_free(world.start):
            raise WorldError(
                f"chair {body.chair_id} does not fit at the start of '{world.name}', "
                f"({world.start.x:g}, {world.start.y:g}, {world.start.theta:g}): move the start"
            )
        self._chair = _plant(world, body, settings, _stream(seed, 0))

    def drive(self, forward_volts: float, turn_volts: float) -> None:
        """Hold the lines at these volts (turn above neutral is right) until the next call of this or `release`."""
        if not (math.isfinite(forward_volts) and math.isfinite(turn_volts)):
            raise ValueError(f"{forward_volts}, {turn_volts} V cannot be put on the lines: give finite volts")
        self._lines = (forward_volts, turn_volts)

    def release(self) -> None:
        """Let go of the lines: `rider` moves the chair."""
        self._lines = None

    def advance(self, duration_ns: int) -> tuple[SensorMessage, ...]:
        """Let time pass, a whole number of steps; the messages of that time in order, ticks before a scan of one stamp.

        Raises:
            ValueError: the duration is negative or not a multiple of the plant's step.
        """
        if duration_ns < 0 or duration_ns % self._step_ns:
            raise ValueError(f"cannot advance by {duration_ns} ns: give a multiple of {self._step_ns} ns")
        messages: list[SensorMessage] = []
        for _ in range(duration_ns // self._step_ns):
            self._step()
            if self.now_ns % self._wheels_ns == 0:
                messages.append(WheelTicks(self.now_ns, *self._chair.ticks))
            if self.now_ns % self._scan_ns == 0:
                messages.append(self._lidar.scan(self._solid, self._chair.pose, self.now_ns))
        return tuple(messages)

    def truth(self) -> Pose2:
        """True `map_from_base`."""
        return self._chair.pose

    def twist(self) -> Twist:
        """True twist over the ground, base frame."""
        return self._chair.twist

    def clearance(self) -> float:
        """True distance [m] from the outline to the nearest solid cell."""
        return clearance(self._solid, self._body, self._chair.pose)

    def _step(self) -> None:
        volts = self._lines
        if volts is None:
            volts = volts_from_joystick(self._settings.plant, self.rider.forward, self.rider.turn)
        free = self._chair.step(*volts, self._is_free)
        self.now_ns += self._step_ns
        if not free:
            self.contacts += not self.in_contact
            self.in_contact = True
        elif self.in_contact and self.clearance() > CONTACT_ENDS:
            self.in_contact = False

    def _is_free(self, pose: Pose2) -> bool:
        return not in_contact(self._solid, self._body, pose)


def _plant(world: World, body: ChairBody, settings: SimulatorSettings, rng: np.random.Generator) -> Plant:
    if settings.plant_model == "mujoco":
        return MujocoChair(world.grid, body, settings.plant, settings.mujoco, rng, world.start)
    return KinematicChair(body, settings.plant, rng, world.start)


def _stream(seed: int, sensor: int) -> np.random.Generator:
    """Its own random stream for each part, so that changing one leaves the others' bytes alone."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(sensor,)))
