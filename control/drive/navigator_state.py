"""The navigator's state from tick to tick: its plan, and the motion of its chair."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from waychair.control.drive.leg_drive import LegDrive
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.grid.resumable import Resumable
from waychair.planning.route.global_planner import GlobalPlanner
from waychair.planning.route.legs import DrivingManner, PathLeg
from waychair.planning.window.motion_limits import CommandedMotion, DwaSettings, motion_after
from waychair.types import FloatArray, Path, Pose2, Twist

REPLAN_PERIOD_S = 1.0
"""s; shortest time between two plans."""

LOOK_AHEAD = 5.0
"""m; length of the path that must be free."""

CORNER_TOLERANCE = 0.05
"""m; tolerance of a stop at the end of a leg that another leg follows."""

LONGEST_PLAN_S, LONGEST_FIELD_S = 2.0, 60.0
"""s; a plan that takes longer is begun again if obstacles have moved; a potential field that takes longer is given up, and
the old path is kept."""

PATH_HYSTERESIS_S = 1.5
"""s; among people a new path replaces the present one only if it arrives sooner by this."""

RESTED_TICKS, AT_REST = 8, 1e-3
"""A chair commanded less than the second [m/s, rad/s] for so many ticks stands."""

OFF_PATH = 0.5
"""m; a chair farther off its path needs a new plan."""


@dataclass(slots=True)
class PlanState:
    """The path to a goal and the planning of the next one.

    `leg` drives the first of the `legs`. `count`: plans made for this goal. `made_ns`: start of the latest planning, None
    to ask for a new plan. `generator`: planning that takes several ticks; the chair `stops` for it, and then `stands`.
    `obstacles` (N, 2) [m] in map: the ones that the latest planning avoids. `among_people`: it expects walking people.
    """

    planner: GlobalPlanner | None = None
    path: Path | None = None
    legs: list[PathLeg] = field(default_factory=list)
    leg: LegDrive | None = None
    count: int = 0
    made_ns: int | None = None
    generator: Resumable[None] | None = None
    stops: bool = False
    stands: bool = False
    obstacles: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    among_people: bool = False
    no_path_reason: str = ""

    def start(self, planner: GlobalPlanner) -> None:
        """Start planning to another goal from scratch."""
        self.planner = planner
        self.path, self.made_ns, self.count, self.leg = None, None, 0, None
        self.generator, self.stops, self.stands = None, False, False

    def adopt(self, path: Path, legs: list[PathLeg], leg: LegDrive) -> None:
        """Follow another path from now on; a chair in position at the end of a single free leg stays in position."""
        if self.leg is not None and len(legs) == len(self.legs) == 1 and legs[0].manner is DrivingManner.FREE:
            leg.in_position = self.leg.in_position
        self.path, self.legs, self.leg, self.count = path, legs, leg, self.count + 1

    def drop_path(self, reason: str) -> None:
        """Follow no path, for a reason."""
        self.path, self.leg, self.no_path_reason = None, None, reason

    def rest(self, pose: Pose2) -> FloatArray | None:
        """Return the rest (N, 2) [m] of the path from a pose in map; None without a path, or if the chair is off it."""
        if self.path is None:
            return None
        points = self.path.poses[:, :2]
        away = np.hypot(*(points - (pose.x, pose.y)).T)
        nearest = int(np.argmin(away))
        return points[nearest:] if away[nearest] < OFF_PATH else None


@dataclass(slots=True)
class MotionState:
    """The chair's pose in map, the localisation's correction, the commands so far, and the distances to obstacles.

    `before` is the command before `command`, and `motion` the acceleration of both. `rested_ticks`: ticks without a
    command to move. `jumping`: the localised pose has just jumped. `local` is None until the distances are asked for.
    """

    pose: Pose2 = field(default_factory=Pose2)
    map_from_odom: Pose2 = field(default_factory=Pose2)
    stepped_ns: int | None = None
    command: Twist = field(default_factory=Twist)
    before: Twist = field(default_factory=Twist)
    motion: CommandedMotion = field(default_factory=CommandedMotion)
    rested_ticks: int = RESTED_TICKS
    jumping: bool = False
    local: DistanceField | None = None

    def note_tick(self, limits: DwaSettings) -> None:
        """Count the ticks at rest, and update the acceleration by the last command."""
        self.rested_ticks = self.rested_ticks + 1 if max(abs(self.command.v), abs(self.command.omega)) < AT_REST else 0
        self.motion = motion_after(self.motion, self.before, self.command, limits)
        self.before = self.command
