"""Weighted least squares over a pose graph: Levenberg-Marquardt with sparse factors, under kernels and weights.

The residual of an edge is the SE(2) logarithm, as in `edges.residuals`, and a step moves each pose along its exponential, so
that one Gauss-Newton step is exact to second order. The Levenberg-Marquardt steps follow gtsam's rules. scipy.sparse is
loaded by the first graph that needs it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit

from waychair.errors import GraphError
from waychair.geometry import compose, invert
from waychair.resumable import CountedSteps, finished
from waychair.slam.graph.block_cholesky import BlockCholesky, Structure, structure_of
from waychair.slam.graph.edges import EdgeArrays, chi_square
from waychair.types import BoolArray, FloatArray, IntArray

_PLAIN, _HUBER, _SWITCHED = 0, 1, 2  # kernels of an edge: none, Huber's, dynamic covariance scaling
_FIRST_DAMPING, _MOST_DAMPING, _DAMPING_STEP = 1e-5, 1e5, 10.0  # added to the diagonal [1/m^2], [1/rad^2]
_LEAST_FIDELITY = 1e-3  # least share of the expected gain for which a step is taken
_LEAST_GAIN = 1e-5  # relative, and absolute; a step that gains less is the last
_FORESEEN = (
    0.1  # share of the least gain; if the step gained what the equations said up to this, the next one gains less
)


class PoseGraphProblem:
    """One graph to be solved: node 0 fixed, and a Huber kernel of `match_kernel` [sigma] on every edge except loops.

    With `match_kernel` None there is no kernel. `order` is that of an earlier problem of the same graph (`elimination_order`),
    which had fewer nodes and edges.
    """

    def __init__(self, edges: EdgeArrays, match_kernel: float | None, order: IntArray | None = None) -> None:
        self.edges = edges
        self._known_order = order
        self._width = math.inf if match_kernel is None else match_kernel
        self._kernels = np.where(edges.loop, _PLAIN, _HUBER if match_kernel is not None else _PLAIN)
        self._structures: dict[bytes, tuple[Structure, IntArray]] = {}  # of the latest set of edges

    def solve(
        self, poses: FloatArray, weights: FloatArray | None = None, iterations: int = 50, damped: bool = True
    ) -> FloatArray:
        """Return poses (N, 3) after Levenberg-Marquardt (`damped` False: Gauss-Newton) steps from `poses`.

        `weights` (E,) in [0, 1] scale the information of the edges; edges of weight 0 are ignored.

        Raises:
            GraphError: the equations cannot be solved.
        """
        return finished(self.solving(poses, weights, iterations, damped))

    def solving(
        self, poses: FloatArray, weights: FloatArray | None = None, iterations: int = 50, damped: bool = True
    ) -> CountedSteps[FloatArray]:
        """Return the work of `solve`, a step at a time."""
        each = np.ones(len(self.edges)) if weights is None else weights
        kernels = np.where(each == 1.0, self._kernels, _PLAIN)
        return self._optimised(poses, each, kernels, 0.0, iterations, damped)

    def solving_switchable(self, poses: FloatArray, scale: float, iterations: int = 50) -> CountedSteps[FloatArray]:
        """Return the work towards the poses (N, 3) with each loop weighted down by its own residual, a step at a time.

        This is dynamic covariance scaling (Agarwal et al., ICRA 2013, eq. 15), the closed form of switchable
        constraints. A loop with a chi-square below `scale` has full weight.
        """
        kernels = np.where(self.edges.loop, _SWITCHED, self._kernels)
        return self._optimised(poses, np.ones(len(self.edges)), kernels, scale, iterations, True)

    def cost(self, poses: FloatArray) -> float:
        """Return the sum over all edges of their chi-squares under the kernels."""
        return 2.0 * self._cost(poses, np.ones(len(self.edges)), self._kernels, 0.0)

    def innovations(
        self, poses: FloatArray, weights: FloatArray, wanted: IntArray
    ) -> CountedSteps[tuple[FloatArray, FloatArray]]:
        """Work out the chi-square (K,) of the innovation of each wanted edge against the solution of the weighted others,
        and the volume (K,) [m^2 rad] of its unit ellipsoid.

        Unlike the residual, the innovation accounts for the uncertainty between the two nodes: to first order, it is the
        cost of adding the edge.

        Raises:
            numpy.linalg.LinAlgError: the weighted edges leave nodes loose.
        """
        factor = self._factor(poses, weights)
        found, volumes = np.empty(len(wanted)), np.empty(len(wanted))
        for k in range(len(wanted)):
            away, share = self._share(factor, poses, wanted[k : k + 1], 1.0)
            expected = np.eye(3) + share
            found[k] = away @ np.linalg.solve(expected, away)
            volumes[k] = 4.0 / 3.0 * math.pi * math.sqrt(np.linalg.det(expected))
            yield len(poses)
        return found, volumes / np.sqrt(np.linalg.det(self.edges.information[wanted]))

    def group_innovations(self, poses: FloatArray, weights: FloatArray, groups: Sequence[IntArray]) -> FloatArray:
        """Return the chi-square (K,) of the joint innovation of each group of edges against all other weighted edges.

        With the group's whitened residuals r and their share K = J H^-1 J' in the solution, it is r' (I - K)^-1 r: to first
        order, the cost of adding the whole group to the rest. All edges of a group have a weight above 0.

        Raises:
            numpy.linalg.LinAlgError: the weighted edges leave nodes loose.
        """
        factor = self._factor(poses, weights)
        found = np.empty(len(groups))
        for k, members in enumerate(groups):
            away, share = self._share(factor, poses, members, weights[members])
            found[k] = away @ np.linalg.solve((1 + 1e-9) * np.eye(len(away)) - share, away)
        return found

    def _factor(self, poses: FloatArray, weights: FloatArray) -> BlockCholesky:
        """Return the factor of the normal equations at the poses, with the weighted edges."""
        kernels = np.where(weights == 1.0, self._kernels, _PLAIN)
        structure, diagonal, below, _ = self._equations(poses, weights, kernels, 0.0)
        return BlockCholesky(structure, diagonal, below)

    def _share(
        self, factor: BlockCholesky, poses: FloatArray, members: IntArray, weights: FloatArray | float
    ) -> tuple[FloatArray, FloatArray]:
        """Return the whitened residuals r (3K,) of some edges at the poses, and J H^-1 J' (3K, 3K) of their Jacobian J."""
        edges, columns = self.edges, np.arange(3 * len(members)).reshape(-1, 3)
        i, j = edges.i[members], edges.j[members]
        away, *jacobians = _linearised(poses, i, j, edges.i_from_j[members])
        whitening = np.linalg.cholesky(edges.information[members] * np.reshape(weights, (-1, 1, 1))).transpose(0, 2, 1)
        first, second = (whitening @ jacobian for jacobian in jacobians)
        right = np.zeros((len(poses), 3, columns.size))
        for k in range(len(members)):
            right[i[k]][:, columns[k]] += first[k].T
            right[j[k]][:, columns[k]] += second[k].T
        solved = np.zeros_like(right)
        solved[1:] = factor.solve(right[1:])
        share: FloatArray = (first @ solved[i] + second @ solved[j]).reshape(columns.size, columns.size)
        return np.einsum("eij,ej->ei", whitening, away).ravel(), share

    @property
    def elimination_order(self) -> IntArray | None:
        """The order (N - 1,) in which the nodes after the first were eliminated last; None before a solution."""
        return next((structure.order for structure, _ in self._structures.values()), None)

    def _structure(self, kept: BoolArray, count: int) -> tuple[Structure, IntArray]:
        """Return the structure of the equations of the kept edges, and the block of each edge; node 0 is no unknown."""
        name = kept.tobytes()
        if name not in self._structures:
            i, j = np.where(kept, self.edges.i - 1, -1), np.where(kept, self.edges.j - 1, -1)
            structure = structure_of(i, j, count - 1, self._known_order)
            self._structures = {name: (structure, structure.slots(i, j))}
        return self._structures[name]

    def _equations(
        self, poses: FloatArray, weights: FloatArray, kernels: IntArray, scale: float
    ) -> tuple[Structure, FloatArray, FloatArray, FloatArray]:
        """Return the normal equations at the poses: their structure, blocks on and below the diagonal, and right side (N - 1, 3).

        A step is the solution for the right side.
        """
        edges = self.edges
        structure, slots = self._structure(weights > 0, len(poses))
        away, first, second = _linearised(poses, edges.i, edges.j, edges.i_from_j)
        chi_squares = weights * np.einsum("ei,eij,ej->e", away, edges.information, away)
        believed = weights * _beliefs(chi_squares, kernels, self._width, scale)
        return structure, *_assembled(
            edges.i, edges.j, edges.information, away, first, second, believed, slots, structure.position,
            len(structure.rows),
        )  # fmt: skip

    def _cost(self, poses: FloatArray, weights: FloatArray, kernels: IntArray, scale: float) -> float:
        """Return half the sum of the weighted chi-squares under the kernels."""
        return _sum_of_costs(weights * chi_square(poses, self.edges), kernels, self._width, scale)

    def _optimised(
        self, poses: FloatArray, weights: FloatArray, kernels: IntArray, scale: float, iterations: int, damped: bool
    ) -> CountedSteps[FloatArray]:
        """Work out the poses after so many steps, or fewer where a step gains next to nothing."""
        present, damping = poses.copy(), _FIRST_DAMPING if damped else 0.0
        cost = self._cost(present, weights, kernels, scale)
        for _ in range(iterations if len(poses) > 1 else 0):
            structure, diagonal, below, right = self._equations(present, weights, kernels, scale)
            before, unforeseen = cost, math.inf
            while damping < _MOST_DAMPING:
                step = _step(structure, diagonal + damping * np.eye(3), below, right)
                if step is None and not damped:
                    raise unsolvable(poses)
                if step is not None:
                    tried = present.copy()
                    tried[1:] = compose(present[1:], _exponential(step))
                    new = self._cost(tried, weights, kernels, scale)
                    gain = 0.5 * float((step * right).sum() + damping * (step**2).sum())
                    if not damped or (gain > 0 and cost - new > _LEAST_FIDELITY * gain):
                        unforeseen = abs(cost - new - gain)
                        present, cost, damping = tried, new, damping / _DAMPING_STEP
                        break
                    if abs(cost - new) < _LEAST_GAIN * cost:
                        break
                damping *= _DAMPING_STEP
            if not math.isfinite(cost):
                raise unsolvable(poses)
            yield len(poses)
            least = max(_LEAST_GAIN * before, _LEAST_GAIN)
            if before - cost <= least or (damped and unforeseen <= _FORESEEN * least):
                break
        return present


