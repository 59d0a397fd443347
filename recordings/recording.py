"""Reading recorded drives of every supported format, and writing and reading TUM trajectories.

Formats: CARMEN and CoreSLAM logs, rows of scans, ROS 1 and ROS 2 bags, folders of colour and depth pictures. ROS 2 bags
are written by `RecordingWriter`.
"""

from __future__ import annotations

import math
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from waychair.config import Settings, setting
from waychair.errors import NoScans, RecordingDamaged, RecordingError, RecordingNotFound
from waychair.files import write_text
from waychair.recordings.bags.rosbag_file import bag_suffix
from waychair.recordings.bags.rosbag_pictures import read_camera_mount, read_pictures
from waychair.recordings.bags.rosbag_reader import BagSettings, read_bag
from waychair.recordings.bags.rosbag_writer import RecordingWriter
from waychair.recordings.rgbd_folders import RgbdSettings, frames_of, is_rgbd_folder, read_rgbd_folder
from waychair.recordings.scans import LaserMount, count_silent_scans, mirrored, mount_from_text
from waychair.recordings.text.carmen import GZIP_MAGIC, decompressed_text, read_carmen, stamp_from_text
from waychair.recordings.text.coreslam import is_coreslam, read_coreslam
from waychair.recordings.text.laser_text import is_laser_text, read_laser_text
from waychair.types import Pose2, Pose3, RgbdFrame, SensorFrame, Trajectory, Trajectory3

__all__ = ["InputSettings", "Recording", "RecordingWriter", "read_recording", "read_tum", "write_tum"]

_HEAD = 1 << 16  # bytes; the first data line of a text file lies within them


@dataclass(frozen=True, slots=True)
class InputSettings(Settings):
    """How to read a recording: its topics, and facts that the recording itself does not state."""

    mounts: tuple[str, ...] = setting(
        (), "m, rad", "mount of the laser in the base as X,Y,YAW[,upside-down], one per scan topic; empty: as recorded"
    )
    bag: BagSettings = field(default_factory=BagSettings)
    rgbd: RgbdSettings = field(default_factory=RgbdSettings)

    def laser_mounts(self) -> tuple[LaserMount, ...]:
        """Return the mounts that `mounts` describes.

        Raises:
            ConfigError: a mount has a wrong form.
        """
        return tuple(mount_from_text(text) for text in self.mounts)


@dataclass(frozen=True, slots=True)
class Recording:
    """A recorded drive: each frame holds a scan, and in `wheels` and `imu` the readings since the frame before.

    A folder of pictures has no frames, only `pictures()`.

    Frames are in recording order; their stamps may step backwards. `source` names the format and the topics, `warnings`
    lists the defects, one sentence each. `pictures()` reads the recording again and decodes one picture with depth at a
    time; `unread` counts unreadable pictures by reason. `picture_count` is the number of pictures, 0 if unknown.
    `camera_mount()` reads the pose of a bag's optical frame in the base, None if the bag does not state it.
    """

    path: Path
    frames: tuple[SensorFrame, ...]
    base_from_laser: Pose2
    source: str
    warnings: tuple[str, ...] = ()
    pictures: Callable[[], Iterator[RgbdFrame]] = lambda: iter(())
    picture_count: int = 0
    unread: Counter[str] = field(default_factory=Counter)
    camera_mount: Callable[[], Pose3 | None] = lambda: None


def read_recording(
    path: Path,
    settings: InputSettings | None = None,
    *,
    base_from_laser: Pose2 | None = None,
    progress: Callable[[float], None] | None = None,
) -> Recording:
    """Return the recording at a path; its format is recognised by content.

    `base_from_laser` overrides the settings with one upright mount. Without a mount, a bag's mount comes from its /tf,
    and a CARMEN log's base is the laser, with the laser's pose as odometry. With a mount, a CARMEN log's odometry is its
    robot pose. `progress` gets the part read, 0..1.

    Raises:
        RecordingNotFound: the path does not exist.
        RecordingDamaged: the recording is empty, of an unknown format, or damaged so that no scan can be read.
        NoScans: the recording holds no laser scans, or only scans without a distance; the message lists its topics.
        RecordingError: the recording cannot be opened, or lacks a topic that the settings name.
    """
    settings = settings or InputSettings()
    mounts = settings.laser_mounts() if base_from_laser is None else (LaserMount(base_from_laser),)
    if is_rgbd_folder(path):
        folder, unread = read_rgbd_folder(path, settings.rgbd), Counter[str]()
        pictures = partial(frames_of, folder, unread)
        return Recording(
            path=path,
            frames=(),
            base_from_laser=Pose2(),
            source=folder.source,
            warnings=folder.warnings,
            pictures=pictures,
            picture_count=len(folder.pairs),
            unread=unread,
        )
    suffix = _bag_suffix(path)
    if suffix is not None:
        bag = read_bag(path, suffix, settings.bag, mounts, progress)
        pictures = partial(read_pictures, path, suffix, settings.bag)
        mount = partial(read_camera_mount, path, suffix, settings.bag)
        recording = Recording(
            path=path,
            frames=bag.frames,
            base_from_laser=bag.base_from_laser,
            source=bag.source,
            warnings=bag.warnings,
            pictures=pictures,
            camera_mount=mount,
        )
        return _checked(recording)
    if len(mounts) > 1:
        raise RecordingError(f"{len(mounts)} mounts are given for the one laser of {path}; give one")
    recording = _read_text(path, mounts[0] if mounts else None, progress)
    if mounts and mounts[0].upside_down:
        turned = [replace(frame, scan=mirrored(frame.scan)) for frame in recording.frames if frame.scan is not None]
        recording = replace(recording, frames=tuple(turned))
    return _checked(recording)


