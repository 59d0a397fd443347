"""A chair that stays in one room for days: neither the key scans nor the time of a scan grow without end."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Iterator

import numpy as np
import pytest

from tests.slam.conftest import scan_at
from tests.slam.test_carried import cast
from waychair.offline.mapping import MappingSettings
from waychair.slam.graph.edges import Edge, EdgeKind
from waychair.slam.graph.information import match_information
from waychair.slam.mapping.key_scan_graph import KeyGraph
from waychair.slam.mapping.live_mapping import LiveMapping
from waychair.slam.scan.scan_points import scan_points
from waychair.types import Odometry, Pose2, SensorFrame

ROOM = np.array(
    [
        [0, 0, 5, 0], [5, 0, 5, 4], [5, 4, 0, 4], [0, 4, 0, 0],
        [0, 2.5, 0.8, 2.5], [0.8, 2.5, 0.8, 3.2], [0.8, 3.2, 0, 3.2],  # a cupboard, a bed and a chair
        [3.5, 0, 3.5, 0.6], [3.5, 0.6, 4.4, 0.6], [4.4, 0.6, 4.4, 0], [2.2, 4, 2.5, 3.5], [2.5, 3.5, 2.9, 4],
    ],
    float,
)  # fmt: skip
SCANS = 24_000  # each at a new view, so that each is a full match


def days() -> Iterator[SensorFrame]:
    """Drive from one random place of the room to the next, with odometry that drifts, and yield a scan at each step."""
    rng, pose, odometry, goal = np.random.default_rng(0), Pose2(2.5, 2.0, 0.0), Pose2(), (2.5, 2.0)
    for k in range(SCANS):
        while math.hypot(goal[0] - pose.x, goal[1] - pose.y) < 0.2:
            goal = float(rng.uniform(1.2, 3.3)), float(rng.uniform(1.0, 3.0))
        turn = math.remainder(math.atan2(goal[1] - pose.y, goal[0] - pose.x) - pose.theta, math.tau)
        step = Pose2(0.2, 0.0, turn) if abs(turn) < 0.1 else Pose2(0.0, 0.0, math.copysign(min(abs(turn), 0.18), turn))
        pose, error = pose @ step, rng.normal(0.0, 0.03, 3)
        odometry = odometry @ Pose2(step.x * (1 + error[0]), 0.1 * error[1], step.theta * (1 + error[2]))
        stamp = 500_000_000 * k
        yield SensorFrame(
            stamp, dataclasses.replace(cast(ROOM, pose), stamp_ns=stamp), wheels=(Odometry(stamp, odometry),)
        )


@pytest.mark.nightly
def test_days_in_one_room_add_ever_fewer_key_scans_and_no_scan_takes_longer() -> None:
    live, parts = LiveMapping(MappingSettings(), Pose2()), 8
    keys, cost = [0], []
    frames = days()
    for _ in range(parts):
        casting = mapping = 0.0  # of the same seconds, since other programs slow both down
        for _ in range(SCANS // parts):
            begun = time.process_time()
            frame = next(frames)
            cast_at = time.process_time()
            live.process(frame)
            casting, mapping = casting + cast_at - begun, mapping + time.process_time() - cast_at
        keys.append(len(live.mapper.keys))
        cost.append(mapping / casting)
    fresh = np.diff(keys)
    assert live.mapper.counts["matches"] > 0.8 * SCANS
    assert keys[-1] < 1_500
    assert fresh[-1] < 0.15 * fresh[0]
    assert np.mean(cost[-2:]) < 1.5 * np.mean(cost[1:3])


@pytest.mark.parametrize(("count", "covering"), [(2, None), (3, 2)])
def test_a_crowd_of_key_scans_covers_a_view_also_where_the_ways_to_them_are_long(
    count: int, covering: int | None
) -> None:
    keys = KeyGraph()
    scan, known = scan_points(scan_at(Pose2(1.5, 1.5, 0.4)), Pose2(), 20.0), match_information(1e6 * np.eye(3))
    keys.add(scan, None)
    keys.add(scan, Edge(0, 1, Pose2(2.0, 0.0, 0.0), known, EdgeKind.MATCH))
    for k in range(count):  # round the place of node 0, each 2 m from node 1 along an edge of its own
        keys.add(scan, Edge(1, 2 + k, Pose2(-2.0, 0.05 * (k + 1), 0.0), known, EdgeKind.MATCH))
    assert keys.covering_key(1, Pose2(0.0, 0.04, 0.0), 1.5, 0.3, 0.2, 5.0) == covering


def test_the_nearest_key_scans_along_the_edges_are_given_up_to_their_number() -> None:
    keys = KeyGraph()
    scan = scan_points(scan_at(Pose2(1.5, 1.5, 0.4)), Pose2(), 20.0)
    keys.add(scan, None)
    for k in range(1, 9):
        keys.add(scan, Edge(0, k, Pose2(0.1 * k, 0.0, 0.0), match_information(1e6 * np.eye(3)), EdgeKind.MATCH))
    assert keys.path_lengths(0, 0.55) == pytest.approx({0: 0.0, 1: 0.1, 2: 0.2, 3: 0.3, 4: 0.4, 5: 0.5})
    assert list(keys.path_lengths(0, 5.0, 3)) == [0, 1, 2]
