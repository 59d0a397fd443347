"""Through a door: line up, look for the jambs, approach on their middle, and go through only when straight before it.

There is no second chance where the chair could no longer stop before the wall: at that gate it must head for a place
within 1.6 cm of the middle, or a fifth of the room beside it, and within three degrees, and still do so if it turns on
a little as it does; else it backs off and tries again.
Driving at an angle t through a wall of depth d takes W / cos t + d tan t: five degrees cost 1.6 cm in a wall of 0.15 m.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.config import Settings, setting
from waychair.control.doorway import DoorWatch, DoorwaySettings
from waychair.control.tracking import TrackingSettings, track
from waychair.geometry import compose
from waychair.maps.distance_field import DistanceField
from waychair.planning.dwa import DwaResult, rotate_to_heading
from waychair.planning.legs import Leg
from waychair.planning.motion import DwaSettings, Motion, braking
from waychair.types import FloatArray, Pose2, Twist

_BEHIND = 0.04
"""Kept free [m] in a retreat, which nobody has planned: behind, the map is all there is, and the place on it is as good
as 2 cm."""

_TURNS_ON = 0.4
"""For so long [s] a chair goes on as it did: steered back through a dead band it answers that late."""


@dataclass(frozen=True, slots=True)
class DoorDriveSettings(Settings):
    """When the chair may enter."""

    gate: float = setting(0.25, "m", "the front end this far before the middle: now or never", low=0.05, high=1.0)
    lateral: float = setting(0.016, "m", "off the axis, at the axle and where the front enters", low=0.005, high=0.2)
    lateral_share: float = setting(0.2, "", "or this part of the room on each side, if that is more", low=0.0, high=0.9)
    heading: float = setting(0.05, "rad", "off the axis", low=0.01, high=0.3)
    lined_up: float = setting(0.015, "rad", "how exactly it turns to the door before it sets off", low=0.005, high=0.3)
    tail_share: float = setting(
        0.47,
        "",
        "in the door errors die away over this part of the way from axle to tail, or more",
        low=0.0,
        high=2.0,
    )
    retreat: float = setting(0.8, "m", "backing off to try again", low=0.1, high=2.0)
    tries: int = setting(4, "", "retreats before it is given up", low=0, high=20)
    doorway: DoorwaySettings = field(default_factory=DoorwaySettings)
    retreating: TrackingSettings = field(default_factory=TrackingSettings)
    tracking: TrackingSettings = field(
        default_factory=lambda: TrackingSettings(return_length=0.3, damping=1.9, damping_off=1.9)
    )


class DoorDrive:
    """Keeps where the door is and how far the passage has come."""

    def __init__(self, leg: Leg, odom_from_map: Pose2, body: ChairBody, settings: DoorDriveSettings) -> None:
        assert leg.door is not None
        self._settings, self._body, self._door = settings, body, leg.door
        # each correction of the heading swings the tail: where that is far behind the axle, the chair comes back to the
        # middle over a longer way, its heading held as stiffly as before
        before = settings.tracking
        gentle = max(before.return_length, settings.tail_share * body.rear)
        damping = before.damping * gentle / before.return_length
        self._within = replace(before, return_length=gentle, damping=damping, damping_off=damping)
        self._longer = replace(body, length=body.length + _BEHIND, axle_from_rear=body.axle_from_rear + _BEHIND)
        self.watch = DoorWatch(odom_from_map @ leg.door.map_from_door, leg.door.width, settings.doorway)
        self._line = compose(leg.door.map_from_door.inverse().array(), leg.path.poses)  # in the door's own frame
        self._lined_up = self._entered = self._in_position = False
        self._retreating, self._turn_back = False, 0.0
        self._poses: deque[Pose2] = deque()  # in odom, the last ones
        self.tries = 0
        self.refused = False
        """Whether the chair stands at the last gate and will not enter: no door was found there, or never straight."""

    @property
    def entered(self) -> bool:
        """Whether the chair is past the point at which it might still back off."""
        return self._entered

    def believe(self, odom_from_map: Pose2) -> None:
        """Where the map has the door now; heeded until it is seen."""
        self.watch.believe(odom_from_map @ self._door.map_from_door)

    def step(
        self,
        pose: Pose2,
        command: Twist,
        distances: DistanceField,
        limits: DwaSettings,
        motion: Motion | None = None,
    ) -> DwaResult:
        """The next command; pose and distances in odom. `arrived` when the chair is through. motion: as in `track`."""
        door_from_odom = self.watch.odom_from_door.inverse()
        at, soon = door_from_odom @ pose, door_from_odom @ self._soon(pose, limits.period)
        front = at.x + self._body.front
        if not self._entered and not self._lined_up:
            if front > 0.0:  # it stands in the door: there is nothing left to line up
                self._entered = True
            else:
                turned = self._line_up(pose, command, distances, limits, motion)
                if turned is not None:
                    return turned
        if self._retreating:
            return self._retreat(at, pose, command, distances, limits)
        if not self._entered and front > -self._settings.gate:
            if not (self._straight(at) and self._straight(soon)):
                return self._back_off(at, command, limits)
            self._entered = True
        line = compose(self.watch.odom_from_door.array(), self._line)
        tracking = self._within if self._entered else self._settings.tracking
        done = self._in_position
        choice = track(pose, command, line, False, distances, self._body, limits, tracking, done, motion)
        self._in_position = choice.in_position
        return choice

    def _soon(self, pose: Pose2, period: float) -> Pose2:
        """Where a chair at a pose is soon, if it goes on just as it came there."""
        self._poses.append(pose)
        while len(self._poses) > 1 + round(_TURNS_ON / period):
            self._poses.popleft()
        return pose @ (self._poses[0].inverse() @ pose)

    def _straight(self, at: Pose2) -> bool:
        """Whether a pose in the door's frame is good enough to enter with, and the door surely where it seems."""
        s = self._settings
        room = (self.watch.width - self._body.width) / 2
        allowed = max(s.lateral, s.lateral_share * room)
        entering = at.y - at.x * math.tan(at.theta)  # where its middle line meets the door's plane
        return self.watch.sure and max(abs(at.y), abs(entering)) <= allowed and abs(at.theta) <= s.heading

    def _line_up(
        self, pose: Pose2, command: Twist, distances: DistanceField, limits: DwaSettings, motion: Motion | None
    ) -> DwaResult | None:
        """Turn in place to the door's direction; None once that is done."""
        limits = replace(
            limits,
            heading_tolerance=self._settings.lined_up,
            max_omega=min(limits.max_omega, self._settings.tracking.max_omega),
            margin=0.0,
        )
        heading = self.watch.odom_from_door.theta
        turned = rotate_to_heading(pose, command, heading, distances, self._body, limits, motion)
        self._lined_up = turned.arrived
        return None if turned.arrived else turned

    def _back_off(self, at: Pose2, command: Twist, limits: DwaSettings) -> DwaResult:
        """Stop, and turn back if there are tries left."""
        stopped = DwaResult(braking(command, limits), np.zeros((0, 2)), np.zeros(0), at.array()[None])
        if not self.watch.sure or self.tries >= self._settings.tries:
            self.refused = abs(command.v) < 0.01
            return replace(stopped, blocked=True)
        if abs(command.v) < 0.01:
            self.tries, self._retreating = self.tries + 1, True
            self._turn_back = at.x - self._settings.retreat
        return stopped

    def _retreat(
        self, at: Pose2, pose: Pose2, command: Twist, distances: DistanceField, limits: DwaSettings
    ) -> DwaResult:
        """Backwards along the axis, which already brings the chair nearer to it, then line up again.

        Where it must not drive backwards now, since somebody may be behind, it waits for that.
        """
        steps = np.linspace(at.x + 0.1, self._turn_back, 12)
        line = np.column_stack([steps, np.zeros((12, 2))])
        odom_line: FloatArray = compose(self.watch.odom_from_door.array(), line)
        choice = track(pose, command, odom_line, True, distances, self._longer, limits, self._settings.retreating)
        if limits.max_reverse == 0.0 and not choice.in_position:
            return choice
        if choice.in_position or choice.blocked:
            standing = abs(command.v) < 0.01
            self._retreating = not standing
            self._lined_up = not standing
            return replace(choice, twist=braking(command, limits), arrived=False, in_position=False, blocked=False)
        return choice
