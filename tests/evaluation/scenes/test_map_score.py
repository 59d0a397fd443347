"""The score of a map's walls: right, displaced, missing and unseen walls."""

from __future__ import annotations

import numpy as np
import pytest
from evaluation.scenes.maps.map_score import wall_agreement

from waychair.types import OccupancyGrid, Pose2


def room(resolution: float = 0.05) -> OccupancyGrid:
    """Return a room of 4 x 3 m with walls of 10 cm."""
    cells = np.full((60, 80), 100, np.int8)
    cells[2:-2, 2:-2] = 0
    return OccupancyGrid(cells, resolution, Pose2(-1.0, 2.0, 0.0))


def test_the_true_grid_agrees_with_itself_in_any_frame() -> None:
    true_from_map = Pose2(3.0, -1.0, 0.7)
    truth = room()
    seen = OccupancyGrid(truth.cells, truth.resolution, true_from_map.inverse() @ truth.map_from_grid)
    score = wall_agreement(seen, truth, true_from_map, 0.05)
    assert (score.true_cells, score.found_faces) == (1.0, 1.0)
    assert score.faces == 2 * (76 + 56)


@pytest.mark.parametrize(("shift", "agrees"), [(0.0, True), (0.02, True), (0.12, False)])
def test_a_displaced_wall_agrees_within_the_tolerance_only(shift: float, agrees: bool) -> None:
    score = wall_agreement(room(), room(), Pose2(shift, 0.0, 0.0), 0.05)
    assert (score.true_cells == 1.0) == agrees
    assert (score.found_faces == 1.0) == agrees


def test_a_missing_wall_is_counted_where_its_space_was_seen() -> None:
    truth = room()
    cells = truth.cells.copy()
    cells[:2, :] = 0  # the lower wall mapped as free
    score = wall_agreement(OccupancyGrid(cells, 0.05, truth.map_from_grid), truth, Pose2(), 0.05)
    assert score.true_cells == 1.0
    assert 0.6 < score.found_faces < 0.75


def test_walls_of_unseen_rooms_do_not_count() -> None:
    truth = room()
    cells = truth.cells.copy()
    cells[:, 40:] = -1
    cells[:, 40:][truth.cells[:, 40:] == 100] = -1
    score = wall_agreement(OccupancyGrid(cells, 0.05, truth.map_from_grid), truth, Pose2(), 0.05)
    assert (score.true_cells, score.found_faces) == (1.0, 1.0)
    assert score.faces == 2 * 38 + 56
