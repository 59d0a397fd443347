"""Pose graph in 3D, solved with gtsam under robust kernels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.errors import GraphError
from waychair.slam.camera.picture_registration import angle_between
from waychair.types import FloatArray, Pose3

MAX_ERROR = 3.0
"""An edge with a larger residual [sigma] makes the newest loop doubtful (RTAB-Map's RGBD/OptimizeMaxError)."""

_KERNEL = 2.0  # sigma; width of the kernels: Huber on odometry, Cauchy on loops
_ITERATIONS = 30  # Levenberg-Marquardt steps
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


@dataclass(frozen=True, slots=True)
class SpatialSolution:
    """Poses map_from_node, and the residual (E,) of each edge [sigma]."""

    poses: tuple[Pose3, ...]
    errors: FloatArray


def solve_spatial(poses: Sequence[Pose3], edges: Sequence[SpatialEdge]) -> SpatialSolution:
    """Return poses that fit the edges, with node 0 fixed; the graph must be connected.

    Raises:
        GraphError: the equations cannot be solved.
    """
    import gtsam

    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for node, pose in enumerate(poses):
        values.insert(node, gtsam.Pose3(gtsam.Rot3(pose.rotation), pose.translation))
    held = gtsam.noiseModel.Isotropic.Sigma(6, _HELD)
    graph.add(gtsam.PriorFactorPose3(0, values.atPose3(0), held))
    kernels = gtsam.noiseModel.mEstimator
    huber, cauchy = kernels.Huber.Create(_KERNEL), kernels.Cauchy.Create(_KERNEL)
    for edge in edges:
        noise = gtsam.noiseModel.Robust.Create(
            cauchy if edge.loop else huber, gtsam.noiseModel.Gaussian.Covariance(edge.covariance)
        )
        measured = gtsam.Pose3(gtsam.Rot3(edge.i_from_j.rotation), edge.i_from_j.translation)
        graph.add(gtsam.BetweenFactorPose3(edge.i, edge.j, measured, noise))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(_ITERATIONS)
    try:
        solved = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    except RuntimeError as error:
        raise GraphError(f"the graph of {len(poses)} poses cannot be solved: {error}") from error
    found = [solved.atPose3(node) for node in range(len(poses))]
    result = tuple(Pose3(pose.rotation().matrix(), np.asarray(pose.translation())) for pose in found)
    return SpatialSolution(result, _errors(result, edges))


def _errors(poses: Sequence[Pose3], edges: Sequence[SpatialEdge]) -> FloatArray:
    """Return the residual (E,) of each edge [sigma]: RTAB-Map's ratio, the larger of translation and rotation."""
    ratios = []
    for edge in edges:
        now = poses[edge.i].inverse() @ poses[edge.j]
        away = float(np.abs(now.translation - edge.i_from_j.translation).max())
        angular, linear = np.sqrt(np.diag(edge.covariance)[:3].max()), np.sqrt(np.diag(edge.covariance)[3:].max())
        ratios.append(max(away / float(linear), angle_between(now, edge.i_from_j) / float(angular)))
    return np.array(ratios)
