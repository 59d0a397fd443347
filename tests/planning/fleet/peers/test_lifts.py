"""F37: a lift that does not come, or is stuck with a chair in it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.planning.fleet.peers.buildings import Desk
from tests.planning.fleet.small_traffic import traffic
from waychair.maps.traffic.traffic_graph import TrafficLift
from waychair.planning.fleet.peers.peer import Own
from waychair.planning.fleet.ways import Ways, ways_of


def _two_lifts() -> Ways:
    """P, Q and R below and S above, joined by two lifts, of which the east one is the longer way."""
    plain = traffic("storeys", ["P-a", "Q-a", "R-a", "a-W", "V-d", "W-V", "a-b", "b-E", "F-c", "E-F", "c-d", "d-S"])
    lifts = {"W-V": "west", "E-F": "east"}
    above = {"V", "F", "c", "d", "S"}
    return ways_of(
        replace(
            plain,
            nodes=tuple(replace(node, storey="first") if node.name in above else node for node in plain.nodes),
            sections=tuple(replace(each, lift=lifts.get(each.name)) for each in plain.sections),
            lifts=(TrafficLift("west", ("W", "V")), TrafficLift("east", ("E", "F"))),
        ),
        0.5,
    )


WAYS = _two_lifts()


def _lifts(desk: Desk, number: int) -> set[str]:
    return {WAYS.names[spot] for spot in desk.steps[number].authority.chain} & {"west", "east"}


@pytest.fixture
def waiting() -> tuple[Desk, int]:
    """Chairs below, of which one that is no warden wants to go up and is granted the way to the nearer lift."""
    desk = Desk(3, ways=WAYS)
    desk.run(6)
    number = next(each for each in desk.peers if each not in desk.wardens)
    return desk, number


def test_f37_a_lift_that_does_not_come_is_closed_for_all_and_the_other_one_is_taken(waiting: tuple[Desk, int]) -> None:
    desk, number = waiting
    desk.own[number] = replace(desk.own[number], blocked={"west": 120_000})
    desk.run(0.2)
    desk.own[number] = replace(desk.own[number], blocked={})
    for each in (number, desk.wardens[0]):
        desk.wish(each, "S")
        desk.run(2)
        assert "west" not in _lifts(desk, each)
        desk.own[each] = Own(desk.own[each].entered)


def test_f37_a_cabin_with_a_silent_chair_in_it_stays_taken(waiting: tuple[Desk, int]) -> None:
    desk, stuck = waiting
    cabin = WAYS.names.index("west")
    desk.own[stuck] = Own((cabin,), 5)
    desk.run(1)
    del desk.peers[stuck]
    other = next(each for each in desk.peers if each not in desk.wardens)
    desk.run(4)
    desk.wish(other, "S")
    desk.run(3)
    assert "west" not in _lifts(desk, other)
    office = desk.peers[desk.wardens[0]].office
    assert office is not None
    assert office.district is not None
    assert int(WAYS.resource[cabin]) in office.district.order.closed
