"""Several chairs in one world: one gives today's bytes, they see each other, touch once, and people avoid them all."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.errors import ConfigError, WorldError
from waychair.simulation.fleet import ChairPlan, FleetSimulator
from waychair.simulation.lifts.lifts import Lifts
from waychair.simulation.plan.world import World, load_levels, load_world, world_from_grid
from waychair.simulation.scene.scene import OtherChair, PersonBehaviour, PersonPlan
from waychair.simulation.sensors.lidar import LidarSettings
from waychair.simulation.sensors.silhouettes import sides_of
from waychair.simulation.sensors.sonar import SonarSettings
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.types import JoystickInput, OccupancyGrid, Pose2, Scan, SensorMessage, SonarReadings

SECOND = 1_000_000_000
EXACT = SimulatorSettings(
    lidar=LidarSettings(sweep_s=0.0, sigma=0.0, faults=False, beams=541), sonar=SonarSettings(rate_hz=10.0)
)
AHEAD = 541 // 2
"""The lidar's beam straight ahead."""


def _hall() -> World:
    return world_from_grid(OccupancyGrid(np.zeros((160, 240), np.int8), 0.05), Pose2(2.0, 4.0, 0.0))


def _plan(x: float, y: float = 4.0, theta: float = 0.0, body: ChairBody = CHAIR_A) -> ChairPlan:
    return ChairPlan(body, EXACT, Pose2(x, y, theta))


def _two(gap: float, **others: ChairBody) -> FleetSimulator:
    """Two chairs in a row, the second one so far [m] ahead of the first one's front."""
    second = others.get("body", CHAIR_A)
    return FleetSimulator(_hall(), [_plan(2.0), _plan(2.0 + CHAIR_A.front + gap + second.rear, body=second)])


def _bytes(messages: tuple[SensorMessage, ...]) -> list[bytes]:
    return [m.ranges.tobytes() + b"%d" % m.stamp_ns if isinstance(m, Scan) else repr(m).encode() for m in messages]


def _drive(fleet: FleetSimulator, number: int, seconds: float, forward: float) -> None:
    fleet.chairs[number].rider = JoystickInput(fleet.now_ns, forward)
    fleet.advance(round(seconds * SECOND))


