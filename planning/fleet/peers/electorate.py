"""The electorate of a district, changed by its warden one peer at a time as chairs are parked and come back.

Two electorates that follow each other differ by one peer, so that a majority of the one shares a peer with any majority of the
other. A warden changes the electorate only once a majority knows the last one, the first of its own term among them, and no peer
follows a warden whose electorate is older than its own, which it remembers over a restart.
(Membership changes by one: D. Ongaro, "Consensus: bridging theory and practice", 2014, 4.1, with its correction of 2015.)
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

from waychair.planning.fleet.peers.election import Known, Voter, is_majority
from waychair.planning.fleet.peers.messages import Electorate, Term


def next_electorate(
    own: Voter, term: Term, known: Mapping[int, Known], followed_by: Collection[int]
) -> Electorate | None:
    """Return the electorate that a warden goes on to; None while it keeps the one that it has.

    `known` are the last States of all peers, its own among them; `followed_by` the peers that follow it in its term.
    """
    now = own.electorate
    if now.epoch != term.epoch:
        return Electorate(term.epoch, 0, now.members)
    knowing = {number for number in followed_by if number in known and known[number].state.electors == now.version}
    if not is_majority(now, {own.number, *knowing}):
        return None
    members = set(now.members)
    parked = {number for number, each in known.items() if each.state.parked}
    for number in sorted(members & parked, key=lambda each: (each == own.number, each)):
        if found := _followed(now, members - {number}, followed_by):
            return found
    for number in sorted(knowing - members - parked):
        if found := _followed(now, members | {number}, followed_by):
            return found
    return None


def _followed(now: Electorate, members: set[int], followed_by: Collection[int]) -> Electorate | None:
    """Return the next electorate if a majority of its members follows."""
    found = Electorate(now.epoch, now.change + 1, tuple(sorted(members)))
    return found if is_majority(found, followed_by) else None


def adopted(own: Voter, order_electorate: Electorate, building: frozenset[int]) -> Voter:
    """Return a voter after its warden has told the electorate; an older one, or one of strangers, changes nothing."""
    if order_electorate.version <= own.electorate.version or not building.issuperset(order_electorate.members):
        return own
    return replace(own, electorate=order_electorate)
