"""The question whether a node is active, as Nav2's lifecycle nodes answer it, for scripts that wait for them.

The chair's nodes have no lifecycle of their own: each begins by itself, and its life is `waychair up`'s care. But
nav2_simple_commander asks bt_navigator and amcl before it does anything (`waitUntilNav2Active`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from waychair.ros.interface_types import interface_type
from waychair.ros.node import ChairNode

INACTIVE, ACTIVE = (2, "inactive"), (3, "active")
"""Of lifecycle_msgs/msg/State."""


def answer_for(nav2_node: str, node: ChairNode[Any], is_active: Callable[[], bool]) -> None:
    """Offer the service `get_state` (lifecycle_msgs/GetState) of a node of Nav2."""

    def answer(request: Any, response: Any) -> Any:
        response.current_state.id, response.current_state.label = ACTIVE if is_active() else INACTIVE
        return response

    node.create_service(interface_type("lifecycle_msgs/srv/GetState"), f"{nav2_node}/get_state", answer)
