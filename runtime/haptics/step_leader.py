"""Leads one rider along steps to a place: plans, guides, learns, and plans anew from wherever the rider went."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace

from waychair.calibration.chair_body import ChairBody
from waychair.control.haptics.guide import StepGuide
from waychair.control.haptics.guide_numbers import NUDGES, VALID_NS
from waychair.control.haptics.guide_types import GuideInputs, GuideState, GuideWord, LeadingPhase
from waychair.control.haptics.learning import RiderLearner
from waychair.control.haptics.symbols import Advice, Symbol
from waychair.errors import NoPath, PlanningError
from waychair.geometry import wrap_angle
from waychair.planning.grid.costmap import Costmap
from waychair.planning.steps.clear_ground import ClearGround
from waychair.planning.steps.step import StepPlan
from waychair.planning.steps.step_planner import StepPlanner
from waychair.types import Goal, Place, Pose2, Twist

REPLANS = 8
"""Plans in a row without a step that was done, after which the rider is no longer led."""

REFUSED_NS, ASKED_NS = 45_000_000_000, 2_000_000_000
"""ns for which a rider waits while other steps are wanted and there are none, as for somebody who stands in a door; and between two
looks for them."""

AskGround = Callable[[], Callable[[], Costmap]]
"""Returns the work of making the ground's costmap as it is now, for any one thread."""


LOOK_NS = 1_000_000_000
"""ns between two looks at the steps on ground that grows."""


AskWhy = Callable[[], Callable[[PlanningError, Pose2, Pose2], str]]
"""Returns the work of finding why a plan from a start to a goal failed, the true cause in words, for any one thread."""


@dataclass(frozen=True, slots=True)
class LedGround:
    """The ground to lead over: as it is `now`, the same by the map alone (`mapped`), and the true cause if no steps lead there.

    One that `grows` with what is seen has the steps looked at again as they go on.
    """

    now: AskGround
    mapped: AskGround | None = None
    why: AskWhy | None = None
    grows: bool = False


class _Refused(PlanningError):
    """There are no steps now. `barred`: there is no way at all; `mapped`: there is one on the map alone."""

    def __init__(self, why: str, *, barred: bool, mapped: bool) -> None:
        super().__init__(why)
        self.barred, self.mapped = barred, mapped


@dataclass(frozen=True, slots=True)
class _Way:
    """The way to the goal: its planner, and its ground."""

    planner: StepPlanner
    ground: LedGround


@dataclass(frozen=True, slots=True)
class _Vain:
    """Plans in a row without a step that was done; why there are no other steps, since when, and when they were asked for last.

    `barred`: no way at all leads on. `blocked`: why other steps are wanted, if something holds the chair; `led_on`: the same, once
    there are some.
    """

    plans: int = 0
    why: str = ""
    barred: bool = False
    blocked: str = ""
    led_on: str = ""
    since_ns: int = 0
    asked_ns: int = -ASKED_NS

    def may_ask(self, now_ns: int) -> bool:
        """Return whether the last question is long enough ago."""
        return now_ns - self.asked_ns >= ASKED_NS


