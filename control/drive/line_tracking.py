"""Tracking of a planned line to the centimetre, forwards or backwards, through doors and in multi-point turns.

Where there is space, the dynamic window weighs arcs; here only the line itself is known to be free. Straight lines and
arcs are followed by feedback in C. Samson's path coordinates (IEEE Trans. Automatic Control 40(1), 1995). Its errors
decay over the distance driven, not over time, so it acts the same at every speed and backwards. Near the line the
heading is held stiffly, so that a small error does not swing the ends out; farther off, the return to the line is
fastest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import wrap_angle
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.clearance import TRACKED, TRACKED_TIGHT
from waychair.planning.body.footprint import along_arc, footprint, free_time, in_cells
from waychair.planning.route.leaving_a_wall import standing_body
from waychair.planning.window.dwa import DwaResult, rotate_to_heading
from waychair.planning.window.motion_limits import (
    MIN_SPEED,
    PERIOD,
    CommandedMotion,
    DwaSettings,
    braking,
    slowing_speed,
    stop_time,
    towards,
)
from waychair.types import FloatArray, Pose2, Twist

_BESIDE = 0.02
"""m; farther off a line the plan does not tell free space, and the pose is known to half a centimetre only: the wide
margin is kept."""

_PREVIEW = 0.6
"""m; preview of the line ahead of the chair, enough to slow down for the sharpest bend."""

_STANDING = 0.01
"""m/s; the chair stands below this speed."""


TRACKING_SPEED, TRACKING_OMEGA = 0.25, 0.4
"""m/s, rad/s; highest speed along a tracked line, where space is tight, and highest turn rate."""

END_TOLERANCE, HEADING_TOLERANCE = 0.015, 0.02
"""m, rad; tolerances at a line's end, along the line and of the heading."""

TURN_FIRST, TURN_MIDWAY = 0.12, 0.8
"""rad; a standing chair farther off the line's heading turns before it drives; a driving chair stops and turns."""


@dataclass(frozen=True, slots=True)
class TrackingGains:
    """The distance [m] over which an error decays, and the damping of the heading; a damping of 1 is critical.

    `damping` holds on the line, `damping_off` 4 cm off it and farther.
    """

    return_length: float = 0.16
    damping: float = 2.0
    damping_off: float = 1.0


@dataclass(frozen=True, slots=True)
class OnLine:
    """A pose relative to a line of poses: left of it by `lateral` [m], turned off it by `heading` [rad].

    `curvature` [1/m] is the body's turn per metre, positive to the left when driven forwards. `remaining` [m] is the
    distance along the line to its end, negative beyond it. `bends` (N, 2) are the distances [m] to the starts of
    changes of the curvature, 0 for one already begun, and the rates of these changes [1/m^2].
    """

    lateral: float
    heading: float
    curvature: float
    remaining: float
    bends: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))


def on_line(poses: FloatArray, pose: Pose2, backwards: bool = False) -> OnLine:
    """Return a pose relative to the nearest step of a line; poses (N, 3) with the body's headings, N >= 2, same
    frame."""
    points = poses[:, :2]
    steps = np.diff(points, axis=0)
    lengths = np.maximum(np.hypot(steps[:, 0], steps[:, 1]), 1e-9)
    share = ((np.array([pose.x, pose.y]) - points[:-1]) * steps).sum(axis=1) / lengths**2
    within = np.clip(share, 0.0, 1.0)
    away = np.hypot(*(points[:-1] + within[:, None] * steps - (pose.x, pose.y)).T)
    k = int(np.argmin(away))
    gear = -1.0 if backwards else 1.0
    turn = wrap_angle(poses[k + 1, 2] - poses[k, 2]) if k < len(steps) - 1 or len(steps) == 1 else 0.0
    heading = wrap_angle(poses[k, 2] + within[k] * turn)
    direction = gear * steps[k] / lengths[k]  # of the body's heading
    lateral = direction[0] * (pose.y - points[k, 1]) - direction[1] * (pose.x - points[k, 0])
    left = float(lengths[k:].sum() - (share[k] if k == len(steps) - 1 else within[k]) * lengths[k])
    curvature = gear * turn / float(lengths[k])
    bends = _bends(poses, lengths, k, float(within[k]))
    return OnLine(float(lateral), wrap_angle(pose.theta - heading), curvature, left, bends)


