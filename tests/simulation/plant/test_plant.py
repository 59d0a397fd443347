"""The kinematic chair: its motion by joystick volts."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.dac import DEFAULT, PAPER, counts_from_wheel_speeds, volts_from_counts
from waychair.geometry import rotation
from waychair.simulation.follower import Follower
from waychair.simulation.plant.kinematic_chair import KinematicChair, moved
from waychair.simulation.plant.plant import (
    GRAVITY,
    PlantSettings,
    families,
    randomised,
    volts_from_joystick,
    volts_from_twist,
)
from waychair.slam.odometry.odometry_filter import OdometryFilter
from waychair.types import Pose2, Twist, WheelSpeeds, WheelTicks

NOMINAL = PlantSettings()
QUIET = PlantSettings(speed_noise=0.0, slip_noise=0.0, left_wheel_scale=1.0, right_wheel_scale=1.0)
STEP_S = QUIET.step_ms / 1000.0


def _free(_pose: Pose2) -> bool:
    return True


def _chair(settings: PlantSettings = QUIET, seed: int = 0) -> KinematicChair:
    return KinematicChair(CHAIR_A, settings, np.random.default_rng(seed))


def _settled(settings: PlantSettings, forward_volts: float, turn_volts: float) -> Twist:
    chair = _chair(settings)
    for _ in range(800):
        chair.step(forward_volts, turn_volts, _free)
    return chair.twist


@pytest.mark.parametrize("left", [-0.6, -0.2, 0.0, 0.05, 0.4, 0.8])
@pytest.mark.parametrize("right", [-0.5, 0.0, 0.1, 0.8])
def test_calibrated_counts_reach_the_commanded_wheel_speeds(left: float, right: float) -> None:
    volts = volts_from_counts(DEFAULT, *counts_from_wheel_speeds(DEFAULT, WheelSpeeds(left, right)))
    twist = _settled(QUIET, *volts)
    half = twist.omega * CHAIR_A.track / 2
    assert twist.v - half == pytest.approx(left, abs=0.015)
    assert twist.v + half == pytest.approx(right, abs=0.015)


def test_the_published_equations_alone_do_not_move_the_chair_at_a_crawl() -> None:
    volts = volts_from_counts(PAPER, *counts_from_wheel_speeds(PAPER, WheelSpeeds(0.1, 0.1)))
    assert _settled(QUIET, *volts) == Twist(0.0, 0.0)


def test_the_gains_are_those_of_the_published_equations() -> None:
    count = 3.3 / 255
    inverse = np.linalg.inv(np.array([[28.2122, 30.1732], [57.0194, -58.6717]]))
    forward, turn = inverse[:, 0] / count, inverse[:, 1] / count
    assert NOMINAL.forward_gain * (1 + NOMINAL.forward_skew) == pytest.approx(forward[0], rel=1e-4)
    assert NOMINAL.forward_gain * (1 - NOMINAL.forward_skew) == pytest.approx(forward[1], rel=1e-4)
    assert NOMINAL.turn_gain * (1 + NOMINAL.turn_skew) / 2 == pytest.approx(turn[0], rel=1e-4)
    assert NOMINAL.turn_gain * (1 - NOMINAL.turn_skew) / 2 == pytest.approx(-turn[1], rel=1e-4)


def test_a_chair_at_rest_with_neutral_volts_does_not_creep() -> None:
    chair = _chair(NOMINAL)
    for _ in range(1000):
        chair.step(1.65, 1.65, _free)
    assert chair.pose == Pose2()
    assert chair.ticks == (0, 0)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_dead_band_ends_at_its_limits(sign: float) -> None:
    inside, outside = NOMINAL.forward_dead_band - 1e-4, NOMINAL.forward_dead_band + 1e-2
    assert _settled(QUIET, 1.65 + sign * inside, 1.65).v == 0.0
    assert sign * _settled(QUIET, 1.65 + sign * outside, 1.65).v > 0.01
    assert _settled(QUIET, 1.65, 1.65 + sign * inside).omega == 0.0
    assert sign * _settled(QUIET, 1.65, 1.65 + sign * outside).omega < -0.01


def test_beyond_the_swing_the_speed_does_not_rise() -> None:
    full = _settled(QUIET, 1.65 + QUIET.swing_volts, 1.65).v
    assert _settled(QUIET, 3.3, 1.65).v == pytest.approx(full, abs=1e-9)
    assert _settled(QUIET, 1.65 + QUIET.swing_volts - 0.1, 1.65).v < full - 0.1


def test_turn_volts_above_neutral_turn_right_and_the_riders_left_turns_left() -> None:
    assert _settled(QUIET, 1.65, 2.0).omega < -0.1
    assert _settled(QUIET, *volts_from_joystick(QUIET, 0.0, 0.4)).omega > 0.1


@pytest.mark.parametrize("stick", [2.0, -7.0])
def test_a_joystick_beyond_its_range_is_held_at_its_end(stick: float) -> None:
    end = math.copysign(1.0, stick)
    assert volts_from_joystick(QUIET, stick, stick) == volts_from_joystick(QUIET, end, end)


def test_the_volts_of_a_twist_give_that_twist_on_a_chair_without_skew() -> None:
    settings = dataclasses.replace(QUIET, forward_skew=0.0, turn_skew=0.0)
    twist = _settled(settings, *volts_from_twist(settings, CHAIR_A.track, Twist(0.5, -0.4)))
    assert (twist.v, twist.omega) == pytest.approx((0.5, -0.4), abs=1e-6)


def test_before_the_delay_nothing_moves_and_then_no_faster_than_the_ramp() -> None:
    chair = _chair()
    speeds = [0.0]
    for _ in range(400):
        chair.step(1.65 + 0.7, 1.65, _free)
        speeds.append(chair.twist.v)
    waiting = round(NOMINAL.delay_s / STEP_S) + 1
    assert speeds[:waiting] == [0.0] * waiting
    assert speeds[waiting] > 0.0
    assert max(np.diff(speeds)) <= NOMINAL.acceleration * STEP_S + 1e-12
    for _ in range(400):
        chair.step(1.65, 1.65, _free)
        speeds.append(chair.twist.v)
    assert min(np.diff(speeds)) >= -NOMINAL.deceleration * STEP_S - 1e-12
    assert speeds[-1] == pytest.approx(0.0, abs=1e-4)


def test_unequal_motors_pull_a_straight_command_off_its_line() -> None:
    assert _settled(QUIET, 2.2, 1.65).omega < -0.01


def test_a_quarter_circle_is_an_exact_arc_for_any_time_steps() -> None:
    twist = Twist(1.0, 1.0)
    whole = moved(Pose2(), twist, math.pi / 2)
    assert (whole.x, whole.y, whole.theta) == pytest.approx((1.0, 1.0, math.pi / 2))
    pose = Pose2()
    for _ in range(7):
        pose = moved(pose, twist, math.pi / 14)
    assert (pose.x, pose.y, pose.theta) == pytest.approx((1.0, 1.0, math.pi / 2))


def test_ticks_measure_the_distance_of_each_wheel() -> None:
    chair = _chair()
    for _ in range(1000):
        chair.step(2.2, 1.75, _free)
    left, right = (ticks * math.tau * CHAIR_A.wheel_radius / CHAIR_A.ticks_per_turn for ticks in chair.ticks)
    assert (right - left) / CHAIR_A.track == pytest.approx(chair.pose.theta, abs=2e-3)
    assert (left + right) / 2 > math.hypot(chair.pose.x, chair.pose.y)


def test_ticks_wrap_as_signed_32_bit_numbers() -> None:
    body = dataclasses.replace(CHAIR_A, ticks_per_turn=1_000_000, wheel_radius=0.02)
    chair = KinematicChair(body, dataclasses.replace(QUIET, step_ms=10), np.random.default_rng(0))
    seen = []
    for _ in range(30_000):
        chair.step(3.0, 1.65, _free)
        seen.append(chair.ticks[0])
    assert min(seen) < 0 < max(seen) <= 2**31 - 1
    steps = np.diff(np.array(seen)).astype(np.int32)
    assert steps.min() >= 0


def test_a_blocked_chair_stays_in_place_and_its_wheels_stall() -> None:
    chair = _chair()
    for _ in range(200):
        chair.step(2.2, 1.65, _free)
    pose, ticks = chair.pose, chair.ticks
    assert not chair.step(2.2, 1.65, lambda _pose: False)
    assert (chair.pose, chair.ticks, chair.twist) == (pose, ticks, Twist())


def test_slip_is_not_seen_by_the_encoders_but_ripple_is() -> None:
    def straight(settings: PlantSettings) -> tuple[float, float]:
        chair = _chair(dataclasses.replace(settings, forward_skew=0.0))
        for _ in range(2000):
            chair.step(2.2, 1.65, _free)
        return chair.pose.theta, (chair.ticks[1] - chair.ticks[0]) * math.tau * 0.165 / 4096 / CHAIR_A.track

    theta, measured = straight(dataclasses.replace(QUIET, slip_noise=0.05))
    assert measured == 0.0
    assert abs(theta) > 1e-3
    theta, measured = straight(dataclasses.replace(QUIET, speed_noise=0.05))
    assert measured == pytest.approx(theta, abs=2e-3)
    assert abs(theta) > 3e-3


def test_randomised_chairs_differ_within_the_stated_ranges() -> None:
    chairs = [randomised(NOMINAL, seed) for seed in range(200)]
    assert randomised(NOMINAL, 3) == chairs[3]
    gains = [chair.forward_gain / NOMINAL.forward_gain for chair in chairs]
    neutrals = [chair.neutral_volts - 1.65 for chair in chairs]
    assert 0.92 <= min(gains) < 0.94
    assert 1.06 < max(gains) <= 1.08
    assert -0.010 <= min(neutrals) < -0.008
    assert 0.008 < max(neutrals) <= 0.010


def test_no_randomised_chair_has_equal_tyres_and_either_may_be_larger() -> None:
    chairs = [randomised(NOMINAL, seed) for seed in range(100)]
    differences = [chair.left_wheel_scale / chair.right_wheel_scale - 1.0 for chair in chairs]
    assert 0.0009 < min(map(abs, differences)) <= max(map(abs, differences)) < 0.0015
    assert 30 < sum(difference > 0.0 for difference in differences) < 70


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.nightly)])
def test_odometry_of_a_loop_of_200_m_drifts_by_metres_on_every_chair(seed: int) -> None:
    chair, odometry = _chair(randomised(NOMINAL, seed), seed), OdometryFilter(CHAIR_A)
    believed = odometry.update_wheels(WheelTicks(0, *chair.ticks)).odom_from_base
    follower = Follower(np.array([[25.0, 0.0], [25.0, 25.0], [0.0, 25.0], [0.0, 0.0]] * 2), CHAIR_A.track, NOMINAL)
    stamp_ns = 0
    while not follower.done:
        volts = volts_from_joystick(NOMINAL, *follower.stick(chair.pose))
        for _ in range(10):
            chair.step(*volts, _free)
        stamp_ns += 50_000_000
        believed = odometry.update_wheels(WheelTicks(stamp_ns, *chair.ticks)).odom_from_base
    assert 1.0 < math.dist((believed.x, believed.y), (chair.pose.x, chair.pose.y)) < 15.0


def test_at_rest_the_imu_measures_gravity_upwards_and_nothing_else() -> None:
    chair = _chair()
    chair.step(1.65, 1.65, _free)
    assert chair.specific_force.tolist() == [0.0, 0.0, GRAVITY]
    assert chair.angular_rate.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.4, -0.2), (-0.3, 0.25)])
def test_the_imu_measures_the_motion_of_its_mount_through_the_map(x: float, y: float) -> None:
    body = dataclasses.replace(CHAIR_A, imu_x=x, imu_y=y)
    chair = KinematicChair(body, dataclasses.replace(QUIET, step_ms=1), np.random.default_rng(0), Pose2(1.0, 2.0, 0.5))
    poses, forces, rates = [], [], []
    for step in range(1500):
        chair.step(2.3, 1.35 if step < 700 else 2.0, _free)
        poses.append(chair.pose)
        forces.append(chair.specific_force)
        rates.append(chair.angular_rate)
    mounts = np.array([(pose @ Pose2(x, y)).array()[:2] for pose in poses])
    accelerations = np.diff(mounts, n=2, axis=0) / 0.001**2
    for i in range(100, len(accelerations), 50):
        # the second difference is centred on poses[i + 1]; the force of the next step has its change
        expected = rotation(poses[i + 1].theta).T @ accelerations[i]
        assert forces[i + 2][:2] == pytest.approx(expected, abs=0.01)
        assert rates[i + 1][2] == pytest.approx((poses[i + 1].theta - poses[i].theta) / 0.001, abs=1e-6)
    assert np.ptp(np.array(forces)[:, 1]) > 0.3


def test_the_3d_pose_lies_flat_on_the_floor() -> None:
    chair = KinematicChair(CHAIR_A, QUIET, np.random.default_rng(0), Pose2(1.0, 2.0, 0.5))
    assert chair.pose3.planar().array() == pytest.approx(chair.pose.array())
    assert chair.pose3.translation.tolist() == [1.0, 2.0, 0.0]
    assert chair.upright


def test_the_eight_families_differ_from_the_nominal_chair_by_their_family_only() -> None:
    named = families(QUIET)
    assert len(named) == 8
    for settings in named.values():
        assert settings != QUIET
        assert dataclasses.replace(settings, family=QUIET.family) == QUIET


def test_random_values_at_the_limits_stay_possible() -> None:
    edge = dataclasses.replace(NOMINAL, forward_dead_band=0.5, delay_s=0.5, lag_s=1.0)
    drawn = [randomised(edge, seed) for seed in range(20)]
    assert max(chair.forward_dead_band for chair in drawn) == 0.5
    assert min(chair.forward_dead_band for chair in drawn) < 0.5
