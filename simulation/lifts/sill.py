"""The slit between a lift's car and the sill of its doorway: wheels that cross it dip, and the IMU feels it."""

from __future__ import annotations

import math
from collections.abc import Iterable

from waychair.calibration.chair_body import ChairBody
from waychair.simulation.scene.scene import Pit
from waychair.types import Pose2

CASTER_RADIUS, CASTER_BEHIND_FRONT = 0.09, 0.2
"""m; of the casters, and how far they are behind the chair's front."""


def jolt(gaps: Iterable[Pit], body: ChairBody, pose: Pose2, speed: float) -> float:
    """Return the vertical acceleration [m/s^2] of a chair at `speed` [m/s] whose wheels are over a slit; 0 elsewhere.

    A wheel of radius r sinks gap² / 8 r into a slit. Its middle follows a cosine across the slit, so that neither height
    nor speed is left behind.
    """
    felt = 0.0
    for gap in gaps:
        if not speed or math.dist((gap.middle.x, gap.middle.y), (pose.x, pose.y)) > gap.width / 2 + body.front:
            continue
        for ahead, radius in ((0.0, body.wheel_radius), (body.front - CASTER_BEHIND_FRONT, CASTER_RADIUS)):
            at = gap.middle.inverse() @ (pose @ Pose2(ahead, 0.0))
            if abs(at.x) < gap.length / 2 and abs(at.y) < gap.width / 2:
                sinks = gap.length**2 / (8.0 * radius)
                bend = 2.0 * (math.pi / gap.length) ** 2 * math.cos(math.tau * at.x / gap.length)
                felt += speed**2 * sinks * bend
    return felt
