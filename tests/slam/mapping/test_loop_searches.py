"""The pace of long searches for a revisited place."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest

from tests.slam.conftest import scan_at
from waychair.slam.graph.edges import Edge, EdgeKind
from waychair.slam.graph.information import unknown_information
from waychair.slam.mapping import loop_candidates
from waychair.slam.mapping.carried import CarryJudge
from waychair.slam.mapping.key_scan_graph import KeyGraph
from waychair.slam.mapping.loop_candidates import LoopSettings
from waychair.slam.mapping.loop_closure import LoopCloser
from waychair.slam.mapping.loop_searches import SubmapsSearch
from waychair.slam.mapping.mapper import LOCAL_REACH, Mapper, MapperSettings
from waychair.slam.scan.scan_matching import MatchSettings
from waychair.slam.scan.scan_points import scan_points
from waychair.slam.scan.submap_search import SubmapRound
from waychair.types import FloatArray, Pose2, SensorFrame

Drive = tuple[list[SensorFrame], FloatArray]

ALONG = [Pose2(1.5 + 0.3 * k, 1.5, 0.0) for k in range(28)]
"""The way along the flat's lower side, which three parts of a map have in common."""


@pytest.mark.parametrize(("submaps", "key_scans_a_piece"), [(1, 1), (60, 1), (61, 2), (120, 2), (200, 4)])
def test_the_more_submaps_a_round_has_the_more_key_scans_share_a_piece(submaps: int, key_scans_a_piece: int) -> None:
    members = {first: np.arange(first, first + 40) for first in range(0, 40 * submaps, 40)}
    search = SubmapsSearch([], members, SubmapRound(np.zeros((0, 2)), list(members.items())))
    due = [search.is_due() for _ in range(12)]
    assert due == [k % key_scans_a_piece == key_scans_a_piece - 1 for k in range(12)]


def test_submaps_that_the_budget_leaves_over_are_searched_three_with_each_further_key_scan_while_parts_are_apart(
    drive: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop_candidates, "_SUBMAP_SCANS", 10)
    frames, first = drive[0][:330], Mapper(MapperSettings(), Pose2())
    for frame in frames:
        first.process(frame)
    assert first.result().counts["submaps_never_searched"] == 0  # a short way, on which nothing is uncertain
    again, left = first.for_next_drive({}), list[int]()
    known = len(again.keys)
    for frame in frames[40:]:
        before = len(again.keys)
        again.process(frame)
        if len(again.keys) > before and again._closer.counts["submap_searches"]:
            left.append(again._closer.never_searched)
        if left and not left[-1]:
            break
    assert left[0] >= known // 10 - 3  # three have been searched, and the last one may be a shorter rest
    assert left == [*range(left[0], 0, -3), 0]


def test_a_run_that_ends_while_a_submap_waits_tells_that_it_was_never_searched(
    drive: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop_candidates, "_SUBMAP_SCANS", 10)
    mapper, told = Mapper(MapperSettings(loops=LoopSettings(drift=0.4)), Pose2()), list[int]()
    for frame in drive[0]:
        before = len(mapper.keys)
        mapper.process(frame)
        if len(mapper.keys) > before:
            told.append(mapper._closer.never_searched)
        if told and told[-1] and any(was > then == 0 for was, then in pairwise(told)):
            break  # a run that goes on has searched one; another became possible between two searches, where the drive ends
    assert told[0] == 0
    assert told[-1] == mapper.result().counts["submaps_never_searched"] > 0


def three_parts() -> KeyGraph:
    """A map whose three parts are the same way, driven after the chair was carried: each part lies elsewhere on the map."""
    keys = KeyGraph()
    for part in range(3):
        moved = Pose2(20.0 * part, 7.0 * part, 0.6 * part)
        for k, pose in enumerate(ALONG):
            scan = scan_points(scan_at(pose, noise=0.01, seed=len(keys)), Pose2(), 20.0)
            last, kind = len(keys) - 1, EdgeKind.UNKNOWN if k == 0 else EdgeKind.MATCH
            step = keys.pose(last).inverse() @ moved @ pose if last >= 0 else moved
            keys.add(scan, Edge(last, last + 1, step, unknown_information(), kind) if last >= 0 else None)
    return keys


