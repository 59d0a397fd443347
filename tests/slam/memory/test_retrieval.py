"""Nodes that are woken and nodes that must stay awake: RTAB-Map's rules, and places with all nodes asleep."""

from __future__ import annotations

import numpy as np
import pytest

from tests.slam.corridor import SURE, chain, corridor, loop, set_limits, stand, view
from waychair.maps.layers.grid_assembly import GridAssembly
from waychair.slam.memory.anchor_poses import AnchorPoses
from waychair.slam.memory.memory_manager import NodeMemory
from waychair.slam.memory.memory_settings import MemorySettings
from waychair.slam.memory.nodes import LinkKind, NodeStatus
from waychair.slam.memory.retrieval import NearbyNodes, immunised_nodes, nearby_nodes, nodes_to_wake
from waychair.slam.memory.skeleton import Skeleton
from waychair.types import OccupancyGrid, Pose2

ALONE = NearbyNodes(here=30)


def half_asleep(length: int = 30, asleep: range = range(1, 11), stm: int = 3) -> Skeleton:
    """A corridor with the first nodes asleep, the last in the STM, and the others in the WM."""
    skeleton = chain(length)
    skeleton.rows["kept"][1 : length - stm + 1] = NodeStatus.WM
    skeleton.rows["kept"][list(asleep)] = NodeStatus.LTM
    return skeleton


def test_neighbours_of_the_hypothesis_are_woken_nearest_first() -> None:
    assert nodes_to_wake(half_asleep(), 12, ALONE) == [10, 9]


def test_within_a_level_the_newest_is_woken_first(monkeypatch: pytest.MonkeyPatch) -> None:
    set_limits(monkeypatch, MAX_RETRIEVED=4)
    skeleton = half_asleep(asleep=range(1, 30))
    skeleton.rows["kept"][15] = NodeStatus.WM
    assert nodes_to_wake(skeleton, 15, ALONE) == [16, 14, 17, 13]


def test_neighbours_in_time_are_woken_before_those_over_loops(monkeypatch: pytest.MonkeyPatch) -> None:
    set_limits(monkeypatch, MAX_RETRIEVED=3)
    skeleton = half_asleep(asleep=range(1, 11))
    skeleton.link(loop(3, 15))
    assert nodes_to_wake(skeleton, 15, ALONE) == [10, 9, 8]
    set_limits(monkeypatch, PREDICTION_LEVELS=6)
    assert nodes_to_wake(skeleton, 15, ALONE) == [10, 9, 3]


def test_the_hypothesis_reaches_seventeen_links() -> None:
    skeleton = half_asleep(length=60, asleep=range(1, 13))
    assert nodes_to_wake(skeleton, 29, ALONE) == [12]
    assert nodes_to_wake(skeleton, 30, ALONE) == []


def test_no_more_than_two_are_woken_for_the_hypothesis_and_two_for_the_place() -> None:
    around = NearbyNodes(here=30, near=(11,), path=(5, 4, 3))
    assert nodes_to_wake(half_asleep(), 12, around) == [5, 4, 10, 9]


def test_nodes_round_the_chair_are_woken_before_nodes_round_the_hypothesis() -> None:
    assert nodes_to_wake(half_asleep(), 20, NearbyNodes(here=30, near=(11,))) == [10, 9, 8, 7]


def test_the_planned_path_is_woken_first_then_neighbours_of_near_nodes_and_then_theirs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    set_limits(monkeypatch, MAX_LOCAL_RETRIEVED=4, MAX_RETRIEVED=0)
    around = NearbyNodes(here=30, near=(15, 11), path=(20, 3))
    assert nodes_to_wake(half_asleep(), None, around) == [3, 10, 4, 2]


def test_awake_nodes_are_not_woken_again() -> None:
    assert nodes_to_wake(half_asleep(asleep=range(0)), 12, NearbyNodes(30, (11,), (5,))) == []


def test_near_nodes_are_within_the_radius_and_ordered_by_distance(monkeypatch: pytest.MonkeyPatch) -> None:
    set_limits(monkeypatch, LOCAL_RADIUS=2.0)
    anchors = np.zeros((31, 3))
    anchors[:, 0] = np.arange(31)
    found = nearby_nodes(half_asleep(), AnchorPoses(anchors), Pose2(14.2), 30, range(11, 28), ())
    assert list(found.near) == [14, 15, 13, 16]


