"""The world built from a saved map, and the people in it."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.dac import DEFAULT
from waychair.control.drive.navigator import NavigatorSettings
from waychair.control.drive.recovery import RecoverySettings
from waychair.errors import StartOccupied, StartOutsideMap, WaychairError, WorldError
from waychair.planning.route.global_planner import PlannerSettings
from waychair.runtime.chair import ChairSettings
from waychair.simulation.people.people import SimulatedPeople
from waychair.simulation.plan.world import load_world, world_from_grid
from waychair.simulation.scene.scene import PersonBehaviour, PersonPlan
from waychair.simulation.simulator import Simulator
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import DriveSetup, drive_to_places
from waychair.trials.navigate import navigate, with_closed_borders, with_walkers
from waychair.types import OccupancyGrid, Place, Pose2


def hall(side: int) -> OccupancyGrid:
    cells = np.zeros((side, side), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    return OccupancyGrid(cells, 0.05)


def test_walkers_stand_on_free_ground_apart_from_each_other_and_away_from_the_start() -> None:
    world = with_walkers(world_from_grid(hall(160), Pose2(4.0, 4.0)), 10, 3)
    points = [person.path[0] for person in world.people]
    assert len(points) == 10
    assert min(math.dist(a, b) for a, b in itertools.combinations(points, 2)) > 0.5
    assert min(math.dist(point, (4.0, 4.0)) for point in points) > 1.5
    assert all(0.3 < value < 7.7 for point in points for value in point)


def test_nobody_stands_at_the_border_of_a_grid_without_walls() -> None:
    """The border is solid to people, and free on such a map."""
    cells = np.zeros((80, 80), np.int8)
    for seed in range(5):
        world = with_walkers(
            replace(world_from_grid(hall(80), Pose2(2.0, 2.0)), grid=OccupancyGrid(cells, 0.05)), 6, seed
        )
        SimulatedPeople(world.people, world.grid, CHAIR_A, np.random.default_rng(0))


def test_too_many_people_for_the_map_are_refused_with_advice() -> None:
    with pytest.raises(WorldError, match="take fewer"):
        with_walkers(world_from_grid(hall(60), Pose2(1.5, 1.5)), 50, 0)


def test_free_ground_ends_at_unknown_space_but_not_at_single_unknown_cells() -> None:
    grid = hall(60)
    grid.cells[20:40, 40:58], grid.cells[10, 10] = -1, -1
    raised = with_closed_borders(grid).cells
    wall = raised[20:40, 40:58]
    assert (wall[[0, -1]] == 100).all()
    assert (wall[:, 0] == 100).all()
    assert (wall[1:-1, 1:-1] == -1).all()
    assert raised[10, 10] == -1
    assert (np.delete(raised, np.s_[20:40], axis=0) == np.delete(grid.cells, np.s_[20:40], axis=0)).all()


@pytest.mark.parametrize(
    ("start", "error", "said"),
    [
        (Pose2(9.0, 4.0), StartOutsideMap, r"\(9, 4\) is outside the map"),
        (Pose2(0.01, 4.0), StartOccupied, r"does not fit at its start \(0\.01, 4, 0\) on the map"),
        (Pose2(0.3, 4.0), StartOccupied, r"\(0\.3, 4, 0\) on the map"),
    ],
)
def test_an_impossible_start_is_reported_as_it_was_given(start: Pose2, error: type[WaychairError], said: str) -> None:
    with pytest.raises(error, match=said):
        navigate(hall(160), start, [Place("there", Pose2(4.0, 4.0))])
    shifted = Pose2(1.0, -2.0, 0.5)  # pose of the world in the map
    world = world_from_grid(hall(160), Pose2(4.0, 4.0))
    begin = shifted @ start
    turned = OccupancyGrid(hall(160).cells, 0.05, shifted)
    with pytest.raises(error, match=rf"\({begin.x:g}, {begin.y:g}".replace(".", r"\.")):
        navigate(turned, begin, [Place("there", Pose2(4.0, 4.0))], world=world, map_from_world=shifted)


@pytest.mark.nightly
def test_a_chair_turns_beside_the_legs_of_a_table_that_are_on_its_map() -> None:
    grid = hall(120)
    for x, y in ((3.75, 2.6), (3.0, 2.1), (2.2, 3.6)):
        grid.cells[round(y / 0.05), round(x / 0.05)] = 100
    (leg,) = navigate(grid, Pose2(1.0, 4.5, -0.5), [Place("table", Pose2(3.0, 3.0, -1.5))])
    assert leg.reached, leg.reason
    assert leg.contacts == 0
    assert leg.duration_s < 40.0


@pytest.mark.nightly
def test_the_harmonic_field_leads_round_a_corner_and_through_a_door_without_a_stop() -> None:
    """Regression: the band bent too close to the jamb, where the chair cut the corner and got stuck for 58 s."""
    clinic = load_world("small_clinic").without_people()
    behind = [Place("behind the door", Pose2(3.0, 3.0, 0.0))]
    settings = ChairSettings(navigator=NavigatorSettings(planner=PlannerSettings(planner="harmonic")))
    (leg,) = navigate(clinic.grid, clinic.start, behind, 0, 0, clinic, settings=settings)
    assert leg.reached, leg.reason
    assert leg.contacts == 0
    assert leg.plans == 1
    assert leg.duration_s < 35.0


@pytest.mark.nightly
def test_a_chair_does_not_turn_into_a_bystander_and_finally_says_that_one_is_in_the_way() -> None:
    corner = CHAIR_A.circumscribed_radius + 0.13
    standing = PersonPlan(
        PersonBehaviour.PATH, np.array([[4.0 + corner * math.cos(1.01), 4.0 + corner * math.sin(1.01)]])
    )
    grid = hall(160)
    world = replace(world_from_grid(grid, Pose2(2.0, 4.0)), people=(standing,))
    simulator = Simulator(world, CHAIR_A, randomised_settings(1), 1)
    window = Place("window", Pose2(4.0, 4.0, math.pi / 2))
    soon = ChairSettings(navigator=NavigatorSettings(recovery=RecoverySettings(tries=1, patience=20.0)))
    (leg,) = drive_to_places(DriveSetup(grid, {"window": window}, CHAIR_A, DEFAULT, chair=soon), simulator, ["window"])
    assert leg.contacts == 0
    assert not leg.reached
    assert "somebody (or something as slim) stands in the way" in leg.reason
