"""The order of chairs: granted whole, never a cycle, always a next move, whoever is late; exchanges of places."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations, product

import numpy as np
import pytest

from tests.planning.fleet.small_traffic import (
    RING,
    SMALL,
    TEE,
    can_be_reached,
    is_under_way,
    next_orders,
    progress,
    traffic,
)
from waychair.errors import TaskError
from waychair.maps.traffic.traffic_graph import TrafficGraph
from waychair.planning.fleet.granting import Granting, granted, overtaken
from waychair.planning.fleet.order import (
    Order,
    Request,
    Turn,
    asked,
    cleared,
    entered,
    foreseen,
    held_up,
    parked,
    stopped,
)
from waychair.planning.fleet.rules import Priority, aged, inherited, weight
from waychair.planning.fleet.sipp import Stay
from waychair.planning.fleet.ways import ways_of

CLEARING_MS = 400


def ordered(
    graph: TrafficGraph, places: dict[int, str], goals: dict[int, str], seed: int = 0, rounds: int = 3
) -> Order:
    """Return the order in which all requests are granted that can be."""
    order = parked(ways_of(graph, 1.0), places)
    for number, (chair, goal) in enumerate(goals.items()):
        order = asked(order, Request(number, chair, goal, number))
    return granted(order, 1000, CLEARING_MS, np.random.default_rng(seed), rounds)


def all_states(order: Order) -> Iterator[Order]:
    """Yield every state that any lateness can lead to."""
    known, open_states = {progress(order)}, [order]
    while open_states:
        state = open_states.pop()
        yield state
        for after in next_orders(state):
            if progress(after) not in known:
                known.add(progress(after))
                open_states.append(after)


def situations(graph: TrafficGraph) -> Iterator[tuple[dict[int, str], dict[int, str]]]:
    """Yield all places and goals of one to three chairs."""
    refuges = [refuge.name for refuge in graph.refuges]
    for chairs in (1, 2, 3):
        for places in permutations(refuges, min(chairs, len(refuges))):
            for goals in product(refuges, repeat=len(places)):
                wishes = {k: goal for k, goal in enumerate(goals, 1) if goal != places[k - 1]}
                yield dict(enumerate(places, 1)), wishes


def check_situation(graph: TrafficGraph, places: dict[int, str], goals: dict[int, str]) -> int:
    """Check that all granted chairs arrive however late anybody is; return the number of states."""
    order = ordered(graph, places, goals)
    assert foreseen(order, 1000, CLEARING_MS) is not None
    ends = places | goals
    if len(set(ends.values())) == len(ends):
        assert (not order.waiting) == can_be_reached(order.ways, places, ends), (graph.name, places, goals)
    waiting = {request.chair for request in order.waiting}
    count = 0
    for state in all_states(order):
        count += 1
        moving = [chair for chair, chain in state.chains.items() if is_under_way(chain)]
        assert not moving or any(True for _ in next_orders(state)), (graph.name, places, goals)
        used = [int(state.ways.resource[chain.spots[0]]) for chain in state.chains.values()]
        assert len(set(used)) == len(used)
        if not moving:
            for chair, chain in state.chains.items():
                assert state.ways.names[chain.spots[0]] == (places if chair in waiting else ends)[chair]
    return count


@pytest.mark.parametrize("graph", SMALL, ids=lambda graph: graph.name)
def test_some_chair_can_always_move_in_sampled_states_of_small_graphs(graph: TrafficGraph) -> None:
    assert sum(check_situation(graph, *each) for each in list(situations(graph))[3::41]) > 10


@pytest.mark.nightly
@pytest.mark.parametrize("graph", SMALL, ids=lambda graph: graph.name)
def test_some_chair_can_always_move_in_all_states_of_small_graphs(graph: TrafficGraph) -> None:
    assert sum(check_situation(graph, *each) for each in situations(graph)) > 500


def exchange(graph: TrafficGraph, rng: np.random.Generator) -> None:
    """Let two to four chairs take each other's places, in a random order of late events."""
    refuges = [refuge.name for refuge in graph.refuges]
    chairs = int(rng.integers(2, 5))
    places = dict(enumerate(rng.permutation(refuges)[:chairs].tolist(), 1))
    goals = {chair: places[chair % chairs + 1] for chair in places}
    order = ordered(graph, places, goals, int(rng.integers(1000)), rounds=1)
    assert not order.waiting, (graph.name, places)
    while any(is_under_way(chain) or chain.behind for chain in order.chains.values()):
        after = list(next_orders(order))
        order = after[int(rng.integers(len(after)))]
    assert {chair: order.ways.names[chain.spots[0]] for chair, chain in order.chains.items()} == goals


