"""A way round a doorway that is shut or taken is offered with its cost before the chair takes it."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from tests.control.drive.navigator_hall import NOTHING, TICK_NS, drive, hall, navigator, segment
from waychair.control.drive.navigation import Navigation
from waychair.control.drive.navigator import Navigator, Stage
from waychair.types import FloatArray, Goal, Pose2

WALL = ((6.0, 0.0, 6.15, 1.5), (6.0, 2.5, 6.15, 6.0), (6.0, 7.0, 6.15, 8.0))
"""A wall across the hall with doorways at y from 1.5 to 2.5 and from 6 to 7 [m]."""

SHUT = segment(6.07, 1.5, 6.07, 2.5)
NEAR, BEHIND = Pose2(3.7, 2.0, 0.0), Pose2(8.5, 2.0, 0.0)
COST = re.compile(r"(\d+) m \((\d+) s\) longer")


def somebody(x: float, y: float) -> FloatArray:
    """Return points round two legs."""
    angles = np.arange(0.0, math.tau, 0.4)
    ring = 0.07 * np.column_stack([np.cos(angles), np.sin(angles)])
    legs = np.array([[x, y - 0.12], [x, y + 0.12]])
    return (legs[:, None] + ring).reshape(-1, 2)


def until_offered(pilot: Navigator, seen: FloatArray, start: Pose2 = NEAR) -> tuple[list[Navigation], list[Pose2]]:
    """Drive towards the goal behind the wall for a few seconds, until the chair stands and offers the other way."""
    pilot.go(Goal(BEHIND))
    states, poses = drive(pilot, start, 1.0 + 5.0 * (NEAR.x - start.x), seen)
    assert states[-1].stage is Stage.OFFERING
    return states, poses


@pytest.mark.parametrize(("seen", "named"), [(SHUT, "the door is shut"), (somebody(6.07, 2.0), "somebody")])
def test_the_other_way_round_a_doorway_is_offered_with_its_cause_and_cost(seen: FloatArray, named: str) -> None:
    states, poses = until_offered(navigator(hall(*WALL)), seen, Pose2(2.5, 2.0, 0.0))
    assert named in states[-1].reason
    cost = COST.search(states[-1].reason)
    assert cost is not None
    assert 3 <= int(cost[1]) <= 9
    assert states[-1].twist.v == pytest.approx(0.0, abs=1e-6)
    assert math.dist((poses[-1].x, poses[-1].y), (6.07, 2.0)) < 2.6  # it has driven up to the doorway
    assert poses[-1].y == pytest.approx(2.0, abs=0.5)


def test_go_on_takes_the_other_way_at_once() -> None:
    pilot = navigator(hall(*WALL))
    states, poses = until_offered(pilot, SHUT)
    pilot.resume()
    further, ways = drive(pilot, poses[-1], 8, SHUT, len(states) * TICK_NS)
    assert "takes another way" in further[20].reason
    assert all(state.stage is Stage.DRIVING for state in further[20:])
    assert ways[-1].y > 3.0


def test_without_an_answer_the_chair_waits_as_long_as_the_other_way_costs() -> None:
    pilot = navigator(hall(*WALL))
    states, poses = until_offered(pilot, SHUT)
    wait_s = float(re.search(r"up to (\d+) s", states[-1].reason)[1])  # type: ignore[index]
    waited, _ = drive(pilot, poses[-1], wait_s + 3, SHUT, len(states) * TICK_NS)
    offering = sum(state.stage is Stage.OFFERING for state in (*states, *waited)) / 20
    assert offering == pytest.approx(wait_s, abs=2.0)
    assert waited[-1].stage is Stage.DRIVING


def test_a_doorway_that_is_free_again_is_driven_through_without_an_answer() -> None:
    pilot = navigator(hall(*WALL))
    states, poses = until_offered(pilot, SHUT)
    seen_through = segment(11.0, 0.2, 11.0, 3.8)
    further, ways = drive(pilot, poses[-1], 7, seen_through, len(states) * TICK_NS)
    assert further[60].stage is Stage.DRIVING
    assert max(pose.y for pose in ways) < 2.5
    assert ways[-1].x > NEAR.x + 1.0


def test_a_short_way_round_something_is_taken_without_waiting() -> None:
    pilot = navigator(hall())
    pilot.go(Goal(BEHIND))
    states, ways = drive(pilot, Pose2(2.0, 2.0, 0.0), 8, segment(5.0, 1.0, 5.0, 3.0))
    assert ways[-1].x > 3.0
    assert Stage.OFFERING not in {state.stage for state in states}


def test_without_an_offer_there_is_nothing_to_take() -> None:
    pilot = navigator(hall())
    pilot.go(Goal(BEHIND))
    drive(pilot, NEAR, 1, NOTHING)
    pilot.resume()
    assert pilot.stage is Stage.DRIVING


def test_the_longer_way_is_driven_without_backing_out_since_it_is_no_lack_of_progress() -> None:
    pilot = navigator(hall(*WALL))
    states, poses = until_offered(pilot, SHUT)
    pilot.resume()
    further, _ = drive(pilot, poses[-1], 14, SHUT, len(states) * TICK_NS)
    assert pilot.recovery.begun == 0
    assert all(state.twist.v > -0.05 for state in further)
