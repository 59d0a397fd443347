"""The optimisation of a pose graph some of whose loops are false, and why a loop was left out.

Kernels and annealing were measured on the Intel and Manhattan graphs with 50 false loops, scattered at random or in
groups that agree with each other (`benchmarks/acceptance/posegraphs.py`). Cauchy's and Geman-McClure's kernels alone
end up to 1.3 m away. Scaling loops down by how far they are contradicted (dynamic covariance scaling) trusts the
start: exact where the odometry is good, groups included, and lost where it is not. Graduated non-convexity trusts no
start, but lets a group bend an odometry that claims little. So both are tried, and the solution of greater likelihood
stands, with a noise level that is estimated from each solution, because many a graph's information is far too modest
(Intel's by a factor of 50).
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.config import Settings, setting
from waychair.geometry import pose_from_array
from waychair.slam.edges import Edge, EdgeKind, chi_square, edge_arrays
from waychair.slam.least_squares import Problem, check_graph, placed
from waychair.slam.synchronisation import spectral_poses
from waychair.types import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class GraphSettings(Settings):
    """How the graph is optimised."""

    loop_scale: float = setting(1.0, "", "chi-square up to which a loop counts in full", low=0.01, high=1e4)
    match_kernel: float = setting(2.0, "sigma", "width of the Huber kernel on the other edges", low=0.1, high=100.0)
    loop_limit: float = setting(
        16.27, "", "a loop of greater chi-square is left out (99.9 % of 3 dof)", low=1.0, high=1e6
    )
    rejection_cost: float = setting(
        50.0, "", "gain in -2 log likelihood for which a loop is left out", low=1.0, high=1e6
    )
    relinearise: float = setting(
        0.1, "m, rad", "move of a node after which iSAM2 linearises it anew", low=1e-4, high=1.0
    )
    few: int = setting(3, "", "loops in doubt that are tried all together, not one by one", low=0, high=1000)
    annealing: float = setting(2.0, "", "factor by which each round trusts large residuals less", low=1.05, high=10.0)
    max_rounds: int = setting(100, "", "rounds of graduated non-convexity", low=1, high=1000)
    max_iterations: int = setting(50, "", "Levenberg-Marquardt steps", low=1, high=1000)
    hopeless: float = setting(
        0.1, "", "share of loops left out beyond which the start itself is doubted", low=0.0, high=1.0
    )
    max_second_looks: int = setting(100, "", "loops left out that are looked at again", low=0, high=10_000)


class Reason(enum.Enum):
    """Why a loop was left out of the graph."""

    CONTRADICTED = "the rest of the graph contradicts it"
    REMOVED = "it was taken out on request"


@dataclass(frozen=True, slots=True)
class Rejected:
    """A loop that was left out: its chi-square (3 dof) against the poses without it, and what was allowed."""

    edge: Edge
    reason: Reason
    chi_square: float
    limit: float

    def __str__(self) -> str:
        edge = self.edge
        return f"loop {edge.i}-{edge.j}: {self.reason.value} (chi-square {self.chi_square:.1f} of {self.limit:.1f})"


@dataclass(frozen=True, slots=True)
class Solution:
    """Poses (N, 3) [m, m, rad], and which edges (E,) they rest on: all but the rejected loops."""

    poses: FloatArray
    accepted: BoolArray
    rejected: tuple[Rejected, ...]


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A solution under trial: the weights (E,) are 1 or 0; the rest as `_unlikelihood` says."""

    poses: FloatArray
    weights: FloatArray
    score: float
    against: float
    variance: float


def optimise(poses: FloatArray, edges: Sequence[Edge], settings: GraphSettings) -> FloatArray:
    """Poses (N, 3) of `solve`."""
    return solve(poses, edges, settings).poses


def solve(poses: FloatArray, edges: Sequence[Edge], settings: GraphSettings) -> Solution:
    """Poses that fit the edges best, node 0 held where it is, and the loops that had to be left out for it.

    Edges that are no loops are believed, under a Huber kernel (on every edge the largest single gain measured on the
    Freiburg and Intel logs). When the quick solution contradicts no loop it stands.

    Raises:
        GraphError: nodes that hang on no edge, values that are not finite, or equations that cannot be solved.
    """
    arrays = edge_arrays(edges)
    check_graph(poses, arrays)
    problem = Problem(arrays, settings.match_kernel)
    if not arrays.loop.any():
        return Solution(problem.solve(poses, iterations=settings.max_iterations), ~arrays.loop, ())
    quick = problem.solve_switchable(poses, settings.loop_scale, settings.max_iterations)
    if _within(problem, quick, settings.loop_limit).all():
        return Solution(quick, np.ones(len(edges), bool), ())
    best = _settled(problem, quick, settings)
    if not best.weights.all():
        best = min(best, _settled(problem, _trusting(problem, best, poses, settings), settings), key=_score)
        best = _looked_at_again(problem, best, settings)
    left_out = int((best.weights == 0).sum())
    if left_out > settings.few:  # the poses may have been bent by what was believed before
        best = min(best, _quick(problem, reckoned(poses, edges), settings), key=_score)
    if left_out > settings.hopeless * arrays.loop.sum():
        start = placed(spectral_poses(arrays, len(poses)), poses[0])
        best = min(best, _quick(problem, start, settings), key=_score)
    accepted = best.weights > 0
    against = chi_square(best.poses, arrays)
    return Solution(
        best.poses,
        accepted,
        tuple(
            Rejected(edges[k], Reason.CONTRADICTED, float(against[k]), settings.loop_limit)
            for k in np.flatnonzero(~accepted).tolist()
        ),
    )


