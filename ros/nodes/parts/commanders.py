"""Supervision of the nodes that publish on the topics that move the chair: only known ones are obeyed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from waychair.ros.nodes.inputs import UNKNOWN_NODE

if TYPE_CHECKING:
    from rclpy.node import Node

NAVIGATOR_NODE, PAGE_NODE = "navigator", "page"
"""The only nodes that the bridge obeys for speeds and for the joystick."""

_RELEASE_NS = 2_000_000_000  # a page's joystick that is silent for so long has been released
_CHECK_NS = 200_000_000  # time between two checks of the publishers' names while their number is constant


class Commanders:
    """The publishers of speeds, requests and a page's joystick; `intruder` names an unauthorised or duplicate one."""

    def __init__(self, node: Node, authorised: Mapping[str, str], now_ns: int) -> None:
        """Take the only authorised node of each topic, by topic; the last topic is that of the page's joystick."""
        self.intruder = ""
        self._node, self._authorised = node, dict(authorised)
        self._counts, self._checked_ns = [0] * len(authorised), 0
        self._joystick_held_ns: int | None = now_ns  # a page's joystick may be held since then; None: released

    def check(self, now_ns: int) -> None:
        """Find an unauthorised or duplicate publisher.

        A publisher is discovered before its first message, so that none of its messages is obeyed.
        """
        counts = [self._node.count_publishers(name) for name in self._authorised]
        if self._joystick_held_ns is not None:  # until a page has been present, and silent for long enough
            if not self._counts[-1]:
                self._joystick_held_ns = now_ns
            elif now_ns - self._joystick_held_ns >= _RELEASE_NS:
                self._joystick_held_ns = None
        if counts == self._counts and now_ns - self._checked_ns < _CHECK_NS:
            return
        self._counts, self._checked_ns, self.intruder = counts, now_ns, ""
        for topic, sender in self._authorised.items():
            names = [each.node_name for each in self._node.get_publishers_info_by_topic(topic)]
            others = [name for name in names if name != sender]
            if others or (len(names) > 1 and sender == NAVIGATOR_NODE):
                self.intruder = others[0] if others else f"{len(names)} nodes named '{sender}'"
                self.intruder = self.intruder.replace(UNKNOWN_NODE, "its name is not known yet")

    def release_joystick(self) -> None:
        """Note that the page's joystick was released."""
        self._joystick_held_ns = None

    def push_joystick(self, now_ns: int) -> bool:
        """Note that the page's joystick is pushed, and return whether the push counts.

        A joystick that may have been held before this node started counts only after a release, or after silence.
        """
        if self._joystick_held_ns is not None:
            self._joystick_held_ns = now_ns
        return self._joystick_held_ns is None
