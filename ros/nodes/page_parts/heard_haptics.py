"""The parts of a page's port that show what glove node and cells node tell, and pass on a rider's wishes to the glove node."""

from __future__ import annotations

import time
from typing import Any

from waychair.calibration.chair_body import ChairBody
from waychair.control.haptics.next_door import DoorSide
from waychair.ros import topics
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.haptics import read_haptic_state
from waychair.ros.nodes.node import ChairNode
from waychair.ros.nodes.page_parts.heard_cells import HeardCells
from waychair.runtime.haptics.haptic_state import HapticState
from waychair.runtime.pages.chair_port import PortAnswer

_SILENT_NS = 2_000_000_000
"""Time after which a silent glove node counts as gone."""


class HeardHaptics:
    """The last word of the glove node, nothing while there is none, and its services."""

    _told: tuple[int, HapticState] | None = None

    def _listen_to_glove(self, node: ChairNode[Any]) -> None:
        node.listen(topics.HAPTIC_STATE, read_haptic_state, self._take_haptics, needed=False)
        trigger = interface_type("std_srvs/srv/Trigger")
        self._lead = node.create_client(interface_type("waychair_msgs/srv/Lead"), "haptics/lead")
        self._lead_through = node.create_client(interface_type("waychair_msgs/srv/LeadThrough"), "haptics/lead_through")
        self._rider_asks = {name: node.create_client(trigger, f"haptics/{name}") for name in _ASKS}

    def _take_haptics(self, state: HapticState) -> None:
        self._told = time.monotonic_ns(), state

    def haptics(self) -> HapticState | None:
        """See `ChairPort`."""
        told = self._told
        return None if told is None or time.monotonic_ns() - told[0] > _SILENT_NS else told[1]

    def lead(self, goal: str) -> PortAnswer:
        """See `ChairPort`."""
        return self._call(self._lead, interface_type("waychair_msgs/srv/Lead").Request(place=goal))

    def lead_through(self, side: DoorSide) -> PortAnswer:
        """See `ChairPort`."""
        return self._call(self._lead_through, interface_type("waychair_msgs/srv/LeadThrough").Request(side=side.value))

    def end_lead(self) -> PortAnswer:
        """See `ChairPort`."""
        return self._ask_glove("end")

    def say_again(self) -> PortAnswer:
        """See `ChairPort`."""
        return self._ask_glove("say_again")

    def say_where(self) -> PortAnswer:
        """See `ChairPort`."""
        return self._ask_glove("say_where")

    def _ask_glove(self, name: str) -> PortAnswer:
        return self._call(self._rider_asks[name], interface_type("std_srvs/srv/Trigger").Request())

    def _call(self, client: Any, request: Any) -> PortAnswer:
        """Call a service of the nodes; the port does."""
        raise NotImplementedError


_ASKS = ("end", "say_again", "say_where")
"""The glove node's services without arguments (std_srvs/Trigger)."""


class HeardSenses(HeardCells, HeardHaptics):
    """The last words of both nodes."""

    def _listen_to_senses(self, node: ChairNode[Any], body: ChairBody) -> None:
        self._listen_to_cells(node, body)
        self._listen_to_glove(node)
