"""Multi-point turns with as much clearance as there is room for, and the drives that they consist of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.errors import NoPath
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.clearance import MANOEUVRE, MANOEUVRE_TIGHT, MAP_DOUBT
from waychair.planning.grid.costmap import Costmap
from waychair.planning.grid.fine_distances import fine_field
from waychair.planning.route.leaving_a_wall import leading_out_path
from waychair.planning.route.multi_point_turn import ManoeuvreAttempt, manoeuvre_resumably
from waychair.resumable import Resumable
from waychair.types import Bytes, FloatArray, Pose2

_ROOMY = tuple(ManoeuvreAttempt(clearance, 0.05, 72) for clearance in MANOEUVRE)
_TIGHT = tuple(
    ManoeuvreAttempt(clearance, side, headings)
    for clearance, (side, headings) in zip(MANOEUVRE_TIGHT, ((0.025, 144), (0.025, 144), (0.02, 180)), strict=True)
)
"""Attempts for a multi-point turn, in turn: those with little clearance need finer bins."""


def manoeuvre_between(costmap: Costmap, begin: Pose2, end: Pose2) -> Resumable[FloatArray | None]:
    """Return poses (N, 3) of a multi-point turn with as much margin as there is room for; None if there is none.

    Headings are the body's. From a cramped place the chair is led out first, rather than keeping that little clearance
    all along.
    """
    body, middle = costmap.body, Pose2((begin.x + end.x) / 2, (begin.y + end.y) / 2, 0.0)
    field = fine_field(costmap.grid, middle, math.hypot(end.x - begin.x, end.y - begin.y) / 2 + 2 * body.length)
    barred = costmap.barred_on(field)
    turned = yield from _turned(field=field, body=body, begin=begin, end=end, attempts=_ROOMY, barred=barred)
    if turned is not None:
        return turned
    out = yield from leading_out_path(field, body, begin, MAP_DOUBT * costmap.grid.resolution)
    if out is not None:
        turned = yield from _turned(
            field=field, body=body, begin=Pose2(*out[-1]), end=end, attempts=_ROOMY, barred=barred
        )
        if turned is not None:
            return np.concatenate([out[:-1], turned])
    return (yield from _turned(field=field, body=body, begin=begin, end=end, attempts=_TIGHT, barred=barred))


def _turned(
    field: DistanceField,
    body: ChairBody,
    begin: Pose2,
    end: Pose2,
    attempts: Sequence[ManoeuvreAttempt],
    barred: Bytes,
) -> Resumable[FloatArray | None]:
    for attempt in attempts:
        yield
        with suppress(NoPath):
            return (
                yield from manoeuvre_resumably(
                    field=field, body=body, start=begin, goal=end, attempt=attempt, barred=barred
                )
            )
    return None


def gear_changes(poses: FloatArray) -> list[tuple[FloatArray, bool]]:
    """Return the drives of a multi-point turn (N, 3), each with whether it is backwards.

    They end at turns on the spot and changes of direction; such a turn is told by the next drive's first heading. A turn
    at the very beginning or end is a drive of one pose.
    """
    steps = np.diff(poses[:, :2], axis=0)
    along = steps[:, 0] * np.cos(poses[:-1, 2]) + steps[:, 1] * np.sin(poses[:-1, 2])
    gears = np.where((steps == 0.0).all(axis=1), 0, np.where(along < 0.0, -1, 1))
    drives: list[tuple[FloatArray, bool]] = []
    begin = 0
    for k in range(1, len(gears) + 1):
        if k < len(gears) and gears[k] == gears[begin]:
            continue
        if gears[begin] != 0:
            drives.append((poses[begin : k + 1].copy(), bool(gears[begin] < 0)))
        begin = k
    return drives or [(poses[-1:].copy(), False)]
