"""Faces of a world: their places, their normals, and that none is missing or too many."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.simulation.plan.world import World
from waychair.simulation.scene.scene import Block, Finish, Lamp, Pit, Poster, Slope
from waychair.simulation.sensors.looks import LOOKS
from waychair.simulation.sensors.surfaces import Surfaces, surfaces_from_world
from waychair.types import FloatArray, OccupancyGrid, Pose2

NAMES = tuple(LOOKS)
POSE = Pose2(4.0, 3.0, 0.7)


def _world(**parts: object) -> World:
    grid = OccupancyGrid(np.zeros((160, 200), np.int8), 0.05)
    return World("hall", grid, Pose2(1.0, 1.0, 0.0), finish=Finish(height=2.5), **parts)  # type: ignore[arg-type]


def _faces(world: World) -> Surfaces:
    """The faces of the things in a world, without floor and ceiling."""
    all_of_them, empty = surfaces_from_world(world, NAMES), surfaces_from_world(_world(), NAMES)
    n = len(empty.seeds)
    s = all_of_them
    return Surfaces(s.anchors[n:], s.axes[n:], s.outlines[n:], s.looks[n:], s.seeds[n:])


def _areas(surfaces: Surfaces) -> FloatArray:
    """(F,) [m^2], by the shoelace formula; positive where the corners go round as the normal says."""
    u, v = surfaces.outlines[..., 0], surfaces.outlines[..., 1]
    area: FloatArray = np.sum(u * np.roll(v, -1, axis=1) - np.roll(u, -1, axis=1) * v, axis=1) / 2
    return area


@given(st.floats(0.1, 3.0), st.floats(0.1, 3.0), st.floats(-math.pi, math.pi), st.floats(0.1, 1.0), st.floats(1.1, 2.0))
def test_faces_of_a_block_look_outwards_and_close_it(
    length: float, width: float, theta: float, low: float, high: float
) -> None:
    block = Block(Pose2(5.0, 4.0, theta), length, width, low, high, "wood", 7)
    faces = _faces(_world(blocks=(block,)))
    middle = np.array([5.0, 4.0, (low + high) / 2])
    outwards = np.sum((faces.corners.mean(axis=1) - middle) * faces.normals, axis=1)
    np.testing.assert_allclose(np.sort(outwards), np.sort([length / 2] * 2 + [width / 2] * 2 + [(high - low) / 2] * 2))
    # by the divergence theorem the faces' areas, each times its distance from the middle, add up to three volumes
    assert np.sum(np.abs(_areas(faces)) * outwards) == pytest.approx(3 * length * width * (high - low))


@pytest.mark.parametrize(("low", "high", "count"), [(0.0, 2.5, 4), (0.0, 1.0, 5), (2.05, 2.5, 5), (0.7, 0.74, 6), (-0.5, -0.2, 5)])  # fmt: skip
def test_faces_on_floor_and_ceiling_are_left_out(low: float, high: float, count: int) -> None:
    assert len(_faces(_world(blocks=(Block(POSE, 1.0, 1.0, low, high),))).seeds) == count


def test_pits_are_cut_out_of_the_floor() -> None:
    pits = (Pit(POSE, 2.0, 1.0, 1.5), Pit(Pose2(8.0, 6.0, 0.0), 1.0, 1.0, 0.5))
    s = surfaces_from_world(_world(pits=pits), NAMES)
    floor = (s.corners[..., 2] == 0.0).all(axis=1) & (s.normals[:, 2] > 0.9)
    assert np.abs(_areas(s)[floor]).sum() == pytest.approx(10.0 * 8.0 - 2.0 - 1.0)
    # nothing of the floor is inside the first pit
    local = (s.corners[floor].mean(axis=1)[:, :2] - (POSE.x, POSE.y)) @ [
        [math.cos(POSE.theta), -math.sin(POSE.theta)],
        [math.sin(POSE.theta), math.cos(POSE.theta)],
    ]
    assert not np.any((np.abs(local[:, 0]) < 0.99) & (np.abs(local[:, 1]) < 0.49))


def test_walls_of_a_pit_face_into_it() -> None:
    faces = _faces(_world(pits=(Pit(POSE, 2.0, 1.0, 1.5),)))
    extra = faces.corners.mean(axis=1)
    walls = np.isclose(extra[:, 2], -0.75)
    inwards = np.sum((np.array([POSE.x, POSE.y, -0.75]) - extra[walls]) * faces.normals[walls], axis=1)
    np.testing.assert_allclose(np.sort(inwards), [0.5, 0.5, 1.0, 1.0])


def test_the_top_face_of_a_slope_rises_along_it() -> None:
    faces = _faces(_world(slopes=(Slope(POSE, 2.4, 1.0, 0.0, 0.2),)))
    top = faces.corners[np.argmax(faces.normals[:, 2])]
    along = (top[:, :2] - (POSE.x, POSE.y)) @ (math.cos(POSE.theta), math.sin(POSE.theta))
    np.testing.assert_allclose(top[:, 2], 0.1 + along / 12.0, atol=1e-9)
    np.testing.assert_allclose(np.ptp(along), 2.4)


def test_a_poster_hangs_before_its_wall_and_faces_away_from_it() -> None:
    faces = _faces(_world(posters=(Poster(Pose2(3.0, 2.0, math.pi / 2), 1.5, 0.8, 0.6, 3),)))
    np.testing.assert_allclose(faces.normals, [[0.0, 1.0, 0.0]], atol=1e-9)
    assert 2.0 < faces.corners[0, :, 1].min() < 2.01
    np.testing.assert_allclose(np.ptp(faces.corners[0], axis=0), [0.8, 0.0, 0.6], atol=1e-9)


def test_lamps_face_down() -> None:
    faces = _faces(_world(lamps=(Lamp(3.0, 2.0, 2.4),)))
    np.testing.assert_allclose(faces.normals, [[0.0, 0.0, -1.0]], atol=1e-9)


def test_no_two_faces_share_a_seed_unless_their_blocks_do() -> None:
    def seeds(*of_blocks: int) -> list[int]:
        blocks = tuple(Block(Pose2(2.0 + i, 3.0, 0.0), 0.5, 0.5, 0.2, 1.0, seed=s) for i, s in enumerate(of_blocks))
        return list(_faces(_world(blocks=blocks)).seeds)

    assert len(set(seeds(*range(500)))) == 500 * 6
    alike = seeds(41, 41)
    assert alike[:6] == alike[6:]
