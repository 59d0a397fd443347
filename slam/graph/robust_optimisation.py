"""Robust optimisation of a pose graph with false loops, and the reasons for rejected loops.

The methods were measured on the Intel and Manhattan graphs with 50 false loops, at random or in mutually consistent
groups (`evaluation/figures/pose_graphs/posegraphs.py`). Cauchy and Geman-McClure kernels alone err by up to 1.3 m. Dynamic
covariance scaling relies on the start: it is exact where the odometry is good, even for groups, and fails where it is
not. Graduated non-convexity needs no good start, but a group of false loops can bend weakly constrained odometry. Plain
least squares is exact where no loop is false. So all are tried, each ends with all accepted loops at full weight, and
the solution of greatest likelihood is taken. Its noise level is estimated from the solution, because the information of
many graphs is far too small (Intel's by a factor of 50). Loops that say the same have one voice (`loop_groups.py`).
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from waychair.errors import GraphError
from waychair.geometry import compose, pose_from_array
from waychair.resumable import CountedSteps, finished
from waychair.slam.graph.edges import Edge, EdgeArrays, EdgeKind, chi_square, edge_arrays
from waychair.slam.graph.least_squares import (
    PoseGraphProblem,
    check_graph,
    is_tree,
    joined_weights,
    unsolvable,
    with_first_pose,
)
from waychair.slam.graph.loop_groups import group_cost, loop_groups
from waychair.slam.graph.loop_sieve import MANY_LOOPS, credible_loops, is_too_dense
from waychair.types import BoolArray, FloatArray, IntArray

LOOP_SCALE = 1.0  # chi-square up to which a loop has full weight (dynamic covariance scaling)
MATCH_KERNEL = 2.0  # sigma; width of the Huber kernel on all edges except loops
LOOP_LIMIT = 16.27  # a loop of greater chi-square is rejected (99.9 % of 3 degrees of freedom)
REJECTION_COST = 50.0  # gain in -2 log likelihood for which a loop is rejected,
FIRST_REJECTION_COST = 90.0  # for one of the first `FEW_LOOPS`: no other has shown yet how far the odometry drifts
FEW_LOOPS = 3  # loops in doubt up to this number are tried all together
ANNEALING = 2.0  # factor by which the limit shrinks per round of graduated non-convexity
MAX_ROUNDS = 100  # rounds of graduated non-convexity
MAX_ITERATIONS = 50  # Levenberg-Marquardt steps
HOPELESS_SHARE = 0.1  # share of rejected loops beyond which the start itself is doubted
MAX_SECOND_LOOKS = 100  # rejected loops that are checked again
LEAST_GROUP = 5  # loops; smaller groups are judged loop by loop
MAX_DOUBTS = 6  # groups, the most doubtful first, that are left out on trial
MAX_HEARD = 400  # loops; the largest groups up to so many loops in all are heard
MOST_NOISE = (
    100.0  # times the stated variance; no graph is so noisy, it has too many false loops to be judged one by one
)
HUBER_COST = 0.171  # -2 log of the normalisation of Huber's density in 3 dimensions against the normal one


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


@dataclass(frozen=True, slots=True)
class _Case:
    """A graph in question: its factors, the group (E,) of each loop, and the start (N, 3)."""

    problem: PoseGraphProblem
    groups: IntArray
    start: FloatArray


def solve(poses: FloatArray, edges: Sequence[Edge], solved_before: bool = False) -> Solution:
    """Return the result of `solving` without a break, and raise its errors."""
    return finished(solving(poses, edges, solved_before))


def solving(poses: FloatArray, edges: Sequence[Edge], solved_before: bool = False) -> CountedSteps[Solution]:
    """Work out the poses that fit the edges best, with node 0 fixed, and the rejected loops.

    All other edges are kept, under a Huber kernel (the largest single gain measured on the Freiburg and Intel logs).
    Poses that are an earlier solution (`solved_before`) save time: the quick solution is taken if it contradicts no loop,
    and groups of loops are not heard one by one.

    Raises:
        GraphError: the graph is not connected, values are not finite, or the equations cannot be solved, not even by
            plain least squares.
    """
    arrays = edge_arrays(edges)
    check_graph(poses, arrays)
    if is_tree(arrays, len(poses)):
        return Solution(_hung(poses, arrays), np.ones(len(arrays), bool), ())
    problem = PoseGraphProblem(arrays, MATCH_KERNEL)
    if is_too_dense(arrays, len(poses)):
        return (yield from _sieved(problem, poses, edges, solved_before))
    if not arrays.loop.any():
        return Solution((yield from problem.solving(poses, iterations=MAX_ITERATIONS)), ~arrays.loop, ())
    case = _Case(problem, loop_groups(poses, arrays), poses)
    yield len(poses)
    best = yield from _likeliest(None, _quick(case, poses, settle=not solved_before))
    if best is None:
        best = yield from _trusted(case, poses)
    if not best.weights.all():
        best = yield from _judged(case, best, chained_poses(poses, edges), solved_before)
    elif not solved_before:  # the start may lie in another valley
        best = yield from _likelier(best, _trusted_from_nothing(case))
    if not solved_before:
        if (best.weights == 0).sum() > FEW_LOOPS:
            best = yield from _likelier(best, *(_begun_without(case, group) for group in _largest(case, best)))
        best = _without_kernel(case, (yield from _heard_by_group(case, best)))
    if best.variance > MOST_NOISE and arrays.loop.sum() >= MANY_LOOPS:
        with suppress(GraphError):
            return (yield from _sieved(problem, poses, edges, solved_before))
    return _solution(best.poses, edges, arrays, best.weights > 0)


def _solution(poses: FloatArray, edges: Sequence[Edge], arrays: EdgeArrays, accepted: BoolArray) -> Solution:
    """Return the solution with its rejected loops."""
    against = chi_square(poses, arrays)
    return Solution(
        poses,
        accepted,
        tuple(
            RejectedLoop(edges[k], RejectionReason.CONTRADICTED, float(against[k]), LOOP_LIMIT)
            for k in np.flatnonzero(~accepted).tolist()
        ),
    )


def _sieved(
    problem: PoseGraphProblem, poses: FloatArray, edges: Sequence[Edge], solved_before: bool
) -> CountedSteps[Solution]:
    """Work out the solution of the credible loops and the other edges of a graph that has too many loops to be solved as a whole.

    If that is still too much, or if all are credible, they are taken as they are.
    """
    try:
        begun, kept = yield from credible_loops(problem, poses, solved_before)
    except np.linalg.LinAlgError as error:
        raise unsolvable(poses) from error
    numbers = np.flatnonzero(kept)
    if kept.all() or is_too_dense(problem.edges.take(numbers), len(poses)):
        return _solution(begun, edges, problem.edges, kept)
    found = yield from solving(begun, [edges[k] for k in numbers.tolist()], solved_before)
    accepted = np.zeros(len(edges), bool)
    accepted[numbers[found.accepted]] = True
    return _solution(found.poses, edges, problem.edges, accepted)


def chained_poses(poses: FloatArray, edges: Sequence[Edge]) -> FloatArray:
    """Return poses (N, 3) chained from the edges between consecutive nodes; a missing edge takes the step of `poses`."""
    steps = {edge.i: edge.i_from_j for edge in edges if edge.kind is not EdgeKind.LOOP and edge.j == edge.i + 1}
    chain = [pose_from_array(poses[0])]
    for k in range(len(poses) - 1):
        own = steps.get(k)
        step = pose_from_array(poses[k]).inverse() @ pose_from_array(poses[k + 1]) if own is None else own
        chain.append(chain[-1] @ step)
    return np.array([pose.array() for pose in chain])


def _hung(poses: FloatArray, edges: EdgeArrays) -> FloatArray:
    """Return the poses (N, 3) of a tree: each node hangs at the end of its edge."""
    hung = poses.copy()
    for edge in np.argsort(edges.j).tolist():
        hung[edges.j[edge]] = compose(hung[edges.i[edge]], edges.i_from_j[edge])
    return hung


def _judged(case: _Case, quick: _Trial, chain: FloatArray, solved_before: bool) -> CountedSteps[_Trial]:
    """Find the likeliest of many solutions, where the quick one rejects loops."""
    best = yield from _likelier(quick, _trusted(case, quick.poses))
    if (quick.weights == 0).sum() > FEW_LOOPS:
        best = yield from _likelier(best, _settled_by_rounds(case))
    best = yield from _reconsidered(case, best)
    left_out, first = int((best.weights == 0).sum()), best
    if left_out > FEW_LOOPS:  # loops accepted earlier may have bent the poses
        best = yield from _likelier(best, _quick(case, chain))
    if left_out > HOPELESS_SHARE * case.problem.edges.loop.sum() or (left_out and not solved_before):
        best = yield from _likelier(best, _without_a_start(case))
    return best if best is first else (yield from _reconsidered(case, best))


def _without_a_start(case: _Case) -> CountedSteps[_Trial]:
    """Find the likelier solution next to the spectral start: by dynamic covariance scaling, or with every loop trusted."""
    start = _spectral(case)
    best = yield from _likeliest(None, _quick(case, start), _trusted(case, start))
    if best is None:
        raise GraphError("the equations cannot be solved from the spectral start")
    return best


def _likeliest(best: _Trial | None, *attempts: CountedSteps[_Trial]) -> CountedSteps[_Trial | None]:
    """Find the trial of greatest likelihood; an attempt whose equations cannot be solved counts for nothing."""
    for attempt in attempts:
        try:
            trial = yield from attempt
        except (GraphError, RuntimeError, np.linalg.LinAlgError):  # scipy's errors are RuntimeErrors
            continue
        if math.isfinite(trial.score) and (best is None or trial.score < best.score):
            best = trial
    return best


def _likelier(best: _Trial, *attempts: CountedSteps[_Trial]) -> CountedSteps[_Trial]:
    found = yield from _likeliest(best, *attempts)
    assert found is not None
    return found


def _quick(case: _Case, poses: FloatArray, settle: bool = True) -> CountedSteps[_Trial]:
    """Find the settled solution next to that of dynamic covariance scaling, or that itself if it contradicts no loop."""
    quick = yield from case.problem.solving_switchable(poses, LOOP_SCALE, MAX_ITERATIONS)
    weights = _within(case, quick)
    if settle or not weights.all():
        return (yield from _settled(case, quick))
    return _Trial(quick, weights, *_unlikelihood(case, quick, weights))


def _trusted(case: _Case, poses: FloatArray) -> CountedSteps[_Trial]:
    """Find the solution with every loop accepted, or, if it is likelier, the settled one next to it."""
    weights = np.ones(len(case.problem.edges))
    plain = yield from case.problem.solving(poses, weights, iterations=MAX_ITERATIONS)
    trial = _Trial(plain, weights, *_unlikelihood(case, plain, weights))
    if _within(case, plain).all():
        return trial
    return (yield from _likelier(trial, _settled(case, plain)))


def _trusted_from_nothing(case: _Case) -> CountedSteps[_Trial]:
    """Find the solution next to the spectral start with every loop accepted, as `_trusted` does."""
    return (yield from _trusted(case, _spectral(case)))


def _spectral(case: _Case) -> FloatArray:
    """Return poses (N, 3) from the edges alone."""
    from waychair.slam.graph.pose_synchronisation import spectral_poses

    poses = spectral_poses(case.problem.edges, len(case.start))
    if not np.isfinite(poses).all():
        raise GraphError("the edges alone do not determine the poses; add edges to loose nodes")
    return with_first_pose(poses, case.start[0])


def _settled_by_rounds(case: _Case) -> CountedSteps[_Trial]:
    """Find the settled solution next to that of graduated non-convexity."""
    return (yield from _settled(case, (yield from _graduated(case.problem, case.start))))


def _graduated(problem: PoseGraphProblem, poses: FloatArray) -> CountedSteps[FloatArray]:
    """Work out poses by graduated non-convexity with truncated least squares on the loops.

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
        weights = joined_weights(problem.edges, weights, against, len(poses))
        poses = yield from problem.solving(poses, weights, iterations=1, damped=False)
        against = chi_square(poses, problem.edges)
        if convexity > 1 and np.isin(weights, (0.0, 1.0)).all():
            break
        convexity *= ANNEALING
    return poses


