"""Least squares over a pose graph in space with gtsam, from the given poses and from a chordal start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from waychair.errors import GraphError
from waychair.types import BoolArray, FloatArray, Pose3

KERNEL = 2.0
"""Width [sigma] of the kernels: Huber on odometry, Cauchy on loops."""

PLAIN_STEPS = 100
"""Levenberg-Marquardt steps without kernels; a torus of 5,000 nodes needs about ten from a chordal start."""

_HELD = 1e-6  # standard deviation [rad], [m] of the prior that fixes node 0


@dataclass(frozen=True, slots=True)
class SpatialEdge:
    """Measured `i_from_j` of two nodes with its covariance (6, 6) of rotation [rad] and translation [m] in j's frame."""

    i: int
    j: int
    i_from_j: Pose3
    covariance: FloatArray
    loop: bool = False
    """Found by appearance: its weight falls with its residual (Cauchy kernel)."""


class SpatialProblem:
    """The factors of one graph in space; `loop` (E,) bool marks the loops."""

    def __init__(self, edges: Sequence[SpatialEdge]) -> None:
        import gtsam

        self.edges = tuple(edges)
        self.loop = np.array([edge.loop for edge in edges], bool)
        self._plain = [self._between(edge, gtsam.noiseModel.Gaussian.Covariance(edge.covariance)) for edge in edges]

    def solve(
        self,
        poses: Sequence[Pose3],
        iterations: int = PLAIN_STEPS,
        kernels: bool = False,
        accepted: BoolArray | None = None,
    ) -> tuple[Pose3, ...]:
        """Return the poses (N) after Levenberg-Marquardt steps from `poses`, with node 0 fixed.

        Of the edges, only those `accepted` (E,) count.

        Raises:
            GraphError: the equations cannot be solved.
        """
        import gtsam

        graph, values = self._held(poses[0]), gtsam.Values()
        for node, pose in enumerate(poses):
            values.insert(node, _gtsam_pose(pose))
        for edge, factor in enumerate(self._robust() if kernels else self._plain):
            if accepted is None or accepted[edge]:
                graph.add(factor)
        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setMaxIterations(iterations)
        try:
            solved = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
        except RuntimeError as error:
            raise GraphError(f"the graph of {len(poses)} poses cannot be solved: {error}") from error
        return _poses(solved, len(poses))

    def chordal_start(self, first: Pose3, count: int) -> tuple[Pose3, ...] | None:
        """Return `count` poses from the edges alone, node 0 at `first`; None where the edges do not determine them.

        The rotations are a linear least-squares solution, each projected onto the nearest rotation (Carlone, Tron,
        Daniilidis, Dellaert: Initialization techniques for 3D SLAM, ICRA 2015); the translations follow from one step.
        """
        import gtsam

        graph = self._held(first)
        for factor in self._plain:
            graph.add(factor)
        try:
            found = gtsam.InitializePose3.initialize(graph)
            poses = _poses(found, count)
        except (RuntimeError, ValueError, IndexError):  # gtsam's errors for loose nodes
            return None
        if not all(np.isfinite(pose.rotation).all() and np.isfinite(pose.translation).all() for pose in poses):
            return None
        moved = first @ poses[0].inverse()
        return tuple(moved @ pose for pose in poses)

    def chi_square(self, poses: Sequence[Pose3]) -> FloatArray:
        """Return the squared Mahalanobis length (E,) of the residuals (6 degrees of freedom)."""
        import gtsam

        values = gtsam.Values()
        for node, pose in enumerate(poses):
            values.insert(node, _gtsam_pose(pose))
        return np.array([2.0 * factor.error(values) for factor in self._plain])

    def _robust(self) -> list[Any]:
        import gtsam

        kernels = gtsam.noiseModel.mEstimator
        huber, cauchy = kernels.Huber.Create(KERNEL), kernels.Cauchy.Create(KERNEL)
        return [
            self._between(edge, gtsam.noiseModel.Robust.Create(cauchy if edge.loop else huber, factor.noiseModel()))
            for edge, factor in zip(self.edges, self._plain, strict=True)
        ]

    def _held(self, first: Pose3) -> Any:
        import gtsam

        graph = gtsam.NonlinearFactorGraph()
        graph.add(gtsam.PriorFactorPose3(0, _gtsam_pose(first), gtsam.noiseModel.Isotropic.Sigma(6, _HELD)))
        return graph

    def _between(self, edge: SpatialEdge, noise: Any) -> Any:
        import gtsam

        return gtsam.BetweenFactorPose3(edge.i, edge.j, _gtsam_pose(edge.i_from_j), noise)


def spatial_least_squares(poses: Sequence[Pose3], problem: SpatialProblem) -> tuple[Pose3, ...]:
    """Return the poses with the least sum of chi-squares: no kernels, no edge rejected.

    The solver runs from the given poses and from a chordal start, and the better solution is returned: from dead
    reckoning it ends in a local minimum on a torus of 5,000 nodes.

    Raises:
        GraphError: the equations cannot be solved.
    """
    starts = (problem.chordal_start(poses[0], len(poses)), tuple(poses))
    solutions, refusal = [], None
    for start in starts:
        if start is None:
            continue
        try:
            solutions.append(problem.solve(start))
        except GraphError as error:
            refusal = error
    if not solutions:
        raise refusal or GraphError(f"the graph of {len(poses)} poses cannot be solved; add edges to loose nodes")
    return min(solutions, key=lambda solution: _total(problem, solution))


def _total(problem: SpatialProblem, poses: Sequence[Pose3]) -> float:
    total = float(problem.chi_square(poses).sum())
    return total if np.isfinite(total) else np.inf


def _gtsam_pose(pose: Pose3) -> Any:
    import gtsam

    return gtsam.Pose3(gtsam.Rot3(pose.rotation), pose.translation)


def _poses(values: Any, count: int) -> tuple[Pose3, ...]:
    found = [values.atPose3(node) for node in range(count)]
    return tuple(Pose3(pose.rotation().matrix(), np.asarray(pose.translation())) for pose in found)
