"""The pose graph: optimum of a known problem, false loops, and the g2o file."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from waychair.geometry import compose, invert, pose_from_array
from waychair.slam.graph.graph_optimisation import Edge, EdgeKind, chi_square, residuals, solve, write_g2o
from waychair.slam.mapping.loop_candidates import LoopSettings, candidates, graph_distances
from waychair.types import FloatArray, Pose2

TIGHT = np.diag([1e4, 1e4, 1e4])


def ring(count: int = 40, radius: float = 5.0) -> FloatArray:
    """True poses (count, 3) on a circle."""
    angles = np.linspace(0, math.tau, count, endpoint=False)
    return np.stack([radius * np.cos(angles), radius * np.sin(angles), angles + math.pi / 2], axis=1)


def edge(truth: FloatArray, i: int, j: int, kind: EdgeKind, off: Pose2 | None = None) -> Edge:
    relative = pose_from_array(compose(invert(truth[i]), truth[j]))
    return Edge(i, j, relative @ (off or Pose2()), TIGHT, kind)


def drifting(truth: FloatArray) -> tuple[FloatArray, list[Edge]]:
    """Dead-reckoned poses along the ring and their edges, each with a small error."""
    rng = np.random.default_rng(3)
    edges = [
        edge(truth, k, k + 1, EdgeKind.MATCH, Pose2(0.01, 0.0, 0.01 + 0.002 * rng.standard_normal()))
        for k in range(len(truth) - 1)
    ]
    poses = [truth[0]]
    for item in edges:
        poses.append(compose(poses[-1], item.i_from_j.array()))
    return np.array(poses), edges


def test_one_loop_closes_the_ring() -> None:
    truth = ring()
    poses, edges = drifting(truth)
    assert np.hypot(*(poses - truth)[-1, :2]) > 1.0
    edges.append(edge(truth, 0, len(truth) - 1, EdgeKind.LOOP))
    solved = solve(poses, edges).poses
    assert solved[0] == pytest.approx(poses[0])
    assert np.hypot(*(solved - truth)[-1, :2]) < 0.2


def test_false_loops_do_not_bend_a_well_connected_map_and_are_named_by_their_chi_square() -> None:
    truth = ring()
    edges = [edge(truth, k, k + 1, EdgeKind.MATCH) for k in range(len(truth) - 1)]
    edges += [edge(truth, k, k + 20, EdgeKind.LOOP) for k in range(0, 20, 4)]
    false = [edge(truth, k, k + 25, EdgeKind.LOOP, Pose2(3.0, -2.0, 1.0)) for k in (0, 7)]
    solved = solve(truth + 0.0, [*edges, *false]).poses
    assert np.hypot(*(solved - truth)[:, :2].T).max() < 0.1
    assert (chi_square(solved, false) > 100).all()
    assert (chi_square(solved, edges) < 10).all()


def test_residuals_vanish_at_the_truth_and_equal_the_error_elsewhere() -> None:
    truth = ring()
    exact = [edge(truth, 0, 5, EdgeKind.LOOP)]
    assert residuals(truth, exact) == pytest.approx(np.zeros((1, 3)), abs=1e-12)
    off = [Edge(0, 5, exact[0].i_from_j @ Pose2(0.3, 0.0, 0.0), TIGHT, EdgeKind.LOOP)]
    assert residuals(truth, off) == pytest.approx(np.array([[-0.3, 0.0, 0.0]]), abs=1e-9)
    assert chi_square(truth, off) == pytest.approx([0.09e4])


def test_the_g2o_file_holds_every_pose_and_edge(tmp_path: Path) -> None:
    truth = ring(5)
    edges = [edge(truth, k, k + 1, EdgeKind.MATCH) for k in range(4)]
    write_g2o(tmp_path / "graph.g2o", truth, edges)
    rows = [line.split() for line in (tmp_path / "graph.g2o").read_text().splitlines()]
    vertices = np.array([row[2:] for row in rows if row[0] == "VERTEX_SE2"], float)
    assert vertices == pytest.approx(truth, abs=1e-7)
    first = next(row for row in rows if row[0] == "EDGE_SE2")
    assert [int(value) for value in first[1:3]] == [0, 1]
    assert [float(value) for value in first[3:6]] == pytest.approx(edges[0].i_from_j.array(), abs=1e-7)
    assert [float(value) for value in first[6:]] == [1e4, 0, 0, 1e4, 0, 1e4]


def test_the_graph_distance_is_that_of_the_shortest_path() -> None:
    truth = ring(40, 5.0)
    edges = [edge(truth, k, k + 1, EdgeKind.MATCH) for k in range(39)]
    chord = float(np.hypot(*(truth[1] - truth[0])[:2]))
    assert graph_distances(truth, edges, 39)[0] == pytest.approx(39 * chord, rel=0.01)
    edges.append(edge(truth, 0, 39, EdgeKind.LOOP))
    assert graph_distances(truth, edges, 39)[5] == pytest.approx(6 * chord, rel=0.01)


def ways(poses: FloatArray, edges: list[Edge], known: int) -> FloatArray:
    return graph_distances(poses, edges, len(poses) - 1)[:known]


def test_candidates_are_near_in_space_and_far_along_the_graph() -> None:
    truth = np.concatenate([ring(100), ring(100)[:20]])
    edges = [edge(truth, k, k + 1, EdgeKind.MATCH) for k in range(len(truth) - 1)]
    found = candidates(truth, ways(truth, edges, len(truth) - 30), LoopSettings())
    assert found[0].nearest == 19
    assert set(found[0].members) <= set(range(50))
    assert found[0].window == pytest.approx(0.03 * 31.4, rel=0.1)


def test_a_chair_that_only_drove_on_has_no_candidates() -> None:
    line = np.stack([np.arange(0, 40, 0.2), np.zeros(200), np.zeros(200)], axis=1)
    edges = [edge(line, k, k + 1, EdgeKind.MATCH) for k in range(199)]
    assert candidates(line, ways(line, edges, 160), LoopSettings()) == ()
    assert candidates(line[:2], ways(line[:2], edges[:1], 0), LoopSettings()) == ()


def test_a_place_just_linked_is_not_a_candidate_again() -> None:
    truth = np.concatenate([ring(100), ring(100)[:20]])
    edges = [edge(truth, k, k + 1, EdgeKind.MATCH) for k in range(len(truth) - 1)]
    edges.append(edge(truth, 19, len(truth) - 1, EdgeKind.LOOP))
    assert all(abs(c.nearest - 19) > 10 for c in candidates(truth, ways(truth, edges, len(truth) - 30), LoopSettings()))
