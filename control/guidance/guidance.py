"""Step guidance: one movement at a time for a rider who drives, as a pure step from the chair's pose to what is told.

The pose is matched to the ways of the building's graph. At each junction the rider takes the proposed way or another one, and
another one is planned from in the same step. Prompts fade with practice at each place, and come back after an error.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from types import MappingProxyType

from waychair.control.guidance.practice import (
    AT_DECISIONS,
    BEFORE,
    HESITATES_S,
    NO_PROMPT,
    STEERS,
    DecisionMade,
    Practice,
    RiderDecision,
    practised,
)
from waychair.control.guidance.telling import (
    ARRIVED_M,
    AT_ONCE,
    TAKES_TIME,
    Cue,
    Occasion,
    Speech,
    bearing_to,
    nearest_along,
    present,
    reached,
    spoken,
    turned_from,
    turning,
)
from waychair.control.guidance.way_matching import PlaceOnWay, matched
from waychair.errors import BuildingError, NoPath
from waychair.geometry import wrap_angle
from waychair.maps.building.hgraph import NodeRef
from waychair.planning.building.guided_ways import GuidedWays, Plan, StoreyPart
from waychair.planning.movements import TURNS, Movement, MovementKind
from waychair.types import Pose2

LOBBY_M = 1.5
"""m; so near to the place before a lift's door the rider waits for it."""


INSIDE_M = 0.2
"""m; a chair is in a cabin once its axle is so far within, and out of it again so far without."""

SURELY_M = 0.5
"""m of straight driving; the way on has to cost less by this before it replaces the way back."""


AT_END_M, NOT_SURE_M = 0.1, 1.0
"""m; a chair this near to the end of its way may be on the next one, which it has surely taken after so much of it."""


class GuidanceTrouble(enum.StrEnum):
    """Why no movement is told."""

    NONE = ""
    NO_POSE = "no pose"
    NO_WAY = "no way"
    NO_GRAPH = "no graph"


@dataclass(frozen=True, slots=True)
class GuidanceView:
    """What a step knows: the storey of the map in use, the pose there (None while uncertain), and who drives.

    `lift_open`: whether the lift's door before the chair is open, None where nobody can tell.
    """

    now_ns: int
    storey: str
    pose: Pose2 | None
    at_rest: bool = False
    computer_drives: bool = False
    lift_open: bool | None = None


@dataclass(frozen=True, slots=True)
class Guiding:
    """What is shown and said now.

    `movement`: the present one, `left` [m]: to its end, `following`: the next one, `bearing` [rad]: of the way ahead from the
    chair's heading. `cue`: it is to be spoken of now, with SOON of the following one; None: silence. `decided`: a decision
    that was just recognised. `at_stops`: the storeys at which the lift may stop, in a cabin. `offers`: the chair may be
    asked to drive. `why`: the sentence of a trouble.
    """

    movement: Movement | None = None
    left: float = 0.0
    following: Movement | None = None
    bearing: float = 0.0
    cue: Cue | None = None
    decided: DecisionMade | None = None
    arrived: bool = False
    at_stops: tuple[str, ...] = ()
    offers: bool = False
    trouble: GuidanceTrouble = GuidanceTrouble.NONE
    why: str = ""


@dataclass(frozen=True, slots=True)
class Rest:
    """The rider's rests: since when the present one [ns], the longest since the last place [s], and whether it is noted."""

    since_ns: int | None = None
    longest_s: float = 0.0
    noted: bool = False


@dataclass(frozen=True, slots=True)
class Guidance:
    """The state of guidance to a goal.

    `level`: the level of prompting where the rider has no practice. `told`: the index of the present movement of the
    plan's part, `passed` that of the way there on which the chair was last; neither goes back. `lift`: the one in whose cabin
    the chair is. `plans`: how many have been made.
    """

    goal: NodeRef
    level: int = BEFORE
    practice: Mapping[str, Practice] = field(default_factory=lambda: MappingProxyType({}))
    storey: str = ""
    lift: str = ""
    plan: Plan | None = None
    plans: int = 0
    told: int = 0
    passed: int = 0
    track: PlaceOnWay | None = None
    turning: MovementKind | None = None
    speech: Speech = field(default_factory=Speech)
    rest: Rest = field(default_factory=Rest)
    arrived: bool = False

    def practice_at(self, place: str) -> Practice:
        """Return the practice at a place."""
        return self.practice.get(place, Practice(min(self.level, BEFORE)))


