"""A hall with an ideal chair in it, for tests of the navigator."""

from __future__ import annotations

import math

import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.drive.navigator import Navigation, Navigator, NavigatorSettings, Stage
from waychair.planning.body.footprint import along_arc
from waychair.types import FloatArray, OccupancyGrid, Place, Pose2

TICK_NS = 50_000_000
NOTHING = np.empty((0, 2))


def hall(*boxes: tuple[float, float, float, float]) -> OccupancyGrid:
    """12 x 8 m with walls round it and boxes (x0, y0, x1, y1) [m] in it."""
    cells = np.zeros((160, 240), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    for x0, y0, x1, y1 in boxes:
        cells[round(y0 / 0.05) : round(y1 / 0.05), round(x0 / 0.05) : round(x1 / 0.05)] = 100
    return OccupancyGrid(cells, 0.05, Pose2())


def segment(x0: float, y0: float, x1: float, y1: float) -> FloatArray:
    """Return points every 2 cm, as a lidar would see a board."""
    count = round(math.hypot(x1 - x0, y1 - y0) / 0.02) + 1
    return np.column_stack([np.linspace(x0, x1, count), np.linspace(y0, y1, count)])


def drive(
    navigator: Navigator, pose: Pose2, seconds: float, obstacles: FloatArray = NOTHING, start_ns: int = 0
) -> tuple[list[Navigation], list[Pose2]]:
    """Run ticks of an ideal chair until the drive ends or the time is up."""
    states, poses = [], [pose]
    for k in range(round(seconds * 20)):
        states.append(navigator.step(start_ns + k * TICK_NS, poses[-1], obstacles if k % 2 == 0 else None))
        if states[-1].stage in (Stage.ARRIVED, Stage.FAILED):
            break
        v, omega = states[-1].twist.v, states[-1].twist.omega
        p = poses[-1]
        poses.append(Pose2(*along_arc(p.x, p.y, p.theta, v, omega, 0.05)))
    return states, poses


def navigator(grid: OccupancyGrid, settings: NavigatorSettings | None = None) -> Navigator:
    return Navigator(grid, {"lift": Place("lift", Pose2(9.0, 5.0, 1.0))}, CHAIR_A, settings)
