"""The navigator: plans a path on the map, follows it, replans on change and reports arrival, one call per tick.

The loop is the source paper's Fig. 4. The plan is made in map, but motion is computed in odom, which never jumps: the
plan's legs are expressed in odom anew at every tick. A tick never raises: every failure becomes a stop with a reason.
The navigator decides where to go; the supervisor decides whether the computer drives.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from waychair.calibration.chair_body import BodyLayer, ChairBody
from waychair.control.drive.bystanders import Bystanders
from waychair.control.drive.goals import is_missed, limits_to, posed
from waychair.control.drive.leg_drive import LegDrive, View
from waychair.control.drive.local_obstacles import Surroundings, have_mostly_moved, without_mixed_pixels
from waychair.control.drive.navigation import ACTIVE, Navigation, Stage
from waychair.control.drive.navigator_settings import NavigatorSettings
from waychair.control.drive.navigator_state import (
    CORNER_TOLERANCE,
    LONGEST_FIELD_S,
    LONGEST_PLAN_S,
    LOOK_AHEAD,
    PATH_HYSTERESIS_S,
    REPLAN_PERIOD_S,
    RESTED_TICKS,
    MotionState,
    PlanState,
)
from waychair.control.drive.pose_corrections import Corrections
from waychair.control.drive.recovery import Recovery
from waychair.errors import GoalOccupied, NotConverged, WaychairError
from waychair.geometry import transform_points
from waychair.maps.drawn.zones import Zone
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.grid.costmap import Costmap
from waychair.planning.grid.drawn_map import DrawnMap
from waychair.planning.grid.fine_distances import fine_field
from waychair.planning.grid.resumable import Resumable
from waychair.planning.route.global_planner import SPACING, GlobalPlanner, check_goal
from waychair.planning.route.leaving_a_wall import BY_HAND, reason_for_cramped
from waychair.planning.route.legs import DrivingManner
from waychair.planning.seen.forecast import arrival
from waychair.planning.warm_up import warm_up
from waychair.planning.window.dwa import DwaResult
from waychair.planning.window.motion_limits import CommandedMotion, braking, crawling, stopping
from waychair.types import (
    BoolArray,
    FloatArray,
    Goal,
    OccupancyGrid,
    Path,
    Place,
    Pose2,
    RgbdFrame,
    SonarReadings,
    Twist,
)

__all__ = ["Navigation", "Navigator", "NavigatorSettings", "Stage"]

_UNKNOWN_POSE = "the chair does not know where it is; drive it by joystick to a place that it knows"

_SLICES_STANDING = 3
"""Steps of planning done in one tick while the chair stands because it has no path."""


class Navigator:
    """Drives to one goal after the other on a known map."""

    def __init__(
        self,
        grid: OccupancyGrid,
        places: Mapping[str, Place],
        body: ChairBody,
        settings: NavigatorSettings | None = None,
        zones: Sequence[Zone] = (),
    ) -> None:
        warm_up()
        self.settings = s = settings or NavigatorSettings()
        self._drawn = DrawnMap(grid, body, zones, self.settings.clearance.comfortable)
        self._places = places
        self._body = body
        self._surroundings = Surroundings(self._drawn, body, self.settings.surroundings)
        self.recovery = Recovery(self.settings.recovery)
        self._people = Bystanders(body, s.tracks.model, s.personal_space, s.dwa.clearance)
        self._among_people = False
        self._stage, self._reason = Stage.IDLE, "no goal"
        self._goals: list[Goal] = []
        self._dwa = self.settings.dwa
        self._plan, self._now = PlanState(), MotionState()
        self._corrections = Corrections()

    @property
    def active(self) -> bool:
        """Whether there is a goal still to reach."""
        return self._stage in ACTIVE

    @property
    def stage(self) -> Stage:
        """How far the drive has come."""
        return self._stage

    @property
    def reason(self) -> str:
        """The reason for waiting, or for the last drive's end."""
        return self._reason

    def go(self, goal: Goal, *further: Goal) -> None:
        """Replace the present goals by a goal and the goals to go to after it.

        Raises:
            UnknownPlace: a goal is a name that is not among the places.
            GoalTooExact: a goal's tolerances are closer than a chair can stop. After an error the present goals stay.
        """
        self._goals = [posed(each, self._places) for each in (goal, *further)]
        self._begin(self._goals[0])

    def redraw(self, drawn: DrawnMap, places: Mapping[str, Place]) -> None:
        """Go on with another drawing of the same map and other places; a drive under way is planned anew."""
        self._places = places
        if drawn is self._drawn:
            return
        self._drawn, self._now.local = drawn, None
        self._surroundings.redraw(drawn)
        if self._plan.planner is not None and self.active:
            self._plan.start(GlobalPlanner(self._plan.planner.goal, self.settings.planner))

    def is_mapped(self, points: FloatArray, within: float) -> BoolArray:
        """Return a mask (N,) of points (N, 2) [m] in map that lie within `within` [m] of an obstacle of the map."""
        return self._drawn.is_mapped(points, within)

    @property
    def people(self) -> FloatArray:
        """Positions (K, 2) [m] in odom of people that walk or have walked."""
        return self._people.positions

    @property
    def local_distances(self) -> DistanceField:
        """The distances to obstacles round the chair, in map, computed at the first request after a scan."""
        self._now.local = near = self._now.local or self._surroundings.window(self._now.pose)
        return near

    def pause(self) -> None:
        """Stop and stand until `resume`."""
        if self.active:
            self._stage, self._reason, self._plan.generator = Stage.PAUSED, "paused", None

    def resume(self) -> None:
        """Go on after a pause, by a new plan."""
        if self._stage is Stage.PAUSED:
            self._stage, self._reason, self._plan.made_ns = Stage.DRIVING, "", None
            self.recovery.reset()

    def cancel(self, reason: str) -> None:
        """Give the goals up for good."""
        if self.active:
            self._stage, self._reason, self._goals = Stage.FAILED, reason, []

    def commanded(self, twist: Twist) -> None:
        """Take the twist that was sent for the last command; the next dynamic window is centred on it."""
        self._now.command = twist

    def at_rest(self) -> None:
        """Start the next command from standstill, because the lines were released."""
        self._now.command, self._now.motion = Twist(), CommandedMotion()

    def hear(self, readings: SonarReadings, pose: Pose2) -> None:
        """Take in the sonars' readings at map_from_base."""
        self._surroundings.hear(readings, pose)

    def look(self, frame: RgbdFrame, pose: Pose2, level_from_base: FloatArray | None = None) -> None:
        """Take in a depth image at map_from_base, with the chair's lean (3, 3) if it is known."""
        self._surroundings.look(frame, pose, level_from_base)

    def step(
        self,
        now_ns: int,
        pose: Pose2,
        obstacles: FloatArray | None,
        map_from_odom: Pose2 | None = None,
        beyond: FloatArray | None = None,
        seen_ns: int | None = None,
    ) -> Navigation:
        """Do one tick from map_from_base and, if there was a scan, its obstacle points (N, 2) [m] in map.

        `beyond` (M, 2) [m] in map are the ends of free space on the scan's other beams. `seen_ns` is the scan's stamp,
        by default `now_ns`. `map_from_odom` is the localisation's correction of the odometry, by default identity.
        """
        odom_from_map = Pose2() if map_from_odom is None else map_from_odom.inverse()
        if not (np.isfinite(pose.array()).all() and np.isfinite(odom_from_map.array()).all()):
            return self._halt(now_ns, _UNKNOWN_POSE)
        self._now.pose, self._now.map_from_odom = pose, odom_from_map.inverse()
        since_ns, self._now.stepped_ns = now_ns - (self._now.stepped_ns or now_ns), now_ns
        self._now.note_tick(self._dwa)
        if obstacles is not None:
            laser, self._now.local = pose @ self._body.base_from_laser, None
            obstacles = without_mixed_pixels(obstacles, laser)
            self._surroundings.see(now_ns, pose, obstacles, beyond)
            stood_s, seen_ns = self.recovery.standing_s(now_ns), now_ns if seen_ns is None else seen_ns
            self._people.see(
                now_ns=now_ns,
                pose=pose,
                obstacles=obstacles,
                odom_from_map=odom_from_map,
                surroundings=self._surroundings,
                stood_s=stood_s,
                seen_ns=seen_ns,
            )
            self._among_people = self._people.someone_walks_near(odom_from_map @ pose)
        if self._plan.planner is None or not self.active:
            return self._navigation(Twist())
        if self._stage is Stage.PAUSED:
            return self._navigation(stopping(self._now.command, self._dwa, self._now.motion))
        # after a jump of the pose: slow down, and plan anew from the true pose
        self._note_correction(now_ns, pose, odom_from_map)
        if (self._plan.generator is not None or self._needs_plan(now_ns)) and not self._advance_plan(now_ns):
            self.recovery.leave_out_planning(since_ns)
            return self._navigation(braking(self._now.command, self._dwa))
        if self._plan.path is None or not self.active:
            return self._halt(now_ns, self._plan.no_path_reason)
        choice = self._choose(now_ns, pose, self._view(now_ns, pose, obstacles, odom_from_map))
        return self._outcome(now_ns, choice)

    def _begin(self, goal: Goal) -> None:
        assert isinstance(goal.target, Pose2)
        self._plan.start(GlobalPlanner(goal.target, self.settings.planner))
        self._dwa = limits_to(goal, self.settings.dwa)
        self._stage, self._reason = Stage.DRIVING, ""
        self.recovery.reset()

    def _view(self, now_ns: int, pose: Pose2, obstacles: FloatArray | None, odom_from_map: Pose2) -> View:
        """Return the input of the present leg's drive, in odom."""
        return View(
            pose=odom_from_map @ pose,
            command=self._now.command,
            local=lambda: self.local_distances.seen_from(odom_from_map),  # computed only if the leg needs it
            odom_from_map=odom_from_map,
            seen=None if obstacles is None else transform_points(odom_from_map, obstacles),
            unscanned=transform_points(odom_from_map, self._surroundings.unscanned()),
            motion=None if self._now.jumping else self._now.motion,  # after a jump, braking is not limited for comfort
            tracks=self._people.predicted(now_ns, odom_from_map @ pose),
            has_sonars=self._surroundings.has_sonars,
            layered=tuple(
                (layer, transform_points(odom_from_map, seen)) for layer, seen in self._surroundings.in_narrow_layers()
            ),
        )

    def _choose(self, now_ns: int, pose: Pose2, view: View) -> DwaResult:
        """Follow the path; if that has been impossible for a while, first back out along the chair's trail."""
        tries, backed = self.recovery.tries, self.recovery.backing
        behind = self._people.someone_behind(now_ns, view.pose)
        backing = self.recovery.step(
            now_ns=now_ns,
            pose=view.pose,
            remaining=self._remaining(pose),
            command=self._now.command,
            local=view.local,
            body=self._body,
            settings=self._dwa,
            waits=behind or self._people.someone_passes_near(view.pose),
        )
        if backing is not None:
            return backing
        if backed:  # the old path does not start here
            self._plan.drop_path("backed out")
            self._plan.made_ns = None
            stop = braking(self._now.command, self._dwa)
            return DwaResult(stop, np.zeros((0, 2)), np.zeros(0), view.pose.array()[None])
        if self.recovery.tries > tries:  # backing out was impossible, too
            self._plan.made_ns = None
        choice = self._follow(view, behind)
        if choice.arrived and len(self._plan.legs) > 1:  # stopped and turned: go on with the next leg
            self._plan.legs, self._plan.leg = self._plan.legs[1:], None
            choice = self._follow(view, behind)
        return replace(choice, arrived=choice.arrived and len(self._plan.legs) == 1)

    def _follow(self, view: View, behind: bool) -> DwaResult:
        """Return the next command on the present leg, never backwards if somebody may be `behind`."""
        if self._plan.leg is None:
            self._plan.leg = LegDrive(self._plan.legs, self._drawn.grid, self._body)
        limits = crawling(self._dwa) if self._now.jumping else self._dwa
        if behind:
            limits = replace(limits, max_reverse=0.0)
        if len(self._plan.legs) > 1:
            corner = replace(limits.tolerances, position=CORNER_TOLERANCE)
            limits = replace(limits, tolerances=corner)
        return self._plan.leg.step(view, limits)

    def _remaining(self, pose: Pose2) -> float | None:
        """Return the distance [m] to the goal, None while the chair turns at the end of a leg."""
        leg = self._plan.leg or LegDrive(self._plan.legs, self._drawn.grid, self._body)
        here = leg.remaining(pose)
        return None if here is None else here + sum(leg.path.length() for leg in self._plan.legs[1:])

    def _why_given_up(self) -> str:
        body, here = self._body, self._now.pose
        field = fine_field(self._drawn.grid, here, body.circumscribed_radius + 0.3, self._surroundings.stationary()[0])
        if (why := reason_for_cramped(field, body, here)) is not None:
            return f"{why}: {BY_HAND}"
        tries = self.settings.recovery.tries
        return f"no way through after {tries} tries: clear the way or choose another goal"

    def _outcome(self, now_ns: int, choice: DwaResult) -> Navigation:
        """Return the tick's output from a choice: reached, given up, waiting or driving."""
        if self.recovery.exhausted:
            self.cancel(self._why_given_up())
            return self._navigation(braking(self._now.command, self._dwa), choice)
        if (
            choice.arrived
            and self._plan.leg is not None
            and self._plan.leg.leg.manner is not DrivingManner.FREE
            and is_missed(self._goals[0], self._now.pose)
        ):
            self._plan.made_ns, choice = None, replace(choice, arrived=False)
        if choice.arrived:
            self._goals = self._goals[1:]
            if self._goals:
                self._begin(self._goals[0])
            else:
                self._stage, self._reason = Stage.ARRIVED, "arrived"
            return self._navigation(Twist(), choice)
        if choice.blocked:
            leg = self._plan.leg
            if self._plan.planner is not None and leg is not None and leg.refused_door is not None:
                self._plan.planner.distrust(leg.refused_door)
                self._plan.made_ns = None
            return self._halt(now_ns, "something is in the way", choice)
        self.recovery.note_motion()
        self._stage, self._reason = Stage.DRIVING, ""
        return self._navigation(choice.twist, choice)

    def _navigation(self, twist: Twist, choice: DwaResult | None = None) -> Navigation:
        self._now.command = twist
        leg = self._plan.legs[0] if self._plan.legs and self.active else None
        return Navigation(
            stage=self._stage,
            twist=twist,
            reason=self._reason,
            path=self._plan.path,
            plans=self._plan.count,
            choice=choice,
            leg=leg,
            goals=len(self._goals),
        )

    def _halt(self, now_ns: int, why: str, choice: DwaResult | None = None) -> Navigation:
        """Brake and wait; give up when the patience is over."""
        if self.active:
            waited = self.recovery.note_standstill(now_ns)
            self._stage, self._reason = Stage.WAITING, f"{why}; waiting"
            s = self.settings.recovery
            if waited > (s.patience_with_people if self._among_people else s.patience):
                what, _, advice = why.partition("; ")
                self.cancel(f"{what}, for {waited:.0f} s: {advice or 'clear the way or choose another goal'}")
        return self._navigation(braking(self._now.command, self._dwa) if choice is None else choice.twist, choice)

    def _note_correction(self, now_ns: int, pose: Pose2, odom_from_map: Pose2) -> None:
        """Note whether the localised pose is jumping; when that begins or ends, the plan is void.

        A chair past a door's last gate keeps its plan, because it follows the jambs that it sees.
        """
        jumping = self._corrections.jumping(now_ns, pose, odom_from_map)
        if jumping != self._now.jumping and not (self._plan.leg is not None and self._plan.leg.entered):
            self._plan.made_ns = None
        self._now.jumping = jumping

    def _needs_plan(self, now_ns: int) -> bool:
        if self._plan.made_ns is None:
            return True
        if now_ns - self._plan.made_ns < REPLAN_PERIOD_S * 1e9:
            return False
        if self._plan.leg is not None and self._plan.leg.entered and self._plan.path is not None:
            return False
        if self._plan.path is None or self._stage is Stage.WAITING:
            return True
        if not self._plan.among_people and self._people.expected_people(self._now.map_from_odom).tracks:
            return True
        rest = self._plan.rest(self._now.pose)
        if rest is None:
            return True
        ahead = rest[: math.ceil(LOOK_AHEAD / SPACING)]
        in_odom, half = transform_points(self._now.map_from_odom.inverse(), ahead), self._body.width / 2
        radius = self.settings.tracks.model.radius
        return self._surroundings.stands_near(ahead, half) or self._people.someone_lingers_near(in_odom, half + radius)

    def _advance_plan(self, now_ns: int) -> bool:
        """Plan, or go on planning; return whether to drive on. A plan that takes longer than a tick needs standstill.

        A plan that holds from any pose does not: meanwhile the chair follows its old path, if it has one.
        """
        if self._plan.stops:
            if self._now.rested_ticks < RESTED_TICKS:
                return False
            self._plan.generator, self._plan.stops, self._plan.stands = None, False, True
        lasts_s = 0.0 if self._plan.generator is None else (now_ns - (self._plan.made_ns or now_ns)) * 1e-9
        if lasts_s > LONGEST_PLAN_S and have_mostly_moved(self._plan.obstacles, self._surroundings.stationary()[0]):
            self._plan.generator = None  # the obstacles that it avoids are gone, so it is worthless
        if self._plan.generator is None:
            may_stay = self._plan.made_ns is not None and self._plan.among_people
            self._plan.made_ns, self._plan.generator = now_ns, self._make_plan(now_ns, may_stay)
        drives = self._plan.path is not None and not self._plan.stands
        for done, _ in enumerate(self._plan.generator, 1):
            if self._plan.planner is None or not self._plan.planner.valid_from_anywhere:
                self._plan.stops = self._now.rested_ticks < RESTED_TICKS
                return False
            if drives or done == _SLICES_STANDING:
                return drives
        self._plan.generator, self._plan.stands = None, False
        return True

    def _make_plan(self, now_ns: int, may_stay: bool) -> Resumable[None]:
        """Plan a new path over the map and the present obstacles, in slices; while there is none, the chair waits.

        If a potential field is not found in time, the old path is kept. Among people the old path is also kept if it
        `may_stay`, unless another one arrives much sooner: a chair that keeps changing its path is in everybody's way.
        """
        assert self._plan.planner is not None
        upright, layered = self._surroundings.stationary()
        self._plan.obstacles = upright
        foreseen = self._people.expected_people(self._now.map_from_odom).tracks
        self._plan.among_people = len(foreseen) > 0
        news = len(upright) or any(len(points) for _, points in layered) or foreseen
        path = None
        try:
            if self._plan.count == 0:  # refuse a goal that the map alone rules out, instead of waiting
                costmap = self._drawn.costmap()
                check_goal(costmap, self._body, self._plan.planner.goal)
                path = yield from self._plan.planner.replan_resumably(
                    costmap, lambda: self._now.pose, has_time=self._until(now_ns)
                )
        except WaychairError as error:
            self.cancel(str(error))
            return
        try:
            if news or path is None:
                path = yield from self._path_round_obstacles(now_ns, upright, layered)
        except NotConverged as error:
            self._plan.no_path_reason = str(error)
            return
        except WaychairError as error:
            self._plan.drop_path(str(error))
            return
        if may_stay and foreseen and self._is_as_good(path):
            return
        if self._plan.path is None:  # the wait for a path must not count towards backing out
            self.recovery.note_motion()
        legs = list(self._plan.planner.legs)
        self._plan.adopt(path, legs, LegDrive(legs, self._drawn.grid, self._body))

    def _is_as_good(self, path: Path) -> bool:
        """Return whether the rest of the present path is free and arrives not much later than another path."""
        assert self._plan.planner is not None
        rest = self._plan.rest(self._now.pose)
        if rest is None or not self._plan.planner.is_free(rest):
            return False
        people, cruise = self._people.expected_people(self._now.map_from_odom), self.settings.dwa.max_speed
        forecast = self.settings.planner.forecast
        now, then = (arrival(people, points, cruise, forecast)[0] for points in (rest, path.poses[:, :2]))
        return now < then + PATH_HYSTERESIS_S

    def _path_round_obstacles(
        self, now_ns: int, upright: FloatArray, layered: Sequence[tuple[BodyLayer, FloatArray]]
    ) -> Resumable[Path]:
        """Plan a path round the present obstacles; obstacles at a goal that is still far may be gone by then."""
        assert self._plan.planner is not None
        goal = self._plan.planner.goal
        try:
            return (yield from self._path_over(now_ns, self._drawn.costmap(upright, layered)))
        except GoalOccupied:
            if math.hypot(goal.x - self._now.pose.x, goal.y - self._now.pose.y) < self.settings.goal_wait_distance:
                raise
        room = self._body.circumscribed_radius + self.settings.clearance.comfortable
        layered = [(layer, points[np.hypot(*(points - (goal.x, goal.y)).T) > room]) for layer, points in layered]
        upright = upright[np.hypot(*(upright - (goal.x, goal.y)).T) > room]
        return (yield from self._path_over(now_ns, self._drawn.costmap(upright, layered)))

    def _path_over(self, now_ns: int, costmap: Costmap) -> Resumable[Path]:
        """Plan a path over a costmap among walking people."""
        assert self._plan.planner is not None
        people, cruise = self._people.expected_people(self._now.map_from_odom), self.settings.dwa.max_speed
        return self._plan.planner.replan_among_people(
            costmap=costmap,
            start=lambda: self._now.pose,
            people=people,
            cruise=cruise,
            near=self._among_people,
            has_time=self._until(now_ns),
        )

    def _until(self, began_ns: int) -> Callable[[], bool]:
        """Return a function that tells whether there still is time for a field begun at `began_ns`."""
        return lambda: (self._now.stepped_ns or 0) - began_ns < LONGEST_FIELD_S * 1e9
