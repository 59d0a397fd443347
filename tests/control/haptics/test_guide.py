"""Guidance on a chair of plain equations: when symbols come, and where they lead."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import pytest

from tests.control.haptics.plain_driver import DURATIONS, TICK_S, PlainDriver, corner, driven, open_leg, through
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.haptics.course import off_aim, veered
from waychair.control.haptics.guide import StepGuide
from waychair.control.haptics.guide_numbers import GAP_S, LOOK_AHEAD
from waychair.control.haptics.guide_types import GuideInputs, GuideState, LeadingPhase, Nudge
from waychair.control.haptics.rider import RiderModel
from waychair.control.haptics.symbols import Symbol
from waychair.geometry import wrap_angle
from waychair.planning.route.legs import DoorPassage
from waychair.planning.steps.step import Step, StepKind, StepPlan, with_pivots
from waychair.types import Pose2, Twist


def test_an_obedient_driver_arrives_within_ten_centimetres_round_a_corner() -> None:
    drive = driven(corner(), PlainDriver(Pose2(), RiderModel()))
    assert drive.last.arrived
    assert math.hypot(drive.driver.pose.x - 3.0, drive.driver.pose.y - 2.0) < 0.1


def test_the_turn_is_said_ahead_by_pattern_and_lag() -> None:
    rider = RiderModel()
    drive = driven(corner(), PlainDriver(Pose2(), rider))
    swivel = next(at for at, symbol in drive.said if symbol is Symbol.SWIVEL_LEFT)
    forward = next(at for at, symbol in drive.said if symbol is Symbol.FORWARD)
    begins = forward + DURATIONS[Symbol.FORWARD] + rider.lag_s
    arrives = begins + 3.0 / rider.speed
    assert abs(arrives - swivel - DURATIONS[Symbol.SWIVEL_LEFT] - rider.lag_s) < 0.35


def test_patterns_keep_their_gap() -> None:
    drive = driven(corner(), PlainDriver(Pose2(0.0, 0.0, math.radians(4.0)), RiderModel()), seconds=6.0)
    assert any(symbol is Symbol.NUDGE_RIGHT for _, symbol in drive.said)
    for (at, symbol), (later, _) in itertools.pairwise(drive.said):
        assert later - at >= DURATIONS[symbol] + GAP_S - 1e-6


def test_a_nudge_that_is_on_its_way_is_counted_before_another_is_said() -> None:
    guide, now_ns = StepGuide(CHAIR_A, RiderModel(), DURATIONS), 10_000_000_000
    off = GuideInputs(now_ns, Pose2(1.0, 0.0, math.radians(3.0)), Twist(0.3, 0.0))
    said = GuideState(step=0, said=Symbol.NUDGE_RIGHT, said_ns=now_ns - 700_000_000)
    again, _ = guide.step(corner(), said, off)
    counted, _ = guide.step(corner(), replace(said, nudges=(Nudge(-RiderModel().nudge, now_ns + 600_000_000),)), off)
    assert again.advice is not None
    assert again.advice.symbol is Symbol.NUDGE_RIGHT
    assert counted.advice is None


def test_a_door_is_passed_in_its_middle_by_odometry_alone_despite_a_veer() -> None:
    door = DoorPassage(Pose2(4.0, 0.5, math.radians(10.0)), 0.8)
    driver = PlainDriver(Pose2(), RiderModel(veer_per_m=math.radians(5.0)))
    plan = through(door)
    offsets = []
    guide_drive = driven(plan, driver)
    assert guide_drive.last.arrived
    at = door.map_from_door.inverse() @ guide_drive.driver.pose
    offsets.append(at.y)
    assert at.x > CHAIR_A.rear
    assert abs(at.y) < 0.2


def arc(begin: Pose2, veer: float, way: float) -> Pose2:
    """Return where a chair that veers is after a way ahead."""
    turned = veer * way
    return begin @ Pose2(math.sin(turned) / veer, (1.0 - math.cos(turned)) / veer, turned)


@pytest.mark.parametrize("along", [-0.4, 0.2])
def test_an_arc_of_a_chair_that_veers_leads_through_the_doors_middle(along: float) -> None:
    plan = through(DoorPassage(Pose2(4.0), 0.9))
    step = next(each for each in plan.steps if each.door is not None)
    assert step.door is not None
    assert off_aim(step, Pose2(along), CHAIR_A, 0.0) == 0.0
    veer, at = -0.1, (step.start.inverse() @ step.door.map_from_door).x
    begin = Pose2(along, 0.0, off_aim(step, Pose2(along), CHAIR_A, veer))
    way = at - along
    passing = [arc(begin, veer, each) for each in (way - CHAIR_A.front, way)]
    lines = [pose.y + (at - pose.x) * math.tan(pose.theta) for pose in passing]
    assert 0.5 * sum(lines) == pytest.approx(0.0, abs=0.004)
    _, turned = veered(veer, way, CHAIR_A.front)
    assert begin.theta + turned == pytest.approx(0.5 * sum(pose.theta for pose in passing), abs=1e-3)


def test_an_arc_of_a_chair_that_veers_ends_on_the_open_leg() -> None:
    leg, veer = open_leg(8.0).steps[0], -0.12
    begin = Pose2(1.0, 0.0, off_aim(leg, Pose2(1.0), CHAIR_A, veer))
    assert begin.theta > 0.0
    assert arc(begin, veer, LOOK_AHEAD).y == pytest.approx(0.0, abs=0.005)


@pytest.mark.parametrize("plan", [corner(), through(DoorPassage(Pose2(2.0, 3.0, math.pi / 2), 0.9))])
def test_a_chair_is_turned_before_a_leg_or_a_door_so_far_that_its_veer_leads_back_to_it(plan: StepPlan) -> None:
    guide = StepGuide(CHAIR_A, RiderModel(veer_per_m=-0.12), DURATIONS)
    turn = next(k for k, step in enumerate(plan.steps) if step.kind is StepKind.PIVOT)
    against = wrap_angle(
        guide._begin(plan, turn, GuideState(), GuideInputs(0, Pose2(), Twist())).heading - plan.steps[turn].end.theta
    )
    assert math.radians(2.0) < against < math.radians(8.0)
    assert off_aim(plan.steps[turn + 1], Pose2(0.0, 0.0, against), CHAIR_A, -0.12) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("length", [7.5, 8.0, 9.0])
def test_a_chair_whose_veer_outruns_the_nudges_stays_near_an_open_leg(length: float) -> None:
    rider = RiderModel(veer_per_m=-0.2, nudge=math.radians(1.0))
    drive = driven(open_leg(length), PlainDriver(Pose2(), rider))
    assert drive.last.arrived
    assert abs(drive.driver.pose.y) < 0.25
    assert any(symbol is Symbol.SWIVEL_LEFT for _, symbol in drive.said)


def test_a_driver_who_stops_short_of_the_place_gets_new_steps() -> None:
    plan, guide = open_leg(2.0), StepGuide(CHAIR_A, RiderModel(), DURATIONS)
    ended = {}
    for short in (0.1, 0.45):
        said = GuideState(1, LeadingPhase.DONE, said=Symbol.ARRIVED, said_ns=0)
        guidance, _ = guide.step(plan, said, GuideInputs(3_000_000_000, Pose2(2.0 - short), Twist()))
        ended[short] = guidance.arrived, guidance.astray
    assert ended == {0.1: (True, False), 0.45: (False, True)}


def test_a_turn_right_round_is_asked_for_again_to_the_side_that_was_said() -> None:
    about = Step(StepKind.STRAIGHT, Pose2(0.0, 0.0, math.pi), Pose2(-2.0, 0.0, math.pi), room=0.3)
    guide, plan = StepGuide(CHAIR_A, RiderModel(), DURATIONS), with_pivots(Pose2(), [about], None)
    for side, symbol in ((1.0, Symbol.SWIVEL_LEFT), (-1.0, Symbol.SWIVEL_RIGHT)):
        state, asked = GuideState(step=0, phase=LeadingPhase.TURN, heading=math.pi, said=symbol), []
        for tick in range(1, 200):
            askew = 0.05 * side * (-1.0) ** (tick // 20)  # the chair twitches, and does not turn
            inputs = GuideInputs(tick * 50_000_000, Pose2(0.0, 0.0, askew), Twist())
            word, state = guide.step(plan, state, inputs)
            asked += [] if word.advice is None else [word.advice.symbol]
            if word.advice is not None and word.advice.symbol is Symbol.BACK:
                break
        swivels = [each for each in asked if each in (Symbol.SWIVEL_LEFT, Symbol.SWIVEL_RIGHT)]
        assert len(swivels) > 1
        assert set(swivels) == {symbol}


@pytest.mark.parametrize(("width", "beside_cm"), [(0.9, (2.0, 5.0)), (0.68, (0.1, 1.8))])
def test_a_chair_that_would_pass_the_middle_of_a_door_askew_aims_beside_it_as_far_as_the_door_is_wide(
    width: float, beside_cm: tuple[float, float]
) -> None:
    plan, veer = through(DoorPassage(Pose2(3.0, 0.0), width)), -0.12
    step = next(each for each in plan.steps if each.door is not None)
    assert step.door is not None
    at = step.start.inverse() @ step.door.map_from_door
    there = Pose2(at.x - 1.3, 0.06, 0.0)  # beside the axis, on the side from which the chair veers
    aimed = off_aim(step, there, CHAIR_A, veer)
    aside, bend = veered(veer, 1.3, CHAIR_A.front)
    offset = there.y + 1.3 * math.tan(aimed) + aside
    to_middle = math.atan2(-there.y - aside, 1.3)
    assert to_middle + bend < math.radians(-4.0)  # so far askew it would pass the middle
    assert beside_cm[0] < 100.0 * offset < beside_cm[1]
    assert aimed > to_middle


def test_a_course_that_misses_the_door_is_broken_off_and_tried_again() -> None:
    door = DoorPassage(Pose2(3.0, 0.0, 0.0), 0.8)
    begin = Pose2(1.6, 0.22, 0.0)  # close before the door and 22 cm beside its axis
    plan = StepPlan(
        (
            replace(through(door).steps[-2], start=Pose2(0.8), kind=StepKind.DOOR),
            through(door).steps[-1],
        )
    )
    drive = driven(plan, PlainDriver(begin, RiderModel()), seconds=200.0)
    assert drive.last.arrived or drive.last.astray
    assert any(symbol is Symbol.BACK for _, symbol in drive.said) or drive.last.astray


def test_the_guide_falls_silent_before_a_driver_who_does_not_follow_and_offers_to_repeat() -> None:
    plan, driver = corner(), PlainDriver(Pose2(), RiderModel(), deaf=True)
    guide, state, said, offered = StepGuide(CHAIR_A, RiderModel(), DURATIONS), GuideState(), list[float](), False
    for tick in range(1, 400):
        guidance, state = guide.step(plan, state, GuideInputs(tick * 50_000_000, driver.pose, Twist()))
        offered = offered or guidance.offers_repeat
        if guidance.advice is not None:
            said.append(tick * TICK_S)
    assert offered
    assert max(b - a for a, b in itertools.pairwise(said)) >= 4.0


def test_a_driver_far_beside_the_leg_gets_new_steps() -> None:
    guide = StepGuide(CHAIR_A, RiderModel(), DURATIONS)
    guidance, _ = guide.step(corner(), GuideState(), GuideInputs(50_000_000, Pose2(1.0, 0.8, 0.0), Twist(0.3, 0.0)))
    assert guidance.astray
    assert guidance.advice is None
