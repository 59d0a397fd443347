"""Robust pose graphs: false loops on a real graph, bad starts, proofs of optimality."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.slam.graph.two_laps import laps, measured, rmse
from waychair.errors import GraphError
from waychair.slam.graph.edges import EdgeArrays, chi_square, edge_arrays
from waychair.slam.graph.graph_optimisation import Edge, EdgeKind, RejectionReason, read_g2o, solve
from waychair.slam.graph.least_squares import least_squares
from waychair.slam.graph.pose_graph import PoseGraph
from waychair.slam.graph.pose_synchronisation import isotropic, lower_bound, polished, sesync_objective, spectral_poses
from waychair.slam.graph.robust_optimisation import chained_poses
from waychair.types import FloatArray, Pose2


@pytest.fixture(scope="module")
def intel(data_dir: Path) -> tuple[FloatArray, tuple[Edge, ...], FloatArray]:
    """Odometry's start, edges and the clean optimum of the first 600 nodes of the Intel graph."""
    poses, every = read_g2o(data_dir / "posegraphs" / "intel.g2o.gz")
    edges = tuple(edge for edge in every if max(edge.i, edge.j) < 600)
    start = chained_poses(poses[:600], edges)
    return start, edges, least_squares(start, edge_arrays(edges))


@pytest.fixture(scope="module")
def mit(data_dir: Path) -> tuple[FloatArray, EdgeArrays]:
    poses, edges = read_g2o(data_dir / "posegraphs" / "MIT.g2o.gz")
    return poses, edge_arrays(edges)


def drawn_false_loops(clean: FloatArray, information: FloatArray, group: int, count: int) -> list[Edge]:
    """Loops at random poses within 10 m, in groups that join consecutive nodes and agree with each other."""
    rng, drawn = np.random.default_rng(0), []
    while len(drawn) < count:
        i = int(rng.integers(0, 200))
        j = int(rng.integers(300, 600 - group))
        there = Pose2(*rng.uniform(-10, 10, 2).tolist(), float(rng.uniform(-3, 3)))
        for k in range(group):
            from_second = Pose2(*clean[j].tolist()).inverse() @ Pose2(*clean[j + k].tolist())
            to_first = Pose2(*clean[i + k].tolist()).inverse() @ Pose2(*clean[i].tolist())
            drawn.append(Edge(i + k, j + k, to_first @ there @ from_second, information, EdgeKind.LOOP))
    return drawn


@pytest.mark.parametrize("group", [1, pytest.param(10, marks=pytest.mark.nightly)])
def test_false_loops_do_not_move_the_optimum_and_are_named(
    intel: tuple[FloatArray, tuple[Edge, ...], FloatArray], group: int
) -> None:
    start, edges, clean = intel
    false = drawn_false_loops(clean, edges[-1].information, group, 20)
    solution = solve(start, (*edges, *false))
    assert rmse(solution.poses, clean) < 0.1
    assert {id(item.edge) for item in solution.rejected} == {id(edge) for edge in false}
    assert all(
        item.chi_square >= item.limit and item.reason is RejectionReason.CONTRADICTED for item in solution.rejected
    )
    told = [str(item) for item in solution.rejected]
    assert told[0].startswith(f"loop {false[0].i}-{false[0].j}: the rest of the graph contradicts it (chi-square ")


@pytest.mark.parametrize(("turned", "is_true"), [(0.0, True), (0.8, False)])
def test_the_first_loop_is_kept_although_steps_drift_by_more_than_their_deviation(turned: float, is_true: bool) -> None:
    """Sixty steps round a circle err by 1.1 standard deviations of the heading, all to one side, 18 degrees in all."""
    count, sigma, bias = 60, 0.0047, 0.0052
    information = np.diag([0.01**-2, 0.01**-2, sigma**-2])
    true, drifted = (Pose2(0.4, 0.0, 2 * math.pi / count + more) for more in (0.0, bias))
    steps = [Edge(k, k + 1, drifted, information, EdgeKind.MATCH) for k in range(count)]
    poses, back = [Pose2()], Pose2()
    for _ in range(count):
        poses.append(poses[-1] @ drifted)
        back = back @ true
    loop = Edge(0, count, back @ Pose2(0.0, 0.0, turned), information, EdgeKind.LOOP)
    solution = solve(np.array([pose.array() for pose in poses]), (*steps, loop))
    assert bool(solution.accepted.all()) is is_true


