"""Reading ROS 1 and ROS 2 bags without ROS: scans of lasers or point clouds, odometry, IMU, and sensor mounts.

Messages are sensor_msgs/LaserScan, PointCloud2 and Imu, nav_msgs/Odometry and tf2_msgs/TFMessage; frames follow
REP-105, ranges REP-117. `rosbag_pictures` reads the pictures on demand.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Connection

from waychair.config import Settings, setting
from waychair.errors import NoScans, RecordingDamaged, RecordingError
from waychair.geometry import in_space, interpolate
from waychair.recordings.bags.ros_decoding import (
    cloud_from_message,
    imu_from_message,
    odometry_from_message,
    scan_from_message,
)
from waychair.recordings.bags.ros_transforms import BASE_FRAMES, TransformTree, frame_name, planar, stamp_ns
from waychair.recordings.bags.rosbag_file import (
    BagFile,
    counts_by_topic,
    iterate_messages,
    open_bag,
    salvage_bag,
    topic_list,
)
from waychair.recordings.scan_merging import OdometryInterpolation, merged_scans
from waychair.recordings.scans import LaserMount, mirrored, scan_from_points
from waychair.topics import IMU, ODOMETRY, SCAN
from waychair.types import FloatArray, ImuSample, Odometry, Pose2, Scan, SensorFrame, Twist

SCAN_TYPE, CLOUD_TYPE = "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/PointCloud2"
ODOMETRY_TYPE, IMU_TYPE = "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu"
TRANSFORM_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
GROUND_TRUTH = "/ground_truth/"
"""Prefix of a simulator's true poses. These topics are used only if the settings name them."""

CLOUD_RANGE_MIN, CLOUD_RANGE_MAX = 0.3, 30.0  # m; points of a cloud that are nearer or farther are left out
BEAM_STEP = math.radians(0.25)  # between beams of scans that are made from clouds or from several lasers
SCAN_SPREAD = 0.1  # s; scans of several lasers up to this far apart are merged

_LEVEL = math.cos(math.radians(5.0))
_PROGRESS_EVERY = 256  # messages


