"""STM and rehearsal, the graph in RAM, loops, and invariants under arbitrary histories."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from tests.slam.corridor import SURE, chain, corridor, loop, set_limits, stand, view
from waychair.slam.memory.memory_changes import MemoryChange
from waychair.slam.memory.memory_manager import NodeMemory
from waychair.slam.memory.memory_settings import MemorySettings
from waychair.slam.memory.nodes import IN_TIME, Link, LinkKind, NodeStatus, carried
from waychair.slam.memory.rehearsal import RehearsalResult, similarity
from waychair.slam.memory.retrieval import MAX_LOCAL_RETRIEVED, MAX_RETRIEVED
from waychair.types import Pose2

ALIKE = [1, 2, 3, 4, 5]


def test_the_stm_holds_ten_nodes_and_the_oldest_move_to_the_wm() -> None:
    memory = corridor(13, MemorySettings())
    assert memory.stm == tuple(range(4, 14))
    assert memory.wm == {1, 2, 3}


def test_a_node_that_enters_the_wm_is_reported() -> None:
    memory = corridor(10, MemorySettings())
    assert memory.add(view(11), SURE).change.entered_wm == (1,)


def test_intermediate_nodes_do_not_count_for_the_size_of_the_stm() -> None:
    memory = corridor(10, MemorySettings())
    memory.add(view(11), SURE, intermediate=True)
    assert memory.stm == tuple(range(1, 12))
    assert memory.weight(11) == -1
    memory.add(view(12), SURE)
    assert memory.stm == tuple(range(2, 13))


def test_consecutive_nodes_are_linked_by_their_odometry() -> None:
    memory = corridor(2, MemorySettings())
    link = memory.skeleton.linked(1, 2)
    assert link is not None
    assert link.kind is LinkKind.NEIGHBOUR
    assert link.i_from_j == Pose2(1.0)


def test_a_motion_measured_by_scans_replaces_the_odometry() -> None:
    memory = corridor(1, MemorySettings())
    memory.add(view(2), SURE, motion=Pose2(1.1, 0.1))
    link = memory.skeleton.linked(1, 2)
    assert link is not None
    assert link.i_from_j == Pose2(1.1, 0.1)


def test_a_new_map_has_no_link_to_the_last_one() -> None:
    memory = corridor(2, MemorySettings())
    assert memory.start_map() == 1
    memory.add(view(3), SURE)
    assert memory.node(3).map_id == 1
    assert memory.skeleton.neighbours(3) == []


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        (ALIKE, ALIKE, 1.0),
        ([1, 1, 2], [1, 2, 2], 2 / 3),
        ([1, 2, 3, 4], [1, 2], 0.5),
        ([1, -1, 0], [1], 1.0),
        ([1, 2], [3, 4], 0.0),
        ([], ALIKE, 0.0),
        ([0, -3], [0, -3], 0.0),
    ],
)
def test_similarity_counts_shared_occurrences_of_the_larger_view(a: list[int], b: list[int], expected: float) -> None:
    assert similarity(np.array(a, np.int32), np.array(b, np.int32)) == pytest.approx(expected)
    assert similarity(np.array(b, np.int32), np.array(a, np.int32)) == pytest.approx(expected)


@given(st.lists(st.integers(-2, 6), max_size=12), st.lists(st.integers(-2, 6), max_size=12))
def test_the_similarity_equals_that_of_counting_word_by_word(a: list[int], b: list[int]) -> None:
    valid = [[word for word in words if word > 0] for words in (a, b)]
    shared = sum(min(valid[0].count(word), valid[1].count(word)) for word in set(valid[0]))
    expected = shared / max(map(len, valid)) if all(valid) else 0.0
    assert similarity(np.array(a, np.int32), np.array(b, np.int32)) == pytest.approx(expected)


def test_standing_still_gives_one_node_with_more_weight() -> None:
    memory = NodeMemory()
    for second in range(5):
        added = memory.add(view(1, ALIKE, x=0.05, second=second), SURE)
    assert added.id == 1
    assert added.verdict is RehearsalResult.MERGE
    assert memory.stm == (1,)
    assert memory.weight(1) == 4
    assert memory.counts().merged == 4
    assert memory.skeleton.kept(3) is NodeStatus.GONE


def test_the_path_continues_from_the_node_that_replaces_the_merged_one() -> None:
    memory = NodeMemory()
    memory.add(view(1, ALIKE, x=0.0), SURE)
    memory.add(view(1, ALIKE, x=0.05), SURE)
    memory.add(view(2, x=1.0), SURE)
    link = memory.skeleton.linked(1, 3)
    assert link is not None
    assert link.i_from_j == Pose2(1.0)


def test_while_the_chair_moves_only_the_weight_is_transferred() -> None:
    memory = NodeMemory()
    memory.add(view(1, ALIKE), SURE)
    assert memory.add(view(2, ALIKE), SURE).verdict is RehearsalResult.ADD_WEIGHT
    assert (memory.weight(1), memory.weight(2)) == (1, 0)
    assert memory.stm == (1, 2)


@pytest.mark.parametrize("motion", [Pose2(0.11), Pose2(0.0, -0.11), Pose2(0.0, 0.0, 0.11)])
def test_motion_on_any_single_axis_counts_as_moving(motion: Pose2) -> None:
    memory = NodeMemory()
    memory.add(view(1, ALIKE), SURE)
    assert memory.add(view(2, ALIKE), SURE, motion=motion).verdict is RehearsalResult.ADD_WEIGHT


def test_small_motions_on_all_axes_count_as_standing() -> None:
    memory = NodeMemory()
    memory.add(view(1, ALIKE), SURE)
    assert memory.add(view(2, ALIKE), SURE, motion=Pose2(0.1, -0.1, 0.1)).verdict is RehearsalResult.MERGE


def test_a_view_at_standstill_after_intermediate_nodes_becomes_one_of_them() -> None:
    memory = NodeMemory()
    memory.add(view(1, ALIKE, x=0.0), SURE)
    memory.add(view(2, [], x=0.02), SURE, intermediate=True)
    assert memory.add(view(3, ALIKE, x=0.04), SURE).verdict is RehearsalResult.INTERMEDIATE
    assert [memory.weight(node) for node in (1, 2, 3)] == [1, -1, -1]
    assert memory.stm == (1, 2, 3)


@pytest.mark.parametrize(("shared", "verdict"), [(6, RehearsalResult.ADD_WEIGHT), (5, RehearsalResult.DIFFERENT)])
def test_views_are_alike_from_sixty_percent_on(shared: int, verdict: RehearsalResult) -> None:
    memory = NodeMemory()
    memory.add(view(1, list(range(1, 11))), SURE)
    assert memory.add(view(2, [*range(1, shared + 1), *range(20, 30 - shared)]), SURE).verdict is verdict


def test_only_the_latest_picture_is_compared() -> None:
    memory = NodeMemory()
    memory.add(view(1, ALIKE), SURE)
    memory.add(view(2), SURE)
    assert memory.add(view(3, ALIKE), SURE).verdict is RehearsalResult.DIFFERENT


def test_a_view_without_words_is_never_merged_by_rehearsal() -> None:
    memory = NodeMemory()
    memory.add(view(1, [0, -1]), SURE)
    assert memory.node(1).is_bad
    assert memory.add(view(2, [0, -1], x=1.0), SURE).verdict is RehearsalResult.DIFFERENT


def test_a_loop_adds_no_weight() -> None:
    memory = corridor(15, MemorySettings())
    memory.link(loop(2, 15))
    assert memory.weight(2) == memory.weight(15) == 0


def test_a_chair_that_has_not_moved_removes_its_node_and_adds_the_weight_to_the_loop() -> None:
    memory = corridor(13, MemorySettings())
    assert memory.add(view(13, second=14.0), SURE).id == 13
    memory.link(loop(1, 13))
    assert [node.id for node in memory.drop(13).slept] == [13]
    assert memory.weight(1) == 1
    assert memory.skeleton.kept(13) is NodeStatus.GONE
    with pytest.raises(ValueError, match="not the newest"):
        memory.drop(5)


def test_a_loop_to_a_removed_node_is_refused() -> None:
    memory = corridor(3, MemorySettings())
    memory.drop(3)
    with pytest.raises(ValueError, match="node 3 does not exist"):
        memory.link(loop(1, 3))


def test_a_loop_refused_by_the_graph_is_removed_and_neighbour_links_stay() -> None:
    memory = corridor(5, MemorySettings())
    memory.link(loop(1, 5))
    memory.unlink(5, 1)
    assert memory.counts().closures == 0
    with pytest.raises(ValueError, match="no loop"):
        memory.unlink(1, 2)


def test_graph_reduction_replaces_the_links_of_a_node_that_closed_a_loop() -> None:
    memory = corridor(11, MemorySettings(reduce_graph=True))
    memory.link(loop(1, 5))
    before = memory.skeleton.linked(5, 6)
    assert before is not None
    for k in range(12, 16):
        change = memory.add(view(k), SURE).change
    assert [node.id for node in change.slept] == [5]
    assert memory.skeleton.kept(5) is NodeStatus.GONE
    around = memory.skeleton.linked(1, 6)
    assert around is not None
    assert around.kind is LinkKind.MERGED
    assert around.i_from_j.array() == pytest.approx((loop(1, 5).i_from_j @ before.i_from_j).array())
    assert set(memory.skeleton.neighbours(1, IN_TIME)) == {2, 4, 6}
    assert memory.counts().reduced == 1


def test_a_link_seen_from_its_other_end_is_its_inverse() -> None:
    link = Link(1, 2, LinkKind.GLOBAL, Pose2(1.0, 2.0, 0.5), np.diag([4.0, 9.0, 100.0]))
    back = link.reversed()
    assert (back.i, back.j) == (2, 1)
    assert (link.i_from_j @ back.i_from_j).array() == pytest.approx(np.zeros(3), abs=1e-12)
    again = back.reversed()
    assert again.information == pytest.approx(link.information)


def test_propagated_information_equals_that_of_the_motions() -> None:
    """A small motion of b moves a, rigidly joined, by an amount that is equally unlikely under the information of
    both."""
    information, a_from_b = np.array([[4.0, 1.0, 0.5], [1.0, 9.0, 2.0], [0.5, 2.0, 50.0]]), Pose2(2.0, -1.0, 0.7)
    in_a = carried(information, a_from_b)
    for motion in 1e-5 * np.random.default_rng(1).standard_normal((20, 3)):
        of_a = (a_from_b @ Pose2(*motion.tolist()) @ a_from_b.inverse()).array()
        assert of_a @ in_a @ of_a == pytest.approx(motion @ information @ motion, rel=1e-3)


def test_consecutive_links_add_their_uncertainties() -> None:
    first = Link(1, 2, LinkKind.NEIGHBOUR, Pose2(), np.diag([4.0, 4.0, 10.0]))
    both = first.then(replace(first, i=2, j=3), LinkKind.MERGED)
    assert both.information == pytest.approx(np.diag([2.0, 2.0, 5.0]))


def test_sleeping_nodes_move_with_their_anchors() -> None:
    memory = NodeMemory()
    memory.add(view(1), SURE, anchor=0, anchor_from_node=Pose2(1.0, 0.0))
    memory.move_anchors(np.array([[0.0, 0.0, 0.0]]))
    assert memory.poses([1])[0] == pytest.approx([1.0, 0.0, 0.0])
    memory.move_anchors(np.array([[5.0, 5.0, math.pi / 2]]))
    assert memory.poses([1])[0] == pytest.approx([5.0, 6.0, math.pi / 2])
    assert np.isnan(NodeMemory().skeleton.poses([0], np.empty((0, 3)))).all()


def test_ten_hours_of_nodes_take_less_than_200_bytes_each() -> None:
    skeleton = chain(36_000)
    rows, links = skeleton.rows, skeleton._links
    used = rows.itemsize + links.itemsize + 4 + 2 * 8 + 1  # with first, ends and after, kinds
    assert used <= 200
    assert rows.nbytes + links.nbytes <= 2 * 36_000 * 200
    assert len(skeleton.neighbours(35_999)) == 2


def test_stamps_that_go_back_do_not_increase_the_age_of_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    set_limits(monkeypatch, STM_SIZE=1)
    memory = corridor(11, MemorySettings())
    memory.add(view(12, second=3.0), SURE)
    memory.add(view(13, second=4.0), SURE)
    entered = memory.skeleton.rows["entered_ns"][1:12]
    assert (np.diff(entered) >= 0).all()


def test_counts_distinguish_states_from_events(monkeypatch: pytest.MonkeyPatch) -> None:
    set_limits(monkeypatch, STM_SIZE=5, MAX_LOCAL_RETRIEVED=0)
    memory = corridor(40, MemorySettings(working_memory_limit=5))
    for k in range(41, 60):
        stand(memory, k)
        memory.add(view(k), SURE)
        memory.retrieve(None if k < 55 else min(memory.wm), Pose2(float(k)))
        memory.transfer()
    counts = memory.counts(words=123)
    assert counts.stm + counts.wm + counts.ltm == counts.frames == 59
    assert counts.entered_wm == 59 - counts.stm + counts.retrieved
    assert counts.ltm == counts.transferred - counts.retrieved
    assert counts.retrieved > 0
    assert counts.words == 123


class AnyHistory(RuleBasedStateMachine):
    """Adds, loops, refusals, sleeping and waking in any order."""

    limits: ClassVar[dict[str, float]] = {"STM_SIZE": 3, "CACHED_NODES": 1}
    reduces = True

    def __init__(self) -> None:
        super().__init__()
        self.patch = pytest.MonkeyPatch()
        set_limits(self.patch, **self.limits)
        self.memory = NodeMemory(MemorySettings(working_memory_limit=6, reduce_graph=self.reduces))
        self.in_ram: set[int] = set()
        self.in_wm: set[int] = set()
        self.x = 0.0

    def teardown(self) -> None:
        self.patch.undo()

    def follow(self, change: MemoryChange) -> None:
        """Keep the nodes that a vocabulary and a filter would know."""
        self.in_ram |= {node.id for node in change.woken}
        self.in_ram -= {node.id for node in change.slept}
        self.in_wm |= set(change.entered_wm)
        self.in_wm -= set(change.left_wm)

    @rule(
        look=st.integers(1, 4),
        step=st.sampled_from([0.0, 0.5, 30.0]),
        intermediate=st.sampled_from([False] * 4 + [True]),
    )
    def drive(self, look: int, step: float, intermediate: bool) -> None:
        self.x += step
        newest = self.memory.skeleton.count
        words = [] if intermediate else list(range(look, look + 4))
        stand(self.memory, newest + 1)
        added = self.memory.add(view(newest, words, x=self.x), SURE, intermediate=intermediate)
        self.in_ram.add(added.id)
        self.follow(added.change)

    @rule(look=st.integers(5, 9))
    def jump(self, look: int) -> None:
        self.memory.start_map()
        self.drive(look, 0.5, False)

    @precondition(lambda self: len(self.memory.stm) + len(self.memory.wm) > 2)
    @rule(data=st.data(), kind=st.sampled_from([LinkKind.GLOBAL, LinkKind.SPACE]))
    def close(self, data: st.DataObject, kind: LinkKind) -> None:
        ids = self.memory.skeleton.ids()
        i, j = sorted(data.draw(st.lists(st.sampled_from(ids), min_size=2, max_size=2, unique=True)))
        if self.memory.skeleton.linked(i, j) is None:
            self.memory.link(loop(i, j, kind))

    @precondition(lambda self: len(self.memory.stm) > 1)
    @rule()
    def take_back(self) -> None:
        self.follow(self.memory.drop(self.memory.stm[-1]))

    @precondition(lambda self: self.memory.stm)
    @rule(data=st.data())
    def recall(self, data: st.DataObject) -> None:
        places = [None, *sorted(self.memory.wm)]
        here = Pose2(data.draw(st.floats(0.0, 30.0)))
        path = data.draw(st.lists(st.sampled_from(self.memory.skeleton.ids()), max_size=3))
        change = self.memory.retrieve(data.draw(st.sampled_from(places)), here, path)
        assert len(change.woken) <= MAX_RETRIEVED + MAX_LOCAL_RETRIEVED
        self.follow(change)

    @rule()
    def forget(self) -> None:
        before = len(self.memory.wm)
        self.follow(self.memory.transfer())
        assert len(self.memory.wm) <= before

    @invariant()
    def every_node_is_in_one_place(self) -> None:
        skeleton, stm, wm = self.memory.skeleton, set(self.memory.stm), self.memory.wm
        assert not stm & wm
        for node in range(1, skeleton.count):
            where = skeleton.kept(node)
            assert (node in stm) == (where is NodeStatus.STM)
            assert (node in wm) == (where is NodeStatus.WM)
            assert (where is NodeStatus.GONE) == (skeleton.rows["kept"][node] == 0)
            if where is not NodeStatus.GONE:
                assert self.memory.node(node).id == node

    @invariant()
    def those_who_follow_know_what_is_awake(self) -> None:
        assert self.in_ram == set(self.memory.stm) | self.memory.wm
        assert self.in_wm == self.memory.wm

    @invariant()
    def every_link_is_symmetric(self) -> None:
        skeleton = self.memory.skeleton
        for link in skeleton.every_link():
            assert NodeStatus.GONE not in (skeleton.kept(link.i), skeleton.kept(link.j))
            back = skeleton.linked(link.j, link.i)
            assert back is not None
            assert (link.i_from_j @ back.i_from_j).array() == pytest.approx(np.zeros(3), abs=1e-9)
            assert link.j in skeleton.neighbours(link.i)
            assert link.i in skeleton.neighbours(link.j)

    @invariant()
    def sizes_respect_their_limits(self) -> None:
        pictures = [node for node in self.memory.stm if self.memory.weight(node) >= 0]
        assert len(pictures) <= self.limits["STM_SIZE"]
        counts = self.memory.counts()
        assert counts.ltm == counts.transferred - counts.retrieved
        assert counts.stm + counts.wm + counts.ltm == len(self.memory.skeleton.ids())


class AnyHistoryFromDisk(AnyHistory):
    """The same test without cached nodes and without reduction, with a short reach round the chair."""

    limits: ClassVar[dict[str, float]] = {"STM_SIZE": 3, "CACHED_NODES": 0, "LOCAL_RADIUS": 3.0}
    reduces = False


AnyHistory.TestCase.settings = settings(max_examples=20, stateful_step_count=40)
AnyHistoryFromDisk.TestCase.settings = AnyHistory.TestCase.settings
TestAnyHistory = AnyHistory.TestCase
TestAnyHistoryFromDisk = AnyHistoryFromDisk.TestCase
