"""Groups of loops that agree: found as groups, judged against the odometry, and graphs in which loops alone join parts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.geometry import compose, invert, pose_from_array
from waychair.slam.graph.edges import chi_square, edge_arrays
from waychair.slam.graph.graph_optimisation import Edge, EdgeKind, solve
from waychair.slam.graph.least_squares import PoseGraphProblem, joined_weights, least_squares
from waychair.slam.graph.loop_groups import group_cost, loop_groups
from waychair.slam.graph.robust_optimisation import chained_poses
from waychair.types import FloatArray, Pose2

SIGMA = np.array([0.02, 0.02, 0.01])
INFORMATION = np.diag(SIGMA**-2)


def block_drive(count: int, seed: int) -> FloatArray:
    """True poses (count, 3) of a drive along streets of 5 m: at each crossing straight on, left or right."""
    rng = np.random.default_rng(seed)
    poses, heading = [np.zeros(3)], 0.0
    for k in range(1, count):
        if k % 5 == 0:
            heading += float(rng.choice([-1, 0, 1])) * math.pi / 2
        x, y, _ = poses[-1]
        poses.append(np.array([x + math.cos(heading), y + math.sin(heading), math.remainder(heading, math.tau)]))
    return np.array(poses)


def seen(truth: FloatArray, i: int, j: int, kind: EdgeKind, noise: FloatArray) -> Edge:
    measured = compose(compose(invert(truth[i]), truth[j]), noise)
    return Edge(i, j, Pose2() @ pose_from_array(measured), INFORMATION, kind)


def driven(truth: FloatArray, seed: int, tied: int = 10) -> list[Edge]:
    """Noisy odometry, and loops between nodes within 0.5 m that are `tied` or more nodes apart."""
    rng = np.random.default_rng(seed)
    edges = [seen(truth, k, k + 1, EdgeKind.ODOMETRY, SIGMA * rng.normal(size=3)) for k in range(len(truth) - 1)]
    for j in range(len(truth)):
        near = np.flatnonzero(np.hypot(*(truth[: max(j - tied, 0), :2] - truth[j, :2]).T) < 0.5)
        edges += [seen(truth, int(i), j, EdgeKind.LOOP, SIGMA * rng.normal(size=3)) for i in near[:2]]
    return edges


def mistaken(truth: FloatArray, i: int, j: int, count: int, at: Pose2) -> list[Edge]:
    """False loops from nodes i, i + 1, ... to nodes j, j + 1, ..., which all place node j at `at` in node i."""
    rng, false = np.random.default_rng(count), []
    for k in range(count):
        to_first = pose_from_array(compose(invert(truth[i + k]), truth[i]))
        from_second = pose_from_array(compose(invert(truth[j]), truth[j + k]))
        away = Pose2(*(SIGMA / 3 * rng.normal(size=3)).tolist())
        false.append(Edge(i + k, j + k, to_first @ at @ from_second @ away, INFORMATION, EdgeKind.LOOP))
    return false


def rmse(poses: FloatArray, other: FloatArray) -> float:
    return float(np.sqrt(((poses - other)[:, :2] ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("seed", range(3))
def test_a_graph_without_a_false_loop_ends_at_the_plain_optimum_from_dead_reckoning(seed: int) -> None:
    truth = block_drive(500, seed)
    edges = driven(truth, seed)
    start = chained_poses(truth, edges)
    assert rmse(start, truth) > 0.5
    solution = solve(start, edges)
    best = least_squares(truth, edge_arrays(edges))
    assert solution.accepted.all()
    assert rmse(solution.poses, best) < 0.02


@pytest.mark.parametrize(("seed", "size"), [(0, 12), (1, 12), (2, 40)])
def test_false_loops_that_agree_are_no_majority(seed: int, size: int) -> None:
    truth = block_drive(300, seed)
    edges = driven(truth, seed)
    start = chained_poses(truth, edges)
    clean = least_squares(start, edge_arrays(edges))
    false = mistaken(truth, 60, 200, size, Pose2(3.0, -4.0, 1.0))
    solution = solve(start, [*edges, *false])
    assert not solution.accepted[-size:].any()
    assert rmse(solution.poses, clean) < 0.05


def test_a_ring_of_odometry_alone_outvotes_ten_agreeing_loops() -> None:
    """Only one true loop closes the ring; ten false ones agree that two opposite places are one."""
    angles = np.linspace(0, math.tau, 100, endpoint=False)
    truth = np.stack([10 * np.cos(angles), 10 * np.sin(angles), angles + math.pi / 2], axis=1)
    edges = driven(truth, 5)
    edges.append(seen(truth, 0, 99, EdgeKind.LOOP, np.zeros(3)))
    false = mistaken(truth, 20, 70, 10, Pose2(0.0, 1.0, 0.5))
    solution = solve(chained_poses(truth, edges), [*edges, *false])
    assert solution.accepted.tolist() == [True] * len(edges) + [False] * 10


def test_loops_of_one_mistake_form_a_group_and_others_do_not() -> None:
    truth = block_drive(300, 4)
    one = mistaken(truth, 10, 150, 8, Pose2(3.0, 1.0, 0.2))
    turned = [Edge(e.j, e.i, e.i_from_j.inverse(), e.information, e.kind) for e in one[4:]]
    other = mistaken(truth, 12, 152, 5, Pose2(-3.0, 1.0, 0.2))
    odometry = [seen(truth, 0, 1, EdgeKind.ODOMETRY, np.zeros(3))]
    groups = loop_groups(truth, edge_arrays([*odometry, *one[:4], *turned, *other]))
    assert groups[0] == -1
    assert len(set(groups[1:9].tolist())) == 1
    assert len(set(groups[9:].tolist())) == 1
    assert groups[1] != groups[9]
    assert group_cost(groups, np.arange(1, 9), 50.0) == pytest.approx(50 * (1 + 0.2 * math.log(8)))
    assert loop_groups(truth, edge_arrays(odometry)).tolist() == [-1]


def test_a_group_s_joint_innovation_is_the_cost_of_adding_it() -> None:
    truth = block_drive(120, 6)
    edges = driven(truth, 6)
    added = mistaken(truth, 5, 90, 6, pose_from_array(compose(invert(truth[5]), truth[90])) @ Pose2(0.05, 0.03, 0.01))
    arrays = edge_arrays([*edges, *added])
    problem = PoseGraphProblem(arrays, None)
    members, weights = np.arange(len(edges), len(arrays)), np.ones(len(arrays))
    with_group = problem.solve(problem.solve(truth), iterations=20)
    weights[members] = 0
    without = problem.solve(problem.solve(truth, weights), weights, iterations=20)
    cost = chi_square(with_group, arrays).sum() - chi_square(without, arrays)[weights > 0].sum()
    (innovation,) = problem.group_innovations(with_group, np.ones(len(arrays)), [members])
    assert innovation == pytest.approx(cost, rel=0.02)


def test_a_drive_that_only_loops_join_to_the_first_is_placed_and_false_loops_are_named() -> None:
    truth = block_drive(80, 7)
    edges = [edge for edge in driven(truth, 7) if (edge.i < 40) == (edge.j < 40)]
    true = [seen(truth, k, 79 - k, EdgeKind.LOOP, np.zeros(3)) for k in range(0, 30, 3)]
    false = mistaken(truth, 30, 60, 2, Pose2(9.0, 9.0, 2.0))
    start = truth.copy()
    start[40:, :2] += (6.0, -3.0)
    solution = solve(start, [*edges, *true, *false])
    assert rmse(solution.poses, truth) < 0.2
    assert {id(item.edge) for item in solution.rejected} == {id(edge) for edge in false}


def test_the_only_loop_between_two_drives_is_kept() -> None:
    truth = block_drive(40, 8)
    edges = [edge for edge in driven(truth, 8) if (edge.i < 20) == (edge.j < 20)]
    only = seen(truth, 3, 30, EdgeKind.LOOP, np.zeros(3))
    start = truth.copy()
    start[20:, 0] += 50.0
    solution = solve(start, [*edges, only])
    assert solution.accepted.all()
    assert rmse(solution.poses, truth) < 0.5


def test_of_the_rejected_edges_the_best_ones_hold_the_graph_together() -> None:
    truth = np.zeros((4, 3))
    pairs = [(0, 1), (1, 2), (0, 2), (2, 3), (1, 3)]
    edges = edge_arrays([seen(truth, i, j, EdgeKind.LOOP, np.zeros(3)) for i, j in pairs])
    against = np.array([0.0, 90.0, 30.0, 20.0, 50.0])
    kept = joined_weights(edges, np.array([1.0, 0.0, 0.0, 0.0, 0.0]), against, 4)
    assert kept.tolist() == [1.0, 0.0, 1.0, 1.0, 0.0]


def test_long_loops_over_poor_odometry_are_one_group() -> None:
    rng, exact = np.random.default_rng(4), np.diag([400.0, 400.0, 400.0])
    true = [Pose2()]
    for _ in range(99):
        true.append(true[-1] @ Pose2(1.0, 0.0, 0.05))
    noise = [Pose2(*rng.normal(0.0, 0.05, 3)) for _ in range(99)]
    edges = [Edge(k, k + 1, Pose2(1.0, 0.0, 0.05) @ noise[k], exact, EdgeKind.MATCH) for k in range(99)]
    far = [true[k].inverse() @ Pose2(15.0, 9.0, 1.0) @ true[70 + k] for k in range(20)]
    edges += [Edge(k, 70 + k, far[k], exact, EdgeKind.LOOP) for k in range(20)]
    groups = loop_groups(chained_poses(np.zeros((100, 3)), edges), edge_arrays(edges))
    assert len(np.unique(groups[99:])) == 1
