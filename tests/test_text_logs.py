"""CoreSLAM logs and rows of scans: real and damaged ones."""

from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from waychair.errors import NoScans, RecordingDamaged
from waychair.recordings.recording import InputSettings, read_recording
from waychair.recordings.text import coreslam
from waychair.slam.scan.reference_surfaces import reference_from_points
from waychair.slam.scan.scan_matching import BEAM_SIGMA, MatchSettings, Window, match
from waychair.slam.scan.scan_points import scan_points
from waychair.types import FloatArray, Odometry, Pose2, SensorFrame


def coreslam_line(micros: int, left: int, right: int, ranges: int = 1500) -> str:
    return " ".join(map(str, [micros, 1, left, right, *[0] * 20, *[ranges] * 683]))


@pytest.mark.parametrize(("name", "scans", "seconds"), [("exp1", 756, 74.6), ("exp2", 641, 63.2)])
def test_the_real_coreslam_logs_are_read_completely(data_dir: Path, name: str, scans: int, seconds: float) -> None:
    recording = read_recording(data_dir / "lidar_coreslam" / f"{name}.dat.gz")
    assert len(recording.frames) == scans
    assert recording.warnings == ()
    assert recording.base_from_laser == Pose2(0.145, 0.0, 0.0)
    stamps = [frame.stamp_ns for frame in recording.frames]
    assert (stamps[-1] - stamps[0]) * 1e-9 == pytest.approx(seconds, abs=0.05)
    scan = recording.frames[0].scan
    assert scan is not None
    assert len(scan.ranges) == 683
    assert math.degrees(scan.angle_step) == pytest.approx(0.352, abs=0.001)
    assert not np.isfinite(scan.ranges[:70]).any()
    assert not np.isfinite(scan.ranges[-70:]).any()
    assert 4.0 < max(scan_ranges_of(frame).max() for frame in recording.frames) <= 5.6
    assert scan.time_step * 1024 == pytest.approx(0.1, rel=0.01)  # a turn of the mirror


def scan_ranges_of(frame: SensorFrame) -> FloatArray:
    assert frame.scan is not None
    return frame.scan.ranges[np.isfinite(frame.scan.ranges)].astype(np.float64)


