"""The physical model as text: the ground of the plan, and a chair of the stated masses and sizes."""

from __future__ import annotations

import math
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.errors import ConfigError, WorldError
from waychair.geometry import transform_points
from waychair.simulation.plan.world import World, load_world, world_from_grid
from waychair.simulation.plant.chair_file import CHAIRS
from waychair.simulation.plant.mujoco_ground import FLOOR, WALL
from waychair.simulation.plant.mujoco_model import MujocoSettings, mjcf
from waychair.simulation.plant.plant import PlantSettings
from waychair.simulation.scene.scene import Block, Pit, Slope
from waychair.types import OccupancyGrid, Pose2

GRID = OccupancyGrid(np.zeros((200, 200), np.int8), 0.05)
NO_WALLS = World("empty", GRID, Pose2(5.0, 5.0, 0.0))


def _model(world: World, body: ChairBody = CHAIR_A, settings: MujocoSettings | None = None) -> tuple[Any, Any]:
    """Model and data, after kinematics."""
    text = mjcf(world, body, PlantSettings(), settings or MujocoSettings(), Pose2())
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def _height(model: Any, data: Any, x: float, y: float) -> float:
    """Height [m] of the ground at (x, y), found with a ray from above the blocks."""
    geom = np.zeros(1, np.int32)
    down = mujoco.mj_ray(model, data, [x, y, 3.0], [0.0, 0.0, -1.0], None, 1, model.body("chair").id, geom)
    return 3.0 - float(down)


@given(
    x=st.floats(1.0, 9.0),
    y=st.floats(1.0, 9.0),
    theta=st.floats(-3.1, 3.1),
    length=st.floats(0.05, 4.0),
    width=st.floats(0.05, 1.0),
    low=st.floats(0.0, 0.8),
)
def test_a_block_is_a_box_exactly_at_its_planned_place(
    x: float, y: float, theta: float, length: float, width: float, low: float
) -> None:
    block = Block(Pose2(x, y, theta), length, width, low, 2.7)
    model, data = _model(World("one", GRID, Pose2(), blocks=(block,)))
    (wall,) = np.flatnonzero(model.geom_conaffinity == WALL)
    assert data.geom_xpos[wall] == pytest.approx([x, y, (low + 2.7) / 2])
    assert model.geom_size[wall] == pytest.approx([length / 2, width / 2, (2.7 - low) / 2])
    assert data.geom_xmat[wall][[0, 3]] == pytest.approx([math.cos(theta), math.sin(theta)])


def test_a_wall_is_at_its_cells_on_a_rotated_grid() -> None:
    cells = np.zeros((20, 30), np.int8)
    cells[4:6, 10:20] = 100
    grid = OccupancyGrid(cells, 0.1, Pose2(3.0, -2.0, 0.5))
    model, data = _model(world_from_grid(grid, grid.map_from_grid @ Pose2(0.2, 0.2)))
    (wall,) = np.flatnonzero(model.geom_conaffinity == WALL)
    middle = grid.map_from_grid @ Pose2(1.5, 0.5, 0.0)
    assert data.geom_xpos[wall, :2] == pytest.approx([middle.x, middle.y])
    assert model.geom_size[wall, :2] == pytest.approx([0.5, 0.1])
    assert data.geom_xmat[wall, :2] == pytest.approx([math.cos(0.5), -math.sin(0.5)])


def test_the_clinic_has_as_many_boxes_as_blocks_that_the_chair_can_reach() -> None:
    world = load_world("small_clinic")
    model, _ = _model(world)
    reachable = [block for block in world.blocks if block.low < MujocoSettings().outline_high]
    boxes = (model.geom_type == mujoco.mjtGeom.mjGEOM_BOX) & (model.geom_bodyid == 0)
    assert boxes.sum() == len(reachable)
    assert len(reachable) > 20


@pytest.mark.parametrize(("low", "high", "kept"), [(0.89, 1.0, True), (0.9, 1.0, False), (2.05, 2.7, False)])
def test_blocks_above_the_chair_are_left_out(low: float, high: float, kept: bool) -> None:
    model, _ = _model(World("one", GRID, Pose2(), blocks=(Block(Pose2(2.0, 2.0), 1.0, 1.0, low, high),)))
    assert (model.geom_conaffinity == WALL).any() == kept


@pytest.mark.parametrize(("high", "bit"), [(0.02, FLOOR), (0.10, FLOOR), (0.11, WALL), (-0.2, FLOOR)])
def test_steps_touch_the_wheels_only_and_higher_blocks_are_walls(high: float, bit: int) -> None:
    model, _ = _model(World("one", GRID, Pose2(), blocks=(Block(Pose2(2.0, 2.0), 1.0, 1.0, -1.0, high),)))
    boxes = np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_BOX) & (model.geom_bodyid == 0))
    assert model.geom_conaffinity[boxes].tolist() == [bit]


def test_the_landing_of_a_ramp_is_ground() -> None:
    ramp, landing = Slope(Pose2(2.0, 2.0), 3.0, 1.0, 0.0, 0.25), Block(Pose2(4.0, 2.0), 1.0, 1.0, 0.0, 0.25)
    model, data = _model(World("one", GRID, Pose2(), blocks=(landing,), slopes=(ramp,)))
    assert not (model.geom_conaffinity == WALL).any()
    assert _height(model, data, 4.0, 2.0) == pytest.approx(0.25)


