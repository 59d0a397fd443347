"""A rider who wants other steps where there are none waits with a reason, and is told after a while that nothing leads on."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.runtime.haptics.guided_rider import DESK, START, room
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.haptics.guide_types import GuideInputs, GuideWord
from waychair.control.haptics.learning import RiderLearner
from waychair.control.haptics.patterns import vocabulary
from waychair.errors import NoPath
from waychair.planning.grid.costmap import Costmap, LiveCostmap
from waychair.planning.steps.step_planner import StepPlanner
from waychair.runtime.haptics.live_ground import LiveGround
from waychair.runtime.haptics.step_leader import REFUSED_NS, LedGround, StepLeader
from waychair.simulation.plan.world import load_world
from waychair.simulation.simulator import Simulator
from waychair.types import Goal, Pose2, Scan, Twist

DURATIONS = {symbol: 1e-3 * each.duration_ms for symbol, each in vocabulary("glove_3x3").patterns.items()}
ASIDE = Pose2(2.0, 2.9, 0.0)
"""Off the way from `START` to the desk, so that other steps are wanted."""


def _ground(*, shut: bool) -> Costmap:
    """Return the ground of the room, with or without the wall."""
    grid = room()
    if shut:
        grid.cells[:, 70:72] = 100
    return LiveCostmap(grid, CHAIR_A, ()).costmap()


class Leading:
    """A leader in the room, between whose rider and the desk a wall can be drawn."""

    def __init__(self, *, shut: bool = False, mapped_shut: bool = False, grows: bool = False) -> None:
        self.leader, self.shut, self.asked, self.now_ns = StepLeader(CHAIR_A, DURATIONS, RiderLearner()), shut, 0, 0
        self.asked_map, self._mapped_shut = 0, mapped_shut
        self.leader.lead(DESK, LedGround(lambda: self._costmap, lambda: self._map_alone, grows=grows))
        self.run(START, 0.1)

    def _costmap(self) -> Costmap:
        self.asked += 1
        return _ground(shut=self.shut)

    def _map_alone(self) -> Costmap:
        self.asked_map += 1
        return _ground(shut=self._mapped_shut)

    def run(self, pose: Pose2, seconds: float) -> GuideWord | None:
        """Let a rider stand at a pose for a time; return the last guidance."""
        word = None
        for _ in range(max(1, round(seconds / 0.05))):
            self.now_ns += 50_000_000
            word = self.leader.step(GuideInputs(self.now_ns, pose, Twist()))
        return word


def test_a_rider_waits_with_the_reason_and_goes_on_once_the_way_is_free_again() -> None:
    leading = Leading()
    assert (leading.leader.waits, leading.asked) == ("", 1)
    leading.shut = True
    leading.run(ASIDE, 10.0)
    assert "no path" in leading.leader.waits or "no straight legs" in leading.leader.waits
    assert leading.leader.goal is not None
    assert 3 <= leading.asked <= 8  # not at every tick
    leading.shut = False
    leading.run(ASIDE, 2.5)
    assert leading.leader.waits == ""
    plan = leading.leader.plan
    assert plan is not None
    assert np.hypot(plan.steps[0].start.x - ASIDE.x, plan.steps[0].start.y - ASIDE.y) < 0.05


def test_somebody_in_the_way_at_the_beginning_is_waited_for_and_a_wall_of_the_map_is_not() -> None:
    leading = Leading(shut=True)
    leading.run(START, 10.0)
    assert "no path" in leading.leader.waits
    assert (leading.leader.goal, leading.leader.plan) == (DESK, None)
    assert 3 <= leading.asked <= 8
    assert leading.asked_map == 1
    leading.shut = False
    leading.run(START, 2.5)
    assert (leading.leader.waits, leading.leader.plan is None) == ("", False)
    assert Leading(shut=True, mapped_shut=True).leader.goal is None
    never = Leading(shut=True)
    never.run(START, REFUSED_NS * 1e-9 + 3.0)
    assert never.leader.goal is None
    assert "no path" in never.leader.reason


def test_a_rider_who_waits_gets_steps_from_wherever_they_begin_again() -> None:
    leading = Leading()
    leading.shut = True
    leading.run(ASIDE, 3.0)
    word = leading.run(START, 1.0)  # back on the old way, where the guide itself wants nothing else
    assert leading.leader.waits
    assert word is not None
    assert word.hold.rear == 1.0  # who waits may back away from what is in the way
    leading.shut = False
    word = leading.run(START, 2.5)
    assert leading.leader.waits == ""
    assert word is not None
    assert word.hold.rear == 0.0


def test_a_rider_is_asked_nothing_while_no_way_leads_on_and_goes_on_after() -> None:
    leading = Leading()
    leading.shut = True
    leading.run(ASIDE, 3.0)
    assert "no path" in leading.leader.waits
    words = [leading.run(ASIDE, 0.05) for _ in range(200)]
    assert all(word is not None and (word.advice, word.reason) == (None, leading.leader.waits) for word in words)
    assert leading.leader.again(GuideInputs(leading.now_ns, ASIDE, Twist())) is None  # nor is an old symbol repeated
    leading.shut = False
    words = [leading.run(ASIDE, 0.05) for _ in range(60)]
    assert any(word is not None and word.advice is not None for word in words)


# a hold is noticed as well where the steps are looked at each second
@pytest.mark.parametrize("grows", [False, True])
def test_new_steps_that_follow_a_hold_tell_what_held_the_chair(grows: bool) -> None:
    leading, told = Leading(grows=grows), set[str]()
    held = GuideInputs.under((0.0, 0.0, 1.0, 1.0), 0.25, 0.0, 0, START, Twist())
    for _ in range(1000):
        leading.now_ns += 50_000_000
        leading.leader.step(replace(held, now_ns=leading.now_ns))
        told.add(leading.leader.led_on)
    assert told == {"", "something is in the way, after 2 tries"}
    away = Leading()
    away.run(ASIDE, 3.0)  # off the way by the rider's own driving
    assert (away.asked, away.leader.led_on) == (2, "")


def test_a_rider_who_waits_at_a_door_is_told_so_without_coordinates() -> None:
    clinic = load_world("small_clinic")
    before, goal = Pose2(12.9, 4.4, math.pi), next(place.pose for place in clinic.places if place.name == "bath")
    simulator = Simulator(replace(clinic.with_closed(["bath"]), start=before), CHAIR_A)
    scans = [message for message in simulator.advance(200_000_000) if isinstance(message, Scan)]
    ground = LiveGround(CHAIR_A, clinic.grid)
    ground.see(scans[-1], before, Twist())
    with pytest.raises(NoPath) as refused:
        StepPlanner(Goal(goal), goal).replan(ground.ask()(), before)
    assert ground.ask_why()(refused.value, before, goal) == "the door is shut, or something stands in it"


def test_a_rider_to_whom_nothing_leads_on_is_told_so_in_the_end() -> None:
    leading = Leading()
    leading.shut = True
    leading.run(ASIDE, REFUSED_NS * 1e-9 - 3.0)
    assert leading.leader.goal is not None
    leading.run(ASIDE, 6.0)
    assert leading.leader.goal is None
    assert leading.leader.reason
    assert not leading.leader.arrived
