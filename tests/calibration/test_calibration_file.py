"""One file per chair: it is read back as it was written, or refused with the reason."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.calibration.synthetic import TRUE
from waychair.calibration.calibration_file import (
    CameraMount,
    ChairCalibration,
    content_hash,
    load_calibration,
    mount_from_extrinsics,
    save_calibration,
    update_calibration,
)
from waychair.calibration.chair_body import CHAIR_B
from waychair.calibration.fits.camera_mount import Extrinsics
from waychair.calibration.fits.imu_at_rest import ImuCalibration
from waychair.calibration.fits.self_mask import SelfMask
from waychair.calibration.fits.stopping import StopTable
from waychair.calibration.fits.time_offset import SensorDelays
from waychair.calibration.fits.wheels import WheelCalibration
from waychair.errors import CalibrationDamaged, CalibrationError, CalibrationMismatch
from waychair.types import Pose3

FULL = ChairCalibration(
    chair_id="ward 3, left",
    date="2026-01-31T12:00:00+00:00",
    body=CHAIR_B,
    dac=TRUE,
    stops=StopTable(speeds=(0.2, 0.8), distances=(0.1, 0.6), turn_rate=0.6, turn_angle=0.2, delay_s=0.1),
    wheels=WheelCalibration(left_radius=0.1651),
    imu=ImuCalibration(gyro_bias=(0.1, -0.2, 0.3)),
    camera=CameraMount(rotation=((0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)), translation=(0.1, 0.2, 0.3)),
)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A chair's file."""
    path = tmp_path / "chair.json"
    save_calibration(path, FULL)
    return path


def _edited(path: Path, **changes: Any) -> None:
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


def test_a_chairs_file_is_read_back_as_it_was_written(path: Path) -> None:
    assert load_calibration(path) == load_calibration(path, FULL.chair_id) == FULL
    assert json.loads(path.read_text())["hash"] == content_hash(FULL)


def test_unmeasured_parameters_stay_unknown(tmp_path: Path) -> None:
    bare = ChairCalibration("C7", "2026-01-31")
    save_calibration(tmp_path / "bare.json", bare)
    assert load_calibration(tmp_path / "bare.json") == bare


def test_the_file_of_another_chair_is_refused(path: Path) -> None:
    with pytest.raises(CalibrationMismatch, match="belongs to chair 'ward 3, left', not 'ward 4'"):
        load_calibration(path, "ward 4")


def test_an_edited_file_is_refused(path: Path) -> None:
    text = path.read_text()
    assert text.count("0.1651") == 1
    path.write_text(text.replace("0.1651", "0.1652"))
    with pytest.raises(CalibrationDamaged, match="altered"):
        load_calibration(path)


def test_a_change_of_any_byte_is_noticed(path: Path) -> None:
    """With any single character changed, the file is refused or still has the same values."""
    text = path.read_text()
    for at in range(0, len(text), 7):
        path.write_text(text[:at] + chr((ord(text[at]) + 1) % 128) + text[at + 1 :])
        try:
            assert load_calibration(path) == FULL
        except CalibrationDamaged:
            continue


@pytest.mark.parametrize("schema", [0, 2, "1", None])
def test_an_unknown_schema_is_refused(path: Path, schema: object) -> None:
    _edited(path, schema=schema)
    with pytest.raises(CalibrationDamaged, match="schema"):
        load_calibration(path)


@pytest.mark.parametrize("text", ["", "[]", "{", "null", '{"schema": 1}'])
def test_a_file_without_a_calibration_is_refused(path: Path, text: str) -> None:
    path.write_text(text)
    with pytest.raises(CalibrationDamaged):
        load_calibration(path)


def test_a_missing_file_or_one_that_is_not_text_is_refused(path: Path) -> None:
    path.write_bytes(b"\xff\xfe\x81")
    with pytest.raises(CalibrationDamaged, match="not text"):
        load_calibration(path)
    with pytest.raises(CalibrationError, match="calibrate dac"):
        load_calibration(path.with_name("none.json"))


