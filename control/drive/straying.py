"""How far a chair strays from the line that it follows, for its speed: it decides how fast the chair may be beside things.

A chair that answers late (`answer_time.py`), or not as foreseen, strays. A line that moves under the chair, by what the
scans show of a door or by a correction of the pose, is no fault of the chair's: what the line moved counts only until the
chair is on it again.
"""

from __future__ import annotations

import math

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.control.answer_time import AnswerTime
from waychair.planning.route.speed_profile import faster_end
from waychair.planning.window.motion_limits import ERROR_STANDING, PERIOD
from waychair.types import FloatArray, Pose2, Twist

JUDGED_FROM, FORGETS_OVER = 0.1, 8.0
"""[m/s] Speed from which straying is judged; [m] way over which it is forgotten."""

STEP, GENTLEST = 0.05, 3.0
"""[s] Steps in which straying per speed of the faster end counts. A chair that strays returns to the line over up to so many
times the distance, so that it does not swing about it."""


class Straying:
    """The straying of one chair from its lines, one after the other, in odom, from tick to tick."""

    def __init__(self, body: ChairBody, tolerance: float, answers: AnswerTime | None = None) -> None:
        """`tolerance` [rad]: a smaller error of the heading is none. `answers`: by default it answers as foreseen."""
        self._answers = answers
        self._reach, self._tolerance, self._body = max(body.front, body.rear), tolerance, body
        self._own = 0.0  # [s] for each m/s of the faster end: what is remembered
        self.begin_line()

    def begin_line(self) -> None:
        """Begin another line: how far the chair is off it at first is no fault of the chair's."""
        self._was_on_line = False
        self._off = 0.0  # [s] what straying is now
        self._moved = 0.0  # [m] how far the line moved since the chair was last on it
        self._line: FloatArray | None = None

    def answered(self, command: Twist, odom_from_base: Pose2) -> Pose2:
        """Take in the last command and the pose of a tick; return where the chair will have driven the commands that it answers
        late: the pose itself if it answers as foreseen."""
        if self._answers is None:
            return odom_from_base
        self._answers.note_pose(command, odom_from_base)
        return self._answers.answered(odom_from_base)

    @property
    def seconds(self) -> float:
        """How far off the line the chair has to be expected, for each m/s of its faster end [s], in steps of `STEP`."""
        late = 0.0 if self._answers is None else self._answers.may_be_late_s
        return STEP * math.floor(max(self._own, self._off, late) / STEP + 1e-9)

    @property
    def gentler(self) -> float:
        """So many times farther on the chair returns to its line."""
        return min(max(self._own / STEP / 2, 1.0), GENTLEST)

    def note(self, line: FloatArray, k: int, lateral: float, heading: float, bend: float, speed: float) -> None:
        """Take in a tick: the line (N, 3), the chair's step on it, its errors [m, rad], the curvature [1/m] and speed [m/s]."""
        self._moved += 0.0 if self._line is None else self._shift(line[k], self._line[k])
        self._line = line
        off = abs(lateral) + max(abs(heading) - self._tolerance, 0.0) * self._reach
        if off < ERROR_STANDING and abs(heading) < self._tolerance:
            self._was_on_line, self._moved = True, 0.0
        if not self._was_on_line or speed <= JUDGED_FROM:
            self._off = 0.0
            return
        end_speed = speed * float(faster_end(np.array([bend]), self._body)[0])
        kept = self._own * (1.0 - speed * PERIOD / FORGETS_OVER)
        self._off = (off - ERROR_STANDING) / end_speed
        self._own = max(kept, self._off - self._moved / end_speed)

    def _shift(self, now: FloatArray, before: FloatArray) -> float:
        """Return how far [m] a pose of the line has moved aside, with what its turn moves the chair's farther end."""
        moved = Pose2(*before).inverse() @ Pose2(*now)
        return abs(moved.y) + abs(moved.theta) * self._reach
