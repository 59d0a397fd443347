"""Odometry from wheels, gyro and measured motions: accuracy, consistency of the covariance, and invalid input."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import CalibrationError
from waychair.geometry import arc
from waychair.slam.odometry.odometry_filter import OdometryFilter
from waychair.slam.odometry.odometry_model import OdometrySettings
from waychair.slam.odometry.wheel_counts import COUNTS
from waychair.types import FloatArray, ImuSample, Odometry, Pose2, WheelTicks

PER_METRE = CHAIR_A.ticks_per_turn / (math.tau * CHAIR_A.wheel_radius)
WHEELS_NS, IMU_NS, SECOND = 20_000_000, 5_000_000, 10**9
GRAVITY = np.array([0.0, 0.0, 9.80665])


@dataclass(frozen=True, slots=True)
class Faults:
    """Errors of a chair's wheels and gyro: `scale`, `drift` [rad/m], `track`, `gain`, `bias` [rad/s]."""

    scale: float = 0.0
    drift: float = 0.0
    track: float = 0.0
    gain: float = 0.0
    bias: float = 0.0


Reading = WheelTicks | ImuSample


def driven(
    speeds: FloatArray, faults: Faults, rng: np.random.Generator, noise: bool = True
) -> Iterator[tuple[Reading, Pose2]]:
    """Readings and true poses of a chair that moves by `speeds` (N, 2) [m/s, rad/s], 20 ms each."""
    s, pose, left, right, accel = OdometrySettings(), Pose2(), 0.0, 0.0, GRAVITY
    before = 0.0
    for k, (v, omega) in enumerate(speeds.tolist()):
        way, turn = v * 0.02, omega * 0.02
        white = rng.standard_normal(3) * noise
        accel = GRAVITY + np.array([(v - before) / 0.02, v * omega, 0.0])
        before = v
        for j in range(1, 5):
            rate = omega * (1 + faults.gain) + faults.bias + noise * s.gyro_noise / math.sqrt(0.005) * rng.normal()
            part = pose @ arc(way * j / 4, turn * j / 4)
            yield ImuSample(k * WHEELS_NS + j * IMU_NS, accel, np.array([0.0, 0.0, rate])), part
        pose = pose @ arc(way, turn)
        slip = math.sqrt(s.drift_noise**2 * abs(way) + s.turn_noise**2 * abs(turn)) * white[0]
        seen_way = (way + s.distance_noise * math.sqrt(abs(way)) * white[1]) / (1 + faults.scale)
        seen_turn = (turn + slip - faults.drift * seen_way) / (1 + faults.track)
        left += seen_way - seen_turn * CHAIR_A.track / 2
        right += seen_way + seen_turn * CHAIR_A.track / 2
        yield WheelTicks((k + 1) * WHEELS_NS, round(left * PER_METRE), round(right * PER_METRE)), pose


def wandering(seconds: float, rng: np.random.Generator) -> FloatArray:
    """Speeds of a drive that stands for two seconds, then drives straight, turns and turns in place in some order."""
    legs = [np.zeros((100, 2))]
    while sum(map(len, legs)) * 0.02 < seconds:
        v, omega = [(0.8, 0.0), (0.6, 0.4), (0.6, -0.5), (0.0, 0.6), (0.0, -0.6)][rng.integers(5)]
        legs.append(np.tile([v, omega], (rng.integers(50, 150), 1)))
    return np.concatenate(legs)


def nees_of(odometry: Odometry, truth: Pose2) -> float:
    """Squared error over its covariance, along the arc from the estimate to the truth.

    Errors of a heading bend a path, which is Gaussian in the coordinates of the motion group, not in x and y (Long et
    al., The banana distribution is Gaussian, RSS 2012).
    """
    assert odometry.covariance is not None
    gap = odometry.odom_from_base.inverse() @ truth
    half = gap.theta / 2
    k = half / math.tan(half) if half else 1.0
    error = np.array([k * gap.x + half * gap.y, k * gap.y - half * gap.x, gap.theta])
    c, s = math.cos(odometry.odom_from_base.theta), math.sin(odometry.odom_from_base.theta)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return float(error @ np.linalg.solve(turn @ odometry.covariance @ turn.T, error))


def counts(stamp_ns: int, way: float, turn: float = 0.0) -> WheelTicks:
    """Counts of a chair after this distance in all."""
    half = turn * CHAIR_A.track / 2
    return WheelTicks(stamp_ns, round((way - half) * PER_METRE), round((way + half) * PER_METRE))


