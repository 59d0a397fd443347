"""ROS 1 and ROS 2 bags read without ROS: laser scans, odometry and the laser's mount.

Messages are sensor_msgs/LaserScan, nav_msgs/Odometry and tf2_msgs/TFMessage; frames follow REP-105, ranges REP-117.
"""

from __future__ import annotations

import math
import tempfile
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_typestore

from waychair.errors import NoScans, RecordingDamaged, RecordingError
from waychair.geometry import interpolate
from waychair.topics import ODOMETRY, SCAN
from waychair.types import FloatArray, Odometry, Pose2, Pose3, Scan, SensorFrame, Twist

SCAN_TYPE = "sensor_msgs/msg/LaserScan"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
TRANSFORMS_TYPE = "tf2_msgs/msg/TFMessage"
STATIC_TRANSFORMS = "/tf_static"
GROUND_TRUTH = "/ground_truth/"
"""Simulators tell the truth on topics that begin so; nothing may be made of them unless they are asked for by name."""
BASE_FRAMES = ("base_link", "base_footprint")
"""Names of the base (REP-105, REP-120) when the odometry does not give it."""

SUFFIXES = {b"#ROSBAG V2.0": ".bag", b"\x89MCAP": ".mcap", b"SQLite format 3": ".db3"}
"""First bytes of the files that hold bags, and the ending each must have."""

_PLANAR = [0, 1, 5]  # x, y and yaw among x, y, z, roll, pitch, yaw
_PROGRESS_EVERY = 256  # messages
_LONGEST_REASON = 200  # characters


@dataclass(frozen=True, slots=True)
class BagContents:
    """The scans of a bag with the odometry since the one before, the laser's mount, and what was wrong with it."""

    frames: tuple[SensorFrame, ...]
    base_from_laser: Pose2
    source: str
    warnings: tuple[str, ...]


@dataclass(slots=True)
class _Messages:
    """What one pass through a bag collects, in the order of the bag."""

    scans: list[Scan] = field(default_factory=list)
    scan_frame: str = ""
    odometry: list[Odometry] = field(default_factory=list)
    base_frame: str = ""
    transforms: list[tuple[str, str, FloatArray]] = field(default_factory=list)  # parent, child, parent_from_child
    skipped: int = 0
    damage: str = ""


def bag_suffix(head: bytes) -> str | None:
    """`.bag`, `.mcap` or `.db3` by the first bytes of a file, None for anything else."""
    return next((suffix for magic, suffix in SUFFIXES.items() if head.startswith(magic)), None)


