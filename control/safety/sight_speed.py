"""The speed limit from the sensors' view: the chair must be able to stop within it, and moves slowly where it is blind.

Every sensor is a sector. In driving, the strip that the chair will cover must lie in sectors up to the stopping
distance. In turning and reversing, the corners that move outwards must lie in sectors. Sonar cones are too narrow to
count: two of them leave most of the ground behind a chair uncovered.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.config import Settings, setting
from waychair.geometry import arcs, compose, transform_points, wrap_angles
from waychair.types import BoolArray, FloatArray, Pose2, Scan, Twist

FAR_ENOUGH = 3.0
"""m; a chair that sees so far along its path may drive at any speed."""

SEEN_SHARE = 0.95
"""Share of the chair's width that must be seen."""

BRAKING, REACTION_S = 0.6, 0.3
"""m/s^2, s; braking and reaction time with which the chair must be able to stop within its view."""


@dataclass(frozen=True, slots=True)
class UnseenSettings(Settings):
    """The speed into unseen space, the required view, and the braking that it must allow."""

    speed: float = setting(
        0.15,
        "m/s",
        "highest speed of any part of the chair into space that no sensor sees; larger: faster blind motion",
        low=0.01,
        high=0.5,
    )


@dataclass(frozen=True, slots=True)
class Sector:
    """One sensor's view: from its mount, `half_angle` [rad] to both sides of its x axis, up to `reach` [m]."""

    base_from_sensor: Pose2
    half_angle: float
    reach: float


def sight_share(
    twist: Twist, body: ChairBody, sectors: Sequence[Sector], settings: UnseenSettings = UnseenSettings()
) -> float:
    """Return the share of a twist at which the chair can stop within its view and no unseen corner moves out too
    fast."""
    if not (math.isfinite(twist.v) and math.isfinite(twist.omega)):
        return 0.0
    corners = body.outline()
    x, y = corners.T
    outwards = np.maximum(np.sign(x) * (twist.v - twist.omega * y), np.sign(y) * twist.omega * x)
    fastest = float(outwards[~in_view(corners, sectors)].max(initial=0.0))
    share = min(1.0, settings.speed / max(fastest, 1e-9))
    if abs(twist.v) <= settings.speed:
        return share
    way, lost = sight_along(twist, body, sectors), BRAKING * REACTION_S
    stopping = math.inf if way >= FAR_ENOUGH else math.sqrt(lost * lost + 2.0 * BRAKING * way) - lost
    return min(share, max(settings.speed, stopping) / abs(twist.v))


def sight_along(twist: Twist, body: ChairBody, sectors: Sequence[Sector]) -> float:
    """Return the distance [m], up to `FAR_ENOUGH`, over which the leading edge's strip on a twist's arc is seen without a
    gap."""
    ways = np.arange(_STEP, FAR_ENOUGH + _STEP / 2, _STEP)
    across = np.linspace(-body.width / 2, body.width / 2, _ACROSS)
    edge = np.full(_ACROSS, body.front if twist.v > 0.0 else -body.rear)
    gear = math.copysign(1.0, twist.v)
    poses = arcs(gear * ways, twist.omega / abs(twist.v) * ways)
    line = np.column_stack([edge, across, np.zeros(_ACROSS)])
    points = compose(poses[:, None], line)[..., :2].reshape(-1, 2)
    seen = in_view(points, sectors).reshape(len(ways), _ACROSS).mean(axis=1) >= SEEN_SHARE
    return float(FAR_ENOUGH if seen.all() else ways[int(np.argmin(seen))] - _STEP)


_STEP, _ACROSS = 0.1, 7
"""m between the strip's checked lines, and checked points per line."""


def sectors_of_scan(scan: Scan, base_from_laser: Pose2) -> list[Sector]:
    """Return a sector for each run of beams that are valid or without an echo.

    Invalid beams (nan, or nearer than the least range) separate the runs, unless there are only one or two of them.
    """
    blind = np.isnan(scan.ranges) | (scan.ranges < max(scan.range_min, 0.0))
    broken = np.flatnonzero(np.diff(np.concatenate([[True], blind, [True]]).astype(np.int8)))
    runs: list[list[int]] = []
    for first, after in broken.reshape(-1, 2).tolist():
        if runs and first - runs[-1][1] <= _DROPPED:
            runs[-1][1] = after
        else:
            runs.append([first, after])
    angles = scan.angles()
    sectors = []
    for first, after in runs:
        middle = (angles[first] + angles[after - 1]) / 2
        half = abs(angles[after - 1] - angles[first]) / 2 + abs(scan.angle_step) / 2
        sectors.append(Sector(base_from_laser @ Pose2(0.0, 0.0, float(middle)), float(half), scan.range_max))
    return sectors


_DROPPED = 2
"""Up to so many invalid beams in a row are drop-outs."""


def in_view(points: FloatArray, sectors: Sequence[Sector]) -> BoolArray:
    """Return a mask (N,) of points (N, 2) [m] in base that lie in any sector."""
    seen: BoolArray = np.zeros(len(points), np.bool_)
    for sector in sectors:
        x, y = transform_points(sector.base_from_sensor.inverse(), points).T
        seen |= (np.abs(wrap_angles(np.arctan2(y, x))) <= sector.half_angle) & (np.hypot(x, y) <= sector.reach)
    return seen