def _settled(case: _Case, poses: FloatArray) -> CountedSteps[_Trial]:
    """Find the solution next to the poses whose accepted loops are exactly those within the limit."""
    weights = _within(case, poses)
    for _ in range(10):
        poses = yield from case.problem.solving(poses, weights, iterations=MAX_ITERATIONS)
        now = _within(case, poses)
        if (now == weights).all():
            break
        weights = now
    return _Trial(poses, weights, *_unlikelihood(case, poses, weights))


def _within(case: _Case, poses: FloatArray) -> FloatArray:
    """Return weights (E,): 0 for loops beyond the limit that are not needed to connect the graph, 1 for other edges."""
    against = chi_square(poses, case.problem.edges)
    weights = np.where(case.problem.edges.loop & (against >= LOOP_LIMIT), 0.0, 1.0)
    return joined_weights(case.problem.edges, weights, against, len(poses))


def _variance(against: float, loops: float) -> tuple[float, float]:
    """Return the noise level of a solution, its chi-square per degree of freedom pulled towards 1, and the pull's weight.

    The pull is as if some more loops fitted exactly as their information says: five if the noise is less than stated, as
    in most graphs, and fifty if it is more, because false loops that bend the odometry look like noise.
    """
    prior = 15.0 if against < 3 * loops else 150.0
    return (against + prior) / (3 * loops + prior), prior


