"""Driving one leg of the plan in its manner: free by the dynamic window, exact on its line, or through a door."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.calibration.chair_body import BodyLayer, ChairBody
from waychair.control.drive.door_drive import DoorDrive
from waychair.control.drive.doorway import DoorWatch
from waychair.control.drive.line_tracking import TRACKING_SPEED, on_line, track
from waychair.control.drive.way_follower import WayFollower, follower
from waychair.geometry import compose, transform_points
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.clearance import MAP_DOUBT
from waychair.planning.grid.fine_distances import fine_field
from waychair.planning.route.legs import DoorPassage, DrivingManner, PathLeg, joined_legs
from waychair.planning.route.way_making import field_round
from waychair.planning.seen.openings import openings
from waychair.planning.seen.person_tracks import Track
from waychair.planning.window.dwa import DwaResult, choose
from waychair.planning.window.motion_limits import CommandedMotion, DwaSettings, slowing_speed
from waychair.types import FloatArray, IntArray, OccupancyGrid, Path, Pose2, Twist

_HAND_OVER = 0.15
"""m; a leg that flows into the next one may be left so far before its end."""


_TURN_AS_WAY = 0.5
"""m/rad; distance that a turn counts for where progress is judged."""


WALL_WITHIN = 0.06
"""m; on exact legs and in doors a scan's point so near to a mapped wall belongs to that wall."""

WIDEST_OPENING, OPENING_SPEED, OPENING_SLOW_M = 1.8, 0.4, 0.8
"""m, m/s, m; with sonars: gaps of the map up to the first may hold glass, which sonars detect late, so the chair's front
passes them at the second speed, from the third distance on."""


@dataclass(frozen=True, slots=True)
class View:
    """The input of a leg's drive in one tick, in odom: pose, last command, and obstacles.

    `seen` (N, 2) [m] are the points of this tick's scan, None without one. `unscanned` (M, 2) [m] are points that other
    sensors have seen; `layered` are those at the heights of one layer of the body. `local` makes the window of
    distances on request. `motion` is that of the commands so far, `tracks` are the people to predict.
    """

    pose: Pose2
    command: Twist
    local: Callable[[], DistanceField]
    odom_from_map: Pose2
    seen: FloatArray | None
    unscanned: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    motion: CommandedMotion | None = None
    tracks: tuple[Track, ...] = ()
    has_sonars: bool = False
    layered: tuple[tuple[BodyLayer, FloatArray], ...] = ()


