"""The chair's electronics: from volts on the joystick lines to wheel speeds."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from waychair.simulation.plant.plant import NOISE_S, PlantSettings
from waychair.simulation.plant.plant_families import Heat, ParkingBrake, cut_speed_and_turn, stick_response, voltage
from waychair.types import WheelSpeeds


class MotorController:
    """From joystick volts to wheel speeds, with delay, ramps, lag, parking brake and heating.

    `power` is the power left, as a part of that of cold motors on a full battery; `braked` tells whether the parking
    brake locks the wheels.
    """

    def __init__(self, track: float, settings: PlantSettings) -> None:
        self._track = track
        self._settings = settings
        self._dt = settings.step_ms / 1000.0
        neutral = (settings.neutral_volts, settings.neutral_volts)
        self._delayed_volts = deque([neutral] * round(settings.delay_s / self._dt))
        self._axes = (0.0, 0.0)  # speed [m/s] and wheel speed difference [m/s] after the ramps
        self._wheels = WheelSpeeds()
        self._brake = ParkingBrake(settings.family, self._dt)
        self._heat = Heat(settings.family, self._dt)
        self.braked = self._brake.shut
        self.power = 1.0

    def step(self, forward_volts: float, turn_volts: float, load: float = 0.0) -> WheelSpeeds:
        """Return wheel speeds at the rim [m/s] after one step at these volts; turn volts above neutral turn right.

        `load` in [0, 1] is the motors' torque in the last step, relative to their greatest torque.
        """
        self._delayed_volts.append((forward_volts, turn_volts))
        speed, difference = self._targets(*self._delayed_volts.popleft())
        self.power = voltage(load, self._settings.family) * self._heat.step(load)
        self.braked = self._brake.step(
            speed != 0.0 or difference != 0.0, max(abs(self._wheels.left), abs(self._wheels.right))
        )
        if self.braked:
            self.stall()
            return self._wheels
        self._ramp(speed * self.power, difference * self.power)
        self._lag()
        return self._wheels

    def stall(self) -> None:
        """Stop the wheels; the ramps start again from rest."""
        self._axes = (0.0, 0.0)
        self._wheels = WheelSpeeds()

    def _targets(self, forward_volts: float, turn_volts: float) -> tuple[float, float]:
        """Return speed [m/s] and wheel speed difference [m/s] that the stick commands with a full battery."""
        s, family = self._settings, self._settings.family
        forward_span, turn_span = s.swing_volts - s.forward_dead_band, s.swing_volts - s.turn_dead_band
        forward = _beyond_dead_band(forward_volts - s.neutral_volts, s.forward_dead_band, s.swing_volts) / forward_span
        turn = -_beyond_dead_band(turn_volts - s.neutral_volts, s.turn_dead_band, s.swing_volts) / turn_span
        forward, turn = stick_response(forward, family.stick_curve), stick_response(turn, family.stick_curve)
        forward, turn = cut_speed_and_turn(forward, turn, family)
        return s.forward_gain * forward_span * forward * family.speed, s.turn_gain * turn_span * turn * family.speed

    def _ramp(self, speed: float, difference: float) -> None:
        s, step = self._settings, self._dt * self._settings.family.profile_ramp
        turn_step = s.turn_acceleration * self._track * step
        self._axes = (
            _ramped(self._axes[0], speed, s.acceleration * step, s.deceleration * step),
            _ramped(self._axes[1], difference, turn_step, turn_step),
        )

    def _lag(self) -> None:
        s = self._settings
        speed, half = self._axes[0], 0.5 * self._axes[1]
        left = speed * (1.0 + s.forward_skew) - half * (1.0 + s.turn_skew)
        right = speed * (1.0 - s.forward_skew) + half * (1.0 - s.turn_skew)
        part = 1.0 - math.exp(-self._dt / s.lag_s)
        wheels = self._wheels
        self._wheels = WheelSpeeds(
            wheels.left + part * (left - wheels.left), wheels.right + part * (right - wheels.right)
        )


class WheelNoise:
    """Motor ripple and slip of the two wheels: four independent first-order Gauss-Markov sequences of unit variance."""

    def __init__(self, rng: np.random.Generator, settings: PlantSettings) -> None:
        self._rng = rng
        self._keep = math.exp(-settings.step_ms / 1000.0 / NOISE_S)
        self._fresh = math.sqrt(1.0 - self._keep * self._keep)
        self._values = (0.0, 0.0, 0.0, 0.0)
        self._stock: list[list[float]] = []

    def draw(self) -> tuple[float, float, float, float]:
        """Return the values of the next step: ripple left and right, slip left and right."""
        if not self._stock:
            self._stock = (self._fresh * self._rng.standard_normal((1024, 4))).tolist()
        a, b, c, d = self._values
        p, q, r, s = self._stock.pop()
        keep = self._keep
        self._values = (keep * a + p, keep * b + q, keep * c + r, keep * d + s)
        return self._values


def _beyond_dead_band(volts: float, dead_band: float, swing: float) -> float:
    """Return the volts beyond the dead band, saturated at the swing."""
    return math.copysign(max(min(abs(volts), swing) - dead_band, 0.0), volts)


def _ramped(current: float, target: float, up: float, down: float) -> float:
    limit = up if current * target >= 0.0 and abs(target) > abs(current) else down
    return current + min(limit, max(-limit, target - current))
