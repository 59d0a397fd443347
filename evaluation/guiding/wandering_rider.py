"""A simulated rider who hears one movement at a time, follows it with some probability, and wanders otherwise.

The rider knows neither the goal's place nor the plan: it takes the way that the movement names, by sight. At each junction it
decides once, turns early or late, keeps no exact line, and its pose is known with noise. `Score` compares the rider's true
choices with those that guidance recognises.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from waychair.control.guidance.guidance import Guidance, GuidanceView, Guiding, begun, step
from waychair.control.guidance.practice import BEFORE, Practice, RiderDecision
from waychair.control.guidance.telling import Cue
from waychair.geometry import wrap_angle
from waychair.maps.building.hgraph import NodeRef
from waychair.planning.building.guided_ways import GuidedWays, StoreyWays
from waychair.planning.movements import Movement, MovementKind
from waychair.types import Pose2

TICK_NS = 50_000_000
TICK_S = 0.05

BEYOND_M = 0.5
"""m; a choice is unambiguous once the chair is truly so far along the chosen way."""

RECOGNISED_S = 0.6
"""s; a choice is to be recognised within this of being unambiguous."""

TIME_LIMIT_S = 1800.0
"""s; a rider who needs longer has not arrived."""

_TURN_RATE, _SPEED = 1.0, 0.6
_FACES = math.radians(60.0)
_JOG_M = 1.2
"""m; over a way so short a person sees the one behind it, and knows the direction of that before it."""

_IDEAL = {MovementKind.LEFT: math.pi / 2, MovementKind.RIGHT: -math.pi / 2, MovementKind.TURN_ROUND: math.pi}


@dataclass(slots=True)
class Score:
    """The score of one rider: true other ways, false ones, and the delays [s] of those recognised in time.

    `repeats`: sentences repeated within 4 s while nothing changed. `late_plans`: other ways that were not planned from
    in the step in which they were recognised.
    """

    arrived: bool = False
    seconds: float = 0.0
    decisions: int = 0
    others: int = 0
    false: int = 0
    late_plans: int = 0
    prompts: int = 0
    repeats: int = 0
    delays_s: list[float] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Now:
    """The time [ns], and whether guidance has just planned anew."""

    ns: int
    replanned: bool


@dataclass(frozen=True, slots=True)
class _Choice:
    """A choice at a junction that is not recognised yet: the way taken, whether it is the proposed one, and since when."""

    edge: tuple[int, int]
    proposed: bool
    planned: tuple[int, int] | None = None
    clear_ns: int | None = None


class WanderingRider:
    """One rider on the way to a goal."""

    def __init__(self, ways: GuidedWays, start: tuple[str, int], follows: float, seed: int) -> None:
        """`start`: storey and junction; `follows`: the probability of following at each junction."""
        self._ways, self._follows = ways, follows
        self._random = np.random.default_rng(seed)
        self.storey = start[0]
        known = ways.storey(self.storey)
        self.edge = (start[1], start[1])  # it sets off once it has heard the first movement
        x, y = known.points[start[1]]
        self.pose = Pose2(float(x), float(y), float(self._random.uniform(-math.pi, math.pi)))
        self.left: tuple[int, int] | None = None
        """The way before the present one."""
        self._chosen: tuple[int, int] | None = None
        self._turns_at = 0.0
        self._wait_s = 0.0
        self._cabin = ""
        self._aside = 0.0
        self._heeded: MovementKind | None = None

    def move(self, heard: Movement | None) -> _Choice | None:
        """Move for a tick, having heard a movement last; return a choice that was just made."""
        if self._wait_s > 0.0:
            self._wait_s -= TICK_S
            return None
        if self._cabin:
            self._ride(heard)
            return None
        known = self._ways.storey(self.storey)
        if self._at_lift(known, heard):
            return None
        return self._drive(known, heard)

    def _at_lift(self, known: StoreyWays, heard: Movement | None) -> bool:
        """Go into the lift if told to, and before it; return whether the rider is in it."""
        if heard is None or heard.kind is not MovementKind.WAIT:
            return False
        lifts = [lift for lift in self._ways.lifts() if self._ways.lift_title(lift) == heard.lift]
        stop = self._ways.lobby(lifts[0], self.storey) if lifts else None
        if stop is None:
            return False
        x, y = known.points[stop]
        if math.hypot(x - self.pose.x, y - self.pose.y) > 0.7:
            return False
        cabin = self._ways.cabin_pose(lifts[0], self.storey)
        self._cabin, self._wait_s = lifts[0], 5.0
        self.pose = cabin if cabin is not None else self.pose
        return True

    def _ride(self, heard: Movement | None) -> None:
        """Press the storey that was told, or another one, and come out of the lift there."""
        stops = self._ways.stops(self._cabin)
        if heard is not None and heard.kind is MovementKind.PRESS:
            told = next((stop for stop in stops if self._ways.storey_title(stop) == heard.storey), stops[0])
            strays = self._random.random() > self._follows
            to = stops[int(self._random.integers(len(stops)))] if strays else told
            cabin = self._ways.cabin_pose(self._cabin, to)
            assert cabin is not None
            self.storey, self.pose, self._wait_s = to, cabin, 3.0
        elif heard is not None and heard.kind is MovementKind.LEAVE_LIFT:
            lobby = self._ways.lobby(self._cabin, self.storey)
            known = self._ways.storey(self.storey)
            x, y = known.points[lobby]
            theta = math.atan2(y - self.pose.y, x - self.pose.x)
            self.pose = Pose2(float(x), float(y), theta)
            self.left, self.edge, self._cabin, self._chosen, self._wait_s = None, (lobby, lobby), "", None, 0.2

    def _drive(self, known: StoreyWays, heard: Movement | None) -> _Choice | None:
        choice = None
        if self.edge[0] == self.edge[1]:
            if heard is not None:
                self.edge = self._sets_off(known, heard)
            return None
        faces = self.faces(known)
        if faces:
            self._heed(heard)
        one, other = self.edge
        here, there = known.points[one], known.points[other]
        line = there - here
        length = float(np.hypot(*line))
        along = float((np.array([self.pose.x, self.pose.y]) - here) @ line) / length
        if faces and self._chosen is None and along > length - 0.7:
            self._chosen = self._choose(known, heard)
            self._turns_at = float(self._random.uniform(-0.3, 0.35))
            choice = _Choice(self._chosen, proposed=False)
        if self._chosen is not None and along > length + min(self._turns_at, 0.4 * self._length(known, self._chosen)):
            self.left, self.edge, self._chosen = self.edge, self._chosen, None
            one, other = self.edge
            here, there = known.points[one], known.points[other]
            line, length = there - here, self._length(known, self.edge)
            along = float((np.array([self.pose.x, self.pose.y]) - here) @ line) / length
        self._aside += (-0.5 * self._aside * TICK_S) + 0.08 * math.sqrt(TICK_S) * float(self._random.normal())
        target = here + line / length * min(along + 0.6, length + 0.6)
        target = target + self._aside * np.array([-line[1], line[0]]) / length
        want = wrap_angle(math.atan2(target[1] - self.pose.y, target[0] - self.pose.x) - self.pose.theta)
        turn = min(max(2.0 * want, -_TURN_RATE), _TURN_RATE)
        speed = _SPEED * max(0.0, math.cos(want)) ** 2 if abs(want) < math.pi / 2 else 0.0
        theta = wrap_angle(self.pose.theta + turn * TICK_S)
        x, y = self.pose.x + speed * TICK_S * math.cos(theta), self.pose.y + speed * TICK_S * math.sin(theta)
        self.pose = Pose2(x, y, theta)
        return choice

    def faces(self, known: StoreyWays) -> bool:
        """Return whether the rider faces the way that it takes."""
        return abs(wrap_angle(self._towards(known, *self.edge) - self.pose.theta)) < _FACES

    def _sets_off(self, known: StoreyWays, heard: Movement) -> tuple[int, int]:
        """Return the way from a junction at which the rider stands: the one told from its heading, or any other one."""
        place = self.edge[0]
        onwards = known.junctions[place].ways
        wanted = self.pose.theta + _IDEAL.get(heard.kind, 0.0)
        told = min(onwards, key=lambda other: abs(wrap_angle(self._towards(known, place, other) - wanted)))
        strays = self._random.random() > self._follows
        return place, onwards[int(self._random.integers(len(onwards)))] if strays else told

    def _heed(self, heard: Movement | None) -> None:
        """Turn round between junctions if that is told, with the probability of following."""
        if heard is None or heard.kind is self._heeded:
            return
        self._heeded = heard.kind
        is_told = heard.kind is MovementKind.TURN_ROUND and self._chosen is None
        if is_told and self._random.random() < self._follows:
            self.left, self.edge = None, self.edge[::-1]

    def is_on(self, known: StoreyWays, edge: tuple[int, int]) -> bool:
        """Return whether the rider is on a way, or has left it by less than `BEYOND_M`, so that it has chosen no other yet."""
        return edge == self.edge or (edge == self.left and _away(known, self.edge, self.pose)[0] < BEYOND_M)

    @staticmethod
    def _towards(known: StoreyWays, one: int, other: int) -> float:
        dx, dy = known.points[other] - known.points[one]
        return math.atan2(dy, dx)

    def _choose(self, known: StoreyWays, heard: Movement | None) -> tuple[int, int]:
        """Return the way taken from the junction ahead: the one told, by sight, or any other one."""
        one, place = self.edge
        onwards = known.junctions[place].ways
        if len(onwards) == 1:
            return place, one
        came = one if self.left is None or self._length(known, self.edge) > _JOG_M else self.left[0]
        ahead = self._towards(known, came, place)
        kind = None if heard is None else heard.kind
        wanted = 0.0 if kind is None else _IDEAL.get(kind, 0.0)
        changes = {other: self._change(known, place, other, ahead + wanted) for other in onwards}
        others = [other for other in onwards if other != one or kind is MovementKind.TURN_ROUND]
        told = min(others, key=changes.__getitem__)
        if len(onwards) > 2 and self._random.random() > self._follows:
            rest = [other for other in onwards if other != told]
            return place, rest[int(self._random.integers(len(rest)))]
        return place, told

    def _change(self, known: StoreyWays, place: int, other: int, wanted: float) -> float:
        """Return how far [rad] a way from a junction leads from the wanted direction; a jog counts by the way behind it."""
        ends = [other]
        if self._length(known, (place, other)) < _JOG_M:
            ends += [beyond for beyond in known.junctions[other].ways if beyond != place]
        return min(abs(wrap_angle(self._towards(known, place, end) - wanted)) for end in ends)

    @staticmethod
    def _length(known: StoreyWays, edge: tuple[int, int]) -> float:
        return math.dist(known.points[edge[0]], known.points[edge[1]])


def guided(
    ways: GuidedWays,
    start: tuple[str, int],
    goal: NodeRef,
    follows: float,
    seed: int,
    practice: Mapping[str, Practice] | None = None,
    level: int = BEFORE,
) -> tuple[Score, Guidance]:
    """Let a rider drive to a goal, and return its score and the last state of guidance."""
    rider, score = WanderingRider(ways, start, follows, seed), Score()
    noise = np.random.default_rng(seed + 1)
    state = begun(goal, level, practice or {})
    heard: Movement | None = None
    choice: _Choice | None = None
    said: dict[str, tuple[int, object]] = {}
    for tick in range(round(TIME_LIMIT_S / TICK_S)):
        now_ns = (tick + 1) * TICK_NS
        before, came = rider.pose, rider.edge[0]
        made = rider.move(heard)
        true = rider.pose
        at_rest = math.hypot(true.x - before.x, true.y - before.y) < 1e-3 and abs(true.theta - before.theta) < 1e-3
        x, y, theta = noise.normal(0.0, (0.03, 0.03, 0.015))
        pose = Pose2(true.x + x, true.y + y, wrap_angle(true.theta + theta))
        if made is not None:
            planned = _planned(state, came, made.edge[0])
            choice = _Choice(made.edge, planned == made.edge, planned)
        plans = state.plans
        state, guiding = step(state, GuidanceView(now_ns, rider.storey, pose, at_rest=at_rest), ways)
        heard = guiding.movement
        choice = _scored(score, choice, guiding, ways, rider, state, Now(now_ns, state.plans > plans))
        if guiding.cue is not None:
            score.prompts += 1
            words = words_of(guiding)
            last = said.get(words)
            if last is not None and now_ns - last[0] < 4_000_000_000 and last[1] == (state.plans, state.told):
                score.repeats += 1
            said[words] = now_ns, (state.plans, state.told)
        if guiding.arrived:
            score.arrived, score.seconds = True, now_ns * 1e-9
            return score, state
    score.seconds = TIME_LIMIT_S
    return score, state


def words_of(guiding: Guiding) -> str:
    """Return the words of what is said, but for distances."""
    said = guiding.following if guiding.cue is Cue.SOON else guiding.movement
    return "" if said is None else f"{guiding.cue is Cue.SOON} {said.kind} {said.landmark} {said.lift} {said.storey}"


def _planned(state: Guidance, came: int, place: int) -> tuple[int, int] | None:
    """Return the way that the plan takes from a junction to which a rider has come from another, None if it does not."""
    passed = () if state.plan is None else state.plan.parts[0].junctions
    ways = zip(passed, passed[1:], passed[2:], strict=False)
    after = next(((place, after) for before, here, after in ways if (before, here) == (came, place)), None)
    return after or next((pair for pair in pairwise(passed) if pair[0] == place), None)


def _is_planned(state: Guidance, edge: tuple[int, int]) -> bool:
    passed = () if state.plan is None else state.plan.parts[0].junctions
    return any(pair == edge for pair in pairwise(passed))


def _away(known: StoreyWays, edge: tuple[int, int], pose: Pose2) -> tuple[float, float]:
    """Return how far along a way a chair is, and how far from it [m]."""
    here, there = known.points[edge[0]], known.points[edge[1]]
    length = float(np.hypot(*(there - here)))
    at = np.array([pose.x, pose.y])
    along = float((at - here) @ (there - here)) / length
    foot = here + (there - here) * min(max(along / length, 0.0), 1.0)
    return along, float(np.hypot(*(at - foot)))


def _scored(
    score: Score,
    choice: _Choice | None,
    guiding: Guiding,
    ways: GuidedWays,
    rider: WanderingRider,
    state: Guidance,
    now: Now,
) -> _Choice | None:
    """Return the choice that still waits to be recognised; count those that were, in time or wrongly."""
    decided = guiding.decided
    strays = decided is not None and decided.decision in (RiderDecision.OTHER, RiderDecision.TURNED_BACK)
    if decided is not None and decided.decision is not RiderDecision.HESITATED:
        score.decisions += 1
    if strays and not now.replanned:
        score.late_plans += 1
    edge = None if state.track is None else state.track.edge
    known = ways.storey(rider.storey)
    is_there = edge is not None and rider.is_on(known, edge)
    if (
        strays
        and edge is not None
        and (not is_there or (choice is not None and choice.proposed and edge == choice.edge))
    ):
        score.false += 1
        strays = False
    if choice is None:
        return None
    along, _ = _away(known, choice.edge, rider.pose)
    off = choice.planned is None or _away(known, choice.planned, rider.pose)[1] >= BEYOND_M
    enough = min(BEYOND_M, 0.9 * math.dist(*known.points[list(choice.edge)]))
    is_clear = rider.edge == choice.edge and rider.faces(known) and along >= enough
    if choice.clear_ns is None and is_clear and (off or choice.proposed):
        choice = replace(choice, clear_ns=now.ns)
    waited_s = 0.0 if choice.clear_ns is None else (now.ns - choice.clear_ns) * 1e-9
    if choice.proposed:
        return None if waited_s > RECOGNISED_S else choice
    followed = decided is not None and decided.decision is RiderDecision.FOLLOWED and edge == choice.edge
    if edge == choice.edge and not followed and (choice.clear_ns is not None or strays):
        score.others += 1
        score.delays_s.append(waited_s)
        return None
    if now.replanned and _is_planned(state, choice.edge):
        return None  # it has become the proposed way before anybody could tell
    if waited_s > RECOGNISED_S:
        score.others += 1
        return None
    return choice
