"""What a peer remembers: when things happened last, and what it has heard of others."""

from __future__ import annotations

from dataclasses import dataclass, field

from waychair.planning.fleet.peers.closures import Closures
from waychair.planning.fleet.peers.election import Known
from waychair.planning.fleet.peers.messages import Answer

STATE_NS, HELLO_NS, REQUEST_NS = 200_000_000, 2_000_000_000, 400_000_000
"""A State is sent at least so often, a Hello, and an unanswered Request."""


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
class Heard:
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
