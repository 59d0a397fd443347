"""How fast the chair may go where no sensor looks: backwards and round, if nothing sees what it would back or turn into.

Every sensor is a sector; an area counts as seen when all of it lies in sectors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.calibration.self_mask import SelfMask
from waychair.config import Settings, setting
from waychair.geometry import transform_points, wrap_angles
from waychair.types import BoolArray, FloatArray, Pose2, Scan


@dataclass(frozen=True, slots=True)
class UnseenSettings(Settings):
    """How fast and how far."""

    speed: float = setting(0.15, "m/s", "of any part of the chair into an area that no sensor sees", low=0.01, high=0.5)
    look: float = setting(0.5, "m", "this far beyond the outline must be seen to drive there", low=0.1, high=3.0)
    share: float = setting(0.95, "", "of an area that must be seen for it to count as seen", low=0.5, high=1.0)


@dataclass(frozen=True, slots=True)
class Sector:
    """What one sensor sees: from its mount, `half_angle` [rad] to both sides of its x axis, `reach` [m] far."""

    base_from_sensor: Pose2
    half_angle: float
    reach: float


@dataclass(frozen=True, slots=True)
class UnseenLimits:
    """Highest speeds forward and in reverse [m/s] and of turning [rad/s]; inf where all is seen."""

    forward: float = math.inf
    reverse: float = math.inf
    omega: float = math.inf


def limits_by_sight(
    body: ChairBody, sectors: Sequence[Sector], settings: UnseenSettings = UnseenSettings()
) -> UnseenLimits:
    """Limits by what the sensors see of the areas ahead of the chair, behind it, and swept by turning in place.

    In turning, the farthest corner is what must not be faster than the limit.
    """
    ahead = _strip(body.front, body.front + settings.look, body.width)
    behind = _strip(-body.rear - settings.look, -body.rear, body.width)
    radius = body.circumscribed_radius
    speeds = [math.inf if _seen(area, sectors, settings) else settings.speed for area in (ahead, behind)]
    turning = math.inf if _seen(_swept(body), sectors, settings) else settings.speed / radius
    return UnseenLimits(speeds[0], speeds[1], turning)


def sectors_of_scan(scan: Scan, base_from_laser: Pose2, mask: SelfMask | None = None) -> list[Sector]:
    """The unbroken runs of beams that see something other than the chair itself; nan beams are broken."""
    hidden = np.isnan(scan.ranges) if mask is None else np.isnan(scan.ranges) | mask.hides(scan)
    edges = np.flatnonzero(np.diff(np.concatenate([[True], hidden, [True]]).astype(np.int8)))
    angles = scan.angles()
    sectors = []
    for first, after in edges.reshape(-1, 2):
        middle = (angles[first] + angles[after - 1]) / 2
        half = abs(angles[after - 1] - angles[first]) / 2 + abs(scan.angle_step) / 2
        sectors.append(Sector(base_from_laser @ Pose2(0.0, 0.0, float(middle)), float(half), scan.range_max))
    return sectors


def _seen(points: FloatArray, sectors: Sequence[Sector], settings: UnseenSettings) -> bool:
    seen: BoolArray = np.zeros(len(points), np.bool_)
    for sector in sectors:
        x, y = transform_points(sector.base_from_sensor.inverse(), points).T
        seen |= (np.abs(wrap_angles(np.arctan2(y, x))) <= sector.half_angle) & (np.hypot(x, y) <= sector.reach)
    return bool(seen.mean() >= settings.share)


def _strip(first: float, last: float, width: float) -> FloatArray:
    """Points (N, 2) every 5 cm of a rectangle across the chair, in the base frame."""
    x = np.arange(first + 0.025, last, 0.05)
    y = np.arange(-width / 2 + 0.025, width / 2, 0.05)
    points: FloatArray = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return points


def _swept(body: ChairBody) -> FloatArray:
    """Points (N, 2) every 5 cm of the disc that turning in place sweeps, without the outline, in the base frame."""
    radius = body.circumscribed_radius
    disc = _strip(-radius, radius, 2 * radius)
    x, y = disc.T
    inside = (x <= body.front) & (x >= -body.rear) & (np.abs(y) <= body.width / 2)
    ring: FloatArray = disc[(np.hypot(x, y) <= radius) & ~inside]
    return ring
