"""The table of topics, and the environment of the processes that use them."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from waychair import topics as nouns
from waychair.errors import ConfigError
from waychair.recordings.bags.ros_messages import TYPES
from waychair.ros import topics
from waychair.ros.environment import PROFILE, namespace_arguments, ros_environment
from waychair.ros.interface_builder import TEXTS
from waychair.ros.topics import LATCHED, RELIABLE, SENSOR_DATA, RosTopic, profile

TABLE = [value for value in vars(topics).values() if isinstance(value, RosTopic)] + [topics.sonar(k) for k in range(8)]


@pytest.mark.parametrize("topic", TABLE, ids=lambda topic: topic.name)
def test_every_topic_has_a_legal_name_and_a_known_type(topic: RosTopic) -> None:
    assert re.fullmatch(r"/?[a-z][a-z0-9_]*(/[a-z][a-z0-9_]*)*", topic.name), "no part may begin with a digit"
    assert topic.type in TYPES.types or Path(TEXTS, *topic.type.split("/")).with_suffix(".msg").is_file()


def test_a_topic_has_the_name_of_its_type_if_the_type_has_its_own_topic() -> None:
    named_otherwise = {nouns.WHEELS, nouns.CAMERA, nouns.SONAR, nouns.JOYSTICK, nouns.STATUS}
    for topic in TABLE:
        if topic.stream is not None and topic.stream not in named_otherwise and topic is not topics.TRUTH:
            assert topic.name == topic.stream.name
    assert topics.IMU.rate_hz == 200.0
    assert topics.MAP.rate_hz == 0.0


def test_late_subscribers_get_maps_poses_and_mounts_but_no_old_readings() -> None:
    assert {topic.name for topic in TABLE if topic.qos == LATCHED} >= {
        "map", "amcl_pose", "robot_description", "/tf_static", "global_costmap/costmap", "local_costmap/costmap"
    }  # fmt: skip
    assert {topic.type for topic in TABLE if topic.qos == SENSOR_DATA} == {
        f"sensor_msgs/msg/{name}"
        for name in ("LaserScan", "Imu", "FluidPressure", "Image", "CameraInfo", "Range", "Joy")
    }


def test_the_sensor_data_qos_equals_that_of_rclpy() -> None:
    qos = pytest.importorskip("rclpy.qos", reason="ROS is not installed (no rclpy)")
    ours, theirs = profile(SENSOR_DATA), qos.qos_profile_sensor_data
    assert (ours.depth, ours.reliability, ours.durability) == (theirs.depth, theirs.reliability, theirs.durability)
    assert qos.qos_check_compatible(ours, profile(RELIABLE))[0] == qos.QoSCompatibility.ERROR
    assert qos.qos_check_compatible(profile(RELIABLE), ours)[0] != qos.QoSCompatibility.ERROR


def test_nodes_are_visible_on_this_computer_only_unless_opened() -> None:
    base = {"ROS_LOCALHOST_ONLY": "0", "ROS_STATIC_PEERS": "192.0.2.7", "PATH": "/bin", "ROS_DOMAIN_ID": "7"}
    closed, opened = ros_environment(base=base), ros_environment(lan=True, domain=9, base=base)
    assert closed["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert "ROS_STATIC_PEERS" not in closed
    assert opened["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SUBNET"
    assert opened["ROS_STATIC_PEERS"] == "192.0.2.7"
    assert (closed["ROS_DOMAIN_ID"], opened["ROS_DOMAIN_ID"], closed["PATH"]) == ("7", "9", "/bin")
    assert "ROS_LOCALHOST_ONLY" not in closed | opened
    of_a_node = ros_environment(base=opened)
    assert of_a_node["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SUBNET", "a node of an opened chair is opened"
    assert (
        ros_environment(base={"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"})["ROS_AUTOMATIC_DISCOVERY_RANGE"]
        == "LOCALHOST"
    )


@pytest.mark.parametrize("domain", ["102", "-1", "x", "232"])
def test_an_impossible_domain_is_refused(domain: str) -> None:
    with pytest.raises(ConfigError, match=f"ROS_DOMAIN_ID = {domain} is impossible: choose 0 to 101"):
        ros_environment(base={"ROS_DOMAIN_ID": domain})


@pytest.mark.parametrize(("given", "name"), [("left", "/left"), ("/left", "/left"), ("ward/chair_2/", "/ward/chair_2")])
def test_a_namespace_may_be_given_with_slashes_or_without(given: str, name: str) -> None:
    assert f"__ns:={name}" in namespace_arguments(given)


def test_without_a_namespace_names_are_unchanged() -> None:
    assert namespace_arguments("") == namespace_arguments("/") == ()


@pytest.mark.parametrize("namespace", ["2nd", "left chair", "a//b", "sündig", "~", "a:=b"])
def test_an_invalid_namespace_is_refused(namespace: str) -> None:
    with pytest.raises(ConfigError, match="is impossible: use letters, digits and _"):
        namespace_arguments(namespace)


def test_the_profile_is_shipped_and_one_of_the_user_is_kept() -> None:
    assert ros_environment(base={})["FASTRTPS_DEFAULT_PROFILES_FILE"] == str(PROFILE)
    own = {"FASTDDS_DEFAULT_PROFILES_FILE": "own.xml"}
    assert "FASTRTPS_DEFAULT_PROFILES_FILE" not in ros_environment(base=own)
    sizes = [int(node.text or 0) for node in ElementTree.parse(PROFILE).iter() if node.tag.endswith("segment_size")]
    assert sizes == [32 << 20]


def test_ros_is_imported_only_when_needed() -> None:
    for name in ("topics", "environment", "interface_builder", "messages.sensors", "parameters"):
        importlib.import_module(f"waychair.ros.{name}")
        source = Path(importlib.import_module(f"waychair.ros.{name}").__file__ or "").read_text()
        assert not re.search(r"^(import|from) (rclpy|\w+_msgs)", source, re.MULTILINE)
