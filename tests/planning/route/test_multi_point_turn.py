"""Multi-point turns: free all the way by an independent check, and refused where nothing fits."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A, CHAIR_A_FRONT, CHAIR_A_MID, CHAIR_B, BodyLayer, ChairBody
from waychair.errors import NoPath
from waychair.geometry import rectangle, transform_points
from waychair.maps.drawn.zones import Rule, Zone, zone_contains
from waychair.maps.grid.cells import cells_from_points, inside, occupied
from waychair.planning.body.footprint import fits
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.planning.grid.fine_distances import FINEST, fine_field
from waychair.planning.route import multi_point_turn as manoeuvre_module
from waychair.planning.route.global_planner import GlobalPlanner
from waychair.planning.route.multi_point_turn import ManoeuvreAttempt, manoeuvre, manoeuvre_resumably
from waychair.types import FloatArray, OccupancyGrid, Pose2


def room(width: float, height: float, *boxes: tuple[float, float, float, float]) -> OccupancyGrid:
    """A walled room with boxes (x0, y0, x1, y1) [m] in it, on cells of 2.5 cm."""
    cells = np.zeros((round(height / 0.025), round(width / 0.025)), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    for x0, y0, x1, y1 in boxes:
        cells[round(y0 / 0.025) : round(y1 / 0.025), round(x0 / 0.025) : round(x1 / 0.025)] = 100
    return OccupancyGrid(cells, 0.025)


DEAD_END = room(5.0, 2.5, (0.0, 0.0, 5.0, 0.5), (0.0, 2.0, 5.0, 2.5), (4.5, 0.0, 5.0, 2.5))


def touches(grid: OccupancyGrid, body: ChairBody, pose: FloatArray) -> bool:
    """Return whether any point of the rectangle, sampled every centimetre, lies in an occupied cell."""
    corners = rectangle(body.front, body.rear, body.width / 2)
    x, y = (np.arange(corners[:, k].min(), corners[:, k].max() + 1e-9, 0.01) for k in (0, 1))
    points = transform_points(Pose2(*pose), np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    cells = cells_from_points(grid, points)
    return not inside(grid, cells).all() or bool(occupied(grid)[cells[:, 0], cells[:, 1]].any())


@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_B, CHAIR_A_MID, CHAIR_A_FRONT], ids=lambda body: body.chair_id)
def test_a_multi_point_turn_in_a_dead_end_touches_nothing_and_can_be_driven(body: ChairBody) -> None:
    start, goal = Pose2(4.3 - body.front, 1.2, 0.05), Pose2(1.5, 1.25, math.pi)
    poses = manoeuvre(fine_field(DEAD_END, Pose2(2.5, 1.25), 3.0), body, start, goal)
    assert poses[0] == pytest.approx(start.array())
    assert poses[-1] == pytest.approx(goal.array())
    assert not any(touches(DEAD_END, body, pose) for pose in poses)
    steps = np.diff(poses, axis=0)
    goes = np.hypot(*steps[:, :2].T) > 0
    across = -np.sin(poses[:-1, 2]) * steps[:, 0] + np.cos(poses[:-1, 2]) * steps[:, 1]
    assert np.abs(across[goes]).max() < 0.02, "it moves along its own axis, never sideways"
    assert np.hypot(*steps[:, :2].T).max() < 0.06 or len(poses) < 20


@pytest.mark.sampled(1)
@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_B, CHAIR_A_MID, CHAIR_A_FRONT], ids=lambda body: body.chair_id)
def test_from_any_start_the_chair_looks_along_the_way_that_it_drives(body: ChairBody) -> None:
    """Consecutive turns in several steps add up; with one lost, the path would continue across the chair."""
    rng, field = np.random.default_rng(0), fine_field(DEAD_END, Pose2(2.5, 1.25), 3.0)
    for _ in range(8):
        turn = math.radians(rng.uniform(-10.0, 10.0))
        start = Pose2(4.5 - body.front - rng.uniform(0.15, 0.6), 1.25 + rng.uniform(-0.2, 0.2), turn)
        poses = manoeuvre(field, body, start, Pose2(1.5, 1.25, math.pi))
        steps = np.diff(poses, axis=0)
        goes = np.hypot(*steps[:, :2].T) > 0
        across = -np.sin(poses[:-1, 2]) * steps[:, 0] + np.cos(poses[:-1, 2]) * steps[:, 1]
        assert np.abs(across[goes]).max() < 0.02
        assert np.abs(np.arctan2(np.sin(steps[goes, 2]), np.cos(steps[goes, 2]))).max() < 0.5
        assert not any(touches(DEAD_END, body, pose) for pose in poses)


def test_a_turn_that_does_not_fit_is_refused_with_advice() -> None:
    narrow = room(5.0, 2.5, (0.0, 0.0, 5.0, 0.8), (0.0, 1.7, 5.0, 2.5))
    with pytest.raises(NoPath, match="does not fit"):
        manoeuvre(fine_field(narrow, Pose2(2.5, 1.25), 3.0), CHAIR_A, Pose2(2.5, 1.25, 0.0), Pose2(1.5, 1.25, math.pi))


@pytest.mark.parametrize(("name", "x"), [("start", 4.4), ("end", 2.5)])
def test_an_end_in_a_wall_is_named(name: str, x: float) -> None:
    start, goal = Pose2(x, 1.25, 0.0), Pose2(2.5 if name == "start" else 4.4, 1.25, 0.0)
    with pytest.raises(NoPath, match=f"at the {name}"):
        manoeuvre(fine_field(DEAD_END, Pose2(2.5, 1.25), 3.0), CHAIR_A, start, goal)


def test_in_the_open_the_path_is_a_turn_and_a_straight_line() -> None:
    poses = manoeuvre(
        fine_field(room(6.0, 6.0), Pose2(3.0, 3.0), 4.0), CHAIR_A, Pose2(2.0, 3.0, 1.5), Pose2(4.0, 3.0, 0.0)
    )
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).sum() == pytest.approx(2.0, abs=0.1)


def test_finer_bins_find_turns_that_coarse_ones_miss_but_no_impossible_ones() -> None:
    corner = room(4.5, 4.5, (0.0, 0.0, 4.5, 0.5), (0.0, 1.425, 2.575, 4.5), (3.5, 0.0, 4.5, 4.5))
    field = fine_field(corner, Pose2(2.2, 2.2), 3.0)
    start, goal = Pose2(1.2, 0.95, 0.0), Pose2(3.04, 3.2, math.pi / 2)
    fine = ManoeuvreAttempt(clearance=0.005, bin=0.025, headings=144)
    assert len(manoeuvre(field, CHAIR_A, start, goal, fine))
    with pytest.raises(NoPath):
        manoeuvre(field, replace(CHAIR_B, width=0.8), start, goal, fine)


def test_a_fine_field_keeps_the_walls_in_place_and_adds_new_obstacles() -> None:
    grid = room(3.0, 3.0)
    plain = fine_field(grid, Pose2(1.5, 1.5), 5.0)
    assert plain.resolution == FINEST
    assert plain.metres.shape == (240, 240)
    assert plain.metres[120, 2] == pytest.approx(FINEST)  # two fine cells to a cell of the map
    points = np.array([[1.5, 1.5], [0.05, 1.0]])
    seen = fine_field(grid, Pose2(1.5, 1.5), 5.0, points, known_within=0.06)
    assert seen.metres[120, 120] == 0.0
    assert seen.metres[80, 4] > 0.0, "a point at a wall is the wall"


def test_a_fine_field_keeps_obstacles_of_each_height_apart_and_leaves_out_those_of_walls() -> None:
    feet = BodyLayer(0.0, 0.3, 0.5, 0.2, 0.2)
    low = np.array([[2.0, 1.8], [2.5, 0.53]])  # the second one is the wall's
    field = fine_field(DEAD_END, Pose2(2.0, 1.25), 2.0, low[:0], known_within=0.06, layered=[(feet, low)])
    ((layer, metres),) = field.layers
    assert layer == feet
    assert (metres == 0.0).sum() == 1
    there = Pose2(2.0, 1.25 + 0.29, 0.0)  # the point is within the outline, and beside the feet
    assert fits(CHAIR_A, 0.0, field, there)
    assert not fits(CHAIR_A, 0.0, fine_field(DEAD_END, Pose2(2.0, 1.25), 2.0, low), there)


def test_a_measured_door_replaces_the_mapped_one() -> None:
    grid = room(4.0, 4.0, (2.0, 0.0, 2.15, 1.6), (2.0, 2.35, 2.15, 4.0))  # mapped 0.75 m wide, 2.5 cm off
    door = Pose2(2.075, 2.0, 0.0)
    free = fine_field(grid, door, 3.0, opening=(door, 0.8))
    rows = np.flatnonzero(free.metres[:, round(2.075 / FINEST)] > 0) * FINEST
    opening = rows[(rows > 1.0) & (rows < 3.0)]
    assert (opening.min(), opening.max() + FINEST) == pytest.approx((1.6, 2.4), abs=1.5 * FINEST)


@pytest.mark.parametrize("x", [-5.0, 0.02, 0.3, 2.0, 3.98, 9.0])
def test_a_door_at_the_edge_of_the_scan_is_opened_as_far_as_it_is_seen(x: float) -> None:
    grid = OccupancyGrid(np.full((160, 160), 100, np.int8), 0.025)
    door = Pose2(x, 2.0, 0.3)
    seen = fine_field(grid, Pose2(2.0, 2.0), 5.0, opening=(door, 0.8))
    centres = np.moveaxis(np.indices(seen.metres.shape)[::-1] + 0.5, 0, -1) * FINEST
    local = np.abs(transform_points(door.inverse(), centres.reshape(-1, 2))).reshape(centres.shape)
    opened = (local[..., 0] < 0.4) & (local[..., 1] < 0.4)
    np.testing.assert_array_equal(seen.metres > 0.0, opened)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("part", [1, 37, 800])
def test_in_slices_the_same_path_is_found_and_no_slice_takes_many_more_checks_than_its_limit(
    part: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    field = fine_field(DEAD_END, Pose2(2.5, 1.25), 3.0)
    start, goal = Pose2(3.5, 1.2, 0.05), Pose2(1.5, 1.25, math.pi)
    whole = manoeuvre(field, CHAIR_A, start, goal)
    monkeypatch.setattr(manoeuvre_module, "CHECKS_PER_STEP", part)
    slices = manoeuvre_resumably(field, CHAIR_A, start, goal)
    count = 0
    while True:
        try:
            next(slices)
        except StopIteration as done:
            np.testing.assert_array_equal(done.value, whole)
            break
        count += 1
    assert count >= 2
    assert count * part >= 30


def test_steering_changes_no_more_often_than_the_turn_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    field = fine_field(room(6.0, 3.0), Pose2(3.0, 1.5), 4.0)

    def changes(price: float) -> float:
        monkeypatch.setattr(manoeuvre_module, "STEER_PRICE", price)
        poses = manoeuvre(field, CHAIR_A, Pose2(1.0, 1.5), Pose2(4.5, 1.6))
        return float(np.abs(np.diff(np.diff(np.unwrap(poses[:, 2])))).sum())

    assert changes(0.3) <= changes(0.0)


@pytest.mark.nightly
def test_a_turn_in_a_one_way_zone_never_leads_back_against_it() -> None:
    """Facing +x in a passage for -x only, a chair would drive on a little to turn: it reverses, and turns farther
    on."""
    cells = np.full((120, 240), 100, np.int8)
    cells[50:76, 10:230] = 0
    ramp = Zone("ramp", Rule.ONE_WAY, np.array([[3.0, 2.4], [7.0, 2.4], [7.0, 3.9], [3.0, 3.9]]), math.pi)
    grid, start, goal = OccupancyGrid(cells, 0.05), Pose2(5.0, 3.15), Pose2(2.0, 3.15, math.pi)
    ways = []
    for zones in ((), (ramp,)):
        planner = GlobalPlanner(goal)
        planner.replan(costmap_from_grid(grid, CHAIR_A_FRONT, zones=zones), start)
        poses = np.concatenate([leg.path.poses for leg in planner.legs])
        steps = np.diff(poses[:, :2], axis=0)
        ways.append(steps[(steps[:, 0] > 1e-6) & zone_contains(ramp, poses[:-1, :2]), 0].sum())
    assert ways[0] > 0.2
    assert ways[1] == 0.0
