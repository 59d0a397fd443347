"""Fast search for cells of a grid."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.maps.grid.cells import cells_where, occupied_edges
from waychair.types import OccupancyGrid, Pose2


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 1.0])
@pytest.mark.parametrize("shape", [(7, 13), (1, 5), (0, 4)])
def test_found_cells_equal_those_of_numpy(shape: tuple[int, int], share: float) -> None:
    mask = np.random.default_rng(1).random(shape) < share
    found = cells_where(mask)
    assert found.shape == (int(mask.sum()), 2)
    np.testing.assert_array_equal(found, np.argwhere(mask))


def test_the_outline_of_what_stands_has_the_corners_on_its_border_and_none_within() -> None:
    cells = np.zeros((4, 5), np.int8)
    cells[0:2, 1:3] = 100
    found = occupied_edges(OccupancyGrid(cells, 0.5, Pose2(1.0, 2.0)))
    expected = [(x, y) for y in (2.0, 2.5, 3.0) for x in (1.5, 2.0, 2.5) if (x, y) != (2.0, 2.5)]
    assert sorted(map(tuple, found.tolist())) == sorted(expected)
    assert occupied_edges(OccupancyGrid(np.zeros((2, 2), np.int8), 0.5)).shape == (0, 2)
