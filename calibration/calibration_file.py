"""A chair's calibration file: one JSON file with all its measurements and a hash that reveals changes.

The calibration of another chair, or one edited by hand, can make a chair lurch. So it is refused, not repaired.
"""

from __future__ import annotations

import dataclasses
import errno
import hashlib
import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec
import numpy as np

from waychair.calibration.chair_body import BODIES, CHAIR_A, ChairBody
from waychair.calibration.fits.camera_mount import Extrinsics
from waychair.calibration.fits.fitted_dac import FittedDac
from waychair.calibration.fits.imu_at_rest import ImuCalibration
from waychair.calibration.fits.self_mask import SelfMask
from waychair.calibration.fits.stopping import StopTable
from waychair.calibration.fits.time_offset import SensorDelays, without_delay
from waychair.calibration.fits.wheels import WheelCalibration
from waychair.calibration.measured import Measured, measured
from waychair.errors import CalibrationDamaged, CalibrationError, CalibrationMismatch, ConfigError
from waychair.files import os_error_text, write_json
from waychair.install_advice import document
from waychair.types import Json, Pose3, Scan

T = TypeVar("T")

SCHEMA = 1
"""Version of the file's format; files of other versions are refused."""

JoystickFamily = Literal["hall_5v", "inductive_12v", "eight_pin_3v3"]
"""Names of the joystick families, as in `firmware_bridge.protocol.Family`."""

_SIMULATED_NAME = re.compile(r"sim-\d+")
"""Names of simulated chairs, as `waychair calibrate` gives them."""


@dataclass(frozen=True, slots=True)
class CameraMount(Measured):
    """The transform `camera_from_laser` as numbers for the file."""

    rotation: tuple[tuple[float, float, float], ...] = measured((), "", "rows of the rotation")
    translation: tuple[float, float, float] = measured((0.0, 0.0, 0.0), "m", "the laser's origin in the camera's frame")
    rms_m: float = measured(0.0, "m", "of the points about their planes", low=0.0, high=1.0)

    @property
    def camera_from_laser(self) -> Pose3:
        """The transform as a pose."""
        return Pose3(np.array(self.rotation), np.array(self.translation))


@dataclass(frozen=True, slots=True)
class ChairCalibration:
    """All that is known of one chair; parts not measured yet are None. `date` is ISO 8601.

    `family` is the joystick family of the board with which it was measured. `simulated`: it was measured on a simulated
    chair, and no real chair may be driven by it.
    """

    chair_id: str
    date: str
    body: ChairBody = field(default_factory=lambda: CHAIR_A)
    dac: FittedDac | None = None
    stops: StopTable | None = None
    wheels: WheelCalibration | None = None
    imu: ImuCalibration | None = None
    camera: CameraMount | None = None
    sensor_delays: SensorDelays | None = None
    self_mask: SelfMask | None = None
    family: JoystickFamily | None = None
    simulated: bool = False

    @property
    def is_simulated(self) -> bool:
        """Whether this is the calibration of a simulated chair, by its mark or its name."""
        return self.simulated or is_simulated_name(self.chair_id)

    def with_true_stamp(self, message: T) -> T:
        """Return a sensor's message with its stamp corrected by the measured delay."""
        return message if self.sensor_delays is None else without_delay(message, self.sensor_delays)

    def masked(self, scan: Scan) -> Scan:
        """Return a scan without the beams that see the chair itself."""
        return scan if self.self_mask is None else self.self_mask.applied(scan)


def is_simulated_name(chair_id: str) -> bool:
    """Return whether `waychair calibrate` gives this name to a simulated chair."""
    return _SIMULATED_NAME.fullmatch(chair_id) is not None


def check_measured(calibration: ChairCalibration, source: str) -> None:
    """Check that a board may drive a chair by a calibration: the joystick was measured. `source` names it in errors.

    Raises:
        CalibrationError: it holds no model of the joystick, in whose place that of the simulated chair would count.
    """
    if calibration.dac is None:
        raise CalibrationError(
            f"{source} holds no model of the joystick: run `waychair calibrate dac` with this chair first"
        )


def check_real(calibration: ChairCalibration, source: str) -> None:
    """Check that a real chair may be driven by a calibration; `source` names it in errors.

    Raises:
        CalibrationMismatch: it is that of a simulated chair, or has the dimensions of a built-in one.
        CalibrationError: see `check_measured`.
    """
    if calibration.is_simulated:
        raise CalibrationMismatch(
            f"{source} is the calibration of the simulated chair '{calibration.chair_id}', and a real chair is driven by "
            f"its own file only: measure it with `waychair calibrate` ({document('docs/hardware.md')})"
        )
    check_measured(calibration, source)
    if has_built_in_body(calibration):
        raise CalibrationMismatch(
            f"{source} has the dimensions of the built-in chair '{calibration.body.chair_id}': measure this chair by tape "
            f"and run `waychair calibrate body` ({document('docs/hardware.md')})"
        )


def has_built_in_body(calibration: ChairCalibration) -> bool:
    """Return whether the dimensions are a built-in chair's, since none were given."""
    return calibration.body.chair_id in BODIES and calibration.body.chair_id != calibration.chair_id


