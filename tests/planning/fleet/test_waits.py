"""Waits are told with their cause and time, audited, and the rest of the coordinator's manners."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.planning.fleet.small_traffic import TEE, traffic
from tests.planning.fleet.test_order import CLEARING_MS, ordered
from waychair.maps.traffic.traffic_graph import RefugeKind
from waychair.planning.fleet import warden
from waychair.planning.fleet.order import Chain, Order, Request, Turn, asked, cleared, entered, parked
from waychair.planning.fleet.rules import Priority
from waychair.planning.fleet.waits import IDLE_MS, LATE_MS, Audit, Reason, Wait, in_the_way, jain, place_to_wait, waits
from waychair.planning.fleet.warden import ChairReport, Heard, Lease, RequestWord, WardenState, decided
from waychair.planning.fleet.ways import ways_of


def test_a_wait_is_told_with_chair_place_and_seconds() -> None:
    wait = Wait(1, 2, "a-b", Reason.FIRST, (Priority.ROUTINE, Priority.ROUTINE), 0, 18_500)
    assert wait.sentence == "Waits for chair 2 to leave a-b: about 20 s."
    older = Wait(1, 3, "a-b", Reason.AGE, (Priority.ROUTINE, Priority.ROUTINE), 0, 9_000)
    assert older.sentence == "Lets chair 3 go first: it has waited longer: about 10 s."
    assert Wait(1, None, "a-b", Reason.CLOSED, (Priority.ROUTINE, None), 0, None).sentence == "Waits: a-b is closed."


def test_the_second_of_two_chairs_waits_and_the_audit_compares_foreseen_and_real_time() -> None:
    order = ordered(TEE, {1: "P", 2: "Q"}, {1: "S", 2: "R"})
    audit = Audit()
    now = 1000
    begun = False
    for now in range(1000, 60_000, 250):
        for chair in order.chains:
            if order.chains[chair].ready_ms <= now and order.may_enter(chair):
                order = entered(order, chair, now)
        audit.note(waits(order, now, CLEARING_MS), now)
        begun |= bool(audit.begun)
        order = _cleared_rears(order, now)
    assert begun
    assert not audit.begun
    assert audit.ended
    assert all(set(each) >= {"place", "waits", "first", "rule", "foreseen_s", "real_s"} for each in audit.ended)
    assert audit.foreseen_right() == 1.0


def test_a_wait_for_a_chair_that_is_late_is_told_without_seconds() -> None:
    order = ordered(TEE, {1: "P", 2: "Q"}, {1: "S", 2: "R"})
    told = []
    for now in range(1000, 60_000, 250):
        for chair in order.chains:
            if order.chains[chair].ready_ms <= now and order.may_enter(chair):
                order = entered(order, chair, now)
        told += waits(order, now, CLEARING_MS)  # nobody's rear ever leaves
    assert {(wait.chair, wait.other) for wait in told} == {(2, 1)}
    assert told[0].foreseen_ms is not None
    assert min(wait.foreseen_ms for wait in told if wait.foreseen_ms is not None) >= LATE_MS
    assert told[-1].foreseen_ms is None
    assert told[-1].sentence == told[-1].why


def test_a_chair_that_turns_back_into_the_section_that_its_rear_is_in_waits_for_nobody() -> None:
    ways = ways_of(TEE, 0.5)
    there = next(k for k, name in enumerate(ways.names) if "-" in name)
    back = there + 1
    assert ways.resource[back] == ways.resource[there]
    node = next(k for k in ways.after[ways.first[there] : ways.first[there + 1]].tolist() if not ways.at_home[k])
    chain = Chain((node, back), visit=1, behind=((0, there),))
    queues = {int(ways.resource[there]): (Turn(1, 0), Turn(1, 2)), int(ways.resource[node]): (Turn(1, 1),)}
    order = Order(ways, {1: chain}, queues)
    assert not order.may_enter(1)
    assert waits(order, 5000, CLEARING_MS) == ()


def test_a_chair_without_a_chain_waits_for_the_one_that_will_drive_through_its_way() -> None:
    order = ordered(TEE, {1: "P", 2: "Q"}, {1: "S"})
    (wait,) = (each for each in waits(asked(order, Request(9, 2, "R", 3000)), 5000, CLEARING_MS) if each.chair == 2)
    assert (wait.other, wait.reason, wait.waited_ms) == (1, Reason.FIRST, 2000)
    assert wait.place == "b2"
    assert wait.sentence == f"Waits for chair 1 to leave {wait.place}."


def _cleared_rears(order: Order, now: int) -> Order:
    for chair in order.chains:
        while order.chains[chair].behind and now >= order.chains[chair].entered_ms + CLEARING_MS:
            order = cleared(order, chair)
    return order


def test_an_idle_chair_in_a_wanted_place_is_named_with_the_chairs_that_wait() -> None:
    order = ordered(TEE, {1: "P", 2: "Q", 3: "T"}, {1: "Q", 3: "Q"})
    assert in_the_way(order, 2000) == {}
    assert in_the_way(order, IDLE_MS + 2000) == {2: (1, 3)}
    told = {wait.chair: wait for wait in waits(order, 2000, CLEARING_MS)}
    assert told[1].reason is Reason.TAKEN
    assert told[1].sentence == "Waits for chair 2 to leave Q."


def test_a_chair_makes_room_in_its_own_dock_or_else_in_the_nearest_free_bay() -> None:
    graph = traffic("docks", ["P-a", "a-b", "b-D", "b-c", "c-B"], bays="B")
    order = parked(ways_of(graph, 1.0), {1: "P"})
    assert place_to_wait(order, 1) == "B"
    docks = tuple(replace(each, kind=RefugeKind.DOCK, owner=2) if each.name == "D" else each for each in graph.refuges)
    assert place_to_wait(parked(ways_of(replace(graph, refuges=docks), 1.0), {1: "P", 3: "B"}), 1) is None
    assert place_to_wait(parked(ways_of(replace(graph, refuges=docks), 1.0), {2: "P"}), 2) == "D"


def test_a_chair_whose_place_shuts_off_the_goal_is_named() -> None:
    through = traffic("a ward behind a desk", ["P-a", "a-D", "D-b", "b-Q"])
    order = ordered(through, {1: "P", 2: "D"}, {1: "Q"})
    (wait,) = waits(order, 2000, CLEARING_MS)
    assert wait.sentence == "Waits for chair 2 to leave D."
    assert in_the_way(order, IDLE_MS + 2000) == {2: (1,)}


def test_an_exchange_without_room_to_pass_is_said() -> None:
    order = ordered(traffic("no room", ["P-a", "a-Q"]), {1: "P", 2: "Q"}, {1: "Q", 2: "P"})
    for wait in waits(order, 2000, CLEARING_MS):
        assert wait.reason is Reason.NO_ROOM
        assert "there is no room to pass. Ask for help." in wait.sentence


def test_fairness_is_one_among_equals_and_a_share_where_one_has_all() -> None:
    assert jain([2.0, 2.0, 2.0]) == pytest.approx(1.0)
    assert jain([3.0, 0.0, 0.0]) == pytest.approx(1 / 3)
    assert jain([0.0, 0.0]) == 1.0


def district(places: dict[int, str]) -> WardenState:
    return WardenState(parked(ways_of(TEE, 1.0), places), CLEARING_MS)


def test_a_warden_grants_follows_and_renews_and_refuses_an_unknown_chair_in_one_sentence() -> None:
    state, replies, _ = decided(district({1: "P"}), Heard(requests=(Request(1, 1, "Q", 0),)), 0)
    (grant,) = replies
    assert (grant.answer, grant.chair) == (RequestWord.GRANTED, 1)
    assert state.order.ways.names[grant.spots[-1]] == "Q"
    state, replies, _ = decided(state, Heard((ChairReport(1, 2, 1, 500), ChairReport(8, 0))), 1000)
    assert {reply.chair: reply.answer for reply in replies} == {8: RequestWord.REJECTED, 1: RequestWord.GRANTED}
    assert replies[-1].spots == grant.spots[2:]
    assert replies[-1].serial == state.serial
    assert "chair 8 is not in this building" in replies[0].sentence


def test_a_chair_that_falls_silent_keeps_its_spot_only_and_others_find_another_way() -> None:
    ring = traffic("ring", ["P-a", "a-b", "b-Q", "b-c", "c-a", "c-R"])
    state = WardenState(parked(ways_of(ring, 1.0), {1: "P", 2: "R"}), CLEARING_MS)
    state, _, _ = decided(state, Heard(requests=(Request(1, 1, "Q", 0),)), 0)
    state, _, _ = decided(state, Heard((ChairReport(1, 3, 0, 3000),)), 1000)
    where = state.order.ways.names[state.order.chains[1].spots[0]]
    assert where == "a-b"
    state, replies, _ = decided(state, Heard((ChairReport(2, 0),), (Request(2, 2, "P", 5000),)), 5000)
    answers = {reply.chair: reply for reply in replies}
    assert answers[1].answer is RequestWord.REVOKED
    assert answers[2].answer is RequestWord.GRANTED
    assert where not in [state.order.ways.names[spot] for spot in answers[2].spots]


def test_a_blocked_section_is_shared_by_all_until_its_time_is_over() -> None:
    ring = traffic("ring", ["P-a", "a-b", "b-Q", "b-c", "c-a"])
    state = WardenState(parked(ways_of(ring, 1.0), {1: "P"}), CLEARING_MS)
    state, replies, _ = decided(state, Heard((), (Request(1, 1, "Q", 0),), {"a-b": 60_000}), 0)
    assert "c-a" in [state.order.ways.names[spot] for spot in replies[0].spots]
    assert state.order.closed
    state, _, _ = decided(state, Heard((ChairReport(1, 0),)), 60_001)
    assert not state.order.closed


def test_a_lease_lapses_for_spots_not_entered_and_when_the_clock_goes_backwards() -> None:
    lease = Lease((4, 5, 6), 1_000_000_000, 3000)
    assert lease.usable(2_000_000_000) == (4, 5, 6)
    assert lease.usable(4_000_000_001) == (4,)
    assert lease.usable(999_999_999) == (4,)


def test_a_doubled_report_changes_nothing_and_one_out_of_turn_is_refused() -> None:
    state, _, _ = decided(district({1: "P", 2: "R"}), Heard(requests=(Request(1, 1, "Q", 0), Request(2, 2, "S", 0))), 0)
    waiting = next(chair for chair in (1, 2) if len(state.order.chains[chair].spots) > 1)
    once, _, _ = decided(state, Heard((ChairReport(waiting, 1, 1, 900),)), 500)
    twice, _, _ = decided(once, Heard((ChairReport(waiting, 1, 1, 900),)), 500)
    assert once.order.chains == twice.order.chains
    _, replies, _ = decided(state, Heard((ChairReport(waiting, 99),)), 500)
    assert replies[0].answer is RequestWord.REJECTED
    assert "entered out of turn" in replies[0].sentence


def test_a_search_in_vain_is_repeated_by_other_choices_less_and_less_often(monkeypatch: pytest.MonkeyPatch) -> None:
    searches: list[tuple[int, float]] = []

    def in_vain(order: Order, now_ms: int, clearing_ms: int, rng: np.random.Generator, rounds: int) -> Order:
        searches.append((now_ms, rng.random()))
        return order

    monkeypatch.setattr(warden, "granted", in_vain)
    state, _, _ = decided(district({1: "P", 2: "Q"}), Heard(requests=(Request(1, 1, "R", 0),)), 5_000)
    for now_ms in range(5_100, 21_000, 100):
        state, _, _ = decided(state, Heard(), now_ms)
    assert [now_ms for now_ms, _ in searches] == [5_000, 6_000, 8_000, 12_000, 20_000]
    assert len({choice for _, choice in searches}) == len(searches)
    monkeypatch.undo()
    state, _, _ = decided(state, Heard(), 40_000)
    assert len(state.order.chains[1].spots) > 1


def test_no_way_is_searched_again_and_again_to_a_place_that_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    state, _, _ = decided(district({1: "P", 2: "Q"}), Heard(requests=(Request(1, 1, "Q", 0),)), 5_000)
    monkeypatch.delattr(warden, "granted")
    for now_ms in range(5_100, 21_000, 100):
        state, _, _ = decided(state, Heard(), now_ms)
    assert len(state.order.waiting) == 1
