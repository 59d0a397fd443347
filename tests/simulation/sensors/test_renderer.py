"""The renderer: exact depth, light fixed in the world, surfaces as unique as their seeds."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Iterator

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import MissingExtra
from waychair.geometry import in_space
from waychair.simulation.plan.world import World, load_world
from waychair.simulation.scene.scene import Block, Finish, Lamp, PersonBehaviour, PersonState, Pit, Slope
from waychair.simulation.sensors import renderer as renderer_module
from waychair.simulation.sensors.renderer import (
    NEAR,
    RenderedImage,
    Renderer,
    camera_matrix,
    metres_from_depth,
    renderer_problem,
)
from waychair.types import Bytes, FloatArray, OccupancyGrid, Pose2, Pose3

if renderer_problem():
    pytest.skip(str(renderer_problem()), allow_module_level=True)

WIDTH, HEIGHT = 320, 240
MATRIX = camera_matrix(WIDTH, HEIGHT, math.radians(69.0))
LAMPS = tuple(Lamp(x, y, 2.45) for x in (2.0, 5.0, 8.0) for y in (2.0, 6.0))


def _hall(*blocks: Block, **parts: object) -> World:
    """10 x 8 m between four walls."""
    walls = (
        Block(Pose2(5.0, 0.0, 0.0), 10.2, 0.2, 0.0, 2.5, seed=101),
        Block(Pose2(5.0, 8.0, 0.0), 10.2, 0.2, 0.0, 2.5, seed=102),
        Block(Pose2(0.0, 4.0, 0.0), 0.2, 8.2, 0.0, 2.5, seed=103),
        Block(Pose2(10.0, 4.0, 0.0), 0.2, 8.2, 0.0, 2.5, seed=104),
    )
    grid = OccupancyGrid(np.zeros((180, 220), np.int8), 0.05, Pose2(-0.5, -0.5, 0.0))
    parts = {"lamps": LAMPS, "finish": Finish(height=2.5), **parts}
    return World("hall", grid, Pose2(1.0, 1.0, 0.0), blocks=walls + blocks, **parts)  # type: ignore[arg-type]


def _seen_from(x: float, y: float, theta: float) -> Pose3:
    return in_space(Pose2(x, y, theta)) @ CHAIR_A.base_from_camera


def _render(world: World, pose: Pose3, *people: PersonState, exposure: float = 0.4) -> RenderedImage:
    renderer = Renderer(world, MATRIX, WIDTH, HEIGHT)
    picture = renderer.render(pose, people, exposure)
    renderer.release()
    return picture


def _rays(world: World, pose: Pose3, columns: FloatArray, rows: FloatArray) -> FloatArray:
    """Depth along the optical axis [m] of the nearest block, floor or ceiling at each pixel, by slabs."""
    optical = np.stack(
        [(columns - MATRIX[0, 2]) / MATRIX[0, 0], (rows - MATRIX[1, 2]) / MATRIX[1, 1], np.ones(len(rows))]
    )
    directions = (pose.rotation @ optical).T
    with np.errstate(divide="ignore"):
        nearest = np.where(directions[:, 2] < 0.0, 0.0, world.finish.height) - pose.translation[2]
        nearest = nearest / directions[:, 2]
        for block in world.blocks:
            c, s = math.cos(block.middle.theta), math.sin(block.middle.theta)
            local_from_map = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
            start = local_from_map @ (pose.translation - (block.middle.x, block.middle.y, 0.0))
            step = directions @ local_from_map.T
            low = np.array([-block.length / 2, -block.width / 2, block.low])
            high = np.array([block.length / 2, block.width / 2, block.high])
            enter = np.minimum((low - start) / step, (high - start) / step).max(axis=1)
            leave = np.maximum((low - start) / step, (high - start) / step).min(axis=1)
            hit = (enter < leave) & (enter > 0.0)
            nearest[hit] = np.minimum(nearest[hit], enter[hit])
    return nearest


@pytest.fixture(scope="module")
def floor() -> Iterator[tuple[World, Renderer]]:
    world = dataclasses.replace(load_world("second_floor"), posters=(), lamps=())
    world = dataclasses.replace(world, blocks=tuple(b for b in world.blocks if b.material != "glass"))
    renderer = Renderer(world, MATRIX, WIDTH, HEIGHT)
    yield world, renderer
    renderer.release()


def test_depth_equals_that_of_an_exact_ray(floor: tuple[World, Renderer]) -> None:
    world, renderer = floor
    rng = np.random.default_rng(5)
    errors = []
    for x, y in world.route()[:6]:
        pose = _seen_from(x, y, rng.uniform(-math.pi, math.pi))
        rows, columns = rng.integers(0, HEIGHT, 400), rng.integers(0, WIDTH, 400)
        depth = renderer.render(pose).depth[rows, columns]
        errors.append(np.abs(depth - _rays(world, pose, columns, rows)))
    # the rest are pixels on edges
    assert np.median(errors) < 0.0005
    assert np.mean(np.concatenate(errors) < 0.001) > 0.99


def test_the_depth_of_an_oblique_box_is_exact() -> None:
    world = _hall(Block(Pose2(3.5, 1.2, 0.6), 0.7, 0.4, 0.3, 0.9, "wood", 5), lamps=(Lamp(9.5, 7.5, 2.45),))
    pose = _seen_from(1.0, 1.0, 0.1)
    rows, columns = (v.ravel() for v in np.mgrid[0:HEIGHT:3, 0:WIDTH:3])
    expected = _rays(world, pose, columns, rows).reshape(HEIGHT // 3, -1)
    depth = _render(world, pose).depth[::3, ::3][:, : expected.shape[1]]
    assert np.mean(np.abs(depth - expected) < 0.001) > 0.995


def test_a_place_has_the_same_brightness_from_every_side() -> None:
    world = _hall()
    point = np.array([5.0, 7.9, 1.2])
    renderer = Renderer(world, MATRIX, WIDTH, HEIGHT)
    seen = []
    for x, y in ((4.0, 5.5), (5.0, 5.0), (6.3, 5.6), (5.2, 6.4)):
        pose = _seen_from(x, y, math.atan2(7.9 - y, 5.0 - x))
        column, row, depth = MATRIX @ pose.rotation.T @ (point - pose.translation)
        column, row = column / depth, row / depth
        reach = 0.25 * MATRIX[0, 0] / depth  # the same half metre of the wall
        colour = renderer.render(pose).colour
        patch = colour[round(row - reach) : round(row + reach), round(column - reach) : round(column + reach), :3]
        seen.append(np.square(patch / 255.0).mean(axis=(0, 1)))
    renderer.release()
    np.testing.assert_allclose(seen, np.tile(seen[0], (4, 1)), rtol=0.06)


def test_a_room_is_dark_behind_a_closed_wall() -> None:
    wall = Block(Pose2(5.0, 4.0, 0.0), 0.2, 8.0, 0.0, 2.5)
    world = _hall(wall, lamps=(Lamp(2.0, 4.0, 2.45),), finish=Finish(height=2.5, ambient=0.002))
    bright, dark = (_render(world, _seen_from(x, 4.0, math.pi / 2)).colour[..., :3].mean() for x in (2.0, 8.0))
    assert bright > 3 * dark > 0.0


def _wall_seen(seed: int, x: float, theta: float) -> Bytes:
    """Return the picture of an evenly lit block of this seed from 1.5 m before its middle, at any place."""
    block = Block(Pose2(x, 4.0, theta), 3.0, 0.3, 0.0, 2.5, seed=seed)
    before = (
        Pose2(x, 4.0, theta) @ Pose2(0.0, -1.65 - CHAIR_A.camera_x, math.pi / 2) @ Pose2(0.0, -CHAIR_A.camera_y, 0.0)
    )
    world = _hall(block, lamps=(Lamp(5.0, 4.0, 2.45, 0.0),), finish=Finish(height=2.5, ambient=1.0))
    pose = in_space(before) @ CHAIR_A.base_from_camera
    return _render(world, pose).colour[60:180, 90:230, :3].copy()


def test_equal_seeds_look_alike_at_any_place() -> None:
    here, there = _wall_seen(9, 5.0, 0.0), _wall_seen(9, 4.0, 0.8)
    assert np.abs(here.astype(int) - there).mean() < 1.0
    assert here.std() > 8.0


def test_different_seeds_look_different() -> None:
    seen = [_wall_seen(seed, 5.0, 0.0).astype(float).mean(axis=2) for seed in range(4)]
    for i in range(4):
        for j in range(i):
            assert abs(np.corrcoef(seen[i].ravel(), seen[j].ravel())[0, 1]) < 0.25


def test_floors_of_different_levels_look_different() -> None:
    pose = _seen_from(3.0, 4.0, 0.0)
    seen = [
        _render(_hall(level=level), pose).colour[170:, :, :3].astype(float).mean(axis=2) for level in ("1", "1", "2")
    ]
    np.testing.assert_array_equal(seen[0], seen[1])
    assert abs(np.corrcoef(seen[0].ravel(), seen[2].ravel())[0, 1]) < 0.4


def test_a_small_motion_of_the_camera_causes_no_flicker(floor: tuple[World, Renderer]) -> None:
    _, renderer = floor
    before = renderer.render(_seen_from(14.0, 7.1, math.pi)).colour[..., :3].astype(int)
    after = renderer.render(_seen_from(14.0, 7.1, math.pi + 0.0003)).colour[..., :3]
    change = np.abs(before - after)
    assert change.mean() < 2.0  # a tenth of a pixel
    assert np.mean(change > 60) < 0.002


def test_depth_goes_through_glass_and_not_through_a_mirror() -> None:
    pane = Block(Pose2(3.5, 1.2, 0.0), 0.02, 6.0, 0.0, 2.5, "glass")
    pose = _seen_from(1.0, 1.2, 0.0)
    rows, columns = np.array([60, 120]), np.array([160, 160])
    bare, glazed = _render(_hall(), pose), _render(_hall(pane), pose)
    np.testing.assert_array_equal(glazed.depth, bare.depth)
    assert np.all(glazed.colour[rows, columns, 3] < bare.colour[rows, columns, 3])
    assert np.any(glazed.colour[..., :3] != bare.colour[..., :3])
    mirror = _render(_hall(dataclasses.replace(pane, material="mirror")), pose)
    assert np.all(mirror.colour[rows, columns, 3] == 0)
    np.testing.assert_allclose(mirror.depth[rows, columns], 3.49 - 1.0 - CHAIR_A.camera_x, atol=0.1)


def test_a_stairway_is_visible_down_to_its_ground() -> None:
    pose = _seen_from(1.0, 4.0, 0.0)
    flat, sunken = (_render(_hall(pits=pits), pose).depth for pits in ((), (Pit(Pose2(5.0, 4.0, 0.0), 3.0, 2.0, 1.0),)))
    deeper = sunken > flat + 0.05
    assert 0.02 < deeper.mean() < 0.3
    assert np.isfinite(sunken).all()


def test_a_ramp_is_visible_above_the_floor() -> None:
    pose = _seen_from(1.0, 4.0, 0.0)
    flat = _render(_hall(), pose).depth
    ramp = _render(_hall(slopes=(Slope(Pose2(4.0, 4.0, 0.0), 2.4, 1.2, 0.0, 0.2),)), pose).depth
    assert 0.01 < np.mean(ramp < flat - 0.02) < 0.3


@pytest.mark.parametrize("behaviour", [PersonBehaviour.PATH, PersonBehaviour.SEATED, PersonBehaviour.BOUNCE])
def test_people_are_rendered_at_their_places(behaviour: PersonBehaviour) -> None:
    person = PersonState(Pose2(4.0, 4.2, 0.3), 1.0, 0.4, 0.25, behaviour, 3)
    pose = _seen_from(1.0, 4.0, 0.0)
    empty, picture = _render(_hall(), pose), _render(_hall(), pose, person)
    changed = picture.depth != empty.depth
    assert changed.mean() > 0.002
    ahead = np.median(picture.depth[changed]) + 1.0 + CHAIR_A.camera_x
    assert ahead == pytest.approx(4.0, abs=0.5)
    assert picture.colour[changed, 3].min() == 255


def test_people_behind_the_camera_change_nothing() -> None:
    person = PersonState(Pose2(0.6, 4.0, 0.0), 1.0, 0.4, 0.25, PersonBehaviour.PATH, 3)
    pose = _seen_from(3.0, 4.0, 0.0)
    np.testing.assert_array_equal(_render(_hall(), pose).colour, _render(_hall(), pose, person).colour)


def test_legs_move_with_the_stride() -> None:
    pose = _seen_from(1.0, 4.0, 0.0)
    seen = [
        _render(_hall(), pose, PersonState(Pose2(3.5, 4.2, math.pi / 2), 1.0, stride, 0.25, PersonBehaviour.PATH)).depth
        for stride in (0.0, math.pi / 2)
    ]
    assert np.mean(seen[0] != seen[1]) > 0.003


def test_a_world_without_blocks_lamps_or_people_shows_a_lit_floor() -> None:
    grid = OccupancyGrid(np.zeros((100, 100), np.int8), 0.05)
    picture = _render(World("empty", grid, Pose2()), _seen_from(1.0, 2.5, 0.0))
    assert np.isinf(picture.depth).any()
    assert picture.colour[-20:, :, :3].mean() > 30


def test_a_depth_buffer_is_converted_to_metres() -> None:
    z = np.array([[NEAR, 0.3, 1.0], [8.0, 40.0, np.inf]])
    depth = (1.0 - NEAR / z).astype(np.float32)
    metres_from_depth(depth)
    np.testing.assert_allclose(depth, z, rtol=3e-5)


@pytest.mark.parametrize("name", ["moderngl", "egl"])
def test_a_machine_that_cannot_render_names_the_package_to_install(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    import moderngl

    def no_egl(**_: object) -> None:
        raise RuntimeError("libEGL.so not loaded")

    if name == "egl":
        monkeypatch.setattr(moderngl, "create_context", no_egl)
    else:
        monkeypatch.setitem(sys.modules, "moderngl", None)
    with pytest.raises(MissingExtra, match="install") as caught:
        Renderer(_hall(), MATRIX, WIDTH, HEIGHT)
    assert ("[sim]" if name == "moderngl" else "libegl1") in str(caught.value)
    assert renderer_module.renderer_problem.__wrapped__() == str(caught.value)
