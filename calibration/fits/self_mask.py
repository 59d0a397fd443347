"""The self-mask: lidar sectors that see the chair or its rider (legs, leg rests, a bag), learnt while the chair turns.

Parts of the chair stay at their angle and range while everything else goes by. Only points within the footprint, or a
hand's breadth beyond it, can be masked, so that a mask never hides a wall or a person farther off.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.measured import Measured, measured
from waychair.errors import CalibrationError, ConfigError, ThinData
from waychair.types import BoolArray, FloatArray, Scan


@dataclass(frozen=True, slots=True)
class SelfMask(Measured):
    """Sectors of the lidar's view that see the chair itself, by angle, so that they hold for any number of beams.

    Sector k is from `begins[k]` to `ends[k]` [rad, laser frame] and sees the chair within `reaches[k]` [m]. All its
    beams are hidden. In the `margin` beside it, beams that end within the reach are hidden, too, because they may see
    loose clothes or a moved knee; the others pass.
    """

    begins: tuple[float, ...] = measured((), "rad", "where each sector begins, ascending")
    ends: tuple[float, ...] = measured((), "rad", "where it ends")
    reaches: tuple[float, ...] = measured((), "m", "how far the chair reaches in it")
    margin: float = measured(math.radians(3.0), "rad", "beside each sector", low=0.0, high=0.5)

    def __post_init__(self) -> None:
        Measured.__post_init__(self)
        edges = [edge for sector in zip(self.begins, self.ends, strict=False) for edge in sector]
        if not len(self.begins) == len(self.ends) == len(self.reaches) or edges != sorted(edges):
            raise ConfigError("a self-mask's sectors are impossible: they must ascend, each with its end and its reach")
        if not all(math.isfinite(value) for value in (*edges, *self.reaches)) or any(r <= 0.0 for r in self.reaches):
            raise ConfigError("a self-mask's sectors are impossible: angles must be finite and reaches above 0 m")

    def hides(self, scan: Scan) -> BoolArray:
        """Return a mask (N,) of a scan's beams that see, or may see, the chair itself."""
        angles = scan.angles()
        hidden = np.zeros(len(angles), bool)
        for begin, end, reach in zip(self.begins, self.ends, self.reaches, strict=True):
            hidden |= (angles >= begin) & (angles <= end)
            beside = (angles >= begin - self.margin) & (angles <= end + self.margin)
            hidden |= beside & (scan.ranges <= reach)
        return hidden

    def applied(self, scan: Scan) -> Scan:
        """Return the scan with the hidden beams made invalid."""
        return replace(scan, ranges=np.where(self.hides(scan), np.float32(math.nan), scan.ranges))


BEYOND = 0.15
"""m; largest distance by which parts of the chair or its rider stick out of the footprint."""

SPREAD = 0.06
"""m; ranges of an own part stay within this, except for outliers."""

OFTEN, SOMETIMES = 0.7, 0.15
"""Shares of the scans in which an own part is seen: OFTEN for its core, SOMETIMES for beams beside it."""

GROW = math.radians(5.0)
"""rad; largest extension of a sector by beams that sometimes see the own part."""

SLACK = 0.05
"""m; added to the own part's reach."""

MARGIN = math.radians(3.0)
"""rad; beside a sector, near ranges are hidden, too."""

MOST_HIDDEN = 0.7
"""Largest share of the lidar's beams that may see the chair itself."""

SWING = 0.3
"""m; the ranges of the surroundings must change by this, so that the chair has turned."""

LEAST_SCANS = 50


def learn_self_mask(scans: Sequence[Scan], body: ChairBody) -> SelfMask:
    """Learn the mask of a lidar from scans of a chair that turns, at best a full circle, or drives about.

    Scans may differ in their number of beams.

    Raises:
        ThinData: there are too few scans, or the chair stood still.
        CalibrationError: nearly all of the lidar's beams see the chair.
    """
    if len(scans) < LEAST_SCANS:
        raise ThinData(f"{len(scans)} scans are too few to tell the chair from a room: record {LEAST_SCANS} or more")
    angles, ranges = _by_angle(scans)
    limits = outline_reach(angles, body, BEYOND)
    near = (ranges <= limits) & ~np.isnan(ranges)  # -inf is so close that it must be the chair
    ends = np.maximum(ranges, 0.0)
    typical = _medians(ends, near)
    steady = near & (np.abs(ends - typical) <= SPREAD)
    told = np.maximum((~np.isnan(ranges)).sum(axis=0), 1)
    own = steady.sum(axis=0) / told >= OFTEN
    _refuse_standstill(ranges, own)
    own = _grown(own, near.sum(axis=0) / told >= SOMETIMES, round(GROW / (angles[1] - angles[0])))
    if (share := float(own.mean())) > MOST_HIDDEN:
        raise CalibrationError(f"{share:.0%} of the lidar's beams end on the chair itself: mount it where it sees more")
    farthest = np.where(near, ranges, -math.inf).max(axis=0) + SLACK
    # The footprint holds nothing but the chair, so mixed pixels between its parts and a wall are the chair's, too.
    reaches = np.clip(farthest, np.maximum(outline_reach(angles, body, 0.0), SLACK), np.maximum(limits, SLACK))
    return _sectors(angles, own, reaches, MARGIN)


