"""Obstacle layers: seen points are marked, passed points cleared, points out of sight forgotten."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A, BodyLayer, ChairBody
from waychair.maps.depth.ground import GROUND, GroundView, ground_view
from waychair.planning.seen.obstacle_layer import (
    EMPTY,
    ObstacleLayer,
    Sight,
    any_nearer,
    between_heights,
    on_ground,
    passed_points,
    sight_from_depth,
    sight_from_points,
    sights_from_sonar,
    updated,
    without,
)
from waychair.types import BoolArray, Bytes, FloatArray, Pose2, RgbdFrame, SonarReadings

SECOND = 10**9
ALL_ROUND = np.linspace(-math.pi, math.pi, 720, endpoint=False)
BEAM = math.pi / 720
LEVEL_CAMERA = ChairBody(camera_y=0.0, camera_z=0.95, camera_pitch=0.0).base_from_camera


def look(stamp_ns: int, ranges: FloatArray, origin: tuple[float, float] = (0.0, 0.0), limit: float = 6.0) -> Sight:
    """A lidar all round; beams are followed up to the limit."""
    far = np.minimum(ranges, limit)
    ends = np.array(origin) + far[:, None] * np.stack([np.cos(ALL_ROUND), np.sin(ALL_ROUND)], axis=-1)
    return sight_from_points(stamp_ns, np.array(origin), ends, ranges < limit, BEAM)


def room(person_at: float | None, half_width: float = 0.1) -> FloatArray:
    """Ranges of a round room of 5 m with a person in it, 2 m from the lidar in a direction."""
    ranges = np.full(720, 5.0)
    if person_at is not None:
        ranges[np.abs(np.angle(np.exp(1j * (ALL_ROUND - person_at)))) < half_width] = 2.0
    return ranges


def near(layer: ObstacleLayer, distance: float) -> int:
    """Points at a distance from the origin."""
    return int((np.abs(np.hypot(*layer.points.T) - distance) < 0.1).sum())


@pytest.mark.parametrize("direction", [0.0, 1.0, math.pi, -3.0])
def test_a_person_who_walked_on_is_cleared_at_once_and_marked_at_the_new_place(direction: float) -> None:
    layer = updated(EMPTY, look(0, room(direction)))
    assert near(layer, 2.0) > 10
    layer = updated(layer, look(SECOND // 10, room(direction + 0.5)))
    bearings = np.arctan2(*layer.points[np.hypot(*layer.points.T) < 3.0].T[::-1])
    assert (np.abs(np.angle(np.exp(1j * (bearings - direction - 0.5)))) < 0.12).all()
    assert near(updated(layer, look(SECOND // 5, room(None))), 2.0) == 0


def test_a_beam_without_a_return_clears_as_far_as_it_is_followed() -> None:
    layer = updated(EMPTY, look(0, room(0.0)))
    open_ended = np.full(720, 50.0)
    assert len(updated(layer, look(1, open_ended)).points) == 0
    assert near(updated(layer, look(1, open_ended, limit=1.5)), 2.0) > 10


def test_a_hidden_obstacle_is_remembered_until_it_fades() -> None:
    layer = updated(EMPTY, look(0, room(0.0)))
    nearer = np.minimum(room(None), np.where(np.abs(ALL_ROUND) < 0.3, 1.0, np.inf))
    at_the_end = updated(layer, look(5 * SECOND, nearer))
    assert near(at_the_end, 2.0) > 10
    assert near(updated(at_the_end, look(5 * SECOND + 1, nearer)), 2.0) == 0


def test_an_obstacle_seen_again_does_not_fade_or_multiply() -> None:
    layer = EMPTY
    for k in range(40):
        layer = updated(layer, look(k * SECOND, room(0.0)), forgotten_after_s=2.0)
    once = updated(EMPTY, look(0, room(0.0)))
    assert len(layer.points) == len(once.points)
    assert (layer.seen_ns == 39 * SECOND).all()


def test_a_scan_without_beams_clears_nothing() -> None:
    layer = updated(EMPTY, look(0, room(0.0)))
    nothing = sight_from_points(1, np.zeros(2), np.empty((0, 2)), np.empty(0, bool), BEAM)
    assert len(updated(layer, nothing).points) == len(layer.points)
    assert len(without(layer, np.ones(len(layer.points), bool)).points) == 0


def plain_passed(
    points: FloatArray,
    bearings: FloatArray,
    near: FloatArray,
    far: FloatArray,
    hits: BoolArray,
    half_angle: float,
    radius: float,
    behind: float,
) -> list[bool]:
    """The kernel in plain numpy, every beam against every point."""
    result = []
    for x, y in points:
        distance = math.hypot(x, y)
        if distance <= radius:
            result.append(False)
            continue
        away = np.abs(np.angle(np.exp(1j * (bearings - math.atan2(y, x)))))
        at = (away <= half_angle + math.asin(radius / distance)) & (near <= distance)
        went = at & (far > distance + behind)
        result.append(bool(went.any() and not (at & ~went & hits).any()))
    return result


@given(st.integers(0, 2**32 - 1), st.integers(0, 60))
@settings(max_examples=60, deadline=None)
def test_the_kernel_equals_plain_numpy(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-4, 4, (30, 2))
    points[0] = 0.0
    bearings = rng.uniform(-math.pi, math.pi, count)
    near = np.where(rng.random(count) < 0.3, rng.uniform(0, 4, count), 0.0)
    far, hits = near + rng.uniform(0, 6, count), rng.random(count) < 0.5
    arguments = points, bearings, near, far, hits, float(rng.uniform(0, 0.3)), 0.05, 0.1
    assert passed_points(*arguments).tolist() == plain_passed(*arguments)


def plain_between_heights(
    ends: FloatArray, kind: Bytes, lens: FloatArray, bottom: float, top: float, theta: float
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """The kernel in plain numpy, all beams at once."""
    known = np.isfinite(ends[..., 0])
    away, ground = ends[known] - lens, kind[known] == GROUND
    level = np.abs(away[:, 2]) < 1e-6
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.sort((np.array([[bottom], [top]]) - lens[2]) / np.where(level, np.nan, away[:, 2]), axis=0)
    within = bottom <= lens[2] <= top
    begin = np.where(level, 0.0 if within else np.inf, np.clip(shares[0], 0.0, None))
    end = np.where(level, 1.0 if within else -np.inf, np.clip(shares[1], None, 1.0))
    passes = end > begin
    away, begin, end = away[passes], begin[passes], end[passes]
    length = np.hypot(*away[:, :2].T)
    hits = (end >= 1.0) & (away[:, 2] + lens[2] >= bottom) & ~ground[passes]
    bearings = np.angle(np.exp(1j * (np.arctan2(away[:, 1], away[:, 0]) + theta)))
    return bearings, begin * length, end * length, hits


@given(st.integers(0, 2**32 - 1), st.floats(-0.2, 1.2))
@settings(max_examples=60, deadline=None)
def test_the_kernel_of_heights_equals_plain_numpy(seed: int, bottom: float) -> None:
    rng = np.random.default_rng(seed)
    ends = rng.uniform((-4.0, -4.0, -0.5), (4.0, 4.0, 1.8), (6, 8, 3))
    lens = np.array([0.4, 0.0, 0.95])
    ends[rng.random((6, 8)) < 0.1] = math.nan
    ends[rng.random((6, 8)) < 0.1, 2] = lens[2]
    arguments = ends, rng.integers(0, 5, (6, 8), np.uint8), lens, bottom, bottom + 0.4, float(rng.uniform(-4.0, 4.0))
    for found, plain in zip(between_heights(*arguments), plain_between_heights(*arguments), strict=True):
        assert found == pytest.approx(plain, abs=1e-9)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_the_kernel_of_the_ground_equals_plain_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    directions, foot = rng.uniform(-1, 1, (6, 8, 2)), rng.uniform(0.2, 3.0, (6, 8))
    foot[rng.random((6, 8)) < 0.2] = math.nan
    met, told, theta = rng.random((6, 8)) < 0.3, rng.random((6, 8)) < 0.7, float(rng.uniform(-4.0, 4.0))
    bearings, near, far, hits = on_ground(directions, foot, met, told, theta)
    counts = told & np.isfinite(foot)
    assert hits.tolist() == met[counts].tolist()
    assert np.exp(1j * bearings) == pytest.approx(np.exp(1j * (np.arctan2(*directions[counts].T[::-1]) + theta)))
    assert (np.abs(bearings) <= math.pi).all()
    assert near == pytest.approx(foot[counts] - 0.12)
    assert far == pytest.approx(foot[counts] + np.where(met[counts], 0.0, 0.12))


@given(st.integers(0, 2**32 - 1), st.integers(0, 12), st.integers(0, 12))
@settings(max_examples=100, deadline=None)
def test_a_nearer_point_is_found_among_all_pairs(seed: int, count: int, others: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, gap = rng.uniform(0, 5, (count, 2)), rng.uniform(0, 5, (others, 2)), float(rng.uniform(0.01, 2.0))
    plain = any(math.dist(first, second) < gap for first in a for second in b)
    assert any_nearer(a, b, gap) == plain


def test_a_scan_without_returns_leaves_an_empty_layer_empty() -> None:
    assert len(updated(EMPTY, look(0, np.full(720, 9.0))).points) == 0


def test_a_sonar_marks_its_whole_arc_and_clears_it_without_an_echo() -> None:
    mounts = (Pose2(0.75, 0.0, 0.0), Pose2(-0.25, 0.0, math.pi))
    pose = Pose2(10.0, 5.0, math.pi / 2)

    def heard(stamp_ns: int, *ranges: float) -> list[Sight]:
        readings = SonarReadings(stamp_ns, np.array(ranges, np.float32))
        return sights_from_sonar(readings, pose, mounts, 4.0, math.radians(15))

    layer = EMPTY
    for sight in heard(0, 1.0, math.inf):
        layer = updated(layer, sight)
    away = layer.points - (10.0, 5.75)
    np.testing.assert_allclose(np.hypot(*away.T), 1.0, atol=1e-6)
    assert np.ptp(np.arctan2(away[:, 0], away[:, 1])) == pytest.approx(math.radians(30), abs=0.01)
    assert heard(1, math.nan, -math.inf) == []
    ahead, _ = heard(1, math.inf, math.inf)
    assert len(updated(layer, ahead).points) == 0
    (behind,) = heard(1, math.nan, math.inf)
    assert len(updated(layer, behind).points) == len(layer.points)


def table_top(stamp_ns: int, depth_of_table: float) -> RgbdFrame:
    """A level camera 0.95 m up sees a far wall, the floor, and a board from 0.65 to 0.75 m high."""
    focal, height, width = 200.0, 120, 160
    rows = np.repeat(np.arange(height)[:, None], width, axis=1)
    down = (rows - height / 2) / focal
    depth = np.full((height, width), 4.0)
    with np.errstate(divide="ignore"):
        depth = np.where(down > 0, np.minimum(depth, 0.95 / down), depth)
        at_table = 0.95 - down * depth_of_table
    depth[(at_table > 0.65) & (at_table < 0.75)] = depth_of_table
    camera = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
    return RgbdFrame(stamp_ns, np.zeros((height, width), np.uint8), depth.astype(np.float32), camera)


def viewed(frame: RgbdFrame) -> GroundView:
    return ground_view(frame, LEVEL_CAMERA, CHAIR_A.front, step=2)


def test_a_table_top_is_at_the_height_of_the_arm_rests_only_and_the_floor_at_none() -> None:
    feet, arms = BodyLayer(0.0, 0.3, 0.75, 0.25, 0.3), BodyLayer(0.5, 1.2, 0.75, 0.25, 0.3)
    view = viewed(table_top(0, 1.5))
    seen = [sight_from_depth(view, Pose2(3.0, 2.0), layer, 0.06).points() for layer in (feet, arms)]
    table = 3.0 + CHAIR_A.camera_x + 1.5
    assert (np.abs(seen[1][:, 0] - table) < 0.01).sum() > 50
    assert not (np.abs(seen[0][:, 0] - table) < 0.05).any()
    assert (seen[0][:, 0] > table).all()


def test_a_removed_table_is_cleared_by_beams_at_its_height() -> None:
    arms = BodyLayer(0.5, 1.2, 0.75, 0.25, 0.3)
    first, then = (
        sight_from_depth(viewed(table_top(k, depth)), Pose2(), arms, 0.06) for k, depth in enumerate((1.5, 3.9))
    )
    layer = updated(EMPTY, first)
    ahead = np.abs(layer.points[:, 0] - CHAIR_A.camera_x - 1.5) < 0.05
    assert ahead.sum() > 5
    left = updated(layer, then).points
    assert not (np.abs(left[:, 0] - CHAIR_A.camera_x - 1.5) < 0.05).any()
