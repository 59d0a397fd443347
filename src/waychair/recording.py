"""Recorded drives: CARMEN logs and ROS 1 or ROS 2 bags in, ROS 2 bags out, and trajectories as TUM text."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from waychair.carmen import read_carmen, stamp_from_text
from waychair.errors import RecordingDamaged, RecordingError, RecordingNotFound
from waychair.files import write_text
from waychair.rosbag_reader import bag_suffix, read_bag
from waychair.rosbag_writer import RecordingWriter
from waychair.types import Pose2, SensorFrame, Trajectory

__all__ = ["Recording", "RecordingWriter", "read_recording", "read_tum", "write_tum"]


@dataclass(frozen=True, slots=True)
class Recording:
    """A recorded drive: each frame holds a scan, and in `wheels` the odometry since the frame before.

    Frames are in the order in which they were recorded; their stamps may step backwards. `source` says which format
    and topics they came from, `warnings` what was wrong with them, one sentence each.
    """

    path: Path
    frames: tuple[SensorFrame, ...]
    base_from_laser: Pose2
    source: str
    warnings: tuple[str, ...] = ()


def read_recording(
    path: Path,
    *,
    base_from_laser: Pose2 | None = None,
    scan_topic: str | None = None,
    odom_topic: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> Recording:
    """A CARMEN log (plain or gzipped) or a ROS 1 or ROS 2 bag (file or folder), told apart by its content.

    Without `base_from_laser` a bag's mount comes from its /tf_static, and a CARMEN log's base is the laser itself,
    with the laser's pose as odometry; with it the log's robot pose is the odometry. The topics are those of a bag
    (/scan and /odom when there is a choice). `progress` is told the part read, 0..1.

    Raises:
        RecordingNotFound: there is nothing at this path.
        RecordingDamaged: it is empty, of an unknown format, or damaged before its first scan.
        NoScans: it is whole but holds no laser scans; the message lists what it holds.
        RecordingError: it cannot be opened, or the odometry topic asked for is not there.
    """
    if path.is_dir():
        if not (path / "metadata.yaml").is_file():
            raise RecordingDamaged(
                f"{path} is no ROS 2 bag: it has no metadata.yaml; give the .mcap or .db3 file in it"
            )
        suffix: str | None = ""
    else:
        suffix = bag_suffix(_first_bytes(path))
    if suffix is not None:
        bag = read_bag(
            path,
            suffix,
            base_from_laser=base_from_laser,
            scan_topic=scan_topic,
            odom_topic=odom_topic,
            progress=progress,
        )
        return Recording(path, bag.frames, bag.base_from_laser, bag.source, bag.warnings)
    log = read_carmen(path.read_bytes(), str(path), of_robot=base_from_laser is not None, progress=progress)
    pose = "laser's" if base_from_laser is None else "robot's"
    source = f"CARMEN log, {log.kind} with the {pose} pose as odometry"
    return Recording(path, log.frames, base_from_laser or Pose2(), source, log.warnings)


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """Write `stamp x y z qx qy qz qw` lines in the trajectory's order (the text form of the TUM RGB-D benchmark).

    Stamps are exact seconds with six decimals, or nine where microseconds do not hold them; positions and quaternions
    have nine decimals.
    """
    lines = []
    for stamp_ns, (x, y, theta) in zip(trajectory.stamps_ns.tolist(), trajectory.poses.tolist(), strict=True):
        qz, qw = math.sin(theta / 2), math.cos(theta / 2)
        lines.append(f"{_text_from_stamp(stamp_ns)} {x:.9f} {y:.9f} 0 0 0 {qz:.9f} {qw:.9f}\n")
    write_text(path, "".join(lines))


def read_tum(path: Path) -> Trajectory:
    """The planar part of a TUM trajectory, in the file's order; empty lines and those that begin with # are skipped.

    Raises:
        RecordingNotFound: there is no such file.
        RecordingDamaged: a line does not hold eight finite numbers with a quaternion in the last four.
    """
    _first_bytes(path)
    stamps, poses = [], []
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), start=1):
        fields = line.split()
        if not fields or fields[0].startswith("#"):
            continue
        try:
            stamps.append(stamp_from_text(fields[0]))
            poses.append(_planar_pose(fields))
        except ValueError as error:
            raise RecordingDamaged(f"{path} line {number} is not `stamp x y z qx qy qz qw`: {error}") from error
    return Trajectory(np.array(stamps, dtype=np.int64), np.array(poses, dtype=np.float64).reshape(-1, 3))


def _planar_pose(fields: list[str]) -> tuple[float, float, float]:
    x, y, z, qx, qy, qz, qw = (float(field) for field in fields[1:])
    if not math.isfinite(x + y + z + qx + qy + qz + qw) or qx == qy == qz == qw == 0.0:
        raise ValueError("these numbers are no pose")
    return x, y, math.atan2(2 * (qw * qz + qx * qy), qw * qw + qx * qx - qy * qy - qz * qz)


def _text_from_stamp(stamp_ns: int) -> str:
    seconds, nanoseconds = divmod(abs(stamp_ns), 1_000_000_000)
    fraction = f"{nanoseconds:09d}" if nanoseconds % 1000 else f"{nanoseconds // 1000:06d}"
    return f"{'-' if stamp_ns < 0 else ''}{seconds}.{fraction}"


def _first_bytes(path: Path) -> bytes:
    """Enough of a file to tell its format by."""
    if not path.exists():
        raise RecordingNotFound(f"there is no recording at {path}; check the path")
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}") from error
    if not head:
        raise RecordingDamaged(f"{path} is empty; copy it again from its source")
    return head
