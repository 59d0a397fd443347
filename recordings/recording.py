"""Reading recorded drives of every supported format, and writing and reading TUM trajectories.

Formats: CARMEN and CoreSLAM logs, rows of scans, ROS 1 and ROS 2 bags, folders of colour and depth pictures. ROS 2 bags
are written by `bags.rosbag_writer.RecordingWriter`.
"""

from __future__ import annotations

import math
import tempfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from waychair.config import Settings, setting
from waychair.errors import NoScans, RecordingError, RecordingUnknown
from waychair.files import write_text
from waychair.geometry import quaternions, rotations
from waychair.recordings.bags.bag_parts import BagFiles
from waychair.recordings.bags.bag_settings import NOT_USED, BagSettings
from waychair.recordings.other_files import likely_kind
from waychair.recordings.packed import packing_of, unpack
from waychair.recordings.plausibility.findings import Finding
from waychair.recordings.plausibility.plausible_scans import without_false_ranges
from waychair.recordings.recording_files import RecordingFiles, find_recording, text_head
from waychair.recordings.rgbd_folders import RgbdSettings, frames_of, read_rgbd_folder
from waychair.recordings.scans import LaserMount, count_silent_scans, mirrored, mount_from_text
from waychair.recordings.stamps import read_pose_rows
from waychair.recordings.text.carmen import GZIP_MAGIC, decompressed_text, read_carmen
from waychair.recordings.text.coreslam import is_coreslam, read_coreslam
from waychair.recordings.text.laser_text import is_laser_text, read_laser_text
from waychair.types import Pose2, Pose3, RgbdFrame, SensorFrame, Trajectory, Trajectory3

_HEAD = 1 << 16  # bytes; the first data line of a text file lies within them