def _by_angle(scans: Sequence[Scan]) -> tuple[FloatArray, FloatArray]:
    """Return the angles (N,) [rad] of the finest scan, and the ranges (S, N) of all scans at their nearest beams."""
    finest = min(scans, key=lambda scan: abs(scan.angle_step))
    angles = np.sort(finest.angles())
    ranges = np.full((len(scans), len(angles)), np.nan)
    for row, scan in zip(ranges, scans, strict=True):
        index = np.rint((angles - scan.angle_min) / scan.angle_step).astype(np.int64)
        there = (index >= 0) & (index < len(scan.ranges))
        row[there] = scan.ranges[index[there]]
    return angles, ranges


def _medians(values: FloatArray, chosen: BoolArray) -> FloatArray:
    """Return the median (N,) of the chosen values of each column of (S, N); 0 if none is chosen."""
    ordered = np.sort(np.where(chosen, values, math.inf), axis=0)
    counts = chosen.sum(axis=0)
    columns = np.arange(values.shape[1])
    low, high = (
        ordered[np.maximum(counts - 1, 0) // 2, columns],
        ordered[np.minimum(counts // 2, len(values) - 1), columns],
    )
    return np.where(counts > 0, 0.5 * (low + high), 0.0)


def outline_reach(angles: FloatArray, body: ChairBody, beyond: float) -> FloatArray:
    """Return the distances (N,) [m] from the laser to the outline, grown by `beyond`, at each angle.

    They are 0 where a laser mounted outside that outline looks away from it.
    """
    mount = body.base_from_laser
    x, y = np.cos(angles + mount.theta), np.sin(angles + mount.theta)
    ahead = np.where(x > 0.0, body.front + beyond - mount.x, -body.rear - beyond - mount.x)
    aside = np.where(y > 0.0, body.width / 2 + beyond, -body.width / 2 - beyond) - mount.y
    with np.errstate(divide="ignore", invalid="ignore"):
        limits = np.minimum(np.where(x == 0.0, math.inf, ahead / x), np.where(y == 0.0, math.inf, aside / y))
    return np.maximum(limits, 0.0)


def _refuse_standstill(ranges: FloatArray, own: BoolArray) -> None:
    """Refuse scans of a parked chair, in which a wall beside it would be taken for its rider."""
    others = np.where(np.isfinite(ranges), ranges, np.nan)[:, ~own]
    told = others[:, (~np.isnan(others)).sum(axis=0) > 0.5 * len(ranges)]
    if not told.size:
        raise ThinData("the lidar sees nothing but the chair: record in a room whose walls it sees")
    swing = np.nanquantile(told, 0.9, axis=0) - np.nanquantile(told, 0.1, axis=0)
    if (part := float((swing > SWING).mean())) < 0.5:
        raise ThinData(
            f"the ranges of only {part:.0%} of the lidar's beams changed: turn the chair a full circle while recording"
        )


def _grown(own: BoolArray, sometimes: BoolArray, most: int) -> BoolArray:
    """Return the own beams extended by up to `most` neighbouring beams that sometimes see the chair."""
    grown = own.copy()
    for _ in range(most):
        beside = np.zeros_like(grown)
        beside[1:] |= grown[:-1]
        beside[:-1] |= grown[1:]
        grown |= beside & sometimes
    return grown


def _sectors(angles: FloatArray, own: BoolArray, reaches: FloatArray, margin: float) -> SelfMask:
    """Return the runs of own beams as sectors that extend half a beam further."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], own, [False]]).astype(np.int8))).tolist()
    half = 0.5 * float(angles[1] - angles[0])
    runs = list(zip(edges[::2], edges[1::2], strict=True))
    return SelfMask(
        begins=tuple(round(float(angles[i]) - half, 6) for i, _ in runs),
        ends=tuple(round(float(angles[j - 1]) + half, 6) for _, j in runs),
        reaches=tuple(round(float(reaches[i:j].max()), 3) for i, j in runs),
        margin=margin,
    )