@dataclass(frozen=True, slots=True)
class BagSettings(Settings):
    """The topics and frames to read from a bag; an empty name means the usual one, else the best guess."""

    scan_topics: tuple[str, ...] = setting(
        (), "", "topics of the scans or point clouds to map; several are merged into one scan; empty: guessed"
    )
    odom_topic: str = setting("", "", "topic of the odometry; empty: guessed, or /tf if no topic has any")
    imu_topic: str = setting("", "", "topic of the IMU; empty: guessed")
    colour_topic: str = setting("", "", "topic of the colour or grey pictures; empty: guessed")
    depth_topic: str = setting("", "", "topic of the depth pictures that are registered to colour; empty: guessed")
    base_frame: str = setting("", "", "frame of the chair in the bag, the parent of the sensor mounts; empty: guessed")
    cloud_low: float = setting(
        0.3, "m", "lowest height of point-cloud points that count as obstacles; larger: less floor, fewer low objects",
        low=-10, high=10,
    )  # fmt: skip
    cloud_high: float = setting(
        1.2, "m", "largest height of point-cloud points that count as obstacles; larger: more overhanging objects",
        low=-10, high=10,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class BagContents:
    """The scans of a bag, each with the odometry and IMU since the one before; the laser's mount; the warnings."""

    frames: tuple[SensorFrame, ...]
    base_from_laser: Pose2
    source: str
    warnings: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Topics:
    scans: tuple[str, ...]
    clouds: tuple[str, ...]
    odom: str | None
    imu: str | None


@dataclass(slots=True)
class _BagMessages:
    """Messages collected from a bag, in bag order."""

    tree: TransformTree = field(default_factory=TransformTree)
    scans: dict[str, list[Scan]] = field(default_factory=dict)
    scan_frames: dict[str, str] = field(default_factory=dict)
    slices_at: dict[str, Pose2] = field(default_factory=dict)
    odometry: list[Odometry] = field(default_factory=list)
    odometry_base: str = ""
    imu: list[ImuSample] = field(default_factory=list)
    imu_frame: str = ""
    skipped: int = 0
    unstamped: int = 0


def read_bag(
    path: Path,
    suffix: str,
    settings: BagSettings,
    mounts: Sequence[LaserMount] = (),
    progress: Callable[[float], None] | None = None,
) -> BagContents:
    """Return every scan of a bag of the given kind ('' for the folder of a ROS 2 bag), in bag order.

    A frame's `wheels` are the odometry messages since the previous frame, followed by the odometry interpolated to the
    scan's stamp. Its `imu` are the samples since then, in the axes of the base if /tf holds the IMU's mount. Stamps
    are those of the headers. Mounts come from /tf_static and /tf unless given, one for each scan topic.

    Raises:
        NoScans: no topic, or not the one that the settings name, holds scans; the message lists the topics.
        RecordingDamaged: the bag is damaged, and no scan in it can be read.
        RecordingError: a topic that the settings name is missing.
    """
    try:
        with open_bag(path, suffix) as bag:
            return _read(path, bag, settings, mounts, progress)
    except RecordingDamaged as damage:
        rest = salvage_bag(path, suffix, damage)
        lost: Counter[str] = Counter()
        try:
            contents = _read(path=path, bag=rest, settings=settings, mounts=mounts, progress=progress, lost=lost)
        except NoScans:
            raise damage from None
        # A missing end is the reason of the damage, and no loss of messages.
        losses = [f"{count} damaged {kind}" for kind, count in sorted((lost + rest.lost).items()) if kind != "end"]
        left_out = f", without {' and '.join(losses)}" if losses else ""
        reason = str(damage).partition(" is a damaged bag ")[2].partition("; ")[0]
        warning = (
            f"{path} is damaged {reason}: only the {len(contents.frames)} scans that can be read are used{left_out}"
        )
        return replace(contents, warnings=(warning, *contents.warnings))


def _read(
    path: Path,
    bag: BagFile,
    settings: BagSettings,
    mounts: Sequence[LaserMount],
    progress: Callable[[float], None] | None,
    lost: Counter[str] | None = None,
) -> BagContents:
    warnings: list[str] = []
    topics = _choose(path, bag, settings, warnings)
    if len(mounts) > len(topics.scans):
        raise RecordingError(
            f"{len(mounts)} mounts are given for the {len(topics.scans)} scan topics of {path}; give one for each"
        )
    found = _collect(path=path, bag=bag, topics=topics, settings=settings, mounts=mounts, progress=progress, lost=lost)
    if found.skipped:
        warnings.append(f"{found.skipped} scans without beams or angles, or odometry without a pose, were left out")
    if found.unstamped:
        warnings.append(f"{found.unstamped} messages have no stamp: their time of recording is used instead")
    base = _base_frame(found, settings)
    odometry, name = _odometry(found, topics, base)
    scans, mount = _scans(
        found=found, topics=topics, base=base, odometry=odometry, mounts=mounts, settings=settings, warnings=warnings
    )
    frames = _frames(scans, odometry, _in_base_axes(found, base, warnings), warnings)
    source = f"ROS {'2' if bag.is2 else '1'} bag, scans {' and '.join(topics.scans)}, odometry {name}"
    return BagContents(frames, mount, source + (f", IMU {topics.imu}" if found.imu else ""), tuple(warnings))


def _choose(path: Path, bag: BagFile, settings: BagSettings, warnings: list[str]) -> _Topics:
    """Return the topics that the settings name, else the usual ones, else those with the most messages."""
    scans = _chosen_scans(path, bag, settings.scan_topics, warnings)
    odom = _chosen(
        path=path, bag=bag, msgtype=ODOMETRY_TYPE, asked=settings.odom_topic, usual=ODOMETRY.name, warnings=warnings
    )
    imu = _chosen(path=path, bag=bag, msgtype=IMU_TYPE, asked=settings.imu_topic, usual=IMU.name, warnings=warnings)
    for asked, chosen, kind in ((settings.odom_topic, odom, ODOMETRY_TYPE), (settings.imu_topic, imu, IMU_TYPE)):
        if asked and chosen is None:
            raise RecordingError(f"{path} holds no {kind} on {asked}, only {topic_list(bag)}")
    clouds = counts_by_topic(bag, CLOUD_TYPE)
    return _Topics(scans, tuple(topic for topic in scans if topic in clouds), odom, imu)


def _chosen_scans(path: Path, bag: BagFile, asked: Sequence[str], warnings: list[str]) -> tuple[str, ...]:
    if not asked:
        usual = _chosen(path=path, bag=bag, msgtype=SCAN_TYPE, asked="", usual=SCAN.name, warnings=warnings) or _chosen(
            path=path, bag=bag, msgtype=CLOUD_TYPE, asked="", usual="", warnings=warnings
        )
        if usual is None:
            raise NoScans(f"{path} holds no {SCAN_TYPE}, only {topic_list(bag)}; give a bag with laser scans")
        return (usual,)
    known = counts_by_topic(bag, SCAN_TYPE, CLOUD_TYPE)
    chosen = []
    for name in asked:
        topic = next((topic for topic in known if topic.strip("/") == name.strip("/")), None)
        if topic is None:
            advice = "choose another scan topic" if known else "give a bag with laser scans"
            raise NoScans(f"{path} holds no {SCAN_TYPE} on {name}, only {topic_list(bag)}; {advice}")
        chosen.append(topic)
    return tuple(dict.fromkeys(chosen))


def _chosen(path: Path, bag: BagFile, msgtype: str, asked: str, usual: str, warnings: list[str]) -> str | None:
    counts = counts_by_topic(bag, msgtype)
    if asked:
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


def _collect(
    path: Path,
    bag: BagFile,
    topics: _Topics,
    settings: BagSettings,
    mounts: Sequence[LaserMount],
    progress: Callable[[float], None] | None,
    lost: Counter[str] | None,
) -> _BagMessages:
    """Collect the messages in one pass, or in two where point clouds need all mounts before they can be sliced."""
    small = [c for c in bag.connections if c.msgtype in TRANSFORM_TYPES or c.topic in (topics.odom, topics.imu)]
    scans = [c for c in bag.connections if c.topic in topics.scans and c.msgtype in (SCAN_TYPE, CLOUD_TYPE)]
    passes: list[Collection[Connection]] = [small, scans] if topics.clouds else [[*small, *scans]]
    total, done, found = max(1, sum(c.msgcount for c in [*small, *scans])), 0, _BagMessages()
    found.scans = {topic: [] for topic in topics.scans}
    for connections in passes:
        for connection, log_ns, message in iterate_messages(path, bag, connections, lost):
            if connection.msgtype not in TRANSFORM_TYPES and stamp_ns(message.header.stamp) == 0 and log_ns > 0:
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(log_ns, 1_000_000_000)
                found.unstamped += 1
            if connection.msgtype == CLOUD_TYPE:
                _take_cloud(
                    found=found,
                    topic=connection.topic,
                    message=message,
                    topics=topics,
                    settings=settings,
                    mounts=mounts,
                )
            else:
                _take(found, connection, message)
            done += 1
            if progress is not None and done % _PROGRESS_EVERY == 0:
                progress(min(1.0, done / total))
    if not any(found.scans.values()):
        names = " and ".join(topics.scans)
        raise NoScans(f"the topic {names} of {path} holds no usable scan; choose another one: {topic_list(bag)}")
    if progress is not None:
        progress(1.0)
    return found


def _take(found: _BagMessages, connection: Connection, message: Any) -> None:
    if connection.msgtype in TRANSFORM_TYPES:
        found.tree.add(message)
    elif connection.msgtype == SCAN_TYPE:
        found.scan_frames.setdefault(connection.topic, frame_name(message.header.frame_id))
        scan = scan_from_message(message)
        found.scans[connection.topic] += [scan] if scan else []
        found.skipped += not scan
    elif connection.msgtype == ODOMETRY_TYPE:
        found.odometry_base = found.odometry_base or frame_name(message.child_frame_id)
        odometry = odometry_from_message(message)
        found.odometry += [odometry] if odometry else []
        found.skipped += not odometry
    elif connection.msgtype == IMU_TYPE:
        found.imu_frame = found.imu_frame or frame_name(message.header.frame_id)
        sample = imu_from_message(message)
        found.imu += [sample] if sample else []
        found.skipped += not sample


def _take_cloud(
    found: _BagMessages, topic: str, message: Any, topics: _Topics, settings: BagSettings, mounts: Sequence[LaserMount]
) -> None:
    """Add a height band of a point cloud as a level scan at the sensor's position."""
    frame = found.scan_frames.setdefault(topic, frame_name(message.header.frame_id))
    stamp = stamp_ns(message.header.stamp)
    points = cloud_from_message(message)
    index = topics.scans.index(topic)
    chain = found.tree.chain(_base_frame(found, settings), frame, stamp)
    matrix = _given_matrix(mounts[index]) if index < len(mounts) else np.eye(4) if chain is None else chain
    in_base = points @ matrix[:3, :3].T + matrix[:3, 3]
    sensor = matrix[:2, 3]
    inside = (in_base[:, 2] >= settings.cloud_low) & (in_base[:, 2] <= settings.cloud_high)
    flat = in_base[:, :2] - sensor
    scan = scan_from_points(
        stamp_ns=stamp,
        hits=flat[inside],
        misses=flat[~inside],
        step=BEAM_STEP,
        range_min=CLOUD_RANGE_MIN,
        range_max=CLOUD_RANGE_MAX,
    )
    found.slices_at.setdefault(topic, Pose2(float(sensor[0]), float(sensor[1])))
    found.scans[topic].append(scan)


def _given_matrix(mount: LaserMount) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3, :3] = in_space(mount.base_from_laser).rotation
    matrix[:2, 3] = mount.base_from_laser.x, mount.base_from_laser.y
    if mount.upside_down:
        matrix[:3, :3] = matrix[:3, :3] @ np.diag([1.0, -1.0, -1.0])
    return matrix


