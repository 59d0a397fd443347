"""How the guard holds the stick of a driver who is led: what leads off the heading that was asked for is not passed on.

A hand that does not see where straight ahead is drifts, and a nudge may turn the chair less than the drift does until the next
one. The guard clamps only: it stops a turn, and never makes one. A turn that the rider means passes while the chair drives. A push
ahead or back that was not asked for moves nothing: a symbol was taken for another, or a hand drifts that turns on the spot, and
nobody sees behind the chair. The rider's override lets all through.
"""

from __future__ import annotations

from waychair.calibration.chair_body import ChairBody
from waychair.control.haptics.course import before_wall, course_error, on_leg
from waychair.control.haptics.guide_numbers import (
    ALL,
    CREEPS,
    DRIFT,
    HELD_FROM,
    HOLDS_S,
    LEAST_ERROR,
    OBEYED_S,
    PASSED,
    PER_ROOM,
    SLOW,
    SLOW_BEFORE,
    SLOWEST,
    STILL_V,
    STRAIGHT_ENOUGH,
    SWIVELS,
    TIGHT,
)
from waychair.control.haptics.guide_types import GuideInputs, GuideState, LeadingPhase, StickHold
from waychair.control.haptics.symbols import Symbol
from waychair.geometry import wrap_angle
from waychair.planning.steps.step import StepKind, StepPlan


def stick_hold(
    plan: StepPlan, state: GuideState, now: GuideInputs, body: ChairBody, veer: float, since_obeyed_s: float
) -> StickHold:
    """Return how the stick is best held. `since_obeyed_s`: since the last symbol should have been obeyed, negative before."""
    front, rear = _asked(state, now, since_obeyed_s > 0.0)
    front, obeys = min(front, _front(plan, state, now, body, veer)), since_obeyed_s < OBEYED_S
    error = _error(plan, state, now, body, veer, obeys)
    if error is None:
        return StickHold(front, rear=rear)
    held = ALL if (state.phase is LeadingPhase.TURN or obeys) and abs(now.twist.v) < STILL_V else DRIFT
    nudged_left, nudged_right = (any(side * each.turn > 0.0 for each in state.nudges) for side in (1.0, -1.0))
    return StickHold(
        front,
        left=held if error < HELD_FROM and not nudged_left else 0.0,
        right=held if error > -HELD_FROM and not nudged_right else 0.0,
        rear=rear,
    )


def _asked(state: GuideState, now: GuideInputs, obeyed: bool) -> tuple[float, float]:
    """Return the caps ahead and back: 1 where driving so was asked for, and until a symbol is `obeyed` what is still done, else 0.

    Back is free while the guide is silent before a rider who does not follow.
    """
    if state.phase is LeadingPhase.DONE:
        return 1.0, 1.0
    ahead = state.phase is LeadingPhase.GO or (not obeyed and now.twist.v > STILL_V)
    back = state.phase is LeadingPhase.BACK or (not obeyed and now.twist.v < -STILL_V)
    return float(ahead), float(back or now.now_ns < state.quiet_ns)


def _error(
    plan: StepPlan, state: GuideState, now: GuideInputs, body: ChairBody, veer: float, obeys: bool
) -> float | None:
    """Return the error of the heading asked for [rad, left positive] when a stick that is held now takes effect, if any.

    `obeys`: the last symbol may still be on its way to the hand.
    """
    if state.phase is LeadingPhase.TURN:
        return _turn_error(state, now)
    if state.phase is LeadingPhase.BACK:
        return 0.0 if obeys or now.twist.v < -STILL_V else None  # straight back
    return None if state.phase is LeadingPhase.DONE else course_error(plan.steps[state.step], now, body, veer)


def _turn_error(state: GuideState, now: GuideInputs) -> float | None:
    """Return the error of a turn on the spot that has come far enough; a turn to the wrong side, or about, goes on: a driver
    whose stick does nothing would not feel what is wrong."""
    if state.said not in SWIVELS:
        return None
    error = wrap_angle(state.heading - now.pose.theta - now.twist.omega * HOLDS_S)
    left = error if state.said is Symbol.SWIVEL_LEFT else -error
    return error if -PASSED < left < HELD_FROM else None


def _front(plan: StepPlan, state: GuideState, now: GuideInputs, body: ChairBody, veer: float) -> float:
    """Return the cap ahead. A driver who has not felt that a leg ends is held where a turn on the spot or the arrival begins.

    It is less at a door that is near, in its own step or in the last part of the leg to its pivotal point: in its step the less
    the farther the chair is off its course.
    """
    step = plan.steps[state.step]
    along, _, _ = on_leg(step, now.pose)
    ends = step.kind in (StepKind.PIVOT, StepKind.ARRIVED) and state.phase is not LeadingPhase.BACK
    if ends and along + max(now.twist.v, 0.0) * HOLDS_S > 0.0:
        return 0.0
    following = plan.steps[state.step + 1 : state.step + 3]
    near = step.kind is StepKind.PIVOT or step.length - along < SLOW_BEFORE
    doors = [each for each in (step, *(following if near else ())) if each.door is not None]
    if not doors:
        return 1.0
    room = min(door.room for door in doors)
    cap = min(max(PER_ROOM * room, SLOWEST if doors[0] is step else SLOW), 1.0)
    if doors[0] is not step or state.phase is LeadingPhase.BACK:
        return cap
    if state.phase is LeadingPhase.TURN:
        return 0.0  # nearer to the door there would be less room to turn
    if room > TIGHT and before_wall(step, along, body) < 0.0:
        return cap  # the front is in a door that is wide enough for what is left of its error
    off = (abs(course_error(step, now, body, veer)) - LEAST_ERROR) / (STRAIGHT_ENOUGH - LEAST_ERROR)
    return cap + min(max(off, 0.0), 1.0) * (CREEPS - cap)