def _bends(poses: FloatArray, lengths: FloatArray, k: int, within: float) -> FloatArray:
    """Return the distances [m] to changes of curvature between steps of a line and their rates [1/m^2], (N, 2).

    The chair is on step k and has driven the share `within` of it. Each change spreads over half of the step before it
    and half of the step after it. The last step is left out, since it may end in the heading of the next leg.
    """
    first = max(k - 1, 0)
    ways = np.cumsum(lengths[first:-1]) - (lengths[first:k].sum() + within * lengths[k])  # to each step's end
    near = slice(first, first + int(np.searchsorted(ways, _PREVIEW)) + 1)
    steps = lengths[near][: len(ways)]
    turns = np.diff(poses[near.start : near.start + len(steps) + 1, 2])
    curvatures = np.arctan2(np.sin(turns), np.cos(turns)) / steps
    begun = np.maximum(ways[: max(len(steps) - 1, 0)] - steps[:-1] / 2, 0.0)
    return np.column_stack([begun, np.abs(np.diff(curvatures)) / steps[1:]])


def track(
    pose: Pose2,
    command: Twist,
    poses: FloatArray,
    backwards: bool,
    distances: DistanceField,
    body: ChairBody,
    limits: DwaSettings,
    gains: TrackingGains = TrackingGains(),
    in_position: bool = False,
    motion: CommandedMotion | None = None,
    doubt: float = 0.0,
) -> DwaResult:
    """Return the next command on a line of poses (N, 3) [m, m, rad]; pose, poses and distances are in one frame.

    As in `dwa.choose`, the result is `in_position` at the line's end, and `arrived` when turned to its last heading and
    standing. It is `blocked` if the body could not stop before contact, or if the line goes backwards and reversing is
    forbidden. With a `motion` the jerk along the line is limited. Off the line the wide margin is kept; on it, the
    narrow margin if the wide one blocks. A chair that seems to touch a mapped obstacle, by up to the map's `doubt` [m],
    comes no nearer to it.
    """
    limits = replace(
        limits,
        max_omega=min(limits.max_omega, TRACKING_OMEGA),
        tolerances=replace(limits.tolerances, heading=HEADING_TOLERANCE),
    )
    ahead = Pose2(*along_arc(pose.x, pose.y, pose.theta, command.v, command.omega, limits.reaction_time))
    at = on_line(poses, ahead, backwards) if len(poses) > 1 else OnLine(0.0, 0.0, 0.0, 0.0)

    def with_margin(margin: float, turn_from: float, shape: ChairBody = body) -> DwaResult:
        kept = replace(limits, clearance=margin)
        if in_position or at.remaining <= END_TOLERANCE:
            turned = rotate_to_heading(
                pose=pose,
                command=command,
                heading=float(poses[-1, 2]),
                distances=distances,
                body=shape,
                settings=kept,
                motion=motion,
            )
            return replace(turned, in_position=True)
        if abs(at.heading) > turn_from:
            heading = wrap_angle(ahead.theta - at.heading)
            turned = rotate_to_heading(
                pose=pose,
                command=command,
                heading=heading,
                distances=distances,
                body=shape,
                settings=kept,
                motion=motion,
            )
            return replace(turned, arrived=False)
        if backwards and limits.max_reverse == 0.0:
            return _halted(ahead, command, np.zeros((0, 2)), kept)
        wanted = _feedback(at, backwards, _until_steady(command, backwards, kept, motion), kept, gains)
        return _admitted(
            ahead=ahead, command=command, wanted=wanted, distances=distances, body=shape, limits=kept, motion=motion
        )

    def turning_from(heading: float) -> DwaResult:
        result = with_margin(TRACKED, heading)
        if result.blocked and (len(poses) == 1 or abs(on_line(poses, pose, backwards).lateral) <= _BESIDE):
            result = with_margin(TRACKED_TIGHT, heading)  # the line may have been planned with a smaller margin
            shorter = standing_body(distances, body, pose, doubt) if result.blocked else None
            if shorter is not None and shorter is not body:
                return with_margin(TRACKED_TIGHT, heading, shorter)
        return result

    stands = abs(command.v) < _STANDING
    result = turning_from(TURN_FIRST if stands else TURN_MIDWAY)
    if stands and result.blocked and TURN_FIRST < abs(at.heading) <= TURN_MIDWAY:
        return turning_from(TURN_MIDWAY)  # if it cannot turn on the spot, it turns while driving
    return result


