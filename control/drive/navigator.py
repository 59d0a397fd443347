"""The navigator: plans a path on the map, follows it, replans on change and reports arrival, one call per tick.

The loop is the source paper's Fig. 4. The plan is made in map, but motion is computed in odom, which never jumps: the
plan's legs are expressed in odom anew at every tick. A tick never raises: every failure becomes a stop with a reason.
The navigator decides where to go; the supervisor decides whether the computer drives.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.control.answer_time import AnswerTime
from waychair.control.drive.bystanders import Bystanders
from waychair.control.drive.goals import how_far_off, is_at, is_missed, limits_to, posed
from waychair.control.drive.granted_way import GrantedWay
from waychair.control.drive.leg_drive import LegInput
from waychair.control.drive.local_obstacles import Surroundings, without_mixed_pixels
from waychair.control.drive.navigation import ACTIVE, Navigation, Stage
from waychair.control.drive.navigator_settings import NavigatorSettings
from waychair.control.drive.navigator_state import (
    CORNER_TOLERANCE,
    DETOUR_TOLD_S,
    LONGEST_SEARCH_S,
    MOST_APPROACHES,
    RESTED_TICKS,
    TOLD_AFTER_S,
    GearChanges,
    MotionState,
    PlanState,
)
from waychair.control.drive.path_making import PathMaker, or_another_goal
from waychair.control.drive.planning import Planning
from waychair.control.drive.recovery import Recovery
from waychair.control.drive.straying import Straying
from waychair.control.drive.way_follower import HEADING_TOLERANCE, SCAN_NOISE
from waychair.geometry import transform_points
from waychair.maps.depth.ground import GroundView
from waychair.maps.drawn.zones import Zone
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.grid.drawn_map import DrawnMap
from waychair.planning.grid.fine_distances import fine_field
from waychair.planning.route.global_planner import GlobalPlanner
from waychair.planning.route.leaving_a_wall import BY_HAND, reason_for_cramped
from waychair.planning.route.legs import PathLeg
from waychair.planning.route.rooms import prepare_outlines
from waychair.planning.warm_up import warm_up
from waychair.planning.window.dwa import DwaResult
from waychair.planning.window.motion_limits import PERIOD, CommandedMotion, DwaSettings, braking, crawling, stopping
from waychair.types import (
    BoolArray,
    FloatArray,
    Goal,
    OccupancyGrid,
    Place,
    Pose2,
    RgbdFrame,
    SonarReadings,
    Twist,
)

__all__ = ["Navigation", "Navigator", "NavigatorSettings", "Stage"]

_UNKNOWN_POSE = "the chair does not know where it is; drive it by joystick to a place that it knows"


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
        drawn = DrawnMap(grid, body, zones, self.settings.clearance.comfortable)
        prepare_outlines(body, grid, (-SCAN_NOISE,))
        self._places = places
        self._body = body
        self._goals: list[Goal] = []
        self._stage, self._reason = Stage.IDLE, "no goal"
        self._dwa = s.dwa
        self._surroundings = Surroundings(drawn, body, s.surroundings)
        self._people = Bystanders(body, s.tracks.model, s.personal_space, s.dwa.clearance)
        self.recovery = Recovery(s.recovery)
        straying = Straying(body, HEADING_TOLERANCE, AnswerTime(body.track, s.dwa.reaction_time + PERIOD))
        self._plan, self._now = PlanState(), MotionState(straying)
        self._maker = PathMaker(drawn, body, s, self._surroundings, self._people, self._plan, self._now)
        self._planning = Planning(self._maker, self._plan, self._now, self.recovery)
        self.granted = GrantedWay(body, self._plan, self._now)

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
        if drawn is self._maker.drawn:
            return
        self._maker.drawn, self._now.local = drawn, None
        self._surroundings.redraw(drawn)
        if self._plan.planner is not None and self.active:
            self._planning.start(GlobalPlanner(self._plan.planner.goal, self.settings.planner, limits=self._dwa))

    def is_mapped(self, points: FloatArray, within: float) -> BoolArray:
        """Return a mask (N,) of points (N, 2) [m] in map that lie within `within` [m] of an obstacle of the map."""
        return self._maker.drawn.is_mapped(points, within)

    @property
    def grid(self) -> OccupancyGrid:
        """The map with its keep-out zones closed."""
        return self._maker.drawn.grid

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
            self._stage, self._reason = Stage.PAUSED, "paused"
            self._planning.interrupt()

    def resume(self) -> None:
        """Go on after a pause, by a new plan, or by the other way that is offered."""
        if self._plan.other.offer is not None and self._stage is Stage.OFFERING:
            self._plan.other.latest = replace(self._plan.other.offer, taken=True)
            self._plan.ask_anew()
        if self._stage is Stage.PAUSED:
            self._stage, self._reason = Stage.DRIVING, ""
            self._plan.ask_anew()
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

    def look(self, frame: RgbdFrame, pose: Pose2, level_from_base: FloatArray | None = None) -> GroundView:
        """Take in a depth image at map_from_base, with the chair's lean (3, 3) if it is known; return its ground."""
        return self._surroundings.look(frame, pose, level_from_base)

    @property
    def beyond_scans(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Points (N, 2) [m] in map that no scan shows: drop-offs, others, and unmapped things that stood where the lidar does not look
        any more.

        The others are things that only sonars and depth camera show, and the reach of walking people.
        """
        odom_from_map = self._now.map_from_odom.inverse()
        people = transform_points(self._now.map_from_odom, self._people.in_reach(odom_from_map @ self._now.pose))
        seen = self._surroundings
        return seen.missing_floor(), np.concatenate([seen.things_unscanned(), people]), seen.stood()

    def step(
        self,
        now_ns: int,
        pose: Pose2,
        obstacles: FloatArray | None,
        map_from_odom: Pose2 | None = None,
        beyond: FloatArray | None = None,
        seen_ns: int | None = None,
        unconfirmed: bool = False,
    ) -> Navigation:
        """Do one tick from map_from_base and, if there was a scan, its obstacle points (N, 2) [m] in map.

        `beyond` (M, 2) [m] in map are the ends of free space on the scan's other beams. `seen_ns` is the scan's stamp,
        by default `now_ns`. `map_from_odom` is the localisation's correction of the odometry, by default identity.
        `unconfirmed`: the goal waits for the rider's yes; a chair that stands there has not arrived yet.
        """
        self._plan.unconfirmed = unconfirmed
        odom_from_map = Pose2() if map_from_odom is None else map_from_odom.inverse()
        if not (np.isfinite(pose.array()).all() and np.isfinite(odom_from_map.array()).all()):
            return self._halt(now_ns, _UNKNOWN_POSE)
        view = self._perceive(now_ns, pose, obstacles, odom_from_map, beyond, now_ns if seen_ns is None else seen_ns)
        standing = self._without_a_drive() or self._at_goal() or self._plan_ahead(now_ns)
        if standing is not None:
            return standing
        view = replace(view, fastest=self.granted.fastest(self._dwa))  # of the leg that was chosen just now
        behind = self._people.someone_behind(now_ns, view.pose)
        choice = self._back_out(now_ns, view, behind) or self._follow(view, behind)
        return self._report(now_ns, choice)

    def _perceive(
        self,
        now_ns: int,
        pose: Pose2,
        obstacles: FloatArray | None,
        odom_from_map: Pose2,
        beyond: FloatArray | None,
        seen_ns: int,
    ) -> LegInput:
        """Take in a tick's pose and scan; return them, and all that is remembered, in odom."""
        now = self._now
        now.pose, now.map_from_odom = pose, odom_from_map.inverse()
        now.note_tick(now_ns, self._dwa)
        odom_from_base = odom_from_map @ pose
        now.note_place(now_ns, odom_from_base)
        if obstacles is not None:
            now.local = None
            obstacles = without_mixed_pixels(obstacles, pose @ self._body.base_from_laser)
            self._surroundings.see(now_ns, pose, obstacles, beyond)
            self._people.see(
                now_ns=now_ns,
                pose=pose,
                obstacles=obstacles,
                odom_from_map=odom_from_map,
                surroundings=self._surroundings,
                stood_s=self.recovery.standing_s(now_ns),
                seen_ns=seen_ns,
                beyond=beyond,
            )
        if self.active and self._stage is not Stage.PAUSED:
            self._planning.note_pose(now_ns, pose, odom_from_map)
        return LegInput(
            pose=odom_from_base,
            answered=now.straying.answered(now.command, odom_from_base),
            command=now.command,
            local=lambda: self.local_distances.seen_from(odom_from_map),  # computed only if the leg needs it
            odom_from_map=odom_from_map,
            seen=None if obstacles is None else transform_points(odom_from_map, obstacles),
            unscanned=transform_points(odom_from_map, self._surroundings.unscanned()),
            motion=None if now.jumping else now.motion,  # after a jump, braking is not limited for comfort
            tracks=self._people.predicted(now_ns, odom_from_base),
            has_sonars=self._surroundings.has_sonars,
            layered=tuple(
                (layer, transform_points(odom_from_map, seen)) for layer, seen in self._surroundings.in_narrow_layers()
            ),
        )

    def _begin(self, goal: Goal) -> None:
        assert isinstance(goal.target, Pose2)
        self._people.waiting = goal.waiting
        self._dwa, self._now.gears = limits_to(goal, self.settings.dwa), GearChanges()
        self._planning.start(GlobalPlanner(goal.target, self.settings.planner, limits=self._dwa))
        self._stage, self._reason = Stage.DRIVING, ""
        self.recovery.reset()

    def _without_a_drive(self) -> Navigation | None:
        """Return the output of a chair that has no goal or is paused."""
        if self._plan.planner is None or not self.active:
            return self._navigation(Twist())
        if self._stage is Stage.PAUSED:
            return self._navigation(stopping(self._now.command, self._dwa, self._now.motion))
        return None

    def _at_goal(self) -> Navigation | None:
        """Return the output of a chair that stands at its goal, however it came there."""
        begins = self._plan.path is None and self._now.rested_ticks >= RESTED_TICKS
        if (begins or self._now.stands_for(TOLD_AFTER_S)) and is_at(self._goals[0], self._now.pose):
            return self._navigation(Twist()) if self._plan.unconfirmed else self._reached()
        return None

    def _plan_ahead(self, now_ns: int) -> Navigation | None:
        """Plan in this tick's share of time; return the output of a chair that has no plan to follow now."""
        waits = self._stage in (Stage.WAITING, Stage.OFFERING)
        if not self._planning.keep_up(now_ns, self._goals[0], waits):
            self.recovery.leave_out_planning(self._now.since_ns)
            self._say_at_rest(f"the chair looks for a way, for up to {LONGEST_SEARCH_S:.0f} s")
            return self._navigation(braking(self._now.command, self._dwa))
        if self._plan.refusal:
            self.cancel(self._plan.refusal)
        if self._plan.other.offer is not None and self.active:
            self._stage, self._reason = Stage.OFFERING, self._plan.other.offer.text
            self.recovery.leave_out_planning(self._now.since_ns)
            return self._navigation(braking(self._now.command, self._dwa))
        if self._plan.path is None or not self.active:
            return self._halt(now_ns, self._plan.no_path_reason)
        if self.recovery.rests(now_ns):
            return self._halt(now_ns, self._maker.what_bars("the chair does not get on here"))
        if self.granted.holds:  # a wait for other chairs is no failure to get on
            self.recovery.leave_out_planning(self._now.since_ns)
        return None

    def _back_out(self, now_ns: int, view: LegInput, behind: bool) -> DwaResult | None:
        """Return a command out along the chair's trail, once following the path has been impossible for a while."""
        tries, backed = self.recovery.tries, self.recovery.backing
        backing = self.recovery.step(
            now_ns=now_ns,
            pose=view.pose,
            remaining=self._remaining(self._now.pose),
            command=view.command,
            local=view.local,
            body=self._body,
            settings=self._dwa,
            waits=behind or self._people.someone_passes_near(view.pose),
            may_back=not self._now.gears.are_enough,
        )
        stop = braking(view.command, self._dwa)
        if backing is not None and self.recovery.repeats:  # it has not helped before
            return replace(backing, twist=stop, blocked=True)
        if backing is not None:
            return backing
        if backed:  # the old path does not start here
            self._plan.drop_path("backed out")
            self._plan.ask_anew()
            return DwaResult(stop, np.zeros((0, 2)), np.zeros(0), view.pose.array()[None])
        if self.recovery.tries > tries:  # backing out was impossible, too
            self._plan.ask_anew()
        return None

    def _follow(self, view: LegInput, behind: bool) -> DwaResult:
        """Return the next command on the present leg, or on the next one where the chair has stopped and turned."""
        choice = self._on_leg(view, behind)
        if choice.arrived and len(self._plan.legs) > 1:
            self._plan.legs, self._plan.leg = self._plan.legs[1:], None
            choice = self._on_leg(view, behind)
        return replace(choice, arrived=choice.arrived and len(self._plan.legs) == 1)

    def _on_leg(self, view: LegInput, behind: bool) -> DwaResult:
        """Return the next command on the present leg."""
        self._plan.leg = self._plan.leg or self._maker.drive_of(self._plan.legs[0])
        return self._plan.leg.step(view, self._limits_on(self._plan.leg.leg, behind))

    def _limits_on(self, leg: PathLeg, behind: bool) -> DwaSettings:
        """Return the limits on a leg: slow after a jump of the pose, and never backwards if somebody may be `behind`.

        Nor backwards after several changes of gear in a row, if the chair could as well wait.
        """
        limits = crawling(self._dwa) if self._now.jumping else self._dwa
        if behind or (self._now.gears.are_enough and self._could_wait(leg)):
            limits = replace(limits, max_reverse=0.0)
        if len(self._plan.legs) > 1:
            corner = replace(limits.tolerances, position=CORNER_TOLERANCE, heading=HEADING_TOLERANCE)
            limits = replace(limits, tolerances=corner)
        return limits

    def _could_wait(self, leg: PathLeg) -> bool:
        """Return whether waiting may help on a leg: one without a line, or a turn in several parts before somebody who may leave."""
        people = len(self._people.tracks) > 0
        return not leg.is_line or (leg.backwards and people and bool(self._maker.what_bars("")))

    def _remaining(self, pose: Pose2) -> float | None:
        """Return the distance [m] to the goal, None while the chair turns at the end of a leg."""
        leg = self._plan.leg or self._maker.drive_of(self._plan.legs[0])
        here = leg.remaining(pose)
        return None if here is None else here + sum(leg.path.length() for leg in self._plan.legs[1:])

    def _why_given_up(self) -> str:
        body, here = self._body, self._now.pose
        field = fine_field(
            self._maker.drawn.grid, here, body.circumscribed_radius + 0.3, self._surroundings.stationary()[0]
        )
        if (why := reason_for_cramped(field, body, here)) is not None:
            return f"{why}: {BY_HAND}"
        tries = self.settings.recovery.tries
        if what := self._maker.what_bars("").partition("; ")[0]:
            return f"{what}, and the chair found no way past it in {tries} tries: ask for room, clear the way or choose another goal"
        return f"no way through after {tries} tries: clear the way or choose another goal"

    def _report(self, now_ns: int, choice: DwaResult) -> Navigation:
        """Return the tick's output from a choice: reached, given up, waiting or driving."""
        if self.recovery.exhausted or self.recovery.repeats:
            if self.recovery.rested_s(now_ns) < self.settings.recovery.patience:
                self.recovery.rest(now_ns, people=len(self._people.tracks) > 0)
                self._plan.ask_anew()
                return self._halt(now_ns, self._maker.what_bars("the chair does not get on here"))
            self.cancel(self._why_given_up())
            return self._navigation(braking(self._now.command, self._dwa), choice)
        leg = self._plan.leg
        if choice.arrived and leg is not None and leg.leg.is_line and is_missed(self._goals[0], self._now.pose):
            self._plan.ask_anew()
            choice = replace(choice, arrived=False)
            self._plan.approaches += 1
            if self._plan.approaches >= MOST_APPROACHES:
                self.cancel(how_far_off(self._goals[0], self._now.pose))
                return self._navigation(braking(self._now.command, self._dwa), choice)
        if choice.arrived and not self._plan.unconfirmed:
            return self._reached(choice)
        if choice.blocked:
            return self._halt(now_ns, self._maker.what_bars("something is in the way"), choice)
        self.recovery.note_motion()
        since_ns, detour = self._plan.other.taken
        self._stage, self._reason = Stage.DRIVING, detour if now_ns - since_ns < DETOUR_TOLD_S * 1e9 else ""
        if self._now.stands_for(TOLD_AFTER_S):
            self._reason = self._why_at_rest(choice.twist != Twist())
        return self._navigation(choice.twist, choice)

    def _reached(self, choice: DwaResult | None = None) -> Navigation:
        """Go on to the next goal, or end the drive."""
        self._goals = self._goals[1:]
        if self._goals:
            self._begin(self._goals[0])
        else:
            self._stage, self._reason = Stage.ARRIVED, "arrived"
        return self._navigation(Twist(), choice)

    def _why_at_rest(self, wants_to_move: bool) -> str:
        """Return for what a chair stands that is not blocked, and for how long."""
        recovery = self.settings.recovery
        if self.granted.holds:
            return self.granted.authority.reason
        if self._people.someone_walks_near(self._now.odom_from_base):
            return f"the chair lets somebody pass, for up to {recovery.patience:.0f} s"
        otherwise = (
            "the chair sets off once nothing holds it back" if wants_to_move else "no motion is free at this moment"
        )
        what = self._maker.what_bars(otherwise).partition("; ")[0]
        return f"{what}; the chair tries otherwise after {recovery.progress_time:.0f} s"

    def _say_at_rest(self, why: str) -> None:
        """Tell for what the chair stands, once it has stood for a while in a drive."""
        if self.active and self._plan.other.offer is None and self._now.stands_for(TOLD_AFTER_S):
            self._reason = why

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
            patience = self.settings.recovery.patience
            self._stage, self._reason = Stage.WAITING, f"{why}; waiting, for up to {patience:.0f} s"
            if waited > patience:
                what, _, advice = why.partition("; ")
                self.cancel(f"{what}, for {waited:.0f} s: {or_another_goal(advice.removeprefix('wait, or '))}")
        return self._navigation(braking(self._now.command, self._dwa) if choice is None else choice.twist, choice)
