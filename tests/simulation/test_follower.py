"""The simulated rider on a route."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.errors import WorldError
from waychair.simulation.follower import Follower, follow
from waychair.simulation.plan.world import load_world, world_from_grid
from waychair.simulation.plant.plant import PlantSettings, randomised
from waychair.simulation.scene.scene import PersonBehaviour, PersonPlan, PersonState
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.types import OccupancyGrid, Pose2, Scan

NOMINAL = PlantSettings()


@pytest.mark.parametrize(
    ("body", "seed"),
    [
        pytest.param(body, seed, marks=[] if (body, seed) == (CHAIR_B, 2) else pytest.mark.nightly)
        for body in (CHAIR_A, CHAIR_B)
        for seed in (0, 1, 2)
    ],
)
def test_the_route_of_the_clinic_is_finished_without_contact(body: ChairBody, seed: int) -> None:
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
    assert follower.stick(simulator.truth()) == (0.0, 0.0)


def test_the_chair_rests_with_released_lines_when_the_route_is_done() -> None:
    world = load_world("small_clinic")
    simulator = Simulator(world, CHAIR_A)
    for _ in follow(simulator, Follower(np.array([[2.0, 1.0]]), CHAIR_A.track, NOMINAL)):
        pass
    simulator.advance(2_000_000_000)
    assert (simulator.truth().x, simulator.truth().y) == pytest.approx((2.0, 1.0), abs=0.1)
    assert simulator.twist().v == pytest.approx(0.0, abs=1e-4)


def test_the_chair_turns_on_the_spot_to_a_route_behind_it() -> None:
    simulator = Simulator(world_from_grid(OccupancyGrid(np.zeros((200, 200), np.int8), 0.05), Pose2(5, 5, 0)), CHAIR_A)
    follower = Follower(np.array([[3.0, 5.0]]), CHAIR_A.track, NOMINAL)
    furthest = 0.0
    for _ in follow(simulator, follower):
        furthest = max(furthest, simulator.truth().x - 5.0, abs(simulator.truth().y - 5.0))
    assert simulator.truth().x == pytest.approx(3.0, abs=0.1)
    assert furthest < 0.15


def test_an_empty_route_is_done_at_once() -> None:
    assert Follower(np.empty((0, 2)), CHAIR_A.track, NOMINAL).done


def test_a_route_through_a_wall_is_refused_with_the_place_of_contact() -> None:
    simulator = Simulator(load_world("small_clinic"), CHAIR_A)
    follower = Follower(np.array([[1.0, 1.0], [2.6, 1.0], [2.6, 4.0]]), CHAIR_A.track, NOMINAL)
    with pytest.raises(WorldError, match=r"touched something at \(2\.\d"):
        list(follow(simulator, follower))
    assert simulator.contacts == 1


def test_a_chair_that_cannot_move_ends_the_route() -> None:
    plant = PlantSettings(forward_dead_band=0.5, turn_dead_band=0.5)
    simulator = Simulator(load_world("small_clinic"), CHAIR_A, SimulatorSettings(plant=plant))
    timid = PlantSettings(forward_dead_band=0.0, turn_dead_band=0.0)
    with pytest.raises(WorldError, match="did not move"):
        list(follow(simulator, Follower(np.array([[2.0, 1.0]]), CHAIR_A.track, timid)))


def test_the_rider_waits_only_for_people_ahead_or_within_reach_of_a_turn() -> None:
    def drives(place: Pose2, goal: tuple[float, float]) -> bool:
        """Return whether a chair at the origin starts for the goal with a person standing at a place."""
        person = PersonState(place, 0.0, 0.0, 0.25, PersonBehaviour.SEATED)
        stick = Follower(np.array([goal]), CHAIR_A.track, NOMINAL).stick(Pose2(), CHAIR_A, (person,))
        return stick != (0.0, 0.0)

    ahead, aside = (3.0, 0.0), (0.0, 3.0)
    assert not drives(Pose2(CHAIR_A.front + 0.25 + 0.3, 0.0), ahead)
    assert not drives(Pose2(1.2, CHAIR_A.width / 2 + 0.25 + 0.05), ahead)
    assert drives(Pose2(1.2, CHAIR_A.width / 2 + 0.25 + 0.2), ahead)
    assert drives(Pose2(CHAIR_A.front + 0.25 + 1.5, 0.0), ahead)
    assert drives(Pose2(-CHAIR_A.rear - 0.26, 0.0), ahead), "a person behind, however near, does not stop the chair"
    assert not drives(Pose2(0.5, 0.65), aside), "the front corner would swing into the person"
    assert drives(Pose2(0.5, -0.65), aside), "away from the person"


def test_a_walker_in_a_corridor_and_the_chair_pass_each_other() -> None:
    cells = np.zeros((60, 300), np.int8)
    cells[:4], cells[-4:] = 100, 100
    hall = world_from_grid(OccupancyGrid(cells, 0.05), Pose2(1.0, 1.1, 0.0))
    walkers = tuple(
        PersonPlan(behaviour, np.array([[12.0, y], [2.0, y]]))
        for behaviour, y in ((PersonBehaviour.SOCIAL, 1.3), (PersonBehaviour.PATH, 2.4))
    )
    simulator = Simulator(replace(hall, people=walkers), CHAIR_A)
    nearest = 1.0
    for _ in follow(simulator, Follower(np.array([[13.0, 1.1]]), CHAIR_A.track, NOMINAL)):
        nearest = min(nearest, simulator.person_distance())
    assert simulator.contacts == 0
    assert 0.02 < nearest < 0.6, "they did meet"
