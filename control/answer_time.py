"""How late a chair answers its commands: by its own motion, compared with the commands of the last moments.

A chair that answers later than its file says still drives what it was told before. Where it will be once it has done that
follows from those commands, so it is steered from there, as any other chair from where it stands. A loop that took the delay
for a lack of speed would add what comes anyway.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from waychair.planning.body.footprint import along_arc
from waychair.planning.window.motion_limits import PERIOD
from waychair.types import Pose2, Twist

LATEST_S = 0.6
"""[s] How much later than foreseen an answer may come to be noticed."""

UNPROVEN_S = 0.3
"""[s] So late a chair may answer that has not moved yet."""

FORGETS_S = 4.0
"""[s] of motion over which the comparison is forgotten."""

LATE_FROM, TELLING, CLEARER = 3, 3, 0.4
"""[ticks], [ticks], share. A chair is late from the first on, if commands that much older than foreseen leave at most the share of
the motion unexplained that the foreseen ones leave. It is in time if the foreseen ones, or younger ones, leave at most the share
of what is left by those that are older by the first and the second together."""

LEAST_MOTION = 0.05
"""[m] Way of both wheels, of the time that is remembered, from which a chair is judged."""

MOST_PER_STEP = 0.3
"""[m], [rad] A larger step from one tick to the next is a jump of the odometry."""

_MOVES = 0.02
"""[m/s] Slower wheels tell nothing."""


class AnswerTime:
    """The commands of the last moments, and how much of the motion they leave unexplained by their age, from tick to tick."""

    def __init__(self, track: float, foreseen_s: float) -> None:
        """`track` [m] between the drive wheels; `foreseen_s` [s] from a command's first tick to the chair's motion."""
        self._half_track = track / 2
        self._foreseen = round(foreseen_s / PERIOD)  # ticks
        ages = self._foreseen + round(LATEST_S / PERIOD) + 1
        self._commands: deque[Twist] = deque([Twist()] * ages, ages)  # the latest first
        self._unexplained = np.zeros(ages)  # [m^2/s] by the commands' age in ticks
        self._moved = 0.0  # [m]
        self._late = 0  # ticks
        self._is_known = False
        self._before: Pose2 | None = None

    @property
    def late_s(self) -> float:
        """By how much later [s] than foreseen the chair answers, as far as it has shown it."""
        return self._late * PERIOD

    @property
    def may_be_late_s(self) -> float:
        """By how much later [s] the chair answers, or may answer until it has shown it."""
        return self.late_s if self._is_known else UNPROVEN_S

    def note_pose(self, command: Twist, odom_from_base: Pose2) -> None:
        """Take in a tick: the last command, and the pose now."""
        step = Pose2() if self._before is None else self._before.inverse() @ odom_from_base
        self._before = odom_from_base
        jumps = max(abs(step.x), abs(step.y), abs(step.theta)) > MOST_PER_STEP
        self.note(command, None if jumps else Twist(step.x / PERIOD, step.theta / PERIOD))

    def note(self, command: Twist, measured: Twist | None) -> None:
        """Take in a tick: the last command, and the mean motion since the tick before, None if it tells nothing."""
        self._commands.appendleft(command)
        if measured is None:
            return
        motion = np.array([measured.v, self._half_track * measured.omega])
        told = np.array([(each.v, self._half_track * each.omega) for each in self._commands])
        if not (np.isfinite(motion).all() and np.isfinite(told).all()):
            return
        if max(np.abs(motion).max(), np.abs(told).max()) < _MOVES:
            return
        kept = 1.0 - PERIOD / FORGETS_S
        self._unexplained = kept * self._unexplained + ((told - motion) ** 2).sum(axis=1) * PERIOD
        self._moved = kept * self._moved + float(np.abs(motion).sum()) * PERIOD
        if self._moved >= LEAST_MOTION:
            self._judge()

    def answered(self, pose: Pose2) -> Pose2:
        """Return where a chair at a pose will be once it has driven the late commands: the pose itself if none is late."""
        x, y, theta = pose.x, pose.y, pose.theta
        for age in range(self._foreseen + self._late - 1, self._foreseen - 1, -1):
            each = self._commands[age]
            x, y, theta = along_arc(x, y, theta, each.v, each.omega, PERIOD)
        return Pose2(x, y, theta)

    def _judge(self) -> None:
        left, late = self._unexplained, self._foreseen + LATE_FROM
        best = int(np.argmin(left))
        if best >= late and left[best] <= CLEARER * left[self._foreseen]:
            found = best - self._foreseen
            self._late, self._is_known = found if abs(found - self._late) > 1 else self._late, True
        elif left[:late].min() <= CLEARER * left[max(self._foreseen + self._late, late + TELLING)]:
            self._late, self._is_known = 0, True
