"""The recorder as a process: every message, complete after a normal end, readable after a kill."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosReliability

from waychair.geometry import in_space
from waychair.recordings.bags import ros_messages
from waychair.recordings.recording import Recording, read_recording
from waychair.ros import topics
from waychair.ros.messages.reports import Report
from waychair.types import Pose2, Scan, Twist

if TYPE_CHECKING:
    from tests.ros.harness import Harness

COMMAND = ("-c", "from waychair.cli.main import main; main()", "record", "--out")
MESSAGES = 30
UNPAIRED = 10  # scans at either end that may have no odometry beside them: the two topics are not delivered in step
MOUNT = {("base_link", "laser"): in_space(Pose2(0.6, 0.1, 0.0), 0.3)}


@contextmanager
def senders(ros: Harness, *wanted: topics.RosTopic, namespace: str = "") -> Iterator[dict[str, Callable[[Any], None]]]:
    """Return functions that publish plain messages to a recorder, by topic."""
    from waychair.ros.interface_types import interface_type
    from waychair.ros.messages.wire import serialised

    names = [
        topic.name if not namespace or topic.name.startswith("/") else f"{namespace}/{topic.name}" for topic in wanted
    ]
    made = [
        ros.node.create_publisher(interface_type(topic.type), name, topics.profile(topic.qos))
        for name, topic in zip(names, wanted, strict=True)
    ]
    ros.spin_until(lambda: all(each.get_subscription_count() for each in made), "the recorder")

    def sender(publisher: Any) -> Callable[[Any], None]:
        return lambda message: publisher.publish(serialised(message))

    yield {topic.name: sender(each) for topic, each in zip(wanted, made, strict=True)}
    for each in made:
        ros.node.destroy_publisher(each)


def drive(ros: Harness, send: dict[str, Callable[[Any], None]], count: int = MESSAGES) -> list[int]:
    """A scan between two odometry messages until so many have been recorded; the stamps of the scans."""
    stamps: list[int] = []

    def step() -> None:
        now_ns = ros.node.get_clock().now().nanoseconds
        pose = Pose2(0.001 * len(stamps), 0.0, 0.0)
        send["odom"](ros_messages.odometry(now_ns - 1000, "odom", pose, Twist(0.5, 0.0)))
        send["scan"](ros_messages.laser_scan(Scan(now_ns, np.full(90, 2.0, np.float32), -1.5, 3.0 / 90)))
        send["odom"](ros_messages.odometry(now_ns + 1000, "odom", pose, Twist(0.5, 0.0)))
        stamps.append(now_ns)

    def recorded(report: Report) -> bool:
        counts = {name.rpartition("/")[2]: value for name, value in report.values}
        return min(int(counts.get("scan", 0)), int(counts.get("odom", 0)) // 2) >= count + UNPAIRED

    send["/tf_static"](ros_messages.transforms(0, MOUNT))
    ros.report("recorder: recording", recorded, step)
    return stamps


def assert_unbroken(recording: Recording, stamps: list[int]) -> None:
    """No message is missing between the first and the last; the first best-effort messages may have no subscriber yet."""
    recorded = [frame.stamp_ns for frame in recording.frames]
    begin = stamps.index(recorded[0])
    whole = stamps[begin:]
    assert recorded[: len(whole)] == whole[: len(recorded)]
    assert min(len(recorded), len(whole)) >= MESSAGES


def test_a_recorder_that_ends_normally_leaves_every_message_at_the_path(ros: Harness, tmp_path: Path) -> None:
    from tests.ros.harness import ended

    path = tmp_path / "drive.mcap"
    with ros.process(*COMMAND, path) as process:
        with senders(ros, topics.SCAN, topics.ODOMETRY, topics.TF_STATIC) as send:
            stamps = drive(ros, send)
        code, output = ended(process)
    assert code == 0, output
    assert f"{path}: " in output
    assert "nothing was received on /imu/data" in output
    assert "/scan" not in output.replace("recording", "")
    assert [file.name for file in tmp_path.iterdir()] == ["drive.mcap"]
    recording = read_recording(path)
    assert_unbroken(recording, stamps)
    assert recording.base_from_laser == Pose2(0.6, 0.1, 0.0)
    with AnyReader([path]) as bag:
        offered = {c.topic: c.ext.offered_qos_profiles[0].reliability for c in bag.connections}  # type: ignore[union-attr]
    assert offered["/scan"] == QosReliability.BEST_EFFORT
    assert offered["/odom"] == QosReliability.RELIABLE


def test_a_killed_recorder_leaves_all_but_the_last_second(ros: Harness, tmp_path: Path) -> None:
    path, ward = tmp_path / "drive.mcap", "/killed"  # of its own: for others it seems to listen for another 20 s
    arguments = ("--ros-args", "-p", f"bag:={path}", "-r", f"__ns:={ward}")
    with ros.process("-m", "waychair.ros.nodes.recorder_node", *arguments) as process:
        with senders(ros, topics.SCAN, topics.ODOMETRY, topics.TF_STATIC, namespace=ward) as send:
            stamps = drive(ros, send)
            (aside,) = tmp_path.glob(".drive.*/drive/drive.mcap")
            for _ in range(2):  # the second has begun after the last of those messages came
                before = aside.stat().st_size
                ros.spin_until(lambda: aside.stat().st_size > before, "a flush")  # noqa: B023
        process.send_signal(signal.SIGKILL)
        process.communicate()
    assert not path.exists()
    recording = read_recording(aside)
    assert_unbroken(recording, stamps)
    assert "is damaged" in recording.warnings[0]


@pytest.mark.nightly
def test_topics_with_weaker_qos_are_recorded_too(ros: Harness, tmp_path: Path) -> None:
    from tests.ros.harness import ended

    lossy = replace(topics.ODOMETRY, qos=topics.SENSOR_DATA)
    with ros.process(*COMMAND, tmp_path / "drive.mcap") as process:
        with senders(ros, topics.SCAN, lossy, topics.TF_STATIC) as send:
            drive(ros, send)
        code, output = ended(process)
    assert code == 0, output
    assert len(read_recording(tmp_path / "drive.mcap").frames) >= MESSAGES


def test_a_taken_path_is_refused_in_one_sentence(ros: Harness, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    path.write_bytes(b"somebody's")
    with ros.process(*COMMAND, path) as process:
        output, _ = process.communicate(timeout=60.0)
    assert process.returncode == 1
    assert output.splitlines()[-1] == f"waychair: {path} exists already; remove it or choose another name"
    assert path.read_bytes() == b"somebody's"


def test_a_recorder_without_publishers_says_so_and_leaves_no_file(ros: Harness, tmp_path: Path) -> None:
    from tests.ros.harness import ended

    arguments = ("--ros-args", "-p", f"bag:={tmp_path / 'drive.db3'}", "-r", "__ns:=/nowhere")
    with ros.process("-m", "waychair.ros.nodes.recorder_node", *arguments) as process:
        ros.report("/nowhere/recorder: recording")
        code, output = ended(process, signal.SIGTERM)
    assert code == 2
    assert "nothing was recorded, since no message arrived" in output
    assert list(tmp_path.iterdir()) == []


def test_the_command_describes_itself() -> None:
    import sys

    done = subprocess.run(
        [sys.executable, "-c", "from waychair.cli.main import main; main()", "record", "--help"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert "--camera" in done.stdout
