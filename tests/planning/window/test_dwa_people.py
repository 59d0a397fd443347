"""The dynamic window among predicted people."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.planning.window.test_dwa import PROMPT, hall, straight
from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.grid.distance_field import distance_field
from waychair.planning.seen.person_tracks import Track
from waychair.planning.window.dwa import choose
from waychair.planning.window.motion_limits import PERIOD
from waychair.types import Pose2, Twist


def walker(x: float, y: float, vx: float, vy: float) -> Track:
    return Track(1, 0, 0, 9, np.array([x, y]), np.array([vx, vy]), 0.01 * np.eye(4), 0.3)


def test_the_chair_waits_for_people_who_will_cross_before_they_are_in_the_way() -> None:
    """They come from the side, still two metres off the path: the field is empty, only the prediction has them."""
    field, pose = distance_field(hall()), Pose2(2.0, 4.0)
    fast = Twist(0.8, 0.0)
    alone = choose(pose, fast, straight(pose, 6.0), field, CHAIR_A, PROMPT)
    crossing = choose(pose, fast, straight(pose, 6.0), field, CHAIR_A, PROMPT, tracks=(walker(3.6, 5.6, 0.0, -1.2),))
    leaving = choose(pose, fast, straight(pose, 6.0), field, CHAIR_A, PROMPT, tracks=(walker(3.6, 5.6, 0.0, 1.2),))
    assert alone.twist.v > 0.78
    assert crossing.twist.v < 0.78 or abs(crossing.twist.omega) > 0.01
    assert leaving.twist == alone.twist


def test_a_standing_chair_does_not_drive_into_a_person_who_walks_at_it() -> None:
    field, pose = distance_field(hall()), Pose2(4.0, 4.0)
    result = choose(pose, Twist(), straight(pose, 6.0), field, CHAIR_A, PROMPT, tracks=(walker(5.3, 4.0, -1.0, 0.0),))
    stands = (result.candidates == 0.0).all(axis=1)
    assert np.isfinite(result.scores[stands]).all()
    assert result.twist.v <= 0.0


@pytest.mark.parametrize(("ahead", "braking"), [(0.6, 1.5), (1.0, 1.5), (1.4, 0.6)])
def test_the_chair_brakes_for_an_approaching_person_as_hard_as_the_remaining_time_needs(
    ahead: float, braking: float
) -> None:
    field, pose, limits = distance_field(hall()), Pose2(3.0, 4.0), replace(PROMPT, reaction_time=0.15)
    at = pose.x + CHAIR_A.front + 0.3 + ahead
    result = choose(pose, Twist(0.8), straight(pose, 6.0), field, CHAIR_A, limits, tracks=(walker(at, 4.0, -0.8, 0.0),))
    assert result.twist.v == pytest.approx(0.8 - braking * PERIOD)
    assert result.twist.omega == 0.0


def test_the_chair_may_drive_away_from_a_person_who_comes_from_behind() -> None:
    field, pose = distance_field(hall()), Pose2(4.0, 4.0)
    behind = walker(pose.x - CHAIR_A.rear - 0.6, 4.0, 0.5, 0.0)
    result = choose(pose, Twist(), straight(pose, 6.0), field, CHAIR_A, PROMPT, tracks=(behind,))
    assert result.twist.v > 0.0
    assert not np.isfinite(result.scores[result.candidates[:, 0] < 0.0]).any()


@pytest.mark.parametrize(
    ("ahead", "vy", "turns"), [(1.3, 0.0, True), (1.3, 0.5, False), (1.3, -0.5, False), (2.2, 0.5, True)]
)
def test_the_chair_does_not_turn_in_search_of_a_way_before_an_approaching_person(
    ahead: float, vy: float, turns: bool
) -> None:
    field, pose = distance_field(hall()), Pose2(4.0, 4.0)
    person = walker(pose.x + ahead, 4.0, 0.0, vy)
    result = choose(pose, Twist(), straight(Pose2(4.0, 4.0, 0.8), 4.0), field, CHAIR_A, PROMPT, tracks=(person,))
    on_the_spot = (result.candidates[:, 0] == 0.0) & (result.candidates[:, 1] != 0.0)
    assert np.isfinite(result.scores[on_the_spot]).any() == turns
    assert np.isfinite(result.scores[~on_the_spot]).any()


def turning(tracks: tuple[Track, ...], at_goal: bool) -> tuple[Twist, bool]:
    """Return the command of a chair that shall turn left on the spot, on its way or at its goal."""
    field, pose = distance_field(hall()), Pose2(4.0, 4.0)
    path = straight(Pose2(4.0, 4.0, 2.0), 0.05 if at_goal else 4.0)
    path.poses[-1, 2] = 2.0
    result = choose(pose, Twist(0.0, 0.3), path, field, CHAIR_A, PROMPT, at_goal, tracks=tracks)
    return result.twist, result.blocked


@pytest.mark.parametrize("at_goal", [False, True])
def test_the_chair_turns_no_corner_into_a_person(at_goal: bool) -> None:
    free, _ = turning((), at_goal)
    assert free.omega > 0.3
    beside = walker(4.0 + CHAIR_A.front, 4.0 + CHAIR_A.width / 2 + 0.4, 0.0, 0.0)
    twist, blocked = turning((beside,), at_goal)
    assert twist.omega <= 0.3
    assert blocked or not at_goal
    behind = walker(4.0 - CHAIR_A.rear - 0.4, 4.0, 0.0, 0.0)
    away = walker(4.0 + CHAIR_A.front, 4.0 + CHAIR_A.width / 2 + 0.9, 0.0, 0.8)
    assert turning((away,), at_goal)[0] == free
    assert turning((behind,), at_goal)[0].omega <= free.omega
