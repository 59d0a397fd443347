"""The rectangle against brute force: never a false "free", and few false contacts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, BodyLayer, ChairBody
from waychair.geometry import rectangle, transform_points
from waychair.maps.grid.distance_field import DistanceField, distances
from waychair.planning.body.arc_fan import free_times
from waychair.planning.body.footprint import (
    along_arc,
    eased_footprint,
    fits,
    fits_each,
    footprint,
    free_time,
    in_cells,
    room,
    side_clearance,
)
from waychair.types import BoolArray, FloatArray, Pose2

CELL = 0.05
SIZE = 80


def field_of(obstacles: BoolArray, origin: Pose2 | None = None) -> DistanceField:
    return DistanceField(distances(obstacles, CELL), CELL, origin or Pose2())


def obstacle_squares(obstacles: BoolArray) -> FloatArray:
    """(N, 4, 2) corners [m] of the occupied cells, counter-clockwise."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    squares: FloatArray = (np.argwhere(obstacles)[:, None, ::-1] + corners) * CELL
    return squares


def gap(body: ChairBody, pose: Pose2, squares: FloatArray) -> float:
    """Largest separation [m] along any side's normal (separating axes) to the nearest square; <= 0 means contact.

    A lower bound of the true distance, exact in sign.
    """
    return separation(body.outline(), pose, squares)


def separation(corners: FloatArray, pose: Pose2, squares: FloatArray) -> float:
    """Return the same for a rectangle with its corners (4, 2) [m] in base."""
    outline = transform_points(pose, corners)
    angles = [pose.theta, pose.theta + math.pi / 2, 0.0, math.pi / 2]
    axes = np.array([[math.cos(a), math.sin(a)] for a in angles])
    mine, theirs = outline @ axes.T, squares @ axes.T
    apart = np.maximum(theirs.min(axis=1) - mine.max(axis=0), mine.min(axis=0) - theirs.max(axis=1))
    return float(apart.max(axis=1).min())


def scattered(rng: np.random.Generator, density: float) -> BoolArray:
    obstacles: BoolArray = rng.random((SIZE, SIZE)) < density
    obstacles[0, 0] = True
    return obstacles


def halved(x: float, y: float, a: float, b: float) -> list[tuple[tuple[float, ...], int]]:
    """Return a rectangle of half sides a, b and the halves below it, each with its number of parts."""
    below = []
    if math.hypot(a, b) > 0.5:
        halves = ((x + a / 2, y), (x - a / 2, y)) if a >= b else ((x, y - b / 2), (x, y + b / 2))
        sides = (a / 2, b) if a >= b else (a, b / 2)
        below = [part for half in halves for part in halved(*half, *sides)]
    return [((x, y, math.hypot(a, b), min(a, b)), 1 + len(below)), *below]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_B])
@pytest.mark.parametrize(("margin", "cell"), [(0.0, 0.05), (0.03, 0.02), (-0.01, 0.01)])
def test_the_discs_equal_those_of_plain_halving(body: ChairBody, margin: float, cell: float) -> None:
    field = DistanceField(distances(np.eye(3, dtype=bool), cell), cell, Pose2())
    front, rear, half = (side / cell for side in (body.front + margin, body.rear + margin, body.width / 2 + margin))
    parts = halved((front - rear) / 2, 0.0, (front + rear) / 2, half)
    shape = footprint(body, margin, field)
    assert shape.discs == pytest.approx(np.array([disc for disc, _ in parts]), abs=1e-9)
    assert shape.skip.tolist() == [k + count for k, (_, count) in enumerate(parts)]


def test_a_margin_is_reduced_for_near_obstacles_but_not_for_those_inside_the_outline() -> None:
    for cell in (0.01, 0.02, 0.05):
        eases = {}
        for gap_m in (0.6 * cell, -1.5 * cell):
            obstacles = np.zeros((round(4.0 / cell),) * 2, np.bool_)
            obstacles[:, math.ceil((2.0 + CHAIR_B.front + gap_m) / cell - 1e-9) :] = True
            field = DistanceField(distances(obstacles, cell), cell, Pose2())
            shape, ease = eased_footprint(CHAIR_B, 0.03, field, Pose2(2.0, 2.0, 0.0))
            eases[gap_m] = ease
            if gap_m < 0.0:  # full margin: the chair is in contact, and no arc is admissible
                assert shape.discs[0, 2] == footprint(CHAIR_B, 0.03, field).discs[0, 2]
        assert 0.0 < eases[0.6 * cell] <= 0.03 + cell + 1e-9
        assert eases[-1.5 * cell] == 0.0


@given(st.integers(0, 2**32 - 1), st.sampled_from([CHAIR_A, CHAIR_B]))
@settings(max_examples=60, deadline=None)
def test_a_pose_called_free_never_touches_an_occupied_cell(seed: int, body: ChairBody) -> None:
    rng = np.random.default_rng(seed)
    obstacles = scattered(rng, float(rng.choice([0.0005, 0.002, 0.01])))
    field, squares = field_of(obstacles), obstacle_squares(obstacles)
    for x, y, theta in rng.uniform((1.2, 1.2, -4), (2.8, 2.8, 4), (40, 3)):
        separation = gap(body, Pose2(x, y, theta), squares)
        free = fits(body, 0.0, field, Pose2(x, y, theta))
        assert not free or separation > 0
        # A pose called occupied has an obstacle within the slack and a leaf's overhang of its outline.
        assert free or separation < 1.7 * CELL