def _step(structure: Structure, diagonal: FloatArray, below: FloatArray, right: FloatArray) -> FloatArray | None:
    """Return the step (N - 1, 3) that solves the normal equations, or None if they are singular."""
    try:
        factor = BlockCholesky(structure, diagonal, below)
    except np.linalg.LinAlgError:
        return None
    step: FloatArray = factor.solve(right[:, :, None])[:, :, 0]
    return step


def unsolvable(poses: FloatArray) -> GraphError:
    """Return the error for a graph whose equations are singular."""
    return GraphError(f"the pose graph of {len(poses)} nodes cannot be solved; check the information of its edges")


def _exponential(twists: FloatArray) -> FloatArray:
    """Return the poses (N, 3) reached by twists (N, 3) in unit time."""
    turn = twists[:, 2]
    small = np.abs(turn) < 1e-10
    safe = np.where(small, 1.0, turn)
    along, across = np.where(small, 1.0, np.sin(safe) / safe), np.where(small, 0.5 * turn, (1 - np.cos(safe)) / safe)
    x, y = along * twists[:, 0] - across * twists[:, 1], across * twists[:, 0] + along * twists[:, 1]
    return np.stack([x, y, turn], axis=1)


def _beliefs(chi_squares: FloatArray, kernels: IntArray, width: float, scale: float) -> FloatArray:
    """Return the weights (E,) that the kernels give to edges with these chi-squares (see `_sum_of_costs`)."""
    beliefs = np.ones(len(chi_squares))
    tails = (kernels == _HUBER) & (chi_squares > width**2)
    beliefs[tails] = width / np.sqrt(chi_squares[tails])
    switched = (kernels == _SWITCHED) & (chi_squares > scale)
    beliefs[switched] = (2 * scale / (scale + chi_squares[switched])) ** 2
    return beliefs


