"""Ride comfort: accelerations and jerk of the chair's true motion, for comparison with the limiter's limits.

The true twist is sampled every 10 ms and evaluated in two ways.

First by ISO 2631-1 (1997), as for a robotic wheelchair by Solea and Nunes (ICINCO 2008): accelerations along and across
are weighted by W_d, a band from 0.4 to 2 Hz. The figures are the r.m.s., the fourth-power vibration dose value, and the
share of time with an uncomfortable running r.m.s. over one second. The standard's upper band limit of 100 Hz lies above
the Nyquist frequency and is left out. No source limits the jerk in this weighting; the limiter's limit is a choice.

Second, jerk and extremes are taken after a second-order Butterworth low pass at `FILTER_HZ`, run forward and backward
without phase shift, which removes the motors' ripple. The jerk of the speed that the joystick lines requested is
computed with the same filter; the difference comes from the chair. Hard stops (deceleration above the mean of comfort
and emergency) are counted and left out of both jerks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.control.speed.limiter import LimiterSettings
from waychair.simulation.plan.world import World
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.types import BoolArray, FloatArray, IntArray, Json, Pose2, SensorMessage, Twist

FILTER_HZ = 2.0
_RATE_HZ = 100.0
_SHORTEST_S = 1.0
"""A shorter motion cannot be evaluated after the filter."""


@dataclass(frozen=True, slots=True)
class TrueMotion:
    """True motion: stamps (T,) int64 [ns], poses (T, 3) in map, twists (T, 2) [m/s, rad/s] over the ground.

    `people` (T,) [m] is the distance from the footprint to the nearest person, +inf without people. `requested` (T,) [m/s]
    is the speed that the joystick lines request; if it is empty, no stop counts as hard.
    """

    stamps_ns: IntArray
    poses: FloatArray
    twists: FloatArray
    people: FloatArray
    requested: FloatArray = field(default_factory=lambda: np.empty(0))

    def at(self, stamp_ns: int) -> tuple[Pose2, Twist]:
        """Return pose and twist of the last sample at or before a stamp."""
        k = max(int(np.searchsorted(self.stamps_ns, stamp_ns, side="right")) - 1, 0)
        return Pose2(*self.poses[k].tolist()), Twist(*self.twists[k].tolist())

    def since(self, stamp_ns: int) -> TrueMotion:
        """Return the motion after a stamp."""
        later = self.stamps_ns > stamp_ns
        requested = self.requested[later] if len(self.requested) else self.requested
        return TrueMotion(self.stamps_ns[later], self.poses[later], self.twists[later], self.people[later], requested)


class RecordingSimulator(Simulator):
    """A simulator that records the true motion, one sample per `advance`."""

    def __init__(self, world: World, body: ChairBody, settings: SimulatorSettings | None = None, seed: int = 0) -> None:
        self._samples: list[tuple[int, Pose2, Twist, float, float]] = []
        super().__init__(world, body, settings, seed)

    def advance(self, duration_ns: int) -> tuple[SensorMessage, ...]:
        """Advance the simulator and record a sample."""
        messages = super().advance(duration_ns)
        self._samples.append((self.now_ns, self.truth(), self.twist(), self.person_distance(), self._requested_speed()))
        return messages

    def clear_motion(self) -> None:
        """Drop the motion so far."""
        self._samples.clear()

    def motion(self) -> TrueMotion:
        """Return the motion so far, or since `clear_motion`."""
        stamps = np.array([stamp for stamp, *_ in self._samples], np.int64)
        poses = np.array([pose.array() for _, pose, *_ in self._samples]).reshape(-1, 3)
        twists = np.array([(twist.v, twist.omega) for _, _, twist, *_ in self._samples]).reshape(-1, 2)
        people, requested = np.array([sample[3:] for sample in self._samples]).reshape(-1, 2).T
        return TrueMotion(stamps, poses, twists, people, requested)

    def _requested_speed(self) -> float:
        """Return the speed [m/s] at which the chair would settle with the present volts on its forward line."""
        plant, lines = self.settings.plant, self.lines
        beyond = (0.0 if lines is None else lines.forward_mv / 1000.0) - plant.neutral_volts
        return math.copysign(plant.forward_gain * max(abs(beyond) - plant.forward_dead_band, 0.0), beyond)


@dataclass(frozen=True, slots=True)
class Ride:
    """Comfort figures of a drive, over the time in motion.

    By ISO 2631-1: `weighted_rms` [m/s^2], `dose` [m/s^1.75], and the shares of time `above_a_little` and `above_fairly`
    uncomfortable. `rms` [m/s^2] is the unweighted acceleration along and across. Extremes: `speeding_up`,
    `slowing_down`, `sideways` [m/s^2] and, outside `hard_stops`, `jerk` along [m/s^3] (99th percentile `jerk_p99`) and
    `jerk_told`, the jerk of the requested speed.
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
"""The figures of a chair that did not move."""

