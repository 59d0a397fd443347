"""The chair's own controller, motors and wheels, kinematically: two joystick voltages in, motion and ticks out.

The controller is modelled as a rider feels it: a dead band about neutral, a gain per axis, ramps, a delay and a
first-order lag, with a left and a right motor that are not quite alike. There is no mass, slope or caster here; the
chair does what its wheels do, but for a little slip. The physical chair (`mujoco_chair`) has the same controller.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.config import Settings, setting
from waychair.types import Pose2, Twist, WheelSpeeds


@dataclass(frozen=True, slots=True)
class PlantSettings(Settings):
    """One chair's drive. The defaults turn the printed equations of Pai et al. (2026) the other way round.

    Inverting their four coefficients at 12.94 mV per count gives the two gains and the two skews below exactly. Ramps,
    lag and the dead band (7 % of 1.35 V) are plausible figures, not measured on a chair: randomise them. The swing is
    the 1.2 V of a common analogue joystick input (Curtiss-Wright SK81935).
    """

    neutral_volts: float = setting(1.65, "V", "both axes at rest", low=0.5, high=10.0)
    swing_volts: float = setting(1.2, "V", "beyond this far from neutral the axes saturate", low=0.1, high=5.0)
    forward_dead_band: float = setting(0.0945, "V", "from neutral to where it starts to drive", low=0.0, high=0.5)
    turn_dead_band: float = setting(0.0945, "V", "from neutral to where it starts to turn", low=0.0, high=0.5)
    forward_gain: float = setting(1.32413, "m/s/V", "speed per volt beyond the dead band", low=0.1, high=5.0)
    turn_gain: float = setting(1.33649, "m/s/V", "wheel speed difference per volt", low=0.1, high=5.0)
    forward_skew: float = setting(0.01428, "", "part by which the left wheel leads when driving", low=-0.2, high=0.2)
    turn_skew: float = setting(0.03359, "", "part by which the left wheel leads when turning", low=-0.2, high=0.2)
    acceleration: float = setting(0.9, "m/s^2", "ramp when speeding up", low=0.05, high=5.0)
    deceleration: float = setting(1.6, "m/s^2", "ramp when slowing down", low=0.05, high=5.0)
    turn_acceleration: float = setting(3.0, "rad/s^2", "ramp of the turn rate", low=0.1, high=20.0)
    lag_s: float = setting(0.14, "s", "time constant of the motors", low=0.001, high=1.0)
    delay_s: float = setting(0.05, "s", "from the stick to the first effect", low=0.0, high=0.5)
    speed_noise: float = setting(0.01, "", "motor ripple, part of the wheel speed (one sigma)", low=0.0, high=0.3)
    slip_noise: float = setting(0.01, "", "slip that the encoders do not see, as above", low=0.0, high=0.3)
    noise_s: float = setting(0.3, "s", "how long ripple and slip persist", low=0.01, high=10.0)
    left_wheel_scale: float = setting(1.0, "", "true over nominal radius, left", low=0.8, high=1.2)
    right_wheel_scale: float = setting(1.0, "", "true over nominal radius, right", low=0.8, high=1.2)
    track_scale: float = setting(1.0, "", "effective over nominal track", low=0.8, high=1.2)
    step_ms: int = setting(10, "ms", "integration step", low=1, high=50)


_SPREADS: tuple[tuple[str, float, bool], ...] = (
    ("neutral_volts", 0.010, False),
    ("forward_dead_band", 0.25, True),
    ("turn_dead_band", 0.25, True),
    ("forward_gain", 0.08, True),
    ("turn_gain", 0.08, True),
    ("forward_skew", 0.03, False),
    ("turn_skew", 0.03, False),
    ("acceleration", 0.20, True),
    ("deceleration", 0.20, True),
    ("turn_acceleration", 0.20, True),
    ("lag_s", 0.30, True),
    ("delay_s", 0.50, True),
    ("left_wheel_scale", 0.01, False),
    ("right_wheel_scale", 0.01, False),
    ("track_scale", 0.02, False),
)
"""Field, half width of its range, and whether that is a part of the nominal value rather than in its own unit."""


def randomised(settings: PlantSettings, seed: int) -> PlantSettings:
    """Another chair of the same make: each figure drawn evenly from its range about `settings`.

    Ranges: neutral +-10 mV, dead bands +-25 %, gains +-8 %, skews +-0.03, ramps +-20 %, lag +-30 %, delay +-50 %, wheel
    radii +-1 %, track +-2 %.
    """
    draws = np.random.default_rng(seed).uniform(-1.0, 1.0, len(_SPREADS))
    drawn = {}
    for (name, half_width, relative), draw in zip(_SPREADS, draws.tolist(), strict=True):
        nominal = getattr(settings, name)
        drawn[name] = nominal + draw * half_width * (nominal if relative else 1.0)
    return dataclasses.replace(settings, **drawn)


def volts_from_twist(settings: PlantSettings, track: float, twist: Twist) -> tuple[float, float]:
    """Stick volts (forward, turn) at which a chair without skew holds the twist; an axis at rest is at neutral."""
    forward = _volts(twist.v / settings.forward_gain, settings.forward_dead_band, settings.swing_volts)
    turn = _volts(-twist.omega * track / settings.turn_gain, settings.turn_dead_band, settings.swing_volts)
    return settings.neutral_volts + forward, settings.neutral_volts + turn


def volts_from_joystick(settings: PlantSettings, forward: float, turn: float) -> tuple[float, float]:
    """Stick volts (forward, turn) of a rider's joystick in [-1, 1], turn positive to the left."""
    return (
        settings.neutral_volts + settings.swing_volts * min(1.0, max(-1.0, forward)),
        settings.neutral_volts - settings.swing_volts * min(1.0, max(-1.0, turn)),
    )


