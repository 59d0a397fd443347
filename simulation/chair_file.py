"""Simulated chairs: body, electronics and masses of each; some are built in, others are YAML files.

A file needs only the values that differ from chair A; `save_chair` writes all values with their units.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np

from waychair.calibration.chair import BODIES, CHAIR_A, CHAIR_A_MID, ROBOT, ChairBody
from waychair.config import Settings, load, save
from waychair.errors import ConfigError
from waychair.simulation.mujoco_chair import substeps
from waychair.simulation.mujoco_model import MujocoSettings
from waychair.simulation.plant import PlantSettings, Spread, drawn, randomised

_SPREADS = (
    Spread("rider_mass", 0.25, relative=True),
    Spread("rider_from_rear", 0.03),
    Spread("motor_gain", 0.10, relative=True),
    Spread("wheel_damping", 0.30, relative=True),
    Spread("wheel_rolling", 0.30, relative=True),
    Spread("swivel_friction", 0.30, relative=True),
)


@dataclass(frozen=True, slots=True)
class SimulatedChair(Settings):
    """A simulated chair: its body, its drive, and the further figures of the MuJoCo plant."""

    body: ChairBody = field(default_factory=ChairBody)
    plant: PlantSettings = field(default_factory=PlantSettings)
    mujoco: MujocoSettings = field(default_factory=MujocoSettings)

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        substeps(self.plant, self.mujoco)


_LIGHT = MujocoSettings(
    frame_mass=3.0,
    frame_inset=0.02,
    rider_mass=0.001,
    rider_from_rear=0.15,
    rider_z=0.15,
    outline_low=0.03,
    outline_high=0.35,
    wheel_mass=0.2,
    wheel_half_width=0.01,
    wheel_armature=0.001,
    wheel_damping=0.002,
    motor_gain=0.5,
    motor_torque=1.0,
    brake_torque=2.0,
    caster_from_end=0.035,
    caster_inset=0.05,
    caster_radius=0.02,
    caster_half_width=0.005,
    caster_trail=0.01,
    caster_mass=0.05,
    fork_mass=0.05,
    caster_damping=0.0001,
    spring_stiffness=500.0,
    spring_damping=10.0,
    swivel_damping=0.0005,
    swivel_friction=0.001,
    swivel_armature=0.00002,
)
"""A robot of 4 kg without a rider; plausible figures, not measured."""

_PHYSICS = {
    CHAIR_A_MID.chair_id: MujocoSettings(caster_from_end=0.15),  # casters must swing clear of the drive wheels
    ROBOT.chair_id: _LIGHT,
}

CHAIRS: Mapping[str, SimulatedChair] = MappingProxyType(
    {name: SimulatedChair(body, mujoco=_PHYSICS.get(name, MujocoSettings())) for name, body in BODIES.items()}
)
"""The built-in chairs by name."""


def load_chair(name_or_path: str | Path = CHAIR_A.chair_id) -> SimulatedChair:
    """Return the built-in chair of this name, or the chair of a YAML file.

    Raises:
        ConfigError: there is no such chair or file, or the file holds an unknown key or an impossible value.
    """
    path = Path(name_or_path)
    if path.suffix in (".yaml", ".yml"):
        return load(SimulatedChair, path)
    if str(name_or_path) not in CHAIRS:
        raise ConfigError(f"there is no chair '{name_or_path}': take one of {', '.join(CHAIRS)}, or a .yaml file")
    return CHAIRS[str(name_or_path)]


def save_chair(chair: SimulatedChair, path: Path) -> None:
    """Write a whole chair to a YAML file that `load_chair` reads back, each value with its unit and meaning.

    Raises:
        ConfigError: the file's name does not end in .yaml or .yml: `load_chair` would take it for a chair's name.
        OutputError: the file cannot be written.
    """
    if path.suffix not in (".yaml", ".yml"):
        raise ConfigError(f"'{path}' is not a name for a chair's file: use a name that ends in .yaml")
    save(chair, path)


def randomised_chair(chair: SimulatedChair, seed: int) -> SimulatedChair:
    """Return another chair of the same make with another rider; the body, which is measured by tape, stays the same.

    The drive varies as in `plant.randomised`; the rider's mass by +-25 % and position by +-3 cm, motors by +-10 %, drag
    and friction of wheels and pivots by +-30 %, each with a uniform distribution.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
    return dataclasses.replace(chair, plant=randomised(chair.plant, seed), mujoco=drawn(chair.mujoco, _SPREADS, rng))
