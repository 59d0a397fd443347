"""Physical hazards: ramps, thresholds, staircases, wet floors."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.simulation.plan.world import World
from waychair.simulation.plant.chair_file import CHAIRS, SimulatedChairData
from waychair.simulation.plant.mujoco_chair import MujocoChair
from waychair.simulation.plant.mujoco_model import MujocoSettings
from waychair.simulation.plant.plant import PlantSettings, volts_from_twist
from waychair.simulation.plant.plant_families import PlantFamily
from waychair.simulation.scene.scene import Block, Pit, Slope
from waychair.types import OccupancyGrid, Pose2, Twist

EVEN = PlantSettings(
    speed_noise=0.0,
    slip_noise=0.0,
    forward_skew=0.0,
    turn_skew=0.0,
    left_wheel_scale=1.0,
    right_wheel_scale=1.0,
)
GRID = OccupancyGrid(np.zeros((400, 400), np.int8), 0.05)
START = Pose2(5.0, 10.0, 0.3)
"""No part here lies along the axes of the map."""


def _at(ahead: float, left: float = 0.0) -> Pose2:
    """Return a pose this far [m] ahead and to the left of the chair's start."""
    return START @ Pose2(ahead, left)


def _chair(world: World, chair: SimulatedChairData = CHAIRS["A"], plant: PlantSettings = EVEN) -> MujocoChair:
    return MujocoChair(world, chair.body, plant, chair.mujoco, np.random.default_rng(0), START)


def _drive(chair: MujocoChair, twist: Twist, seconds: float) -> bool:
    """Hold the stick; return whether nothing was touched."""
    free = True
    for _ in range(round(seconds * 200)):
        free = chair.step(*volts_from_twist(EVEN, CHAIR_A.track, twist)) and free
    return free


def _ahead(chair: MujocoChair) -> float:
    return (START.inverse() @ chair.pose).x


RAMP = World(
    "ramp", GRID, START, slopes=(Slope(_at(4.2), 6.0, 2.0, 0.0, 0.5),), blocks=(Block(_at(8.2), 2.0, 2.0, 0.0, 0.5),)
)
"""A ramp of 1:12 that begins 1.2 m ahead, and a landing."""


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["A", "B", "A_mid", "A_front"])
def test_every_chair_drives_up_a_ramp_of_1_in_12_and_holds_nine_tenths_of_its_speed(name: str) -> None:
    chair = _chair(RAMP, CHAIRS[name])
    assert _drive(chair, Twist(0.5, 0.0), 10.0)
    assert chair.pose3.translation[2] == pytest.approx((_ahead(chair) - 1.2) / 12.0, abs=0.01)
    assert 0.9 < chair.twist.v / 0.5 < 0.98
    forward = chair.pose3.rotation[:, 0]
    assert math.degrees(math.asin(forward[2])) == pytest.approx(4.76, abs=1.7)  # springs let the mid drive lean back
    assert chair.specific_force[0] > 0.7
    assert _drive(chair, Twist(0.5, 0.0), 6.0)
    assert chair.pose3.translation[2] == pytest.approx(0.5, abs=0.005)
    assert chair.upright


def test_on_a_ramp_the_parking_brake_holds_a_chair_that_creeps_with_motors_alone() -> None:
    ways = []
    for family in (PlantFamily(), PlantFamily(brake_release_s=0.3)):
        chair = _chair(RAMP, plant=dataclasses.replace(EVEN, family=family))
        _drive(chair, Twist(0.5, 0.0), 8.0)
        _drive(chair, Twist(), 3.0)
        before = _ahead(chair)
        _drive(chair, Twist(), 3.0)
        ways.append(before - _ahead(chair))
    assert 0.03 < ways[0] < 0.3
    assert abs(ways[1]) < 0.002


@pytest.mark.parametrize("name", ["A", "B", "A_mid", "A_front"])
def test_every_chair_climbs_a_threshold_of_2_cm_at_half_a_metre_per_second(name: str) -> None:
    world = World("threshold", GRID, START, blocks=(Block(_at(2.0), 0.1, 2.0, 0.0, 0.02),))
    chair, highest = _chair(world, CHAIRS[name]), 0.0
    for _ in range(1400):
        assert chair.step(*volts_from_twist(EVEN, CHAIR_A.track, Twist(0.5, 0.0)))
        highest = max(highest, float(chair.pose3.translation[2]))
    assert _ahead(chair) > 2.9
    assert 0.015 < highest < 0.04
    assert chair.upright


def test_a_kerb_of_20_cm_stops_the_chair_like_a_wall() -> None:
    world = World("kerb", GRID, START, blocks=(Block(_at(2.5), 1.0, 2.0, 0.0, 0.2),))
    chair = _chair(world)
    assert not _drive(chair, Twist(0.5, 0.0), 6.0)
    assert _ahead(chair) + CHAIR_A.front == pytest.approx(2.0, abs=0.02)
    assert chair.upright


DOWN = World(
    "stairs",
    GRID,
    START,
    pits=(Pit(_at(4.0), 4.0, 1.5, 1.6),),
    blocks=tuple(Block(_at(2.15 + 0.3 * i), 0.3, 1.5, -1.6, -0.16 * (i + 1)) for i in range(9)),
)
"""Nine steps down that begin 2 m ahead, in a shaft of 1.5 m."""


def test_a_chair_driven_to_a_staircase_falls_down_it_and_the_fall_stays_reported() -> None:
    chair = _chair(DOWN)
    assert _drive(chair, Twist(0.5, 0.0), 2.5)
    assert chair.upright
    assert not _drive(chair, Twist(0.5, 0.0), 6.0)
    assert not chair.upright
    assert chair.pose3.translation[2] < -0.5
    assert not _drive(chair, Twist(), 1.0)
    assert not chair.upright


def test_a_chair_that_drives_past_a_staircase_stays_upright_on_a_floor_without_bumps() -> None:
    world = dataclasses.replace(DOWN, pits=(Pit(_at(4.0, 1.5), 4.0, 1.5, 1.6),), blocks=())
    chair = _chair(world)
    for _ in range(2400):
        assert chair.step(*volts_from_twist(EVEN, CHAIR_A.track, Twist(0.6, 0.0)))
        assert abs(chair.pose3.translation[2]) < 0.002
    assert chair.upright
    assert _ahead(chair) > 6.0
    assert abs((START.inverse() @ chair.pose).y) < 0.01


def test_a_wet_floor_adds_an_error_of_more_than_a_right_angle_to_a_spin_unseen_by_the_encoders() -> None:
    unseen = []
    for friction in (0.9, 0.15):
        wet = MujocoSettings(floor_friction=friction, wheel_friction=friction, caster_friction=0.7 * friction)
        chair = _chair(World("wet", GRID, START), SimulatedChairData(mujoco=wet))
        turned = 0.0
        for _ in range(1600):
            before = chair.pose.theta
            chair.step(*volts_from_twist(EVEN, CHAIR_A.track, Twist(0.0, 1.2)))
            turned += math.remainder(chair.pose.theta - before, math.tau)
        left, right = (count * math.tau * CHAIR_A.wheel_radius / CHAIR_A.ticks_per_turn for count in chair.ticks)
        unseen.append(abs(math.degrees((right - left) / CHAIR_A.track - turned)))
    assert unseen[0] < 10.0
    assert unseen[1] > 90.0
