"""Follows a line of poses as fast as its bends, its room and what stands on it allow.

The chair steers back onto the line by feedback in C. Samson's path coordinates (IEEE Trans. Automatic Control 40(1),
1995): errors decay over the distance driven, so that it acts the same at every speed and backwards. Where the chair stands,
it turns to the line's heading before it drives.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.control.drive.straying import Straying
from waychair.geometry import arc_lengths, compose, wrap_angle
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.clearance import HARD, TRACKED
from waychair.planning.body.footprint import along_arc, fits_each, footprint, free_time, in_cells
from waychair.planning.route.leaving_a_wall import standing_body
from waychair.planning.route.legs import DoorPassage, PathLeg
from waychair.planning.route.speed_profile import RESERVE, curvatures, fastest_now, next_acceleration, speeds_along
from waychair.planning.window.dwa import DwaResult, rotate_to_heading
from waychair.planning.window.motion_limits import (
    MIN_SPEED,
    PERIOD,
    CommandedMotion,
    DwaSettings,
    braking,
    stop_time,
)
from waychair.types import BoolArray, FloatArray, Pose2, Twist

LAG_S = 0.08
"""[s] The chair answers a command so much later than the next period."""

END_TOLERANCE, HEADING_TOLERANCE = 0.02, 0.03
"""[m], [rad] Tolerances at a line's end, along the line and, unless a goal allows more, of the heading."""

TURN_FIRST, TURN_MIDWAY = 0.2, 0.9
"""[rad] A standing chair farther off the line's heading turns before it drives; a driving chair stops and turns."""

STANDING = 0.01
"""[m/s] The chair stands below this speed."""

LOOK_AHEAD = 2.0
"""[m] Length of line that is called ahead."""

SEEN_AHEAD = 1.6
"""[m] The live picture is compared with so much of the line."""

SCAN_NOISE = 0.02
"""[m] What stands on the line by less may be noise of the scan, or of the pose; each step is checked by itself."""

AT_ONCE = 0.06
"""[m] A standing chair whose line is barred so near does not set off."""

BESIDE = 0.02
"""[m] Farther off the line the plan does not tell free space, and the wide margin is kept."""

FIRST_LOOK = 3.0
"""[m] Beginning of the line on which the chair is looked for at first; it has driven on since the plan began."""

_DOOR_ON_LINE, _EASES_OVER = 0.3, 1.0
"""[m] A door no farther from the line moves it; the line eases into its correction over the second length."""

_EASE = 0.5
"""Part of a change of the turn rate that is commanded at once. The pose ahead is foreseen with the last turn rate: all of it
would be answered by its opposite in the next period."""

_PULL = 0.5
"""Largest pull back onto the line, as a lateral error in units of the distance over which it decays."""


@dataclass(frozen=True, slots=True)
class _OnLine:
    """A pose on a line: the way driven [m], the errors to the left [m] and in heading [rad], the curvature [1/m]."""

    way: float
    lateral: float
    heading: float
    bend: float


