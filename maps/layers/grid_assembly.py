"""The grid of scans attached to the nodes of a pose graph, redrawn a little at each call as the nodes move.

A scan whose node has moved is removed at its old pose and added at its new one. Evidence is a sum of whole numbers, so
the finished grid equals one drawn anew from all scans, to the last bit; memory holds only a number per cell and the
scans. Scans nearest to the chair are moved first, so that the grid round the chair soon fits the chair's pose again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Generic, Protocol, TypeVar

import numpy as np

from waychair.geometry import compose
from waychair.maps.depth.depth_evidence import DepthEvidence
from waychair.maps.depth.depth_scan import DepthScan
from waychair.maps.grid.occupancy import EvidenceGrid, OccupancySettings, batches
from waychair.types import FloatArray, IntArray, OccupancyGrid, Scan

T = TypeVar("T")
Drawn_contra = TypeVar("Drawn_contra", contravariant=True)

_GONE = -1  # node of a row that is free, or whose scan is to be removed


TOLERANCE = 0.5
"""A scan is moved when the end of one of its beams is off by more than this [cells]."""

BEAMS_PER_CALL = 6_000
"""Beams that one call of `draw` adds or removes, so that no call takes long."""


class EvidenceLayer(Protocol[Drawn_contra]):
    """A grid to which scans are added, and from which they can be removed to the last bit."""

    settings: OccupancySettings

    def add(self, first: FloatArray, last: FloatArray, scans: Sequence[Drawn_contra]) -> None:
        """Add scans taken while the sensor moved from poses `first` (N, 3) [m, m, rad] to poses `last`."""

    def remove(self, first: FloatArray, last: FloatArray, scans: Sequence[Drawn_contra]) -> None:
        """Remove scans that were added at exactly these poses."""

    def beams(self, scan: Drawn_contra) -> int:
        """Return how many beams drawing a scan takes."""

    def reach(self, scan: Drawn_contra) -> float:
        """Return an upper bound of the distance [m] from the sensor's pose to the cells of a scan."""