def _unlikelihood(case: _Case, poses: FloatArray, weights: FloatArray) -> tuple[float, float, float]:
    """Return -2 log likelihood of the loops up to a constant, the sum of chi-squares, and the noise level.

    Each accepted loop has 3 degrees of freedom with the solution's variance. A group of false loops that bends the
    odometry raises the variance, and with it the cost of every true loop.
    """
    loops, left_out = float(case.problem.edges.loop.sum()), np.flatnonzero(weights == 0)
    against = float(chi_square(poses, case.problem.edges)[weights > 0].sum())
    variance, prior = _variance(against, loops - len(left_out))
    doubted, groups = len(np.unique(case.groups[left_out])), int(case.groups.max()) + 1
    cost = _rejection(case, left_out)
    if groups > FEW_LOOPS and 2 * doubted > groups:  # it doubts the noise, not the loops: every loop counts by itself
        cost = (3.0 + REJECTION_COST) * len(left_out)
    return (3 * loops + prior) * math.log(variance) + (against + prior) / variance - prior + cost, against, variance


def _rejection(case: _Case, left_out: IntArray) -> float:
    """Return the cost of leaving loops out: that of 3 degrees of freedom each, and that of a rejection per group.

    A group that agrees is one mistake, and costs more only by the logarithm of its number.
    """
    is_first = case.problem.edges.loop.sum() <= FEW_LOOPS
    return 3.0 * len(left_out) + group_cost(case.groups, left_out, FIRST_REJECTION_COST if is_first else REJECTION_COST)


