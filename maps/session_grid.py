"""The grid of several drives through one building, in which the newer ones outweigh the older.

Within a session evidence is a sum, and the order of its scans does not count. From session to session it does: what the
earlier ones say of a cell is limited before the next one's sum is added (`EvidenceGrid.overlaid`), so that a chair that
has been moved away is gone once some eight scans of a later drive have looked through where it stood, however often it
was seen before; and what nobody has looked at again stays.

What a depth camera sees standing fades alike: furniture moves. Where the floor ends does not: buildings keep their
stairs, a step down that is forgotten hurts more than one that is kept, and over its edge a camera sees floor as well,
that of the storey below. So drop-offs are one sum over all sessions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

import numpy as np

from waychair.maps.depth_scan import DepthScan
from waychair.maps.grid_assembly import Assembly, AssemblySettings, DepthAssembly, GridAssembly
from waychair.maps.occupancy import OccupancySettings
from waychair.types import FloatArray, OccupancyGrid, Scan

T = TypeVar("T")
A = TypeVar("A", bound=Assembly[Any])


class Sessions(Generic[T, A]):
    """An assembly for each session; scans go into that of the session that was begun last."""

    def __init__(self, make: Callable[[], A]) -> None:
        self._make = make
        self._layers = {0: make()}
        self._layer_of: dict[int, int] = {}  # of scans, by number
        self._nodes, self._near = np.empty((0, 3)), np.zeros(2)
        self.session = 0

    def begin(self, session: int) -> None:
        """What is added from now on is of this session; their numbers go up in time."""
        if session not in self._layers:
            self._layers[session] = self._make()
            self._layers[session].bend(self._nodes, self._near)
        self.session = session

    def __len__(self) -> int:
        return len(self._layer_of)

    @property
    def pending(self) -> int:
        """At most so many scans are still to be drawn, taken out or moved."""
        return sum(layer.pending for layer in self._layers.values())

    def add(self, number: int, scan: T, node: int, first: FloatArray, last: FloatArray) -> None:
        """As `Assembly.add`."""
        self._layers[self.session].add(number, scan, node, first, last)
        self._layer_of[number] = self.session

    def drop(self, number: int) -> None:
        """Take a scan of any session out again."""
        self._layers[self._layer_of.pop(number)].drop(number)

    def hung(self, number: int) -> tuple[int, T, int, FloatArray]:
        """The session of a scan, then as `Assembly.hung`."""
        session = self._layer_of[number]
        return session, *self._layers[session].hung(number)

    def bend(self, nodes: FloatArray, near: FloatArray) -> None:
        """As `Assembly.bend`."""
        self._nodes, self._near = nodes, near
        for layer in self._layers.values():
            layer.bend(nodes, near)

    def draw(self) -> int:
        """Do some of what is pending, that of the newest session first; returns the beams."""
        waiting = [session for session, layer in self._layers.items() if layer.pending]
        return self._layers[max(waiting)].draw() if waiting else 0

    def settle(self) -> None:
        """Do all that is pending, and move also what is off by less than the tolerance."""
        for layer in self._layers.values():
            layer.settle()

    @property
    def _by_age(self) -> list[A]:
        return [self._layers[session] for session in sorted(self._layers)]


class SessionGrid(Sessions[Scan, GridAssembly]):
    """The lidar's scans, and the grid of them all."""

    def __init__(self, occupancy: OccupancySettings | None = None, settings: AssemblySettings | None = None) -> None:
        super().__init__(lambda: GridAssembly(occupancy, settings))

    def grid(self) -> OccupancyGrid:
        """A copy of the grid as it is now; all unknown when nothing was drawn yet."""
        oldest, *newer = (layer.cells for layer in self._by_age)
        for cells in newer:
            oldest = oldest.overlaid(cells)
        return oldest.grid()


class SessionDepth(Sessions[DepthScan, DepthAssembly]):
    """What depth images tell, and the grids of what stands on the floor and of where it ends."""

    def __init__(self, occupancy: OccupancySettings | None = None, settings: AssemblySettings | None = None) -> None:
        super().__init__(lambda: DepthAssembly(occupancy, settings))

    def grids(self) -> tuple[OccupancyGrid, OccupancyGrid]:
        """Copies of the grid of obstacles and of the grid of drop-offs, as they are now."""
        oldest, *newer = (layer.cells for layer in self._by_age)
        obstacles, drops = oldest.obstacles, oldest.drops
        for cells in newer:
            obstacles = obstacles.overlaid(cells.obstacles)
            drops = drops.overlaid(cells.drops, limited=False)
        return obstacles.grid(), drops.grid()
