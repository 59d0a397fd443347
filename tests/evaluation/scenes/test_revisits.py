"""A small sample of `evaluation.figures.mapping.floors`: a lap of the basement, and a part of the alias world's
drive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from evaluation.scenes.maps.revisits import map_drive, record_drive, score

from waychair.simulation.sensors.camera import CameraSettings
from waychair.simulation.sensors.renderer import renderer_problem

SMALL = CameraSettings(width=320, height=240)

pytestmark = pytest.mark.skipif(renderer_problem() is not None, reason="no pictures can be drawn here")


@pytest.mark.nightly
def test_a_lap_of_the_basement_is_closed_by_pictures_and_lidar(tmp_path: Path) -> None:
    route = np.array([[12.5, 1.4], [12.5, 7.8], [1.4, 7.8], [1.4, 1.4], [7.0, 1.4]])
    record_drive("basement", tmp_path / "drive.mcap", 1.0, route, SMALL)
    figures = score(map_drive(tmp_path / "drive.mcap"))
    assert figures["at_revisits"] >= 5
    assert figures["recall"] >= 0.95
    assert figures["revisits"] == figures["closed"] == 1
    assert figures["by_appearance"] >= 1
    assert figures["false_links"] == figures["false_edges"] == 0


@pytest.mark.nightly
def test_identical_rooms_close_no_loop(tmp_path: Path) -> None:
    route = np.array([[12.5, 1.15]])
    record_drive("alias", tmp_path / "drive.mcap", 1.0, route, SMALL)
    figures = score(map_drive(tmp_path / "drive.mcap"))
    assert figures["refused"] >= 1
    assert figures["false_links"] == figures["false_edges"] == 0
