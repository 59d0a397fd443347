"""The limits of a chair's motion, and the step from one command to the next within them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.calibration.fits.stopping import StopTable, permitted_speed
from waychair.config import GIVEN, Settings, given, setting
from waychair.planning.body.clearance import PLANNED
from waychair.planning.body.personal_space import COMFORT_WEIGHT
from waychair.types import FloatArray, Twist

PERIOD = 0.05
"""[s] Time between two commands: the chair's control loop runs at 20 Hz."""

MIN_SPEED, MIN_OMEGA = 0.06, 0.1
"""[m/s], [rad/s] Smallest commands besides 0: a drive's dead band may ignore slower ones. A turn on the spot goes on at
`MIN_OMEGA` until it is measured."""

EMERGENCY_BRAKING, EMERGENCY_ALPHA = 1.5, 3.0
"""[m/s^2], [rad/s^2] Decelerations where the chair would otherwise meet a person before it stands."""

CRAWL_V, CRAWL_OMEGA = 0.15, 0.4
"""Speeds [m/s], [rad/s] at which the chair leaves a tight spot."""

ERROR_STANDING, ERROR_PER_SPEED = 0.01, 0.05
"""[m], [s] Foreseen distance from the line or arc: at a crawl, and more for each m/s."""

RELEASE = 1.6
"""A turn at the goal may drift to so many times the tolerance of the position."""

STANDING_V, STANDING_OMEGA = 0.01, 0.02
"""Speeds [m/s], [rad/s] below which a command counts as standing still."""


@dataclass(frozen=True, slots=True)
class GoalTolerances(Settings):
    """When the chair is at its goal."""

    position: float = setting(
        0.08,
        "m",
        "distance to the goal at which the chair has arrived; larger: it stops sooner and less exactly",
        low=0.01,
        high=1.0,
    )
    heading: float = setting(
        0.05,
        "rad",
        "error of the final heading that counts as arrived; larger: shorter, less exact turns",
        low=0.005,
        high=math.pi,
    )

    @property
    def release(self) -> float:
        """The drift [m] in the turn at the goal after which the chair drives to it again."""
        return RELEASE * self.position


@dataclass(frozen=True, slots=True)
class DwaSettings(Settings):
    """Limits of the chair's motion; engineering choices for comfort, no standard.

    In a chair the rider's comfort limits (`limiter`) replace the speeds [m/s], [rad/s], the accelerations [m/s^2],
    [rad/s^2] and the jerks [m/s^3], [rad/s^3] that are given here. `braking`: of a comfortable stop. `max_lateral`
    [m/s^2]: of v * omega. `clearance` [m] is kept around the footprint by the local planner. `people_weight`: of the
    distance to people against speed and path. `stops`: the measured stopping distances, if there are any (`measured`).
    """

    max_speed: float = given(0.8)
    max_reverse: float = setting(
        0.2,
        "m/s",
        "highest planned reverse speed, 0 for no reversing; larger: the chair backs out faster",
        low=0.0,
        high=1.0,
    )
    max_omega: float = given(0.8)
    acceleration: float = given(0.5)
    braking: float = given(0.6)
    alpha: float = given(0.8)
    jerk: float = given(0.7)
    alpha_jerk: float = given(4.0)
    max_lateral: float = given(0.5)
    max_wheel_speed: float = given(1.0)
    reaction_time: float = setting(
        0.15, "s", "delay from a command to the chair's motion; larger: more distance to obstacles", low=0.0, high=2.0
    )
    clearance: float = given(PLANNED)
    people_weight: float = given(COMFORT_WEIGHT)
    tolerances: GoalTolerances = field(default_factory=GoalTolerances)
    stops: StopTable | None = field(default=None, metadata=GIVEN)


@dataclass(frozen=True, slots=True)
class CommandedMotion:
    """The state of the commands so far: their acceleration [m/s^2, rad/s^2], and the last direction of travel.

    `direction` is 1 after driving forwards, -1 after driving backwards, 0 before either.
    """

    acceleration: Twist = field(default_factory=Twist)
    direction: int = 0


