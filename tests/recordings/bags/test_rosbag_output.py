"""An unfinished bag: flushed messages are readable, and the path stays free until the end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from waychair.errors import OutputError
from waychair.recordings.bags import ros_messages, ros_topics
from waychair.recordings.bags.ros_messages import ODOM_FRAME, serialised
from waychair.recordings.bags.ros_topics import RosTopic
from waychair.recordings.bags.rosbag_output import BagOutput
from waychair.recordings.recording import read_recording
from waychair.types import Pose2, Scan, Twist

SECOND = 1_000_000_000
NAMES = ("drive.mcap", "drive.db3", "drive")


def put(bag: BagOutput, topic: RosTopic, stamp_ns: int, message: object) -> None:
    bag.write(topic.absolute, topic.type, topic.qos, stamp_ns, serialised(message))


def drive(bag: BagOutput, first: int, count: int) -> None:
    for k in range(first, first + count):
        now = (k + 1) * SECOND
        put(bag, ros_topics.ODOMETRY, now, ros_messages.odometry(now, ODOM_FRAME, Pose2(0.1 * k, 0.0, 0.0), Twist()))
        scan = Scan(now, np.full(90, 2.0, np.float32), -1.5, 3.0 / 90)
        put(bag, ros_topics.SCAN, now, ros_messages.laser_scan(scan))


@pytest.mark.parametrize("name", NAMES)
def test_flushed_messages_are_readable_in_an_unfinished_bag(tmp_path: Path, name: str) -> None:
    bag = BagOutput(tmp_path / name)
    bag.open()
    drive(bag, 0, 5)
    bag.flush()
    bag.flush()  # nothing new
    drive(bag, 5, 3)
    left = tmp_path / f"left{bag.temporary_path.suffix}"
    left.write_bytes(bag.temporary_path.read_bytes())  # as a killed process would leave it
    assert not bag.path.exists()
    recording = read_recording(left)
    assert [frame.stamp_ns // SECOND for frame in recording.frames] == [1, 2, 3, 4, 5]
    drive(bag, 8, 2)
    assert bag.finish() == tmp_path / name
    assert [frame.stamp_ns // SECOND for frame in read_recording(tmp_path / name).frames] == list(range(1, 11))
    left.unlink()
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert not bag.is_open


@pytest.mark.parametrize("name", NAMES)
def test_a_discarded_bag_leaves_no_file_and_a_kept_one_is_beside_its_path(tmp_path: Path, name: str) -> None:
    for _ in range(2):
        bag = BagOutput(tmp_path / name)
        bag.open()
        drive(bag, 0, 3)
        bag.discard()
        assert list(tmp_path.iterdir()) == []
    bag = BagOutput(tmp_path / name)
    bag.open()
    drive(bag, 0, 3)
    part = bag.keep_part()
    assert [path.name for path in tmp_path.iterdir()] == [name.replace("drive", "drive.part")] == [part.name]
    assert len(read_recording(part).frames) == 3


def test_a_path_taken_meanwhile_is_not_overwritten_and_the_bag_is_kept_beside_it(tmp_path: Path) -> None:
    bag = BagOutput(tmp_path / "drive.mcap")
    bag.open()
    drive(bag, 0, 3)
    (tmp_path / "drive.mcap").write_text("somebody's")
    with pytest.raises(OutputError, match=r"was created meanwhile: the bag is in .*drive\.part\.mcap"):
        bag.finish()
    assert len(read_recording(tmp_path / "drive.part.mcap").frames) == 3
    assert (tmp_path / "drive.mcap").read_text() == "somebody's"


def test_topic_names_in_a_bag_are_absolute() -> None:
    assert (ros_topics.SCAN.absolute, ros_topics.TF.absolute) == ("/scan", "/tf")
    assert [ros_topics.sonar(k).absolute for k in (0, 7)] == ["/sonar_0", "/sonar_7"]