def _signed(path: Path, **changes: Any) -> None:
    """Return a file with changed content and a matching hash."""
    import hashlib

    content = {**json.loads(path.read_text()), **changes}
    del content["hash"]
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"))
    path.write_text(json.dumps({**content, "hash": hashlib.sha256(canonical.encode()).hexdigest()}))


def test_impossible_values_are_refused_even_with_the_right_hash(path: Path) -> None:
    dac = json.loads(path.read_text())["dac"]
    dac["forward"]["above"]["gain"] = -1.0
    _signed(path, dac=dac)
    with pytest.raises(CalibrationDamaged, match="gain"):
        load_calibration(path)


def test_a_curve_that_is_not_monotone_is_refused_even_with_the_right_hash(path: Path) -> None:
    dac = json.loads(path.read_text())["dac"]
    dac["turn"]["below"]["curve"] = -5.0
    _signed(path, dac=dac)
    with pytest.raises(CalibrationDamaged, match="turns back"):
        load_calibration(path)


def test_unknown_entries_are_refused(path: Path) -> None:
    _signed(path, speed_limit=9.0)
    with pytest.raises(CalibrationDamaged, match="does not know"):
        load_calibration(path)


def test_a_chair_without_a_name_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="name"):
        save_calibration(tmp_path / "chair.json", replace(FULL, chair_id=" "))
    assert not list(tmp_path.iterdir())


def test_later_measurements_are_added(path: Path) -> None:
    wheels = WheelCalibration(left_radius=0.17)
    update_calibration(path, ChairCalibration(FULL.chair_id, "2026-02-01", CHAIR_B, wheels=wheels))
    assert load_calibration(path) == replace(FULL, date="2026-02-01", wheels=wheels)
    with pytest.raises(CalibrationMismatch):
        update_calibration(path, ChairCalibration("ward 4", "2026-02-01", wheels=wheels))
    assert load_calibration(path).wheels == wheels


def test_the_camera_mount_survives_the_file() -> None:
    pose = Pose3(np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]), np.array([0.1, 0.2, 0.3]))
    mount = mount_from_extrinsics(Extrinsics(pose, 0.01, 100))
    assert (mount.camera_from_laser.rotation == pose.rotation).all()
    assert (mount.camera_from_laser.translation == pose.translation).all()


def test_an_older_file_is_read_with_defaults_for_newer_parameters(path: Path) -> None:
    content = json.loads(path.read_text())
    del content["hash"], content["dac"]["speed_cut"], content["dac"]["volts_min"], content["self_mask"]
    _rehashed(path, content)
    assert load_calibration(path) == FULL


@pytest.mark.parametrize(("place", "name"), [((), "colour"), (("dac", "turn", "above"), "dac.turn.above.colour")])
def test_an_unknown_entry_is_named(path: Path, place: tuple[str, ...], name: str) -> None:
    content = json.loads(path.read_text())
    del content["hash"]
    part = content
    for key in place:
        part = part[key]
    part["colour"] = "red"
    _rehashed(path, content)
    with pytest.raises(CalibrationDamaged, match=f"holds the entry {name}, which schema 1 does not know"):
        load_calibration(path)


def _rehashed(path: Path, content: dict[str, Any]) -> None:
    """Write it as another version would have."""
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"))
    path.write_text(json.dumps({**content, "hash": hashlib.sha256(canonical.encode()).hexdigest()}))


def test_delays_and_self_mask_are_read_back_as_they_were_written(path: Path) -> None:
    delays = SensorDelays(lidar_ns=40_000_000, wheels_ns=-3, camera_ns=7)
    mask = SelfMask(begins=(-1.4, 1.3), ends=(-1.3, 1.4), reaches=(0.3, 0.25))
    update_calibration(path, replace(FULL, sensor_delays=delays, self_mask=mask))
    kept = load_calibration(path)
    assert (kept.sensor_delays, kept.self_mask) == (delays, mask)


def test_an_impossible_mask_is_refused_even_with_the_right_hash(path: Path) -> None:
    _signed(path, self_mask={"begins": [1.0], "ends": [0.5], "reaches": [0.3], "margin": 0.05})
    with pytest.raises(CalibrationDamaged, match="sectors"):
        load_calibration(path)