@pytest.mark.parametrize("name", ["exp1", "exp2"])
def test_the_turns_of_the_real_scans_follow_those_of_the_wheels_at_the_scans_own_time(
    data_dir: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One scan matched to the next, for fifteen seconds; at the times of their lines they follow much worse."""
    settings, agreement = MatchSettings(), []
    for age in (coreslam.SCAN_AGE, 0.0):
        monkeypatch.setattr(coreslam, "SCAN_AGE", age)
        frames = read_recording(data_dir / "lidar_coreslam" / f"{name}.dat.gz").frames[100:250]
        points = [scan_points(frame.scan, Pose2(0.145, 0, 0), 20.0) for frame in frames if frame.scan is not None]
        poses = [own.odom_from_base for frame in frames for own in frame.wheels if isinstance(own, Odometry)]
        turns = []
        for k in range(len(frames) - 1):
            reference = reference_from_points(points[k].points, points[k].normals, settings.resolution, BEAM_SIGMA)
            moved = poses[k].inverse() @ poses[k + 1]
            found = match(points[k + 1], reference, moved, np.eye(3), Window(0.15, 0.15), settings)
            if found.inliers > 0.7:
                turns.append((found.pose.theta, moved.theta))
        agreement.append(float(np.corrcoef(np.array(turns).T)[0, 1]))
    assert agreement[0] > 0.85
    assert agreement[0] > agreement[1] + 0.1


def test_a_full_turn_of_both_wheels_is_their_circumference_and_of_one_an_arc(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(coreslam, "SCAN_AGE", 0.0)
    lines = [coreslam_line(0, 5, 7), coreslam_line(10**6, 2005, 2007), coreslam_line(2 * 10**6, 2005, 4007)]
    (tmp_path / "log.dat").write_text("\n".join(lines))
    frames = read_recording(tmp_path / "log.dat").frames
    readings = [reading for frame in frames for reading in frame.wheels if isinstance(reading, Odometry)]
    assert [frame.stamp_ns for frame in frames] == [0, 10**9, 2 * 10**9]
    around = math.tau * 0.077
    np.testing.assert_allclose(readings[1].odom_from_base.array(), [around, 0.0, 0.0], atol=1e-12)
    assert readings[1].twist.v == pytest.approx(around)
    turn = around / 0.33  # round the left wheel, which stands
    centre = np.array([around, 0.165])
    expected = centre + 0.165 * np.array([math.sin(turn), -math.cos(turn)])
    np.testing.assert_allclose(readings[2].odom_from_base.array(), [*expected, turn], atol=1e-12)


def test_a_scan_older_than_its_line_has_the_odometry_of_its_own_time(tmp_path: Path) -> None:
    (tmp_path / "log.dat").write_text("\n".join(coreslam_line(k * 10**6, 1000 * k, 1000 * k) for k in range(5, 9)))
    frames = read_recording(tmp_path / "log.dat").frames
    readings = [reading for frame in frames for reading in frame.wheels if isinstance(reading, Odometry)]
    assert [frame.stamp_ns for frame in frames] == [k * 10**9 - 190_000_000 for k in range(5, 9)]
    ways = np.array([reading.odom_from_base.x for reading in readings]) / (math.pi * 0.077)
    np.testing.assert_allclose(ways, [0.0, 0.81, 1.81, 2.81])  # before the first line there is no odometry
    assert readings[2].twist.v == pytest.approx(math.pi * 0.077)


def test_a_given_mount_replaces_that_of_the_published_robot(tmp_path: Path) -> None:
    (tmp_path / "log.dat").write_text("\n".join(coreslam_line(k * 10**5, 1000 * k, 1000 * k) for k in range(3)))
    assert read_recording(tmp_path / "log.dat").base_from_laser.x == 0.145
    mounted = read_recording(tmp_path / "log.dat", InputSettings(mounts=("0.3,0.1,0.2",)))
    assert mounted.base_from_laser == Pose2(0.3, 0.1, 0.2)


def test_damaged_lines_of_a_coreslam_log_are_left_out_and_counted(tmp_path: Path) -> None:
    lines = [coreslam_line(k * 10**5, k, k) for k in range(20)]
    lines[7] = lines[7][:900]
    lines[9] = lines[9].replace("1500", "15x0", 1)
    lines[12], lines[13] = lines[13], lines[12]
    (tmp_path / "log.dat").write_text("\n".join(lines) + "\n")
    recording = read_recording(tmp_path / "log.dat")
    assert len(recording.frames) == 18
    assert recording.warnings == (
        "2 damaged lines, the first of them line 8, left out",
        "stamps step backwards 1 times: the scans are kept in the order of the file",
    )
    (tmp_path / "one.dat").write_text(lines[0])
    with pytest.raises(NoScans, match="only one scan"):
        read_recording(tmp_path / "one.dat")


def test_the_real_rows_of_scans_are_read_and_have_no_odometry(data_dir: Path) -> None:
    recording = read_recording(data_dir / "ros_bags" / "hokuyo_scan_tools.txt.gz")
    assert len(recording.frames) == 278
    assert all(frame.wheels == () for frame in recording.frames)
    scan = recording.frames[0].scan
    assert scan is not None
    assert (len(scan.ranges), scan.range_max) == (681, pytest.approx(5.6))
    assert recording.frames[0].stamp_ns == 1282836370_970876000
    assert any("scan matching alone" in warning for warning in recording.warnings)


def test_truncated_rows_are_left_out_and_a_truncated_gzip_is_named(data_dir: Path, tmp_path: Path) -> None:
    data = (data_dir / "ros_bags" / "hokuyo_scan_tools.txt.gz").read_bytes()
    (tmp_path / "cut.txt.gz").write_bytes(data[: len(data) // 2])
    recording = read_recording(tmp_path / "cut.txt.gz")
    assert 100 < len(recording.frames) < 200
    assert any("the gzip file is cut short" in warning for warning in recording.warnings)
    assert any("1 damaged rows" in warning for warning in recording.warnings)
    text = gzip.decompress(data).decode().splitlines()
    (tmp_path / "none.txt").write_text("\n".join([text[0], *(row[:-9] for row in text[1:3])]))
    with pytest.raises(RecordingDamaged):
        read_recording(tmp_path / "none.txt")


def test_a_text_log_can_have_a_laser_mounted_upside_down(data_dir: Path) -> None:
    path = data_dir / "ros_bags" / "hokuyo_scan_tools.txt.gz"
    upright = read_recording(path).frames[5].scan
    hanging = read_recording(path, InputSettings(mounts=("0,0,0,upside-down",))).frames[5].scan
    assert upright is not None
    assert hanging is not None
    np.testing.assert_array_equal(hanging.ranges, upright.ranges[::-1])
    np.testing.assert_allclose(hanging.angles(), -upright.angles()[::-1], atol=1e-9)
