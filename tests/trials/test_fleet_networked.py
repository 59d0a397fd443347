"""Chairs over a bad network keep every rule, and a bug in a rule is seen."""

from __future__ import annotations

import pytest
from evaluation.fleet.network_runs import MUTANTS, killed_by, warden_killed

from waychair.maps.traffic.corridors import corridor_graph, load_corridors
from waychair.simulation.network import NetworkFaults
from waychair.trials.fleet.fleet_invariants import Invariants, troubles
from waychair.trials.fleet.fleet_networked import NetworkedChairs, NetworkTrouble

T = corridor_graph(load_corridors("T"), rooms=True)


def test_chairs_arrive_through_loss_partition_crash_and_sleep_without_breaking_a_rule() -> None:
    cuts = [
        NetworkTrouble(15_000, 12_000, "part", ((1,), (2, 3))),
        NetworkTrouble(40_000, 3_000, "crash", ((2,),)),
        NetworkTrouble(50_000, 10_000, "sleep", ((3,),)),
        NetworkTrouble(62_000, 5_000, "deaf", ((1, 2),)),
    ]
    faults = NetworkFaults(loss=0.15, doubled=0.1, delay_ms=30.0, late=0.02, drift_ppm=200.0)
    digests = []
    for _ in range(2):
        world, watch = NetworkedChairs(T, 3, 4, faults, cuts, last_wish_ms=60_000), Invariants()
        world.run(200_000, watch)
        watch.end(world)
        assert watch.faults == []
        assert sum(len(chair.done) for chair in world.chairs.values()) >= 3
        digests.append(world.sent.hexdigest())
    assert digests[0] == digests[1]


def test_the_order_goes_on_four_seconds_after_the_warden_was_killed() -> None:
    assert all(0.0 < warden_killed(seed) <= 4.0 for seed in range(3))


def test_troubles_are_the_same_for_the_same_seed() -> None:
    assert troubles(5, 3) == troubles(5, 3) != troubles(5, 4)


@pytest.mark.nightly
@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.rule)
def test_a_bug_in_each_rule_is_found(mutant) -> None:  # type: ignore[no-untyped-def]
    assert killed_by(mutant, range(20)) is not None
