"""Contact and clearance of the chair's rectangle, against slow and plain geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair import CHAIR_A, CHAIR_B, ChairBody
from waychair.geometry import transform_points
from waychair.simulation.contact import Solid, clearance, in_contact, solid_from_grid
from waychair.types import FloatArray, OccupancyGrid, Pose2

RESOLUTION = 0.05


def _solid(*cells: tuple[int, int], origin: Pose2 | None = None, shape: tuple[int, int] = (80, 80)) -> Solid:
    values = np.zeros(shape, np.int8)
    for row, col in cells:
        values[row, col] = 100
    return solid_from_grid(OccupancyGrid(values, RESOLUTION, origin or Pose2()))


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


def _square(row: int, col: int, smaller: float = 0.0) -> FloatArray:
    low, high = np.array([col, row]) * RESOLUTION + smaller, np.array([col + 1, row + 1]) * RESOLUTION - smaller
    return np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])


@settings(max_examples=300, deadline=None)
@given(
    st.floats(1.5, 2.5),
    st.floats(1.5, 2.5),
    st.floats(-math.pi, math.pi),
    st.lists(st.tuples(st.integers(22, 58), st.integers(22, 58)), min_size=1, max_size=2),
    st.sampled_from([CHAIR_A, CHAIR_B]),
    st.booleans(),
)
def test_contact_and_clearance_equal_plain_polygon_geometry(
    x: float, y: float, theta: float, cells: list[tuple[int, int]], body: ChairBody, turned_map: bool
) -> None:
    origin = Pose2(-3.0, 7.0, 0.9) if turned_map else Pose2()
    solid = _solid(*cells, origin=origin)
    outline = transform_points(Pose2(x, y, theta), body.outline())
    expected = min(_distance(outline, _square(*cell)) for cell in cells)
    pose = origin @ Pose2(x, y, theta)
    assert clearance(solid, body, pose) == pytest.approx(expected, abs=1e-9)
    # Within a nanometre of touching, either answer is right.
    if expected > 1e-9:
        assert not in_contact(solid, body, pose)
    elif any(_distance(outline, _square(*cell, smaller=1e-9)) == 0.0 for cell in cells):
        assert in_contact(solid, body, pose)


def test_a_cell_wholly_under_the_chair_is_contact() -> None:
    assert in_contact(_solid((40, 40)), CHAIR_A, Pose2(1.9, 2.0, 0.3))


def test_contact_begins_at_the_front_and_not_at_the_origin() -> None:
    solid = _solid((40, 60))
    touching = 3.0 - CHAIR_A.front
    assert not in_contact(solid, CHAIR_A, Pose2(touching - 1e-6, 2.025, 0.0))
    assert in_contact(solid, CHAIR_A, Pose2(touching + 1e-6, 2.025, 0.0))
    assert clearance(solid, CHAIR_A, Pose2(touching - 0.3, 2.025, 0.0)) == pytest.approx(0.3)


def test_a_far_wall_is_found_across_a_large_world() -> None:
    solid = _solid((5, 990), shape=(1000, 1000))
    assert clearance(solid, CHAIR_A, Pose2(2.0, 0.275, 0.0)) == pytest.approx(990 * 0.05 - 2.0 - 0.75)


def test_unknown_cells_and_what_lies_beyond_the_grid_touch_nothing() -> None:
    solid = solid_from_grid(OccupancyGrid(np.full((80, 80), -1, np.int8), RESOLUTION))
    for pose in (Pose2(2.0, 2.0, 0.0), Pose2(-50.0, 9.0, 1.0)):
        assert not in_contact(solid, CHAIR_A, pose)
        assert clearance(solid, CHAIR_A, pose) == math.inf