class LegDrive:
    """The drive along one leg, with its state from tick to tick."""

    def __init__(self, legs: Sequence[PathLeg], grid: OccupancyGrid, body: ChairBody) -> None:
        """Drive the first of the legs; the next one tells how it ends."""
        self.leg = legs[0]
        # the dynamic window must see the path go on, or it would brake at the leg's end
        self._poses = joined_legs(tuple(legs[:2])).poses if self.leg.flows else self.leg.path.poses
        self._into_exact = self.leg.flows and len(legs) > 1 and legs[1].manner is not DrivingManner.FREE
        self.in_position = False
        self._grid, self._body = grid, body
        self._door: DoorDrive | None = None
        self._openings: FloatArray | None = None
        self._follower: WayFollower | None = None
        self._watches = [(door, DoorWatch(Pose2(), door.width)) for door in self.leg.doors]
        self._near: DistanceField | None = None  # in map
        self._points: FloatArray | None = None  # in odom, of the latest scan

    @property
    def entered(self) -> bool:
        """Whether the chair is in a door, where it must go on."""
        return self._door is not None and self._door.entered

    @property
    def refused_door(self) -> DoorPassage | None:
        """The leg's door if the chair gave up entering it as a door."""
        return self.leg.door if self._door is not None and self._door.refused else None

    @property
    def is_barred(self) -> bool:
        """Whether something stands on the line ahead, as far as the live picture reaches."""
        return self._follower is not None and self._follower.is_barred

    def remaining(self, pose: Pose2) -> float | None:
        """Return the distance [m] to the leg's end from a pose in map; None while turning there or retrying a door.

        A pending turn counts as distance, so that turning on the spot is progress.
        """
        if self.in_position or len(self.leg.path.poses) < 2 or (self._door is not None and self._door.tries):
            return None  # a door counts its own tries
        at = on_line(self.leg.path.poses, pose, self.leg.backwards)
        return max(0.0, at.remaining) + _TURN_AS_WAY * abs(at.heading)

    def step(self, view: View, limits: DwaSettings) -> DwaResult:
        """Return the next command; `arrived` when the leg is done and the chair stands."""
        if view.seen is not None:
            self._points = view.seen
        if self.leg.manner is DrivingManner.FREE:
            path = Path(compose(view.odom_from_map.array(), self._poses))
            choice = choose(
                pose=view.pose,
                command=view.command,
                path=path,
                distances=view.local(),
                body=self._body,
                settings=limits,
                in_position=self.in_position,
                motion=view.motion,
                tracks=view.tracks,
                fastest=self._fastest(view, limits),
            )
            if self.leg.flows and self._passes(view):
                choice = replace(choice, arrived=True)
        elif self.leg.manner is DrivingManner.LINE:
            choice = self._along_line(view, limits)
        elif self.leg.manner is DrivingManner.EXACT:
            poses = self.leg.poses_in(view.odom_from_map)
            choice = track(
                pose=view.pose,
                command=view.command,
                poses=poses,
                backwards=self.leg.backwards,
                distances=self._near_field(view, None),
                body=self._body,
                limits=limits,
                in_position=self.in_position,
                motion=view.motion,
                doubt=MAP_DOUBT * self._grid.resolution,
            )
        else:
            choice = self._through_door(view, limits)
        self.in_position = choice.in_position
        return choice

    def _along_line(self, view: View, limits: DwaSettings) -> DwaResult:
        if self._follower is None:
            field = field_round(self._grid, self.leg.path.poses[:, :2])
            self._follower = follower(self.leg.path.poses, self.leg.backwards, self._body, field)
        seen, opening = [], None
        for door, watch in self._watches:
            watch.believe(view.odom_from_map @ door.map_from_door)
            at = watch.odom_from_door.inverse() @ view.pose
            if at.x > self._body.rear + 0.3 or at.x < -4.0:
                continue
            if view.seen is not None:
                watch.see(view.seen, view.pose @ self._body.base_from_laser)
            if watch.sure:
                seen.append((door, watch.odom_from_door))
                opening = opening or (view.odom_from_map.inverse() @ watch.odom_from_door, watch.width)
        choice = self._follower.step(
            view.odom_from_map, view.pose, view.command, self._near_field(view, opening, 2.0), limits, view.motion, seen
        )
        if not (view.tracks or self._follower.is_barred) or choice.in_position or not self._follower.is_roomy:
            return choice
        # somebody or something near the line, and room beside it: the dynamic window weighs the arcs round it
        rest = self._follower.rest_in(view.odom_from_map)
        if self.leg.backwards or len(rest) < 2:
            return choice
        return choose(
            pose=view.pose,
            command=view.command,
            path=Path(rest),
            distances=view.local(),
            body=self._body,
            settings=limits,
            motion=view.motion,
            tracks=view.tracks,
            fastest=self._follower.fastest,
        )

    def _fastest(self, view: View, limits: DwaSettings) -> float:
        """Return the speed limit [m/s] that falls in time to those of a following exact leg and of openings ahead."""
        if not self._into_exact and not view.has_sonars:
            return math.inf
        left = on_line(self.leg.path.poses, view.odom_from_map.inverse() @ view.pose).remaining
        left -= abs(view.command.v) * limits.reaction_time
        fastest = [math.inf]
        if self._into_exact:
            fastest.append(slowing_speed(left - _HAND_OVER, TRACKING_SPEED, limits))
        if view.has_sonars:
            fastest += [slowing_speed(way, OPENING_SPEED, limits) for way in self._ways_to_openings(left)]
        return min(fastest)

    def _ways_to_openings(self, left: float) -> list[float]:
        """Return the distances [m] to the slow zones of the openings ahead, from `left` [m] before the leg's end.

        A slow zone ends once the chair's front is through.
        """
        if self._openings is None:
            self._openings = self._before_end(openings(self._grid, self.leg.path.poses, WIDEST_OPENING))
        front = left - self._body.front
        return [front - each - OPENING_SLOW_M for each in self._openings.tolist() if front > each]

    def _before_end(self, indices: IntArray) -> FloatArray:
        """Return the distances (K,) [m] from some of the leg's poses to its end."""
        steps = np.hypot(*np.diff(self.leg.path.poses[:, :2], axis=0).T)
        ways: FloatArray = np.append(np.cumsum(steps[::-1])[::-1], 0.0)[indices]
        return ways

    def _passes(self, view: View) -> bool:
        """Return whether the chair is at the end of a leg that flows into the next one, and heads along it."""
        end = view.odom_from_map @ Pose2(*self.leg.path.poses[-1])
        off = end.inverse() @ view.pose
        return off.x > -_HAND_OVER and abs(off.y) < 2 * _HAND_OVER and abs(off.theta) < 0.5

    def _through_door(self, view: View, limits: DwaSettings) -> DwaResult:
        if self._door is None:
            self._door = DoorDrive(self.leg, view.odom_from_map, self._body)
        door = self._door
        door.believe(view.odom_from_map)
        if view.seen is not None:
            door.watch.see(view.seen, view.pose @ self._body.base_from_laser)
        opening = None
        if door.watch.sure:
            opening = (view.odom_from_map.inverse() @ door.watch.odom_from_door, door.watch.width)
        return door.step(view.pose, view.command, self._near_field(view, opening), limits, view.motion)

    def _near_field(self, view: View, opening: tuple[Pose2, float] | None, more: float = 0.5) -> DistanceField:
        """Return distances to obstacles near the chair on fine cells, in odom, made anew with every scan.

        The map's walls and all points that the map does not explain count.
        """
        map_from_odom = view.odom_from_map.inverse()
        if self._near is None or view.seen is not None:
            points = view.unscanned if self._points is None else np.concatenate([self._points, view.unscanned])
            points = transform_points(map_from_odom, points)
            reach = self._body.circumscribed_radius + more
            layered = [(layer, transform_points(map_from_odom, seen)) for layer, seen in view.layered]
            self._near = fine_field(
                grid=self._grid,
                centre=map_from_odom @ view.pose,
                reach=reach,
                points=points,
                opening=opening,
                known_within=WALL_WITHIN,
                layered=layered,
            )
        return self._near.seen_from(view.odom_from_map)
