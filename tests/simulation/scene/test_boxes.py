"""Bins: a box is in every bin that it reaches into."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.simulation.scene.boxes import SMALLEST_BIN, Bins, bins_from_boxes, boxes_from_segments
from waychair.types import FloatArray


def _boxes(rng: np.random.Generator, count: int) -> FloatArray:
    theta = rng.choice([0.0, math.pi / 2, rng.uniform(-math.pi, math.pi)], count)
    places, sizes = rng.uniform(-8.0, 8.0, (count, 2)), rng.uniform(0.0, 2.0, (count, 2))
    return np.column_stack([places, np.cos(theta), np.sin(theta), sizes])


def _held(bins: Bins, x: float, y: float) -> set[int]:
    """Return the numbers of the boxes in the bin of a point, none outside."""
    col, row = math.floor((x - bins.x) / bins.side), math.floor((y - bins.y) / bins.side)
    if not (0 <= col < bins.cols and 0 <= row < bins.rows):
        return set()
    number = row * bins.cols + col
    return set(bins.items[bins.starts[number] : bins.starts[number + 1]].tolist())


@settings(max_examples=50)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40))
def test_every_point_of_a_box_lies_in_a_bin_that_holds_the_box(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    boxes = _boxes(rng, count)
    bins = bins_from_boxes(boxes)
    for i, (x, y, c, s, half_length, half_width) in enumerate(boxes.tolist()):
        for along, across in rng.uniform(-1.0, 1.0, (8, 2)) * (half_length, half_width):
            assert i in _held(bins, x + along * c - across * s, y + along * s + across * c)


@settings(max_examples=50)
@given(st.integers(0, 2**32 - 1))
def test_a_bin_holds_no_box_farther_than_one_bin_away(seed: int) -> None:
    boxes = _boxes(np.random.default_rng(seed), 30)
    bins = bins_from_boxes(boxes)
    for row in range(bins.rows):
        for col in range(bins.cols):
            x, y = bins.x + (col + 0.5) * bins.side, bins.y + (row + 0.5) * bins.side
            for i in _held(bins, x, y):
                dx, dy, (c, s, half_length, half_width) = x - boxes[i, 0], y - boxes[i, 1], boxes[i, 2:].tolist()
                beyond = max(abs(dx * c + dy * s) - half_length, abs(dy * c - dx * s) - half_width)
                assert beyond <= bins.side * math.sqrt(0.5) + 1e-5


def test_bins_are_a_few_for_every_box_and_never_tiny() -> None:
    many = bins_from_boxes(_boxes(np.random.default_rng(1), 1000))
    assert 2000 < many.rows * many.cols < 6000
    dense = bins_from_boxes(np.tile([0.0, 0.0, 1.0, 0.0, 1.0, 1.0], (10_000, 1)))
    assert dense.side == SMALLEST_BIN
    far_apart = bins_from_boxes(boxes_from_segments(np.array([[0.0, 0.0, 1.0, 0.0], [1e6, 0.0, 1e6 + 1, 0.0]])))
    assert far_apart.rows * far_apart.cols < 2000


def test_segments_become_boxes_of_zero_width() -> None:
    boxes = boxes_from_segments(np.array([[1.0, 1.0, 4.0, 5.0]]))
    np.testing.assert_allclose(boxes, [[2.5, 3.0, 0.6, 0.8, 2.5, 0.0]])