def measured(settings: DwaSettings, stops: StopTable | None) -> DwaSettings:
    """Return the settings for a chair with these measured stops; without any it only crawls.

    The chair drives no faster than its stops were measured for, and reacts no sooner than measured. The dynamic window
    admits only arcs along which the measured stopping distance is free. On an exact line the chair slows down for the
    end instead; the collision monitor knows the measured stops everywhere.
    """
    return replace(
        settings,
        max_speed=min(settings.max_speed, permitted_speed(stops)),
        reaction_time=max(settings.reaction_time, stops.delay_s) if stops is not None else settings.reaction_time,
        stops=stops,
    )


def motion_after(motion: CommandedMotion, command: Twist, following: Twist, settings: DwaSettings) -> CommandedMotion:
    """Return the motion once `following` has been commanded after `command`; a standing chair no longer brakes.

    The acceleration is clipped to the comfortable limits. The limiter or the monitor may have cut the command harder;
    with that acceleration, limited jerk would brake the chair to standstill after a moment's emergency.
    """
    faster = 0.0 if following.v == 0.0 else (following.v - command.v) / PERIOD
    turning = (following.omega - command.omega) / PERIOD
    change = Twist(_within(faster, settings.braking), _within(turning, settings.alpha))
    driving = abs(following.v) >= STANDING_V
    return CommandedMotion(change, int(math.copysign(1, following.v)) if driving else motion.direction)


def _within(value: float, most: float) -> float:
    return min(max(value, -most), most)


def crawling(settings: DwaSettings, room: float = 0.0) -> DwaSettings:
    """Return the same limits at crawling speed, or as much faster as a room [m] beside the chair allows."""
    faster = max(1.0, (room - ERROR_STANDING) / ERROR_PER_SPEED / CRAWL_V)
    return replace(
        settings,
        max_speed=min(settings.max_speed, faster * CRAWL_V),
        max_reverse=min(settings.max_reverse, faster * CRAWL_V),
        max_omega=min(settings.max_omega, faster * CRAWL_OMEGA),
    )


def braking(command: Twist, settings: DwaSettings) -> Twist:
    """Return the command after one period of braking on the same arc: v and omega fall in proportion."""
    left = 1.0 - PERIOD / max(stop_time(command, settings), PERIOD)
    return Twist(command.v * left, command.omega * left)


def braking_hard(command: Twist, settings: DwaSettings) -> Twist:
    """Return the command after one period of emergency braking on the same arc."""
    hard, hard_alpha = max(EMERGENCY_BRAKING, settings.braking), max(EMERGENCY_ALPHA, settings.alpha)
    return braking(command, replace(settings, braking=hard, alpha=hard_alpha))


def stopping(command: Twist, settings: DwaSettings, motion: CommandedMotion | None) -> Twist:
    """Return the command after one period of a comfortable stop: as `braking`, with limited jerk, never speeding up."""
    if motion is None:
        return braking(command, settings)
    eased = towards(command, Twist(), settings, motion)
    along = abs(command.v) / settings.braking >= abs(command.omega) / settings.alpha
    before, after = (command.v, eased.v) if along else (command.omega, eased.omega)
    left = min(max(after / before, 0.0), 1.0) if before else 0.0
    return Twist(command.v * left, command.omega * left)


def slowing_speed(way: float, end: float, settings: DwaSettings) -> float:
    """Return the greatest speed [m/s] that slows to `end` [m/s] within a distance [m] at half the braking and jerk.

    The other half is kept in reserve for the chair's lag. The acceleration is 0 at both ends. From v the mean speed is
    (v + end) / 2, for the time (v - end) / a + a / jerk, or 2 sqrt((v - end) / jerk) where the full a is not reached;
    solved for v.
    """
    a, jerk, way = settings.braking / 2, settings.jerk / 2, max(way, 0.0)
    ramps = a * a / jerk  # change of the speed while a comes and goes
    speed = math.hypot(ramps / 2 - end, math.sqrt(2 * a * way)) - ramps / 2
    if speed - end >= ramps:
        return speed
    # With s = sqrt(v - end): s^3 + 2 end s = way sqrt(jerk). Cardano's formula gives the one real root.
    half, third = way * math.sqrt(jerk) / 2, 2 * end / 3
    root = math.sqrt(half**2 + third**3)
    return end + (math.cbrt(half + root) + math.cbrt(half - root)) ** 2


