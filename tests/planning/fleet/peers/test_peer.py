"""Peers choose one warden, take over from what chairs say, and never let two chairs into one spot."""

from __future__ import annotations

import msgspec
import pytest

from tests.planning.fleet.peers.buildings import WAYS, Desk
from waychair.planning.fleet.peers.election import ranked
from waychair.planning.fleet.peers.messages import Answer, Hello, State, Wish, packed
from waychair.planning.fleet.peers.peer import Own, OwnWish, Peer


def test_one_chair_alone_is_its_own_warden_at_once() -> None:
    desk = Desk(1)
    desk.wish(1, "Q")
    assert desk.run(2, lambda: bool(desk.steps and desk.steps[1].authority.spots)) < 1.0
    assert not desk.steps[1].authority.alone


def test_three_peers_choose_the_first_by_rendezvous_hashing() -> None:
    desk = Desk(3)
    assert desk.run(6, lambda: bool(desk.wardens)) < 4.5
    assert desk.wardens == [ranked("all", [1, 2, 3])[0]]


def test_the_warden_grants_a_request_within_three_steps() -> None:
    desk = Desk(2)
    desk.run(6)
    asking = 3 - desk.wardens[0]
    desk.wish(asking, "R")
    assert desk.run(2, lambda: bool(desk.steps[asking].authority.chain)) <= 0.4


def test_a_fixed_voter_without_a_chair_can_be_the_warden() -> None:
    desk = Desk(1, voters=2)
    desk.run(6, lambda: bool(desk.wardens))
    del desk.peers[2]
    desk.run(6)
    assert len(desk.wardens) == 1


def test_f31_the_next_one_takes_over_within_four_seconds_of_a_warden_that_was_killed() -> None:
    desk = Desk(3)
    desk.run(6)
    dead = desk.wardens[0]
    del desk.peers[dead]
    chair = min(desk.peers)
    desk.wish(chair, "PQR"[dead - 1])  # taken for as long as the dead one is there
    assert desk.run(8, lambda: bool(desk.wardens)) <= 4.0
    desk.run(2)
    assert desk.steps[chair].authority.spots == ()
    assert desk.steps[chair].authority.sentence


def test_f28a_a_minority_grants_nothing_and_drives_by_its_own_eyes_within_ten_seconds() -> None:
    desk = Desk(3)
    desk.run(6)
    cut = desk.wardens[0]
    desk.hears = lambda source, other: (source == cut) == (other == cut)
    others = [number for number in desk.peers if number != cut]
    desk.wish(cut, "PQR"[others[0] - 1])
    assert desk.run(12, lambda: desk.steps[cut].authority.alone) <= 10.0
    desk.run(1)
    assert set(desk.wardens) < set(others)
    assert len(desk.wardens) == 1
    desk.wish(others[0], "PQR"[others[1] - 1])
    desk.run(2)
    assert desk.steps[others[0]].authority.look
    desk.hears = lambda source, other: True
    assert desk.run(8, lambda: not desk.steps[cut].authority.alone) <= 5.0


def test_f31_an_order_is_taken_over_from_what_the_chairs_hold() -> None:
    desk = Desk(3)
    desk.run(6)
    section = WAYS.names.index("a-m")
    mover = next(number for number in desk.peers if number not in desk.wardens)
    desk.own[mover] = Own((section,), 7)
    desk.run(1)
    del desk.peers[desk.wardens[0]]
    desk.run(6)
    office = desk.peers[desk.wardens[0]].office
    assert office is not None
    assert office.district is not None
    order = office.district.order
    assert order.chains[mover].spots[0] == section
    assert order.chains[mover].visit == 7


def _answer(desk: Desk, number: int, **other: object) -> Answer:
    """Return an answer that would let a chair into its next two spots."""
    peer = desk.peers[number]
    term = peer.allegiance.term
    assert term is not None
    own = desk.own[number]
    after = int(WAYS.after[WAYS.first[own.entered[-1]]])
    good = Answer(
        number, peer.boot, 0, term.epoch, 99, "GRANTED", desk.now_ns, 2000, own.visit, (*own.entered, after), 1
    )
    return msgspec.structs.replace(good, **other)


