"""At the goal and before things in the way: at most one turn, few reversals, and never a silent rest."""

from __future__ import annotations

import math
import re
from itertools import pairwise

import numpy as np
import pytest

from tests.control.drive.navigator_hall import NOTHING, TICK_NS, drive, hall, navigator, segment
from waychair.control.drive.navigation import Navigation
from waychair.control.drive.navigator import Navigator, NavigatorSettings, Stage
from waychair.control.drive.recovery import RecoverySettings
from waychair.types import FloatArray, Goal, Pose2

ESTIMATE = re.compile(r"\d+ s\b")


def turned(poses: list[Pose2]) -> float:
    """Return how far the chair turned [degrees], in whichever direction."""
    return math.degrees(float(np.abs(np.diff(np.unwrap([pose.theta for pose in poses]))).sum()))


def way(poses: list[Pose2]) -> float:
    return float(np.hypot(*np.diff([(pose.x, pose.y) for pose in poses], axis=0).T).sum())


def reversals(states: list[Navigation]) -> int:
    gears = [math.copysign(1.0, state.twist.v) for state in states if abs(state.twist.v) > 0.03]
    return sum(a != b for a, b in pairwise(gears))


def stuck(pilot: Navigator, seconds: float, seen: FloatArray = NOTHING) -> list[Navigation]:
    """Run ticks of a chair that obeys no command."""
    here = Pose2(2.0, 2.0, 0.0)
    return [pilot.step(k * TICK_NS, here, seen if k % 2 == 0 else None) for k in range(round(seconds * 20))]


@pytest.mark.parametrize("tolerances", [(0.15, 0.09), (0.05, 0.035), (0.03, 0.03)])
@pytest.mark.parametrize("back", [0.2, 0.4, 0.7])
def test_to_a_goal_just_behind_it_the_chair_backs_without_a_turn(back: float, tolerances: tuple[float, float]) -> None:
    pilot, start = navigator(hall()), Pose2(5.0, 4.0, 0.7)
    pilot.go(Goal(start @ Pose2(-back), *tolerances))
    states, poses = drive(pilot, start, 40)
    assert states[-1].stage is Stage.ARRIVED
    assert turned(poses) < 20.0
    assert way(poses) < back + 0.1


@pytest.mark.sampled(1)
@pytest.mark.parametrize("aside", [(0.0, 0.3, 0.0), (0.1, -0.2, 1.0), (-0.2, 0.2, math.pi), (0.3, 0.3, -2.0)])
def test_to_a_goal_beside_it_the_chair_turns_once_at_most(aside: tuple[float, float, float]) -> None:
    pilot, start = navigator(hall()), Pose2(5.0, 4.0, 0.7)
    pilot.go(Goal(start @ Pose2(*aside), 0.05, 0.05))
    states, poses = drive(pilot, start, 60)
    assert states[-1].stage is Stage.ARRIVED
    assert turned(poses) < 370.0


def test_a_chair_that_stands_at_its_goal_has_arrived() -> None:
    pilot = navigator(hall())
    pilot.go(Goal(Pose2(5.05, 3.96, 0.75), 0.15, 0.1))
    states, poses = drive(pilot, Pose2(5.0, 4.0, 0.7), 5)
    assert states[-1].stage is Stage.ARRIVED
    assert way(poses) < 0.02


def test_a_chair_in_its_goals_place_only_turns() -> None:
    pilot = navigator(hall())
    pilot.go(Goal(Pose2(5.06, 3.95, -2.0), 0.15, 0.09))
    states, poses = drive(pilot, Pose2(5.0, 4.0, 0.7), 30)
    assert states[-1].stage is Stage.ARRIVED
    assert way(poses) < 0.02
    assert turned(poses) < 190.0