def test_a_place_with_all_nodes_asleep_is_woken_by_its_position(monkeypatch: pytest.MonkeyPatch) -> None:
    set_limits(monkeypatch, LOCAL_RADIUS=3.0)
    skeleton, anchors = half_asleep(), np.zeros((31, 3))
    anchors[:, 0] = np.arange(31)
    around = nearby_nodes(skeleton, AnchorPoses(anchors), Pose2(5.2), 30, range(11, 28), ())
    assert list(around.sleepers) == [5, 6]
    assert nodes_to_wake(skeleton, None, around) == [5, 6]


def test_on_a_second_lap_the_nodes_of_the_first_are_awake(monkeypatch: pytest.MonkeyPatch) -> None:
    """A lap of 150 nodes, 30 of which may be awake: RTAB-Map's own rules wake none of the first lap."""
    set_limits(monkeypatch, STM_SIZE=5)
    memory = corridor(0, MemorySettings(working_memory_limit=30))
    places = [float(k) for k in range(1, 151)] + [k - 150.2 for k in range(151, 251)]
    anchors, found = np.zeros((251, 3)), []
    anchors[1:, 0] = places
    for k, x in enumerate(places, start=1):
        memory.move_anchors(anchors[: k + 1])
        memory.add(view(k, x=x), SURE)
        memory.retrieve(None, Pose2(x))
        if k > 155:
            found.append(any(node <= 150 and abs(node - x) < 1.0 for node in memory.wm))
        memory.transfer()
    assert len(memory.wm) <= 30
    assert all(found)


