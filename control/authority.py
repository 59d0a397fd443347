"""The part of a drive that a chair has been granted among other chairs: up to a stop line across its way.

An authority limits the speed so that the chair comes to rest in comfort before the line, whichever way it drives. It never
pushes, and no monitor or joystick asks it. Without an authority a chair drives alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import arc_lengths, compose, nearest_step
from waychair.planning.window.motion_limits import DwaSettings, slowing_speed
from waychair.types import BoolArray, FloatArray, Pose2

BEFORE_LINE = 0.04
"""m; the foremost corner stops so far before the line, which is about the error of the pose and of stopping."""

HELD_WITHIN = 0.25
"""m; a chair so near to its line stands for it, or is about to."""

_ASKEW = 0.6
"""rad; a chair that stands at a larger angle to its way turns before it drives on."""

_LOOKED_AT = 5.0
"""m of way ahead in which the line is looked for; no chair needs longer to stop."""


@dataclass(frozen=True, slots=True)
class Authority:
    """How far a chair may drive: not over the stop `line` (2, 2) [m] in map, from end to end; None: as far as it likes.

    With `stands` it may not move at all. `reason` is a sentence for the rider that waits. `speed` [m/s] is the highest one.
    """

    line: FloatArray | None = None
    reason: str = ""
    stands: bool = False
    speed: float = math.inf

    def way_left(self, body: ChairBody, pose: Pose2, poses: FloatArray) -> float:
        """Return the way [m] along planned poses (N, 3) until the chair's outline comes to the line; +inf if it does not.

        `pose` is where the chair is, in map as the line and the planned poses. 0 if the line is under the chair, or it stands.
        """
        if self.stands:
            return 0.0
        if self.line is None:
            return math.inf
        if crosses(self.line, body, pose.array()[None])[0]:
            return 0.0
        along = arc_lengths(poses[:, :2])
        here, k = _way_at(poses, along, pose)
        ahead = (along > here) & (along < here + _LOOKED_AT)
        on_line = crosses(self.line, body, poses[ahead])
        off = Pose2(*poses[k]).inverse() @ pose
        if abs(off.theta) < _ASKEW:  # as askew as it is now, the chair may reach the line by another corner before
            on_line |= crosses(self.line, body, compose(poses[ahead], np.array([0.0, off.y, off.theta])))
        if not on_line.any():
            return math.inf
        first = np.flatnonzero(ahead)[np.argmax(on_line)]
        # the outline comes to the line between this pose and the one before
        return max(float(along[max(first - 1, 0)]) - here, 0.0)


FREE = Authority()
"""The authority of a chair that is alone."""


def fastest_before(way: float, speed: float, limits: DwaSettings) -> float:
    """Return the highest speed [m/s] from which a chair, at a speed [m/s] now, stops in comfort within a way [m]."""
    if way == math.inf:
        return math.inf
    room = way - BEFORE_LINE - abs(speed) * limits.reaction_time
    return slowing_speed(room, 0.0, limits) if room > 0.0 else 0.0


def crosses(line: FloatArray, body: ChairBody, poses: FloatArray) -> BoolArray:
    """Return which poses (N, 3) put the chair's outline onto a line (2, 2)."""
    cos, sin = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    x, y = body.outline().T
    corners = poses[:, None, :2] + np.stack([cos * x - sin * y, sin * x + cos * y], axis=2)
    found = np.zeros(len(corners), np.bool_)
    a, b = line
    for k in range(4):
        p, q = corners[:, k], corners[:, (k + 1) % 4]
        meet = (_side(a, b, p) * _side(a, b, q) <= 0.0) & (_side(p, q, a) * _side(p, q, b) <= 0.0)
        near = (np.maximum(p, q) >= np.minimum(a, b)) & (np.minimum(p, q) <= np.maximum(a, b))
        found |= meet & near.all(axis=1)  # two segments on one straight line need not touch
    return found


def _side(a: FloatArray, b: FloatArray, p: FloatArray) -> FloatArray:
    """Return on which side of the line from a to b a point lies; points (..., 2)."""
    d, e = b - a, p - a
    side: FloatArray = d[..., 0] * e[..., 1] - d[..., 1] * e[..., 0]
    return side


def _way_at(poses: FloatArray, along: FloatArray, pose: Pose2) -> tuple[float, int]:
    """Return the way along poses (N, 3) at the point nearest to a pose, and the index of the pose before it."""
    if len(poses) < 2:
        return 0.0, 0
    k, share = nearest_step(poses[:, :2], pose.array()[:2])
    return float(along[k] + share * (along[k + 1] - along[k])), k
