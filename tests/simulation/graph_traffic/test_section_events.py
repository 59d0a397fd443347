"""Chairs on a traffic graph from event to event."""

from __future__ import annotations

from itertools import pairwise

import pytest

from waychair.errors import TrafficError
from waychair.maps.traffic.traffic_graph import Section, TrafficGraph, TrafficLift, TrafficNode
from waychair.simulation.graph_traffic.section_events import SectionEvents, StopModel

GRAPH = TrafficGraph(
    "house",
    tuple(TrafficNode(name, float(i), 0.0) for i, name in enumerate("abcd")),
    (
        Section("ab", "a", "b", 5.0, 1.2),
        Section("bc", "b", "c", 5.0, 1.8, 2),
        Section("cd", "c", "d", 2.0, 1.2, delay_s=30.0, lift="north"),
        Section("bd", "b", "d", 2.0, 1.2, delay_s=40.0, lift="north"),
    ),
    lifts=(TrafficLift("north", ("b", "c", "d")),),
)


def test_a_chair_leaves_a_section_after_its_free_time() -> None:
    events = SectionEvents(GRAPH, [0], speed=0.5)
    assert events.enter(0, 0) == 10.0
    assert events.next_left(9.0) is None
    assert events.now_s == 9.0
    assert events.next_left() == (10.0, 0, 0, 1)
    assert events.next_left() is None


def test_one_lane_takes_one_direction_and_two_lanes_both() -> None:
    events = SectionEvents(GRAPH, [0, 1, 0, 2], speed=0.5)
    events.enter(0, 0)
    assert not events.may_enter(1, 0)
    assert events.may_enter(2, 0)
    with pytest.raises(TrafficError, match="would meet another chair on section ab"):
        events.enter(1, 0)
    events.enter(1, 1)
    assert events.may_enter(3, 1)
    with pytest.raises(TrafficError, match="not at an end of section ab"):
        events.enter(3, 0)


def test_a_lift_takes_one_chair_at_a_time_whatever_its_stops() -> None:
    events = SectionEvents(GRAPH, [2, 2, 1], speed=0.5)
    assert events.enter(0, 2) == 34.0
    assert not events.may_enter(1, 2)
    assert not events.may_enter(2, 3)
    events.next_left()
    assert events.may_enter(2, 3)


def test_chairs_behind_each_other_keep_order_and_gap_whatever_stops_them() -> None:
    events = SectionEvents(GRAPH, [0] * 20, speed=0.5, gap_s=3.0, stops=StopModel(0.2, 20.0), seed=3)
    times = [events.enter(chair, 0) for chair in range(20)]
    assert all(later - earlier >= 3.0 for earlier, later in pairwise(times))
    order = []
    while (left := events.next_left()) is not None:
        order.append(left.chair)
    assert order == list(range(20))


def test_stops_last_as_long_as_they_should_and_come_from_the_seed() -> None:
    def delays(seed: int) -> list[float]:
        events = SectionEvents(GRAPH, [0] * 2000, speed=0.5, gap_s=-1e9, stops=StopModel(0.05, 15.0), seed=seed)
        return [events.enter(chair, 0) - 10.0 for chair in range(2000)]

    first = delays(1)
    assert sum(first) / len(first) == pytest.approx(0.05 * 10.0 * 15.0, rel=0.15)
    assert first == delays(1) != delays(2)