@pytest.mark.parametrize("world", ["small_clinic", "crowd"])
def test_one_chair_gives_the_bytes_of_the_single_simulator(world: str) -> None:
    level = load_world("small_clinic")
    if world == "crowd":
        people = [PersonPlan(kind, np.array([[5.0, 1.5 + k], [9.0, 4.0]])) for k, kind in enumerate(PersonBehaviour)]
        level = replace(_hall(), people=tuple(people))
    single = Simulator(level, CHAIR_A, SimulatorSettings(), seed=5)
    fleet = FleetSimulator(level, [ChairPlan(CHAIR_A, SimulatorSettings(), level.start)], seed=5)
    single.rider = fleet.chairs[0].rider = JoystickInput(0, 0.6, 0.2)
    for _ in range(4):
        alone, (among,) = single.advance(SECOND // 2), fleet.advance(SECOND // 2)
        assert _bytes(alone) == _bytes(among)
    assert single.truth() == fleet.chairs[0].truth()
    assert single.people == fleet.people


def test_each_chair_has_random_streams_of_its_own() -> None:
    alike = SimulatorSettings(lidar=LidarSettings(beams=41))
    fleet = FleetSimulator(_hall(), [ChairPlan(CHAIR_A, alike, Pose2(3.0, y, 0.0)) for y in (2.0, 6.0)], seed=1)
    first, second = fleet.advance(SECOND // 5)
    noise = [np.array([m.ranges for m in heard if isinstance(m, Scan)]) for heard in (first, second)]
    assert not np.allclose(noise[0], noise[1][:, ::-1], equal_nan=True)


def test_chairs_see_each_other_by_lidar_and_sonars() -> None:
    heard = _two(gap=1.5).advance(SECOND // 10)[0]
    scan = next(m for m in heard if isinstance(m, Scan))
    sonars = next(m for m in heard if isinstance(m, SonarReadings))
    assert scan.ranges[AHEAD] == pytest.approx(CHAIR_A.front - CHAIR_A.laser_x + 1.5, abs=0.015)
    assert sonars.ranges[0] == pytest.approx(1.5, abs=0.05)


@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_B])
def test_the_sides_that_sensors_see_lie_within_the_outline_and_have_no_gaps(body: ChairBody) -> None:
    circles = sides_of(body)
    assert (circles[:, 0] + circles[:, 2]).max() == pytest.approx(body.front)
    assert (circles[:, 0] - circles[:, 2]).min() == pytest.approx(-body.rear)
    assert (np.abs(circles[:, 1]) + circles[:, 2]).max() == pytest.approx(body.width / 2)
    for x, y, radius in circles:
        others = np.hypot(circles[:, 0] - x, circles[:, 1] - y)
        assert (others < 2 * radius).sum() >= 3  # itself and both neighbours


def test_a_chair_that_drives_into_another_is_stopped_and_the_contact_counts_once_with_both_speeds() -> None:
    fleet = _two(gap=0.6)
    _drive(fleet, 0, 4.0, 0.5)
    (contact,) = fleet.chair_contacts
    assert contact.chairs == (0, 1)
    assert contact.speeds[0] > 0.1
    assert contact.speeds[1] == 0.0
    assert fleet.between(0, 1) < 0.02
    assert contact.x == pytest.approx(2.0 + CHAIR_A.front + 0.6, abs=0.03)
    assert [chair.contacts for chair in fleet.chairs] == [0, 0]
    _drive(fleet, 0, 1.5, -0.5)
    assert fleet.between(0, 1) > 0.05
    _drive(fleet, 0, 3.0, 0.5)
    assert len(fleet.chair_contacts) == 2


def test_two_chairs_that_meet_head_on_report_one_contact() -> None:
    fleet = FleetSimulator(_hall(), [_plan(3.0), _plan(6.0, theta=math.pi)])
    for chair in fleet.chairs:
        chair.rider = JoystickInput(0, 0.5)
    fleet.advance(4 * SECOND)
    (contact,) = fleet.chair_contacts
    assert min(contact.speeds) > 0.1


def test_people_stop_for_the_second_chair_as_for_the_first() -> None:
    fleet = FleetSimulator(_hall(), [_plan(2.0, 6.5), _plan(6.0)])
    fleet.populate([PersonPlan(PersonBehaviour.PATH, np.array([[9.5, 4.0], [4.0, 4.0]]))])
    fleet.advance(4 * SECOND)
    (person,) = fleet.people
    assert 0.0 < person.pose.x - (6.0 + CHAIR_A.front) - person.radius < 0.6


def test_two_chairs_in_one_place_are_refused_by_number() -> None:
    with pytest.raises(WorldError, match="chairs 1 and 2 start in one place"):
        FleetSimulator(_hall(), [_plan(2.0), _plan(2.5)])


def test_chairs_of_different_steps_and_several_mujoco_chairs_are_refused() -> None:
    other = replace(EXACT, plant=replace(EXACT.plant, step_ms=2 * EXACT.plant.step_ms))
    with pytest.raises(ConfigError, match="lockstep"):
        FleetSimulator(_hall(), [_plan(2.0), ChairPlan(CHAIR_A, other, Pose2(6.0, 4.0, 0.0))])
    with pytest.raises(ConfigError, match="lockstep"):
        FleetSimulator(_hall(), [])
    heavy = replace(EXACT, plant_model="mujoco")
    with pytest.raises(ConfigError, match="kinematic"):
        FleetSimulator(_hall(), [ChairPlan(CHAIR_A, heavy, Pose2(x, 4.0, 0.0)) for x in (2.0, 6.0)])


def test_the_camera_draws_another_chair_where_it_is() -> None:
    renderer = pytest.importorskip("waychair.simulation.sensors.renderer")
    if (problem := renderer.renderer_problem()) is not None:
        pytest.skip(problem)
    matrix = renderer.camera_matrix(64, 48, 1.2)
    camera = renderer.Renderer(_hall(), matrix, 64, 48)
    pose = Pose2(2.0, 4.0, 0.0)
    view = CHAIR_A.base_from_camera
    from waychair.geometry import in_space

    empty = camera.render(in_space(pose) @ view).depth.copy()
    there = OtherChair(Pose2(4.5, 4.0, 0.0), CHAIR_A, 1)
    seen = camera.render(in_space(pose) @ view, [there]).depth
    nearer = seen < empty - 0.3
    assert nearer.sum() > 60
    assert 1.7 < seen[nearer].min() < 2.5
    camera.release()


def test_a_lift_carries_a_chair_to_the_level_of_another_one_and_only_then_do_they_see_each_other() -> None:
    levels = load_levels("two_floors")
    quick = SimulatorSettings(lidar=LidarSettings(beams=41))
    cabin, before = Pose2(8.8, 3.5, math.pi), Pose2(5.0, 3.5, 0.0)
    plans = [ChairPlan(CHAIR_A, quick, cabin), ChairPlan(CHAIR_A, quick, before, "upper")]
    lifts = Lifts(levels)
    fleet = FleetSimulator(levels[0], plans, lifts=lifts)
    first, second = fleet.chairs
    assert (first.world.level, second.world.level) == ("ground", "upper")
    assert fleet.between(0, 1) == math.inf
    assert [len(chair.people) for chair in fleet.chairs] == [1, 0]
    lifts.call("lift", "upper")
    for _ in range(40):
        fleet.advance(SECOND)
        if first.world.level == "upper":
            break
    assert first.world.level == "upper"
    assert first.truth().x == pytest.approx(cabin.x)
    assert fleet.between(0, 1) == pytest.approx(3.8 - 2 * CHAIR_A.front, abs=0.01)
    assert first.people == ()
    assert fleet.chair_contacts == []


def test_a_chair_cannot_start_on_a_level_to_which_no_lift_leads() -> None:
    with pytest.raises(WorldError, match="no lift leads to the level 'roof'"):
        FleetSimulator(_hall(), [replace(_plan(2.0), level="roof")])