def straight(odometry: OdometryFilter, metres: float) -> Odometry:
    """Half a metre per second, by wheels alone, from time 0 on."""
    steps = round(metres / 0.01)
    return [odometry.update_wheels(counts(k * WHEELS_NS, 0.01 * k)) for k in range(steps + 1)][-1]


def gyro(stamp_ns: int, rate: float, accel: float = 0.0) -> ImuSample:
    """A sample of a chair on the level."""
    return ImuSample(stamp_ns, GRAVITY + np.array([accel, 0.0, 0.0]), np.array([0.0, 0.0, rate]))


def test_equal_counts_drive_straight() -> None:
    odometry = OdometryFilter(CHAIR_A)
    odometry.update_wheels(WheelTicks(0, 0, 0))
    moved = odometry.update_wheels(counts(2 * SECOND, 2.0))
    assert moved.odom_from_base.x == pytest.approx(2.0, abs=1e-3)
    assert moved.odom_from_base.theta == 0.0
    assert moved.twist.v == pytest.approx(1.0, abs=1e-3)


def test_opposite_counts_turn_in_place_to_the_left() -> None:
    odometry = OdometryFilter(CHAIR_A)
    odometry.update_wheels(WheelTicks(0, 0, 0))
    moved = odometry.update_wheels(counts(SECOND, 0.0, math.pi / 2))
    assert moved.odom_from_base.theta == pytest.approx(math.pi / 2, abs=2e-3)
    assert math.hypot(moved.odom_from_base.x, moved.odom_from_base.y) < 1e-9