def _reconsidered(case: _Case, best: _Trial) -> CountedSteps[_Trial]:
    """Find the candidate after accepting again the loops that were rejected only because their poses are uncertain.

    A true loop that was rejected early may lie hundreds of sigmas from a solution that is uncertain there; its
    innovation tells it from a false loop. Real noise has long tails, so one loop may reach five times the noise level.
    Loops are accepted together, and stay if that costs less than their rejection.
    """
    problem, noise = case.problem, max(best.variance, min(1.0, 5 * best.variance))
    for _ in range(5):
        left_out = np.flatnonzero(best.weights == 0)
        against = chi_square(best.poses, problem.edges)[left_out]
        asked = left_out[np.argsort(against)][:MAX_SECOND_LOOKS]
        if not len(asked):
            break
        try:
            innovations, _ = yield from problem.innovations(best.poses, best.weights, asked)
            welcome = asked[innovations < REJECTION_COST * noise]
            weights = best.weights.copy()
            weights[welcome] = 1.0
            begun = yield from problem.solving(best.poses, weights, iterations=MAX_ITERATIONS)
            again = yield from _settled(case, begun)
        except (GraphError, RuntimeError, np.linalg.LinAlgError):
            break
        back = np.flatnonzero((best.weights == 0) & (again.weights > 0))
        gained = (again.weights > 0).sum() - (best.weights > 0).sum()
        if gained <= 0 or again.against - best.against > noise * _rejection(case, back):
            break
        best = again
    return best