def _read_text(path: Path, mount: LaserMount | None, progress: Callable[[float], None] | None) -> Recording:
    """Read a text log; the first line that is not a comment tells the format."""
    data = path.read_bytes()
    first = _first_line(data)
    base_from_laser = mount.base_from_laser if mount is not None else Pose2()
    if is_laser_text(first):
        text, warnings = decompressed_text(data, str(path))
        rows = read_laser_text(text, str(path), progress)
        return Recording(path, rows.frames, base_from_laser, "rows of scans, no odometry", (*warnings, *rows.warnings))
    if is_coreslam(first):
        text, warnings = decompressed_text(data, str(path))
        log = read_coreslam(text, str(path), progress)
        at = base_from_laser if mount is not None else log.base_from_laser
        return Recording(path, log.frames, at, "CoreSLAM log, odometry of its encoders", (*warnings, *log.warnings))
    carmen = read_carmen(data, str(path), of_robot=mount is not None, progress=progress)
    pose = "laser's" if mount is None else "robot's"
    source = f"CARMEN log, {carmen.kind} with the {pose} pose as odometry"
    return Recording(path, carmen.frames, base_from_laser, source, carmen.warnings)


def _checked(recording: Recording) -> Recording:
    """Return the recording with warnings about scans without a distance and about stamps that step backwards.

    Raises:
        NoScans: no scan holds a distance.
    """
    count = len(recording.frames)
    blind = count_silent_scans([frame.scan for frame in recording.frames if frame.scan is not None])
    if blind == count:
        raise NoScans(
            f"none of the {count} scans of {recording.path} holds a distance (all are nan, infinite or zero): "
            "check the laser and its driver"
        )
    warnings = list(recording.warnings)
    if blind:
        warnings.append(f"{blind} of {count} scans hold no distance at all (nan, infinite or zero)")
    stamps = np.array([frame.stamp_ns for frame in recording.frames], np.int64)
    backwards = int((np.diff(stamps) < 0).sum())
    if backwards and not any("step backwards" in warning for warning in warnings):
        warnings.append(f"stamps step backwards {backwards} times: the scans are kept in the order of the recording")
    return replace(recording, warnings=tuple(warnings))


def _bag_suffix(path: Path) -> str | None:
    """Return the kind of bag ('' for a folder); None for a file that is not a bag."""
    if not path.is_dir():
        return bag_suffix(_first_bytes(path))
    storages = [file for file in path.iterdir() if file.suffix in (".mcap", ".db3")]
    if not (path / "metadata.yaml").is_file() and not storages:
        raise RecordingDamaged(
            f"{path} is not a recording: it has no metadata.yaml, .mcap or .db3 of a ROS 2 bag, and no pictures, which lie in "
            "rgb/ and depth/ or are named frame-N.color.png and frame-N.depth.png"
        )
    return ""


def _first_line(data: bytes) -> bytes:
    head = data[:_HEAD]
    if head.startswith(GZIP_MAGIC):
        try:
            head = zlib.decompressobj(wbits=31).decompress(head, _HEAD)
        except zlib.error:
            return b""
    lines = (line for line in head.split(b"\n") if line.strip() and not line.startswith(b"#"))
    return next(lines, b"")


def write_tum(path: Path, trajectory: Trajectory | Trajectory3) -> None:
    """Write `stamp x y z qx qy qz qw` lines in the trajectory's order (the text form of the TUM RGB-D benchmark).

    Stamps are exact seconds with six decimals, or nine where six are not exact; positions and quaternions have nine
    decimals.
    """
    lines = []
    if isinstance(trajectory, Trajectory3):
        from scipy.spatial.transform import Rotation

        turns = Rotation.from_matrix(trajectory.rotations).as_quat() if len(trajectory.stamps_ns) else ()
        for stamp_ns, position, turn in zip(trajectory.stamps_ns.tolist(), trajectory.positions, turns, strict=True):
            numbers = " ".join(f"{value:.9f}" for value in (*position, *turn))
            lines.append(f"{_text_from_stamp(stamp_ns)} {numbers}\n")
        write_text(path, "".join(lines))
        return
    for stamp_ns, (x, y, theta) in zip(trajectory.stamps_ns.tolist(), trajectory.poses.tolist(), strict=True):
        qz, qw = math.sin(theta / 2), math.cos(theta / 2)
        lines.append(f"{_text_from_stamp(stamp_ns)} {x:.9f} {y:.9f} 0 0 0 {qz:.9f} {qw:.9f}\n")
    write_text(path, "".join(lines))


def read_tum(path: Path) -> Trajectory:
    """Return the planar part of a TUM trajectory in file order; empty lines and lines that begin with # are skipped.

    Raises:
        RecordingNotFound: the file does not exist.
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
        raise ValueError("these numbers are not a pose")
    return x, y, math.atan2(2 * (qw * qz + qx * qy), qw * qw + qx * qx - qy * qy - qz * qz)


def _text_from_stamp(stamp_ns: int) -> str:
    seconds, nanoseconds = divmod(abs(stamp_ns), 1_000_000_000)
    fraction = f"{nanoseconds:09d}" if nanoseconds % 1000 else f"{nanoseconds // 1000:06d}"
    return f"{'-' if stamp_ns < 0 else ''}{seconds}.{fraction}"


def _first_bytes(path: Path) -> bytes:
    """Return the first bytes of a file, which identify its format."""
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
