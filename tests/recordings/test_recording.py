"""Reading recordings: real logs, recognition of formats by content, and trajectories as TUM text."""

from __future__ import annotations

import gzip
import math
import shutil
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.errors import NoScans, RecordingDamaged, RecordingError, RecordingNotFound, WaychairError
from waychair.geometry import wrap_angles
from waychair.recordings.recording import Recording, read_recording, read_tum, write_tum
from waychair.types import Odometry, Pose2, Trajectory

SENA_MOUNT = Pose2(0.78, 0.0, 0.0)


def stamps_ns(recording: Recording) -> list[int]:
    return [frame.stamp_ns for frame in recording.frames]


def odometry(recording: Recording) -> np.ndarray:
    """(N, 3) the one odometry reading of each frame."""
    poses = []
    for frame in recording.frames:
        (reading,) = frame.wheels
        assert isinstance(reading, Odometry)
        poses.append(reading.odom_from_base.array())
    return np.array(poses)


def test_the_intel_log_is_read_completely_in_file_order_with_exact_stamps(data_dir: Path) -> None:
    folder = data_dir / "lidar_intel"
    recording = read_recording(folder / "intel_first1088s.clf.gz")
    stamps = stamps_ns(recording)
    assert len(stamps) == 5505
    assert int((np.diff(stamps) < 0).sum()) == 265
    assert recording.warnings == ("stamps step backwards 265 times: the scans are kept in the order of the file",)
    assert recording.base_from_laser == Pose2()
    known = set(stamps)
    with gzip.open(folder / "intel_first1088s.relations.gz", "rt") as file:
        named = [Decimal(text) for line in file for text in line.split()[:2]]
    assert len(named) == 2 * 1030
    assert all(int(stamp * 10**9) in known for stamp in named)


def test_the_intel_odometry_is_that_of_the_log(data_dir: Path) -> None:
    poses = odometry(read_recording(data_dir / "lidar_intel" / "intel_first1088s.clf.gz"))
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    assert steps.sum() == pytest.approx(204.0, abs=1.0)
    assert poses[0].tolist() == [0.0, 0.0, -0.002458]


def test_the_wheelchair_log_gives_base_poses_once_the_mount_is_known(data_dir: Path) -> None:
    path = data_dir / "wheelchair_sena" / "sena_one_loop.clf.gz"
    of_laser, of_base = read_recording(path), read_recording(path, base_from_laser=SENA_MOUNT)
    assert len(of_base.frames) == 225
    assert of_base.base_from_laser == SENA_MOUNT
    lasers, bases = odometry(of_laser), odometry(of_base)
    expected = np.array([(Pose2(*pose) @ SENA_MOUNT).array() for pose in bases])
    np.testing.assert_allclose(lasers[:, :2], expected[:, :2], atol=2e-6)
    assert np.hypot(*np.diff(bases[:, :2], axis=0).T).sum() == pytest.approx(76.4, abs=0.2)
    turned = wrap_angles(np.diff(bases[:, 2])).sum()
    assert math.degrees(turned) == pytest.approx(-466.7, abs=0.5)


def test_the_freiburg_log_has_half_degree_beams_and_infinite_no_returns(data_dir: Path) -> None:
    recording = read_recording(data_dir / "lidar_fr079" / "fr079_laser.clf.gz")
    scans = [frame.scan for frame in recording.frames if frame.scan is not None]
    assert len(scans) == 4791
    assert recording.warnings == ()
    assert {len(scan.ranges) for scan in scans} == {360}
    ranges = np.concatenate([scan.ranges for scan in scans])
    assert np.isinf(ranges).any()
    assert ranges[np.isfinite(ranges)].max() < 80.0


def test_the_format_is_recognised_by_the_content_and_not_by_the_name(data_dir: Path, tmp_path: Path) -> None:
    shutil.copy(data_dir / "wheelchair_sena" / "sena_one_loop.clf.gz", tmp_path / "log.bag")
    assert len(read_recording(tmp_path / "log.bag").frames) == 225
    shutil.copy(data_dir / "ros_bags" / "nav2_turtlebot.mcap", tmp_path / "bag.log")
    with pytest.raises(NoScans, match="/amcl_pose"):
        read_recording(tmp_path / "bag.log")


@pytest.mark.parametrize(
    ("name", "topics"),
    [
        (
            "husky_imu_odom_gps.bag",
            ["/fix (sensor_msgs/msg/NavSatFix)", "/husky_velocity_controller/odom", "/imu/data"],
        ),
        ("nav2_turtlebot.mcap", ["/odom (nav_msgs/msg/Odometry)", "/tf_static", "/amcl_pose", "/tf "]),
    ],
)
def test_an_error_about_a_bag_without_a_laser_lists_its_topics(data_dir: Path, name: str, topics: list[str]) -> None:
    with pytest.raises(NoScans) as caught:
        read_recording(data_dir / "ros_bags" / name)
    assert all(topic in str(caught.value) for topic in topics)