class Plant(Protocol):
    """What a chair is to the simulator: volts in, motion and encoder counts out, one `PlantSettings.step_ms` a step."""

    @property
    def pose(self) -> Pose2:
        """True map_from_base."""

    @property
    def twist(self) -> Twist:
        """True twist over the ground, base frame."""

    @property
    def ticks(self) -> tuple[int, int]:
        """Encoder counts (left, right), wrapping as signed 32-bit numbers."""

    def step(self, forward_volts: float, turn_volts: float, is_free: Callable[[Pose2], bool]) -> bool:
        """Move on by one step at these volts, a turn above neutral being right; whether nothing was touched.

        `is_free` tells where the chair may stand; a plant that has walls of its own need not ask.
        """


class MotorController:
    """The chair's own electronics: stick volts in, the speeds its motors turn the wheels at out.

    Keeps the volts on their way, the axes after the ramps and the wheels after the lag.
    """

    def __init__(self, track: float, settings: PlantSettings) -> None:
        self._track = track
        self._settings = settings
        self._dt = settings.step_ms / 1000.0
        neutral = (settings.neutral_volts, settings.neutral_volts)
        self._on_the_way = deque([neutral] * round(settings.delay_s / self._dt))
        self._axes = (0.0, 0.0)  # speed [m/s] and wheel speed difference [m/s] after the ramps
        self._wheels = WheelSpeeds()

    def step(self, forward_volts: float, turn_volts: float) -> WheelSpeeds:
        """Rim speeds [m/s] after one step at these volts on the stick's lines; a turn above neutral is right."""
        s = self._settings
        self._on_the_way.append((forward_volts, turn_volts))
        forward_volts, turn_volts = self._on_the_way.popleft()
        self._ramp(
            s.forward_gain * _axis(forward_volts - s.neutral_volts, s.forward_dead_band, s.swing_volts),
            -s.turn_gain * _axis(turn_volts - s.neutral_volts, s.turn_dead_band, s.swing_volts),
        )
        self._lag()
        return self._wheels

    def stall(self) -> None:
        """The wheels are held: the ramps begin anew from rest."""
        self._axes = (0.0, 0.0)
        self._wheels = WheelSpeeds()

    def _ramp(self, speed: float, difference: float) -> None:
        s = self._settings
        turn_ramp = s.turn_acceleration * self._track
        self._axes = (
            _ramped(self._axes[0], speed, s.acceleration * self._dt, s.deceleration * self._dt),
            _ramped(self._axes[1], difference, turn_ramp * self._dt, turn_ramp * self._dt),
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


class KinematicChair:
    """True pose in map, true twist, and the angles the drive wheels have turned by."""

    def __init__(
        self, body: ChairBody, settings: PlantSettings, rng: np.random.Generator, pose: Pose2 | None = None
    ) -> None:
        self.pose = pose or Pose2()
        self.twist = Twist()
        self._body = body
        self._settings = settings
        self._dt = settings.step_ms / 1000.0
        self._controller = MotorController(body.track, settings)
        self._angles = (0.0, 0.0)  # [rad]
        self._noise = WheelNoise(rng, settings)

    @property
    def ticks(self) -> tuple[int, int]:
        """Encoder counts (left, right), wrapping as signed 32-bit numbers."""
        per_turn = self._body.ticks_per_turn
        return ticks_from_angle(self._angles[0], per_turn), ticks_from_angle(self._angles[1], per_turn)

    def step(self, forward_volts: float, turn_volts: float, is_free: Callable[[Pose2], bool]) -> bool:
        """Move on by one step at these volts on the stick's lines; whether the way was free.

        Where it was not, the chair stays at its last free pose and its wheels stall. A turn above neutral is right.
        """
        s = self._settings
        wheels = self._controller.step(forward_volts, turn_volts)
        left_ripple, right_ripple, left_slip, right_slip = self._noise.draw()
        left = wheels.left * (1.0 + s.speed_noise * left_ripple)
        right = wheels.right * (1.0 + s.speed_noise * right_ripple)
        left_ground = left * s.left_wheel_scale * (1.0 - s.slip_noise * left_slip)
        right_ground = right * s.right_wheel_scale * (1.0 - s.slip_noise * right_slip)
        twist = Twist(
            0.5 * (left_ground + right_ground), (right_ground - left_ground) / (self._body.track * s.track_scale)
        )
        pose = moved(self.pose, twist, self._dt)
        if not is_free(pose):
            self.twist = Twist()
            self._controller.stall()
            return False
        self.pose, self.twist = pose, twist
        turned = self._dt / self._body.wheel_radius
        self._angles = (self._angles[0] + left * turned, self._angles[1] + right * turned)
        return True


class WheelNoise:
    """Ripple and slip of the two wheels: four independent first-order Gauss-Markov sequences of unit variance."""

    def __init__(self, rng: np.random.Generator, settings: PlantSettings) -> None:
        self._rng = rng
        self._keep = math.exp(-settings.step_ms / 1000.0 / settings.noise_s)
        self._fresh = math.sqrt(1.0 - self._keep * self._keep)
        self._values = (0.0, 0.0, 0.0, 0.0)
        self._stock: list[list[float]] = []

    def draw(self) -> tuple[float, float, float, float]:
        """Values of the next step: ripple left and right, slip left and right."""
        if not self._stock:
            self._stock = (self._fresh * self._rng.standard_normal((1024, 4))).tolist()
        a, b, c, d = self._values
        p, q, r, s = self._stock.pop()
        keep = self._keep
        self._values = (keep * a + p, keep * b + q, keep * c + r, keep * d + s)
        return self._values


def moved(pose: Pose2, twist: Twist, seconds: float) -> Pose2:
    """Pose after a constant twist: the exact arc, not its tangent."""
    turn = twist.omega * seconds
    half = 0.5 * turn
    chord = twist.v * seconds * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    return pose @ Pose2(chord * math.cos(half), chord * math.sin(half), turn)


def ticks_from_angle(angle: float, ticks_per_turn: int) -> int:
    """Encoder count of a wheel that has turned by `angle` [rad], wrapping as a signed 32-bit number."""
    count = math.floor(angle / math.tau * ticks_per_turn)
    return (count + 2**31) % 2**32 - 2**31


def _axis(volts: float, dead_band: float, swing: float) -> float:
    """Volts beyond the dead band, saturated at the swing."""
    return math.copysign(max(min(abs(volts), swing) - dead_band, 0.0), volts)


def _volts(beyond: float, dead_band: float, swing: float) -> float:
    return 0.0 if beyond == 0.0 else math.copysign(min(abs(beyond) + dead_band, swing), beyond)


def _ramped(current: float, target: float, up: float, down: float) -> float:
    limit = up if current * target >= 0.0 and abs(target) > abs(current) else down
    return current + min(limit, max(-limit, target - current))