def begun(goal: NodeRef, level: int = BEFORE, practice: Mapping[str, Practice] = MappingProxyType({})) -> Guidance:
    """Return guidance to a goal, which begins with the next step; levels are those of `practice`."""
    return Guidance(goal, min(max(level, NO_PROMPT), STEERS), MappingProxyType(dict(practice)))


def at_level(state: Guidance, level: int, practice: Mapping[str, Practice] = MappingProxyType({})) -> Guidance:
    """Return the same guidance at another level of prompting, which holds at every place but those of `practice`."""
    return replace(state, level=min(max(level, NO_PROMPT), STEERS), practice=MappingProxyType(dict(practice)))


def step(state: Guidance, view: GuidanceView, ways: GuidedWays) -> tuple[Guidance, Guiding]:
    """Return the state after this view, and what is shown and said."""
    pose = view.pose
    if pose is None or not all(math.isfinite(each) for each in (pose.x, pose.y, pose.theta)):
        return state, Guiding(trouble=GuidanceTrouble.NO_POSE, arrived=state.arrived)
    state = _rested(state, view)
    try:
        lift = ways.cabin_of(view.storey, pose, -INSIDE_M if not state.lift else INSIDE_M)
        return _in_lift(state, view, ways, lift) if lift else _on_storey(state, view, pose, ways)
    except NoPath as error:
        return replace(state, plan=None, track=None), Guiding(trouble=GuidanceTrouble.NO_WAY, why=str(error))
    except BuildingError as error:
        return replace(state, plan=None, track=None), Guiding(trouble=GuidanceTrouble.NO_GRAPH, why=str(error))


def _rested(state: Guidance, view: GuidanceView) -> Guidance:
    rest = state.rest
    if not view.at_rest or view.computer_drives or state.arrived:
        return replace(state, rest=Rest(longest_s=rest.longest_s))
    since = view.now_ns if rest.since_ns is None else rest.since_ns
    return replace(state, rest=Rest(since, max(rest.longest_s, (view.now_ns - since) * 1e-9), rest.noted))


def _on_storey(state: Guidance, view: GuidanceView, pose: Pose2, ways: GuidedWays) -> tuple[Guidance, Guiding]:
    known = ways.storey(view.storey)
    before = state.track if view.storey == state.storey and not state.lift and state.plan is not None else None
    proposed = () if before is None or state.plan is None else tuple(pairwise(state.plan.parts[0].junctions))
    track = matched(
        before, known, pose, view.now_ns, lambda one, other: ways.in_sight(view.storey, one, other), proposed
    )
    state, decided = replace(state, storey=view.storey, lift="", track=track), None
    if before is None:
        state = _planned(replace(state, rest=Rest()), pose, ways, track)
    elif track.edge != before.edge:
        state, decided = _moved_on(state, view, pose, ways, before, track)
    else:
        state = _reconsidered(state, pose, ways, track)
    if view.computer_drives:
        return replace(state, speech=Speech()), Guiding(decided=decided)
    return _told(state, view, pose, ways, decided)


def _planned(state: Guidance, pose: Pose2, ways: GuidedWays, track: PlaceOnWay) -> Guidance:
    """Return the state with the cheaper plan from where the chair is: on along its way, or back."""
    (onwards, back), (behind, ahead) = _costs(state, pose, ways, track), track.edge
    if back < onwards:
        behind, ahead = ahead, behind
    plan = ways.plan(state.storey, None if behind == ahead else behind, ahead, state.goal)
    return replace(state, plan=plan, plans=state.plans + 1, told=0, passed=0, turning=None, arrived=False)


def _costs(state: Guidance, pose: Pose2, ways: GuidedWays, track: PlaceOnWay) -> tuple[float, float]:
    """Return the costs to the goal [m of straight driving] on along the chair's way, and back.

    A plan that comes back along this way has to turn round at its end, so that turning here is always cheaper.
    """
    known = ways.storey(state.storey)
    costs = []
    for behind, ahead in (track.edge, track.edge[::-1]):
        x, y = known.points[ahead]
        away, towards = math.hypot(x - pose.x, y - pose.y), math.atan2(y - pose.y, x - pose.x)
        turn = ways.turn_cost(wrap_angle(towards - pose.theta)) if away > ARRIVED_M else 0.0
        if behind in ways.plan(state.storey, None, ahead, state.goal).parts[0].junctions[1:2]:
            turn += ways.turn_cost(math.pi)
        costs.append(away + turn + ways.cost(state.storey, ahead, state.goal))
    return costs[0], costs[1]


