"""A graph that grows while the chair drives: solved on, judged in pieces where a loop is in doubt, mended, stored."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.slam.graph.two_laps import grown, laps, measured, rmse
from waychair.errors import GraphError
from waychair.resumable import CountedSteps
from waychair.slam.graph.edges import Edge, EdgeKind, edge_arrays
from waychair.slam.graph.g2o_files import read_g2o
from waychair.slam.graph.least_squares import least_squares
from waychair.slam.graph.pose_graph import PoseGraph
from waychair.slam.graph.robust_optimisation import RejectionReason, Solution, chained_poses, solving
from waychair.slam.mapping.checkpoint import object_from_state, state_of
from waychair.types import FloatArray, Pose2


def test_the_incremental_graph_agrees_with_the_batch_solution(
    data_dir: Path,
) -> None:
    poses, every = read_g2o(data_dir / "posegraphs" / "intel.g2o.gz")
    edges = tuple(edge for edge in every if max(edge.i, edge.j) < 300)
    start = chained_poses(poses[:300], edges)
    clean = least_squares(start, edge_arrays(edges))
    graph = grown(edges, start)
    assert rmse(graph.poses, clean) < 0.03
    assert rmse(graph.solve().poses, clean) < 0.01
    assert {id(edge) for edge in graph.edges} == {id(edge) for edge in edges}
    assert graph.rejected == ()


def test_a_false_loop_is_rejected_during_a_drive_and_a_removed_one_is_remembered() -> None:
    truth, edges = laps()
    false = measured(truth, 3, 70, EdgeKind.LOOP, Pose2(4.0, -3.0, 1.0))
    graph = grown([*edges, false], truth)
    assert [item.edge for item in graph.rejected] == [false]
    assert rmse(graph.poses, truth) < 0.1
    graph.remove([edges[-1]])
    graph.update()
    assert {item.reason for item in graph.rejected} == {RejectionReason.CONTRADICTED, RejectionReason.REMOVED}
    assert rmse(graph.poses, truth) < 0.1
    assert edges[-1] not in graph.edges
    with pytest.raises(GraphError, match="not in the graph"):
        graph.remove([edges[-1]])


def test_many_loops_in_doubt_are_judged_together_now_and_then_and_all_at_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    truth, edges = laps()
    solutions: list[int] = []

    def counted(poses: FloatArray, known: list[Edge], solved_before: bool = False) -> CountedSteps[Solution]:
        solutions.append(len(poses))
        return solving(poses, known, solved_before)

    monkeypatch.setattr("waychair.slam.graph.judgement.solving", counted)
    monkeypatch.setattr("waychair.slam.graph.pose_graph._NODES_A_JUDGEMENT", 4)
    rng = np.random.default_rng(3)
    drifts = [Pose2(float(x), float(y), float(turn)) for x, y, turn in rng.uniform(-1, 1, (36, 3)) * (4.0, 4.0, 2.0)]
    false = [measured(truth, k, k + 42, EdgeKind.LOOP, drift) for k, drift in enumerate(drifts)]
    graph = grown([*edges, *false], truth)
    assert rmse(graph.poses, truth) < 0.1
    assert 0 < len(solutions) < 20
    graph.solve()
    assert {id(item.edge) for item in graph.rejected} == {id(edge) for edge in false}
    assert rmse(graph.poses, truth) < 0.1


@pytest.mark.parametrize("closed", [False, True])
def test_an_edge_is_replaced_before_and_after_a_solution_and_a_stored_graph_remembers_it(closed: bool) -> None:
    truth, edges = laps()
    wrong = measured(truth, 20, 21, EdgeKind.MATCH, Pose2(0.6, 0.0, 0.2))
    edges[20], right = wrong, edges[20]
    graph = grown(edges if closed else edges[:79], truth)
    with pytest.raises(GraphError, match="cannot be replaced"):
        graph.replace(right, wrong)
    with pytest.raises(GraphError, match="cannot be replaced"):
        graph.replace(wrong, edges[21])
    graph.replace(wrong, right)
    graph.update()
    true_edges = [*edges[:20], right, *edges[21:]] if closed else [*edges[:20], right, *edges[21:79]]
    assert graph.poses == pytest.approx(grown(true_edges, truth).poses, abs=0.01)
    assert right in graph.edges
    assert wrong not in graph.edges
    again = object_from_state(state_of(graph), PoseGraph)
    assert again.poses == pytest.approx(graph.poses, abs=1e-9)


def test_without_a_loop_closure_nothing_is_solved() -> None:
    truth, edges = laps()
    graph = grown(edges[:30], truth[:31])
    reckoned_poses = chained_poses(truth[:31], edges[:30])
    assert graph.poses == pytest.approx(reckoned_poses)


def one_piece_an_update(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("waychair.slam.graph.pose_graph._NODES_A_SLICE", 1)


def test_a_judgement_in_pieces_ends_as_one_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    truth, edges = laps()
    false = measured(truth, 3, 50, EdgeKind.LOOP, Pose2(4.0, -3.0, 1.0))
    at_once = grown([*edges, false], truth)
    one_piece_an_update(monkeypatch)
    graph, updates = grown(edges, truth), 0
    graph.add(truth[:0], [false])
    while graph.is_judging or not updates:
        graph.update()
        updates += 1
        assert false not in graph.edges
        assert rmse(graph.poses, truth) < 0.1
    assert updates > 2
    assert [item.edge for item in graph.rejected] == [item.edge for item in at_once.rejected] == [false]
    assert graph.poses == pytest.approx(at_once.poses, abs=0.02)


def judging(monkeypatch: pytest.MonkeyPatch) -> tuple[PoseGraph, FloatArray, list[Edge], Edge]:
    """A graph before the second lap's last ten nodes that has begun to judge a false loop; its truth, edges and that loop."""
    one_piece_an_update(monkeypatch)
    truth, edges = laps()
    graph = grown([edge for edge in edges if edge.j < 70], truth[:70])
    false = measured(truth, 3, 65, EdgeKind.LOOP, Pose2(4.0, -3.0, 1.0))
    graph.add(truth[:0], [false])
    graph.update()
    assert graph.is_judging
    return graph, truth, edges, false


