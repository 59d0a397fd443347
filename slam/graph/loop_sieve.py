"""Choice of the credible loops of a graph that has too many false ones to be solved with all of them.

Loops between random nodes join everything with everything: the equations of a graph of 3,500 nodes with 10,000 false loops
are nearly dense, and one solution takes half a minute. So the graph is built up from its odometry. In each round the
innovations of the loops that nearly fit are taken, and those that fit are accepted, the most certain first. How many of them
fit by chance follows from the volume in which a loop would fit; while that number stays small beside those that fit, more
are accepted. Each round makes the graph stiffer, and further loops certain. The loops that are left are false, or nothing in the
graph supports them.
"""

from __future__ import annotations

import math

import numpy as np

from waychair.resumable import CountedSteps
from waychair.slam.graph.block_cholesky import structure_of
from waychair.slam.graph.edges import EdgeArrays, chi_square, residuals
from waychair.slam.graph.least_squares import PoseGraphProblem, joined_weights
from waychair.types import BoolArray, FloatArray

MOST_WORK = 1e7
"""Products of 3 x 3 blocks in one factor of the equations, half a second; graphs that need more are sieved."""

MANY_LOOPS = 200
"""Fewer loops make no equations dense, and can be judged one by one."""

_FITS = 16.27  # chi-square up to which an innovation fits (99.9 % of 3 degrees of freedom)
_CHANCE = 0.01  # largest share of the accepted loops of a round that may fit by chance
_CHANCE_OF_ONE = 0.02  # largest probability with which a loop that is accepted may fit by chance
_LEAST_SURE = 0.2  # the same where no loop is as sure; then only the surest tenth is accepted
_SUREST = 50  # loops by which the noise is estimated
_MEDIAN = 2.37  # of the chi-square distribution with 3 degrees of freedom
_MARGIN, _LEAST_NOISE = (
    3.0,
    0.01,
)  # times that estimate; with 2 true loops of M3500 are lost, with 5 false ones of Intel stay
_ASKED = 1000  # loops whose innovation is taken in a round, those that fit best first
_ROUNDS = 30
_SAMPLE = 1500  # loops by which the work is estimated
_STEPS = 10  # Levenberg-Marquardt steps of a round
_TURN_REACH = 2.0  # m; a residual of one radian counts as much as this


def is_too_dense(edges: EdgeArrays, count: int) -> bool:
    """Return whether the equations of a graph of `count` nodes take more than `MOST_WORK`."""
    loops = np.flatnonzero(edges.loop)
    if len(loops) < MANY_LOOPS:
        return False
    for every in sorted({max(1, len(loops) // _SAMPLE), 1}, reverse=True):
        kept = ~edges.loop
        kept[loops[::every]] = True
        blocks = np.diff(structure_of(edges.i[kept] - 1, edges.j[kept] - 1, count - 1).starts)
        if float((blocks.astype(np.float64) ** 2).sum()) > MOST_WORK:
            return True
    return False


def credible_loops(
    problem: PoseGraphProblem, poses: FloatArray, solved_before: bool
) -> CountedSteps[tuple[FloatArray, BoolArray]]:
    """Work out the poses (N, 3) with the credible loops, and the mask (E,) of those and all other edges.

    Poses that are an earlier solution (`solved_before`) accept the loops that fit them from the beginning.

    Raises:
        GraphError, numpy.linalg.LinAlgError: the equations of the other edges cannot be solved.
    """
    edges = problem.edges
    against = chi_square(poses, edges)
    welcome = ~edges.loop | (solved_before & (against < _FITS))
    span, noise = _span(edges), 1.0
    for _ in range(_ROUNDS):
        weights = joined_weights(edges, welcome.astype(np.float64), against, len(poses))
        poses = yield from problem.solving(poses, weights, iterations=_STEPS)
        away = residuals(poses, edges)
        against = chi_square(poses, edges)
        is_known = (accepted := welcome & edges.loop).sum() >= _SUREST
        if is_known:
            noise = _noise(against[accepted])
        welcome &= ~edges.loop | (against < _FITS * noise)
        open_loops = np.flatnonzero(weights == 0)
        far = np.hypot(away[open_loops, 0], away[open_loops, 1]) + _TURN_REACH * np.abs(away[open_loops, 2])
        asked = open_loops[np.argsort(far, kind="stable")[:_ASKED]]
        innovations, volumes = yield from problem.innovations(poses, weights, asked)
        if not is_known and (fits := np.flatnonzero(innovations < _FITS)).size:
            noise = _noise(innovations[fits[np.argsort(volumes[fits], kind="stable")[:_SUREST]]])
        fresh = asked[_is_certain(innovations / noise, volumes * noise**1.5, span)]
        if not len(fresh):
            break
        welcome[fresh] = True
    return poses, weights > 0


def _noise(against: FloatArray) -> float:
    """Return the limit of the noise over the stated one, at most 1, by the chi-squares (K,) of loops that are mostly true.

    Many graphs state far too large a noise (Intel's 50 times), and with that, too many false loops would fit by chance.
    """
    return float(np.clip(_MARGIN * np.median(against) / _MEDIAN, _LEAST_NOISE, 1.0))


def _is_certain(innovations: FloatArray, volumes: FloatArray, span: float) -> BoolArray:
    """Return which of some loops (K,) fit and are accepted; `volumes` (K,) are those of their innovations' unit ellipsoids.

    A false loop fits by chance if it falls into the volume of a loop that fits. In the order of their volumes, loops are
    accepted while the expected number of these is a small share of those that fit. Where none is as sure, a few are accepted,
    so that the graph becomes stiffer.
    """
    order = np.argsort(volumes, kind="stable")
    chance = np.minimum(1.0, volumes[order] * _FITS**1.5 / span)
    fits = innovations[order] < _FITS
    few = fits & (chance <= _CHANCE_OF_ONE) & (np.cumsum(chance) <= _CHANCE * np.cumsum(fits))
    if not few.any():
        few = fits & (chance <= _LEAST_SURE)
        few &= np.cumsum(few) <= max(1, few.sum() // 10)
    last = int(np.flatnonzero(few)[-1]) + 1 if few.any() else 0
    accepted = np.zeros(len(order), bool)
    accepted[order[:last]] = fits[:last]
    return accepted


def _span(edges: EdgeArrays) -> float:
    """Return the volume [m^2 rad] over which the measured loops spread."""
    loops = edges.i_from_j[edges.loop, :2]
    width, height = np.maximum(loops.max(axis=0) - loops.min(axis=0), 1.0)
    return float(width * height * math.tau)
