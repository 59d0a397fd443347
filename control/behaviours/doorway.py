"""Doorway navigation (paper 3.3): detection in the picture, validation by range, tracking, and the pivotal-zone path.

The picture proposes a door frame; the laser line decides. The path is a series of nearly straight lines and one sharp
turn: to the pivotal zone before the door, a swivel on the spot until the chair faces the door, and forward through it.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.control.behaviours.commands import DoorCommand, Move, between
from waychair.control.behaviours.paper_settings import CameraLimits, DoorLimits
from waychair.control.behaviours.range_finder import Depth, LookRequest
from waychair.geometry import wrap_angle
from waychair.types import Pose2


@dataclass(frozen=True, slots=True)
class FrameCandidate:
    """Two uprights with a lintel in the picture: bearings of left and right edge [rad] in base, confidence in [0, 1]."""

    left: float
    right: float
    confidence: float


@dataclass(frozen=True, slots=True)
class FramesSeen:
    """All candidates of one picture."""

    candidates: tuple[FrameCandidate, ...]


@dataclass(frozen=True, slots=True)
class OdometryPose:
    """The chair's pose in odom [m, rad], for keeping things in place while it moves, and its speeds [m/s, rad/s]."""

    x: float
    y: float
    theta: float
    v: float = 0.0
    omega: float = 0.0

    def pose(self) -> Pose2:
        """Return it as a pose."""
        return Pose2(self.x, self.y, self.theta)


@dataclass(frozen=True, slots=True)
class DoorwayJambs:
    """A doorway in base: its jambs [m], left and right as seen from the chair."""

    left_x: float
    left_y: float
    right_x: float
    right_y: float

    @property
    def width(self) -> float:
        """Distance between the jambs [m]."""
        return math.hypot(self.left_x - self.right_x, self.left_y - self.right_y)

    @property
    def middle(self) -> tuple[float, float]:
        """The point between the jambs [m]."""
        return (self.left_x + self.right_x) / 2, (self.left_y + self.right_y) / 2

    @property
    def through(self) -> float:
        """Direction through the door, away from the chair's side [rad]."""
        return math.atan2(self.left_y - self.right_y, self.left_x - self.right_x) - math.pi / 2

    def seen_from(self, new_from_old: Pose2) -> DoorwayJambs:
        """Return the doorway in another frame."""
        left = new_from_old @ Pose2(self.left_x, self.left_y)
        right = new_from_old @ Pose2(self.right_x, self.right_y)
        return DoorwayJambs(left.x, left.y, right.x, right.y)


class CandidateVerdict(enum.Enum):
    """The verdict on a candidate: not yet ranged, a doorway, or none."""

    LOOKING = "looking"
    VALID = "valid"
    REFUTED = "refuted"


@dataclass(frozen=True, slots=True)
class DoorCheck:
    """The validation's output: its verdict, the doorway if valid, and the look it asks for."""

    state: CandidateVerdict
    door: DoorwayJambs | None = None
    request: LookRequest | None = None

    @property
    def valid(self) -> bool:
        """Whether a doorway was confirmed."""
        return self.state is CandidateVerdict.VALID


def detect_doorway(frames: FramesSeen, constants: DoorLimits) -> FrameCandidate | None:
    """Return the surest frame in the picture; of equally sure ones the one nearest to straight ahead."""
    sure = [each for each in frames.candidates if each.confidence >= constants.confidence and each.left > each.right]
    if not sure:
        return None
    return min(sure, key=lambda each: (-each.confidence, abs(each.left + each.right)))


def validate_door(candidate: FrameCandidate, depth: Depth | None, constants: DoorLimits) -> DoorCheck:
    """Return whether ranges show a doorway between the candidate's edges: jambs at door width, and depth behind them.

    The nearest range within a few degrees of each edge is its jamb. Without ranges on both sides and between, the
    camera is asked to look at the candidate's middle.
    """
    middle = candidate.right + (candidate.left - candidate.right) / 2
    request = LookRequest(wrap_angle(middle))
    if depth is None:
        return DoorCheck(CandidateVerdict.LOOKING, request=request)
    left, right = (_jamb(depth, edge, constants) for edge in (candidate.left, candidate.right))
    inside = (depth.bearings < candidate.left - constants.jamb) & (depth.bearings > candidate.right + constants.jamb)
    if left is None or right is None or not inside.any():
        return DoorCheck(CandidateVerdict.LOOKING, request=request)
    door = DoorwayJambs(*left, *right)
    behind = float(np.median(depth.metres[inside])) - math.hypot(*door.middle)
    if constants.narrowest <= door.width <= constants.widest and behind >= constants.deeper:
        return DoorCheck(CandidateVerdict.VALID, door, request)
    return DoorCheck(CandidateVerdict.REFUTED, request=request)


