"""Synchronisation of messages: sets of one message per topic, with equal or with nearest stamps.

Both kinds are those of Pai et al. (2026), section 3.2.1. Exact: messages of one sensor with the same stamp, such as the
two pictures of a stereo camera. Approximate: messages of several sensors with the nearest stamps, by the adaptive
algorithm of ROS's message_filters. The latest among the oldest messages of all topics is the pivot; of all sets with
the pivot, the one with the smallest spread is emitted. Sets never cross.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar


class Stamped(Protocol):
    """A message with a stamp."""

    @property
    def stamp_ns(self) -> int:
        """Time of the measurement [ns]."""


M = TypeVar("M", bound=Stamped)


@dataclass(slots=True)
class MessageCounts:
    """Outcomes of a topic's messages; `received` is the sum of waiting messages and all counts but `out_of_order`.

    `used`: emitted in a set. `unmatched`: skipped for a better match. `dropped`: the queue was full. `late`: a later
    message was already emitted. `repeated`: the stamp was known. `out_of_order`: received after a later one, and sorted
    in unless late.
    """

    received: int = 0
    used: int = 0
    unmatched: int = 0
    dropped: int = 0
    late: int = 0
    repeated: int = 0
    out_of_order: int = 0


class MessageQueue(Generic[M]):
    """The waiting messages of one topic, at most `most`, in the order of their stamps, and their counts."""

    def __init__(self, most: int) -> None:
        self.waiting: list[M] = []
        self.counts = MessageCounts()
        self.newest_ns: int | None = None
        self._most = most
        self._passed_ns: int | None = None  # messages up to this stamp are late
        self._left_ns: int | None = None  # stamp of the last message emitted or skipped

    def put(self, message: M) -> None:
        """Take in a message unless it is late or repeated; a full queue drops its oldest."""
        counts, stamp = self.counts, message.stamp_ns
        counts.received += 1
        if self.newest_ns is not None and stamp < self.newest_ns:
            counts.out_of_order += 1
        if self._passed_ns is not None and stamp <= self._passed_ns:
            counts.repeated += stamp == self._left_ns
            counts.late += stamp != self._left_ns
            return
        at = bisect_left(self.waiting, stamp, key=lambda other: other.stamp_ns)
        if at < len(self.waiting) and self.waiting[at].stamp_ns == stamp:
            counts.repeated += 1
            return
        self.waiting.insert(at, message)
        self.newest_ns = stamp if self.newest_ns is None else max(self.newest_ns, stamp)
        if len(self.waiting) > self._most:
            self.counts.dropped += 1
            self._leave(1)

    def take(self, index: int) -> M:
        """Return the message at `index`, and skip those before it."""
        message = self.waiting[index]
        self.counts.used += 1
        self.counts.unmatched += index
        self._leave(index + 1)
        return message

    def take_until(self, stamp_ns: int) -> list[M]:
        """Return all messages up to a stamp; messages with such a stamp are late from now on."""
        count = bisect_left(self.waiting, stamp_ns + 1, key=lambda other: other.stamp_ns)
        taken = self.waiting[:count]
        self.counts.used += count
        self._leave(count)
        self._passed_ns = stamp_ns if self._passed_ns is None else max(self._passed_ns, stamp_ns)
        return taken

    def pass_over(self) -> None:
        """Skip the oldest message."""
        self.counts.unmatched += 1
        self._leave(1)

    def clear(self) -> None:
        """Start again, as after the clock was set back."""
        self.counts.dropped += len(self.waiting)
        self.waiting, self.newest_ns, self._passed_ns, self._left_ns = [], None, None, None

    def _leave(self, count: int) -> None:
        if count:
            self._passed_ns = self._left_ns = self.waiting[count - 1].stamp_ns
            del self.waiting[:count]


class MessageSets(ABC, Generic[M]):
    """Queues of messages by topic, from which complete sets are emitted."""

    def __init__(self, topics: Sequence[str], queue: int = 10) -> None:
        """Keep at most `queue` waiting messages of each topic."""
        self.queues: Mapping[str, MessageQueue[M]] = {topic: MessageQueue[M](queue) for topic in topics}

    def add(self, topic: str, message: M) -> tuple[tuple[M, ...], ...]:
        """Return the sets completed by this message in order of time, each in the order of the topics.

        Raises:
            KeyError: the topic is unknown.
        """
        self.queues[topic].put(message)
        found = []
        while all(queue.waiting for queue in self.queues.values()):
            indices = self._next()
            if indices is None:
                break
            if indices:
                found.append(tuple(q.take(at) for q, at in zip(self.queues.values(), indices, strict=True)))
        return tuple(found)

    def clear(self) -> None:
        """Drop all waiting messages."""
        for queue in self.queues.values():
            queue.clear()

    @abstractmethod
    def _next(self) -> tuple[int, ...] | None:
        """Return the next set as indices into the queues, none empty; None: not yet; (): a message was skipped."""


class ExactSets(MessageSets[M]):
    """Sets whose messages have the same stamp."""

    def _next(self) -> tuple[int, ...] | None:
        stamps = [[message.stamp_ns for message in queue.waiting] for queue in self.queues.values()]
        common = set.intersection(*map(set, stamps))
        return tuple(own.index(min(common)) for own in stamps) if common else None


class ApproximateSets(MessageSets[M]):
    """Sets with the nearest stamps.

    A set is emitted as soon as no later one can be better. `least_gaps_ns`, the least gap between two messages of each
    topic in the order of the topics, makes this earlier. Of two sets the earlier is preferred, unless the later one's
    begin gains more than 1 + `age_penalty` times the loss at its end. No set spreads over more than `max_spread_ns`.
    """

    def __init__(
        self,
        topics: Sequence[str],
        queue: int = 10,
        *,
        max_spread_ns: float = math.inf,
        age_penalty: float = 0.0,
        least_gaps_ns: Sequence[int] | None = None,
    ) -> None:
        super().__init__(topics, queue)
        self._max_spread_ns = max_spread_ns
        self._age_penalty = age_penalty
        self._least_gaps_ns = tuple(least_gaps_ns or (0,) * len(topics))

    def _next(self) -> tuple[int, ...] | None:
        queues = list(self.queues.values())
        pivot = max(queue.waiting[0].stamp_ns for queue in queues)
        at = [0] * len(queues)
        best: tuple[int, ...] = ()
        best_cost = math.inf
        while True:
            stamps = [queue.waiting[index].stamp_ns for queue, index in zip(queues, at, strict=True)]
            begin, end = min(stamps), max(stamps)
            if end - begin <= self._max_spread_ns and (cost := self._cost(begin - pivot, end - pivot)) < best_cost:
                best, best_cost = tuple(at), cost
            if begin == pivot:
                break
            # Every other set with the pivot begins later: advance the topic that is first now.
            first = stamps.index(begin)
            at[first] += 1
            if at[first] == len(queues[first].waiting):
                soonest = max(end, begin + self._least_gaps_ns[first])
                if soonest - pivot <= self._max_spread_ns and self._cost(0, soonest - pivot) < best_cost:
                    return None
                break
        if not best:
            next(queue for queue in queues if queue.waiting[0].stamp_ns == pivot).pass_over()
        return best

    def _cost(self, begin_ns: int, end_ns: int) -> float:
        return (1.0 + self._age_penalty) * end_ns - begin_ns
