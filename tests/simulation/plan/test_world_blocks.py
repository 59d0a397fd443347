"""The parts of a plan: walls, doors, furniture, light, posters and people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from waychair.errors import WorldError
from waychair.geometry import transform_points
from waychair.maps.grid.cells import occupied, points_from_cells
from waychair.simulation.plan.plan_fittings import within_any
from waychair.simulation.plan.world import World, load_world
from waychair.simulation.scene.scene import DOOR_HEIGHT, Block, PersonBehaviour
from waychair.simulation.scene.seeds import seed_from_names
from waychair.types import BoolArray, FloatArray

PLAN = """\
name: flat
size: [8.0, 5.0]
start: [1.0, 1.0, 0.0]
walls:
  - start: [0.0, 2.5]
    end: [8.0, 2.5]
    doors:
      - {name: kitchen, at: 2.0, width: 0.9}
      - {name: cellar, at: 5.0, width: 0.8, closed: true, material: metal}
"""
ROOM = """\
  - {start: [0.0, 0.0], end: [8.0, 0.0]}
  - {start: [8.0, 0.0], end: [8.0, 5.0]}
  - {start: [8.0, 5.0], end: [0.0, 5.0]}
  - {start: [0.0, 5.0], end: [0.0, 0.0]}
"""


def _world(tmp_path: Path, more: str = "", plan: str = PLAN) -> World:
    path = tmp_path / "plan.yaml"
    path.write_text(plan + more, encoding="utf-8")
    return load_world(path)


def _spans(blocks: Sequence[Block]) -> set[tuple[float, float, float, float, str]]:
    """Blocks along x: begin, end, heights and material."""
    return {
        (
            round(b.middle.x - b.length / 2, 6),
            round(b.middle.x + b.length / 2, 6),
            b.low,
            b.high,
            b.material,
        )
        for b in blocks
    }


def test_a_wall_consists_of_pieces_to_the_ceiling_lintels_over_doors_and_leaves_in_closed_ones(tmp_path: Path) -> None:
    assert _spans(_world(tmp_path).blocks) == {
        (0.0, 1.55, 0.0, 2.7, "plaster"),
        (2.45, 4.6, 0.0, 2.7, "plaster"),
        (5.4, 8.0, 0.0, 2.7, "plaster"),
        (1.55, 2.45, DOOR_HEIGHT, 2.7, "plaster"),
        (4.6, 5.4, DOOR_HEIGHT, 2.7, "plaster"),
        (4.6, 5.4, 0.0, DOOR_HEIGHT, "metal"),
    }


def test_a_low_room_has_no_lintels_and_doors_of_its_height(tmp_path: Path) -> None:
    world = _world(tmp_path, "finish: {height: 2.0, walls: concrete}\n").with_closed(["kitchen"])
    assert {block.high for block in world.blocks} == {2.0}
    assert sorted(block.material for block in world.blocks) == ["concrete"] * 3 + ["metal", "wood"]


def test_a_door_that_the_plan_closes_is_solid_and_cannot_be_closed_again(tmp_path: Path) -> None:
    world = _world(tmp_path)
    assert [door.name for door in world.doors] == ["kitchen"]
    closed = world.with_closed(["kitchen"])
    assert _spans(closed.blocks) - _spans(world.blocks) == {(1.55, 2.45, 0.0, DOOR_HEIGHT, "wood")}
    assert occupied(closed.grid)[points_row(2.5), 10:170].all()
    assert not occupied(world.grid)[points_row(2.5), 10:170].all()
    assert len({block.seed for block in closed.blocks}) == len(closed.blocks)


def points_row(y: float) -> int:
    """Row of the cells of the plan above at this y [m]."""
    return math.floor((y + 0.5) / 0.05)


def test_a_table_is_a_top_on_four_legs_under_its_corners(tmp_path: Path) -> None:
    table = "tables:\n  - {centre: [5.0, 1.2], size: [1.2, 0.8], yaw: 0.5, height: 0.75, top: 0.05, legs: 0.06}\n"
    top, *legs = [block for block in _world(tmp_path, table).blocks if block.material == "wood"]
    assert (top.low, top.high, top.length, top.width) == (0.7, 0.75, 1.2, 0.8)
    assert {(leg.low, leg.high, leg.length, leg.width) for leg in legs} == {(0.0, 0.7, 0.06, 0.06)}
    corners = transform_points(top.middle.inverse(), np.array([(leg.middle.x, leg.middle.y) for leg in legs]))
    assert sorted(map(tuple, corners.round(6).tolist())) == [(-0.57, -0.37), (-0.57, 0.37), (0.57, -0.37), (0.57, 0.37)]


@pytest.mark.parametrize(
    ("low", "high", "solid"),
    [(0.0, 0.03, False), (0.0, 0.04, True), (1.19, 1.3, True), (1.2, 1.3, False), (0.7, 0.74, True)],
)
def test_a_chair_is_stopped_by_blocks_that_it_neither_rolls_over_nor_passes_under(
    tmp_path: Path, low: float, high: float, solid: bool
) -> None:
    world = _world(tmp_path, f"boxes:\n  - {{centre: [5.0, 1.2], size: [0.5, 0.5], low: {low}, high: {high}}}\n")
    points = points_from_cells(world.grid, np.argwhere(occupied(world.grid)))
    assert bool((np.abs(points - (5.0, 1.2)) < 0.25).all(axis=1).any()) is solid


def _cells_by_hand(world: World) -> BoolArray:
    cells = np.argwhere(np.ones(world.grid.cells.shape, np.bool_))
    points = points_from_cells(world.grid, cells)
    standing = [block for block in world.blocks if block.high > 0.03 and block.low < 1.2]
    solid = np.zeros(len(points), np.bool_)
    for thing in (*standing, *world.pits):
        local = np.abs(transform_points(thing.middle.inverse(), points))
        solid |= np.all(local <= np.array([thing.length, thing.width]) / 2 + 1e-9, axis=1)
    return solid.reshape(world.grid.cells.shape)


@pytest.mark.parametrize("name", ["small_clinic", "stairs", "table", "glass_door", "two_floors"])
def test_the_grid_has_the_blocks_and_pits_that_stop_a_chair(name: str) -> None:
    world = load_world(name)
    np.testing.assert_array_equal(occupied(world.grid), _cells_by_hand(world))


def test_seeds_are_the_same_in_every_run_and_differ_for_every_name() -> None:
    assert seed_from_names("flat", "walls", 0) == 1886369904
    assert len({seed_from_names("flat", "walls", i, k) for i in range(50) for k in range(20)}) == 1000
    assert all(0 <= seed_from_names("x", i) < 2**31 for i in range(100))


def test_things_of_one_given_seed_look_alike_and_others_do_not(tmp_path: Path) -> None:
    boxes = "".join(
        f"  - {{centre: [{x}.0, 1.2], size: [0.5, 0.5], seed: {seed}}}\n" for x, seed in ((3, 7), (5, 7), (7, 8))
    )
    first, second, third = (
        block.seed for block in _world(tmp_path, "boxes:\n" + boxes).blocks if block.material == "wood"
    )
    assert first == second != third


def test_lamps_hang_on_a_lattice_under_the_ceiling_but_not_in_walls(tmp_path: Path) -> None:
    world = _world(tmp_path, "light: {ambient: 0.1, power: 0.7, spacing: 1.0}\n")
    assert len(world.lamps) == 8 * 5 - 8  # the middle row would hang in the wall
    assert [lamp.z for lamp in world.lamps] == pytest.approx([2.65] * 32)
    assert {lamp.power for lamp in world.lamps} == {0.7}
    assert world.finish.ambient == 0.1


def test_given_lamps_replace_the_lattice(tmp_path: Path) -> None:
    lamps = _world(tmp_path, "lamps:\n  - {at: [2.0, 1.0], power: 0.5}\n  - {at: [4.0, 1.0], height: 1.8}\n").lamps
    values = np.array([(lamp.x, lamp.y, lamp.z, lamp.power) for lamp in lamps])
    assert values == pytest.approx(np.array([(2.0, 1.0, 2.65, 0.5), (4.0, 1.0, 1.8, 1.0)]))


@pytest.mark.parametrize(("side", "y", "looks"), [("left", 2.55, math.pi / 2), ("right", 2.45, -math.pi / 2)])
def test_a_poster_hangs_on_the_given_side_of_its_wall(tmp_path: Path, side: str, y: float, looks: float) -> None:
    given = f"    posters:\n      - {{at: 7.0, side: {side}, height: 1.5, size: [0.5, 0.7]}}\n"
    (poster,) = _world(tmp_path, given).posters
    assert (poster.middle.x, poster.middle.theta) == pytest.approx((7.0, looks))
    assert 0.0 < abs(poster.middle.y - 2.5) - 0.05 < 0.01
    assert poster.middle.y == pytest.approx(y, abs=0.01)
    assert (poster.height, poster.length, poster.width) == (1.5, 0.5, 0.7)


@pytest.mark.parametrize(
    ("tag", "said"),
    [
        ("at: 7.0, number: 12, side: right", ""),
        ("at: 7.0, number: 587", r"tags\[0\]\.number: expected `int` <= 586"),
        ("at: 7.95, number: 1", r"tags\[0\]\.at: a tag of 0.25 m at 7.95 m lies outside its wall"),
        ("at: 7.0, number: 1, height: 0.05", r"tags\[0\]\.height: a tag 0.25 m high at 0.05 m reaches beyond"),
    ],
)
def test_a_tag_hangs_on_a_wall_as_a_poster_does(tmp_path: Path, tag: str, said: str) -> None:
    given = f"    tags:\n      - {{{tag}}}\n"
    if said:
        with pytest.raises(WorldError, match=said):
            _world(tmp_path, given)
        return
    (found,) = _world(tmp_path, given).tags
    assert (found.number, found.height, found.side) == (12, 1.2, 0.25)
    assert (found.middle.x, found.middle.y) == pytest.approx((7.0, 2.446), abs=0.001)
    assert found.middle.theta == pytest.approx(-math.pi / 2)


def _corners(world: World, off: float) -> FloatArray:
    """Corners (N, 3) [m] of all posters, `off` [m] before them."""
    return np.array(
        [
            (*transform_points(p.middle, np.array([[off, a * p.length / 2]]))[0], p.height + b * p.width / 2)
            for p in world.posters
            for a in (-1, 1)
            for b in (-1, 1)
        ]
    )


@pytest.mark.parametrize("name", ["second_floor", "apartment", "two_floors", "glass_door"])
def test_posters_hang_flat_on_walls_and_nothing_hides_them(name: str) -> None:
    world = load_world(name)
    assert within_any(_corners(world, -0.02), world.blocks).all()
    assert not within_any(_corners(world, 0.02), world.blocks).any()


def test_the_number_of_posters_follows_the_density_and_they_are_the_same_in_every_run(tmp_path: Path) -> None:
    more = ROOM + "poster_density: 0.5\nplaces: {}\n"
    world, again = _world(tmp_path, more), _world(tmp_path, more)
    length = 2 * (8.0 - 0.9 - 0.8) + 26.0  # both faces of the wall, the inner faces of the room
    assert len(world.posters) == pytest.approx(0.5 * length, rel=0.2)
    assert world.posters == again.posters
    other = _world(tmp_path, more, PLAN.replace("name: flat", "name: other"))
    assert {poster.middle for poster in other.posters}.isdisjoint({poster.middle for poster in world.posters})


def test_posters_hang_neither_on_glass_nor_above_a_low_ceiling(tmp_path: Path) -> None:
    glass = PLAN.replace("end: [8.0, 2.5]", "end: [8.0, 2.5]\n    material: glass")
    assert not _world(tmp_path, "poster_density: 1.0\n", glass).posters
    low = _world(tmp_path, "poster_density: 1.0\nfinish: {height: 1.9}\n").posters
    assert low
    assert all(poster.height + poster.width / 2 <= 1.9 for poster in low)


def test_a_door_closed_twice_has_one_leaf(tmp_path: Path) -> None:
    world = _world(tmp_path)
    assert len(world.with_closed(["kitchen", "kitchen"]).blocks) == len(world.blocks) + 1


def test_movers_are_placed_within_the_walls_apart_and_the_same_in_every_run(tmp_path: Path) -> None:
    more = ROOM + "people:\n  - {behaviour: bounce, count: 12, speed: 0.2, radius: 0.2}\n"
    plan = PLAN.replace("{name: kitchen, at: 2.0, width: 0.9}", "{name: kitchen, at: 2.0, width: 0.9, closed: true}")
    world = _world(tmp_path, more, plan)
    points = np.concatenate([person.path for person in world.people])
    assert points.shape == (12, 2)
    assert {person.behaviour for person in world.people} == {PersonBehaviour.BOUNCE}
    assert (points > 0.25).all()
    assert (points < (7.75, 2.25)).all()  # the doors are closed: no mover is in the other room
    apart = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1)) + 9.0 * np.eye(12)
    assert apart.min() > 0.4
    again = _world(tmp_path, more, plan)
    np.testing.assert_array_equal(points, np.concatenate([person.path for person in again.people]))


def test_a_person_has_the_properties_of_the_plan(tmp_path: Path) -> None:
    more = "people:\n  - {behaviour: sudden, path: [[5.0, 1.5], [3.0, 1.2]], speed: 1.2, yields: false, trigger: 2.5}\n"
    (person,) = _world(tmp_path, more).people
    assert (person.behaviour, person.speed, person.yields) == (PersonBehaviour.SUDDEN, 1.2, False)
    assert (person.radius, person.trigger) == (0.25, 2.5)
    assert person.path.tolist() == [[5.0, 1.5], [3.0, 1.2]]
