"""CARMEN logs: exact stamps, file order, angles by beam count, and damage that is named."""

from __future__ import annotations

import gzip
import math
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.errors import NoScans, RecordingDamaged
from waychair.recordings.stamps import stamp_from_text
from waychair.recordings.text.carmen import read_carmen
from waychair.types import Odometry, Pose2


def flaser(ranges: list[float | str], stamp: str = "1.5", laser: str = "1 2 0.5", robot: str = "3 4 0.25") -> bytes:
    numbers = " ".join(str(r) for r in ranges)
    return f"FLASER {len(ranges)} {numbers} {laser} {robot} {stamp} host 0.1\n".encode()


def odometry_of(data: bytes, *, of_robot: bool) -> Odometry:
    reading = read_carmen(data, "log", of_robot=of_robot).frames[0].wheels[0]
    assert isinstance(reading, Odometry)
    return reading


@pytest.mark.parametrize(
    ("text", "stamp_ns"),
    [
        ("976052905.167303", 976052905_167303000),
        ("0", 0),
        ("-0.445999", -445_999_000),
        ("1137834225.713387", 1137834225_713387000),
        ("1.0000000014", 1_000_000_001),
        ("9.760529e+08", 976052900_000000000),
        ("1e-999999", 0),
    ],
)
def test_a_stamp_is_read_from_its_decimal_text_to_the_nanosecond(text: str, stamp_ns: int) -> None:
    assert stamp_from_text(text) == stamp_ns


@given(st.decimals(min_value=-9_000_000_000, max_value=9_000_000_000, places=9))
def test_no_stamp_is_rounded_by_a_float(seconds: Decimal) -> None:
    assert stamp_from_text(f"{seconds:f}") == int(seconds * 10**9)


@pytest.mark.parametrize("text", ["nan", "inf", "1e999999999", "9223372037", "12:30", ""])
def test_an_invalid_time_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="not a time"):
        stamp_from_text(text)


@pytest.mark.parametrize(
    ("beams", "step_deg", "last_deg"), [(180, 1.0, 89.0), (181, 1.0, 90.0), (360, 0.5, 89.5), (361, 0.5, 90.0)]
)
def test_beams_run_to_the_left_from_minus_90_degrees(beams: int, step_deg: float, last_deg: float) -> None:
    scan = read_carmen(flaser([1.0] * beams), "log").frames[0].scan
    assert scan is not None
    angles = np.degrees(scan.angles())
    assert angles[0] == pytest.approx(-90.0)
    assert angles[1] - angles[0] == pytest.approx(step_deg)
    assert angles[-1] == pytest.approx(last_deg)


def test_a_missing_return_is_infinite_and_an_invalid_distance_nan() -> None:
    scan = read_carmen(flaser([79.99, 80.0, 81.83, 0.0, -1.0, "nan", 0.01]), "log").frames[0].scan
    assert scan is not None
    np.testing.assert_array_equal(
        scan.ranges, np.array([79.99, np.inf, np.inf, np.nan, np.nan, np.nan, 0.01], np.float32)
    )


def test_odometry_is_the_laser_pose_unless_that_of_the_robot_is_requested() -> None:
    line = flaser([1.0, 2.0])
    assert odometry_of(line, of_robot=False).odom_from_base == Pose2(1.0, 2.0, 0.5)
    assert odometry_of(line, of_robot=True).odom_from_base == Pose2(3.0, 4.0, 0.25)
    assert odometry_of(line, of_robot=True).stamp_ns == 1_500_000_000


def test_robotlaser_has_its_own_angles_range_and_speeds() -> None:
    line = b"ROBOTLASER1 0 -0.5 1.0 0.25 30.0 0.01 0 3 1.5 30.0 2.0 1 7 1 2 0.5 3 4 0.25 0.6 -0.1 1 1 0 12.25 host 1\n"
    frame = read_carmen(line, "log", of_robot=True).frames[0]
    assert frame.scan is not None
    np.testing.assert_array_equal(frame.scan.ranges, np.array([1.5, np.inf, 2.0], np.float32))
    np.testing.assert_allclose(frame.scan.angles(), [-0.5, -0.25, 0.0])
    assert frame.scan.range_max == 30.0
    assert frame.stamp_ns == 12_250_000_000
    odometry = odometry_of(line, of_robot=True)
    assert (odometry.odom_from_base, odometry.twist.v, odometry.twist.omega) == (Pose2(3.0, 4.0, 0.25), 0.6, -0.1)


def test_scans_with_different_numbers_of_beams_are_all_kept_in_file_order() -> None:
    data = flaser([1.0] * 181, "5.0") + b"ODOM 0 0 0 0 0 0 5.1 host 0\n" + flaser([1.0] * 90, "4.5")
    log = read_carmen(data, "log")
    assert [frame.stamp_ns for frame in log.frames] == [5_000_000_000, 4_500_000_000]
    assert log.warnings == ("stamps step backwards 1 times: the scans are kept in the order of the file",)


