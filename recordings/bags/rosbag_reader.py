"""Reading ROS 1 and ROS 2 bags without ROS: scans of lasers or point clouds, odometry, IMU, and sensor mounts.

Messages are sensor_msgs/LaserScan, PointCloud2 and Imu, nav_msgs/Odometry and tf2_msgs/TFMessage; frames follow
REP-105, ranges REP-117. `rosbag_pictures` reads the pictures on demand.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Connection

from waychair.errors import NoScans, RecordingDamaged, RecordingError
from waychair.recordings.bags.bag_frames import sensor_frames
from waychair.recordings.bags.bag_parts import BagFiles
from waychair.recordings.bags.bag_settings import NOT_USED, BagSettings
from waychair.recordings.bags.bag_topics import (
    CLOUD_TYPE,
    ECHO_TYPE,
    IMU_TYPE,
    ODOMETRY_TYPE,
    SCAN_TYPE,
    TRANSFORM_TYPES,
    AskedTopics,
    BagTopics,
    choose_topics,
)
from waychair.recordings.bags.clouds.cloud_decoding import Cloud, CloudDamaged, cloud_from_message
from waychair.recordings.bags.clouds.cloud_scans import (
    SAMPLE,
    CloudBand,
    CloudKind,
    height_over_floor,
    kind_of_clouds,
    told_scan,
)
from waychair.recordings.bags.clouds.cloud_units import unit_of_clouds
from waychair.recordings.bags.continued_clock import ContinuedClock, clock_warning
from waychair.recordings.bags.ros_decoding import (
    first_echoes,
    imu_from_message,
    odometry_from_message,
    told_scan_from_message,
)
from waychair.recordings.bags.ros_transforms import (
    BASE_FRAMES,
    TransformTree,
    frame_name,
    laser_mount,
    matrix_from_mount,
    mean_twist,
    stamp_ns,
    unknown_mount,
)
from waychair.recordings.bags.rosbag_file import (
    BagFile,
    iterate_messages,
    missing_messages,
    open_bag,
    salvage_bag,
    topic_list,
)
from waychair.recordings.bags.topic_clocks import TopicTimes, plausible_stamps
from waychair.recordings.plausibility.findings import Finding
from waychair.recordings.plausibility.plausible_scans import plausible_scans, without_nothing_codes
from waychair.recordings.plausibility.told_scans import ToldScan
from waychair.recordings.scan_merging import OdometryInterpolation, merged_scans
from waychair.recordings.scans import LaserMount, mirrored
from waychair.types import ImuSample, Odometry, Pose2, Scan, SensorFrame

BEAM_STEP = math.radians(0.25)  # between beams of scans that are made from clouds or from several lasers
LONGEST_SWEEP = 1.0  # s; a longer one is told in another unit
SCAN_SPREAD = 0.1  # s; scans of several lasers up to this far apart are merged

_PROGRESS_EVERY = 256  # messages


@dataclass(frozen=True, slots=True)
class BagContents:
    """The scans of a bag, each with the odometry and IMU since the one before; the laser's mount; the warnings."""

    frames: tuple[SensorFrame, ...]
    base_from_laser: Pose2
    source: str
    warnings: tuple[str, ...]
    findings: tuple[Finding, ...] = ()
    other_robots: tuple[str, ...] = ()
    """Beginnings of the topics of other robots in the bag, whose pictures are not used."""


@dataclass(slots=True)
class _BagMessages:
    """Messages collected from a bag, in bag order."""

    tree: TransformTree = field(default_factory=TransformTree)
    told: dict[str, list[ToldScan]] = field(default_factory=dict)
    bands: dict[str, CloudBand] = field(default_factory=dict)
    slices: dict[str, list[Scan]] = field(default_factory=dict)
    scan_frames: dict[str, str] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    without_speeds: Counter[str] = field(default_factory=Counter)
    damaged_clouds: dict[str, list[str]] = field(default_factory=dict)
    """What is wrong with each damaged cloud, by topic."""
    odometry: list[Odometry] = field(default_factory=list)
    odometry_base: str = ""
    imu: list[ImuSample] = field(default_factory=list)
    imu_frame: str = ""
    not_finite: dict[str, list[int]] = field(default_factory=dict)
    """The times of recording [ns] of messages that hold no numbers, by topic."""
    logs: dict[str, list[tuple[int, bool]]] = field(default_factory=dict)
    """The time of recording [ns] of each message that was kept, and whether it has no stamp, by topic."""
    clock_steps: list[tuple[int, int]] = field(default_factory=list)
    """Times of recording [ns] at which the stamps begin anew, and by how much [ns] they are set back."""