@pytest.mark.parametrize("graph", [RING, TEE], ids=lambda graph: graph.name)
def test_two_to_four_chairs_exchange_their_places(graph: TrafficGraph) -> None:
    rng = np.random.default_rng(1)
    for _ in range(15):
        exchange(graph, rng)


@pytest.mark.nightly
@pytest.mark.parametrize("graph", [RING, TEE], ids=lambda graph: graph.name)
def test_ten_thousand_exchanges_of_places(graph: TrafficGraph) -> None:
    rng = np.random.default_rng(2)
    for _ in range(5000):
        exchange(graph, rng)


LINE = traffic("corridor", ["P-a", "a-b", "b-Q", "a-R", "b-S"])


def test_an_exchange_that_nobody_can_make_stays_asked_and_nobody_moves() -> None:
    order = ordered(traffic("no room", ["P-a", "a-Q"]), {1: "P", 2: "Q"}, {1: "Q", 2: "P"})
    assert [request.chair for request in order.waiting] == [1, 2]
    assert not any(is_under_way(chain) for chain in order.chains.values())


def test_a_goal_that_an_idle_chair_holds_waits_until_that_chair_leaves_and_then_by_age() -> None:
    order = ordered(LINE, {1: "P", 2: "R", 3: "Q"}, {1: "Q", 2: "Q"})
    assert [request.chair for request in order.waiting] == [1, 2]
    order = asked(order, Request(9, 3, "S", 5000))
    order = granted(order, 5000, CLEARING_MS, np.random.default_rng(0), 3)
    assert [request.chair for request in order.waiting] == [2]
    assert order.ways.names[order.chains[1].spots[-1]] == "Q"


def test_spots_that_a_chair_entered_at_once_are_left_as_it_drives_through_them() -> None:
    order = ordered(LINE, {1: "P"}, {1: "S"})
    for _ in range(3):
        order = entered(order, 1, 1000)
    chain, passing = order.chains[1], order.ways.passing_ms
    after = [int(passing[spot]) for _, spot in chain.behind[1:]] + [int(passing[chain.spots[0]])]
    times = foreseen(held_up(order, 1, 1000 + sum(after)), 1000, CLEARING_MS)
    assert times is not None
    left = [times[Turn(1, visit)].until_ms for visit, _ in chain.behind]
    assert left == [1000 + sum(after[:k]) + CLEARING_MS for k in range(3)]
    assert left[0] < left[1] < left[2]
    told = foreseen(held_up(order, 1, 1000 + sum(after), (1500, 900)), 1000, CLEARING_MS)
    assert told is not None
    assert [told[Turn(1, visit)].until_ms for visit, _ in chain.behind] == [1500, 1000, left[2]]


def test_a_late_chair_keeps_the_others_in_their_order_and_its_time_is_foreseen() -> None:
    order = ordered(LINE, {1: "P", 2: "Q"}, {1: "S", 2: "R"})
    times = foreseen(order, 1000, CLEARING_MS)
    assert times is not None
    first, second = sorted(order.chains, key=lambda chair: -len([t for t in times if t.chair == chair]))
    late = foreseen(held_up(order, first, 61_000), 1000, CLEARING_MS)
    assert late is not None
    assert max(late[turn].from_ms for turn in late if turn.chair == first) > 61_000
    assert set(late) == set(times)
    assert second in {turn.chair for turn in late}


