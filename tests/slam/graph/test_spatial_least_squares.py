"""Pose graphs in space: exact edges, a bad start on a sphere of great noise, and a false loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from waychair.slam.graph.spatial_least_squares import SpatialEdge, SpatialProblem
from waychair.slam.rgbd.spatial_graph import solve_spatial
from waychair.types import FloatArray, Pose3


def turned(vector: FloatArray) -> FloatArray:
    """The rotation matrix of a rotation vector, by Rodrigues' formula."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / max(angle, 1e-12)
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation: FloatArray = np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew
    return rotation


def ball(turns: int = 12, steps: int = 16) -> list[Pose3]:
    """Poses of a drive round a ball of 5 m from pole to pole, with any heading."""
    rng, poses = np.random.default_rng(1), []
    for k in range(turns * steps):
        round_, down = 2 * np.pi * k / steps, np.pi * (k + 1) / (turns * steps + 1)
        place = 5 * np.array([np.sin(down) * np.cos(round_), np.sin(down) * np.sin(round_), np.cos(down)])
        poses.append(Pose3(turned(0.5 * rng.normal(size=3)), place))
    moved = poses[0].inverse()
    return [moved @ pose for pose in poses]


def tied(truth: list[Pose3], steps: int, far: float, bent: float, stated: float = 1.0) -> list[SpatialEdge]:
    """Noisy edges to the next node and to the next turn; the covariance is `stated` times that of the noise."""
    rng, edges = np.random.default_rng(2), []
    covariance = stated * np.diag([max(bent, 1e-3) ** 2] * 3 + [max(far, 1e-3) ** 2] * 3)
    for i, j in [(k, k + s) for s in (1, steps) for k in range(len(truth) - s)]:
        noise = Pose3(turned(bent * rng.normal(size=3)), far * rng.normal(size=3))
        edges.append(SpatialEdge(i, j, truth[i].inverse() @ truth[j] @ noise, covariance, loop=j > i + 1))
    return edges


def chained(edges: list[SpatialEdge], count: int) -> list[Pose3]:
    steps = {edge.i: edge.i_from_j for edge in edges if edge.j == edge.i + 1}
    poses = [Pose3(np.eye(3), np.zeros(3))]
    for node in range(count - 1):
        poses.append(poses[-1] @ steps[node])
    return poses


def apart(poses: tuple[Pose3, ...] | list[Pose3], truth: list[Pose3]) -> float:
    return float(max(np.linalg.norm(a.translation - b.translation) for a, b in zip(poses, truth, strict=True)))


def test_exact_edges_give_the_poses_without_a_guess() -> None:
    truth = ball(4)
    problem = SpatialProblem(tied(truth, 16, 0.0, 0.0))
    first = Pose3(turned(np.array([0.3, -0.2, 1.0])), np.array([1.0, 2.0, 3.0]))
    start = problem.chordal_start(first, len(truth))
    assert start is not None
    assert apart(start, [first @ pose for pose in truth]) < 2e-3
    assert problem.chi_square(start).max() < 1.0


@pytest.mark.sampled(1)
@pytest.mark.parametrize("stated", [1.0, 0.02])
@pytest.mark.parametrize("flagged", [True, False])
def test_a_noisy_ball_ends_at_the_best_solution_from_dead_reckoning(stated: float, flagged: bool) -> None:
    truth = ball()
    edges = tied(truth, 16, 0.1, 0.2, stated)
    if not flagged:
        edges = [SpatialEdge(e.i, e.j, e.i_from_j, e.covariance) for e in edges]
    start, problem = chained(edges, len(truth)), SpatialProblem(edges)
    assert apart(start, truth) > 2.0
    best = problem.chi_square(problem.solve(truth)).sum()
    assert problem.chi_square(solve_spatial(start, edges).poses).sum() < 1.001 * best


def test_a_false_loop_does_not_bend_a_ball() -> None:
    truth = ball(6)
    edges = tied(truth, 16, 0.01, 0.005)
    clean = solve_spatial(truth, edges).poses
    false = SpatialEdge(5, 80, Pose3(np.eye(3), np.array([1.0, 0.0, 0.0])), edges[0].covariance, loop=True)
    solution = solve_spatial(chained(edges, len(truth)), [*edges, false])
    assert apart(solution.poses, list(clean)) < 0.01
    assert solution.errors[-1] > 3.0
    assert solution.errors[:-1].max() < 6.0


def test_a_node_without_edges_has_no_chordal_start() -> None:
    truth = ball(2)
    edges = [edge for edge in tied(truth, 16, 0.01, 0.01) if 20 not in (edge.i, edge.j)]
    assert SpatialProblem(edges).chordal_start(truth[0], len(truth)) is None


def test_ten_pieces_that_no_edges_connect_are_each_solved_in_themselves() -> None:
    truth = ball(3, 8)
    edges = tied(truth, 8, 0.05, 0.05)
    start, count = chained(edges, len(truth)), len(truth)
    alone = solve_spatial(start, edges).poses
    places = [Pose3(turned(np.array([0.0, 0.0, 0.3 * k])), np.array([20.0 * k, 0.0, 0.0])) for k in range(10)]
    every = [replace(edge, i=edge.i + count * k, j=edge.j + count * k) for k in range(10) for edge in edges]
    solved = solve_spatial([place @ pose for place in places for pose in start], every).poses
    for first in range(0, 10 * count, count):
        moved = alone[0] @ solved[first].inverse()
        assert apart([moved @ pose for pose in solved[first : first + count]], list(alone)) < 1e-4
