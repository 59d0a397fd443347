"""Pictures of worlds, and the lists of their hazards."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from waychair.simulation.plan.world import World, world_from_grid
from waychair.simulation.scene.scene import Block, PersonBehaviour, PersonPlan, Pit, Slope
from waychair.trials.world_plan import OVERHANG, PERSON, PIT, RAMP, hazard_names, world_picture
from waychair.types import OccupancyGrid, Pose2

PLAIN = replace(world_from_grid(OccupancyGrid(np.zeros((80, 120), np.int8), 0.05), Pose2(1.0, 1.0, 0.0)), blocks=())
AT = Pose2(3.0, 2.0, 0.3)


def with_block(low: float, high: float, material: str = "wood") -> World:
    return replace(PLAIN, blocks=(Block(AT, 1.0, 0.5, low, high, material),))


@pytest.mark.parametrize(
    ("world", "expected"),
    [
        (PLAIN, ()),
        (with_block(0.0, 2.7), ()),
        (with_block(2.05, 2.7), ()),  # a lintel is no obstacle
        (with_block(0.70, 0.74), ("overhang",)),
        (with_block(0.0, 0.02), ("sill of 2 cm",)),
        (with_block(-2.0, -0.17), ()),  # a step, down in its pit
        (with_block(0.0, 2.0, "glass"), ("glass",)),
        (with_block(0.0, 2.0, "mirror"), ("mirror",)),
        (with_block(0.0, 0.8, "black_leather"), ("dark surface",)),
        (replace(PLAIN, slopes=(Slope(AT, 2.4, 1.0, 0.0, 0.2),) * 2), ("ramp 1:12 (2)",)),
        (replace(PLAIN, slopes=(Slope(AT, 2.4, 1.0, 0.2, 0.2),)), ()),  # a landing
        (replace(PLAIN, pits=(Pit(AT, 2.0, 1.2, 1.7),)), ("pit",)),
        (
            replace(PLAIN, people=(PersonPlan(PersonBehaviour.SUDDEN, np.array([[1.0, 3.0], [2.0, 3.0]])),)),
            ("sudden person",),
        ),
    ],
)
def test_hazards_are_named(world: World, expected: tuple[str, ...]) -> None:
    assert hazard_names(world) == expected


def pixels(world: World, colour: str) -> int:
    """Return the number of pixels of about this colour in the world's picture."""
    picture = cv2.imdecode(np.frombuffer(world_picture(world).png, np.uint8), cv2.IMREAD_COLOR)
    rgb = np.asarray(picture)[:, :, ::-1].astype(int)
    return int(np.all(np.abs(rgb - np.frombuffer(bytes.fromhex(colour[1:]), np.uint8)) < 12, axis=2).sum())


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("changed", "colour"),
    [
        (with_block(0.0, 1.0, "cloth"), "#77869c"),
        (with_block(0.7, 0.74), OVERHANG),
        (replace(PLAIN, slopes=(Slope(AT, 2.4, 1.0, 0.0, 0.2),)), RAMP),
        (replace(PLAIN, pits=(Pit(AT, 2.0, 1.2, 1.7),)), PIT),
        (replace(PLAIN, people=(PersonPlan(PersonBehaviour.PATH, np.array([[1.0, 3.0], [2.0, 3.0]])),)), PERSON),
    ],
)
def test_every_part_of_a_world_is_drawn_on_its_picture(changed: World, colour: str) -> None:
    assert pixels(PLAIN, colour) == 0
    assert pixels(changed, colour) > 50


def test_a_picture_is_captioned_with_the_hazards_and_titled_with_the_level() -> None:
    world = replace(with_block(0.0, 2.0, "glass"), name="house", level="cellar")
    picture = world_picture(world)
    assert (picture.title, picture.caption) == ("house, cellar", "glass")
    assert world_picture(PLAIN).caption == "no hazards"
