"""The demo rider's turn at the end of the mapping drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import WorldError
from waychair.simulation.follower import Follower, follow
from waychair.simulation.plan.world import load_world
from waychair.simulation.plant.plant import PlantSettings
from waychair.simulation.simulator import Simulator
from waychair.trials.demo.demo import WORLD, randomised_settings, return_route
from waychair.types import FloatArray, Pose2

END = Pose2(6.45, 7.12, 2.78)
"""The true end of the mapping drive on the second floor, beside lockers."""


def turns_round(route: FloatArray, seed: int) -> bool:
    """Return whether a rider starts back along a route without a contact."""
    simulator = Simulator(
        replace(load_world(WORLD).without_people(), start=END), CHAIR_A, randomised_settings(seed), seed
    )
    for _ in follow(simulator, Follower(route, CHAIR_A.track, PlantSettings())):
        if simulator.truth().x > END.x + 1.0:
            return True
    return False


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(5))
def test_the_rider_drives_on_to_a_place_with_room_to_turn(seed: int) -> None:
    assert turns_round(return_route(load_world(WORLD)), seed)


def test_at_the_very_end_there_is_no_room_to_turn() -> None:
    with pytest.raises(WorldError, match="touched something"):
        turns_round(load_world(WORLD).route()[-2::-1], 3)


def test_with_room_to_turn_the_rider_turns_at_once() -> None:
    world = load_world("small_clinic")
    assert np.array_equal(return_route(world), world.route()[-2::-1])
