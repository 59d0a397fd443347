"""The source paper's dynamic window as published, with its flaws."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.planning.window.test_dwa import CELL, hall, moved, straight
from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.grid.distance_field import DistanceField, distance_field
from waychair.planning.body.footprint import fits
from waychair.planning.window.dwa import choose
from waychair.planning.window.motion_limits import DwaSettings
from waychair.planning.window.paper_dwa import choose_as_paper, score, window
from waychair.types import Pose2, Twist

PERFECT = DwaSettings(reaction_time=0.0)
DEAD_BAND = 0.06


def test_the_score_sums_three_terms_of_equal_weight_each_divided_by_its_sum() -> None:
    heading, dist, vel = np.array([3.0, 0.0, 1.0]), np.array([0.1, 0.4, 9.0]), np.array([0.2, 0.6, 0.9])
    admissible = np.array([True, True, False])
    found = score((heading, dist, vel), admissible)[:2]
    np.testing.assert_allclose(found, [3 / 3 + 0.1 / 0.5 + 0.2 / 0.8, 0.0 + 0.4 / 0.5 + 0.6 / 0.8])


def test_the_score_is_defined_where_eta_is_zero_over_zero() -> None:
    none = np.zeros(3)
    np.testing.assert_array_equal(score((none, none, none), np.ones(3, bool)), none)


@pytest.mark.parametrize("now", [Twist(), Twist(0.79, 0.1), Twist(0.01, -0.79), Twist(0.4, 0.8)])
def test_the_window_is_the_intersection_of_equations_8_and_9(now: Twist) -> None:
    v, omega = window(now, PERFECT).T
    assert (v.min(), v.max()) == (max(0.0, now.v - 0.03), min(0.8, now.v + 0.025))
    assert (omega.min(), omega.max()) == pytest.approx((max(-0.8, now.omega - 0.04), min(0.8, now.omega + 0.04)))


def test_admissible_commands_obey_equation_10_as_published() -> None:
    field = distance_field(hall(((4.3, 0, 4.5, 8),)))
    result = choose_as_paper(Pose2(3.0, 4.0), Twist(0.4, 0.0), straight(Pose2(3.0, 4.0), 6.0), field, CHAIR_A, PERFECT)
    standing = result.candidates[:, 0] == 0.0
    assert np.isfinite(result.scores).any()
    assert not np.isfinite(result.scores[standing & (result.candidates[:, 1] != 0.0)]).any()
    # 0.5 m to the wall: no more than sqrt(2 * 0.5 * 0.6)
    assert (result.candidates[np.isfinite(result.scores), 0] <= math.sqrt(2 * 0.5 * 0.6)).all()


def test_turning_in_place_is_never_admissible_as_published() -> None:
    result = choose_as_paper(
        Pose2(4.0, 4.0), Twist(), straight(Pose2(4.0, 4.0), 6.0), distance_field(hall()), CHAIR_A, PERFECT
    )
    turning = (result.candidates[:, 0] == 0.0) & (result.candidates[:, 1] != 0.0)
    assert not np.isfinite(result.scores[turning]).any()


def test_the_papers_window_drives_a_chair_without_a_dead_band() -> None:
    field, pose, speed = distance_field(hall()), Pose2(2.0, 4.0), Twist()
    for _ in range(60):
        speed = choose_as_paper(pose, speed, straight(Pose2(2.0, 4.0), 8.0), field, CHAIR_A, PERFECT).twist
        pose = moved(pose, speed)
        assert fits(CHAIR_A, 0.0, field, pose)
    assert speed.v > 0.7
    assert pose.x > 2.8


def test_with_a_dead_band_a_chair_never_starts_round_the_measured_speed_but_starts_round_the_command() -> None:
    """The motors do nothing below 6 cm/s, as real ones do."""
    field, start = distance_field(hall()), Pose2(2.0, 4.0)
    path = straight(start, 8.0)
    as_paper, default, command, speed = start, start, Twist(), Twist()
    for _ in range(60):
        asked = choose_as_paper(as_paper, speed, path, field, CHAIR_A, PERFECT).twist
        speed = asked if abs(asked.v) > DEAD_BAND else Twist()
        as_paper = moved(as_paper, speed)
        command = choose(default, command, path, field, CHAIR_A, PERFECT).twist
        default = moved(default, command if abs(command.v) > DEAD_BAND else Twist())
    assert as_paper == start
    assert default.x > 2.8


def test_without_an_admissible_command_it_brakes_and_says_so() -> None:
    field = DistanceField(np.zeros((100, 100), np.float32), CELL)
    result = choose_as_paper(Pose2(2.5, 2.5), Twist(0.6, 0.3), straight(Pose2(2.5, 2.5), 2.0), field, CHAIR_A, PERFECT)
    assert result.blocked
    assert result.twist.v == pytest.approx(0.6 - 0.6 * 0.05)