FEET, ARMS = BodyLayer(0.0, 0.3, 0.5, 0.2, 0.2), BodyLayer(0.6, 1.4, 0.4, 0.25, 0.27)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_obstacles_at_the_heights_of_a_layer_must_be_clear_of_that_layer_only(seed: int) -> None:
    """By brute force: each outline against its own obstacles, by three footprints at once as by each for itself."""
    rng = np.random.default_rng(seed)
    masks = [scattered(rng, float(rng.choice([0.0005, 0.002, 0.01]))) for _ in range(3)]
    feet, arms = (field_of(mask).metres for mask in masks[1:])
    field = replace(field_of(masks[0]), layers=((FEET, feet), (ARMS, arms)))
    squares = [obstacle_squares(mask) for mask in masks]
    sides = [(CHAIR_A.front, CHAIR_A.rear, CHAIR_A.width / 2), *((each[2], each[3], each[4]) for each in (FEET, ARMS))]
    arcs = rng.uniform((-0.4, -0.8), (0.8, 0.8), (30, 2))
    shape = footprint(CHAIR_A, 0.0, field)
    for pose in (Pose2(*row) for row in rng.uniform((1.2, 1.2, -4), (2.8, 2.8, 4), (20, 3)).tolist()):
        gaps = [separation(rectangle(*side), pose, each) for side, each in zip(sides, squares, strict=True)]
        free = fits(CHAIR_A, 0.0, field, pose)
        assert not free or min(gaps) > 0.0
        assert free or min(gaps) < 1.7 * CELL
        assert (room(shape, *in_cells(field, pose).tolist(), 0.0) >= 0.0) is free
    start, certain = in_cells(field, Pose2(2.0, 2.0, 0.3)), np.full(30, 2.5)
    times = free_times(shape, start, arcs, certain, 2.5)
    for (v, omega), seconds in zip(arcs, times, strict=True):
        for t in np.linspace(0.0, seconds, 40) if seconds > 0.0 else ():
            at = Pose2(*along_arc(2.0, 2.0, 0.3, v, omega, t))
            assert all(separation(rectangle(*side), at, each) > 0.0 for side, each in zip(sides, squares, strict=True))


def test_many_poses_checked_together_fit_like_each_alone() -> None:
    rng = np.random.default_rng(2)
    field = field_of(rng.random((SIZE, SIZE)) < 0.003, Pose2(-0.7, 0.4, 0.3))
    poses = rng.uniform((-0.5, 0.5, -4.0), (3.0, 4.0, 4.0), (300, 3))
    found = fits_each(CHAIR_A, 0.02, field, poses)
    assert found.tolist() == [fits(CHAIR_A, 0.02, field, Pose2(*pose)) for pose in poses.tolist()]
    assert 20 < found.sum() < 280
    assert fits_each(CHAIR_A, 0.02, field, np.empty((0, 3))).tolist() == []


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_an_arc_called_free_is_free_at_every_instant(seed: int) -> None:
    rng = np.random.default_rng(seed)
    obstacles = scattered(rng, 0.002)
    field, squares = field_of(obstacles), obstacle_squares(obstacles)
    shape = footprint(CHAIR_A, 0.0, field)
    for x, y, theta, v, omega in rng.uniform((1.2, 1.2, -4, -0.5, -1), (2.8, 2.8, 4, 0.8, 1), (8, 5)):
        start = in_cells(field, Pose2(x, y, theta))
        free = free_time(shape, start, v / CELL, omega, 2.5, 2.5)
        assert 0 <= free <= 2.5
        if free > 0:
            for t in np.linspace(0, free, 120):
                assert gap(CHAIR_A, Pose2(*along_arc(x, y, theta, v, omega, t)), squares) > 0


def test_the_distance_to_a_wall_ahead_is_found_to_within_a_few_centimetres() -> None:
    obstacles = np.zeros((SIZE, SIZE), bool)
    obstacles[:, 60] = True  # its near face is at 3.00 m
    field = field_of(obstacles)
    start = in_cells(field, Pose2(1.0, 2.0))
    free = 0.5 * free_time(footprint(CHAIR_A, 0.0, field), start, 0.5 / CELL, 0.0, 9.0, 9.0)
    assert 1.25 - 0.10 < free <= 1.25


