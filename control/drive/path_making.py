"""Making the navigator's path: over the map first, then round the present obstacles, in slices of a tick.

A failed plan is told with its true cause (`planning.route.refused_plans`). A path that became much longer because something
bars the shorter one is told with what it costs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from waychair.calibration.chair_body import BodyLayer, ChairBody
from waychair.control.drive.bystanders import Bystanders
from waychair.control.drive.goals import is_in_place, is_missed
from waychair.control.drive.leg_drive import LegDrive
from waychair.control.drive.local_obstacles import Surroundings
from waychair.control.drive.navigator_settings import NavigatorSettings
from waychair.control.drive.navigator_state import LONGEST_FIELD_S, PATH_HYSTERESIS_S, MotionState, PlanState
from waychair.errors import GoalOccupied, NotConverged, PlanningError, WaychairError
from waychair.planning.grid.costmap import Costmap
from waychair.planning.grid.drawn_map import DrawnMap
from waychair.planning.grid.resumable import Resumable
from waychair.planning.route.direct_leg import turning_leg
from waychair.planning.route.global_planner import SPACING, check_goal
from waychair.planning.route.legs import joined_legs
from waychair.planning.route.refused_plans import Obstruction, Seen, cause_of, explained, obstruction_on
from waychair.planning.seen.forecast import arrival
from waychair.types import FloatArray, Goal, Path, Pose2

_TOLD_DETOUR_M = 2.0
"""m; a way round that is longer by this is told, with what bars the shorter one."""

_TOLD_AGAIN_S = 4.0
"""s; the cause of a plan that fails again and again is looked for so often."""

_BARRED_WITHIN, _BESIDE = 2.5, 0.15
"""m; obstacles within the first distance of a chair that stands, and no farther beside its body than the second, bar
its path."""


class PathMaker:
    """Makes paths for one navigator, whose state it shares."""

    def __init__(
        self,
        drawn: DrawnMap,
        body: ChairBody,
        settings: NavigatorSettings,
        surroundings: Surroundings,
        people: Bystanders,
        plan: PlanState,
        now: MotionState,
    ) -> None:
        self.drawn = drawn
        self._body, self._settings = body, settings
        self._surroundings, self._people = surroundings, people
        self._plan, self._now = plan, now
        self._told: tuple[type[PlanningError], int, str] | None = None  # of the latest failed plan

    def make(self, now_ns: int, goal: Goal, may_stay: bool, near_people: bool) -> Resumable[None]:
        """Plan a new path over the map and the present obstacles, in slices; while there is none, the chair waits.

        If a potential field is not found in time, the old path is kept. Among people the old path is also kept if it
        `may_stay`, unless another one arrives much sooner: a chair that keeps changing its path is in everybody's way.
        A goal that the map alone rules out is refused: see `PlanState.refusal`.
        """
        plan, planner = self._plan, self._plan.planner
        assert planner is not None
        upright, layered = self._surroundings.stationary()
        plan.obstacles = upright
        if self._turns_at(goal, upright, layered):
            return
        foreseen = self._people.expected_people(self._now.map_from_odom).tracks
        plan.among_people = len(foreseen) > 0
        news = len(upright) or any(len(points) for _, points in layered) or foreseen
        before, path = plan.rest(self._now.pose), None
        try:
            if plan.count == 0:  # refuse a goal that the map alone rules out, instead of waiting
                costmap = self.drawn.costmap()
                check_goal(costmap, self._body, planner.goal, self._now.pose)
                path = yield from planner.replan_resumably(
                    costmap, lambda: self._now.pose, has_time=self._until(now_ns)
                )
                before = path.poses[:, :2]
        except PlanningError as error:
            plan.refusal = str((yield from explained(error, self.drawn, self._now.pose, planner.goal)))
            return
        except WaychairError as error:
            plan.refusal = str(error)
            return
        try:
            if news or path is None:
                path = yield from self._round_obstacles(now_ns, upright, layered, near_people)
        except NotConverged as error:
            plan.no_path_reason = str(error)
            return
        except PlanningError as error:
            told = self._told
            plan.drop_path(told[2] if told is not None and told[0] is type(error) else str(error))
            plan.no_path_reason = yield from self._cause_of(now_ns, error, upright, layered)
            return
        except WaychairError as error:
            plan.drop_path(str(error))
            return
        if may_stay and foreseen and self._is_as_good(path):
            return
        self._note_detour(now_ns, before, path.poses[:, :2], upright, layered)
        legs = list(planner.legs)
        plan.adopt(path, legs, LegDrive(legs, self.drawn.grid, self._body))

    def what_bars(self, otherwise: str) -> str:
        """Return a sentence on the live obstacle that bars the path, or another one if there is none."""
        rest, pose = self._plan.rest(self._now.pose), self._now.pose
        if rest is None:
            return otherwise
        upright, layered = self._surroundings.stationary()
        points = _all_points(upright, layered)
        near = points[np.hypot(*(points - (pose.x, pose.y)).T) < _BARRED_WITHIN]
        ahead = rest[: round(_BARRED_WITHIN / SPACING)]
        front = pose @ Pose2(self._body.front)
        found = obstruction_on(ahead, near, self.drawn, self._body.width / 2 + _BESIDE)
        if found is None:
            found = obstruction_on(np.array([[front.x, front.y]]), near, self.drawn, self._body.width / 2 + 3 * _BESIDE)
        return otherwise if found is None else found.text

    def _turns_at(self, goal: Goal, upright: FloatArray, layered: Sequence[tuple[BodyLayer, FloatArray]]) -> bool:
        """Adopt a turn on the spot if the chair is at the goal's place and can turn there; return whether it did."""
        assert isinstance(goal.target, Pose2)
        if not (is_in_place(goal, self._now.pose) and is_missed(goal, self._now.pose)):
            return False
        leg = turning_leg(self.drawn.costmap(upright, layered), self._now.pose, goal.target.theta)
        if leg is None:
            return False
        self._plan.adopt(joined_legs((leg,)), [leg], LegDrive([leg], self.drawn.grid, self._body))
        return True

    def _cause_of(
        self, now_ns: int, error: PlanningError, upright: FloatArray, layered: Sequence[tuple[BodyLayer, FloatArray]]
    ) -> Resumable[str]:
        """Return the cause of a plan that failed among live obstacles; the search for it is not repeated at once."""
        if self._told is not None and self._told[0] is type(error) and now_ns - self._told[1] < _TOLD_AGAIN_S * 1e9:
            return self._told[2]
        found = yield from self._obstruction(error, upright, layered)
        self._told = type(error), now_ns, str(error) if found is None else found.text
        return self._told[2]

    def _obstruction(
        self, error: PlanningError, upright: FloatArray, layered: Sequence[tuple[BodyLayer, FloatArray]]
    ) -> Resumable[Obstruction | None]:
        planner = self._plan.planner
        assert planner is not None
        seen = Seen(_all_points(upright, layered))
        return (yield from cause_of(error, self.drawn, self._now.pose, planner.goal, seen))

    def _note_detour(
        self,
        now_ns: int,
        before: FloatArray | None,
        path: FloatArray,
        upright: FloatArray,
        layered: Sequence[tuple[BodyLayer, FloatArray]],
    ) -> None:
        """Note what bars the way before, if the path is much longer, and by how much."""
        if before is None:
            return
        longer = float(np.hypot(*np.diff(path, axis=0).T).sum() - np.hypot(*np.diff(before, axis=0).T).sum())
        if longer < _TOLD_DETOUR_M:
            return
        found = obstruction_on(before, _all_points(upright, layered), self.drawn, self._body.width / 2)
        what = "the way is barred" if found is None else found.what
        seconds = longer / max(self._settings.dwa.max_speed, 0.05)
        self._plan.detour = now_ns, f"{what}: the chair takes another way, {longer:.0f} m ({seconds:.0f} s) longer"

    def _is_as_good(self, path: Path) -> bool:
        """Return whether the rest of the present path is free and arrives not much later than another path."""
        assert self._plan.planner is not None
        rest = self._plan.rest(self._now.pose)
        if rest is None or not self._plan.planner.is_free(rest):
            return False
        people, cruise = self._people.expected_people(self._now.map_from_odom), self._settings.dwa.max_speed
        forecast = self._settings.planner.forecast
        now, then = (arrival(people, points, cruise, forecast)[0] for points in (rest, path.poses[:, :2]))
        return now < then + PATH_HYSTERESIS_S

    def _round_obstacles(
        self,
        now_ns: int,
        upright: FloatArray,
        layered: Sequence[tuple[BodyLayer, FloatArray]],
        near_people: bool,
    ) -> Resumable[Path]:
        """Plan a path round the present obstacles; obstacles at a goal that is still far may be gone by then."""
        assert self._plan.planner is not None
        goal = self._plan.planner.goal
        try:
            return (yield from self._path_over(now_ns, self.drawn.costmap(upright, layered), near_people))
        except GoalOccupied:
            if math.hypot(goal.x - self._now.pose.x, goal.y - self._now.pose.y) < self._settings.goal_wait_distance:
                raise
        room = self._body.circumscribed_radius + self._settings.clearance.comfortable
        layered = [(layer, points[np.hypot(*(points - (goal.x, goal.y)).T) > room]) for layer, points in layered]
        upright = upright[np.hypot(*(upright - (goal.x, goal.y)).T) > room]
        return (yield from self._path_over(now_ns, self.drawn.costmap(upright, layered), near_people))

    def _path_over(self, now_ns: int, costmap: Costmap, near_people: bool) -> Resumable[Path]:
        """Plan a path over a costmap among walking people."""
        assert self._plan.planner is not None
        people, cruise = self._people.expected_people(self._now.map_from_odom), self._settings.dwa.max_speed
        return self._plan.planner.replan_among_people(
            costmap=costmap,
            start=lambda: self._now.pose,
            people=people,
            cruise=cruise,
            near=near_people,
            has_time=self._until(now_ns),
        )

    def _until(self, began_ns: int) -> Callable[[], bool]:
        """Return a function that tells whether there still is time for a field begun at `began_ns`."""
        return lambda: (self._now.stepped_ns or 0) - began_ns < LONGEST_FIELD_S * 1e9


def _all_points(upright: FloatArray, layered: Sequence[tuple[BodyLayer, FloatArray]]) -> FloatArray:
    """Return the points (N, 2) [m] of obstacles of full height and of those that concern one layer of the body."""
    return np.concatenate([upright, *(points for _, points in layered)])


def or_another_goal(advice: str) -> str:
    """Return the advice for a chair that has waited in vain."""
    if "another goal" in advice:
        return advice
    return f"{advice}, or choose another goal" if advice else "clear the way or choose another goal"