def test_a_wrap_of_the_counters_does_not_move_the_chair_back() -> None:
    odometry = OdometryFilter(CHAIR_A)
    odometry.update_wheels(WheelTicks(0, COUNTS - 10, COUNTS // 2 - 5))
    moved = odometry.update_wheels(WheelTicks(WHEELS_NS, 10, COUNTS // 2 + 15))
    assert moved.odom_from_base.x == pytest.approx(20 / PER_METRE, rel=1e-6)


@pytest.mark.parametrize("stamp_ns", [0, -5, SECOND, SECOND - 1])
def test_repeated_or_late_counts_change_nothing(stamp_ns: int) -> None:
    odometry = OdometryFilter(CHAIR_A)
    odometry.update_wheels(counts(0, 0.0))
    before = odometry.update_wheels(counts(SECOND, 0.5))
    if stamp_ns > 0:
        assert odometry.update_wheels(counts(stamp_ns, 0.9)) is before
    after = odometry.update_wheels(counts(SECOND + WHEELS_NS, 0.51))
    assert after.odom_from_base.x == pytest.approx(0.51, abs=1e-3)


def test_a_clock_that_goes_back_restarts_at_the_present_pose() -> None:
    odometry = OdometryFilter(CHAIR_A)
    here = straight(odometry, 3.0)
    again = odometry.update_wheels(counts(0, 3.01))
    assert again.stamp_ns == 0
    assert again.odom_from_base.x == pytest.approx(here.odom_from_base.x, abs=0.02)
    assert odometry.update_wheels(counts(WHEELS_NS, 3.02)).odom_from_base.x > again.odom_from_base.x


@pytest.mark.parametrize("ahead_s", [-1000, 1000])
def test_an_imu_with_another_clock_is_ignored(ahead_s: int) -> None:
    odometry = OdometryFilter(CHAIR_A)
    for k in range(101):
        last = odometry.update_wheels(counts(k * WHEELS_NS, 0.01 * k))
        odometry.update_imu(gyro(ahead_s * SECOND + k * WHEELS_NS, 1.0))
    assert last.odom_from_base.x == pytest.approx(1.0, abs=0.01)
    assert last.odom_from_base.theta == 0.0
    assert last.stamp_ns == 100 * WHEELS_NS


def test_a_jump_of_the_counts_does_not_move_the_chair() -> None:
    odometry = OdometryFilter(CHAIR_A)
    here = straight(odometry, 1.0)
    jumped = odometry.update_wheels(counts(here.stamp_ns + WHEELS_NS, 400.0))
    assert jumped.odom_from_base.x == pytest.approx(1.01, abs=0.02)
    assert odometry.update_wheels(counts(here.stamp_ns + 2 * WHEELS_NS, 400.01)).odom_from_base.x < 1.05


def test_encoders_that_start_again_after_a_silence_do_not_move_the_chair() -> None:
    odometry = OdometryFilter(CHAIR_A)
    here = straight(odometry, 3.0)
    again_ns = here.stamp_ns + 5 * SECOND
    assert odometry.update_wheels(counts(again_ns, 0.0)).odom_from_base.x == pytest.approx(3.0, abs=0.02)
    moved = odometry.update_wheels(counts(again_ns + WHEELS_NS, 0.01))
    assert moved.odom_from_base.x == pytest.approx(3.01, abs=0.02)
    assert odometry.wheels is not None
    assert odometry.wheels.left == pytest.approx(3.01 * PER_METRE, abs=2)


def test_counts_without_a_chair_body_are_refused_with_advice() -> None:
    with pytest.raises(CalibrationError, match="give the chair's body"):
        OdometryFilter().update_wheels(WheelTicks(0, 0, 0))


def test_recorded_odometry_keeps_its_steps_even_sideways() -> None:
    odometry, start = OdometryFilter(), Pose2(3.0, -2.0, 1.0)
    steps = [Pose2(0.02 * k, 0.004 * k, 0.01 * k) for k in range(50)]
    for k, step in enumerate(steps):
        last = odometry.update_wheels(Odometry(k * SECOND // 10, start @ step))
    assert last.odom_from_base.array() == pytest.approx(steps[-1].array(), abs=1e-12)


def test_readings_that_are_not_finite_are_left_out() -> None:
    odometry = OdometryFilter(CHAIR_A)
    here = straight(odometry, 0.5)
    for bad in (math.nan, math.inf, 1e6):
        assert odometry.update_imu(gyro(here.stamp_ns + 1, bad)) is here
    assert odometry.update_imu(gyro(here.stamp_ns + 1, 0.0, math.nan)) is here
    assert odometry.update_wheels(Odometry(here.stamp_ns + 2, Pose2(math.nan, 0.0, 0.0))) is here
    assert odometry.update_motion(0, here.stamp_ns, Pose2(), np.full((3, 3), math.nan)) is here


def test_a_chair_at_rest_learns_the_gyros_bias_and_does_not_turn() -> None:
    odometry, rng = OdometryFilter(CHAIR_A), np.random.default_rng(1)
    for reading, _ in driven(np.zeros((150, 2)), Faults(bias=0.012), rng):
        last = odometry.update_imu(reading) if isinstance(reading, ImuSample) else odometry.update_wheels(reading)
    bias, sigma = odometry.gyro_bias
    assert bias == pytest.approx(0.012, abs=3 * sigma)
    assert sigma < 4e-4
    assert abs(last.odom_from_base.theta) < 0.012 * 0.5
    assert last.twist.omega == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("with_gyro", [False, True])
def test_errors_agree_with_the_covariance(with_gyro: bool) -> None:
    """Chairs drawn from the filter's prior: the sum of the squared errors (3 dof each) lies in the 99 % band."""
    s, nees = OdometrySettings(), []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        sigmas = (s.wheel_scale, s.wheel_drift, s.track_scale, s.gyro_scale, s.gyro_bias)
        faults = Faults(*(rng.normal(0.0, sigma) for sigma in sigmas))
        odometry = OdometryFilter(CHAIR_A)
        for reading, pose in driven(wandering(12.0, rng), faults, rng):
            if isinstance(reading, WheelTicks):
                last, truth = odometry.update_wheels(reading), pose
            elif with_gyro:
                odometry.update_imu(reading)
        nees.append(nees_of(last, truth))
    assert 6.2 < sum(nees) < 37.2  # chi-square of 18 degrees of freedom, 0.5 % and 99.5 %


@pytest.mark.parametrize("with_gyro", [False, True])
def test_errors_of_the_speeds_agree_with_their_covariance(with_gyro: bool) -> None:
    """Within a factor of two in sigmas; a reading's rounding is not white."""
    squares = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        speeds, odometry = wandering(8.0, rng), OdometryFilter(CHAIR_A)
        k = 0
        for reading, _ in driven(speeds, Faults(scale=0.005, bias=0.01), rng):
            if isinstance(reading, WheelTicks):
                twist, sigmas = odometry.update_wheels(reading).twist, np.sqrt(np.diag(odometry.twist_covariance))
                if k > 50:
                    squares.append(((np.array([twist.v, twist.omega]) - speeds[k]) / sigmas[[0, 2]]) ** 2)
                k += 1
            elif with_gyro:
                odometry.update_imu(reading)
    means = np.mean(squares, axis=0)
    assert (means < 4.0).all()
    assert (means > 0.1).all()
    covariance = odometry.twist_covariance
    assert np.linalg.eigvalsh(covariance).min() > 0.0


def test_the_gyro_makes_the_heading_more_certain_than_unequal_wheels() -> None:
    rng, both, wheels = np.random.default_rng(3), OdometryFilter(CHAIR_A), OdometryFilter(CHAIR_A)
    for reading, pose in driven(wandering(25.0, rng), Faults(drift=0.005, bias=0.004), rng):
        if isinstance(reading, ImuSample):
            both.update_imu(reading)
        else:
            fused, alone, truth = both.update_wheels(reading), wheels.update_wheels(reading), pose
    off = [abs((odometry.odom_from_base.inverse() @ truth).theta) for odometry in (fused, alone)]
    assert off[0] < 0.3 * off[1]


def test_systematic_errors_grow_with_the_distance_and_not_with_its_square_root() -> None:
    sigmas = []
    for metres in (10.0, 40.0):
        covariance = straight(
            OdometryFilter(CHAIR_A, OdometrySettings(drift_noise=0.0, distance_noise=0.0)), metres
        ).covariance
        assert covariance is not None
        sigmas.append(np.sqrt(np.diag(covariance)))
    assert sigmas[1][[0, 2]] / sigmas[0][[0, 2]] == pytest.approx(4.0, rel=0.01)
    assert sigmas[1][1] / sigmas[0][1] == pytest.approx(16.0, rel=0.01)


def test_one_spinning_wheel_is_found_as_slip_and_does_not_turn_the_chair() -> None:
    odometry, turned, stamp = OdometryFilter(CHAIR_A), 0.0, 0
    covariances = []
    for k in range(150):
        turned += 0.02 if 100 <= k < 125 else 0.0  # half a second at 1 rad/s, by the wheels
        for j in range(1, 5):
            odometry.update_imu(gyro(stamp + j * IMU_NS, 0.0))
        stamp += WHEELS_NS
        last = odometry.update_wheels(counts(stamp, 0.006 * k, turned))
        covariances.append(last.covariance)
        assert odometry.slipping == (100 <= k < 125 + 14)
    assert abs(last.odom_from_base.theta) < 0.02
    assert covariances[126][0, 0] > 2.0 * covariances[99][0, 0]


def test_two_spinning_wheels_do_not_move_the_chair() -> None:
    odometry, way, stamp, slipped = OdometryFilter(CHAIR_A), 0.0, 0, False
    for k in range(150):
        way += 0.016 if 100 <= k < 125 else 0.0  # half a second at 0.8 m/s, of a chair that stands in mud
        for j in range(1, 5):
            odometry.update_imu(gyro(stamp + j * IMU_NS, 0.0))
        stamp += WHEELS_NS
        last = odometry.update_wheels(counts(stamp, way))
        slipped = slipped or odometry.slipping
    assert slipped
    assert last.odom_from_base.x < 0.1 * way
    assert last.covariance is not None
    assert math.sqrt(last.covariance[0, 0]) > 0.2 * way


def test_a_real_acceleration_is_not_taken_for_slip() -> None:
    odometry, rng = OdometryFilter(CHAIR_A), np.random.default_rng(0)
    speeds = np.concatenate([np.zeros(50), np.linspace(0, 1.2, 60), np.full(50, 1.2), np.linspace(1.2, 0, 30)])
    for reading, pose in driven(np.stack([speeds, 0 * speeds], axis=1), Faults(), rng):
        truth = pose
        last = odometry.update_imu(reading) if isinstance(reading, ImuSample) else odometry.update_wheels(reading)
        assert not odometry.slipping
    assert last.odom_from_base.x == pytest.approx(truth.x, rel=0.01)


def test_measured_motions_alone_move_the_chair() -> None:
    odometry, rng, pose = OdometryFilter(), np.random.default_rng(0), Pose2()
    sigma = np.array([0.005, 0.005, 0.003])
    for k in range(200):
        step = arc(0.06 * min(1.0, k / 20), 0.05 if 60 < k < 120 else 0.0)
        pose = pose @ step
        seen = Pose2(*(step.array() + sigma * rng.standard_normal(3)))
        last = odometry.update_motion(k * SECOND // 10, (k + 1) * SECOND // 10, seen, np.diag(sigma**2))
    assert nees_of(last, pose) < 16.3  # 99.9 % of three degrees of freedom
    assert last.twist.v == pytest.approx(0.6, abs=0.15)
    assert math.hypot(*(last.odom_from_base.array() - pose.array())[:2]) < 0.5


def test_measured_motions_estimate_the_size_of_the_wheels() -> None:
    odometry = OdometryFilter(CHAIR_A, OdometrySettings(wheel_scale=0.05))
    for k in range(501):
        last = odometry.update_wheels(counts(k * WHEELS_NS, 0.01 * k))
        if k and k % 50 == 0:  # the true distance is 4 % longer
            begin, end = (k - 50) * WHEELS_NS, k * WHEELS_NS
            last = odometry.update_motion(begin, end, Pose2(0.52), np.diag([0.003, 0.003, 0.002]) ** 2)
    assert last.odom_from_base.x == pytest.approx(1.04 * 5.0, abs=0.06)
    assert last.twist.v == pytest.approx(0.52, abs=0.016)


def test_a_match_with_a_large_error_moves_the_chair_only_a_little() -> None:
    odometry = OdometryFilter(CHAIR_A)
    for k in range(101):
        odometry.update_wheels(counts(k * WHEELS_NS, 0.01 * k))
        if k == 50:
            odometry.update_motion(0, k * WHEELS_NS, Pose2(0.5), np.diag([1e-4, 1e-4, 1e-4]))
    after = odometry.update_motion(50 * WHEELS_NS, 100 * WHEELS_NS, Pose2(1.5, 0.0, 0.5), np.diag([1e-5, 1e-5, 1e-5]))
    assert after.odom_from_base.x == pytest.approx(1.0, abs=0.1)


def test_with_silent_wheels_the_gyro_and_the_last_speed_are_used() -> None:
    odometry = OdometryFilter(CHAIR_A)
    begun = straight(odometry, 1.0)
    for k in range(1, 401):
        last = odometry.update_imu(gyro(begun.stamp_ns + k * IMU_NS, 0.5))
    assert last.odom_from_base.theta == pytest.approx(1.0, abs=0.02)
    assert last.covariance is not None
    assert begun.covariance is not None
    assert last.covariance[0, 0] > 0.1 > begun.covariance[0, 0]
    back = odometry.update_wheels(counts(last.stamp_ns + IMU_NS, 2.0))
    assert np.isfinite(back.odom_from_base.array()).all()


def test_prediction_interpolates_and_extrapolates_for_a_tenth_of_a_second_only() -> None:
    odometry = OdometryFilter(CHAIR_A)
    assert odometry.predict(5).odom_from_base == Pose2()
    last = straight(odometry, 2.0)
    x, at = last.odom_from_base.x, last.stamp_ns
    assert odometry.predict(at - WHEELS_NS // 2).odom_from_base.x == pytest.approx(x - 0.005, abs=3e-4)
    assert odometry.predict(at + SECOND // 20).odom_from_base.x == pytest.approx(x + 0.025, abs=2e-3)
    assert odometry.predict(at + SECOND).odom_from_base == odometry.predict(at + SECOND // 10).odom_from_base
    assert odometry.predict(at).odom_from_base == last.odom_from_base


def test_a_late_wheel_reading_does_not_count_the_gyro_twice() -> None:
    odometry, turn = OdometryFilter(CHAIR_A), 0.0
    for k in range(1, 201):
        for j in range(4):
            odometry.update_imu(gyro((4 * k + j) * IMU_NS, 0.5))
        turn += 0.01
        odometry.update_wheels(counts(k * WHEELS_NS, 0.0, turn))  # 15 ms older than the last sample
    assert not odometry.slipping
    assert odometry.predict(200 * WHEELS_NS).odom_from_base.theta == pytest.approx(
        math.remainder(turn, math.tau), abs=0.02
    )


def test_the_twist_of_wheels_alone_is_that_of_the_last_step() -> None:
    odometry = OdometryFilter(CHAIR_A)
    odometry.update_wheels(counts(0, 0.0))
    odometry.update_wheels(counts(WHEELS_NS, 0.02))
    twist = odometry.update_wheels(counts(2 * WHEELS_NS, 0.03, 0.01)).twist
    assert twist.v == pytest.approx(0.5, abs=0.02)
    assert twist.omega == pytest.approx(0.5, abs=0.03)


def test_a_chair_that_stands_keeps_its_pose_however_far_it_has_driven_and_learns_the_gyros_bias() -> None:
    rng = np.random.default_rng(4)
    speeds = np.zeros((4500, 2))
    speeds[100:1500] = np.column_stack([np.full(1400, 0.5), 0.4 * np.sin(np.arange(1400) / 60)])
    odometry, poses = OdometryFilter(CHAIR_A), []
    for reading, _ in driven(speeds, Faults(bias=0.003), rng):
        if isinstance(reading, ImuSample):
            odometry.update_imu(reading)
        else:
            poses.append(odometry.update_wheels(reading).odom_from_base)
    rest = [poses[1550].inverse() @ pose for pose in poses[1550:]]
    assert max(math.hypot(pose.x, pose.y) for pose in rest) < 1e-3
    assert max(abs(pose.theta) for pose in rest) < 5e-4
    bias, deviation = odometry.gyro_bias
    assert abs(bias - 0.003) < 3 * deviation + 1e-4
