"""Frames hold the messages of one time and all readings in between; late topics are named."""

from __future__ import annotations

from itertools import pairwise
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.fits.time_offset import SensorDelays
from waychair.errors import ConfigError
from waychair.slam.frames.frame_synchroniser import QUEUE, Synchroniser, SynchroniserSettings, frames_with_delays
from waychair.topics import CAMERA, IMU, MAP, ODOMETRY, SCAN, SONAR, WHEELS, Topic
from waychair.types import ImuSample, Odometry, Pose2, RgbdFrame, Scan, SensorFrame, Twist, WheelTicks

MS = 1_000_000
SECOND = 1000 * MS


def scan(ms: int) -> Scan:
    """A scan with two beams."""
    return Scan(ms * MS, np.ones(2, np.float32), 0.0, 0.1)


def picture(ms: int) -> RgbdFrame:
    """One pixel."""
    return RgbdFrame(ms * MS, np.zeros((1, 1), np.uint8), np.ones((1, 1), np.float32), np.eye(3))


def sample(ms: int) -> ImuSample:
    """At rest."""
    return ImuSample(ms * MS, np.zeros(3), np.zeros(3))


def ticks(ms: int, per_ms: int = 10) -> WheelTicks:
    """Counts of a chair at constant speed."""
    return WheelTicks(ms * MS, per_ms * ms, per_ms * ms + 7)


def drive(synchroniser: Synchroniser, until_ms: int) -> list[SensorFrame]:
    """Scans every 100 ms, wheels every 20, IMU every 5, in order of time."""
    frames: list[SensorFrame] = []
    for ms in range(0, until_ms, 5):
        frames += synchroniser.add(IMU, sample(ms))
        if ms % 20 == 10:
            frames += synchroniser.add(WHEELS, ticks(ms))
        if ms % 100 == 0:
            frames += synchroniser.add(SCAN, scan(ms))
    return frames


