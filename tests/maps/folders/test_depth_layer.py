"""A saved map tells the cells that only a camera has seen, and the drop-offs; planners use the map alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import MapError
from waychair.maps.folders.depth_layer import (
    DROP_OFF,
    SEEN_BY_DEPTH,
    depth_layer,
    drop_offs,
    load_depth_layer,
    save_depth_layer,
    scanned_part,
)
from waychair.maps.folders.map_files import load_map, save_map
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.types import OccupancyGrid, Pose2


@pytest.fixture
def parts() -> tuple[OccupancyGrid, OccupancyGrid, np.ndarray]:
    """The lidar's grid, which is smaller; the grid of all sensors; and its drop-offs."""
    cells = np.zeros((60, 80), np.int8)
    cells[:, 0] = 100
    whole = cells.copy()
    drops = np.zeros(cells.shape, np.bool_)
    drops[20:30, 40:60] = True
    whole[drops] = 100
    whole[50:52, 10:20] = 90
    scanned = OccupancyGrid(cells[10:], 0.05, Pose2(-1.0, 0.5))
    return scanned, OccupancyGrid(whole, 0.05, Pose2(-1.0, 0.0)), drops


def test_the_layer_survives_its_file_and_the_map_is_occupied_where_the_floor_ends(
    parts: tuple[OccupancyGrid, OccupancyGrid, np.ndarray], tmp_path: Path
) -> None:
    scanned, grid, drops = parts
    save_map(tmp_path, grid)
    save_depth_layer(tmp_path, depth_layer(scanned, grid, drops))
    again = load_map(tmp_path)
    layer = load_depth_layer(tmp_path / "map.yaml", again)
    assert layer is not None
    np.testing.assert_array_equal(drop_offs(layer), drops)
    assert set(layer.cells[50:52, 10:20].ravel().tolist()) == {SEEN_BY_DEPTH}
    assert (layer.cells[drops] == DROP_OFF).all()
    assert (again.cells[drops] == 100).all()
    assert (scanned_part(again, layer).cells[drops] == -1).all()
    assert (scanned_part(again, layer).cells[11:, 0] == 100).all()
    assert scanned_part(again, None) is again


def test_no_path_leads_over_a_drop_off(parts: tuple[OccupancyGrid, OccupancyGrid, np.ndarray], tmp_path: Path) -> None:
    _, grid, drops = parts
    save_map(tmp_path, grid)
    costmap = costmap_from_grid(load_map(tmp_path), CHAIR_A)
    assert (costmap.prices[drops] == 0).all()


def test_a_map_without_a_layer_removes_an_earlier_layer(
    parts: tuple[OccupancyGrid, OccupancyGrid, np.ndarray], tmp_path: Path
) -> None:
    scanned, grid, drops = parts
    save_map(tmp_path, grid)
    assert load_depth_layer(tmp_path, grid) is None
    save_depth_layer(tmp_path, depth_layer(scanned, grid, drops))
    save_depth_layer(tmp_path, None)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["map.pgm", "map.yaml"]


def test_the_layer_of_another_map_is_refused_with_advice(
    parts: tuple[OccupancyGrid, OccupancyGrid, np.ndarray], tmp_path: Path
) -> None:
    scanned, grid, drops = parts
    save_depth_layer(tmp_path, depth_layer(scanned, grid, drops))
    with pytest.raises(MapError, match="belongs to another map"):
        load_depth_layer(tmp_path, scanned)
