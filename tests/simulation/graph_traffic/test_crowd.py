"""Chairs and people on a traffic graph in steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from waychair.errors import TrafficError
from waychair.maps.traffic.corridors import corridor_graph, load_corridors
from waychair.maps.traffic.traffic_graph import Section, TrafficGraph, TrafficNode
from waychair.simulation.graph_traffic.crowd import Crowd, CrowdModel, RightOfWay


def corridor(*lengths: float, lanes: int = 1) -> TrafficGraph:
    """A corridor of sections of these lengths [m]."""
    nodes = tuple(TrafficNode(f"n{i}", float(sum(lengths[:i])), 0.0) for i in range(len(lengths) + 1))
    sections = tuple(
        Section(f"s{i}", f"n{i}", f"n{i + 1}", length, 1.2 if lanes == 1 else 1.8, lanes)
        for i, length in enumerate(lengths)
    )
    return TrafficGraph("corridor", nodes, sections)


def put(crowd: Crowd, person: int, section: int, direction: int, at: float) -> None:
    """Put a person on a section, so that the meeting is known to the centimetre."""
    arrays = crowd._arrays
    arrays.facing[arrays.people.on_section[person], arrays.people.walking[person]] -= 1
    arrays.people.on_section[person], arrays.people.walking[person], arrays.people.at[person] = section, direction, at
    arrays.facing[section, direction] += 1


def time_to_arrive(crowd: Crowd, chair: int = 0, until: float = 600.0) -> float:
    while crowd.now < until:
        crowd.run(until)
        for each, when in crowd.arrived():
            if each == chair:
                return when
            crowd.give(each, [])
    return float("inf")


def test_a_chair_alone_takes_exactly_its_free_time() -> None:
    crowd = Crowd(corridor(8.0, 3.0, 1.0), [0], 0, RightOfWay.HUMANS, 1)
    crowd.give(0, [0, 1, 2])
    assert time_to_arrive(crowd) == pytest.approx(12.0 / 0.33 + crowd.model.step_s, abs=1e-6)


def test_by_rule_a_a_chair_waits_at_the_node_until_nobody_comes_towards_it() -> None:
    crowd = Crowd(corridor(9.0, 30.0), [0], 1, RightOfWay.HUMANS, 1)
    put(crowd, 0, 0, 1, 0.0)  # from n1 to n0, 9 m at 0.6 m/s
    crowd.give(0, [0])
    assert time_to_arrive(crowd) == pytest.approx(15.0 + 9.0 / 0.33, abs=0.6)
    assert crowd.waited[0, 0] == pytest.approx(15.0, abs=0.6)


def test_by_rule_a_a_chair_on_a_section_stands_until_the_person_has_passed() -> None:
    crowd = Crowd(corridor(9.0, 9.0), [0], 1, RightOfWay.HUMANS, 1)
    put(crowd, 0, 1, 1, 3.0)  # enters the chair's section when the chair is on it
    crowd.give(0, [0])
    assert time_to_arrive(crowd) == pytest.approx(1.5 / 0.6 + 9.0 / 0.33, abs=0.6)
    assert crowd.people_held_up == 0.0


def test_by_rule_b_the_person_stands_and_the_chair_drives_on() -> None:
    crowd = Crowd(corridor(9.0, 9.0), [0], 1, RightOfWay.CHAIRS, 1)
    put(crowd, 0, 0, 1, 1.0)
    crowd.give(0, [0])
    assert time_to_arrive(crowd) == pytest.approx(9.0 / 0.33, abs=0.26)
    assert crowd.people_held_up == pytest.approx(1.5 / 0.33, abs=0.6)


def test_by_rule_c_people_stand_for_a_top_chair_and_a_routine_chair_for_people() -> None:
    times = []
    for top in ((0,), ()):
        crowd = Crowd(corridor(9.0, 9.0), [0], 1, RightOfWay.FLEXIBLE, 1, top=top)
        put(crowd, 0, 0, 1, 1.0)
        crowd.give(0, [0])
        times.append(time_to_arrive(crowd))
    assert times[0] == pytest.approx(9.0 / 0.33, abs=0.26)
    assert times[1] > times[0] + 10.0


def trap(inheritance: bool) -> float:
    """The time that a top chair takes behind a routine chair which meets a person who stands for the top chair."""
    model = CrowdModel(inheritance=inheritance)
    crowd = Crowd(corridor(12.0, 12.0), [0, 0], 1, RightOfWay.FLEXIBLE, 1, top=(1,), model=model)
    put(crowd, 0, 1, 1, 0.0)  # 24 m from the chairs, so that both are under way when it comes near
    crowd.give(0, [0])
    crowd.run(4.5)
    crowd.give(1, [0])
    return time_to_arrive(crowd, chair=1, until=900.0)


def test_without_inheritance_the_flexible_rule_locks_up_for_good() -> None:
    assert trap(inheritance=False) == float("inf")


def test_a_chair_in_a_top_chairs_way_inherits_its_priority_towards_people_too() -> None:
    assert trap(inheritance=True) < 60.0


def test_chairs_of_opposite_directions_take_turns_on_one_lane_and_pass_on_two() -> None:
    for lanes, last in ((1, 2 * 8.0 / 0.33), (2, 8.0 / 0.33)):
        crowd = Crowd(corridor(8.0, lanes=lanes), [0, 1], 0, RightOfWay.HUMANS, 3)
        crowd.give(0, [0])
        crowd.give(1, [0])
        times = [time_to_arrive(crowd, chair) for chair in (0, 1)]
        assert max(times) == pytest.approx(last, abs=0.6)


def test_a_chair_behind_another_keeps_its_gap() -> None:
    crowd = Crowd(corridor(8.0), [0, 0], 0, RightOfWay.HUMANS, 3)
    crowd.give(0, [0])
    crowd.give(1, [0])
    while crowd.now < 20.0:
        crowd.run(crowd.now + 0.25)
        a, b = crowd._arrays.chairs.offset
        assert abs(a - b) >= 1.2 - 0.1 or min(a, b) == 0.0


def test_people_spread_over_a_house_and_turn_back_at_dead_ends_only() -> None:
    graph = corridor_graph(load_corridors("2bconR"))
    crowd = Crowd(graph, [0], 40, RightOfWay.HUMANS, 4)
    crowd.give(0, [])
    seen = np.zeros(len(graph.sections))
    before = crowd._arrays.people.on_section.copy()
    for _ in range(400):
        crowd.run(crowd.now + 1.0)
        crowd.give(0, [])
        seen += np.bincount(crowd._arrays.people.on_section, minlength=len(seen))
    lengths = np.array([section.length for section in graph.sections])
    assert (seen / seen.sum() > 0.4 * lengths / lengths.sum()).all()
    assert (crowd._arrays.people.on_section != before).any()
    assert crowd._arrays.facing.sum() == 40


def test_the_same_seed_moves_everybody_the_same_way() -> None:
    graph = corridor_graph(load_corridors("9cube"))

    def state(seed: int) -> bytes:
        crowd = Crowd(graph, [0, 5], 12, RightOfWay.HUMANS, seed)
        crowd.give(0, [])
        crowd.run(50.0)
        return crowd._arrays.people.at.tobytes()

    assert state(1) == state(1) != state(2)


def test_a_permit_is_needed_where_permits_rule_and_is_used_up() -> None:
    crowd = Crowd(corridor(3.0, 3.0), [0], 0, RightOfWay.HUMANS, 1, permits=True)
    crowd.give(0, [0, 1])
    assert crowd.run(60.0)
    assert crowd.asking() == [0]
    crowd.permit(0, 0)
    assert crowd.run(60.0)
    assert (crowd.asking(), crowd.node_of(0), crowd.section_of(0)) == ([0], 1, -1)
    crowd.permit(0, 1)
    assert time_to_arrive(crowd) < 25.0


@pytest.mark.parametrize("people", [-1, 10_001])
def test_an_impossible_number_of_people_is_refused(people: int) -> None:
    with pytest.raises(TrafficError, match="people are impossible"):
        Crowd(corridor(3.0), [0], people, RightOfWay.HUMANS, 1)


def test_ten_thousand_people_and_none_are_crowds() -> None:
    graph = replace(corridor_graph(load_corridors("T")), name="full")
    for people in (0, 10_000):
        crowd = Crowd(graph, [0], people, RightOfWay.HUMANS, 1)
        crowd.give(0, [0])
        crowd.run(2.0)
        assert crowd.now >= 2.0