A_LITTLE, FAIRLY = 0.315, 0.63
"""ISO 2631-1, annex C: a weighted r.m.s. [m/s^2] between the two is a little uncomfortable, above it fairly."""


def ride_of(motion: TrueMotion) -> Ride:
    """Return the comfort figures of a motion; `STILL` for one shorter than a second."""
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
    requested = np.interp(grid, seconds, motion.requested) if len(motion.requested) else np.zeros(len(grid))
    hard = _hard_stops(requested)
    gentle = ~_widened(hard)
    jerk, jerk_told = (np.where(gentle, np.abs(_rate(_rate(speed))), 0.0) for speed in (v, _smooth(requested)))
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
"""A chair moves above this speed [m/s, rad/s]."""


def weighted(acceleration: FloatArray) -> FloatArray:
    """Return accelerations (T,) [m/s^2], sampled every 10 ms, weighted by W_d of ISO 2631-1, annex A (Q4 = 0.63)."""
    from scipy.signal import bilinear, butter, lfilter, sosfilt  # here, since it loads slowly and few commands use it

    corner = math.tau * 2.0
    transition = bilinear([1.0 / corner, 1.0], [corner**-2, 1.0 / (0.63 * corner), 1.0], fs=_RATE_HZ)
    high_pass = butter(2, 0.4, "highpass", fs=_RATE_HZ, output="sos")
    felt: FloatArray = lfilter(*transition, sosfilt(high_pass, acceleration))
    return felt


def _hard_stops(requested: FloatArray) -> BoolArray:
    """Return (T,) whether the requested deceleration exceeds the mean of comfort and emergency, over `_HARD_S`."""
    limits = LimiterSettings()
    lag = round(_HARD_S * _RATE_HZ)
    lost = np.zeros(len(requested))
    lost[lag:] = np.abs(requested[:-lag]) - np.abs(requested[lag:])
    hard: BoolArray = lost > 0.5 * (limits.braking + limits.emergency) * _HARD_S
    return hard


_HARD_S = 0.15


def _widened(hard: BoolArray) -> BoolArray:
    """Return hard stops (T,) extended by the filter's length before and by the chair's response time after."""
    before, after = round(0.4 * _RATE_HZ), round(1.0 * _RATE_HZ)
    near = np.convolve(hard, np.ones(before + after + 1), mode="full")[before : before + len(hard)]
    wide: BoolArray = near > 0.5
    return wide


def _rate(values: FloatArray) -> FloatArray:
    """Return the derivative (T,) per second."""
    rate: FloatArray = np.gradient(values, 1.0 / _RATE_HZ)
    return rate


def ride_row(name: str, ride: Ride) -> Json:
    """Return a row of the table."""
    return {"scene": name, **{key: round(getattr(ride, key), 3) for key in Ride.__slots__}}


def _smooth(values: FloatArray) -> FloatArray:
    """Return the low-pass filtered values (T,)."""
    from scipy.signal import butter, sosfiltfilt

    low_pass = butter(2, FILTER_HZ, fs=_RATE_HZ, output="sos")
    smoothed: FloatArray = sosfiltfilt(low_pass, values)
    return smoothed
