"""A chair that is carried while it maps: the tear, what undoes it, and the place where the parts are joined again."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest

from tests.slam.conftest import scan_at
from waychair.geometry import compose, invert
from waychair.offline.mapping_report import torn_warnings
from waychair.slam.graph.edges import Edge, EdgeKind
from waychair.slam.graph.information import (
    MATCH_POSITION_SIGMA,
    match_information,
    odometry_information,
    rotated_information,
    unknown_information,
)
from waychair.slam.graph.robust_optimisation import chained_poses, solve
from waychair.slam.mapping.carried import CarryJudge, OpenTear, Verdict, agrees_with_odometry
from waychair.slam.mapping.key_scan_graph import KeyGraph
from waychair.slam.mapping.loop_candidates import LoopSettings, candidates, graph_distances, uncertain_submaps
from waychair.slam.mapping.loop_closure import Driven
from waychair.slam.mapping.mapper import Mapper, MapperSettings
from waychair.slam.mapping.mapper_result import MapperResult
from waychair.slam.mapping.open_tears import OpenTears
from waychair.slam.scan.scan_agreement import Agreement, agreement, view_of
from waychair.slam.scan.scan_matching import MatchSettings
from waychair.slam.scan.scan_points import scan_points
from waychair.types import FloatArray, Odometry, Pose2, Scan, SensorFrame

HERE = Pose2(1.5, 1.5, 0.4)
BEAMS = np.linspace(-math.pi / 2, math.pi / 2, 181)


def seen_from(*poses: Pose2) -> list[tuple]:  # type: ignore[type-arg]
    return [(view_of(scan_points(scan_at(pose, noise=0.01), Pose2(), 20.0), Pose2()), pose) for pose in poses]


def laid(scan: Scan, pose: Pose2) -> Agreement:
    """Return how a scan, laid at a pose, agrees with two scans of the corner of the flat."""
    return agreement(
        seen_from(HERE, Pose2(1.8, 1.5, 0.4)), [(view_of(scan_points(scan, Pose2(), 20.0), Pose2()), pose)]
    )


def test_a_chair_that_stayed_contradicts_nothing() -> None:
    assert laid(scan_at(HERE, noise=0.01, seed=3), HERE).contradiction < 0.02


def test_a_chair_elsewhere_looks_through_walls() -> None:
    found = laid(scan_at(Pose2(10.0, 7.0, 2.5)), HERE)
    assert found.contradiction > 0.4
    assert found.shared > 200


def test_a_wall_where_earlier_scans_saw_free_ground_contradicts_as_well() -> None:
    boxed = scan_at(HERE)
    boxed.ranges[:] = np.minimum(boxed.ranges, 1.2)
    assert laid(boxed, HERE).contradiction > 0.4


def test_people_round_the_chair_contradict_little() -> None:
    crowded = scan_at(HERE)
    for beam in (20, 60, 110, 150):  # four people
        crowded.ranges[beam : beam + 8] = np.minimum(crowded.ranges[beam : beam + 8], 0.8)
    assert laid(crowded, HERE).contradiction < 0.15


PITCH = 5.0  # m


def rooms(count: int, furnished: bool) -> FloatArray:
    """Return the walls (W, 4) [m] of a corridor and of rooms in a row beside it, alike unless furnished."""
    end = PITCH * count
    walls: list[tuple[float, ...]] = [(0, 0, end, 0), (0, 0, 0, 2), (end, 0, end, 7)]
    for k in range(count):
        x, size = PITCH * k, 0.6 + 0.9 * k * furnished
        walls += [(x, 2, x + 1, 2), (x + 2.2, 2, x + PITCH, 2), (x, 2, x, 7), (x, 7, x + PITCH, 7)]
        left, low = x + PITCH - size, 7 - 1.2 * size
        walls += [(left, low, x + PITCH, low), (left, low, left, 7)]  # a cupboard
    return np.array(walls, float)


def cast(walls: FloatArray, pose: Pose2) -> Scan:
    """Return the scan of walls from a pose, by the intersection of all beams with all walls."""
    angles = BEAMS + pose.theta
    ray = np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, None]
    start, along = walls[:, :2] - (pose.x, pose.y), walls[:, 2:] - walls[:, :2]
    cross = ray[..., 0] * along[:, 1] - ray[..., 1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        away = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / cross
        share = (start[:, 0] * ray[..., 1] - start[:, 1] * ray[..., 0]) / cross
    away[~((away > 0) & (share >= 0) & (share <= 1))] = np.inf
    ranges = away.min(axis=1) + 0.01 * np.random.default_rng(round(1e4 * pose.x)).standard_normal(len(BEAMS))
    return Scan(0, ranges.astype(np.float32), float(BEAMS[0]), float(BEAMS[1] - BEAMS[0]), range_max=30.0)


def way(*corners: tuple[float, float]) -> list[Pose2]:
    """Return poses every 0.15 m and 0.15 rad along corners [m]."""
    poses: list[Pose2] = []
    for (x0, y0), (x1, y1) in itertools.pairwise(corners):
        towards, steps = math.atan2(y1 - y0, x1 - x0), round(math.hypot(x1 - x0, y1 - y0) / 0.15)
        if poses:
            turn = math.remainder(towards - poses[-1].theta, math.tau)
            parts = np.linspace(0, 1, math.ceil(abs(turn) / 0.15) + 1)[1:]
            poses += [Pose2(x0, y0, poses[-1].theta + turn * part) for part in parts.tolist()]
        poses += [Pose2(x0 + (x1 - x0) * k / steps, y0 + (y1 - y0) * k / steps, towards) for k in range(steps)]
    return poses


def visit(room: int) -> list[tuple[float, float]]:
    """Return corners of the way from the corridor round a room and back."""
    x = PITCH * room
    loop = [(x + 1.6, 3.2), (x + 3.4, 3.2), (x + 3.4, 4.6), (x + 1.0, 4.6)]
    return [(x + 1.6, 1.0), *loop, (x + 1.6, 3.2), (x + 1.6, 1.0)]


def mapped(walls: FloatArray, *drives: Sequence[Pose2], leaves: float = 0.0) -> tuple[MapperResult, FloatArray]:
    """Map drives one after the other, between which the chair is carried; the odometry shows only what is driven.

    A share of the beams, `leaves`, passes through the walls, others in each scan.
    """
    mapper, odometry, last = Mapper(MapperSettings(), Pose2()), Pose2(), None
    truth: list[FloatArray] = []
    for drive in drives:
        last = None
        for pose in drive:
            step = Pose2() if last is None else last.inverse() @ pose
            odometry, last = odometry @ Pose2(1.01 * step.x, step.y, step.theta), pose
            stamp = 100_000_000 * len(truth)
            scan, rng = dataclasses.replace(cast(walls, pose), stamp_ns=stamp), np.random.default_rng(len(truth))
            scan.ranges[rng.random(len(BEAMS)) < leaves] += np.float32(rng.uniform(0.5, 4.0))
            mapper.process(SensorFrame(stamp, scan, wheels=(Odometry(stamp, odometry),)))
            truth.append(pose.array())
    return mapper.result(), np.array(truth)


def away_from(result: MapperResult, truth: FloatArray) -> FloatArray:
    """Return the distance (N,) [m] of each pose to the truth, both relative to the first."""
    moved = compose(truth[0], compose(invert(result.trajectory.poses[0]), result.trajectory.poses))
    away: FloatArray = np.hypot(*(moved - truth)[:, :2].T)
    return away


def torn(result: MapperResult) -> list[Edge]:
    return [edge for edge in result.edges if edge.kind is EdgeKind.UNKNOWN]


def test_a_chair_carried_to_another_room_is_found_there() -> None:
    walls = rooms(2, furnished=True)
    tour, again = way((0.8, 1.0), *visit(0), *visit(1), (9.0, 1.0)), way(*visit(0)[1:], (5.0, 1.0), (9.0, 1.0))
    result, truth = mapped(walls, tour, again)
    assert len(torn(result)) == 1
    assert any("has joined" in warning for warning in torn_warnings(result))
    assert np.median(away_from(result, truth)[len(tour) :]) < 0.1


def test_a_chair_carried_again_before_the_scans_have_judged_the_first_time_is_found() -> None:
    walls = rooms(2, furnished=True)
    tour, short = way((0.8, 1.0), *visit(0), *visit(1), (9.0, 1.0)), way((2.0, 4.6), (1.4, 4.6), (1.0, 4.0))[:9]
    again = way(*visit(1)[2:], (5.0, 1.0), (0.8, 1.0))
    result, truth = mapped(walls, tour, short, again)
    assert np.median(away_from(result, truth)[len(tour) + len(short) :]) < 0.1
    assert [result.key_frames[edge.j] for edge in torn(result)] == pytest.approx(
        [len(tour), len(tour) + len(short)], abs=3
    )
    joined, apart = torn_warnings(result)  # nine scans alone are not found again, but the last drive is
    assert "joined the map again" in joined
    assert "is not joined" in apart


def test_a_chair_carried_among_alike_rooms_is_joined_to_no_wrong_one() -> None:
    walls = rooms(3, furnished=False)
    tour, again = way((0.8, 1.0), *visit(0), *visit(1), (9.0, 1.0)), way(*visit(2)[1:5], *visit(2)[1:6])
    result, _ = mapped(walls, tour, again)  # the third room is the only one that it has not seen
    assert len(torn(result)) == 1
    assert not any(edge.kind is EdgeKind.LOOP and edge.j >= torn(result)[0].j > edge.i for edge in result.edges)
    assert any("is not joined" in warning for warning in torn_warnings(result))


def test_scans_that_a_crowd_hides_for_a_moment_tear_nothing(drive: tuple[list[SensorFrame], FloatArray]) -> None:
    frames, truth = list(drive[0][:160]), drive[1][:160]
    for k in (60, 61, 62, 63):  # boards are carried past the chair, near and all round
        scan = frames[k].scan
        assert scan is not None
        near = np.minimum(scan.ranges, np.where(np.arange(181) % 60 < 40, 0.5 + 0.1 * (k - 60), np.inf))
        frames[k] = dataclasses.replace(frames[k], scan=dataclasses.replace(scan, ranges=near.astype(np.float32)))
    mapper = Mapper(MapperSettings(), Pose2())
    for frame in frames:
        mapper.process(frame)
    result = mapper.result()
    assert torn(result) == []
    assert torn_warnings(result) == []
    assert away_from(result, truth)[70:].max() < 0.1


def test_hedges_that_some_beams_pass_tear_nothing() -> None:
    walls = rooms(4, furnished=True)
    result, truth = mapped(walls, way(*visit(0), *visit(1), *visit(2), *visit(3)), leaves=0.3)
    assert torn(result) == []
    assert away_from(result, truth).max() < 0.5


def test_a_chair_carried_among_hedges_is_noticed() -> None:
    walls = rooms(2, furnished=True)
    result, _ = mapped(walls, way((0.8, 1.0), *visit(0), (5.0, 1.0)), way(*visit(1)[1:], (9.0, 1.0)), leaves=0.2)
    assert len(torn(result)) == 1


def test_one_faulty_scan_tears_nothing(drive: tuple[list[SensorFrame], FloatArray]) -> None:
    frames, scan = list(drive[0][:120]), drive[0][300].scan
    assert scan is not None
    frames[60] = dataclasses.replace(frames[60], scan=dataclasses.replace(scan, stamp_ns=frames[60].stamp_ns))
    mapper = Mapper(MapperSettings(), Pose2())
    for frame in frames:
        mapper.process(frame)
    assert mapper.counts["tears_undone"] == 0
    assert torn(mapper.result()) == []
    assert away_from(mapper.result(), drive[1][:120]).max() < 0.1


def test_a_mirror_hall_tears_the_map_and_the_next_scans_undo_it(drive: tuple[list[SensorFrame], FloatArray]) -> None:
    frames, truth = list(drive[0][:160]), drive[1][:160]
    for k in (60, 61, 62, 63):  # the lidar sees another place in a large mirror
        scan = drive[0][200 + k].scan
        assert scan is not None
        frames[k] = dataclasses.replace(frames[k], scan=dataclasses.replace(scan, stamp_ns=frames[k].stamp_ns))
    mapper = Mapper(MapperSettings(), Pose2())
    for frame in frames:
        mapper.process(frame)
    result = mapper.result()
    assert mapper.counts["tears_undone"] >= 1
    assert torn(result) == []
    assert away_from(result, truth)[70:].max() < 0.15


def chained(count: int, unknown: int) -> tuple[KeyGraph, list[Edge]]:
    """Return key scans 0.5 m apart on a straight line, with an edge of unknown motion to key scan `unknown`."""
    keys, scan = KeyGraph(), scan_points(scan_at(HERE), Pose2(), 20.0)
    keys.add(scan, None)
    edges = []
    for k in range(1, count):
        known = unknown_information() if k == unknown else odometry_information(Pose2(0.5, 0, 0))
        kind = EdgeKind.UNKNOWN if k == unknown else EdgeKind.MATCH
        edges.append(Edge(k - 1, k, Pose2(0.5, 0.0, 0.0), known, kind))
        keys.add(scan, edges[-1])
    return keys, edges


@pytest.mark.parametrize(("moved", "false"), [(0.0, True), (0.2, True), (3.0, False)])
def test_a_tear_is_undone_if_a_loop_over_it_agrees_with_the_odometry(moved: float, false: bool) -> None:
    keys, edges = chained(20, 10)
    keys.link(Edge(2, 18, Pose2(8.0 + moved, 0.0, 0.0), match_information(1e6 * np.eye(3)), EdgeKind.LOOP))
    keys.optimise()
    known = agrees_with_odometry(keys, edges[9])
    assert (known is not None) is false
    if known is not None:
        keys.undo_tear(edges[9], known)
        keys.optimise()
        assert not keys.is_torn
        assert keys.poses[19, 0] == pytest.approx(9.5 + moved, abs=0.02)


def test_a_chair_carried_far_through_a_building_bends_no_weak_odometry_once_its_map_is_joined() -> None:
    true = np.array([[10.0 * k, 0.0, 0.0] for k in range(10)] + [[300.0 - 10.0 * k, 0.0, math.pi] for k in range(29)])
    sure = np.diag([MATCH_POSITION_SIGMA**-2, MATCH_POSITION_SIGMA**-2, 4e4])
    poses = [Pose2(*pose) for pose in true.tolist()]
    edges = [Edge(k, k + 1, poses[k].inverse() @ poses[k + 1], sure, EdgeKind.MATCH) for k in range(len(poses) - 1)]
    edges[9] = Edge(9, 10, Pose2(), unknown_information(), EdgeKind.UNKNOWN)  # carried by 210 m
    edges[20] = dataclasses.replace(edges[20], kind=EdgeKind.ODOMETRY, information=np.diag([20.0, 20.0, 70.0]))
    edges.append(Edge(4, 36, poses[4].inverse() @ poses[36], sure, EdgeKind.LOOP))
    found = solve(chained_poses(true, edges), edges).poses
    assert np.hypot(*(found - true)[:, :2].T).max() < 0.5


def test_before_any_loop_the_part_after_a_tear_moves_with_the_edge_that_undoes_it() -> None:
    keys, edges = chained(6, 3)
    keys.undo_tear(edges[2], Edge(2, 3, Pose2(0.5, 0.1, math.pi / 2), odometry_information(Pose2(0.5)), EdgeKind.MATCH))
    assert keys.poses[2] == pytest.approx([1.0, 0.0, 0.0])
    assert keys.poses[5] == pytest.approx([1.5, 1.1, math.pi / 2])
    assert keys.reaches(5, 1)


def slipped(really_at: Sequence[Pose2]) -> tuple[KeyGraph, OpenTear, Verdict]:
    """Map a way into a room and three key scans after a slip, laid in that room and really `really_at`; judge the slip."""
    walls, mounted, keys = rooms(2, furnished=True), Pose2(), KeyGraph()
    into = [Pose2(1.6, 1.0 + 0.3 * k, math.pi / 2) for k in range(11)]
    for k, (pose, true) in enumerate(zip(into, [*into[:8], *really_at], strict=True)):
        step = into[k - 1].inverse() @ pose if k else Pose2()
        edge = Edge(k - 1, k, step, match_information(1e6 * np.eye(3)), EdgeKind.MATCH)
        keys.add(scan_points(cast(walls, true), mounted, 20.0), edge if k else None)
    slip = OpenTear(keys.edges[7], tuple(range(8)), odometry_information(Pose2(0.3)), Pose2(0.9, 0.1, 0.2))
    return keys, slip, CarryJudge(MatchSettings(), 10.0, mounted).judged(keys, slip, range(8, 11))[0]


def test_a_slip_that_the_next_scans_confirm_stays_open_and_tears_nothing() -> None:
    _, _, verdict = slipped([Pose2(1.6, 1.0 + 0.3 * k, math.pi / 2) for k in range(8, 11)])
    assert verdict is Verdict.OPEN


def test_a_slip_that_the_next_scans_contradict_was_a_carry_and_tears_the_map_there() -> None:
    elsewhere = [Pose2(3.0 + 1.5 * k, 1.0, 0.0) for k in range(3)]  # along the corridor
    keys, slip, verdict = slipped(elsewhere)
    assert verdict is Verdict.CARRIED
    assert slip.odometry is not None
    assert keys.tear(slip.edge, slip.odometry)
    assert keys.is_torn
    assert not keys.reaches(10, 8)
    assert (keys.pose(7).inverse() @ keys.pose(8)).array() == pytest.approx(slip.odometry.array(), abs=1e-9)


def test_a_slip_before_a_carry_is_judged_by_the_key_scans_between_them_alone() -> None:
    keys, carry, _ = slipped([Pose2(3.0 + 1.5 * k, 1.0, 0.0) for k in range(3)])
    drove = OpenTear(keys.edges[3], tuple(range(4)), odometry_information(Pose2(0.3)), Pose2(0.6, 0.1, 0.0))
    tears = OpenTears(CarryJudge(MatchSettings(), 10.0, Pose2()))
    tears.add(drove)
    tears.add(carry)
    ruling = tears.judged(keys, range(11))
    assert (ruling.parted, ruling.recent) == ([carry], [8, 9, 10])
    assert [(edge.i, edge.j) for edge in keys.edges if edge.kind is EdgeKind.UNKNOWN] == [(7, 8)]
    assert tears.judged(keys, [8, 9, 10]).took_long is False  # nothing is open


def test_a_loop_over_a_slip_keeps_the_map_whole() -> None:
    keys, edges = chained(12, 20)
    keys.link(Edge(2, 9, Pose2(3.5, 0.0, 0.0), match_information(1e6 * np.eye(3)), EdgeKind.LOOP))
    assert not keys.tear(edges[4], Pose2())
    assert not keys.is_torn


def test_an_edge_of_unknown_motion_needs_a_search_of_submaps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("waychair.slam.mapping.loop_candidates._SUBMAP_SCANS", 10)
    settings = LoopSettings()
    poses = np.array([[0.2 * k, 0.0, 0.0] for k in range(41)])
    kinds = [EdgeKind.UNKNOWN if k == 29 else EdgeKind.MATCH for k in range(40)]
    edges = [Edge(k, k + 1, Pose2(0.2, 0, 0), unknown_information(), kind) for k, kind in enumerate(kinds)]
    ways = graph_distances(poses, edges, 40)[:35]
    assert candidates(poses, ways, settings) == ()
    assert list(uncertain_submaps(poses, ways, settings, [30])) == [20, 10, 0]  # nearest first


def test_the_key_scans_just_before_a_tear_are_searched_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("waychair.slam.mapping.loop_candidates._SUBMAP_SCANS", 10)
    poses = np.array([[0.2 * k, 0.0, 0.0] for k in range(60)])
    kinds = [EdgeKind.UNKNOWN if k == 26 else EdgeKind.MATCH for k in range(59)]
    edges = [Edge(k, k + 1, Pose2(0.2, 0, 0), unknown_information(), kind) for k, kind in enumerate(kinds)]
    ways = graph_distances(poses, edges, 59)[:50]
    found = uncertain_submaps(poses, ways, LoopSettings(), [27])
    assert {first: list(nodes) for first, nodes in found.items()} == {
        0: list(range(10)), 10: list(range(10, 20)), 20: list(range(20, 27)),
    }  # fmt: skip


def test_searches_of_submaps_that_find_nothing_become_rarer_until_one_does() -> None:
    since, rests = Driven(), list[float]()
    for _ in range(6):
        since.submaps = 10.0  # m; the length of the round
        since.end_round(is_fruitless=True)
        rests.append(since.next_round - since.submaps)
    assert rests == [0.0, 10.0, 20.0, 30.0, 30.0, 30.0]
    since.end_round(is_fruitless=False)
    assert since.next_round == 0.0
    since.end_round(is_fruitless=True)
    assert since.next_round == 10.0


def test_information_falls_with_the_distance_and_rotates_with_the_frame() -> None:
    near, far = odometry_information(Pose2(0.1, 0, 0)), odometry_information(Pose2(2.0, 0, 0.5))
    assert (np.diag(far) < np.diag(near)).all()
    assert (np.diag(unknown_information()) < np.diag(far)).all()
    assert np.sqrt(np.linalg.inv(match_information(1e12 * np.eye(3)))[0, 0]) == pytest.approx(MATCH_POSITION_SIGMA)
    quarter = rotated_information(np.diag([1.0, 2.0, 3.0]), np.pi / 2)
    assert quarter == pytest.approx(np.diag([2.0, 1.0, 3.0]), abs=1e-12)
