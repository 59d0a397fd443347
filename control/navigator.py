"""The navigator: the source paper's loop (its Fig. 4), plan, follow, replan on change, reached, one call a tick.

It never raises in a tick: whatever goes wrong becomes a stop and a reason. It decides where to go, never who drives.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.config import Settings, setting
from waychair.control.recovery import Recovery, RecoverySettings
from waychair.control.surroundings import Surroundings, SurroundingsSettings
from waychair.errors import PlanningError
from waychair.maps.distance_field import DistanceField
from waychair.maps.places import find
from waychair.planning.costmap import Costmap, CostmapSettings, costmap_from_grid
from waychair.planning.dwa import DwaResult, DwaSettings, braking, choose
from waychair.planning.global_planner import GlobalPlanner, PlannerSettings, check_goal, legs_of
from waychair.types import FloatArray, Goal, OccupancyGrid, Path, Place, Pose2, Twist


class Stage(enum.Enum):
    """How far the drive to a goal has come."""

    IDLE = "idle"
    DRIVING = "driving"
    WAITING = "waiting"
    ARRIVED = "arrived"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class NavigatorSettings(Settings):
    """When to plan anew, and the parts' own settings."""

    obstacle_range: float = setting(
        6.0, "m", "beams beyond this are no obstacles to care about yet", low=1.0, high=50.0
    )
    look_ahead: float = setting(5.0, "m", "part of the path that must be free", low=0.5, high=50.0)
    off_path: float = setting(0.5, "m", "farther from the path than this: plan anew", low=0.1, high=5.0)
    corner_tolerance: float = setting(0.05, "m", "how exactly it stops to turn before a door", low=0.01, high=0.5)
    replan_period: float = setting(1.0, "s", "shortest time between two plans", low=0.05, high=60.0)
    surroundings: SurroundingsSettings = field(default_factory=SurroundingsSettings)
    recovery: RecoverySettings = field(default_factory=RecoverySettings)
    costmap: CostmapSettings = field(default_factory=CostmapSettings)
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    dwa: DwaSettings = field(default_factory=DwaSettings)


@dataclass(frozen=True, slots=True)
class Navigation:
    """The twist of this tick, the stage, why in a plain sentence, and the path that is followed."""

    stage: Stage
    twist: Twist = field(default_factory=Twist)
    reason: str = ""
    path: Path | None = None
    plans: int = 0
    choice: DwaResult | None = None

    @property
    def driving(self) -> bool:
        """Whether the computer wants the joystick lines, be it to stand still on them."""
        return self.stage in (Stage.DRIVING, Stage.WAITING)