class WayFollower:
    """The drive along the line of one leg, with its state from tick to tick; the line is in map."""

    def __init__(self, leg: PathLeg, body: ChairBody, straying: Straying | None = None, doubt: float = 0.0) -> None:
        """`straying`: the chair's on its lines before. `doubt` [m]: by so much the cells of a coarse map may reach beyond the
        true obstacles.

        Raises:
            ValueError: the leg does not tell its room.
        """
        if leg.rooms is None:
            raise ValueError("a line is followed by the room beside it, and this leg has none")
        poses = leg.path.poses
        kept = np.concatenate([[True], np.hypot(*np.diff(poses[:, :2], axis=0).T) > 1e-6])
        self._body, self._doubt = body, doubt
        self.poses, self._kept = poses[kept], kept
        self._final = float(poses[-1, 2])
        self._along, self._bends = arc_lengths(self.poses[:, :2]), curvatures(self.poses)
        self._rooms, self._gear = leg.rooms[kept], -1.0 if leg.backwards else 1.0
        self._k: int | None = None  # the step of the line on which the chair is
        self.in_position = self.is_barred = False
        self._straying = straying or Straying(body, HEADING_TOLERANCE)
        self._profile: tuple[DwaSettings | None, float, FloatArray] = None, 0.0, np.zeros(0)
        self._speeds = np.zeros(1), np.zeros(1)  # of the last tick, [m/s] and [m] along the line

    def is_ahead(self, there: BoolArray) -> bool:
        """Return whether something holds at all of the leg's poses (N,) in the next metres."""
        at = self._along[self._k or 0]
        near = (self._along >= at) & (self._along < at + LOOK_AHEAD)
        return bool(there[self._kept][near].all())

    def rest_in(self, odom_from_map: Pose2) -> FloatArray:
        """Return the rest (N, 3) of the line in odom, with the last heading."""
        rest = compose(odom_from_map.array(), self.poses[self._k or 0 :])
        rest[-1, 2] = wrap_angle(self._final + odom_from_map.theta)
        return rest

    def remaining(self, pose: Pose2) -> float:
        """Return the distance [m] to the end from a pose in map; a turn before it counts by 0.5 m/rad."""
        at = self._at(self.poses, pose, keeps=False)
        return max(0.0, float(self._along[-1]) - at.way) + _TURN_AS_WAY * abs(at.heading)

    def step(
        self,
        odom_from_map: Pose2,
        pose: Pose2,
        command: Twist,
        distances: DistanceField,
        limits: DwaSettings,
        motion: CommandedMotion | None,
        seen_doors: Sequence[tuple[DoorPassage, Pose2]] = (),
        fastest: float = math.inf,
    ) -> DwaResult:
        """Return the next command; pose and distances in odom.

        `seen_doors`: doors with their measured odom_from_door. `fastest` [m/s] is a limit from elsewhere. On the line the
        narrow margin is kept if the wide one blocks; a chair that seems to touch a mapped obstacle comes no nearer to it.
        """
        if self._k is None:
            self._straying.begin_line()
        poses = self._corrected(odom_from_map, seen_doors)
        ahead = Pose2(*along_arc(pose.x, pose.y, pose.theta, command.v, command.omega, limits.reaction_time))
        at = self._at(poses, ahead)
        here = self._at(poses, pose, keeps=False)
        self._straying.note(poses, self._k or 0, here.lateral, here.heading, here.bend, abs(command.v))
        heading = max(limits.tolerances.heading, HEADING_TOLERANCE)
        kept = replace(limits, tolerances=replace(limits.tolerances, heading=heading))
        tick = _Tick(poses, pose, ahead, command, at, distances, motion, odom_from_map.theta, fastest)
        result = self._with(self._body, replace(kept, clearance=TRACKED), tick)
        if result.blocked and (len(poses) == 1 or abs(at.lateral) <= BESIDE):
            tight = replace(kept, clearance=HARD)
            result = self._with(self._body, tight, tick)
            shorter = standing_body(distances, self._body, pose, self._doubt) if result.blocked else None
            if shorter is not None and shorter is not self._body:
                result = self._with(shorter, tight, tick)
        self.in_position = result.in_position
        return result

    def _with(self, body: ChairBody, limits: DwaSettings, tick: _Tick) -> DwaResult:
        """Return the command for a body and a clearance."""
        at, command = tick.at, tick.command

        def turn_to(heading: float) -> DwaResult:
            return rotate_to_heading(
                pose=tick.pose,
                command=command,
                heading=heading,
                distances=tick.distances,
                body=body,
                settings=limits,
                motion=tick.motion,
            )

        left = float(self._along[-1]) - at.way
        if self.in_position or (left <= END_TOLERANCE and abs(command.v) <= MIN_SPEED):
            return replace(turn_to(wrap_angle(self._final + tick.turned)), in_position=True)
        stands = abs(command.v) < STANDING
        if abs(at.heading) > (TURN_FIRST if stands else TURN_MIDWAY):
            turned = turn_to(wrap_angle(tick.ahead.theta - at.heading))
            if not (stands and turned.blocked and abs(at.heading) < TURN_MIDWAY):
                return replace(turned, arrived=False)
        if self._gear < 0.0 and limits.max_reverse == 0.0:
            return _halted(tick, limits)
        speed, free = self._speed(body, limits, tick)
        if free is not None and free < AT_ONCE and stands:
            return _halted(tick, limits)
        wanted = self._feedback(at, command.omega, speed, limits)
        return self._admitted(body, limits, tick, wanted)

    def _speed(self, body: ChairBody, limits: DwaSettings, tick: _Tick) -> tuple[float, float | None]:
        """Return the next speed [m/s], and the free way [m] on the line; None if all of it is free."""
        at, motion = tick.at, tick.motion
        v = max(self._gear * tick.command.v, 0.0)
        a = 0.0 if motion is None else self._gear * motion.acceleration.v
        speeds, along = self._speeds_within(limits), self._along
        free = self._free_way(body, tick)
        self.is_barred = free is not None
        if free is not None:
            k = int(np.searchsorted(along, at.way + free))
            speeds, along = np.append(speeds[:k], 0.0), np.append(along[:k], at.way + free - END_TOLERANCE)
        self._speeds = speeds, along
        jerk = limits.braking / PERIOD if motion is None else limits.jerk
        then = next_acceleration(speeds, along, at.way + v * LAG_S, v, a, limits.acceleration, limits.braking, jerk)
        if then >= min(a + jerk * PERIOD, limits.acceleration) - 1e-9:  # the limiter shapes the way up
            then = min(a + 2 * jerk * PERIOD, limits.acceleration)
        speed = v + then * PERIOD if then > 0.0 else max(v + then * PERIOD, MIN_SPEED)
        return min(speed, max(tick.fastest, v - limits.braking * PERIOD)), free

    def _speeds_within(self, limits: DwaSettings) -> FloatArray:
        """Return (N,) [m/s] the speeds at the line's poses, with a stop at its end; computed when the limits change."""
        before, strayed, speeds = self._profile
        of_speed = replace(limits, clearance=HARD)  # no speed depends on it, and it changes within a tick
        strays = self._straying.seconds
        if before != of_speed or strayed != strays:
            speeds = speeds_along(self._bends, self._rooms, self._along, self._body, limits, self._gear, strays)
            speeds[-1] = 0.0
            self._profile = of_speed, strays, speeds
        return speeds

    def top_speed(self, limits: DwaSettings) -> float:
        """Return the highest speed [m/s] that the line ahead allowed in the last tick, whatever the speed was then."""
        speeds, along = self._speeds
        return fastest_now(
            speeds, along, float(self._along[self._k or 0]), RESERVE * limits.braking, RESERVE * limits.jerk
        )

    def can_be_begun(self, command: Twist, limits: DwaSettings) -> bool:
        """Return whether a chair on the move at the line's beginning can slow down in time for all of it.

        At these speeds its error stays within the room; one that is faster in a bend leaves the line.
        """
        highest = fastest_now(self._speeds_within(limits), self._along, 0.0, limits.braking, limits.jerk)
        return self._gear * command.v <= highest + _NEGLIGIBLE

    def _feedback(self, at: _OnLine, turns: float, speed: float, limits: DwaSettings) -> Twist:
        """Return a speed [m/s] along the line, and the turn rate back onto it; the last one was `turns` [rad/s]."""
        v = self._gear * speed
        room = float(self._rooms[min(self._k or 0, len(self._rooms) - 1)])
        gain = 1.0 / max(self._straying.gentler * float(np.interp(room, _ROOM, _RETURN)), _RETURN_S * speed)
        damping = float(np.interp(abs(at.lateral), (BESIDE, 2 * BESIDE), _DAMPING))
        pull = max(-_PULL, min(_PULL, gain * at.lateral)) * gain
        omega = v * at.bend * self._gear - v * pull - 2 * damping * speed * gain * at.heading
        omega = turns + _EASE * (omega - turns)
        share = min(1.0, limits.max_omega / max(abs(omega), 1e-9))
        return Twist(v * max(share, min(1.0, MIN_SPEED / max(speed, 1e-9))), omega * share)

    def _at(self, poses: FloatArray, pose: Pose2, keeps: bool = True) -> _OnLine:
        """Return a pose on the nearest step of the line near the last one; `keeps` it as the last one."""
        if len(poses) < 2:
            return _OnLine(0.0, 0.0, 0.0, 0.0)
        if self._k is None:
            first, last = 0, max(1, int(np.searchsorted(self._along, FIRST_LOOK)))
        else:
            first, last = max(0, self._k - 6), self._k + 14
        last = min(len(poses) - 1, last)
        a, b = poses[first:last, :2], poses[first + 1 : last + 1, :2]
        steps = b - a
        long = np.maximum(np.hypot(*steps.T), 1e-9)
        share = ((np.array([pose.x, pose.y]) - a) * steps).sum(axis=1) / long**2
        within = np.clip(share, 0.0, 1.0)
        j = int(np.argmin(np.hypot(*(a + within[:, None] * steps - (pose.x, pose.y)).T)))
        k = first + j
        if keeps:
            self._k = k
        w = float(within[j])
        onwards = max(float(share[j]), 0.0) if k == len(poses) - 2 else w
        x, y = self._gear * steps[j] / long[j]
        lateral = float(x * (pose.y - a[j, 1]) - y * (pose.x - a[j, 0]))
        heading = poses[k, 2] + w * wrap_angle(poses[k + 1, 2] - poses[k, 2])
        bend = (1 - w) * self._bends[k] + w * self._bends[k + 1]
        return _OnLine(
            float(self._along[k] + onwards * long[j]), lateral, wrap_angle(pose.theta - heading), float(bend)
        )

    def _corrected(self, odom_from_map: Pose2, seen_doors: Sequence[tuple[DoorPassage, Pose2]]) -> FloatArray:
        """Return the line in odom (N, 3), moved onto the axes of the doors that are seen."""
        poses = compose(odom_from_map.array(), self.poses)
        for door, measured in seen_doors:
            middle = door.map_from_door
            k = int(np.argmin(np.hypot(*(self.poses[:, :2] - (middle.x, middle.y)).T)))
            if math.dist(self.poses[k, :2], (middle.x, middle.y)) > _DOOR_ON_LINE:
                continue
            off = measured @ (odom_from_map @ middle).inverse()
            before, after = self._along[k] - self._body.front - 0.3, self._along[k] + self._body.rear + 0.2
            away = np.maximum(np.maximum(before - self._along, self._along - after), 0.0)
            share = np.clip(1.0 - away / _EASES_OVER, 0.0, 1.0)[:, None]
            poses = poses + share * (compose(off.array(), poses) - poses)
        return poses

    def _free_way(self, body: ChairBody, tick: _Tick) -> float | None:
        """Return the distance [m] to the first pose ahead where the outline does not fit; None if all do."""
        near = (self._along > tick.at.way) & (self._along < tick.at.way + SEEN_AHEAD)
        if not near.any():
            return None
        free = fits_each(body, -SCAN_NOISE, tick.distances, tick.poses[near])
        return None if free.all() else float(self._along[near][np.argmin(free)] - tick.at.way)

    def _admitted(self, body: ChairBody, limits: DwaSettings, tick: _Tick, wanted: Twist) -> DwaResult:
        """Return the first step towards the wanted twist, or half of it, from which the chair can stop; else braking.

        A step with limited jerk from which it could not stop is tried again without that limit.
        """
        shape, start = footprint(body, limits.clearance, tick.distances), in_cells(tick.distances, tick.ahead)
        for eased in (None,) if tick.motion is None else (tick.motion, None):
            for share in (1.0, 0.5):
                target = Twist(share * wanted.v, share * wanted.omega)
                twist = _stepped(tick.command, target, self._gear, limits, eased)
                needed = PERIOD + stop_time(twist, limits) / 2
                if free_time(shape, start, twist.v / shape.cell, twist.omega, needed, needed) >= needed:
                    x, y, theta = tick.ahead.x, tick.ahead.y, tick.ahead.theta
                    times = np.linspace(0.0, 2.0, 11)
                    arc = np.array([along_arc(x, y, theta, target.v, target.omega, t) for t in times])
                    return DwaResult(twist, np.array([[target.v, target.omega]]), np.zeros(1), arc)
        return _halted(tick, limits)


