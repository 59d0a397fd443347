"""Guidance of a driver by symbols along steps: when to say what, so that it is obeyed in the right place. A pure step.

A symbol is obeyed about a second after it is sent. So the guide sends each one as much ahead as this rider is late
(pattern and lag), by the present rates. It corrects a drive by short nudges rather than held turns, and counts those that
are on their way before it sends another. Before a door there is a gate: if the chair would not pass, the driver backs off
and tries again. The chair's poses come from a localiser on the map, or from odometry for a door that was just found;
`StepPlan` and poses are in one frame.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from waychair.calibration.chair_body import ChairBody
from waychair.control.haptics.course import (
    aims_well,
    before_wall,
    course_error,
    front_at_door,
    is_hopeless,
    may_swivel,
    off_aim,
    on_leg,
    tolerated_error,
    veered,
)
from waychair.control.haptics.guide_numbers import (
    ABOUT,
    AIM_PART,
    AIM_TICKS,
    ASTRAY,
    ASTRAY_AT_GOAL,
    BACK_FROM_THINGS,
    BACK_OFF,
    BEHIND_START,
    EARLY_S,
    FAR_OFF,
    GAP_S,
    GATE_FROM,
    GATE_TO,
    IGNORED,
    IN_VAIN,
    IN_VAIN_FROM,
    KEEPS_WAITING_S,
    MISSED,
    MOST_TRIES,
    NEAR_END,
    NUDGED_S,
    NUDGES,
    NUDGING_S,
    OBEYED_S,
    OPEN_SWIVEL_FROM,
    OPEN_TRIES,
    PASSED,
    QUIET_S,
    REPEAT_S,
    SETTLES_S,
    SHORT_SWIVEL,
    SHORTEST_SWIVEL_S,
    SHUFFLE,
    SPEEDS_UP_S,
    STILL_OMEGA,
    STILL_V,
    STOPPED_S,
    STOPPED_SWIVEL_FROM,
    STOPS_SHORT,
    STRAIGHT_ENOUGH,
    STRAIGHTENS_S,
    STUCK_S,
    SWIVEL_FROM,
    SWIVELLING,
    SWIVELS,
    VALID_NS,
)
from waychair.control.haptics.guide_types import Aim, GuideInputs, GuideState, GuideWord, LeadingPhase, Nudge, StickHold
from waychair.control.haptics.held_stick import stick_hold
from waychair.control.haptics.rider import RiderModel
from waychair.control.haptics.symbols import Advice, Symbol
from waychair.geometry import wrap_angle
from waychair.planning.steps.door_steps import HALF_WALL
from waychair.planning.steps.step import Step, StepKind, StepPlan
from waychair.types import Pose2


@dataclass(frozen=True, slots=True)
class StepGuide:
    """The guide of one rider on one chair; `durations` [s] of the patterns. What it remembers is passed in and returned."""

    body: ChairBody
    rider: RiderModel
    durations: Mapping[Symbol, float] = field(default_factory=dict)

    def lead(self, symbol: Symbol) -> float:
        """Return the time [s] from sending a symbol until the chair obeys."""
        return self.durations.get(symbol, 0.45) + self.rider.lag_s

    def step(self, plan: StepPlan, state: GuideState, now: GuideInputs) -> tuple[GuideWord, GuideState]:
        """Return the guidance of a tick and the next memory."""
        state = replace(state, nudges=tuple(each for each in state.nudges if each.done_ns > now.now_ns))
        if state.step < 0:
            state = self._begin(plan, 0, state, now)
        return _Tick(self, plan, now).run(state)

    def _begin(self, plan: StepPlan, index: int, state: GuideState, now: GuideInputs) -> GuideState:
        """Return the state at the beginning of a step of the plan."""
        step = plan.steps[index]
        fresh = replace(state, step=index, tries=0, shuffles=0, still_ns=None, aim=None)
        if step.kind is StepKind.PIVOT:
            onto = plan.steps[index + 1]
            leads = onto.kind in (StepKind.STRAIGHT, StepKind.DOOR)
            against = off_aim(onto, Pose2(), self.body, self.rider.veer_per_m) if leads else 0.0
            return replace(fresh, phase=LeadingPhase.TURN, heading=wrap_angle(step.end.theta + against))
        if step.kind is StepKind.BACK:
            return replace(fresh, phase=LeadingPhase.BACK, back_until=-step.length)
        if step.kind is StepKind.ARRIVED:
            return replace(fresh, phase=LeadingPhase.DONE)
        return replace(fresh, phase=LeadingPhase.GO)


OPEN = StickHold()
"""A word's hold of the stick until the tick's own is known."""

_SIDE: Mapping[Symbol | None, float] = {Symbol.SWIVEL_LEFT: 1.0, Symbol.SWIVEL_RIGHT: -1.0}
"""The side to which a swivel turns; one that was said keeps its side where either way round is about as long."""


class _Tick:
    """One tick of the guide."""

    def __init__(self, guide: StepGuide, plan: StepPlan, now: GuideInputs) -> None:
        self.guide, self.plan, self.now = guide, plan, now
        self._may_turn = True  # at most one change from turning to driving and back in a tick

    def run(self, state: GuideState) -> tuple[GuideWord, GuideState]:
        """Return guidance and memory."""
        guidance, after = self._phase(state)
        since_s, veer = self._since_obeyed(after), self.guide.rider.veer_per_m
        hold = stick_hold(self.plan, after, self.now, self.guide.body, veer, since_s)
        return replace(guidance, hold=hold), after

    def _phase(self, state: GuideState) -> tuple[GuideWord, GuideState]:
        if state.phase is LeadingPhase.DONE:
            return self._done(state)
        if state.phase is LeadingPhase.TURN:
            return self._turn(state)
        if state.phase is LeadingPhase.BACK:
            return self._back(state)
        return self._go(state)

    # saying -----------------------------------------------------------------------------------------------------------

    def _free(self, state: GuideState) -> bool:
        """Return whether a pattern may begin now."""
        if self.now.now_ns < state.quiet_ns:
            return False
        lasts = 0.0 if state.said is None else self.guide.durations.get(state.said, 0.45) + GAP_S
        return self.now.now_ns >= state.said_ns + round(lasts * 1e9)

    def _say(self, symbol: Symbol, reason: str, state: GuideState, **flags: bool) -> tuple[GuideWord, GuideState]:
        """Say a symbol now if the channel is free."""
        step = self.plan.steps[state.step]
        if not self._free(state):
            return GuideWord(None, step, reason, OPEN, **flags), state
        number, now_ns = state.number + 1, self.now.now_ns
        after = replace(state, number=number, said=symbol, said_ns=now_ns)
        if symbol in (Symbol.NUDGE_LEFT, Symbol.NUDGE_RIGHT):
            turn = self.guide.rider.nudge if symbol is Symbol.NUDGE_LEFT else -self.guide.rider.nudge
            done_ns = now_ns + round((self.guide.lead(symbol) + NUDGED_S) * 1e9)
            nudged = 1 if turn > 0.0 else -1
            nudged += state.nudged if state.nudged * nudged > 0 else 0
            after = replace(after, nudges=(*after.nudges, Nudge(turn, done_ns)), nudged=nudged)
        elif symbol is not Symbol.FORWARD:
            after = replace(after, nudged=0)
        return GuideWord(Advice(symbol, number, now_ns + VALID_NS, reason=reason), step, reason, OPEN, **flags), after

    def _quiet(self, reason: str, state: GuideState, **flags: bool) -> tuple[GuideWord, GuideState]:
        return GuideWord(None, self.plan.steps[state.step], reason, OPEN, **flags), state

    def _since_obeyed(self, state: GuideState) -> float:
        """Return the time [s] since the last symbol should have been obeyed; negative before."""
        if state.said is None:
            return math.inf
        return (self.now.now_ns - state.said_ns) * 1e-9 - self.guide.lead(state.said)

    def _ask_again(self, symbol: Symbol, reason: str, state: GuideState, **flags: bool) -> tuple[GuideWord, GuideState]:
        """Say a symbol that has had no effect again, or fall silent after some."""
        if not self._free(state) or self._since_obeyed(state) < OBEYED_S:
            return self._quiet(reason, state, **flags)
        if state.ignored >= IGNORED:
            quiet_ns = self.now.now_ns + round(QUIET_S * 1e9)
            state = replace(state, ignored=0, quiet_ns=quiet_ns)
            return self._quiet("the rider does not follow", state, offers_repeat=True, **flags)
        return self._say(symbol, reason, replace(state, ignored=state.ignored + 1), **flags)

    # phases -----------------------------------------------------------------------------------------------------------

    def _done(self, state: GuideState) -> tuple[GuideWord, GuideState]:
        step = self.plan.steps[state.step]
        moves = abs(self.now.twist.v) > STILL_V or abs(self.now.twist.omega) > STILL_OMEGA
        if state.said is not Symbol.ARRIVED or (moves and self._since_obeyed(state) > OBEYED_S):
            return self._say(Symbol.ARRIVED, "arrived", state)
        stands = not moves and self._since_obeyed(state) > 0.0
        if stands and math.hypot(step.end.x - self.now.pose.x, step.end.y - self.now.pose.y) > MISSED:
            return self._quiet("beside the place", state, astray=True)
        return GuideWord(None, step, "arrived", arrived=stands), state

    def _next(self, state: GuideState) -> tuple[GuideWord, GuideState]:
        """Go on to the next step."""
        return self._phase(self.guide._begin(self.plan, state.step + 1, state, self.now))

    def _turn(self, state: GuideState) -> tuple[GuideWord, GuideState]:
        omega, error = self.now.twist.omega, wrap_angle(state.heading - self.now.pose.theta)
        side = _SIDE.get(state.said, self.plan.steps[state.step].turn)
        if abs(error) > ABOUT and error * side < 0.0:
            error += math.copysign(math.tau, side)
        after = self._after_turn(state)
        swivel = Symbol.SWIVEL_LEFT if error > 0.0 else Symbol.SWIVEL_RIGHT
        left, turns = abs(error), abs(omega) > STILL_OMEGA
        reason = f"turn {'left' if error > 0.0 else 'right'}, {math.degrees(left):.0f} degrees more"
        if state.said not in SWIVELS:
            if left < self._swivel_from(state) and (not turns or omega * error > 0.0):
                return self._leave_turn(state)
            return self._say(swivel, reason, replace(state, still_ns=None))
        state = self._watched(state, turns)
        if turns and self._since_obeyed(state) > -EARLY_S:
            if omega * error > 0.0:
                ahead_s = self.guide.lead(after) - (STOPPED_S if self.now.holds else 0.0)
                if left <= self._rate(state) * ahead_s + STOPS_SHORT:
                    return self._leave_turn(state)
                goes_on = left > self._rate(state) * (self.guide.lead(after) + KEEPS_WAITING_S)
                if goes_on and self._silent_s(state) > REPEAT_S:
                    return self._say(swivel, reason, replace(state, ignored=0))
                return self._quiet(reason, replace(state, ignored=0))
            if left < PASSED and omega * side > 0.0:  # a turn to the other side has not been obeyed yet
                return self._leave_turn(state)
        over = self.now.held_turn or self._since_obeyed(state) > OBEYED_S  # the guard holds what has come far enough
        if not turns and left < self._swivel_from(state) and over:
            return self._leave_turn(state)
        if self.now.pushes_aside and self._stood(state, swivel) > (0.0 if self.now.held_turn else STUCK_S):
            return self._shuffle(state)
        return self._ask_again(swivel, reason, state)

    def _swivel_from(self, state: GuideState) -> float:
        if self.now.holds:
            step = self.plan.steps[state.step]
            if step.kind is not StepKind.PIVOT and step.door is None:
                return OPEN_SWIVEL_FROM
            return STOPPED_SWIVEL_FROM if abs(state.nudged) < IN_VAIN else IN_VAIN_FROM
        return max(SWIVEL_FROM, SHORT_SWIVEL * self.guide.rider.swivel * SHORTEST_SWIVEL_S)

    def _rate(self, state: GuideState) -> float:
        """Return the rate of a turn on the spot [rad/s], which a turn that just began still reaches."""
        measured = abs(self.now.twist.omega)
        return max(measured, self.guide.rider.swivel) if self._since_obeyed(state) < SPEEDS_UP_S else measured

    def _watched(self, state: GuideState, moves: bool) -> GuideState:
        """Return the state with the time since when the chair has not moved as it should."""
        if moves:
            return replace(state, still_ns=None)
        return state if state.still_ns is not None else replace(state, still_ns=self.now.now_ns)

    def _after_turn(self, state: GuideState) -> Symbol:
        """Return the symbol that ends a turn."""
        step = self.plan.steps[state.step]
        following = self.plan.steps[state.step + 1] if step.kind is StepKind.PIVOT else step
        if following.kind is StepKind.ARRIVED:
            return Symbol.ARRIVED
        return Symbol.BACK if following.kind is StepKind.BACK else Symbol.FORWARD

    def _leave_turn(self, state: GuideState) -> tuple[GuideWord, GuideState]:
        self._may_turn = False
        step = self.plan.steps[state.step]
        if step.kind is StepKind.PIVOT:
            return self._next(state)
        return self._go(replace(state, phase=LeadingPhase.GO, still_ns=None))

    def _shuffle(self, state: GuideState) -> tuple[GuideWord, GuideState]:
        """The chair cannot turn on: a little back, and if that is not free either new steps are wanted."""
        if state.shuffles >= MOST_TRIES:
            return self._quiet("the turn is blocked", state, astray=True, blocked=True)
        state = replace(state, shuffles=state.shuffles + 1)
        along, _, _ = on_leg(self._leg(state), self.now.pose)
        return self._back(replace(state, phase=LeadingPhase.BACK, back_until=along - SHUFFLE, still_ns=None))

    def _leg(self, state: GuideState) -> Step:
        """Return the present leg; in a pivot, a leg of no length that looks ahead."""
        step = self.plan.steps[state.step]
        if step.kind is not StepKind.PIVOT:
            return step
        return replace(step, start=Pose2(step.start.x, step.start.y, self.now.pose.theta))

    def _back(self, state: GuideState) -> tuple[GuideWord, GuideState]:
        v, leg = self.now.twist.v, self._leg(state)
        along, _, _ = on_leg(leg, self.now.pose)
        left = along - state.back_until
        following = self._after_back(state)
        backs = v < -STILL_V
        shut = self.now.shut_back and not backs and abs(self.now.twist.omega) < SWIVELLING  # a push would move nothing
        if state.said is Symbol.BACK or shut:
            state = self._watched(state, backs)
        held = state.said is Symbol.BACK and self.now.held_back and self._since_obeyed(state) > OBEYED_S
        if not backs and (held or self._stood(state, Symbol.BACK) > (0.0 if shut else STUCK_S)):
            if self.plan.steps[state.step].kind is StepKind.PIVOT:
                return self._quiet("neither the turn nor the way back is free", state, astray=True, blocked=True)
            return self._leave_back(state)
        if left <= max(-v, 0.0) * self.guide.lead(following) or (backs and self.now.shut_back):
            if state.tries >= OPEN_TRIES and leg.door is None:  # the same leg would end before the same thing
                return self._quiet("something is in the way", state, astray=True, blocked=True)
            return self._leave_back(state)
        reason = f"back, {max(left, 0.0):.1f} m more"
        if shut:
            return self._quiet(reason, state)
        if state.said is Symbol.BACK or (state.said in NUDGES and backs):
            if backs:
                if self._silent_s(state) > REPEAT_S:
                    return self._say(Symbol.BACK, reason, replace(state, ignored=0))
                return self._quiet(reason, replace(state, ignored=0))
            return self._ask_again(Symbol.BACK, reason, state)
        return self._say(Symbol.BACK, reason, state)

    def _after_back(self, state: GuideState) -> Symbol:
        return self._following(state) if self.plan.steps[state.step].kind is StepKind.BACK else Symbol.FORWARD

    def _leave_back(self, state: GuideState) -> tuple[GuideWord, GuideState]:
        step = self.plan.steps[state.step]
        if step.kind is StepKind.BACK:
            return self._next(state)
        if step.kind is StepKind.PIVOT:
            return self._turn(replace(state, phase=LeadingPhase.TURN, said=None, still_ns=None))
        return self._go(replace(state, phase=LeadingPhase.GO, still_ns=None))

    def _silent_s(self, state: GuideState) -> float:
        return (self.now.now_ns - state.said_ns) * 1e-9

    def _go(self, state: GuideState) -> tuple[GuideWord, GuideState]:
        step, v = self.plan.steps[state.step], self.now.twist.v
        along, aside, _ = on_leg(step, self.now.pose)
        drives = v > STILL_V
        following = self._following(state)
        ends = step.length - along
        if ends <= (max(v, 0.0) * self.guide.lead(following) if following is not Symbol.FORWARD else 0.0) + NEAR_END:
            return self._next(state)
        if abs(aside) > (ASTRAY_AT_GOAL if following is Symbol.ARRIVED else ASTRAY) or along < -2.0 * ASTRAY:
            return self._quiet("off the way", state, astray=True)
        ahead_s = self.guide.lead(Symbol.NUDGE_LEFT)
        error, course = self._error(step, state, ahead_s)
        if step.door is not None and abs(self.now.twist.omega) < SWIVELLING:
            if not drives and is_hopeless(step, along, aside, self.guide.body):
                return self._quiet("too far beside the door's axis", state, astray=True)
            state = self._aimed(step, state, course)
            refused = self._gate(step, state, course)
            if refused:
                return refused
        reason = f"straight, {max(ends, 0.0):.1f} m more"
        pending = state.said is Symbol.FORWARD and self._since_obeyed(state) < SETTLES_S
        if pending and abs(self.now.twist.omega) > SWIVELLING:
            return self._quiet(reason, state)
        if state.said in SWIVELS:
            return self._say(Symbol.FORWARD, reason, state)  # a hand that still turns must not be nudged
        present = course_error(step, self.now, self.guide.body, self.guide.rider.veer_per_m)
        if present * state.nudged <= 0.0:
            state = replace(state, nudged=0)
        in_vain = self.now.holds and abs(state.nudged) >= IN_VAIN
        if in_vain:
            error = present  # nudges on their way will not do either
        far_off = abs(error) > self._swivel_from(state) * (FAR_OFF if state.nudges and not in_vain else 1.0)
        if self._may_turn and far_off and may_swivel(step, along, self.guide.body):
            heading = wrap_angle(self.now.pose.theta + error)
            return self._turn(replace(state, phase=LeadingPhase.TURN, heading=heading, still_ns=None))
        if drives:
            state = replace(state, ignored=0, still_ns=None)
        limit = tolerated_error(self.guide.rider, max(v, 0.0), error)
        side = Symbol.NUDGE_LEFT if error > 0.0 else Symbol.NUDGE_RIGHT
        if not drives:
            return self._from_rest(state, error, side, reason)
        if abs(self.now.twist.omega) > SWIVELLING:
            return self._ask_again(Symbol.FORWARD, reason, state)
        ends_soon = following is not Symbol.FORWARD and ends < v * (self.guide.lead(following) + KEEPS_WAITING_S)
        if abs(error) > limit and not ends_soon:
            return self._say(side, f"{reason}, {abs(math.degrees(error)):.0f} degrees off", state)
        if self._silent_s(state) > REPEAT_S and not ends_soon:
            return self._say(Symbol.FORWARD, reason, state)
        return self._quiet(reason, state)

    def _from_rest(self, state: GuideState, error: float, side: Symbol, reason: str) -> tuple[GuideWord, GuideState]:
        """The chair does not drive ahead yet: straighten it, send it ahead, or notice that something is in the way."""
        now, state = self.now, self._watched(state, moves=False)
        sent = state.said is Symbol.FORWARD
        pending = sent and self._since_obeyed(state) < OBEYED_S
        stood = self._stood(state, Symbol.FORWARD)
        askew = abs(error) > STRAIGHT_ENOUGH
        step = self.plan.steps[state.step]
        along, _, _ = on_leg(step, now.pose)
        at_jamb = step.door is not None and not (state.aim and aims_well(step, state.aim, self.guide.body))
        shut = now.shut_ahead and stood > 0.0
        held = (now.held_ahead or shut) and at_jamb  # elsewhere somebody may walk by
        pushes = sent and now.pushes_ahead
        if not pending and ((held and (sent or shut)) or ((pushes or shut) and stood > 2.0 * STUCK_S)):
            return self._retry(state, "something is in the way")
        if askew and (stood > STRAIGHTENS_S or (not pending and front_at_door(step, along, self.guide.body))):
            return self._retry(state, "the chair cannot be straightened here")
        if pending or state.nudges:
            return self._quiet(reason, state)
        if sent and now.held_ahead:
            return self._quiet("something is in the way", state)  # the driver obeys already
        if askew and abs(now.twist.omega) < STILL_OMEGA and now.twist.v > -STILL_V and not now.held_swivel:
            return self._say(side, f"straighten, {abs(math.degrees(error)):.0f} degrees off", state)
        if now.shut_ahead:
            return self._quiet("something is in the way", state)  # a push would move nothing
        if sent or now.held_swivel:  # nudges do nothing to a hand that holds a turn
            return self._ask_again(Symbol.FORWARD, reason, state)
        return self._say(Symbol.FORWARD, reason, state)

    def _stood(self, state: GuideState, symbol: Symbol) -> float:
        """Return for how long [s] the chair has not moved although it could have obeyed a symbol."""
        return 0.0 if state.still_ns is None else (self.now.now_ns - state.still_ns) * 1e-9 - self.guide.lead(symbol)

    def _following(self, state: GuideState) -> Symbol:
        following = self.plan.steps[state.step + 1]
        if following.kind is StepKind.PIVOT:
            return Symbol.SWIVEL_LEFT
        if following.kind is StepKind.ARRIVED:
            return Symbol.ARRIVED
        return Symbol.BACK if following.kind is StepKind.BACK else Symbol.FORWARD

    def _error(self, step: Step, state: GuideState, ahead_s: float) -> tuple[float, Pose2]:
        """Return the error of the course [rad, left positive] when the next nudge acts, and the pose on the leg then."""
        now, rider = self.now, self.guide.rider
        along, aside, turned = on_leg(step, self.now.pose)
        on_way = sum(each.turn * min(1.0, (each.done_ns - now.now_ns) * 1e-9 / NUDGING_S) for each in state.nudges)
        drives = now.twist.v > STILL_V
        way = now.twist.v * ahead_s
        heading = turned + on_way + (rider.veer_per_m * way if drives else 0.0) + self._still_to_turn(state)
        there = Pose2(along + way, aside + way * math.sin(turned + 0.5 * (heading - turned)), heading)
        return off_aim(step, there, self.guide.body, rider.veer_per_m), there

    def _still_to_turn(self, state: GuideState) -> float:
        """Return how far [rad] a turn on the spot still goes on until the symbol that ends it is obeyed."""
        omega = self.now.twist.omega
        if abs(omega) < STILL_OMEGA or state.said in NUDGES:
            return 0.0
        left_s = self.guide.lead(Symbol.FORWARD) if state.said in SWIVELS else -self._since_obeyed(state)
        rate = self._rate(state) if state.said in SWIVELS else abs(omega)
        turn = math.copysign(rate, omega) * max(left_s, 0.0)
        if not self.now.holds:
            return turn
        to_heading = wrap_angle(state.heading - self.now.pose.theta)  # where the guard stops it
        return min(max(turn, min(to_heading, 0.0)), max(to_heading, 0.0))

    def _gate(self, step: Step, state: GuideState, course: Pose2) -> tuple[GuideWord, GuideState] | None:
        """Refuse the door if the chair, as it will be when it can obey, would not pass it; None while it may go on."""
        along, _, _ = on_leg(step, self.now.pose)
        before, then = before_wall(step, along, self.guide.body), before_wall(step, course.x, self.guide.body)
        if not (then <= GATE_FROM and before >= GATE_TO) or (state.nudges and before > GATE_FROM):
            return None  # a nudge on its way still changes the aim
        if state.aim is None or state.aim.ticks < AIM_TICKS:
            return None
        if aims_well(step, state.aim, self.guide.body):
            return None
        offset, turned = state.aim.offset, state.aim.turned
        off = f"{abs(100.0 * offset):.0f} cm and {abs(math.degrees(turned)):.0f} degrees off the door"
        return self._retry(state, off)

    def _aimed(self, step: Step, state: GuideState, course: Pose2) -> GuideState:
        """Return the state with the aim at the door, smoothed: one noisy pose must not break a good try off."""
        assert step.door is not None
        at = step.start.inverse() @ step.door.map_from_door
        way = max(at.x - course.x, 0.0)
        aside, bend = veered(self.guide.rider.veer_per_m, way, self.guide.body.front)
        offset = course.y + (at.x - course.x) * math.tan(course.theta) + aside - at.y
        turned = wrap_angle(course.theta + bend - at.theta)
        if state.aim is None:
            return replace(state, aim=Aim(offset, turned, 1))
        part = max(AIM_PART, 1.0 / (state.aim.ticks + 1))
        return replace(
            state,
            aim=Aim(
                state.aim.offset + part * (offset - state.aim.offset),
                state.aim.turned + part * (turned - state.aim.turned),
                state.aim.ticks + 1,
            ),
        )

    def _retry(self, state: GuideState, why: str) -> tuple[GuideWord, GuideState]:
        """Back off from a door, or from something in the way, and try again."""
        step = self.plan.steps[state.step]
        if state.tries >= (OPEN_TRIES if step.door is None else MOST_TRIES):
            return self._quiet(f"{why}, after {state.tries} tries", state, astray=True, blocked=True)
        along, _, _ = on_leg(step, self.now.pose)
        until = along - BACK_FROM_THINGS
        if step.door is not None:
            at = step.start.inverse() @ step.door.map_from_door
            until = min(until, at.x - HALF_WALL - self.guide.body.front - BACK_OFF)
        until = max(until, -BACK_FROM_THINGS if self.now.holds else -BEHIND_START)
        state = replace(state, phase=LeadingPhase.BACK, back_until=until, tries=state.tries + 1)
        guidance, state = self._back(replace(state, still_ns=None, aim=None))
        reason = guidance.reason
        return replace(guidance, reason=reason if reason.startswith(why) else f"{why}: {reason}"), state
