"""Tilt from the IMU, and the beams that end on the floor because of it; the truth is a simulated ramp."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import in_space
from waychair.simulation.follower import Follower, follow
from waychair.simulation.plan.world import load_world
from waychair.simulation.plant.plant import PlantSettings
from waychair.simulation.sensors.tilted_rays import FLOOR, Terrain, nearest_face, terrain_from_world
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.slam.odometry.odometry_filter import OdometryFilter
from waychair.slam.odometry.tilt import Tilt, TiltFilter, ground_beams, levelled
from waychair.types import BoolArray, FloatArray, ImuSample, Pose3, Scan, Twist, WheelTicks

GRAVITY = 9.80665
PERIOD_NS = 5_000_000


def felt(tilt: Tilt, forward: float = 0.0) -> FloatArray:
    """Specific force in the base of a chair that tilts and accelerates."""
    return np.asarray(tilt.level_from_base().T @ [0.0, 0.0, GRAVITY] + [forward, 0.0, 0.0])


def scan_of(ranges: FloatArray) -> Scan:
    """Beams from -135 to 135 degrees."""
    step = math.radians(270.0) / (len(ranges) - 1)
    return Scan(0, ranges.astype(np.float32), -math.radians(135.0), step, 0.0, 0.05, 25.0)


@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_a_chair_at_rest_knows_its_lean_from_the_first_sample(roll: float, pitch: float) -> None:
    true = Tilt(0, roll, pitch)
    found = TiltFilter(CHAIR_A).update(ImuSample(0, felt(true), np.zeros(3)), Twist())
    assert (found.roll, found.pitch) == pytest.approx((roll, pitch), abs=1e-9)


def test_an_acceleration_does_not_count_as_a_slope() -> None:
    filter_, v = TiltFilter(CHAIR_A), 0.0
    for k in range(400):
        forward = 0.9 if 100 <= k < 300 else 0.0
        v += forward * 0.005
        tilt = filter_.update(ImuSample(k * PERIOD_NS, felt(Tilt(0), forward), np.zeros(3)), Twist(v))
        assert abs(tilt.pitch) < math.radians(0.1)


def test_a_curve_does_not_count_as_a_slope_to_the_side() -> None:
    filter_, twist = TiltFilter(CHAIR_A), Twist(0.8, 0.7)
    outwards = np.array([-(0.7**2) * CHAIR_A.imu_x, 0.8 * 0.7, GRAVITY])
    filter_.update(ImuSample(0, felt(Tilt(0)), np.zeros(3)), twist)
    for k in range(1, 1000):
        tilt = filter_.update(ImuSample(k * PERIOD_NS, outwards, np.array([0.0, 0.0, 0.7])), twist)
    assert max(abs(tilt.roll), abs(tilt.pitch)) < math.radians(0.05)


def test_a_biased_gyro_does_not_change_the_lean() -> None:
    filter_ = TiltFilter(CHAIR_A)
    for k in range(12_000):
        tilt = filter_.update(ImuSample(k * PERIOD_NS, felt(Tilt(0)), np.array([0.01, -0.02, 0.0])), Twist())
    assert max(abs(tilt.roll), abs(tilt.pitch)) < math.radians(0.1)


def test_samples_that_are_late_or_not_finite_are_left_out() -> None:
    filter_ = TiltFilter(CHAIR_A)
    nothing = filter_.update(ImuSample(7, np.array([math.nan, 0.0, 9.8]), np.zeros(3)), Twist())
    assert nothing == Tilt(7)
    assert filter_.tilt is None
    first = filter_.update(ImuSample(100, felt(Tilt(0, 0.0, 0.1)), np.zeros(3)), Twist())
    for stamp, accel, twist in ((100, 0.0, 0.0), (50, 0.0, 0.0), (200, math.inf, 0.0), (200, 0.0, math.nan)):
        assert filter_.update(ImuSample(stamp, np.array([accel, 0.0, 9.8]), np.zeros(3)), Twist(twist)) is first
    after = filter_.update(ImuSample(100 + 10**9, felt(Tilt(0, 0.0, -0.1)), np.zeros(3)), Twist())
    assert after.pitch == pytest.approx(-0.1)


def test_on_level_ground_no_beam_is_taken_for_the_floor_and_no_scan_is_changed() -> None:
    scan = scan_of(np.linspace(0.1, 25.0, 271))
    for degrees in (0.0, 0.5, -0.5, 1.4):
        tilt = Tilt(0, math.radians(degrees), math.radians(degrees))
        assert levelled(scan, CHAIR_A, tilt) is scan
        assert not ground_beams(scan, CHAIR_A, Tilt(0, 0.0, math.radians(degrees))).any()


def test_with_the_nose_down_beams_ahead_meet_the_floor_and_those_behind_do_not() -> None:
    tilt = Tilt(0, 0.0, math.atan2(1, 12))
    far, near = scan_of(np.full(271, 4.5)), scan_of(np.full(271, 1.5))
    ground = ground_beams(far, CHAIR_A, tilt)
    assert ground[135]
    assert not ground[:45].any()
    assert not ground_beams(near, CHAIR_A, tilt).any()
    assert np.isnan(levelled(far, CHAIR_A, tilt).ranges[135])
    assert levelled(near, CHAIR_A, tilt).ranges[135] == pytest.approx(1.5 * math.cos(tilt.pitch), rel=1e-6)


def test_beams_without_a_return_stay_unchanged() -> None:
    tilt, odd = Tilt(0, 0.0, 0.1), np.array([math.inf, -math.inf, math.nan])
    scan = scan_of(np.tile(odd, 91)[:271])
    assert not ground_beams(scan, CHAIR_A, tilt).any()
    assert np.array_equal(levelled(scan, CHAIR_A, tilt).ranges, scan.ranges, equal_nan=True)


@dataclass(frozen=True, slots=True)
class Seen:
    """A scan of the drive over the ramp, the estimated tilt, and the true pose."""

    scan: Scan
    tilt: Tilt
    map_from_base: Pose3


@pytest.fixture(scope="module")
def drive() -> list[Seen]:
    """A drive over the sill and the ramp by the simulated chair, with all sensor errors."""
    settings = SimulatorSettings(plant_model="mujoco")
    settings = replace(settings, imu=replace(settings.imu, rate_hz=200.0), lidar=replace(settings.lidar, beams=136))
    world = load_world("ramp")
    simulator = Simulator(world, CHAIR_A, settings, 1)
    odometry, lean, seen, tilts = OdometryFilter(CHAIR_A), TiltFilter(CHAIR_A), [], {}
    poses = {0: simulator._chair.pose3}
    for message in follow(simulator, Follower(world.route()[:1], CHAIR_A.track, PlantSettings())):
        if isinstance(message, ImuSample):
            tilts[message.stamp_ns] = lean.update(message, odometry.update_imu(message).twist)
        elif isinstance(message, WheelTicks):
            odometry.update_wheels(message)
        elif isinstance(message, Scan) and message.stamp_ns in tilts:
            seen.append(Seen(message, tilts[message.stamp_ns], poses[message.stamp_ns]))
        poses[simulator.now_ns] = simulator._chair.pose3
    return seen


def floor_of(scan: Scan, base: Pose3, terrain: Terrain, blocks: int) -> BoolArray:
    """Mask of the beams that end on floor or ramp in the simulated world."""
    laser = base @ in_space(CHAIR_A.base_from_laser, CHAIR_A.laser_z)
    floor = np.zeros(len(scan.ranges), np.bool_)
    for k, angle in enumerate(scan.angles()):
        ahead = laser.rotation @ [math.cos(angle), math.sin(angle), 0.0]
        _, hit, *_ = nearest_face(terrain, *laser.translation, *ahead, 0.0, 25.0)
        floor[k] = (hit == FLOOR and ahead[2] < 0.0) or hit >= blocks
    return floor & np.isfinite(scan.ranges)


@pytest.mark.nightly
def test_the_lean_equals_that_of_the_simulated_chair(drive: list[Seen]) -> None:
    off = [seen.tilt.pitch - math.asin(-seen.map_from_base.rotation[2, 0]) for seen in drive]
    true = [math.asin(-seen.map_from_base.rotation[2, 0]) for seen in drive]
    assert max(true) > math.radians(4.5) > -math.radians(4.5) > min(true)
    assert np.sqrt(np.mean(np.square(off))) < math.radians(1.0)


def test_the_foot_of_a_ramp_is_no_wall_and_walls_stay(drive: list[Seen]) -> None:
    on_ramp = [seen for seen in drive if 9.0 < seen.map_from_base.translation[0] < 13.0]
    marked = [ground_beams(seen.scan, CHAIR_A, seen.tilt) for seen in on_ramp]
    world = load_world("ramp")
    terrain = terrain_from_world(world)
    assert terrain is not None
    floor = np.concatenate([floor_of(seen.scan, seen.map_from_base, terrain, len(world.blocks)) for seen in on_ramp])
    ground = np.concatenate(marked)
    finite = np.concatenate([np.isfinite(seen.scan.ranges) for seen in on_ramp])
    assert floor.sum() > 300
    assert (floor & ground).sum() > 0.98 * floor.sum()
    assert (ground & ~floor & finite).sum() < 0.15 * (~floor & finite).sum()
    level = [seen for seen in drive if seen.map_from_base.translation[0] < 2.0]
    assert not any(ground_beams(seen.scan, CHAIR_A, seen.tilt).any() for seen in level)