def mount_from_extrinsics(extrinsics: Extrinsics) -> CameraMount:
    """Return the fitted camera mount as numbers for the file."""
    pose = extrinsics.camera_from_laser
    rows = tuple((float(a), float(b), float(c)) for a, b, c in pose.rotation)
    x, y, z = (float(value) for value in pose.translation)
    return CameraMount(rotation=rows, translation=(x, y, z), rms_m=extrinsics.rms_m)


def content_hash(calibration: ChairCalibration) -> str:
    """Return the hexadecimal SHA-256 of the file's content, which bridge and board compare before they arm."""
    return _hash(_content(calibration))


def save_calibration(path: Path, calibration: ChairCalibration) -> None:
    """Write the file atomically.

    Raises:
        OutputError: it cannot be written.
        CalibrationError: the chair has no name.
    """
    if not calibration.chair_id.strip():
        raise CalibrationError("a calibration needs the chair's name: give the number on its type plate, for example")
    content = _content(calibration)
    write_json(path, {**content, "hash": _hash(content)})


def load_calibration(path: Path, chair_id: str | None = None) -> ChairCalibration:
    """Return the calibration in a file, which must be of the chair `chair_id` if that is given.

    Raises:
        CalibrationError: there is no such file.
        CalibrationDamaged: the file is not JSON, of another schema, altered (by its hash), or holds impossible values.
        CalibrationMismatch: it is the file of another chair.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise CalibrationError(f"cannot read {path}: {_unread(error)}") from error
    except UnicodeDecodeError as error:
        raise CalibrationDamaged(f"{path} is not text: calibrate the chair again") from error
    values = _refuse_altered(path, text)
    if chair_id is not None and values.get("chair_id") != chair_id:
        raise CalibrationMismatch(
            f"{path} belongs to chair '{values.get('chair_id')}', not '{chair_id}': take that chair's own file"
        )
    try:
        calibration = msgspec.convert(values, ChairCalibration)
    except (msgspec.ValidationError, ConfigError, CalibrationError) as error:
        raise CalibrationDamaged(f"{path} holds an impossible value ({error}): calibrate the chair again") from error
    unknown = _unknown_entry(values, msgspec.to_builtins(calibration))
    if unknown is not None:
        raise CalibrationDamaged(
            f"{path} holds the entry {unknown}, which schema {SCHEMA} does not know: update waychair"
        )
    return calibration


def update_calibration(path: Path, measured: ChairCalibration) -> ChairCalibration:
    """Add measurements to a chair's file, which is created if missing, and return its content now.

    Parts of `measured` that are None stay as they were in the file.

    Raises:
        CalibrationMismatch: it is the file of another chair.
        CalibrationDamaged: see `load_calibration`.
        OutputError: it cannot be written.
    """
    if path.exists():
        known = load_calibration(path, measured.chair_id)
        kept = {entry.name: getattr(known, entry.name) for entry in dataclasses.fields(measured)}
        measured = dataclasses.replace(
            measured,
            simulated=known.simulated or measured.simulated,
            **{name: value for name, value in kept.items() if getattr(measured, name) is None},
        )
    save_calibration(path, measured)
    return measured


def _unread(error: OSError) -> str:
    """Return why a chair's file cannot be read, and the advice."""
    if error.errno == errno.ENOENT:
        return f"{error.strerror}; run `waychair calibrate dac` first, or name the chair's own file"
    return os_error_text(error)


def _unknown_entry(values: Any, known: Any) -> str | None:
    """Return the name of a file's first unknown entry; missing entries of an older file have their defaults."""
    pairs: list[tuple[str, Any, Any]] = []
    if isinstance(values, dict) and isinstance(known, dict):
        strange = [name for name in values if name not in known]
        if strange:
            return str(strange[0])
        pairs = [(name, values[name], known[name]) for name in values]
    elif isinstance(values, list) and isinstance(known, list | tuple):
        pairs = [(str(index), *pair) for index, pair in enumerate(zip(values, known, strict=False))]
    found = ((name, _unknown_entry(value, here)) for name, value, here in pairs)
    return next((f"{name}.{deeper}" for name, deeper in found if deeper is not None), None)


def _refuse_altered(path: Path, text: str) -> dict[str, Any]:
    """Return the content of a file after checks that it is JSON, of this schema, and unaltered."""
    try:
        values = json.loads(text)
    except ValueError as error:
        raise CalibrationDamaged(f"{path} is not JSON ({error}): calibrate the chair again") from error
    if not isinstance(values, dict) or values.get("schema") != SCHEMA:
        schema = values.get("schema") if isinstance(values, dict) else None
        raise CalibrationDamaged(f"{path} is of schema {schema}, this waychair reads {SCHEMA}: calibrate again")
    found = values.pop("hash", None)
    if found != _hash(values):
        raise CalibrationDamaged(f"{path} was altered since it was written (its hash differs): calibrate again")
    del values["schema"]
    return values


def _content(calibration: ChairCalibration) -> Json:
    return {"schema": SCHEMA, **msgspec.to_builtins(calibration)}


def _hash(content: Json) -> str:
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(canonical.encode()).hexdigest()
