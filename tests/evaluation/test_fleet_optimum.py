"""The proven optimum of one task each, with which the fleet's planners are compared."""

from __future__ import annotations

import pytest
from evaluation.fleet.optimum import least_mean_delay
from evaluation.fleet.paper_tables import FLEXIBLE, HUMANS_FIRST

from waychair.maps.traffic.corridors import corridor_graph, load_corridors
from waychair.maps.traffic.traffic_graph import Section, TrafficGraph, TrafficNode
from waychair.planning.fleet.paper.baselines import PaperPreset
from waychair.trials.fleet.fleet_tasks import Instance, do_tasks, random_instance


def test_two_chairs_that_swap_the_ends_of_a_corridor_wait_once() -> None:
    nodes = tuple(TrafficNode(name, float(i), 0.0) for i, name in enumerate("abc"))
    graph = TrafficGraph("corridor", nodes, (Section("ab", "a", "b", 3.3, 1.2), Section("bc", "b", "c", 6.6, 1.2)))
    assert least_mean_delay(graph, ["a", "c"], ["c", "a"]) == pytest.approx(5.0)  # 10 s for one: they pass at b


def test_chairs_that_do_not_meet_have_no_delay() -> None:
    graph = corridor_graph(load_corridors("Rectangle"))
    names = [node.name for node in graph.nodes]
    assert least_mean_delay(graph, names[:2], names[:2]) == pytest.approx(0.0)


@pytest.mark.parametrize("plan", ["T", "3tie"])
def test_no_planner_of_the_paper_beats_the_optimum(plan: str) -> None:
    graph = corridor_graph(load_corridors(plan))
    for seed in range(3):
        instance = random_instance(graph, 3, seed)
        least = least_mean_delay(graph, instance.starts, instance.goals)
        assert least is not None
        for preset in PaperPreset:
            done = do_tasks(graph, instance, preset, seed)
            assert sum(done.delays) / 3 >= least - 1e-6
            assert done.messages > 0


def test_the_exact_conflicts_let_a_pair_pass_where_it_costs_least() -> None:
    graph = corridor_graph(load_corridors("fig8"))
    instance = Instance(("10", "00"), ("00", "10"))
    done = do_tasks(graph, instance, PaperPreset.EXACT, 1)
    assert sum(done.delays) == pytest.approx(2.0 / 0.33, abs=0.01)  # one of them takes the way over 12, 2 m longer
    shortest = do_tasks(graph, instance, PaperPreset.FWOUTP, 1)
    assert sum(shortest.delays) >= sum(done.delays)


def test_the_tables_of_the_paper_fall_from_humans_first_to_flexible() -> None:
    assert all(
        flexible < humans
        for plan in HUMANS_FIRST
        for flexible, humans in zip(FLEXIBLE[plan], HUMANS_FIRST[plan], strict=True)
    )
