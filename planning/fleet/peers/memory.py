"""The memory of a peer: when things happened last, and the news of others."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

from waychair.planning.fleet.peers import messages
from waychair.planning.fleet.peers.closures import Closures
from waychair.planning.fleet.peers.decision import SILENT_NS
from waychair.planning.fleet.peers.election import Known
from waychair.planning.fleet.peers.messages import Answer, Letter, Reader, State

STATE_NS, HELLO_NS, REQUEST_NS = 200_000_000, 2_000_000_000, 400_000_000
"""A State is sent at least so often, a Hello, and an unanswered Request."""

BOOT_NS = 3_000_000_000
"""A number belongs to another boot only after so long without the one before."""

MOST_IN_STEP = 30
"""Messages of one sender that a step reads; a warden of a hundred chairs sends each one two."""


@dataclass(slots=True)
class Times:
    """When things happened last, by the own clock [ns]."""

    now: int = 0
    start: int = 0
    state: int = -STATE_NS
    hello: int = -HELLO_NS
    request: int = -REQUEST_NS
    warden: int = 0
    """a granting warden was followed"""
    alone: int | None = None
    """alone mode was announced"""


@dataclass(slots=True)
class HeardOthers:
    """What was heard of others.

    Attributes:
        closures: the sections that are seen shut, with the own reports.
        known: the last State of each peer.
        seqs: the last sequence number of each boot.
        dead: boots that were followed by others of the same number.
        uptimes: boot and uptime of each peer, by its Hello.
        doubled: when a second boot of a number was first heard beside another one.
        answer: the last good answer, with the sequence number of its letter.
    """

    closures: Closures
    known: dict[int, Known] = field(default_factory=dict)
    seqs: dict[int, int] = field(default_factory=dict)
    dead: set[int] = field(default_factory=set)
    uptimes: dict[int, int] = field(default_factory=dict)
    doubled: dict[int, int] = field(default_factory=dict)
    answer: Answer | None = None

    def bearable(self, letters: Sequence[tuple[int, bytes]], reader: Reader) -> list[tuple[int, bytes]]:
        """Return the last messages of each sender, as many as it sends in a step at most: one that floods drowns nobody."""
        if len(letters) <= MOST_IN_STEP:
            return list(letters)
        counts: dict[int, int] = {}
        found = []
        for who, data in reversed(letters):
            counts[who] = counts.get(who, 0) + 1
            if counts[who] <= MOST_IN_STEP:
                found.append((who, data))
        reader.count("flood", len(letters) - len(found))
        return found[::-1]

    def take_state(self, letter: Letter, state: State, now_ns: int) -> None:
        """Keep a State that is newer than the last of its sender; another boot is heard once the one before is silent."""
        known = self.known.get(letter.sender)
        if known is not None and known.boot != letter.boot:
            if now_ns - known.heard_ns < BOOT_NS:
                self.doubled.setdefault(letter.sender, now_ns)
                return
            self.dead.add(known.boot)
        elif known is not None and letter.seq <= self.seqs.get(letter.boot, -1):
            return
        if known is None or known.boot != letter.boot:
            self.doubled.pop(letter.sender, None)
        self.seqs[letter.boot] = letter.seq
        self.known[letter.sender] = Known(letter.sender, letter.boot, letter.sent_ns, now_ns, state)

    def misses_somebody(self, others: Collection[int], now_ns: int) -> bool:
        """Return whether one of the other chairs may be driving by its own eyes."""
        for number in others:
            known = self.known.get(number)
            if known is None or (now_ns - known.heard_ns > SILENT_NS and not known.state.parked):
                return True
            if known.state.mode != messages.IN_ORDER:
                return True
        return False
