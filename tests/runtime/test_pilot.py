"""The pilot's conversion of a scan for the navigator."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.runtime.pilot import Pilot, PilotSettings
from waychair.slam.localising.localisation import Localisation, LocalisationState
from waychair.types import OccupancyGrid, Pose2, Scan, Twist


@pytest.mark.parametrize("range_max", [math.inf, 6.0, 5.0])
def test_beams_end_on_an_obstacle_or_are_free_up_to_the_range_of_navigator_and_lidar(range_max: float) -> None:
    grid = OccupancyGrid(np.zeros((400, 400), np.int8), 0.05)
    pilot = Pilot(grid, {}, CHAIR_A, PilotSettings(), None, ())
    reach = min(pilot.settings.navigator.obstacle_range, range_max)
    ranges = np.array([2.0, reach, reach + 1.0, math.inf, math.nan, 0.0], np.float32)
    pose = Pose2(10.0, 10.0, 0.5)
    localisation = Localisation(pose, Pose2(), 1.0, LocalisationState.OK, 1.0)
    pilot.see(Scan(9, ranges, 0.0, 0.0, 0.01, range_max=range_max), localisation, Twist())
    laser = pose @ CHAIR_A.base_from_laser
    sight = pilot._sight
    assert sight.points is not None
    assert sight.beyond is not None
    ways = [np.hypot(*(ends - (laser.x, laser.y)).T).tolist() for ends in (sight.points, sight.beyond)]
    assert ways == [pytest.approx([2.0]), pytest.approx([0.999 * reach] * 3)]
    assert sight.seen_ns == 9 + 30_000_000, "when half of the beams were taken"
