"""The sentences and the health in the report of a mapping run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.cases.mapping.lidar_floor import replaced, write_scans
from waychair.offline.mapping import MappingSettings, map_recording
from waychair.offline.mapping_report import tears_of, torn_warnings
from waychair.recordings.recording import read_recording
from waychair.slam.graph.graph_optimisation import Edge, EdgeKind
from waychair.slam.mapping.mapper_result import MapperResult
from waychair.types import Pose2, Trajectory


def torn(breaks: int, joined: tuple[int, ...] = ()) -> MapperResult:
    """Key scans a second apart, with a break before each of the last ones; loops join some of those to the first."""
    count = breaks + 2
    kinds = [EdgeKind.MATCH, *[EdgeKind.UNKNOWN] * breaks]
    edges = [Edge(k, k + 1, Pose2(1.0), np.eye(3), kind) for k, kind in enumerate(kinds)]
    edges += [Edge(0, k, Pose2(float(k)), np.eye(3), EdgeKind.LOOP) for k in joined]
    poses = np.column_stack([np.arange(count), np.zeros((count, 2))]).astype(np.float64)
    keys = tuple(range(count))
    stamps = 1_000_000_000 * np.arange(count, dtype=np.int64)
    return MapperResult(Trajectory(stamps, poses), poses, keys, keys, tuple(edges), (), {}, {})


def test_seventy_breaks_are_one_sentence_with_their_count() -> None:
    (warning,) = torn_warnings(torn(70))
    assert warning.startswith("at 2.0 s and 69 times later the scans do not match those before, and the part after it")


def test_mended_breaks_and_others_are_told_apart() -> None:
    mended, open_ = torn_warnings(torn(3, joined=(2,)))
    assert mended.startswith("at 2.0 s the scans do not match those before; a loop closure has joined")
    assert open_.startswith("at 3.0 s and once later")
    assert torn_warnings(torn(0)) == []


def held_by_odometry(*edges: Edge) -> MapperResult:
    """Ten key scans a second apart, between the fifth and the sixth of which only the odometry knows the motion."""
    kinds = [EdgeKind.ODOMETRY if k == 4 else EdgeKind.MATCH for k in range(9)]
    along = [Edge(k, k + 1, Pose2(1.0), np.eye(3), kind) for k, kind in enumerate(kinds)]
    poses = np.column_stack([np.arange(10), np.zeros((10, 2))]).astype(np.float64)
    stamps = 1_000_000_000 * np.arange(10, dtype=np.int64)
    keys = tuple(range(10))
    return MapperResult(Trajectory(stamps, poses), poses, keys, keys, (*along, *edges), (), {}, {})


def test_parts_that_only_the_odometry_joins_are_told() -> None:
    (warning,) = torn_warnings(held_by_odometry())
    assert warning.startswith(
        "at 5.0 s the scans do not show the chair's motion, and odometry alone joins the map there"
    )


def test_a_loop_round_a_place_without_a_match_says_enough() -> None:
    assert torn_warnings(held_by_odometry(Edge(1, 8, Pose2(7.0), np.eye(3), EdgeKind.LOOP))) == []


def test_a_few_key_scans_at_the_end_that_only_the_odometry_joins_are_no_part() -> None:
    result = held_by_odometry()
    ended = replace(result, key_poses=result.key_poses[:9], edges=result.edges[:8])
    assert torn_warnings(ended) == []


def test_every_tear_is_listed_with_its_time_its_cause_and_what_became_of_it() -> None:
    tears = tears_of(torn(3, joined=(2,)))
    assert [(tear["at_s"], tear["joined_again"]) for tear in tears] == [(2.0, True), (3.0, False), (4.0, False)]
    assert all("contradict" in tear["why"] for tear in tears)


def test_the_report_holds_the_health_of_the_recording(tmp_path: Path) -> None:
    write_scans(tmp_path / "drive", replaced(time_increment=833_333.3))
    report = map_recording(read_recording(tmp_path / "drive"), MappingSettings()).report
    assert report["times_real_time"] > 1.0
    assert report["loop_search"]["submaps_never_searched"] == 0
    (finding,) = report["health"]
    assert (finding["kind"], finding["topic"]) == ("beam times", "/scan")
    assert "nanoseconds" in finding["text"]
    assert sum("nanoseconds" in warning for warning in report["warnings"]) == 1
