"""The shipped worlds: their promises, and that chairs fit into them."""

from __future__ import annotations

import hashlib
import math
from itertools import pairwise

import cv2
import numpy as np
import pytest
from msgspec import structs
from scipy.ndimage import distance_transform_edt

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.geometry import transform_points
from waychair.maps.grid.cells import cells_from_points, occupied
from waychair.simulation.plan.floor_plan import PlanDoor
from waychair.simulation.plan.plan_file import load_building
from waychair.simulation.plan.world import WORLDS, World, levels_of, load_world, shipped_worlds, world_from_plan
from waychair.simulation.plant.plant import PlantSettings, randomised
from waychair.simulation.scene.contact import in_contact, solid_from_blocks
from waychair.simulation.scene.scene import MATERIALS, PersonBehaviour, Reflection
from waychair.simulation.sensors.height_slices import slice_at
from waychair.simulation.sensors.lidar import LidarSettings
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.trials.record import drive_route, route_length
from waychair.types import FloatArray, Pose2

LEVELS = [(name, level) for name in shipped_worlds() for level in levels_of(name)]
SHORT = {"corridor_t", "glass_door", "ramp"}
"""Worlds with routes that are driven every time; the other routes are driven nightly."""

ROUTES = [pytest.param(*each, marks=[] if each[0] in SHORT else pytest.mark.nightly) for each in LEVELS]


@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_B])
@pytest.mark.parametrize("name", ["small_clinic", "second_floor", "basement"])
def test_every_place_and_the_start_have_room_for_a_chair_to_turn_round(name: str, body: ChairBody) -> None:
    world = load_world(name)
    solid = solid_from_blocks(world.blocks, world.pits)
    for pose in (world.start, *(place.pose for place in world.places)):
        for theta in np.linspace(-math.pi, math.pi, 24):
            assert not in_contact(solid, body, Pose2(pose.x, pose.y, float(theta)))


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("name", "level"), ROUTES)
def test_chair_a_drives_every_worlds_mapping_route_without_contact(name: str, level: str) -> None:
    world = load_world(name, level).without_people()
    for seed in (0, 3) if name == "apartment" else (0,):  # the tightest
        plant = randomised(PlantSettings(), seed)
        settings = SimulatorSettings(plant=plant, lidar=LidarSettings(beams=2))  # the rider sees the truth
        simulator = Simulator(world, CHAIR_A, settings, seed)
        drive = drive_route(simulator, CHAIR_A, world.route())
        assert simulator.contacts == 0
        assert drive.distance_m == pytest.approx(route_length(world.route(), world.start), rel=0.03, abs=0.1)
        assert math.dist((simulator.truth().x, simulator.truth().y), world.route()[-1]) < 0.15


@pytest.mark.parametrize(("name", "level"), LEVELS)
def test_chair_a_is_free_at_every_place_of_every_world(name: str, level: str) -> None:
    world = load_world(name, level)
    assert world.places
    solid = solid_from_blocks(world.blocks, world.pits)
    assert not in_contact(solid, CHAIR_A, world.start)
    assert not [place.name for place in world.places if in_contact(solid, CHAIR_A, place.pose)]


def _revisits(route: FloatArray, start: Pose2) -> int:
    """Return how often the path meets its own past after at least 5 m of new ground."""
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
def test_a_mapping_route_has_its_stated_length_and_number_of_revisits(name: str, length: float, revisits: int) -> None:
    world = load_world(name)
    assert route_length(world.route(), world.start) == pytest.approx(length, abs=3.0)
    assert _revisits(world.route(), world.start) == revisits


def _reachable(world: World, a: Pose2, b: Pose2, clearance: float = 0.35) -> float:
    """Return the length [m] of the shortest path of a disc between two poses, on the grid; inf without a path."""
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


def test_closing_a_door_of_the_second_floor_leaves_a_longer_detour() -> None:
    world = load_world("second_floor")
    begin = Pose2(32.1, 7.1, 0.0)
    restroom = next(place.pose for place in world.places if place.name == "restroom")
    open_way = _reachable(world, begin, restroom)
    closed_way = _reachable(world.with_closed(["fire_door"]), begin, restroom)
    assert open_way + 5.0 < closed_way < math.inf