def test_the_swing_out_of_the_front_is_seen_and_the_rear_has_none() -> None:
    """A wall 5 cm beyond the turning circle of the rear but inside that of the front bars turning only there."""
    ahead, behind = np.zeros((SIZE, SIZE), bool), np.zeros((SIZE, SIZE), bool)
    ahead[:, 40 + 16], behind[:, 40 - 12] = True, True  # 0.80 m ahead; 0.55 m behind (near faces) of the axle
    for obstacles, free in ((ahead, False), (behind, True)):
        field = field_of(obstacles)
        start = in_cells(field, Pose2(2.0, 2.0))
        turned = free_time(footprint(CHAIR_A, 0.0, field), start, 0.0, 1.0, math.pi / 2, math.pi / 2)
        assert (turned == math.pi / 2) is free


def test_an_obstacle_completely_inside_the_outline_is_found() -> None:
    obstacles = np.zeros((SIZE, SIZE), bool)
    obstacles[40, 45] = True
    assert not fits(CHAIR_A, 0.0, field_of(obstacles), Pose2(2.0, 2.0))


def test_a_pose_partly_outside_of_the_field_is_not_free() -> None:
    field = field_of(np.zeros((SIZE, SIZE), bool))
    assert fits(CHAIR_A, 0.0, field, Pose2(2.0, 2.0))
    for outside in (Pose2(3.6, 2.0), Pose2(2.0, 3.6, 1.6), Pose2(0.6, 2.0, 3.1), Pose2(2.0, 0.2), Pose2(9.0, 9.0)):
        assert not fits(CHAIR_A, 0.0, field, outside)


@pytest.mark.parametrize("width", [0.80, 0.85, 0.90])
def test_the_chair_fits_straight_through_doors(width: float) -> None:
    obstacles = np.zeros((SIZE, SIZE), bool)
    half = width / CELL / 2
    for row in range(SIZE):
        obstacles[row, 39:42] = abs(row + 0.5 - 40) > half
    assert fits(CHAIR_A, 0.01, field_of(obstacles), Pose2(2.0, 2.0))


def test_the_field_may_be_rotated_in_the_map() -> None:
    obstacles = np.zeros((SIZE, SIZE), bool)
    obstacles[40, 56] = True
    origin = Pose2(3.0, -2.0, 0.9)
    field = field_of(obstacles, origin)
    assert not fits(CHAIR_A, 0.0, field, origin @ Pose2(2.1, 2.0, 0.0))
    assert fits(CHAIR_A, 0.0, field, origin @ Pose2(2.1, 2.0, math.pi / 2))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_room_equals_its_plain_reference(seed: int) -> None:
    """The least clearance of the leaves when all fit is never less than that of the tree walk, and signs agree."""
    rng = np.random.default_rng(seed)
    obstacles = scattered(rng, 0.003)
    field = field_of(obstacles)
    shape = footprint(CHAIR_A, 0.0, field)
    leaves = shape.discs[shape.skip == np.arange(len(shape.skip)) + 1]
    for x, y, theta in rng.uniform((24, 24, -4), (56, 56, 4), (20, 3)):
        c, s = math.cos(theta), math.sin(theta)
        at = np.column_stack([x + c * leaves[:, 0] - s * leaves[:, 1], y + s * leaves[:, 0] + c * leaves[:, 1]])
        border = np.minimum(at, SIZE - at).min(axis=1)
        distance = np.minimum(plain_bilinear(field.metres.astype(float), at) / CELL, border)
        plain = distance - leaves[:, 2] - 1.0
        found = room(shape, x, y, theta, 99.0)
        assert (found < 0) == (plain.min() < 0)
        assert found < 0 or found == pytest.approx(plain.min(), abs=1e-6)


def plain_bilinear(metres: FloatArray, at: FloatArray) -> FloatArray:
    """Bilinear interpolation with numpy; no point near the border is asked for."""
    x, y = at.T - 0.5
    left, below = np.floor(x).astype(int), np.floor(y).astype(int)
    x, y = x - left, y - below
    result: FloatArray = (
        metres[below, left] * (1 - x) * (1 - y)
        + metres[below, left + 1] * x * (1 - y)
        + metres[below + 1, left] * (1 - x) * y
        + metres[below + 1, left + 1] * x * y
    )
    return result


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(0, 3))
@settings(max_examples=60, deadline=None)
def test_an_arc_equals_the_sum_of_small_steps(v: float, omega: float, t: float) -> None:
    pose, steps = Pose2(1.0, -2.0, 0.4), 2000
    for _ in range(steps):
        half = pose.theta + omega * t / steps / 2
        pose = Pose2(
            pose.x + v * t / steps * math.cos(half),
            pose.y + v * t / steps * math.sin(half),
            pose.theta + omega * t / steps,
        )
    np.testing.assert_allclose(along_arc(1.0, -2.0, 0.4, v, omega, t), pose.array(), atol=1e-6)


def test_the_distance_beside_is_measured_from_the_long_sides() -> None:
    obstacles = np.zeros((SIZE, SIZE), bool)
    obstacles[54] = True  # centres 0.725 m left of the axis
    field = field_of(obstacles)
    shape = footprint(CHAIR_A, 0.0, field)
    x, y, _ = in_cells(field, Pose2(2.0, 2.0))
    assert side_clearance(shape, x, y, 1.0, 0.0) == pytest.approx(0.425, abs=1e-6)
