"""A sensor's clock against the computer's: offset, drift and fixed latency, and how to find the first two on-line.

Messages arrive late by the clock's offset, a fixed latency and a jitter that is never negative. So the earliest arrivals
lie on a line, under all others: of the lines under all points it is the one nearest to them, which is an edge of their
lower convex hull (Moon, Skelly and Towsley, INFOCOM 1999; Zhang, Liu and Xia, INFOCOM 2002). The fixed latency cannot
be told from the offset by arrivals; `waychair calibrate time` finds it.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from dataclasses import dataclass
from typing import Literal, TypeAlias

from waychair.config import Settings, setting
from waychair.errors import ThinData
from waychair.types import Scan

_Arrival: TypeAlias = tuple[int, int]
"""A sensor's stamp [ns], and by how much more the computer's clock showed when the message arrived [ns]."""


@dataclass(frozen=True, slots=True)
class SensorClock:
    """How the computer's time follows from a sensor's stamp.

    The computer's clock shows `offset_ns` more than the sensor's at the sensor's `reference_ns`, and gains `drift_ppm`
    millionths on it. A stamp is put on `latency_ns` after the measurement.
    """

    offset_ns: int = 0
    drift_ppm: float = 0.0
    latency_ns: int = 0
    reference_ns: int = 0

    def host_from_sensor(self, stamp_ns: int) -> int:
        """When, by the computer's clock [ns], that was measured which the sensor stamped so [ns]."""
        drift = round(1e-6 * self.drift_ppm * (stamp_ns - self.reference_ns))
        return stamp_ns + self.offset_ns + drift - self.latency_ns


@dataclass(frozen=True, slots=True)
class ClockSettings(Settings):
    """What an estimate goes by."""

    bucket_s: float = setting(1.0, "s", "of the arrivals in such a time only the earliest counts", low=0.01, high=60.0)
    window_s: float = setting(600.0, "s", "arrivals before this are forgotten", low=10.0, high=100_000.0)
    least_s: float = setting(10.0, "s", "before this the drift is taken to be 0", low=1.0, high=1000.0)
    most_drift_ppm: float = setting(500.0, "ppm", "no clock drifts by more", low=1.0, high=10_000.0)
    step_s: float = setting(
        0.05, "s", "a change of the offset by more means that a clock was set", low=0.001, high=10.0
    )
    step_buckets: int = setting(5, "", "it must last so long, when arrivals become later", low=1, high=100)


class ClockEstimator:
    """Keeps the earliest arrival of each bucket of time; begins again when either clock was set."""

    def __init__(self, settings: ClockSettings | None = None) -> None:
        self.settings = settings or ClockSettings()
        self.steps = 0
        self._bucket_ns = round(self.settings.bucket_s * 1e9)
        self._earliest: deque[_Arrival] = deque(maxlen=max(2, round(self.settings.window_s / self.settings.bucket_s)))
        self._known = SensorClock()  # as of the last full bucket

    def add(self, stamp_ns: int, arrival_ns: int) -> None:
        """A message of this stamp has arrived when the computer's clock showed `arrival_ns`."""
        delay, buckets = arrival_ns - stamp_ns, self._earliest
        if buckets and self._too_early(stamp_ns, arrival_ns):
            self.steps += 1
            buckets.clear()
        if buckets and stamp_ns // self._bucket_ns == buckets[-1][0] // self._bucket_ns:
            buckets[-1] = min(buckets[-1], (stamp_ns, delay), key=lambda arrival: arrival[1])
        elif not buckets or stamp_ns > buckets[-1][0]:
            self._forget_before_step()
            buckets.append((stamp_ns, delay))
            self._known = self.clock()

    def clock(self, latency_ns: int = 0) -> SensorClock:
        """Offset and drift by the arrivals so far, with a fixed latency that is known otherwise.

        Raises:
            ThinData: nothing has arrived.
        """
        if not self._earliest:
            raise ThinData("no message has arrived to tell the sensor's clock from: check that it is switched on")
        return dataclasses.replace(_line_below(tuple(self._earliest), self.settings), latency_ns=latency_ns)

    def _too_early(self, stamp_ns: int, arrival_ns: int) -> bool:
        """Whether a message came, or its stamp lies, before what is possible: nothing comes before it was sent."""
        last, step = self._earliest[-1][0], round(self.settings.step_s * 1e9)
        if stamp_ns < last - self._bucket_ns - step:
            return True
        unknown_drift = 1e-6 * self.settings.most_drift_ppm * abs(stamp_ns - last)
        return arrival_ns < self._known.host_from_sensor(stamp_ns) - step - unknown_drift

    def _forget_before_step(self) -> None:
        """When all messages of late came later than those before explain, the clock was set meanwhile."""
        arrivals, count = tuple(self._earliest), self.settings.step_buckets
        before, late = arrivals[:-count], arrivals[-count:]
        if len(before) < count:
            return
        line = _line_below(before, self.settings)
        if all(stamp + delay > line.host_from_sensor(stamp) + self.settings.step_s * 1e9 for stamp, delay in late):
            self.steps += 1
            self._earliest.clear()
            self._earliest.extend(late)


def _line_below(arrivals: tuple[_Arrival, ...], settings: ClockSettings) -> SensorClock:
    """The clock by which none of the arrivals came early; without drift when they tell none that is possible."""
    reference = arrivals[-1][0]
    points = [(stamp - reference, delay) for stamp, delay in arrivals]
    lowest = SensorClock(min(delay for _, delay in points), 0.0, 0, reference)
    if -points[0][0] < settings.least_s * 1e9:
        return lowest
    (x0, y0), (x1, y1) = _edge_below(points)
    drift = (y1 - y0) / (x1 - x0)
    if abs(drift) * 1e6 > settings.most_drift_ppm:
        return lowest
    return SensorClock(y0 - round(drift * x0), 1e6 * drift, 0, reference)


def _edge_below(points: list[_Arrival]) -> tuple[_Arrival, _Arrival]:
    """Ends of the lower convex hull's edge over the mean x of the points, which ascend in x (Andrew's monotone chain)."""
    hull: list[_Arrival] = []
    for point in points:
        while len(hull) > 1 and _turn(hull[-2], hull[-1], point) <= 0:
            hull.pop()
        hull.append(point)
    mean = sum(x for x, _ in points) / len(points)
    right = next(i for i in range(1, len(hull)) if hull[i][0] >= mean)
    return hull[right - 1], hull[right]


def _turn(a: _Arrival, b: _Arrival, c: _Arrival) -> int:
    """Positive when the way from a over b to c bends to the left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def first_beam(scan: Scan, stamped: Literal["first", "middle", "last"]) -> Scan:
    """The scan of a driver that stamps its first, middle or last beam, stamped at its first."""
    beams = {"first": 0.0, "middle": 0.5, "last": 1.0}[stamped] * (len(scan.ranges) - 1)
    return dataclasses.replace(scan, stamp_ns=scan.stamp_ns - round(beams * scan.time_step * 1e9))