def test_closing_the_only_door_of_a_room_closes_the_room_off() -> None:
    world = load_world("second_floor")
    classroom, lift, restroom = (place.pose for place in world.places)
    assert _reachable(world, lift, restroom) < 100.0
    assert _reachable(world.with_closed(["restroom"]), lift, restroom) == math.inf
    assert _reachable(world.with_closed(["restroom"]), lift, classroom) < math.inf


def test_the_second_floor_and_the_apartment_have_their_promised_doors() -> None:
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


@pytest.mark.parametrize(
    ("name", "level"),
    [pytest.param(*each, marks=pytest.mark.nightly if each[0] == "second_floor" else []) for each in LEVELS],
)
def test_closing_every_door_gives_the_walls_without_doors(name: str, level: str) -> None:
    (plan,) = (each.plan for each in load_building(WORLDS / f"{name}.yaml").levels if each.plan.name == level)
    whole = structs.replace(
        plan, walls=[structs.replace(wall, doors=[door for door in wall.doors if not door.name]) for wall in plan.walls]
    )
    world = load_world(name, level)
    before = world.grid.cells.copy()
    closed = world.with_closed([door.name for door in world.doors])
    np.testing.assert_array_equal(closed.grid.cells, world_from_plan(whole, name).grid.cells)
    np.testing.assert_array_equal(world.grid.cells, before)


def test_the_route_of_the_clinic_returns_over_its_start() -> None:
    world = load_world("small_clinic")
    assert {"reception", "ward", "bath"} <= {place.name for place in world.places}
    assert np.hypot(*(world.route()[5:] - (world.start.x, world.start.y)).T).min() < 0.1


@pytest.mark.parametrize(
    ("name", "digest"),
    [
        ("apartment", "792327928b915199"),
        ("basement", "9648e76646fb264a"),
        ("corridor_t", "3209060696941267"),
        ("second_floor", "a4a2bcfc9236e8a3"),
        ("small_clinic", "13779474cae0cc95"),
    ],
)
def test_the_cells_of_worlds_with_recorded_results_stay_unchanged(name: str, digest: str) -> None:
    assert hashlib.sha256(load_world(name).grid.cells.tobytes()).hexdigest()[:16] == digest


@pytest.mark.parametrize(("name", "level"), LEVELS)
def test_every_level_is_lit_and_made_of_known_materials_below_its_ceiling(name: str, level: str) -> None:
    world = load_world(name, level)
    assert world.lamps
    assert all(0.0 < lamp.z < world.finish.height for lamp in world.lamps)
    assert {block.material for block in world.blocks} | {world.finish.floor, world.finish.ceiling} <= set(MATERIALS)
    assert all(block.high <= world.finish.height for block in world.blocks)
    assert len(world.posters) >= 5
    assert all(poster.height + poster.width / 2 < world.finish.height for poster in world.posters)


@pytest.mark.parametrize("name", [name for name in shipped_worlds() if name != "alias"])
def test_no_two_surfaces_of_a_building_share_a_seed(name: str) -> None:
    worlds = [load_world(name, level) for level in levels_of(name)]
    seeds = [thing.seed for world in worlds for thing in (*world.blocks, *world.slopes, *world.posters)]
    assert len(set(seeds)) == len(seeds)


def test_the_rooms_of_the_alias_world_have_the_same_shape_and_look() -> None:
    world = load_world("alias")
    inner = [block for block in world.blocks if 0.1 < block.middle.x < 29.9]  # the building's ends are no repeats
    looks = [
        {
            (round(block.middle.x - 5.0 * k, 6), block.middle.y, block.length, block.high, block.material, block.seed)
            for block in inner
            if 5.0 * k + 0.1 < block.middle.x < 5.0 * k + 4.9
        }
        for k in range(6)
    ]
    assert len(looks[0]) == 7
    assert all(look == looks[0] for look in looks)
    pictures = [{(p.seed, p.height) for p in world.posters if 5.0 * k < p.middle.x < 5.0 * k + 5.0} for k in range(6)]
    assert len(pictures[0]) == 3
    assert all(picture == pictures[0] for picture in pictures)
    lamps = np.array([lamp.x % 5.0 for lamp in world.lamps])
    assert len(set(lamps.round(6))) == 2


