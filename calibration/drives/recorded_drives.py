"""Calibrate a chair's wheels, inertial unit and camera from recordings of its drives."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.drives.camera_views import is_at_rest, nominal_mount, views_of_planes
from waychair.calibration.drives.recorded_sensors import imu_samples_of, wheel_ticks_of
from waychair.calibration.fits.camera_mount import Extrinsics, PlaneView, extrinsics_from_planes
from waychair.calibration.fits.imu_at_rest import ImuCalibration, imu_at_rest
from waychair.calibration.fits.wheels import WheelCalibration, wheels_from_drive
from waychair.errors import CalibrationError
from waychair.geometry import pose_from_array
from waychair.recordings.recording import read_recording, read_tum
from waychair.types import IntArray, Pose2, WheelTicks

MAPPED_STRETCH_NS = 2_000_000_000
"""Time between the mapped poses that the encoders are compared with.

Lidar poses are good to a centimetre: longer stretches reduce the relative error.
"""

_VIEWS_APART_NS = 500_000_000


def wheels_from_recording(recording: Path, trajectory: Path, body: ChairBody) -> WheelCalibration:
    """Fit the wheels to the encoders of a recorded drive and to its mapped poses, such as trajectory.tum.

    Raises:
        RecordingError: a file cannot be read, or the recording holds no wheels.
        CalibrationError: see `wheels_from_drive`; or the two files share no time.
    """
    ticks = wheel_ticks_of(recording, body.ticks_per_turn)
    path = read_tum(trajectory)
    order = np.argsort(path.stamps_ns, kind="stable")
    known = [(int(path.stamps_ns[k]), pose_from_array(path.poses[k])) for k in order]
    shared = [(stamp, pose) for stamp, pose in known if ticks[0].stamp_ns <= stamp <= ticks[-1].stamp_ns]
    if len(shared) < 2:
        raise CalibrationError(
            f"{trajectory} and {recording} share no time: give the trajectory made of this recording"
        )
    apart = thinned(shared, MAPPED_STRETCH_NS)
    stamps = np.array([stamp for stamp, _ in apart], np.int64)
    return wheels_from_drive(
        counts_at(ticks, stamps), np.array([pose.array() for _, pose in apart]), body.ticks_per_turn
    )


def imu_from_recording(recording: Path) -> ImuCalibration:
    """Return bias and noise of the inertial unit from a recording of a chair at rest; its axes must be the base's.

    Raises:
        RecordingError: the file cannot be read, or it holds no inertial unit.
        CalibrationError: see `imu_at_rest`.
    """
    return imu_at_rest(imu_samples_of(recording))


def camera_from_recording(path: Path, body: ChairBody) -> Extrinsics:
    """Return camera extrinsics from a recording of a chair that turned and rested by turns between bare walls.

    `body` gives the places of lidar and camera by tape measure. A picture counts if the chair rested: the scans before
    and after it agree.

    Raises:
        RecordingError: the recording cannot be read.
        CalibrationError: it holds no depth pictures, or none of a chair at rest; see `extrinsics_from_planes`.
    """
    recording = read_recording(path)
    scans = sorted((frame.scan for frame in recording.frames if frame.scan), key=lambda scan: scan.stamp_ns)
    stamps = np.array([scan.stamp_ns for scan in scans], np.int64)
    nominal = nominal_mount(body)
    views: list[PlaneView] = []
    pictures = next_ns = 0
    for picture in recording.pictures():
        pictures += 1
        at = int(np.searchsorted(stamps, picture.stamp_ns, side="right")) - 1
        if picture.stamp_ns < next_ns or not 0 <= at < len(scans) - 1 or not is_at_rest(scans[at], scans[at + 1]):
            continue
        next_ns = picture.stamp_ns + _VIEWS_APART_NS
        views += views_of_planes(picture, scans[at], body, nominal)
    if not views:
        raise CalibrationError(
            f"none of the {pictures} pictures with depth in {path} shows a wall or the floor from a chair at rest: "
            "in a room with bare walls, turn the chair, let it rest for a second, and repeat"
        )
    return extrinsics_from_planes(views, nominal)


def thinned(known: Sequence[tuple[int, Pose2]], apart_ns: int) -> list[tuple[int, Pose2]]:
    """Return the poses thinned to at least `apart_ns` between two."""
    kept: list[tuple[int, Pose2]] = []
    for stamp, pose in known:
        if not kept or stamp - kept[-1][0] >= apart_ns:
            kept.append((stamp, pose))
    return kept


def counts_at(ticks: Sequence[WheelTicks], stamps: IntArray) -> IntArray:
    """Return unwrapped encoder counts (N, 2) at these stamps, by linear interpolation."""
    known = np.array([reading.stamp_ns for reading in ticks], np.int64)
    counts = np.array([(reading.left, reading.right) for reading in ticks], np.int64)
    steps = (np.diff(counts, axis=0, prepend=counts[:1]) + 2**31) % 2**32 - 2**31
    whole = np.cumsum(steps, axis=0)
    at = [np.interp(stamps, known, whole[:, wheel]) for wheel in (0, 1)]
    return np.round(np.stack(at, axis=1)).astype(np.int64)
