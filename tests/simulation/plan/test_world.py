"""Worlds from floor plans and from mapped grids."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from waychair.errors import WorldError
from waychair.maps.grid.cells import occupied, occupied_points
from waychair.simulation.plan.world import (
    load_world,
    world_from_grid,
)
from waychair.simulation.scene.contact import solid_from_blocks
from waychair.types import OccupancyGrid, Place, Pose2

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


def test_a_plan_becomes_a_grid_with_its_walls_in_their_drawn_places(tmp_path: Path) -> None:
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


def test_an_oblique_wall_has_no_hole_for_a_beam(tmp_path: Path) -> None:
    path = tmp_path / "plan.yaml"
    path.write_text(PLAN.replace("end: [4.0, 2.0]", "end: [4.0, 2.9]"), encoding="utf-8")
    solid = occupied(load_world(path).grid)
    # Between its ends neighbouring columns share a row of the wall: its cells meet at faces, not only at corners.
    assert all((solid[45:, col] & solid[45:, col + 1]).any() for col in range(12, 88))


def test_an_unknown_door_is_refused_with_the_known_ones() -> None:
    with pytest.raises(WorldError, match="no door 'gate': take one of reception, bath, ward"):
        load_world("small_clinic").with_closed(["bath", "gate"])
    with pytest.raises(WorldError, match="no doors with names"):
        load_world("corridor_t").with_closed(["gate"])


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
def test_an_invalid_plan_is_refused_with_its_key_or_line(tmp_path: Path, old: str, new: str, named: str) -> None:
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
    assert len(solid_from_blocks(world.blocks).boxes) == 1
    assert world.routes == {}


def test_a_mapped_grid_with_its_start_in_a_wall_is_refused() -> None:
    with pytest.raises(WorldError, match="start"):
        world_from_grid(OccupancyGrid(np.full((40, 40), 100, np.int8), 0.05), Pose2(1.0, 1.0, 0.0))
