"""Recovery of a chair that makes no progress: wait first, then back out along its own trail, then only wait.

Standing still and coming no nearer to the goal are both judged by time. Backing out follows the trail that was driven,
the only path known to have been free, and goes farther at each try, so that two chairs waiting for each other part. If
somebody may have entered that area since, the chair waits instead. It also waits for people that walk in front of it,
because they move on by themselves.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.config import Settings, given, setting
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.clearance import BACKING_OUT, BACKING_OUT_NOISE
from waychair.planning.body.footprint import Footprint
from waychair.planning.window.backing_out import back_up, kept_footprint
from waychair.planning.window.dwa import DwaResult
from waychair.planning.window.motion_limits import DwaSettings
from waychair.types import Pose2, Twist

_LEAP = 0.3
"""m; a larger step from one tick to the next is a jump of the odometry."""

_FARTHEST = 4
"""Each try backs out farther, up to so many times the first try's distance."""

_HERE = 0.5
"""m; a backing that begins within this distance of the last one's beginning repeats it."""

_SAME_PLACE = 0.1
"""m; a try within this distance of the last one keeps the last one's clearance."""


PROGRESS_M, PROGRESS_RAD = 0.1, 0.1
"""m, rad; a smaller approach to the goal, or a smaller turn at it, is no progress."""

TURNING_TIME_S = 5.0
"""s; a chair that turns without progress for so long backs out."""

BACKING_LENGTH = 0.4
"""m; distance of the first backing; each further try goes farther."""

BLOCKED_S = 1.0
"""s; a backing that is blocked for so long is given up."""

REST_S, AMONG_THINGS_S = 10.0, 2.0
"""s; a chair that has backed out often enough stands for so long before it tries to go on again: while there are people
about, who may move on, and among things alone, for whose sake a wait is lost."""

TRIES_RESET = 1.0
"""m; the tries count anew once the chair is nearer to the goal by this than at its last try."""


@dataclass(frozen=True, slots=True)
class RecoverySettings(Settings):
    """Waiting times before backing out and giving up, and the number of tries.

    `wait` [s]: standstill before the chair first backs out, more at each further try; `progress_time` [s] without
    progress before it does. `tries`: times that it backs out at one place before it only waits there.
    """

    wait: float = given(2.0)
    progress_time: float = given(8.0)
    tries: int = given(2)
    patience: float = setting(
        120.0,
        "s",
        "time for which the chair waits at a shut door, or for somebody in its way, before it gives up its goal; "
        "larger: it gives up later",
        low=1.0,
        high=3600.0,
    )


