"""Who orders: the election of a district's warden by the peers that hear each other, without clocks that agree.

A peer follows one warden at a time, in one epoch, and says so in its States. A warden counts a follower only for a time from
when it sent the State that the follower echoes, by its own clock. A peer that has lost its warden follows another one only after
that time. So at most one warden counts a majority at any moment, as two majorities share a peer. An epoch that a
peer has left it never follows again.
(The terms are those of D. Ongaro and J. Ousterhout, "In search of an understandable consensus algorithm", 2014; the lease of the
leader is that of C. Gray and D. Cheriton, SOSP 1989.)
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from waychair.planning.fleet.peers.messages import Electorate, State, Term

FOLLOWED_NS = 1_000_000_000
"""A warden counts a follower for so long; five States of 0.2 s, of which 0.3 in 1000 windows lose all at 20 % loss."""

EPOCHS = 1_000
"""Epochs of two wardens are never equal: each ends in its warden's number, which is below this."""

DRIFT_NS = 1_000_000
"""More than two clocks part in the longest of these times: 200 ppm each, of 2 s."""


@dataclass(frozen=True, slots=True)
class Known:
    """The last State of a peer, with its boot and clock [ns], and when it was heard by the own clock."""

    number: int
    boot: int
    sent_ns: int
    heard_ns: int
    state: State


def ranked(district: str, peers: Iterable[int]) -> list[int]:
    """Return peers by rendezvous hashing: the first is the district's warden, the next one takes over.

    (D. Thaler and C. Ravishankar, IEEE/ACM Transactions on Networking 6, 1998.)
    """
    return sorted(peers, key=lambda peer: hashlib.sha256(f"{district}\x1e{peer}".encode()).digest(), reverse=True)


def is_majority(electorate: Electorate, voters: Iterable[int]) -> bool:
    """Return whether voters are more than half of an electorate."""
    return 2 * len(set(electorate.members) & set(voters)) > len(electorate.members)


@dataclass(frozen=True, slots=True)
class Allegiance:
    """The warden that a peer follows, and the one that it may follow next.

    Attributes:
        term: the term that it follows, or None.
        heard_ns: when that warden was last heard.
        echo_ns: when that State was sent, by the warden's clock.
        left: the highest epoch that it has left.
        free_ns: from when on it may follow another warden.
    """

    term: Term | None = None
    heard_ns: int = 0
    echo_ns: int = 0
    left: int = 0
    free_ns: int = 0


@dataclass(frozen=True, slots=True)
class Voter:
    """A peer that votes: its number and boot, the district, and the newest electorate that it knows."""

    number: int
    boot: int
    district: str
    electorate: Electorate


def followed(own: Voter, before: Allegiance, known: Mapping[int, Known], now_ns: int) -> Allegiance:
    """Return whom a peer follows now, from the last States of all others.

    A follower stays as long as it hears its warden in that epoch. It moves with a warden that has gone to a new epoch itself.
    Else it follows the warden of the highest epoch that it hears, and stands for warden itself if it is the first of all that
    it hears and nobody else has an epoch that it may follow. It neither follows a warden with an older electorate than its own,
    nor stands beside a peer with a newer one.
    """
    live = {each.number: each for each in known.values() if now_ns - each.heard_ns <= FOLLOWED_NS}
    version = own.electorate.version
    abreast = {number: each for number, each in live.items() if each.state.electors >= version}
    is_behind = any(each.state.electors > version for each in live.values())
    now = before
    term = before.term
    if term is not None and term.warden != own.number:
        warden = live.get(term.warden)
        if warden is not None and warden.boot == term.boot and warden.state.term == term.epoch:
            return Allegiance(term, warden.heard_ns, warden.sent_ns, before.left, before.free_ns)
        free_ns = before.heard_ns + FOLLOWED_NS + DRIFT_NS
        if warden is not None and warden.boot == term.boot:
            free_ns = now_ns  # it has given that epoch up itself
        now = Allegiance(None, 0, 0, max(before.left, term.epoch), free_ns)
    elif term is not None:
        rival = _highest(abreast, term.epoch)
        if (rival is None and not is_behind) or _counts(own, term, live, now_ns):
            return before
        # nobody is ordered by this peer any more, and another one is further
        now = Allegiance(None, 0, 0, max(before.left, term.epoch), now_ns + FOLLOWED_NS + DRIFT_NS)
    if now_ns < now.free_ns:
        return now
    rival = _highest(abreast, now.left)
    if rival is not None:
        new = Term(rival.number, rival.boot, rival.state.term)
        return Allegiance(new, rival.heard_ns, rival.sent_ns, now.left, now.free_ns)
    candidates = {own.number, *abreast}
    candidates = candidates & set(own.electorate.members) or candidates
    if not is_behind and ranked(own.district, candidates)[0] == own.number:
        return standing(own, now, known)
    return now


def standing(own: Voter, before: Allegiance, known: Mapping[int, Known]) -> Allegiance:
    """Return the allegiance of a peer that stands for warden in an epoch above all that it has heard of."""
    epochs = [before.left, own.electorate.epoch]
    epochs += [max(each.state.left, each.state.term, each.state.electors[0]) for each in known.values()]
    epochs += [each.state.follows.epoch for each in known.values() if each.state.follows is not None]
    if before.term is not None:
        epochs.append(before.term.epoch)
    left = before.left if before.term is None else max(before.left, before.term.epoch)
    epoch = (max(epochs) // EPOCHS + 1) * EPOCHS + own.number
    return Allegiance(Term(own.number, own.boot, epoch), 0, 0, left, before.free_ns)


def followers(own: Voter, term: Term, known: Mapping[int, Known], now_ns: int) -> set[int]:
    """Return the peers that follow this warden in its term, itself among them, so that nobody else counts them."""
    found = {own.number}
    for each in known.values():
        if each.state.follows == term and now_ns - each.state.echo_ns < FOLLOWED_NS and each.state.echo_ns:
            found.add(each.number)
    return found


def _counts(own: Voter, term: Term, live: Mapping[int, Known], now_ns: int) -> bool:
    return is_majority(own.electorate, followers(own, term, live, now_ns))


def _highest(live: Mapping[int, Known], above: int) -> Known | None:
    """Return the peer that stands in the highest epoch above one; of equals the one with the higher number."""
    standing_peers = [each for each in live.values() if each.state.term > above]
    return max(standing_peers, key=lambda each: (each.state.grants, each.state.term, each.number), default=None)
