"""AprilTags in the pictures of a node's camera, read in a worker, for all parts that want a building's words of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from waychair.errors import WaychairError
from waychair.maps.building.building import Building
from waychair.maps.building.hgraph_files import SUBMAPS
from waychair.ros.nodes.node import ChairNode
from waychair.ros.nodes.parts.journey_plan import known_building
from waychair.ros.nodes.worker import Worker
from waychair.runtime.tag_watch import LOOK_S, TagWord, words_of_tags
from waychair.slam.camera.seen_tags import seen_tags
from waychair.types import Pose2, Pose3, RgbdFrame


class TagReader:
    """Takes frames, at most two a second, and hands on the words of their tags."""

    def __init__(
        self,
        node: ChairNode[Any],
        base_from_camera: Pose3,
        where: Callable[[], tuple[str, Pose2] | None],
        take: Callable[[tuple[TagWord, ...], Pose2], None],
    ) -> None:
        """`where`: the folder of the map in use and the chair in odom, None without; `take` gets the words, and the chair in
        odom as the picture was shown.
        """
        self._mount, self._where, self._take = base_from_camera, where, take
        self._worker = Worker(node)
        node.at_end(self._worker.close)
        self._busy, self._last_ns = False, -(10**12)
        self._known: tuple[str, Building | None, int] = "", None, 0
        """The folder of a map, its building, and when that was changed last [ns]."""

    def look(self, frame: RgbdFrame) -> None:
        """Have a frame that has just been taken read, unless another one is being read, or was just before."""
        where = self._where()
        if where is None or self._busy or 0 <= frame.stamp_ns - self._last_ns < LOOK_S * 1e9:
            return
        self._busy, self._last_ns = True, frame.stamp_ns
        folder, odom_from_base = where

        def read() -> tuple[TagWord, ...]:
            building = self._building(folder)
            return () if building is None else words_of_tags(building.hgraph, seen_tags(frame, self._mount))

        def take(words: tuple[TagWord, ...]) -> None:
            self._busy = False
            now = self._where()
            if now is not None and now[0] == folder:
                self._take(words, odom_from_base)

        self._worker.submit(read, take)

    def _building(self, folder: str) -> Building | None:
        """Return the building of a map, None for a map of none; in the worker."""
        known, building, changed_ns = self._known
        if known != folder or (building is not None and _changed_ns(building) != changed_ns):
            try:
                building, _ = known_building(Path(folder))
                self._known = folder, building, _changed_ns(building)
            except WaychairError:  # of no building, or damaged, of which a journey tells
                self._known = folder, None, 0
        return self._known[1]


def _changed_ns(building: Building) -> int:
    """Return when a file of the building's sub-maps, in which beacons are, was replaced last [ns]."""
    folder = building.folder / SUBMAPS
    return folder.stat().st_mtime_ns if folder.is_dir() else 0
