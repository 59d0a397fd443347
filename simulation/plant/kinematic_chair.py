"""The kinematic chair: without mass, slopes or casters; it follows its wheels, apart from a little slip."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import in_space
from waychair.simulation.plant.motor_controller import MotorController, WheelNoise
from waychair.simulation.plant.plant import GRAVITY, PlantSettings, ticks_from_angle
from waychair.simulation.plant.plant_families import ROLLING_LOAD, Casters
from waychair.types import FloatArray, Pose2, Pose3, Twist, WheelSpeeds


class KinematicChair:
    """A `Plant` without physics: true pose in map, true twist, and the angles of the drive wheels.

    The IMU's accelerations are differences of the twist from step to step: motor ripple shows as vibration, a wall as
    a jolt.
    """

    def __init__(
        self, body: ChairBody, settings: PlantSettings, rng: np.random.Generator, pose: Pose2 | None = None
    ) -> None:
        """A chair at rest at `pose` (map_from_base)."""
        self.pose = pose or Pose2()
        self.twist = Twist()
        self.specific_force: FloatArray = np.array([0.0, 0.0, GRAVITY])
        self._body = body
        self._settings = settings
        self._dt = settings.step_ms / 1000.0
        self._controller = MotorController(body.track, settings)
        self._casters = Casters(settings.family)
        self._load = 0.0
        self._wheels = WheelSpeeds()
        self._angles = (0.0, 0.0)  # [rad]
        self._noise = WheelNoise(rng, settings)

    @property
    def pose3(self) -> Pose3:
        """True map_from_base on a level floor."""
        return in_space(self.pose)

    @property
    def ticks(self) -> tuple[int, int]:
        """Encoder counts (left, right), wrapping as signed 32-bit numbers."""
        per_turn = self._body.ticks_per_turn
        return ticks_from_angle(self._angles[0], per_turn), ticks_from_angle(self._angles[1], per_turn)

    @property
    def angular_rate(self) -> FloatArray:
        """Angular rate (3,) [rad/s], axes as base."""
        return np.array([0.0, 0.0, self.twist.omega])

    @property
    def upright(self) -> bool:
        """Always true: this chair cannot tip over."""
        return True

    def step(self, forward_volts: float, turn_volts: float, is_free: Callable[[Pose2], bool]) -> bool:
        """Move by one step at these volts on the joystick lines; return whether the new pose was free.

        If it was not, the chair stays at its last free pose and its wheels stall. Turn volts above neutral turn right.
        """
        s = self._settings
        wheels = self._controller.step(forward_volts, turn_volts, self._load)
        self._load, self._wheels = self._load_of(wheels), wheels
        left_ripple, right_ripple, left_slip, right_slip = self._noise.draw()
        push = 0.5 * self._body.track * self._casters.step(self.twist.v, self.twist.omega, self._dt)
        left = wheels.left * (1.0 + s.speed_noise * left_ripple) - push
        right = wheels.right * (1.0 + s.speed_noise * right_ripple) + push
        left_ground = left * s.left_wheel_scale * (1.0 - s.slip_noise * left_slip)
        right_ground = right * s.right_wheel_scale * (1.0 - s.slip_noise * right_slip)
        twist = Twist(
            0.5 * (left_ground + right_ground), (right_ground - left_ground) / (self._body.track * s.track_scale)
        )
        pose = moved(self.pose, twist, self._dt)
        if not is_free(pose):
            self._set_twist(Twist())
            self._controller.stall()
            return False
        self.pose = pose
        self._set_twist(twist)
        turned = self._dt / self._body.wheel_radius
        self._angles = (self._angles[0] + left * turned, self._angles[1] + right * turned)
        return True

    def _set_twist(self, twist: Twist) -> None:
        """Set the twist; the IMU senses its change, the centripetal acceleration and its lever arm from the axle."""
        x, y = self._body.imu_x, self._body.imu_y
        acceleration = (twist.v - self.twist.v) / self._dt
        spin = (twist.omega - self.twist.omega) / self._dt
        v, omega = 0.5 * (twist.v + self.twist.v), 0.5 * (twist.omega + self.twist.omega)
        self.specific_force = np.array(
            [acceleration - spin * y - omega * omega * x, v * omega + spin * x - omega * omega * y, GRAVITY]
        )
        self.twist = twist

    def _load_of(self, wheels: WheelSpeeds) -> float:
        """Return the motors' load in [0, 1] for rolling on the level and accelerating; 1 is full ramp at full speed."""
        s = self._settings
        fastest = s.forward_gain * (s.swing_volts - s.forward_dead_band)
        speed = max(abs(wheels.left), abs(wheels.right)) / fastest
        change = max(abs(wheels.left - self._wheels.left), abs(wheels.right - self._wheels.right)) / self._dt
        return min(1.0, ROLLING_LOAD * speed + (1.0 - ROLLING_LOAD) * change / s.acceleration)


def moved(pose: Pose2, twist: Twist, seconds: float) -> Pose2:
    """Return the pose after a constant twist, by the exact arc."""
    turn = twist.omega * seconds
    half = 0.5 * turn
    chord = twist.v * seconds * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    return pose @ Pose2(chord * math.cos(half), chord * math.sin(half), turn)