def read_bag(
    files: BagFiles,
    settings: BagSettings,
    mounts: Sequence[LaserMount] = (),
    progress: Callable[[float], None] | None = None,
) -> BagContents:
    """Return every scan of a bag, in bag order.

    A frame's `wheels` are the odometry messages since the previous frame, followed by the odometry interpolated to the
    scan's stamp. Its `imu` are the samples since then, in the axes of the base if /tf holds the IMU's mount. Stamps
    are those of the headers. Mounts come from /tf_static and /tf unless given, one for each scan topic.

    Raises:
        NoScans: no topic, or not the one that the settings name, holds scans; the message lists the topics.
        RecordingDamaged: the bag is damaged, and no scan in it can be read.
        RecordingError: a topic that the settings name is missing.
    """
    path = files.path
    try:
        with open_bag(files) as bag:
            return _read(path, bag, settings, mounts, progress)
    except RecordingDamaged as damage:
        rest = salvage_bag(files, damage)
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
    odom_asked, imu_asked = ("" if name == NOT_USED else name for name in (settings.odom_topic, settings.imu_topic))
    topics = choose_topics(path, bag, AskedTopics(settings.scan_topics, odom_asked, imu_asked), warnings)
    if settings.imu_topic == NOT_USED:
        topics = replace(topics, imu=None)
    if len(mounts) > len(topics.scans):
        raise RecordingError(
            f"{len(mounts)} mounts are given for the {len(topics.scans)} scan topics of {path}; give one for each"
        )
    found = _collect(path=path, bag=bag, topics=topics, settings=settings, mounts=mounts, progress=progress, lost=lost)
    _put_stamps_right(found, topics)
    warnings += [clock_warning(step_ns) for _, step_ns in found.clock_steps]
    base = _base_frame(found, settings)
    odometry, name = ([], "none") if settings.odom_topic == NOT_USED else _odometry(found, topics, base)
    scans, mount = _scans(
        found=found, topics=topics, base=base, odometry=odometry, mounts=mounts, settings=settings, warnings=warnings
    )
    amiss: list[str] = []
    scans = _by_stamp(scans, warnings)
    frames = sensor_frames(scans, odometry, _in_base_axes(found, base, warnings), amiss)
    warnings += [] if settings.odom_topic == NOT_USED else amiss
    source = f"ROS {'2' if bag.is2 else '1'} bag, scans {' and '.join(topics.scans)}, odometry {name}"
    source += f", IMU {topics.imu}" if found.imu else ""
    return BagContents(frames, mount, source, tuple(warnings), tuple(found.findings), topics.others)