class Navigator:
    """Drives one goal at a time on a known map."""

    def __init__(
        self,
        grid: OccupancyGrid,
        places: Mapping[str, Place],
        body: ChairBody,
        settings: NavigatorSettings | None = None,
    ) -> None:
        self._grid = grid
        self._places = places
        self._body = body
        self._settings = settings or NavigatorSettings()
        self._surroundings = Surroundings(grid, self._settings.surroundings)
        self._recovery = Recovery(self._settings.recovery)
        self._local: DistanceField | None = None
        self._command = Twist()
        self._stage, self._reason = Stage.IDLE, "no goal"
        self._planner: GlobalPlanner | None = None
        self._dwa = self._settings.dwa
        self._path: Path | None = None
        self._legs: list[Path] = []
        self._no_way = ""
        self._planned_ns: int | None = None
        self._plans = 0
        self._in_position = False

    @property
    def active(self) -> bool:
        """Whether there is a goal still to reach."""
        return self._stage in (Stage.DRIVING, Stage.WAITING)

    def go(self, goal: Goal) -> None:
        """Take a goal, in place of the present one.

        Raises:
            UnknownPlace: the goal is a name that is not among the places.
        """
        if isinstance(goal.target, str):
            place = find(self._places, goal.target)
            goal = Goal(place.pose, place.tolerance_m, place.tolerance_rad)
        assert isinstance(goal.target, Pose2)
        self._planner = GlobalPlanner(goal.target, self._settings.planner)
        # what remains of the tolerance is left to the localisation's own error
        self._dwa = replace(
            self._settings.dwa,
            goal_tolerance=min(self._settings.dwa.goal_tolerance, 0.6 * goal.tolerance_m),
            goal_release=min(self._settings.dwa.goal_release, 0.9 * goal.tolerance_m),
            heading_tolerance=min(self._settings.dwa.heading_tolerance, goal.tolerance_rad / 2),
        )
        self._stage, self._reason = Stage.DRIVING, ""
        self._path, self._planned_ns, self._plans, self._in_position = None, None, 0, False
        self._recovery.reset()

    def cancel(self, reason: str) -> None:
        """Give the goal up; nothing resumes it."""
        if self.active:
            self._stage, self._reason = Stage.FAILED, reason

    def at_rest(self) -> None:
        """Told when the lines were let go: the next command starts from standstill."""
        self._command = Twist()

    def step(self, now_ns: int, pose: Pose2, obstacles: FloatArray | None) -> Navigation:
        """One tick from map_from_base and, when there was a scan, the obstacle points (N, 2) [m] it saw in map."""
        if obstacles is not None:
            self._surroundings.see(obstacles)
        if self._planner is None or not self.active:
            return self._navigation(Twist())
        if obstacles is not None or self._local is None:
            self._local = self._surroundings.window(pose)
        if self._needs_plan(now_ns, pose):
            self._plan(now_ns, pose)
        if self._path is None or not self.active:
            return self._halt(now_ns, self._no_way)
        choice = self._choose(now_ns, pose, self._path, self._local)
        if self._recovery.exhausted:
            tries = self._settings.recovery.tries
            self.cancel(f"no way through after {tries} tries: clear the way or choose another goal")
            return self._navigation(braking(self._command, self._dwa), choice)
        if choice.arrived:
            self._stage, self._reason = Stage.ARRIVED, "arrived"
            return self._navigation(Twist(), choice)
        if choice.blocked:
            return self._halt(now_ns, "something is in the way", choice)
        self._recovery.moves()
        self._stage, self._reason = Stage.DRIVING, ""
        return self._navigation(choice.twist, choice)

    def _choose(self, now_ns: int, pose: Pose2, path: Path, local: DistanceField) -> DwaResult:
        """Follow the path; where that has been impossible for a while, first back out the way the chair came."""
        tries = self._recovery.tries
        remaining = None if self._in_position else _remaining(path, pose)
        backing = self._recovery.step(now_ns, pose, remaining, self._command, local, self._body, self._dwa)
        if self._recovery.tries > tries:
            self._planned_ns = None  # once backed out, plan anew from there
        if backing is not None:
            return backing
        choice = self._follow(pose, local)
        if choice.arrived and len(self._legs) > 1:  # stopped and turned: on with the next leg
            self._legs, self._in_position = self._legs[1:], False
            choice = self._follow(pose, local)
        return choice

    def _follow(self, pose: Pose2, local: DistanceField) -> DwaResult:
        """The next command on the present leg."""
        limits = self._dwa
        if len(self._legs) > 1:
            limits = replace(limits, goal_tolerance=self._settings.corner_tolerance)
        choice = choose(pose, self._command, self._legs[0], local, self._body, limits, in_position=self._in_position)
        self._in_position = choice.in_position
        return choice

    def _navigation(self, twist: Twist, choice: DwaResult | None = None) -> Navigation:
        self._command = twist
        return Navigation(self._stage, twist, self._reason, self._path, self._plans, choice)

    def _halt(self, now_ns: int, why: str, choice: DwaResult | None = None) -> Navigation:
        """Brake and wait; give up after the patience."""
        if self.active:
            waited = self._recovery.stands(now_ns)
            self._stage, self._reason = Stage.WAITING, f"{why}; waiting"
            if waited > self._settings.recovery.patience:
                self.cancel(f"{why}, for {waited:.0f} s: clear the way or choose another goal")
        return self._navigation(braking(self._command, self._dwa), choice)

    def _needs_plan(self, now_ns: int, pose: Pose2) -> bool:
        if self._planned_ns is None:
            return True
        if now_ns - self._planned_ns < self._settings.replan_period * 1e9:
            return False
        if self._path is None or self._stage is Stage.WAITING:
            return True
        away = np.hypot(*(self._path.poses[:, :2] - (pose.x, pose.y)).T)
        nearest = int(np.argmin(away))
        if away[nearest] > self._settings.off_path:
            return True
        steps = math.ceil(self._settings.look_ahead / self._settings.planner.spacing)
        ahead = self._path.poses[nearest : nearest + steps, :2]
        news = self._surroundings.unexpected()
        if not len(news):
            return False
        gaps = np.hypot(*(ahead[:, None] - news[None]).transpose(2, 0, 1))
        return bool(gaps.min() < self._body.width / 2)

    def _plan(self, now_ns: int, pose: Pose2) -> None:
        """A new path over the map and what is in the way now; while there is none, the chair waits."""
        assert self._planner is not None
        self._planned_ns = now_ns
        try:
            if self._plans == 0:  # a goal that the map alone rules out is refused, not waited for
                costmap = self._costmap(None)
                check_goal(costmap, self._body, self._planner.goal)
                self._planner.replan(costmap, pose)
        except PlanningError as error:
            self.cancel(str(error))
            return
        try:
            path = self._planner.replan(self._costmap(self._surroundings.unexpected()), pose)
            if self._path is None:  # having waited for a way is no reason to back out now that there is one
                self._recovery.moves()
            legs = legs_of(path)
            self._in_position = self._in_position and len(legs) == len(self._legs) == 1
            self._path, self._legs, self._plans = path, legs, self._plans + 1
        except PlanningError as error:
            self._path, self._no_way = None, str(error)

    def _costmap(self, obstacles: FloatArray | None) -> Costmap:
        return costmap_from_grid(self._grid, self._body, self._settings.costmap, obstacles)


def _remaining(path: Path, pose: Pose2) -> float:
    """Way [m] to the end of a path, that to the path included."""
    away = np.hypot(*(path.poses[:, :2] - (pose.x, pose.y)).T)
    nearest = int(np.argmin(away))
    return float(away[nearest]) + Path(path.poses[nearest:]).length()
