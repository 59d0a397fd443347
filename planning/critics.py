"""Critics of the dynamic window: measures of the candidate arcs, and their weighted sum."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.config import Settings, setting
from waychair.types import BoolArray, FloatArray

ENOUGH, LEAST = 0.3, 0.05
"""Clearance [m] beyond which more is worth nothing, and up to which more always counts."""


PERSONAL = 0.6
"""Distance [m] to people beyond which more is worth nothing: Hall's intimate distance, 0.45 m, and some to spare."""


@dataclass(frozen=True, slots=True)
class Features:
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


@dataclass(frozen=True, slots=True)
class Weights(Settings):
    """Weights of the critics; each critic is 1 for the best possible arc and falls by 1 over its scale."""

    path: float = setting(4.0, "", "nearness to the path, per 0.5 m", low=0.0, high=100.0)
    heading: float = setting(0.4, "", "direction of the path at the end, per half turn", low=0.0, high=100.0)
    progress: float = setting(2.0, "", "way made along the path, per longest way", low=0.0, high=100.0)
    target: float = setting(1.0, "", "nearness to the target, per longest way", low=0.0, high=100.0)
    clearance: float = setting(1.0, "", "distance beside the body, per 0.3 m", low=0.0, high=100.0)
    speed: float = setting(0.3, "", "forward speed, per highest speed", low=0.0, high=100.0)
    smoothness: float = setting(0.1, "", "small change of the command", low=0.0, high=100.0)
    people: float = setting(2.0, "", "distance to people, as far as 0.6 m", low=0.0, high=100.0)
    oscillation: float = setting(0.1, "", "going on in the direction of before", low=0.0, high=100.0)


def comfortable_score(features: Features, weights: Weights, longest: float, highest: float) -> FloatArray:
    """Return (N,) the weighted sum of the critics; `longest` [m] is the longest arc, `highest` [m/s] the highest speed.

    The critics are divided by fixed scales, not by the extremes of the present candidates: a difference of millimetres
    between arcs in an empty hall stays small, and there is no 0/0. Near a path's end, clearance beyond that at the end
    is worth nothing; otherwise the chair would stop short of a goal beside a wall.
    """
    worth = min(ENOUGH, max(features.end_clearance, LEAST))
    score: FloatArray = (
        -weights.path * features.path_error / 0.5
        - weights.heading * features.heading_error / np.pi
        + weights.progress * features.progress / longest
        - weights.target * features.target_distance / longest
        + weights.clearance * np.minimum(features.clearance, worth) / ENOUGH
        + weights.speed * features.candidates[:, 0] / highest
        - weights.smoothness * features.change
        - weights.people * np.clip(1.0 - features.people_gap / PERSONAL, 0.0, 1.0)
        - weights.oscillation * features.reversal
    )
    return score
