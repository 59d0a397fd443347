"""ROS bags in and out: round trips, odometry at the scans' stamps, mounts from /tf_static, and damage."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.bags import SECOND, Bag
from waychair.errors import NoScans, OutputError, RecordingDamaged, RecordingError
from waychair.recordings.bags.bag_settings import BagSettings
from waychair.recordings.bags.rosbag_writer import RecordingWriter
from waychair.recordings.recording import InputSettings, Recording, read_recording
from waychair.types import Odometry, Pose2, Scan, Twist

START_NS = 1_700_000_000 * SECOND
MOUNT = Pose2(0.6, -0.1, 0.25)


def scan_at(stamp_ns: int, beams: int = 90) -> Scan:
    rng = np.random.default_rng(stamp_ns % 1000)
    ranges = rng.uniform(0.2, 9.0, beams).astype(np.float32)
    ranges[:3] = [np.inf, -np.inf, np.nan]
    return Scan(stamp_ns, ranges, -1.5, 3.0 / beams, 1e-4, 0.05, 12.0)


def odometry_at(stamp_ns: int) -> Odometry:
    t = (stamp_ns - START_NS) / SECOND
    covariance = np.diag([0.01, 0.02, 0.03]) + 0.001
    return Odometry(stamp_ns, Pose2(0.5 * t, -0.1 * t, 0.2 * t), Twist(0.5, 0.2), covariance)


def write_drive(path: Path, scans: int = 10, **options: Any) -> list[Scan]:
    """10 scans a second, odometry at each and once between."""
    written = [scan_at(START_NS + k * SECOND // 10) for k in range(scans)]
    with RecordingWriter(path, MOUNT, **options) as writer:
        for scan in written:
            writer.write(odometry_at(scan.stamp_ns - SECOND // 20))
            writer.write(odometry_at(scan.stamp_ns))
            writer.write(scan)
    return written


def scans(*topics: str) -> InputSettings:
    """Settings that ask for these scan topics."""
    return InputSettings(bag=BagSettings(scan_topics=topics))


def made(path: Path, fill: Callable[[Bag], None], ros: int = 2) -> Recording:
    bag = Bag(path, ros)
    fill(bag)
    bag.close()
    return read_recording(path)


@pytest.mark.parametrize(
    ("name", "options", "files"),
    [
        ("drive.mcap", {}, {"drive.mcap"}),
        ("drive.db3", {}, {"drive.db3"}),
        ("drive", {}, {"drive", "drive/drive.mcap", "drive/metadata.yaml"}),
        ("drive", {"storage": "sqlite3"}, {"drive", "drive/drive.db3", "drive/metadata.yaml"}),
    ],
)
def test_a_written_bag_is_read_back_unchanged(
    tmp_path: Path, name: str, options: dict[str, Any], files: set[str]
) -> None:
    written = write_drive(tmp_path / name, **options)
    assert {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*")} == files
    recording = read_recording(tmp_path / name)
    assert recording.warnings == ()
    np.testing.assert_allclose(recording.base_from_laser.array(), MOUNT.array(), atol=1e-12)
    assert len(recording.frames) == len(written)
    for frame, scan in zip(recording.frames, written, strict=True):
        assert frame.scan is not None
        assert frame.stamp_ns == frame.scan.stamp_ns == scan.stamp_ns
        np.testing.assert_array_equal(frame.scan.ranges, scan.ranges)
        np.testing.assert_allclose(frame.scan.angles(), scan.angles(), atol=1e-5)
        assert (frame.scan.range_min, frame.scan.range_max) == (pytest.approx(0.05), 12.0)
        assert [reading.stamp_ns for reading in frame.wheels] == [scan.stamp_ns - SECOND // 20, scan.stamp_ns]
        for reading in frame.wheels:
            assert isinstance(reading, Odometry)
            expected = odometry_at(reading.stamp_ns)
            np.testing.assert_allclose(reading.odom_from_base.array(), expected.odom_from_base.array(), atol=1e-12)
            assert reading.twist == expected.twist
            assert reading.covariance is not None
            np.testing.assert_array_equal(reading.covariance, expected.covariance)


def test_an_existing_recording_is_never_overwritten(tmp_path: Path) -> None:
    (tmp_path / "drive.mcap").write_text("precious")
    with pytest.raises(OutputError, match="exists already; remove it or choose another name"):
        write_drive(tmp_path / "drive.mcap")
    assert (tmp_path / "drive.mcap").read_text() == "precious"


def test_a_failed_recording_leaves_no_file(tmp_path: Path) -> None:
    def fails_halfway() -> None:
        with RecordingWriter(tmp_path / "drive", MOUNT) as writer:
            writer.write(scan_at(START_NS))
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fails_halfway()
    assert list(tmp_path.iterdir()) == []


def test_an_empty_recording_is_refused_and_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="nothing was written"), RecordingWriter(tmp_path / "drive.db3", MOUNT):
        pass
    assert list(tmp_path.iterdir()) == []


def test_an_impossible_path_is_an_output_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot write"):
        write_drive(tmp_path / "file" / "drive.mcap")
    with pytest.raises(OutputError, match=r"ends in \.db3 but mcap"):
        RecordingWriter(tmp_path / "drive.db3", MOUNT, storage="mcap")


@pytest.mark.parametrize("stamp_ns", [-1, (1 << 31) * SECOND])
def test_a_stamp_that_ros_cannot_express_is_refused(tmp_path: Path, stamp_ns: int) -> None:
    with (
        pytest.raises(RecordingError, match="cannot be expressed"),
        RecordingWriter(tmp_path / "drive.mcap", MOUNT) as writer,
    ):
        writer.write(scan_at(stamp_ns))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("ros", "name"), [(1, "drive.bag"), (2, "drive")])
def test_odometry_is_interpolated_at_the_scan_and_kept_since_the_last_one(tmp_path: Path, ros: int, name: str) -> None:
    def fill(bag: Bag) -> None:
        for k in range(6):
            bag.odometry(k * SECOND, float(k), math.pi - 0.1 + 0.1 * k)
        bag.scan(SECOND // 2, [1.0, 2.0])
        bag.scan(3 * SECOND + SECOND // 4, [1.0, 2.0])
        bag.scan(4 * SECOND, [1.0, 2.0])

    recording = made(tmp_path / name, fill, ros)
    assert recording.source == f"ROS {ros} bag, scans /scan, odometry /odom"
    wheels = [[(w.stamp_ns, w.odom_from_base.x) for w in f.wheels if isinstance(w, Odometry)] for f in recording.frames]
    assert wheels == [
        [(0, 0.0), (SECOND // 2, 0.5)],
        [(SECOND, 1.0), (2 * SECOND, 2.0), (3 * SECOND, 3.0), (3 * SECOND + SECOND // 4, 3.25)],
        [(4 * SECOND, 4.0)],
    ]
    second = recording.frames[1].wheels[-1]
    assert isinstance(second, Odometry)
    assert second.odom_from_base.theta == pytest.approx(-math.pi + 0.225)
    assert (second.twist.v, second.covariance) == (pytest.approx(3.25), None)


def test_scans_outside_the_odometry_are_left_out_with_a_warning(tmp_path: Path) -> None:
    def fill(bag: Bag) -> None:
        for second in (5, 8):
            bag.odometry(second * SECOND, 1.0)
        for second in (4, 6, 9):
            bag.scan(second * SECOND, [1.0, 2.0])

    recording = made(tmp_path / "drive", fill)
    assert [frame.stamp_ns for frame in recording.frames] == [6 * SECOND]
    assert any(warning.startswith("2 scans before the first") for warning in recording.warnings)


@pytest.mark.parametrize("late_s", [None, 1000])
def test_a_bag_without_odometry_at_its_scans_gives_frames_without_wheels(tmp_path: Path, late_s: int | None) -> None:
    def fill(bag: Bag) -> None:
        bag.scan(SECOND, [1.0, 2.0])
        if late_s is not None:
            bag.odometry(late_s * SECOND, 1.0)

    recording = made(tmp_path / "drive", fill)
    assert [frame.wheels for frame in recording.frames] == [()]
    assert any("scan matching alone" in warning for warning in recording.warnings)


def test_the_topic_can_be_chosen_and_an_automatic_choice_is_named(tmp_path: Path) -> None:
    def fill(bag: Bag) -> None:
        for k in range(3):
            bag.odometry(k * SECOND, 1.0, topic="/wheels/odom")
            bag.scan(k * SECOND, [1.0, 2.0], "/front/scan")
        bag.scan(SECOND, [7.0, 8.0], "/rear/scan")

    recording = made(tmp_path / "drive", fill)
    assert recording.source == "ROS 2 bag, scans /front/scan, odometry /wheels/odom"
    assert any("there are also /rear/scan" in warning for warning in recording.warnings)
    (rear,) = read_recording(tmp_path / "drive", scans("rear/scan")).frames
    assert rear.scan is not None
    assert rear.scan.ranges.tolist() == [7.0, 8.0]
    with pytest.raises(NoScans, match=r"on /scan, only .*/front/scan.*; choose another scan topic"):
        read_recording(tmp_path / "drive", scans("/scan"))
    with pytest.raises(RecordingError, match=r"on /odom, only .*/wheels/odom"):
        read_recording(tmp_path / "drive", InputSettings(bag=BagSettings(odom_topic="/odom")))


def test_the_mount_is_chained_through_static_transforms_in_both_directions(tmp_path: Path) -> None:
    quarter = (0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4))

    def fill(bag: Bag) -> None:
        bag.mount(0, ("base_footprint", "base_link", (0.0, 0.0, 0.1), (0.0, 0.0, 0.0, 1.0)))
        bag.mount(
            0,
            ("base_footprint", "mast", (0.5, 1.0, 0.5), quarter),
            ("mast", "/laser", (0.5, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
        )
        bag.odometry(0, 0.0)
        bag.scan(0, [1.0, 2.0])

    recording = made(tmp_path / "drive", fill)
    assert recording.warnings == ()
    np.testing.assert_allclose(recording.base_from_laser.array(), [0.5, 1.5, math.pi / 2], atol=1e-12)
    given = read_recording(tmp_path / "drive", base_from_laser=Pose2(9.0, 0.0, 0.0))
    assert given.base_from_laser == Pose2(9.0, 0.0, 0.0)


def test_a_mount_farther_away_than_a_chair_is_large_is_refused_by_its_topic_and_frame(tmp_path: Path) -> None:
    def fill(bag: Bag) -> None:
        bag.mount(0, ("base_link", "laser", (350.0, 0.0, 0.5), (0.0, 0.0, 0.0, 1.0)))
        bag.odometry(0, 0.0)
        bag.scan(0, [1.0, 2.0])

    with pytest.raises(RecordingError, match=r"/tf_static: the mount of the laser 'laser' is 350 m from base_link"):
        made(tmp_path / "drive", fill)


def test_a_topic_that_only_the_metadata_tells_of_does_not_hide_the_scans(tmp_path: Path) -> None:
    def fill(bag: Bag) -> None:
        bag.scan(0, [1.0, 2.0])

    made(tmp_path / "drive", fill)
    meta = tmp_path / "drive" / "metadata.yaml"
    meta.write_text(meta.read_text().replace("name: /scan", "name: /lidar"))
    recording = read_recording(tmp_path / "drive")
    assert len(recording.frames) == 1
    assert "metadata.yaml tells of 1 messages on /lidar, of which the file holds none" in recording.warnings[0]


def test_an_unknown_mount_is_the_identity_with_a_warning(tmp_path: Path) -> None:
    def fill(bag: Bag) -> None:
        bag.odometry(0, 0.0)
        bag.scan(0, [1.0, 2.0])

    recording = made(tmp_path / "drive", fill)
    assert recording.base_from_laser == Pose2()
    assert any("give its mount with --base-from-laser" in warning for warning in recording.warnings)


def test_clockwise_beams_are_reordered_with_their_own_times(tmp_path: Path) -> None:
    def fill(bag: Bag) -> None:
        bag.scan(SECOND, [1.0, 2.0, 3.0], step=-0.1)

    (frame,) = made(tmp_path / "drive", fill).frames
    scan = frame.scan
    assert scan is not None
    assert scan.ranges.tolist() == [3.0, 2.0, 1.0]
    np.testing.assert_allclose(scan.angles(), [0.3, 0.4, 0.5], atol=1e-6)
    first_measured = scan.stamp_ns + round(2 * scan.time_step * 1e9)
    assert first_measured == SECOND


def test_scans_of_a_laser_mounted_upside_down_are_corrected(tmp_path: Path) -> None:
    def fill(bag: Bag) -> None:
        bag.mount(0, ("base_link", "laser", (0.3, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0)))  # half a turn about x
        bag.odometry(0, 0.0)
        bag.scan(0, [1.0, 2.0, 3.0])
        bag.odometry(SECOND, 0.0)

    recording = made(tmp_path / "drive", fill)
    scan = recording.frames[0].scan
    assert scan is not None
    assert recording.base_from_laser.array().tolist() == pytest.approx([0.3, 0.0, 0.0])
    assert dict(zip(np.round(scan.angles(), 3).tolist(), scan.ranges.tolist(), strict=True)) == {
        -0.5: 1.0,
        -0.6: 2.0,
        -0.7: 3.0,
    }


def test_scans_without_beams_are_left_out_and_a_bag_of_them_has_no_scans(tmp_path: Path) -> None:
    def fill(bag: Bag) -> None:
        bag.scan(0, [])
        bag.scan(SECOND, [1.0, 2.0])

    recording = made(tmp_path / "drive", fill)
    assert len(recording.frames) == 1
    assert any("scans with fewer than 2" in warning and "once" in warning for warning in recording.warnings)
    with pytest.raises(NoScans, match="no usable scan"):
        made(tmp_path / "empty", lambda bag: bag.scan(0, []))


def test_a_bag_folder_without_its_storage_is_damaged(tmp_path: Path) -> None:
    write_drive(tmp_path / "drive")
    (tmp_path / "drive" / "drive.mcap").unlink()
    with pytest.raises(RecordingDamaged, match="is a damaged bag"):
        read_recording(tmp_path / "drive")


def test_a_message_that_cannot_be_decoded_is_left_out_and_counted(tmp_path: Path) -> None:
    def fill(bag: Bag) -> None:
        for k in range(30):
            bag.odometry(k * SECOND, 1.0)
            bag.scan(k * SECOND, [1.0, 2.0, 3.0])

    made(tmp_path / "drive.bag", fill, ros=1)
    data = (tmp_path / "drive.bag").read_bytes()
    at = data.index(b"laser", data.index(b"laser", len(data) // 2) + 8) - 5  # the length of a scan's frame name
    (tmp_path / "drive.bag").write_bytes(data[:at] + b"\xff\xff\xff\x7f" + data[at + 4 :])
    recording = read_recording(tmp_path / "drive.bag")
    assert len(recording.frames) == 29
    assert "only the 29 scans that can be read are used, without 1 damaged messages" in recording.warnings[0]


def test_an_error_of_the_progress_callback_reaches_the_caller(tmp_path: Path) -> None:
    def stop(_: float) -> None:
        raise KeyError("stop")

    write_drive(tmp_path / "drive.mcap")
    with pytest.raises(KeyError, match="stop"):
        read_recording(tmp_path / "drive.mcap", progress=stop)
