"""The physical chair: the same controller as the kinematic chair, but its motors move 149 kg on wheels and casters.

Only this module imports MuJoCo, and only when a chair is made.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.errors import ConfigError, MissingExtra, WorldError
from waychair.install_advice import install_command
from waychair.simulation.plan.world import World
from waychair.simulation.plant.motor_controller import MotorController, WheelNoise
from waychair.simulation.plant.mujoco_model import MujocoSettings, mjcf
from waychair.simulation.plant.plant import PlantSettings, ticks_from_angle
from waychair.types import FloatArray, Pose2, Pose3, Twist

SETTLING_S = 0.5
"""Time for the chair to settle on its wheels before the simulation begins."""

TIPPED = math.radians(25.0)
"""Lean [rad] at which a chair has tipped over: five times a ramp of 1:12, and less than a staircase."""


@dataclass(frozen=True, slots=True)
class _Physics:
    """MuJoCo's model and state of a chair in its world, and the places of the chair's parts in their arrays."""

    mujoco: Any
    model: Any
    data: Any
    # Views of MuJoCo's arrays: getting one anew in every step costs more than reading it.
    qpos: Any
    qvel: Any
    control: Any
    torques: Any
    sensed: Any
    outline: int
    joints: list[int]
    axles: list[int]

    @classmethod
    def of(cls, mujoco: Any, xml: str) -> Self:
        """Return the physics of a model in MuJoCo's format."""
        model = mujoco.MjModel.from_xml_string(xml)
        data = mujoco.MjData(model)
        return cls(
            mujoco=mujoco,
            model=model,
            data=data,
            qpos=data.qpos,
            qvel=data.qvel,
            control=data.ctrl,
            torques=data.actuator_force,
            sensed=data.sensordata,
            outline=model.geom("outline").id,
            joints=[int(model.joint(name).qposadr[0]) for name in ("left", "right")],
            axles=[int(model.joint(name).dofadr[0]) for name in ("left", "right")],
        )

    def step(self, count: int) -> FloatArray:
        """Let `count` time steps pass; return the mean (6,) of the IMU's readings over them."""
        felt = np.zeros(6)
        for _ in range(count):
            self.mujoco.mj_step(self.model, self.data)
            felt += self.sensed
        return felt / count

    def limit(self, motor: float, brake: float) -> None:
        """Limit the motors to a torque [N m], and apply the brakes' friction [N m]."""
        self.model.actuator_forcerange[:] = -motor, motor
        self.model.dof_frictionloss[self.axles] = brake

    def rotation(self) -> FloatArray:
        """Return the chair's rotation matrix (3, 3), map from base."""
        flat = np.empty(9)
        self.mujoco.mju_quat2Mat(flat, self.qpos[3:7])
        return flat.reshape(3, 3)

    def touches(self) -> bool:
        """Return whether anything is in contact with the chair's outline."""
        return self.outline in self.data.contact.geom.ravel().tolist()


