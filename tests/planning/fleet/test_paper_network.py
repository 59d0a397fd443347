"""The paper's node network: labels, commitments, filters, stops and admission."""

from __future__ import annotations

import random
from collections import Counter

import numpy as np
import pytest

from waychair.errors import TrafficError
from waychair.maps.traffic.corridors import corridor_graph, floor_plan_names, load_corridors
from waychair.maps.traffic.indexed_traffic import indexed_traffic
from waychair.maps.traffic.traffic_graph import Refuge, RefugeKind, Section, TrafficGraph, TrafficNode
from waychair.planning.fleet.paper.admission import Asking, Tie, first_to_go
from waychair.planning.fleet.paper.baselines import PaperPreset, preset_route, reading_of
from waychair.planning.fleet.paper.bloom import empty_filter
from waychair.planning.fleet.paper.docking import dock_nodes
from waychair.planning.fleet.paper.goal_filters import distances_from
from waychair.planning.fleet.paper.harmonic_rules import (
    HarmonicRule,
    RulePriority,
    chair_stands_for_chair,
    chair_stands_for_people,
    check_rule_for_driving,
    right_hand_offset,
)
from waychair.planning.fleet.paper.network import FoundRoute, NodeNetwork, SearchStops
from waychair.planning.fleet.paper.plan_fwpp import Conflicts, commit, no_commitments, plan_route

SPEED = 0.5


def graph_of(*sections: tuple[str, str, float], **more: object) -> TrafficGraph:
    """A graph of single-file sections by their ends and lengths [m]."""
    names = dict.fromkeys(name for start, end, _ in sections for name in (start, end))
    return TrafficGraph(
        "test",
        tuple(TrafficNode(name, float(i), 0.0) for i, name in enumerate(names)),
        tuple(Section(f"{a}{b}", a, b, length, 1.2) for a, b, length in sections),
        **more,  # type: ignore[arg-type]
    )


LOOP = graph_of(("a", "b", 10.0), ("b", "d", 10.0), ("a", "c", 12.0), ("c", "d", 12.0))
"""Two ways from a to d: 20 m over b and 24 m over c."""


def route_by_network(
    network: NodeNetwork, chair: int, source: str, target: str, start_s: float = 0.0, priority: int = 0
) -> FoundRoute:
    return network.search(chair, source, target, start_s=start_s, speed=SPEED, priority=priority)


def test_the_first_chair_takes_the_shortest_way_and_all_its_nodes_commit() -> None:
    network = NodeNetwork(LOOP)
    found = route_by_network(network, 0, "a", "d", start_s=100.0)
    assert found == (("a", "b", "d"), ("ab", "bd"), (100.0, 120.0, 140.0))
    assert {name for name, node in network.nodes.items() if 0 in node.committed} == {"a", "b", "d"}
    committed = network.nodes["b"].committed[0]
    assert (committed.arrival_s, committed.section, committed.ahead, committed.ahead_s) == (120.0, "bd", "d", 140.0)


@pytest.mark.parametrize(
    ("conflicts", "start_s", "way"),
    [
        (Conflicts.NONE, 25.0, "dba"),
        (Conflicts.READ, 25.0, "dca"),  # the first chair is on bd from 20 to 40 s
        (Conflicts.READ, 10.0, "dba"),  # not seen: the second is at d before the first is on bd
        (Conflicts.EXACT, 10.0, "dca"),
        (Conflicts.EXACT, 25.0, "dca"),
        (Conflicts.PRINTED, 10.0, "dba"),  # does not hold where the two meet
        (Conflicts.PRINTED, 25.0, "dca"),  # but on ab, which the first has left for longer than it took
    ],
)
def test_the_second_chair_goes_round_the_conflicts_that_its_reading_sees(
    conflicts: Conflicts, start_s: float, way: str
) -> None:
    network = NodeNetwork(LOOP, conflicts)
    route_by_network(network, 0, "a", "d")
    assert "".join(route_by_network(network, 1, "d", "a", start_s=start_s).nodes) == way


def test_the_penalty_is_the_others_time_on_the_section_and_the_exact_one_the_time_until_it_is_free() -> None:
    corridor = graph_of(("a", "b", 10.0), ("b", "c", 10.0))
    for conflicts, wait in ((Conflicts.READ, 20.0), (Conflicts.EXACT, 15.0)):
        network = NodeNetwork(corridor, conflicts)
        route_by_network(network, 0, "a", "c")  # on bc from 20 to 40 s
        assert route_by_network(network, 1, "c", "b", start_s=25.0).arrivals_s[-1] == 25.0 + wait + 20.0


