"""What no sensor sees is driven into slowly."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair import BODIES, CHAIR_A
from waychair.control.unseen import Sector, UnseenLimits, UnseenSettings, limits_by_sight, sectors_of_scan
from waychair.types import Pose2, Scan

ALL_ROUND = Sector(Pose2(0.25, 0.0, 0.0), math.pi, 10.0)
AHEAD = Sector(CHAIR_A.base_from_laser, math.radians(135), 10.0)
BEHIND = Sector(Pose2(-CHAIR_A.rear, 0.0, math.pi), math.radians(85), 4.0)


def test_with_sight_all_round_nothing_is_limited() -> None:
    assert limits_by_sight(CHAIR_A, [ALL_ROUND]) == UnseenLimits()


def test_a_lidar_that_looks_ahead_limits_reverse_and_turning_but_not_driving_ahead() -> None:
    limits = limits_by_sight(CHAIR_A, [AHEAD])
    assert limits.forward == math.inf
    assert limits.reverse == 0.15
    assert limits.omega * CHAIR_A.circumscribed_radius == pytest.approx(0.15)


def test_without_any_sensor_everything_is_slow() -> None:
    limits = limits_by_sight(CHAIR_A, [], UnseenSettings(speed=0.1))
    assert (limits.forward, limits.reverse) == (0.1, 0.1)


def test_a_sensor_at_the_back_frees_reverse() -> None:
    assert limits_by_sight(CHAIR_A, [AHEAD, BEHIND]).reverse == math.inf


@pytest.mark.parametrize("name", BODIES)
def test_no_body_turns_a_corner_faster_than_the_limit_into_the_unseen(name: str) -> None:
    body = BODIES[name]
    limits = limits_by_sight(body, [])
    assert limits.omega * np.hypot(*body.outline().T).max() <= 0.15 + 1e-12


def test_beams_that_are_invalid_split_a_scan_into_sectors() -> None:
    ranges = np.full(360, 2.0, np.float32)
    ranges[100:110] = np.nan
    ranges[:5] = np.inf
    scan = Scan(0, ranges, -math.pi, math.tau / 360, range_max=8.0)
    first, second = sectors_of_scan(scan, Pose2(1.0, 0.0, 0.0))
    assert (first.reach, second.reach) == (8.0, 8.0)
    assert first.half_angle == pytest.approx(math.radians(50))
    assert second.half_angle == pytest.approx(math.radians(125))
    assert first.base_from_sensor.theta == pytest.approx(-math.pi + math.radians(49.5))
    assert sectors_of_scan(Scan(0, np.full(9, np.nan, np.float32), 0.0, 0.1), Pose2()) == []