def _heard_by_group(case: _Case, best: _Trial) -> CountedSteps[_Trial]:
    """Find the candidate after leaving out, on trial, the accepted groups that the rest of the graph doubts most."""
    for _ in range(MAX_DOUBTS):
        better = best
        for group in _doubted(case, best)[:MAX_DOUBTS]:
            better = yield from _likelier(best, _without(case, best, group))
            if better is not best:
                break
        if better is best:
            break
        best = better
    return best


def _without(case: _Case, best: _Trial, group: int) -> CountedSteps[_Trial]:
    """Find the settled solution next to that without one group."""
    problem, against = case.problem, chi_square(best.poses, case.problem.edges)
    weights = np.where(case.groups == group, 0.0, best.weights)
    weights = joined_weights(problem.edges, weights, against, len(best.poses))
    begun = yield from problem.solving(best.poses, weights, iterations=MAX_ITERATIONS)
    return (yield from _reconsidered(case, (yield from _settled(case, begun))))


def _begun_without(case: _Case, group: int) -> CountedSteps[_Trial]:
    """Find the settled solution from the start with every loop but those of one group trusted.

    A large group that was trusted from the beginning may have bent the poses so far that no other loop comes back.
    """
    weights = np.where(case.groups == group, 0.0, 1.0)
    weights = joined_weights(case.problem.edges, weights, chi_square(case.start, case.problem.edges), len(case.start))
    begun = yield from case.problem.solving(case.start, weights, iterations=MAX_ITERATIONS)
    return (yield from _settled(case, begun))


def _largest(case: _Case, best: _Trial) -> list[int]:
    """Return the largest groups of accepted loops, as many as are left out on trial."""
    accepted = case.groups[(case.groups >= 0) & (best.weights > 0)]
    names, sizes = np.unique(accepted, return_counts=True)
    order = np.argsort(-sizes, kind="stable")[:MAX_DOUBTS]
    return [int(names[k]) for k in order if sizes[k] >= LEAST_GROUP]


def _without_kernel(case: _Case, best: _Trial) -> _Trial:
    """Return the candidate, or the least-squares solution of its edges if normal noise explains them better than long tails.

    The Huber kernel takes weight from every edge whose noise is larger than stated, so that a graph with such noise
    throughout is bent, although nothing in it is false.
    """
    edges = case.problem.edges
    try:
        poses = PoseGraphProblem(edges, None).solve(best.poses, best.weights, MAX_ITERATIONS)
    except GraphError:
        return best
    accepted = best.weights > 0
    bent, plain = (chi_square(each, edges)[accepted] for each in (best.poses, poses))
    loop = edges.loop[accepted]
    freedom, level = 3.0 * len(loop), _variance(float(plain.sum()), float(loop.sum()))[0]
    tails = min(freedom * math.log(noise) + _long_tailed(bent / noise, loop) for noise in (best.variance, level))
    if freedom * math.log(level) + float(plain.sum()) / level >= tails:
        return best
    return _Trial(poses, best.weights, *_unlikelihood(case, poses, best.weights))


def _long_tailed(against: FloatArray, loop: BoolArray) -> float:
    """Return -2 log likelihood of edges with Huber's density except for loops, up to the constant of the normal density."""
    tail = against > MATCH_KERNEL**2
    huber = np.where(tail, 2 * MATCH_KERNEL * np.sqrt(against) - MATCH_KERNEL**2, against) + HUBER_COST
    return float(np.where(loop, against, huber).sum())


def _doubted(case: _Case, best: _Trial) -> list[int]:
    """Return the accepted groups whose innovation against all other edges exceeds their rejection, the worst first."""
    accepted = np.flatnonzero((case.groups >= 0) & (best.weights > 0))
    names, sizes = np.unique(case.groups[accepted], return_counts=True)
    largest = np.argsort(-sizes, kind="stable")
    heard = largest[(sizes[largest] >= LEAST_GROUP) & (np.cumsum(sizes[largest]) <= MAX_HEARD)]
    if not len(heard):
        return []
    members = [accepted[case.groups[accepted] == name] for name in names[heard]]
    try:
        innovations = case.problem.group_innovations(best.poses, best.weights, members)
    except (RuntimeError, np.linalg.LinAlgError):
        return []
    excess = innovations / best.variance - [_rejection(case, group) for group in members]
    return [int(names[heard[k]]) for k in np.argsort(-excess).tolist() if excess[k] > 0]
