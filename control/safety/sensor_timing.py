"""How often and how late a sensor's messages come, so that a slow lidar, a late one and a busy computer are told apart.

A single late scan pauses a drive, which goes on with the next one (F11). A lidar that is late again and again would
stop and start the chair for ever. So the times of the last seconds are judged together: either the chair drives slowly
enough for them, or the cause is named once.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from waychair.control.safety.collision_monitor import SCAN_MS
from waychair.control.safety.stops import Halt, halt
from waychair.topics import SCAN

WINDOW_S = 5.0
"""s; the times of so long are judged together. So a lidar that has recovered is trusted again after it."""

EPISODES, LATE_SHARE = 3, 0.5
"""A lidar that was too late so often, or for such a share of the time, is too slow; fewer are hiccups."""

LEAST_S = 1.0
"""s; the share is judged from so long a time on."""

SILENT_S = WINDOW_S / (EPISODES - 1)
"""s; after a longer silence a lidar begins anew: the slowest one whose scans are judged sends `EPISODES` of them in the window."""

SLOW_AGE_S = 0.26
"""s; scans that become older than this, between the 0.2 s of a usual lidar and the limit, slow a drive."""

WRONG_CLOCK_S = 1.5
"""s; no computer and no cable delays a scan by so much for long; its stamps are of another clock."""

HELD_UP_NS = 100_000_000
"""ns; a longer gap between two ticks, twice their period, means that the computer was busy."""

_TICK_S = 0.05


class SensorTiming:
    """The latest messages of one sensor: stamps, and the ticks at which they were first seen."""

    def __init__(self) -> None:
        self.stamp_ns: int | None = None
        self.arrived_ns: int | None = None
        """The tick at which the latest message was first seen; None before the first."""
        self._is_new = False
        self._delays: deque[tuple[int, float]] = deque()  # tick, and the age [s] at it

    def hear(self, stamp_ns: int) -> None:
        """Take in a message's stamp."""
        self._is_new = self._is_new or stamp_ns != self.stamp_ns
        self.stamp_ns = stamp_ns

    def tick(self, now_ns: int) -> None:
        """Note the messages since the last tick as arrived now."""
        if self._is_new and self.stamp_ns is not None:
            self.arrived_ns, self._is_new = now_ns, False
            self._delays.append((now_ns, (now_ns - self.stamp_ns) * 1e-9))
        _forget(self._delays, now_ns)

    def delay_s(self) -> float:
        """Return the usual age [s] of a message when it is first seen; 0 before the first. A negative one is ahead."""
        return float(np.median([delay for _, delay in self._delays])) if self._delays else 0.0

    def period_s(self) -> float:
        """Return the usual time [s] between two messages; +inf with fewer than two."""
        ticks = [tick for tick, _ in self._delays]
        return (ticks[-1] - ticks[0]) * 1e-9 / (len(ticks) - 1) if len(ticks) > 1 else math.inf

    def keeps_coming(self, now_ns: int, within_ns: int) -> bool:
        """Return whether messages keep coming, the last one within a time before now, whatever their stamps."""
        several = len(self._delays) >= EPISODES
        return several and self.arrived_ns is not None and 0 <= now_ns - self.arrived_ns <= within_ns


class ScanTiming(SensorTiming):
    """The timing of the lidar: whether its scans are too old to drive by again and again, and why."""

    def __init__(self) -> None:
        super().__init__()
        self._ticks: deque[tuple[int, bool]] = deque()  # tick, and whether the last scan was too old at it
        self._is_late = False

    def tick(self, now_ns: int) -> None:
        """Note the scans since the last tick as arrived now, and whether the latest one is too old."""
        before_ns = self.arrived_ns
        super().tick(now_ns)
        if self.stamp_ns is None:
            return
        if before_ns is not None and self.arrived_ns == now_ns and now_ns - before_ns > SILENT_S * 1e9:
            self._delays = deque([self._delays[-1]])  # it was silent, which is no slowness
            self._ticks.clear()
            self._is_late = False
        self._ticks.append((now_ns, abs(now_ns - self.stamp_ns) > SCAN_MS * 1_000_000))
        _forget(self._ticks, now_ns)
        late = np.array([late for _, late in self._ticks])
        episodes = int((late[1:] & ~late[:-1]).sum()) + int(late[0])
        lasts_s = (self._ticks[-1][0] - self._ticks[0][0]) * 1e-9
        several = len(self._delays) >= EPISODES
        again = episodes >= EPISODES or (lasts_s >= LEAST_S and late.mean() >= LATE_SHARE)
        again = again or self.period_s() > 1e-3 * SCAN_MS
        self._is_late = several and (again or (self._is_late and bool(late.any())))

    def oldest_s(self) -> float:
        """Return the age [s] that scans usually reach before the next one comes; 0 while there are too few."""
        if len(self._delays) <= EPISODES:
            return 0.0
        # the ticks see a scan up to one tick late, so the least delay is nearest to the true one
        return min(abs(delay) for _, delay in self._delays) + self.period_s()

    def halt(self, slow_computer: bool) -> Halt | None:
        """Return why the scans are too old again and again; None if they are not.

        `slow_computer`: the computer, and not the lidar, delays the scans.
        """
        if not self._is_late:
            return None
        delay, period, limit = self.delay_s(), self.period_s(), 1e-3 * SCAN_MS
        if abs(delay) > WRONG_CLOCK_S or delay < -_TICK_S:
            return halt("lidar_clock", difference_of(delay))
        if slow_computer:
            return halt("computer_slow", f"scans are {delay:.2f} s old when they arrive")
        if delay + 1.0 / SCAN.rate_hz <= limit:
            needed = math.ceil(1.0 / (limit - delay))
            return halt("lidar_slow", f"{1.0 / period:.1f} scans a second, and {needed} are needed")
        allowed = limit - min(period, 1.0 / SCAN.rate_hz)
        return halt("lidar_delayed", f"{delay:.2f} s after their first beam, and {allowed:.2f} s are allowed")


def difference_of(age_s: float) -> str:
    """Return how far a clock is behind the chair's by the age [s] of its messages, negative ahead of it."""
    return f"{abs(age_s):.1f} s {'ahead of' if age_s < 0.0 else 'behind'} the chair's"


class TickGaps:
    """The times in which the control loop was held up."""

    def __init__(self) -> None:
        self._ticked_ns: int | None = None
        self._gaps: deque[tuple[int, int]] = deque()  # end and length of a gap [ns]

    def tick(self, now_ns: int) -> None:
        """Note a tick."""
        gap_ns = 0 if self._ticked_ns is None else now_ns - self._ticked_ns
        self._ticked_ns = now_ns
        if gap_ns > HELD_UP_NS:
            self._gaps.append((now_ns, gap_ns))
        _forget(self._gaps, now_ns)

    def explain(self, now_ns: int, silent_ns: int) -> bool:
        """Return whether gaps make up at least half of a sensor's silence until now."""
        held_up_ns = sum(length_ns for end_ns, length_ns in self._gaps if now_ns - end_ns <= silent_ns)
        return 0 < silent_ns <= 2 * held_up_ns

    def often(self) -> bool:
        """Return whether the control loop was held up again and again."""
        return len(self._gaps) >= EPISODES


def _forget(noted: deque[tuple[int, float]] | deque[tuple[int, bool]] | deque[tuple[int, int]], now_ns: int) -> None:
    """Drop entries of the past window, and those of a clock that went back."""
    while noted and not 0 <= now_ns - noted[0][0] <= WINDOW_S * 1e9:
        noted.popleft()
