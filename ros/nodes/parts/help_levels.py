"""The bridge's part for levels of help: the parameter `help_level`, the services of the rider's acts, and the topic `guard`.

A level begins by the service `choose_level` or by setting the parameter while the node runs, both somebody's own act. A level
that the parameter has at the start is offered only. The parameter follows the level, also where the board ends the guard.
"""

from __future__ import annotations

import time
from typing import Any

from rclpy.parameter import Parameter

from waychair.control.safety.guard import Unscanned
from waychair.errors import MessageError
from waychair.ros import topics
from waychair.ros.interface_types import interface_type
from waychair.ros.messages.guard import guard_message, level_of
from waychair.ros.messages.haptics import read_haptic_state
from waychair.ros.messages.json_text import read_json_text
from waychair.ros.nodes.node import ChairNode
from waychair.ros.nodes.parts.bridge_state import Localised
from waychair.ros.topics import RosTopic
from waychair.runtime.drive_base import DriveBase
from waychair.runtime.haptics.haptic_state import HapticState
from waychair.runtime.rider.guard_points import IN_ODOM, GuardPoints, ToldPoints
from waychair.runtime.rider.guard_view import guard_view

LEVEL = "help_level"
"""The name of the parameter, which the bridge declares as one that may change."""

_RATE_HZ = 10.0


class HelpLevels:
    """The level of help of the bridge's drive base, for other nodes and people."""

    def __init__(self, node: ChairNode[Any], base: DriveBase, at_start: str) -> None:
        self._node, self._base = node, base
        self._unscanned, self._seen_walls = self._points_of(topics.UNSCANNED), self._points_of(topics.SEEN_WALLS)
        node.listen(topics.HAPTIC_STATE, read_haptic_state, self._take_haptics, needed=False)
        base.guard.offer(level_of(at_start))
        self._publish = node.publisher(topics.GUARD)
        node.create_service(interface_type("waychair_msgs/srv/ChooseLevel"), "choose_level", self._answer)
        node.serve("override_guard", self._override)
        node.every(_RATE_HZ, self._tell)

    def take(self, level: str) -> None:
        """Take the parameter's new value as the rider's own choice."""
        wanted = level_of(level)
        if wanted is not self._base.guard.level:
            self._base.choose_level(wanted)

    def watch(self, localised: Localised, now_ns: int) -> None:
        """Let the guard watch what the navigator's node told of drop-offs and things that no scan shows, and walls that were seen.

        Where the chair is localised and the node tells nothing, it is not known what is there.
        """
        base = self._base
        pose = base.motion.map_from_base(now_ns)
        known = Unscanned() if localised.last is None else self._unscanned.seen_from(pose, localised.revision, now_ns)
        walls = self._seen_walls.seen_from(base.motion.odom_from_base(now_ns), IN_ODOM, now_ns)
        base.guard.unscanned = known if known is None or walls is None else known.with_mapped(walls.mapped)

    def _points_of(self, topic: RosTopic) -> ToldPoints:
        """Listen to points for the guard, and return the place of the last ones."""
        points = ToldPoints()
        self._node.listen(topic, _read_points, lambda told: points.take(told, time.monotonic_ns()), needed=False)
        return points

    def _take_haptics(self, state: HapticState) -> None:
        """Hold the stick of a rider who is led as the guide asks for."""
        if state.goal:
            self._base.guard.hold_stick(state.hold, time.monotonic_ns())

    def _answer(self, request: Any, response: Any) -> Any:
        try:
            wanted = level_of(request.level)
        except MessageError as error:
            response.success, response.message = False, str(error)
            return response
        response.message = self._base.choose_level(wanted)
        response.success = self._base.guard.level is wanted
        self._follow()
        return response

    def _override(self) -> tuple[bool, str]:
        return self._base.guard.override(time.monotonic_ns())

    def _follow(self) -> None:
        """Let the parameter follow the level."""
        level = self._base.guard.level.value
        if self._node.get_parameter(LEVEL).value != level:
            self._node.set_parameters([Parameter(LEVEL, value=level)])

    def _tell(self) -> None:
        self._follow()
        self._publish(guard_message(self._node.now_ns(), guard_view(self._base.guard, self._base.bridge.telemetry)))


def _read_points(message: Any) -> GuardPoints:
    return read_json_text(message, GuardPoints, "a message about drop-offs")
