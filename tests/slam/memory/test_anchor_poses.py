"""The cost of anchor poses: only new anchors while the chair drives, all of them once after a loop."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.slam.corridor import SURE, view
from waychair.slam.graph.edges import Edge, EdgeKind
from waychair.slam.graph.pose_graph import PoseGraph
from waychair.slam.memory.anchor_poses import AnchorPoses
from waychair.slam.memory.long_term_memory import LongTermStore
from waychair.slam.memory.memory_journal import Journal
from waychair.slam.memory.memory_manager import NodeMemory
from waychair.slam.memory.skeleton import Skeleton
from waychair.types import FloatArray, IntArray, Pose2


def near_by_looking(poses: FloatArray, at: Pose2, radius: float) -> IntArray:
    away = np.hypot(*(poses[:, :2] - (at.x, at.y)).T)
    rows = np.flatnonzero(away <= radius)
    found: IntArray = rows[np.lexsort((rows, away[rows]))]
    return found


@given(st.lists(st.integers(1, 400), min_size=1, max_size=6), st.integers(0, 10**6), st.floats(0.0, 30.0))
def test_near_anchors_equal_those_of_a_full_search(grows: list[int], seed: int, radius: float) -> None:
    rng, poses, anchors = np.random.default_rng(seed), np.empty((0, 3)), AnchorPoses()
    for more in grows:
        poses = np.concatenate([poses, rng.uniform(-40.0, 40.0, (more, 3))])
        if rng.random() < 0.3:
            poses = poses + rng.normal(0.0, 1.0, poses.shape)
        anchors.update(poses)
        at = Pose2(*rng.uniform(-40.0, 40.0, 3).tolist())
        np.testing.assert_array_equal(anchors.near(at, radius), near_by_looking(poses, at, radius))


def test_anchors_without_a_pose_are_never_near() -> None:
    poses = np.zeros((5, 3))
    poses[[1, 3]] = np.nan
    assert AnchorPoses(poses).near(Pose2(), 1.0).tolist() == [0, 2, 4]
    assert AnchorPoses(np.full((2, 3), np.nan)).near(Pose2(), 1.0).tolist() == []
    assert AnchorPoses().near(Pose2(), 1.0).tolist() == []


def test_only_new_rows_are_reported_while_the_array_grows() -> None:
    room = np.zeros((1000, 3))
    room[:, 0] = np.arange(1000)
    anchors = AnchorPoses()
    assert anchors.update(room[:10]).tolist() == list(range(10))
    assert anchors.update(room[:10]).tolist() == []
    assert anchors.update(room[:13]).tolist() == [10, 11, 12]
    bent = room[:14].copy()
    bent[4] += 0.5
    bent[5] += 1e-9
    assert anchors.update(bent).tolist() == [4, 13]


def test_a_graph_that_only_grows_keeps_its_poses_in_place() -> None:
    graph, apart = PoseGraph(), 0
    graph.add(np.zeros((1, 3)), [])
    for k in range(1000):
        before = graph.poses
        edge = Edge(k, k + 1, Pose2(1.0), np.eye(3), EdgeKind.MATCH)
        graph.add(np.array([[k + 1.0, 0.0, 0.0]]), [edge])
        graph.update()
        apart += not np.may_share_memory(before, graph.poses)
    assert apart <= 6, "room is doubled, not made for each node"
    np.testing.assert_array_equal(graph.poses[:, 0], np.arange(1001.0))


def test_a_loop_that_moves_all_anchors_is_written_in_steps_and_the_newest_first() -> None:
    journal, poses = Journal(), np.zeros((1000, 3))
    journal.moved(np.arange(1000))
    written: list[int] = []
    for _ in range(4):
        batch = journal.batch((), None, Skeleton(), (), poses)
        assert batch.anchors is not None
        assert len(batch.anchors[0]) <= 256
        assert not written or batch.anchors[0].max() < min(written)
        written += batch.anchors[0].tolist()
        journal = journal.following()
    assert sorted(written) == list(range(1000))
    assert not journal.has_moved


@pytest.mark.parametrize("count", [3, 700])
def test_all_anchors_are_on_the_disk_when_the_memory_is_closed(count: int, tmp_path: Path) -> None:
    memory = NodeMemory(store=LongTermStore(tmp_path / "memory.db"))
    poses = np.random.default_rng(1).uniform(-9.0, 9.0, (count, 3))
    memory.move_anchors(np.zeros((count, 3)))
    memory.add(view(1), SURE, 0)
    memory.move_anchors(poses)
    memory.close()
    again = NodeMemory(store=LongTermStore(tmp_path / "memory.db"))
    np.testing.assert_array_equal(again.anchors, poses)
    again.close()
