"""Choosing a bag's topics: scans, odometry and IMU of one robot.

A topic belongs to a robot by its name space (/robot1/scan) or by its frame, which /tf connects with the odometry's base
frame. Frames above the base, such as odom and map, connect nothing: they may be shared by several robots.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice, takewhile
from pathlib import Path

from waychair.errors import NoScans, RecordingError
from waychair.recordings.bags.ros_transforms import TransformTree, frame_name
from waychair.recordings.bags.rosbag_file import BagFile, counts_by_topic, iterate_messages, topic_list
from waychair.topics import IMU, ODOMETRY, SCAN

SCAN_TYPE, CLOUD_TYPE = "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/PointCloud2"
ECHO_TYPE = "sensor_msgs/msg/MultiEchoLaserScan"
ODOMETRY_TYPE, IMU_TYPE = "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu"
TRANSFORM_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
GROUND_TRUTH = "/ground_truth/"
"""Prefix of a simulator's true poses. These topics are used only if the settings name them."""

_SIDEWAYS = ("vertical", "tilt", "rear", "back")
"""Parts of the names of lidars that see less of the floor plan than the one beside them."""

_BY_PREFERENCE = (SCAN_TYPE, ECHO_TYPE, CLOUD_TYPE)

_AS_MANY = 0.95
"""Share of the most scans from which another robot has as many: which of them is meant cannot be told."""

_TRANSFORMS_LOOKED_AT = 3000  # messages; the frames of a robot all come within its first seconds


@dataclass(frozen=True, slots=True)
class AskedTopics:
    """The topics that the settings name; empty ones are guessed."""

    scans: tuple[str, ...] = ()
    odom: str = ""
    imu: str = ""


@dataclass(frozen=True, slots=True)
class BagTopics:
    """The chosen topics: scans, those of them that are clouds, odometry, IMU, and transforms.

    `others` are the beginnings of other robots' topics in the bag, such as /robot2/.
    """

    scans: tuple[str, ...]
    clouds: tuple[str, ...]
    odom: str | None
    imu: str | None
    transforms: tuple[str, ...]
    others: tuple[str, ...] = ()


@dataclass(slots=True)
class _Robot:
    """The topics of one robot."""

    name: str
    scans: list[str] = field(default_factory=list)
    odoms: list[str] = field(default_factory=list)
    imus: list[str] = field(default_factory=list)

    def space(self) -> str:
        """Return the beginning that all its topics share and others lack, such as /robot1/ or /robot1_; or nothing."""
        topics = sorted([*self.scans, *self.odoms, *self.imus])
        same = takewhile(lambda pair: pair[0] == pair[1], zip(topics[0], topics[-1], strict=False))
        common = "".join(first for first, _ in same)
        return common if common.strip("/") else ""

    def __str__(self) -> str:
        return f"{self.name} ({', '.join([*self.scans, *self.odoms, *self.imus])})"


@dataclass(frozen=True, slots=True)
class _Frames:
    """The frame of each topic's messages, and sets of frames that /tf connects into one body."""

    of_topic: Mapping[str, str]
    bodies: Mapping[str, int]

    def body(self, topic: str) -> int | str:
        """Return the body that carries a topic's frame: a number, or the frame itself where /tf does not hold it."""
        frame = self.of_topic.get(topic, "")
        return self.bodies.get(frame, frame or topic)


