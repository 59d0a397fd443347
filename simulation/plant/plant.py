"""The plant: the simulated chair from joystick volts to motion, encoder counts and IMU signals.

There are two plants: `kinematic_chair`, whose wheels follow their commands, and `mujoco_chair`, which has mass, casters
and grip. Both have the same electronics (`motor_controller`): a dead band about neutral, a gain per axis, ramps, a
delay and a first-order lag, with slightly unequal motors, and the effects of `plant_families`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Protocol, TypeVar

import numpy as np

from waychair.simulation.plant.figure_limits import Limits, check_limits, limits_of
from waychair.simulation.plant.plant_families import FAMILIES, PlantFamily
from waychair.types import FloatArray, Pose2, Pose3, Twist

Figures = TypeVar("Figures")

GRAVITY = 9.80665
"""Standard gravity [m/s^2]."""

NOISE_S = 0.3
"""Correlation time of motor ripple and slip; plausible, not measured."""


@dataclass(frozen=True, slots=True)
class PlantSettings:
    """One chair's drive; the defaults invert the printed equations of Pai et al. (2026).

    Inverting their four coefficients at 12.94 mV per count gives the two gains and the two skews below exactly. Ramps,
    lag and the dead band (7 % of 1.35 V) are plausible, not measured on a chair: randomise them. The swing is the 1.2 V
    of a common analogue joystick input (Curtiss-Wright SK81935). Two tyres never have equal radii: with a difference
    of 0.1 %, wheel odometry ends about 10 m off after a route of 200 m, as on real chairs.
    """

    neutral_volts: Annotated[float, Limits(0.5, 10.0)] = 1.65  # V; volts of both axes at rest
    swing_volts: Annotated[float, Limits(0.1, 5.0)] = 1.2  # V; largest deviation from neutral; the axes saturate there
    forward_dead_band: Annotated[float, Limits(0.0, 0.5)] = 0.0945  # V; from neutral to the start of driving
    turn_dead_band: Annotated[float, Limits(0.0, 0.5)] = 0.0945  # V; from neutral to the start of turning
    forward_gain: Annotated[float, Limits(0.1, 5.0)] = 1.32413  # m/s/V; speed per volt beyond the dead band
    turn_gain: Annotated[float, Limits(0.1, 5.0)] = 1.33649  # m/s/V; wheel speed difference per volt
    forward_skew: Annotated[float, Limits(-0.2, 0.2)] = 0.01428  # part by which the left wheel leads when driving
    turn_skew: Annotated[float, Limits(-0.2, 0.2)] = 0.03359  # part by which the left wheel leads when turning
    acceleration: Annotated[float, Limits(0.05, 5.0)] = 0.9  # m/s^2; ramp of speeding up
    deceleration: Annotated[float, Limits(0.05, 5.0)] = 1.6  # m/s^2; ramp of slowing down
    turn_acceleration: Annotated[float, Limits(0.1, 20.0)] = 3.0  # rad/s^2; ramp of the turn rate
    lag_s: Annotated[float, Limits(0.001, 1.0)] = 0.14  # s; time constant of the motors
    delay_s: Annotated[float, Limits(0.0, 0.5)] = 0.05  # s; from the stick to the first effect
    speed_noise: Annotated[float, Limits(0.0, 0.3)] = 0.01  # one sigma; motor ripple, part of the speed
    slip_noise: Annotated[float, Limits(0.0, 0.3)] = 0.003  # one sigma; slip unknown to the encoders, as a part
    left_wheel_scale: Annotated[float, Limits(0.8, 1.2)] = 1.0006  # true over nominal radius, left
    right_wheel_scale: Annotated[float, Limits(0.8, 1.2)] = 0.9994  # true over nominal radius, right
    track_scale: Annotated[float, Limits(0.8, 1.2)] = 1.0  # effective over nominal track
    step_ms: Annotated[int, Limits(1, 50)] = 5  # ms; integration step
    family: PlantFamily = field(default_factory=PlantFamily)

    def __post_init__(self) -> None:
        check_limits(self)


@dataclass(frozen=True, slots=True)
class Spread:
    """Half the width of the interval about a figure's value for random draws; a part of the value if `relative`."""

    name: str
    half_width: float
    relative: bool = False


_SPREADS = (
    Spread("neutral_volts", 0.010),
    Spread("forward_dead_band", 0.25, relative=True),
    Spread("turn_dead_band", 0.25, relative=True),
    Spread("forward_gain", 0.08, relative=True),
    Spread("turn_gain", 0.08, relative=True),
    Spread("forward_skew", 0.03),
    Spread("turn_skew", 0.03),
    Spread("acceleration", 0.20, relative=True),
    Spread("deceleration", 0.20, relative=True),
    Spread("turn_acceleration", 0.20, relative=True),
    Spread("lag_s", 0.30, relative=True),
    Spread("delay_s", 0.50, relative=True),
    Spread("track_scale", 0.001),
)

_TYRES = 0.002
"""Largest relative error that both drive wheels' radii share."""