@dataclass(frozen=True, slots=True)
class InputSettings(Settings):
    """How to read a recording: its topics, and facts that the recording itself does not state."""

    mounts: tuple[str, ...] = setting(
        (),
        "m, rad",
        "mount of the laser in the base as X,Y[,Z],YAW[,upside-down], one per scan topic; empty: as recorded",
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
    lists the defects, one sentence each, those of `findings` among them. `pictures()` reads the recording again and
    decodes one picture with depth at a time; `unread` counts unreadable pictures by reason. `picture_count` is the number
    of pictures, 0 if unknown.
    `camera_mount()` reads the pose of a bag's optical frame in the base, None if the bag does not state it. `parts` are
    the files and folders that were read. `listed` is the number of pairs of pictures in a folder's lists, lost ones
    among them.
    """

    path: Path
    frames: tuple[SensorFrame, ...]
    base_from_laser: Pose2
    source: str
    warnings: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    pictures: Callable[[], Iterator[RgbdFrame]] = lambda: iter(())
    picture_count: int = 0
    unread: Counter[str] = field(default_factory=Counter)
    camera_mount: Callable[[], Pose3 | None] = lambda: None
    parts: tuple[Path, ...] = ()
    listed: int = 0


def read_recording(
    path: Path | Sequence[Path],
    settings: InputSettings | None = None,
    *,
    base_from_laser: Pose2 | None = None,
    progress: Callable[[float], None] | None = None,
) -> Recording:
    """Return the recording at a path, or the one of which several files are the parts; the content tells its format.

    `base_from_laser` overrides the settings with one upright mount. Without a mount, a bag's mount comes from its /tf,
    and a CARMEN log's base is the laser, with the laser's pose as odometry. With a mount, a CARMEN log's odometry is its
    robot pose. `progress` gets the part read, 0..1.

    Raises:
        RecordingNotFound: the path does not exist.
        RecordingUnknown: the file is of another kind; the sentence names it.
        RecordingDamaged: the recording is empty, or damaged so that no scan can be read.
        NoScans: the recording holds no laser scans, or only scans without a distance; the message lists its topics.
        RecordingError: the recording cannot be opened, lacks a topic that the settings name, or the files are no parts
            of one recording.
    """
    settings = settings or InputSettings()
    mounts = settings.laser_mounts() if base_from_laser is None else (LaserMount(base_from_laser),)
    files = find_recording([path] if isinstance(path, Path) else path)
    if files.pictures:
        return _read_folder(files, settings)
    if files.bag is not None:
        return _checked(_read_bag(files, files.bag, settings, mounts, progress))
    if len(mounts) > 1:
        raise RecordingError(f"{len(mounts)} mounts are given for the one laser of {files.path}; give one")
    recording = _without_codes(_read_text(files.path, mounts[0] if mounts else None, progress))
    if settings.bag.odom_topic == NOT_USED:
        recording = replace(recording, frames=tuple(replace(frame, wheels=()) for frame in recording.frames))
    recording = replace(recording, warnings=(*files.warnings, *recording.warnings), parts=files.parts)
    if mounts and mounts[0].upside_down:
        turned = [replace(frame, scan=mirrored(frame.scan)) for frame in recording.frames if frame.scan is not None]
        recording = replace(recording, frames=tuple(turned))
    return _checked(recording)


def _read_bag(
    files: RecordingFiles,
    bag_files: BagFiles,
    settings: InputSettings,
    mounts: Sequence[LaserMount],
    progress: Callable[[float], None] | None,
) -> Recording:
    """Read the files of a bag; only here the bag libraries are loaded."""
    from waychair.recordings.bags.rosbag_pictures import read_camera_mount, read_pictures
    from waychair.recordings.bags.rosbag_reader import read_bag

    bag = read_bag(bag_files, settings.bag, mounts, progress)
    return Recording(
        path=files.path,
        frames=bag.frames,
        base_from_laser=bag.base_from_laser,
        source=bag.source,
        warnings=(*files.warnings, *bag.warnings),
        findings=bag.findings,
        pictures=partial(read_pictures, bag_files, settings.bag, bag.other_robots),
        camera_mount=partial(read_camera_mount, bag_files, settings.bag, bag.other_robots),
        parts=files.parts,
    )


def _read_folder(files: RecordingFiles, settings: InputSettings) -> Recording:
    """Read a folder of pictures."""
    folder, unread = read_rgbd_folder(files.path, settings.rgbd), Counter[str]()
    return Recording(
        path=files.path,
        frames=(),
        base_from_laser=Pose2(),
        source=folder.source,
        warnings=(*files.warnings, *folder.warnings),
        pictures=partial(frames_of, folder, unread),
        picture_count=len(folder.pairs),
        unread=unread,
        parts=files.parts,
        listed=folder.listed,
    )


def _read_text(path: Path, mount: LaserMount | None, progress: Callable[[float], None] | None) -> Recording:
    """Read a text log; the first line that is not a comment tells the format."""
    data, cut = _text_of(path)
    first = _first_line(data)
    base_from_laser = mount.base_from_laser if mount is not None else Pose2()
    if is_laser_text(first):
        text, warnings = decompressed_text(data, str(path))
        rows = read_laser_text(text, str(path), progress)
        told = (*cut, *warnings, *rows.warnings)
        return Recording(path, rows.frames, base_from_laser, "rows of scans, no odometry", told)
    if is_coreslam(first):
        text, warnings = decompressed_text(data, str(path))
        log = read_coreslam(text, str(path), progress)
        at = base_from_laser if mount is not None else log.base_from_laser
        told = (*cut, *warnings, *log.warnings)
        return Recording(path, log.frames, at, "CoreSLAM log, odometry of its encoders", told)
    try:
        carmen = read_carmen(data, str(path), of_robot=mount is not None, progress=progress)
    except RecordingUnknown:
        kind = likely_kind(path, text_head(path))
        if kind is None:
            raise
        raise RecordingUnknown(kind.sentence(path)) from None
    pose = "laser's" if mount is None else "robot's"
    source = f"CARMEN log, {carmen.kind} with the {pose} pose as odometry"
    return Recording(path, carmen.frames, base_from_laser, source, (*cut, *carmen.warnings))


def _without_codes(recording: Recording) -> Recording:
    """Return the recording with +inf in place of the lidar's codes for "nothing seen", and the finding about them."""
    scanned = [index for index, frame in enumerate(recording.frames) if frame.scan is not None]
    scans = [scan for frame in recording.frames if (scan := frame.scan) is not None]
    cleared, findings = without_false_ranges("lidar", scans)
    frames = list(recording.frames)
    for index, scan in zip(scanned, cleared, strict=True):
        frames[index] = replace(frames[index], scan=scan)
    return replace(recording, frames=tuple(frames), findings=(*recording.findings, *findings))


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
    warnings = [*recording.warnings, *(finding.sentence() for finding in recording.findings)]
    if blind:
        warnings.append(f"{blind} of {count} scans hold no distance at all (nan, infinite or zero)")
    stamps = np.array([frame.stamp_ns for frame in recording.frames], np.int64)
    backwards = int((np.diff(stamps) < 0).sum())
    if backwards and not any("step backwards" in warning for warning in warnings):
        warnings.append(f"stamps step backwards {backwards} times: the scans are kept in the order of the recording")
    return replace(recording, warnings=tuple(warnings))


def _text_of(path: Path) -> tuple[bytes, list[str]]:
    """Return the bytes of a text file, decompressed unless by gzip, and a warning where its end is missing."""
    packing = packing_of(text := path.read_bytes())
    if packing is None or text.startswith(GZIP_MAGIC):
        return text, []
    with tempfile.TemporaryDirectory() as work:
        reason = unpack(path, packing, Path(work) / "text")
        text = (Path(work) / "text").read_bytes()
    cut = f"the {packing.name} file is cut short or damaged ({reason}): only the data before that was read"
    return text, [cut] if reason else []


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
        turns = quaternions(trajectory.rotations)
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
    """Return the planar part of a TUM trajectory in file order (see `read_tum_in_space`).

    Raises:
        RecordingNotFound: the file does not exist.
        RecordingDamaged: a line does not hold eight finite numbers with a quaternion in the last four.
    """
    return planar_part(read_tum_in_space(path))


def planar_part(trajectory: Trajectory3) -> Trajectory:
    """Return x, y and yaw of a trajectory in space."""
    turns = trajectory.rotations
    theta = np.arctan2(turns[:, 1, 0], turns[:, 0, 0])
    return Trajectory(trajectory.stamps_ns, np.column_stack([trajectory.positions[:, :2], theta]))


def read_tum_in_space(path: Path) -> Trajectory3:
    """Return a TUM trajectory in file order; stamps are in seconds, or in ms, us or ns by their size.

    Raises:
        RecordingNotFound: the file does not exist.
        RecordingDamaged: a line does not hold eight finite numbers with a quaternion in the last four.
    """
    stamps, table = read_pose_rows(path)
    return Trajectory3(stamps, rotations(table[:, 3:]), table[:, :3])


def _text_from_stamp(stamp_ns: int) -> str:
    seconds, nanoseconds = divmod(abs(stamp_ns), 1_000_000_000)
    fraction = f"{nanoseconds:09d}" if nanoseconds % 1000 else f"{nanoseconds // 1000:06d}"
    return f"{'-' if stamp_ns < 0 else ''}{seconds}.{fraction}"
