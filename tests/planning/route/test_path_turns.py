"""The histogram of a path's turns."""

from __future__ import annotations

import numpy as np

from waychair.planning.route.path_turns import BIN_DEG, turn_histogram
from waychair.types import Path


def test_a_straight_path_has_turns_in_the_first_bin_only() -> None:
    path = Path(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))
    edges, counts = turn_histogram(path)
    assert edges.tolist() == [0]
    assert counts.sum() > 10


def test_a_right_angle_is_counted_in_the_last_bin() -> None:
    path = Path(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]]))
    edges, counts = turn_histogram(path)
    assert edges[-1] == 90 - 90 % BIN_DEG
    assert counts[-1] == 1
