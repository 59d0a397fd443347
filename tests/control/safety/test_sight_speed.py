"""Into unseen space the chair drives slowly, and nowhere faster than it can stop within sight."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.chair_body import BODIES, CHAIR_A, CHAIR_A_FRONT
from waychair.control.safety.sight_speed import (
    BRAKING,
    FAR_ENOUGH,
    REACTION_S,
    Sector,
    UnseenSettings,
    sectors_of_scan,
    sight_along,
    sight_share,
)
from waychair.types import Pose2, Scan, Twist

S = UnseenSettings()
ALL_ROUND = Sector(Pose2(0.25, 0.0, 0.0), math.pi, 10.0)
AHEAD = Sector(CHAIR_A.base_from_laser, math.radians(135), 10.0)
BEHIND = Sector(Pose2(-CHAIR_A.rear, 0.0, math.pi), math.radians(100), 4.0)


def view(field_of_view: float, turns: int = 0, range_max: float = 25.0) -> list[Sector]:
    scan = Scan(
        0,
        np.ones(181, np.float32),
        -field_of_view / 2 + turns * math.tau,
        field_of_view / 180,
        range_max=range_max,
    )
    return sectors_of_scan(scan, CHAIR_A.base_from_laser)


@given(st.floats(-0.8, 0.8), st.floats(-0.8, 0.8))
def test_with_a_full_field_of_view_nothing_is_limited(v: float, omega: float) -> None:
    assert sight_share(Twist(v, omega), CHAIR_A, [ALL_ROUND]) == 1.0


def test_reversing_and_turning_into_unseen_space_is_slow() -> None:
    sectors = view(math.radians(270.0))
    assert sight_share(Twist(0.8, 0.0), CHAIR_A, sectors) == 1.0
    assert sight_share(Twist(-0.3, 0.0), CHAIR_A, sectors) == pytest.approx(0.5)
    assert sight_share(Twist(-0.1, 0.0), CHAIR_A, sectors) == 1.0
    turning = sight_share(Twist(0.0, 0.8), CHAIR_A, sectors)
    assert turning * 0.8 * CHAIR_A.width / 2 == pytest.approx(S.speed)


def test_a_sensor_at_the_back_frees_reverse() -> None:
    assert sight_share(Twist(-0.5, 0.0), CHAIR_A, [AHEAD]) == pytest.approx(0.3)
    assert sight_share(Twist(-0.5, 0.0), CHAIR_A, [AHEAD, BEHIND]) == 1.0


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("twist", [Twist(0.8, 0.0), Twist(-0.4, 0.2), Twist(0.0, 0.8), Twist(0.5, -0.6)])
def test_a_blind_chair_moves_no_part_outwards_faster_than_the_limit(name: str, twist: Twist) -> None:
    body = BODIES[name]
    share = sight_share(twist, body, [])
    x, y = body.outline().T
    outwards = np.maximum(np.sign(x) * (twist.v - twist.omega * y), np.sign(y) * twist.omega * x)
    assert share * outwards.max() <= S.speed + 1e-9


@pytest.mark.parametrize("range_max", [1.2, 1.5, 2.0, 3.0])
def test_a_lidar_with_a_short_range_limits_the_speed_to_a_stop_within_sight(range_max: float) -> None:
    sectors = view(math.radians(270.0), range_max=range_max)
    way = sight_along(Twist(0.8, 0.0), CHAIR_A, sectors)
    assert CHAIR_A.laser_x + range_max - CHAIR_A.front - 0.2 <= way <= CHAIR_A.laser_x + range_max - CHAIR_A.front
    v = 2.5 * sight_share(Twist(2.5, 0.0), CHAIR_A, sectors)
    assert v * REACTION_S + v * v / (2 * BRAKING) == pytest.approx(way, abs=1e-6)


def test_on_an_arc_the_strip_of_the_arc_must_be_seen() -> None:
    to_the_right = Sector(Pose2(-CHAIR_A.rear, 0.0, -0.6), 1.05, 10.0)
    assert sight_along(Twist(0.8, -0.6), CHAIR_A, [to_the_right]) == FAR_ENOUGH
    assert 0.1 < sight_along(Twist(0.8, 0.6), CHAIR_A, [to_the_right]) < 1.0


def test_the_sight_of_a_corner_does_not_depend_on_full_turns_of_the_angles() -> None:
    known = sight_share(Twist(-0.3, 0.0), CHAIR_A_FRONT, view(math.radians(270.0)))
    for turns in (-1, 1, 3):
        assert sight_share(Twist(-0.3, 0.0), CHAIR_A_FRONT, view(math.radians(270.0), turns)) == known


def test_invalid_beams_split_a_scan_into_sectors_and_drop_outs_do_not() -> None:
    ranges = np.full(360, 2.0, np.float32)
    ranges[100:110] = np.nan
    ranges[200:202] = np.nan
    ranges[:5] = np.inf
    scan = Scan(0, ranges, -math.pi, math.tau / 360, range_max=8.0)
    first, second = sectors_of_scan(scan, Pose2(1.0, 0.0, 0.0))
    assert (first.reach, second.reach) == (8.0, 8.0)
    assert first.half_angle == pytest.approx(math.radians(50))
    assert second.half_angle == pytest.approx(math.radians(125))
    assert first.base_from_sensor.theta == pytest.approx(-math.pi + math.radians(49.5))
    assert sectors_of_scan(Scan(0, np.full(9, np.nan, np.float32), 0.0, 0.1), Pose2()) == []


@pytest.mark.parametrize("value", [math.nan, 0.0, 0.05, -math.inf])
def test_beams_that_end_below_the_least_range_see_nothing_of_the_way(value: float) -> None:
    ranges = np.full(181, 3.0, np.float32)
    ranges[80:101] = value
    first, second = sectors_of_scan(Scan(0, ranges, -math.pi / 2, math.pi / 180, range_min=0.1), Pose2())
    assert first.half_angle == pytest.approx(math.radians(40.0))
    assert second.half_angle == pytest.approx(math.radians(40.0))
