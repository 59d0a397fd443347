"""A timer whose ticks come a little behind what they act on, so that news do not wait for most of a period."""

from __future__ import annotations


class TickPhase:
    """Moves the ticks of a timer, a bit at a time, to just behind regular news."""

    def __init__(self, period_ns: int, behind_ns: int = 6_000_000, most_ns: int = 2_000_000) -> None:
        """`behind_ns`: from the news to the tick, so that news which are late by less are not missed; `most_ns`: by
        which a period may be changed."""
        self._period_ns, self._behind_ns, self._most_ns = period_ns, behind_ns, most_ns
        self._ticked_ns: int | None = None

    def ticked(self, now_ns: int) -> None:
        """A tick begins."""
        self._ticked_ns = now_ns

    def came(self, now_ns: int) -> int:
        """News have come: how long the next period should be [ns]."""
        if self._ticked_ns is None:
            return self._period_ns
        wait_ns = (self._ticked_ns - now_ns) % self._period_ns
        late_ns = wait_ns - self._behind_ns
        if late_ns > self._period_ns // 2:  # the tick before was a bit too early
            late_ns -= self._period_ns
        return self._period_ns - min(max(late_ns // 2, -self._most_ns), self._most_ns)
