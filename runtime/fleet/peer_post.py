"""The output of a peer's step: its messages, its log, the memory of the peers that are counted, and how long its own Requests wait."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from waychair.planning.fleet.peers.peer import Peer, PeerStep
from waychair.runtime.fleet.audit_file import AuditFile
from waychair.runtime.fleet.electorate_file import keep_electorate
from waychair.runtime.fleet.network.transport import PeerTransport


class FleetTransport(PeerTransport, Protocol):
    """A transport that also carries messages beside the peers' own."""

    def received_aside(self) -> list[tuple[int, bytes]]:
        """Return these messages since the last call, with the number of each sender as the network knows it."""


MOST_MEASURES = 10_000
"""Measures that are kept, the latest ones: on a real chair nobody may take them."""


WAITED_NS = 200_000_000
"""ns that a step may have to wait for another thread's, which may make a plan meanwhile."""


@dataclass(frozen=True, slots=True)
class Measures:
    """A member's measures since somebody took them: ms from a Request to its first answer, ms of age of others' States.

    The ages hold on one computer, whose programs have one clock.
    """

    answers_ms: list[float]
    ages_ms: list[float]


class PeerPost:
    """The outside of one chair's peer: its network, its log and its memory, see `FleetMember`."""

    def __init__(self, transport: FleetTransport, log: AuditFile | None, memory: Path | None) -> None:
        self.transport = transport
        self.now_ns = 0
        """The time of the last step."""
        self._log, self._memory = log, memory
        self._asked_ns: int | None = None  # since when a Request has been without an answer
        self._answers_ms: deque[float] = deque(maxlen=MOST_MEASURES)
        self._ages_ms: deque[float] = deque(maxlen=MOST_MEASURES)

    def begin(self, now_ns: int) -> int:
        """Return the time of a step that begins now: not before the last one, if that was another thread's for which it waited.

        A clock that ran back farther is passed on, as the peer then forgets its leases.
        """
        waited = 0 <= self.now_ns - now_ns <= WAITED_NS
        self.now_ns = self.now_ns if waited else now_ns
        return self.now_ns

    def forget_request(self) -> None:
        """Measure no answer to a wish that is no more."""
        self._asked_ns = None

    def pass_on(self, step: PeerStep) -> tuple[str, ...]:
        """Send a step's messages, once what must be remembered is on the disk; return sentences for people."""
        said = [keep_electorate(self._memory, step.electorate)]
        for to, kind, data in step.send:
            self.transport.send(to, kind, data)
            if kind == "request" and self._asked_ns is None:
                self._asked_ns = self.now_ns
        said += [] if self._log is None else [self._log.add(step.records, self.now_ns)]
        return (*step.notices, *filter(None, said))

    def measure(self, peer: Peer, wish: int) -> None:
        """Note how old the others' States are now, and how long the own wish of this number took to be answered."""
        self._ages_ms += [(self.now_ns - each.sent_ns) / 1e6 for each in peer.known.values()]
        if self._asked_ns is not None and wish and peer.answered == wish:
            self._answers_ms.append((self.now_ns - self._asked_ns) / 1e6)
            self._asked_ns = None

    def taken_measures(self) -> Measures:
        """Return the measures since the last call."""
        found = Measures(list(self._answers_ms), list(self._ages_ms))
        self._answers_ms.clear()
        self._ages_ms.clear()
        return found
