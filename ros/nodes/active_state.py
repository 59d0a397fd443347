"""The service `get_state` of Nav2's lifecycle nodes, for scripts that wait for them.

The chair's nodes have no lifecycle: `waychair up` starts and supervises their processes. But nav2_simple_commander asks
bt_navigator and amcl whether they are active before anything else (`waitUntilNav2Active`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from waychair.ros.interface_types import interface_type
from waychair.ros.nodes.node import ChairNode

INACTIVE, ACTIVE = (2, "inactive"), (3, "active")
"""Ids and labels of lifecycle_msgs/msg/State."""


def offer_get_state(nav2_node: str, node: ChairNode[Any], is_active: Callable[[], bool]) -> None:
    """Offer the service `get_state` (lifecycle_msgs/GetState) under the name of one of Nav2's nodes."""

    def answer(request: Any, response: Any) -> Any:
        response.current_state.id, response.current_state.label = ACTIVE if is_active() else INACTIVE
        return response

    node.create_service(interface_type("lifecycle_msgs/srv/GetState"), f"{nav2_node}/get_state", answer)