_NEGLIGIBLE = 0.1
"""[m/s] A chair too fast by no more for the beginning of its line brakes on it."""

_TURN_AS_WAY = 0.5
"""[m/rad] Distance that a turn counts for where progress is judged."""

_ROOM, _RETURN, _RETURN_S = (0.04, 0.12), (0.16, 0.3), 0.55
"""[m], [m], [s] Distance over which an error decays, by the room beside the line; at speed it is as long as this time."""

_DAMPING = (1.6, 1.0)
"""Damping of the heading on the line, where a small error must not swing the ends out, and off it; 1 is critical."""


@dataclass(frozen=True, slots=True)
class _Tick:
    """The input of one tick in odom: the line (N, 3), poses now and after the reaction time, what is near, and limits."""

    poses: FloatArray
    pose: Pose2
    ahead: Pose2
    command: Twist
    at: _OnLine
    distances: DistanceField
    motion: CommandedMotion | None
    turned: float
    """[rad] odom_from_map's heading."""
    fastest: float


def _stepped(command: Twist, wanted: Twist, gear: float, limits: DwaSettings, motion: CommandedMotion | None) -> Twist:
    """Return the next command on the wanted arc; with a motion the jerk is limited on the way down."""
    before = gear * command.v
    slowing = limits.braking
    if motion is not None:
        slowing = min(limits.jerk * PERIOD - min(gear * motion.acceleration.v, 0.0), slowing)
    v = max(abs(wanted.v), before - slowing * PERIOD)
    omega = wanted.omega * (v / abs(wanted.v) if wanted.v else 0.0)
    return Twist(gear * v, max(-limits.max_omega, min(limits.max_omega, omega)))


def _halted(tick: _Tick, limits: DwaSettings) -> DwaResult:
    """Return braking, because no motion along the line is possible."""
    nothing = np.zeros((0, 2))
    return DwaResult(braking(tick.command, limits), nothing, np.zeros(0), tick.ahead.array()[None], blocked=True)
