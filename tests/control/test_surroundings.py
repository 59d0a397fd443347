"""What the local planner sees round the chair: walls, zones, and all sensors, now and a moment ago."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from waychair.calibration.chair import CHAIR_A, BodyLayer
from waychair.control.surroundings import Surroundings, SurroundingsSettings
from waychair.maps.distance_field import DistanceField
from waychair.maps.zones import Rule, Zone
from waychair.types import FloatArray, OccupancyGrid, Pose2, RgbdFrame, SonarReadings

SECOND = 10**9
HERE = Pose2(4.0, 3.0, 0.0)
LASER = (HERE @ CHAIR_A.base_from_laser).array()[:2]


def hall() -> OccupancyGrid:
    cells = np.zeros((120, 160), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    return OccupancyGrid(cells, 0.05)


def around(*zones: Zone) -> Surroundings:
    return Surroundings(hall(), CHAIR_A, SurroundingsSettings(), zones)


def wall_behind(extent: float = 0.6) -> FloatArray:
    """The east wall of the hall, as the lidar sees it every quarter of a degree."""
    return np.stack([np.full(400, 7.97), LASER[1] + np.linspace(-extent, extent, 400)], axis=-1)


def someone(x: float) -> FloatArray:
    return np.stack([np.full(9, x), np.linspace(2.9, 3.1, 9)], axis=-1)


def at(field: DistanceField, x: float, y: float) -> float:
    column, row = ((p - o) / field.resolution for p, o in zip((x, y), field.map_from_grid.array()[:2], strict=True))
    return float(field.metres[int(row), int(column)])


def test_the_window_holds_walls_keep_out_zones_and_what_was_seen() -> None:
    square = np.array([[5.0, 4.0], [5.5, 4.0], [5.5, 4.5], [5.0, 4.5]])
    seen = around(Zone("stairs", Rule.KEEP_OUT, square))
    seen.see(0, HERE, someone(6.0))
    window = seen.window(HERE)
    assert at(window, 5.25, 4.25) == at(window, 6.0, 3.0) == at(window, 0.02, 3.0) == 0.0
    assert at(window, 4.0, 3.0) > 1.0


def test_a_wall_of_the_map_is_no_news_and_someone_in_front_of_it_is() -> None:
    seen = around()
    seen.see(0, HERE, wall_behind())
    assert len(seen.unexpected()) == 0
    seen.see(SECOND, HERE, np.concatenate([wall_behind(), someone(6.0)]))
    assert seen.unexpected()[:, 0].tolist() == pytest.approx([6.0] * len(seen.unexpected()))
    assert len(seen.unexpected()) >= 8


def test_someone_who_left_is_cleared_by_the_wall_that_is_seen_behind_them() -> None:
    seen = around()
    seen.see(0, HERE, someone(6.0))
    seen.see(SECOND // 10, HERE, wall_behind())
    assert len(seen.unexpected()) == 0
    assert at(seen.window(HERE), 6.0, 3.0) > 0.5


def test_beams_that_met_nothing_clear_too_when_they_are_told() -> None:
    seen = around()
    seen.see(0, HERE, someone(6.0))
    seen.see(1, HERE, np.empty((0, 2)))
    assert len(seen.unexpected()) > 0
    seen.see(2, HERE, np.empty((0, 2)), beyond=wall_behind() - (0.5, 0.0))
    assert len(seen.unexpected()) == 0


def test_what_the_chair_has_turned_away_from_is_remembered_and_then_forgotten() -> None:
    seen = around()
    seen.see(0, HERE, someone(6.0))
    for k in range(1, 5):
        seen.see(k * SECOND, Pose2(4.0, 3.0, math.pi), np.array([[0.03, 3.0]]))
        assert at(seen.window(HERE), 6.0, 3.0) == 0.0
    seen.see(6 * SECOND, Pose2(4.0, 3.0, math.pi), np.array([[0.03, 3.0]]))
    assert at(seen.window(HERE), 6.0, 3.0) > 0.5


def test_glass_that_a_sonar_hears_is_not_cleared_by_the_lidar_that_looks_through_it() -> None:
    seen = around()
    ahead = (Pose2(CHAIR_A.front, 0.0, 0.0),)
    seen.hear(SonarReadings(0, np.array([1.0], np.float32)), HERE, ahead)
    for k in range(5):
        seen.see(k, HERE, wall_behind())
    assert at(seen.window(HERE), 5.75, 3.0) < 0.05
    assert len(seen.upright()) > 5
    seen.hear(SonarReadings(9, np.array([np.inf], np.float32)), HERE, ahead)
    assert len(seen.upright()) == 0


def test_a_board_at_the_height_of_the_arm_rests_counts_for_that_layer_alone() -> None:
    layers = (BodyLayer(0.0, 0.5, 0.75, 0.25, 0.25), BodyLayer(0.5, 1.4, 0.7, 0.25, 0.3))
    body = dataclasses.replace(CHAIR_A, camera_y=0.0, camera_pitch=0.0, layers=layers)
    seen = Surroundings(hall(), body, SurroundingsSettings())
    depth = np.full((120, 160), np.nan, np.float32)
    depth[70:75] = 1.5  # 0.95 m - 1.5 m * (10 ... 15) / 200: 0.84 to 0.88 m high
    camera = np.array([[200.0, 0.0, 80.0], [0.0, 200.0, 60.0], [0.0, 0.0, 1.0]])
    seen.look(RgbdFrame(0, np.zeros((120, 160), np.uint8), depth, camera), HERE)
    by_layer = {layer.bottom: len(points) for layer, points in seen.layered()}
    assert by_layer[0.0] == 0
    assert by_layer[0.5] > 10
    assert at(seen.window(HERE), 4.0 + body.camera_x + 1.5, 3.0) < 0.05
    assert len(seen.upright()) == 0