@given(theta=st.floats(-3.1, 3.1), along=st.floats(-0.49, 0.49), across=st.floats(-0.49, 0.49))
def test_a_slope_rises_evenly_from_its_low_to_its_high_end(theta: float, along: float, across: float) -> None:
    middle = Pose2(5.0, 5.0, theta)
    model, data = _model(World("one", GRID, Pose2(), slopes=(Slope(middle, 3.0, 1.2, 0.0, 0.25),)))
    ((x, y),) = transform_points(middle, np.array([[3.0 * along, 1.2 * across]])).tolist()
    assert _height(model, data, x, y) == pytest.approx(0.125 + 0.25 * along, abs=1e-6)


@pytest.mark.parametrize("theta", [0.0, 0.4, math.pi / 2, -2.0])
def test_the_floor_is_missing_over_pits_only(theta: float) -> None:
    turn = Pose2(5.0, 5.0, theta)
    pits = (
        Pit(turn @ Pose2(-1.0, 0.0, 0.0), 1.5, 0.8, 1.2),
        Pit(turn @ Pose2(1.5, 0.5, math.pi / 2), 1.0, 0.6, 0.5),
    )
    step = Block(pits[0].middle @ Pose2(-0.6, 0.0, 0.0), 0.3, 0.8, -1.2, -0.15)
    model, data = _model(World("pits", GRID, Pose2(), pits=pits, blocks=(step,)))
    points = np.random.default_rng(0).uniform(-3.0, 3.0, (400, 2))
    for (x, y), (map_x, map_y) in zip(points.tolist(), transform_points(turn, points).tolist(), strict=True):
        depth = 0.0
        if abs(x + 1.0) < 0.75 and abs(y) < 0.4:
            depth = -0.15 if x < -1.45 else -1.2
        if abs(x - 1.5) < 0.3 and abs(y - 0.5) < 0.5:
            depth = -0.5
        assert _height(model, data, map_x, map_y) == pytest.approx(depth, abs=1e-6)


def test_pits_at_odd_angles_to_each_other_are_refused() -> None:
    pits = (Pit(Pose2(2.0, 2.0), 1.0, 1.0, 1.0), Pit(Pose2(6.0, 6.0, 0.3), 1.0, 1.0, 1.0))
    with pytest.raises(WorldError, match=r"turned by 17\.1887 degrees"):
        _model(World("odd", GRID, Pose2(), pits=pits))


@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_B])
def test_the_chair_weighs_149_kg(body: ChairBody) -> None:
    model, _ = _model(NO_WALLS, body)
    assert model.body_mass.sum() == pytest.approx(148.6)
    assert (model.body_mass[model.body("chair").id :] > 0.0).all()


@pytest.mark.parametrize("name", CHAIRS)
def test_all_parts_of_a_chair_are_within_its_outline_and_its_drive_wheels_under_its_base(name: str) -> None:
    body = CHAIRS[name].body
    model, data = _model(NO_WALLS, body, CHAIRS[name].mujoco)
    rider = (model.geom_type == mujoco.mjtGeom.mjGEOM_ELLIPSOID) & (model.geom_bodyid == model.body("chair").id)
    for geom in np.flatnonzero((model.geom_bodyid > 0) & ~rider):
        half = np.abs(data.geom_xmat[geom].reshape(3, 3)) @ model.geom_aabb[geom, 3:]
        x, y, z = data.geom_xpos[geom]
        assert -body.rear - 1e-6 <= x - half[0] <= x + half[0] <= body.front + 1e-6
        assert abs(y) + half[1] <= body.width / 2 + 1e-6
        assert z - half[2] > -1e-4
    wheels = [model.joint(side).bodyid[0] for side in ("left", "right")]
    assert data.xpos[wheels][:, :2] == pytest.approx(np.array([[0.0, body.track / 2], [0.0, -body.track / 2]]))


@pytest.mark.parametrize(("name", "ahead", "behind"), [("A", 2, 0), ("A_mid", 2, 2), ("A_front", 0, 2)])
def test_casters_are_clear_of_the_drive_wheels(name: str, ahead: int, behind: int) -> None:
    model, data = _model(NO_WALLS, CHAIRS[name].body, CHAIRS[name].mujoco)
    swivels = [
        j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE and model.jnt_axis[j, 2]
    ]
    xs = data.xanchor[swivels][:, 0]
    assert ((xs > 0.1).sum(), (xs < -0.1).sum()) == (ahead, behind)
    radius, trail = CHAIRS[name].mujoco.caster_radius, CHAIRS[name].mujoco.caster_trail
    assert (np.abs(xs) - radius - trail > CHAIRS[name].body.wheel_radius).all()  # they swing clear of the drive wheels


def test_the_wheels_have_the_true_radii_and_track_of_the_plant_and_stand_on_the_floor() -> None:
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
    with pytest.raises(ConfigError, match=r"outline_high = 0\.1 is impossible: it must lie above outline_low = 0\.3 m"):
        MujocoSettings(outline_low=0.3, outline_high=0.1)
