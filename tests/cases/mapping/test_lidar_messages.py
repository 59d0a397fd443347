"""Lidars whose messages do not mean what they say: codes, units, contradictions, beam times, and near surfaces."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.cases.mapping.lidar_floor import (
    Change,
    Drive,
    Lidar,
    PointTime,
    mapped_error,
    only,
    replaced,
    short_sighted,
    walls,
    write_clouds,
    write_scans,
)
from waychair.errors import NoScans
from waychair.offline.aids import checked_recording
from waychair.recordings.recording import InputSettings, Recording, read_recording

ACCURATE = 0.03  # m RMSE; a sound recording of this floor gives 0.01
DEGREES = math.degrees


def kinds(recording: Recording) -> list[tuple[str, str]]:
    """Topic and kind of each finding; each must be a sentence among the warnings."""
    for finding in recording.findings:
        assert finding.sentence() in recording.warnings
    return [(finding.topic, finding.kind) for finding in recording.findings]


def test_a_sound_recording_maps_and_nothing_is_found(tmp_path: Path) -> None:
    drive = write_scans(tmp_path / "drive")
    recording = read_recording(tmp_path / "drive")
    assert kinds(recording) == []
    assert mapped_error(recording, drive) < ACCURATE


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("nothing", "told_most"), [(3.0, 3.0), (2.99, 3.0), (6.51, 10.0), (2.0, 10.0), (3.0, 0.0)])
def test_a_value_that_very_many_beams_share_is_a_code_for_nothing(
    tmp_path: Path, nothing: float, told_most: float
) -> None:
    drive = write_scans(tmp_path / "drive", replaced(range_max=told_most), short_sighted(nothing))
    recording = read_recording(tmp_path / "drive")
    assert kinds(recording) == [("/scan", "code for nothing")]
    coded = [np.count_nonzero(frame.scan.ranges == np.float32(nothing)) for frame in recording.frames if frame.scan]
    assert sum(coded) == 0
    assert mapped_error(recording, drive) < 0.06


@pytest.mark.sampled(1)
@pytest.mark.parametrize("step", [0.001, 0.01, 0.05])
def test_rounded_ranges_of_walls_are_no_codes(tmp_path: Path, step: float) -> None:
    drive = write_scans(tmp_path / "drive", replaced(ranges=lambda ranges: np.round(ranges / step) * step))
    recording = read_recording(tmp_path / "drive")
    assert kinds(recording) == []
    assert mapped_error(recording, drive) < ACCURATE


def test_a_chair_that_only_stands_has_no_codes(tmp_path: Path) -> None:
    write_scans(
        tmp_path / "drive", replaced(ranges=lambda ranges: np.round(ranges, 1)), drive=Drive(((0.0, 0.0),) * 300)
    )
    assert kinds(read_recording(tmp_path / "drive")) == []


@pytest.mark.sampled(6)
@pytest.mark.parametrize(
    ("change", "kind"),
    [
        (replaced(ranges=lambda r: 1e3 * r), "range unit"),
        (replaced(ranges=lambda r: 1e3 * r, range_min=100.0, range_max=12_000.0), "range unit"),
        (replaced(ranges=lambda r: 100.0 * r), "range unit"),
        (replaced(ranges=lambda r: 39.37 * r, range_min=3.937, range_max=472.44), "range unit"),
        (replaced(range_min=100.0, range_max=12_000.0), "range limits"),
        (replaced(range_min=12.0, range_max=0.1), "range limits"),
        (replaced(range_max=0.5), "range limits"),
        (replaced(angle_min=DEGREES, angle_max=DEGREES, angle_increment=DEGREES), "angles"),
        (replaced(angle_min=DEGREES, angle_max=DEGREES), "angles"),
        (replaced(angle_increment=DEGREES), "angles"),
        (replaced(angle_increment=0.0), "angles"),
        (replaced(angle_increment=lambda step: 2.0 * step), "angles"),
        (replaced(angle_increment=lambda step: 0.5 * step), "angles"),
        (replaced(angle_max=0.4), "angles"),
        (replaced(time_increment=833_333.3), "beam times"),
        (replaced(time_increment=833.3), "beam times"),
        (replaced(time_increment=0.8333), "beam times"),
        (replaced(time_increment=0.2), "beam times"),
        (replaced(time_increment=lambda seconds: -seconds), "beam times"),
        (replaced(time_increment=lambda seconds: 3.0 * seconds), "beam times"),
        (replaced(time_increment=0.0), "beam times"),
        (replaced(time_increment=math.nan), "beam times"),
    ],
)
def test_a_field_in_another_unit_or_a_contradiction_is_put_right_and_named_once(
    tmp_path: Path, change: Change, kind: str
) -> None:
    drive = write_scans(tmp_path / "drive", change)
    recording = read_recording(tmp_path / "drive")
    assert kinds(recording) == [("/scan", kind)]
    assert mapped_error(recording, drive) < ACCURATE


def exchanged(number: int, told: dict[str, Any]) -> dict[str, Any]:
    return {**told, "angle_min": told["angle_max"], "angle_max": told["angle_min"]}


@pytest.mark.parametrize("change", [exchanged, replaced(angle_increment=lambda step: -step)])
def test_a_mirrored_field_of_view_is_settled_by_the_motion_or_refused_by_name(tmp_path: Path, change: Change) -> None:
    partial = Lidar(first=-2.1, view=4.2)
    drive = write_scans(tmp_path / "moved", change, partial)
    recording = read_recording(tmp_path / "moved")
    assert kinds(recording) == [("/scan", "angles")]
    assert "as the odometry confirms" in recording.findings[0].text
    assert mapped_error(recording, drive) < 0.05
    write_scans(tmp_path / "unknown", change, partial, odometry=False)
    with pytest.raises(NoScans, match=r"/scan: the angles .* contradict each other: 240 beams, angle_min .*odometry"):
        read_recording(tmp_path / "unknown")


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    "change",
    [
        replaced(ranges=lambda r: 1e3 * r),
        replaced(angle_increment=lambda step: 1.7 * step),
        replaced(angle_min=DEGREES, angle_max=DEGREES, angle_increment=DEGREES),
        replaced(angle_min=math.nan),
        replaced(time_increment=1e6),
        replaced(ranges=lambda r: r[:0]),
        replaced(ranges=lambda r: r[:70]),
        replaced(ranges=lambda r: np.full(400_000, 2.0)),
        replaced(range_max=0.01),
    ],
)
def test_one_odd_message_among_sound_ones_changes_nothing_and_is_named_with_its_time(
    tmp_path: Path, change: Change
) -> None:
    drive = write_scans(tmp_path / "drive", only(30, change))
    recording = read_recording(tmp_path / "drive")
    for finding in recording.findings:
        assert (finding.topic, finding.count) == ("/scan", 1)
        assert finding.first_s == pytest.approx(6.0, abs=0.01)
    assert mapped_error(recording, drive) < ACCURATE


def every_third(change: Change) -> Change:
    """The change, to every third message."""
    return lambda number, told: change(number, told) if number % 3 == 0 else told


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "change",
    [
        replaced(angle_min=DEGREES),
        replaced(angle_min=lambda angle: angle + 2.0),
        replaced(angle_increment=0.0),
        exchanged,
        replaced(ranges=lambda r: np.concatenate([r, r])),
    ],
)
def test_scans_that_contradict_themselves_among_sound_ones_have_the_angles_of_these(
    tmp_path: Path, change: Change
) -> None:
    drive = write_scans(tmp_path / "drive", every_third(change))
    recording = read_recording(tmp_path / "drive")
    assert set(kinds(recording)) == {("/scan", "angles")}
    assert mapped_error(recording, drive) < ACCURATE


def test_ranges_in_reverse_order_are_mirrored_and_their_sweep_turned_round(tmp_path: Path) -> None:
    drive = write_scans(tmp_path / "drive", replaced(ranges=lambda r: r[::-1].copy()))
    recording = read_recording(tmp_path / "drive")
    checked = checked_recording(recording, 20.0)
    (said,) = checked.sentences
    assert "does the driver give the ranges in reverse order?" in said
    assert mapped_error(checked.recording, drive) < ACCURATE


def test_half_of_the_beams_without_a_distance_are_told(tmp_path: Path) -> None:
    def covered(number: int, told: dict[str, Any]) -> dict[str, Any]:
        ranges = told["ranges"].copy()
        ranges[: int(0.7 * len(ranges))] = math.inf
        return {**told, "ranges": ranges}

    write_scans(tmp_path / "drive", covered)
    recording = read_recording(tmp_path / "drive")
    assert kinds(recording) == [("/scan", "blind sector")]
    assert "168 of 240 beams" in recording.findings[0].text


def test_ranges_of_no_lidar_are_refused_by_name(tmp_path: Path) -> None:
    write_scans(tmp_path / "drive", replaced(ranges=lambda r: 1e9 * r))
    with pytest.raises(NoScans, match=r"/scan: the median range is .* m, as no lidar measures"):
        read_recording(tmp_path / "drive")


REL = PointTime("time", 7, "f4", lambda later, stamp: later)
POINT_TIMES = {
    "seconds": REL,
    "microseconds": PointTime("time_offset", 6, "u4", lambda later, stamp: 1e6 * later),
    "nanoseconds": PointTime("t", 6, "u4", lambda later, stamp: 1e9 * later),
    "absolute": PointTime("timestamp", 8, "f8", lambda later, stamp: stamp + later),
    "absolute nanoseconds": PointTime("timestamp", 8, "f8", lambda later, stamp: 1e9 * (stamp + later)),
    "another clock": PointTime("timestamp", 8, "f8", lambda later, stamp: stamp + later - 1.6e9),
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", [*POINT_TIMES, "none"])
def test_a_flat_cloud_is_the_scan_of_a_planar_lidar_and_its_beams_have_times(tmp_path: Path, name: str) -> None:
    drive = write_clouds(tmp_path / "drive", time=POINT_TIMES.get(name))
    recording = read_recording(tmp_path / "drive")
    scans = [frame.scan for frame in recording.frames if frame.scan is not None]
    assert len(scans[0].ranges) == 240
    np.testing.assert_allclose(scans[20].time_step, 0.2 / 240, rtol=0.02)
    assert mapped_error(recording, drive, (0.15, 0.0)) < ACCURATE


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", POINT_TIMES)
def test_points_of_a_cloud_in_space_are_put_right_by_their_times(tmp_path: Path, name: str) -> None:
    rings = tuple(np.radians([-9.0, -3.0, 1.0, 7.0]).tolist())
    drive = write_clouds(tmp_path / "drive", rings, POINT_TIMES[name], 0.7, over_floor=0.7, beams=450)
    recording = read_recording(tmp_path / "drive")
    assert kinds(recording) == []
    assert mapped_error(recording, drive) < ACCURATE


RINGS = tuple(np.radians([-15.0, 0.0, 15.0]).tolist())


@pytest.mark.sampled(2)
@pytest.mark.parametrize("rings", [(0.0,), RINGS], ids=["flat", "in space"])
@pytest.mark.parametrize(("scale", "unit"), [(100.0, "centimetres"), (1e3, "millimetres"), (39.37, "inches")])
def test_the_motion_tells_the_unit_of_clouds(tmp_path: Path, scale: float, unit: str, rings: tuple[float, ...]) -> None:
    drive = write_clouds(tmp_path / "drive", rings, REL, 0.3, over_floor=0.3, scale=scale)
    recording = read_recording(tmp_path / "drive")
    (found,) = [finding for finding in recording.findings if finding.kind == "range unit"]
    assert found.text.startswith(f"the points are in {unit}, ")
    assert "may be" not in found.text
    assert mapped_error(recording, drive) < 2.0 * ACCURATE


def test_without_odometry_the_likelier_unit_of_clouds_is_taken_and_the_doubt_is_named(tmp_path: Path) -> None:
    write_clouds(tmp_path / "drive", time=REL, height=0.2, scale=1e3, odometry=False)
    (found,) = [finding for finding in read_recording(tmp_path / "drive").findings if finding.kind == "range unit"]
    assert "the points are in millimetres" in found.text
    assert "they may be in centimetres (10 times the size), since no motion by odometry tells the unit" in found.text


def test_a_cloud_in_millimetres_is_converted(tmp_path: Path) -> None:
    drive = write_clouds(tmp_path / "drive", time=REL, height=0.2, scale=1e3)
    recording = read_recording(tmp_path / "drive")
    assert ("/cloud", "range unit") in kinds(recording)
    assert mapped_error(recording, drive) < ACCURATE


def test_the_height_of_an_unknown_mount_is_seen_over_the_floor_or_given(tmp_path: Path) -> None:
    rings = tuple(np.radians([-25.0, -15.0, -5.0, 1.0, 5.0]).tolist())
    write_clouds(tmp_path / "drive", rings, REL, over_floor=0.7)
    seen = read_recording(tmp_path / "drive")
    assert ("/cloud", "mount") in kinds(seen)
    assert "0.70 m over the floor" in seen.findings[0].text
    given = read_recording(tmp_path / "drive", InputSettings(mounts=("0.15,0,0.7,0",)))
    assert kinds(given) == []
    ranges = [[frame.scan.ranges for frame in recording.frames if frame.scan] for recording in (seen, given)]
    near = [np.nanmedian(np.where(np.isfinite(rows), rows, np.nan)) for rows in ranges]
    assert near[0] == pytest.approx(near[1], abs=0.1)


def test_a_cloud_outside_the_band_of_heights_is_refused_with_the_words_that_fit(tmp_path: Path) -> None:
    write_clouds(tmp_path / "drive", tuple(np.radians([-30.0, -24.0]).tolist()), REL, 0.2)
    with pytest.raises(
        NoScans, match=r"/cloud: all points lie below 0\.3 m over the base.*--base-from-laser X,Y,Z,YAW"
    ):
        read_recording(tmp_path / "drive")


@pytest.mark.sampled(2)
@pytest.mark.parametrize("field", ["width", "height", "point_step", "row_step"])
def test_a_cloud_whose_size_does_not_fit_its_data_is_left_out_before_memory_is_taken(
    tmp_path: Path, field: str
) -> None:
    def change(number: int, message: Any) -> None:
        if number == 25:
            setattr(message, field, 4_000_000_000 if field != "point_step" else 3)

    drive = write_clouds(tmp_path / "drive", time=REL, height=0.2, change=change)
    recording = read_recording(tmp_path / "drive")
    if field == "row_step":  # one row needs no stride
        assert kinds(recording) == []
    else:
        assert kinds(recording) == [("/cloud", "cloud size")]
    assert mapped_error(recording, drive) < ACCURATE


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("noise", "near"), [(0.012, 0.25), (0.03, 0.25), (0.02, 0.15)])
def test_a_near_surface_beside_a_dense_lidar_does_not_hold_the_chair_back(
    tmp_path: Path, noise: float, near: float
) -> None:
    cupboard = (3.4, near, 4.9, near + 0.6)
    dense = Lidar(beams=720, first=-2.1, view=4.2, period=0.1, noise=noise)
    drive = write_scans(tmp_path / "drive", None, dense, Drive(((7.6, 0.0),)), walls(cupboard))
    assert mapped_error(read_recording(tmp_path / "drive"), drive) < ACCURATE