@pytest.mark.parametrize(
    "other",
    [{"boot": 5}, {"stance": 77}, {"epoch": 99}, {"chair": 9}, {"echo_ns": 10**12 - 10**10}, {"visit": 3}, {"upto": 0}],
)
def test_f33_an_answer_for_an_earlier_boot_stance_or_term_or_beyond_its_lease_lets_nobody_in(
    other: dict[str, int],
) -> None:
    desk = Desk(3)
    desk.run(6)
    warden = desk.wardens[0]
    number = next(each for each in desk.peers if each != warden)
    stance = desk.peers[number]._stance
    boot = desk.peers[warden].boot
    for changed in ({"stance": stance} | other, {"stance": stance}):
        data = packed(desk.fleet.building, warden, boot, 10**6, desk.now_ns, _answer(desk, number, **changed))
        step = desk.peers[number].step(desk.now_ns, desk.own[number], [(warden, data)])
        assert bool(step.authority.spots) == (changed == {"stance": stance})


def test_f35_a_message_in_anothers_name_is_refused() -> None:
    desk = Desk(3)
    desk.run(6)
    data = packed(desk.fleet.building, 1, 1001, 10**6, desk.now_ns, State((3,), 9))
    step = desk.peers[2].step(desk.now_ns, desk.own[2], [(3, data)])
    assert step.notices == ("Chair 3 sends in the name of chair 1: take it off the network.",)


def test_f32_the_second_chair_of_a_number_is_refused_and_drives_alone() -> None:
    desk = Desk(3)
    desk.run(6)
    twin = Peer(desk.fleet, 2, 77)
    said: list[str] = []
    first: list[str] = []
    before: list[tuple[int, int | None, bytes]] = []
    for _ in range(120):
        desk.run(0.1)
        heard = [(source, data) for source, _, data in desk.bus]
        step = twin.step(desk.now_ns, desk.own[2], heard)
        said += step.notices
        first += desk.peers[2].step(desk.now_ns, desk.own[2], [(2, data) for _, _, data in before]).notices
        before = [(2, to, data) for to, _, data in step.send]
        desk.bus += before
    assert said == ["Another chair has the number 2 already: give this one a number of its own."]
    assert twin.refused
    assert step.authority.alone
    assert step.send == ()
    assert first == []
    assert not desk.peers[2].refused


def test_f34_a_computer_that_slept_asks_anew() -> None:
    desk = Desk(3)
    desk.run(6)
    number = next(each for each in desk.peers if each not in desk.wardens)
    desk.wish(number, "PQR"[desk.wardens[0] - 1])
    desk.own[desk.wardens[0]] = Own((WAYS.slots["R" if desk.wardens[0] != 3 else "P"][0],))
    desk.run(1)
    step = desk.peers[number].step(desk.now_ns + 10**10, desk.own[number], [])
    assert step.authority.spots == ()


def test_f35_a_chair_that_floods_drowns_nobody() -> None:
    desk = Desk(3)
    desk.run(6)
    flood = [(3, packed(desk.fleet.building, 3, 1003, k, 1, Hello())) for k in range(1, 5000)]
    good = packed(desk.fleet.building, 1, 1001, 10**6, desk.now_ns, State((2,), 5, wish=Wish(1, "R")))
    desk.peers[2].step(desk.now_ns, desk.own[2], [*flood, (1, good), *flood])
    assert desk.peers[2].reader.refused["flood"] > 4000
    assert desk.peers[2]._heard.known[1].state.visit == 5


def test_the_same_steps_give_the_same_bytes() -> None:
    both = []
    for _ in range(2):
        desk, sent = Desk(3), list[bytes]()
        desk.run(5, lambda desk=desk, sent=sent: sent.extend(data for _, _, data in desk.bus))
        both.append(sent)
        assert both[-1]
    assert both[0] == both[1]


