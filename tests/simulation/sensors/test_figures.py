"""Bodies of people: their legs are at the places that the lidar sees."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.simulation.scene.scene import PersonBehaviour, PersonState
from waychair.simulation.sensors.figures import MOVER_HEIGHT, SHIN_HEIGHT, BodyMeshes, body_meshes
from waychair.simulation.sensors.looks import LOOKS
from waychair.simulation.sensors.renderer import PERSON_REACH
from waychair.simulation.sensors.silhouettes import legs_of
from waychair.types import FloatArray, Pose2

NAMES = tuple(LOOKS)
POSE = Pose2(3.0, -2.0, 2.1)


def _person(behaviour: PersonBehaviour, stride: float = 0.0, seed: int = 1, radius: float = 0.25) -> PersonState:
    return PersonState(POSE, 1.0, stride, radius, behaviour, seed)


def _cut(body: BodyMeshes, height: float) -> FloatArray:
    """Return (N, 2) the points at which the edges of the body's triangles pass a height."""
    edges = body.positions[np.concatenate([body.triangles[:, [0, 1]], body.triangles[:, [1, 2]]])]
    through = edges[(edges[:, 0, 2] - height) * (edges[:, 1, 2] - height) < 0.0]
    part = (height - through[:, 0, 2]) / (through[:, 1, 2] - through[:, 0, 2])
    points: FloatArray = (through[:, 0] + part[:, None] * (through[:, 1] - through[:, 0]))[:, :2]
    return points


@pytest.mark.parametrize("behaviour", [PersonBehaviour.PATH, PersonBehaviour.SEATED, PersonBehaviour.BOUNCE])
@pytest.mark.parametrize("stride", [0.0, 0.8, math.pi / 2, 4.0])
def test_legs_are_at_the_places_that_the_lidar_sees(behaviour: PersonBehaviour, stride: float) -> None:
    person = _person(behaviour, stride)
    points, circles = _cut(body_meshes([person], NAMES), SHIN_HEIGHT), legs_of(person)
    distances = np.linalg.norm(points[:, None] - circles[:, :2], axis=2) - circles[:, 2]
    assert np.all(np.abs(distances).min(axis=1) < 0.03)
    assert np.all(np.abs(distances).min(axis=0) < 0.03)


def test_a_mover_is_a_drum_half_a_metre_high() -> None:
    body = body_meshes([_person(PersonBehaviour.BOUNCE, radius=0.15)], NAMES)
    assert body.positions[:, 2].min() == 0.0
    assert body.positions[:, 2].max() == MOVER_HEIGHT == 0.5
    assert np.hypot(*(body.positions[:, :2] - (POSE.x, POSE.y)).T).max() == pytest.approx(0.15)


@pytest.mark.parametrize("behaviour", list(PersonBehaviour))
def test_no_part_is_beyond_a_persons_reach_or_below_the_floor(behaviour: PersonBehaviour) -> None:
    body = body_meshes([_person(behaviour, math.pi / 2)], NAMES)
    assert np.linalg.norm(body.positions - (POSE.x, POSE.y, 1.0), axis=1).max() < PERSON_REACH
    assert body.positions[:, 2].min() >= -1e-9


def test_clothes_depend_on_the_person_and_patterns_on_the_limb() -> None:
    body = body_meshes([_person(PersonBehaviour.PATH, seed=1), _person(PersonBehaviour.PATH, seed=2)], NAMES)
    clothes = body.looks == NAMES.index("clothes")
    colours = [set(body.seeds[clothes & (body.owners == owner)] >> 8) for owner in (0, 1)]
    assert [len(seen) for seen in colours] == [2, 2]  # a jacket and trousers
    assert not colours[0] & colours[1]
    assert len(set(body.seeds)) == 2 * 6


def test_the_triangles_of_a_tube_have_one_orientation() -> None:
    body = body_meshes([_person(PersonBehaviour.BOUNCE)], NAMES)
    a, b, c = np.moveaxis(body.positions[body.triangles], 1, 0)
    middle = np.array([POSE.x, POSE.y, MOVER_HEIGHT / 2])
    outward = np.sum(np.cross(b - a, c - a) * ((a + b + c) / 3 - middle), axis=1)
    assert np.all(outward <= 1e-12) or np.all(outward >= -1e-12)


def test_without_people_there_are_no_triangles() -> None:
    assert len(body_meshes([], NAMES).positions) == 0
