"""The navigator's state from tick to tick: its plan, and the motion of its chair."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from waychair.control.drive.leg_drive import LegDrive
from waychair.control.drive.straying import Straying
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.route.global_planner import GlobalPlanner
from waychair.planning.route.legs import PathLeg
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

LONGEST_SEARCH_S = 20.0
"""s; a search for multi-point turns that takes longer is given up, with a sentence: nobody waits longer for an answer."""

TOLD_AFTER_S = 1.0
"""s; a chair that has stood for so long in a drive says for what it stands."""

_LEAP = 0.3
"""m; a larger step from one tick to the next is the beginning, or a jump of the odometry."""

STILL_M, STILL_RAD = 0.02, 0.03
"""m, rad; a chair that has moved by no more than this stands, whatever it was commanded."""

MOST_APPROACHES = 3
"""Drives to a goal's place that may each end outside its tolerances: then the chair cannot stop there as exactly."""

DETOUR_TOLD_S = 8.0
"""s; for so long a way round is told, with what bars the shorter way."""

PATH_HYSTERESIS_S = 1.5
"""s; among people a new path replaces the present one only if it arrives sooner by this."""

RESTED_TICKS, AT_REST = 8, 1e-3
"""A chair commanded less than the second [m/s, rad/s] for so many ticks stands."""

MOST_CHANGES, ONE_WAY_M, ROLLS_M = 4, 1.0, 0.004
"""Changes of gear in a row without the second [m] driven one way between them, after which a chair waits instead
of backing once more. A way back shorter than the third [m] is the noise of the wheels."""

OFF_PATH = 0.5
"""m; a chair farther off its path needs a new plan."""


@dataclass(slots=True)
class GearChanges:
    """The gear, 1 or -1 (0 at first), and the changes of gear in a row, by the way along the chair's own axis.

    `at`, `began` and `farthest` [m] are along that way: now, where the present gear began, and farthest in it.
    """

    gear: float = 0.0
    count: int = 0
    at: float = 0.0
    began: float = 0.0
    farthest: float = 0.0

    def note(self, forwards: float) -> None:
        """Take in a step [m] forwards, negative backwards."""
        self.at += forwards
        back = self.at - self.farthest
        if self.gear * back > 0.0:
            self.farthest = self.at
        elif abs(back) > ROLLS_M:
            self.count += 1 if self.gear else 0
            self.gear, self.began, self.farthest = math.copysign(1.0, back), self.farthest, self.at
        if abs(self.farthest - self.began) > ONE_WAY_M:
            self.count = 0

    @property
    def are_enough(self) -> bool:
        """Whether the chair has moved to and fro enough here, so that it must not begin to back again."""
        return self.count >= (MOST_CHANGES - 1 if self.gear > 0.0 else MOST_CHANGES)


@dataclass(frozen=True, slots=True)
class OfferedWay:
    """Another way round a doorway that is shut or taken: the sentence for the rider, and where [m] in map the doorway is.

    The chair waits there for `wait_s` [s] from `since_ns` on, or until somebody has `taken` the offer.
    """

    text: str
    at: tuple[float, float]
    since_ns: int
    wait_s: float
    taken: bool = False

    def is_over(self, now_ns: int) -> bool:
        """Return whether the chair now goes the other way."""
        return self.taken or now_ns - self.since_ns >= self.wait_s * 1e9


@dataclass(slots=True)
class OtherWay:
    """The longer way: stamp [ns] and sentence once the chair has `taken` it, the present `offer`, and the `latest` of a drive."""

    taken: tuple[int, str] = (0, "")
    offer: OfferedWay | None = None
    latest: OfferedWay | None = None


