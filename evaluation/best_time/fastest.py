"""The least time of a drive between two poses at rest: path and timing optimised together.

Path and timing depend on each other: a wider bend is longer and faster. So the unknowns are poses, speeds and
accelerations at equidistant times (knots), and the time between them.

1. `first_way.py` searches a way on a lattice by a rough time; it decides on which side of things the chair passes.
2. `programme.py` shortens the time between the knots by successive linear programmes in a trust region (SLP: Fletcher
   and Sainz de la Maza 1989; for motions: sequential convex optimisation, Schulman et al., IJRR 2014; successive
   convexification, Mao, Szmuk and Acikmese, CDC 2016).
3. The motion is integrated densely and checked: exact outline, limits, end pose. One that exceeds a limit between the knots
   is stretched in time. One that touches something there is optimised again with a little clearance. So `seconds` is the time of a motion that the chair could drive.

The result is an upper bound of the true least time: the best motion beside the first way, on a grid of times. Along a
path that is fixed, the problem is time-optimal path parameterisation (TOPP: Bobrow, Dubowsky and Gibson, IJRR 1985;
TOPP-RA: Pham and Pham, T-RO 2018; with limited jerk: Consolini, Locatelli and Minari, T-ASE 2022).
"""

from __future__ import annotations

import math

import numpy as np

from evaluation.best_time.comfort import Comfort
from evaluation.best_time.first_way import FirstWay, first_way, timed
from evaluation.best_time.gaps import BoxesRound
from evaluation.best_time.motion import BestDrive, faults, integrated, motion_through, within_limits
from evaluation.best_time.programme import MotionTask, shortened
from waychair.errors import PlanningError
from waychair.geometry import wrap_angle
from waychair.types import Pose2

_SPACINGS_S = (0.25, 0.125)
"""[s] Time between two knots of the first way, in turn, until the exact outline is free also between them: a third of the
time in which the jerk builds up the acceleration, and half of that, for turns of a corner past another one."""

_MOST_KNOTS = 360
"""A longer drive than 90 s, or 45 s, has its knots farther apart."""

_CLEARANCES = (0.003, 0.006, 0.012)
"""[m] Least gap at the knots, in turn, likewise."""


class NoBestTime(PlanningError):
    """No motion within the limits was found, though there is a way."""


def best_drive(around: BoxesRound, start: Pose2, goal: Pose2, comfort: Comfort) -> BestDrive:
    """Return the fastest motion found from rest at one pose to rest at another, for the exact outline, without margins.

    Raises:
        NoPath: the chair touches something at the start or the goal, or no way was found between them.
        NoBestTime: no motion along the way was found that keeps all limits.
    """
    return _along(around, first_way(around, start, goal, comfort), goal, comfort)


def _along(around: BoxesRound, way: FirstWay, goal: Pose2, comfort: Comfort) -> BestDrive:
    """Return the fastest motion found beside a way."""
    problem = ""
    for spacing_s in _SPACINGS_S:
        rough_s, rows = timed(way, comfort, spacing_s, _MOST_KNOTS)
        heading = float(rows[-1, 2])
        ends = way.start.array(), np.array([goal.x, goal.y, heading + wrap_angle(goal.theta - heading)])
        motion = motion_through(rows, rough_s, ends)
        for clear in _CLEARANCES:
            motion = shortened(MotionTask(around, comfort, ends, clear), motion)
            drive = integrated(within_limits(motion, integrated(motion, rough_s), comfort), rough_s)
            problem = faults(around, drive, goal, comfort)
            if not problem:
                return drive
    far = math.dist((way.start.x, way.start.y), (goal.x, goal.y))
    raise NoBestTime(f"the best motion to ({goal.x:g}, {goal.y:g}), {far:.1f} m away, {problem}: take another goal")
