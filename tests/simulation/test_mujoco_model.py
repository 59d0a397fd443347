"""The physical model as text: walls from cells, and a chair of the stated masses and sizes."""

from __future__ import annotations

import math
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from waychair.calibration.chair import CHAIR_A, CHAIR_B, ChairBody
from waychair.errors import ConfigError
from waychair.maps.grid import occupied
from waychair.simulation.mujoco_model import WALL, MujocoSettings, mjcf, rectangles_from_cells
from waychair.simulation.plant import PlantSettings
from waychair.simulation.world import load_world
from waychair.types import BoolArray, OccupancyGrid, Pose2

NO_WALLS = OccupancyGrid(np.zeros((4, 4), np.int8), 0.05)


@given(
    arrays(np.bool_, array_shapes(min_dims=2, max_dims=2, min_side=0, max_side=12)),
    st.sampled_from([1, 3]),
)
def test_rectangles_cover_every_set_cell_once_and_no_other(cells: BoolArray, scale: int) -> None:
    cells = np.kron(cells, np.ones((scale, scale), np.bool_))
    covered = np.zeros(cells.shape, int)
    for row, col, height, width in rectangles_from_cells(cells).tolist():
        assert height > 0
        assert width > 0
        covered[row : row + height, col : col + width] += 1
    np.testing.assert_array_equal(covered, cells)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (7, 5)])
def test_a_solid_block_is_one_rectangle(shape: tuple[int, int]) -> None:
    cells = np.zeros((12, 12), np.bool_)
    cells[2 : 2 + shape[0], 3 : 3 + shape[1]] = True
    assert rectangles_from_cells(cells).tolist() == [[2, 3, *shape]]


def test_a_corner_of_two_walls_is_two_rectangles_whichever_is_longer() -> None:
    for rows, cols in ((30, 10), (10, 30)):
        cells = np.zeros((40, 40), np.bool_)
        cells[5 : 5 + rows, 5:7] = True
        cells[5:7, 5 : 5 + cols] = True
        assert len(rectangles_from_cells(cells)) == 2


def test_the_clinics_walls_become_few_boxes() -> None:
    solid = occupied(load_world("small_clinic").grid)
    assert 20 < len(rectangles_from_cells(solid)) < 60 < solid.sum() / 20


def test_a_wall_is_where_its_cells_are_on_a_grid_that_is_turned() -> None:
    cells = np.zeros((20, 30), np.int8)
    cells[4:6, 10:20] = 100
    grid = OccupancyGrid(cells, 0.1, Pose2(3.0, -2.0, 0.5))
    model = mujoco.MjModel.from_xml_string(mjcf(grid, CHAIR_A, PlantSettings(), MujocoSettings(), Pose2()))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    walls = np.flatnonzero(model.geom_conaffinity == WALL)
    assert len(walls) == 1
    middle = grid.map_from_grid @ Pose2(1.5, 0.5, 0.0)
    assert data.geom_xpos[walls[0], :2] == pytest.approx([middle.x, middle.y])
    assert model.geom_size[walls[0], :2] == pytest.approx([0.5, 0.1])
    assert data.geom_xmat[walls[0], :2] == pytest.approx([math.cos(0.5), -math.sin(0.5)])


@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_B])
def test_the_chair_weighs_149_kg_and_nothing_of_it_sticks_out_of_its_outline(body: ChairBody) -> None:
    model = mujoco.MjModel.from_xml_string(mjcf(NO_WALLS, body, PlantSettings(), MujocoSettings(), Pose2()))
    assert model.body_mass.sum() == pytest.approx(148.6)
    assert (model.body_mass[model.body("chair").id :] > 0.0).all()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for geom in range(1, model.ngeom):
        half = np.abs(data.geom_xmat[geom].reshape(3, 3)) @ model.geom_aabb[geom, 3:]
        x, y, _ = data.geom_xpos[geom]
        assert -body.rear - 1e-6 <= x - half[0] <= x + half[0] <= body.front + 1e-6
        assert abs(y) + half[1] <= body.width / 2 + 1e-6


def test_true_radii_and_track_of_the_plant_shape_the_wheels_which_all_stand_on_the_floor() -> None:
    plant = PlantSettings(left_wheel_scale=1.01, right_wheel_scale=0.99, track_scale=1.02)
    root = ElementTree.fromstring(mjcf(NO_WALLS, CHAIR_A, plant, MujocoSettings(), Pose2()))
    for side, scale in (("left", 1.01), ("right", 0.99)):
        wheel = root.find(f".//joint[@name='{side}']/..")
        assert wheel is not None
        geom = wheel.find("geom")
        assert geom is not None
        radius = float(geom.attrib["size"].split()[0])
        _, y, z = (float(value) for value in wheel.attrib["pos"].split())
        assert radius == pytest.approx(0.165 * scale)
        assert abs(y) == pytest.approx(0.54 * 1.02 / 2)
        assert 0.165 + z == pytest.approx(radius)


def test_impossible_physics_is_refused() -> None:
    with pytest.raises(ConfigError, match="rider_mass"):
        MujocoSettings(rider_mass=0.0)
