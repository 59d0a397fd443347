"""Wheel odometry that is not what it says is corrected or left out, by name, and the map is that of sound wheels."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from tests.bags import SECOND, Bag
from tests.cases.mapping.aided_drive import ImuFault, WheelFault, Wheels, checked, error_of, looks, recorded, turned
from waychair.cli.options.recording_options import RecordingOptions
from waychair.recordings.recording import InputSettings, Recording, read_recording
from waychair.recordings.scans import mirrored
from waychair.slam.mapping.live_mapping import LiveMapping, LiveMappingSettings
from waychair.slam.odometry.aid_findings import AidPart, AidState, Cause
from waychair.slam.odometry.broken_steps import BreakKind, OrderedOdometry, repaired
from waychair.slam.scan.scan_motion import LONGEST_APART_S
from waychair.slam.trajectory_errors import truth_errors
from waychair.types import FloatArray, Odometry, Pose2, SensorFrame, WheelTicks

GOOD = 0.05
"""m; RMSE of a map that is as good as that of sound wheels."""


def from_half(change: Callable[[FloatArray], FloatArray]) -> WheelFault:
    """Odometry whose poses change from the middle of the drive on."""

    def fault(sound: Wheels) -> Wheels:
        half = len(sound.times) // 2
        poses = sound.poses.copy()
        poses[half:] = change(poses[half:])
        return replace(sound, poses=poses)

    return fault


def begin_anew(poses: FloatArray) -> FloatArray:
    """Poses that count from zero."""
    first = poses[0]
    back = np.array([-math.cos(first[2]) * first[0] - math.sin(first[2]) * first[1],
                     math.sin(first[2]) * first[0] - math.cos(first[2]) * first[1], -first[2]])  # fmt: skip
    return turned(poses, back)


def some_off(count: int) -> WheelFault:
    """Odometry of which some messages in the middle are 100 km away."""

    def fault(sound: Wheels) -> Wheels:
        poses, half = sound.poses.copy(), len(sound.times) // 2
        poses[half : half + count, :2] += (1e5, -1e5)
        return replace(sound, poses=poses)

    return fault


def silent(sound: Wheels) -> Wheels:
    """Odometry that says nothing for a second, and then counts from zero."""
    part = (sound.times > 0.4 * sound.times[-1]) & (sound.times < 0.4 * sound.times[-1] + 1.0)
    poses, after = sound.poses.copy(), int(np.flatnonzero(part)[-1]) + 1
    poses[after:] = begin_anew(poses[after:])
    return Wheels(sound.times[~part], poses[~part], sound.speeds[~part])


def mute(sound: Wheels) -> Wheels:
    """Odometry without messages for five seconds, which goes on as if it had counted."""
    part = (sound.times > 0.4 * sound.times[-1]) & (sound.times < 0.4 * sound.times[-1] + 5.0)
    return Wheels(sound.times[~part], sound.poses[~part], sound.speeds[~part])


def first_off(sound: Wheels) -> Wheels:
    """Odometry whose first message is 100 km away."""
    poses = sound.poses.copy()
    poses[0, 0] += 1e5
    return replace(sound, poses=poses)


def stopped(sound: Wheels) -> Wheels:
    """Odometry that stands still from the middle of the drive on."""
    poses, speeds, half = sound.poses.copy(), sound.speeds.copy(), len(sound.times) // 2
    poses[half:], speeds[half:] = poses[half], 0.0
    return Wheels(sound.times, poses, speeds)


def scaled(*factors: float) -> WheelFault:
    """Odometry whose x, y and heading are other by factors."""
    return lambda sound: sound.moved(lambda _, poses: poses * factors)


def test_sound_aids_are_used_as_they_are() -> None:
    recording, truth = recorded(imu=lambda sound: sound)
    found = checked(recording)
    assert found.recording is recording
    assert found.findings == ()
    assert error_of(recording, truth)[0] < GOOD


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("fault", "cause", "words"),
    [
        (from_half(begin_anew), Cause.RESTART, "begins anew at zero"),
        (from_half(lambda poses: poses + np.array([3.0, 0.0, 0.0])), Cause.JUMP, "jumps by 3.0 m"),
        (from_half(lambda poses: turned(poses, np.array([1.0, -4.0, 1.2]))), Cause.JUMP, "jumps by"),
        (silent, Cause.RESTART, "begins anew at zero"),
        (some_off(1), Cause.WILD, "one message"),
        (some_off(30), Cause.WILD, "30 messages"),
    ],
    ids=["restart", "jump", "turned jump", "silence and restart", "one wild message", "two seconds of wild messages"],
)
def test_a_step_that_no_chair_drives_is_no_motion(fault: WheelFault, cause: Cause, words: str) -> None:
    recording, truth = recorded(fault)
    error, mapping = error_of(recording, truth)
    assert error < GOOD
    (finding,) = mapping.report["aids"]
    assert finding["cause"] == cause.value
    end = (truth.stamps_ns[-1] - truth.stamps_ns[0]) * 1e-9
    assert 0.35 * end < finding["since_s"] < 0.6 * end
    assert any(words in warning for warning in mapping.report["warnings"])
    (told,) = mapping.report["health"]
    assert told["kind"] == cause.value
    assert told["first_s"] == finding["since_s"]
    assert words in told["text"]


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("fault", "part", "state", "cause"),
    [
        (scaled(1000.0, 1000.0, 1.0), AidPart.WHEEL_WAY, AidState.CORRECTED, Cause.MILLIMETRES),
        (
            lambda sound: sound.moved(lambda _, p: p[:, [1, 0, 2]]),
            AidPart.WHEEL_WAY,
            AidState.CORRECTED,
            Cause.EXCHANGED,
        ),
        (scaled(1.0, -1.0, 1.0), AidPart.WHEEL_WAY, AidState.CORRECTED, Cause.EXCHANGED),
        (lambda sound: sound.rolled(way=0.5), AidPart.WHEEL_WAY, AidState.CORRECTED, Cause.SCALE),
        (lambda sound: sound.rolled(way=-1.0), AidPart.WHEEL_WAY, AidState.CORRECTED, Cause.BACKWARD),
        (lambda sound: sound.rolled(turn=1.5), AidPart.WHEEL_TURN, AidState.CORRECTED, Cause.SCALE),
        (scaled(1.0, -1.0, -1.0), AidPart.WHEEL_TURN, AidState.CORRECTED, Cause.OTHER_WAY),
        (scaled(1.0, 1.0, 0.0), AidPart.WHEEL_TURN, AidState.LEFT_OUT, Cause.NOTHING),
        (lambda sound: replace(sound, times=sound.times + 0.6), AidPart.WHEELS, AidState.CORRECTED, Cause.DELAY),
    ],
    ids=["mm", "x and y exchanged", "y mirrored", "half", "backward", "track", "mirrored", "no heading", "late"],
)
def test_odometry_in_other_units_or_axes_is_corrected_by_name(
    fault: WheelFault, part: AidPart, state: AidState, cause: Cause
) -> None:
    recording, truth = recorded(fault)
    assert (part, state, cause) in looks(checked(recording).findings)
    assert error_of(recording, truth)[0] < GOOD


def test_odometry_that_stops_is_replaced_by_the_scans_from_then_on() -> None:
    recording, truth = recorded(stopped)
    found = checked(recording)
    causes = {(part, cause) for part, _, cause in looks(found.findings)}
    assert (AidPart.WHEELS, Cause.STUCK) in causes
    end = (truth.stamps_ns[-1] - truth.stamps_ns[0]) * 1e-9
    way = next(finding for finding in found.findings if finding.cause is Cause.STUCK)
    assert way.since_s is not None
    assert 0.35 * end < way.since_s < 0.7 * end
    assert way.until_s is None
    assert error_of(recording, truth)[0] < GOOD


def sparse(recording: Recording, until_s: float, every: int) -> Recording:
    """The recording with one scan of so many up to a time, and all readings of the wheels."""
    frames, waiting, first = list[SensorFrame](), list[Odometry | WheelTicks](), recording.frames[0].stamp_ns
    for k, frame in enumerate(recording.frames):
        waiting += frame.wheels
        if k % every == 0 or frame.stamp_ns - first > until_s * SECOND:
            frames.append(replace(frame, wheels=tuple(waiting)))
            waiting = []
    return replace(recording, frames=tuple(frames))


def test_between_scans_that_are_too_far_apart_to_be_compared_odometry_with_a_later_fault_is_kept() -> None:
    recording, _ = recorded(from_half(lambda poses: np.broadcast_to(poses[:1], poses.shape)))
    few = sparse(recording, 14.0, 22)
    result = checked(few)
    assert any(found.state is AidState.LEFT_OUT for found in result.findings)
    told, used = (
        [frame.wheels[-1].odom_from_base for frame in each.frames[:6] if isinstance(frame.wheels[-1], Odometry)]
        for each in (few, result.recording)
    )
    assert few.frames[5].stamp_ns - few.frames[0].stamp_ns > 5 * LONGEST_APART_S * SECOND
    assert (told[0].inverse() @ told[5]).x > 1.0
    for before, after in pairwise(range(6)):
        was, now = (track[before].inverse() @ track[after] for track in (told, used))
        assert now.array() == pytest.approx(was.array(), abs=1e-6)


def test_exchanged_wheels_are_told_from_a_hanging_lidar_by_the_gyro() -> None:
    recording, truth = recorded(lambda sound: sound.rolled(turn=-1.0), imu=lambda sound: sound)
    assert looks(checked(recording).findings) == [(AidPart.WHEEL_TURN, AidState.CORRECTED, Cause.OTHER_WAY)]
    assert error_of(recording, truth)[0] < GOOD


def mirrored_headings(sound: Wheels) -> Wheels:
    """Odometry whose positions are right, and whose headings count to the right; its speeds do as well."""
    return replace(sound, poses=sound.poses * (1.0, 1.0, -1.0), speeds=sound.speeds * (1.0, -1.0))


@pytest.mark.parametrize("imu", [None, lambda sound: sound], ids=["alone", "with a gyro"])
def test_headings_against_their_own_positions_are_corrected_and_the_lidar_is_not_blamed(imu: ImuFault | None) -> None:
    recording, truth = recorded(mirrored_headings, imu)
    found = checked(recording)
    assert looks(found.findings) == [(AidPart.WHEEL_TURN, AidState.CORRECTED, Cause.MIRRORED_HEADINGS)]
    assert "the headings turn the other way than its own positions and the scans: corrected" in found.sentences[0]
    assert error_of(recording, truth)[0] < GOOD


def test_a_lidar_upside_down_is_still_told_from_odometry_that_agrees_with_itself() -> None:
    recording, _ = recorded(scan=mirrored)
    assert (AidPart.LIDAR, AidState.CORRECTED, Cause.MIRRORED_OR_WHEELS) in looks(checked(recording).findings)


def test_without_a_gyro_both_causes_of_turns_the_other_way_are_named() -> None:
    recording, _ = recorded(lambda sound: sound.rolled(turn=-1.0))
    (said,) = checked(recording).sentences
    assert "upside down" in said
    assert "wheel are exchanged" in said
    assert "--odom none" in said


def test_speeds_in_another_unit_are_taken_from_the_poses() -> None:
    recording, truth = recorded(lambda sound: replace(sound, speeds=sound.speeds * (1000.0, 1.0)))
    assert looks(checked(recording).findings) == [(AidPart.TWIST, AidState.CORRECTED, Cause.SCALE)]
    assert error_of(recording, truth)[0] < GOOD


def test_wheels_some_per_cent_long_are_noted_and_left_alone_where_scans_measure_the_way() -> None:
    recording, truth = recorded(lambda sound: sound.rolled(way=1.05))
    found = checked(recording)
    assert looks(found.findings) == [(AidPart.SCALES, AidState.NOTED, Cause.SCALES_DIFFER)]
    assert found.findings[0].value == pytest.approx(1.05 * 1.005, abs=0.01)
    assert found.recording is recording
    assert error_of(recording, truth)[0] < GOOD


def test_ranges_some_per_cent_short_are_noted_without_blame() -> None:
    recording, _ = recorded(scan=lambda sound: replace(sound, ranges=(0.97 * sound.ranges).astype(np.float32)))
    (said,) = checked(recording).sentences
    assert re.search(r"the way by wheels is about [34]% longer than by scans, so one of both has a wrong scale", said)


def test_the_scale_is_told_to_some_thousandths_though_swept_scans_see_the_chair_later() -> None:
    """Speeding up, the wheels seem shorter, and longer in slowing down: no scatter of the scale."""
    recording, _ = recorded(scan=lambda sound: replace(sound, ranges=(1.025 * sound.ranges).astype(np.float32)))
    (found,) = checked(recording).findings
    assert found.cause is Cause.SCALES_DIFFER
    assert found.value == pytest.approx(1.005 / 1.025, abs=0.004)
    assert found.sigma < 0.003


def test_readings_that_stay_the_same_for_a_while_are_stood_in_for_by_the_scans() -> None:
    def stuck(sound: Wheels) -> Wheels:
        at = 0.4 * sound.times[-1]
        kept = (sound.times > at) & (sound.times < at + 4.0)
        first = int(np.argmax(kept))
        poses, speeds = sound.poses.copy(), sound.speeds.copy()
        poses[kept], speeds[kept] = poses[first], speeds[first]
        return replace(sound, poses=poses, speeds=speeds)

    recording, truth = recorded(stuck)
    assert (AidPart.WHEELS, AidState.LEFT_OUT, Cause.STUCK) in looks(checked(recording).findings)
    assert error_of(recording, truth)[0] < GOOD


def test_single_speeds_that_no_chair_drives_are_left_out_and_the_poses_kept() -> None:
    def wild(sound: Wheels) -> Wheels:
        speeds = sound.speeds.copy()
        speeds[[100, 250, 251]] = ((1e6, 0.0), (0.0, -40.0), (30.0, 0.0))
        return replace(sound, speeds=speeds)

    recording, truth = recorded(wild)
    (finding,) = checked(recording).findings
    assert (finding.part, finding.state, finding.cause) == (AidPart.TWIST, AidState.LEFT_OUT, Cause.WILD)
    assert finding.count == 3
    assert error_of(recording, truth)[0] < GOOD


@pytest.mark.parametrize(
    "yaw", [0.4, *(pytest.param(yaw, marks=pytest.mark.nightly) for yaw in (math.pi, math.pi / 2))]
)
def test_a_lidar_that_looks_elsewhere_than_told_is_found(yaw: float) -> None:
    recording, truth = recorded(told=Pose2(0.15, 0.0, yaw))
    found = checked(recording)
    assert looks(found.findings) == [(AidPart.LIDAR, AidState.CORRECTED, Cause.MOUNT)]
    assert abs(found.recording.base_from_laser.theta) < 0.05
    assert "--base-from-laser" in found.sentences[0]
    assert error_of(recording, truth)[0] < GOOD


@pytest.mark.parametrize(
    "told",
    [
        Pose2(0.75, 0.0, 0.0),
        *(pytest.param(told, marks=pytest.mark.nightly) for told in (Pose2(-0.45, 0.0, 0.0), Pose2(0.15, 0.5, 0.0))),
    ],
)
def test_a_lidar_elsewhere_than_told_is_found_by_the_turns(told: Pose2) -> None:
    recording, truth = recorded(told=told)
    found = checked(recording)
    assert looks(found.findings) == [(AidPart.LIDAR, AidState.CORRECTED, Cause.MOUNT)]
    lever = found.recording.base_from_laser
    assert math.hypot(lever.x - 0.15, lever.y) < 0.08
    assert "m in turns" in found.sentences[0]
    assert error_of(recording, truth)[0] < 0.08


def test_without_messages_the_scans_stand_in() -> None:
    recording, truth = recorded(mute)
    (finding,) = checked(recording).findings
    assert (finding.part, finding.state, finding.cause) == (AidPart.WHEELS, AidState.LEFT_OUT, Cause.MISSING)
    end = (truth.stamps_ns[-1] - truth.stamps_ns[0]) * 1e-9
    assert finding.since_s == pytest.approx(0.4 * end, abs=1.0)
    assert finding.until_s == pytest.approx(0.4 * end + 5.0, abs=1.0)
    assert error_of(recording, truth)[0] < GOOD


def test_a_first_message_that_is_wild_is_one_message() -> None:
    recording, truth = recorded(first_off)
    found = checked(recording)
    assert looks(found.findings) == [(AidPart.WHEELS, AidState.LEFT_OUT, Cause.WILD)]
    assert "one message at 0.0 s is 100 km off" in found.sentences[0]
    assert error_of(recording, truth)[0] < GOOD


def test_a_drive_in_millimetres_has_no_broken_step_but_its_restart() -> None:
    times = np.arange(0.0, 30.0, 0.1)
    ahead = np.cumsum(np.where((times > 8.0) & (times < 20.0), 0.08, 0.012))  # a slow drive with a quick part
    poses = 1000.0 * np.stack([ahead, 0.0 * times, 0.0 * times], axis=1)
    track = OrderedOdometry(times, poses, np.zeros((300, 2)), np.zeros(300, np.bool_))
    assert repaired(track) == (track, ())
    poses[150:, 0] -= poses[150, 0]
    _, (found,) = repaired(replace(track, poses=poses))
    assert (found.kind, found.begin_s) == (BreakKind.RESTART, pytest.approx(15.0))


def test_a_restart_near_zero_is_named_with_its_distance() -> None:
    times = np.arange(0.0, 10.0, 0.1)
    poses = np.stack([0.5 * times, 0.0 * times, 0.0 * times], axis=1)
    poses[50:, 0] -= poses[50, 0]
    track = OrderedOdometry(times, poses, np.full((100, 2), (0.5, 0.0)), np.zeros(100, np.bool_))
    mended, (found,) = repaired(track)
    assert found.kind is BreakKind.RESTART
    assert found.metres == pytest.approx(2.5, abs=0.06)
    assert found.begin_s == pytest.approx(5.0)
    assert mended.poses[-1, 0] == pytest.approx(0.5 * times[-1], abs=0.02)


def test_jitter_of_stamps_is_no_broken_step() -> None:
    rng = np.random.default_rng(3)
    times = np.sort(np.arange(0.0, 20.0, 0.2) + rng.choice([0.0, 0.19], 100))
    poses = np.stack([0.8 * np.arange(0.0, 20.0, 0.2), np.zeros(100), np.zeros(100)], axis=1)
    track = OrderedOdometry(times, poses, np.zeros((100, 2)), np.zeros(100, np.bool_))
    assert repaired(track) == (track, ())


def test_a_drive_on_the_spot_tells_about_turns_only() -> None:
    spin = ((0.0, math.pi), (0.0, math.pi), (0.0, -math.pi))
    recording, _ = recorded(lambda sound: sound.rolled(turn=2.0), legs=spin)
    assert (AidPart.WHEEL_TURN, AidState.CORRECTED, Cause.SCALE) in looks(checked(recording).findings)


def test_the_live_mapper_takes_a_jump_for_no_motion() -> None:
    recording, truth = recorded(from_half(begin_anew))
    live = LiveMapping(LiveMappingSettings(), recording.base_from_laser)
    for frame in recording.frames:
        live.include(live.reckon(frame))
    result = live.settle()
    assert result.counts["odometry_jumps"] in (1, 2)  # the reading at a scan's stamp lies half way of the jump
    assert truth_errors(result.trajectory, truth).rmse_m < GOOD


def test_stamps_that_begin_anew_are_continued(tmp_path: Path) -> None:
    path = tmp_path / "reset"
    bag = Bag(path)
    for k in range(60):
        stamp = (100 + k % 40) * SECOND // 5 if k != 10 else SECOND  # one odd stamp, and a clock that is set back
        bag.scan(stamp, [1.0 + 0.05 * beam for beam in range(40)], logged_ns=(100 + k) * SECOND // 5)
    bag.close()
    recording = read_recording(path)
    stamps = [frame.stamp_ns for frame in recording.frames]
    assert stamps[40:] == [(100 + k) * SECOND // 5 for k in range(40, 60)]
    assert stamps[10] == 110 * SECOND // 5  # the odd one, by its time of recording
    assert sum("set back by 8.0 s" in warning for warning in recording.warnings) == 1


def test_odometry_and_imu_are_left_out_on_wish(tmp_path: Path) -> None:
    path = tmp_path / "drive"
    bag = Bag(path)
    for k in range(20):
        stamp = (100 + k) * SECOND // 5
        bag.odometry(stamp, 0.01 * k)
        bag.imu(stamp, (0.0, 0.0, 0.0), (0.0, 0.0, 9.81), frame="base_link")
        bag.scan(stamp, [1.0 + 0.05 * beam for beam in range(40)])
    bag.close()
    both = read_recording(path)
    assert all(frame.wheels and frame.imu for frame in both.frames)
    alone = read_recording(path, RecordingOptions(odom="none", imu="none").over(InputSettings()))
    assert len(alone.frames) == 20
    assert not any(frame.wheels or frame.imu for frame in alone.frames)
    assert not any("scan matching alone" in warning for warning in alone.warnings)
