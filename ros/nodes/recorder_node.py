"""The recorder node: records the messages of the chair's nodes to a ROS 2 bag, without ros2cli.

Messages are stored as the received bytes, with their time of arrival. The bag is flushed every second, so that a killed
recorder loses at most its last second (see `BagOutput.temporary_path`). A recorder that ends normally leaves the whole bag at its
path.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from waychair.calibration.chair_body import CHAIR_A, sonar_mounts
from waychair.config import Settings, setting
from waychair.errors import RecordingError
from waychair.recordings.bags.rosbag_output import BagOutput
from waychair.ros import topics
from waychair.ros.environment import namespace_arguments
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.reports import DiagnosticLevel, Report
from waychair.ros.nodes.node import ChairNode, run_node, run_until_signal
from waychair.ros.topics import RosTopic, profile

DRIVE: tuple[RosTopic, ...] = (
    topics.SCAN,
    topics.IMU,
    topics.JOINTS,
    topics.ODOMETRY,
    topics.TF,
    topics.TF_STATIC,
    *(topics.sonar(k) for k in range(len(sonar_mounts(CHAIR_A)))),
    topics.BATTERY,
    topics.SEAT,
    topics.JOY,
    topics.TRUTH,
    topics.MAP,
    topics.PLACES,
    topics.LOCALISATION,
    topics.POSE,
    topics.INITIAL_POSE,
    topics.GOAL,
    topics.PLAN,
    topics.LOCAL_PLAN,
    topics.SPEED_LIMIT,
    topics.STOP,
    topics.COMMAND,
    topics.DRIVE_REQUEST,
    topics.DRIVE_STATE,
    topics.ROBOT_DESCRIPTION,
    topics.DIAGNOSTICS,
)
PICTURES: tuple[RosTopic, ...] = (topics.COLOUR, topics.COLOUR_INFO, topics.DEPTH, topics.DEPTH_INFO)
"""About 25 MB a second before compression."""

_DEPTH = 200  # QoS depth: messages that are queued while the disk is busy
_FLUSH_HZ = 1.0


@dataclass(frozen=True, slots=True)
class RecorderNodeSettings(Settings):
    """The bag's path, and the optional topics."""

    bag: str = setting(
        "drive.mcap", "", "path of the bag, which must not exist: a file that ends in .mcap or .db3, or a folder"
    )
    camera: bool = setting(
        False, "", "true: colour and depth pictures are recorded, too, at 25 MB/s before compression"
    )


@dataclass(frozen=True, slots=True)
class Recorded:
    """A recorded bag: its path, seconds from the first to the last message, message counts by topic, and size."""

    path: Path
    seconds: float
    counts: dict[str, int]
    megabytes: float


class RecorderNode(ChairNode[RecorderNodeSettings]):
    """A node that writes a `BagOutput`; `recorded` is its summary after the node has ended."""

    def __init__(self, settings: RecorderNodeSettings | None = None) -> None:
        """Take settings that replace the node's parameters, for use from a program."""
        super().__init__("recorder", RecorderNodeSettings)
        self.settings = settings or self.settings
        self.recorded: Recorded | None = None
        self._counts: Counter[str] = Counter()
        self._span_ns: tuple[int, int] | None = None
        self._incompatible: set[RosTopic] = set()
        self._topic_subscriptions: dict[RosTopic, Any] = {}
        self._bag = BagOutput(Path(self.settings.bag))
        for topic in DRIVE + (PICTURES if self.settings.camera else ()):
            self._subscribe(topic, replace(topic, qos=replace(topic.qos, depth=_DEPTH)))
        self._bag.open()
        self.at_end(self._end)
        self.get_logger().info(f"recording to {self._bag.temporary_path} until the bag is complete")
        self.every(_FLUSH_HZ, self._bag.flush)
        self.every(_FLUSH_HZ, self._resubscribe)

    def reports(self) -> Iterable[Report]:
        """Report the size of the bag and the message counts."""
        counts = ((name, str(count)) for name, count in sorted(self._counts.items()))
        values = (("MB", f"{self._bag.size / 1e6:.1f}"), *counts)
        level = DiagnosticLevel.OK if self._counts else DiagnosticLevel.WARN
        yield Report("recording", level, "" if self._counts else "no message has arrived yet", values)

    def _subscribe(self, topic: RosTopic, wanted: RosTopic) -> None:
        from rclpy.event_handler import SubscriptionEventCallbacks

        events = SubscriptionEventCallbacks(incompatible_qos=lambda event: self._incompatible.add(topic))
        subscription = self.create_subscription(
            interface_type(topic.type), topic.name, self._callback(topic), profile(wanted.qos),
            event_callbacks=events, raw=True,
        )  # fmt: skip
        self._topic_subscriptions[topic] = subscription

    def _resubscribe(self) -> None:
        """Subscribe again, with best effort, to topics whose publishers offer less than the usual QoS."""
        for topic in self._incompatible:
            self.destroy_subscription(self._topic_subscriptions[topic])
            self._subscribe(topic, replace(topic, qos=topics.Qos(_DEPTH, reliable=False)))
        self._incompatible.clear()

    def _callback(self, topic: RosTopic) -> Callable[[bytes], None]:
        name = self.resolve_topic_name(topic.name)

        def take(data: bytes) -> None:
            now_ns = self.now_ns()
            self._bag.write(name, topic.type, topic.qos, now_ns, data)
            self._bag.end_if_full()
            self._counts[name] += 1
            self._span_ns = (now_ns if self._span_ns is None else self._span_ns[0], now_ns)

        return take

    def _end(self) -> None:
        """Finish the bag.

        Raises:
            RecordingError: no message was received.
            OutputError: the bag cannot be finished.
        """
        if not self._bag.is_open:
            return
        if self._span_ns is None or set(self._counts) == {topics.DIAGNOSTICS.name}:  # the recorder's own
            self._bag.discard()
            raise RecordingError("nothing was recorded, since no message arrived: start the chair with `waychair up`")
        megabytes = self._bag.size / 1e6
        first, last = self._span_ns
        self.recorded = Recorded(self._bag.finish(), (last - first) * 1e-9, dict(self._counts), megabytes)


def record(path: Path, camera: bool = False, namespace: str = "") -> Recorded:
    """Record the messages of the chair's nodes until SIGINT or SIGTERM; `namespace` selects one chair's nodes.

    Raises:
        ConfigError: the namespace is invalid.
        OutputError: the path exists, cannot be written to, or its disk is full.
        RecordingError: no message was received.
    """
    nodes: list[RecorderNode] = []

    def make() -> RecorderNode:
        nodes.append(RecorderNode(RecorderNodeSettings(str(path), camera)))
        return nodes[0]

    named = namespace_arguments(namespace)
    run_until_signal(make, ("--ros-args", *named) if named else ())
    recorded = nodes[0].recorded
    assert recorded is not None  # or `run_until_signal` has raised
    return recorded


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node's process, and return its exit code."""
    return run_node(RecorderNode, arguments)


if __name__ == "__main__":
    sys.exit(main())
