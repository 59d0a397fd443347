"""Phase-locking a timer to periodic messages: its ticks follow a message after a short delay, not after a long wait."""

from __future__ import annotations


class TickPhase:
    """Moves the ticks of a timer, in small steps, to just after periodic messages."""

    def __init__(self, period_ns: int, delay_ns: int = 6_000_000, max_change_ns: int = 2_000_000) -> None:
        """Take the period, the delay `delay_ns` from a message to the tick, and the largest change `max_change_ns` of a period.

        The delay allows for jitter: a message that is late by less is not missed.
        """
        self._period_ns, self._delay_ns, self._max_change_ns = period_ns, delay_ns, max_change_ns
        self._ticked_ns: int | None = None

    def ticked(self, now_ns: int) -> None:
        """Note the time of a tick."""
        self._ticked_ns = now_ns

    def message_arrived(self, now_ns: int) -> int:
        """Note the arrival of a message, and return the next period [ns]."""
        if self._ticked_ns is None:
            return self._period_ns
        wait_ns = (self._ticked_ns - now_ns) % self._period_ns
        late_ns = wait_ns - self._delay_ns
        if late_ns > self._period_ns // 2:  # the tick before was slightly too early
            late_ns -= self._period_ns
        return self._period_ns - min(max(late_ns // 2, -self._max_change_ns), self._max_change_ns)
