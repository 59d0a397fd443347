"""Drives of a whole chair with zones, glass, drop-offs and small turns."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.runtime.riding import FAR, Ride
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.drive.navigator import Stage
from waychair.geometry import transform_points
from waychair.maps.drawn.zones import Rule, Zone, zone_contains
from waychair.simulation.plant.plant import PlantSettings
from waychair.simulation.scene.scene import Block, Pit
from waychair.simulation.sensors.camera import CameraSettings
from waychair.simulation.sensors.renderer import renderer_problem
from waychair.simulation.sensors.sonar import SonarSettings
from waychair.simulation.simulator import SimulatorSettings
from waychair.trials.drive import start_drive
from waychair.types import Goal, Pose2

ACROSS = 4.98
"""From wall to wall of the hall [m]."""


def to_the_end(ride: Ride, goal: Goal, seconds: float) -> Stage:
    """Run ticks until the drive ends or the time is up; return the stage."""
    start_drive(ride.simulator, ride.chair, goal)
    for _ in range(round(20 * seconds)):
        if ride.tick().navigation.stage in (Stage.ARRIVED, Stage.FAILED):
            break
    return ride.states[-1].navigation.stage


@pytest.mark.nightly
def test_a_slow_zone_is_driven_slowly_and_no_corner_enters_a_keep_out_zone() -> None:
    slow = Zone("ward", Rule.SLOW, np.array([[4.0, 0.0], [5.5, 0.0], [5.5, 5.0], [4.0, 5.0]]), 0.3)
    closed = Zone("stairs", Rule.KEEP_OUT, np.array([[6.8, 1.6], [7.8, 1.6], [7.8, 3.2], [6.8, 3.2]]))
    with Ride(zones=(slow, closed)) as ride:
        start_drive(ride.simulator, ride.chair, FAR)
        fastest = elsewhere = 0.0
        for _ in range(20 * 45):
            stage = ride.tick().navigation.stage
            outline = transform_points(ride.simulator.truth(), CHAIR_A.outline())
            assert not zone_contains(closed, outline).any()
            if zone_contains(slow, outline).any():
                fastest = max(fastest, ride.speed)
            else:
                elsewhere = max(elsewhere, ride.speed)
            if stage in (Stage.ARRIVED, Stage.FAILED):
                break
        assert stage is Stage.ARRIVED
    assert 0.2 < fastest < 0.35
    assert elsewhere > 0.6


@pytest.mark.nightly
def test_an_oblique_pane_of_glass_invisible_to_the_lidar_is_heard_by_the_sonars_and_not_touched() -> None:
    pane = Block(Pose2(6.5, 2.5, math.radians(65.0)), 5.4, 0.02, 0.0, 2.0, "glass")
    with Ride(simulator=SimulatorSettings(sonar=SonarSettings(rate_hz=20.0)), blocks=(pane,)) as ride:
        assert to_the_end(ride, FAR, 14.0) is not Stage.ARRIVED
        assert ride.simulator.contacts == 0
        heard = transform_points(pane.middle.inverse(), ride.chair.navigator._surroundings.unscanned())
        assert (np.abs(heard[:, 1]) < 0.3).sum() > 5


@pytest.mark.skipif(renderer_problem() is not None, reason="no pictures can be drawn here")
def test_the_depth_camera_sees_a_pit_across_the_way_and_the_chair_stops_before_it() -> None:
    pit = Pit(Pose2(7.0, 2.5, 0.0), 2.0, ACROSS, 0.5)
    camera = CameraSettings(rate_hz=10.0, width=320, height=240)
    with Ride(simulator=SimulatorSettings(camera=camera), pits=(pit,)) as ride:
        assert to_the_end(ride, FAR, 14.0) is not Stage.ARRIVED
        assert ride.simulator.contacts == 0
        front = ride.simulator.truth().x + CHAIR_A.front
    assert 4.0 < front < 6.0


@pytest.mark.sampled(1)
@pytest.mark.parametrize("dead_band", [0.071, 0.118])
@pytest.mark.parametrize("heading", [0.08, -0.15])
def test_small_turns_end_at_any_dead_band_of_the_turn_axis(dead_band: float, heading: float) -> None:
    """The dead band is a quarter larger or smaller than the calibrated one."""
    with Ride(simulator=SimulatorSettings(plant=PlantSettings(turn_dead_band=dead_band))) as ride:
        goal = Goal(Pose2(2.0, 2.5, heading), 0.15, 0.05)
        assert to_the_end(ride, goal, 12.0) is Stage.ARRIVED
        assert ride.simulator.truth().theta == pytest.approx(heading, abs=0.05)


def test_the_chair_plans_and_limits_with_the_jerk_and_the_stops_of_its_file() -> None:
    with Ride() as ride:
        dwa = ride.chair.navigator.settings.dwa
        assert dwa.stops is not None
        assert dwa.reaction_time >= dwa.stops.delay_s
        ride.drive(60)
        speeds = np.array([state.command.v for state in ride.states if state.command is not None])
    rates = np.diff(speeds) / 0.05
    assert np.abs(np.diff(rates)).max() / 0.05 <= 2.0 * ride.chair.settings.limiter.jerk + 1e-6