def _until_steady(command: Twist, backwards: bool, limits: DwaSettings, motion: CommandedMotion | None) -> float:
    """Return the distance [m] driven while an acceleration ends by limited jerk; 0 without one."""
    gear = -1.0 if backwards else 1.0
    faster = 0.0 if motion is None else max(gear * motion.acceleration.v, 0.0)
    return max(gear * command.v, 0.0) * faster / limits.jerk + faster**3 / (3 * limits.jerk**2)


def _feedback(at: OnLine, backwards: bool, way: float, limits: DwaSettings, gains: TrackingGains) -> Twist:
    """Return a speed from which the chair can stop at the end, and the turn rate back onto the line.

    `way` [m] is the distance driven before the chair can begin to slow down.
    """
    fastest = min(TRACKING_SPEED, limits.max_reverse if backwards else limits.max_speed)
    speed = min(fastest, slowing_speed(at.remaining - way, 0.0, limits), _steering_speed(at, way, limits))
    v = math.copysign(max(speed, MIN_SPEED), -1.0 if backwards else 1.0)
    gain = 1.0 / gains.return_length
    damping = np.interp(abs(at.lateral), (_BESIDE, 2 * _BESIDE), (gains.damping, gains.damping_off))
    omega = v * at.curvature - v * gain**2 * at.lateral - 2.0 * float(damping) * abs(v) * gain * at.heading
    share = min(1.0, limits.max_omega / max(abs(omega), 1e-9))
    return Twist(v * max(share, min(1.0, MIN_SPEED / max(abs(v), 1e-9))), omega * share)


def _steering_speed(at: OnLine, way: float, limits: DwaSettings) -> float:
    """Return the speed [m/s] from which the chair slows down in time for its turning to follow the line's curvature.

    There v^2 times the curvature's change per metre is alpha.
    """
    bends = [(left, math.sqrt(limits.alpha / bend)) for left, bend in at.bends.tolist() if bend > 1e-6]
    return min((slowing_speed(left - way, speed, limits) for left, speed in bends), default=math.inf)


def _admitted(
    ahead: Pose2,
    command: Twist,
    wanted: Twist,
    distances: DistanceField,
    body: ChairBody,
    limits: DwaSettings,
    motion: CommandedMotion | None,
) -> DwaResult:
    """Return the first step towards the wanted twist, or half of it, from which the chair can stop; else braking.

    A step with limited jerk from which it could not stop is tried again without that limit.
    """
    shape, start = footprint(body, limits.clearance, distances), in_cells(distances, ahead)
    candidates = np.array([[wanted.v, wanted.omega], [wanted.v / 2, wanted.omega / 2]])
    steps = [(k, eased) for eased in ((None,) if motion is None else (motion, None)) for k in range(2)]
    for k, eased in steps:
        v, omega = candidates[k].tolist()
        twist = _step(command, Twist(v, omega), limits, eased)
        needed = PERIOD + stop_time(twist, limits) / 2
        if free_time(shape, start, twist.v / shape.cell, twist.omega, needed, needed) >= needed:
            scores = np.where(np.arange(2) == k, 0.0, -np.inf)
            arc = np.array([along_arc(ahead.x, ahead.y, ahead.theta, v, omega, t) for t in np.linspace(0.0, 2.0, 11)])
            return DwaResult(twist, candidates, scores, arc)
    return _halted(ahead, command, candidates, limits)


def _halted(ahead: Pose2, command: Twist, candidates: FloatArray, limits: DwaSettings) -> DwaResult:
    """Return braking, because none of the candidates (N, 2) is possible."""
    scores = np.full(len(candidates), -np.inf)
    return DwaResult(braking(command, limits), candidates, scores, ahead.array()[None], blocked=True)


def _step(command: Twist, wanted: Twist, limits: DwaSettings, motion: CommandedMotion | None) -> Twist:
    """Return the twist after one control period towards a wanted one; limited jerk along, and the line's curvature."""
    if motion is None:
        return towards(command, wanted, limits)
    v = towards(command, wanted, limits, motion).v
    share = max(v / wanted.v, 0.0)
    omega = min(max(wanted.omega * share, -limits.max_omega), limits.max_omega)
    return Twist(v, towards(command, Twist(v, omega), limits).omega)