_TYRE_DIFFERENCE = (0.0010, 0.0014)
"""Least and greatest relative difference of the two drive wheels' radii; either may be the larger."""


def drawn(figures: Figures, spreads: tuple[Spread, ...], rng: np.random.Generator) -> Figures:
    """Return a dataclass with each figure of `spreads` drawn uniformly about its value and held within its limits."""
    values: dict[str, float] = {}
    for spread in spreads:
        nominal, (low, high) = getattr(figures, spread.name), limits_of(type(figures))[spread.name]
        width = spread.half_width * (nominal if spread.relative else 1.0)
        values[spread.name] = min(high, max(low, nominal + width * float(rng.uniform(-1.0, 1.0))))
    plain: Any = figures
    changed: Figures = dataclasses.replace(plain, **values)
    return changed


def randomised(settings: PlantSettings, seed: int) -> PlantSettings:
    """Return another chair of the same make: each figure drawn uniformly about `settings`.

    Ranges: neutral +-10 mV, dead bands +-25 %, gains +-8 %, skews +-0.03, ramps +-20 %, lag +-30 %, delay +-50 %, track
    +-0.1 %, both wheel radii +-0.2 %. One wheel is always larger than the other, by 0.10 to 0.14 %.
    """
    rng = np.random.default_rng(seed)
    chair = drawn(settings, _SPREADS, rng)
    mean = 0.5 * (settings.left_wheel_scale + settings.right_wheel_scale) * (1.0 + _TYRES * rng.uniform(-1.0, 1.0))
    half = 0.5 * float(rng.choice([-1.0, 1.0]) * rng.uniform(*_TYRE_DIFFERENCE))
    return dataclasses.replace(
        chair, left_wheel_scale=float(mean * (1.0 + half)), right_wheel_scale=float(mean * (1.0 - half))
    )


def families(settings: PlantSettings | None = None) -> Mapping[str, PlantSettings]:
    """Return eight chairs by name, each `settings` with one more effect that no form of calibration describes."""
    nominal = settings or PlantSettings()
    return {name: dataclasses.replace(nominal, family=family) for name, family in FAMILIES.items()}


def volts_from_twist(settings: PlantSettings, track: float, twist: Twist) -> tuple[float, float]:
    """Return the volts (forward, turn) at which a chair without skew holds the twist; an axis at rest is at neutral."""
    forward = _volts(twist.v / settings.forward_gain, settings.forward_dead_band, settings.swing_volts)
    turn = _volts(-twist.omega * track / settings.turn_gain, settings.turn_dead_band, settings.swing_volts)
    return settings.neutral_volts + forward, settings.neutral_volts + turn


def volts_from_joystick(settings: PlantSettings, forward: float, turn: float) -> tuple[float, float]:
    """Return the volts (forward, turn) of a rider's joystick in [-1, 1], turn positive to the left."""
    return (
        settings.neutral_volts + settings.swing_volts * min(1.0, max(-1.0, forward)),
        settings.neutral_volts - settings.swing_volts * min(1.0, max(-1.0, turn)),
    )


def joystick_from_volts(settings: PlantSettings, forward: float, turn: float) -> tuple[float, float]:
    """Return the joystick (forward, turn) in [-1, 1] that gives these volts; turn positive to the left."""
    forward, turn = ((volts - settings.neutral_volts) / settings.swing_volts for volts in (forward, turn))
    return forward, -turn


class Plant(Protocol):
    """The simulator's view of a chair; each step lasts `PlantSettings.step_ms`."""

    @property
    def pose(self) -> Pose2:
        """True map_from_base, seen from above."""

    @property
    def pose3(self) -> Pose3:
        """True map_from_base in 3D; the base's origin is on the floor under the middle of the drive axle."""

    @property
    def twist(self) -> Twist:
        """True twist over the ground, base frame."""

    @property
    def ticks(self) -> tuple[int, int]:
        """Encoder counts (left, right), wrapping as signed 32-bit numbers."""

    @property
    def specific_force(self) -> FloatArray:
        """Specific force (3,) [m/s^2] at the IMU's mount, axes as base: +g upwards at rest (REP-145)."""

    @property
    def angular_rate(self) -> FloatArray:
        """Angular rate (3,) [rad/s], axes as base."""

    @property
    def upright(self) -> bool:
        """False from the moment when the chair tipped over or fell."""

    def step(self, forward_volts: float, turn_volts: float, is_free: Callable[[Pose2], bool]) -> bool:
        """Move by one step at these volts (turn volts above neutral turn right); return whether nothing was touched.

        `is_free` tells whether the chair may be at a pose; a plant with its own walls need not call it.
        """


def ticks_from_angle(angle: float, ticks_per_turn: int) -> int:
    """Return the encoder count of a wheel that has turned by `angle` [rad], wrapping as a signed 32-bit number."""
    count = math.floor(angle / math.tau * ticks_per_turn)
    return (count + 2**31) % 2**32 - 2**31


def _volts(beyond: float, dead_band: float, swing: float) -> float:
    return 0.0 if beyond == 0.0 else math.copysign(min(abs(beyond) + dead_band, swing), beyond)
