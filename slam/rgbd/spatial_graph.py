"""Pose graph of key frames in space: robust rounds, a plain solution at full weight, and the likelier of the two."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.errors import GraphError
from waychair.slam.camera.picture_registration import angle_between
from waychair.slam.graph.spatial_least_squares import KERNEL, SpatialEdge, SpatialProblem, spatial_least_squares
from waychair.types import BoolArray, FloatArray, Pose3

__all__ = ["MAX_ERROR", "SpatialEdge", "SpatialSolution", "solve_spatial"]

MAX_ERROR = 3.0
"""An edge with a larger residual [sigma] makes the newest loop doubtful (RTAB-Map's RGBD/OptimizeMaxError)."""

_ITERATIONS = 30  # Levenberg-Marquardt steps under kernels
_REJECTION_COST = 50.0  # greatest -2 log likelihood of a loop; beyond it, the loop counts as rejected
_PRIOR_LOOPS = 50.0  # the noise level begins as if so many more loops fitted exactly as their covariance says
_HUBER_COST = 1.04  # -2 log of the normalisation of Huber's density in 6 dimensions against the normal one


@dataclass(frozen=True, slots=True)
class SpatialSolution:
    """Poses map_from_node, and the residual (E,) of each edge [sigma]."""

    poses: tuple[Pose3, ...]
    errors: FloatArray


def solve_spatial(poses: Sequence[Pose3], edges: Sequence[SpatialEdge]) -> SpatialSolution:
    """Return poses that fit the edges, with node 0 fixed. Pieces that no edges connect are each solved in themselves.

    Kernels hold false loops off but also bend a graph without any: Huber's takes weight from every second edge of a
    graph whose noise is exactly as stated. So the plain least-squares solution is a candidate too, and the kernels
    also run from there.

    Raises:
        GraphError: the equations cannot be solved, neither under kernels nor plainly.
    """
    problem = SpatialProblem(edges)
    candidates: list[tuple[float, tuple[Pose3, ...]]] = []
    refusal: GraphError | None = None
    try:
        plain = spatial_least_squares(poses, problem)
        candidates.append((_unlikelihood(problem, plain), plain))
    except GraphError as error:
        refusal = error
    for start in (tuple(poses), *(candidate for _, candidate in candidates)):
        try:
            robust = problem.solve(start, _ITERATIONS, kernels=True)
            candidates.append((_unlikelihood(problem, robust), robust))
            accepted = ~problem.loop | (problem.chi_square(robust) < _REJECTION_COST)
            if not accepted.all():
                robust = problem.solve(robust, _ITERATIONS, accepted=accepted)
                candidates.append((_unlikelihood(problem, robust), robust))
        except GraphError as error:
            refusal = error
    if not candidates:
        assert refusal is not None
        raise refusal
    result = min(candidates, key=lambda candidate: candidate[0])[1]
    return SpatialSolution(result, _errors(result, edges))


def _unlikelihood(problem: SpatialProblem, poses: Sequence[Pose3]) -> float:
    """Return -2 log likelihood of the edges up to a constant.

    A loop costs its chi-square, or `_REJECTION_COST` if that is less. Odometry is normal, or has the long tails of Huber's
    kernel, whichever fits better. The noise is as stated, or larger throughout by the solution's own level: the
    covariance of some graphs is far too small.
    """
    against = problem.chi_square(poses)
    if not np.isfinite(against).all():
        return math.inf
    freedom, prior = 6.0 * max(len(against) - len(poses) + 1, 0), 6.0 * _PRIOR_LOOPS
    level = max(1.0, (float(against.sum()) + prior) / (freedom + prior))
    return min(freedom * math.log(noise) + _cost(against / noise, problem.loop) for noise in (1.0, level))


def _cost(against: FloatArray, loop: BoolArray) -> float:
    odometry, loops = against[~loop], against[loop]
    bent = np.where(odometry > KERNEL**2, 2 * KERNEL * np.sqrt(odometry) - KERNEL**2, odometry) + _HUBER_COST
    return float(min(odometry.sum(), bent.sum()) + np.minimum(loops, _REJECTION_COST).sum())


def _errors(poses: Sequence[Pose3], edges: Sequence[SpatialEdge]) -> FloatArray:
    """Return the residual (E,) of each edge [sigma]: RTAB-Map's ratio, the larger of translation and rotation."""
    ratios = []
    for edge in edges:
        now = poses[edge.i].inverse() @ poses[edge.j]
        away = float(np.abs(now.translation - edge.i_from_j.translation).max())
        angular, linear = np.sqrt(np.diag(edge.covariance)[:3].max()), np.sqrt(np.diag(edge.covariance)[3:].max())
        ratios.append(max(away / float(linear), angle_between(now, edge.i_from_j) / float(angular)))
    return np.array(ratios)
