"""The pace of long searches for a revisited place."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.slam.mapping import loop_closure
from waychair.slam.mapping.loop_closure import LoopSettings
from waychair.slam.mapping.loop_searches import SubmapsSearch
from waychair.slam.mapping.mapper import Mapper, MapperSettings
from waychair.slam.scan.submap_search import SubmapRound
from waychair.types import FloatArray, Pose2, SensorFrame

Drive = tuple[list[SensorFrame], FloatArray]


@pytest.mark.parametrize(("submaps", "key_scans_a_piece"), [(1, 1), (60, 1), (61, 2), (120, 2), (200, 4)])
def test_the_more_submaps_a_round_has_the_more_key_scans_share_a_piece(submaps: int, key_scans_a_piece: int) -> None:
    members = {first: np.arange(first, first + 40) for first in range(0, 40 * submaps, 40)}
    search = SubmapsSearch([], members, SubmapRound(np.zeros((0, 2)), list(members.items())))
    due = [search.is_due() for _ in range(12)]
    assert due == [k % key_scans_a_piece == key_scans_a_piece - 1 for k in range(12)]


def test_submaps_that_the_budget_leaves_over_are_searched_three_with_each_further_key_scan_while_parts_are_apart(
    drive: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop_closure, "_SUBMAP_SCANS", 10)
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
    monkeypatch.setattr(loop_closure, "_SUBMAP_SCANS", 10)
    mapper, told = Mapper(MapperSettings(loops=LoopSettings(drift=0.4)), Pose2()), list[int]()
    for frame in drive[0][:430]:
        before = len(mapper.keys)
        mapper.process(frame)
        if len(mapper.keys) > before:
            told.append(mapper._closer.never_searched)
    waiting = [k for k, count in enumerate(told) if count]
    assert told[waiting[0] - 1] == 0
    assert 0 in told[waiting[0] :]  # a run that goes on searches it
    # the last one became possible between two searches, and the drive ends before the next
    assert told[-1] == mapper.result().counts["submaps_never_searched"] == 1
