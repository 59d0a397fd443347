"""The page node: it connects the rider's page to the chair's nodes (`page_port`).

| takes | |
|---|---|
| drive_state, drive_request, localisation, odom, scan, plan, people, map, places | for display |
| floor, journey | the storey, its goals in the building, and how a journey fares |
| guide_to | a goal to which a rider who drives is told the way |
| other_chairs | the chairs that share the building |
| camera/... | only while a page shows its pictures |

| sends | |
|---|---|
| page_joystick, page_watch | a page's joystick while it is held; a heartbeat while a page with a Stop button is open |
| guidance | the present movement of step guidance, and its sentences |
| stop, initialpose, layout_changed, storey_goal | requests of a page |

It calls `confirm`, `say_storey`, `pause`, `go_on`, `cancel`, `stop`, `reset_faults`, `reinitialize_global_localization`, and navigate_to_pose.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from pathlib import Path

from waychair.ros.messages.reports import Report
from waychair.ros.node_settings.page import PageNodeSettings
from waychair.ros.nodes.node import ChairNode
from waychair.ros.nodes.page_parts.heard_others import SharingPagePort
from waychair.ros.nodes.parts.known_chair import known_chair
from waychair.runtime.pages.chair_port import ChairPort

_UPDATE_HZ = 5.0


class PageNode(ChairNode[PageNodeSettings]):
    """A node with a page's port and the web server of its page."""

    def __init__(self, serve: Callable[[ChairPort, PageNodeSettings], AbstractContextManager[str]]) -> None:
        """Start the page with `serve`, a context manager that yields the page's address."""
        super().__init__("page", PageNodeSettings)
        s = self.settings
        folder = Path(s.map_folder) if s.map_folder else None
        self._port = port = SharingPagePort(self, known_chair(s.calibration, s.chair), folder, s.scan_frame)
        self.every(_UPDATE_HZ, port.update)
        server = serve(port, s)
        address = server.__enter__()
        self.at_end(lambda: server.__exit__(None, None, None))
        self.get_logger().info(f"the page is at {address.partition('#')[0]}")

    def reports(self) -> Iterable[Report]:
        """Report whether the camera's pictures can be shown."""
        return self._port.reports()
