"""What a ride feels like: the accelerations and the jerk of the chair's true motion, beside what the limiter promises.

The true twist is taken every 10 ms, filtered, and differentiated. The filter is a Butterworth low pass of the second
order, run forwards and backwards so that nothing is shifted, at `FILTER_HZ`: sideways and lengthwise a sitting person
is most sensitive between 0.5 and 2 Hz (ISO 2631-1, weighting W_d), and what is faster is the ripple of the motors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from waychair.calibration.chair import ChairBody
from waychair.control.limiter import LimiterSettings
from waychair.simulation.simulator import SensorMessage, Simulator, SimulatorSettings
from waychair.simulation.world import World
from waychair.types import FloatArray, IntArray, Json, Pose2, Twist

FILTER_HZ = 2.0
_RATE_HZ = 100.0
_SHORTEST_S = 1.0
"""A shorter motion tells nothing after the filter."""


@dataclass(frozen=True, slots=True)
class Motion:
    """True motion: stamps (T,) int64 [ns], poses (T, 3) in map, twists (T, 2) [m/s, rad/s] over the ground.

    `people` (T,) [m] is the distance from the outline to the nearest person, +inf where there is nobody.
    """

    stamps_ns: IntArray
    poses: FloatArray
    twists: FloatArray
    people: FloatArray

    def at(self, stamp_ns: int) -> tuple[Pose2, Twist]:
        """Pose and twist at the last sample that is no later than a stamp."""
        k = max(int(np.searchsorted(self.stamps_ns, stamp_ns, side="right")) - 1, 0)
        return Pose2(*self.poses[k].tolist()), Twist(*self.twists[k].tolist())


class WatchedSimulator(Simulator):
    """A simulator that keeps the true motion, one sample whenever it was advanced."""

    def __init__(self, world: World, body: ChairBody, settings: SimulatorSettings | None = None, seed: int = 0) -> None:
        self._samples: list[tuple[int, Pose2, Twist, float]] = []
        super().__init__(world, body, settings, seed)

    def advance(self, duration_ns: int) -> tuple[SensorMessage, ...]:
        """As the simulator's."""
        messages = super().advance(duration_ns)
        self._samples.append((self.now_ns, self.truth(), self.twist(), self.person_distance()))
        return messages

    def motion(self) -> Motion:
        """All of it so far."""
        stamps = np.array([stamp for stamp, *_ in self._samples], np.int64)
        poses = np.array([pose.array() for _, pose, *_ in self._samples]).reshape(-1, 3)
        twists = np.array([(twist.v, twist.omega) for _, _, twist, _ in self._samples]).reshape(-1, 2)
        return Motion(stamps, poses, twists, np.array([away for *_, away in self._samples]))


@dataclass(frozen=True, slots=True)
class Ride:
    """How a drive felt, while it moved.

    `rms` [m/s^2] is that of the acceleration along and across; the others are extremes: speeding up, slowing down and
    sideways [m/s^2], and the jerk along [m/s^3], whose 99th percentile is `jerk_p99`.
    """

    moving_s: float
    rms: float
    speeding_up: float
    slowing_down: float
    sideways: float
    jerk: float
    jerk_p99: float


STILL = Ride(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""A chair that did not move."""


def ride_of(motion: Motion) -> Ride:
    """The figures of a motion; those of `STILL` for one that is shorter than a second."""
    seconds = (motion.stamps_ns - motion.stamps_ns[:1]) * 1e-9
    if len(seconds) < 2 or seconds[-1] < _SHORTEST_S:
        return STILL
    grid = np.arange(0.0, seconds[-1], 1.0 / _RATE_HZ)
    v, omega = (_smooth(np.interp(grid, seconds, values)) for values in motion.twists.T)
    along, across = np.gradient(v, 1.0 / _RATE_HZ), v * omega
    jerk = np.abs(np.gradient(along, 1.0 / _RATE_HZ))
    moves = (np.abs(v) > _MOVES) | (np.abs(omega) > _MOVES)
    if not moves.any():
        return STILL
    faster = along * np.sign(v)
    return Ride(
        moving_s=float(moves.sum() / _RATE_HZ),
        rms=float(np.sqrt((along[moves] ** 2 + across[moves] ** 2).mean())),
        speeding_up=float(max(faster[moves].max(), 0.0)),
        slowing_down=float(max(-faster[moves].min(), 0.0)),
        sideways=float(np.abs(across).max()),
        jerk=float(jerk.max()),
        jerk_p99=float(np.percentile(jerk[moves], 99)),
    )


_MOVES = 0.01
"""A chair that is faster [m/s, rad/s] moves."""


def worst_of(rides: Sequence[Ride]) -> Ride:
    """One line for many drives: their extremes, and the r.m.s. over all the time that they moved."""
    time = sum(ride.moving_s for ride in rides)
    if not time:
        return STILL
    return Ride(
        time,
        float(np.sqrt(sum(ride.moving_s * ride.rms**2 for ride in rides) / time)),
        *(
            max(float(getattr(ride, name)) for ride in rides)
            for name in ("speeding_up", "slowing_down", "sideways", "jerk", "jerk_p99")
        ),
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
