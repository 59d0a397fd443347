"""Guidance of a driver whose stick the board guards: what it holds, and what the guide says then."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from tests.control.haptics.plain_driver import DURATIONS, HERE, TICK_S, PlainDriver, corner, driven, open_leg, through
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.haptics.course import before_wall
from waychair.control.haptics.guide import StepGuide
from waychair.control.haptics.guide_numbers import (
    ALL,
    BACK_FROM_THINGS,
    BEHIND_START,
    CREEPS,
    DRIFT,
    IN_VAIN,
    OPEN_SWIVEL_FROM,
    OPEN_TRIES,
    PER_ROOM,
)
from waychair.control.haptics.guide_types import (
    Aim,
    GuideInputs,
    GuideState,
    GuideWord,
    LeadingPhase,
    Nudge,
    StickHold,
)
from waychair.control.haptics.held_stick import stick_hold
from waychair.control.haptics.rider import RiderModel
from waychair.control.haptics.symbols import Symbol
from waychair.planning.route.legs import DoorPassage
from waychair.planning.steps.step import StepKind, StepPlan
from waychair.types import Pose2, Twist


def test_a_guard_that_holds_the_stick_leads_a_drifting_hand_with_weak_nudges_through_a_door() -> None:
    door = DoorPassage(Pose2(3.5), 0.8)
    drifting = RiderModel(nudge=math.radians(0.4), veer_per_m=math.radians(-18.0), speed=0.25)
    drives = []
    for held in (False, True):
        plan = through(door, Pose2(0.0, 0.4))
        drives.append(driven(plan, PlainDriver(Pose2(0.0, 0.4), drifting), known=RiderModel(), held=held))
    alone, helped = drives
    assert not alone.last.arrived
    assert helped.last.arrived
    assert helped.seconds < 45.0
    assert not any(symbol is Symbol.BACK for _, symbol in helped.said)


def test_a_side_to_which_a_nudge_is_on_its_way_is_not_held() -> None:
    guide, now_ns = StepGuide(CHAIR_A, RiderModel(), DURATIONS), 10_000_000_000
    straight = GuideInputs(now_ns, Pose2(1.0), Twist(0.3, 0.0), holds=True)
    said = GuideState(step=0, phase=LeadingPhase.GO, said=Symbol.NUDGE_LEFT, said_ns=now_ns - 500_000_000)
    quiet, _ = guide.step(corner(), said, straight)
    nudged, _ = guide.step(corner(), replace(said, nudges=(Nudge(0.04, now_ns + 600_000_000),)), straight)
    assert (quiet.hold.left, quiet.hold.right) == (DRIFT, DRIFT)
    assert (nudged.hold.left, nudged.hold.right) == (0.0, DRIFT)


def test_a_turn_is_stopped_at_its_heading_and_not_before() -> None:
    guide, now_ns = StepGuide(CHAIR_A, RiderModel(), DURATIONS), 10_000_000_000
    state = GuideState(
        step=1, phase=LeadingPhase.TURN, heading=math.pi / 2, said=Symbol.SWIVEL_LEFT, said_ns=now_ns - 10**9
    )
    holds = {}
    for theta in (0.3, 1.2, 1.5):
        word, _ = guide.step(corner(), state, GuideInputs(now_ns, Pose2(3.0, 0.0, theta), Twist(0.0, 0.4), holds=True))
        holds[theta] = word.hold.left
    assert holds == {0.3: 0.0, 1.2: 0.0, 1.5: ALL}


def test_a_driver_who_has_not_felt_that_a_leg_ends_is_held_where_the_turn_or_the_arrival_begins() -> None:
    guide, now_ns, plan = StepGuide(CHAIR_A, RiderModel(), DURATIONS), 10_000_000_000, corner()
    turn = next(k for k, step in enumerate(plan.steps) if step.kind is StepKind.PIVOT)
    for index, phase, said in ((turn, LeadingPhase.TURN, Symbol.SWIVEL_LEFT), (-1, LeadingPhase.DONE, Symbol.ARRIVED)):
        step = plan.steps[index]
        state = GuideState(
            step=index % len(plan.steps), phase=phase, heading=step.end.theta, said=said, said_ns=now_ns - 10**9
        )
        fronts = []
        for ahead in (-0.3, -0.05, 0.1):
            pose = step.start @ Pose2(ahead)
            word, _ = guide.step(plan, state, GuideInputs(now_ns, pose, Twist(0.3, 0.0), holds=True))
            fronts.append(word.hold.front)
        assert fronts == [1.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("plan", "degrees", "turns"), [("open", 9.0, False), ("open", 11.0, True), ("door", 9.0, True)]
)
def test_nudges_in_vain_end_in_a_turn_sooner_before_a_door_than_on_an_open_leg(
    plan: str, degrees: float, turns: bool
) -> None:
    assert 9.0 < math.degrees(OPEN_SWIVEL_FROM) < 11.0
    steps = open_leg(4.0) if plan == "open" else through(DoorPassage(Pose2(4.0), 0.9))
    at = next(k for k, each in enumerate(steps.steps) if (each.door is not None) == (plan == "door"))
    begin = steps.steps[at].start
    pose, state = begin @ Pose2(0.3, 0.0, math.radians(-degrees)), GuideState(step=at, nudged=IN_VAIN)
    inputs = GuideInputs(10_000_000_000, pose, Twist(0.2, 0.0), holds=True)
    word, _ = StepGuide(CHAIR_A, RiderModel(), DURATIONS).step(steps, state, inputs)
    assert word.advice is not None
    assert word.advice.symbol is (Symbol.SWIVEL_LEFT if turns else Symbol.NUDGE_LEFT)


@pytest.mark.parametrize(
    ("ahead", "width", "front"), [(-0.3, 1.0, CREEPS), (0.2, 1.0, PER_ROOM * 0.2), (0.2, 0.75, CREEPS)]
)
def test_a_chair_that_is_askew_creeps_before_a_door_and_in_a_tight_one_only(
    ahead: float, width: float, front: float
) -> None:
    plan = through(DoorPassage(Pose2(4.0), width))
    at = next(k for k, step in enumerate(plan.steps) if step.door is not None)
    step = plan.steps[at]
    pose = step.start @ Pose2(before_wall(step, 0.0, CHAIR_A) + ahead, 0.0, math.radians(9.0))
    now = GuideInputs(10_000_000_000, pose, Twist(0.1, 0.0), holds=True)
    hold = stick_hold(plan, GuideState(step=at, phase=LeadingPhase.GO), now, CHAIR_A, 0.0, 10.0)
    assert hold.front == pytest.approx(front)


@pytest.mark.parametrize(
    ("phase", "v", "since_s", "front", "rear"),
    [
        (LeadingPhase.GO, 0.0, -0.5, 1.0, 0.0),
        (LeadingPhase.GO, -0.2, -0.5, 1.0, 1.0),  # the driver still backs, and has not felt yet that it is enough
        (LeadingPhase.GO, -0.2, 0.5, 1.0, 0.0),
        (LeadingPhase.BACK, 0.2, -0.5, 1.0, 1.0),
        (LeadingPhase.BACK, 0.2, 0.5, 0.0, 1.0),
        (LeadingPhase.TURN, 0.0, 0.5, 0.0, 0.0),
    ],
)
def test_the_guard_passes_ahead_and_back_only_what_was_asked_for(
    phase: LeadingPhase, v: float, since_s: float, front: float, rear: float
) -> None:
    state, now = GuideState(0, phase), GuideInputs(10_000_000_000, Pose2(1.0), Twist(v), holds=True)
    hold = stick_hold(open_leg(3.0), state, now, CHAIR_A, 0.0, since_s)
    assert (hold.front, hold.rear) == (front, rear)


def test_a_rider_who_has_a_reason_not_to_follow_may_back_away() -> None:
    guide, state = StepGuide(CHAIR_A, RiderModel(), DURATIONS), GuideState()
    rears = dict[bool, set[float]]()
    for tick in range(1, 400):
        inputs = GuideInputs.under((1.0, 0.0, 1.0, 1.0), -0.25, 0.0, tick * 50_000_000, Pose2(1.0), Twist())
        word, state = guide.step(open_leg(3.0), state, inputs)
        rears.setdefault(tick * 50_000_000 < state.quiet_ns, set()).add(word.hold.rear)
    assert rears == {False: {0.0}, True: {1.0}}


def test_a_driver_who_does_not_turn_the_stick_is_asked_again_and_not_sent_back() -> None:
    guide, state = StepGuide(CHAIR_A, RiderModel(), DURATIONS), GuideState(said=Symbol.FORWARD)
    plan, said = corner(), list[Symbol]()
    pivot = next(k for k, each in enumerate(plan.steps) if each.kind is StepKind.PIVOT)
    state = replace(state, step=pivot, phase=LeadingPhase.TURN, heading=math.pi / 2)
    for tick in range(1, 400):
        inputs = GuideInputs.under((0.0, 0.0, 1.0, 1.0), -0.25, 0.0, tick * 50_000_000, Pose2(3.0), Twist())
        word, state = guide.step(plan, state, inputs)
        said += [] if word.advice is None else [word.advice.symbol]
    assert len(said) > 4
    assert set(said) == {Symbol.SWIVEL_LEFT}


@pytest.mark.parametrize(("holds", "back"), [(True, BACK_FROM_THINGS), (False, BEHIND_START)])
def test_a_driver_is_sent_back_behind_the_start_of_a_leg_only_as_far_as_somebody_looks(
    holds: bool, back: float
) -> None:
    state = GuideState(step=0, said=Symbol.FORWARD, said_ns=0, still_ns=0)
    inputs = GuideInputs(10_000_000_000, Pose2(), Twist(), holds=holds)
    word, state = StepGuide(CHAIR_A, RiderModel(), DURATIONS).step(open_leg(3.0), state, inputs)
    assert word.advice is not None
    assert word.advice.symbol is Symbol.BACK
    assert state.back_until == pytest.approx(-back)


@pytest.mark.parametrize(("forward", "then"), [(0.0, Symbol.FORWARD), (0.3, Symbol.NUDGE_LEFT)])
def test_a_hand_that_holds_a_turn_is_told_to_drive_ahead_and_not_nudged(forward: float, then: Symbol) -> None:
    pose, now_ns = Pose2(1.0, 0.0, math.radians(-9.0)), 6_000_000_000
    state = GuideState(0, LeadingPhase.GO, said=Symbol.FORWARD, said_ns=now_ns - 2_000_000_000)
    inputs = GuideInputs.under((0.6, 0.2, 0.3, 0.0), forward, -0.2, now_ns, pose, Twist())
    assert inputs.held_turn
    word, _ = StepGuide(CHAIR_A, RiderModel(), DURATIONS).step(open_leg(3.0), state, inputs)
    assert word.advice is not None
    assert word.advice.symbol is then


@pytest.mark.parametrize(("off_deg", "then"), [(1.0, Symbol.FORWARD), (-9.0, Symbol.BACK)])
def test_a_driver_who_has_been_straightened_at_last_drives_on_and_one_still_askew_is_sent_back(
    off_deg: float, then: Symbol
) -> None:
    door = DoorPassage(Pose2(4.0, 0.0, 0.0), 0.9)
    plan = through(door)
    at = next(k for k, each in enumerate(plan.steps) if each.door is not None)
    pose = door.map_from_door @ Pose2(0.2, 0.0, math.radians(off_deg))
    state = GuideState(at, LeadingPhase.GO, said=Symbol.NUDGE_LEFT, said_ns=10_000_000_000, still_ns=0)
    inputs = GuideInputs(12_000_000_000, pose, Twist(), holds=True)
    word, _ = StepGuide(CHAIR_A, RiderModel(), DURATIONS).step(plan, state, inputs)
    assert word.advice is not None
    assert word.advice.symbol is then


@pytest.mark.parametrize(("rear", "most"), [(0.0, 1), (0.15, 3)])  # the guard sees what is behind, or nothing does
def test_a_turn_that_is_held_with_no_way_back_asks_for_new_steps(rear: float, most: int) -> None:
    plan, guide, state = corner(), StepGuide(CHAIR_A, RiderModel(), DURATIONS), GuideState()
    state = replace(state, step=next(k for k, each in enumerate(plan.steps) if each.kind is StepKind.PIVOT))
    state = replace(state, phase=LeadingPhase.TURN, heading=math.pi / 2)
    asked = list[Symbol]()
    for tick in range(1, 400):
        back = bool(asked) and asked[-1] is Symbol.BACK
        stick = (-0.2, 0.0) if back else (0.0, 0.2)
        inputs = GuideInputs.under((1.0, rear, 0.0, 0.0), *stick, tick * 50_000_000, Pose2(3.0), Twist())
        word, state = guide.step(plan, state, inputs)
        asked += [] if word.advice is None else [word.advice.symbol]
        if word.astray:
            break
    assert word.reason == "neither the turn nor the way back is free"
    assert tick * TICK_S < 8.0 + 1.5 * (most - 1)
    assert asked[-1] is Symbol.BACK
    assert asked.count(Symbol.BACK) <= most


@pytest.mark.parametrize(("off_deg", "phase"), [(2.0, LeadingPhase.GO), (40.0, LeadingPhase.BACK)])
def test_a_turn_that_the_guard_holds_is_over_at_its_heading_and_stuck_elsewhere(
    off_deg: float, phase: LeadingPhase
) -> None:
    plan, guide = corner(), StepGuide(CHAIR_A, RiderModel(), DURATIONS)
    pivot = next(k for k, each in enumerate(plan.steps) if each.kind is StepKind.PIVOT)
    state = GuideState(pivot, LeadingPhase.TURN, math.pi / 2, said=Symbol.SWIVEL_LEFT, said_ns=0, still_ns=0)
    pose = Pose2(3.0, 0.0, math.pi / 2 - math.radians(off_deg))
    inputs = GuideInputs.under((1.0, 1.0, 0.0, 0.0), 0.0, 0.2, 1_500_000_000, pose, Twist())
    assert inputs.held_turn
    assert guide.step(plan, state, inputs)[1].phase is phase


def test_a_driver_held_by_something_on_an_open_leg_is_not_told_to_push_on_and_gets_new_steps_once_back() -> None:
    plan, guide = open_leg(4.0), StepGuide(CHAIR_A, RiderModel(), DURATIONS)
    state = GuideState(0, LeadingPhase.GO, said=Symbol.FORWARD, said_ns=0, still_ns=0, tries=OPEN_TRIES - 1)
    asked, back_m = list[Symbol](), 0.0
    for tick in range(1, 400):
        back = Symbol.BACK in asked
        back_m += 0.01 if back else 0.0
        stick, twist = ((-0.2, 0.0), Twist(-0.2)) if back else ((0.25, 0.0), Twist())
        inputs = GuideInputs.under((0.0, 1.0, 1.0, 1.0), *stick, tick * 50_000_000, Pose2(1.0 - back_m), twist)
        word, state = guide.step(plan, state, inputs)
        asked += [] if word.advice is None else [word.advice.symbol]
        if word.astray:
            break
    assert word.astray
    assert asked == [Symbol.BACK]
    assert 0.1 < back_m < 0.5


def test_a_driver_held_ahead_and_behind_on_an_open_leg_gets_new_steps_after_two_tries() -> None:
    plan, guide, state = open_leg(4.0), StepGuide(CHAIR_A, RiderModel(), DURATIONS), GuideState()
    asked = list[Symbol]()
    for tick in range(1, 1000):
        stick = (-0.2, 0.0) if asked[-1:] == [Symbol.BACK] else (0.25, 0.0)
        inputs = GuideInputs.under((0.0, 0.0, 1.0, 1.0), *stick, tick * 50_000_000, Pose2(1.0), Twist())
        word, state = guide.step(plan, state, inputs)
        asked += [] if word.advice is None else [word.advice.symbol]
        if word.astray:
            break
    assert word.astray
    assert tick * TICK_S < 35.0
    assert asked == [Symbol.FORWARD, *[Symbol.BACK, Symbol.FORWARD] * OPEN_TRIES]


def _held_ahead_until(plan: StepPlan, driven_m: float) -> float:
    """Return the time [s] after which a driver whom the guard holds from a place on is sent back; inf if never."""
    guide, driver, state = (
        StepGuide(CHAIR_A, RiderModel(), DURATIONS),
        PlainDriver(HERE, RiderModel()),
        GuideState(),
    )
    held_s = 0.0
    for tick in range(1, 600):
        held = driver.pose.x >= driven_m
        held_s += TICK_S if held else 0.0
        inputs = GuideInputs(tick * 50_000_000, driver.pose, driver.twist, held_ahead=held, holds=True)
        guidance, state = guide.step(plan, state, inputs)
        if state.phase is LeadingPhase.BACK:
            return held_s
        if guidance.advice is not None:
            driver.hear(guidance.advice.symbol, tick * TICK_S)
        driver.step(tick * TICK_S, StickHold(front=0.0) if held else guidance.hold)
    return math.inf


def test_somebody_who_walks_by_has_time_to_pass_before_a_driver_on_an_open_leg_is_sent_back() -> None:
    assert 4.0 < _held_ahead_until(open_leg(4.0), 1.0) < 8.0


@pytest.mark.parametrize(("offset", "phase"), [(0.0, LeadingPhase.GO), (0.3, LeadingPhase.BACK)])
def test_a_driver_held_before_a_door_waits_with_a_good_aim_and_is_sent_back_from_a_jamb(
    offset: float, phase: LeadingPhase
) -> None:
    plan, guide = through(DoorPassage(Pose2(3.0, 0.0), 0.9)), StepGuide(CHAIR_A, RiderModel(), DURATIONS)
    at = next(k for k, each in enumerate(plan.steps) if each.door is not None)
    state = GuideState(at, LeadingPhase.GO, said=Symbol.FORWARD, said_ns=0, still_ns=0, aim=Aim(offset, 0.0, 200))
    inputs = GuideInputs.under((0.0, 1.0, 1.0, 1.0), 0.25, 0.0, 2_500_000_000, plan.steps[at].start, Twist())
    assert inputs.held_ahead
    assert guide.step(plan, state, inputs)[1].phase is phase


def _asked_under(
    plan: StepPlan,
    state: GuideState,
    own_caps: tuple[float, float, float, float],
    stick: tuple[float, float],
    seconds: float,
) -> tuple[list[Symbol], GuideWord]:
    """Return what a driver who stands is asked for, whose stick the guard holds by itself as well, and the last word."""
    guide, asked = StepGuide(CHAIR_A, RiderModel(), DURATIONS), list[Symbol]()
    for tick in range(1, round(seconds / TICK_S)):
        now_ns, held = tick * 50_000_000, (0.0, 0.0, *own_caps[2:])
        inputs = GuideInputs.under(held, *stick, now_ns, plan.steps[state.step].start, Twist(), own_caps)
        word, state = guide.step(plan, state, inputs)
        asked += [] if word.advice is None else [word.advice.symbol]
        if word.astray:
            break
    return asked, word


@pytest.mark.parametrize(("rear", "asked_back"), [(0.0, False), (0.11, False), (0.17, True)])
def test_nobody_is_asked_back_where_the_guard_lets_hardly_anything_pass(rear: float, asked_back: bool) -> None:
    plan = corner()
    pivot = next(k for k, each in enumerate(plan.steps) if each.kind is StepKind.PIVOT)
    state = GuideState(pivot, LeadingPhase.TURN, math.pi / 2, said=Symbol.SWIVEL_LEFT, said_ns=0)
    asked, last = _asked_under(plan, state, (1.0, rear, 0.0, 0.0), (0.0, 0.2), 12.0)
    assert (Symbol.BACK in asked) is asked_back
    assert last.reason == "neither the turn nor the way back is free"


def test_nobody_who_stands_is_sent_ahead_where_the_guard_lets_nothing_pass_but_back_after_a_while() -> None:
    state, rest = GuideState(0, LeadingPhase.GO, said=Symbol.NUDGE_LEFT, said_ns=0), (0.0, 0.0)
    first = {
        (front, seconds): _asked_under(open_leg(3.0), state, (front, 1.0, 1.0, 1.0), rest, seconds)[0][:1]
        for front in (0.0, 0.2)
        for seconds in (5.0, 7.5)
    }
    assert (first[0.2, 5.0], first[0.0, 5.0], first[0.0, 7.5]) == ([Symbol.FORWARD], [], [Symbol.BACK])


def test_a_way_back_that_the_guard_ends_is_over() -> None:
    plan, guide, now_ns = open_leg(3.0), StepGuide(CHAIR_A, RiderModel(), DURATIONS), 10_000_000_000
    state = GuideState(0, LeadingPhase.BACK, back_until=0.5, said=Symbol.BACK, said_ns=now_ns - 4_000_000_000)
    phases = []
    for rear in (0.17, 0.12):
        own_caps = (1.0, rear, 1.0, 1.0)
        inputs = GuideInputs.under(own_caps, -0.25, 0.0, now_ns, Pose2(0.8), Twist(-0.08), own_caps)
        word, after = guide.step(plan, state, inputs)
        assert word.advice is not None
        phases.append((after.phase, word.advice.symbol))
    assert phases == [(LeadingPhase.BACK, Symbol.BACK), (LeadingPhase.GO, Symbol.FORWARD)]


@pytest.mark.parametrize(("theta", "omega", "phase"), [(1.2, -0.4, LeadingPhase.TURN), (2.0, 0.4, LeadingPhase.GO)])
def test_a_turn_to_the_other_side_has_not_passed_its_heading(theta: float, omega: float, phase: LeadingPhase) -> None:
    plan, now_ns = corner(), 10_000_000_000
    pivot = next(k for k, each in enumerate(plan.steps) if each.kind is StepKind.PIVOT)
    state = GuideState(pivot, LeadingPhase.TURN, math.pi / 2, said=Symbol.SWIVEL_LEFT, said_ns=now_ns - 900_000_000)
    inputs = GuideInputs.under((0.0, 0.0, 1.0, 1.0), 0.0, 0.2, now_ns, Pose2(3.0, 0.0, theta), Twist(0.0, omega))
    word, after = StepGuide(CHAIR_A, RiderModel(), DURATIONS).step(plan, state, inputs)
    assert after.phase is phase
    assert word.advice is None or word.advice.symbol is Symbol.FORWARD


@pytest.mark.parametrize(("omega", "asked"), [(0.1, None), (0.4, Symbol.BACK)])
def test_a_slow_swing_does_not_open_the_way_back_and_a_turn_is_ended_by_asking_back(
    omega: float, asked: Symbol | None
) -> None:
    now_ns, own_caps = 10_000_000_000, (1.0, 0.0, 1.0, 1.0)
    state = GuideState(0, LeadingPhase.BACK, back_until=0.5, said=Symbol.SWIVEL_LEFT, said_ns=now_ns - 2_000_000_000)
    inputs = GuideInputs.under(own_caps, 0.0, 0.2, now_ns, Pose2(0.8), Twist(0.0, omega), own_caps)
    word, _ = StepGuide(CHAIR_A, RiderModel(), DURATIONS).step(open_leg(3.0), state, inputs)
    assert (None if word.advice is None else word.advice.symbol) is asked
