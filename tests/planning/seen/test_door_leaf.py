"""The leaf of a door is found at its jamb, with its angle and the room it leaves."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.planning.seen.door_leaf import Leaf, find_leaf
from waychair.types import FloatArray


def _points(width: float, angle: float, side: float, share: float = 1.0) -> FloatArray:
    along = np.linspace(0.05, share * 0.95 * width, 40)
    hinge = np.array([0.0, side * width / 2])
    way = np.array([math.sin(angle), -side * math.cos(angle)])
    points: FloatArray = hinge + along[:, None] * way + np.random.default_rng(1).normal(0.0, 0.008, (40, 2))
    return points


@pytest.mark.parametrize(("angle", "side"), [(30.0, 1.0), (60.0, -1.0), (-45.0, 1.0), (85.0, -1.0)])
def test_a_leaf_is_found_with_its_side_and_angle(angle: float, side: float) -> None:
    found = find_leaf(_points(0.9, math.radians(angle), side), 0.9)
    assert found is not None
    assert found.side == ("left" if side > 0.0 else "right")
    assert math.degrees(found.angle) == pytest.approx(angle, abs=5.0)


def test_half_a_leaf_and_an_empty_opening_are_no_leaf() -> None:
    assert find_leaf(_points(0.9, 0.8, 1.0, share=0.5), 0.9) is None
    assert find_leaf(np.zeros((0, 2)), 0.9) is None


def test_a_leaf_at_45_degrees_leaves_less_than_a_third_and_one_at_90_all() -> None:
    assert Leaf("left", math.radians(45.0), 0.9).clear(0.9) == pytest.approx(0.264, abs=0.001)
    assert Leaf("left", math.radians(90.0), 0.9).clear(0.9) == pytest.approx(0.9)
    assert Leaf("right", math.radians(-120.0), 0.9).clear(0.9) == pytest.approx(0.9)