def test_the_corrected_logs_have_the_documented_number_of_scans(data_dir: Path) -> None:
    folder = data_dir / "lidar_radish_corrected"
    counts = {"aces": 440, "freiburg-101": 292, "seattle": 241}
    for name, count in counts.items():
        assert len(read_recording(folder / f"{name}-corrected.log.gz").frames) == count


def test_graph_logs_with_robotlaser_lines_are_read(data_dir: Path) -> None:
    recording = read_recording(data_dir / "lidar_fr079" / "fr079_keyframes_flirt.log.gz")
    assert len(recording.frames) == 1464
    assert "ROBOTLASER1" in recording.source


def test_a_missing_path_an_empty_file_and_an_unknown_format_have_their_own_errors(tmp_path: Path) -> None:
    with pytest.raises(RecordingNotFound, match="no recording at"):
        read_recording(tmp_path / "nothing.clf")
    (tmp_path / "empty.clf").touch()
    with pytest.raises(RecordingDamaged, match="is empty"):
        read_recording(tmp_path / "empty.clf")
    with pytest.raises(RecordingDamaged, match=r"no metadata\.yaml"):
        read_recording(tmp_path)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from([b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0", b"\x1f\x8b\x08"]), st.binary())
def test_random_bytes_after_any_magic_number_give_one_sentence(
    tmp_path_factory: pytest.TempPathFactory, magic: bytes, noise: bytes
) -> None:
    path = tmp_path_factory.mktemp("noise") / "recording"
    path.write_bytes(magic + noise)
    with pytest.raises(RecordingError) as caught:
        read_recording(path)
    assert "\n" not in str(caught.value)


def test_a_trajectory_survives_tum_text_in_order(tmp_path: Path) -> None:
    stamps = np.array([976052905_167303000, 976052904_000000000, -445_999_000, 1_000_000_001], dtype=np.int64)
    poses = np.array([[1.0, -2.0, 3.0], [0.1, 0.2, -3.1415], [1e-7, 0.0, 0.0], [123.456789, 5.0, math.pi]])
    write_tum(tmp_path / "t.tum", Trajectory(stamps, poses))
    lines = (tmp_path / "t.tum").read_text().splitlines()
    assert [line.split()[0] for line in lines] == ["976052905.167303", "976052904.000000", "-0.445999", "1.000000001"]
    assert all(len(line.split()) == 8 for line in lines)
    back = read_tum(tmp_path / "t.tum")
    np.testing.assert_array_equal(back.stamps_ns, stamps)
    np.testing.assert_allclose(back.poses, poses, atol=1e-8)


@given(st.lists(st.tuples(st.integers(-(2**62), 2**62), st.floats(-1e6, 1e6), st.floats(-3.14, 3.14)), max_size=20))
@settings(deadline=None)
def test_every_stamp_survives_tum_text(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[int, float, float]]
) -> None:
    path = tmp_path_factory.mktemp("tum") / "t.tum"
    stamps = np.array([row[0] for row in rows], dtype=np.int64)
    poses = np.array([(x, -x, theta) for _, x, theta in rows]).reshape(-1, 3)
    write_tum(path, Trajectory(stamps, poses))
    back = read_tum(path) if rows else Trajectory(stamps, poses)
    np.testing.assert_array_equal(back.stamps_ns, stamps)
    np.testing.assert_allclose(back.poses, poses, atol=1e-8)


def test_a_pose_in_space_is_read_as_its_planar_part(tmp_path: Path) -> None:
    (tmp_path / "t.tum").write_text("# stamp x y z qx qy qz qw\n\n1.5 1 2 3 0 0 1.4142135 1.4142135\n")
    back = read_tum(tmp_path / "t.tum")
    np.testing.assert_allclose(back.poses, [[1.0, 2.0, math.pi / 2]])


@pytest.mark.parametrize(
    "line", ["1 2 3", "1 0 0 0 0 0 0 0", "x 0 0 0 0 0 0 1", "1 0 0 0 0 0 0 nan", "1 0 0 0 0 0 0 1 9"]
)
def test_an_invalid_tum_line_is_named_by_its_number(tmp_path: Path, line: str) -> None:
    (tmp_path / "t.tum").write_text("1 0 0 0 0 0 0 1\n" + line + "\n")
    with pytest.raises(RecordingDamaged, match="line 2"):
        read_tum(tmp_path / "t.tum")


def test_a_missing_tum_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(WaychairError, match="no recording"):
        read_tum(tmp_path / "t.tum")