def choose_topics(path: Path, bag: BagFile, asked: AskedTopics, warnings: list[str]) -> BagTopics:
    """Return the topics that the settings name, else the usual ones, else those with the most messages; of one robot.

    Raises:
        NoScans: the bag holds no scans, or not those that the settings name.
        RecordingError: a topic that the settings name is missing, or the bag holds several robots equally.
    """
    scans = _candidates(path, bag, asked.scans)
    odoms, imus = _odometries(path, bag, asked.odom, ODOMETRY_TYPE), _odometries(path, bag, asked.imu, IMU_TYPE)
    others: tuple[str, ...] = ()
    if len(scans) > 1 or len(odoms) > 1 or len(imus) > 1:
        frames = _frames(path, bag, scans, odoms, imus)
        robots = _robots(bag, frames, scans, odoms, imus)
        if len(robots) > 1:
            robot = _chosen_robot(path, robots, scans, asked, warnings)
            spaces = [each.space() for each in robots if each is not robot]
            others = tuple(space for space in spaces if space and not robot.space().startswith(space))
            scans = {topic: count for topic, count in scans.items() if topic in robot.scans or asked.scans}
            odoms = {topic: count for topic, count in odoms.items() if topic in robot.odoms or asked.odom}
            imus = {topic: count for topic, count in imus.items() if topic in robot.imus or asked.imu}
        else:
            scans, odoms = _fitting(path, scans, odoms, frames, asked)
            imus = _beside(_first_of(scans, asked), imus, frames) or imus
    odoms, imus = _only(odoms, asked.odom), _only(imus, asked.imu)
    chosen = named_topics(scans, asked.scans) or (_best(path, scans, SCAN.name, SCAN_TYPE, warnings),)
    odom = _best(path, odoms, ODOMETRY.name, ODOMETRY_TYPE, warnings) if odoms else None
    imu = _best(path, imus, IMU.name, IMU_TYPE, warnings) if imus else None
    clouds = counts_by_topic(bag, CLOUD_TYPE)
    return BagTopics(
        scans=chosen,
        clouds=tuple(topic for topic in chosen if topic in clouds),
        odom=odom,
        imu=imu,
        transforms=_transforms(bag, others),
        others=others,
    )


def named_topics(known: Collection[str], asked: Sequence[str]) -> tuple[str, ...]:
    """Return the known topics of these names, with or without a leading slash, each once."""
    found = [topic for name in asked for topic in known if topic.strip("/") == name.strip("/")]
    return tuple(dict.fromkeys(found))


def of_other_robot(topic: str, others: Iterable[str]) -> bool:
    """Return whether a topic begins with the name of another robot."""
    return any(topic.startswith(space) for space in others)


def _candidates(path: Path, bag: BagFile, asked: Sequence[str]) -> dict[str, int]:
    """Return the topics that may be mapped with their counts: scans, else scans of several echoes, else clouds.

    The asked topics are among them, whatever their type.
    """
    known = counts_by_topic(bag, SCAN_TYPE, ECHO_TYPE, CLOUD_TYPE)
    for name in asked:
        if not named_topics(known, [name]):
            advice = "choose another scan topic" if known else "give a bag with laser scans"
            raise NoScans(f"{path} holds no {SCAN_TYPE} on {name}, only {topic_list(bag)}; {advice}")
    usual = next((counts for kind in _BY_PREFERENCE if (counts := _without_truth(counts_by_topic(bag, kind)))), {})
    if not usual and not asked:
        raise NoScans(f"{path} holds no {SCAN_TYPE}, only {topic_list(bag)}; give a bag with laser scans")
    return {**usual, **{topic: known[topic] for topic in named_topics(known, asked)}}


def _odometries(path: Path, bag: BagFile, asked: str, msgtype: str) -> dict[str, int]:
    counts = counts_by_topic(bag, msgtype)
    found = named_topics(counts, [asked]) if asked else ()
    if asked and not found:
        raise RecordingError(f"{path} holds no {msgtype} on {asked}, only {topic_list(bag)}")
    return {**_without_truth(counts), **{topic: counts[topic] for topic in found}}


def _only(counts: Mapping[str, int], asked: str) -> dict[str, int]:
    """Return the asked topic alone, or all where none is asked for."""
    return {topic: counts[topic] for topic in named_topics(counts, [asked])} if asked else dict(counts)


def _without_truth(counts: Mapping[str, int]) -> dict[str, int]:
    return {topic: count for topic, count in counts.items() if not topic.startswith(GROUND_TRUTH)}