def _jamb(depth: Depth, edge: float, limits: DoorLimits) -> tuple[float, float] | None:
    near = [k for k, bearing in enumerate(depth.bearings) if between(float(bearing), edge) <= limits.jamb]
    if not near:
        return None
    k = min(near, key=lambda each: float(depth.metres[each]))
    bearing, metres = float(depth.bearings[k]), float(depth.metres[k])
    return metres * math.cos(bearing), metres * math.sin(bearing)


@dataclass(frozen=True, slots=True)
class TrackerMemory:
    """Dynamic data of the Object tracker: the doorway in odom, its stamp, and how often it was refuted in a row."""

    door: DoorwayJambs | None = None
    stamp_ns: int = 0
    refuted: int = 0


@dataclass(frozen=True, slots=True)
class TrackedDoor:
    """The Object tracker's output: the doorway in base, its age [s], and the look that keeps the camera on it."""

    door: DoorwayJambs
    age_s: float
    request: LookRequest

    @property
    def held(self) -> bool:
        """Whether a door is held; always."""
        return True


_REFUTED = 3
"""Refutations in a row after which a door is forgotten: one alone may be somebody who walks through it."""


def track_door(
    check: DoorCheck | None,
    odometry: OdometryPose | None,
    constants: tuple[DoorLimits, CameraLimits],
    dynamic: TrackerMemory,
    now_ns: int,
) -> tuple[TrackedDoor | None, TrackerMemory]:
    """Return the validated door where it is now, held in place by the odometry; None once it is refuted or too old.

    Without odometry a door cannot be held while the chair moves, so only one just validated counts.
    """
    limits, _ = constants
    odom_from_base = odometry.pose() if odometry is not None else Pose2()
    memory = dynamic
    if check is not None and check.door is not None:
        memory = TrackerMemory(check.door.seen_from(odom_from_base), now_ns)
    elif check is not None and check.state is CandidateVerdict.REFUTED:
        memory = replace(memory, refuted=memory.refuted + 1)
    age_s = (now_ns - memory.stamp_ns) * 1e-9
    lost = age_s > limits.held or memory.refuted >= _REFUTED or (odometry is None and age_s > 0.0)
    if memory.door is None or lost:
        return None, TrackerMemory()
    door = memory.door.seen_from(odom_from_base.inverse())
    x, y = door.middle
    return TrackedDoor(door, age_s, LookRequest(math.atan2(y, x))), memory


class ZonePhase(enum.Enum):
    """The parts of a pivotal-zone path."""

    APPROACH = "approach"
    SWIVEL = "swivel"
    FORWARD = "forward"


@dataclass(frozen=True, slots=True)
class PathMemory:
    """Dynamic data of the Path planner."""

    phase: ZonePhase = ZonePhase.APPROACH


def plan_path(
    tracked: TrackedDoor, constants: tuple[DoorLimits, ChairBody], dynamic: PathMemory
) -> tuple[DoorCommand, PathMemory]:
    """Return the next simple move: towards the pivotal zone, a swivel in it until the chair faces the door, forward.

    The pivotal point lies on the door's axis, with the chair's front end a set distance before the wall. A chair that
    stands nearer to the door than that, and on its axis, turns where it is.
    """
    limits, body = constants
    door, phase = tracked.door, dynamic.phase
    x, y = door.middle
    heading = wrap_angle(door.through)
    along = x * math.cos(heading) + y * math.sin(heading)
    if along < -body.rear:
        return DoorCommand(Move.DONE), PathMemory()
    back = limits.pivot_ahead + body.front
    pivot_x, pivot_y = x - back * math.cos(heading), y - back * math.sin(heading)
    aside = abs(x * math.sin(heading) - y * math.cos(heading))
    in_zone = math.hypot(pivot_x, pivot_y) <= limits.zone or (along < back and aside <= limits.zone / 2)
    if phase is ZonePhase.APPROACH and in_zone:
        phase = ZonePhase.SWIVEL
    if phase is ZonePhase.SWIVEL and not in_zone:
        phase = ZonePhase.APPROACH
    if phase is ZonePhase.SWIVEL and abs(heading) <= limits.straight:
        phase = ZonePhase.FORWARD
    if phase is ZonePhase.FORWARD and abs(heading) > limits.askew:
        phase = ZonePhase.SWIVEL if in_zone else ZonePhase.APPROACH
    if phase is ZonePhase.APPROACH:
        return DoorCommand(Move.GO, math.atan2(pivot_y, pivot_x)), PathMemory(phase)
    if phase is ZonePhase.SWIVEL:
        return DoorCommand(Move.SWIVEL, heading), PathMemory(phase)
    return DoorCommand(Move.GO, 0.0), PathMemory(phase)
