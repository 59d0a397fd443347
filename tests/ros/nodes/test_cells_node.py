"""The cells node in this process: what it hears reaches the cells, and what they tell is sent, to a page as well."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.ros.realtime import ALONE
from waychair.errors import MessageError
from waychair.planning.seen.doorways import DoorState, Doorway
from waychair.recordings.bags.ros_messages import laser_scan, odometry
from waychair.ros import topics
from waychair.ros.messages.cells import doorways, perception, read_perception, signal
from waychair.ros.messages.servos import ServoPairing, pan_tilt_angles, picture_messages, read_pan_tilt_command
from waychair.ros.stack import Stack, processes
from waychair.runtime.pages.perception_view import AimView, PerceptionView, SectorsView
from waychair.types import PanTiltAngles, Picture, Pose2, Scan, Twist

if TYPE_CHECKING:
    from tests.ros.harness import Harness

NOTHING = SectorsView(16, (), looked=False, words="Nobody has looked for free ways yet.")


def test_what_a_page_shows_arrives_unchanged_and_another_text_is_refused() -> None:
    view = PerceptionView(7, "stop", ("Way finder",), (), NOTHING, aim=AimView(0.5, 0.0, True, "The camera looks."))
    assert read_perception(perception(view)) == view
    lost = PerceptionView(7, "stop", (), (), NOTHING, aim=AimView(math.nan, 0.0, False, "no angles"))
    assert read_perception(perception(lost)).aim is None
    with pytest.raises(MessageError, match="behaviour cells"):
        read_perception(signal("stop the chair"))


def test_only_doorways_that_range_bears_out_are_sent() -> None:
    sure = Doorway(1, Pose2(2.0, 1.0, 0.3), 0.9, 0.8, 0.02, DoorState.OPEN)
    guess = Doorway(2, Pose2(5.0, 1.0, 0.0), 0.9, 0.0, 0.2, DoorState.UNKNOWN, validated=False)
    message = doorways(5, (sure, guess))
    assert message.header.frame_id == "odom"
    assert [(each.position.x, each.position.y) for each in message.poses] == [(2.0, 1.0)]


@pytest.mark.parametrize("picture_first", [True, False])
def test_a_picture_is_paired_with_the_report_of_its_stamp_in_any_order(picture_first: bool) -> None:
    pairing = ServoPairing()
    colour, info = picture_messages(Picture(14, np.zeros((6, 8, 3), np.uint8), np.eye(3)))
    report = pan_tilt_angles(PanTiltAngles(14, 1.0, 0.0, True), laser=True)
    pairing.calibrated(info)
    pairing.angles(pan_tilt_angles(PanTiltAngles(13, 1.0, 0.0, True), laser=False))
    if picture_first:
        assert pairing.colour(colour) is None
        picture = pairing.angles(report)[1]
    else:
        assert pairing.angles(report)[1] is None
        picture = pairing.colour(colour)
    assert picture is not None
    assert (picture.stamp_ns, picture.laser) == (14, True)


def test_the_stack_starts_the_cells_where_the_chair_is_to_perceive_and_does_not_end_with_them(tmp_path: Path) -> None:
    assert "cells" not in [each.name for each in processes(Stack(tmp_path, cable="tcp:1.2.3.4:5", mapping=True))]
    stack = Stack(tmp_path, cable="tcp:1.2.3.4:5", mapping=True, settings={"cells": {"perceive": True}})
    cells = next(each for each in processes(stack) if each.name == "cells")
    assert cells.module == "waychair.ros.nodes.cells_node"
    assert not cells.vital


@ALONE
def test_the_node_tells_signal_state_and_the_camera_s_orders_and_a_page_shows_them(ros: Harness) -> None:
    from waychair.ros.interface_types import interface_type
    from waychair.ros.messages.wire import serialised
    from waychair.ros.nodes.cells_node import CellsNode
    from waychair.ros.nodes.page_parts.page_port import PagePort
    from waychair.ros.nodes.parts.known_chair import known_chair

    heard = {each: ros.heard(each) for each in (topics.SIGNAL, topics.PERCEPTION, topics.PAN_TILT_COMMAND)}
    with ros.serving(CellsNode(["--ros-args", "-p", "perceive:=true", "-p", "camera:=false"])) as node:
        page = PagePort(node, known_chair("", "A"), None)
        assert page.perception() is None
        senders = {}
        for topic in (topics.ODOMETRY, topics.SCAN, topics.PAN_TILT):
            made = ros.node.create_publisher(interface_type(topic.type), topic.name, topics.profile(topic.qos))
            senders[topic] = made

        def send(topic: topics.RosTopic, message: Any) -> None:
            senders[topic].publish(serialised(message))

        def drive() -> None:
            now_ns = ros.node.get_clock().now().nanoseconds
            send(topics.ODOMETRY, odometry(now_ns, "odom", Pose2(), Twist()))
            send(topics.SCAN, laser_scan(Scan(now_ns, np.full(720, 3.0, np.float32), -math.pi, math.tau / 720)))
            send(topics.PAN_TILT, pan_tilt_angles(PanTiltAngles(now_ns, 0.0, 0.0, True), laser=False))

        def told() -> bool:
            views = [read_perception(each) for each in heard[topics.PERCEPTION]]
            return bool(heard[topics.PAN_TILT_COMMAND]) and any(each.sectors.looked for each in views)

        ros.spin_until(told, "the cells", drive)
        assert heard[topics.SIGNAL]
        assert read_pan_tilt_command(heard[topics.PAN_TILT_COMMAND][0]).laser
        ros.spin_until(lambda: page.perception() is not None, "the page", drive)
        shown = page.perception()
        assert shown is not None
        assert "The camera looks straight ahead" in (shown.aim.words if shown.aim else "")
        assert "<svg" in (page.network("Free-space finding") or "")