def _frames(path: Path, bag: BagFile, *groups: Mapping[str, int]) -> _Frames:
    """Return the frames of these topics by the first message of each, and the bodies by the first transforms."""
    of_topic: dict[str, str] = {}
    lost: Counter[str] = Counter()  # messages that cannot be decoded; `read_bag` counts them
    above: set[str] = set()
    for topic in (topic for group in groups for topic in group):
        connections = [c for c in bag.connections if c.topic == topic]
        for _, _, message in islice(iterate_messages(path, bag, connections, lost), 1):
            frame = frame_name(message.header.frame_id)
            if hasattr(message, "child_frame_id"):
                above.add(frame)
                frame = frame_name(message.child_frame_id) or frame
            of_topic[topic] = frame
    tree = TransformTree()
    transforms = [c for c in bag.connections if c.msgtype in TRANSFORM_TYPES]
    still = [c for c in transforms if c.topic.endswith("static")]
    for connections in (still, [c for c in transforms if c not in still]):
        for _, _, message in islice(iterate_messages(path, bag, connections, lost), _TRANSFORMS_LOOKED_AT):
            tree.add(message)
    above -= set(of_topic.values())
    return _Frames(of_topic, tree.bodies(above))


def _robots(
    bag: BagFile, frames: _Frames, scans: Mapping[str, int], odoms: Mapping[str, int], imus: Mapping[str, int]
) -> list[_Robot]:
    """Return the robots with scans and odometry of their own; fewer than two mean that the bag is of one robot."""
    names = {_name(topic, frames) for topic in scans} & {_name(topic, frames) for topic in odoms} - {""}
    if len(names) > 1 and not _one_body(bag, frames, scans, names):
        key = {topic: _name(topic, frames) for topic in (*scans, *odoms, *imus)}
        wanted: dict[str, str] = {name: name for name in names}
    else:
        bodies = {frames.body(topic) for topic in scans} & {frames.body(topic) for topic in odoms}
        key = {topic: str(frames.body(topic)) for topic in (*scans, *odoms, *imus)}
        wanted = {}
        for body in bodies:
            first = min(topic for topic in scans if frames.body(topic) == body)
            wanted[str(body)] = frames.of_topic.get(first, "") or first
    return [
        _Robot(
            wanted[robot],
            [topic for topic in scans if key[topic] == robot],
            [topic for topic in odoms if key[topic] == robot],
            [topic for topic in imus if key[topic] == robot],
        )
        for robot in sorted(wanted)
    ]


def _one_body(bag: BagFile, frames: _Frames, scans: Mapping[str, int], names: Collection[str]) -> bool:
    """Return whether /tf connects the scans of all these name spaces, which then are of one robot's sensors."""
    if any(c.msgtype in TRANSFORM_TYPES and _first_name(c.topic) in names for c in bag.connections):
        return False  # each robot has its own /tf, so that frames of the same name are not the same frame
    topics = [topic for topic in scans if _name(topic, frames) in names]
    different = len({frames.of_topic.get(topic) for topic in topics}) == len(topics)
    bodies = {frames.body(topic) for topic in topics}
    return different and len(bodies) == 1 and isinstance(next(iter(bodies)), int)


def _chosen_robot(
    path: Path, robots: Sequence[_Robot], scans: Mapping[str, int], asked: AskedTopics, warnings: list[str]
) -> _Robot:
    """Return the robot of the topics that the settings name, else the one with the most scans.

    Raises:
        RecordingError: two robots have as many.
    """
    odoms = [topic for robot in robots for topic in robot.odoms]
    for wanted in (*named_topics(scans, asked.scans), *named_topics(odoms, [asked.odom] if asked.odom else [])):
        for robot in robots:
            if wanted in robot.scans or wanted in robot.odoms:
                return robot
    order = sorted(robots, key=lambda robot: -max(scans[topic] for topic in robot.scans))
    first, second = (max(scans[topic] for topic in robot.scans) for robot in order[:2])
    told = f"{path} holds {len(robots)} robots: {' and '.join(map(str, robots))}"
    options = [f"--scan {robot.scans[0]}" for robot in order]
    if second >= _AS_MANY * first:
        raise RecordingError(f"{told}; name the one to map by its scans: {' or '.join(options)}")
    warnings.append(
        f"{told}; {order[0].name} was chosen, which has the most scans: name another by {' or '.join(options[1:])}"
    )
    return order[0]


