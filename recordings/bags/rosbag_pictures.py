"""Reading pictures with depth from a ROS bag, decoded lazily one by one."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from waychair.errors import RecordingDamaged, RecordingError
from waychair.recordings.bags.bag_parts import BagFiles
from waychair.recordings.bags.bag_settings import BagSettings
from waychair.recordings.bags.bag_topics import TRANSFORM_TYPES, of_other_robot
from waychair.recordings.bags.ros_decoding import camera_matrix_from_message, depth_from_message, picture_from_message
from waychair.recordings.bags.ros_transforms import BASE_FRAMES, TransformTree, frame_name, stamp_ns
from waychair.recordings.bags.rosbag_file import (
    BagFile,
    counts_by_topic,
    iterate_messages,
    open_bag,
    salvage_bag,
    topic_list,
)
from waychair.types import FloatArray, Pose3, RgbdFrame

IMAGE_TYPES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
INFO_TYPE = "sensor_msgs/msg/CameraInfo"

PICTURE_SPREAD = 0.02  # s; a colour picture and its depth are this far apart at most

_WAITING = 8  # colour or depth messages that are kept to be paired
_NOT_COLOUR = ("depth", "infra", "disparity", "confidence")


def read_pictures(files: BagFiles, settings: BagSettings, others: tuple[str, ...] = ()) -> Iterator[RgbdFrame]:
    """Yield every colour picture that has a depth picture of about the same time, in bag order.

    Topics that begin as one of `others`, those of other robots, are left out.

    The stamp is that of the colour picture. A bag without colour or depth yields nothing; damage ends the iteration.

    Raises:
        RecordingError: a topic that the settings name is missing, the camera is not calibrated, or the sizes of depth
            and colour differ.
    """
    try:
        with open_bag(files) as bag:
            yield from _pictures(files.path, bag, settings, others)
    except RecordingDamaged as damage:
        yield from _pictures(files.path, salvage_bag(files, damage), settings, others)


def read_camera_mount(files: BagFiles, settings: BagSettings, others: tuple[str, ...] = ()) -> Pose3 | None:
    """Return the pose of the pictures' optical frame in the base, from /tf; None where the bag does not hold it.

    Raises:
        RecordingError: a topic that the settings name is missing.
    """
    try:
        with open_bag(files) as bag:
            return _camera_mount(files.path, bag, settings, others)
    except RecordingDamaged as damage:
        return _camera_mount(files.path, salvage_bag(files, damage), settings, others)


def _camera_mount(path: Path, bag: BagFile, settings: BagSettings, others: tuple[str, ...]) -> Pose3 | None:
    colour = _topic(path, bag, _picture_counts(bag, others), settings.colour_topic, depth=False)
    if colour is None:
        return None
    tree, camera = TransformTree(), ""
    moves = [c for c in bag.connections if c.msgtype in TRANSFORM_TYPES and not of_other_robot(c.topic, others)]
    for _, _, message in iterate_messages(path, bag, moves):
        tree.add(message)
    for _, _, message in iterate_messages(path, bag, [c for c in bag.connections if c.topic == colour]):
        camera = frame_name(message.header.frame_id)
        break
    usual = next((name for name in BASE_FRAMES if name in tree), BASE_FRAMES[0])
    base = frame_name(settings.base_frame) or tree.base_above(camera) or usual
    chain = tree.chain(base, camera, 0)
    return None if chain is None else Pose3(chain[:3, :3], chain[:3, 3])


def _pictures(path: Path, bag: BagFile, settings: BagSettings, others: tuple[str, ...]) -> Iterator[RgbdFrame]:
    counts = _picture_counts(bag, others)
    colour = _topic(path, bag, counts, settings.colour_topic, depth=False)
    depth = _topic(path, bag, counts, settings.depth_topic, depth=True)
    if colour is None or depth is None:
        return
    info = _info_topic(path, bag, colour, depth)
    matrix: FloatArray | None = None
    waiting: dict[str, deque[tuple[int, Any]]] = {name: deque(maxlen=_WAITING) for name in (colour, depth)}
    connections = [c for c in bag.connections if c.topic in (colour, depth, info)]
    for connection, _, message in iterate_messages(path, bag, connections):
        if connection.msgtype == INFO_TYPE:
            matrix = camera_matrix_from_message(message) if matrix is None else matrix
            continue
        waiting[connection.topic].append((stamp_ns(message.header.stamp), message))
        if matrix is None:
            continue
        while (pair := _pair(waiting[colour], waiting[depth], PICTURE_SPREAD * 1e9)) is not None:
            yield _frame(path, *pair, matrix)
    if matrix is None and counts[colour]:
        raise RecordingError(f"{path} holds no calibration of the camera of {colour}; record its camera_info too")


def _picture_counts(bag: BagFile, others: tuple[str, ...]) -> dict[str, int]:
    """Return the topics of pictures that are not of other robots, with their counts."""
    counts = counts_by_topic(bag, *IMAGE_TYPES)
    return {topic: count for topic, count in counts.items() if not of_other_robot(topic, others)}


def _pair(
    colours: deque[tuple[int, Any]], depths: deque[tuple[int, Any]], spread_ns: float
) -> tuple[int, Any, Any] | None:
    """Remove and return the oldest picture with a depth within the spread, and drop everything older; else None."""
    for at, picture in colours:
        near = min(depths, key=lambda item: abs(item[0] - at), default=None)
        if near is not None and abs(near[0] - at) <= spread_ns:
            while colours and colours[0][0] <= at:
                colours.popleft()
            while depths and depths[0][0] <= near[0]:
                depths.popleft()
            return at, picture, near[1]
    return None


def _frame(path: Path, at_ns: int, picture: Any, depth: Any, camera_matrix: FloatArray) -> RgbdFrame:
    image, metres = picture_from_message(picture), depth_from_message(depth)
    if image.shape[:2] != metres.shape:
        sizes = [f"{shape[1]} x {shape[0]}" for shape in (metres.shape, image.shape)]
        raise RecordingError(
            f"the depth of {path} has {sizes[0]} pixels, its pictures {sizes[1]}: record the depth that is aligned to colour"
        )
    return RgbdFrame(at_ns, image, metres, camera_matrix)


def _topic(path: Path, bag: BagFile, counts: Mapping[str, int], asked: str, *, depth: bool) -> str | None:
    """Return the topic that the settings name, else the one with the most messages and a fitting name."""
    if asked:
        found = next((topic for topic in counts if topic.strip("/") == asked.strip("/")), None)
        if found is None:
            raise RecordingError(f"{path} holds no picture on {asked}, only {topic_list(bag)}")
        return found
    fitting = [
        topic
        for topic in counts
        if ("depth" in topic if depth else not any(word in topic for word in _NOT_COLOUR)) and counts[topic]
    ]
    return max(fitting, key=lambda topic: (counts[topic], "align" in topic or "regist" in topic, topic), default=None)


def _info_topic(path: Path, bag: BagFile, colour: str, depth: str) -> str:
    """Return the camera_info topic beside the pictures, else the one beside the depth, else any."""
    counts = counts_by_topic(bag, INFO_TYPE)
    if not counts:
        raise RecordingError(f"{path} holds no {INFO_TYPE}, so the camera of {colour} is not known; record it too")
    return max(counts, key=lambda topic: (_shared(topic, colour), _shared(topic, depth), counts[topic], topic))


def _shared(topic: str, other: str) -> int:
    """Return the number of leading parts that two topic names share."""
    parts = list(zip(topic.split("/"), other.split("/"), strict=False))
    return next((k for k, (a, b) in enumerate(parts) if a != b), len(parts))
