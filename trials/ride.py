"""What a ride feels like: the accelerations and the jerk of the chair's true motion, beside what the limiter promises.

The true twist is taken every 10 ms and judged twice. By what the sources on comfort use, ISO 2631-1 (1997) and, of a
robotic wheelchair, Solea and Nunes (ICINCO 2008): the acceleration along and across, each weighted by W_d, which fades
out what is slower than 0.4 Hz or faster than 2 Hz; its r.m.s., its fourth-power vibration dose value, and for how much
of the time the running r.m.s. of a second is uncomfortable. The standard's band ends at 100 Hz, beyond the sampling's
50, so that end is left out. Nobody gives a limit of jerk in that weighting, nor filters it: the limiter's is a choice.

So the jerk and the extremes are of the twist behind a Butterworth low pass of the second order, run forwards and
backwards so that nothing is shifted, at `FILTER_HZ`: what is faster is the ripple of the motors. Beside the jerk that
was felt stands that of what the joystick lines asked for, by the same filter: the rest is the chair's own doing. Hard
stops, harder than midway from comfort to emergency, are counted and left out of both: there jerk is the purpose.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import bilinear, butter, lfilter, sosfilt, sosfiltfilt

from waychair.calibration.chair import ChairBody
from waychair.control.limiter import LimiterSettings
from waychair.simulation.simulator import SensorMessage, Simulator, SimulatorSettings
from waychair.simulation.world import World
from waychair.types import BoolArray, FloatArray, IntArray, Json, Pose2, Twist

FILTER_HZ = 2.0
_RATE_HZ = 100.0
_SHORTEST_S = 1.0
"""A shorter motion tells nothing after the filter."""


@dataclass(frozen=True, slots=True)
class Motion:
    """True motion: stamps (T,) int64 [ns], poses (T, 3) in map, twists (T, 2) [m/s, rad/s] over the ground.

    `people` (T,) [m] is the distance from the outline to the nearest person, +inf where there is nobody. `told` (T,)
    [m/s] is the speed along that the joystick lines ask for; empty where nobody noted it, so that no stop is known as hard.
    """

    stamps_ns: IntArray
    poses: FloatArray
    twists: FloatArray
    people: FloatArray
    told: FloatArray = field(default_factory=lambda: np.empty(0))

    def at(self, stamp_ns: int) -> tuple[Pose2, Twist]:
        """Pose and twist at the last sample that is no later than a stamp."""
        k = max(int(np.searchsorted(self.stamps_ns, stamp_ns, side="right")) - 1, 0)
        return Pose2(*self.poses[k].tolist()), Twist(*self.twists[k].tolist())

    def since(self, stamp_ns: int) -> Motion:
        """What came after a stamp."""
        later = self.stamps_ns > stamp_ns
        told = self.told[later] if len(self.told) else self.told
        return Motion(self.stamps_ns[later], self.poses[later], self.twists[later], self.people[later], told)


class WatchedSimulator(Simulator):
    """A simulator that keeps the true motion, one sample whenever it was advanced."""

    def __init__(self, world: World, body: ChairBody, settings: SimulatorSettings | None = None, seed: int = 0) -> None:
        self._samples: list[tuple[int, Pose2, Twist, float, float]] = []
        super().__init__(world, body, settings, seed)

    def advance(self, duration_ns: int) -> tuple[SensorMessage, ...]:
        """As the simulator's."""
        messages = super().advance(duration_ns)
        self._samples.append((self.now_ns, self.truth(), self.twist(), self.person_distance(), self._told()))
        return messages

    def forget(self) -> None:
        """The motion so far has been looked at."""
        self._samples.clear()

    def motion(self) -> Motion:
        """All of it so far, or since it was forgotten."""
        stamps = np.array([stamp for stamp, *_ in self._samples], np.int64)
        poses = np.array([pose.array() for _, pose, *_ in self._samples]).reshape(-1, 3)
        twists = np.array([(twist.v, twist.omega) for _, _, twist, *_ in self._samples]).reshape(-1, 2)
        people, told = np.array([sample[3:] for sample in self._samples]).reshape(-1, 2).T
        return Motion(stamps, poses, twists, people, told)

    def _told(self) -> float:
        """Speed [m/s] at which the chair would settle by what is on its forward line now."""
        plant = self.settings.plant
        beyond = self._board_volts[0] - plant.neutral_volts
        return math.copysign(plant.forward_gain * max(abs(beyond) - plant.forward_dead_band, 0.0), beyond)


@dataclass(frozen=True, slots=True)
class Ride:
    """How a drive felt, while it moved.

    `weighted_rms` [m/s^2], `dose` [m/s^1.75], and the parts of the time that the running r.m.s. is `above_a_little` and
    `above_fairly` uncomfortable are by ISO 2631-1. `rms` [m/s^2] is that of the acceleration along and across without
    weighting; the others are extremes: speeding up, slowing down and sideways [m/s^2], and, outside of `hard_stops`, the
    jerk along [m/s^3], whose 99th percentile is `jerk_p99`, and that of what was told to the chair.
    """

    moving_s: float
    rms: float
    speeding_up: float
    slowing_down: float
    sideways: float
    jerk: float
    jerk_p99: float
    jerk_told: float
    weighted_rms: float
    dose: float
    above_a_little: float
    above_fairly: float
    hard_stops: int


STILL = Ride(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)
"""A chair that did not move."""

A_LITTLE, FAIRLY = 0.315, 0.63
"""ISO 2631-1, annex C: a weighted r.m.s. [m/s^2] is a little uncomfortable from the first to the second."""