def test_what_comes_during_a_judgement_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    graph, truth, edges, false = judging(monkeypatch)
    for node in range(70, 80):
        new = [edge for edge in edges if edge.j == node]
        new.sort(key=lambda edge: edge.kind is EdgeKind.LOOP)
        graph.add(truth[node][None], new)
        graph.update()
    while graph.is_judging:
        graph.update()
    assert [item.edge for item in graph.rejected] == [false]
    assert {id(edge) for edge in graph.edges} == {id(edge) for edge in edges}
    assert rmse(graph.poses, truth) < 0.1


def test_a_stored_graph_goes_on_with_its_judgement(monkeypatch: pytest.MonkeyPatch) -> None:
    graph, *_ = judging(monkeypatch)
    again = object_from_state(state_of(graph), PoseGraph)
    updates = [0, 0]
    for k, each in enumerate((graph, again)):
        while each.is_judging:
            each.update()
            updates[k] += 1
    assert updates[0] == updates[1] > 1
    assert (again.poses == graph.poses).all()
    assert [str(item) for item in again.rejected] == [str(item) for item in graph.rejected]


def test_a_removed_edge_ends_a_judgement_that_knew_it(monkeypatch: pytest.MonkeyPatch) -> None:
    graph, truth, _, false = judging(monkeypatch)
    graph.remove([false])
    graph.update()
    assert not graph.is_judging
    assert [(item.edge, item.reason) for item in graph.rejected] == [(false, RejectionReason.REMOVED)]
    assert rmse(graph.poses, truth[:70]) < 0.1


def test_loops_in_doubt_that_come_during_a_judgement_are_taken_with_its_solution(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A chair slips at node 20: from the loop between 24 and 64 on, all are in doubt until the slip is known."""
    one_piece_an_update(monkeypatch)
    truth, edges = laps()
    slip = measured(truth, 20, 21, EdgeKind.MATCH, Pose2(0.3, 0.2, 0.1))
    every = [*edges[:20], slip, *edges[21:]]
    graph = grown(every, chained_poses(truth, every))
    assert graph.is_judging
    assert {(28, 68), (24, 64)} <= {(item.edge.i, item.edge.j) for item in graph.rejected}
    while graph.is_judging:
        graph.update()
    assert {(28, 68), (32, 72), (36, 76)} <= {(edge.i, edge.j) for edge in graph.edges}
    assert rmse(graph.poses, truth) < 0.1
