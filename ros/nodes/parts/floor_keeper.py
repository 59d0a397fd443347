"""The map in use, told to all nodes and kept over a kill: which storey's it is, and whether the chair is certainly there."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from waychair.control.journey.building_legs import sites_of_building
from waychair.errors import OutputError, WaychairError
from waychair.files import write_json
from waychair.planning.building.learnt_drives import building_of_map
from waychair.ros import topics
from waychair.ros.messages.floor import NO_REVISION, Floor, floor
from waychair.ros.nodes.node import ChairNode
from waychair.types import Pose2


class FloorKeeper:
    """Sends the topic `floor`, and keeps it in a file beside the chair's pose.

    A mapper that is killed in a lift, or after it, begins again with that map, and stays as uncertain as it was. In a lift's
    cabin it is uncertain in any case.
    """

    def __init__(self, node: ChairNode[Any], pose_file: str) -> None:
        """`pose_file`: the file of the chair's pose; "": nothing is kept."""
        self._file = Path(pose_file).with_suffix(".floor.json") if pose_file else None
        self._send: Callable[[Any], None] = node.publisher(topics.FLOOR)
        self._node = node
        self._known: Floor | None = None

    @property
    def revision(self) -> int:
        """The revision of the map in use; `NO_REVISION` before the first."""
        return NO_REVISION if self._known is None else self._known.revision

    def first(self, given: Path) -> tuple[Path, bool]:
        """Return the map folder to begin with, and whether the chair is certainly there.

        It is that in which the last run ended, if that is of the given map's building, else the given one.
        """
        kept = self._kept()
        if kept is None:
            return given, True
        folder, certain = kept
        if folder.resolve() != given.resolve():
            one, other = _building_folder(given), _building_folder(folder)
            if one is None or one != other:
                return given, True
            self._node.get_logger().warning(
                f"the chair was on the storey of {folder} when it was switched off, so it begins there; if it is elsewhere, "
                "tell it by `waychair storey NAME`"
            )
        return folder, certain

    def in_a_lift(self, folder: Path, pose: Pose2 | None) -> bool:
        """Return whether a kept pose on a map is in a lift, or in its doorway: the car may have gone elsewhere since.

        The phase of a journey is not asked: a chair that was killed while it drove in or out is in the car as well. It may
        also be there if no pose was kept with the floor.
        """
        try:
            found = building_of_map(folder)
            sites = () if found is None else sites_of_building(found[0].hgraph)
        except WaychairError:
            return False  # `_floor_of` says so
        here = [site for site in sites if found is not None and site.storey == found[1]]
        if pose is None:
            return bool(here) and self._kept() is not None
        return any(site.is_near(site.cabin.inverse() @ pose) for site in here)

    def take(self, folder: Path, *, certain: bool) -> Floor:
        """Note that this map is in use from now on, and tell all nodes."""
        self._known = known = self._floor_of(folder, certain)
        self._keep(known)
        self._send(floor(known))
        return known

    def doubt(self, *, certain: bool) -> None:
        """Note whether the chair is certainly on the storey of the map in use, and tell all nodes."""
        if self._known is None or self._known.certain is certain:
            return
        self._known = replace(self._known, stamp_ns=self._node.now_ns(), certain=certain)
        self._keep(self._known)
        self._send(floor(self._known))

    def _floor_of(self, folder: Path, certain: bool) -> Floor:
        revision = max(time.time_ns(), self.revision + 1)
        bare = Floor(self._node.now_ns(), str(folder.resolve()), revision, certain=certain)
        try:
            found = building_of_map(folder)
        except WaychairError as error:
            self._node.get_logger().error(f"{error}; the chair drives on this map alone")
            return bare
        if found is None:
            return bare
        building, storey = found
        height = next(each.height for each in building.hgraph.storeys if each.id == storey)
        return replace(bare, building=building.hgraph.name, storey=storey, height=height)

    def _keep(self, known: Floor) -> None:
        if self._file is None:
            return
        try:
            write_json(self._file, {"map": known.map_folder, "certain": known.certain})
        except OutputError as error:
            self._node.get_logger().error(f"{error}; after a restart the chair may begin with another storey's map")

    def _kept(self) -> tuple[Path, bool] | None:
        """Return the folder and the certainty of the last run; None without one, or if its map is gone."""
        if self._file is None or not self._file.is_file():
            return None
        try:
            known = json.loads(self._file.read_text(encoding="utf-8"))
            folder, certain = Path(known["map"]), known["certain"] is True
        except (OSError, ValueError, KeyError, TypeError) as error:
            self._node.get_logger().error(f"{self._file} tells no storey ({error}): tell it by `waychair storey NAME`")
            return None
        return (folder, certain) if folder.exists() else None


def _building_folder(folder: Path) -> Path | None:
    """Return the folder of the building that a map folder is a storey of; None without one."""
    try:
        found = building_of_map(folder)
    except WaychairError:
        return None
    return None if found is None else found[0].folder