def _fitting(
    path: Path, scans: dict[str, int], odoms: dict[str, int], frames: _Frames, asked: AskedTopics
) -> tuple[dict[str, int], dict[str, int]]:
    """Return the scans that have odometry, and the odometry of the base that carries them; all where nothing tells.

    Raises:
        RecordingError: the odometry is of several robots, and nothing tells which of them carries the lidar.
    """
    if not asked.scans:
        scans = {topic: count for topic, count in scans.items() if _beside(topic, odoms, frames)} or scans
    if asked.odom or not odoms:
        return scans, odoms
    first = _first_of(scans, asked)
    if fitting := _beside(first, odoms, frames):
        return scans, fitting
    bases, kinds = {frames.body(topic) for topic in odoms}, {topic.rpartition("/")[2] for topic in odoms}
    if len(odoms) > 1 and len(bases) == len(odoms) and len(kinds) == 1:
        told = " and ".join(sorted(odoms))
        raise RecordingError(
            f"{path} holds the odometry of {len(odoms)} robots, {told}, and neither /tf nor a name tells which of them "
            f"carries {first}: name it by {' or '.join(f'--odom {topic}' for topic in sorted(odoms))}"
        )
    carrier = frames.body(first)
    elsewhere = isinstance(carrier, int) and all(isinstance(base, int) and base != carrier for base in bases)
    return scans, {} if elsewhere else odoms


def _beside(scan: str, counts: Mapping[str, int], frames: _Frames) -> dict[str, int]:
    """Return the topics of the body that carries a lidar, else those of its name space."""
    body, name = frames.body(scan), _name(scan, frames)
    of_body = {topic: count for topic, count in counts.items() if frames.body(topic) == body}
    return of_body or {topic: count for topic, count in counts.items() if name and _name(topic, frames) == name}


def _first_of(scans: Mapping[str, int], asked: AskedTopics) -> str:
    """Return the asked scan, else the one with the most messages."""
    return next(iter(named_topics(scans, asked.scans)), "") or max(scans, key=lambda topic: (scans[topic], topic))


def _best(path: Path, counts: Mapping[str, int], usual: str, msgtype: str, warnings: list[str]) -> str:
    """Return the topic of the usual name, else the one with the most messages, and warn of the others."""
    if f"/{usual}" in counts:
        return f"/{usual}"
    best = max(counts, key=lambda topic: (not any(word in topic for word in _SIDEWAYS), counts[topic], topic))
    if len(counts) > 1:
        others = ", ".join(sorted(set(counts) - {best}))
        warnings.append(f"{best} was chosen among the {msgtype} topics of {path.name}; there are also {others}")
    return best


def _transforms(bag: BagFile, others: Collection[str]) -> tuple[str, ...]:
    """Return the topics of transforms, without those of other robots."""
    topics = dict.fromkeys(c.topic for c in bag.connections if c.msgtype in TRANSFORM_TYPES)
    return tuple(topic for topic in topics if not of_other_robot(topic, others))


def _name(topic: str, frames: _Frames) -> str:
    """Return the name space of a topic, else that of its frame; empty where neither has one."""
    return _first_name(topic) or _first_name(frames.of_topic.get(topic, ""))


def _first_name(name: str) -> str:
    first, slash, _ = name.strip("/").partition("/")
    return first if slash else ""
