"""The grid of several drives through one building, in which newer drives outweigh older ones.

Within a session evidence is a sum, and the order of its scans does not matter. Between sessions it does: earlier
evidence for a cell is limited before the next session's sum is added (`EvidenceGrid.overlaid`). A piece of furniture
that was moved away thus disappears after some eight scans of a later drive through its cells, however often it was seen
before. Cells that no later drive sees stay as they were.

Obstacles seen by a depth camera fade in the same way: furniture moves. Drop-offs do not fade: stairs stay, forgetting
one is worse than keeping one too long, and beyond its rim a camera also sees floor, that of the storey below. So
drop-offs are one sum over all sessions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

import numpy as np

from waychair.maps.depth.depth_scan import DepthScan
from waychair.maps.grid.occupancy import OccupancySettings
from waychair.maps.layers.grid_assembly import BEAMS_PER_CALL, Assembly, DepthAssembly, GridAssembly
from waychair.types import FloatArray, OccupancyGrid, Scan

T = TypeVar("T")
A = TypeVar("A", bound=Assembly[Any])


class Sessions(Generic[T, A]):
    """An assembly for each session; scans are added to the session that was begun last."""

    def __init__(self, make: Callable[[], A]) -> None:
        self._make = make
        self._layers = {0: make()}
        self._layer_of: dict[int, int] = {}  # session by scan number
        self._nodes, self._near = np.empty((0, 3)), np.zeros(2)
        self.session = 0

    def begin(self, session: int) -> None:
        """Begin or continue a session, to which scans are added from now on. Later sessions have greater numbers."""
        if session not in self._layers:
            self._layers[session] = self._make()
            self._layers[session].move_nodes(self._nodes, self._near)
        self.session = session

    def __len__(self) -> int:
        return len(self._layer_of)

    @property
    def pending(self) -> int:
        """An upper bound of the scans still to be drawn, removed or moved."""
        return sum(layer.pending for layer in self._layers.values())

    def add(self, number: int, scan: T, node: int, first: FloatArray, last: FloatArray) -> None:
        """Attach a scan to a node, as `Assembly.add`."""
        self._layers[self.session].add(number, scan, node, first, last)
        self._layer_of[number] = self.session

    def drop(self, number: int) -> None:
        """Remove a scan of any session."""
        self._layers[self._layer_of.pop(number)].drop(number)

    def attached(self, number: int) -> tuple[int, T, int, FloatArray]:
        """Return the session of a scan, then the values of `Assembly.attached`."""
        session = self._layer_of[number]
        return session, *self._layers[session].attached(number)

    def move_nodes(self, nodes: FloatArray, near: FloatArray) -> None:
        """Take in new poses of the nodes, as `Assembly.move_nodes`."""
        self._nodes, self._near = nodes, near
        for layer in self._layers.values():
            layer.move_nodes(nodes, near)

    def draw(self, most_beams: int = BEAMS_PER_CALL) -> int:
        """Do some of the pending work, the newest session's first; return the beams."""
        waiting = [session for session, layer in self._layers.items() if layer.pending]
        return self._layers[max(waiting)].draw(most_beams) if waiting else 0

    def settle(self) -> None:
        """Do all pending work, and also move scans that are off by less than the tolerance."""
        for layer in self._layers.values():
            layer.settle()

    def draw_anew(self, make: Callable[[], A]) -> None:
        """Begin to draw all scans again, in assemblies made by `make`, such as ones of larger cells."""
        held = [(number, *self.attached(number)) for number in self._layer_of]
        latest, self._make = self.session, make
        self._layers, self._layer_of = {0: make()}, {}
        self.move_nodes(self._nodes, self._near)
        for number, session, scan, node, (first, last) in held:
            self.begin(session)
            self.add(number, scan, node, first, last)
        self.begin(latest)

    @property
    def _by_age(self) -> list[A]:
        return [self._layers[session] for session in sorted(self._layers)]


class SessionGrid(Sessions[Scan, GridAssembly]):
    """The lidar scans of several sessions, and the grid of all of them."""

    def __init__(self, occupancy: OccupancySettings | None = None) -> None:
        super().__init__(lambda: GridAssembly(occupancy))

    def grid(self) -> OccupancyGrid:
        """Return a copy of the present grid; all unknown before anything is drawn."""
        oldest, *newer = (layer.cells for layer in self._by_age)
        for cells in newer:
            oldest = oldest.overlaid(cells)
        return oldest.grid()


class SessionDepth(Sessions[DepthScan, DepthAssembly]):
    """The depth images of several sessions, and their grids of obstacles and of drop-offs."""

    def __init__(self, occupancy: OccupancySettings | None = None) -> None:
        super().__init__(lambda: DepthAssembly(occupancy))

    def grids(self) -> tuple[OccupancyGrid, OccupancyGrid]:
        """Return copies of the present grids of obstacles and of drop-offs."""
        oldest, *newer = (layer.cells for layer in self._by_age)
        obstacles, drops = oldest.obstacles, oldest.drops
        for cells in newer:
            obstacles = obstacles.overlaid(cells.obstacles)
            drops = drops.overlaid(cells.drops, limited=False)
        return obstacles.grid(), drops.grid()
