"""Contact and clearance of the chair's rectangle, against slow and plain geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.geometry import rectangle, transform_points
from waychair.simulation.scene.contact import (
    HIGHEST,
    LOWEST,
    SolidBoxes,
    clearance,
    in_contact,
    nearest_point,
    person_distance,
    solid_from_blocks,
)
from waychair.simulation.scene.scene import Block, PersonBehaviour, PersonState, Pit
from waychair.types import FloatArray, Pose2


def _block(x: float, y: float, theta: float = 0.0, length: float = 0.1, width: float = 0.1) -> Block:
    return Block(Pose2(x, y, theta), length, width, 0.0, 2.0)


def _corners(block: Block, smaller: float = 0.0) -> FloatArray:
    half_length, half_width = block.length / 2 - smaller, block.width / 2 - smaller
    return transform_points(block.middle, rectangle(half_length, half_length, half_width))


def _point_to_segment(point: FloatArray, a: FloatArray, b: FloatArray) -> float:
    part = np.clip(np.dot(point - a, b - a) / np.dot(b - a, b - a), 0.0, 1.0)
    return float(np.linalg.norm(point - a - part * (b - a)))


def _inside(point: FloatArray, polygon: FloatArray) -> bool:
    edges = np.roll(polygon, -1, axis=0) - polygon
    to_point = point - polygon
    return bool((edges[:, 0] * to_point[:, 1] - edges[:, 1] * to_point[:, 0] >= 0).all())


def _crossing(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> bool:
    def side(p: FloatArray, q: FloatArray, r: FloatArray) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0


def _distance(first: FloatArray, second: FloatArray) -> float:
    """Distance of two convex polygons by their edges; 0 where they meet."""
    if any(_inside(p, second) for p in first) or any(_inside(p, first) for p in second):
        return 0.0
    best = math.inf
    for i in range(len(first)):
        for j in range(len(second)):
            a, b, c, d = first[i - 1], first[i], second[j - 1], second[j]
            if _crossing(a, b, c, d):
                return 0.0
            best = min(best, _point_to_segment(a, c, d), _point_to_segment(c, a, b))
    return best


_blocks = st.builds(
    _block,
    st.floats(-3.0, 3.0),
    st.floats(-3.0, 3.0),
    st.sampled_from([0.0, math.pi / 2]) | st.floats(-math.pi, math.pi),
    st.floats(0.02, 4.0),
    st.floats(0.02, 1.0),
)


@settings(max_examples=300)
@given(
    st.floats(-4.0, 4.0),
    st.floats(-4.0, 4.0),
    st.floats(-math.pi, math.pi),
    st.lists(_blocks, min_size=1, max_size=3),
    st.sampled_from([CHAIR_A, CHAIR_B]),
)
def test_contact_and_clearance_equal_plain_polygon_geometry(
    x: float, y: float, theta: float, blocks: list[Block], body: ChairBody
) -> None:
    solid, pose = solid_from_blocks(blocks), Pose2(x, y, theta)
    outline = transform_points(pose, body.outline())
    expected = min(_distance(outline, _corners(block)) for block in blocks)
    assert clearance(solid, body, pose) == pytest.approx(expected, abs=1e-9)
    # Within a nanometre of touching, either answer is right.
    if expected > 1e-9:
        assert not in_contact(solid, body, pose)
        point = np.array(nearest_point(solid, body, pose))
        assert min(_point_to_segment(point, *edge) for edge in _edges(outline)) == pytest.approx(expected, abs=1e-9)
        assert min(_point_to_segment(point, *edge) for b in blocks for edge in _edges(_corners(b))) < 1e-9
    elif any(_distance(outline, _corners(block, smaller=1e-9)) == 0.0 for block in blocks):
        assert in_contact(solid, body, pose)


def _edges(polygon: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    return [(polygon[i - 1], polygon[i]) for i in range(len(polygon))]


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_among_many_blocks_the_answers_equal_those_of_a_full_search(seed: int) -> None:
    rng = np.random.default_rng(seed)
    blocks = [
        _block(*rng.uniform((0, 0, -math.pi, 0.05, 0.05), (30, 20, math.pi, 3.0, 0.5)).tolist()) for _ in range(200)
    ]
    all_of_them = solid_from_blocks(blocks)
    each = [solid_from_blocks([block]) for block in blocks]
    for x, y, theta in rng.uniform((-5, -5, -math.pi), (35, 25, math.pi), (10, 3)).tolist():
        pose = Pose2(x, y, theta)
        assert in_contact(all_of_them, CHAIR_A, pose) == any(in_contact(one, CHAIR_A, pose) for one in each)
        assert clearance(all_of_them, CHAIR_A, pose) == min(clearance(one, CHAIR_A, pose) for one in each)


def test_a_block_completely_under_the_chair_is_a_contact() -> None:
    assert in_contact(solid_from_blocks([_block(2.0, 2.0)]), CHAIR_A, Pose2(1.9, 2.0, 0.3))


def test_a_bar_across_the_chair_is_a_contact_even_without_a_corner_inside_the_other() -> None:
    bar = solid_from_blocks([_block(0.25, 0.0, math.pi / 2, length=3.0)])
    assert in_contact(bar, CHAIR_A, Pose2())
    assert clearance(bar, CHAIR_A, Pose2()) == 0.0


def test_contact_starts_at_the_front_and_not_at_the_origin() -> None:
    solid = solid_from_blocks([_block(3.05, 2.0)])
    touching = 3.0 - CHAIR_A.front
    assert not in_contact(solid, CHAIR_A, Pose2(touching - 1e-6, 2.0, 0.0))
    assert in_contact(solid, CHAIR_A, Pose2(touching + 1e-6, 2.0, 0.0))
    assert clearance(solid, CHAIR_A, Pose2(touching - 0.3, 2.0, 0.0)) == pytest.approx(0.3)


def test_an_oblique_wall_is_touched_at_its_face_to_the_micrometre() -> None:
    wall = solid_from_blocks([_block(0.0, 0.0, 0.7, length=6.0, width=0.2)])
    for gap in (1e-6, 0.01, 0.4):
        square_on = Pose2(0.0, 0.0, 0.7) @ Pose2(0.0, -0.1 - gap - CHAIR_A.front, math.pi / 2)
        assert clearance(wall, CHAIR_A, square_on) == pytest.approx(gap, abs=1e-9)
        assert not in_contact(wall, CHAIR_A, square_on)
        assert in_contact(wall, CHAIR_A, square_on @ Pose2(gap + 1e-6, 0.0, 0.0))


def test_a_far_wall_is_found_across_a_large_world() -> None:
    solid = solid_from_blocks([_block(990.0, 0.0), _block(-1800.0, 0.0)])
    assert clearance(solid, CHAIR_A, Pose2(2.0, 0.0, 0.0)) == pytest.approx(990.0 - 0.05 - 2.0 - 0.75)


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0.0, 2.0, True),
        (0.0, LOWEST, False),
        (0.0, LOWEST + 1e-3, True),
        (HIGHEST, 2.0, False),
        (HIGHEST - 1e-3, 2.0, True),
        (-0.2, 0.0, False),
    ],
)
def test_only_blocks_at_the_height_of_the_chair_are_solid(low: float, high: float, expected: bool) -> None:
    solid = solid_from_blocks([Block(Pose2(), 1.0, 1.0, low, high)])
    assert in_contact(solid, CHAIR_A, Pose2()) == expected


def test_a_pit_is_solid() -> None:
    solid = solid_from_blocks([], [Pit(Pose2(2.0, 0.0), 1.0, 1.0, depth=3.0)])
    assert clearance(solid, CHAIR_A, Pose2()) == pytest.approx(1.5 - CHAIR_A.front)


def test_without_blocks_there_is_no_contact() -> None:
    nothing = solid_from_blocks([])
    for pose in (Pose2(), Pose2(2.0, 2.0, 0.0), Pose2(-50.0, 9.0, 1.0)):
        assert not in_contact(nothing, CHAIR_A, pose)
        assert clearance(nothing, CHAIR_A, pose) == math.inf
        assert np.isnan(nearest_point(nothing, CHAIR_A, pose)).all()


def test_the_nearest_point_is_on_the_block_about_to_be_touched() -> None:
    wall: SolidBoxes = solid_from_blocks([_block(2.0, 0.3, length=0.2, width=4.0)])
    x, y = nearest_point(wall, CHAIR_A, Pose2(1.0, 0.0, 0.0))
    assert x == pytest.approx(1.9)
    assert abs(y) <= CHAIR_A.width / 2 + 1e-9


def _person(x: float, y: float, radius: float = 0.25) -> PersonState:
    return PersonState(Pose2(x, y), 1.0, 0.0, radius, PersonBehaviour.PATH)


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-math.pi, math.pi), st.floats(0.05, 0.5))
def test_distance_to_a_person_equals_plain_polygon_geometry(x: float, y: float, theta: float, radius: float) -> None:
    outline = transform_points(Pose2(0.4, -0.7, theta), CHAIR_A.outline())
    centre = np.array([x, y])
    apart = 0.0 if _inside(centre, outline) else min(_point_to_segment(centre, *edge) for edge in _edges(outline))
    expected = max(apart - radius, 0.0)
    assert person_distance(CHAIR_A, Pose2(0.4, -0.7, theta), [_person(x, y, radius)]) == pytest.approx(
        expected, abs=1e-9
    )


def test_the_nearest_of_several_people_counts_and_without_people_the_distance_is_infinite() -> None:
    assert person_distance(CHAIR_A, Pose2(), [_person(5.0, 0.0), _person(2.0, 0.0)]) == pytest.approx(1.0)
    assert person_distance(CHAIR_A, Pose2(), []) == math.inf
