"""Stamps that begin anew in the middle of a bag, as where a simulator is reset or a clock is set, are continued.

The time of recording tells that a message came after another one although its stamp is earlier. A single odd stamp is no
new clock: several messages of the topic in a row must agree.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from statistics import median
from typing import Any

from rosbags.interfaces import Connection

from waychair.recordings.bags.ros_transforms import stamp_ns

Logged = tuple[Connection, int, Any]
"""A message's connection, its time of recording [ns], and the message."""

_LEAST_NS = 2_000_000_000  # a smaller step of the stamps against the time of recording is a late message
_IN_A_ROW = 5  # messages of a topic that agree on a new clock
_SAME_NS = 500_000_000  # clocks of two topics that differ by less are one clock
_SECOND = 1_000_000_000


@dataclass(slots=True)
class _TopicClock:
    """The clock of a topic: what is added to its stamps, its newest message, and messages on another clock."""

    shift_ns: int = 0
    stamp_ns: int | None = None
    log_ns: int = 0
    waiting: list[tuple[Logged, int]] = field(default_factory=list)


class ContinuedClock:
    """Passes messages on with ascending stamps; `resets` are the times of recording [ns] of new clocks, and their steps
    [ns]."""

    def __init__(self) -> None:
        self.resets: list[tuple[int, int]] = []
        self._topics: dict[str, _TopicClock] = {}

    def continued(self, messages: Iterator[Logged]) -> Iterator[Logged]:
        """Yield the messages, each topic in its order, with stamps that continue those before."""
        for logged in messages:
            connection, log_ns, message = logged
            if not hasattr(message, "header"):
                yield self._transforms(logged)
                continue
            clock = self._topics.setdefault(connection.topic, _TopicClock())
            stamp = stamp_ns(message.header.stamp) + clock.shift_ns
            off = 0 if clock.stamp_ns is None else _off(stamp - clock.stamp_ns, log_ns - clock.log_ns)
            if off == 0:
                yield from _released(clock)
                clock.stamp_ns, clock.log_ns = stamp, log_ns
                _shift(message.header.stamp, clock.shift_ns)
                yield logged
                continue
            clock.waiting.append((logged, off))
            offs = [other for _, other in clock.waiting]
            if len(offs) >= _IN_A_ROW:
                if max(offs) - min(offs) < _LEAST_NS:
                    yield from self._on_new_clock(clock, round(median(offs)))
                else:
                    yield from _released(clock)
        for clock in self._topics.values():
            yield from _released(clock)

    def _on_new_clock(self, clock: _TopicClock, step_ns: int) -> Iterator[Logged]:
        """Yield the waiting messages with stamps of a new clock that is `step_ns` behind."""
        first_ns = clock.waiting[0][0][1]
        known = next(
            (
                step
                for log_ns, step in self.resets
                if abs(step - step_ns) < _SAME_NS and abs(log_ns - first_ns) < _LEAST_NS
            ),
            None,
        )
        if known is None:
            self.resets.append((first_ns, step_ns))
        clock.shift_ns += step_ns if known is None else known
        waiting, clock.waiting = clock.waiting, []
        for (connection, log_ns, message), _ in waiting:
            _shift(message.header.stamp, clock.shift_ns)
            clock.stamp_ns, clock.log_ns = stamp_ns(message.header.stamp), log_ns
            yield connection, log_ns, message

    def _transforms(self, logged: Logged) -> Logged:
        """Return a message of transforms on the newest clock."""
        shift = sum(step for _, step in self.resets)
        if shift:
            for transform in logged[2].transforms:
                if stamp_ns(transform.header.stamp):
                    _shift(transform.header.stamp, shift)
        return logged


def _off(stamped_ns: int, logged_ns: int) -> int:
    """Return by how much [ns] a stamp is behind the one that the time of recording suggests; 0 within what is usual."""
    set_back, set_on = stamped_ns < -_LEAST_NS, stamped_ns > max(logged_ns, 0) + _LEAST_NS
    return logged_ns - stamped_ns if set_back or set_on else 0


def _released(clock: _TopicClock) -> Iterator[Logged]:
    """Yield waiting messages as they are: their stamps were odd ones, and no new clock."""
    waiting, clock.waiting = clock.waiting, []
    for (connection, log_ns, message), _ in waiting:
        _shift(message.header.stamp, clock.shift_ns)
        yield connection, log_ns, message


def _shift(stamp: Any, shift_ns: int) -> None:
    if shift_ns:
        seconds, stamp.nanosec = divmod(stamp_ns(stamp) + shift_ns, _SECOND)
        stamp.sec = seconds


def clock_warning(step_ns: int) -> str:
    """Return the sentence about stamps that are set back by so much [ns]."""
    way = "back" if step_ns > 0 else "on"
    return (
        f"the stamps are set {way} by {abs(step_ns) * 1e-9:.1f} s in the middle of the bag, as where a simulator is reset or a "
        "clock is set: they are continued by the time of recording"
    )