class StepLeader:
    """Leads to one place at a time. `goal` is that place or None, `reason` why leading has ended; `learner` knows the rider.

    With a `worker` plans are made there, and the rider is told nothing new meanwhile; without one, at once.
    """

    def __init__(
        self,
        body: ChairBody,
        durations: Mapping[Symbol, float],
        learner: RiderLearner,
        worker: Executor | None = None,
    ) -> None:
        """`durations` [s] of the patterns."""
        self.learner = learner
        self.goal: Place | None = None
        self.reason = ""
        self.arrived = False
        self._body, self._durations, self._worker = body, durations, worker
        self._planned: _Way | None = None
        self._plan: StepPlan | None = None
        self._planning: Future[StepPlan] | None = None
        self._memory = self._before = GuideState()
        self._vain = _Vain()
        self._looked_ns = 0

    def lead(self, goal: Place, ground: LedGround) -> None:
        """Lead to a place from now on, over the ground that is asked for at each plan, in the frame of the place and of the poses.

        A plan under way for another place is dropped. Where there are no steps at first but some on the map alone, the rider waits
        for them.
        """
        self.goal, self.reason, self.arrived = goal, "", False
        self._planned = _Way(StepPlanner(Goal(goal.pose), goal.pose), ground)
        self._plan = self._planning = None
        self._memory = self._before = GuideState(number=self._memory.number)
        self._vain = _Vain()

    def end(self, reason: str) -> None:
        """Lead no longer."""
        if self.goal is not None:
            self.goal, self.reason, self._plan, self._planning = None, reason, None, None
            self._vain = _Vain()

    def look_again(self) -> None:
        """Forget the plan: after a silence, or on another map, the steps begin from where the chair is."""
        self._plan = self._planning = None
        self._vain = _Vain()

    def step(self, now: GuideInputs) -> GuideWord | None:
        """Return the guidance of a tick; None while there is no goal or no plan yet."""
        self.learner.note_motion(now.now_ns, now.twist)
        if self.goal is None or self._planned is None:
            return None
        if self._plan is None and self._planning is None:
            if not self.waits or self._vain.may_ask(now.now_ns):
                self._vain = replace(self._vain, asked_ns=now.now_ns)
                self._ask(now.pose)
        elif self._planning is None and self._planned.ground.grows and now.now_ns - self._looked_ns > LOOK_NS:
            self._looked_ns = now.now_ns
            self._look(now.pose)
        self._take_plan(now.now_ns)
        if self._plan is None:
            return None
        self._before = self._memory
        if self.waits and self._vain.barred:
            guidance = GuideWord(None, self._plan.steps[max(self._memory.step, 0)], self.waits)
        else:
            guidance, self._memory = self._guide.step(self._plan, self._memory, now)
        if guidance.arrived:
            self.end("arrived")
            self.arrived = True
        elif (
            (guidance.astray or self.waits)  # the steps that there are may lead to where others begin
            and self._planning is None
            and self._vain.may_ask(now.now_ns)
        ):
            self._ask_anew(guidance, now)
        if guidance.astray or self.waits:  # nothing is asked for: the rider may back away from what is in the way
            guidance = replace(guidance, hold=replace(guidance.hold, rear=1.0))
        return guidance

    def lead_s(self, symbol: Symbol) -> float:
        """Return the time [s] from sending a symbol until this rider obeys."""
        return self._guide.lead(symbol)

    def note_said(self, advice: Advice, now_ns: int, moving: Twist) -> None:
        """Note that the guide's advice of this tick reaches the rider: its effect is watched."""
        self.learner.note_said(advice.symbol, now_ns, self._durations[advice.symbol], moving)

    def note_unsaid(self) -> None:
        """Note that the guide's advice of this tick was not said: nobody will obey it."""
        before = self._before
        self._memory = replace(self._memory, said=before.said, said_ns=before.said_ns, nudges=before.nudges)

    def again(self, now: GuideInputs) -> Advice | None:
        """Return the advice that holds now, at the rider's wish; None if nothing was said. A nudge is never given twice."""
        memory = self._memory
        if self._plan is None or memory.said is None or (self.waits and self._vain.barred):
            return None
        symbol = {
            LeadingPhase.GO: Symbol.FORWARD,
            LeadingPhase.BACK: Symbol.BACK,
            LeadingPhase.DONE: Symbol.ARRIVED,
        }.get(memory.phase)
        if symbol is None:
            left = memory.said is Symbol.SWIVEL_LEFT or (
                memory.said is not Symbol.SWIVEL_RIGHT and wrap_angle(memory.heading - now.pose.theta) > 0.0
            )
            symbol = Symbol.SWIVEL_LEFT if left else Symbol.SWIVEL_RIGHT
        number = memory.number + 1
        said = memory.said if memory.said in NUDGES and symbol is Symbol.FORWARD else symbol
        self._memory = replace(
            memory,
            number=number,
            said=said,
            said_ns=now.now_ns,
            nudges=self._before.nudges,  # without one that the guide would have given in this tick
            ignored=0,
            quiet_ns=now.now_ns,
        )
        return Advice(symbol, number, now.now_ns + VALID_NS, reason=self.step_words)

    @property
    def plan(self) -> StepPlan | None:
        """The present steps; None while there are none."""
        return self._plan

    @property
    def step_words(self) -> str:
        """The present step in words; empty without one."""
        plan, index = self._plan, self._memory.step
        return "" if plan is None or index < 0 else plan.steps[index].words()

    @property
    def waits(self) -> str:
        """Why the rider waits: other steps are wanted, and there are none now; empty while the steps lead on."""
        return self._vain.why

    @property
    def led_on(self) -> str:
        """What held the chair before the present steps were made; empty where nothing did."""
        return self._vain.led_on

    @property
    def _guide(self) -> StepGuide:
        return StepGuide(self._body, self.learner.model, self._durations)

    def _ask_anew(self, guidance: GuideWord, now: GuideInputs) -> None:
        """Ask for steps from here, unless that has led nowhere for too often."""
        vain = self._vain  # a wish that was refused made no plan
        again = vain.plans if vain.why else 0 if self._memory.step > 0 else vain.plans + 1
        blocked = guidance.reason if guidance.blocked else vain.blocked if vain.why else ""
        self._vain = replace(vain, plans=again, asked_ns=now.now_ns, blocked=blocked, led_on="")
        if again > REPLANS:
            self.end(
                f"{guidance.reason}: the steps do not lead on from here; choose the place again, or let the chair drive"
            )
            return
        self._ask(now.pose)

    def _look(self, pose: Pose2) -> None:
        """Ask for other steps if the way of those ahead is no longer free."""
        present = self._plan
        assert present is not None
        ahead = present.steps[max(self._memory.step, 0) :]
        self._ask(pose, lambda costmap: present if ClearGround(costmap).is_free_from(ahead, pose) else None)

    def _ask(self, pose: Pose2, or_else: Callable[[Costmap], StepPlan | None] = lambda _: None) -> None:
        """Ask for steps from here, unless `or_else` has some that are good still."""
        assert self._planned is not None  # there is a goal
        planner, ground, known = self._planned.planner, self._planned.ground, self.waits
        work = ground.now()
        # asked once: a rider who waits knows the cause, and that there are steps on the map alone
        on_map = ground.mapped() if self._plan is None and ground.mapped is not None and not known else None
        find_why = ground.why() if ground.why is not None and not known else None

        def plan() -> StepPlan:
            costmap = work()
            try:
                return or_else(costmap) or planner.replan(costmap, pose)
            except PlanningError as error:
                if on_map is not None:
                    StepPlanner(planner.goal, planner.pose).replan(on_map(), pose)
                why = known or str(error) if find_why is None else find_why(error, pose, planner.pose)
                raise _Refused(why, barred=isinstance(error, NoPath), mapped=on_map is not None) from error

        if self._worker is not None:
            self._planning = self._worker.submit(plan)
            return
        self._planning = Future()
        try:
            self._planning.set_result(plan())
        except PlanningError as error:
            self._planning.set_exception(error)

    def _take_plan(self, now_ns: int) -> None:
        if self._planning is None or not self._planning.done():
            return
        planning, self._planning = self._planning, None
        try:
            plan = planning.result()
        except PlanningError as error:
            vain, why = self._vain, str(error)
            barred, mapped = (error.barred, error.mapped) if isinstance(error, _Refused) else (False, False)
            self._vain = replace(vain, why=why, barred=barred, since_ns=vain.since_ns if vain.why else now_ns)
            never = self._plan is None and not mapped and not vain.why
            if never or now_ns - self._vain.since_ns >= REFUSED_NS:
                self.end(why)
            elif self._plan is not None:  # no steps lead on from here; the old ones may, from a little elsewhere
                self._memory = replace(self._memory, tries=0, shuffles=0)
            return
        blocked, waited = self._vain.blocked, self.waits
        self._vain = replace(self._vain, why="", barred=False, blocked="")
        if plan is self._plan:  # it was looked at, and is good still
            if waited:  # the chair stood because of that
                self._memory = replace(self._memory, still_ns=None)
            return
        self._vain = replace(self._vain, led_on=blocked)
        memory, self._plan = self._memory, plan
        self._memory = GuideState(number=memory.number, said=memory.said, said_ns=memory.said_ns)
