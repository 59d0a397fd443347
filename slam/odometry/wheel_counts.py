"""Encoder counts: continued over a restart of the counter from zero, and as paths of the wheels."""

from __future__ import annotations

import math

from waychair.calibration.chair_body import ChairBody
from waychair.types import WheelTicks

_SILENT_NS = 300_000_000
COUNTS = 2**32
"""Encoder counters wrap at this count."""


class WheelCounts:
    """Keeps the offsets to be added to the counts of two encoders of a chair."""

    def __init__(self, body: ChairBody) -> None:
        self.body = body
        self._before: WheelTicks | None = None
        self._added = (0, 0)

    def update(self, reading: WheelTicks) -> WheelTicks:
        """Return a reading whose counts continue those before.

        Counts near zero after a silence or with another clock, and far from the last ones, mean a restarted counter; the
        chair is assumed to have stood meanwhile. Otherwise the jump would be read as a motion of metres within a second.
        """
        before, self._before = self._before, reading
        if before is not None and abs(reading.stamp_ns - before.stamp_ns) > _SILENT_NS:
            was, now = (before.left, before.right), (reading.left, reading.right)
            turn = self.body.ticks_per_turn
            near_zero = max(map(abs, now)) < turn // 4
            jump = max(abs(_wrapped(a - b)) for a, b in zip(now, was, strict=True))
            if near_zero and jump > turn // 2:
                self._added = (
                    _wrapped(self._added[0] + was[0] - now[0]),
                    _wrapped(self._added[1] + was[1] - now[1]),
                )
        left, right = reading.left + self._added[0], reading.right + self._added[1]
        return WheelTicks(reading.stamp_ns, _wrapped(left), _wrapped(right))


def _wrapped(count: int) -> int:
    return (count + COUNTS // 2) % COUNTS - COUNTS // 2


def wheel_paths(before: WheelTicks, now: WheelTicks, body: ChairBody) -> tuple[float, float]:
    """Return the paths [m] of the left and right wheel between two readings; 32-bit counters may wrap."""
    per_count = math.tau * body.wheel_radius / body.ticks_per_turn
    return _wrapped(now.left - before.left) * per_count, _wrapped(now.right - before.right) * per_count
