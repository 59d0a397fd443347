"""A growing pose graph: solved on from its last solution while the chair drives, and judged where a loop is in doubt.

A node that closes no loop costs nothing. A loop costs one to three Levenberg-Marquardt steps over the whole graph, about
1 ms each at 1,000 nodes and 6 ms at 5,000. On the Intel graph, fed node by node, that is less than the incremental solver
iSAM2 needs for the part that a loop bends (2 ms, 95 %: 8 ms), and the solution is the optimum after every loop.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from waychair.errors import GraphError
from waychair.geometry import compose, invert
from waychair.slam.graph.edges import Edge, EdgeArrays, EdgeKind, EdgeTable, chi_square
from waychair.slam.graph.judgement import Judgement
from waychair.slam.graph.least_squares import PoseGraphProblem, is_tree
from waychair.slam.graph.robust_optimisation import (
    LOOP_LIMIT,
    MATCH_KERNEL,
    REJECTION_COST,
    RejectedLoop,
    RejectionReason,
    Solution,
    solve,
)
from waychair.types import FloatArray, IntArray

_STEPS = 6
"""Levenberg-Marquardt steps after new loops; a graph that needs more has a loop in doubt."""

_REVIEW = 4
"""Number of rejected loops at which all are first reviewed; later whenever the number has doubled."""

_NODES_A_JUDGEMENT = 50
"""After a solution of the whole graph that rejected loops, the next may come when the graph has grown by one fiftieth."""

_NODES_A_SLICE = 15_000
"""Nodes solved in one piece of a judgement: three steps over 5,000, some 20 ms."""

_NODES_AN_ORDER = 20
"""A new order of elimination is sought when the graph has grown by one twentieth."""


@dataclass(frozen=True, slots=True)
class _Order:
    """The order in which the nodes after the first are eliminated, and the number of nodes from which a better one is sought."""

    nodes: IntArray | None
    until: int


@dataclass(frozen=True, slots=True)
class _Due:
    """The number of nodes from which loops in doubt are judged again, and that of rejected loops from which all are reviewed."""

    judgement: int = 0
    review: int = _REVIEW


class PoseGraph:
    """Nodes and edges in the order in which they were added; `poses` (N, 3) are those of the last `update`.

    `poses` is a new array whenever a node has moved. While nodes are only added, the longer array shares the memory of
    the shorter one, except when the buffer has to grow.

    `rejected` holds the rejected loops with reasons. They are checked again whenever the whole graph is solved.
    """

    _judgement: Judgement | None = None  # of the class, since older drives were stored without them
    _due = _Due()

    def __init__(self) -> None:
        self.poses: FloatArray = np.empty((0, 3))
        self._buffer = self.poses  # buffer of poses, with spare rows
        self._edges: list[Edge] = []
        self._table = EdgeTable()  # the same edges
        self._rejected: dict[int, RejectedLoop] = {}  # by the edge's index in the list
        self._removed: list[RejectedLoop] = []
        self._connected = 1  # nodes below this number have an edge to an earlier node
        self._closes_cycle = False  # whether an edge since the last update closes a cycle
        self._is_solved = False  # whether `poses` continue a solution of the edges that are known
        self._known_edges = 0
        self._parked: set[int] = set()  # rejected loops that no solution has judged yet
        self._due = _Due()
        self._judgement = None
        self._cost = 0.0  # sum of robust chi-squares at the last solution
        self._order: _Order | None = None

    @property
    def edges(self) -> tuple[Edge, ...]:
        """The accepted edges, which determine the poses."""
        return tuple(edge for k, edge in enumerate(self._edges) if k not in self._rejected)

    @property
    def edge_arrays(self) -> EdgeArrays:
        """The accepted edges as arrays; valid until the next change."""
        if not self._rejected:
            return self._table.arrays
        accepted = np.ones(len(self._edges), bool)
        accepted[list(self._rejected)] = False
        return self._table.arrays.take(np.flatnonzero(accepted))

    @property
    def rejected(self) -> tuple[RejectedLoop, ...]:
        """The rejected loops and the removed loops."""
        return (*self._rejected.values(), *self._removed)

    def add(self, poses: FloatArray, edges: Sequence[Edge]) -> None:
        """Add nodes at poses (K, 3) in the frame of node 0, and edges among all nodes.

        Raises:
            GraphError: an edge names a missing node, or a value is not finite. Nothing is then added.
        """
        count = len(self.poses) + len(poses)
        for edge in edges:
            if not (0 <= edge.i < count and 0 <= edge.j < count and edge.i != edge.j):
                raise GraphError(f"edge {edge.i}-{edge.j} does not join two of the {count} nodes; add the nodes first")
            if not (np.isfinite(edge.i_from_j.array()).all() and np.isfinite(edge.information).all()):
                raise GraphError(f"edge {edge.i}-{edge.j} has a value that is not finite; remove it")
        if not np.isfinite(poses).all():
            raise GraphError("a new node's pose is not finite; omit the node")
        self._append(poses)
        self._table.append(edges)
        for edge in edges:
            self._edges.append(edge)
            extends = edge.kind is not EdgeKind.LOOP and max(edge.i, edge.j) == self._connected
            self._connected += extends
            self._closes_cycle |= not extends

    def _append(self, poses: FloatArray) -> None:
        """Append rows to the buffer of poses; existing rows stay in place while there are spare rows."""
        known, count = len(self.poses), len(self.poses) + len(poses)
        if self.poses.base is not self._buffer or count > len(self._buffer):
            self._buffer = np.zeros((max(64, 2 * count), 3))  # spare rows are saved, too: a file holds no old memory
            self._buffer[:known] = self.poses
        self._buffer[known:count] = poses
        self.poses = self._buffer[:count]

    def update(self) -> FloatArray:
        """Return poses (N, 3) that fit all edges so far, except loops in doubt.

        While every node has one edge to an earlier node, the poses already fit and nothing is done. When an edge closes
        a cycle, the solution goes on from the last one. If the new loops raise the cost by more than
        the rejection of a loop costs, or a loop does not fit, they are left out until the whole graph has been judged.
        That begins at once, or, soon after a judgement that has rejected loops, when the graph has grown. Each update
        does a piece of it.

        Raises:
            GraphError: the graph is not connected, or the equations cannot be solved.
        """
        if self._closes_cycle or self._connected < len(self.poses):
            before, known = self.poses, self._known_edges
            if not self._is_solved:
                self._begin_judgement(self.poses)
                self._judge(math.inf)
            elif not self._solve_on():
                doubted = self.poses
                self._park(before, known)
                self._begin_if_due(doubted)
            self._closes_cycle = False
        self._begin_if_due(self.poses)
        self._judge(_NODES_A_SLICE)
        return self.poses

    @property
    def is_judging(self) -> bool:
        """Whether a judgement is under way, which further updates go on with."""
        return self._judgement is not None

    def _begin_if_due(self, start: FloatArray) -> None:
        """Begin a judgement from poses (N, 3) if loops wait for one, none is under way, and the graph has grown enough."""
        if self._parked and self._judgement is None and len(self.poses) >= self._due.judgement:
            self._begin_judgement(start)

    def _begin_judgement(self, start: FloatArray, of_all: bool = False) -> None:
        """Begin to solve the whole graph with the loops that wait for it, without those rejected before unless it is `of_all`."""
        left_out = set() if of_all else self._rejected.keys() - self._parked
        inside = [k for k in range(len(self._edges)) if k not in left_out]
        self._judgement = Judgement(start, [self._edges[k] for k in inside], inside, len(self._edges))

    def _judge(self, most: float) -> None:
        """Go on with the judgement until at least `most` nodes are solved, and review all rejected loops now and then."""
        while (judgement := self._judgement) is not None and most > 0:
            self._judgement = None  # an error ends it
            solution, spent = judgement.go_on(most)
            most -= spent
            if solution is None:
                self._judgement = judgement
            else:
                self._take(judgement, solution)

    def _take(self, judgement: Judgement, solution: Solution) -> None:
        """Take over a solution, and solve on with what has come since its judgement began."""
        asked = set(judgement.numbers)
        left_out = [judgement.numbers[k] for k in np.flatnonzero(~solution.accepted).tolist()]
        self._rejected = {k: loop for k, loop in self._rejected.items() if k not in asked}
        self._rejected |= dict(zip(left_out, solution.rejected, strict=True))
        self._parked -= asked
        self.poses = _joined_rigidly(solution.poses, self.poses)
        self._settle()
        if judgement.known < len(self._edges):
            self._rejected = {k: loop for k, loop in self._rejected.items() if k not in self._parked}
            self._parked, self._known_edges, joined = set(), judgement.known, self.poses
            if not self._solve_on():
                self._park(joined, judgement.known)
        if judgement.is_of_all:
            self._due = replace(self._due, review=2 * len(self._rejected) + _REVIEW)
        if left_out:  # the dear case: no other before the graph has grown
            self._due = replace(self._due, judgement=len(self.poses) + len(self.poses) // _NODES_A_JUDGEMENT)
        if len(self._rejected) >= self._due.review:  # perhaps an older loop is false
            self._begin_judgement(self.poses, of_all=True)

    def _park(self, poses: FloatArray, known: int) -> None:
        """Leave the loops from edge `known` on out, at the poses without them, until the next judgement is due."""
        self.poses = poses
        fresh = [k for k in range(known, len(self._edges)) if self._edges[k].kind is EdgeKind.LOOP]
        against = chi_square(poses, [self._edges[k] for k in fresh])
        for k, value in zip(fresh, against.tolist(), strict=True):
            self._rejected[k] = RejectedLoop(self._edges[k], RejectionReason.CONTRADICTED, value, LOOP_LIMIT)
        self._parked |= set(fresh)
        self._settle()

    def solve(self) -> Solution:
        """Solve the whole graph from the present poses, check every loop again, and set `poses` to the solution.

        Raises:
            GraphError: the graph is not connected, or the equations cannot be solved.
        """
        solution = solve(self.poses, self._edges, solved_before=True)
        self.poses, self._parked, self._judgement = solution.poses, set(), None
        left_out = np.flatnonzero(~solution.accepted).tolist()
        self._rejected = dict(zip(left_out, solution.rejected, strict=True))
        if not is_tree(self._table.arrays, len(self.poses)):
            self._settle()
        return replace(solution, rejected=self.rejected)

    def remove(self, edges: Collection[Edge]) -> None:
        """Remove edges permanently; loops among them stay listed in `rejected`. The next `update` solves the rest.

        Raises:
            GraphError: an edge is not in the graph.
        """
        going = {id(edge) for edge in edges}
        gone = [k for k, edge in enumerate(self._edges) if id(edge) in going]
        if len(gone) == len(going):
            self._remove(gone)
        else:
            raise GraphError(f"{len(going) - len(gone)} of the edges to remove are not in the graph; remove each once")

    def replace(self, old: Edge, new: Edge) -> None:
        """Put an edge in the place of one between the same nodes that is no loop.

        If no solution knows the old edge yet, the later of its nodes and all nodes after it move rigidly, so that the new
        edge fits; else the next `update` solves the whole graph.

        Raises:
            GraphError: there is no such edge, or the new one joins other nodes or is a loop.
        """
        index = next((k for k, edge in enumerate(self._edges) if edge is old), None)
        if index is None or (old.i, old.j) != (new.i, new.j) or EdgeKind.LOOP in (old.kind, new.kind):
            raise GraphError(f"edge {old.i}-{old.j} cannot be replaced; give an edge of the graph that is no loop")
        self._replace(index, new)

    def _replace(self, index: int, new: Edge) -> None:
        """Put an edge in the place of the edge at this index."""
        self._edges[index], self._judgement = new, None
        self._table.replace(index, new)
        if index < self._known_edges or new.j < new.i:
            self._is_solved, self._closes_cycle = False, True
            return
        moved = compose(compose(self.poses[new.i], new.i_from_j.array()), invert(self.poses[new.j]))
        self.poses = np.concatenate([self.poses[: new.j], compose(moved, self.poses[new.j :])])

    def _remove(self, gone: list[int]) -> None:
        """Remove the edges at these indices."""
        loops = [self._edges[k] for k in gone if self._edges[k].kind is EdgeKind.LOOP]
        against = chi_square(self.poses, loops) if loops else ()
        self._removed += [
            RejectedLoop(edge, RejectionReason.REMOVED, float(value), LOOP_LIMIT)
            for edge, value in zip(loops, against, strict=True)
        ]
        kept = [k for k in range(len(self._edges)) if k not in set(gone)]
        self._rejected = {new: self._rejected[old] for new, old in enumerate(kept) if old in self._rejected}
        self._parked = {new for new, old in enumerate(kept) if old in self._parked}
        self._edges = [self._edges[k] for k in kept]
        self._table.keep(kept)
        self._is_solved, self._closes_cycle, self._judgement = False, True, None

    def _solve_on(self) -> bool:
        """Solve the accepted edges from the present poses; return False if that fails, or a new loop stays in doubt."""
        if not self._is_solved:
            return False
        count, before = len(self.poses), self._cost
        if self._order is not None and count >= self._order.until:
            self._order = None
        problem = self._problem()
        try:
            self.poses = problem.solve(self.poses, iterations=_STEPS)
        except GraphError:
            return False
        if self._order is None:
            self._order = _Order(problem.elimination_order, count + count // _NODES_AN_ORDER + 1)
        fresh, self._known_edges = self._table.arrays.take(slice(self._known_edges, None)), len(self._edges)
        self._cost = problem.cost(self.poses)
        if self._cost - before > REJECTION_COST:
            return False
        return not fresh.loop.any() or float(chi_square(self.poses, fresh)[fresh.loop].max()) < LOOP_LIMIT

    def _settle(self) -> None:
        """Take the present poses as the solution of all edges so far."""
        self._cost, self._known_edges, self._is_solved = self._problem().cost(self.poses), len(self._edges), True

    def _problem(self) -> PoseGraphProblem:
        """Return the problem of the accepted edges."""
        return PoseGraphProblem(self.edge_arrays, MATCH_KERNEL, None if self._order is None else self._order.nodes)


def _joined_rigidly(solved: FloatArray, poses: FloatArray) -> FloatArray:
    """Return poses (N, 3) of which the first are `solved` (K, 3), and the others lie as before, seen from the last of these."""
    count = len(solved)
    if count == len(poses):
        return solved
    moved = compose(solved[-1], invert(poses[count - 1]))
    return np.concatenate([solved, compose(moved, poses[count:])])
