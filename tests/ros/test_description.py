"""The chair as RViz draws it: one tree of frames that agrees with the static transforms and the headers."""

from __future__ import annotations

import dataclasses
import math
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair_body import BODIES, BodyLayer, ChairBody
from waychair.recordings.bags.ros_messages import BASE_FRAME, MAP_FRAME, ODOM_FRAME, WHEEL_JOINTS
from waychair.ros import topics
from waychair.ros.description import WHEEL_FRAMES, robot_description, urdf, wheel_transforms
from waychair.ros.messages.wire import deserialised, serialised
from waychair.ros.mounts import static_transforms
from waychair.ros.topics import RosTopic
from waychair.types import FloatArray, Pose3, WheelTicks

ANGLES = st.floats(-1.4, 1.4)


def turned(roll: float, pitch: float, yaw: float) -> FloatArray:
    """Rotation by fixed-axis angles, as URDF means them: about x, then y, then z."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(a), math.cos(a)) for a in (roll, pitch, yaw))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    return np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]]) @ about_y @ about_x


def named(joint: Element, tag: str, attribute: str) -> str:
    element = joint.find(tag)
    assert element is not None
    return element.attrib[attribute]


def numbers(joint: Element, attribute: str) -> list[float]:
    return [float(number) for number in named(joint, "origin", attribute).split()]


def joints(body: ChairBody) -> dict[str, Element]:
    return {joint.attrib["name"]: joint for joint in ElementTree.fromstring(urdf(body)).iter("joint")}


def poses(body: ChairBody) -> dict[tuple[str, str], Pose3]:
    """`parent_from_child` of all joints at rest."""
    return {
        (named(joint, "parent", "link"), named(joint, "child", "link")): Pose3(
            turned(*numbers(joint, "rpy")), np.array(numbers(joint, "xyz"))
        )
        for joint in joints(body).values()
    }


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
def test_the_links_are_one_tree_with_the_base_as_its_root(body: ChairBody) -> None:
    robot = ElementTree.fromstring(urdf(body))
    assert robot.tag == "robot"
    assert robot.attrib["name"] == f"waychair_{body.chair_id}"
    links = [link.attrib["name"] for link in robot.findall("link")]
    parents = {child: parent for parent, child in poses(body)}
    assert len(set(links)) == len(links)
    assert len(parents) == len(robot.findall("joint"))
    assert set(links) == {BASE_FRAME, *parents}
    for link in links:
        while link != BASE_FRAME:
            link = parents[link]


def test_every_sensors_header_names_a_frame_of_the_tree() -> None:
    table = [value for value in vars(topics).values() if isinstance(value, RosTopic)]
    table += [topics.sonar(k) for k in range(8)]
    frames = {topic.frame for topic in table} - {"", MAP_FRAME, ODOM_FRAME}
    frames -= {topics.SERVO_FRAME}  # the camera on servos is no part of the tree: its angles come with its transform
    assert frames <= {BASE_FRAME, *(child for _, child in poses(ChairBody()))}


@settings(max_examples=30, deadline=None)
@given(yaw=ANGLES, pitch=ANGLES, laser=st.floats(-3.1, 3.1), x=st.floats(-2.0, 2.0))
def test_fixed_joints_equal_the_static_transforms(yaw: float, pitch: float, laser: float, x: float) -> None:
    body = dataclasses.replace(ChairBody(), camera_yaw=yaw, camera_pitch=pitch, laser_theta=laser, laser_x=x)
    found, expected = poses(body), static_transforms(body)
    assert set(found) - set(expected) == {(BASE_FRAME, wheel) for wheel in WHEEL_FRAMES}
    for edge, pose in expected.items():
        np.testing.assert_allclose(found[edge].rotation, pose.rotation, atol=1e-7)
        np.testing.assert_allclose(found[edge].translation, pose.translation, atol=1e-7)


def test_the_wheels_joints_are_those_of_joint_states_and_turn_about_the_axle() -> None:
    body = BODIES["B"]
    for side, joint in zip((1.0, -1.0), WHEEL_JOINTS, strict=True):
        wheel = joints(body)[joint]
        assert wheel.attrib["type"] == "continuous"
        assert named(wheel, "axis", "xyz") == "0 1 0"
        assert numbers(wheel, "xyz") == [0.0, side * body.track / 2, body.wheel_radius]


def test_the_top_of_a_wheel_that_rolls_forward_moves_forward() -> None:
    body = ChairBody()
    quarter = body.ticks_per_turn // 4
    left, right = wheel_transforms(body, WheelTicks(0, quarter, -quarter)).values()
    top = np.array([0.0, 0.0, body.wheel_radius])
    np.testing.assert_allclose(left.rotation @ top, [body.wheel_radius, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(right.rotation @ top, [-body.wheel_radius, 0.0, 0.0], atol=1e-12)
    still = wheel_transforms(body, WheelTicks(0, 0, 0))
    for edge, pose in still.items():
        np.testing.assert_allclose(pose.translation, poses(body)[edge].translation)


def test_each_layer_of_an_outline_is_drawn_and_kept_free() -> None:
    layers = (BodyLayer(0.0, 0.5, 0.7, 0.2, 0.3), BodyLayer(0.5, 1.2, 0.3, 0.2, 0.25))
    robot = ElementTree.fromstring(urdf(dataclasses.replace(ChairBody(), layers=layers)))
    base = next(link for link in robot.iter("link") if link.attrib["name"] == BASE_FRAME)
    for kind in ("visual", "collision"):
        boxes = [box.attrib["size"] for shape in base.findall(kind) for box in shape.iter("box")]
        assert boxes == ["0.9 0.6 0.5", "0.5 0.5 0.7"]


def test_the_description_is_sent_as_a_string() -> None:
    body = BODIES["A_mid"]
    message = robot_description(body)
    assert message.__msgtype__ == topics.ROBOT_DESCRIPTION.type
    assert deserialised(serialised(message), topics.ROBOT_DESCRIPTION.type).data == urdf(body)
