"""A network that loses, delays, doubles and reorders by a seed, falls into parts, and whose computers' clocks drift.

It carries bytes by address and knows no message. All is drawn from one stream in the order of the calls, so that the same
calls meet the same faults.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

_PPM = 1e-6

_DRAWS = 4096
"""Random numbers that are drawn at once."""


@dataclass(frozen=True, slots=True)
class NetworkFaults:
    """How bad a network is.

    Attributes:
        loss: share of messages that are lost.
        doubled: share of messages that come twice.
        delay_ms: mean of the delay, which is exponential beyond a millisecond: messages overtake each other.
        late: share of messages that take up to `latest_ms` instead.
        latest_ms: the longest delay.
        drift_ppm: clocks run up to so much too fast or too slow.
    """

    loss: float = 0.0
    doubled: float = 0.0
    delay_ms: float = 3.0
    late: float = 0.0
    latest_ms: float = 2_000.0
    drift_ppm: float = 0.0


@dataclass
class SeededNetwork:
    """Messages under way between numbered computers."""

    seed: int
    faults: NetworkFaults = NetworkFaults()
    sent: int = 0
    lost: int = 0
    _queue: list[tuple[int, int, int, bytes]] = field(default_factory=list)
    _part_of: dict[int, int] = field(default_factory=dict)
    _deaf: set[tuple[int, int]] = field(default_factory=set)
    _inbox: dict[int, list[tuple[int, bytes]]] = field(default_factory=dict)
    _rates: dict[int, tuple[float, int]] = field(default_factory=dict)
    _drawn: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng([self.seed, 0xF1EE7])

    def _draw(self) -> float:
        if not self._drawn:
            self._drawn = self._rng.random(_DRAWS).tolist()
        return self._drawn.pop()

    def send(self, now_ns: int, source: int, others: Iterable[int], data: bytes) -> None:
        """Send bytes to some computers; each copy meets its own fate."""
        faults = self.faults
        for other in others:
            self.sent += 1
            if self._draw() < faults.loss:
                self.lost += 1
                continue
            for _ in range(2 if self._draw() < faults.doubled else 1):
                delay_ms = 1.0 - faults.delay_ms * float(np.log1p(-self._draw()))
                if faults.late and self._draw() < faults.late:
                    delay_ms = self._draw() * faults.latest_ms
                due = now_ns + int(1e6 * min(delay_ms, faults.latest_ms))
                heapq.heappush(self._queue, (due, self.sent, (source << 16) | other, data))

    def received(self, now_ns: int, own: int) -> list[tuple[int, bytes]]:
        """Return what has come to a computer since the last call, with its source; a message between two parts is lost."""
        while self._queue and self._queue[0][0] <= now_ns:
            _, _, link, data = heapq.heappop(self._queue)
            source, other = link >> 16, link & 0xFFFF
            if self._part_of.get(source, 0) != self._part_of.get(other, 0) or (source, other) in self._deaf:
                self.lost += 1
                continue
            self._inbox.setdefault(other, []).append((source, data))
        return self._inbox.pop(own, [])

    def part(self, parts: Iterable[Iterable[int]]) -> None:
        """Cut the network into parts; computers that are in none of them are together in a further one."""
        self._part_of = {each: k for k, part in enumerate(parts, start=1) for each in part}

    def deafen(self, links: Iterable[tuple[int, int]]) -> None:
        """Cut links in one direction each, from the first computer to the second."""
        self._deaf = set(links)

    def heal(self) -> None:
        """Join all parts and links again."""
        self._part_of, self._deaf = {}, set()

    def forget(self, own: int) -> None:
        """Lose what has come to a computer that crashed and was not read."""
        self._inbox.pop(own, None)

    def clock_ns(self, now_ns: int, own: int) -> int:
        """Return the monotonic clock of a computer: it begins anywhere and drifts."""
        if own not in self._rates:
            rng = np.random.default_rng([self.seed, own, 0xC10C])
            drift = float(rng.uniform(-1.0, 1.0)) * self.faults.drift_ppm * _PPM
            self._rates[own] = (drift, int(rng.integers(10**12, 10**15)))
        drift, offset = self._rates[own]
        return offset + now_ns + int(drift * now_ns)
