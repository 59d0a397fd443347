"""The navigator: the source paper's loop (its Fig. 4), plan, follow, replan on change, reached, one call a tick.

It never raises in a tick: whatever goes wrong becomes a stop and a reason. It decides where to go, never who drives.
"""

from __future__ import annotations

import enum
import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.config import Settings, setting
from waychair.errors import PlanningError
from waychair.maps.distance_field import DistanceField, distances
from waychair.maps.grid import cells_from_points, inside, occupied
from waychair.maps.places import find
from waychair.planning.costmap import Costmap, CostmapSettings, costmap_from_grid
from waychair.planning.dwa import DwaResult, DwaSettings, braking, choose
from waychair.planning.escape import back_up
from waychair.planning.global_planner import GlobalPlanner, PlannerSettings, check_goal
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
    """When to plan anew, when to give up, and the planners' own settings."""

    obstacle_range: float = setting(
        6.0, "m", "beams beyond this are no obstacles to care about yet", low=1.0, high=50.0
    )
    known_within: float = setting(0.15, "m", "a point this near to a wall of the map is that wall", low=0.0, high=1.0)
    local_reach: float = setting(4.0, "m", "half side of the window the local planner sees", low=2.0, high=20.0)
    local_resolution: float = setting(0.025, "m", "cells of that window, half the map's in doors", low=0.01, high=0.1)
    look_ahead: float = setting(5.0, "m", "part of the path that must be free", low=0.5, high=50.0)
    off_path: float = setting(0.5, "m", "farther from the path than this: plan anew", low=0.1, high=5.0)
    replan_period: float = setting(1.0, "s", "shortest time between two plans", low=0.05, high=60.0)
    back_up_after: float = setting(2.0, "s", "standing still this long before backing out", low=0.1, high=3600.0)
    back_up_way: float = setting(0.4, "m", "how far to back out", low=0.05, high=5.0)
    progress_time: float = setting(8.0, "s", "coming no nearer this long: back out and try again", low=1.0, high=600.0)
    max_back_ups: int = setting(6, "", "giving up after so many tries", low=0, high=100)
    patience: float = setting(20.0, "s", "standing still this long before giving up", low=1.0, high=3600.0)
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
        self._walls = occupied(grid)
        self._static = distances(self._walls, grid.resolution)
        self._obstacles = np.empty((0, 2))
        self._local: DistanceField | None = None
        self._command = Twist()
        self._stage, self._reason = Stage.IDLE, "no goal"
        self._planner: GlobalPlanner | None = None
        self._dwa = self._settings.dwa
        self._path: Path | None = None
        self._planned_ns: int | None = None
        self._waiting_since: int | None = None
        self._plans = 0
        self._no_way = ""
        self._trail: deque[tuple[float, float, float]] = deque(maxlen=100)
        self._backing_from: Pose2 | None = None
        self._backing_since = 0
        self._back_ups = 0
        self._in_position = False
        self._nearest: tuple[int, float] | None = None  # when, and how near to the goal [m]

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
            goal_tolerance=min(self._settings.dwa.goal_tolerance, goal.tolerance_m / 1.5),
            heading_tolerance=min(self._settings.dwa.heading_tolerance, goal.tolerance_rad / 2),
        )
        self._stage, self._reason = Stage.DRIVING, ""
        self._forget()

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
            self._obstacles = obstacles
        if self._planner is None or not self.active:
            return self._navigation(Twist())
        if obstacles is not None or self._local is None:
            self._local = self._surroundings(pose)
        if self._needs_plan(now_ns, pose):
            self._plan(now_ns, pose)
        if self._path is None or not self.active:
            return self._halt(now_ns, self._no_way)
        choice = self._choose(now_ns, pose, self._path, self._local)
        if self._back_ups > self._settings.max_back_ups:
            self._stage = Stage.FAILED
            self._reason = f"no way through after {self._back_ups - 1} tries: clear the way or choose another goal"
            return self._navigation(braking(self._command, self._dwa), choice)
        if choice.arrived:
            self._stage, self._reason = Stage.ARRIVED, "arrived"
            return self._navigation(Twist(), choice)
        if choice.blocked:
            return self._halt(now_ns, "something is in the way", choice)
        self._stage, self._reason, self._waiting_since = Stage.DRIVING, "", None
        return self._navigation(choice.twist, choice)

    def _choose(self, now_ns: int, pose: Pose2, path: Path, local: DistanceField) -> DwaResult:
        """Follow the path; where that has been impossible for a while, first back out the way the chair came."""
        self._trail_grows(pose)
        if self._backing_from is None and self._stuck(now_ns, pose, path):
            self._backing_from, self._backing_since, self._back_ups = pose, now_ns, self._back_ups + 1
        if self._backing_from is not None:
            backed = math.hypot(pose.x - self._backing_from.x, pose.y - self._backing_from.y)
            choice = back_up(pose, self._command, np.array(self._trail), local, self._body, self._dwa)
            lasted = (now_ns - self._backing_since) * 1e-9
            if backed < self._settings.back_up_way and lasted < self._settings.progress_time and not choice.blocked:
                return choice
            self._backing_from, self._planned_ns, self._nearest = (
                None,
                None,
                None,
            )  # far enough, or no farther: plan anew from here
        choice = choose(pose, self._command, path, local, self._body, self._dwa, in_position=self._in_position)
        self._in_position = choice.in_position
        return choice

    def _stuck(self, now_ns: int, pose: Pose2, path: Path) -> bool:
        """Whether the chair has stood still, or come no nearer to the goal, for long enough to try something else."""
        if self._waiting_since is not None:
            return (now_ns - self._waiting_since) * 1e-9 >= self._settings.back_up_after * (1 + self._back_ups)
        away = np.hypot(*(path.poses[:, :2] - (pose.x, pose.y)).T)
        remaining = (len(away) - 1 - int(np.argmin(away))) * self._settings.planner.spacing + float(away.min())
        if self._in_position or self._nearest is None or remaining < self._nearest[1] - 0.1:
            self._nearest = (now_ns, remaining)
        if (now_ns - self._nearest[0]) * 1e-9 < self._settings.progress_time:
            return False
        self._nearest = None
        return True

    def _trail_grows(self, pose: Pose2) -> None:
        """Remember the way driven forwards; backing out takes it back."""
        if self._backing_from is not None:
            while (
                len(self._trail) > 1
                and (self._trail[-1][0] - pose.x) * math.cos(pose.theta)
                + (self._trail[-1][1] - pose.y) * math.sin(pose.theta)
                > 0
            ):
                self._trail.pop()
        elif not self._trail or math.hypot(self._trail[-1][0] - pose.x, self._trail[-1][1] - pose.y) > 0.05:
            self._trail.append((pose.x, pose.y, pose.theta))

    def _forget(self) -> None:
        self._path, self._planned_ns, self._waiting_since, self._plans = None, None, None, 0
        self._backing_from, self._back_ups, self._in_position, self._nearest = None, 0, False, None

    def _navigation(self, twist: Twist, choice: DwaResult | None = None) -> Navigation:
        self._command = twist
        return Navigation(self._stage, twist, self._reason, self._path, self._plans, choice)

    def _halt(self, now_ns: int, why: str, choice: DwaResult | None = None) -> Navigation:
        """Brake and wait; give up after the patience."""
        if self.active:
            self._waiting_since = now_ns if self._waiting_since is None else self._waiting_since
            waited = (now_ns - self._waiting_since) * 1e-9
            self._stage, self._reason = Stage.WAITING, f"{why}; waiting"
            if waited > self._settings.patience:
                self._stage, self._reason = (
                    Stage.FAILED,
                    f"{why}, for {waited:.0f} s: clear the way or choose another goal",
                )
        return self._navigation(braking(self._command, self._dwa), choice)

    def _surroundings(self, pose: Pose2) -> DistanceField:
        """Distances in a window round the chair, to the map's walls and to what the lidar sees now."""
        grid, reach = self._grid, self._settings.local_reach
        finer = max(1, round(grid.resolution / self._settings.local_resolution))
        size = math.ceil(2 * reach / grid.resolution)
        row, col = (cells_from_points(grid, np.array([[pose.x, pose.y]]))[0] - size // 2).tolist()
        window = np.zeros((size, size), np.bool_)
        top, left = max(row, 0), max(col, 0)
        part = self._walls[top : max(row + size, 0), left : max(col + size, 0)]
        window[top - row : top - row + part.shape[0], left - col : left - col + part.shape[1]] = part
        window = window.repeat(finer, axis=0).repeat(finer, axis=1)
        corner = grid.map_from_grid @ Pose2(col * grid.resolution, row * grid.resolution, 0.0)
        local = OccupancyGrid(np.zeros(window.shape, np.int8), grid.resolution / finer, corner)
        cells = cells_from_points(local, self._obstacles)
        rows, cols = cells[inside(local, cells)].T
        window[rows, cols] = True
        return DistanceField(distances(window, local.resolution), local.resolution, corner)

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
        steps = math.ceil(self._settings.look_ahead / max(self._settings.planner.spacing, 1e-3))
        ahead = self._path.poses[nearest : nearest + steps, :2]
        news = self._unexpected()
        if not len(news):
            return False
        gaps = np.hypot(*(ahead[:, None] - news[None]).transpose(2, 0, 1))
        return bool(gaps.min() < self._body.width / 2)

    def _unexpected(self) -> FloatArray:
        """Obstacle points that the map does not explain."""
        cells = cells_from_points(self._grid, self._obstacles)
        within = inside(self._grid, cells)
        rows, cols = cells[within].T
        news: FloatArray = self._obstacles[within][self._static[rows, cols] > self._settings.known_within]
        return news

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
            self._stage, self._reason = Stage.FAILED, str(error)
            return
        try:
            path = self._planner.replan(self._costmap(self._unexpected()), pose)
            if self._path is None:  # having waited for a way is no reason to back out now that there is one
                self._waiting_since = None
            self._path, self._plans = path, self._plans + 1
        except PlanningError as error:
            self._path, self._no_way = None, str(error)

    def _costmap(self, obstacles: FloatArray | None) -> Costmap:
        return costmap_from_grid(self._grid, self._body, self._settings.costmap, obstacles)
