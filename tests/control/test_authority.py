"""The stop line of a chair among others: found along the way, kept to in comfort, forwards, backwards and round bends."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.control.authority import BEFORE_LINE, FREE, Authority, crosses, fastest_before
from waychair.control.drive.granted_way import GrantedWay
from waychair.control.drive.navigator_state import MotionState, PlanState
from waychair.control.drive.straying import Straying
from waychair.geometry import transform_points
from waychair.planning.window.motion_limits import DwaSettings
from waychair.types import FloatArray, Pose2

LIMITS = DwaSettings()
PERIOD_S = 0.05


def _straight(length: float, heading: float = 0.0) -> FloatArray:
    x = np.arange(0.0, length, 0.05)
    return np.column_stack([x, np.zeros_like(x), np.full_like(x, heading)])


def _across(x: float) -> Authority:
    return Authority(np.array([[x, -0.7], [x, 0.7]]), "the chair waits")


@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_B])
def test_the_way_left_is_that_of_the_foremost_corner(body: ChairBody) -> None:
    left = _across(4.0).way_left(body, Pose2(0.5, 0.0, 0.0), _straight(6.0))
    assert left == pytest.approx(4.0 - body.front - 0.5, abs=0.05)


@pytest.mark.parametrize("askew", [-0.3, -0.1, 0.1, 0.3])
def test_a_chair_that_is_askew_stops_before_its_foremost_corner_is_over_the_line(askew: float) -> None:
    pose = Pose2(2.5, 0.1, askew)
    left = _across(4.0).way_left(CHAIR_A, pose, _straight(6.0))
    foremost = max(x for x, _ in transform_points(pose, CHAIR_A.outline()).tolist())
    assert 4.0 - foremost - 0.1 < left <= 4.0 - foremost


def test_backwards_it_is_that_of_the_rear() -> None:
    left = _across(4.0).way_left(CHAIR_A, Pose2(0.0, 0.0, math.pi), _straight(6.0, math.pi))
    assert left == pytest.approx(4.0 - CHAIR_A.rear, abs=0.06)


def test_round_a_bend_the_way_is_counted_along_the_line() -> None:
    turn = np.linspace(0.0, math.pi / 2, 40)
    bend = np.column_stack([np.sin(turn), 1.0 - np.cos(turn), turn])
    on = np.column_stack([np.ones(40), 1.0 + np.arange(40) * 0.05, np.full(40, math.pi / 2)])
    line = Authority(np.array([[0.3, 2.5], [1.7, 2.5]]))
    left = line.way_left(CHAIR_A, Pose2(), np.concatenate([bend, on]))
    assert left == pytest.approx(math.pi / 2 + 1.5 - CHAIR_A.front, abs=0.06)


def test_without_a_line_and_with_one_elsewhere_the_way_is_free() -> None:
    assert FREE.way_left(CHAIR_A, Pose2(), _straight(6.0)) == math.inf
    beside = Authority(np.array([[1.0, 2.0], [3.0, 2.0]]))
    assert beside.way_left(CHAIR_A, Pose2(), _straight(6.0)) == math.inf
    assert _across(-0.5).way_left(CHAIR_A, Pose2(), _straight(6.0)) == math.inf  # behind


def test_a_chair_on_the_line_has_no_way_left() -> None:
    assert _across(0.5).way_left(CHAIR_A, Pose2(), _straight(6.0)) == 0.0


def test_a_side_of_the_outline_crosses_although_no_corner_does() -> None:
    short = np.array([[0.2, 0.2], [0.2, 0.5]])
    assert crosses(short, CHAIR_A, np.array([[0.0, 0.0, 0.0], [0.0, 1.5, 0.0]])).tolist() == [True, False]


def test_a_line_beside_the_chair_on_the_straight_line_of_its_rear_does_not_cross_it() -> None:
    rear = -CHAIR_A.rear
    assert not crosses(np.array([[rear, 2.0], [rear, 3.0]]), CHAIR_A, np.zeros((1, 3)))[0]
    assert crosses(np.array([[rear, 0.2], [rear, 3.0]]), CHAIR_A, np.zeros((1, 3)))[0]


@pytest.mark.parametrize("speed", [0.2, 0.5, LIMITS.max_speed])
def test_a_chair_that_keeps_the_speed_stops_before_the_line_and_near_it(speed: float) -> None:
    x, v, a, stop = 0.0, speed, 0.0, 6.0
    for _ in range(round(40.0 / PERIOD_S)):
        allowed = min(speed, fastest_before(max(stop - x, 0.0), v, LIMITS))
        wanted = max((allowed - v) / PERIOD_S, -LIMITS.braking)
        a = min(max(wanted, a - LIMITS.jerk * PERIOD_S), a + LIMITS.jerk * PERIOD_S)
        v = max(v + a * PERIOD_S, 0.0)
        x += v * PERIOD_S
    assert stop - 0.15 < x < stop - BEFORE_LINE / 2
    assert v < 0.01


def test_a_chair_that_has_to_stand_has_no_way_left_with_a_line_or_without() -> None:
    assert Authority(stands=True).way_left(CHAIR_A, Pose2(), _straight(6.0)) == 0.0
    assert fastest_before(0.0, 0.0, LIMITS) == 0.0


def test_a_granted_speed_is_kept_with_a_line_ahead_and_without() -> None:
    way = GrantedWay(CHAIR_A, PlanState(), MotionState(Straying(CHAIR_A, 0.03)))
    assert way.fastest(LIMITS) == math.inf
    way.authority = Authority(speed=0.3)
    assert way.fastest(LIMITS) == 0.3
    way.authority = Authority(stands=True, speed=0.3)
    assert way.fastest(LIMITS) == 0.0
