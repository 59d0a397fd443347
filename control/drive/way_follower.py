"""Follows a line of poses as fast as its bends and its room allow; the dynamic window only where the line is not free."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import arc_lengths, compose, wrap_angle
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.clearance import TRACKED
from waychair.planning.body.footprint import along_arc, fits_each, footprint, free_time, in_cells
from waychair.planning.route.legs import DoorPassage
from waychair.planning.route.speed_profile import RESERVE, curvatures, fastest_now, rooms_along, speeds_along
from waychair.planning.window.dwa import DwaResult, rotate_to_heading
from waychair.planning.window.motion_limits import (
    MIN_SPEED,
    PERIOD,
    CommandedMotion,
    DwaSettings,
    braking,
    stop_time,
)
from waychair.types import FloatArray, Pose2, Twist

LAG_S = 0.08
END_TOLERANCE, HEADING_TOLERANCE = 0.02, 0.03
TURN_FIRST, TURN_MIDWAY = 0.2, 0.9
STANDING = 0.01


_ROOMY, _ROOMY_OVER = 0.1, 2.0
"""m; room beside a line, over so much of it, in which the dynamic window may leave it."""


class WayFollower:
    """The drive along one line, with its state from tick to tick; poses (N, 3) in map."""

    def __init__(self, poses: FloatArray, backwards: bool, body: ChairBody, rooms: FloatArray) -> None:
        self._final = float(poses[-1, 2])
        keep = np.concatenate([[True], np.hypot(*np.diff(poses[:, :2], axis=0).T) > 1e-6])
        self.poses = poses[keep]
        self.along = arc_lengths(self.poses[:, :2])
        self.bends = curvatures(self.poses) if len(self.poses) > 1 else np.zeros(1)
        self.rooms, self.body, self.gear = rooms[keep], body, -1.0 if backwards else 1.0
        self.k = 0
        self.s = 0.0
        self.in_position = self.is_barred = False
        self.fastest = math.inf

    @property
    def is_roomy(self) -> bool:
        """Whether there is room beside the line for the next metres."""
        near = (self.along >= self.along[self.k]) & (self.along < self.along[self.k] + _ROOMY_OVER)
        return bool((self.rooms[near] >= _ROOMY).all())

    def rest_in(self, odom_from_map: Pose2) -> FloatArray:
        """Return the rest (N, 3) of the line in odom, with the last heading."""
        rest = compose(odom_from_map.array(), self.poses[self.k :])
        rest[-1, 2] = wrap_angle(self._final + odom_from_map.theta)
        return rest

    def remaining(self, pose: Pose2) -> float:
        """Return the distance [m] to the end from a pose in map."""
        s, _, _, _ = self._at(self.poses, pose)
        return max(0.0, float(self.along[-1]) - s)

    def _at(self, poses: FloatArray, pose: Pose2) -> tuple[float, float, float, float]:
        """Return the way driven [m], the lateral error [m], the heading error [rad] and the curvature [1/m]."""
        if len(poses) < 2:
            return 0.0, 0.0, 0.0, 0.0
        first, last = max(0, self.k - 6), min(len(poses) - 1, self.k + 14)
        a, b = poses[first:last, :2], poses[first + 1 : last + 1, :2]
        d = b - a
        long = np.maximum(np.hypot(*d.T), 1e-9)
        share = ((np.array([pose.x, pose.y]) - a) * d).sum(axis=1) / long**2
        within = np.clip(share, 0.0, 1.0)
        away = np.hypot(*(a + within[:, None] * d - (pose.x, pose.y)).T)
        j = int(np.argmin(away))
        k = first + j
        self.k = k
        if k == len(poses) - 2:
            within[j] = max(share[j], 0.0)
        direction = d[j] / long[j]
        lateral = float(direction[0] * (pose.y - a[j, 1]) - direction[1] * (pose.x - a[j, 0])) * self.gear
        w = min(float(within[j]), 1.0)
        heading = poses[k, 2] + w * wrap_angle(poses[k + 1, 2] - poses[k, 2])
        bend = (1 - w) * self.bends[k] + w * self.bends[k + 1]
        return float(self.along[k] + within[j] * long[j]), lateral, wrap_angle(pose.theta - heading), float(bend)

    def step(
        self,
        odom_from_map: Pose2,
        pose: Pose2,
        command: Twist,
        distances: DistanceField,
        limits: DwaSettings,
        motion: CommandedMotion | None,
        seen_doors: Sequence[tuple[DoorPassage, Pose2]] = (),
    ) -> DwaResult:
        """Return the next command; pose and distances in odom. `seen_doors`: doors with their measured odom_from_door."""
        poses = self._corrected(odom_from_map, seen_doors)
        final = wrap_angle(self._final + odom_from_map.theta)
        ahead = Pose2(*along_arc(pose.x, pose.y, pose.theta, command.v, command.omega, limits.reaction_time))
        s, lateral, off, bend = self._at(poses, ahead)
        left = float(self.along[-1]) - s
        kept = replace(limits, clearance=TRACKED, tolerances=replace(limits.tolerances, heading=HEADING_TOLERANCE))

        def turn_to(heading: float) -> DwaResult:
            return rotate_to_heading(
                pose=pose,
                command=command,
                heading=heading,
                distances=distances,
                body=self.body,
                settings=kept,
                motion=motion,
            )

        if self.in_position or (left <= END_TOLERANCE and abs(command.v) <= MIN_SPEED):
            self.in_position = True
            return replace(turn_to(final), in_position=True)
        stands = abs(command.v) < STANDING
        if abs(off) > (TURN_FIRST if stands else TURN_MIDWAY):
            turned = turn_to(wrap_angle(ahead.theta - off))
            if not (stands and turned.blocked and abs(off) < TURN_MIDWAY):
                return replace(turned, arrived=False)
        if self.gear < 0 and limits.max_reverse == 0.0:
            return self._halt(ahead, command, kept)
        lead = self._lead(command, kept, motion)
        speeds = speeds_along(self.bends, self.rooms, self.along, self.body, kept, self.gear)
        speeds[-1] = 0.0
        a, jerk = RESERVE * kept.braking, RESERVE * kept.jerk
        fastest = fastest_now(speeds, self.along, s, lead, a, jerk)
        self.fastest = fastest
        free = self._free_way(poses, s, distances)
        self.is_barred = free is not None
        if free is not None:
            fastest = min(fastest, fastest_now(np.zeros(1), np.array([s + free]), s, lead + 0.02, a, jerk))
            if free < 0.06 and stands:
                return self._halt(ahead, command, kept)
        v = self.gear * max(fastest, MIN_SPEED)
        speed = abs(v)
        room = float(self.rooms[min(self.k, len(self.rooms) - 1)])
        reach = max(float(np.interp(room, (0.04, 0.12), (0.16, 0.3))), 0.55 * abs(command.v))
        gain = 1.0 / reach
        damping = float(np.interp(abs(lateral), (0.02, 0.04), (1.6, 1.0)))
        pull = max(-0.5, min(0.5, gain * lateral)) * gain
        omega = v * bend * self.gear - v * pull - 2 * damping * speed * gain * off
        share = min(1.0, kept.max_omega / max(abs(omega), 1e-9))
        wanted = Twist(v * max(share, min(1.0, MIN_SPEED / speed)), omega * share)
        return self._admitted(ahead, command, wanted, distances, kept, motion)

    def _corrected(self, odom_from_map: Pose2, seen_doors: Sequence[tuple[DoorPassage, Pose2]]) -> FloatArray:
        """Return the line in odom (N, 3), moved onto the axes of the doors that are seen."""
        poses = compose(odom_from_map.array(), self.poses)
        for door, measured in seen_doors:
            middle = door.map_from_door
            k = int(np.argmin(np.hypot(*(self.poses[:, :2] - (middle.x, middle.y)).T)))
            if math.dist(self.poses[k, :2], (middle.x, middle.y)) > 0.3:
                continue
            off = measured @ (odom_from_map @ middle).inverse()
            before, after = self.along[k] - self.body.front - 0.3, self.along[k] + self.body.rear + 0.2
            away = np.maximum(np.maximum(before - self.along, self.along - after), 0.0)
            share = np.clip(1.0 - away / 1.0, 0.0, 1.0)[:, None]
            poses = poses + share * (compose(off.array(), poses) - poses)
        return poses

    def _lead(self, command: Twist, limits: DwaSettings, motion: CommandedMotion | None) -> float:
        faster = 0.0 if motion is None else max(self.gear * motion.acceleration.v, 0.0)
        v = max(self.gear * command.v, 0.0)
        return v * (PERIOD + LAG_S) + v * faster / limits.jerk + faster**3 / (3 * limits.jerk**2)

    def _free_way(self, poses: FloatArray, s: float, distances: DistanceField) -> float | None:
        """Return the distance [m] to the first pose ahead where the outline does not fit; None if all do."""
        near = (self.along > s) & (self.along < s + 1.6)
        if not near.any():
            return None
        free = fits_each(self.body, 0.0, distances, poses[near])
        if free.all():
            return None
        return float(self.along[near][np.argmin(free)] - s)

    def _admitted(
        self,
        ahead: Pose2,
        command: Twist,
        wanted: Twist,
        distances: DistanceField,
        limits: DwaSettings,
        motion: CommandedMotion | None,
    ) -> DwaResult:
        for margin in (limits.clearance, 0.0):
            shape, start = footprint(self.body, margin, distances), in_cells(distances, ahead)
            for share in (1.0, 0.5):
                for eased in (motion, None):
                    target = Twist(share * wanted.v, share * wanted.omega)
                    twist = self._stepped(command, target, limits, eased)
                    needed = PERIOD + stop_time(twist, limits) / 2
                    if free_time(shape, start, twist.v / shape.cell, twist.omega, needed, needed) >= needed:
                        arc = np.array(
                            [
                                along_arc(ahead.x, ahead.y, ahead.theta, target.v, target.omega, t)
                                for t in np.linspace(0.0, 2.0, 11)
                            ]
                        )
                        return DwaResult(twist, np.array([[target.v, target.omega]]), np.zeros(1), arc)
        return self._halt(ahead, command, limits)

    def _stepped(self, command: Twist, wanted: Twist, limits: DwaSettings, motion: CommandedMotion | None) -> Twist:
        """Return the next command on the wanted arc: the limiter shapes its growth, jerk is limited here on the way down."""
        if abs(wanted.v) >= abs(command.v) or command.v * wanted.v < 0.0:
            most = max(self.gear * command.v, 0.0) + limits.acceleration * PERIOD
            v = self.gear * min(abs(wanted.v), most)
        else:
            v = self.gear * self._slower(self.gear * command.v, abs(wanted.v), limits, motion)
        return Twist(v, wanted.omega * (v / wanted.v if wanted.v else 0.0))

    def _slower(self, v: float, wanted: float, limits: DwaSettings, motion: CommandedMotion | None) -> float:
        """Return the next speed [m/s] on the way down; the profile has seen to the end of the braking."""
        if motion is None:
            return max(wanted, v - limits.braking * PERIOD)
        a = max(min(self.gear * motion.acceleration.v, 0.0) - limits.jerk * PERIOD, -limits.braking)
        return max(wanted, v + a * PERIOD)

    def _halt(self, ahead: Pose2, command: Twist, limits: DwaSettings) -> DwaResult:
        return DwaResult(braking(command, limits), np.zeros((0, 2)), np.zeros(0), ahead.array()[None], blocked=True)


def follower(poses: FloatArray, backwards: bool, body: ChairBody, field: DistanceField) -> WayFollower:
    """Return the follower of a line in map, with its room on a field in map."""
    return WayFollower(poses, backwards, body, rooms_along(body, field, poses))
