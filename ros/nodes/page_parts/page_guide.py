"""Step guidance of a page over ROS: a rider who drives is told the way, on the page and on the topic `guidance`.

It runs beside the page and drives nothing. Nothing of it is recorded: the rider's record is that of a page without ROS.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from waychair.errors import WaychairError
from waychair.maps.building.building import Building
from waychair.maps.building.zone_rules import with_zones
from waychair.maps.folders.map_files import load_map
from waychair.planning.building.guided_ways import GuidedWays
from waychair.ros import topics
from waychair.ros.messages.guidance import guidance
from waychair.ros.messages.motion import read_odometry
from waychair.ros.nodes.node import ChairNode
from waychair.ros.nodes.parts.journey_plan import known_building
from waychair.runtime.pages.chair_port import ChairView, PortAnswer
from waychair.runtime.pages.drawing_port import NO_GUIDE
from waychair.runtime.pages.guide_view import GuideView
from waychair.runtime.pages.guiding import Guide, guided_chair_of_view
from waychair.topics import COMMAND
from waychair.types import Odometry, Pose2

_TOLD_EVERY = 4
"""Ticks from one message of `guidance` to the next at most: five a second, as fast as a page draws."""


class PageGuide:
    """The guidance of one page's node. Calls come from the web server's threads and from the executor's.

    A call that plans holds the lock; the executor, which is the loop that must not hang, never waits for it.
    """

    def __init__(self, node: ChairNode[Any], view: Callable[[], ChairView]) -> None:
        """`view`: the chair as the page shows it, without guidance."""
        self._view, self._odom_from_base = view, Pose2()
        self._lock = threading.Lock()
        self._guide = Guide(lambda: self._odom_from_base)
        self._send = node.publisher(topics.GUIDANCE)
        self._shown: tuple[GuideView | None, tuple[str, ...]] = None, ()
        self._told: GuideView | None = None
        self._ticks = 0
        node.listen(topics.ODOMETRY, read_odometry, self._take_odometry, needed=False)
        node.every(COMMAND.rate_hz, self._tick)
        self._storey = ""

    def go(self, folder: Path | None, goal: str, level: int) -> PortAnswer:
        """Begin guidance to a goal of the building whose map this is; "" ends it."""
        if not goal:
            return self.end()
        if folder is None:
            return PortAnswer(False, NO_GUIDE)
        try:
            building, storey = known_building(folder)
            ways = _ways(building)
            with self._lock:
                self._storey = storey
                view = self._view()
                self._guide.go(goal, level, view.stamp_ns, ways)
                # the first plan may take long: it loads its kernels
                self._guide.step(guided_chair_of_view(view), storey)
                self._note()
        except WaychairError as error:
            return PortAnswer(False, str(error))
        return PortAnswer(True, f"guides you to {goal}: you drive")

    def end(self) -> PortAnswer:
        """End guidance."""
        with self._lock:
            was_on = self._guide.view is not None
            self._guide.end(self._view().stamp_ns)
            self._note()
        return PortAnswer(was_on, "guidance has ended" if was_on else "there is no guidance to end")

    def enter(self, storey: str) -> None:
        """Take the storey of the map in use."""
        self._storey = storey

    @property
    def shown(self) -> tuple[GuideView | None, tuple[str, ...]]:
        """What a page shows, None without guidance, and the storeys among which the rider chooses in a cabin."""
        return self._shown

    def _note(self) -> None:
        """Note what a page shows, with the lock held."""
        self._shown = self._guide.view, self._guide.at_stops

    def _take_odometry(self, odometry: Odometry) -> None:
        self._odom_from_base = odometry.odom_from_base

    def _tick(self) -> None:
        self._ticks += 1
        if self._lock.acquire(blocking=False):
            try:
                if self._guide.view is not None:
                    self._guide.step(guided_chair_of_view(self._view()), self._storey)
                self._note()
            finally:
                self._lock.release()
        shown = self._shown[0]
        if shown != self._told and (shown is None or self._ticks % _TOLD_EVERY == 0):
            self._told = shown
            self._send(guidance(shown))


def _ways(building: Building) -> GuidedWays:
    folders = {storey.id: building.map_folder(storey.id) for storey in building.hgraph.storeys}
    grids = {storey: load_map(folder) for storey, folder in folders.items() if folder is not None}
    return GuidedWays(with_zones(building), grids)
