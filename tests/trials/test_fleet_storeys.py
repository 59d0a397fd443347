"""Many chairs on several storeys with lifts: nobody meets, all arrive, queues at lifts are counted; the report of a run."""

from __future__ import annotations

import pytest
from evaluation.fleet.hospital_traffic import hospital_traffic

from waychair.errors import TaskError
from waychair.maps.traffic.corridors import corridor_graph, load_corridors
from waychair.maps.traffic.storeys import cut_at_lifts, lobby_in, lobby_out
from waychair.maps.traffic.traffic_graph import TrafficGraph
from waychair.maps.traffic.well_formed import pieces, well_formed
from waychair.trials.fleet.fleet_ordered import Stops, chairs_on
from waychair.trials.fleet.fleet_report import best_bay, ordered_hours, stops_by_people, waits_by_corridor, with_bay
from waychair.trials.fleet.fleet_storeys import FleetStoreys


def test_a_building_is_cut_at_its_lifts_into_storeys_that_are_well_formed() -> None:
    graph = hospital_traffic(2)
    storeys = cut_at_lifts(graph)
    assert list(storeys) == ["storey 0", "storey 1"]
    for storey in storeys.values():
        assert storey.lifts == ()
        assert len(pieces(storey)) == 1
        assert well_formed(storey) == ()
    one = storeys["storey 0"]
    assert one.refuge[lobby_in("lobby A 0")].slots == 2
    assert one.refuge[lobby_out("lobby A 0")].slots == 1
    assert "lobby A 0" not in one.refuge


def test_chairs_ride_the_lifts_and_the_same_seed_gives_the_same_arrivals() -> None:
    runs = []
    for _ in range(2):
        world = FleetStoreys(hospital_traffic(2), 30, 1, between=0.5)
        world.run(900_000)
        runs.append(world.done)
    assert runs[0].took_s == runs[1].took_s
    assert runs[0].arrivals > 30
    assert sum(map(len, runs[0].lift_waits_s.values())) > 10
    assert max(runs[0].longest_queue.values()) >= 2
    assert runs[0].without_way == 0


def test_more_chairs_than_places_are_refused() -> None:
    places = sum(refuge.name.startswith("room") for refuge in hospital_traffic(2).refuges)
    with pytest.raises(TaskError, match=f"give 1 to {places - 1} chairs"):
        FleetStoreys(hospital_traffic(2), places, 0)
    with pytest.raises(TaskError, match="99 chairs cannot go from place to place in T, which has 17 places"):
        chairs_on(tee(), 99, 0)
    with pytest.raises(TaskError, match="no two places in nobody's way"):
        chairs_on(corridor_graph(load_corridors("T")), 1, 0)


def tee() -> TrafficGraph:
    return corridor_graph(load_corridors("T"), rooms=True)


def test_the_corridor_with_the_most_waiting_is_named_and_a_bay_in_it_saves_delay() -> None:
    graph = tee()
    run = ordered_hours(graph, chairs=5, hours=0.5, seed=0, stops=Stops(), rounds=3)
    assert not run.locked_up
    corridors = waits_by_corridor(graph, run.waited_s)
    assert sum(corridors.values()) == pytest.approx(sum(run.waited_s.values()))
    assert list(corridors.values()) == sorted(corridors.values(), reverse=True)
    assert all(" to " in name for name in corridors)
    mean = sum(run.delays) / len(run.delays)
    tried: list[TrafficGraph] = []

    def again(other: TrafficGraph) -> float:
        tried.append(other)
        return mean - len(tried)

    best = best_bay(graph, mean, run.waited_s, 2, again)
    assert best is not None
    assert best.after_s == mean - 2
    assert best.node in best.corridor or best.node in graph.node
    assert all(len(other.refuges) == len(graph.refuges) + 1 for other in tried)
    assert well_formed(with_bay(graph, best.node)) == ()
    assert best_bay(graph, mean, run.waited_s, 2, lambda _: mean + 1.0) is None


def test_people_make_chairs_stop_more_often_the_more_there_are() -> None:
    few, many = (stops_by_people(tee(), persons) for persons in (2, 22))
    assert 0.0 < few.share < many.share < 1.0
    assert few.mean_s == many.mean_s > 2.0
    assert stops_by_people(tee(), 0).share == 0.0
