"""Worlds from maps and from the BARN benchmark."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import MapNotFound, WorldError
from waychair.maps.drawn.places import save_places
from waychair.maps.folders.map_files import save_map
from waychair.maps.grid.cells import cells_from_points, occupied, occupied_points
from waychair.simulation.plan.imports import world_from_barn, world_from_map
from waychair.simulation.plan.world import World
from waychair.simulation.scene.contact import in_contact, solid_from_blocks
from waychair.types import OccupancyGrid, Place, Pose2

BARN = """\
world 7
rows 3
cols 4
cell 0.15
origin_x -4.425
origin_y 0.075
radius 0.075
start -2.25 3.0 1.5708
goal -2.25 13.0
path_length 11.5
path 0,0
grid
#...
....
..##
"""


def _barn(tmp_path: Path, text: str = BARN, scale: float = 1.0) -> World:
    path = tmp_path / "world_007.txt"
    path.write_text(text, encoding="utf-8")
    return world_from_barn(path, scale)


def test_a_saved_map_becomes_a_world_with_its_places(tmp_path: Path) -> None:
    cells = np.zeros((40, 60), np.int8)
    cells[20] = 100
    grid = OccupancyGrid(cells, 0.05, Pose2(-1.0, -0.5, 0.0))
    save_map(tmp_path / "home", grid)
    save_places(tmp_path / "home", {"desk": Place("desk", Pose2(1.0, 0.0, 1.0))})
    for path in (tmp_path / "home", tmp_path / "home" / "map.yaml"):
        world = world_from_map(path, Pose2(0.5, 0.0, 0.0))
        assert (world.name, world.start, world.places) == (
            "home",
            Pose2(0.5, 0.0, 0.0),
            (Place("desk", Pose2(1.0, 0.0, 1.0)),),
        )
        np.testing.assert_array_equal(world.grid.cells, cells)


def test_a_missing_map_or_one_with_its_start_in_a_wall_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MapNotFound):
        world_from_map(tmp_path, Pose2())
    save_map(tmp_path, OccupancyGrid(np.full((9, 9), 100, np.int8), 0.1))
    with pytest.raises(WorldError, match="solid"):
        world_from_map(tmp_path, Pose2(0.45, 0.45, 0.0))


def _discs(centres: list[tuple[float, float]], radius: float, points: np.ndarray) -> np.ndarray:
    """Return the points (N, 2) that lie in one of the discs, by the plain definition."""
    return np.array([any(math.dist(point, centre) <= radius + 1e-9 for centre in centres) for point in points])


@pytest.mark.parametrize("scale", [1.0, 1.63, 3.0])
def test_barn_cylinders_stand_on_their_lattice_with_the_top_line_at_the_largest_y(tmp_path: Path, scale: float) -> None:
    world = _barn(tmp_path, scale=scale)
    centres = [(scale * x, scale * y) for x, y in ((-4.425, 0.375), (-4.125, 0.075), (-3.975, 0.075))]
    points = occupied_points(world.grid)
    assert _discs(centres, scale * 0.075, points).all()
    assert len(points) * world.grid.resolution**2 == pytest.approx(3 * math.pi * (0.075 * scale) ** 2, rel=0.15)
    solid = occupied(world.grid)
    assert all(solid[tuple(cell)] for cell in cells_from_points(world.grid, np.array(centres)))


def test_barn_start_and_goal_are_scaled_and_lie_on_free_ground(tmp_path: Path) -> None:
    world = _barn(tmp_path, scale=2.0)
    assert (world.start.x, world.start.y, world.start.theta) == pytest.approx((-4.5, 6.0, 1.5708))
    (goal,) = world.places
    assert goal.name == "goal"
    assert (goal.pose.x, goal.pose.y) == pytest.approx((-4.5, 26.0))


def test_a_real_barn_world_holds_every_cylinder_and_a_chair_at_its_start(data_dir: Path) -> None:
    path = data_dir / "barn" / "worlds" / "world_001.txt"
    if not path.is_file():
        pytest.skip(f"{path} is not there")
    drawn = path.read_text(encoding="utf-8").partition("grid\n")[2].count("#")
    world = world_from_barn(path, 1.63)
    area = occupied(world.grid).sum() * world.grid.resolution**2
    assert area == pytest.approx(drawn * math.pi * (0.075 * 1.63) ** 2, rel=0.05)
    solid = solid_from_blocks(world.blocks, world.pits)
    assert not in_contact(solid, CHAIR_A, world.start)
    assert not in_contact(solid, CHAIR_A, world.places[0].pose)


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("grid\n", "", "no line `grid`"),
        ("rows 3", "rows 4", "3 lines instead of 4"),
        (
            "start -2.25 3.0 1.5708",
            "start 1e300 3.0 1.5708",
            r"`start` is 1e300 3.0 1.5708: give 3 numbers up to 1e\+06",
        ),
        ("cell 0.15", "cell 1e300", r"up to 1e\+06"),
        ("....\n", "...\n", r"line 14: '\.\.\.' is not a row of the grid; give 4"),
        ("....\n", "..x.\n", r"line 14: '\.\.x\.' is not a row"),
        ("start -2.25 3.0 1.5708\n", "", "`start` is missing: give 3"),
        ("goal -2.25 13.0", "goal -2.25 nan", "`goal` is -2.25 nan"),
        ("cell 0.15", "cell wide", "`cell` is wide"),
        ("radius 0.075", "radius -1", "must be greater than 0"),
        ("start -2.25 3.0", "start -4.425 0.375", "start.* solid"),
    ],
)
def test_an_invalid_barn_file_is_refused(tmp_path: Path, old: str, new: str, named: str) -> None:
    assert old in BARN
    with pytest.raises(WorldError, match=named):
        _barn(tmp_path, BARN.replace(old, new))


def test_a_barn_file_without_a_grid_is_refused(tmp_path: Path) -> None:
    text = BARN.replace("rows 3", "rows 0")
    with pytest.raises(WorldError, match="the grid has no lines"):
        _barn(tmp_path, text[: text.index("grid") + len("grid\n")])


@pytest.mark.parametrize("scale", [0.0, -1.0, math.nan, 11.0])
def test_an_impossible_scale_is_refused(tmp_path: Path, scale: float) -> None:
    with pytest.raises(WorldError, match="scale"):
        _barn(tmp_path, scale=scale)


def test_a_missing_barn_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match="cannot read"):
        world_from_barn(tmp_path / "none.txt")
