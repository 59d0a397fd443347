"""Loop closure by appearance: loops confirmed by pictures and scans together, and blank pictures."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from tests.slam.corridor import set_limits
from tests.slam.flat_pictures import BASE_FROM_CAMERA, picture_at
from waychair.geometry import compose, invert
from waychair.slam.mapping.appearance_loops import AppearanceLoopClosure
from waychair.slam.mapping.appearance_settings import AppearanceSettings
from waychair.slam.mapping.loop_candidates import LoopSettings
from waychair.slam.mapping.loop_closure import LoopRejection
from waychair.slam.mapping.mapper import Mapper, MapperSettings
from waychair.slam.memory.memory_manager import NodeMemory
from waychair.slam.memory.memory_settings import MemorySettings
from waychair.slam.memory.nodes import IN_TIME, LOOPS, Link
from waychair.types import FloatArray, Pose2, RgbdFrame, SensorFrame

Drive = tuple[list[SensorFrame], FloatArray]
Camera = Callable[[int, Pose2], RgbdFrame | None]

EVERY = 9
"""Frames of the lidar from one picture to the next: one every 0.9 s."""

_STEP_NS = 100_000_000
_picture = lru_cache(maxsize=200)(picture_at)  # the same for all tests, though each has its own drive

PICTURES_ONLY = MapperSettings(loops=LoopSettings(spacing=100.0))
"""In a shorter drive the lidar does not search for its own loops."""


def taken(number: int, pose: Pose2) -> RgbdFrame | None:
    """Return the picture of a working camera."""
    return _picture(pose, number * _STEP_NS)


@pytest.fixture(scope="module")
def route(drive: Drive) -> Drive:
    """Every third frame of two laps."""
    return drive[0][::3], drive[1][::3]


def driven(
    drive: Drive,
    camera: Camera = taken,
    mapping: MapperSettings = PICTURES_ONLY,
    settings: AppearanceSettings | None = None,
    memory: NodeMemory | None = None,
    mapper: Mapper | None = None,
) -> tuple[Mapper, AppearanceLoopClosure]:
    mapper = mapper or Mapper(mapping, Pose2())
    appearance = AppearanceLoopClosure(settings or AppearanceSettings(), BASE_FROM_CAMERA, memory)
    for frame, pose in zip(*drive, strict=True):
        number = frame.stamp_ns // _STEP_NS
        mapper.process(frame)
        picture = camera(number, Pose2(*pose.tolist())) if number % EVERY == 0 else None
        if picture is not None:
            appearance.see(picture)
        appearance.follow(mapper, frame)
    return mapper, appearance


def true_pose(drive: Drive, appearance: AppearanceLoopClosure, node: int) -> Pose2:
    stamp = int(appearance.memory.skeleton.rows["stamp_ns"][node])
    at = next(k for k, frame in enumerate(drive[0]) if frame.stamp_ns == stamp)
    return Pose2(*drive[1][at].tolist())


def false_links(drive: Drive, appearance: AppearanceLoopClosure) -> list[Link]:
    """Return the loops in the memory that contradict the true poses."""
    found = []
    for link in appearance.memory.skeleton.every_link():
        truth = true_pose(drive, appearance, link.i).inverse() @ true_pose(drive, appearance, link.j)
        gap = truth.inverse() @ link.i_from_j
        if link.kind in LOOPS and (np.hypot(gap.x, gap.y) > 0.2 or abs(gap.theta) > 0.1):
            found.append(link)
    return found


def worst_error(drive: Drive, mapper: Mapper) -> float:
    result = mapper.result()
    away: FloatArray = np.hypot(*(compose(invert(drive[1][:1]), drive[1]) - result.trajectory.poses)[:, :2].T)
    return float(away.max())


@pytest.fixture(scope="module")
def seen(route: Drive) -> tuple[Mapper, AppearanceLoopClosure]:
    return driven(route)


def test_pictures_close_a_loop_that_the_lidar_does_not_search_for(
    route: Drive, seen: tuple[Mapper, AppearanceLoopClosure]
) -> None:
    mapper, appearance = seen
    assert mapper.counts["loops_sighted"] >= 1
    assert len(appearance.loops) >= 10
    assert false_links(route, appearance) == []
    assert worst_error(route, mapper) < 0.05


def test_links_in_time_keep_the_driven_motion_when_the_graph_bends(
    route: Drive, seen: tuple[Mapper, AppearanceLoopClosure]
) -> None:
    links = [link for link in seen[1].memory.skeleton.every_link() if link.kind in IN_TIME]
    assert len(links) == len(seen[1].memory.skeleton.ids()) - 1
    for link in links:
        gap = (
            true_pose(route, seen[1], link.i).inverse() @ true_pose(route, seen[1], link.j)
        ).inverse() @ link.i_from_j
        assert np.hypot(gap.x, gap.y) < 0.05


def test_nodes_of_the_second_lap_are_linked_to_the_first(
    route: Drive, seen: tuple[Mapper, AppearanceLoopClosure]
) -> None:
    memory = seen[1].memory
    late = route[0][len(route[0]) // 2].stamp_ns + 20 * _STEP_NS
    second = [node for node in memory.skeleton.ids() if memory.skeleton.rows["stamp_ns"][node] > late]
    linked = [node for node in second if memory.skeleton.links(node, LOOPS)]
    assert len(linked) >= 0.95 * len(second)


@pytest.mark.nightly
def test_vocabulary_and_filter_hold_exactly_the_awake_nodes(route: Drive, monkeypatch: pytest.MonkeyPatch) -> None:
    set_limits(monkeypatch, PREDICTION_LEVELS=4, LOCAL_RADIUS=3.0)
    settings = AppearanceSettings(memory=MemorySettings(working_memory_limit=20))
    mapper, appearance = driven(route, settings=settings)
    memory, vocabulary = appearance.memory, appearance.recognition.vocabulary
    counts = memory.counts(len(vocabulary))
    assert counts.transferred > 20
    assert counts.retrieved > 0
    assert counts.wm <= 22
    assert set(vocabulary.index._slots_of) == {node.id for node in memory.awake}
    assert {node.id for node in memory.awake} == {*memory.stm, *memory.wm}
    assert set(appearance.recognition._places) == set(memory.wm)
    assert false_links(route, appearance) == []
    assert worst_error(route, mapper) < 0.05


def test_a_map_without_pictures_equals_that_of_the_lidar_exactly(route: Drive) -> None:
    mapper, appearance = driven(route, lambda number, pose: None, MapperSettings())
    alone = Mapper(MapperSettings(), Pose2())
    for frame in route[0]:
        alone.process(frame)
    ours, theirs = mapper.result(), alone.result()
    np.testing.assert_array_equal(ours.trajectory.poses, theirs.trajectory.poses)
    np.testing.assert_array_equal(ours.key_poses, theirs.key_poses)
    assert ours.counts == theirs.counts
    assert appearance.memory.stm == ()


def test_the_lidar_continues_alone_while_the_camera_is_lost(route: Drive) -> None:
    """No pictures from the middle of the first lap to the end of the second."""
    mapper, appearance = driven(route, lambda n, pose: taken(n, pose) if n < 150 else None, MapperSettings())
    assert appearance.loops == ()
    assert mapper.result().counts["loops_closed"] >= 1
    assert worst_error(route, mapper) < 0.05


@pytest.mark.nightly
def test_the_camera_continues_after_it_was_lost_for_a_while(route: Drive) -> None:
    mapper, appearance = driven(route, lambda n, pose: None if 200 < n < 400 else taken(n, pose))
    assert false_links(route, appearance) == []
    assert len(appearance.loops) >= 5
    assert worst_error(route, mapper) < 0.05


def test_black_pictures_give_no_words_and_no_loops(route: Drive) -> None:
    def black(number: int, pose: Pose2) -> RgbdFrame | None:
        picture = taken(number, pose)
        assert picture is not None
        return dataclasses.replace(picture, image=np.zeros_like(picture.image))

    mapper, appearance = driven(route, black, MapperSettings())
    assert appearance.counts["pictures that show too little"] == appearance.counts["pictures"]
    assert len(appearance.recognition.vocabulary) == 0
    assert appearance.loops == ()
    assert worst_error(route, mapper) < 0.05


def _delayed(number: int, truth: FloatArray, half: int) -> RgbdFrame | None:
    """In the second lap the camera shows the view from two metres further on."""
    at = min(number // 3 + 7, len(truth) - 1) if number // 3 > half else number // 3
    return _picture(Pose2(*truth[at].tolist()), number * _STEP_NS)


def test_a_lookalike_place_is_refused_by_the_driven_path(route: Drive) -> None:
    half = len(route[0]) // 2
    _, appearance = driven(route, lambda n, pose: _delayed(n, route[1], half))
    assert appearance.refused
    assert LoopRejection.CONTRADICTED.value in {refused.reason for refused in appearance.refused}
    assert false_links(route, appearance) == []


@pytest.mark.nightly
def test_a_lookalike_place_is_refused_by_the_lidar(route: Drive) -> None:
    """The path is assumed to be so uncertain that it contradicts nothing."""
    half = len(route[0]) // 2
    mapping = MapperSettings(loops=LoopSettings(spacing=100.0, drift=0.1))
    mapper, appearance = driven(route, lambda n, pose: _delayed(n, route[1], half), mapping)
    reasons = {refused.reason for refused in appearance.refused}
    assert reasons & {LoopRejection.POOR_FIT.value, LoopRejection.FEW_INLIERS.value, LoopRejection.AMBIGUOUS.value}
    assert false_links(route, appearance) == []
    assert worst_error(route, mapper) < 0.1


@pytest.mark.nightly
def test_a_loop_that_the_graph_removes_is_no_link_of_the_memory(route: Drive) -> None:
    mapper, appearance = driven(route)
    edge, link = appearance._closed_loops[0]
    assert appearance.memory.skeleton.linked(link.i, link.j) is not None
    mapper.keys._graph.remove([edge])
    appearance.finish(mapper)
    assert appearance.memory.skeleton.linked(link.i, link.j) is None
    assert appearance.refused[-1].reason == "the rest of the graph contradicts it"


def test_a_standing_chair_gives_one_node_with_more_weight(route: Drive) -> None:
    frames, truth = route
    last = frames[9]
    still = [dataclasses.replace(last, stamp_ns=last.stamp_ns + 3 * k * _STEP_NS) for k in range(1, 31)]
    standing = ([*frames[:10], *still], np.concatenate([truth[:10], np.repeat(truth[9:10], 30, axis=0)]))
    _, appearance = driven(standing)
    memory = appearance.memory
    assert len(memory.skeleton.ids()) == 4
    assert memory.weight(memory.stm[-1]) == 10


def test_a_reopened_memory_has_the_places_of_the_first_session(route: Drive, tmp_path: Path) -> None:
    lap = len(route[0]) // 2
    first = (route[0][:lap], route[1][:lap])
    mapping = MapperSettings(loops=LoopSettings(submap_spacing=100.0))
    mapper, appearance = driven(first, mapping=mapping, memory=NodeMemory.opened(tmp_path / "memory.db"))
    nodes, words = appearance.memory.skeleton.ids(), appearance.recognition.vocabulary
    appearance.finish(mapper)
    made, known = appearance.memory.store.newest_word(), len(mapper.keys)
    appearance.memory.close()

    again, later = driven(
        first,
        settings=AppearanceSettings(memory=MemorySettings(reduce_graph=True)),
        memory=NodeMemory.opened(tmp_path / "memory.db", MemorySettings(reduce_graph=True)),
        mapper=mapper.for_next_drive({}),
    )
    assert again.keys.reaches(again.frames[-1].key, known), "a loop by appearance has joined the two"
    assert [link for link in later.loops if link.i in nodes and link.j not in nodes]
    assert min(later.memory.skeleton.ids()) == min(nodes)
    assert later.memory.node(later.memory.stm[-1]).map_id == 1
    assert len(later.memory.skeleton.ids()) <= 1.5 * len(nodes), "nodes linked to the first drive are removed"
    assert later.memory.store.newest_word() > made
    assert len(later.recognition.vocabulary) < 2 * len(words)
    later.memory.close()


@pytest.mark.parametrize("shape", [(240, 320, 4), (0, 0), (240,)])
def test_an_invalid_picture_is_counted(shape: tuple[int, ...]) -> None:
    appearance = AppearanceLoopClosure(AppearanceSettings(), BASE_FROM_CAMERA)
    sound = picture_at(Pose2(1.5, 1.5), 1)
    appearance.see(dataclasses.replace(sound, image=np.zeros(shape, np.uint8)))
    assert appearance.counts["pictures that cannot be used"] == 1


def test_pictures_that_step_back_in_time_are_counted() -> None:
    appearance = AppearanceLoopClosure(AppearanceSettings(), BASE_FROM_CAMERA)
    for stamp in (5_000_000_000, 4_000_000_000, 5_000_000_000):
        appearance.see(picture_at(Pose2(1.5, 1.5), stamp))
    assert appearance.counts["pictures"] == 1
    assert appearance.counts["pictures not later than the one before"] == 2


def test_pictures_between_two_processed_ones_are_skipped() -> None:
    appearance = AppearanceLoopClosure(AppearanceSettings(detection_rate=1.0), BASE_FROM_CAMERA)
    sound = picture_at(Pose2(1.5, 1.5), 0)
    for k in range(30):
        appearance.see(dataclasses.replace(sound, stamp_ns=k * 100_000_000))
    assert appearance.counts["pictures"] == 4
