"""The rider who knows the way."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.calibration.chair import CHAIR_A, CHAIR_B, ChairBody
from waychair.errors import WorldError
from waychair.simulation.follower import Follower, follow
from waychair.simulation.plant import PlantSettings, randomised
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.simulation.world import load_world, world_from_grid
from waychair.types import OccupancyGrid, Pose2, Scan

NOMINAL = PlantSettings()


@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_B])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_clinics_route_is_finished_without_contact(body: ChairBody, seed: int) -> None:
    world = load_world("small_clinic")
    plant = randomised(NOMINAL, seed) if seed else NOMINAL
    simulator = Simulator(world, body, SimulatorSettings(plant=plant), seed=seed)
    follower = Follower(world.route(), body.track, NOMINAL)
    left = [tuple(waypoint) for waypoint in world.route().tolist()]
    scans = 0
    for message in follow(simulator, follower):
        scans += isinstance(message, Scan)
        pose = simulator.truth()
        if left and np.hypot(pose.x - left[0][0], pose.y - left[0][1]) < 0.2:
            left.pop(0)
    assert not left
    assert follower.done
    assert simulator.contacts == 0
    assert 1000 < scans < 2500
    assert follower.volts(simulator.truth()) == (1.65, 1.65)


def test_the_chair_rests_with_released_lines_when_the_route_is_done() -> None:
    world = load_world("small_clinic")
    simulator = Simulator(world, CHAIR_A)
    for _ in follow(simulator, Follower(np.array([[2.0, 1.0]]), CHAIR_A.track, NOMINAL)):
        pass
    simulator.advance(2_000_000_000)
    assert (simulator.truth().x, simulator.truth().y) == pytest.approx((2.0, 1.0), abs=0.1)
    assert simulator.twist().v == pytest.approx(0.0, abs=1e-4)


def test_a_route_behind_the_chair_is_turned_to_on_the_spot() -> None:
    simulator = Simulator(world_from_grid(OccupancyGrid(np.zeros((200, 200), np.int8), 0.05), Pose2(5, 5, 0)), CHAIR_A)
    follower = Follower(np.array([[3.0, 5.0]]), CHAIR_A.track, NOMINAL)
    furthest = 0.0
    for _ in follow(simulator, follower):
        furthest = max(furthest, simulator.truth().x - 5.0, abs(simulator.truth().y - 5.0))
    assert simulator.truth().x == pytest.approx(3.0, abs=0.1)
    assert furthest < 0.15


def test_an_empty_route_is_done_at_once() -> None:
    assert Follower(np.empty((0, 2)), CHAIR_A.track, NOMINAL).done


def test_a_route_through_a_wall_is_refused_where_it_touches() -> None:
    simulator = Simulator(load_world("small_clinic"), CHAIR_A)
    follower = Follower(np.array([[1.0, 1.0], [2.6, 1.0], [2.6, 4.0]]), CHAIR_A.track, NOMINAL)
    with pytest.raises(WorldError, match=r"touched something at \(2\.\d"):
        list(follow(simulator, follower))
    assert simulator.contacts == 1


def test_a_chair_that_cannot_move_is_given_up() -> None:
    plant = PlantSettings(forward_dead_band=0.5, turn_dead_band=0.5)
    simulator = Simulator(load_world("small_clinic"), CHAIR_A, SimulatorSettings(plant=plant))
    timid = PlantSettings(forward_dead_band=0.0, turn_dead_band=0.0)
    with pytest.raises(WorldError, match="no way"):
        list(follow(simulator, Follower(np.array([[2.0, 1.0]]), CHAIR_A.track, timid)))
