"""Driving to a goal without a map: obstacles seen by the lidar are remembered, unseen cells count as free.

The source paper's loop (its Fig. 4) is plan, follow, replan on change, reached. Here it runs on a grid that fills as
the chair drives: D* Lite repairs its plan as cells change, and the dynamic window follows it. Everything is in odom,
because no map could correct it. A tick never raises: every failure becomes a stop with a reason.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from waychair.calibration.chair_body import ChairBody
from waychair.config import Settings
from waychair.control.drive.navigator import Navigation, Stage
from waychair.control.drive.recovery import Recovery, RecoverySettings
from waychair.errors import PlanningError
from waychair.maps.grid.distance_field import DistanceField, window_distances
from waychair.maps.grid.growing_grid import FINE_CELLS, GridMemory
from waychair.maps.grid.occupancy import OccupancySettings
from waychair.planning.body.clearance import ClearanceSettings
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.planning.route.global_planner import GlobalPlanner, PlannerSettings
from waychair.planning.window.dwa import DwaResult, choose
from waychair.planning.window.motion_limits import DwaSettings, braking
from waychair.types import Path, Pose2, Scan, Twist

REPLAN_PERIOD_S = 0.2
"""s; time between two plans."""

LOCAL_REACH = 3.0
"""m; half side of the window in which the dynamic window tries arcs."""

COARSER = 2
"""Cells of the memory per cell of the plan, in each direction."""


@dataclass(frozen=True, slots=True)
class MaplessSettings(Settings):
    """Settings of the parts of a drive without a map."""

    memory: OccupancySettings = FINE_CELLS
    recovery: RecoverySettings = field(default_factory=RecoverySettings)
    clearance: ClearanceSettings = field(default_factory=ClearanceSettings)
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    dwa: DwaSettings = field(default_factory=DwaSettings)


class MaplessNavigator:
    """The drive to one goal without a map; poses and goal are in odom."""

    def __init__(self, body: ChairBody, at: Pose2, goal: Pose2, settings: MaplessSettings | None = None) -> None:
        """Start from standstill at a pose."""
        self._settings = settings or MaplessSettings()
        self._body = body
        self._goal = goal
        self._memory = GridMemory(at, self._settings.memory)
        self._memory.include(goal)
        # without a map's walls there are no doors to line up with
        self._planner = GlobalPlanner(goal, self._settings.planner, check_footprint=False)
        self._recovery = Recovery(self._settings.recovery)
        self._command = Twist()
        self._local: DistanceField | None = None
        self._path: Path | None = None
        self._no_path_reason = ""
        self._planned_ns: int | None = None
        self._plans = 0
        self._in_position = False
        self._stage, self._reason = Stage.DRIVING, ""

    def step(self, now_ns: int, pose: Pose2, scan: Scan | None) -> Navigation:
        """Do one tick from odom_from_base and, if there is one, the scan taken there."""
        if scan is not None:
            self._memory.see(scan, pose @ self._body.base_from_laser)
            self._local = self._window(pose)
        if self._stage in (Stage.ARRIVED, Stage.FAILED):
            return self._navigation(Twist())
        if self._local is None:
            return self._halt(now_ns, "no scan has arrived yet")
        if self._planned_ns is None or now_ns - self._planned_ns >= REPLAN_PERIOD_S * 1e9:
            self._plan(now_ns, pose)
        if self._path is None:
            return self._halt(now_ns, self._no_path_reason)
        choice = self._choose(now_ns, pose, self._path, self._local)
        if self._recovery.exhausted:
            self._stage, self._reason = Stage.FAILED, "no way through: clear the way or choose another goal"
            return self._navigation(braking(self._command, self._settings.dwa), choice)
        if choice.arrived:
            self._stage, self._reason = Stage.ARRIVED, "arrived"
            return self._navigation(Twist(), choice)
        if choice.blocked:
            return self._halt(now_ns, "something is in the way", choice)
        self._recovery.note_motion()
        self._stage, self._reason = Stage.DRIVING, ""
        return self._navigation(choice.twist, choice)

    def _window(self, pose: Pose2) -> DistanceField:
        """Return the distances to all remembered obstacles near a pose."""
        cell, corner = self._memory.resolution, self._memory.corner
        half = round(LOCAL_REACH / cell)
        row, col = int((pose.y - corner.y) / cell) - half, int((pose.x - corner.x) / cell) - half
        row, col = max(row, 0), max(col, 0)
        solid = self._memory.occupied()[row : row + 2 * half, col : col + 2 * half]
        return DistanceField(window_distances(solid, cell), cell, corner @ Pose2(col * cell, row * cell, 0.0))

    def _plan(self, now_ns: int, pose: Pose2) -> None:
        """Plan a new path over the remembered grid; if none is found, the old path stays."""
        self._planned_ns = now_ns
        try:
            self._path = self._planner.replan(self._costmap(), pose)
            self._plans += 1
        except PlanningError as error:
            self._no_path_reason = str(error)

    def _costmap(self) -> Costmap:
        """Return the costmap of the memory in coarser cells."""
        return costmap_from_grid(
            self._memory.grid(COARSER), self._body, comfortable=self._settings.clearance.comfortable
        )

    def _choose(self, now_ns: int, pose: Pose2, path: Path, local: DistanceField) -> DwaResult:
        """Follow the path; if that has been impossible for a while, first back out along the chair's trail."""
        dwa, remaining = self._settings.dwa, None if self._in_position else path.length()
        backing = self._recovery.step(
            now_ns=now_ns,
            pose=pose,
            remaining=remaining,
            command=self._command,
            local=lambda: local,
            body=self._body,
            settings=dwa,
        )
        if backing is not None:
            return backing
        choice = choose(
            pose=pose,
            command=self._command,
            path=path,
            distances=local,
            body=self._body,
            settings=dwa,
            in_position=self._in_position,
        )
        self._in_position = choice.in_position
        return choice

    def _halt(self, now_ns: int, why: str, choice: DwaResult | None = None) -> Navigation:
        """Brake and wait; give up after the patience."""
        waited = self._recovery.note_standstill(now_ns)
        self._stage, self._reason = Stage.WAITING, f"{why}; waiting"
        if waited > self._settings.recovery.patience:
            self._stage = Stage.FAILED
            self._reason = f"{why}, for {waited:.0f} s: clear the way or choose another goal"
        return self._navigation(braking(self._command, self._settings.dwa), choice)

    def _navigation(self, twist: Twist, choice: DwaResult | None = None) -> Navigation:
        self._command = twist
        return Navigation(
            stage=self._stage, twist=twist, reason=self._reason, path=self._path, plans=self._plans, choice=choice
        )