def _reconsidered(state: Guidance, pose: Pose2, ways: GuidedWays, track: PlaceOnWay) -> Guidance:
    """Return the state with the plan on along the way of a rider who does not turn back, once that costs less."""
    assert state.plan is not None
    part = state.plan.parts[0]
    against = _index(part, *track.edge[::-1], state.passed) is not None
    if not against or _index(part, *track.edge, state.passed) is not None:
        return state
    onwards, back = _costs(state, pose, ways, track)
    return _planned(state, pose, ways, track) if onwards + SURELY_M < back else state


def _moved_on(
    state: Guidance, view: GuidanceView, pose: Pose2, ways: GuidedWays, before: PlaceOnWay, track: PlaceOnWay
) -> tuple[Guidance, DecisionMade | None]:
    """Return the state after the chair has come to another way, or turned back, and the decision that this was."""
    assert state.plan is not None
    known, part, (place, towards) = ways.storey(view.storey), state.plan.parts[0], track.edge
    back = (towards, place) == before.edge or _index(part, towards, place) is not None
    decision = RiderDecision.TURNED_BACK if back else RiderDecision.OTHER
    index = _index(part, place, towards, state.passed)
    if index is not None:
        decision, state = RiderDecision.FOLLOWED, replace(state, passed=index)
    junction, made = known.junctions[place], None
    told = [each.movement.kind for each in part.told if each.junction == place]
    if not view.computer_drives and (len(junction.ways) > 2 or told or decision is not RiderDecision.FOLLOWED):
        proposed = next((kind for kind in told if kind in AT_ONCE), MovementKind.STRAIGHT)
        state, made = _made(state, junction.name, proposed, decision)
    if decision is not RiderDecision.FOLLOWED:
        state = _planned(state, pose, ways, track)
    return state, made


def _made(
    state: Guidance, place: str, proposed: MovementKind, decision: RiderDecision
) -> tuple[Guidance, DecisionMade]:
    """Return the state after a decision of the rider at a place, with the practice there, and the decision."""
    made = DecisionMade(place, proposed, decision, state.rest.longest_s, state.speech.prompts)
    after = practised(state.practice_at(place), made)
    return replace(
        state,
        practice=MappingProxyType({**state.practice, place: after}),
        rest=replace(state.rest, longest_s=0.0),
        speech=replace(state.speech, prompts=0),
    ), made


def _index(part: StoreyPart, one: int, other: int, first: int = 0) -> int | None:
    """Return where a part goes from one junction to another, from its way number `first` on; None where it does not."""
    passed = part.junctions
    return next((k for k in range(first, len(passed) - 1) if passed[k] == one and passed[k + 1] == other), None)


def _in_lift(state: Guidance, view: GuidanceView, ways: GuidedWays, lift: str) -> tuple[Guidance, Guiding]:
    """Return what is told in a cabin: which storey to press, or to leave."""
    title, made = ways.lift_title(lift), None
    if state.lift != lift or state.storey != view.storey or state.plan is None:
        if state.plan is not None and not view.computer_drives:
            part = state.plan.parts[0]
            proposed = MovementKind.PRESS if state.lift == lift else MovementKind.INTO_LIFT
            is_right = part.to == view.storey if state.lift == lift else part.lift == lift
            state = replace(state, rest=Rest())  # riders wait at lifts, and do not hesitate
            state, made = _made(state, title, proposed, RiderDecision.FOLLOWED if is_right else RiderDecision.OTHER)
        plan = ways.plan_in_lift(lift, view.storey, state.goal)
        state = replace(
            state, storey=view.storey, lift=lift, plan=plan, plans=state.plans + 1, told=0, passed=0, track=None
        )
    assert state.plan is not None
    part = state.plan.parts[0]
    movement = Movement(MovementKind.LEAVE_LIFT, lift=title)
    if not part.junctions:
        movement = Movement(MovementKind.PRESS, lift=part.title, storey=part.to_title)
    if view.computer_drives:
        return replace(state, speech=Speech()), Guiding()
    astray = made is not None and made.decision is RiderDecision.OTHER
    level = _level(state, title, astray=astray, rests_s=0.0)
    occasion = Occasion(state.plans, 0, movement, level, rests_s=_rests_s(state, view))
    speech, cue = spoken(state.speech, occasion, view.now_ns)
    offers = state.level >= STEERS
    stops = ways.stops(lift)
    return replace(state, speech=speech), Guiding(movement, cue=cue, decided=made, at_stops=stops, offers=offers)