def test_a_scan_logged_in_both_forms_counts_once() -> None:
    robot = b"ROBOTLASER1 0 -0.5 1.0 0.25 30.0 0.01 0 2 1.5 2.0 0 1 2 0.5 3 4 0.25 0.6 -0.1 1 1 0 12.25 host 1\n"
    log = read_carmen(flaser([1.0, 2.0]) + robot + flaser([1.0, 2.0], "2.0"), "log")
    assert (log.kind, len(log.frames)) == ("FLASER", 2)


@pytest.mark.parametrize(
    "bad", ["FLASER", "FLASER x", "FLASER 999999999999 1", "FLASER -3 1 2", "FLASER 1 2 " + "0 " * 9]
)
def test_a_damaged_line_is_left_out_and_named(bad: str) -> None:
    log = read_carmen(flaser([1.0, 2.0]) + bad.encode() + b"\n" + flaser([1.0, 2.0]), "log")
    assert len(log.frames) == 2
    assert log.warnings == ("1 damaged scan line 2, left out; 2 scans were read",)


@pytest.mark.parametrize("data", [b"\x00\xff\x17" * 400, b"just some words\nand more\n", b"1 2 3\n4 5 6\n", b"\n\n\n"])
def test_a_file_that_is_not_a_log_is_refused_with_the_known_formats(data: bytes) -> None:
    with pytest.raises(RecordingDamaged, match="neither a CARMEN or CoreSLAM log nor"):
        read_carmen(data, "log")


def test_an_error_about_a_log_without_scans_lists_its_content() -> None:
    with pytest.raises(NoScans, match=r"ODOM \(2\), PARAM \(1\)"):
        read_carmen(b"PARAM a 1\nODOM 0 0 0 0 0 0 1 h 1\nODOM 0 0 0 0 0 0 2 h 2\n", "log")


def test_a_log_without_a_complete_scan_is_damaged() -> None:
    with pytest.raises(RecordingDamaged, match="none of the 1 scan lines"):
        read_carmen(flaser([1.0] * 180)[:300], "log")


def test_several_gzip_members_are_one_log() -> None:
    data = gzip.compress(flaser([1.0, 2.0], "1")) + gzip.compress(flaser([1.0, 2.0], "2"))
    log = read_carmen(data, "log")
    assert [frame.stamp_ns for frame in log.frames] == [1_000_000_000, 2_000_000_000]
    assert log.warnings == ()


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=300), st.booleans())
def test_no_bytes_raise_an_unexpected_error(noise: bytes, zipped: bool) -> None:
    data = flaser([1.0, 2.0]) + b"FLASER " + noise + b"\nROBOTLASER1 " + noise
    log = read_carmen(gzip.compress(data) if zipped else data, "log")
    assert len(log.frames) >= 1


def test_a_log_truncated_anywhere_gives_its_complete_scans_and_a_warning(data_dir: Path) -> None:
    zipped = (data_dir / "wheelchair_sena" / "sena_one_loop.clf.gz").read_bytes()
    whole = read_carmen(zipped, "log")
    assert (len(whole.frames), whole.warnings) == (225, ())
    counts = []
    for end in np.linspace(2, len(zipped) - 1, 40).astype(int).tolist():
        try:
            log = read_carmen(zipped[:end], "log")
        except RecordingDamaged:
            counts.append(0)
            continue
        counts.append(len(log.frames))
        assert any("cut short" in warning for warning in log.warnings)
        assert [f.stamp_ns for f in log.frames] == [f.stamp_ns for f in whole.frames[: len(log.frames)]]
    assert counts == sorted(counts)
    assert counts[0] == 0
    assert counts[-1] >= 224


def test_a_corrupted_gzip_gives_the_scans_before_the_damage(data_dir: Path) -> None:
    zipped = bytearray((data_dir / "lidar_fr079" / "fr079_laser.clf.gz").read_bytes())
    middle = len(zipped) // 2
    zipped[middle : middle + 64] = bytes(64)
    log = read_carmen(bytes(zipped), "log")
    assert 1000 < len(log.frames) < 4791
    assert any("damaged" in warning for warning in log.warnings)


def test_plain_text_truncated_in_its_last_line_keeps_the_other_lines() -> None:
    first, last = flaser([1.25, 2.5], "1"), flaser([1.25, 2.5], "2")
    for cut in range(len(last)):
        log = read_carmen(first + last[:cut], "log")
        stamps = [frame.stamp_ns for frame in log.frames]
        assert stamps in ([1_000_000_000], [1_000_000_000, 2_000_000_000])


def test_progress_runs_from_0_to_1() -> None:
    told: list[float] = []
    read_carmen(flaser([1.0, 2.0]) * 1000, "log", progress=told.append)
    assert told == sorted(told)
    assert len(told) > 2
    assert told[-1] == 1.0
    assert math.isclose(told[0], 0.256, abs_tol=0.005)


def test_a_log_in_millimetres_is_refused_with_its_usual_range() -> None:
    with pytest.raises(NoScans, match=r"the ranges of log are 2500 m in the median.*millimetres or centimetres"):
        read_carmen(b"".join(flaser([2500.0] * 180, f"{5.0 + 0.2 * k}") for k in range(5)), "log")
