"""The flowing line keeps its room round corners and beside zones, begins and ends in its headings, and may be interrupted."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import PlanningError
from waychair.geometry import arc_lengths, evenly_spaced, wrap_angle
from waychair.maps.drawn.zones import Rule, Zone
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.planning.route.flowing_line import CELLS_A_POINT, STEPS, flowing
from waychair.planning.route.global_planner import GlobalPlanner
from waychair.planning.route.rooms import rooms_beside
from waychair.planning.route.speed_profile import ROOMS, curvatures
from waychair.resumable import finished
from waychair.types import FloatArray, OccupancyGrid, Pose2

CELL, PRICE = 0.05, 40000.0


def square(size: float = 8.0, *boxes: tuple[float, float, float, float]) -> OccupancyGrid:
    """A room with walls round it and boxes (x0, y0, x1, y1) [m] in it."""
    count = round(size / CELL)
    cells = np.zeros((count, count), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    for x0, y0, x1, y1 in boxes:
        cells[round(y0 / CELL) : round(y1 / CELL), round(x0 / CELL) : round(x1 / CELL)] = 100
    return OccupancyGrid(cells, CELL)


ROUND_A_CORNER = np.array([[1.5, 1.0], [1.5, 4.8], [6.5, 4.8]])
CORNER = costmap_from_grid(square(8.0, (2.2, 0.5, 7.9, 4.1)), CHAIR_A)


def bent(costmap: Costmap, line: FloatArray, **ends: float) -> FloatArray:
    settled = finished(flowing(line, costmap.field, costmap.body, price=2000.0, **ends))
    return finished(flowing(settled[:, :2], costmap.field, costmap.body, price=PRICE, **ends))


def test_round_a_corner_the_line_keeps_its_room_and_turns_gently() -> None:
    poses = bent(CORNER, ROUND_A_CORNER)
    assert finished(rooms_beside(CORNER, poses)).min() >= 0.08
    turns = np.abs(np.diff(np.unwrap(poses[:, 2]))) / np.maximum(np.diff(arc_lengths(poses[:, :2])), 1e-9)
    assert turns[1:-1].max() < 1 / 0.5, "no bend is tighter than half a metre"
    assert arc_lengths(poses[:, :2])[-1] < arc_lengths(ROUND_A_CORNER)[-1]
    np.testing.assert_allclose(poses[[0, -1], :2], ROUND_A_CORNER[[0, -1]], atol=1e-9)


def test_fixed_headings_at_the_ends_are_kept_without_a_kink() -> None:
    line = np.array([[1.5, 1.5], [6.0, 6.0]])
    poses = bent(costmap_from_grid(square(), CHAIR_A), line, leaves=0.0, arrives=math.pi / 2)
    assert poses[0, 2] == pytest.approx(0.0)
    assert wrap_angle(float(poses[-1, 2]) - math.pi / 2) == pytest.approx(0.0, abs=1e-9)
    assert np.abs(np.diff(np.unwrap(poses[:, 2]))).max() < 0.2


def test_where_the_chair_stands_the_line_bends_at_once() -> None:
    field, line = costmap_from_grid(square(), CHAIR_A).field, np.array([[1.5, 1.5], [6.0, 6.0]])

    def made(stands: bool) -> FloatArray:
        return finished(flowing(line, field, CHAIR_A, 0.0, math.pi / 2, price=PRICE, stands=(stands, stands)))

    on_the_move, standing = made(False), made(True)
    assert abs(curvatures(standing)[[1, -2]]).min() > 1.5 * abs(curvatures(on_the_move)[[1, -2]]).max()
    assert standing[[0, -1], 2] == pytest.approx([0.0, math.pi / 2]), "the headings are kept"
    assert arc_lengths(standing[:, :2])[-1] < arc_lengths(on_the_move[:, :2])[-1]


def test_backwards_the_body_heads_against_the_way() -> None:
    line = np.array([[6.0, 2.0], [2.0, 2.0]])
    poses = finished(flowing(line, costmap_from_grid(square(), CHAIR_A).field, CHAIR_A, 0.0, 0.0, backwards=True))
    assert np.abs([wrap_angle(theta) for theta in poses[:, 2].tolist()]).max() < 0.02


def test_a_push_on_the_front_turns_the_chair_away() -> None:
    """A post beside the front only: the line passes it with its outline, not with a disc."""
    costmap = costmap_from_grid(square(8.0, (4.0, 4.42, 4.1, 4.52)), CHAIR_A)
    poses = bent(costmap, np.array([[1.5, 4.0], [6.5, 4.0]]))
    assert finished(rooms_beside(costmap, poses)).min() >= 0.1


@pytest.mark.parametrize("rule", [Rule.SLOW, Rule.ONE_WAY])
def test_a_line_round_a_zone_stays_out_of_it(rule: Rule) -> None:
    """The wall on the other side pushes the line towards the zone."""
    corners = np.array([[2.0, 2.0], [6.0, 2.0], [6.0, 4.0], [2.0, 4.0]])
    value = 0.2 if rule is Rule.SLOW else math.pi
    costmap = costmap_from_grid(square(8.0, (2.5, 4.45, 5.5, 4.6)), CHAIR_A, zones=[Zone("ward", rule, corners, value)])
    assert costmap.from_zones is not None
    line = np.array([[1.0, 4.1], [7.0, 4.1]])
    inside = []
    for zones in (costmap.from_zones, np.empty((0, 0), np.float32)):
        poses = finished(flowing(line, costmap.field, CHAIR_A, price=PRICE, from_zones=zones))
        inside.append(((np.abs(poses[:, 0] - 4.0) < 2.0) & (poses[:, 1] < 4.0)).sum())
    assert inside[0] == 0
    assert inside[1] > 5, "without the zone it would go there"


def test_a_line_may_be_interrupted_after_bounded_work() -> None:
    work, parts = flowing(ROUND_A_CORNER, CORNER.field, CHAIR_A, price=PRICE), []
    while True:
        try:
            parts.append(next(work))
        except StopIteration as done:
            once = finished(flowing(ROUND_A_CORNER, CORNER.field, CHAIR_A, price=PRICE))
            np.testing.assert_array_equal(done.value, once)
            break
    assert 1 <= len(parts) <= 4
    assert max(parts) <= 130 * STEPS * CELLS_A_POINT


@given(st.integers(0, 1000))
@settings(max_examples=10)
def test_every_planned_line_has_the_room_that_it_tells(seed: int) -> None:
    rng = np.random.default_rng(seed)
    boxes = [(x, y, x + 0.3, y + 0.3) for x, y in rng.uniform(2.0, 6.0, (4, 2))]
    costmap = costmap_from_grid(square(8.0, *boxes), CHAIR_A)
    planner = GlobalPlanner(Pose2(6.8, 6.8, 0.5))
    try:
        planner.replan(costmap, Pose2(1.2, 1.2, 0.7))
    except PlanningError:
        return
    for leg in planner.legs:
        assert leg.rooms is not None
        assert len(leg.rooms) == len(leg.path.poses)
        assert set(np.round(leg.rooms, 3)) <= {-1.0, *ROOMS}
        assert leg.rooms[1:-1].min(initial=1.0) >= 0.0


def test_points_are_spaced_evenly_between_the_ends() -> None:
    points = evenly_spaced(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]), 0.3)
    np.testing.assert_allclose(points[[0, -1]], [[0.0, 0.0], [1.0, 1.0]])
    assert np.hypot(*np.diff(points, axis=0).T).max() <= 0.3
