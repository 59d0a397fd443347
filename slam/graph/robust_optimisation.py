"""Robust optimisation of a pose graph with false loops, and the reasons for rejected loops.

The methods were measured on the Intel and Manhattan graphs with 50 false loops, at random or in mutually consistent
groups (`evaluation/figures/mapping/posegraphs.py`). Cauchy and Geman-McClure kernels alone err by up to 1.3 m. Dynamic
covariance scaling relies on the start: it is exact where the odometry is good, even for groups, and fails where it is
not. Graduated non-convexity needs no good start, but a group of false loops can bend weakly constrained odometry. So
both are tried, and the solution of greater likelihood is taken. Its noise level is estimated from the solution, because
the information of many graphs is far too small (Intel's by a factor of 50).
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.geometry import pose_from_array
from waychair.slam.graph.edges import Edge, EdgeKind, chi_square, edge_arrays
from waychair.slam.graph.least_squares import PoseGraphProblem, check_graph, with_first_pose
from waychair.slam.graph.pose_synchronisation import spectral_poses
from waychair.types import BoolArray, FloatArray

LOOP_SCALE = 1.0  # chi-square up to which a loop has full weight (dynamic covariance scaling)
MATCH_KERNEL = 2.0  # sigma; width of the Huber kernel on all edges except loops
LOOP_LIMIT = 16.27  # a loop of greater chi-square is rejected (99.9 % of 3 degrees of freedom)
REJECTION_COST = 50.0  # gain in -2 log likelihood for which a loop is rejected
FEW_LOOPS = 3  # loops in doubt up to this number are tried all together
ANNEALING = 2.0  # factor by which the limit shrinks per round of graduated non-convexity
MAX_ROUNDS = 100  # rounds of graduated non-convexity
MAX_ITERATIONS = 50  # Levenberg-Marquardt steps
HOPELESS_SHARE = 0.1  # share of rejected loops beyond which the start itself is doubted
MAX_SECOND_LOOKS = 100  # rejected loops that are checked again


class RejectionReason(enum.Enum):
    """Why a loop was rejected."""

    CONTRADICTED = "the rest of the graph contradicts it"
    REMOVED = "it was removed on request"


@dataclass(frozen=True, slots=True)
class RejectedLoop:
    """A rejected loop: its chi-square (3 dof) against the poses without it, and the limit."""

    edge: Edge
    reason: RejectionReason
    chi_square: float
    limit: float

    def __str__(self) -> str:
        edge = self.edge
        return f"loop {edge.i}-{edge.j}: {self.reason.value} (chi-square {self.chi_square:.1f} of {self.limit:.1f})"


@dataclass(frozen=True, slots=True)
class Solution:
    """Poses (N, 3) [m, m, rad], and the mask (E,) of accepted edges: all except rejected loops."""

    poses: FloatArray
    accepted: BoolArray
    rejected: tuple[RejectedLoop, ...]


@dataclass(frozen=True, slots=True)
class _Trial:
    """A trial solution: weights (E,) of 1 or 0; `score`, `against` and `variance` as `_unlikelihood` returns them."""

    poses: FloatArray
    weights: FloatArray
    score: float
    against: float
    variance: float


def solve(poses: FloatArray, edges: Sequence[Edge]) -> Solution:
    """Return the poses that fit the edges best, with node 0 fixed, and the rejected loops.

    All other edges are kept, under a Huber kernel (the largest single gain measured on the Freiburg and Intel logs).
    The quick solution is taken if it contradicts no loop.

    Raises:
        GraphError: the graph is not connected, values are not finite, or the equations cannot be solved.
    """
    arrays = edge_arrays(edges)
    check_graph(poses, arrays)
    problem = PoseGraphProblem(arrays, MATCH_KERNEL)
    if not arrays.loop.any():
        return Solution(problem.solve(poses, iterations=MAX_ITERATIONS), ~arrays.loop, ())
    quick = problem.solve_switchable(poses, LOOP_SCALE, MAX_ITERATIONS)
    if _within(problem, quick).all():
        return Solution(quick, np.ones(len(edges), bool), ())
    best = _settled(problem, quick)
    if not best.weights.all():
        best = min(best, _settled(problem, _trusting(problem, best, poses)), key=_score)
        best = _reconsidered(problem, best)
    left_out = int((best.weights == 0).sum())
    if left_out > FEW_LOOPS:  # loops accepted earlier may have bent the poses
        best = min(best, _quick(problem, chained_poses(poses, edges)), key=_score)
    if left_out > HOPELESS_SHARE * arrays.loop.sum():
        start = with_first_pose(spectral_poses(arrays, len(poses)), poses[0])
        best = min(best, _quick(problem, start), key=_score)
    accepted = best.weights > 0
    against = chi_square(best.poses, arrays)
    return Solution(
        best.poses,
        accepted,
        tuple(
            RejectedLoop(edges[k], RejectionReason.CONTRADICTED, float(against[k]), LOOP_LIMIT)
            for k in np.flatnonzero(~accepted).tolist()
        ),
    )


def chained_poses(poses: FloatArray, edges: Sequence[Edge]) -> FloatArray:
    """Return poses (N, 3) chained from the edges between consecutive nodes; a missing edge takes the step of `poses`."""
    steps = {edge.i: edge.i_from_j for edge in edges if edge.kind is not EdgeKind.LOOP and edge.j == edge.i + 1}
    chain = [pose_from_array(poses[0])]
    for k in range(len(poses) - 1):
        own = steps.get(k)
        step = pose_from_array(poses[k]).inverse() @ pose_from_array(poses[k + 1]) if own is None else own
        chain.append(chain[-1] @ step)
    return np.array([pose.array() for pose in chain])


def _quick(problem: PoseGraphProblem, poses: FloatArray) -> _Trial:
    """Return the settled solution next to that of dynamic covariance scaling."""
    return _settled(problem, problem.solve_switchable(poses, LOOP_SCALE, MAX_ITERATIONS))


def _score(candidate: _Trial) -> float:
    return candidate.score


def _trusting(problem: PoseGraphProblem, quick: _Trial, poses: FloatArray) -> FloatArray:
    """Return poses that trust the loops rejected by the quick solution: all at once if they are few, else by annealing."""
    if (quick.weights == 0).sum() > FEW_LOOPS:
        return _graduated(problem, poses)
    return problem.solve(quick.poses, iterations=MAX_ITERATIONS)


def _graduated(problem: PoseGraphProblem, poses: FloatArray) -> FloatArray:
    """Return poses by graduated non-convexity with truncated least squares on the loops.

    Yang, Antonante, Tzoumas, Carlone: Graduated non-convexity for robust spatial perception, RA-L 2020, weights by
    eq. 14. At first all loops are trusted, then only those within a shrinking limit. One Gauss-Newton step per limit is
    enough, because the solution moves little between limits.
    """
    loop, limit = problem.edges.loop, LOOP_LIMIT
    weights = np.ones(len(loop))
    against = chi_square(poses, problem.edges)
    convexity = limit / max(2 * float(against[loop].max()) - limit, limit)
    for _ in range(MAX_ROUNDS):
        upper, lower = (1 + 1 / convexity) * limit, convexity / (1 + convexity) * limit
        soft = np.sqrt(limit * convexity * (1 + convexity) / np.maximum(against[loop], 1e-12)) - convexity
        weights[loop] = np.where(against[loop] >= upper, 0.0, np.where(against[loop] <= lower, 1.0, soft))
        poses = problem.solve(poses, weights, iterations=1, damped=False)
        against = chi_square(poses, problem.edges)
        if convexity > 1 and np.isin(weights, (0.0, 1.0)).all():
            break
        convexity *= ANNEALING
    return poses


def _settled(problem: PoseGraphProblem, poses: FloatArray) -> _Trial:
    """Return the solution next to the poses whose accepted loops are exactly those within the limit."""
    weights = _within(problem, poses)
    for _ in range(10):
        poses = problem.solve(poses, weights, iterations=MAX_ITERATIONS)
        now = _within(problem, poses)
        if (now == weights).all():
            break
        weights = now
    return _Trial(poses, weights, *_unlikelihood(problem, poses, weights))


def _within(problem: PoseGraphProblem, poses: FloatArray) -> FloatArray:
    """Return weights (E,): 0 for loops beyond the limit, 1 for all other edges."""
    against = chi_square(poses, problem.edges)
    return np.where(problem.edges.loop & (against >= LOOP_LIMIT), 0.0, 1.0)


def _variance(against: float, loops: float) -> float:
    """Return the noise level of a solution: its chi-square per degree of freedom, pulled towards 1 for few loops."""
    prior = 15.0  # as if five more loops fitted exactly as their information says
    return (against + prior) / (3 * loops + prior)


def _unlikelihood(problem: PoseGraphProblem, poses: FloatArray, weights: FloatArray) -> tuple[float, float, float]:
    """Return -2 log likelihood of the loops up to a constant, the sum of chi-squares, and the noise level.

    Each accepted loop has 3 degrees of freedom with the solution's variance; each rejected loop costs `REJECTION_COST`. A group of
    false loops that bends the odometry raises the variance, and with it the cost of every true loop.
    """
    loop = problem.edges.loop
    accepted = float((weights[loop] > 0).sum())
    against = float(chi_square(poses, problem.edges)[weights > 0].sum())
    variance = _variance(against, accepted)
    score = 3 * accepted * math.log(variance) + against / variance + REJECTION_COST * (float(loop.sum()) - accepted)
    return score, against, variance


def _reconsidered(problem: PoseGraphProblem, best: _Trial) -> _Trial:
    """Return the candidate after accepting again the loops that were rejected only because their poses are uncertain.

    A true loop that was rejected early may lie hundreds of sigmas from a solution that is uncertain there; its
    innovation tells it from a false loop. Real noise has long tails, so one loop may reach five times the noise level.
    Loops are accepted together, and stay if that costs less than their rejection.
    """
    noise = max(best.variance, min(1.0, 5 * best.variance))
    for _ in range(5):
        left_out = np.flatnonzero(best.weights == 0)
        against = chi_square(best.poses, problem.edges)[left_out]
        asked = left_out[np.argsort(against)][:MAX_SECOND_LOOKS]
        if not len(asked):
            break
        welcome = asked[problem.innovations(best.poses, best.weights, asked) < REJECTION_COST * noise]
        weights = best.weights.copy()
        weights[welcome] = 1.0
        again = _settled(problem, problem.solve(best.poses, weights, iterations=MAX_ITERATIONS))
        back = (again.weights > 0).sum() - (best.weights > 0).sum()
        if back <= 0 or again.against - best.against > back * REJECTION_COST * noise:
            break
        best = again
    return best
