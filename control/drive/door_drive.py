"""Driving through a door: line up, find the jambs, approach on their middle, and enter only when aligned.

The chair decides at the last point from which it can still stop before the wall. There it must head for a point within
1.6 cm of the middle, or a fifth of the space beside it, and within three degrees, also if its present turning goes on a
little. Otherwise it backs off and tries again.
A chair of width W at an angle t to a wall of depth d needs W / cos t + d tan t: five degrees cost 1.6 cm at 0.15 m.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.control.drive.line_tracking import TRACKING_OMEGA, TrackingGains, track
from waychair.control.drive.live_jambs import DoorWatch
from waychair.geometry import compose
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.clearance import RETREAT
from waychair.planning.route.legs import PathLeg
from waychair.planning.window.dwa import DwaResult, rotate_to_heading
from waychair.planning.window.motion_limits import PERIOD, CommandedMotion, DwaSettings, braking
from waychair.types import FloatArray, Pose2, Twist

_TURNS_ON = 0.4
"""s; the chair's present turning goes on for so long, because a correction through the dead band acts that late."""


GATE = 0.25
"""m; distance of the front end before the door's middle at which the chair enters or backs off."""

LATERAL, LATERAL_SHARE = 0.016, 0.2
"""m, share; largest offset from the axis at the gate, or this share of the space on each side if that is more."""

HEADING = 0.05
"""rad; largest heading error at the gate."""

LINED_UP = 0.015
"""rad; heading error up to which the chair turns to the door before it sets off."""

TAIL_SHARE = 0.47
"""In the door errors decay over at least this share of the distance from axle to tail."""

RETREAT_LENGTH, TRIES = 0.8, 4
"""m, count; length of a retreat before the next try, and most retreats."""

APPROACHING = TrackingGains(return_length=0.3, damping=1.9, damping_off=1.9)
"""Gains of the approach; the passage's decay length is longer for a chair with a long tail."""


