"""Making the navigator's path: over the map first, then round the present obstacles, in slices of a tick.

A failed plan is told with its true cause (`planning.route.refused_plans`). A path that became much longer because something
bars the shorter one is told with what it costs. Round a doorway that is shut or taken it is only offered: the chair waits as
long as the other way would cost, unless somebody takes the offer, or the doorway is free before.
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
from waychair.control.drive.navigator_state import (
    LONGEST_FIELD_S,
    LOOK_AHEAD,
    PATH_HYSTERESIS_S,
    MotionState,
    OfferedWay,
    PlanState,
)
from waychair.errors import GoalOccupied, NotConverged, PlanningError, WaychairError
from waychair.geometry import transform_points
from waychair.planning.grid.costmap import Costmap
from waychair.planning.grid.drawn_map import DrawnMap
from waychair.planning.route.global_planner import SPACING, check_goal
from waychair.planning.route.legs import PathLeg, joined_legs
from waychair.planning.route.refused_plans import Obstruction, cause_of, explained, obstruction_on
from waychair.planning.route.way_making import turning_leg
from waychair.planning.seen.forecast import arrival, meets_soon
from waychair.resumable import Resumable
from waychair.types import FloatArray, Goal, Path, Pose2

_TOLD_DETOUR_M = 2.0
"""m; a way round that is longer by this is told, with what bars the shorter one."""

_OFFERED_DETOUR_M, _LEAST_WAIT_S = 3.0, 8.0
"""m, s; a way round a doorway that is longer by the first is offered before it is taken, for at least the second."""

_WAITS_WITHIN, _ONE_DOORWAY = 2.5, 1.0
"""m; the chair drives up to a doorway to this distance before it offers the way round it. Obstacles nearer to each other
than the second are in one doorway, for which the chair waits once."""

_USUAL_SHARE = 0.5
"""Share of the greatest speed that a drive through rooms usually reaches."""

_TOLD_AGAIN_S = 4.0
"""s; the cause of a plan that fails again and again is looked for so often."""

_ROUND = 0.15 * np.array([(math.cos(angle), math.sin(angle)) for angle in np.arange(0.0, math.tau, math.pi / 4)])
"""m; points (8, 2) round the middle of a person that has walked, whose own points the obstacles leave out."""

_LIVE_REACH = 1.5
"""m; up to here the follower of a line judges it by the outline itself."""

_BARRED_WITHIN, _BESIDE = 2.5, 0.15
"""m; obstacles within the first distance of a chair that stands, and no farther beside its body than the second, bar
its path. Where there is none, one up to three times as far beside it does: the drive keeps more room than a plan."""


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

    def make(self, now_ns: int, goal: Goal, may_stay: bool) -> Resumable[None]:
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
        before, path, mapped = plan.rest(self._now.pose), None, None
        try:
            if plan.count == 0:  # refuse a goal that the map alone rules out, instead of waiting
                costmap = self.drawn.costmap()
                check_goal(costmap, self._body, planner.goal, self._now.pose)
                path = yield from planner.replan_resumably(
                    costmap, lambda: self._now.pose, has_time=self._until(now_ns)
                )
                before, mapped = path.poses[:, :2], (path, list(planner.legs))
        except PlanningError as error:
            plan.refusal = str((yield from explained(error, self.drawn, self._now.pose, planner.goal)))
            return
        except WaychairError as error:
            plan.refusal = str(error)
            return
        try:
            if news or path is None:
                path = yield from self._round_obstacles(now_ns, upright, layered)
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
        if self._puts_off(now_ns, before, path.poses[:, :2], _all_points(upright, layered)):
            if mapped is not None and plan.other.offer is None:  # it drives up to the doorway first
                plan.adopt(*mapped, self.drive_of(mapped[1][0]))
            return
        legs = list(planner.legs)
        drive = self.drive_of(legs[0])
        if not drive.can_be_begun(self._now.command, self._settings.dwa):
            planner.valid_from_anywhere = False  # the chair stops, and plans from there
            yield
        plan.adopt(path, legs, drive)

    def drive_of(self, leg: PathLeg) -> LegDrive:
        """Return the drive along a leg, by a chair that strays as it has strayed so far."""
        return LegDrive(leg, self.drawn, self._body, self._now.straying, self._settings.window == "paper")

    def expects_people(self) -> bool:
        """Return whether anybody walks, or may soon walk, near the chair."""
        return bool(self._people.expected_people(self._now.map_from_odom).tracks)

    def meets_people(self, rest: FloatArray) -> bool:
        """Return whether the chair is expected to meet somebody soon on the rest of a path (N, 2) [m] in map."""
        if not self._settings.tracks.model.seeks_way:
            return False
        people = self._people.expected_people(self._now.map_from_odom)
        return meets_soon(people, rest, self._settings.dwa.max_speed, self._settings.planner.forecast)

    def obstacles(self) -> FloatArray:
        """Return the obstacles (N, 2) [m] in map of full height that stand, as the next plan would avoid them."""
        return self._surroundings.stationary()[0]

    def is_barred(self, rest: FloatArray, beyond_live: bool = False) -> bool:
        """Return whether something stands, or somebody lingers, on the next metres of a path (N, 2) [m] in map.

        `beyond_live` leaves out the part near the chair that the follower of a line compares with the live picture.
        """
        if beyond_live:
            rest = rest[np.hypot(*(rest - (self._now.pose.x, self._now.pose.y)).T) > _LIVE_REACH]
        ahead, half = rest[: math.ceil(LOOK_AHEAD / SPACING)], self._body.width / 2
        in_odom = transform_points(self._now.map_from_odom.inverse(), ahead)
        near = half + self._settings.tracks.model.radius
        return self._surroundings.stands_near(ahead, half) or self._people.someone_lingers_near(in_odom, near)

    def what_bars(self, otherwise: str) -> str:
        """Return a sentence on the live obstacle that bars the path, or another one if there is none."""
        rest, pose = self._plan.rest(self._now.pose), self._now.pose
        if rest is None:
            return otherwise
        points = self._seen_points(*self._surroundings.stationary())
        near = points[np.hypot(*(points - (pose.x, pose.y)).T) < _BARRED_WITHIN]
        front = pose @ Pose2(self._body.front)
        ahead = rest[: round(_BARRED_WITHIN / SPACING)]
        tries = ((ahead, _BESIDE), (np.array([[front.x, front.y]]), 3 * _BESIDE), (ahead, 3 * _BESIDE))
        for way, beside in tries:
            found = obstruction_on(way, near, self.drawn, self._body.width / 2 + beside)
            if found is not None:
                return found.text
        return otherwise

    def _seen_points(self, upright: FloatArray, layered: Sequence[tuple[BodyLayer, FloatArray]]) -> FloatArray:
        """Return the points (N, 2) [m] in map of obstacles that stand, and of people that have walked."""
        people = transform_points(self._now.map_from_odom, self._people.positions)
        return np.concatenate([_all_points(upright, layered), (people[:, None] + _ROUND).reshape(-1, 2)])

    def _turns_at(self, goal: Goal, upright: FloatArray, layered: Sequence[tuple[BodyLayer, FloatArray]]) -> bool:
        """Adopt a turn on the spot if the chair is at the goal's place and can turn there; return whether it did."""
        assert isinstance(goal.target, Pose2)
        if not (is_in_place(goal, self._now.pose) and is_missed(goal, self._now.pose)):
            return False
        leg = turning_leg(self.drawn.costmap(upright, layered), self._now.pose, goal.target.theta)
        if leg is None:
            return False
        self._plan.adopt(joined_legs((leg,)), [leg], self.drive_of(leg))
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
        points = self._seen_points(upright, layered)
        return (yield from cause_of(error, self.drawn, self._now.pose, planner.goal, points))

    def _puts_off(self, now_ns: int, before: FloatArray | None, path: FloatArray, points: FloatArray) -> bool:
        """Return whether a path is put off, because it is much longer than the way before and a doorway there may be free soon.

        Note what bars the way before, and by how much the path is longer. `points` (N, 2) [m] in map are live obstacles.
        """
        plan = self._plan
        plan.other.offer = None
        if before is None:
            return False
        longer = float(np.hypot(*np.diff(path, axis=0).T).sum() - np.hypot(*np.diff(before, axis=0).T).sum())
        if longer < _TOLD_DETOUR_M:
            return False
        found = obstruction_on(before, points, self.drawn, self._body.width / 2)
        seconds = longer / max(_USUAL_SHARE * self._settings.dwa.max_speed, 0.05)
        cost, what = f"{longer:.0f} m ({seconds:.0f} s) longer", "the way is barred" if found is None else found.what
        at = None if found is None or longer < _OFFERED_DETOUR_M or not found.in_doorway else found.at
        offer = plan.other.latest
        if at is not None and (offer is None or math.dist(offer.at, at) > _ONE_DOORWAY):
            if math.dist(at, (self._now.pose.x, self._now.pose.y)) > _WAITS_WITHIN:
                return True
            wait_s = min(max(seconds, _LEAST_WAIT_S), self._settings.recovery.patience)
            text = (
                f"{what}: the chair waits for it up to {wait_s:.0f} s, then takes another way, {cost}; "
                "'Go on' takes that way at once"
            )
            offer = OfferedWay(text, at, now_ns, wait_s)
        if at is None or offer is None or offer.is_over(now_ns):
            plan.other.taken = now_ns, f"{what}: the chair takes another way, {cost}"
            return False
        plan.other.offer = plan.other.latest = offer
        return True

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
    ) -> Resumable[Path]:
        """Plan a path round the present obstacles; obstacles at a goal that is still far may be gone by then."""
        assert self._plan.planner is not None
        goal = self._plan.planner.goal
        try:
            return (yield from self._path_over(now_ns, self.drawn.costmap(upright, layered)))
        except GoalOccupied:
            if math.hypot(goal.x - self._now.pose.x, goal.y - self._now.pose.y) < self._settings.goal_wait_distance:
                raise
        room = self._body.circumscribed_radius + self._settings.clearance.comfortable
        layered = [(layer, points[np.hypot(*(points - (goal.x, goal.y)).T) > room]) for layer, points in layered]
        upright = upright[np.hypot(*(upright - (goal.x, goal.y)).T) > room]
        return (yield from self._path_over(now_ns, self.drawn.costmap(upright, layered)))

    def _path_over(self, now_ns: int, costmap: Costmap) -> Resumable[Path]:
        """Plan a path over a costmap among walking people."""
        assert self._plan.planner is not None
        people, cruise = self._people.expected_people(self._now.map_from_odom), self._settings.dwa.max_speed
        return self._plan.planner.replan_among_people(
            costmap=costmap,
            start=lambda: self._now.pose,
            people=people,
            cruise=cruise,
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
