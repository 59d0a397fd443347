"""Backing out of a tight spot along the path by which the chair came in, which is known to have been free."""

from __future__ import annotations

import math

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import wrap_angle
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.footprint import Footprint, along_arc, eased_footprint, fits, footprint, free_time, in_cells
from waychair.planning.window.dwa import DwaResult
from waychair.planning.window.motion_limits import (
    CRAWL_OMEGA,
    CRAWL_V,
    PERIOD,
    DwaSettings,
    braking,
    stop_time,
    towards,
)
from waychair.types import FloatArray, Pose2, Twist

_TURNS = 17
"""Number of turning speeds tried."""


def kept_footprint(
    pose: Pose2, distances: DistanceField, body: ChairBody, margin: float, keeps: float
) -> tuple[Footprint, float | None]:
    """Return the body with its margin [m], reduced as by `eased_footprint` but to no less than `keeps` [m].

    Also return the clearance around it [m], at most the margin; None where it touches something.
    """
    shape, ease = eased_footprint(body, margin, distances, pose)
    if margin - ease < keeps:
        shape = footprint(body, keeps, distances)
    return shape, margin - ease if ease or fits(body, margin, distances, pose) else None


def back_up(
    pose: Pose2,
    command: Twist,
    trail: FloatArray,
    distances: DistanceField,
    shape: Footprint,
    settings: DwaSettings,
    way: float = 0.5,
) -> DwaResult:
    """Return the next command for backing out along `trail` (M, 3) [m, m, rad], the chair's latest poses in order.

    Among the reverse arcs at crawling speed that are free and leave room to stop, the best ends nearest to where the
    chair was `way` [m] ago; without a trail, straight behind it. The shape is the body with its margin on the same
    distances. `blocked` when there is no such arc, or the chair may not drive backwards.
    """
    ahead = Pose2(*along_arc(pose.x, pose.y, pose.theta, command.v, command.omega, settings.reaction_time))
    target = _behind(ahead, trail, way)
    v, start, longest = -min(CRAWL_V, settings.max_reverse), in_cells(distances, ahead), way / CRAWL_V
    candidates = np.column_stack([np.full(_TURNS, v), np.linspace(-CRAWL_OMEGA, CRAWL_OMEGA, _TURNS)])
    scores = np.full(_TURNS, -np.inf)
    for i, (_, omega) in enumerate(candidates):
        needed = PERIOD + stop_time(Twist(v, float(omega)), settings) / 2
        free = free_time(shape, start, v / shape.cell, omega, needed, longest)
        if free >= needed:
            x, y, theta = along_arc(ahead.x, ahead.y, ahead.theta, v, omega, free)
            off = abs(wrap_angle(theta - target.theta))
            scores[i] = -math.hypot(x - target.x, y - target.y) - 0.3 * off
    best = int(np.argmax(scores))
    if v == 0.0 or scores[best] == -np.inf:
        return DwaResult(braking(command, settings), candidates, scores, ahead.array()[None], blocked=True)
    twist = towards(command, Twist(v, float(candidates[best, 1])), settings)
    return DwaResult(twist, candidates, scores, ahead.array()[None])


def _behind(pose: Pose2, trail: FloatArray, way: float) -> Pose2:
    """Return where the chair was `way` [m] ago, or the pose that far straight behind it."""
    if len(trail) > 1:
        along = np.hypot(*np.diff(trail[::-1, :2], axis=0).T).cumsum()
        k = int(np.searchsorted(along, way))
        if k < len(along):
            return Pose2(*trail[::-1][k + 1])
    return pose @ Pose2(-way, 0.0, 0.0)
