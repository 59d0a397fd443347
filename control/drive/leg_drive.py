"""Driving one leg of the plan: along its line, or by the dynamic window where no line has room or people are near."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.calibration.chair_body import BodyLayer, ChairBody
from waychair.control.drive.doors.live_jambs import DoorWatch
from waychair.control.drive.straying import Straying
from waychair.control.drive.way_follower import SEEN_AHEAD, WayFollower
from waychair.geometry import arc_lengths, nearest_step, transform_points
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.clearance import MAP_DOUBT
from waychair.planning.grid.drawn_map import DrawnMap
from waychair.planning.grid.fine_distances import fine_field
from waychair.planning.route.legs import PathLeg
from waychair.planning.seen.glass_gaps import openings
from waychair.planning.seen.person_tracks import Track
from waychair.planning.window.dwa import DwaResult, choose
from waychair.planning.window.motion_limits import CommandedMotion, DwaSettings, braking, slowing_speed
from waychair.planning.window.paper_dwa import choose_as_paper
from waychair.types import BoolArray, FloatArray, Path, Pose2, Twist

ROOMY = 0.1
"""m; room beside a line on the map in which the dynamic window may leave it."""

WALL_WITHIN = 0.06
"""m; beside a line a scan's point so near to a mapped wall belongs to that wall."""

WIDEST_OPENING, OPENING_SPEED, OPENING_SLOW_M = 1.8, 0.4, 0.8
"""m, m/s, m; with sonars: gaps of the map up to the first may hold glass, which sonars detect late, so the chair's front
passes them at the second speed, from the third distance on."""

PAPER_ENDS = 1.0
"""m before a leg's end from which the own window drives: the paper's equations know no stop and no heading at a goal."""


@dataclass(frozen=True, slots=True)
class LegInput:
    """The input of a leg's drive in one tick, in odom: pose, last command, and obstacles.

    `answered` is the pose at which a chair that answers late will have driven its late commands, else the pose itself.
    `seen` (N, 2) [m] are the points of this tick's scan, None without one. `unscanned` (M, 2) [m] are points that other
    sensors have seen; `layered` are those at the heights of one layer of the body. `local` makes the window of
    distances on request. `fastest` [m/s] is a limit from elsewhere. `motion` is that of the commands so far, `tracks` are the people to predict.
    """

    pose: Pose2
    answered: Pose2
    command: Twist
    local: Callable[[], DistanceField]
    odom_from_map: Pose2
    seen: FloatArray | None
    unscanned: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    motion: CommandedMotion | None = None
    tracks: tuple[Track, ...] = ()
    has_sonars: bool = False
    fastest: float = math.inf
    layered: tuple[tuple[BodyLayer, FloatArray], ...] = ()