def _collect(
    path: Path,
    bag: BagFile,
    topics: BagTopics,
    settings: BagSettings,
    mounts: Sequence[LaserMount],
    progress: Callable[[float], None] | None,
    lost: Counter[str] | None,
) -> _BagMessages:
    """Collect the messages in one pass; point clouds in another one, since they are sliced in the base's axes."""
    small = [c for c in bag.connections if c.topic in (topics.odom, topics.imu, *topics.transforms)]
    small += [c for c in bag.connections if c.topic in topics.scans and c.msgtype in (SCAN_TYPE, ECHO_TYPE)]
    clouds = [c for c in bag.connections if c.topic in topics.scans and c.msgtype == CLOUD_TYPE]
    total, done, found = max(1, sum(c.msgcount for c in [*small, *clouds])), 0, _BagMessages()
    read: Counter[str] = Counter()
    for topic in topics.scans:
        (found.slices if topic in topics.clouds else found.told)[topic] = []
    kinds: dict[str, CloudKind] = {}
    for connections in [small, clouds] if clouds else [small]:
        if connections is clouds:
            kinds = _look_at_clouds(
                path=path, bag=bag, clouds=clouds, topics=topics, settings=settings, mounts=mounts, found=found, lost=lost
            )  # fmt: skip
        clock = ContinuedClock()
        for connection, log_ns, message in clock.continued(iterate_messages(path, bag, connections, lost)):
            unstamped = connection.msgtype not in TRANSFORM_TYPES and stamp_ns(message.header.stamp) == 0 < log_ns
            if unstamped:
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(log_ns, 1_000_000_000)
            if connection.msgtype == CLOUD_TYPE:
                kept = _take_cloud(found, connection.topic, message, kinds[connection.topic])
            else:
                kept = _take(found, connection, message)
            if kept:
                found.logs.setdefault(connection.topic, []).append((log_ns, unstamped))
            elif connection.msgtype in (ODOMETRY_TYPE, IMU_TYPE):
                found.not_finite.setdefault(connection.topic, []).append(log_ns)
            done += 1
            read[connection.topic] += 1
            if progress is not None and done % _PROGRESS_EVERY == 0:
                progress(min(1.0, done / total))
        found.clock_steps = found.clock_steps or clock.resets
    if lost is None:
        found.findings += missing_messages(path, [*small, *clouds], read)
    found.findings += _not_finite(found)
    if not any(found.told.values()) and not any(found.slices.values()):
        names = " and ".join(topics.scans)
        why = "".join(f" ({damage})" for damage, *_ in found.damaged_clouds.values())
        raise NoScans(f"the topic {names} of {path} holds no usable scan{why}; choose another one: {topic_list(bag)}")
    if progress is not None:
        progress(1.0)
    return found


def _not_finite(found: _BagMessages) -> list[Finding]:
    """Return a finding for each topic with messages that hold no numbers."""
    begin_ns = min((log_ns for logs in found.logs.values() for log_ns, _ in logs[:1]), default=0)
    text = "messages without finite numbers are left out"
    return [
        *(
            Finding("not finite", topic, text, "check its driver", len(at), max(at[0] - begin_ns, 0) * 1e-9)
            for topic, at in found.not_finite.items()
        ),
        *(
            Finding("not finite", topic, "speeds without finite numbers are taken from the poses", "", count)
            for topic, count in found.without_speeds.items()
        ),
    ]


def _take(found: _BagMessages, connection: Connection, message: Any) -> bool:
    """Add a message; return whether it can be used."""
    if connection.msgtype in TRANSFORM_TYPES:
        found.tree.add(message)
    elif connection.msgtype in (SCAN_TYPE, ECHO_TYPE):
        if connection.msgtype == ECHO_TYPE:
            message.ranges = first_echoes(message)
        found.scan_frames.setdefault(connection.topic, frame_name(message.header.frame_id))
        found.told[connection.topic].append(told_scan_from_message(message))
    elif connection.msgtype == ODOMETRY_TYPE:
        found.odometry_base = found.odometry_base or frame_name(message.child_frame_id)
        odometry = odometry_from_message(message)
        told = message.twist.twist
        if odometry is not None and not math.isfinite(told.linear.x + told.angular.z):
            found.without_speeds[connection.topic] += 1
            last = found.odometry[-1] if found.odometry else odometry
            step_ns = odometry.stamp_ns - last.stamp_ns
            odometry = replace(odometry, twist=mean_twist(last.odom_from_base, odometry.odom_from_base, step_ns))
        found.odometry += [odometry] if odometry else []
        return odometry is not None
    elif connection.msgtype == IMU_TYPE:
        found.imu_frame = found.imu_frame or frame_name(message.header.frame_id)
        sample = imu_from_message(message)
        found.imu += [sample] if sample else []
        return sample is not None
    return True


