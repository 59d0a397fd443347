"""The height by which a chair was lifted: its accelerometer integrated twice, from one rest to the next.

The mean at rest before a ride takes off gravity and bias; the speed that is left at the next rest, which must be 0, takes
off the drift in between. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, section 15.3
(zero-velocity update).
"""

from __future__ import annotations

import math
from collections import deque

from waychair.types import ImuSample

STARTS, ENDS = 0.10, 0.06
"""m/s^2; a smoothed acceleration above the first begins a ride, and one below the second may end it."""

SMOOTH_S, REST_S = 0.25, 0.8
"""s; time constant of the smoothed acceleration, and the rest after which a ride has ended."""

SLOW = 0.3
"""m/s; a car that is faster still rides."""

LEVEL_S = 2.0
"""s; time constant of the mean at rest."""

SIGMA, SIGMA_PER_S = 0.10, 0.02
"""m, m/s; standard deviation of a climb, and its growth with the duration of the rides."""

LONGEST_GAP_S = 0.1
"""s; a longer gap between two samples makes the climb unknown."""


class RideMotion:
    """The climb since `begin`; it hears the samples of a chair that stands in a cabin."""

    def __init__(self) -> None:
        self._level: float | None = None
        self._heard_s = 0.0
        self._last_ns: int | None = None
        self._smooth = 0.0
        self._recent: deque[tuple[float, float]] = deque()  # dt, acceleration, of the moments before a ride is noticed
        self._z = self._v = self._quiet_s = self._ride_s = 0.0
        self._riding = False
        self._climbed = self._rode_s = 0.0
        self._broken = False

    @property
    def riding(self) -> bool:
        """Whether the car moves."""
        return self._riding

    @property
    def known(self) -> bool:
        """Whether the IMU has been heard all the time."""
        return self._level is not None and not self._broken and self._heard_s > 1.0

    @property
    def rode_s(self) -> float:
        """Duration [s] of the rides since `begin`."""
        return self._rode_s

    def begin(self) -> None:
        """Count the climb from here; the mean at rest stays known."""
        self._climbed = self._rode_s = 0.0
        self._riding, self._broken = False, False
        self._z = self._v = self._quiet_s = self._ride_s = 0.0
        self._recent.clear()

    def climb(self) -> tuple[float, float] | None:
        """Return the climb [m] since `begin` and its standard deviation [m]; None while it rides or is unknown."""
        if not self.known or self._riding:
            return None
        return self._climbed, SIGMA + SIGMA_PER_S * self._rode_s

    def hear(self, sample: ImuSample) -> None:
        """Take in a sample."""
        up = float(sample.accel[2])
        last_ns, self._last_ns = self._last_ns, sample.stamp_ns
        if last_ns is None or not math.isfinite(up):
            return
        dt = (sample.stamp_ns - last_ns) * 1e-9
        if not 0.0 < dt <= LONGEST_GAP_S:
            self._broken = True
            return
        self._heard_s += dt
        level = self._level = up if self._level is None else self._level
        a = up - level
        self._smooth += (a - self._smooth) * min(1.0, dt / SMOOTH_S)
        if self._riding:
            self._ride(dt, a)
            return
        self._level = level + a * dt / max(LEVEL_S, min(self._heard_s, LEVEL_S))
        self._recent.append((dt, up))
        while len(self._recent) > 1 and sum(each for each, _ in self._recent) > 2.5 * SMOOTH_S:
            self._recent.popleft()
        if abs(self._smooth) > STARTS and self._heard_s > 1.0:
            self._riding, self._z, self._v, self._quiet_s, self._ride_s = True, 0.0, 0.0, 0.0, 0.0
            # the first moments of the ride have leaked into the mean at rest
            for step, earlier in self._recent:
                self._add(step, earlier - level)
            self._recent.clear()

    def _add(self, dt: float, a: float) -> None:
        self._z += self._v * dt + a * dt * dt / 2
        self._v += a * dt
        self._ride_s += dt

    def _ride(self, dt: float, a: float) -> None:
        self._add(dt, a)
        quiet = abs(self._smooth) < ENDS and abs(self._v) < SLOW
        self._quiet_s = self._quiet_s + dt if quiet else 0.0
        if self._quiet_s >= REST_S:
            self._end()

    def stands(self) -> None:
        """Take the word of something else, such as the lift's open door, that the car stands: its ride is over.

        A speed that has drifted away would otherwise look like a ride at constant speed. The climb is unknown then, until
        the next `begin`.
        """
        if self._riding and self._level is not None:
            self._broken = self._broken or abs(self._v) >= SLOW
            self._end()
            self._level, self._smooth = self._level + self._smooth, 0.0

    def _end(self) -> None:
        # a speed that grew by a constant error has added half of its last value times the duration
        self._climbed += self._z - self._v * self._ride_s / 2
        self._rode_s += self._ride_s
        self._riding = False