def stop_time(twist: Twist, settings: DwaSettings) -> float:
    """Return the time [s] to brake v and omega to 0 in proportion."""
    return max(abs(twist.v) / settings.braking, abs(twist.omega) / settings.alpha)


def towards(command: Twist, target: Twist, settings: DwaSettings, motion: CommandedMotion | None = None) -> Twist:
    """Return the command after one period towards the target: straight in (v, omega), or with limited jerk."""
    return Twist(*_step(_limits(settings, motion), command.v, command.omega, target.v, target.omega))


def towards_each(
    command: Twist, targets: FloatArray, settings: DwaSettings, motion: CommandedMotion | None
) -> FloatArray:
    """Return (N, 2) `towards` for each of many targets (N, 2) [m/s, rad/s]."""
    return _steps(_limits(settings, motion), command.v, command.omega, targets)


class _StepLimits(NamedTuple):
    """How a command may change in one period; `v` and `omega` are the present accelerations, used if `eased`."""

    period: float
    acceleration: float
    braking: float
    alpha: float
    jerk: float
    alpha_jerk: float
    eased: bool
    v: float
    omega: float


def _limits(settings: DwaSettings, motion: CommandedMotion | None) -> _StepLimits:
    now = Twist() if motion is None else motion.acceleration
    s, eased = settings, motion is not None
    return _StepLimits(
        period=PERIOD,
        acceleration=s.acceleration,
        braking=s.braking,
        alpha=s.alpha,
        jerk=s.jerk,
        alpha_jerk=s.alpha_jerk,
        eased=eased,
        v=now.v,
        omega=now.omega,
    )


@njit(cache=True, nogil=True)
def _step(limits: _StepLimits, v: float, omega: float, to_v: float, to_omega: float) -> tuple[float, float]:
    dv, domega = to_v - v, to_omega - omega
    speeding_up = dv * v > 0 or v == 0
    longest = max(abs(dv) / (limits.acceleration if speeding_up else limits.braking), abs(domega) / limits.alpha)
    share = min(1.0, limits.period / longest) if longest > 0 else 1.0
    if not limits.eased:
        return v + share * dv, omega + share * domega
    after = v + _eased(share * dv, dv, limits.v, limits.jerk, limits.period)
    # hard braking may end in standstill, but does not go on into reversing
    after = after if after * (v or to_v) > 0.0 else 0.0
    return after, omega + _eased(share * domega, domega, limits.omega, limits.alpha_jerk, limits.period)


@njit(cache=True, nogil=True)
def _steps(limits: _StepLimits, v: float, omega: float, targets: FloatArray) -> FloatArray:
    after = np.empty_like(targets)
    for i in range(len(targets)):
        after[i, 0], after[i, 1] = _step(limits, v, omega, targets[i, 0], targets[i, 1])
    return after


@njit(cache=True, nogil=True)
def _eased(step: float, left: float, acceleration: float, jerk: float, period: float) -> float:
    """Return a speed's step in one period: the acceleration changes by the jerk and ends at 0 at the target."""
    # A step s is followed by n more, s - change, s - 2 change, ...: in sum (n + 1) (s - n change / 2).
    change = jerk * period**2
    n = math.floor((math.sqrt(1.0 + 8.0 * abs(left) / change) - 1.0) / 2.0)
    most = abs(left) / (n + 1) + n * change / 2
    wanted = min(max(step, -most), most)
    return min(max(wanted, acceleration * period - change), acceleration * period + change)


def change_within(acceleration: float | None, sign: float, most: float, jerk: float, time: float) -> float:
    """Return the greatest change of a speed up (sign 1) or down (-1) within a time; the jerk ramps a up to `most`.

    Without a present acceleration it is `most` at once.
    """
    if acceleration is None:
        return most * time
    now = sign * acceleration
    ramp = min(max((most - now) / jerk, 0.0), time)
    return now * ramp + jerk * ramp**2 / 2 + most * (time - ramp)


def standing(twist: Twist) -> bool:
    """Return whether a command is so small that the chair stands."""
    return abs(twist.v) < STANDING_V and abs(twist.omega) < STANDING_OMEGA
