"""The pilot that the navigator's node makes on a map watches what the map shows and no lidar does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS is not installed")

from tests.runtime.haptics.guided_rider import room
from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import MapError
from waychair.maps.folders.depth_layer import SEEN_BY_DEPTH, save_depth_layer
from waychair.ros.nodes.parts.map_layout import MapLayout
from waychair.runtime.pilot import PilotSettings
from waychair.trials.simulated_stops import simulated_calibration
from waychair.types import OccupancyGrid

CALIBRATION = simulated_calibration(CHAIR_A)
TABLE = np.s_[30:40, 60:70]


def _with_table(folder: Path) -> OccupancyGrid:
    """A room with a table's top that the depth camera has seen, and its layer in the map's folder."""
    grid = room()
    cells, layer = grid.cells.copy(), np.zeros_like(grid.cells)
    cells[TABLE], layer[TABLE] = 100, SEEN_BY_DEPTH
    save_depth_layer(folder, replace(grid, cells=layer))
    return replace(grid, cells=cells)


def test_a_table_top_of_the_map_is_watched_by_the_guard(tmp_path: Path) -> None:
    layout = MapLayout({}, (), tmp_path)
    things = layout.pilot_on(_with_table(tmp_path), CALIBRATION, PilotSettings()).unscanned.things
    assert things[:, 0].min() > 2.9
    assert things[:, 0].max() < 3.6
    assert len(things) == 100
    bare = MapLayout({}, ()).pilot_on(room(), CALIBRATION, PilotSettings())
    assert len(bare.unscanned.things) == 0


def test_a_damaged_depth_layer_is_an_error_and_the_layout_keeps_its_last_map(tmp_path: Path) -> None:
    layout = MapLayout({}, (), tmp_path)
    grid = _with_table(tmp_path)
    (tmp_path / "depth.yaml").write_text("image: nothing.pgm\n")
    with pytest.raises(MapError):
        layout.pilot_on(grid, CALIBRATION, PilotSettings())
    assert layout.grid is None
