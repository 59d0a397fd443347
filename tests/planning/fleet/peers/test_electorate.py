"""Who is counted: one peer at a time, known by a majority before the next, and remembered over a restart."""

from __future__ import annotations

from dataclasses import replace

import msgspec

from tests.planning.fleet.peers.buildings import Desk
from waychair.planning.fleet.peers.election import Allegiance, Known, Voter, followed
from waychair.planning.fleet.peers.electorate import adopted, next_electorate
from waychair.planning.fleet.peers.messages import Electorate, State, Term
from waychair.planning.fleet.peers.peer import Peer
from waychair.trials.fleet.fleet_situations import voters_parked, voters_parked_at_worst

NOW = Electorate(5001, 3, (1, 2, 3))
TERM = Term(1, 77, 5001)
OWN = Voter(1, 77, "all", NOW)


def _known(parked: tuple[int, ...] = (), late: tuple[int, ...] = ()) -> dict[int, Known]:
    """Return the last States of peers 1 to 4, of which some are parked, and some do not know the electorate."""
    return {
        number: Known(
            number, 77, 1, 1, State(parked=number in parked, electors=(5001, 2) if number in late else NOW.version)
        )
        for number in (1, 2, 3, 4)
    }


def test_the_first_electorate_of_a_term_has_the_members_of_the_last_one() -> None:
    later = Term(1, 77, 6001)
    assert next_electorate(OWN, later, _known(parked=(3,)), {1, 2, 3, 4}) == Electorate(6001, 0, (1, 2, 3))


def test_one_peer_at_a_time_leaves_or_comes() -> None:
    assert next_electorate(OWN, TERM, _known(), {1, 2, 3}) is None
    assert next_electorate(OWN, TERM, _known(parked=(2, 3)), {1, 2, 3}) == Electorate(5001, 4, (1, 3))
    assert next_electorate(OWN, TERM, _known(), {1, 2, 3, 4}) == Electorate(5001, 4, (1, 2, 3, 4))
    assert next_electorate(OWN, TERM, _known(parked=(1, 4)), {1, 2, 3, 4}) == Electorate(5001, 4, (2, 3))


def test_nothing_changes_before_a_majority_knows_the_last_change_or_without_followers_of_the_next_one() -> None:
    assert next_electorate(OWN, TERM, _known(parked=(3,), late=(2, 3)), {1, 2, 3}) is None
    assert next_electorate(OWN, TERM, _known(late=(4,)), {1, 2, 3, 4}) is None
    assert next_electorate(OWN, TERM, _known(parked=(2,)), {1, 2}) is None


def test_the_last_one_stays() -> None:
    alone = replace(OWN, electorate=Electorate(5001, 3, (1,)))
    assert next_electorate(alone, TERM, _known(parked=(1,)), {1}) is None


def test_an_older_electorate_and_one_with_strangers_are_not_taken() -> None:
    building = frozenset((1, 2, 3, 4))
    newer = Electorate(5001, 4, (1, 2))
    assert adopted(OWN, newer, building).electorate == newer
    assert adopted(OWN, Electorate(5001, 2, (1, 2)), building) == OWN
    assert adopted(OWN, Electorate(5001, 4, (1, 9)), building) == OWN


def test_nobody_follows_a_warden_with_an_older_electorate_or_stands_beside_a_peer_with_a_newer_one() -> None:
    warden = Known(2, 7, 10, 10, State(term=9002, electors=(5001, 2)))
    assert followed(OWN, Allegiance(), {2: warden}, 20).term != Term(2, 7, 9002)
    abreast = msgspec.structs.replace(warden.state, electors=NOW.version)
    assert followed(OWN, Allegiance(), {2: replace(warden, state=abreast)}, 20).term == Term(2, 7, 9002)
    newer = Known(3, 7, 10, 10, State(electors=(5001, 4)))
    assert followed(OWN, Allegiance(), {3: newer}, 20).term is None


def test_a_chair_whose_mates_are_parked_and_switched_off_orders_alone_and_counts_them_again_when_they_are_back() -> (
    None
):
    desk = Desk(3)
    desk.run(6)
    last = desk.wardens[0]
    others = [number for number in desk.peers if number != last]
    off = {}
    for number in (others[0], last):  # the warden as well
        desk.own[number] = replace(desk.own[number], parked=True)
        desk.run(1)
        off[number] = desk.peers.pop(number).voter.electorate
        desk.run(5)
    assert desk.wardens == [others[1]]
    assert desk.peers[others[1]].voter.electorate.members == (others[1],)
    for number, remembered in off.items():
        desk.own[number] = replace(desk.own[number], parked=False)
        desk.peers[number] = Peer(desk.fleet, number, 2000 + number, electorate=remembered)
    desk.run(6)
    assert {peer.voter.electorate.members for peer in desk.peers.values()} == {(1, 2, 3)}
    assert desk.wardens == [others[1]]


def test_a_chair_that_dies_unparked_is_counted_on() -> None:
    desk = Desk(3)
    desk.run(6)
    del desk.peers[next(number for number in desk.peers if number not in desk.wardens)]
    desk.run(4)
    assert desk.peers[desk.wardens[0]].voter.electorate.members == (1, 2, 3)
    del desk.peers[next(number for number in desk.peers if number not in desk.wardens)]
    desk.run(4)
    assert desk.wardens == []


def test_the_order_goes_on_after_all_but_the_warden_lost_their_power() -> None:
    desk = Desk(3)
    desk.run(6)
    for number in [number for number in desk.peers if number not in desk.wardens]:
        desk.peers[number] = Peer(desk.fleet, number, 2000 + number)
    assert desk.run(12, lambda: desk.now_ns > 10**12 + 8 * 10**9 and bool(desk.wardens)) < 12.0


def test_two_never_order_while_voters_are_parked_and_lose_their_power() -> None:
    assert voters_parked(1) == voters_parked_at_worst(1) == []