def test_start_and_goal_of_the_movers_are_as_far_apart_as_in_the_published_dynamic_test() -> None:
    world = load_world("movers")
    (goal,) = world.places
    assert math.dist((world.start.x, world.start.y), (goal.pose.x, goal.pose.y)) == pytest.approx(2.21, abs=0.005)
    free = ~occupied(world.grid)[11:-11, 11:-11]
    assert free.all()
    assert free.shape == (60, 60)
    assert occupied(world.grid)[10, 10:72].all()
    assert [(p.behaviour, p.speed, p.radius) for p in world.people] == [(PersonBehaviour.BOUNCE, 0.15, 0.15)] * 10
    points = np.concatenate([person.path for person in world.people])
    apart = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1)) + 9.0 * np.eye(10)
    assert apart.min() > 0.3
    assert np.hypot(*(points - (world.start.x, world.start.y)).T).min() > 0.5


def test_the_ramp_rises_one_in_twelve_and_only_its_sides_stop_a_chair() -> None:
    world = load_world("ramp")
    up, platform, down = world.slopes
    assert (up.high - up.low) / up.length == pytest.approx(1 / 12)
    assert (up.high, platform.low, platform.high, down.low) == (0.25,) * 4
    (sill,) = (block for block in world.blocks if block.high < 0.1)
    assert sill.high == 0.02
    solid = occupied(world.grid)
    across = np.arange(0.5, 3.3, 0.05)
    rows, cols = cells_from_points(world.grid, np.column_stack([np.full(len(across), 8.5), across])).T
    edges = across[solid[rows, cols]]
    assert edges == pytest.approx([0.9, 2.65], abs=0.03)
    along = np.arange(0.2, 16.8, 0.02)
    assert not solid[tuple(cells_from_points(world.grid, np.column_stack([along, np.full(len(along), 1.8)])).T)].any()


def test_stairs_descend_in_even_steps_and_are_closed_to_chairs_but_open_to_beams() -> None:
    world = load_world("stairs")
    (pit,) = world.pits
    steps = sorted((block.high, block.middle.x) for block in world.blocks if block.high < 0.0)
    assert pit.depth == pytest.approx(8 * 0.17)
    assert [high for high, _ in steps] == pytest.approx([-0.17 * k for k in range(7, 0, -1)])
    assert [x for _, x in steps] == sorted((x for _, x in steps), reverse=True)
    cell = cells_from_points(world.grid, np.array([[pit.middle.x, pit.middle.y]]))[0]
    assert world.grid.cells[tuple(cell)] == 100
    middles = slice_at(world.blocks, 0.3).segments.reshape(-1, 2, 2).mean(axis=1)
    assert not ((abs(middles - (pit.middle.x, pit.middle.y)) < (1.1, 0.9)).all(axis=1)).any()


def test_a_lidar_sees_only_the_legs_of_the_table_but_a_chair_cannot_be_there() -> None:
    world = load_world("table")
    near = [
        np.hypot(*(segment[2:] - segment[:2]))
        for segment in slice_at(world.blocks, CHAIR_A.laser_z).segments
        if abs(segment[0] - 3.5) < 0.6 and abs(segment[1] - 3.0) < 1.0
    ]
    assert near == pytest.approx([0.05] * 16)
    assert world.grid.cells[tuple(cells_from_points(world.grid, np.array([[3.5, 3.0]]))[0])] == 100


@pytest.mark.parametrize(
    ("name", "reflection"),
    [("glass_door", Reflection.GLASS), ("mirror", Reflection.MIRROR), ("black_sofa", Reflection.DARK)],
)
def test_a_world_for_a_difficult_surface_has_it_at_the_height_of_the_lidar(name: str, reflection: Reflection) -> None:
    seen = slice_at(load_world(name).blocks, CHAIR_A.laser_z)
    segments = seen.segments[seen.reflections == reflection]
    assert np.hypot(*(segments[:, 2:] - segments[:, :2]).T).max() > 1.1