def test_a_chair_out_of_turn_and_impossible_requests_are_refused() -> None:
    order = ordered(LINE, {1: "P", 2: "R"}, {1: "Q", 2: "S"})
    behind = next(chair for chair in (1, 2) if order.chains[chair].spots)
    while order.may_enter(behind):
        order = entered(order, behind, 2000)
        while order.chains[behind].behind and order.may_enter(behind):
            order = cleared(order, behind)
    with pytest.raises(TaskError, match=f"chair {behind} entered out of turn"):
        entered(order, behind, 2000)
    with pytest.raises(TaskError, match="chair 7 is not in this building"):
        asked(order, Request(3, 7, "P", 0))
    with pytest.raises(TaskError, match="no chair can wait at 'a': give one of P, Q, R, S"):
        asked(order, Request(3, 1, "a", 0))
    with pytest.raises(TaskError, match="P has 1 slot, too few for chair 2"):
        parked(order.ways, {1: "P", 2: "P"})
    apart = ways_of(traffic("apart", ["P-a", "Q-b"]), 1.0)
    with pytest.raises(TaskError, match="no way leads chair 1 from P to Q"):
        asked(parked(apart, {1: "P"}), Request(1, 1, "Q", 0))
    with pytest.raises(TaskError, match="give a speed above 0"):
        ways_of(LINE, float("nan"))
    with pytest.raises(TaskError, match="give 1 ms or more"):
        granted(order, 0, 0, np.random.default_rng(0), 1)


def test_a_closed_section_sends_chairs_back_and_round_or_leaves_them_where_they_are() -> None:
    ring = traffic("ring", ["P-a", "a-b", "b-Q", "b-c", "c-a"])
    order = ordered(ring, {1: "P"}, {1: "Q"})
    direct = next(spot for spot in order.chains[1].spots if order.ways.names[spot] == "a-b")
    for _ in range(2):
        order = cleared(entered(order, 1, 2000), 1)
    closed = replace(order, closed=frozenset({int(order.ways.resource[direct])}))
    assert not closed.may_enter(1)
    again = granted(closed, 2000, CLEARING_MS, np.random.default_rng(0), 3)
    names = [again.ways.names[spot] for spot in again.chains[1].spots]
    assert "c-a" in names
    assert "a-b" not in names
    line = ordered(LINE, {1: "P"}, {1: "Q"})
    barrier = line.ways.names.index("a-b")
    stuck = replace(line, closed=frozenset({int(line.ways.resource[barrier])}))
    back = granted(stuck, 2000, CLEARING_MS, np.random.default_rng(0), 3)
    assert len(back.chains[1].spots) == 1
    assert [request.goal for request in back.waiting] == ["Q"]


def test_a_chair_in_a_section_that_closes_drives_out_of_it_and_backs_out_of_a_run_closed_before_it() -> None:
    order = ordered(LINE, {1: "P"}, {1: "Q"})
    for _ in range(3):
        order = cleared(entered(order, 1, 2000), 1)
    inside = order.chains[1].spots[0]
    assert order.ways.names[inside] == "a-b"
    closed = replace(order, closed=frozenset({int(order.ways.resource[inside])}))
    on = granted(closed, 2000, CLEARING_MS, np.random.default_rng(0), 3)
    assert on.chains[1].spots == order.chains[1].spots
    ahead = frozenset({int(order.ways.resource[order.chains[1].spots[1]])})
    back = granted(replace(order, closed=ahead), 2000, CLEARING_MS, np.random.default_rng(0), 3)
    assert back.ways.names[back.chains[1].spots[-1]] in ("P", "R")
    assert [request.goal for request in back.waiting] == ["Q"]
    assert foreseen(back, 2000, CLEARING_MS) is not None


def test_two_chairs_exchange_their_places_around_a_third_that_died_in_the_corridor() -> None:
    order = ordered(RING, {1: "P", 2: "Q", 3: "S"}, {3: "R"})
    while order.ways.names[order.chains[3].spots[0]] != "c-d":
        order = cleared(entered(order, 3, 2000), 3)
    order = stopped(order, 3)
    for number, (chair, goal) in enumerate({1: "Q", 2: "P"}.items(), 5):
        order = asked(order, Request(number, chair, goal, 3000))
    before = order.chains[3]
    order = granted(order, 3000, CLEARING_MS, np.random.default_rng(0), 3)
    assert order.chains[3] == before
    assert len(order.waiting) in (0, 2)  # there is room to pass only in the free part of the ring
    for state in all_states(order):
        moving = [chair for chair, chain in state.chains.items() if is_under_way(chain)]
        assert not moving or any(True for _ in next_orders(state))


