"""Critics of the dynamic window: measures of the candidate arcs, and their weighted sum."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.planning.body.clearance import COMFORTABLE_ARC, COMFORTABLE_ARC_LEAST
from waychair.planning.body.personal_space import COMFORTABLE as COMFORTABLE_FOR_PEOPLE
from waychair.types import BoolArray, FloatArray

PATH_WEIGHT = 4.0
"""Weight of nearness to the path, per 0.5 m."""

HEADING_WEIGHT = 0.4
"""Weight of the path's direction at the arc's end, per half turn."""

PROGRESS_WEIGHT = 2.0
"""Weight of progress along the path, per longest arc."""

TARGET_WEIGHT = 1.0
"""Weight of nearness to the target, per longest arc."""

CLEARANCE_WEIGHT = 1.0
"""Weight of the clearance beside the body, per `COMFORTABLE_ARC`."""

SPEED_WEIGHT = 0.3
"""Weight of the forward speed, per highest speed."""

SMOOTHNESS_WEIGHT = 0.1
"""Weight of a small change of the command."""

OSCILLATION_WEIGHT = 0.1
"""Weight of keeping the direction of travel."""


@dataclass(frozen=True, slots=True)
class ArcMeasures:
    """Measures of N candidate arcs; all (N,) float64 unless said otherwise.

    candidates (N, 2): v [m/s], omega [rad/s]. admissible: bool. free_time [s]: until the first contact or the horizon.
    clearance [m]: least distance beside the body along the arc. path_error [m]: mean distance of the drive axle and of
    the front from the path. heading_error [rad]: |heading at the arc's end - path's direction there|. progress [m]:
    distance along the path to the point nearest to the arc's end. target_distance [m]: least distance to the target.
    change [0..1]: size of the step from the last command. people_gap [m]: least distance to a predicted person; +inf
    without any. reversal: 1 where the direction of travel changes, else 0. end_clearance [m]: clearance at the path's
    end if that is near, else +inf.
    """

    candidates: FloatArray
    admissible: BoolArray
    free_time: FloatArray
    clearance: FloatArray
    path_error: FloatArray
    heading_error: FloatArray
    progress: FloatArray
    target_distance: FloatArray
    change: FloatArray
    people_gap: FloatArray
    reversal: FloatArray
    end_clearance: float = math.inf


def weighted_score(measures: ArcMeasures, people_weight: float, longest: float, highest: float) -> FloatArray:
    """Return (N,) the weighted sum of the critics; `longest` [m] is the longest arc, `highest` [m/s] the highest speed.

    Each critic is 1 for the best possible arc and falls by 1 over its scale. `people_weight` is that of the distance to
    people. The critics are divided by fixed scales, not by the extremes of the present candidates: a difference of
    millimetres between arcs in an empty hall stays small, and there is no 0/0. Near a path's end, clearance beyond that
    at the end is worth nothing; otherwise the chair would stop short of a goal beside a wall.
    """
    worth = min(COMFORTABLE_ARC, max(measures.end_clearance, COMFORTABLE_ARC_LEAST))
    score: FloatArray = (
        -PATH_WEIGHT * measures.path_error / 0.5
        - HEADING_WEIGHT * measures.heading_error / np.pi
        + PROGRESS_WEIGHT * measures.progress / longest
        - TARGET_WEIGHT * measures.target_distance / longest
        + CLEARANCE_WEIGHT * np.minimum(measures.clearance, worth) / COMFORTABLE_ARC
        + SPEED_WEIGHT * measures.candidates[:, 0] / highest
        - SMOOTHNESS_WEIGHT * measures.change
        - people_weight * np.clip(1.0 - measures.people_gap / COMFORTABLE_FOR_PEOPLE, 0.0, 1.0)
        - OSCILLATION_WEIGHT * measures.reversal
    )
    return score