@pytest.mark.sampled(1)
@pytest.mark.parametrize("before", [0.1, 0.5, 1.5])
def test_after_a_pause_near_the_goal_the_chair_turns_no_further_than_without(before: float) -> None:
    pilot, goal = navigator(hall()), Pose2(5.0, 2.0, 1.0)
    pilot.go(Goal(goal))
    _, without = drive(pilot, Pose2(2.0, 2.0, 0.0), 40.0)
    pilot.go(Goal(goal))
    poses, now = [Pose2(2.0, 2.0, 0.0)], 0
    while math.dist((poses[-1].x, poses[-1].y), (5.0, 2.0)) > before:
        _, part = drive(pilot, poses[-1], 0.1, start_ns=now)
        poses, now = [*poses, *part[1:]], now + 100_000_000
    pilot.pause()
    _, part = drive(pilot, poses[-1], 3.0, start_ns=now)
    poses = [*poses, *part[1:]]
    pilot.resume()
    states, part = drive(pilot, poses[-1], 40.0, start_ns=now + 3 * 10**9)
    assert states[-1].stage is Stage.ARRIVED
    assert turned([*poses, *part[1:]]) < turned(without) + 20.0


@pytest.mark.nightly
def test_a_chair_that_does_not_move_says_why_and_for_how_long_from_the_second_second_on() -> None:
    pilot = navigator(hall())
    pilot.go(Goal("lift"))
    states = stuck(pilot, 60)
    assert all(ESTIMATE.search(state.reason) for state in states[25:] if state.stage in (Stage.DRIVING, Stage.WAITING))


def test_a_chair_that_waits_says_for_what_and_for_how_long() -> None:
    pilot = navigator(hall((6.0, 0.0, 6.1, 3.4), (6.0, 4.6, 6.1, 8.0)))
    pilot.go(Goal(Pose2(10.0, 4.0, 0.0)))
    states, _ = drive(pilot, Pose2(3.0, 4.0, 0.0), 12, segment(6.05, 3.6, 6.05, 4.4))
    assert states[-1].stage is Stage.WAITING
    assert states[-1].reason.startswith("the door is shut at (6.")
    assert "for up to 120 s" in states[-1].reason


@pytest.mark.nightly
def test_a_door_that_is_shut_for_a_minute_is_waited_for_and_driven_through() -> None:
    pilot = navigator(hall((6.0, 0.0, 6.1, 3.4), (6.0, 4.6, 6.1, 8.0)))
    pilot.go(Goal(Pose2(9.0, 4.0, 0.0)))
    states, poses = drive(pilot, Pose2(4.0, 4.0, 0.0), 60, segment(6.05, 3.6, 6.05, 4.4))
    assert states[-1].stage is Stage.WAITING
    assert reversals(states) <= 4
    states, _ = drive(pilot, poses[-1], 40, NOTHING, start_ns=60 * 10**9)
    assert states[-1].stage is Stage.ARRIVED


def test_the_patience_is_one_setting_in_seconds() -> None:
    settings = NavigatorSettings(recovery=RecoverySettings(patience=6.0))
    pilot = navigator(hall((6.0, 0.0, 6.1, 3.4), (6.0, 4.6, 6.1, 8.0)), settings)
    pilot.go(Goal(Pose2(9.0, 4.0, 0.0)))
    states, _ = drive(pilot, Pose2(4.0, 4.0, 0.0), 30, segment(6.05, 3.6, 6.05, 4.4))
    assert states[-1].stage is Stage.FAILED
    assert states[-1].reason.endswith("for 6 s: have it opened, or choose another goal")
    assert 5.0 < len(states) / 20 < 12.0


def test_a_shut_door_with_another_way_is_told_with_what_the_other_way_costs() -> None:
    walls = hall((6.0, 0.0, 6.1, 1.0), (6.0, 2.2, 6.1, 6.6), (6.0, 7.8, 6.1, 8.0))
    pilot = navigator(walls)
    pilot.go(Goal(Pose2(9.0, 1.6, 0.0)))
    states, _ = drive(pilot, Pose2(3.0, 1.6, 0.0), 5, segment(6.05, 1.2, 6.05, 2.0))
    told = [state.reason for state in states if "another way" in state.reason]
    assert told
    assert re.search(
        r"the door is shut at \(6\..*: the chair waits for it up to \d+ s, then takes another way, \d+ m \(\d+ s\) longer",
        told[0],
    )


@pytest.mark.nightly
def test_a_chair_that_gets_no_nearer_backs_out_twice_and_then_waits() -> None:
    pilot = navigator(hall())
    pilot.go(Goal("lift"))
    states = stuck(pilot, 110)
    assert pilot.recovery.begun <= 10  # after the second, 8 s of driving and 2 s of rest take turns
    assert any(state.stage is Stage.WAITING for state in states)
    assert states[-1].stage is not Stage.FAILED