class Assembly(Generic[T]):
    """Scans by the caller's numbers, and the poses at which they are drawn."""

    def __init__(self, evidence: EvidenceLayer[T]) -> None:
        self._evidence = evidence
        self._nodes = np.empty((0, 3))
        self._rows: dict[int, int] = {}
        self._free: list[int] = []
        self._scans: list[T | None] = []  # by row, as all below
        self._node = np.empty(0, np.int64)
        self._reach = np.empty(0)  # [m] of the longest beam
        self._node_from_laser = np.empty((0, 2, 3))  # at the first beam and at the last one
        self._drawn = np.empty((0, 2, 3))  # the same in map, as drawn in the grid; nan: not drawn
        self._changed: deque[int] = deque()  # rows that are new or gone
        self._moved: list[int] = []  # rows drawn at an outdated pose, the nearest to the chair last

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def pending(self) -> int:
        """An upper bound of the scans still to be drawn, removed or moved; 0 when all is done."""
        return len(self._changed) + len(self._moved)

    def add(self, number: int, scan: T, node: int, first: FloatArray, last: FloatArray) -> None:
        """Attach a scan to a node; it is drawn before scans that have only moved.

        Args:
            number: a new number, by which the scan can be dropped.
            scan: kept unchanged.
            node: row of the poses that `move_nodes` is given before the next `draw`.
            first: (3,) [m, m, rad] pose of the laser at the scan's first beam, in the node's frame.
            last: (3,) the same at its last beam.
        """
        if not self._free:
            self._make_rows()
        row = self._free.pop()
        self._rows[number] = row
        self._scans[row] = scan
        self._node[row] = node
        self._reach[row] = self._evidence.reach(scan)
        self._node_from_laser[row] = first, last
        self._changed.append(row)

    def drop(self, number: int) -> None:
        """Have a scan removed by one of the next calls of `draw`."""
        row = self._rows.pop(number)
        self._node[row] = _GONE
        self._changed.append(row)

    def attached(self, number: int) -> tuple[T, int, FloatArray]:
        """Return a scan, its node, and the sensor's poses (2, 3) in the node's frame at its first and last beam."""
        row = self._rows[number]
        scan = self._scans[row]
        assert scan is not None
        return scan, int(self._node[row]), self._node_from_laser[row].copy()

    def move_nodes(self, nodes: FloatArray, near: FloatArray) -> None:
        """Take in the nodes' poses (N, 3) [m, m, rad] and the chair's position (2,) [m]; `draw` moves the scans."""
        known = len(self._nodes)
        if np.array_equal(nodes, self._nodes):
            return
        stand = np.array_equal(nodes[:known], self._nodes)
        self._nodes = nodes.copy()
        if not stand:
            rows = self._off_by_more_than(TOLERANCE * self._evidence.settings.resolution)
            rows = rows[~np.isin(rows, np.array(self._changed, np.int64))]
            away = np.hypot(*(self._places(rows)[:, 0, :2] - near).T)
            self._moved = rows[np.argsort(-away, kind="stable")].tolist()

    def draw(self, most_beams: int = BEAMS_PER_CALL) -> int:
        """Do pending work up to a number of beams, but one scan at least.

        Returns:
            The beams added and removed; a scan that is moved counts twice.

        Raises:
            MapError: the grid would become too large; the scans of this call are not in it.
        """
        rows: list[int] = []
        beams = 0
        while self.pending and beams < most_beams:
            row = self._changed.popleft() if self._changed else self._moved.pop()
            scan = self._scans[row]
            if scan is not None:
                rows.append(row)
                beams += 2 * self._evidence.beams(scan)
        every = np.unique(np.array(rows, np.int64))
        return sum(self._redraw(every[part]) for part in batches(len(every)))

    def settle(self) -> None:
        """Do all pending work, and also move scans that are off by less than the tolerance."""
        self._moved = self._off_by_more_than(0.0).tolist()
        while self.pending:
            self.draw()

    def _redraw(self, rows: IntArray) -> int:
        """Remove these rows' scans at outdated poses and add them at their present ones; return the beams."""
        gone = self._node[rows] == _GONE
        places = self._places(rows)
        off = gone | (self._drawn[rows] != places).any(axis=(1, 2))
        out, into = rows[off & np.isfinite(self._drawn[rows, 0, 0])], rows[off & ~gone]
        taken, drawn = self._scans_of(out), self._scans_of(into)
        self._evidence.remove(self._drawn[out, 0], self._drawn[out, 1], taken)
        self._drawn[out] = np.nan
        self._evidence.add(places[off & ~gone, 0], places[off & ~gone, 1], drawn)
        self._drawn[into] = places[off & ~gone]
        for row in rows[gone].tolist():
            self._scans[row] = None
            self._free.append(row)
        return sum(self._evidence.beams(scan) for scan in (*taken, *drawn))

    def _places(self, rows: IntArray) -> FloatArray:
        """Return the laser's poses (K, 2, 3) in map at the first and last beam of rows (K,), from the nodes' poses."""
        on = self._nodes[self._node[rows]]
        return compose(on[:, None], self._node_from_laser[rows])

    def _off_by_more_than(self, distance: float) -> IntArray:
        """Return the rows of scans that are not drawn, or whose beam ends may be off by more than `distance` [m]."""
        rows: IntArray = np.flatnonzero(self._node != _GONE)
        moved = self._places(rows) - self._drawn[rows]
        turned = 2.0 * np.abs(np.sin(0.5 * moved[..., 2])) * self._reach[rows, None]
        shift = (np.hypot(moved[..., 0], moved[..., 1]) + turned).max(axis=1)
        off: IntArray = rows[~(shift <= distance)]  # true for nan: not drawn
        return off

    def _scans_of(self, rows: IntArray) -> list[T]:
        return [scan for scan in (self._scans[row] for row in rows.tolist()) if scan is not None]

    def _make_rows(self) -> None:
        """Double the number of rows."""
        count = len(self._scans)
        more = max(count, 64)
        self._free = list(range(count + more - 1, count - 1, -1))
        self._scans += [None] * more
        self._node = np.concatenate([self._node, np.full(more, _GONE)])
        self._reach = np.concatenate([self._reach, np.zeros(more)])
        self._node_from_laser = np.concatenate([self._node_from_laser, np.zeros((more, 2, 3))])
        self._drawn = np.concatenate([self._drawn, np.full((more, 2, 3), np.nan)])


class GridAssembly(Assembly[Scan]):
    """An assembly of lidar scans."""

    def __init__(self, occupancy: OccupancySettings | None = None) -> None:
        self.cells = EvidenceGrid(occupancy)
        """The evidence drawn so far."""
        super().__init__(self.cells)

    def grid(self) -> OccupancyGrid:
        """Return a copy of the present grid; all unknown before anything is drawn."""
        return self.cells.grid()


class DepthAssembly(Assembly[DepthScan]):
    """An assembly of depth images."""

    def __init__(self, occupancy: OccupancySettings | None = None) -> None:
        self.cells = DepthEvidence(occupancy)
        """The evidence drawn so far."""
        super().__init__(self.cells)
