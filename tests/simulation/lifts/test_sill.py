"""The slit at a lift's sill: the camera sees it, no drop-off is made of it, and wheels cross it with a jolt."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.depth.ground import GroundView, ground_view
from waychair.planning.seen.obstacle_layer import sight_of_drops, sight_of_missing_ground
from waychair.simulation.lifts.sill import jolt
from waychair.simulation.plan.world import World, load_levels
from waychair.simulation.scene.scene import LiftCabin, Pit
from waychair.simulation.sensors.renderer import renderer_problem
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.types import Pose2, RgbdFrame

SLIT = Pit(Pose2(1.0, 0.0), 0.03, 2.0, 1.0)


def drops(view: GroundView) -> int:
    """The number of drop-offs and places of missing ground that the chair would avoid."""
    return sum(int(sight(view, Pose2()).hits.sum()) for sight in (sight_of_drops, sight_of_missing_ground))


def test_every_lift_of_the_hospital_has_a_slit_in_the_wall_before_its_car() -> None:
    world = load_levels("hospital")[0]
    assert sorted(gap.length for gap in world.gaps) == [0.01, 0.02, 0.03]
    for gap in world.gaps:
        doors = [door.middle for door in world.doors if door.name.startswith("lift")]
        assert min(math.dist((gap.middle.x, gap.middle.y), (door.x, door.y)) for door in doors) < 0.06
    assert load_levels("two_floors")[0].gaps == ()


def test_wheels_that_cross_a_slit_dip_and_come_back() -> None:
    step, speed, z, v, deepest = 0.0005, 0.4, 0.0, 0.0, 0.0
    for k in range(round(1.6 / speed / step)):
        a = jolt([SLIT], CHAIR_A, Pose2(-0.2 + speed * k * step, 0.0), speed)
        z, v = z + v * step, v + a * step
        deepest = min(deepest, z)
    assert -0.003 < deepest < -0.0003
    assert abs(z) < 0.0002
    assert jolt([SLIT], CHAIR_A, Pose2(1.0, 1.5), speed) == 0.0


@pytest.mark.skipif(renderer_problem() is not None, reason="no camera can be rendered here")
@pytest.mark.parametrize(("slit", "is_ground"), [(0.0, True), (0.03, True), (2.0, False)])
def test_a_slit_of_three_centimetres_is_ground_and_a_missing_car_is_a_drop_off(slit: float, is_ground: bool) -> None:
    world: World = load_levels("two_floors")[0].without_people()
    lift = LiftCabin("wide", Pose2(3.95 - 1.0 + slit / 2, 3.5), 2.0, 2.0, ("ground",), slit)
    settings = SimulatorSettings()
    settings = replace(settings, camera=replace(settings.camera, rate_hz=10.0, noise=0.0))
    simulator = Simulator(replace(world, start=Pose2(1.5, 3.5), lifts=(lift,)), CHAIR_A, settings)
    frame = next(each for each in simulator.advance(300_000_000) if isinstance(each, RgbdFrame))
    found = drops(ground_view(frame, CHAIR_A.base_from_camera, CHAIR_A.front))
    assert (found == 0) is is_ground
