"""Graphs with so many false loops that their equations would be nearly dense."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from waychair.geometry import compose, invert, pose_from_array
from waychair.slam.graph.edges import Edge, EdgeKind, edge_arrays
from waychair.slam.graph.loop_sieve import is_too_dense
from waychair.slam.graph.robust_optimisation import chained_poses, solve
from waychair.types import FloatArray

_SIGMAS = np.array([0.03, 0.03, 0.01])
_INFORMATION = np.diag(_SIGMAS**-2.0)


def rounds_of_a_block(rounds: int, side: int) -> FloatArray:
    """Return the poses (N, 3) of a drive round a block of so many metres a side, one each metre, each round beside the last."""
    poses = []
    for turn in range(rounds):
        for edge in range(4):
            heading = math.pi / 2 * edge
            corner = side * np.array([(0, 0), (1, 0), (1, 1), (0, 1)][edge])
            for step in range(side):
                x, y = corner + step * np.array([math.cos(heading), math.sin(heading)])
                poses.append((x, y + 0.1 * turn, heading))
    return np.array(poses)


def measured(true: FloatArray, i: int, j: int, kind: EdgeKind, rng: np.random.Generator) -> Edge:
    noise = rng.normal(0.0, _SIGMAS)
    return Edge(i, j, pose_from_array(compose(compose(invert(true[i]), true[j]), noise)), _INFORMATION, kind)


def graph_with_false_loops(false: int, group: int) -> tuple[FloatArray, list[Edge], list[Edge]]:
    """Return the true poses, the true edges, and so many false loops, of which `group` each agree with each other."""
    rng = np.random.default_rng(5)
    true = rounds_of_a_block(10, 25)
    lap = len(true) // 10
    edges = [measured(true, i, j, EdgeKind.MATCH, rng) for i, j in pairwise(range(len(true)))]
    edges += [measured(true, k, k + lap, EdgeKind.LOOP, rng) for k in range(0, len(true) - lap, 2)]
    drawn: list[Edge] = []
    while len(drawn) < false:
        first, second = sorted(rng.integers(0, len(true) - group, 2).tolist())
        if second - first < 2 * group:
            continue
        moved = np.array([*rng.uniform(-10.0, 10.0, 2), rng.uniform(-math.pi, math.pi)])
        for k in range(group):
            to_first = compose(invert(true[first + k]), true[first])
            from_second = compose(invert(true[second]), true[second + k])
            lie = compose(compose(to_first, moved), from_second)
            drawn.append(Edge(first + k, second + k, pose_from_array(lie), _INFORMATION, EdgeKind.LOOP))
    return true, edges, drawn


@pytest.mark.parametrize(
    ("count", "group", "solved_before"),
    [
        (3_000, 1, True),
        pytest.param(10_000, 1, False, marks=pytest.mark.nightly),
        pytest.param(10_000, 1, True, marks=pytest.mark.nightly),
        pytest.param(10_000, 10, False, marks=pytest.mark.nightly),
        pytest.param(10_000, 10, True, marks=pytest.mark.nightly),
    ],
)
def test_thousands_of_false_loops_are_rejected_and_no_true_one(count: int, group: int, solved_before: bool) -> None:
    true, edges, false = graph_with_false_loops(count, group)
    assert is_too_dense(edge_arrays([*edges, *false]), len(true))
    assert_only_true_loops_are_accepted(true, edges, false, solved_before)


@pytest.mark.nightly
@pytest.mark.parametrize("solved_before", [False, True])
def test_false_loops_outnumber_the_true_ones_in_a_graph_that_can_be_solved_as_a_whole(solved_before: bool) -> None:
    true, edges, false = graph_with_false_loops(1_000, 1)
    assert not is_too_dense(edge_arrays([*edges, *false]), len(true))
    assert_only_true_loops_are_accepted(true, edges, false, solved_before)


def assert_only_true_loops_are_accepted(
    true: FloatArray, edges: list[Edge], false: list[Edge], solved_before: bool
) -> None:
    start = true if solved_before else chained_poses(true, edges)
    solution = solve(start, [*edges, *false], solved_before)
    assert solution.accepted[: len(edges)].all()
    assert not solution.accepted[len(edges) :].any()
    assert len(solution.rejected) == len(false)
    away = np.hypot(*(solution.poses - true)[:, :2].T)
    assert math.sqrt((away**2).mean()) < 0.2


def test_many_true_loops_between_neighbours_make_no_graph_dense() -> None:
    _, edges, _ = graph_with_false_loops(0, 1)
    assert not is_too_dense(edge_arrays(edges * 4), 480)