def _look_at_clouds(
    path: Path,
    bag: BagFile,
    clouds: Sequence[Connection],
    topics: BagTopics,
    settings: BagSettings,
    mounts: Sequence[LaserMount],
    found: _BagMessages,
    lost: Counter[str] | None,
) -> dict[str, CloudKind]:
    """Return the kind of each topic's clouds from its first ones, and prepare the bands of those that are in space."""
    kinds = {}
    base = _base_frame(found, settings)
    odometry, _ = _odometry(found, topics, base)
    track = OdometryInterpolation(odometry) if odometry else None
    for topic in topics.clouds:
        own = [c for c in clouds if c.topic == topic]
        sample = list(islice(_clouds(path, bag, own, found, lost), SAMPLE))
        if not sample:
            kinds[topic] = CloudKind()
            found.told[topic] = found.told.get(topic, [])
            continue
        frame = found.scan_frames[topic]
        index = topics.scans.index(topic)
        given = mounts[index] if index < len(mounts) else None
        matrix = found.tree.chain(base, frame, sample[0][0]) if given is None else matrix_from_mount(given)
        again = partial(_clouds, path, bag, own, found, None if lost is None else Counter())
        unit = unit_of_clouds(topic, sample, again, odometry, matrix, found.findings)
        kind = kinds[topic] = kind_of_clouds(topic, sample, unit, found.findings, in_base=frame == base)
        if kind.flat:
            found.told[topic] = []
            continue
        if matrix is None:
            matrix = np.eye(4)
            height = height_over_floor(sample, kind.unit)
            if height is not None:
                matrix[2, 3] = height
                text = f"no mount is known: the sensor is taken to be {height:.2f} m over the floor that it sees"
                found.findings.append(Finding("mount", topic, text, "give it with --base-from-laser X,Y,Z,YAW"))
        found.bands[topic] = CloudBand(matrix, settings.cloud_low, settings.cloud_high, kind, track)
    return kinds


def _clouds(
    path: Path, bag: BagFile, connections: Sequence[Connection], found: _BagMessages, lost: Counter[str] | None
) -> Iterator[tuple[int, Cloud]]:
    """Yield the stamps [ns] and the clouds of one topic that are not damaged."""
    for connection, log_ns, message in iterate_messages(path, bag, connections, lost):
        found.scan_frames.setdefault(connection.topic, frame_name(message.header.frame_id))
        try:
            cloud = cloud_from_message(message)
        except CloudDamaged:
            continue
        yield stamp_ns(message.header.stamp) or log_ns, cloud


def _take_cloud(found: _BagMessages, topic: str, message: Any, kind: CloudKind) -> bool:
    """Add a cloud: a band of heights of one in space as a level scan at the sensor's position, a flat one as its scan."""
    stamp = stamp_ns(message.header.stamp)
    try:
        cloud = cloud_from_message(message)
    except CloudDamaged as damage:
        found.damaged_clouds.setdefault(topic, []).append(str(damage))
        return False
    if kind.flat:
        if len(cloud.points):
            found.told[topic].append(told_scan(stamp, cloud, kind))
        return len(cloud.points) > 0
    if topic in found.bands:
        found.slices[topic].append(found.bands[topic].scan(stamp, cloud))
    return topic in found.bands


def _by_stamp(scans: Sequence[Scan], warnings: list[str]) -> list[Scan]:
    """Return the scans by stamp, as their odometry is; recorders write messages late."""
    ordered = sorted(scans, key=lambda scan: scan.stamp_ns)
    late = sum(one is not other for one, other in zip(scans, ordered, strict=True))
    if late:
        warnings.append(f"{late} scans are not recorded in the order of their stamps: they were sorted")
    return ordered


def _put_stamps_right(found: _BagMessages, topics: BagTopics) -> None:
    """Put the stamps of scans, odometry and IMU right by the times of recording where they cannot be."""
    kept: dict[str, list[Any]] = {
        topic: list(found.told.get(topic) or found.slices.get(topic) or ()) for topic in topics.scans
    }
    kept |= {
        topic: held for topic, held in ((topics.odom, found.odometry), (topics.imu, found.imu)) if topic is not None
    }
    kept = {topic: held for topic, held in kept.items() if held and len(held) == len(found.logs.get(topic, ()))}
    told = [_times_of(topic, held, found.logs[topic]) for topic, held in kept.items()]
    stamps, findings = plausible_stamps(told)
    found.findings += findings
    for times, mended, held in zip(told, stamps, kept.values(), strict=True):
        if np.array_equal(mended, times.stamps):
            continue
        changed = [replace(one, stamp_ns=int(stamp)) for one, stamp in zip(held, mended, strict=True)]
        if times.topic == topics.odom:
            found.odometry = changed
        elif times.topic == topics.imu:
            found.imu = changed
        elif found.told.get(times.topic):
            found.told[times.topic] = changed
        else:
            found.slices[times.topic] = changed