def read_bag(
    path: Path,
    suffix: str,
    *,
    base_from_laser: Pose2 | None = None,
    scan_topic: str | None = None,
    odom_topic: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> BagContents:
    """Every scan of a bag of the given kind ('' for the folder of a ROS 2 bag), in the order of the bag.

    A frame's `wheels` are the odometry messages since the previous frame, and last the odometry interpolated to the
    scan's stamp. Stamps are those of the headers. The mount comes from /tf_static unless it is given.

    Raises:
        NoScans: no topic holds laser scans, or not the one that was asked for; the topics are listed.
        RecordingDamaged: the bag cannot be opened or ends before its first scan.
        RecordingError: the odometry topic that was asked for is not there.
    """
    warnings: list[str] = []
    with _opened(path, suffix) as reader:
        scan = _chosen(path, reader, SCAN_TYPE, scan_topic, SCAN.name, warnings)
        if scan is None:
            asked = f"no {SCAN_TYPE} on {scan_topic}" if scan_topic else f"no {SCAN_TYPE}"
            advice = "choose another scan topic" if _of_type(reader, SCAN_TYPE) else "give a bag with laser scans"
            raise NoScans(f"{path} holds {asked}, only {_listing(reader)}; {advice}")
        odom = _chosen(path, reader, ODOMETRY_TYPE, odom_topic, ODOMETRY.name, warnings)
        if odom is None and odom_topic is not None:
            raise RecordingError(f"{path} holds no {ODOMETRY_TYPE} on {odom_topic}, only {_listing(reader)}")
        messages = _collect(path, reader, scan, odom, progress)
    if messages.damage:
        warnings.append(f"only what comes before the damage was read: {messages.damage}")
    if messages.skipped:
        warnings.append(f"{messages.skipped} scans without beams or angles, or odometry without a pose, were left out")
    mount = _mount(messages, warnings) if base_from_laser is None else base_from_laser
    frames = _frames(messages, warnings)
    source = f"ROS {'2' if reader.is2 else '1'} bag, scans {scan}, odometry {odom or 'none'}"
    return BagContents(frames, mount, source, tuple(warnings))


@contextmanager
def _opened(path: Path, suffix: str) -> Iterator[AnyReader]:
    """The bag, open; the library goes by the file's ending, so another ending gets a link with the right one."""
    with ExitStack() as stack:
        if path.suffix != suffix and not path.is_dir():
            link = Path(stack.enter_context(tempfile.TemporaryDirectory())) / f"bag{suffix}"
            link.symlink_to(path.resolve())
        else:
            link = path
        try:
            reader = AnyReader([link], default_typestore=get_typestore(Stores.ROS2_JAZZY))
            stack.enter_context(reader)
        # Damaged bytes raise whatever the parser stumbles over: struct, key, index, decode, sqlite and its own errors.
        except Exception as error:
            raise _damaged(path, error) from error
        yield reader


def _chosen(
    path: Path, reader: AnyReader, msgtype: str, asked: str | None, usual: str, warnings: list[str]
) -> str | None:
    """The topic that was asked for, else the usual one, else the fullest; None when there is none of this type."""
    counts = _of_type(reader, msgtype)
    if asked is not None:
        return next((topic for topic in counts if topic.strip("/") == asked.strip("/")), None)
    counts = {topic: count for topic, count in counts.items() if not topic.startswith(GROUND_TRUTH)}
    if not counts:
        return None
    if (name := f"/{usual}") in counts:
        return name
    best = max(counts, key=lambda topic: (counts[topic], topic))
    if len(counts) > 1:
        others = ", ".join(sorted(set(counts) - {best}))
        warnings.append(f"{best} was chosen among the {msgtype} topics of {path.name}; there are also {others}")
    return best


def _of_type(reader: AnyReader, msgtype: str) -> dict[str, int]:
    """Number of messages by topic."""
    counts: dict[str, int] = {}
    for connection in reader.connections:
        if connection.msgtype == msgtype:
            counts[connection.topic] = counts.get(connection.topic, 0) + connection.msgcount
    return counts


def _listing(reader: AnyReader) -> str:
    topics = sorted({f"{connection.topic} ({connection.msgtype})" for connection in reader.connections})
    return ", ".join(topics) or "no topics at all"


def _collect(
    path: Path, reader: AnyReader, scan: str, odom: str | None, progress: Callable[[float], None] | None
) -> _Messages:
    """One pass through the bag; what was read before a damaged place is kept."""
    wanted = {(scan, SCAN_TYPE), (odom, ODOMETRY_TYPE), (STATIC_TRANSFORMS, TRANSFORMS_TYPE)}
    connections = [c for c in reader.connections if (c.topic, c.msgtype) in wanted]
    total = max(1, sum(connection.msgcount for connection in connections))
    found = _Messages()
    try:
        for count, (connection, message) in enumerate(_messages(path, reader, connections)):
            _take(found, connection, message)
            if progress is not None and count % _PROGRESS_EVERY == 0:
                progress(min(1.0, count / total))
    except RecordingDamaged as error:
        if not found.scans:
            raise
        found.damage = str(error)
    if not found.scans:
        raise NoScans(f"the topic {scan} of {path} holds no usable scan; choose another one: {_listing(reader)}")
    if progress is not None:
        progress(1.0)
    return found


def _messages(path: Path, reader: AnyReader, connections: Sequence[Connection]) -> Iterator[tuple[Connection, Any]]:
    """The messages of some connections in the order of the bag."""
    raw = reader.messages(connections)
    while True:
        try:
            connection, _, data = next(raw)
            message = reader.deserialize(data, connection.msgtype)
        except StopIteration:
            return
        # As when it is opened: damaged bytes raise anything.
        except Exception as error:
            raise _damaged(path, error) from error
        yield connection, message


def _take(found: _Messages, connection: Connection, message: Any) -> None:
    if connection.msgtype == SCAN_TYPE:
        found.scan_frame = found.scan_frame or _frame_name(message.header.frame_id)
        scan = scan_from_message(message)
        found.scans += [scan] if scan else []
        found.skipped += not scan
    elif connection.msgtype == ODOMETRY_TYPE:
        found.base_frame = found.base_frame or _frame_name(message.child_frame_id)
        odometry = odometry_from_message(message)
        found.odometry += [odometry] if odometry else []
        found.skipped += not odometry
    else:
        for transform in message.transforms:
            pose = transform.transform
            parent, child = _frame_name(transform.header.frame_id), _frame_name(transform.child_frame_id)
            found.transforms.append((parent, child, _matrix(pose.translation, pose.rotation)))


def scan_from_message(message: Any) -> Scan | None:
    """A sensor_msgs/LaserScan with its angles turned to ascend; None when it has no beams or no angles."""
    step = float(message.angle_increment)
    ranges = np.array(message.ranges, dtype=np.float32)
    if len(ranges) < 2 or step == 0.0 or not math.isfinite(step + message.angle_min):
        return None
    scan = Scan(
        _stamp_ns(message.header.stamp),
        ranges,
        float(message.angle_min),
        step,
        float(message.time_increment),
        float(message.range_min),
        float(message.range_max),
    )
    return scan if step > 0 else _reversed(scan)


def _reversed(scan: Scan) -> Scan:
    """The same beams in the opposite order: the stamp moves to the beam that is now the first."""
    last = len(scan.ranges) - 1
    return replace(
        scan,
        stamp_ns=scan.stamp_ns + round(last * scan.time_step * 1e9),
        ranges=scan.ranges[::-1].copy(),
        angle_min=scan.angle_min + last * scan.angle_step,
        angle_step=-scan.angle_step,
        time_step=-scan.time_step if scan.time_step else 0.0,
    )


def _mirrored(scan: Scan) -> Scan:
    """The scan of a laser mounted upside down as one that stands upright would have made it."""
    return _reversed(replace(scan, angle_min=-scan.angle_min, angle_step=-scan.angle_step))


def odometry_from_message(message: Any) -> Odometry | None:
    """A nav_msgs/Odometry in the plane, None when its pose is no number; zeros as covariance mean that none is known."""
    twist = message.twist.twist
    pose = _pose3(_matrix(message.pose.pose.position, message.pose.pose.orientation)).planar()
    if not math.isfinite(pose.x + pose.y + pose.theta):
        return None
    covariance = np.array(message.pose.covariance, dtype=np.float64).reshape(6, 6)[np.ix_(_PLANAR, _PLANAR)]
    return Odometry(
        _stamp_ns(message.header.stamp),
        pose,
        Twist(float(twist.linear.x), float(twist.angular.z)),
        covariance if covariance.any() else None,
    )


def _frames(messages: _Messages, warnings: list[str]) -> tuple[SensorFrame, ...]:
    """A frame per scan with its odometry; scans outside the odometry's time are left out."""
    odometry = sorted(messages.odometry, key=lambda reading: reading.stamp_ns)
    stamps = [reading.stamp_ns for reading in odometry]
    scans = [scan for scan in messages.scans if odometry and stamps[0] <= scan.stamp_ns <= stamps[-1]]
    if not scans:
        why = "no odometry at the time of the scans" if odometry else f"no {ODOMETRY_TYPE}"
        warnings.append(f"the bag holds {why}: the motion must come from matching the scans alone")
        return tuple(SensorFrame(scan.stamp_ns, scan=scan) for scan in messages.scans)
    if len(scans) < len(messages.scans):
        missing = len(messages.scans) - len(scans)
        warnings.append(f"{missing} scans before the first or after the last odometry were left out")
    frames, done = [], 0
    for scan in scans:
        until = bisect_right(stamps, scan.stamp_ns)
        wheels = odometry[done:until]
        if stamps[until - 1] != scan.stamp_ns:
            wheels.append(_between(odometry[until - 1], odometry[until], scan.stamp_ns))
        elif not wheels:
            wheels = [odometry[until - 1]]  # two scans at one stamp
        frames.append(SensorFrame(scan.stamp_ns, scan=scan, wheels=tuple(wheels)))
        done = max(done, until)
    return tuple(frames)


def _between(before: Odometry, after: Odometry, stamp_ns: int) -> Odometry:
    """Odometry at a stamp between two readings: the pose and the speeds linearly, the later covariance."""
    part = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
    v = before.twist.v + part * (after.twist.v - before.twist.v)
    omega = before.twist.omega + part * (after.twist.omega - before.twist.omega)
    pose = interpolate(before.odom_from_base, after.odom_from_base, part)
    return Odometry(stamp_ns, pose, Twist(v, omega), after.covariance)


def _mount(messages: _Messages, warnings: list[str]) -> Pose2:
    """`base_from_laser` along the chain of static transforms; turns the scans of a laser that hangs upside down."""
    bases = (messages.base_frame,) if messages.base_frame else BASE_FRAMES
    laser = messages.scan_frame
    chains = [_chain(messages.transforms, base, laser) for base in bases]
    matrix = next((chain for chain in chains if chain is not None), None)
    if matrix is None:
        warnings.append(
            f"{STATIC_TRANSFORMS} has no way from {bases[0]} to '{laser}': the laser is taken to sit at the base; "
            "give its mount as base_from_laser"
        )
        return Pose2()
    upright = float(matrix[2, 2])
    if abs(upright) < math.cos(math.radians(5.0)):
        tilt = math.degrees(math.acos(min(1.0, abs(upright))))
        warnings.append(f"the laser '{laser}' is tilted by {tilt:.0f} degrees: its scans are taken as if it were level")
    if upright < 0.0:
        messages.scans = [_mirrored(scan) for scan in messages.scans]
    return _pose3(matrix).planar()


def _chain(transforms: Sequence[tuple[str, str, FloatArray]], base: str, laser: str) -> FloatArray | None:
    """`base_from_laser` (4, 4) through the tree of frames, walked from the base; None when they are not connected."""
    neighbours: dict[str, list[tuple[str, FloatArray]]] = {}
    for parent, child, parent_from_child in transforms:
        neighbours.setdefault(parent, []).append((child, parent_from_child))
        neighbours.setdefault(child, []).append((parent, np.asarray(np.linalg.inv(parent_from_child), np.float64)))
    known = {base: np.eye(4)}
    waiting = [base]
    while waiting and laser not in known:
        frame = waiting.pop()
        for other, frame_from_other in neighbours.get(frame, []):
            if other not in known:
                known[other] = known[frame] @ frame_from_other
                waiting.append(other)
    return known.get(laser)


def _matrix(translation: Any, rotation: Any) -> FloatArray:
    """(4, 4) homogeneous transform of a geometry_msgs vector and quaternion; a zero quaternion is no rotation."""
    x, y, z, w = rotation.x, rotation.y, rotation.z, rotation.w
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    x, y, z, w = (x / norm, y / norm, z / norm, w / norm) if norm > 0.0 else (0.0, 0.0, 0.0, 1.0)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), translation.x],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), translation.y],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), translation.z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def _pose3(matrix: FloatArray) -> Pose3:
    return Pose3(matrix[:3, :3], matrix[:3, 3])


def _stamp_ns(stamp: Any) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _frame_name(name: str) -> str:
    return name.lstrip("/")  # ROS 1 allowed a leading slash


def _damaged(path: Path, error: Exception) -> RecordingDamaged:
    reason = " ".join(f"{type(error).__name__}: {error}".split())[:_LONGEST_REASON].rstrip(":. ")
    repair = "repair it (rosbag reindex, ros2 bag reindex, mcap recover) or copy it again from its source"
    return RecordingDamaged(f"{path} is a damaged bag ({reason}); {repair}")
