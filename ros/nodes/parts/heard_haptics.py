"""The parts of a page's port that show what glove node and cells node tell."""

from __future__ import annotations

import time
from typing import Any

from waychair.calibration.chair_body import ChairBody
from waychair.ros import topics
from waychair.ros.messages.haptics import read_haptic_state
from waychair.ros.nodes.node import ChairNode
from waychair.ros.nodes.parts.heard_cells import HeardCells
from waychair.runtime.chair_port import Answer
from waychair.runtime.haptics.haptic_state import HapticState

NOT_BY_ROS = (
    "the ROS nodes play advice but lead nobody yet: send haptics/advice by a node of your own, or use `waychair page`"
)

_SILENT_NS = 2_000_000_000
"""Time after which a silent glove node counts as gone."""


class HeardHaptics:
    """What the glove node has told last; nothing while there is none."""

    _told: tuple[int, HapticState] | None = None

    def _listen_to_glove(self, node: ChairNode[Any]) -> None:
        node.listen(topics.HAPTIC_STATE, read_haptic_state, self._take_haptics, needed=False)

    def _take_haptics(self, state: HapticState) -> None:
        self._told = time.monotonic_ns(), state

    def haptics(self) -> HapticState | None:
        """See `ChairPort`."""
        told = self._told
        return None if told is None or time.monotonic_ns() - told[0] > _SILENT_NS else told[1]

    def lead(self, goal: str) -> Answer:
        """See `ChairPort`."""
        return Answer(False, NOT_BY_ROS)

    def end_lead(self) -> Answer:
        """See `ChairPort`."""
        return Answer(False, NOT_BY_ROS)

    def say_again(self) -> Answer:
        """See `ChairPort`."""
        return Answer(False, NOT_BY_ROS)

    def say_where(self) -> Answer:
        """See `ChairPort`."""
        return Answer(False, NOT_BY_ROS)


class HeardSenses(HeardCells, HeardHaptics):
    """What both nodes have told last."""

    def _listen_to_senses(self, node: ChairNode[Any], body: ChairBody) -> None:
        self._listen_to_cells(node, body)
        self._listen_to_glove(node)