def _base_frame(found: _BagMessages, settings: BagSettings) -> str:
    if settings.base_frame or found.odometry_base:
        return frame_name(settings.base_frame) or found.odometry_base
    return next((name for name in BASE_FRAMES if name in found.tree), BASE_FRAMES[0])


def _odometry(found: _BagMessages, topics: _Topics, base: str) -> tuple[list[Odometry], str]:
    """Return the readings by stamp and the name of their source: a topic, else /tf from odom to the base."""
    if topics.odom is not None:
        return sorted(found.odometry, key=lambda reading: reading.stamp_ns), topics.odom
    frame = found.tree.odometry_frame(base)
    readings = found.tree.odometry(frame, base) if frame else []
    return readings, f"/tf from {frame} to {base}" if readings else "none"


def _scans(
    found: _BagMessages,
    topics: _Topics,
    base: str,
    odometry: Sequence[Odometry],
    mounts: Sequence[LaserMount],
    settings: BagSettings,
    warnings: list[str],
) -> tuple[list[Scan], Pose2]:
    """Return the scans in bag order, and the pose in the base of the laser, real or virtual, that made them."""
    sources = []
    for index, topic in enumerate(topics.scans):
        if not found.scans[topic]:
            warnings.append(f"{topic} holds no usable scan and is left out")
            continue
        given = mounts[index] if index < len(mounts) else None
        if topic in found.slices_at:
            if given is None and found.tree.chain(base, found.scan_frames[topic], 0) is None:
                warnings.append(_unknown_mount(base, found.scan_frames[topic]))
            mount = LaserMount(found.slices_at[topic])
        else:
            mount = given or _mount(found, base, topic, warnings)
        scans = [mirrored(scan) for scan in found.scans[topic]] if mount.upside_down else found.scans[topic]
        sources.append((scans, mount.base_from_laser))
    if len(sources) == 1:
        return list(sources[0][0]), sources[0][1]
    track = OdometryInterpolation(odometry) if odometry else None
    return merged_scans(sources, track, BEAM_STEP, SCAN_SPREAD), Pose2()


