from __future__ import annotations

import pytest

from waychair.simulation.plan.world import World, load_levels
from waychair.trials.travel.which_storey_study import alike_counts, counts, rides


@pytest.fixture(scope="module")
def hospital() -> tuple[World, ...]:
    return load_levels("hospital")


@pytest.mark.nightly
def test_imu_and_map_find_out_the_storey_of_every_ride(hospital: tuple[World, ...]) -> None:
    assert counts(rides(hospital, 20, seed=5)) == {"rides": 20, "right": 20, "asked": 0, "wrong": 0}


def test_without_an_imu_no_storey_is_mistaken_and_alike_ones_are_always_asked_for(hospital: tuple[World, ...]) -> None:
    found = rides(hospital, 60, seed=6, imu=False)
    assert counts(found)["wrong"] == 0
    alike = alike_counts(found, ("2", "3"))
    assert alike["asked"] == alike["rides"] > 10


@pytest.mark.nightly
def test_no_storey_is_mistaken_in_many_rides(hospital: tuple[World, ...]) -> None:
    found = counts(rides(hospital, 1000, seed=7))
    assert (found["wrong"], found["right"] >= 990) == (0, True)
