"""Sets of messages that belong together, one of each topic: exactly, or as nearly at one time as there are any.

Both kinds are those of Pai et al. (2026), section 3.2.1. Exact: messages of one sensor that carry the same stamp, such
as the two pictures of a stereo camera. Approximate: of different sensors, the sets whose stamps lie closest together,
found as message_filters of ROS does (its adaptive algorithm): the latest among the oldest messages of all topics is the
pivot, and of all sets that hold the pivot the one with the smallest spread is given out. Sets never cross.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar


class Stamped(Protocol):
    """Anything with a time."""

    @property
    def stamp_ns(self) -> int:
        """When it was measured [ns]."""


M = TypeVar("M", bound=Stamped)


@dataclass(slots=True)
class Counts:
    """What became of a topic's messages: `received` is the sum of all others but `out_of_order`, and of those waiting.

    `used`: given out. `unmatched`: passed over, because others belonged together. `dropped`: the queue was full.
    `late`: what belongs after it was given out already. `repeated`: of a stamp that was there. `out_of_order`: came
    after a later one, and was put in its place if it was not late.
    """

    received: int = 0
    used: int = 0
    unmatched: int = 0
    dropped: int = 0
    late: int = 0
    repeated: int = 0
    out_of_order: int = 0


class MessageQueue(Generic[M]):
    """The waiting messages of one topic in the order of their stamps, at most `most`, and their counts."""

    def __init__(self, most: int) -> None:
        self.waiting: list[M] = []
        self.counts = Counts()
        self.newest_ns: int | None = None
        self._most = most
        self._passed_ns: int | None = None  # nothing up to this can be of use any more
        self._left_ns: int | None = None  # stamp of the last message that was given out or passed over

    def put(self, message: M) -> None:
        """Take a message in, unless it is late or repeated; the oldest makes room for it."""
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
        """The message at `index`; those before it are passed over."""
        message = self.waiting[index]
        self.counts.used += 1
        self.counts.unmatched += index
        self._leave(index + 1)
        return message

    def take_until(self, stamp_ns: int) -> list[M]:
        """All messages up to a stamp; what comes later with such a stamp will be late."""
        count = bisect_left(self.waiting, stamp_ns + 1, key=lambda other: other.stamp_ns)
        taken = self.waiting[:count]
        self.counts.used += count
        self._leave(count)
        self._passed_ns = stamp_ns if self._passed_ns is None else max(self._passed_ns, stamp_ns)
        return taken

    def pass_over(self) -> None:
        """Give up the oldest message."""
        self.counts.unmatched += 1
        self._leave(1)

    def clear(self) -> None:
        """Begin again, as when the clock was set back."""
        self.counts.dropped += len(self.waiting)
        self.waiting, self.newest_ns, self._passed_ns, self._left_ns = [], None, None, None

    def _leave(self, count: int) -> None:
        if count:
            self._passed_ns = self._left_ns = self.waiting[count - 1].stamp_ns
            del self.waiting[:count]


class MessageSets(ABC, Generic[M]):
    """Keeps what has no partners yet; topics are told apart by name."""

    def __init__(self, topics: Sequence[str], queue: int = 10) -> None:
        """At most `queue` messages wait of each topic."""
        self.queues: Mapping[str, MessageQueue[M]] = {topic: MessageQueue[M](queue) for topic in topics}

    def add(self, topic: str, message: M) -> tuple[tuple[M, ...], ...]:
        """The sets, in the order of time, that this message completes; each in the order of the topics.

        Raises:
            KeyError: the topic is not one of them.
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
        """Forget what waits."""
        for queue in self.queues.values():
            queue.clear()

    @abstractmethod
    def _next(self) -> tuple[int, ...] | None:
        """Places in the queues, none of which is empty, of the next set; None: not yet; (): what cannot be is gone."""


class ExactSets(MessageSets[M]):
    """Sets whose messages have the same stamp."""

    def _next(self) -> tuple[int, ...] | None:
        stamps = [[message.stamp_ns for message in queue.waiting] for queue in self.queues.values()]
        common = set.intersection(*map(set, stamps))
        return tuple(own.index(min(common)) for own in stamps) if common else None


class ApproximateSets(MessageSets[M]):
    """Sets whose stamps lie closest together.

    A set is given out as soon as none that is still to come can be better, which `least_gaps_ns` makes earlier: how far
    two messages of a topic are apart at least, in the order of the topics. Of two sets the earlier is preferred, unless
    the later's begin gains more than 1 + `age_penalty` times what its end loses. No set spreads over more than
    `max_spread_ns`.
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
            # Every other set with the pivot begins later: the topic that is first now must move on.
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
