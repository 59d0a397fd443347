"""Transfer to long-term memory: each rule of RTAB-Map, against a plain restatement."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.slam.corridor import SECOND, SURE, chain, corridor, loop, set_limits, stand, view
from waychair.slam.memory import transfer
from waychair.slam.memory.memory_manager import NodeMemory
from waychair.slam.memory.memory_settings import MemorySettings
from waychair.slam.memory.nodes import NodeStatus
from waychair.slam.memory.skeleton import Skeleton
from waychair.slam.memory.transfer import NodesInRam, is_due, removable, with_intermediate
from waychair.types import Pose2


@pytest.fixture(autouse=True, scope="module")
def _small_stm() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        set_limits(patch, STM_SIZE=5)
        yield


def split(length: int, stm: int = 3) -> tuple[Skeleton, list[int], set[int]]:
    """A corridor with the last nodes in the STM, and the rest in the WM, each a second older than the next."""
    skeleton = chain(length)
    wm = set(range(1, length - stm + 1))
    for node in wm:
        skeleton.rows["kept"][node] = NodeStatus.WM
        skeleton.rows["entered_ns"][node] = node * SECOND
    return skeleton, list(range(length - stm + 1, length + 1)), wm


@pytest.mark.parametrize(
    ("time_thr", "memory_thr", "spent_ms", "nodes", "due"),
    [
        (0.0, 0, 1e6, 10**6, False),  # no limits, no transfer
        (1000.0, 0, 1000.0, 10**6, False),
        (1000.0, 0, 1000.1, 1, True),
        (0.0, 300, 1e6, 300, False),
        (0.0, 300, 0.0, 301, True),
        (1000.0, 300, 1500.0, 5, True),
        (1000.0, 300, 5.0, 301, True),
    ],
)
def test_transfer_is_due_beyond_either_limit(
    time_thr: float, memory_thr: int, spent_ms: float, nodes: int, due: bool
) -> None:
    assert is_due(spent_ms, nodes, MemorySettings(frame_time_limit=time_thr, working_memory_limit=memory_thr)) is due


def test_the_lowest_weight_goes_first() -> None:
    skeleton, stm, wm = split(10)
    skeleton.rows["weight"][1:7] = [3, 1, 2, 0, 1, 5]
    assert removable(skeleton, NodesInRam(stm, wm), 3) == [4, 2, 5]


def test_among_equal_weights_the_oldest_goes_first() -> None:
    skeleton, stm, wm = split(8)
    skeleton.rows["entered_ns"][1:5] = np.array([9, 3, 7, 1]) * SECOND
    assert removable(skeleton, NodesInRam(stm, wm), 4) == [4, 2, 3, 1]


def test_ages_count_in_whole_seconds_and_then_the_lowest_id_goes_first() -> None:
    skeleton, stm, wm = split(8)
    skeleton.rows["entered_ns"][1:5] = np.array([5.9, 5.1, 4.999, 4.0]) * SECOND
    assert removable(skeleton, NodesInRam(stm, wm), 4) == [3, 4, 1, 2]


def test_intermediate_nodes_are_no_candidates_and_are_transferred_with_their_neighbour() -> None:
    skeleton, stm, wm = split(9)
    skeleton.rows["weight"][[2, 3, 5]] = -1
    picked = removable(skeleton, NodesInRam(stm, wm), 1)
    assert picked == [1]
    assert with_intermediate(skeleton, picked, wm) == [1, 2, 3]


def test_neighbours_of_the_stm_stay() -> None:
    skeleton, stm, wm = split(10)
    assert removable(skeleton, NodesInRam(stm, wm), 99) == [1, 2, 3, 4, 5, 6]  # 7 is linked to 8
    skeleton.link(loop(2, 10))
    assert removable(skeleton, NodesInRam(stm, wm), 99) == [1, 3, 4, 5, 6]


def test_immunised_nodes_stay() -> None:
    skeleton, stm, wm = split(10)
    assert removable(skeleton, NodesInRam(stm, wm, immunised={1, 4}), 99) == [2, 3, 5, 6]


def test_the_latest_closure_always_stays() -> None:
    skeleton, stm, wm = split(10)
    assert 3 not in removable(skeleton, NodesInRam(stm, wm, last_closure=3), 99)


def test_a_few_nodes_newer_than_the_latest_closure_stay() -> None:
    skeleton, stm, wm = split(23)  # 20 in the WM: 4 are a fifth
    skeleton.rows["weight"][1:17] = 1  # the recent ones would be transferred first
    assert removable(skeleton, NodesInRam(stm, wm, last_closure=17), 2) == [1, 2]


def test_nodes_newer_than_the_latest_closure_are_transferred_until_few_are_left() -> None:
    skeleton, stm, wm = split(23)
    skeleton.rows["weight"][1:14] = 1
    # 15 to 20 are six; two more than a fifth, so that those two and one more may go before fewer than four are left
    assert removable(skeleton, NodesInRam(stm, wm, last_closure=14), 5) == [15, 16, 17, 1, 2]


def test_without_a_closure_nothing_is_recent() -> None:
    skeleton, stm, wm = split(23)
    skeleton.rows["weight"][1:17] = 1
    assert removable(skeleton, NodesInRam(stm, wm), 2) == [17, 18]


@given(st.data())
def test_the_choice_equals_a_plain_loop_over_the_sorted_nodes(data: st.DataObject) -> None:
    skeleton, stm, wm = split(data.draw(st.integers(5, 30)))
    count = len(wm)
    for node in wm:
        skeleton.rows["weight"][node] = data.draw(st.integers(-1, 3))
        skeleton.rows["entered_ns"][node] = data.draw(st.integers(0, 3 * SECOND))
    last = data.draw(st.integers(0, count))
    immune = data.draw(st.sets(st.integers(1, count), max_size=4))
    most, ratio = data.draw(st.integers(1, 8)), data.draw(st.sampled_from([0.0, 0.2, 0.5, 1.0]))
    for far in data.draw(st.sets(st.integers(1, count), max_size=3)):
        skeleton.link(loop(far, stm[-1]))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(transfer, "RECENT_SHARE", ratio)
        found = removable(skeleton, NodesInRam(stm, wm, last, immune), most)

    def key(node: int) -> tuple[int, int, int]:
        row = skeleton.rows[node]
        return int(row["weight"]), int(row["entered_ns"]) // SECOND, node

    expected: list[int] = []
    recent = len([node for node in wm if node > last]) if last else 0
    for node in sorted(wm, key=key):
        held = any(there in stm for there in skeleton.neighbours(node)) or node in immune or node == last
        if held or skeleton.rows["weight"][node] < 0 or len(expected) == most:
            continue
        if last and node > last:
            if recent < ratio * len(wm):
                continue
            recent -= 1
        expected.append(node)
    assert found == expected


def test_the_wm_shrinks_by_one_more_than_was_added() -> None:
    memory = corridor(40, MemorySettings(working_memory_limit=5))
    before = len(memory.wm)
    assert memory.transfer().left_wm == (1, 2)  # one was added, and one more is transferred
    assert len(memory.wm) == before - 2
    stand(memory, 41)
    memory.add(view(41), SURE)
    woken = memory.retrieve(3, Pose2(-50.0)).woken
    assert [node.id for node in woken] == [2, 1]
    assert len(memory.transfer().left_wm) == 4


def test_nothing_is_transferred_when_the_newest_node_is_an_intermediate_one() -> None:
    memory = corridor(40, MemorySettings(working_memory_limit=5))
    memory.add(view(41), SURE, intermediate=True)
    assert memory.transfer().left_wm == ()


def test_intermediate_nodes_of_the_wm_do_not_count_for_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    set_limits(monkeypatch, STM_SIZE=2)
    memory = NodeMemory(MemorySettings(working_memory_limit=5))
    for k in range(1, 21):
        memory.add(view(k), SURE, intermediate=k % 2 == 0)
    memory.add(view(21), SURE)
    pictures = [node for node in memory.wm if memory.weight(node) >= 0]
    assert len(memory.wm) > len(pictures) > 5
    change = memory.transfer()
    assert [node for node in change.left_wm if memory.weight(node) >= 0] == [1, 3]
    assert 2 in change.left_wm


def test_the_time_of_a_frame_is_limited_too() -> None:
    memory = corridor(40, MemorySettings(frame_time_limit=1000.0))
    assert memory.transfer(spent_ms=1000.0).left_wm == ()
    assert memory.transfer(spent_ms=1000.1).left_wm == (1, 2)


def test_places_near_the_chair_become_young_again(monkeypatch: pytest.MonkeyPatch) -> None:
    set_limits(monkeypatch, LOCAL_RADIUS=2.5, LOCAL_IMMUNIZATION_RATIO=0.0)
    memory = corridor(30, MemorySettings(working_memory_limit=5))
    stand(memory, 31)
    memory.add(view(31, second=100.0), SURE)
    memory.retrieve(None, Pose2(10.2))
    ages = memory.skeleton.rows["entered_ns"]
    nearest_first = sorted(range(8, 13), key=lambda node: abs(node - 10.2))
    assert all(ages[a] > ages[b] for a, b in pairwise(nearest_first))
    assert ages[8:13].min() > np.delete(ages[1:26], range(7, 12)).max()


def test_nodes_in_long_term_memory_are_reported_with_their_words() -> None:
    memory = corridor(40, MemorySettings(working_memory_limit=5))
    slept = memory.transfer().slept
    assert [node.words.tolist() for node in slept] == [view(1).words.tolist(), view(2).words.tolist()]
    assert memory.skeleton.kept(1) is NodeStatus.LTM