@dataclass(slots=True)
class PlanState:
    """The path to a goal.

    `leg` drives the first of the `legs`. `count`: plans made for this goal. `made_ns`: start of the latest planning, None
    to ask for a new plan. `obstacles` (N, 2) [m] in map: the ones that the latest planning avoids. `among_people`: it
    expects walking people.
    `unconfirmed`: the goal waits for the rider's yes, before which no chair has arrived, even one that stands there.
    `refusal`: why the goal is refused for good. `approaches`: drives to the goal's place that missed its tolerances.
    `other`: a longer way round.
    """

    planner: GlobalPlanner | None = None
    path: Path | None = None
    legs: list[PathLeg] = field(default_factory=list)
    leg: LegDrive | None = None
    count: int = 0
    made_ns: int | None = None
    obstacles: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    among_people: bool = False
    no_path_reason: str = ""
    unconfirmed: bool = False
    refusal: str = ""
    approaches: int = 0
    other: OtherWay = field(default_factory=OtherWay)

    def start(self, planner: GlobalPlanner) -> None:
        """Start planning to another goal from scratch."""
        self.planner = planner
        self.path, self.made_ns, self.count, self.leg = None, None, 0, None
        self.refusal, self.approaches, self.other = "", 0, OtherWay()

    def ask_anew(self) -> None:
        """Ask for a new plan; the present path counts until it is made."""
        self.made_ns = None

    def adopt(self, path: Path, legs: list[PathLeg], leg: LegDrive) -> None:
        """Follow another path from now on; a chair in position at the end of a single leg without a line stays in position."""
        if self.leg is not None and len(legs) == len(self.legs) == 1 and not legs[0].is_line:
            leg.in_position = self.leg.in_position
        self.path, self.legs, self.leg, self.count = path, legs, leg, self.count + 1
        self.other.offer = None

    def drop_path(self, reason: str) -> None:
        """Follow no path, for a reason."""
        self.path, self.leg, self.no_path_reason = None, None, reason
        self.other.offer = None

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

    `stepped_ns` is the stamp of the present tick, which began `since_ns` after the one before.
    `before` is the command before `command`, and `motion` the acceleration of both. `rested_ticks`: ticks without a
    command to move. `jumping`: the localised pose has just jumped. `local` is None until the distances are asked for.
    `still_at` is where the chair has stood, in odom, since `still_since_ns`; `odom_from_base` is its latest place there.
    `gears`: the changes of gear on this drive. `straying`: how far the chair strays from its lines.
    """

    straying: Straying
    pose: Pose2 = field(default_factory=Pose2)
    map_from_odom: Pose2 = field(default_factory=Pose2)
    stepped_ns: int | None = None
    since_ns: int = 0
    command: Twist = field(default_factory=Twist)
    before: Twist = field(default_factory=Twist)
    motion: CommandedMotion = field(default_factory=CommandedMotion)
    rested_ticks: int = RESTED_TICKS
    jumping: bool = False
    local: DistanceField | None = None
    still_at: Pose2 | None = None
    still_since_ns: int = 0
    odom_from_base: Pose2 = field(default_factory=Pose2)
    gears: GearChanges = field(default_factory=GearChanges)

    def note_place(self, now_ns: int, odom_from_base: Pose2) -> None:
        """Note where the chair is, in odom, to tell for how long it has stood there, and its changes of gear."""
        step = self.odom_from_base.inverse() @ odom_from_base
        self.odom_from_base = odom_from_base
        if math.hypot(step.x, step.y) < _LEAP:
            self.gears.note(step.x)
        off = None if self.still_at is None else self.still_at.inverse() @ odom_from_base
        if off is None or math.hypot(off.x, off.y) > STILL_M or abs(off.theta) > STILL_RAD:
            self.still_at, self.still_since_ns = odom_from_base, now_ns

    def stands_for(self, seconds: float) -> bool:
        """Return whether the chair has stood for so long."""
        return ((self.stepped_ns or 0) - self.still_since_ns) * 1e-9 >= seconds

    def note_tick(self, now_ns: int, limits: DwaSettings) -> None:
        """Count the ticks at rest, and update the acceleration by the last command."""
        self.since_ns, self.stepped_ns = now_ns - (self.stepped_ns or now_ns), now_ns
        self.rested_ticks = self.rested_ticks + 1 if max(abs(self.command.v), abs(self.command.omega)) < AT_REST else 0
        self.motion = motion_after(self.motion, self.before, self.command, limits)
        self.before = self.command
