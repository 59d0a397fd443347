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
from waychair.maps.building.building import load_building
from waychair.planning.building.learnt_drives import learn_drive
from waychair.runtime.chair import ChairState

_EVERY = 2
"""Ticks from one recorded pose to the next: ten a second."""


@dataclass(slots=True)
class _Recorded:
    """A drive: its storey, stamps [ns], and places [m] in that storey's map."""

    storey: str = ""
    stamps: list[int] = field(default_factory=list)
    points: list[tuple[float, float]] = field(default_factory=list)


class DriveTimes:
    """Records the drives of a chair, tick by tick."""

    def __init__(
        self, folder: Path, wanted: Callable[[], bool], worker: Executor, learnt: Callable[[], None] = lambda: None
    ) -> None:
        """`folder`: of the building; `wanted`: whether the rider has said yes to a record. `worker` learns beside the ticks, and
        then calls `learnt`.
        """
        self._folder, self._wanted, self._worker, self._learnt = folder, wanted, worker, learnt
        self._drive, self._ticks = _Recorded(), 0

    def step(self, state: ChairState, storey: str) -> None:
        """Follow a tick of the chair on a storey's map; a drive that ends before its goal teaches nothing."""
        self._ticks += 1
        drives = state.verdict.computer_drives and not state.verdict.steered
        arrived = state.navigation.stage is Stage.ARRIVED
        if drives and not arrived and (not self._drive.stamps or storey == self._drive.storey):
            if self._ticks % _EVERY == 0:
                self._drive.storey = storey
                self._drive.stamps.append(state.stamp_ns)
                self._drive.points.append((state.map_from_base.x, state.map_from_base.y))
            return
        drive, self._drive = self._drive, _Recorded()
        if arrived and len(drive.stamps) > 1 and self._wanted():
            self._worker.submit(self._learn, drive)

    def _learn(self, drive: _Recorded) -> None:
        try:
            building = load_building(self._folder)
            if learn_drive(building, drive.storey, np.array(drive.stamps, np.int64), np.array(drive.points)):
                self._learnt()
        except WaychairError as error:
            logging.getLogger(__name__).error("%s; the drive's times were not learnt", error)