def test_a_lower_priority_costs_nothing_and_a_higher_one_its_time() -> None:
    corridor = graph_of(("a", "b", 10.0), ("b", "c", 10.0))
    for first, second, arrival in ((0, 1, 45.0), (1, 0, 65.0), (1, 1, 65.0)):
        network = NodeNetwork(corridor)
        route_by_network(network, 0, "a", "c", priority=first)
        assert route_by_network(network, 1, "c", "b", start_s=25.0, priority=second).arrivals_s[-1] == arrival


@pytest.mark.parametrize(("slow_start_s", "penalty"), [(20.0, 20.0), (12.0, 40.0)])
def test_by_equation_two_a_higher_chair_counts_alone_where_arrivals_are_close(
    slow_start_s: float, penalty: float
) -> None:
    network = NodeNetwork(graph_of(("a", "b", 10.0), ("b", "c", 10.0)))
    route_by_network(network, 0, "b", "c", start_s=22.0, priority=1)  # on bc for 20 s; a third is 6.7 s
    network.search(1, "b", "c", start_s=slow_start_s, speed=0.25)  # on bc for 40 s
    assert route_by_network(network, 2, "c", "b", start_s=25.0).arrivals_s[-1] == 25.0 + penalty + 20.0


@pytest.mark.parametrize("name", floor_plan_names())
@pytest.mark.parametrize("conflicts", list(Conflicts))
def test_messages_and_kernel_give_the_same_labels(name: str, conflicts: Conflicts) -> None:
    graph = corridor_graph(load_corridors(name))
    arrays = indexed_traffic(graph)
    names = [node.name for node in graph.nodes]
    dice = np.random.default_rng(5)
    network = NodeNetwork(graph, conflicts, filtered=False)
    commitments = no_commitments(6, len(names))
    commitments.priority[:] = dice.integers(0, 2, size=6)
    durations, closed = arrays.seconds(SPEED), np.zeros(len(graph.sections), dtype=np.int64)
    for chair in range(6):
        source, target = dice.choice(len(names), size=2, replace=False)
        start_s = float(dice.uniform(0.0, 30.0))
        planned = plan_route(
            arrays, durations, closed, chair, int(source), int(target), start_s, commitments, conflicts
        )
        found = route_by_network(
            network, chair, names[source], names[target], start_s, int(commitments.priority[chair])
        )
        assert planned is not None
        assert found.arrivals_s[-1] == pytest.approx(start_s + planned.labels[-1])
        if tuple(names[i] for i in planned.nodes) != found.nodes:  # a tie: go on with the network's
            number = {section.name: i for i, section in enumerate(graph.sections)}
            planned = planned._replace(
                sections=np.array([number[section] for section in found.sections]),
                nodes=np.array([names.index(node) for node in found.nodes]),
                labels=np.array(found.arrivals_s) - start_s,
            )
        commit(arrays, commitments, chair, planned, start_s, durations)


@pytest.mark.parametrize("name", ["T", "9cube", "2d-grid"])
def test_filters_save_messages_and_lose_no_shortest_route(name: str) -> None:
    graph = corridor_graph(load_corridors(name))
    flood, filtered = NodeNetwork(graph, Conflicts.NONE, filtered=False), NodeNetwork(graph, Conflicts.NONE)
    names = [node.name for node in graph.nodes]
    dice = np.random.default_rng(1)
    for _ in range(20):
        source, target = (names[i] for i in dice.choice(len(names), size=2, replace=False))
        shortest = distances_from(graph, source)[target] * 0.33 / SPEED
        for network in (flood, filtered):
            assert route_by_network(network, 0, source, target).arrivals_s[-1] == pytest.approx(shortest)
    assert filtered.messages["Query"] < 0.8 * flood.messages["Query"]
    assert sum(node.work for node in filtered.nodes.values()) < sum(node.work for node in flood.nodes.values())


def test_a_bloom_filter_denies_no_member_and_few_strangers() -> None:
    members = empty_filter(100).with_names(f"room {i}" for i in range(100))
    assert all(f"room {i}" in members for i in range(100))
    strangers = sum(f"ward {i}" in members for i in range(2000))
    assert strangers < 60  # 1 % are expected
    assert members.bytes == 120
    assert "room 1" not in empty_filter(0)


def test_a_closed_section_is_searched_round_and_an_open_one_is_taken_again() -> None:
    network = NodeNetwork(LOOP)
    network.close("ab")
    assert route_by_network(network, 0, "a", "d").nodes == ("a", "c", "d")
    assert network.messages["Filter"] > 0
    network.close("ac")
    with pytest.raises(TrafficError, match="no way from a to d"):
        route_by_network(network, 0, "a", "d")
    network.open("ab")
    assert route_by_network(network, 0, "a", "d").nodes == ("a", "b", "d")
    with pytest.raises(TrafficError, match="no section xy"):
        network.close("xy")


