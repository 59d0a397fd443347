"""The sentences about free ways, doorways, the camera and cells that a page shows."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.behaviours.commands import NULL, STOP, FreeCommand, FreeKind, sector_middles
from waychair.control.behaviours.paper import PaperSettings
from waychair.control.behaviours.presets import shipped
from waychair.control.behaviours.sonar import Obstacle, ObstacleClasses
from waychair.control.drive.doors.doorway_tracker import DoorwayTracker
from waychair.planning.seen.doorways import DoorState, Doorway
from waychair.runtime.pages.perception_view import (
    aim_words,
    direction_words,
    drawn_network,
    effect_words,
    free_words,
    perception_view,
)
from waychair.runtime.perception import CellInputs, Perception
from waychair.types import JoystickInput, OccupancyGrid, Odometry, PanTiltAngles, Pose2, Scan, Twist


def _free(*sectors: int, count: int = 16) -> FreeCommand:
    return FreeCommand(FreeKind.LIST, tuple(sector_middles(count)[k] for k in sectors), count)


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (NULL, "nobody has looked for free ways"),
        (STOP, "no way is free"),
        (_free(*range(16)), "all ways are free"),
        (_free(0), "free straight ahead"),
        (_free(0, 1, 15), "free from 22 degrees right to 22 degrees left"),
        (_free(2, 4, 5), "free 45 degrees left and from 90 degrees left to 112 degrees left"),
        (_free(6, 7, 8), "free from 135 degrees left to straight back"),
        (_free(0, 4, count=8), "free straight ahead and straight back"),
    ],
)
def test_free_orientations_are_told_as_runs_of_directions(command: FreeCommand, words: str) -> None:
    assert free_words(command) == words


def test_directions_and_the_cameras_aim_are_told_by_side() -> None:
    assert [direction_words(math.radians(each)) for each in (0, 90, -30, 180, 350)] == [
        "straight ahead",
        "90 degrees left",
        "30 degrees right",
        "straight back",
        "10 degrees right",
    ]
    assert aim_words(PanTiltAngles(0, math.radians(300), math.radians(-10), True)) == (
        "The camera looks 60 degrees right, 10 degrees down."
    )
    assert aim_words(PanTiltAngles(0, 0.0, 0.0, False)) == "The camera turns past straight ahead, level."
    assert aim_words(PanTiltAngles(0, math.nan, 0.0, True)) == "The camera's servos report no angles."


def test_effects_are_told_in_words_and_unknown_ones_by_their_kind() -> None:
    classes = ObstacleClasses((Obstacle.IMMEDIATE, Obstacle.NEAR, Obstacle.FAR, Obstacle.NEAR))
    assert effect_words(classes) == "1 immediate, 2 near"
    assert effect_words(None) == "nothing"
    assert effect_words(OccupancyGrid(np.zeros((1, 1), np.int8), 0.1)) == "occupancy grid"


def _perceived() -> Perception:
    perception = Perception(CHAIR_A, timer=None)
    step = math.tau / 360
    angles = -math.pi + step * np.arange(360)
    with np.errstate(divide="ignore"):
        room = np.minimum(2.0 / np.abs(np.cos(angles)), 2.0 / np.abs(np.sin(angles)))
    perception.see(Scan(0, room.astype(np.float32), -math.pi, step), Pose2())
    return perception


def test_a_view_holds_every_cell_once_and_the_doorways_by_distance(monkeypatch: pytest.MonkeyPatch) -> None:
    perception = _perceived()
    far = Doorway(7, Pose2(5.0, 1.0, 0.0), 0.9, 0.9, 0.02, DoorState.OPEN)
    near = Doorway(3, Pose2(1.0, 2.0, 1.57), 0.7, 0.0, 0.03, DoorState.AJAR)
    gone = Doorway(9, Pose2(50.0, 1.0, 0.0), 0.9, 0.9, 0.02, DoorState.OPEN)
    monkeypatch.setattr(DoorwayTracker, "doorways", (far, gone, near))
    grid = OccupancyGrid(np.zeros((4, 4), np.int8), 0.05)
    odometry = Odometry(0, Pose2(), Twist(), np.zeros((3, 3)))
    known = CellInputs(odometry, Pose2(1.0, 0.0, 0.0), None, grid, np.zeros((0, 2)), JoystickInput(0))
    perceived = perception.step(50_000_000, known)
    view = perception_view(perceived, CHAIR_A, PanTiltAngles(0, 1.0, 0.0, True))
    wiring = perceived.network.wiring
    assert sorted(each.name for each in view.cells) == sorted(wiring.nodes)
    assert view.cells[0].depth == 0
    assert max(each.depth for each in view.cells) >= 2
    assert [each.number for each in view.doorways] == [3, 7]
    assert view.doorways[0].words == (
        "Doorway 3, 2.0 m away, 90 degrees left: ajar, 0.70 m wide to 3 cm, not surely wide enough for this chair."
    )
    assert view.doorways[1].words == (
        "Doorway 7, 4.1 m away, 14 degrees left: open, 0.90 m wide to 2 cm, wide enough for this chair with 28 cm to spare."
    )
    assert view.aim is not None
    assert view.aim.words.startswith("The camera looks 57 degrees left")
    for name in view.networks:
        assert (drawn_network(perceived, name) or "").startswith("<svg")
    assert drawn_network(perceived, "Lidar view") is None


def test_every_kind_of_effect_in_the_shipped_networks_has_a_name() -> None:
    for preset in ("paper", "default"):
        kinds = shipped(preset, PaperSettings(), CHAIR_A).wiring.kinds
        assert all(kind is not None for name, kind in kinds.items() if name != "inhibit Free-space finding")