def test_priorities_age_up_to_appointments_and_top_outweighs_all() -> None:
    assert aged(Priority.ROUTINE, 0) == Priority.ROUTINE
    assert aged(Priority.ROUTINE, 120_000) == Priority.APPOINTMENT
    assert aged(Priority.ROUTINE, 10**9) == Priority.APPOINTMENT
    assert aged(Priority.TOP, 10**9) == Priority.TOP
    assert weight(Priority.ROUTINE, 300_000) == 2 * weight(Priority.ROUTINE, 0)
    assert weight(Priority.TOP, 0) > 10 * weight(Priority.APPOINTMENT, 600_000)


def test_those_in_the_way_of_a_higher_chair_inherit_its_priority_over_people_too() -> None:
    """The trap: a top chair behind a routine chair, which stands for a person, who stands for the top chair."""
    own = {"chair 1": Priority.TOP, "chair 2": Priority.ROUTINE, "person": Priority.PEOPLE, "chair 3": Priority.ROUTINE}
    waits_for = {
        "chair 1": frozenset({"chair 2"}),
        "chair 2": frozenset({"person"}),
        "person": frozenset({"chair 1"}),
        "chair 3": frozenset({"person"}),
    }
    found = inherited(own, waits_for)
    assert found["chair 2"] == Priority.TOP  # it goes before the person, and the circle is open
    assert found["chair 3"] == Priority.ROUTINE


def test_a_top_chair_goes_first_and_equals_are_overtaken_at_most_twice() -> None:
    order = parked(ways_of(TEE, 1.0), {1: "P", 2: "R", 3: "Q", 4: "S"})
    for number, (chair, goal) in enumerate({1: "T", 2: "U", 3: "R"}.items()):
        order = asked(order, Request(number, chair, goal, number))
    order = granted(order, 1000, CLEARING_MS, np.random.default_rng(0), 10)
    top = granted(asked(order, Request(5, 4, "P", 1500, Priority.TOP)), 1500, CLEARING_MS, np.random.default_rng(0), 30)
    times = foreseen(top, 1500, CLEARING_MS)
    assert times is not None
    arrival = max(stay.from_ms for turn, stay in times.items() if turn.chair == 4)
    alone = 1500 + int(top.ways.least_ms("P")[top.chains[4].spots[0]]) - 1
    assert arrival - alone <= 8000
    assert all(len(chain.overtaken_by) <= 2 for chain in top.chains.values())


def test_a_request_waits_that_could_only_be_granted_by_overtaking_a_chair_once_more() -> None:
    """Chair 2 stands on the way of all; if chair 1 goes now, chair 3 goes far out of its way."""
    order = ordered(TEE, {1: "P", 2: "R", 3: "Q"}, {2: "T", 3: "U"})
    while order.ways.names[order.chains[2].spots[0]] != "a2-m":
        order = cleared(entered(order, 2, 2000), 2)
    order = stopped(order, 2)
    overtaken_twice = replace(order.chains[3], overtaken_by=frozenset({7, 8}))
    order = replace(order, chains={**order.chains, 3: overtaken_twice})
    new = granted(asked(order, Request(9, 1, "Q", 5000)), 5000, CLEARING_MS, np.random.default_rng(0), 3)
    assert new.chains[3].overtaken_by == {7, 8}
    assert [each.number for each in new.waiting] == [9]


@pytest.mark.parametrize("holds_by_request", [True, False])
def test_only_a_chair_that_had_a_way_to_its_goal_is_overtaken(holds_by_request: bool) -> None:
    """After a closure or another warden a chair holds a few spots without its request: they end before its goal."""
    first, later = Request(1, 1, "U", 0), Request(2, 2, "T", 100)
    order = ordered(TEE, {1: "P", 2: "R"}, {1: "U"})
    assert order.chains[1].request is not None
    own = replace(order.chains[1], request=first if holds_by_request else None)
    order = replace(order, chains={**order.chains, 1: own})
    state = Granting(order, 1000, CLEARING_MS, np.random.default_rng(0), ())
    here, _, *rest = own.spots
    shared = rest[0]
    stand = Stay(order.chains[2].spots[0], 0, 2000)
    old = {1: (Stay(here, 0, 3000), Stay(shared, 3000, 4000)), 2: (stand,)}
    new = {1: (Stay(here, 0, 9000), Stay(shared, 9000, 10_000)), 2: (stand, Stay(shared, 2000, 3000))}
    found = overtaken(state, new, old, {1: first, 2: later})
    assert found == {1: frozenset({2}) if holds_by_request else frozenset(), 2: frozenset()}
