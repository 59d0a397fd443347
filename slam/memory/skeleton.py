"""The skeleton of the memory: the part of every node and link, also of those in long-term memory, that stays in RAM.

It takes about 60 B a node and 100 B a link. Arrays instead of objects: 36,000 nodes (10 h at 1 Hz) take 6 MB, up to twice
that just after growth, and the garbage collector has nothing to traverse. So the neighbours of any node are known
without disk access.

**Poses of nodes in long-term memory.** Each node is attached to an anchor, a key scan of the optimised graph, and moves
with it. That graph grows with the building and not with the time spent in it (`KeyGraph`), so its optimisation has a
bounded cost and no node must be marginalised. A loop closure moves the nodes in long-term memory at once: their pose is
one composition away. RTAB-Map optimises only nodes in working memory, and its grid shrinks to them. A full graph of all
nodes would also have exact poses, but its optimisation would take longer every hour.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Collection, Iterable, Iterator, Sequence

import numpy as np

from waychair.geometry import compose
from waychair.slam.memory.nodes import IN_TIME, Link, LinkKind, NodeStatus
from waychair.types import FloatArray, IntArray, Pose2

NODE = np.dtype(
    [
        ("stamp_ns", np.int64),
        ("entered_ns", np.int64),  # time at which it joined the WM, or was last near the chair
        ("map_id", np.int32),
        ("weight", np.int32),  # -1: an intermediate node
        ("anchor", np.int32),
        ("kept", np.int8),
        ("anchor_from_node", np.float64, 3),
    ]
)
LINK = np.dtype([("i_from_j", np.float64, 3), ("information", np.float64, (3, 3))])

ANY = frozenset(LinkKind)


class Skeleton:
    """Nodes by id, counted from 1, and links between them; a link belongs to both of its ends."""

    def __init__(self) -> None:
        self.rows = np.zeros(64, NODE)
        """Data of node k in row k; rows from `count` on are spare."""
        self.rows["anchor"][0] = -1  # there is no node 0
        self.count = 1
        self._links = np.zeros(64, LINK)
        # half-edge h is one end of link h >> 1, half-edge h ^ 1 the other; those of a node form a list
        self._ends = array("i")
        self._kinds = array("b")  # of links; a separate array for fast single look-ups
        self._first = array("i", [-1]) * 64
        self._after = array("i")
        self._free: list[int] = []
        self._neighbour_cache: dict[int, tuple[tuple[int, ...], tuple[int, ...]]] = {}  # cached neighbours
        self._attached: dict[int, list[int]] = {}  # nodes attached to an anchor

    def add(self, node: int, stamp_ns: int, map_id: int, anchor: int, anchor_from_node: Pose2) -> None:
        """Add a node to the STM; ids ascend and may have gaps."""
        if node < self.count:
            raise ValueError(f"node {node} already exists; the next id must be at least {self.count}")
        self.reserve(node + 1)
        self.rows[node] = (stamp_ns, 0, map_id, 0, anchor, NodeStatus.STM, anchor_from_node.array())
        self._attached.setdefault(anchor, []).append(node)

    def reserve(self, count: int) -> None:
        """Make the next node's id at least `count`; unused ids have empty rows."""
        while count > len(self.rows):
            self.rows = np.concatenate([self.rows, np.zeros_like(self.rows)])
            self._first.extend(array("i", [-1]) * len(self._first))
        self.count = max(self.count, count)

    def remove(self, node: int) -> None:
        """Remove a node and its links."""
        for link in self.links(node):
            self.unlink(link.i, link.j)
        self._attached[int(self.rows["anchor"][node])].remove(node)
        self.rows["kept"][node] = NodeStatus.GONE

    def kept(self, node: int) -> NodeStatus:
        """Return the memory that holds the node."""
        return NodeStatus(int(self.rows["kept"][node])) if 0 < node < self.count else NodeStatus.GONE

    def ids(self, *where: NodeStatus) -> list[int]:
        """Return the nodes in these memories (default: any), ascending; the cost grows with all ids."""
        return np.flatnonzero(np.isin(self.rows["kept"][: self.count], where or (1, 2, 3))).tolist()

    def link(self, link: Link) -> None:
        """Link two nodes; an existing link between them is replaced."""
        self.unlink(link.i, link.j)
        if self._free:
            row = self._free.pop()
        else:
            row = len(self._ends) // 2
            self._ends.extend((0, 0))
            self._after.extend((-1, -1))
            self._kinds.append(0)
            if row == len(self._links):
                self._links = np.concatenate([self._links, np.zeros_like(self._links)])
        self._invalidate(link.i, link.j)
        self._kinds[row] = link.kind
        self._links[row] = (link.i_from_j.array(), link.information)
        for half, node in ((2 * row, link.i), (2 * row + 1, link.j)):
            self._ends[half] = node
            self._after[half] = self._first[node]
            self._first[node] = half

    def unlink(self, i: int, j: int) -> bool:
        """Remove the link between two nodes; return whether there was one."""
        row = self._row(i, j)
        if row is None:
            return False
        self._invalidate(i, j)
        for half in (2 * row, 2 * row + 1):
            node = self._ends[half]
            if self._first[node] == half:
                self._first[node] = self._after[half]
                continue
            before = self._first[node]
            while self._after[before] != half:
                before = self._after[before]
            self._after[before] = self._after[half]
        self._free.append(row)
        return True

    def linked(self, i: int, j: int) -> Link | None:
        """Return the link from i to j, or None."""
        row = self._row(i, j)
        return None if row is None else self._link(row).from_node(i)

    def links(self, node: int, kinds: Collection[LinkKind] = ANY) -> list[Link]:
        """Return the links of a node, each with the node as `i`, the latest first."""
        found = (self._link(half >> 1).from_node(node) for half in self._halves(node))
        return [link for link in found if link.kind in kinds]

    def neighbours(self, node: int, kinds: Collection[LinkKind] = ANY) -> list[int]:
        """Return the nodes at the other ends of a node's links."""
        return [self._ends[half ^ 1] for half in self._halves(node) if self._kinds[half >> 1] in kinds]

    def steps(self, node: int) -> list[tuple[int, float]]:
        """Return the nodes at the other ends of a node's links, with the measured distances [m]."""
        rows = [(self._ends[half ^ 1], half >> 1) for half in self._halves(node)]
        return [(there, math.hypot(*self._links["i_from_j"][row, :2].tolist())) for there, row in rows]

    def every_link(self) -> Iterator[Link]:
        """Yield each link once."""
        free = set(self._free)
        return (self._link(row) for row in range(len(self._ends) // 2) if row not in free)

    def levels(self, start: int, most: int, kinds: Collection[LinkKind] = ANY) -> Iterator[list[int]]:
        """Yield the nodes 0, 1, ... `most` links away, each list in ascending order."""
        seen, level = {start}, [start]
        yield level
        for _ in range(most):
            following = {there for here in level for there in self.neighbours(here, kinds)} - seen
            if not following:
                return
            seen |= following
            level = sorted(following)
            yield level

    def attach(self, node: int, anchor: int, anchor_from_node: Pose2) -> None:
        """Attach the node to another anchor."""
        self._attached[int(self.rows["anchor"][node])].remove(node)
        self._attached.setdefault(anchor, []).append(node)
        self.rows["anchor"][node] = anchor
        self.rows["anchor_from_node"][node] = anchor_from_node.array()

    def attached_to(self, anchor: int) -> Sequence[int]:
        """Return the nodes attached to an anchor."""
        return self._attached.get(anchor, ())

    def anchor_from_node(self, node: int) -> Pose2:
        """Return the pose of the node relative to its anchor."""
        return Pose2(*self.rows["anchor_from_node"][node].tolist())

    def poses(self, nodes: Iterable[int] | IntArray, anchors: FloatArray) -> FloatArray:
        """Return the poses (K, 3) [m, m, rad] of nodes in the map for anchor poses (A, 3); nan for an anchor without a pose."""
        ids = np.fromiter(nodes, np.int64)
        on = self.rows["anchor"][ids]
        known = np.full((len(ids), 3), np.nan)
        there = (on >= 0) & (on < len(anchors))
        known[there] = anchors[on[there]]
        return compose(known, self.rows["anchor_from_node"][ids])

    def cached_neighbours(self, node: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Return a node's neighbours along the drive, and those by appearance loops.

        The result is cached until a link changes, so calls for every frame cost nothing at places with many links.
        """
        known = self._neighbour_cache.get(node)
        if known is None:
            known = tuple(self.neighbours(node, IN_TIME)), tuple(self.neighbours(node, (LinkKind.GLOBAL,)))
            self._neighbour_cache[node] = known
        return known

    def neighbours_in_time(self, node: int) -> tuple[int, ...]:
        """Return a node's neighbours along the drive."""
        return self.cached_neighbours(node)[0]

    def _invalidate(self, *nodes: int) -> None:
        for node in nodes:
            self._neighbour_cache.pop(node, None)

    def _halves(self, node: int) -> Iterator[int]:
        half = self._first[node]
        while half >= 0:
            yield half
            half = self._after[half]

    def _row(self, i: int, j: int) -> int | None:
        return next((half >> 1 for half in self._halves(i) if self._ends[half ^ 1] == j), None)

    def _link(self, row: int) -> Link:
        measured, information = self._links[row]
        i, j = self._ends[2 * row], self._ends[2 * row + 1]
        return Link(i, j, LinkKind(self._kinds[row]), Pose2(*measured.tolist()), information.copy())
