"""An IMU that is not what it says is corrected or left out, by name; it cannot ruin a map that is sound without it."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from tests.cases.mapping.aided_drive import Imu, ImuFault, checked, error_of, looks, recorded
from waychair.slam.odometry.aid_findings import AidFinding, AidNames, AidPart, AidState, Cause, sentence
from waychair.slam.odometry.odometry_filter import OdometryFilter
from waychair.types import ImuSample, Odometry, Pose2, Twist

GOOD = 0.05
"""m; RMSE of a map that is as good as that of a sound IMU."""

ON_SIDE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def since(second: float, other: Imu, sound: Imu) -> Imu:
    """The sound IMU up to a time, then the other."""
    late = (sound.times > second)[:, None]
    return Imu(sound.times, np.where(late, other.gyro, sound.gyro), np.where(late, other.accel, sound.accel))


def in_degrees(sound: Imu) -> Imu:
    return replace(sound, gyro=np.degrees(sound.gyro))


def hanging(sound: Imu) -> Imu:
    return replace(sound, gyro=sound.gyro * (1, -1, -1), accel=sound.accel * (1, -1, -1))


def on_edge(sound: Imu) -> Imu:
    return replace(sound, gyro=sound.gyro @ ON_SIDE.T, accel=sound.accel @ ON_SIDE.T)


def leaning(sound: Imu) -> Imu:
    """An IMU whose front is 8 degrees down, though the mount says level."""
    c, s = math.cos(math.radians(8.0)), math.sin(math.radians(8.0))
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return replace(sound, gyro=sound.gyro @ turn, accel=sound.accel @ turn)


def backward(sound: Imu) -> Imu:
    """An IMU that looks backward, though the mount says forward."""
    return replace(sound, gyro=sound.gyro * (-1, -1, 1), accel=sound.accel * (-1, -1, 1))


def dead(sound: Imu) -> Imu:
    return replace(sound, gyro=0.0 * sound.gyro, accel=0.0 * sound.accel)


def without_gravity(sound: Imu) -> Imu:
    return replace(sound, accel=sound.accel - (0.0, 0.0, 9.81))


CASES: dict[str, tuple[ImuFault, tuple[AidPart, AidState, Cause]]] = {
    "degrees": (in_degrees, (AidPart.GYRO, AidState.CORRECTED, Cause.DEGREES)),
    "upside down": (hanging, (AidPart.GYRO, AidState.CORRECTED, Cause.OTHER_WAY)),
    "on edge": (on_edge, (AidPart.GYRO, AidState.CORRECTED, Cause.ON_EDGE)),
    "zeros": (dead, (AidPart.GYRO, AidState.LEFT_OUT, Cause.NOTHING)),
    "no gravity": (without_gravity, (AidPart.GRAVITY, AidState.LEFT_OUT, Cause.NO_GRAVITY)),
    "leaning": (leaning, (AidPart.GRAVITY, AidState.CORRECTED, Cause.LEANING)),
    "backward": (backward, (AidPart.GRAVITY, AidState.LEFT_OUT, Cause.FALSE_SLIPS)),
    "in g": (
        lambda sound: replace(sound, accel=sound.accel / 9.80665),
        (AidPart.GRAVITY, AidState.CORRECTED, Cause.IN_G),
    ),
    "bias": (lambda sound: replace(sound, gyro=sound.gyro + 0.3), (AidPart.GYRO, AidState.CORRECTED, Cause.BIAS)),
    "twice": (lambda sound: replace(sound, gyro=2.0 * sound.gyro), (AidPart.GYRO, AidState.CORRECTED, Cause.SCALE)),
    "late": (lambda sound: replace(sound, times=sound.times + 0.5), (AidPart.GYRO, AidState.CORRECTED, Cause.DELAY)),
    "noise": (
        lambda sound: replace(sound, gyro=np.random.default_rng(1).normal(0.0, 2.0, sound.gyro.shape)),
        (AidPart.GYRO, AidState.LEFT_OUT, Cause.UNLIKE),
    ),
}


BY_DAY = ("degrees", "bias", "zeros", "upside down", "no gravity", "leaning")


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "name", [*BY_DAY, *(pytest.param(name, marks=pytest.mark.nightly) for name in CASES if name not in BY_DAY)]
)
def test_an_imu_that_lies_is_named_and_the_map_is_sound(name: str) -> None:
    fault, look = CASES[name]
    recording, truth = recorded(imu=fault)
    error, mapping = error_of(recording, truth)
    assert look in looks(checked(recording).findings)
    assert error < GOOD
    assert all("odometry" not in warning and "lidar" not in warning for warning in mapping.report["warnings"])


def test_a_gyro_that_sticks_is_left_out_from_then_on() -> None:
    def stuck(sound: Imu) -> Imu:
        return since(12.0, replace(sound, gyro=np.full_like(sound.gyro, 0.4)), sound)

    recording, truth = recorded(imu=stuck)
    found = checked(recording)
    assert looks(found.findings) == [(AidPart.GYRO, AidState.LEFT_OUT, Cause.STUCK)]
    assert found.findings[0].since_s == pytest.approx(12.0, abs=3.0)
    assert any(frame.imu for frame in found.recording.frames[:40])
    assert not any(frame.imu for frame in found.recording.frames[-40:])
    assert error_of(recording, truth)[0] < GOOD


def test_a_gyro_in_degrees_becomes_one_in_radians() -> None:
    sound, _ = recorded(imu=lambda sound: sound)
    made, _ = recorded(imu=in_degrees)
    for frame, true in zip(checked(made).recording.frames[20:], sound.frames[20:], strict=True):
        for sample, told in zip(frame.imu, true.imu, strict=True):
            assert sample.gyro[2] == pytest.approx(told.gyro[2], abs=0.02)


def test_a_gyro_in_degrees_is_told_although_scans_blur_turns() -> None:
    made, _ = recorded(imu=lambda sound: replace(sound, gyro=np.degrees(0.93 * sound.gyro)))
    (finding,) = checked(made).findings
    assert finding.cause is Cause.DEGREES
    assert finding.value == pytest.approx(180.0 / math.pi)


def test_gravity_that_is_lost_on_the_way_has_its_time() -> None:
    made, _ = recorded(imu=lambda sound: since(14.0, without_gravity(sound), sound))
    (finding,) = checked(made).findings
    assert (finding.part, finding.cause) == (AidPart.GRAVITY, Cause.NO_GRAVITY)
    assert finding.since_s == pytest.approx(14.0, abs=3.0)


def test_without_wheels_a_sound_imu_is_joined_by_the_ways_of_the_scans() -> None:
    recording, truth = recorded(None, imu=lambda sound: sound)
    assert error_of(recording, truth)[0] < GOOD


def test_the_sentence_names_the_topic_the_fault_the_consequence_and_the_time() -> None:
    finding = AidFinding(AidPart.GYRO, AidState.CORRECTED, Cause.DEGREES, since_s=31.6, value=57.29578)
    assert sentence(finding, AidNames("/scan", "/odom", "/imu/data")) == (
        "/imu/data: the turn rates are 57.3 times too large, as in degrees: corrected, since 32 s"
    )


def test_an_unknown_acceleration_shows_no_slip() -> None:
    def speed_after(accel: float) -> tuple[bool, float]:
        odometry = OdometryFilter()
        for k in range(60):
            stamp, v = k * 20_000_000, 0.0 if k < 20 else 1.0
            odometry.update_imu(ImuSample(stamp, np.array([accel, 0.0, 9.81]), np.zeros(3)))
            x = 0.02 * max(0, k - 20)
            odometry.update_wheels(Odometry(stamp, Pose2(x, 0.0, 0.0), Twist(v, 0.0)))
        return odometry.slipping, odometry.predict(59 * 20_000_000).twist.v

    assert speed_after(0.0)[0]
    slips, speed = speed_after(math.nan)
    assert not slips
    assert speed == pytest.approx(1.0, abs=0.05)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("size", [15.0, 1e3, 1e8])
def test_single_wild_samples_are_left_out_by_name_and_the_map_stays_right(size: float) -> None:
    def wild(sound: Imu) -> Imu:
        gyro = sound.gyro.copy()
        gyro[np.random.default_rng(4).integers(0, len(gyro), 40), 2] += size
        return replace(sound, gyro=gyro)

    recording, truth = recorded(imu=wild)
    found = checked(recording)
    (finding,) = found.findings
    assert (finding.part, finding.state, finding.cause) == (AidPart.GYRO, AidState.LEFT_OUT, Cause.WILD)
    assert 35 <= finding.count <= 40
    assert finding.value == pytest.approx(size, rel=0.1)
    assert re.search(r"messages from [\d.]+ to [\d.]+ s have wild turn rates", found.sentences[0])
    assert error_of(recording, truth)[0] < GOOD


def test_a_burst_of_wild_forces_is_left_out() -> None:
    def shaken(sound: Imu) -> Imu:
        accel = sound.accel.copy()
        accel[400:425] = (900.0, 0.0, -900.0)
        return replace(sound, accel=accel)

    (finding,) = checked(recorded(imu=shaken)[0]).findings
    assert (finding.part, finding.cause, finding.count) == (AidPart.GRAVITY, Cause.WILD, 25)
