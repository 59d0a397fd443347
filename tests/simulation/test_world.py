"""Worlds from floor plans and from mapped grids."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from msgspec import structs
from scipy.ndimage import distance_transform_edt

from waychair.calibration.chair import CHAIR_A, CHAIR_B, ChairBody
from waychair.errors import WorldError
from waychair.geometry import transform_points
from waychair.maps.grid import cells_from_points, occupied, occupied_points
from waychair.simulation.contact import in_contact, solid_from_grid
from waychair.simulation.floor_plan import load_plan
from waychair.simulation.lidar import LidarSettings
from waychair.simulation.plant import PlantSettings, randomised
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.simulation.world import (
    WORLDS,
    World,
    load_world,
    shipped_worlds,
    world_from_grid,
    world_from_plan,
)
from waychair.trials.record import drive_route, route_length
from waychair.types import FloatArray, OccupancyGrid, Place, Pose2

PLAN = """\
name: box
size: [4.0, 3.0]
start: [1.0, 1.0, 0.5]
walls:
  - {start: [0.0, 2.0], end: [4.0, 2.0]}
boxes:
  - {centre: [3.0, 1.0], size: [0.4, 0.2]}
places:
  door: [0.5, 0.5, 0.0]
routes:
  mapping:
    - [2.0, 1.0]