class MujocoChair:
    """A `Plant` in MuJoCo, integrated at `settings.timestep_ms`; slip, droop and casters come from the physics.

    It does not use the slip noise and the caster swing of `plant`; the scales of wheels and track change the model's
    geometry. The IMU gives the mean over a step, like the filter in front of its converter.
    """

    def __init__(
        self,
        world: World,
        body: ChairBody,
        plant: PlantSettings,
        settings: MujocoSettings,
        rng: np.random.Generator,
        pose: Pose2,
    ) -> None:
        """A chair at rest at `pose` (map_from_base) on the world's floor.

        Raises:
            ConfigError: the plant's step is not a whole number of time steps.
            MissingExtra: MuJoCo is not installed.
            WorldError: the world's pits cannot be cut out of its floor.
        """
        self.upright = True
        self._substeps = substeps(plant, settings)
        self._body = body
        self._plant = plant
        self._settings = settings
        self._controller = MotorController(body.track, plant)
        self._noise = WheelNoise(rng, plant)
        self._physics = _Physics.of(_import_mujoco(), mjcf(world, body, plant, settings, pose))
        self._drive_limits = (-1.0, -1.0)  # torque of the motors and friction of the brakes in force
        self._settle(round(SETTLING_S * 1000.0 / settings.timestep_ms), pose)
        self._felt: FloatArray = self._physics.sensed.copy()

    @property
    def pose3(self) -> Pose3:
        """True map_from_base in 3D; the base's origin is a wheel radius below the axle along the chair's z axis."""
        rotation = self._physics.rotation()
        return Pose3(rotation, self._physics.qpos[:3] - self._body.wheel_radius * rotation[:, 2])

    @property
    def ticks(self) -> tuple[int, int]:
        """Encoder counts (left, right) of the wheels' joints, wrapping as signed 32-bit numbers."""
        left, right = (float(self._physics.qpos[joint]) for joint in self._physics.joints)
        return ticks_from_angle(left, self._body.ticks_per_turn), ticks_from_angle(right, self._body.ticks_per_turn)

    @property
    def specific_force(self) -> FloatArray:
        """Specific force (3,) [m/s^2] at the IMU's mount, axes as base, mean over the last step (REP-145)."""
        return self._felt[:3]

    @property
    def angular_rate(self) -> FloatArray:
        """Angular rate (3,) [rad/s], axes as base, mean over the last step."""
        return self._felt[3:]

    def step(self, forward_volts: float, turn_volts: float, is_free: Callable[[Pose2], bool] | None = None) -> bool:
        """Move by the plant's step at these volts on the joystick lines; return whether the chair touched nothing.

        Turn volts above neutral turn right. The model holds all obstacles, and the floor under a tipped chair, so that
        `is_free` is not used.

        Raises:
            WorldError: the physics became unstable, because the time step is too long for these settings.
        """
        physics = self._physics
        self._command(forward_volts, turn_volts)
        began = physics.data.time
        felt = physics.step(self._substeps)
        if physics.data.time <= began:  # MuJoCo resets itself to the start and time 0 when the state diverges
            raise WorldError(
                f"the physics became unstable at timestep_ms = {self._settings.timestep_ms:g}: choose a smaller one, "
                "or settings nearer to the defaults"
            )
        self._felt = felt
        self._update_pose()
        return not physics.touches()

    def _update_pose(self) -> None:
        """Update pose and twist from the state; MuJoCo's derived arrays such as `xmat` are one step old."""
        x, y, _, qw, qx, qy, qz = self._physics.qpos[:7].tolist()
        vx, vy, vz, _, _, omega = self._physics.qvel[:6].tolist()
        ahead_x, ahead_y, ahead_z = (
            1.0 - 2.0 * (qy * qy + qz * qz),
            2.0 * (qx * qy + qw * qz),
            2.0 * (qx * qz - qw * qy),
        )
        up_x, up_y, up_z = 2.0 * (qx * qz + qw * qy), 2.0 * (qy * qz - qw * qx), 1.0 - 2.0 * (qx * qx + qy * qy)
        radius = self._body.wheel_radius
        self.pose = Pose2(x - radius * up_x, y - radius * up_y, math.atan2(ahead_y, ahead_x))
        self.twist = Twist(ahead_x * vx + ahead_y * vy + ahead_z * vz, omega)
        self.upright = self.upright and up_z > math.cos(TIPPED)

    def _command(self, forward_volts: float, turn_volts: float) -> None:
        """Command motors and brakes with the controller's answer to the volts and the motors' load."""
        physics, torque = self._physics, self._settings.motor_torque
        left, right = physics.torques.tolist()
        load = min(1.0, 0.5 * (abs(left) + abs(right)) / torque)
        wheels = self._controller.step(forward_volts, turn_volts, load)
        left_ripple, right_ripple, _, _ = self._noise.draw()
        per_radius = 1.0 / self._body.wheel_radius
        physics.control[0] = wheels.left * (1.0 + self._plant.speed_noise * left_ripple) * per_radius
        physics.control[1] = wheels.right * (1.0 + self._plant.speed_noise * right_ripple) * per_radius
        limits = torque * self._controller.power, self._settings.brake_torque if self._controller.braked else 0.0
        if limits != self._drive_limits:
            self._drive_limits = limits
            physics.limit(*limits)

    def _settle(self, steps: int, pose: Pose2) -> None:
        """Let the chair settle on its wheels, then move chair and encoders back to their start."""
        physics, data = self._physics, self._physics.data
        physics.mujoco.mj_step(physics.model, data, nstep=steps)
        self._update_pose()
        # Only the heading is set back: the chair keeps the pitch at which it came to rest.
        back = 0.5 * (pose.theta - self.pose.theta)
        c, s = math.cos(back), math.sin(back)
        qw, qx, qy, qz = data.qpos[3:7].tolist()
        data.qpos[3:7] = c * qw - s * qz, c * qx - s * qy, c * qy + s * qx, c * qz + s * qw
        data.qpos[physics.joints] = 0.0
        data.qvel[:] = 0.0
        self._update_pose()
        data.qpos[:2] += pose.x - self.pose.x, pose.y - self.pose.y
        physics.mujoco.mj_forward(physics.model, data)
        self._update_pose()


def substeps(plant: PlantSettings, settings: MujocoSettings) -> int:
    """Return the number of physics time steps in one step of the plant.

    Raises:
        ConfigError: it is not a whole number.
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
            f"the physical chair needs MuJoCo, which is not installed: run `{install_command('sim')}`, or take the "
            "kinematic plant"
        ) from error
    return mujoco