class LegDrive:
    """The drive along one leg, with its state from tick to tick."""

    def __init__(
        self, leg: PathLeg, drawn: DrawnMap, body: ChairBody, straying: Straying | None = None, as_paper: bool = False
    ) -> None:
        """`straying`: the chair's on its lines before. `as_paper`: ahead, the source paper's window drives, up to
        `PAPER_ENDS` before the end."""
        self.leg = leg
        self.in_position = False
        self._body = body
        self._openings: FloatArray | None = None
        self._drawn = drawn
        self._has_room: BoolArray | None = None
        self._follower: WayFollower | None = None
        self._as_paper = as_paper and not leg.backwards
        if leg.rooms is not None and not self._as_paper:
            self._follower = WayFollower(leg, body, straying, MAP_DOUBT * drawn.grid.resolution)
        self._watches = [(door, DoorWatch(Pose2(), door.width)) for door in self.leg.doors]
        self._near: DistanceField | None = None  # in map
        self._points: FloatArray | None = None  # in odom, of the latest scan

    @property
    def is_barred(self) -> bool:
        """Whether something stands on the line ahead, as far as the live picture reaches."""
        return self._follower is not None and self._follower.is_barred

    def can_be_begun(self, command: Twist, limits: DwaSettings) -> bool:
        """Return whether a chair on the move can slow down in time for all of the line; the window finds its own speed."""
        return self._follower is None or self._follower.can_be_begun(command, limits)

    def remaining(self, pose: Pose2) -> float | None:
        """Return the distance [m] to the leg's end from a pose in map; None while turning there.

        A pending turn counts as distance, so that turning on the spot is progress.
        """
        if self.in_position or len(self.leg.path.poses) < 2:
            return None
        return _way_left(self.leg.path.poses, pose) if self._follower is None else self._follower.remaining(pose)

    def step(self, view: LegInput, limits: DwaSettings) -> DwaResult:
        """Return the next command; `arrived` when the leg is done and the chair stands."""
        if view.seen is not None:
            self._points = view.seen
        choice = (
            self._by_window(view, limits) if self._follower is None else self._along_line(self._follower, view, limits)
        )
        self.in_position = choice.in_position
        if view.fastest <= 0.0 and not choice.arrived:  # nothing creeps, and no corner swings, over a stop line
            return replace(choice, twist=braking(view.command, limits))
        return choice

    def _by_window(self, view: LegInput, limits: DwaSettings) -> DwaResult:
        """Return the dynamic window's choice along a leg without a line to be followed."""
        path = Path(self.leg.poses_in(view.odom_from_map))
        fastest = self._fastest(view, limits)
        if self._as_paper and (self.remaining(view.odom_from_map.inverse() @ view.pose) or 0.0) > PAPER_ENDS:
            slow = replace(limits, max_speed=max(0.0, min(limits.max_speed, fastest)))
            return choose_as_paper(view.answered, view.command, path, view.local(), self._body, slow)
        return choose(
            pose=view.answered,
            command=view.command,
            path=path,
            distances=view.local(),
            body=self._body,
            settings=limits,
            in_position=self.in_position,
            motion=view.motion,
            tracks=view.tracks,
            fastest=fastest,
        )

    def _along_line(self, follower: WayFollower, view: LegInput, limits: DwaSettings) -> DwaResult:
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
        fastest = self._fastest(view, limits)
        choice = follower.step(
            odom_from_map=view.odom_from_map,
            pose=view.answered,
            command=view.command,
            distances=self._near_field(view, opening),
            limits=limits,
            motion=view.motion,
            seen_doors=seen,
            fastest=fastest,
        )
        if not (view.tracks or follower.is_barred) or choice.in_position:
            return choice
        if self._has_room is None:
            self._has_room = self._drawn.fits_each(self.leg.path.poses, ROOMY)
        if not follower.is_ahead(self._has_room):
            return choice
        # somebody or something near the line, and room beside it on the map: the dynamic window weighs the arcs round it
        rest = follower.rest_in(view.odom_from_map)
        if self.leg.backwards or len(rest) < 2:
            return choice
        return choose(
            pose=view.answered,
            command=view.command,
            path=Path(rest),
            distances=view.local(),
            body=self._body,
            settings=limits,
            motion=view.motion,
            tracks=view.tracks,
            fastest=min(fastest, follower.top_speed(limits)),
        )

    def _fastest(self, view: LegInput, limits: DwaSettings) -> float:
        """Return the speed limit [m/s] that falls in time to that of openings ahead, where glass may be."""
        if not view.has_sonars:
            return view.fastest
        left = self.remaining(view.odom_from_map.inverse() @ view.pose) or 0.0
        left -= abs(view.command.v) * limits.reaction_time
        before = [slowing_speed(way, OPENING_SPEED, limits) for way in self._ways_to_openings(left)]
        return min((*before, view.fastest))

    def _ways_to_openings(self, left: float) -> list[float]:
        """Return the distances [m] to the slow zones of the openings ahead, from `left` [m] before the leg's end.

        A slow zone ends once the chair's front is through.
        """
        if self._openings is None:
            along = arc_lengths(self.leg.path.poses[:, :2])
            self._openings = along[-1] - along[openings(self._drawn.grid, self.leg.path.poses, WIDEST_OPENING)]
        front = left - self._body.front
        return [front - each - OPENING_SLOW_M for each in self._openings.tolist() if front > each]

    def _near_field(self, view: LegInput, opening: tuple[Pose2, float] | None) -> DistanceField:
        """Return distances to obstacles near the chair on fine cells, in odom, made anew with every scan.

        The map's walls and all points that the map does not explain count.
        """
        map_from_odom = view.odom_from_map.inverse()
        if self._near is None or view.seen is not None:
            points = view.unscanned if self._points is None else np.concatenate([self._points, view.unscanned])
            points = transform_points(map_from_odom, points)
            reach = self._body.circumscribed_radius + SEEN_AHEAD + 0.4
            layered = [(layer, transform_points(map_from_odom, seen)) for layer, seen in view.layered]
            self._near = fine_field(
                grid=self._drawn.grid,
                centre=map_from_odom @ view.pose,
                reach=reach,
                points=points,
                opening=opening,
                known_within=WALL_WITHIN,
                layered=layered,
            )
        return self._near.seen_from(view.odom_from_map)


def _way_left(poses: FloatArray, pose: Pose2) -> float:
    """Return the distance [m] to the end of a line of poses (N, 3), N >= 2, from its step that is nearest to a pose."""
    k, share = nearest_step(poses[:, :2], np.array([pose.x, pose.y]))
    along = arc_lengths(poses[k:, :2])
    return float(along[-1] - share * along[1])