def test_a_frame_holds_all_wheel_and_imu_readings_since_the_last_one_and_a_wheel_reading_at_its_stamp() -> None:
    frames = drive(Synchroniser((SCAN, WHEELS, IMU)), 1000)
    assert [frame.stamp_ns // MS for frame in frames] == list(range(0, 1000, 100))
    assert [reading.stamp_ns // MS for reading in frames[3].wheels] == [210, 230, 250, 270, 290, 300]
    assert frames[3].wheels[-1] == ticks(300)
    assert [reading.stamp_ns // MS for reading in frames[3].imu] == list(range(205, 305, 5))


@given(
    moments=st.lists(
        st.tuples(st.sampled_from(["scan", "wheels", "imu"]), st.integers(0, 60)), max_size=60, unique=True
    ),
    wait=st.sampled_from([0.0, 0.02, 10.0]),
)
def test_no_reading_is_lost_or_twice_in_frames_and_order_is_kept(moments: list[tuple[str, int]], wait: float) -> None:
    synchroniser = Synchroniser((SCAN, WHEELS, IMU), SynchroniserSettings(wait_s=wait))
    frames: list[SensorFrame] = []
    with patch("waychair.slam.frames.frame_synchroniser._interpolated", return_value=[]):
        for kind, ms in moments:
            if kind == "scan":
                frames += synchroniser.add(SCAN, scan(ms))
            elif kind == "wheels":
                frames += synchroniser.add(WHEELS, ticks(ms))
            else:
                frames += synchroniser.add(IMU, sample(ms))
        frames += synchroniser.flush()
    assert all(before.stamp_ns < after.stamp_ns for before, after in pairwise(frames))
    for field, name in (("wheels", WHEELS.name), ("imu", IMU.name)):
        stamps = [reading.stamp_ns for frame in frames for reading in getattr(frame, field)]
        assert all(a < b for a, b in pairwise(stamps))
        status = next(each for each in synchroniser.diagnostics(0) if each.name == name)
        sent = {ms * MS for kind, ms in moments if kind == field}
        assert set(stamps) <= sent
        # A reading missing up to the last frame came after its own frame was returned.
        missing = len([stamp for stamp in sent if frames and stamp <= frames[-1].stamp_ns]) - len(stamps)
        assert missing == status.counts.late
        assert status.counts.repeated == 0
        assert status.counts.used == len(stamps)


def test_a_frame_of_picture_and_scan_has_the_closest_pair() -> None:
    synchroniser = Synchroniser((SCAN, CAMERA))
    frames: list[SensorFrame] = []
    events = [(ms, SCAN) for ms in range(0, 2000, 100)] + [(round(ms), CAMERA) for ms in np.arange(7, 2000, 1000 / 15)]
    for ms, topic in sorted(events, key=lambda event: event[0]):
        frames += synchroniser.add(topic, scan(ms) if topic is SCAN else picture(ms))
    pictures = [ms for ms, topic in events if topic is CAMERA]
    assert len(frames) >= 18
    for frame in frames:
        assert frame.scan is not None
        assert frame.rgbd is not None
        nearest = min(abs(ms * MS - frame.scan.stamp_ns) for ms in pictures)
        assert abs(frame.rgbd.stamp_ns - frame.scan.stamp_ns) == nearest


def test_memory_is_bounded_when_one_sensor_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("waychair.slam.frames.frame_synchroniser.STREAM_QUEUE", 50)
    synchroniser = Synchroniser((SCAN, CAMERA, IMU, WHEELS))
    for ms in range(0, 60_000, 5):
        assert not synchroniser.add(IMU, sample(ms))
        if ms % 100 == 0:
            assert not synchroniser.add(SCAN, scan(ms))  # no picture, no frame
    counts = {status.name: status.counts for status in synchroniser.diagnostics(60 * SECOND)}
    assert counts[IMU.name].dropped == 12_000 - 50
    assert counts[SCAN.name].dropped == 600 - QUEUE


def test_frames_do_not_wait_for_dead_wheels_and_are_counted() -> None:
    synchroniser = Synchroniser((SCAN, WHEELS))
    frames = [frame for ms in range(0, 2000, 100) for frame in synchroniser.add(SCAN, scan(ms))]
    assert len(frames) >= 17
    assert synchroniser.incomplete == len(frames)
    assert all(frame.wheels == () for frame in frames)


def test_a_late_topic_is_named_with_its_delay_and_a_remedy() -> None:
    synchroniser = Synchroniser((SCAN, ODOMETRY, IMU, SONAR))
    for ms in range(0, 5000, 5):
        synchroniser.add(IMU, sample(ms))
        if ms % 100 == 0:
            synchroniser.add(SCAN, scan(ms))
        if ms % 20 == 0:
            synchroniser.add(ODOMETRY, Odometry((ms - 800) * MS, Pose2()))
    complaints = {status.name: status.complaint for status in synchroniser.diagnostics(5 * SECOND)}
    assert complaints[ODOMETRY.name] == "/odom is 0.8 s behind /imu/data: check its clock or its node"
    assert complaints[SONAR.name] == "no message on /sonar: start its node or check the topic's name"
    assert complaints[SCAN.name] == complaints[IMU.name] == ""


def test_silent_slow_and_future_topics_are_named() -> None:
    synchroniser = Synchroniser((SCAN, IMU))
    for ms in range(0, 4000, 200):
        synchroniser.add(SCAN, scan(ms))
        synchroniser.add(IMU, sample(ms))
    slow, _ = synchroniser.diagnostics(3900 * MS)
    assert slow.rate_hz == pytest.approx(5.0)
    assert slow.complaint == "/scan has 5.0 Hz instead of 10 Hz: check the load and the link"
    assert synchroniser.diagnostics(9 * SECOND)[0].complaint.startswith("/scan has been silent for 5.2 s")
    assert synchroniser.diagnostics(-SECOND)[0].complaint.startswith("/scan is 4.8 s ahead of this computer")


def test_a_clock_that_goes_back_starts_a_new_stretch() -> None:
    synchroniser = Synchroniser((SCAN, WHEELS, IMU))
    assert len(drive(synchroniser, 30_000)) == 300
    again = drive(synchroniser, 1000)
    assert synchroniser.resets == 1
    assert [frame.stamp_ns // MS for frame in again] == list(range(0, 1000, 100))


def test_counts_that_wrap_are_interpolated_the_short_way() -> None:
    synchroniser = Synchroniser((SCAN, WHEELS))
    edge = 2**31
    synchroniser.add(WHEELS, WheelTicks(0, edge - 10, -edge + 10))
    synchroniser.add(SCAN, scan(5))
    (frame,) = synchroniser.add(WHEELS, WheelTicks(10 * MS, -edge + 10, edge - 10))
    at = frame.wheels[-1]
    assert isinstance(at, WheelTicks)
    assert (at.stamp_ns, at.left % 2**32, at.right % 2**32) == (5 * MS, edge, edge)


@pytest.mark.parametrize(
    ("topics", "words"),
    [
        ((WHEELS, IMU), "add one of these"),
        ((SCAN, MAP), "which frames do not hold"),
        ((SCAN, WHEELS, ODOMETRY), "both give a frame's wheels"),
        ((SCAN, Topic("scan_rear", Scan, 10.0)), "both give a frame's scan"),
    ],
)
def test_topics_that_give_no_frames_are_refused(topics: tuple[Topic, ...], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        Synchroniser(topics)


def test_an_undeclared_topic_is_refused() -> None:
    with pytest.raises(ConfigError, match="unknown topic 'imu/data'"):
        Synchroniser((SCAN,)).add(IMU, sample(0))


def test_known_delays_are_removed_from_the_frames_of_a_recording() -> None:
    """A chair that turns at a varying rate: after correction, each scan has the heading of its true time."""
    late = SensorDelays(lidar_ns=70 * MS, wheels_ns=20 * MS)

    def heading(ns: int) -> float:
        return 0.5 * (ns * 1e-9) ** 2

    frames = []
    for ms in range(100, 3000, 100):
        true = ms * MS
        wheels = [
            Odometry(ns + late.wheels_ns, Pose2(0.0, 0.0, heading(ns)), Twist())
            for ns in range(true - 100 * MS, true + 60 * MS, 10 * MS)
        ]
        frames.append(
            SensorFrame(
                true + late.lidar_ns, Scan(true + late.lidar_ns, np.ones(2, np.float32), 0.0, 0.1), wheels=tuple(wheels)
            )
        )
    mended = frames_with_delays(frames, late)
    assert [frame.stamp_ns // MS for frame in mended] == list(range(100, 3000, 100))
    for frame in mended:
        last = frame.wheels[-1]
        assert isinstance(last, Odometry)
        assert last.stamp_ns == frame.stamp_ns
        assert last.odom_from_base.theta == pytest.approx(heading(frame.stamp_ns), abs=1e-4)
    stamps = [reading.stamp_ns for frame in mended for reading in frame.wheels]
    assert all(a < b for a, b in pairwise(stamps))
    assert frames_with_delays(frames, SensorDelays()) == tuple(frames)


def test_waiting_frames_are_returned_first_when_the_clock_goes_back() -> None:
    synchroniser = Synchroniser((SCAN, WHEELS))
    synchroniser.add(WHEELS, ticks(9000))
    assert not synchroniser.add(SCAN, scan(9050))
    frames = synchroniser.add(SCAN, scan(100))
    assert [frame.stamp_ns // MS for frame in frames] == [9050]
