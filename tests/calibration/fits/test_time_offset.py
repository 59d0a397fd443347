"""The delay of a sensor's stamps is found from its turns at any rate, noise, scale and mounting."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from waychair.calibration.fits import time_offset as offsets
from waychair.calibration.fits.time_offset import (
    Heading,
    SensorDelays,
    heading_from_gyro,
    time_offset,
    without_delay,
)
from waychair.errors import CalibrationError, ThinData
from waychair.recordings.bags.bag_parts import BagFiles
from waychair.recordings.bags.ros_decoding import imu_from_message, odometry_from_message
from waychair.recordings.bags.rosbag_file import iterate_messages, open_bag
from waychair.types import FloatArray, ImuSample, Odometry, Pose2, RgbdFrame, Scan, SonarReadings, WheelTicks

MS = 1_000_000
GRAVITY = np.array([0.0, 0.0, 9.80665])


def heading_at(seconds: FloatArray, seed: int = 0) -> FloatArray:
    """Return a smooth heading [rad] that swings irregularly from side to side."""
    rng = np.random.default_rng(seed)
    parts = [
        a * np.sin(w * seconds + p)
        for a, w, p in zip(rng.uniform(0.2, 0.5, 4), rng.uniform(0.8, 3.5, 4), rng.uniform(0, 6, 4), strict=True)
    ]
    return np.asarray(np.sum(parts, axis=0))


def gyro(seconds: float = 30.0, bias: float = 0.01, noise: float = 0.003, seed: int = 0) -> list[ImuSample]:
    """Return gyro samples at 200 Hz, each the mean rate since the sample before."""
    times = np.arange(-1, round(200 * seconds)) / 200.0
    rates = np.diff(heading_at(times, seed)) * 200.0 + bias
    rates += noise * np.random.default_rng(seed + 1).standard_normal(len(rates))
    return [
        ImuSample(round(1e9 * t), GRAVITY, np.array([0.0, 0.0, rate])) for t, rate in zip(times[1:], rates, strict=True)
    ]


def seen(rate_hz: float, delay_s: float, noise: float = 0.001, scale: float = 1.0, seed: int = 0) -> Heading:
    """Return the same turns seen by a sensor with late stamps."""
    times = np.arange(0.0, 30.0, 1.0 / rate_hz)
    rng = np.random.default_rng(seed + 2)
    headings = scale * heading_at(times, seed) + noise * rng.standard_normal(len(times))
    return Heading(np.round(1e9 * (times + delay_s)).astype(np.int64), headings)


@settings(max_examples=25)
@given(delay=st.floats(-0.05, 0.2), rate=st.sampled_from([5.0, 10.0, 15.0, 50.0]), seed=st.integers(0, 20))
def test_a_delay_is_found_at_any_rate(delay: float, rate: float, seed: int) -> None:
    found = time_offset(seen(rate, delay, seed=seed), heading_from_gyro(gyro(seed=seed)), "lidar")
    assert found.delay_ns * 1e-9 == pytest.approx(delay, abs=0.002)
    assert found.sigma_ns < 2 * MS
    assert found.correlation > 0.99


@pytest.mark.parametrize("wandering", [False, True])
def test_the_error_estimate_agrees_with_the_true_errors(wandering: bool) -> None:
    """Over many seeds, errors are no larger than estimated, and of the estimated size when the heading wanders."""
    ratios = []
    for seed in range(15):
        clean = seen(10.0, 0.03, noise=0.0, seed=seed)
        noise = 0.004 * np.random.default_rng(seed + 9).standard_normal(len(clean.headings))
        headings = clean.headings + (np.cumsum(noise) if wandering else noise)
        found = time_offset(Heading(clean.stamps_ns, headings), heading_from_gyro(gyro(seed=seed)), "lidar")
        ratios.append((found.delay_ns - 30 * MS) / found.sigma_ns)
    rms = float(np.sqrt(np.mean(np.square(ratios))))
    assert (0.6 if wandering else 0.1) < rms < 1.4


@pytest.mark.parametrize("scale", [0.9, 1.0, 1.1])
def test_scale_errors_and_biases_do_not_change_the_delay(scale: float) -> None:
    found = time_offset(seen(50.0, 0.04, scale=scale), heading_from_gyro(gyro(bias=0.1)), "wheels")
    assert found.delay_ns == pytest.approx(40 * MS, abs=2 * MS)


def test_slips_and_failed_matches_are_ignored() -> None:
    clean = seen(10.0, 0.05)
    headings = clean.headings.copy()
    headings[100:] += 0.4  # slipped
    headings[150] = np.nan  # lost, and started again elsewhere
    headings[151:] -= 1.7
    headings[200] += 0.3  # one wrong match
    found = time_offset(Heading(clean.stamps_ns, headings), heading_from_gyro(gyro()), "lidar")
    assert found.delay_ns == pytest.approx(50 * MS, abs=2 * MS)


@settings(max_examples=5)
@given(seed=st.integers(0, 1000))
def test_the_gyro_may_be_mounted_in_any_attitude(seed: int) -> None:
    turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    samples = [ImuSample(s.stamp_ns, turn @ s.accel, turn @ s.gyro) for s in gyro()]
    assert heading_from_gyro(samples).headings == pytest.approx(heading_from_gyro(gyro()).headings, abs=1e-9)


def test_unordered_repeated_or_invalid_samples_do_not_change_the_delay() -> None:
    samples = gyro()
    shuffled = [
        *samples[:50],
        *samples[60:70],
        *samples[50:60],
        *samples[65:],
        replace(samples[7], stamp_ns=10**12, gyro=np.full(3, np.nan)),
    ]
    assert heading_from_gyro(shuffled).headings == pytest.approx(heading_from_gyro(samples).headings)


def test_too_few_samples_are_refused() -> None:
    known = heading_from_gyro(gyro())
    with pytest.raises(ThinData, match="record the IMU too"):
        heading_from_gyro([])
    with pytest.raises(ThinData, match="0 turns seen by the lidar"):
        time_offset(Heading(np.zeros(0, np.int64), np.zeros(0)), known, "lidar")
    even = [replace(s, gyro=np.array([0.0, 0.0, 0.3])) for s in gyro()]
    with pytest.raises(ThinData, match="turn left and right"):
        time_offset(seen(10.0, 0.0), heading_from_gyro(even), "lidar")


def test_a_sensor_with_different_turns_is_refused() -> None:
    with pytest.raises(CalibrationError, match="do not follow the gyro's"):
        time_offset(seen(10.0, 0.0, seed=9), heading_from_gyro(gyro(seed=0)), "camera")


def test_a_delay_beyond_the_search_range_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("EARLIEST_S", -0.01), ("LATEST_S", 0.04), ("LEAST_CORRELATION", 0.5)):
        monkeypatch.setattr(offsets, name, value)
    with pytest.raises(CalibrationError, match=r"stamps of the lidar are off by .* set its clock first"):
        time_offset(seen(10.0, 0.07), heading_from_gyro(gyro()), "lidar")


def test_each_sensor_is_corrected_by_its_own_delay() -> None:
    late = SensorDelays(lidar_ns=1, wheels_ns=20, camera_ns=300)
    pixel = np.zeros((1, 1), np.uint8)
    stamped = [
        (Scan(1000, np.ones(2, np.float32), 0.0, 0.1), 999),
        (WheelTicks(1000, 0, 0), 980),
        (Odometry(1000, Pose2()), 980),
        (RgbdFrame(1000, pixel, pixel.astype(np.float32), np.eye(3)), 700),
        (ImuSample(1000, GRAVITY, GRAVITY), 1000),
        (SonarReadings(1000, np.ones(2, np.float32)), 1000),
    ]
    for message, stamp in stamped:
        assert without_delay(message, late).stamp_ns == stamp  # type: ignore[attr-defined]


def test_on_a_real_robot_both_halves_agree_and_an_added_delay_is_found(data_dir: Path) -> None:
    """A Husky outdoors, its IMU on its side: its wheels turn about 70 ms before its body does (tyres give)."""
    samples: list[ImuSample] = []
    wheels: list[Odometry] = []
    path = data_dir / "ros_bags" / "husky_imu_odom_gps.bag"
    with open_bag(BagFiles(path, ((path, ".bag"),))) as bag:
        for connection, _, message in iterate_messages(path, bag, bag.connections):
            if connection.msgtype == "sensor_msgs/msg/Imu" and (sample := imu_from_message(message)):
                samples.append(sample)
            elif connection.msgtype == "nav_msgs/msg/Odometry" and (odometry := odometry_from_message(message)):
                wheels.append(odometry)
    stamps = np.array([reading.stamp_ns for reading in wheels])
    headings = np.unwrap([reading.odom_from_base.theta for reading in wheels])
    turned, half = heading_from_gyro(samples), len(stamps) // 2
    halves = [
        time_offset(Heading(stamps[part], headings[part]), turned, "wheels")
        for part in (slice(half), slice(half, None))
    ]
    assert abs(halves[0].delay_ns - halves[1].delay_ns) < 15 * MS
    assert all(each.correlation > 0.99 for each in halves)
    whole = time_offset(Heading(stamps, headings), turned, "wheels")
    later = time_offset(Heading(stamps + 40 * MS, headings), turned, "wheels")
    assert later.delay_ns - whole.delay_ns == pytest.approx(40 * MS, abs=MS)