def test_the_lift_is_at_the_same_place_on_both_floors() -> None:
    ground, upper = (load_world("two_floors", level) for level in levels_of("two_floors"))
    assert ground.lifts == upper.lifts
    assert ground.lifts[0].levels == ("ground", "upper")
    assert (ground.name, ground.level, upper.level) == ("two_floors", "ground", "upper")
    assert load_world("two_floors").level == "ground"
    assert ground.blocks != upper.blocks


def test_the_second_floor_has_all_kinds_of_people_and_the_basement_is_dim() -> None:
    floor, basement = load_world("second_floor"), load_world("basement")
    kinds = [person.behaviour for person in floor.people]
    assert {PersonBehaviour.PATH, PersonBehaviour.SOCIAL, PersonBehaviour.SEATED, PersonBehaviour.SUDDEN} == set(kinds)
    assert not floor.without_people().people
    assert floor.without_people().blocks == floor.blocks
    assert max(lamp.power for lamp in basement.lamps) < 0.5 * min(lamp.power for lamp in floor.lamps)
    assert basement.finish.ambient < 0.5 * floor.finish.ambient


def test_the_leaves_world_has_leaves_at_their_angles_and_people_in_its_doorways() -> None:
    plan, world = load_building(WORLDS / "leaves.yaml").levels[0].plan, load_world("leaves")
    beams = slice_at(world.blocks, 1.0).segments
    for wall in plan.walls:
        for door in (each for each in wall.doors if each.leaf):
            hinge_x = wall.start[0] + door.at + (-0.5 if door.hinge == "start" else 0.5) * door.width
            side = 1.0 if door.opens == "left" else -1.0
            way = 1.0 if door.hinge == "start" else -1.0
            tip = np.array(
                [
                    hinge_x + way * door.width * math.cos(door.leaf),
                    wall.start[1] + side * (wall.thickness / 2 + door.width * math.sin(door.leaf)),
                ]
            )
            ends = beams.reshape(-1, 2)
            assert np.hypot(*(ends - tip).T).min() < 0.01  # the leaf's inner edge ends there
            gap = [hinge_x + way * 0.5 * door.width, wall.start[1]]
            assert not any(_crosses(segment, gap, door) for segment in beams)
    doors = [(wall.start[0] + door.at, wall.start[1]) for wall in plan.walls for door in wall.doors]
    inside = [person for person in plan.people if person.behaviour == "seated"]
    assert [min(math.dist(person.path[0], door) for door in doors) for person in inside] == [0.0]
    through = [person for person in plan.people if person.behaviour == "path"]
    assert [(person.path[0][1] - 5.6) * (person.path[-1][1] - 5.6) < 0.0 for person in through] == [True]


def _crosses(segment: FloatArray, middle: list[float], door: PlanDoor) -> bool:
    """Whether a face lies in the opening itself, which a leaf beyond its jamb leaves whole."""
    x0, y0, x1, y1 = segment
    in_wall = all(abs(y - middle[1]) < 0.04 for y in (y0, y1))
    return in_wall and max(x0, x1) > middle[0] - 0.4 * door.width and min(x0, x1) < middle[0] + 0.4 * door.width


def test_closing_a_door_with_a_leaf_frees_the_ground_where_the_leaf_stood() -> None:
    world = load_world("leaves")
    closed = world.with_closed(["ward"])
    door = next(each for each in world.doors if each.name == "ward")
    assert door.leaf is not None
    middle = door.leaf.middle
    cell = tuple(cells_from_points(world.grid, np.array([[middle.x, middle.y]]))[0])
    assert (world.grid.cells[cell], closed.grid.cells[cell]) == (100, 0)
    assert len(closed.blocks) == len(world.blocks)  # one leaf for another
    shut = tuple(cells_from_points(world.grid, np.array([[door.middle.x, door.middle.y]]))[0])
    assert (world.grid.cells[shut], closed.grid.cells[shut]) == (0, 100)
