"""Fast search for cells of a grid."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.maps.grid.cells import cells_where


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 1.0])
@pytest.mark.parametrize("shape", [(7, 13), (1, 5), (0, 4)])
def test_found_cells_equal_those_of_numpy(shape: tuple[int, int], share: float) -> None:
    mask = np.random.default_rng(1).random(shape) < share
    found = cells_where(mask)
    assert found.shape == (int(mask.sum()), 2)
    np.testing.assert_array_equal(found, np.argwhere(mask))
