"""Planning over ticks: when a drive needs a new plan, and the making of it in slices while the chair drives or stands."""

from __future__ import annotations

from waychair.control.drive.local_obstacles import have_mostly_moved
from waychair.control.drive.navigator_state import (
    LONGEST_PLAN_S,
    LONGEST_SEARCH_S,
    REPLAN_PERIOD_S,
    RESTED_TICKS,
    MotionState,
    PlanState,
)
from waychair.control.drive.path_making import PathMaker
from waychair.control.drive.pose_corrections import Corrections
from waychair.control.drive.recovery import Recovery
from waychair.planning.route.global_planner import GlobalPlanner
from waychair.resumable import Resumable
from waychair.types import Goal, Pose2

_SLICES_STANDING, _SLICES_OF_A_TURN = 3, 4
"""Steps of planning done in one tick while the chair stands because it has no path: of a field, and of a search for a
multi-point turn, whose steps are shorter. The tick then takes some 40 of its 50 ms."""


class Planning:
    """The plan of a drive and the one in the making; it shares the navigator's state.

    A plan that holds from any pose is made while the chair follows its old path, if it has one. For another one the
    chair stops, and then stands.
    """

    def __init__(self, maker: PathMaker, plan: PlanState, now: MotionState, recovery: Recovery) -> None:
        self._maker = maker
        self._plan, self._now, self._recovery = plan, now, recovery
        self._making: Resumable[None] | None = None
        self._stops = self._stands = False
        self._corrections = Corrections()

    def start(self, planner: GlobalPlanner) -> None:
        """Start planning to another goal from scratch."""
        self._plan.start(planner)
        self._making, self._stops, self._stands = None, False, False

    def note_pose(self, now_ns: int, pose: Pose2, odom_from_map: Pose2) -> None:
        """Take in a tick's pose; where it begins or ends to jump the plan is void, and one from the true pose is needed."""
        jumping = self._corrections.jumping(now_ns, pose, odom_from_map)
        if jumping != self._now.jumping:
            self._plan.ask_anew()
        self._now.jumping = jumping

    def interrupt(self) -> None:
        """Give up the plan in the making."""
        self._making = None

    def keep_up(self, now_ns: int, goal: Goal, waits: bool) -> bool:
        """Plan, if a plan is due or in the making; return whether the chair may drive on meanwhile.

        `waits`: the drive waits for something. See `PlanState.refusal` for a goal that turns out to be impossible.
        """
        return (self._making is None and not self._is_due(now_ns, waits)) or self._advance(now_ns, goal)

    def _is_due(self, now_ns: int, waits: bool) -> bool:
        plan = self._plan
        if plan.made_ns is None:
            return True
        if now_ns - plan.made_ns < REPLAN_PERIOD_S * 1e9:
            return False
        people = self._maker.expects_people()
        if plan.path is None or waits or (people and not plan.among_people):
            return True
        rest = plan.rest(self._now.pose)
        if rest is None or self._maker.meets_people(rest):
            return True
        if plan.leg is None:
            return self._maker.is_barred(rest)
        if not plan.leg.leg.is_line:
            return not people or self._maker.is_barred(rest)
        return plan.leg.is_barred or self._maker.is_barred(rest, beyond_live=True)

    def _advance(self, now_ns: int, goal: Goal) -> bool:
        """Begin a plan, or go on making it; return whether to drive on."""
        plan, now = self._plan, self._now
        if self._stops:
            if now.rested_ticks < RESTED_TICKS:
                return False
            self._making, self._stops, self._stands = None, False, True
        lasts_s = 0.0 if self._making is None else (now_ns - (plan.made_ns or now_ns)) * 1e-9
        if lasts_s > LONGEST_PLAN_S and have_mostly_moved(plan.obstacles, self._maker.obstacles()):
            self._making = None  # the obstacles that it avoids are gone, so it is worthless
        if self._making is None:
            may_stay = plan.made_ns is not None and plan.among_people
            plan.made_ns = now_ns
            self._making = self._maker.make(now_ns, goal, may_stay)
        had_path, detour = plan.path is not None, plan.other.taken
        drives = had_path and not self._stands
        for done, _ in enumerate(self._making, 1):
            moves_on = plan.planner is not None and plan.planner.valid_from_anywhere
            if moves_on and (drives or done == _SLICES_STANDING):
                return drives
            if not moves_on and (now.rested_ticks < RESTED_TICKS or done == _SLICES_OF_A_TURN):
                self._stops = now.rested_ticks < RESTED_TICKS
                return lasts_s >= LONGEST_SEARCH_S and self._give_search_up()
        self._making, self._stands = None, False
        if not had_path and plan.path is not None:  # the wait for a path must not count towards backing out
            self._recovery.note_motion()
        if plan.other.taken is not detour:
            self._recovery.note_longer_way()
        return True

    def _give_search_up(self) -> bool:
        """Give up a search for multi-point turns that takes too long: a first plan's goal is refused; return True."""
        self._making, self._stands = None, False
        why = f"no way was found within {LONGEST_SEARCH_S:.0f} s, not even with multi-point turns"
        if self._plan.count == 0:
            self._plan.refusal = f"{why}: there is hardly room to turn; clear the way or choose another goal"
        else:
            self._plan.drop_path(why)
        return True
