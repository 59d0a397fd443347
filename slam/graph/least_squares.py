"""Weighted least squares over a pose graph with gtsam: factors are built once and solved with many weights.

gtsam and scipy.sparse are loaded by the first graph that has to be solved; a graph without a cycle has not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from waychair.errors import GraphError
from waychair.slam.graph.edges import EdgeArrays, chi_square
from waychair.types import FloatArray, IntArray

PRIOR_SIGMA = 1e-6
"""Standard deviation [m], [rad] of the prior that fixes node 0."""


class PoseGraphProblem:
    """The factors of one graph: node 0 fixed, and a Huber kernel of `match_kernel` [sigma] on every edge except loops.

    With `match_kernel` None there is no kernel.
    """

    def __init__(self, edges: EdgeArrays, match_kernel: float | None) -> None:
        import gtsam

        self.edges = edges
        self._measured = [gtsam.Pose2(*pose) for pose in edges.i_from_j]
        self._keys = list(zip(edges.i.tolist(), edges.j.tolist(), strict=True))
        self._huber = gtsam.noiseModel.mEstimator.Huber.Create(match_kernel) if match_kernel is not None else None
        self._factors: dict[int, Any] = {}

    def solve(
        self, poses: FloatArray, weights: FloatArray | None = None, iterations: int = 50, damped: bool = True
    ) -> FloatArray:
        """Return poses (N, 3) after Levenberg-Marquardt (`damped` False: Gauss-Newton) steps from `poses`.

        `weights` (E,) in [0, 1] scale the information of the edges; edges of weight 0 are ignored.

        Raises:
            GraphError: the equations cannot be solved.
        """
        graph = self.factor_graph(poses, weights)
        return self._optimised(graph, poses, iterations, damped)

    def solve_switchable(self, poses: FloatArray, scale: float, iterations: int = 50) -> FloatArray:
        """Return poses (N, 3) with each loop weighted down by its own residual.

        This is dynamic covariance scaling (Agarwal et al., ICRA 2013, eq. 15), the closed form of switchable
        constraints. A loop with a chi-square below `scale` has full weight.
        """
        import gtsam

        kernel = gtsam.noiseModel.mEstimator.DCS.Create(scale)
        graph = self._held(poses)
        for edge, loop in enumerate(self.edges.loop.tolist()):
            graph.add(self._between(edge, kernel) if loop else self._factor(edge))
        return self._optimised(graph, poses, iterations, True)

    def innovations(self, poses: FloatArray, weights: FloatArray, wanted: IntArray) -> FloatArray:
        """Return the chi-square (K,) of the innovation of each wanted edge against the solution of the weighted others.

        Unlike the residual it accounts for the uncertainty between the two nodes: to first order, it is the cost of
        adding the edge.
        """
        import gtsam

        values = gtsam_values(poses)
        marginals = gtsam.Marginals(self.factor_graph(poses, weights), values)
        found = np.empty(len(wanted))
        for k, edge in enumerate(wanted.tolist()):
            jacobian, away = self._between(edge, None).linearize(values).jacobian()
            joint = marginals.jointMarginalCovariance(gtsam.KeyVector(sorted(self._keys[edge]))).fullMatrix()
            if self._keys[edge][0] > self._keys[edge][1]:  # the joint covariance is in the order of the keys
                jacobian = np.hstack([jacobian[:, 3:], jacobian[:, :3]])
            found[k] = away @ np.linalg.solve(np.eye(3) + jacobian @ joint @ jacobian.T, away)
        return found

    def group_innovations(self, poses: FloatArray, weights: FloatArray, groups: Sequence[IntArray]) -> FloatArray:
        """Return the chi-square (K,) of the joint innovation of each group of edges against all other weighted edges.

        With the group's whitened residuals r and their share K = J H^-1 J' in the solution, it is r' (I - K)^-1 r: to first
        order, the cost of adding the whole group to the rest. All edges of a group have a weight above 0.
        """
        from scipy.sparse import csr_matrix

        from waychair.slam.graph.pose_synchronisation import factorised

        kept = np.cumsum(weights > 0)  # the prior of node 0 has the first rows
        linear = self.factor_graph(poses, weights).linearize(gtsam_values(poses))
        row, column, value = linear.sparseJacobian_()
        shape = (3 * (1 + int(kept[-1])), 3 * len(poses) + 1)
        system = csr_matrix((value, (row.astype(int) - 1, column.astype(int) - 1)), shape=shape)
        jacobian, residual = system[:, :-1].tocsr(), system[:, -1].toarray().ravel()
        factor = factorised((jacobian.T @ jacobian).tocsc())
        found = np.empty(len(groups))
        for k, members in enumerate(groups):
            rows = (3 * kept[members][:, None] + np.arange(3)).ravel()
            part, away = jacobian[rows], residual[rows]
            share = part @ factor.solve(part.T.toarray())
            found[k] = away @ np.linalg.solve((1 + 1e-9) * np.eye(len(rows)) - share, away)
        return found

    def factor_graph(self, poses: FloatArray | None, weights: FloatArray | None = None) -> Any:
        """Return gtsam's graph of the weighted edges, with node 0 fixed at its pose (`poses` None: not fixed)."""
        graph = self._held(poses)
        for edge, weight in enumerate([1.0] * len(self.edges) if weights is None else weights.tolist()):
            if weight == 1.0:
                graph.add(self._factor(edge))
            elif weight > 0.0:
                graph.add(self._between(edge, None, weight))
        return graph

    def _held(self, poses: FloatArray | None) -> Any:
        import gtsam

        graph = gtsam.NonlinearFactorGraph()
        if poses is None:
            return graph
        held = gtsam.noiseModel.Isotropic.Sigma(3, PRIOR_SIGMA)
        graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(*poses[0]), held))
        return graph

    def _factor(self, edge: int) -> Any:
        """Return the edge's factor at full weight, made on first use."""
        if edge not in self._factors:
            self._factors[edge] = self._between(edge, None if self.edges.loop[edge] else self._huber)
        return self._factors[edge]

    def _between(self, edge: int, kernel: Any, weight: float = 1.0) -> Any:
        import gtsam

        noise: Any = gtsam.noiseModel.Gaussian.Information(weight * self.edges.information[edge])
        if kernel is not None:
            noise = gtsam.noiseModel.Robust.Create(kernel, noise)
        return gtsam.BetweenFactorPose2(*self._keys[edge], self._measured[edge], noise)

    def _optimised(self, graph: Any, poses: FloatArray, iterations: int, damped: bool) -> FloatArray:
        import gtsam

        parameters: Any = gtsam.LevenbergMarquardtParams() if damped else gtsam.GaussNewtonParams()
        parameters.setMaxIterations(iterations)
        parameters.setRelativeErrorTol(1e-5)
        optimizer: Any = gtsam.LevenbergMarquardtOptimizer if damped else gtsam.GaussNewtonOptimizer
        try:
            result = optimizer(graph, gtsam_values(poses), parameters).optimize()
        except RuntimeError as error:
            raise GraphError(
                f"the pose graph of {len(poses)} nodes cannot be solved ({str(error).strip().splitlines()[0]}); "
                "check the information of its edges"
            ) from error
        solved: FloatArray = gtsam.utilities.extractPose2(result)
        return solved


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
    from waychair.geometry import compose, invert

    return compose(compose(first, invert(poses[0])), poses)


def gtsam_values(poses: FloatArray, first: int = 0) -> Any:
    """Return poses (N, 3) as gtsam values of the nodes from `first` on."""
    import gtsam

    values = gtsam.Values()
    for index, pose in enumerate(poses, first):
        values.insert(index, gtsam.Pose2(*pose))
    return values


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
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    _, part = connected_components(csr_matrix((np.ones(len(i)), (i, j)), shape=(count, count)), directed=False)
    return np.asarray(part, np.int64)


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
