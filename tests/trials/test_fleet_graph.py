"""Hours of several chairs among people on a traffic graph, by the paper's protocol."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.errors import TrafficError
from waychair.maps.traffic.corridors import corridor_graph, load_corridors
from waychair.maps.traffic.indexed_traffic import indexed_traffic
from waychair.planning.fleet.paper.plan_fwpp import Conflicts
from waychair.simulation.graph_traffic.crowd import RightOfWay
from waychair.trials.fleet.fleet_graph import PaperPlanner, fleet_hours, free_times

LOOP = corridor_graph(load_corridors("fig8"))
NAMES = [node.name for node in LOOP.nodes]


def hours(
    plan: str, people: int, rule: RightOfWay = RightOfWay.HUMANS, seed: int = 1, chairs: int = 3
) -> list[list[float]]:
    graph = corridor_graph(load_corridors(plan))
    return fleet_hours(graph, chairs=chairs, people=people, rule=rule, hours=0.5, seed=seed).delays


def test_one_chair_alone_has_no_delay() -> None:
    (delays,) = hours("9cube", 0, chairs=1)
    assert len(delays) > 10
    assert max(delays) < 0.3  # a step of the simulation


def test_people_delay_chairs_and_the_same_seed_gives_the_same_delays() -> None:
    few, many = (float(np.mean(np.concatenate(hours("T", people)))) for people in (2, 22))
    assert many > 3 * few
    assert hours("T", 5) == hours("T", 5) != hours("T", 5, seed=2)


def test_a_top_chair_by_the_flexible_rule_is_delayed_less_than_the_others() -> None:
    runs = [hours("9cube", 12, RightOfWay.FLEXIBLE, seed) for seed in range(3)]
    top = np.mean([delay for run in runs for delay in run[0]])
    others = np.mean([delay for run in runs for chair in run[1:] for delay in chair])
    assert top < 0.5 * others


def test_more_chairs_than_places_are_refused() -> None:
    with pytest.raises(TrafficError, match="places for 7 chairs, not for 8"):
        fleet_hours(LOOP, chairs=8, people=0, rule=RightOfWay.HUMANS, hours=1.0, seed=0)
    with pytest.raises(TrafficError, match="0 chairs"):
        fleet_hours(LOOP, chairs=0, people=0, rule=RightOfWay.HUMANS, hours=1.0, seed=0)


def test_a_chair_turns_off_when_another_one_comes_towards_it_at_another_time_than_it_said() -> None:
    planner = PaperPlanner(indexed_traffic(LOOP), 2, 0.33, Conflicts.EXACT, ())
    ten, corner, twelve, end = (NAMES.index(name) for name in ("10", "02", "12", "00"))
    planner.route(1, end, corner, 1000.0)
    first = planner.route(0, ten, end, 0.0)
    assert corner in first.nodes.tolist()
    assert planner.again(0, -1, ten, end, 0.0, 0.0) is None
    planner.put_off(1, 0, 5.0)  # now the second comes towards the first on the 6 m
    better = planner.again(0, -1, ten, end, 0.0, 0.0)
    assert better is not None
    assert twelve in better.nodes.tolist()


def test_free_times_are_symmetric_and_those_of_the_shortest_ways() -> None:
    times = free_times(indexed_traffic(LOOP), 0.5)
    assert times[NAMES.index("10"), NAMES.index("00")] == pytest.approx(18.0)
    assert np.allclose(times, times.T)


def test_nobody_and_ten_thousand_people_are_possible_and_more_are_refused() -> None:
    kept = {"chairs": 2, "rule": RightOfWay.HUMANS, "hours": 0.05, "seed": 0}
    assert fleet_hours(LOOP, people=0, **kept).waited[:, 0].sum() == 0.0  # type: ignore[arg-type]
    crowded = fleet_hours(LOOP, people=10_000, **kept)  # type: ignore[arg-type]
    assert crowded.waited[:, 0].max() > 100.0
    with pytest.raises(TrafficError, match="10001 people are impossible; give 0 to 10000"):
        fleet_hours(LOOP, people=10_001, **kept)  # type: ignore[arg-type]
