"""The driving times of a chair in a building's folder: each drive that has arrived teaches the building how long its arcs take."""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from waychair.control.drive.navigator import Stage
from waychair.errors import WaychairError
from waychair.maps.building.building import Building, load_building
from waychair.planning.building.learnt_drives import learn_drive
from waychair.runtime.chair import ChairState
from waychair.types import Pose2

_EVERY = 2
"""Ticks from one recorded pose to the next: ten a second."""


@dataclass(slots=True)
class RecordedDrive:
    """A drive on one storey: stamps [ns], and places [m] in the storey's map."""

    stamps: list[int] = field(default_factory=list)
    points: list[tuple[float, float]] = field(default_factory=list)

    def add(self, stamp_ns: int, map_from_base: Pose2) -> None:
        """Add the chair's place at a time."""
        self.stamps.append(stamp_ns)
        self.points.append((map_from_base.x, map_from_base.y))

    @property
    def tells(self) -> bool:
        """Whether it lasts long enough to tell a time."""
        return len(self.stamps) > 1

    def teach(self, building: Building, storey: str) -> bool:
        """Teach a building how long the arcs of a storey took; return whether there were any. Raises as `learn_drive`."""
        return bool(learn_drive(building, storey, np.array(self.stamps, np.int64), np.array(self.points)))


class DriveTimes:
    """Records the drives of a chair, tick by tick."""

    def __init__(
        self, folder: Path, wanted: Callable[[], bool], worker: Executor, learnt: Callable[[], None] = lambda: None
    ) -> None:
        """`folder`: of the building; `wanted`: whether the rider has said yes to a record. `worker` learns beside the ticks, and
        then calls `learnt`.
        """
        self._folder, self._wanted, self._worker, self._learnt = folder, wanted, worker, learnt
        self._drive, self._storey, self._ticks = RecordedDrive(), "", 0

    def step(self, state: ChairState, storey: str) -> None:
        """Follow a tick of the chair on a storey's map; a drive that ends before its goal teaches nothing."""
        self._ticks += 1
        drives = state.verdict.computer_drives and not state.verdict.steered
        arrived = state.navigation.stage is Stage.ARRIVED
        if drives and not arrived and (not self._drive.stamps or storey == self._storey):
            if self._ticks % _EVERY == 0:
                self._storey = storey
                self._drive.add(state.stamp_ns, state.map_from_base)
            return
        drive, self._drive = self._drive, RecordedDrive()
        if arrived and drive.tells and self._wanted():
            self._worker.submit(self._learn, drive, self._storey)

    def _learn(self, drive: RecordedDrive, storey: str) -> None:
        try:
            if drive.teach(load_building(self._folder), storey):
                self._learnt()
        except WaychairError as error:
            logging.getLogger(__name__).error("%s; the drive's times were not learnt", error)
