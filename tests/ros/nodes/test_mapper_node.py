"""The mapper in this process with scans and odometry of the tests: other maps, and the covariance of the pose."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from waychair.calibration.calibration_file import ChairCalibration, save_calibration
from waychair.calibration.fits.time_offset import SensorDelays
from waychair.geometry import wrap_angle
from waychair.maps.folders.map_files import save_map
from waychair.recordings.bags.ros_messages import laser_scan, odometry
from waychair.ros import topics
from waychair.ros.messages.chair import read_localisation
from waychair.ros.messages.motion import pose_with_covariance
from waychair.ros.messages.wire import serialised
from waychair.slam.localising.localisation import LocalisationState
from waychair.types import OccupancyGrid, Pose2, Scan, Twist

if TYPE_CHECKING:
    from tests.ros.harness import Harness
    from waychair.ros.nodes.mapper_node import MapperNode

PLACE = Pose2(2.0, 1.5, 0.0)


@contextmanager
def mapper_node(ros: Harness, *arguments: str) -> Iterator[MapperNode]:
    """The node in this process, served by the harness."""
    from waychair.ros.nodes.mapper_node import MapperNode

    with ros.serving(MapperNode(["--ros-args", *arguments])) as node:
        yield node


def room(folder: Path, across: int) -> Path:
    """A map of a room 6 m long."""
    cells = np.zeros((across, 120), np.int8)
    cells[:2] = cells[-2:] = 100
    cells[:, :2] = cells[:, -2:] = 100
    save_map(folder, OccupancyGrid(cells, 0.05))
    return folder


def scan_in(pose: Pose2, across_m: float, stamp_ns: int) -> Scan:
    """Return the scan of a lidar at a pose in a room."""
    angles = -math.pi + np.arange(360) * (2 * math.pi / 360)
    c, s = np.cos(angles + pose.theta), np.sin(angles + pose.theta)
    with np.errstate(divide="ignore"):
        x = np.where(c > 0, (5.9 - pose.x) / c, (0.1 - pose.x) / c)
        y = np.where(s > 0, (across_m - 0.1 - pose.y) / s, (0.1 - pose.y) / s)
    ranges = np.minimum(np.abs(x), np.abs(y)).astype(np.float32)
    return Scan(stamp_ns, ranges, -math.pi, 2 * math.pi / 360, 0.0, 0.05, 30.0)


class Sensors:
    """Odometry at rest, and scans from one place."""

    def __init__(self, ros: Harness, node: MapperNode) -> None:
        self.ros, self.across_m, self.at = ros, 4.0, PLACE @ node._body.base_from_laser
        self.place, self.scan = self.sender(topics.INITIAL_POSE), self.sender(topics.SCAN)
        self.odometry = self.sender(topics.ODOMETRY)

    def sender(self, topic: topics.RosTopic) -> Callable[[Any], None]:
        from waychair.ros.interface_types import interface_type

        publisher = self.ros.node.create_publisher(interface_type(topic.type), topic.name, topics.profile(topic.qos))
        self.ros.spin_until(lambda: publisher.get_subscription_count() > 0, "the mapper to listen")
        return lambda message: publisher.publish(serialised(message))

    def __call__(self) -> None:
        now_ns = self.ros.node.get_clock().now().nanoseconds
        self.odometry(odometry(now_ns - 10_000_000, "odom", Pose2(), Twist()))
        self.scan(laser_scan(scan_in(self.at, self.across_m, now_ns - 5_000_000)))
        self.odometry(odometry(now_ns, "odom", Pose2(), Twist()))


def load(ros: Harness, folder: Path) -> Any:
    from waychair.ros.interface_types import interface_type

    kind = interface_type("nav2_msgs/srv/LoadMap")
    client = ros.node.create_client(kind, "map_server/load_map")
    ros.spin_until(client.service_is_ready, "the service")
    answer = client.call_async(kind.Request(map_url=f"file://{folder}"))
    ros.spin_until(answer.done, "the answer")
    ros.node.destroy_client(client)
    return answer.result()


@pytest.mark.nightly
def test_after_loading_another_map_the_pose_is_saved_for_that_map(ros: Harness, tmp_path: Path) -> None:
    a, b, kept = room(tmp_path / "a", 80), room(tmp_path / "b", 70), tmp_path / "pose.json"
    arguments = ("-p", f"map_folder:={a}", "-p", f"pose_file:={kept}")
    with mapper_node(ros, *arguments) as node:
        tell = Sensors(ros, node)
        tell.place(pose_with_covariance(node.now_ns(), PLACE))
        ros.spin_until(kept.exists, "the pose on a", tell)
        assert json.loads(kept.read_text())["map"] == str(a)
        kept.unlink()
        answer = load(ros, b)
        assert answer.result == answer.RESULT_SUCCESS
        assert (answer.map.info.height, answer.map.info.width) == (70, 120)
        tell.across_m = 3.5
        tell.place(pose_with_covariance(node.now_ns(), PLACE))
        ros.spin_until(kept.exists, "the pose on b", tell)
        assert json.loads(kept.read_text())["map"] == str(b)


def test_a_missing_or_invalid_map_is_answered_with_an_error_and_the_present_one_stays(
    ros: Harness, tmp_path: Path
) -> None:
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "map.yaml").write_text("image: [")
    with mapper_node(ros, "-p", f"map_folder:={room(tmp_path / 'a', 80)}") as node:
        missing, broken = load(ros, tmp_path / "none"), load(ros, tmp_path / "broken" / "map.yaml")
        assert missing.result == missing.RESULT_MAP_DOES_NOT_EXIST
        assert broken.result == broken.RESULT_INVALID_MAP_DATA
        assert node._folder == tmp_path / "a"


def test_a_map_in_the_making_is_not_replaced_by_another(ros: Harness, tmp_path: Path) -> None:
    with mapper_node(ros, "-p", f"save_folder:={tmp_path / 'made'}") as node:
        answer = load(ros, room(tmp_path / "b", 70))
        assert answer.result == answer.RESULT_UNDEFINED_FAILURE
        assert node._builder is not None


def test_the_pose_of_a_lost_chair_has_an_unlimited_covariance(ros: Harness, tmp_path: Path) -> None:
    with mapper_node(ros, "-p", f"map_folder:={room(tmp_path / 'a', 80)}") as node:
        tell, poses, found = Sensors(ros, node), ros.heard(topics.POSE), ros.heard(topics.LOCALISATION)
        tell.at = PLACE  # no scan fits: the room of another map
        tell.across_m = 20.0
        ros.spin_until(lambda: poses and found, "a place", tell)
        assert read_localisation(found[-1])[1].state is LocalisationState.LOST
        covariance = np.array(poses[-1].pose.covariance).reshape(6, 6)
        assert (np.diag(covariance)[[0, 1, 5]] > [1e3, 1e3, 9.0]).all()
        poses.close()
        found.close()


def test_scans_and_odometry_count_at_the_time_of_their_stamps(ros: Harness, tmp_path: Path) -> None:
    """Scans come 80 ms after their stamps; the chair turns meanwhile, and its pose is right at the time of the scan."""
    late_ns, rate = 80_000_000, 0.5
    chair, folder = tmp_path / "chair.json", room(tmp_path / "a", 80)
    save_calibration(chair, ChairCalibration("late", "2026-11-24", sensor_delays=SensorDelays(lidar_ns=late_ns)))
    arguments = ("-p", f"map_folder:={folder}", "-p", f"calibration:={chair}")
    with mapper_node(ros, *arguments) as node:
        tell, found = Sensors(ros, node), ros.heard(topics.LOCALISATION)
        tell.place(pose_with_covariance(node.now_ns(), PLACE))
        began_ns = ros.node.get_clock().now().nanoseconds
        sent: dict[int, Pose2] = {}

        def turned(stamp_ns: int) -> Pose2:
            return Pose2(0.0, 0.0, rate * (stamp_ns - began_ns) * 1e-9)

        def tell_turning() -> None:
            now_ns = ros.node.get_clock().now().nanoseconds
            tell.odometry(odometry(now_ns, "odom", turned(now_ns), Twist(0.0, rate)))
            seen_ns = now_ns - late_ns
            sent[seen_ns] = PLACE @ turned(seen_ns)
            seen = scan_in(sent[seen_ns] @ node._body.base_from_laser, tell.across_m, now_ns)
            tell.scan(laser_scan(seen))

        def known() -> list[tuple[Pose2, Pose2]]:
            told = [read_localisation(each) for each in found]
            return [(place.map_from_base, sent[stamp_ns]) for stamp_ns, place in told if stamp_ns in sent]

        ros.spin_until(lambda: len(known()) > 20, "places as of the scans' true times", tell_turning)
        errors = [abs(wrap_angle(here.theta - truth.theta)) for here, truth in known()[10:]]
        assert max(errors) < 0.01  # 0.04 if the delay is ignored
        found.close()
