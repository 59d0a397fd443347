"""Light of lamps on faces: against a plain reference, with shadows, and packed without overlap."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.simulation.plan.world import World
from waychair.simulation.scene.scene import Block, Finish, Lamp
from waychair.simulation.sensors.light_map import (
    GLOW,
    HALF_LIGHT,
    REACH,
    SCATTERED,
    LightMap,
    default_lamps,
    light_face,
    light_map,
)
from waychair.simulation.sensors.looks import LOOKS
from waychair.simulation.sensors.surfaces import Surfaces, surfaces_from_world
from waychair.types import FloatArray, OccupancyGrid, Pose2

NAMES = tuple(LOOKS)
DARK = Finish(height=2.5, ambient=0.0)


def _lit(blocks: tuple[Block, ...], lamps: tuple[Lamp, ...], finish: Finish = DARK) -> tuple[Surfaces, LightMap]:
    grid = OccupancyGrid(np.zeros((80, 80), np.int8), 0.05)
    world = World("cell", grid, Pose2(1.0, 1.0, 0.0), blocks=blocks, lamps=lamps, finish=finish)
    surfaces = surfaces_from_world(world, NAMES)
    return surfaces, light_map(surfaces, surfaces.looks == NAMES.index("lamp"), blocks, lamps, finish)


def _floor_light(light: LightMap, x: float, y: float) -> float:
    """Red light on the floor of a hall of one piece; its corners come first."""
    rows, columns = light.texels.shape[:2]
    low, high = light.coordinates[0].min(axis=0), light.coordinates[0].max(axis=0)
    column, row = (low + (high - low) * np.array([x, y]) / 4.0) * (columns, rows) - 0.5
    return float(light.texels[round(float(row)), round(float(column)), 0])


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1))
@pytest.mark.nightly
def test_the_light_of_a_face_equals_a_plain_reference(seed: int) -> None:
    rng = np.random.default_rng(seed)
    anchor, axes = rng.uniform(-1.0, 1.0, 3), np.linalg.qr(rng.standard_normal((3, 3)))[0][:2]
    u, v = np.sort(rng.uniform(-2.0, 2.0, 4)), np.sort(rng.uniform(-1.0, 1.0, 3))
    lamps = np.column_stack([rng.uniform(-4.0, 4.0, (3, 3)), rng.uniform(0.1, 2.0, (3, 3))])
    angles = rng.uniform(-3.0, 3.0, 4)
    boxes = np.column_stack([rng.uniform(-3, 3, (4, 2)), np.cos(angles), np.sin(angles), rng.uniform(0.05, 0.8, (4, 2)), np.full(4, -2.0), rng.uniform(0.0, 2.0, 4)])  # fmt: skip
    window = np.full((3, 4, 3), 0.1)
    light_face(window, anchor, axes, u, v, lamps, boxes, np.arange(0, 13, 4), np.tile(np.arange(4), 3), boxes)
    normal = np.cross(*axes)
    for row in range(3):
        for column in range(4):
            point = anchor + u[column] * axes[0] + v[row] * axes[1] + 0.01 * normal
            if not any(_through(point, np.zeros(3), box) for box in boxes):
                np.testing.assert_allclose(window[row, column], 0.1 + _plain(point, normal, lamps, boxes), atol=1e-9)


def _plain(point: FloatArray, normal: FloatArray, lamps: FloatArray, boxes: FloatArray) -> FloatArray:
    total = np.zeros(3)
    for lamp in lamps:
        way = lamp[:3] - point
        distance = float(np.linalg.norm(way))
        if distance < REACH and not any(_through(point, way, box) for box in boxes):
            straight = max(float(way @ normal) / distance, 0.0)
            fade = (1 - distance**2 / REACH**2) ** 2 / (1 + distance**2 / HALF_LIGHT**2)
            total += (SCATTERED + (1 - SCATTERED) * straight) * fade * lamp[3:]
    return total


def _through(point: FloatArray, way: FloatArray, box: FloatArray) -> bool:
    """Return whether a line from the point meets the box, by many samples; it must not graze the box."""
    samples = point + np.linspace(0.0, 1.0, 4_001)[:, None] * way
    x, y = samples[:, 0] - box[0], samples[:, 1] - box[1]
    within = (np.abs(box[2] * x + box[3] * y) < box[4]) & (np.abs(box[2] * y - box[3] * x) < box[5])
    return bool(np.any(within & (samples[:, 2] > box[6]) & (samples[:, 2] < box[7])))


def test_a_wall_keeps_the_light_on_its_side() -> None:
    _, light = _lit((Block(Pose2(2.0, 2.0, 0.0), 0.2, 4.0, 0.0, 2.5),), (Lamp(1.0, 2.0, 2.4),))
    assert _floor_light(light, 1.0, 2.0) > 0.2
    assert _floor_light(light, 3.0, 2.0) == 0.0


def test_glass_lets_light_through() -> None:
    lamps = (Lamp(1.0, 2.0, 2.4),)
    _, glass = _lit((Block(Pose2(2.0, 2.0, 0.0), 0.02, 4.0, 0.0, 2.5, "glass"),), lamps)
    _, none = _lit((), lamps)
    assert _floor_light(glass, 3.0, 2.0) == _floor_light(none, 3.0, 2.0) > 0.0


def test_without_lamps_there_is_only_ambient_light() -> None:
    _, light = _lit((), (), Finish(height=2.5, ambient=0.4))
    np.testing.assert_allclose(light.texels, 0.4)


def test_lamps_are_bright() -> None:
    surfaces, light = _lit((), (Lamp(1.0, 2.0, 2.4),))
    column, row = (light.coordinates[-1].mean(axis=0) * light.texels.shape[1::-1]).astype(int)
    assert surfaces.looks[-1] == NAMES.index("lamp")
    assert light.texels[row, column, 0] == np.float32(GLOW)


def test_floor_under_a_block_takes_the_light_beside_it() -> None:
    _, light = _lit((Block(Pose2(2.0, 2.0, 0.0), 1.0, 1.0, -0.1, 0.05),), (Lamp(2.0, 2.0, 2.4),))
    assert _floor_light(light, 2.0, 2.0) > 0.5 * _floor_light(light, 3.0, 3.0) > 0.0


@given(st.lists(st.tuples(st.floats(0.1, 3.0), st.floats(0.1, 3.0)), min_size=1, max_size=40))
@settings(max_examples=25)
def test_windows_of_faces_do_not_overlap(sizes: list[tuple[float, float]]) -> None:
    blocks = tuple(Block(Pose2(0.1 * i, 1.0, 0.1), *size, 0.0, 2.0, seed=i) for i, size in enumerate(sizes))
    _, light = _lit(blocks, ())
    corners = np.rint(light.coordinates * light.texels.shape[1::-1] - 0.5).astype(int)
    taken = np.zeros(light.texels.shape[:2], np.int64)
    for low, high in zip(corners.min(axis=1), corners.max(axis=1), strict=True):
        taken[low[1] : high[1] + 1, low[0] : high[0] + 1] += 1
    assert taken.max() == 1


def test_light_falls_with_distance_as_declared() -> None:
    _, light = _lit((), (Lamp(2.0, 2.0, 2.4, 1.0, (1.0, 1.0, 1.0)),))
    down, aside = 2.39, 1.5
    fade = (1 - down**2 / REACH**2) ** 2 / (1 + down**2 / HALF_LIGHT**2)
    assert _floor_light(light, 2.0, 2.0) == pytest.approx(fade, rel=0.02)
    assert _floor_light(light, 2.0 + aside, 2.0) < fade * math.cos(math.atan2(aside, down))


@pytest.mark.parametrize(("size", "count"), [((40, 30), 1), ((200, 120), 4), ((4000, 4000), 400)])
def test_default_lamps_hang_under_the_whole_ceiling(size: tuple[int, int], count: int) -> None:
    columns, rows = size
    grid = OccupancyGrid(np.zeros((rows, columns), np.int8), 0.05, Pose2(-1.0, 2.0, 0.0))
    lamps = default_lamps(World("shed", grid, Pose2(), finish=DARK))
    assert len(lamps) == count
    assert np.mean([lamp.x for lamp in lamps]) == pytest.approx(-1.0 + columns * 0.025)
    assert np.mean([lamp.y for lamp in lamps]) == pytest.approx(2.0 + rows * 0.025)
    assert all(2.0 < lamp.z < DARK.height for lamp in lamps)