def _times_of(topic: str, held: Sequence[Any], logs: Sequence[tuple[int, bool]]) -> TopicTimes:
    stamps = np.array([one.stamp_ns for one in held], np.int64)
    sweeps = [one.time_increment * one.steps for one in held if isinstance(one, ToldScan)]
    sweep_s = float(np.median(sweeps)) if sweeps else 0.0
    waits_ns = round(sweep_s * 1e9) if 0.0 < sweep_s < LONGEST_SWEEP else 0
    recorded = np.array([log_ns for log_ns, _ in logs], np.int64)
    return TopicTimes(topic, stamps, recorded, np.array([none for _, none in logs], np.bool_), waits_ns)


def _base_frame(found: _BagMessages, settings: BagSettings) -> str:
    if settings.base_frame or found.odometry_base:
        return frame_name(settings.base_frame) or found.odometry_base
    lidars = found.scan_frames.values()
    above = next((base for lidar in lidars if (base := found.tree.base_above(lidar)) is not None), None)
    return above or next((name for name in BASE_FRAMES if name in found.tree), BASE_FRAMES[0])


def _odometry(found: _BagMessages, topics: BagTopics, base: str) -> tuple[list[Odometry], str]:
    """Return the readings by stamp and the name of their source: a topic, else /tf from odom to the base."""
    if topics.odom is not None:
        return sorted(found.odometry, key=lambda reading: reading.stamp_ns), topics.odom
    frame = found.tree.odometry_frame(base)
    readings = found.tree.odometry(frame, base) if frame else []
    return readings, f"/tf from {frame} to {base}" if readings else "none"


def _scans(
    found: _BagMessages,
    topics: BagTopics,
    base: str,
    odometry: Sequence[Odometry],
    mounts: Sequence[LaserMount],
    settings: BagSettings,
    warnings: list[str],
) -> tuple[list[Scan], Pose2]:
    """Return the scans in bag order, and the pose in the base of the laser, real or virtual, that made them.

    Raises:
        NoScans: no scan is left that can be used; the message says why.
        RecordingError: a mount is larger than a chair.
    """
    sources = []
    for index, topic in enumerate(topics.scans):
        if damages := found.damaged_clouds.get(topic):
            text = f"clouds whose sizes contradict their data are left out: {damages[0]}"
            found.findings.append(Finding("cloud size", topic, text, "check the driver", len(damages)))
        given = mounts[index] if index < len(mounts) else None
        if found.told.get(topic):
            mount = given or laser_mount(
                found.tree, base, found.scan_frames[topic], found.told[topic][0].stamp_ns, warnings
            )
            plausible = plausible_scans(topic, found.told[topic], odometry, mount)
            scans, findings = list(plausible.scans), plausible.findings
        elif topic in found.bands and found.slices[topic]:
            band = found.bands[topic]
            if given is None and found.tree.chain(base, found.scan_frames[topic], 0) is None:
                warnings.append(unknown_mount(base, found.scan_frames[topic]))
            if outside := band.outside():
                raise NoScans(
                    f"{topic}: {outside}: is the sensor's mount right? Give it with --base-from-laser X,Y,Z,YAW, or other "
                    "heights with cloud_low and cloud_high (waychair config map)"
                )
            x, y = band.base_from_sensor[:2, 3].tolist()
            mount = LaserMount(Pose2(x, y))
            scans, found_codes = without_nothing_codes(topic, found.slices[topic])
            findings = tuple(found_codes)
        else:
            scans, findings = [], ()
        found.findings.extend(findings)
        if not scans:
            warnings.append(f"{topic} holds no usable scan and is left out")
            continue
        scans = [mirrored(scan) for scan in scans] if mount.upside_down else scans
        sources.append((scans, mount.base_from_laser))
    if not sources:
        why = "; ".join(finding.sentence() for finding in found.findings)
        raise NoScans(f"no usable scan is on {' and '.join(topics.scans)}" + (f": {why}" if why else ""))
    if len(sources) == 1:
        return list(sources[0][0]), sources[0][1]
    track = OdometryInterpolation(odometry) if odometry else None
    return merged_scans(sources, track, BEAM_STEP, SCAN_SPREAD), Pose2()


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
