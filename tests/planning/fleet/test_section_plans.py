"""Plans where nodes hold any number of chairs: the proven best, never two chairs against each other, an order that can be kept."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from evaluation.fleet.optimum import least_mean_delay

from waychair.errors import TrafficError
from waychair.maps.traffic.corridors import corridor_graph, load_corridors
from waychair.maps.traffic.indexed_traffic import indexed_traffic
from waychair.maps.traffic.traffic_graph import Section, TrafficGraph, TrafficNode
from waychair.planning.fleet.section_plans import Drive, SectionOrder, SectionPlanner, SectionUse, Trip
from waychair.simulation.graph_traffic.crowd import RightOfWay
from waychair.trials.fleet.fleet_coordinated import coordinated_hours
from waychair.trials.fleet.fleet_graph import fleet_hours, free_times
from waychair.trials.fleet.fleet_tasks import PAPER_SPEED, coordinated_tasks, random_instance


def plan_of(name: str) -> TrafficGraph:
    return corridor_graph(load_corridors(name))


def planner_of(graph: TrafficGraph) -> SectionPlanner:
    indexed = indexed_traffic(graph)
    return SectionPlanner(indexed, PAPER_SPEED, free_times(indexed, PAPER_SPEED))


def meet(drives: Sequence[Drive]) -> bool:
    """Return whether two chairs are on a section against each other, by comparing all pairs."""
    uses = [(chair, use) for chair, drive in enumerate(drives) for use in drive]
    return any(
        a != b
        and one.section == other.section
        and one.direction != other.direction
        and one.from_ms < other.until_ms
        and other.from_ms < one.until_ms
        for a, one in uses
        for b, other in uses
    )


@pytest.mark.parametrize("name", ["T", "4cross", "3tie"])
def test_the_plans_have_the_least_delay_that_is_possible(name: str) -> None:
    graph = plan_of(name)
    planner = planner_of(graph)
    for seed in range(6):
        instance = random_instance(graph, 5, seed)
        least = least_mean_delay(graph, instance.starts, instance.goals)
        assert least is not None
        assert np.mean(coordinated_tasks(graph, planner, instance).delays) == pytest.approx(least, abs=0.01)


@pytest.mark.parametrize("steps", [0, 400])
def test_no_two_chairs_are_on_a_section_against_each_other(steps: int) -> None:
    planner = planner_of(plan_of("2bconR"))
    rng = np.random.default_rng(3)
    for _ in range(20):
        starts, goals = (rng.permutation(8)[:6].tolist() for _ in range(2))
        found = planner.plans([Trip(*each, 0) for each in zip(starts, goals, strict=True)], steps=steps)
        assert found is not None
        assert not meet(found.drives)


def test_a_chair_waits_for_one_on_its_section_and_a_heavier_one_goes_first() -> None:
    graph = plan_of("T")
    planner = planner_of(graph)
    (way,) = planner.plans([Trip(0, 1, 0)]).drives  # type: ignore[union-attr]
    first = way[0]
    busy = SectionUse(first.section, 1 - first.direction, 0, 9000)
    (late,) = planner.plans([Trip(0, 1, 0)], [busy]).drives  # type: ignore[union-attr]
    assert late[0].from_ms == 9000
    for heavy in (0, 1):
        trips = [Trip(0, 1, 0, 1.0 + 9.0 * (heavy == 0)), Trip(1, 0, 100, 1.0 + 9.0 * (heavy == 1))]
        drives = planner.plans(trips).drives  # type: ignore[union-attr]
        assert drives[heavy][-1].until_ms - trips[heavy].ready_ms == planner.alone_ms(0, 1)


def test_the_order_lets_the_later_one_in_when_the_earlier_one_has_left() -> None:
    indexed = indexed_traffic(plan_of("T"))
    order = SectionOrder(indexed)
    order.set({1: (SectionUse(0, 0, 0, 100), SectionUse(1, 0, 100, 200)), 2: (SectionUse(0, 1, 100, 200),)})
    assert order.before(1, 0) is None
    assert order.before(2, 0) == 1
    order.left(1)
    assert order.before(2, 0) is None
    assert order.following(1) == 1


def test_a_goal_without_a_way_has_no_plan() -> None:
    apart = TrafficGraph(
        "apart",
        tuple(TrafficNode(name, 0.0, 0.0) for name in "abcd"),
        (Section("a-b", "a", "b", 4.0, 1.2), Section("c-d", "c", "d", 4.0, 1.2)),
    )
    planner = planner_of(apart)
    assert planner.plans([Trip(0, 3, 0)]) is None
    with pytest.raises(TrafficError, match="no way leads from node 0 to node 3"):
        planner.alone_ms(0, 3)


def test_the_coordinator_delays_chairs_less_than_the_paper_and_the_top_chair_least() -> None:
    graph = plan_of("9cube")
    kept = {"chairs": 3, "people": 4, "rule": RightOfWay.FLEXIBLE, "hours": 0.7, "seed": 1}
    ours, paper = coordinated_hours(graph, **kept), fleet_hours(graph, **kept)  # type: ignore[arg-type]
    assert coordinated_hours(graph, **kept).delays == ours.delays  # type: ignore[arg-type]
    assert sum(map(len, ours.delays)) > 20
    assert not ours.locked_up
    assert np.mean(ours.delays[0]) < np.mean(paper.delays[0])


def test_one_chair_alone_has_no_delay_by_the_coordinator() -> None:
    run = coordinated_hours(plan_of("I"), chairs=1, people=0, rule=RightOfWay.HUMANS, hours=0.5, seed=0)
    assert max(run.delays[0]) < 0.3