def _mount(found: _BagMessages, base: str, topic: str, warnings: list[str]) -> LaserMount:
    """Return a laser's mount from the transform tree."""
    laser, first = found.scan_frames[topic], found.scans[topic][0].stamp_ns
    matrix = found.tree.chain(base, laser, first)
    if matrix is None:
        warnings.append(_unknown_mount(base, laser))
        return LaserMount()
    if found.tree.moves_between(base, laser):
        warnings.append(f"the laser '{laser}' moves on the base by /tf: its pose at the first scan is used for all")
    upright = float(matrix[2, 2])
    if abs(upright) < _LEVEL:
        tilt = math.degrees(math.acos(min(1.0, abs(upright))))
        warnings.append(f"the laser '{laser}' is tilted by {tilt:.0f} degrees: its scans are used as if it were level")
    return LaserMount(planar(matrix), upright < 0.0)


def _unknown_mount(base: str, laser: str) -> str:
    return (
        f"/tf and /tf_static do not connect {base} with '{laser}': the laser is assumed at the base; "
        "give its mount with --base-from-laser X,Y,YAW (and ,upside-down if it hangs upside down)"
    )


def _in_base_axes(found: _BagMessages, base: str, warnings: list[str]) -> list[ImuSample]:
    """Return the IMU samples by stamp, in the axes of the base."""
    samples = sorted(found.imu, key=lambda sample: sample.stamp_ns)
    if not samples or found.imu_frame == base:
        return samples
    matrix = found.tree.chain(base, found.imu_frame, samples[0].stamp_ns)
    if matrix is None:
        warnings.append(f"/tf does not connect {base} with the IMU '{found.imu_frame}': it is assumed to be level")
        return samples
    turn = matrix[:3, :3]
    return [replace(sample, accel=turn @ sample.accel, gyro=turn @ sample.gyro) for sample in samples]


