"""A page's part for levels of help over the chair's nodes: the bridge's topic `guard` and its services."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

from waychair.ros import topics
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.guard import read_guard
from waychair.ros.nodes.node import ChairNode
from waychair.runtime.pages.chair_port import ChairView, PortAnswer
from waychair.runtime.rider.guard_view import GuardView
from waychair.types import HelpLevel

_SILENT_NS = 1_000_000_000
"""ns; a guard that was told longer ago is not shown."""


class PageGuard:
    """Shows the level of help, and passes on the rider's choice and override."""

    _guard_heard: tuple[int, GuardView] | None = None

    def _listen_to_guard(self, node: ChairNode[Any]) -> None:
        self._choose = node.create_client(interface_type("waychair_msgs/srv/ChooseLevel"), "choose_level")
        self._override = node.create_client(interface_type("std_srvs/srv/Trigger"), "override_guard")
        node.listen(topics.GUARD, read_guard, self._take_guard, needed=False)

    def _take_guard(self, guard: GuardView) -> None:
        self._guard_heard = time.monotonic_ns(), guard

    def _with_guard(self, view: ChairView) -> ChairView:
        heard = self._guard_heard
        silent = heard is None or time.monotonic_ns() - heard[0] > _SILENT_NS
        return replace(view, guard=None if silent or heard is None else heard[1])

    def choose_level(self, level: HelpLevel) -> PortAnswer:
        """See `ChairPort`."""
        kind = interface_type("waychair_msgs/srv/ChooseLevel")
        return self._call(self._choose, kind.Request(level=level.value))

    def override_guard(self) -> PortAnswer:
        """See `ChairPort`."""
        return self._call(self._override, interface_type("std_srvs/srv/Trigger").Request())

    def _call(self, client: Any, request: Any) -> PortAnswer:
        """Call a service of the nodes; the port does."""
        raise NotImplementedError
