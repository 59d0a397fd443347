"""The speed of a leg: a chair with sonars is slow into gaps, in which there may be glass that sonars hear late."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.drive.leg_drive import LegDrive, LegInput
from waychair.maps.grid.distance_field import DistanceField, distance_field
from waychair.planning.grid.drawn_map import DrawnMap
from waychair.planning.route.legs import PathLeg
from waychair.planning.window.motion_limits import DwaSettings
from waychair.types import OccupancyGrid, Path, Pose2, Twist

CELL, GAP, MIDDLE = 0.05, 6.0, 4.0
THERE = GAP - CHAIR_A.front
"""The stretch on which the front is in the gap."""


def gapped() -> OccupancyGrid:
    """12 x 8 m with a wall of 0.15 m from x = 6 m on, and a gap of 1.2 m in it round y = 4 m."""
    cells = np.zeros((160, 240), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    cells[:, 120:123] = 100
    cells[68:92, 120:123] = 0
    return OccupancyGrid(cells, CELL)


LINES = {"line": np.full(200, 0.16), "window": None}


def driven(x: float, has_sonars: bool, speed: float = 0.8, manner: str = "line") -> float:
    """Return the speed [m/s] 1 s after a speed at x [m] on the way through the gap."""
    grid = gapped()
    way = np.column_stack([np.arange(1.0, 11.0, CELL), np.full(200, MIDDLE), np.zeros(200)])
    rooms = LINES[manner]
    leg = LegDrive(PathLeg(Path(way), rooms), DrawnMap(grid, CHAIR_A), CHAIR_A)
    free = distance_field(grid)

    def local() -> DistanceField:
        return free

    pose, command = Pose2(x, MIDDLE, 0.0), Twist(speed, 0.0)
    for _ in range(20):
        command = leg.step(
            LegInput(pose, pose, command, local, Pose2(), None, has_sonars=has_sonars), DwaSettings()
        ).twist
        pose = pose @ Pose2(command.v * 0.05, 0.0, command.omega * 0.05)
    return command.v


@pytest.mark.parametrize("manner", LINES)
def test_with_sonars_a_chair_is_slow_before_a_gap_until_its_front_is_through(manner: str) -> None:
    assert driven(THERE - 0.8, has_sonars=True, speed=0.4, manner=manner) < 0.42
    assert driven(THERE - 0.4, has_sonars=True, speed=0.4, manner=manner) < 0.42
    assert driven(THERE + 0.4, has_sonars=True, speed=0.4, manner=manner) > 0.5


def test_the_papers_window_keeps_a_limit_from_elsewhere() -> None:
    grid = gapped()
    way = np.column_stack([np.arange(1.0, 11.0, CELL), np.full(200, MIDDLE), np.zeros(200)])
    leg = LegDrive(PathLeg(Path(way)), DrawnMap(grid, CHAIR_A), CHAIR_A, as_paper=True)
    free, pose, command = distance_field(grid), Pose2(1.5, MIDDLE, 0.0), Twist(0.6, 0.0)
    for _ in range(20):
        view = LegInput(pose, pose, command, lambda: free, Pose2(), None, fastest=0.2)
        command = leg.step(view, DwaSettings()).twist
    assert 0.05 < command.v < 0.21


def test_it_slows_down_in_time_and_not_earlier() -> None:
    assert driven(THERE - 1.2, has_sonars=True) < 0.6
    assert driven(2.0, has_sonars=True) > 0.75


def test_without_sonars_it_keeps_its_speed() -> None:
    assert driven(THERE - 0.8, has_sonars=False) > 0.75