def test_f33_an_older_state_is_nothing() -> None:
    desk = Desk(2)
    desk.run(6)
    building, boot = desk.fleet.building, desk.peers[1].boot
    new, old = (packed(building, 1, boot, seq, 1, State((2,), seq)) for seq in (10**6 + 1, 10**6))
    desk.peers[2].step(desk.now_ns, desk.own[2], [(1, new), (1, old), (1, new)])
    assert desk.peers[2]._heard.known[1].state.visit == 10**6 + 1


def test_f28b_a_chair_that_hears_its_warden_no_more_stops_before_the_next_spot_within_half_a_second() -> None:
    desk = Desk(2)
    desk.run(6)
    asking = 3 - desk.wardens[0]
    desk.wish(asking, "R")
    assert desk.run(2, lambda: bool(desk.steps[asking].authority.spots)) < 1.0
    desk.hears = lambda source, other: False
    assert desk.run(5, lambda: not desk.steps[asking].authority.spots) <= 0.5


def test_f28b_what_a_chair_may_enter_does_not_lapse_while_it_hears_its_warden() -> None:
    desk = Desk(2)
    desk.run(6)
    asking = 3 - desk.wardens[0]
    desk.wish(asking, "R")
    assert desk.run(2, lambda: bool(desk.steps[asking].authority.spots)) < 1.0
    assert desk.run(5, lambda: not desk.steps[asking].authority.spots) >= 5.0


def test_f30_a_chair_that_died_in_a_run_keeps_its_section_and_nobody_is_sent_there() -> None:
    desk = Desk(2, voters=2)
    desk.run(6)
    dead = next(number for number in (1, 2) if number not in desk.wardens)
    other = 3 - dead
    section = WAYS.names.index("m-c")
    desk.own[dead] = Own((section,), 4)
    desk.run(2)
    del desk.peers[dead]
    desk.wish(other, "R")  # behind the dead chair
    desk.run(8)
    assert len(desk.wardens) == 1
    assert WAYS.resource[section] not in WAYS.resource[list(desk.steps[other].authority.chain)]
    assert desk.steps[other].authority.sentence
    home = "PQ"[dead - 1]
    desk.own[other] = Own(desk.own[other].entered, wants=2, wish=OwnWish(2, home, 0, desk.now_ns))
    assert desk.run(3, lambda: bool(desk.steps[other].authority.chain)) < 3.0
    assert WAYS.resource[section] not in WAYS.resource[list(desk.steps[other].authority.chain)]


def test_f36_a_chair_whose_rider_steers_keeps_no_order_and_the_others_look() -> None:
    desk = Desk(2)
    desk.run(6)
    steered = next(number for number in (1, 2) if number not in desk.wardens)
    section = WAYS.names.index("m-c")
    desk.own[steered] = Own((section,), 3, manual=True)
    desk.wish(3 - steered, "PQ"[steered - 1])
    desk.run(2)
    assert desk.steps[steered].authority.spots == ()
    assert not desk.steps[steered].authority.alone
    assert desk.steps[3 - steered].authority.look
    assert desk.steps[3 - steered].authority.chain
    desk.own[steered] = Own((section,), 3, wants=2, wish=OwnWish(1, "R", 0, desk.now_ns))
    assert desk.run(3, lambda: bool(desk.steps[steered].authority.spots)) < 2.0


def test_f33_what_another_chair_has_entered_meanwhile_is_given_back() -> None:
    desk = Desk(2, voters=1)
    desk.run(6)
    mover = next(number for number in (1, 2) if number not in desk.wardens)
    other = 3 - mover
    desk.wish(mover, "R")
    assert desk.run(2, lambda: bool(desk.steps[mover].authority.spots)) < 1.0
    first = desk.steps[mover].authority.spots[0]
    stance = desk.peers[mover]._stance
    desk.own[other] = Own((first,), 5, manual=True)  # by its rider
    desk.run(1)
    assert desk.peers[mover]._stance > stance
    assert first not in desk.steps[mover].authority.spots
    assert desk.steps[mover].authority.look
