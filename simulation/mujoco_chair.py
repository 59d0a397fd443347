"""The physical chair: the same controller as the kinematic one, but its motors push 149 kg on wheels and casters.

This is the one module that imports MuJoCo, and only when a chair is made.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.errors import ConfigError, MissingExtra, WorldError
from waychair.simulation.mujoco_model import WALL, MujocoSettings, mjcf
from waychair.simulation.plant import MotorController, PlantSettings, WheelNoise, ticks_from_angle
from waychair.types import OccupancyGrid, Pose2, Twist

SETTLING_S = 0.5
"""How long the chair sinks into its wheels' contacts before time begins."""


class MujocoChair:
    """A `Plant` in MuJoCo, integrated at `settings.timestep_ms`; slip, droop and casters come from the physics.

    Of `plant` the slip noise is not used, and a wheel's scale and the track's are those of the model's geometry.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        body: ChairBody,
        plant: PlantSettings,
        settings: MujocoSettings,
        rng: np.random.Generator,
        pose: Pose2,
    ) -> None:
        """A chair at rest at `pose` (map_from_base), with the occupied cells of `grid` for walls.

        Raises:
            ConfigError: the plant's step is not a whole number of time steps.
            MissingExtra: MuJoCo is not installed.
        """
        self._substeps = substeps(plant, settings)
        self._mujoco = _import_mujoco()
        self._body = body
        self._plant = plant
        self._settings = settings
        self._controller = MotorController(body.track, plant)
        self._noise = WheelNoise(rng, plant)
        self._model = self._mujoco.MjModel.from_xml_string(mjcf(grid, body, plant, settings, pose))
        self._data = self._mujoco.MjData(self._model)
        self._is_wall = self._model.geom_conaffinity == WALL
        self._joints = [int(self._model.joint(name).qposadr[0]) for name in ("left", "right")]
        self._settle(round(SETTLING_S * 1000.0 / settings.timestep_ms), pose)

    @property
    def pose(self) -> Pose2:
        """True map_from_base: the middle of the drive axle seen from above."""
        x, y, _, qw, qx, qy, qz = self._data.qpos[:7].tolist()
        return Pose2(x, y, math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz)))

    @property
    def twist(self) -> Twist:
        """True twist over the ground, base frame."""
        vx, vy, _, _, _, omega = self._data.qvel[:6].tolist()
        theta = self.pose.theta
        return Twist(vx * math.cos(theta) + vy * math.sin(theta), omega)

    @property
    def ticks(self) -> tuple[int, int]:
        """Encoder counts (left, right) of the wheels' joints, wrapping as signed 32-bit numbers."""
        left, right = (float(self._data.qpos[joint]) for joint in self._joints)
        return ticks_from_angle(left, self._body.ticks_per_turn), ticks_from_angle(right, self._body.ticks_per_turn)

    def step(self, forward_volts: float, turn_volts: float, is_free: Callable[[Pose2], bool] | None = None) -> bool:
        """Move on by the plant's step at these volts on the stick's lines; whether no wall was touched meanwhile.

        A turn above neutral is right. The walls are in the model: `is_free` is not asked.

        Raises:
            WorldError: the physics became unstable, by settings that stand no such time step.
        """
        wheels = self._controller.step(forward_volts, turn_volts)
        left_ripple, right_ripple, _, _ = self._noise.draw()
        per_radius = 1.0 / self._body.wheel_radius
        self._data.ctrl[0] = wheels.left * (1.0 + self._plant.speed_noise * left_ripple) * per_radius
        self._data.ctrl[1] = wheels.right * (1.0 + self._plant.speed_noise * right_ripple) * per_radius
        began, free = self._data.time, True
        for _ in range(self._substeps):
            self._mujoco.mj_step(self._model, self._data)
            free = free and not self._touches_wall()
        if self._data.time <= began:  # MuJoCo begins anew, at the start and at time 0, when numbers run away
            raise WorldError(
                f"the physics became unstable at timestep_ms = {self._settings.timestep_ms:g}: choose a smaller one, "
                "or settings nearer to the defaults"
            )
        return free

    def _touches_wall(self) -> bool:
        return bool(self._is_wall[self._data.contact.geom].any())

    def _settle(self, steps: int, pose: Pose2) -> None:
        """Let the wheels find their load, then put chair and encoders back to where they started."""
        data = self._data
        self._mujoco.mj_step(self._model, data, nstep=steps)
        # Only the heading is set back: the pitch at which the chair has come to rest must stay.
        back = 0.5 * (pose.theta - self.pose.theta)
        c, s = math.cos(back), math.sin(back)
        qw, qx, qy, qz = data.qpos[3:7].tolist()
        data.qpos[3:7] = c * qw - s * qz, c * qx - s * qy, c * qy + s * qx, c * qz + s * qw
        data.qpos[:2] = pose.x, pose.y
        data.qpos[self._joints] = 0.0
        data.qvel[:] = 0.0
        self._mujoco.mj_forward(self._model, data)


def substeps(plant: PlantSettings, settings: MujocoSettings) -> int:
    """Time steps of the physics in one step of the plant.

    Raises:
        ConfigError: not a whole number.
    """
    steps = plant.step_ms / settings.timestep_ms
    if steps < 1.0 or not math.isclose(steps, round(steps), rel_tol=1e-9):
        raise ConfigError(
            f"timestep_ms = {settings.timestep_ms:g} is impossible: the plant's step of {plant.step_ms} ms must be "
            "a whole number of it"
        )
    return round(steps)


def _import_mujoco() -> Any:
    try:
        import mujoco
    except ImportError as error:
        raise MissingExtra(
            "the physical chair needs MuJoCo, which is not installed: run `pip install waychair[sim]`, or take the "
            "kinematic plant"
        ) from error
    return mujoco
