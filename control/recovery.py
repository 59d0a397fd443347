"""What to do when the chair makes no way: wait first, then back out the way it came, then give up.

Standing still and coming no nearer to the goal are both noticed by time. Backing out takes back the way that was
driven, the only one that is known to have been free, and more of it at each try: two who wait for each other part so.
Where somebody may have come there since, the chair waits instead, and so it does for those who walk about in front of
it: they go on by themselves.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.config import Settings, setting
from waychair.maps.distance_field import DistanceField
from waychair.planning.dwa import DwaResult
from waychair.planning.escape import back_up, kept_footprint
from waychair.planning.footprint import Footprint
from waychair.planning.motion import DwaSettings
from waychair.types import Pose2, Twist

_UNSURE = 0.005
"""Nearer by this [m] than the chair has been may be noise of its place."""

_ENOUGH = 0.02
"""Farther than this [m] from everything a chair that backs out may come nearer: it moves, and its place is noisy."""

_LEAP = 0.3
"""No chair goes so far [m] from one tick to the next."""

_FARTHEST = 4
"""At each try it backs out farther, up to so many times the way of the first."""

_SAME_PLACE = 0.1
"""A chair that tries to back out again within this [m] of where it was held up gives nothing more away."""


@dataclass(frozen=True, slots=True)
class RecoverySettings(Settings):
    """How long to wait, how far to back out, and how often."""

    wait: float = setting(
        2.0, "s", "standing still this long before backing out, longer at each try", low=0.1, high=600
    )
    progress_time: float = setting(8.0, "s", "coming no nearer this long: back out and try again", low=1.0, high=600.0)
    progress: float = setting(0.1, "m", "nearer by this much is progress", low=0.01, high=5.0)
    turning_time: float = setting(5.0, "s", "turning no farther this long: back out and try again", low=1.0, high=600.0)
    turning: float = setting(0.1, "rad", "turned by this much is progress", low=0.01, high=3.0)
    way: float = setting(0.4, "m", "how far to back out at first, farther at each try", low=0.05, high=5.0)
    held_up: float = setting(1.0, "s", "backing out is given up when it is impossible this long", low=0.0, high=60.0)
    tries: int = setting(6, "", "giving up after so many", low=0, high=100)
    past: float = setting(1.0, "m", "nearer by this much than when it tried last: tries count anew", low=0.1, high=50.0)
    patience: float = setting(20.0, "s", "standing still this long before giving up", low=1.0, high=3600.0)
    patience_with_people: float = setting(60.0, "s", "as above, among people who walk", low=1.0, high=3600.0)
    about: float = setting(1.0, "m", "who walks this near to the chair is waited for", low=0.0, high=10.0)


class Recovery:
    """Keeps the clocks, the trail of the chair, and whether it is backing out."""

    def __init__(self, settings: RecoverySettings) -> None:
        self._settings = settings
        self._trail: deque[Pose2] = deque(maxlen=100)
        self.tries = 0
        self.begun = 0  # how often it has begun to back out, of all goals
        self._standing_since: int | None = None
        self._nearest: tuple[int, float] | None = None  # when, and how near to the goal [m]
        self._turned: tuple[int, Pose2] | None = None  # when the chair, turning, last came to be elsewhere, and where
        self._backing: tuple[int, Pose2] | None = None  # since when, and from where
        self._keeps = Pose2(), -math.inf  # where it backed out last, and what it kept free there [m]
        self._held_up_since: int | None = None
        self._tried_at: float | None = None  # how near to the goal [m]

    @property
    def exhausted(self) -> bool:
        """Whether all tries have been made."""
        return self.tries > self._settings.tries

    @property
    def backing(self) -> bool:
        """Whether the chair is on its way out backwards."""
        return self._backing is not None

    def reset(self) -> None:
        """A new goal: the trail is kept, and what was kept free here."""
        self.tries, self._tried_at, self._standing_since = 0, None, None
        self._nearest, self._turned, self._backing = None, None, None

    def stands(self, now_ns: int) -> float:
        """Told that nothing is possible in this tick; how long [s] that has been so."""
        self._standing_since = now_ns if self._standing_since is None else self._standing_since
        return self.standing(now_ns)

    def standing(self, now_ns: int) -> float:
        """How long [s] nothing has been possible."""
        return 0.0 if self._standing_since is None else (now_ns - self._standing_since) * 1e-9

    def moves(self) -> None:
        """Told that there is something to do."""
        self._standing_since = None

    def stands_to_plan(self, duration_ns: int) -> None:
        """Told that the chair stood for so long to plan, which is neither being stuck nor making no way."""
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
    ) -> DwaResult | None:
        """A command for backing out, or None while following the path is right.

        `remaining` [m] is the way to the goal, None while turning at it or trying a door again. `local` gives the
        distances round the chair, in the pose's frame, where nothing jumps, when they are needed. Who `waits` for people
        begins no backing, and ends it.
        """
        if waits:
            self._backing, self._nearest, self._turned = None, None, None
        if remaining is not None and self._tried_at is not None and remaining < self._tried_at - self._settings.past:
            self.tries, self._tried_at = 0, None
        if self._backing is None:
            self._remember(pose)
            if waits or not self._stuck(now_ns, pose, remaining):
                return None
            self._backing, self._held_up_since, self.tries = (now_ns, pose), None, self.tries + 1
            self.begun += 1
            if remaining is not None:
                self._tried_at = min(remaining, math.inf if self._tried_at is None else self._tried_at)
        self._take_back(pose)
        since, origin = self._backing
        trail = np.array([passed.array() for passed in self._trail])
        near = local()
        shape = self._shape(pose, near, body, settings.margin)
        s = self._settings
        times = min(self.tries, _FARTHEST)
        way, longest_s = times * s.way, times * s.progress_time
        choice = back_up(pose, command, trail, near, shape, settings, way + 0.1)
        backed = math.hypot(pose.x - origin.x, pose.y - origin.y)
        lasted = (now_ns - since) * 1e-9
        self._held_up_since = (self._held_up_since or now_ns) if choice.blocked else None
        held_up = 0.0 if self._held_up_since is None else (now_ns - self._held_up_since) * 1e-9
        if backed < way and lasted < longest_s and held_up < s.held_up:
            return choice
        self._backing, self._nearest, self._turned = None, None, None
        return None

    def _shape(self, pose: Pose2, near: DistanceField, body: ChairBody, margin: float) -> Footprint:
        """The body with as much free round it as it has had since it began to back out, or tried before, or enough."""
        before, keeps = self._keeps
        if math.hypot(before.x - pose.x, before.y - pose.y) > _SAME_PLACE:
            keeps = -math.inf
        shape, left = kept_footprint(pose, near, body, margin, keeps)
        self._keeps = pose, keeps if left is None else max(keeps, min(left, _ENOUGH) - _UNSURE)
        return shape

    def _stuck(self, now_ns: int, pose: Pose2, remaining: float | None) -> bool:
        s = self._settings
        if self._standing_since is not None:
            return (now_ns - self._standing_since) * 1e-9 >= s.wait * (1 + self.tries)
        if remaining is None:
            self._nearest = None
            since_ns, there = self._turned or (now_ns, pose)
            off = there.inverse() @ pose
            moved = abs(off.theta) > s.turning or math.hypot(off.x, off.y) > s.progress
            self._turned = (now_ns, pose) if moved else (since_ns, there)
            return (now_ns - self._turned[0]) * 1e-9 >= s.turning_time
        self._turned = None
        if self._nearest is None or remaining < self._nearest[1] - s.progress:
            self._nearest = (now_ns, remaining)
        return (now_ns - self._nearest[0]) * 1e-9 >= s.progress_time

    def _remember(self, pose: Pose2) -> None:
        """Where the chair came along; of another drive, or before a leap of the odometry, nothing leads here."""
        way = math.hypot(self._trail[-1].x - pose.x, self._trail[-1].y - pose.y) if self._trail else math.inf
        if way > _LEAP:
            self._trail.clear()
        if way > 0.05:
            self._trail.append(pose)

    def _take_back(self, pose: Pose2) -> None:
        """Drop what of the trail now lies ahead of the chair."""
        while len(self._trail) > 1 and (pose.inverse() @ self._trail[-1]).x > 0:
            self._trail.pop()
