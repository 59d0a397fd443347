"""The physical chair in a world: the simulator, the rider on a route, and a whole `Chair` drive it unchanged."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.calibration.fits.dac import DEFAULT
from waychair.config import dump, from_mapping
from waychair.errors import ConfigError
from waychair.simulation.follower import Follower, follow
from waychair.simulation.plan.world import World, load_world, world_from_grid
from waychair.simulation.plant.mujoco_model import MujocoSettings
from waychair.simulation.plant.plant import PlantSettings, randomised
from waychair.simulation.sensors.lidar import LidarSettings
from waychair.simulation.simulator import SimulationSettings, Simulator, SimulatorSettings
from waychair.trials.drive import DriveSetup, drive_to_places
from waychair.types import JoystickInput, OccupancyGrid, Pose2, Scan, SensorMessage
from waychair.yaml_files import yaml_from_text

SECOND = 1_000_000_000
NOMINAL = PlantSettings()
PHYSICAL = SimulatorSettings(plant_model="mujoco")


def _hall(distance: float = 3.0) -> World:
    """An open hall with one wall in front of the chair, `distance` [m] ahead of the axle."""
    cells = np.zeros((200, 200), np.int8)
    cells[:, 40 + round(distance / 0.05)] = 100
    return world_from_grid(OccupancyGrid(cells, 0.05), Pose2(2.0, 5.0, 0.0))


def _bytes(messages: tuple[SensorMessage, ...]) -> list[bytes]:
    return [m.ranges.tobytes() if isinstance(m, Scan) else repr(m).encode() for m in messages]


def _drive(seed: int, pieces: int = 1) -> list[bytes]:
    simulator = Simulator(load_world("small_clinic"), CHAIR_A, PHYSICAL, seed)
    simulator.drive(2.1, 1.8)
    return [data for _ in range(pieces) for data in _bytes(simulator.advance(2 * SECOND // pieces))]


def test_the_same_seed_gives_identical_scans_and_ticks_for_any_time_steps() -> None:
    assert _drive(3) == _drive(3) == _drive(3, pieces=20)
    assert _drive(3) != _drive(4)


def test_one_push_is_one_contact_and_a_second_one_after_backing_away_is_another() -> None:
    simulator = Simulator(_hall(1.5), CHAIR_A, PHYSICAL)
    for contact in (1, 2):
        simulator.drive(2.4, 1.65)
        simulator.advance(5 * SECOND)
        assert simulator.in_contact
        assert simulator.contacts == contact
        assert simulator.truth().x + CHAIR_A.front < 3.5 + 0.005
        simulator.drive(1.3, 1.65)
        simulator.advance(2 * SECOND)
        assert not simulator.in_contact


@pytest.mark.nightly
@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_B])
def test_random_driving_in_the_clinic_never_puts_the_axle_through_a_wall(body: ChairBody) -> None:
    settings = SimulatorSettings(plant_model="mujoco", lidar=LidarSettings(beams=2))
    simulator = Simulator(load_world("small_clinic"), body, settings)
    deep = body.outline() * 0.98
    solid = simulator.world.grid
    rng = np.random.default_rng(0)
    for _ in range(60):
        simulator.drive(*rng.uniform(0.3, 3.0, 2))
        simulator.advance(SECOND // 2)
        pose = simulator.truth()
        for x, y in deep.tolist():
            corner = solid.map_from_grid.inverse() @ pose @ Pose2(x, y)
            assert solid.cells[int(corner.y / solid.resolution), int(corner.x / solid.resolution)] == 0
    assert simulator.contacts > 1


@pytest.mark.parametrize(
    ("body", "seed"),
    [pytest.param(body, seed, marks=pytest.mark.nightly) for body, seed in ((CHAIR_A, 0), (CHAIR_B, 2))],
)
def test_the_route_of_the_clinic_is_finished_without_contact(body: ChairBody, seed: int) -> None:
    world = load_world("small_clinic")
    plant = randomised(NOMINAL, seed) if seed else NOMINAL
    settings = SimulatorSettings(plant_model="mujoco", plant=plant, lidar=LidarSettings(beams=2))
    simulator = Simulator(world, body, settings, seed)
    follower = Follower(world.route(), body.track, NOMINAL)
    left = [tuple(waypoint) for waypoint in world.route().tolist()]
    for _ in follow(simulator, follower):
        pose = simulator.truth()
        if left and np.hypot(pose.x - left[0][0], pose.y - left[0][1]) < 0.2:
            left.pop(0)
    assert not left
    assert simulator.contacts == 0


def test_a_chair_drives_itself_to_a_place_without_contact() -> None:
    world = load_world("small_clinic")
    settings = SimulatorSettings(plant_model="mujoco", plant=randomised(NOMINAL, 1))
    setup = DriveSetup(world.grid, {place.name: place for place in world.places}, CHAIR_A, DEFAULT)
    (leg,) = drive_to_places(setup, Simulator(world, CHAIR_A, settings, 1), ("reception",))
    assert (leg.reached, leg.contacts) == (True, 0)
    assert leg.distance_m > 4.0
    assert leg.localisation_error_m < 0.10


def test_the_rider_takes_over_the_physical_chair_within_a_second_and_it_stops_after_a_release() -> None:
    simulator = Simulator(_hall(7.0), CHAIR_A, PHYSICAL)
    simulator.drive(2.3, 1.65)
    simulator.advance(2 * SECOND)
    assert simulator.twist().v > 0.4
    simulator.release()
    simulator.rider = JoystickInput(simulator.now_ns, 0.0, 0.6)
    simulator.advance(SECOND)
    assert simulator.twist().omega > 0.3
    simulator.rider = JoystickInput(simulator.now_ns)
    simulator.advance(2 * SECOND)
    assert abs(simulator.twist().v) < 0.01
    assert abs(simulator.twist().omega) < 0.01


def test_the_plants_name_is_checked_and_survives_a_dump() -> None:
    with pytest.raises(ConfigError, match="kinematic or mujoco"):
        SimulatorSettings(plant_model="bullet")
    with pytest.raises(ConfigError, match="whole number"):
        SimulatorSettings(plant_model="mujoco", mujoco=MujocoSettings(timestep_ms=3.0))
    assert SimulatorSettings().plant_model == "kinematic"
    physical = SimulationSettings(plant_model="mujoco")
    assert from_mapping(SimulationSettings, yaml_from_text(dump(physical), "a dump", ConfigError)) == physical
