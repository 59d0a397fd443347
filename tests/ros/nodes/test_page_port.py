"""The camera's picture on a page, for valid and invalid messages."""

from __future__ import annotations

import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS is not installed")

from waychair.errors import MapError
from waychair.maps.drawn.places import save_places
from waychair.maps.folders.map_files import save_map
from waychair.recordings.bags.ros_messages import header, make
from waychair.ros.messages.floor import Floor
from waychair.ros.messages.reports import DiagnosticLevel, Report
from waychair.ros.nodes.page_parts.page_port import PagePort
from waychair.ros.nodes.parts.map_in_use import MapInUse
from waychair.runtime.pages.chair_port import LayoutView, PortAnswer
from waychair.types import OccupancyGrid, Place, Pose2


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


def test_a_new_map_is_only_noted_by_the_node_and_read_by_the_thread_that_asks_for_its_drawing(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("one", "two", "broken")]
    for folder in folders:
        save_map(folder, OccupancyGrid(np.zeros((20, 20), np.int8), 0.1, Pose2()))
        save_places(folder, {folder.name: Place(folder.name, Pose2(1.0, 1.0))})
    (folders[2] / "places.yaml").write_text("places: [", encoding="utf-8")
    told: list[str] = []
    used = MapInUse(folders[0], told.append)
    assert list((used.layout() or LayoutView({})).places) == ["one"]
    port: Any = SimpleNamespace(
        _drawing=used,
        _received=SimpleNamespace(layout_revision=1, places={}),
        _enter_storey=lambda told: None,
        _publish=SimpleNamespace(layout=lambda message: None),
    )
    takes = threading.Thread(target=PagePort._take_floor, args=(port, Floor(0, str(folders[1]), 2)), daemon=True)
    with used._lock:  # a page's thread writes a drawing meanwhile, which may wait for the disk
        takes.start()
        takes.join(5.0)
        assert not takes.is_alive()
    assert port._received.layout_revision == 2
    assert list(PagePort.layout(port).places) == ["two"]
    PagePort._take_floor(port, Floor(0, str(folders[2]), 3))
    assert PagePort.layout(port).places == {}
    answer = PagePort._drawn(port, lambda editor: None, "drawn")
    assert answer == PortAnswer(False, f"the drawing of {folders[2]} is broken: mend its files first")
    assert len(told) == 1
    making = MapInUse(None, told.append)
    assert making.layout() is None
    with pytest.raises(MapError, match="the map is being made: save it"):
        making.change(lambda editor: None)