def _told(
    state: Guidance, view: GuidanceView, pose: Pose2, ways: GuidedWays, decided: DecisionMade | None
) -> tuple[Guidance, Guiding]:
    """Return the present movement of the plan, and whether it is spoken of now."""
    assert state.plan is not None
    track = state.track
    assert track is not None
    part, known = state.plan.parts[0], ways.storey(view.storey)
    if state.arrived or (not part.lift and reached(part, pose)):
        cue = Cue.NOW if not state.arrived and state.level > NO_PROMPT else None
        arrived = Movement(MovementKind.ARRIVED, landmark=state.plan.name.rpartition("/")[2])
        if not state.arrived and decided is None:
            goal = known.junctions[part.junctions[-1]].name
            state, decided = _made(state, goal, MovementKind.ARRIVED, RiderDecision.FOLLOWED)
        return replace(state, arrived=True), Guiding(arrived, cue=cue, decided=decided, arrived=True)
    at = _along(part, track, state.passed, pose)
    index = present(part, state.told, at, pose)
    bearing = bearing_to(part, at, pose)
    turn = turning(part, index, at, pose, state.turning)
    state = replace(state, told=index, turning=turn)
    following = part.told[index + 1].movement if index + 1 < len(part.told) else None
    if part.lift and (index == len(part.told) or float(part.along[-1]) - at < LOBBY_M):
        kind = MovementKind.INTO_LIFT if view.lift_open else MovementKind.WAIT
        movement = Movement(kind, lift=part.title, storey=part.to_title)
        left, place, turn, following = max(float(part.along[-1]) - at, 0.0), part.title, None, None
    elif index == len(part.told):
        movement, left, place = Movement(MovementKind.STRAIGHT), 0.0, ""
    else:
        now = part.told[index]
        movement, left, place = (
            turned_from(now.movement, pose),
            max(now.ends - at, 0.0),
            known.junctions[now.junction].name,
        )
    if turn is not None:
        movement, following = Movement(turn, angle=bearing), movement
    elif movement.kind in TURNS and movement.end is not None:
        bearing = wrap_angle(movement.end.theta - pose.theta)  # what is left of the turn
    astray = decided is not None and decided.decision is not RiderDecision.FOLLOWED
    rests_s = _rests_s(state, view)
    level = _level(state, place, astray=astray, rests_s=rests_s)
    if rests_s > HESITATES_S and decided is None and place and movement.kind not in TAKES_TIME:
        state, decided = _hesitated(state, place, movement.kind, rests_s)
    number = index if place != part.title else len(part.told)
    occasion = Occasion(state.plans, number, movement, level, left, following, rests_s)
    speech, cue = spoken(state.speech, occasion, view.now_ns)
    offers = state.level >= STEERS
    return replace(state, speech=speech), Guiding(movement, left, following, bearing, cue, decided, offers=offers)


def _level(state: Guidance, place: str, *, astray: bool, rests_s: float) -> int:
    """Return the level of prompting at a place now: a rider who went astray or hesitates is told, whatever the practice."""
    level = state.practice_at(place).level if place else min(state.level, BEFORE)
    return max(level, AT_DECISIONS) if state.level > NO_PROMPT and (astray or rests_s > HESITATES_S) else level


def _hesitated(
    state: Guidance, place: str, proposed: MovementKind, rests_s: float
) -> tuple[Guidance, DecisionMade | None]:
    """Return the state with a hesitation noted, once a rest, and the decision that it is."""
    if state.rest.noted:
        return state, None
    made = DecisionMade(place, proposed, RiderDecision.HESITATED, rests_s, state.speech.prompts)
    practice = MappingProxyType({**state.practice, place: practised(state.practice_at(place), made)})
    return replace(state, practice=practice, rest=replace(state.rest, noted=True)), made


def _rests_s(state: Guidance, view: GuidanceView) -> float:
    return 0.0 if state.rest.since_ns is None else (view.now_ns - state.rest.since_ns) * 1e-9


def _along(part: StoreyPart, track: PlaceOnWay, passed: int, pose: Pose2) -> float:
    """Return how far along a part a chair is [m].

    At the end of its way it is on the proposed one already, which it has not surely taken: so turns that follow each other
    are told in time.
    """
    index = _index(part, *track.edge, passed)
    if index is not None:
        at = float(part.along[index]) + track.along
        is_at_end = at > float(part.along[index + 1]) - AT_END_M
        return max(at, nearest_along(part, at, at + NOT_SURE_M, pose)) if is_at_end else at
    index = _index(part, *track.edge[::-1], passed)  # it has not turned yet
    return 0.0 if index is None else float(part.along[index + 1]) - track.along
