"""What a pilot makes of a scan for the navigator."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair import CHAIR_A
from waychair.runtime.pilot import Pilot, PilotSettings
from waychair.slam.localisation import Localisation, LocalisationState
from waychair.types import OccupancyGrid, Pose2, Scan, Twist


def test_beams_end_on_something_or_are_free_as_far_as_the_navigator_looks() -> None:
    grid = OccupancyGrid(np.zeros((400, 400), np.int8), 0.05)
    pilot = Pilot(grid, {}, CHAIR_A, PilotSettings(), None, ())
    reach = pilot.settings.navigator.obstacle_range
    ranges = np.array([2.0, reach, reach + 1.0, math.inf, math.nan, 0.0], np.float32)
    pose = Pose2(10.0, 10.0, 0.5)
    localisation = Localisation(pose, Pose2(), 1.0, LocalisationState.OK, 1.0)
    pilot.see(Scan(0, ranges, 0.0, 0.0), localisation, Twist())
    laser = pose @ CHAIR_A.base_from_laser
    sight = pilot._sight
    assert sight.points is not None
    assert sight.beyond is not None
    ways = [np.hypot(*(ends - (laser.x, laser.y)).T).tolist() for ends in (sight.points, sight.beyond)]
    assert ways == [pytest.approx([2.0]), pytest.approx([0.999 * reach] * 3)]