"""


def _load(tmp_path: Path, text: str) -> None:
    path = tmp_path / "plan.yaml"
    path.write_text(text, encoding="utf-8")
    load_world(path)


def test_a_plan_becomes_a_grid_with_its_walls_where_they_are_drawn(tmp_path: Path) -> None:
    path = tmp_path / "plan.yaml"
    path.write_text(PLAN, encoding="utf-8")
    world = load_world(path)
    assert (world.name, world.start, world.route().tolist()) == ("box", Pose2(1.0, 1.0, 0.5), [[2.0, 1.0]])
    assert world.places == (Place("door", Pose2(0.5, 0.5, 0.0)),)
    points = occupied_points(world.grid)
    wall, box = points[points[:, 1] > 1.5], points[points[:, 1] < 1.5]
    assert len(wall) == 80 * 2
    assert wall.min(axis=0) == pytest.approx([0.025, 1.975])
    assert wall.max(axis=0) == pytest.approx([3.975, 2.025])
    assert len(box) == 8 * 4
    assert box.mean(axis=0) == pytest.approx([3.0, 1.0])


def test_a_slanted_wall_has_no_hole_for_a_beam(tmp_path: Path) -> None:
    path = tmp_path / "plan.yaml"
    path.write_text(PLAN.replace("end: [4.0, 2.0]", "end: [4.0, 2.9]"), encoding="utf-8")
    solid = occupied(load_world(path).grid)
    # Between its ends neighbouring columns share a row of the wall: its cells meet at faces, not only at corners.
    assert all((solid[45:, col] & solid[45:, col + 1]).any() for col in range(12, 88))


@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_B])
@pytest.mark.parametrize("name", ["small_clinic", "second_floor", "basement"])
def test_every_place_and_the_start_hold_a_chair_that_may_turn_round(name: str, body: ChairBody) -> None:
    world = load_world(name)
    solid = solid_from_grid(world.grid)
    for pose in (world.start, *(place.pose for place in world.places)):
        for theta in np.linspace(-math.pi, math.pi, 24):
            assert not in_contact(solid, body, Pose2(pose.x, pose.y, float(theta)))


@pytest.mark.parametrize("name", shipped_worlds())
def test_chair_a_drives_every_worlds_mapping_route_without_contact(name: str) -> None:
    world = load_world(name)
    for seed in (0, 3):
        plant = randomised(PlantSettings(), seed)
        settings = SimulatorSettings(plant=plant, lidar=LidarSettings(beams=2))  # the rider sees the truth
        simulator = Simulator(world, CHAIR_A, settings, seed)
        drive = drive_route(simulator, CHAIR_A, world.route())
        assert simulator.contacts == 0
        assert drive.distance_m == pytest.approx(route_length(world.route(), world.start), rel=0.03)
        assert math.dist((simulator.truth().x, simulator.truth().y), world.route()[-1]) < 0.15


@pytest.mark.parametrize("name", shipped_worlds())
def test_chair_a_stands_free_at_every_place_of_every_world(name: str) -> None:
    world = load_world(name)
    solid = solid_from_grid(world.grid)
    assert not in_contact(solid, CHAIR_A, world.start)
    assert not [place.name for place in world.places if in_contact(solid, CHAIR_A, place.pose)]


def _revisits(route: FloatArray, start: Pose2) -> int:
    """How often the way comes upon its own past after at least 5 m of new ground."""
    corners = np.vstack([[start.x, start.y], route])
    legs = [np.linspace(a, b, max(2, round(math.dist(a, b) / 0.1))) for a, b in pairwise(corners)]
    way = np.concatenate(legs)
    revisits, new = 0, 0.0
    for i in range(80, len(way)):
        seen = bool((np.hypot(*(way[: i - 80] - way[i]).T) < 0.2).any()) if i > 80 else False
        revisits += seen and new > 5.0
        new = 0.0 if seen else new + 0.1
    return revisits


@pytest.mark.parametrize(("name", "length", "revisits"), [("second_floor", 203.0, 3), ("basement", 140.0, 4)])
def test_a_mapping_route_is_as_long_and_comes_back_as_often_as_it_says(name: str, length: float, revisits: int) -> None:
    world = load_world(name)
    assert route_length(world.route(), world.start) == pytest.approx(length, abs=3.0)
    assert _revisits(world.route(), world.start) == revisits


def _reachable(world: World, a: Pose2, b: Pose2, clearance: float = 0.35) -> float:
    """Length [m] of the shortest way of a disc between two poses, on the grid; inf where there is none."""
    step = 2
    free = distance_transform_edt(~occupied(world.grid))[::step, ::step] * world.grid.resolution > clearance
    begin, end = cells_from_points(world.grid, np.array([[a.x, a.y], [b.x, b.y]])) // step
    front = np.zeros(free.shape, np.uint8)
    front[tuple(begin)] = 1
    for k in range(5000):
        if front[tuple(end)]:
            return k * step * world.grid.resolution
        grown = cv2.dilate(front, np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.uint8)) * free
        if (grown == front).all():
            return math.inf
        front = grown
    return math.inf


def test_closing_a_door_of_the_second_floor_leaves_a_longer_way_round() -> None:
    world = load_world("second_floor")
    begin = Pose2(32.1, 7.1, 0.0)
    restroom = next(place.pose for place in world.places if place.name == "restroom")
    open_way = _reachable(world, begin, restroom)
    closed_way = _reachable(world.with_closed(["fire_door"]), begin, restroom)
    assert open_way + 5.0 < closed_way < math.inf


def test_closing_the_only_door_of_a_room_cuts_it_off() -> None:
    world = load_world("second_floor")
    classroom, lift, restroom = (place.pose for place in world.places)
    assert _reachable(world, lift, restroom) < 100.0
    assert _reachable(world.with_closed(["restroom"]), lift, restroom) == math.inf
    assert _reachable(world.with_closed(["restroom"]), lift, classroom) < math.inf


def test_the_second_floor_and_the_apartment_have_the_doors_they_promise() -> None:
    widths = {door.name: door.width for door in load_world("second_floor").doors}
    assert widths["restroom"] == 0.9
    world = load_world("apartment")
    assert {door.width for door in world.doors} == {0.8, 0.815, 0.9}
    solid = occupied(world.grid)
    for door in world.doors:
        across = np.arange(-0.6, 0.6, world.grid.resolution)
        points = transform_points(door.middle, np.column_stack([across, np.zeros(len(across))]))
        free = ~solid[tuple(cells_from_points(world.grid, points).T)]
        assert free.sum() * world.grid.resolution == pytest.approx(door.width, abs=0.0051)


@pytest.mark.parametrize("name", shipped_worlds())
def test_closing_every_door_gives_the_walls_without_doors(name: str) -> None:
    plan, _ = load_plan(WORLDS / f"{name}.yaml")
    whole = structs.replace(
        plan, walls=[structs.replace(wall, doors=[door for door in wall.doors if not door.name]) for wall in plan.walls]
    )
    world = load_world(name)
    before = world.grid.cells.copy()
    closed = world.with_closed([door.name for door in world.doors])
    np.testing.assert_array_equal(closed.grid.cells, world_from_plan(whole).grid.cells)
    np.testing.assert_array_equal(world.grid.cells, before)


def test_a_door_that_is_not_there_is_refused_with_those_that_are() -> None:
    with pytest.raises(WorldError, match="no door 'gate': take one of reception, bath, ward"):
        load_world("small_clinic").with_closed(["bath", "gate"])
    with pytest.raises(WorldError, match="no doors with names"):
        load_world("corridor_t").with_closed(["gate"])


def test_the_clinics_route_comes_back_over_its_start() -> None:
    world = load_world("small_clinic")
    assert {"reception", "ward", "bath"} <= {place.name for place in world.places}
    assert np.hypot(*(world.route()[5:] - (world.start.x, world.start.y)).T).min() < 0.1


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("walls:", "wals:", "wals"),
        ("size: [4.0, 3.0]", "size: [4.0]", "size"),
        ("size: [4.0, 3.0]", "size: [4.0, -3.0]", "size"),
        ("size: [4.0, 3.0]", "size: [4.0, .nan]", "size"),
        ("size: [4.0, 3.0]", "size: [4.0, 1e9]", "size"),
        ("end: [4.0, 2.0]", "end: four", r"walls\[0\].end"),
        ("end: [4.0, 2.0]", "end: [.inf, 2.0]", "walls"),
        ("end: [4.0, 2.0]", "end: [4.0, 2.0], thickness: 0.02", "thickness"),
        ("end: [4.0, 2.0]", "end: [4.0, 2.0], colour: red", "colour"),
        ("start: [1.0, 1.0, 0.5]\n", "", "start"),
        ("start: [1.0, 1.0, 0.5]", "start: [1.0, 2.0, 0.5]", "start: .* solid"),
        ("door: [0.5, 0.5, 0.0]", "door: [9.0, 0.5, 0.0]", "door: .* outside"),
        ("- [2.0, 1.0]", "- [3.0, 1.0]", r"routes\.mapping\[0\]: .* solid"),
        ("boxes:", "boxes: [", "line 7"),
        (PLAN, "", "object"),
    ],
)
def test_a_broken_plan_is_refused_with_its_key_or_line(tmp_path: Path, old: str, new: str, named: str) -> None:
    assert old in PLAN
    with pytest.raises(WorldError, match=named):
        _load(tmp_path, PLAN.replace(old, new))


def test_an_unknown_world_is_refused_with_the_known_ones() -> None:
    with pytest.raises(WorldError, match="small_clinic"):
        load_world("large_clinic")


def test_a_missing_plan_is_refused(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match=r"none\.yaml"):
        load_world(tmp_path / "none.yaml")


def test_a_mapped_grid_is_solid_where_occupied_and_transparent_where_unknown() -> None:
    cells = np.full((40, 40), -1, np.int8)
    cells[:20] = 0
    cells[30, 30] = 100
    cells[31, 30] = 64
    world = world_from_grid(OccupancyGrid(cells, 0.05, Pose2(-1.0, -1.0, 0.0)), Pose2(0.0, -0.5, 0.0))
    assert solid_from_grid(world.grid).cells.sum() == 1
    assert world.routes == {}


def test_a_mapped_grid_whose_start_is_in_a_wall_is_refused() -> None:
    with pytest.raises(WorldError, match="start"):
        world_from_grid(OccupancyGrid(np.full((40, 40), 100, np.int8), 0.05), Pose2(1.0, 1.0, 0.0))
