"""Simulated chairs: body, electronics and masses of each; some are built in, others are YAML files.

A file needs only the values that differ from chair A:

    body: {chair_id: ward 3, width: 0.65}
    plant: {forward_gain: 1.2, family: {dial: 0.6}}
    mujoco: {rider_mass: 90}

The keys and their units are those of `ChairBody`, `PlantSettings`, `PlantFamily` and `MujocoSettings`.
"""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np

from waychair.calibration.chair_body import BODIES, CHAIR_A, CHAIR_A_MID, ROBOT, ChairBody
from waychair.config import with_angles
from waychair.errors import ConfigError
from waychair.simulation.plant.mujoco_chair import substeps
from waychair.simulation.plant.mujoco_model import MujocoSettings
from waychair.simulation.plant.plant import PlantSettings, Spread, drawn, randomised
from waychair.yaml_files import load_yaml

_SPREADS = (
    Spread("rider_mass", 0.25, relative=True),
    Spread("rider_from_rear", 0.03),
    Spread("motor_gain", 0.10, relative=True),
    Spread("wheel_damping", 0.30, relative=True),
    Spread("wheel_rolling", 0.30, relative=True),
    Spread("swivel_friction", 0.30, relative=True),
)


@dataclass(frozen=True, slots=True)
class SimulatedChairData:
    """A simulated chair: its body, its drive, and the further figures of the MuJoCo plant."""

    body: ChairBody = field(default_factory=ChairBody)
    plant: PlantSettings = field(default_factory=PlantSettings)
    mujoco: MujocoSettings = field(default_factory=MujocoSettings)

    def __post_init__(self) -> None:
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

CHAIRS: Mapping[str, SimulatedChairData] = MappingProxyType(
    {name: SimulatedChairData(body, mujoco=_PHYSICS.get(name, MujocoSettings())) for name, body in BODIES.items()}
)
"""The built-in chairs by name."""


def load_chair(name_or_path: str | Path = CHAIR_A.chair_id) -> SimulatedChairData:
    """Return the built-in chair of this name, or the chair of a YAML file.

    Raises:
        ConfigError: there is no such chair or file, or the file holds an unknown key or an impossible value.
    """
    path = Path(name_or_path)
    if path.suffix in (".yaml", ".yml"):
        return _chair_from_file(path)
    if str(name_or_path) not in CHAIRS:
        raise ConfigError(f"there is no chair '{name_or_path}': take one of {', '.join(CHAIRS)}, or a .yaml file")
    return CHAIRS[str(name_or_path)]


def randomised_chair(chair: SimulatedChairData, seed: int) -> SimulatedChairData:
    """Return another chair of the same make with another rider; the body, which is measured by tape, stays the same.

    The drive varies as in `plant.randomised`; the rider's mass by +-25 % and position by +-3 cm, motors by +-10 %, drag
    and friction of wheels and pivots by +-30 %, each with a uniform distribution.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
    return dataclasses.replace(chair, plant=randomised(chair.plant, seed), mujoco=drawn(chair.mujoco, _SPREADS, rng))


def _chair_from_file(path: Path) -> SimulatedChairData:
    values = load_yaml(path, ConfigError)
    values = {} if values is None else values
    _refuse_unknown_keys(SimulatedChairData, values, str(path))
    try:
        return msgspec.convert(with_angles(SimulatedChairData, values, str(path)), SimulatedChairData)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{path}: {error}; correct the value") from error


def _refuse_unknown_keys(kind: Any, values: object, where: str) -> None:
    """Refuse keys that `kind` or a dataclass within it lacks; msgspec would ignore them."""
    if not isinstance(values, Mapping):
        raise ConfigError(f"{where} must hold `key: value` lines, not {values!r}")
    known = {entry.name: entry.default_factory for entry in dataclasses.fields(kind)}
    for key, value in values.items():
        if key not in known:
            near = difflib.get_close_matches(str(key), known, n=1, cutoff=0.0)[0]
            raise ConfigError(f"{where}: unknown key '{key}'; did you mean '{near}'?")
        if dataclasses.is_dataclass(known[key]):
            _refuse_unknown_keys(known[key], value, f"{where}: {key}")
