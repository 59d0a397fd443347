"""Sections that chairs see shut are closed for all, also by the next warden, and open again."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.planning.fleet.peers.buildings import WAYS, Desk
from waychair.planning.fleet.peers.closures import MOST_OF_ONE, Closures
from waychair.planning.fleet.peers.messages import Blocked

NAMES = frozenset(f"s{k}" for k in range(40))
S = 10**9


def _uses(desk: Desk, number: int, section: str) -> bool:
    chain = desk.steps[number].authority.chain
    return int(WAYS.resource[WAYS.names.index(section)]) in {int(WAYS.resource[spot]) for spot in chain}


@pytest.fixture
def shut() -> tuple[Desk, int, int]:
    """Chairs of which one has seen the section to R shut, and another one wants to go there."""
    desk = Desk(2, voters=2)
    desk.run(6)
    witness = next(number for number in (1, 2) if number not in desk.wardens)
    other = 3 - witness
    desk.own[witness] = replace(desk.own[witness], blocked={"m-c": 60_000})
    desk.run(0.2)
    desk.own[witness] = replace(desk.own[witness], blocked={})
    desk.wish(other, "R")
    desk.run(1.5)
    return desk, witness, other


def test_a_section_that_one_chair_sees_shut_is_closed_for_all_until_it_is_free_again(
    shut: tuple[Desk, int, int],
) -> None:
    desk, witness, other = shut
    assert not _uses(desk, other, "m-c") or desk.steps[other].authority.spots == ()
    assert desk.steps[other].authority.sentence
    desk.own[witness] = replace(desk.own[witness], blocked={"m-c": 0})
    desk.run(0.2)
    desk.own[witness] = replace(desk.own[witness], blocked={})
    assert desk.run(4, lambda: bool(desk.steps[other].authority.spots)) < 4.0


def test_the_next_warden_keeps_a_section_shut(shut: tuple[Desk, int, int]) -> None:
    desk, _, _ = shut
    del desk.peers[desk.wardens[0]]
    desk.run(8)
    assert len(desk.wardens) == 1
    office = desk.peers[desk.wardens[0]].office
    assert office is not None
    assert office.district is not None
    assert int(WAYS.resource[WAYS.names.index("m-c")]) in office.district.order.closed


def test_a_chair_that_sees_its_way_shut_gives_it_back_once() -> None:
    desk = Desk(2)
    desk.run(6)
    stance = desk.peers[1]._stance
    desk.own[1] = replace(desk.own[1], blocked={"m-c": 60_000})
    desk.run(1)
    assert desk.peers[1]._stance == stance + 1


def test_reports_are_repeated_until_their_end_and_their_end_is_told() -> None:
    own = Closures(NAMES)
    assert own.report({"s1": 2_500}, "seen shut", 10 * S)
    told = [(at, each.for_ms) for at in range(10, 20) for each in own.due(at * S)]
    assert told == [(10, 2500), (11, 1500), (12, 500), (13, 0), (14, 0), (15, 0)]
    assert not own.own


def test_a_report_lapses_is_taken_back_and_the_longest_of_several_holds() -> None:
    here = Closures(NAMES)
    here.hear(1, Blocked("s1", "", 1_000), S)
    here.hear(2, Blocked("s1", "", 3_000), S)
    assert here.left_ms(S) == {"s1": 3_000}
    here.hear(2, Blocked("s1", "", 0), S)
    assert here.left_ms(S) == {"s1": 1_000}
    assert here.left_ms(3 * S) == {}


def test_one_chair_closes_no_whole_building_and_no_section_of_another_one() -> None:
    here = Closures(NAMES)
    for name in (*sorted(NAMES), "elsewhere"):
        here.hear(1, Blocked(name, "", 1_000), S)
    assert len(here.left_ms(S)) == MOST_OF_ONE
    assert not Closures(NAMES).report({"elsewhere": 5}, "", S)