class DoorDrive:
    """The state of one passage through a door."""

    def __init__(self, leg: PathLeg, odom_from_map: Pose2, body: ChairBody) -> None:
        assert leg.door is not None
        self._body, self._door = body, leg.door
        # each heading correction swings the tail: a chair with a long tail returns to the middle over a longer
        # distance, its heading held as stiffly as before
        before = APPROACHING
        gentle = max(before.return_length, TAIL_SHARE * body.rear)
        damping = before.damping * gentle / before.return_length
        self._within = replace(before, return_length=gentle, damping=damping, damping_off=damping)
        self._longer = replace(body, length=body.length + RETREAT, axle_from_rear=body.axle_from_rear + RETREAT)
        self.watch = DoorWatch(odom_from_map @ leg.door.map_from_door, leg.door.width)
        self._line = compose(leg.door.map_from_door.inverse().array(), leg.path.poses)  # in the door's own frame
        self._lined_up = self._entered = self._in_position = False
        self._retreating, self._turn_back = False, 0.0
        self._poses: deque[Pose2] = deque()  # in odom, the last ones
        self.tries = 0
        self.refused = False
        """Whether the chair stands at the last gate and gave up: it found no door there, or was never aligned with
        it."""

    @property
    def entered(self) -> bool:
        """Whether the chair is past the last point at which it could back off."""
        return self._entered

    def believe(self, odom_from_map: Pose2) -> None:
        """Take the door's place from the map; it counts until the door is seen."""
        self.watch.believe(odom_from_map @ self._door.map_from_door)

    def step(
        self,
        pose: Pose2,
        command: Twist,
        distances: DistanceField,
        limits: DwaSettings,
        motion: CommandedMotion | None = None,
    ) -> DwaResult:
        """Return the next command; `arrived` when the chair is through.

        Pose and distances are in odom; `motion` as in `tracking.track`.
        """
        door_from_odom = self.watch.odom_from_door.inverse()
        at, soon = door_from_odom @ pose, door_from_odom @ self._soon(pose, PERIOD)
        front = at.x + self._body.front
        if not self._entered and not self._lined_up:
            if front > 0.0:  # the chair stands in the door, so lining up is over
                self._entered = True
            else:
                turned = self._line_up(pose, command, distances, limits, motion)
                if turned is not None:
                    return turned
        if self._retreating:
            return self._retreat(at, pose, command, distances, limits)
        if not self._entered and front > -GATE:
            if not (self._straight(at) and self._straight(soon)):
                return self._back_off(at, command, limits)
            self._entered = True
        line = compose(self.watch.odom_from_door.array(), self._line)
        tracking = self._within if self._entered else APPROACHING
        done = self._in_position
        choice = track(
            pose=pose,
            command=command,
            poses=line,
            backwards=False,
            distances=distances,
            body=self._body,
            limits=limits,
            gains=tracking,
            in_position=done,
            motion=motion,
        )
        self._in_position = choice.in_position
        return choice

    def _soon(self, pose: Pose2, period: float) -> Pose2:
        """Return the pose in a moment if the chair goes on as in its last few ticks."""
        self._poses.append(pose)
        while len(self._poses) > 1 + round(_TURNS_ON / period):
            self._poses.popleft()
        return pose @ (self._poses[0].inverse() @ pose)

    def _straight(self, at: Pose2) -> bool:
        """Return whether a pose in the door's frame is aligned enough to enter, and the door's place is certain."""
        room = (self.watch.width - self._body.width) / 2
        allowed = max(LATERAL, LATERAL_SHARE * room)
        entering = at.y - at.x * math.tan(at.theta)  # the chair's middle line at the door's plane
        return self.watch.sure and max(abs(at.y), abs(entering)) <= allowed and abs(at.theta) <= HEADING

    def _line_up(
        self, pose: Pose2, command: Twist, distances: DistanceField, limits: DwaSettings, motion: CommandedMotion | None
    ) -> DwaResult | None:
        """Turn on the spot to the door's direction; None once that is done."""
        limits = replace(
            limits,
            tolerances=replace(limits.tolerances, heading=LINED_UP),
            max_omega=min(limits.max_omega, TRACKING_OMEGA),
            clearance=0.0,
        )
        heading = self.watch.odom_from_door.theta
        turned = rotate_to_heading(
            pose=pose,
            command=command,
            heading=heading,
            distances=distances,
            body=self._body,
            settings=limits,
            motion=motion,
        )
        self._lined_up = turned.arrived
        return None if turned.arrived else turned

    def _back_off(self, at: Pose2, command: Twist, limits: DwaSettings) -> DwaResult:
        """Stop, and retreat if there are tries left."""
        stopped = DwaResult(braking(command, limits), np.zeros((0, 2)), np.zeros(0), at.array()[None])
        if not self.watch.sure or self.tries >= TRIES:
            self.refused = abs(command.v) < 0.01
            return replace(stopped, blocked=True)
        if abs(command.v) < 0.01:
            self.tries, self._retreating = self.tries + 1, True
            self._turn_back = at.x - RETREAT_LENGTH
        return stopped

    def _retreat(
        self, at: Pose2, pose: Pose2, command: Twist, distances: DistanceField, limits: DwaSettings
    ) -> DwaResult:
        """Drive backwards along the door's axis, which also brings the chair nearer to the axis, then line up again.

        While reversing is forbidden, because somebody may be behind, the chair waits.
        """
        steps = np.linspace(at.x + 0.1, self._turn_back, 12)
        line = np.column_stack([steps, np.zeros((12, 2))])
        odom_line: FloatArray = compose(self.watch.odom_from_door.array(), line)
        choice = track(
            pose=pose,
            command=command,
            poses=odom_line,
            backwards=True,
            distances=distances,
            body=self._longer,
            limits=limits,
        )
        if limits.max_reverse == 0.0 and not choice.in_position:
            return choice
        if choice.in_position or choice.blocked:
            standing = abs(command.v) < 0.01
            self._retreating = not standing
            self._lined_up = not standing
            return replace(choice, twist=braking(command, limits), arrived=False, in_position=False, blocked=False)
        return choice