def test_the_heaviest_node_of_a_place_is_woken_unless_one_is_awake(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    set_limits(monkeypatch, LOCAL_RADIUS=3.0)
    skeleton, anchors = half_asleep(), np.zeros((31, 3))
    for node in (1, 2, 3):
        skeleton.attach(node, 0, Pose2())
    skeleton.rows["weight"][2] = 4
    anchors[1:, 0] = 1000.0
    assert list(nearby_nodes(skeleton, AnchorPoses(anchors), Pose2(), 30, range(11, 28), ()).sleepers) == [2]
    skeleton.attach(11, 0, Pose2())
    assert list(nearby_nodes(skeleton, AnchorPoses(anchors), Pose2(), 30, range(11, 28), ()).sleepers) == []


def test_neighbours_of_the_hypothesis_in_time_are_immunised_without_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    set_limits(monkeypatch, LOCAL_IMMUNIZATION_RATIO=0.0)
    skeleton = half_asleep(length=60, asleep=range(1, 11))
    awake = set(range(11, 61))
    assert immunised_nodes(skeleton, 30, ALONE, awake, 47) == set(range(13, 48))
    skeleton.link(loop(11, 30))
    assert 11 not in immunised_nodes(skeleton, 30, ALONE, awake, 47)


def test_the_nearest_nodes_are_immunised_until_a_quarter_of_the_wm_is() -> None:
    skeleton = half_asleep(asleep=range(0))
    skeleton.unlink(27, 28)  # no way to the newest node
    awake = set(range(1, 31))
    near = (12, 13, 11, 14, 10, 15, 9, 16, 8)
    assert immunised_nodes(skeleton, None, NearbyNodes(30, near), awake, 27) == set(near[:6])


def test_the_planned_path_near_the_chair_counts_towards_the_budget() -> None:
    skeleton = half_asleep(asleep=range(0))
    skeleton.unlink(27, 28)
    around = NearbyNodes(30, (12, 13, 11, 14), path=(14, 13, 20))
    kept = immunised_nodes(skeleton, None, around, set(range(1, 31)), 12)
    assert kept == {14, 13, 12}  # 20 is not near


def test_the_shortest_path_from_the_nearest_node_to_the_newest_is_immunised() -> None:
    skeleton = half_asleep(asleep=range(0))
    skeleton.link(loop(12, 26, LinkKind.SPACE))
    around = NearbyNodes(30, (10,))
    kept = immunised_nodes(skeleton, None, around, set(range(1, 31)), 0)
    assert kept == {10, 11, 12, 26, 27, 28, 29, 30}
    assert 26 not in immunised_nodes(skeleton, None, around, set(range(1, 31)) - {11}, 0)


def test_the_woken_and_the_last_loop_are_immunised(monkeypatch: pytest.MonkeyPatch) -> None:
    set_limits(monkeypatch, STM_SIZE=5, LOCAL_RADIUS=0.5, PREDICTION_LEVELS=1)
    memory = corridor(60, MemorySettings(working_memory_limit=5))
    memory.transfer()
    stand(memory, 61)
    memory.add(view(61), SURE)
    memory.link(loop(20, 61))
    woken = memory.retrieve(3, Pose2(-50.0))
    assert [node.id for node in woken.woken] == [2]
    assert woken.entered_wm == (2,)
    assert {2, 20} <= memory.immunised
    assert 2 not in memory.transfer().left_wm


def test_woken_nodes_are_unchanged_and_young(monkeypatch: pytest.MonkeyPatch) -> None:
    for cached in (0, 100):
        set_limits(monkeypatch, STM_SIZE=5, CACHED_NODES=cached)
        memory = corridor(60, MemorySettings(working_memory_limit=5))
        memory.transfer()
        stand(memory, 61)
        memory.add(view(61), SURE)
        node = memory.retrieve(3, Pose2(-50.0)).woken[0]
        assert np.array_equal(node.descriptors, view(node.id).descriptors)
        assert np.array_equal(node.words, view(node.id).words)
        assert memory.skeleton.rows["entered_ns"][node.id] == 60 * 10**9
        assert memory.skeleton.kept(node.id) is NodeStatus.WM


def test_renumbered_words_are_kept_through_sleep(monkeypatch: pytest.MonkeyPatch) -> None:
    set_limits(monkeypatch, STM_SIZE=5, CACHED_NODES=0)
    memory = corridor(60, MemorySettings(working_memory_limit=5))
    memory.rewrite(1, np.array([7, 8, 9, 0, 11], np.int32))
    memory.transfer()
    stand(memory, 61)
    memory.add(view(61), SURE)
    assert memory.node(1).words.tolist() == [7, 8, 9, 0, 11]


def test_without_a_limit_and_without_sleeping_nodes_nothing_is_searched() -> None:
    memory = corridor(20, MemorySettings())
    assert memory.retrieve(3, Pose2()).woken == ()
    assert memory.immunised == frozenset()


def test_a_chair_that_only_localises_keeps_the_places_round_it_awake(monkeypatch: pytest.MonkeyPatch) -> None:
    mapped = corridor(100, MemorySettings())
    set_limits(monkeypatch, LOCAL_RADIUS=4.0, CACHED_NODES=0)
    settings = MemorySettings(working_memory_limit=20)
    mapped.flush()
    again = NodeMemory(settings, mapped.store)
    assert (again.stm, len(again.wm)) == ((), 100)
    for x in np.arange(1.0, 100.0, 0.5):
        again.retrieve(round(x), Pose2(float(x)))
        again.transfer()
        assert round(x) in again.wm
    assert len(again.wm) <= 30


def grid_of(memory: NodeMemory, nodes: range, beams: int) -> OccupancyGrid:
    assembly = GridAssembly()
    for chunk in memory.evidence(nodes, beams):
        assert sum(len(found.scan.ranges) for _, found in chunk) <= max(beams, 40)
        for node, found in chunk:
            first, last = found.node_from_first.array(), found.node_from_last.array()
            assembly.add(node, found.scan, node, first, last)
    assembly.move_nodes(memory.anchors, np.zeros(2))
    assembly.settle()
    return assembly.grid()


@pytest.mark.parametrize("beams", [1, 100, 20_000])
def test_the_grid_stays_complete_while_nodes_sleep(beams: int, monkeypatch: pytest.MonkeyPatch) -> None:
    awake = corridor(60, MemorySettings())
    set_limits(monkeypatch, STM_SIZE=5, CACHED_NODES=0)
    memory = corridor(60, MemorySettings(working_memory_limit=5))
    for k in range(61, 90):
        for each in (awake, memory):
            stand(each, k)
            each.add(view(k), SURE)
            each.transfer()
    assert memory.counts().ltm > 50
    expected, found = grid_of(awake, range(1, 90), 20_000), grid_of(memory, range(1, 90), beams)
    assert found.map_from_grid == expected.map_from_grid
    assert np.array_equal(found.cells, expected.cells)


def test_removed_nodes_do_not_change_the_grid() -> None:
    memory = corridor(5, MemorySettings())
    memory.drop(5)
    assert [node for chunk in memory.evidence(range(1, 9)) for node, _ in chunk] == [1, 2, 3, 4]
