"""The camera's picture on a page, for valid and invalid messages."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS is not installed")

from waychair.recordings.bags.ros_messages import header, make
from waychair.ros.messages.reports import DiagnosticLevel, Report
from waychair.ros.nodes.parts.page_port import PagePort


def image(encoding: str, width: int, channels: int) -> Any:
    data = np.zeros(48 * width * channels, np.uint8)
    return make("sensor_msgs/msg/Image", header(5, "camera"), 48, width, encoding, 0, width * channels, data)


def test_an_invalid_picture_is_reported_and_ends_nothing() -> None:
    port: Any = SimpleNamespace(_pictures=SimpleNamespace(latest=None, problem="", subscription=object()))

    def report() -> Report:
        return next(iter(PagePort.reports(port)))

    PagePort._take_picture(port, image("rgb8", 64, 3))
    assert port._pictures.latest[1].startswith(b"\xff\xd8")
    assert (report().level, report().message) == (DiagnosticLevel.OK, "")
    for bad in (image("nv21", 64, 2), image("yuv422_yuy2", 65, 2)):
        port._pictures.latest = None
        PagePort._take_picture(port, bad)
        assert port._pictures.latest is None
        assert report().level is DiagnosticLevel.WARN
        assert report().message.startswith("a picture cannot be read")
    PagePort._take_picture(port, image("mono8", 64, 1))
    assert report().level is DiagnosticLevel.OK
    assert port._pictures.latest is not None