def closer() -> LoopCloser:
    judge = CarryJudge(MatchSettings(), LOCAL_REACH, Pose2())
    return LoopCloser(LoopSettings(), MatchSettings(), LOCAL_REACH, Pose2(), judge)


def find(of: int, at: int, ahead: float = 0.0) -> Edge:
    """The find that the chair, at key scan `of` of the third part, stands near key scan `at`, and `ahead` [m] of where it does."""
    node = 2 * len(ALONG) + of
    return Edge(
        at, node, ALONG[at % len(ALONG)].inverse() @ ALONG[of] @ Pose2(ahead), unknown_information(), EdgeKind.LOOP
    )


def ended(own: LoopCloser, keys: KeyGraph, finds: Sequence[Edge]) -> list[Edge]:
    """Let a round of submaps end with these finds; return the edges that are accepted."""
    own._submap_search = SubmapsSearch([len(keys) - 1], {}, SubmapRound(np.zeros((0, 2)), []), edges=list(finds))
    return own._submap_edges(keys)


def test_a_view_that_fits_two_parts_of_the_map_joins_them_if_they_are_the_same_there() -> None:
    keys, own = three_parts(), closer()
    second = len(ALONG)
    assert ended(own, keys, [find(12, 12), find(12, second + 12)]) == []  # no find before it
    accepted = ended(own, keys, [find(20, 20), find(20, second + 20)])
    assert [edge.i for edge in accepted] == [20, second + 20]
    assert own.counts["places_ambiguous"] == 0


def test_where_a_drive_ends_its_searches_go_on_to_their_end_and_a_view_confirms_no_find_of_its_own() -> None:
    keys, own = three_parts(), closer()
    recent = range(2 * len(ALONG), len(keys))
    for _ in range(2):  # a map that is saved twice
        assert own.last_loops(keys, recent) == []
        assert own.never_searched == 0
        assert own.counts["submap_searches"] == 1
    own.add_distance(3.0)
    assert {edge.i // len(ALONG) for edge in own.last_loops(keys, recent)} == {0, 1}


@pytest.mark.parametrize(
    "elsewhere",
    [
        find(20, len(ALONG) + 4, -3.0),  # another place of the other part
        find(20, 6, -3.0),  # another place of the same part
    ],
)
def test_a_view_that_fits_at_different_places_joins_nothing_and_the_find_before_it_is_not_trusted(
    elsewhere: Edge,
) -> None:
    keys, own = three_parts(), closer()
    ended(own, keys, [find(12, 12)])
    assert ended(own, keys, [find(20, 20), elsewhere]) == []
    assert own.counts["places_ambiguous"] == 1
    assert ended(own, keys, [find(24, 24)]) == []


@pytest.mark.parametrize(("ahead", "accepted"), [(1.5, True), (-1.5, True), (4.5, False)])
def test_a_find_near_the_chair_in_its_own_part_of_the_map_needs_no_second_one(ahead: float, accepted: bool) -> None:
    keys, own = three_parts(), closer()
    here = 2 * len(ALONG)
    assert bool(ended(own, keys, [find(20, here + 2, ahead)])) == accepted


def test_a_find_in_another_part_of_the_map_needs_a_second_one_however_near_it_lies_by_chance() -> None:
    keys, own = three_parts(), closer()
    there = keys.pose(2 * len(ALONG) + 20)
    near = Edge(20, 2 * len(ALONG) + 20, keys.pose(20).inverse() @ there, unknown_information(), EdgeKind.LOOP)
    assert ended(own, keys, [near]) == []


def test_a_round_without_a_find_says_nothing_against_the_find_before_it() -> None:
    keys, own = three_parts(), closer()
    assert ended(own, keys, [find(12, 12)]) == []
    assert ended(own, keys, []) == []
    assert [edge.i for edge in ended(own, keys, [find(20, 20)])] == [20]


def test_a_find_elsewhere_takes_the_place_of_the_find_before_it() -> None:
    keys, own = three_parts(), closer()
    ended(own, keys, [find(12, 12)])
    assert ended(own, keys, [find(16, 2, -3.0)]) == []
    assert ended(own, keys, [find(20, 20)]) == []