def _frames(
    scans: Sequence[Scan], odometry: Sequence[Odometry], imu: Sequence[ImuSample], warnings: list[str]
) -> tuple[SensorFrame, ...]:
    """Return a frame for each scan, with its odometry; scans outside the odometry's time span are left out."""
    stamps, imu_stamps = [reading.stamp_ns for reading in odometry], [sample.stamp_ns for sample in imu]
    inside = [scan for scan in scans if stamps and stamps[0] <= scan.stamp_ns <= stamps[-1]]
    if not inside:
        warnings.append(_no_odometry(scans, stamps))
    elif len(inside) < len(scans):
        missing = len(scans) - len(inside)
        warnings.append(f"{missing} scans before the first or after the last odometry were left out")
    frames, done, imu_done = [], 0, 0
    for scan in inside or scans:
        imu_until = max(imu_done, bisect_right(imu_stamps, scan.stamp_ns))
        wheels: list[Odometry] = []
        if inside:
            until = bisect_right(stamps, scan.stamp_ns)
            wheels = list(odometry[done:until])
            if stamps[until - 1] != scan.stamp_ns:
                wheels.append(_between(odometry[until - 1], odometry[until], scan.stamp_ns))
            elif not wheels:
                wheels = [odometry[until - 1]]  # two scans at one stamp
            done = max(done, until)
        samples = tuple(imu[imu_done:imu_until])
        frames.append(SensorFrame(scan.stamp_ns, scan=scan, wheels=tuple(wheels), imu=samples))
        imu_done = imu_until
    return tuple(frames)


def _no_odometry(scans: Sequence[Scan], stamps: Sequence[int]) -> str:
    why = f"no {ODOMETRY_TYPE} and no /tf that moves the base"
    if stamps:
        late = (stamps[0] - scans[0].stamp_ns) * 1e-9
        why = f"no odometry at the time of the scans (its first stamp is {late:+.1f} s from theirs)"
    return f"the bag holds {why}: the motion is estimated by scan matching alone"


def _between(before: Odometry, after: Odometry, at_ns: int) -> Odometry:
    """Return the odometry at a stamp between two readings: pose and speeds interpolated, the later covariance."""
    part = (at_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
    v = before.twist.v + part * (after.twist.v - before.twist.v)
    omega = before.twist.omega + part * (after.twist.omega - before.twist.omega)
    pose = interpolate(before.odom_from_base, after.odom_from_base, part)
    return Odometry(at_ns, pose, Twist(v, omega), after.covariance)