def test_without_false_loops_no_true_loop_is_rejected(intel: tuple[FloatArray, tuple[Edge, ...], FloatArray]) -> None:
    start, edges, clean = intel
    solution = solve(start, edges)
    assert solution.accepted.all()
    assert solution.rejected == ()
    assert rmse(solution.poses, clean) < 0.01


def test_from_a_start_near_a_local_optimum_the_proven_optimum_is_found(mit: tuple[FloatArray, EdgeArrays]) -> None:
    poses, edges = mit
    assert sesync_objective(poses, edges) > 1e5
    solved = least_squares(poses, isotropic(edges))
    value = sesync_objective(solved, edges)
    proven = lower_bound(polished(solved, edges), edges)
    assert value == pytest.approx(61.154, abs=0.01)
    assert proven <= value * (1 + 1e-9)
    assert value < 1.0001 * proven


def test_a_local_optimum_gets_no_proof(mit: tuple[FloatArray, EdgeArrays]) -> None:
    poses, edges = mit
    stuck = poses
    for _ in range(3):
        stuck = polished(stuck, edges)
    assert sesync_objective(stuck, edges) > 100
    assert lower_bound(stuck, edges) < 61.16


def test_exact_edges_give_the_poses_without_a_guess() -> None:
    rng = np.random.default_rng(2)
    truth = np.column_stack([rng.uniform(-5, 5, (30, 2)), rng.uniform(-3, 3, 30)])
    truth[0] = 0.0
    pairs = [(k, k + 1) for k in range(29)] + [(0, 10), (5, 25), (29, 2)]
    edges = edge_arrays([measured(truth, i, j, EdgeKind.MATCH) for i, j in pairs])
    assert spectral_poses(edges, 30) == pytest.approx(truth, abs=1e-3)
    assert sesync_objective(truth, edges) == pytest.approx(0.0, abs=1e-15)


def test_invalid_graphs_are_refused() -> None:
    truth, edges = laps()
    with pytest.raises(GraphError, match="no edges connect node 50"):
        solve(truth, [edge for edge in edges if edge.j != 50 and edge.i not in (49, 50)])
    with pytest.raises(GraphError, match="names node 79 of a graph of 40"):
        solve(truth[:40], edges)
    pieces = np.tile(truth, (10, 1))
    inside = [replace(edge, i=edge.i + 80 * k, j=edge.j + 80 * k) for k in range(10) for edge in edges]
    told = "no edges connect node 80 with node 0; add one, or solve the 10 parts separately"
    with pytest.raises(GraphError, match=told):
        solve(pieces, inside)
    grown = PoseGraph()
    grown.add(pieces, inside)
    with pytest.raises(GraphError, match=told):
        grown.update()
    broken = Edge(0, 5, Pose2(float("nan"), 0, 0), np.eye(3), EdgeKind.LOOP)
    with pytest.raises(GraphError, match="not finite"):
        solve(truth, [*edges, broken])
    graph = PoseGraph()
    graph.add(truth[:2], edges[:1])
    for bad in (broken, Edge(1, 1, Pose2(), np.eye(3), EdgeKind.LOOP), Edge(0, 9, Pose2(), np.eye(3), EdgeKind.MATCH)):
        with pytest.raises(GraphError):
            graph.add(truth[2:6], [edges[1], bad])
    assert len(graph.poses) == 2
    assert chi_square(truth, edges[-3:]) == pytest.approx(np.zeros(3), abs=1e-9)