def ride_of(motion: Motion) -> Ride:
    """The figures of a motion; those of `STILL` for one that is shorter than a second."""
    seconds = (motion.stamps_ns - motion.stamps_ns[:1]) * 1e-9
    if len(seconds) < 2 or seconds[-1] < _SHORTEST_S:
        return STILL
    grid = np.arange(0.0, seconds[-1], 1.0 / _RATE_HZ)
    v_true, omega_true = (np.interp(grid, seconds, values) for values in motion.twists.T)
    v, omega = _smooth(v_true), _smooth(omega_true)
    moves = (np.abs(v) > _MOVES) | (np.abs(omega) > _MOVES)
    if not moves.any():
        return STILL
    along, across = _rate(v), v * omega
    faster = along * np.sign(v)
    told = np.interp(grid, seconds, motion.told) if len(motion.told) else np.zeros(len(grid))
    hard = _hard_stops(told)
    gentle = ~_widened(hard)
    jerk, jerk_told = (np.where(gentle, np.abs(_rate(_rate(speed))), 0.0) for speed in (v, _smooth(told)))
    felt = np.hypot(weighted(_rate(v_true)), weighted(v_true * omega_true))
    running = np.sqrt(np.convolve(felt**2, np.full(round(_RATE_HZ), 1.0 / _RATE_HZ), mode="same"))
    return Ride(
        moving_s=float(moves.sum() / _RATE_HZ),
        rms=float(np.sqrt((along[moves] ** 2 + across[moves] ** 2).mean())),
        speeding_up=float(max(faster[moves].max(), 0.0)),
        slowing_down=float(max(-faster[moves].min(), 0.0)),
        sideways=float(np.abs(across).max()),
        jerk=float(jerk.max()),
        jerk_p99=float(np.percentile(jerk[moves & gentle], 99)) if (moves & gentle).any() else 0.0,
        jerk_told=float(jerk_told.max()),
        weighted_rms=float(np.sqrt((felt[moves] ** 2).mean())),
        dose=float(((felt**4).sum() / _RATE_HZ) ** 0.25),
        above_a_little=float((running[moves] > A_LITTLE).mean()),
        above_fairly=float((running[moves] > FAIRLY).mean()),
        hard_stops=int(np.count_nonzero(np.diff(_widened(hard).astype(np.int8), prepend=0) > 0)),
    )


_MOVES = 0.01
"""A chair that is faster [m/s, rad/s] moves."""


def weighted(acceleration: FloatArray) -> FloatArray:
    """(T,) [m/s^2] every 10 ms, weighted by W_d of ISO 2631-1, annex A: f1 = 0.4, f3 = f4 = 2 Hz, Q4 = 0.63."""
    corner = math.tau * 2.0
    transition = bilinear([1.0 / corner, 1.0], [corner**-2, 1.0 / (0.63 * corner), 1.0], fs=_RATE_HZ)
    high_pass = butter(2, 0.4, "highpass", fs=_RATE_HZ, output="sos")
    felt: FloatArray = lfilter(*transition, sosfilt(high_pass, acceleration))
    return felt


def _hard_stops(told: FloatArray) -> BoolArray:
    """(T,) when a chair was told to slow down harder than midway from comfort to emergency, over a few ticks."""
    limits = LimiterSettings()
    lag = round(_HARD_S * _RATE_HZ)
    lost = np.zeros(len(told))
    lost[lag:] = np.abs(told[:-lag]) - np.abs(told[lag:])
    hard: BoolArray = lost > 0.5 * (limits.braking + limits.emergency) * _HARD_S
    return hard


_HARD_S = 0.15


def _widened(hard: BoolArray) -> BoolArray:
    """(T,) the same, from the filter's length before it until the chair has followed it to the end."""
    before, after = round(0.4 * _RATE_HZ), round(1.0 * _RATE_HZ)
    near = np.convolve(hard, np.ones(before + after + 1), mode="full")[before : before + len(hard)]
    wide: BoolArray = near > 0.5
    return wide


def _rate(values: FloatArray) -> FloatArray:
    """(T,) change per second."""
    rate: FloatArray = np.gradient(values, 1.0 / _RATE_HZ)
    return rate


def worst_of(rides: Sequence[Ride]) -> Ride:
    """One line for many drives: their extremes, and the r.m.s. over all the time that they moved."""
    time = sum(ride.moving_s for ride in rides)
    if not time:
        return STILL

    def mean(name: str, power: int = 1) -> float:
        """Over all the time that they moved."""
        return float((sum(ride.moving_s * getattr(ride, name) ** power for ride in rides) / time) ** (1.0 / power))

    extremes = ("speeding_up", "slowing_down", "sideways", "jerk", "jerk_p99", "jerk_told", "dose")
    return Ride(
        moving_s=time,
        rms=mean("rms", 2),
        weighted_rms=mean("weighted_rms", 2),
        above_a_little=mean("above_a_little"),
        above_fairly=mean("above_fairly"),
        hard_stops=sum(ride.hard_stops for ride in rides),
        **{name: max(float(getattr(ride, name)) for ride in rides) for name in extremes},
    )


def ride_row(name: str, ride: Ride) -> Json:
    """A line of the table."""
    return {"scene": name, **{key: round(getattr(ride, key), 3) for key in Ride.__slots__}}


def limits_row(settings: LimiterSettings) -> Json:
    """The line of the limits, with what an emergency may do beside it."""
    return {
        "scene": "limits",
        "speeding_up": settings.acceleration,
        "slowing_down": settings.braking,
        "slowing_down_emergency": settings.emergency,
        "sideways": settings.lateral,
        "jerk": settings.jerk,
    }


def _smooth(values: FloatArray) -> FloatArray:
    """(T,) without what is faster than the filter."""
    low_pass = butter(2, FILTER_HZ, fs=_RATE_HZ, output="sos")
    smoothed: FloatArray = sosfiltfilt(low_pass, values)
    return smoothed
