"""Measured stopping distances of a chair, and the highest speed that they permit.

A chair without measured stops may only crawl. A measured chair may drive up to the highest measured speed, but only as
fast as it can stop within the free distance ahead.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from waychair.calibration.measured import Measured, measured
from waychair.config import Settings, setting
from waychair.errors import CalibrationError, ThinData
from waychair.types import FloatArray

UNMEASURED_SPEED = 0.3
"""m/s; highest speed of a chair whose stops were not measured."""

_AT_REST = (0.03, 0.06)  # m/s, rad/s
_STEADY = (0.10, 0.20)  # m/s, rad/s; a held speed changes by less within half a second
_SPINNING = 0.02  # m/s; a slower chair only turns
_BEGUN = 0.95  # remaining share of the speed at which a stop's delay ends


@dataclass(frozen=True, slots=True)
class StopSettings(Settings):
    """The stops to measure."""

    slowest: float = setting(0.2, "m/s", "lowest speed of a measured stop; larger: fewer stops", low=0.05, high=1.0)
    step: float = setting(
        0.2, "m/s", "step from one speed of measured stops to the next; larger: fewer stops", low=0.05, high=1.0
    )
    fastest: float = setting(
        4.0,
        "m/s",
        "highest speed of a measured stop, at most the chair's top speed; larger: stops need more room",
        low=0.2,
        high=4.0,
    )
    turn_rate: float = setting(
        0.6,
        "rad/s",
        "turn rate of the chair before a measured stop from a turn; larger: faster turns are measured",
        low=0.1,
        high=3.0,
    )
    repetitions: int = setting(3, "", "number of measured stops of each kind; more: a safer worst case", low=1, high=50)


MARGIN, MARGIN_M = 0.2, 0.03
"""Share and m; both are added to the worst measured distance."""


@dataclass(frozen=True, slots=True)
class MeasuredStop:
    """One stop: twist before it [m/s, rad/s], delay [s] to the first effect, distance [m] and turn [rad] to rest."""

    v: float
    omega: float
    delay_s: float
    distance_m: float
    angle_rad: float


@dataclass(frozen=True, slots=True)
class StopTable(Measured):
    """Worst stops with margin: `distances` [m] that any part of the chair needs to stop from `speeds` [m/s], rising.

    `turn_angle` is the turn to rest from spinning at `turn_rate`; `delay_s` is the worst delay.
    """

    speeds: tuple[float, ...] = measured((), "m/s", "measured, of the axle")
    distances: tuple[float, ...] = measured((), "m", "worst way to rest, with margin")
    ways: tuple[float, ...] = measured((), "m", "worst way of the axle alone, with margin; empty: not measured apart")
    turn_rate: float = measured(0.0, "rad/s", "fastest spin whose stop was measured", low=0.0, high=10.0)
    turn_angle: float = measured(0.0, "rad", "worst turn to rest from it, with margin", low=0.0, high=20.0)
    delay_s: float = measured(0.0, "s", "worst time from Stop to the first effect", low=0.0, high=5.0)

    def __post_init__(self) -> None:
        Measured.__post_init__(self)
        values = (*self.speeds, *self.distances)
        rising = all(a < b for a, b in zip(self.speeds, self.speeds[1:], strict=False))
        longer = all(a <= b for a, b in zip(self.distances, self.distances[1:], strict=False))
        if not (self.speeds and len(self.speeds) == len(self.distances) and rising and longer):
            raise CalibrationError("the table of stops has gaps or falls: measure the stops again")
        apart = all(0.0 < way <= whole for way, whole in zip(self.ways, self.distances, strict=False))
        if self.ways and not (apart and len(self.ways) == len(self.speeds)):
            raise CalibrationError("the ways of the axle do not belong to the table of stops: measure the stops again")
        if not all(math.isfinite(value) and value > 0.0 for value in values):
            raise CalibrationError("the table of stops holds a value that is not a positive number: measure again")

    def distance(self, speed: float) -> float:
        """Return the worst distance to rest [m] from a speed [m/s] in any direction, linear between measured speeds.

        Raises:
            CalibrationError: so fast a stop was never measured.
        """
        if not abs(speed) <= self.speeds[-1]:
            raise CalibrationError(
                f"no stop from {speed:g} m/s was measured: drive at most {self.speeds[-1]:g} m/s, or measure it"
            )
        return float(np.interp(abs(speed), (0.0, *self.speeds), (0.0, *self.distances)))

    def way(self, speed: float) -> float:
        """Return the worst way of the axle to rest [m]; that of any part where it was not measured apart. As `distance`."""
        if not self.ways:
            return self.distance(speed)
        return float(np.interp(abs(speed), (0.0, *self.speeds), (0.0, *self.ways)))


def permitted_speed(stops: StopTable | None, free_m: float = math.inf) -> float:
    """Return the highest speed [m/s] at which the chair stops within `free_m`.

    Without a table it is `UNMEASURED_SPEED` for any `free_m`, because the stopping distance is unknown.
    """
    if stops is None:
        return UNMEASURED_SPEED
    if free_m >= stops.distances[-1]:
        return stops.speeds[-1]
    return float(np.interp(max(free_m, 0.0), *_strictly_rising((0.0, *stops.distances), (0.0, *stops.speeds))))


def _strictly_rising(distances: tuple[float, ...], speeds: tuple[float, ...]) -> tuple[list[float], list[float]]:
    """Return distances and speeds without repeated distances; the slowest speed of each is kept."""
    kept: list[tuple[float, float]] = []
    for distance, speed in zip(distances, speeds, strict=True):
        if not kept or distance > kept[-1][0]:
            kept.append((distance, speed))
    return [row[0] for row in kept], [row[1] for row in kept]


def stop_from_motion(seconds: FloatArray, twists: FloatArray) -> MeasuredStop:
    """Return one stop from twists (N, 2) [m/s, rad/s] at rising `seconds` (N,), of which 0 is the moment of Stop.

    The delay ends when the speed (for a spin the turn rate) has lost 5 % of its mean over the last half second before.
    Distance and turn are the integrals of the twist from 0 on (trapezoids), until the chair is at rest.

    Raises:
        ThinData: nothing was measured before or after Stop, or the chair was not steady before or at rest after it.
    """
    before, after = (seconds > -0.5) & (seconds <= 0.0), seconds >= 0.0
    if before.sum() < 2 or after.sum() < 2:
        raise ThinData("a stop needs half a second before it and the time until rest: log both")
    v, omega = (float(value) for value in twists[before].mean(axis=0))
    early, late = (part.mean(axis=0) for part in np.array_split(twists[before], 2))
    if (np.abs(late - early) > _STEADY).any():
        raise ThinData(
            f"the chair was still changing its speed, from {early[0]:.2f} to {late[0]:.2f} m/s and {early[1]:.2f} to "
            f"{late[1]:.2f} rad/s, when it was stopped: hold the speed for longer"
        )
    if (np.abs(twists[-1]) > _AT_REST).any():
        raise ThinData(
            f"the chair was still moving at {twists[-1, 0]:.2f} m/s, {twists[-1, 1]:.2f} rad/s at the log's end: "
            "log until it rests"
        )
    axis = 0 if abs(v) > _SPINNING else 1
    part = twists[after, axis] / (v if axis == 0 else omega)
    fallen = np.flatnonzero(part < _BEGUN)
    delay = float(seconds[after][fallen[0]]) if len(fallen) else 0.0
    going, steps = twists[after], np.diff(seconds[after])
    way = np.abs(0.5 * ((going[1:] + going[:-1]) * steps[:, None]).sum(axis=0) + going[0] * seconds[after][0])
    return MeasuredStop(v, omega, max(delay, 0.0), float(way[0]), float(way[1]))


def stop_table(stops: Iterable[MeasuredStop], corner_m: float, settings: StopSettings | None = None) -> StopTable:
    """Return the worst measured stops plus the margin, for a chair with its farthest corner `corner_m` [m] off its
    axle.

    Every part of the chair must stop, so the turn of a stop counts as the corner's distance. Speeds within 5 % share a
    row, at the slowest of them.

    Raises:
        ThinData: fewer than two speeds, or no spin.
    """
    settings = settings or StopSettings()
    stops = tuple(stops)
    spins = [s for s in stops if abs(s.v) < 0.5 * settings.slowest]
    rows = sorted((abs(s.v), s.distance_m + s.angle_rad * corner_m, s.distance_m) for s in stops if s not in spins)
    speeds: list[float] = []
    distances: list[float] = []
    ways: list[float] = []
    for speed, distance, way in rows:
        if not speeds or speed > 1.05 * speeds[-1]:
            speeds.append(speed)
            distances.append(0.0)
            ways.append(0.0)
        distances[-1], ways[-1] = max(distances[-1], distance), max(ways[-1], way)
    if len(speeds) < 2 or not spins:
        raise ThinData(
            f"stops from {len(speeds)} speeds and {len(spins)} spins are too few: measure two speeds and a spin or more"
        )
    more = 1.0 + MARGIN
    return StopTable(
        speeds=tuple(speeds),
        distances=tuple((np.maximum.accumulate(distances) * more + MARGIN_M).tolist()),
        ways=tuple((np.maximum.accumulate(ways) * more + MARGIN_M).tolist()),
        turn_rate=max(abs(s.omega) for s in spins),
        turn_angle=max(s.angle_rad for s in spins) * more + MARGIN_M / corner_m,
        delay_s=max(s.delay_s for s in stops),
    )


def stops_to_measure(settings: StopSettings, fastest: float) -> Iterator[tuple[float, float]]:
    """Yield twists (v, omega) to stop from, at most `fastest` [m/s]: forward, in reverse, and turning to both sides.

    Each is followed by its opposite, which brings the chair back. In a curve it does so only nearly, because turning
    stops before driving does, so every other pair of curves begins in reverse.
    """
    fastest = min(settings.fastest, fastest)
    count = max(1, math.ceil((fastest - settings.slowest) / settings.step - 1e-9))
    speeds = np.linspace(min(settings.slowest, 0.5 * fastest), fastest, count + 1).tolist()
    w = settings.turn_rate
    for _ in range(settings.repetitions):
        pairs = [pair for v in speeds for pair in ((v, 0.0), (v, w), (-v, w))]
        for v, omega in (*pairs, (0.0, w), (0.0, 1.5 * w)):
            yield v, omega
            yield -v, -omega