def reckoned(poses: FloatArray, edges: Sequence[Edge]) -> FloatArray:
    """Poses (N, 3) by the edges between consecutive nodes alone, no loops; where there is none, the step of `poses`."""
    steps = {edge.i: edge.i_from_j for edge in edges if edge.kind is not EdgeKind.LOOP and edge.j == edge.i + 1}
    chain = [pose_from_array(poses[0])]
    for k in range(len(poses) - 1):
        own = steps.get(k)
        step = pose_from_array(poses[k]).inverse() @ pose_from_array(poses[k + 1]) if own is None else own
        chain.append(chain[-1] @ step)
    return np.array([pose.array() for pose in chain])


def _quick(problem: Problem, poses: FloatArray, settings: GraphSettings) -> _Candidate:
    """The solution next to the poses that dynamic covariance scaling finds."""
    return _settled(problem, problem.solve_switchable(poses, settings.loop_scale, settings.max_iterations), settings)


def _score(candidate: _Candidate) -> float:
    return candidate.score


def _trusting(problem: Problem, quick: _Candidate, poses: FloatArray, settings: GraphSettings) -> FloatArray:
    """Poses that give the loops left out by the quick solution their chance: all of them if they are few."""
    if (quick.weights == 0).sum() > settings.few:
        return _graduated(problem, poses, settings)
    return problem.solve(quick.poses, iterations=settings.max_iterations)


def _graduated(problem: Problem, poses: FloatArray, settings: GraphSettings) -> FloatArray:
    """Poses by graduated non-convexity with truncated least squares on the loops.

    Yang, Antonante, Tzoumas, Carlone: Graduated non-convexity for robust spatial perception, RA-L 2020, eq. 14 for
    the weights. All loops are trusted at first, then only those that a shrinking limit lets pass; one Gauss-Newton
    step at each limit is enough, as the solution moves little between them.
    """
    loop, limit = problem.edges.loop, settings.loop_limit
    weights = np.ones(len(loop))
    against = chi_square(poses, problem.edges)
    convexity = limit / max(2 * float(against[loop].max()) - limit, limit)
    for _ in range(settings.max_rounds):
        upper, lower = (1 + 1 / convexity) * limit, convexity / (1 + convexity) * limit
        soft = np.sqrt(limit * convexity * (1 + convexity) / np.maximum(against[loop], 1e-12)) - convexity
        weights[loop] = np.where(against[loop] >= upper, 0.0, np.where(against[loop] <= lower, 1.0, soft))
        poses = problem.solve(poses, weights, iterations=1, damped=False)
        against = chi_square(poses, problem.edges)
        if convexity > 1 and np.isin(weights, (0.0, 1.0)).all():
            break
        convexity *= settings.annealing
    return poses


def _settled(problem: Problem, poses: FloatArray, settings: GraphSettings) -> _Candidate:
    """The solution next to the poses that rests on exactly the loops within the limit."""
    weights = _within(problem, poses, settings.loop_limit)
    for _ in range(10):
        poses = problem.solve(poses, weights, iterations=settings.max_iterations)
        now = _within(problem, poses, settings.loop_limit)
        if (now == weights).all():
            break
        weights = now
    return _Candidate(poses, weights, *_unlikelihood(problem, poses, weights, settings.rejection_cost))


def _within(problem: Problem, poses: FloatArray, limit: float) -> FloatArray:
    """(E,) 1 for every edge but the loops beyond the limit, 0 for those."""
    against = chi_square(poses, problem.edges)
    return np.where(problem.edges.loop & (against >= limit), 0.0, 1.0)


def _variance(against: float, loops: float) -> float:
    """Noise level of a solution: its sum of chi-squares per degree of freedom, drawn to 1 where loops are few."""
    prior = 15.0  # as if five more loops had fitted as their information says
    return (against + prior) / (3 * loops + prior)


def _unlikelihood(problem: Problem, poses: FloatArray, weights: FloatArray, cost: float) -> tuple[float, float, float]:
    """-2 log likelihood of the loops up to a constant, the sum of chi-squares, and the noise level.

    Each accepted loop has 3 degrees of freedom of the variance that fits the solution, each rejected one costs `cost`.
    A group of false loops that bends the odometry raises the variance, and with it the cost of every true loop.
    """
    loop = problem.edges.loop
    accepted = float((weights[loop] > 0).sum())
    against = float(chi_square(poses, problem.edges)[weights > 0].sum())
    variance = _variance(against, accepted)
    score = 3 * accepted * math.log(variance) + against / variance + cost * (float(loop.sum()) - accepted)
    return score, against, variance


def _looked_at_again(problem: Problem, best: _Candidate, settings: GraphSettings) -> _Candidate:
    """The candidate with the loops back in that were only out because the poses between them are uncertain.

    A true loop left out early may lie hundreds of sigmas from a solution that is itself uncertain there; its
    innovation tells it from a false one. As real noise has long tails, a single loop may be as poor as five times the
    noise level. Loops are taken back together, and stay if that costs less than leaving them out.
    """
    noise = max(best.variance, min(1.0, 5 * best.variance))
    for _ in range(5):
        left_out = np.flatnonzero(best.weights == 0)
        against = chi_square(best.poses, problem.edges)[left_out]
        asked = left_out[np.argsort(against)][: settings.max_second_looks]
        if not len(asked):
            break
        welcome = asked[problem.innovations(best.poses, best.weights, asked) < settings.rejection_cost * noise]
        weights = best.weights.copy()
        weights[welcome] = 1.0
        again = _settled(problem, problem.solve(best.poses, weights, iterations=settings.max_iterations), settings)
        back = (again.weights > 0).sum() - (best.weights > 0).sum()
        if back <= 0 or again.against - best.against > back * settings.rejection_cost * noise:
            break
        best = again
    return best