def test_a_search_stops_after_its_hops_and_at_its_timer() -> None:
    corridor = graph_of(("a", "b", 5.0), ("b", "c", 5.0), ("c", "d", 5.0))
    for stops in (SearchStops(hops=2), SearchStops(timer_s=0.05)):
        network = NodeNetwork(corridor, stops=stops)
        with pytest.raises(TrafficError, match="no way from a to d"):
            route_by_network(network, 0, "a", "d")
        assert not any(node.committed or node.searches for node in network.nodes.values())
    assert route_by_network(NodeNetwork(corridor, stops=SearchStops(hops=3)), 0, "a", "d").nodes[-1] == "d"


def test_a_late_chair_is_announced_along_its_route_and_a_new_search_ends_the_old_promises() -> None:
    network = NodeNetwork(LOOP)
    route_by_network(network, 0, "a", "d")
    network.late(0, "b", 7.0)
    times = [network.nodes[name].committed[0].arrival_s for name in "abd"]
    assert times == [0.0, 27.0, 47.0]
    route_by_network(network, 0, "a", "c")
    assert {name for name, node in network.nodes.items() if 0 in node.committed} == {"a", "c"}


def test_a_goal_at_the_start_is_a_route_of_no_sections() -> None:
    assert route_by_network(NodeNetwork(LOOP), 0, "a", "a", start_s=3.0) == (("a",), (), (3.0,))


def test_an_unknown_node_is_named() -> None:
    with pytest.raises(TrafficError, match="no node x"):
        route_by_network(NodeNetwork(LOOP), 0, "a", "x")


@pytest.mark.parametrize("preset", list(PaperPreset))
def test_every_planner_of_the_paper_finds_a_way_that_hangs_together(preset: PaperPreset) -> None:
    graph = corridor_graph(load_corridors("4cross"))
    names = [node.name for node in graph.nodes]
    network, dice = NodeNetwork(graph, reading_of(preset)), random.Random(2)
    for chair in range(4):
        source, target = dice.sample(names, 2)
        found = preset_route(preset, network, chair, source, target, start_s=0.0, speed=0.33, dice=dice)
        assert (found.nodes[0], found.nodes[-1]) == (source, target)
        for section, here, ahead in zip(found.sections, found.nodes, found.nodes[1:], strict=False):
            assert {graph.section[section].start, graph.section[section].end} == {here, ahead}
        assert list(found.arrivals_s) == sorted(found.arrivals_s)


def test_equal_chairs_have_half_the_chance_each_and_a_higher_one_goes_first() -> None:
    asking = [Asking(0, 0, 5.0), Asking(1, 0, 3.0)]
    dice = random.Random(1)
    firsts = Counter(first_to_go(asking, Tie.HALF_HALF, dice).chair for _ in range(1000))
    assert 440 < firsts[0] < 560
    assert first_to_go(asking, Tie.EARLIEST, dice).chair == 1
    assert first_to_go(asking, Tie.LATEST, dice).chair == 0
    assert first_to_go([*asking, Asking(2, 1, 9.0)], Tie.EARLIEST, dice).chair == 2


def test_the_three_rules_say_who_stands_for_whom() -> None:
    assert chair_stands_for_people(HarmonicRule.HUMANS, RulePriority.TOP)
    assert not chair_stands_for_people(HarmonicRule.CHAIRS, RulePriority.ROUTINE)
    assert [chair_stands_for_people(HarmonicRule.FLEXIBLE, level) for level in RulePriority] == [True, False, False]
    assert [chair_stands_for_chair(RulePriority.ROUTINE, other) for other in RulePriority] == [None, True, True]
    check_rule_for_driving(HarmonicRule.HUMANS)
    with pytest.raises(TrafficError, match="simulations only"):
        check_rule_for_driving(HarmonicRule.CHAIRS)


def test_chairs_keep_right_on_two_lanes_and_the_middle_on_one() -> None:
    assert right_hand_offset(Section("wide", "a", "b", 5.0, 1.8, 2)) == pytest.approx(0.45)
    assert right_hand_offset(Section("narrow", "a", "b", 5.0, 1.2)) == 0.0


def test_every_chair_has_a_dock() -> None:
    docks = (
        Refuge("dock 1", "b", kind=RefugeKind.DOCK, owner=1),
        Refuge("docks", "c", kind=RefugeKind.DOCK, slots=1),
    )
    graph = graph_of(("a", "b", 5.0), ("b", "c", 5.0), ("c", "d", 5.0), refuges=docks)
    assert dock_nodes(graph, ["a", "a", "d"]) == ("c", "b", "d")
    with pytest.raises(TrafficError, match="starts at node x"):
        dock_nodes(graph, ["x"])