def _sum_of_costs(chi_squares: FloatArray, kernels: IntArray, width: float, scale: float) -> float:
    """Return half the sum of chi-squares (E,) under their kernels, of the width of Huber's and the scale of the switched ones."""
    costs = 0.5 * chi_squares
    tails = (kernels == _HUBER) & (chi_squares > width**2)
    costs[tails] = width * (np.sqrt(chi_squares[tails]) - 0.5 * width)
    switched = (kernels == _SWITCHED) & (chi_squares > scale)
    costs[switched] = 2 * scale * chi_squares[switched] / (scale + chi_squares[switched]) - 0.5 * scale
    return float(costs.sum())


@njit(cache=True)
def _linearised(
    poses: FloatArray, i: IntArray, j: IntArray, measured: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the residuals (E, 3), and their derivatives (E, 3, 3) by a step of node i and of node j in its own frame."""
    away, first, second = np.empty((len(i), 3)), np.empty((len(i), 3, 3)), np.empty((len(i), 3, 3))
    for e in range(len(i)):
        xi, yi, ti = poses[i[e], 0], poses[i[e], 1], poses[i[e], 2]
        c, s = math.cos(ti), math.sin(ti)
        dx, dy, turn = poses[j[e], 0] - xi, poses[j[e], 1] - yi, poses[j[e], 2] - ti
        bx, by = c * dx + s * dy, c * dy - s * dx  # j in i, as it is
        c, s = math.cos(measured[e, 2]), math.sin(measured[e, 2])
        dx, dy = bx - measured[e, 0], by - measured[e, 1]
        gx, gy, w = c * dx + s * dy, c * dy - s * dx, turn - measured[e, 2]
        w -= 2.0 * math.pi * math.floor((w + math.pi) / (2.0 * math.pi))
        half = 0.5 * w
        along = 1.0 if abs(half) < 1e-6 else half / math.tan(half)
        x, y = along * gx + half * gy, along * gy - half * gx
        away[e, 0], away[e, 1], away[e, 2] = x, y, w
        bent = 0.0 if abs(w) < 1e-6 else (1.0 - along) / w  # inverse of the right Jacobian of SE(2)
        right = second[e]
        right[0, 0], right[0, 1], right[0, 2] = along, -half, x * bent + 0.5 * y
        right[1, 0], right[1, 1], right[1, 2] = half, along, y * bent - 0.5 * x
        right[2, 0], right[2, 1], right[2, 2] = 0.0, 0.0, 1.0
        c, s = math.cos(turn), math.sin(turn)
        mx, my = s * bx - c * by, c * bx + s * by  # minus the adjoint of i in j, times it from the left
        for k in range(3):
            first[e, k, 0] = -(right[k, 0] * c - right[k, 1] * s)
            first[e, k, 1] = -(right[k, 0] * s + right[k, 1] * c)
            first[e, k, 2] = -(right[k, 0] * mx + right[k, 1] * my + right[k, 2])
    return away, first, second


@njit(cache=True)
def _assembled(
    i: IntArray, j: IntArray, information: FloatArray, away: FloatArray, first: FloatArray, second: FloatArray,
    weights: FloatArray, slots: IntArray, position: IntArray, blocks: int,
) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Return the blocks of the normal equations on the diagonal (N, 3, 3) and below it (B, 3, 3), and the right side (N, 3).

    `slots` (E,): the block of each edge. Node k + 1 is row k.
    """
    diagonal, below, right = np.zeros((len(position), 3, 3)), np.zeros((blocks, 3, 3)), np.zeros((len(position), 3))
    known, told = np.empty((3, 3)), np.empty((3, 3))
    for e in range(len(i)):
        if weights[e] == 0.0:
            continue
        for side in range(2):
            jacobian, node = (first[e], i[e] - 1) if side == 0 else (second[e], j[e] - 1)
            other = second[e] if side == 0 else first[e]
            if node < 0:
                continue
            for a in range(3):
                for b in range(3):
                    known[a, b] = weights[e] * (
                        jacobian[0, a] * information[e, 0, b]
                        + jacobian[1, a] * information[e, 1, b]
                        + jacobian[2, a] * information[e, 2, b]
                    )
            for a in range(3):
                for b in range(3):
                    diagonal[node, a, b] += (
                        known[a, 0] * jacobian[0, b] + known[a, 1] * jacobian[1, b] + known[a, 2] * jacobian[2, b]
                    )
                    told[a, b] = known[a, 0] * other[0, b] + known[a, 1] * other[1, b] + known[a, 2] * other[2, b]
                right[node, a] -= known[a, 0] * away[e, 0] + known[a, 1] * away[e, 1] + known[a, 2] * away[e, 2]
            if slots[e] >= 0 and position[node] > position[i[e] + j[e] - 2 - node]:
                for a in range(3):
                    for b in range(3):
                        below[slots[e], a, b] += told[a, b]
    return diagonal, below, right


def least_squares(poses: FloatArray, edges: EdgeArrays, iterations: int = 100) -> FloatArray:
    """Return the poses (N, 3) with the least sum of chi-squares: no kernels, no edge rejected.

    The solver runs from the given poses and from a spectral initialisation, and the better solution is returned: the
    given start of a real graph (MIT's) may lie in a local minimum.

    Raises:
        GraphError: as `check_graph`, or the equations cannot be solved.
    """
    from waychair.slam.graph.pose_synchronisation import spectral_poses

    check_graph(poses, edges)
    problem = PoseGraphProblem(edges, None)
    starts = (poses, with_first_pose(spectral_poses(edges, len(poses)), poses[0]))
    solutions = [problem.solve(start, iterations=iterations) for start in starts]
    return min(solutions, key=lambda solution: float(chi_square(solution, edges).sum()))


def with_first_pose(poses: FloatArray, first: FloatArray) -> FloatArray:
    """Return the poses (N, 3) moved rigidly so that node 0 is at `first` (3,)."""
    return compose(compose(first, invert(poses[0])), poses)


def joined_weights(edges: EdgeArrays, weights: FloatArray, against: FloatArray, count: int) -> FloatArray:
    """Return the weights (E,) with 1 for the few edges of weight 0 without which the `count` nodes fall apart.

    Of the edges that join two parts, those of least chi-square `against` (E,) are taken.
    """
    part = connected_parts(edges.i[weights > 0], edges.j[weights > 0], count)
    if not part.any():
        return weights
    joined = weights.copy()
    missing = np.flatnonzero(weights == 0)
    for edge in missing[np.argsort(against[missing])].tolist():
        one, other = part[edges.i[edge]], part[edges.j[edge]]
        if one != other:
            joined[edge] = 1.0
            part[part == other] = one
    return joined


def connected_parts(i: IntArray, j: IntArray, count: int) -> IntArray:
    """Return the connected part (count,), from 0 on, of each of `count` nodes that are linked from `i` (E,) to `j` (E,)."""
    return _parts(i, j, count)


@njit(cache=True)
def _parts(i: IntArray, j: IntArray, count: int) -> IntArray:
    """Return the part (count,) of each node: every node points to an earlier one of its part, and the first to itself."""
    first, part, found = np.arange(count), np.empty(count, np.int64), 0
    for k in range(len(i)):
        a, b = i[k], j[k]
        while first[a] != a:
            first[a] = first[first[a]]
            a = first[a]
        while first[b] != b:
            first[b] = first[first[b]]
            b = first[b]
        first[max(a, b)] = min(a, b)
    for k in range(count):
        if first[k] == k:
            part[k], found = found, found + 1
        else:
            part[k] = part[first[k]]
    return part


def is_tree(edges: EdgeArrays, count: int) -> bool:
    """Return whether each of `count` nodes after the first hangs on one earlier node, so that the edges give the poses."""
    hung = np.sort(edges.j)
    return len(hung) == count - 1 and bool((edges.i < edges.j).all() and (hung == np.arange(1, count)).all())


def check_graph(poses: FloatArray, edges: EdgeArrays) -> None:
    """Check that poses (N, 3) and edges form one connected graph.

    Raises:
        GraphError: an edge names a missing node, a value is not finite, or the graph is not connected.
    """
    count, ends = len(poses), np.concatenate([edges.i, edges.j])
    if len(ends) and not (ends.min() >= 0 and ends.max() < count):
        stray = ends.min() if ends.min() < 0 else ends.max()
        raise GraphError(f"an edge names node {stray} of a graph of {count}; add the node or remove the edge")
    if not (np.isfinite(edges.i_from_j).all() and np.isfinite(edges.information).all() and np.isfinite(poses).all()):
        raise GraphError("a pose or an edge of the graph is not finite; remove it")
    if is_tree(edges, count):
        return
    label = connected_parts(edges.i, edges.j, count)
    if (parts := int(label.max(initial=0)) + 1) > 1:
        loose = int(np.flatnonzero(label != label[0])[0])
        raise GraphError(f"no edges connect node {loose} with node 0; add one, or solve the {parts} parts separately")