class Recovery:
    """The clocks, the chair's trail, and the state of backing out."""

    def __init__(self, settings: RecoverySettings) -> None:
        self._settings = settings
        self._trail: deque[Pose2] = deque(maxlen=100)
        self.tries = 0
        self.begun = 0  # number of backings begun, over all goals
        self._standing_since: int | None = None
        self._nearest: tuple[int, float] | None = None  # time of the last progress, and distance to the goal [m]
        self._turned: tuple[int, Pose2] | None = None  # time and pose of the last progress in turning
        self._backing: tuple[int, Pose2] | None = None  # start time and start pose
        self._kept_clearance = Pose2(), -math.inf  # pose of the last backing, and its clearance there [m]
        self._blocked_since: int | None = None
        self._tried_at: float | None = None  # smallest distance to the goal of all tries [m]
        self._begun_at: Pose2 | None = None  # where the latest backing began
        self.repeats = False
        """Whether the present backing begins where the one before began, which has not helped."""
        self._rests_until: int | None = None
        self._first_rest: int | None = None  # start of the first rest at this place

    @property
    def exhausted(self) -> bool:
        """Whether all tries have been made."""
        return self.tries > self._settings.tries

    @property
    def backing(self) -> bool:
        """Whether the chair is backing out."""
        return self._backing is not None

    def reset(self) -> None:
        """Start anew for another goal; the trail and the clearance kept here stay."""
        self.tries, self._tried_at, self._standing_since = 0, None, None
        self._nearest, self._turned, self._backing = None, None, None
        self._rests_until = self._first_rest = self._begun_at = None
        self.repeats = False

    def rest(self, now_ns: int, people: bool) -> None:
        """Stand for a while before the next try to go on, longer among people; no further backing out at this place."""
        self.tries, self.repeats = self._settings.tries, False
        self._backing, self._nearest, self._turned = None, None, None
        self._rests_until = now_ns + round((REST_S if people else AMONG_THINGS_S) * 1e9)
        self._first_rest = now_ns if self._first_rest is None else self._first_rest

    def rests(self, now_ns: int) -> bool:
        """Return whether the chair stands for a `rest`."""
        if self._rests_until is not None and now_ns >= self._rests_until:
            self._rests_until = None
            self.note_motion()
        return self._rests_until is not None

    def rested_s(self, now_ns: int) -> float:
        """Return for how long [s] the chair has rested and tried at this place; 0 before the first rest."""
        return 0.0 if self._first_rest is None else (now_ns - self._first_rest) * 1e-9

    def note_standstill(self, now_ns: int) -> float:
        """Note that no motion is possible in this tick; return for how long [s] that has been so."""
        self._standing_since = now_ns if self._standing_since is None else self._standing_since
        return self.standing_s(now_ns)

    def standing_s(self, now_ns: int) -> float:
        """Return for how long [s] no motion has been possible."""
        return 0.0 if self._standing_since is None else (now_ns - self._standing_since) * 1e-9

    def note_motion(self) -> None:
        """Note that motion is possible in this tick."""
        self._standing_since = None

    def note_longer_way(self) -> None:
        """Note that the chair now follows a longer way to its goal, so that its progress counts from there."""
        self._nearest = None

    def leave_out_planning(self, duration_ns: int) -> None:
        """Leave out the time for which the chair stood to plan, because it was not stuck then."""
        if self._standing_since is not None:
            self._standing_since += duration_ns
        if self._nearest is not None:
            self._nearest = self._nearest[0] + duration_ns, self._nearest[1]
        if self._turned is not None:
            self._turned = self._turned[0] + duration_ns, self._turned[1]

    def step(
        self,
        now_ns: int,
        pose: Pose2,
        remaining: float | None,
        command: Twist,
        local: Callable[[], DistanceField],
        body: ChairBody,
        settings: DwaSettings,
        waits: bool = False,
        may_back: bool = True,
    ) -> DwaResult | None:
        """Return a command for backing out, or None while the path is to be followed.

        `remaining` [m] is the distance to the goal, None while turning there. `local` computes the
        distances round the chair in the pose's frame, which must not jump. A chair that `waits` for people does not
        start to back out, and stops doing so. One that must not back (`may_back`) has no tries left once it is stuck.
        """
        if waits:
            self._backing, self._nearest, self._turned = None, None, None
        if remaining is not None and self._tried_at is not None and remaining < self._tried_at - TRIES_RESET:
            self.tries, self._tried_at, self._first_rest = 0, None, None
        if self._backing is None:
            self._remember(pose)
            if waits or not self._stuck(now_ns, pose, remaining):
                return None
            if not may_back:
                self.tries = self._settings.tries + 1
                return None
            self._backing, self._blocked_since, self.tries = (now_ns, pose), None, self.tries + 1
            self.begun += 1
            at = self._begun_at
            self.repeats = at is not None and math.dist((at.x, at.y), (pose.x, pose.y)) < _HERE
            self._begun_at = pose
            if remaining is not None:
                self._tried_at = min(remaining, math.inf if self._tried_at is None else self._tried_at)
        self._take_back(pose)
        since, origin = self._backing
        trail = np.array([passed.array() for passed in self._trail])
        near = local()
        shape = self._shape(pose, near, body, settings.clearance)
        s = self._settings
        times = min(self.tries, _FARTHEST)
        way, longest_s = times * BACKING_LENGTH, times * s.progress_time
        choice = back_up(
            pose=pose, command=command, trail=trail, distances=near, shape=shape, settings=settings, way=way + 0.1
        )
        backed = math.hypot(pose.x - origin.x, pose.y - origin.y)
        lasted = (now_ns - since) * 1e-9
        self._blocked_since = (self._blocked_since or now_ns) if choice.blocked else None
        held_up = 0.0 if self._blocked_since is None else (now_ns - self._blocked_since) * 1e-9
        if backed < way and lasted < longest_s and held_up < BLOCKED_S:
            return choice
        self._backing, self._nearest, self._turned = None, None, None
        return None

    def _shape(self, pose: Pose2, near: DistanceField, body: ChairBody, margin: float) -> Footprint:
        """Return the footprint grown by the clearance that this backing, or the last one here, has kept so far."""
        before, kept = self._kept_clearance
        if math.hypot(before.x - pose.x, before.y - pose.y) > _SAME_PLACE:
            kept = -math.inf
        shape, left = kept_footprint(pose, near, body, margin, kept)
        self._kept_clearance = pose, kept if left is None else max(kept, min(left, BACKING_OUT) - BACKING_OUT_NOISE)
        return shape

    def _stuck(self, now_ns: int, pose: Pose2, remaining: float | None) -> bool:
        s = self._settings
        if self._standing_since is not None:
            return (now_ns - self._standing_since) * 1e-9 >= s.wait * (1 + self.tries)
        if remaining is None:
            self._nearest = None
            since_ns, there = self._turned or (now_ns, pose)
            off = there.inverse() @ pose
            moved = abs(off.theta) > PROGRESS_RAD or math.hypot(off.x, off.y) > PROGRESS_M
            self._turned = (now_ns, pose) if moved else (since_ns, there)
            return (now_ns - self._turned[0]) * 1e-9 >= TURNING_TIME_S
        self._turned = None
        if self._nearest is None or remaining < self._nearest[1] - PROGRESS_M:
            self._nearest = (now_ns, remaining)
        return (now_ns - self._nearest[0]) * 1e-9 >= s.progress_time

    def _remember(self, pose: Pose2) -> None:
        """Add a pose to the trail; after a jump of the odometry the trail starts anew."""
        way = math.hypot(self._trail[-1].x - pose.x, self._trail[-1].y - pose.y) if self._trail else math.inf
        if way > _LEAP:
            self._trail.clear()
        if way > 0.05:
            self._trail.append(pose)

    def _take_back(self, pose: Pose2) -> None:
        """Drop the end of the trail that now lies ahead of the chair."""
        while len(self._trail) > 1 and (pose.inverse() @ self._trail[-1]).x > 0:
            self._trail.pop()
