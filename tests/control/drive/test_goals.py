"""Unreachable goals are refused with a reason, and the present goal stays."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from tests.control.drive.navigator_hall import NOTHING, TICK_NS, drive, hall, navigator
from waychair.control.drive.navigator import Stage
from waychair.errors import GoalOutsideMap
from waychair.planning.window.dwa import DwaResult
from waychair.types import Goal, Pose2, Twist


def test_a_goal_outside_of_the_map_is_refused_at_once_and_the_present_one_stays() -> None:
    pilot = navigator(hall())
    pilot.go(Goal("lift"))
    for bad in (Pose2(4.0, 2.0, math.inf), Pose2(math.nan, 2.0), Pose2(1e300, 2.0)):
        with pytest.raises(GoalOutsideMap, match="is on no map"):
            pilot.go(Goal(bad))
    assert drive(pilot, Pose2(2.0, 2.0), 40)[0][-1].stage is Stage.ARRIVED


def test_on_a_map_without_free_space_the_chair_stands_and_says_why() -> None:
    pilot = navigator(hall((0.0, 0.0, 12.0, 8.0)))
    pilot.go(Goal(Pose2(4.0, 2.0)))
    (state, *_), _ = drive(pilot, Pose2(2.0, 2.0), 1)
    assert state.stage is Stage.FAILED
    assert "the map has no free space for a chair" in state.reason
    assert state.twist == Twist()


def test_a_goal_that_is_missed_each_time_is_given_up_with_the_distance_and_stays_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pilot, start = navigator(hall()), Pose2(2.0, 4.0)
    pilot.go(Goal(Pose2(8.0, 4.0)))
    follow = pilot._follow

    def overruns(*seen: Any) -> DwaResult:
        return replace(follow(*seen), arrived=True)  # the chair stands, as it takes it, at the end of its way

    monkeypatch.setattr(pilot, "_follow", overruns)
    states, poses = drive(pilot, start, 5)
    assert states[-1].stage is Stage.FAILED
    assert "m and 0 degrees from the goal and cannot stop more exactly" in states[-1].reason
    after = pilot.step(10**10, poses[-1], NOTHING)
    assert (after.stage, after.goals) == (Stage.FAILED, 0)


def test_a_chair_that_stands_at_its_goal_has_arrived_only_once_the_rider_has_said_yes() -> None:
    pilot, here = navigator(hall()), Pose2(9.0, 5.0, 1.0)
    pilot.go(Goal("lift"))
    for k in range(60):
        state = pilot.step(k * TICK_NS, here, NOTHING, unconfirmed=True)
        assert (state.stage, state.twist) == (Stage.DRIVING, Twist())
    pilot.go(Goal("lift"))  # by the yes
    assert pilot.step(60 * TICK_NS, here, NOTHING).stage is Stage.ARRIVED
