"""The first way: its floor distances and collision checks against plain ones, and ways through narrow places."""

from __future__ import annotations

import heapq
import math

import numpy as np
import pytest
from evaluation.best_time.comfort import comfort_of, straight_time, turn_time
from evaluation.best_time.first_way import _floor_distances, _is_clear, _raster, after, first_way, timed
from evaluation.best_time.gaps import surroundings

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import NoPath
from waychair.geometry import wrap_angle
from waychair.simulation.plan.world import load_world
from waychair.simulation.scene.contact import in_contact, solid_from_blocks
from waychair.simulation.scene.scene import Block
from waychair.types import Pose2

COMFORT = comfort_of()


def wall_with_gap(width: float) -> list[Block]:
    """Return a wall across x = 2 of the plane's strip |y| < 3, with a gap round y = 0, and walls beside the strip."""
    length = 3.0 - width / 2
    return [
        Block(Pose2(2.0, sign * (width / 2 + length / 2), 0.0), 0.15, length, 0.0, 2.0) for sign in (1.0, -1.0)
    ] + [Block(Pose2(2.0, sign * 3.05, 0.0), 8.0, 0.1, 0.0, 2.0) for sign in (1.0, -1.0)] + [
        Block(Pose2(x, 0.0, 0.0), 0.1, 6.2, 0.0, 2.0) for x in (-2.0, 6.0)
    ]  # fmt: skip


def test_floor_distances_are_those_of_a_plain_dijkstra() -> None:
    rng = np.random.default_rng(1)
    open_floor = rng.random((14, 17)) > 0.3
    open_floor[5, 6] = True
    plain = {(5, 6): 0.0}
    heap = [(0.0, (5, 6))]
    while heap:
        far, (i, j) = heapq.heappop(heap)
        for a in range(max(i - 1, 0), min(i + 2, 14)):
            for b in range(max(j - 1, 0), min(j + 2, 17)):
                farther = far + 0.05 * math.hypot(a - i, b - j)
                if open_floor[a, b] and farther < plain.get((a, b), math.inf) - 1e-9:
                    plain[a, b] = farther
                    heapq.heappush(heap, (farther, (a, b)))
    found = _floor_distances(open_floor, 5, 6)
    for cell in np.ndindex(14, 17):
        assert found[cell] == pytest.approx(plain.get(cell, math.inf), abs=1e-5)


def test_an_arc_is_clear_only_if_no_pose_on_it_touches_anything() -> None:
    solid = solid_from_blocks(wall_with_gap(0.8))
    around = surroundings(solid, CHAIR_A)
    raster = _raster(around, Pose2(0.0, 0.0, 0.0), Pose2(4.0, 0.0, 0.0))
    rng = np.random.default_rng(2)
    outcomes = []
    for _ in range(150):
        start = Pose2(rng.uniform(-1, 3), rng.uniform(-2, 2), rng.uniform(-3, 3))
        length, turn = rng.uniform(-0.4, 0.4), rng.uniform(-0.6, 0.6)
        touches = any(
            in_contact(solid, CHAIR_A, Pose2(*after(start.x, start.y, start.theta, share * length, share * turn)))
            for share in np.linspace(0.0, 1.0, 41)[1:]
        )
        clear = _is_clear(around, raster, start.x, start.y, start.theta, length, turn)
        outcomes.append((clear, not touches))
    # checked poses lie up to 4 cm apart, so that a corner may be cut by less than that; a clear arc is never refused
    assert all(clear for clear, free in outcomes if free)
    assert sum(clear and not free for clear, free in outcomes) <= 3
    assert 20 < sum(free for _, free in outcomes) < 130


def test_the_way_leads_through_a_door_of_the_chairs_width_and_fifteen_centimetres_and_not_through_a_smaller_one() -> (
    None
):
    start, goal = Pose2(0.0, 1.0, 1.0), Pose2(4.0, -1.0, -2.0)
    around = surroundings(solid_from_blocks(wall_with_gap(0.75)), CHAIR_A)
    way = first_way(around, start, goal, COMFORT)
    x, y, theta = start.x, start.y, start.theta
    for length, turn in way.moves:
        x, y, theta = after(x, y, theta, length, turn)
    assert math.hypot(x - goal.x, y - goal.y) <= 0.05
    assert abs(wrap_angle(theta - goal.theta)) <= 0.05
    with pytest.raises(NoPath, match="no way was found"):
        first_way(surroundings(solid_from_blocks(wall_with_gap(0.3)), CHAIR_A), start, goal, COMFORT)


def test_a_search_over_a_whole_building_is_not_filled_by_ways_that_take_equally_long() -> None:
    """From the bath all headings lead out of one door, by many ways of the same time, which must not be kept twice."""
    world = load_world("small_clinic").without_people()
    bath, ward = (next(place.pose for place in world.places if place.name == name) for name in ("bath", "ward"))
    around = surroundings(solid_from_blocks(world.blocks, world.pits), CHAIR_A)
    assert 15.0 < first_way(around, bath, ward, COMFORT).seconds < 22.0


def test_a_start_in_a_wall_is_named() -> None:
    around = surroundings(solid_from_blocks(wall_with_gap(0.8)), CHAIR_A)
    with pytest.raises(NoPath, match=r"touches something at the start \(2, 2\)"):
        first_way(around, Pose2(2.0, 2.0, 0.0), Pose2(0.0, 0.0, 0.0), COMFORT)


def test_the_rough_times_of_a_line_and_a_turn_are_those_without_jerk() -> None:
    around = surroundings(solid_from_blocks([]), CHAIR_A)
    line, _ = timed(first_way(around, Pose2(), Pose2(5.0, 0.0, 0.0), COMFORT), COMFORT, 0.25, 360)
    assert 0.8 * straight_time(5.0, COMFORT) < line < straight_time(5.0, COMFORT)
    turn, _ = timed(first_way(around, Pose2(), Pose2(0.0, 0.0, 2.0), COMFORT), COMFORT, 0.25, 360)
    assert 0.9 * turn_time(2.0, COMFORT) < turn < turn_time(2.0, COMFORT)
