"""A lift's door as the lidar sees it: the part of its width through which beams pass, and since when it is unchanged."""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from waychair.control.journey.lift_site import LiftSite, lift_holding
from waychair.types import BoolArray, FloatArray, Pose2, Scan

PARTS = 24
"""Parts of the doorway's width that are judged one by one."""

PASSES, BEFORE = 0.15, 0.2
"""m; a beam has passed the doorway if it ends so far behind it, and is hidden if it ends so far before it."""

JAMB = 0.1
"""m; so much of the doorway is not judged on either side, because a slanting beam ends on the jamb's own side."""

LEAST_SEEN = 0.5
"""Share of the parts that must be seen."""

OPEN_FROM, CLOSED_BELOW = 0.9, 0.12
"""Shares of the parts seen that are free: an open and a closed door."""

CHANGE = 0.06
"""A change of the free share by more is a motion of a leaf, or somebody in the doorway."""

SHUT_IN = "the door of the lift is not open: say the storey once it is"
"""Why no word about its storey is taken of a chair in a lift: the car may go elsewhere."""


class Door(enum.Enum):
    """A lift's door."""

    UNSEEN = "unseen"
    CLOSED = "closed"
    PART = "partly open"
    OPEN = "open"


@dataclass(frozen=True, slots=True)
class DoorView:
    """The door now, its free share, the stamps since which it is unchanged and open, None if it is not."""

    door: Door = Door.UNSEEN
    share: float = 0.0
    still_since_ns: int | None = None
    open_since_ns: int | None = None
    seen_ns: int | None = None

    def still_s(self, now_ns: int) -> float:
        """Return for how long [s] nothing has moved in the doorway; 0 while it is unseen."""
        return 0.0 if self.still_since_ns is None else (now_ns - self.still_since_ns) * 1e-9

    def open_s(self, now_ns: int) -> float:
        """Return for how long [s] it has been open."""
        return 0.0 if self.open_since_ns is None else (now_ns - self.open_since_ns) * 1e-9


def seen_door(before: DoorView, scan: Scan, cabin_from_laser: Pose2, site: LiftSite) -> DoorView:
    """Return the door after a scan that was taken from a pose in the cabin's frame."""
    free, seen = _parts(scan, Pose2(-site.door_ahead, 0.0) @ cabin_from_laser, site.door_width)
    if seen.mean() < LEAST_SEEN:
        return DoorView(seen_ns=before.seen_ns)
    share = float(free[seen].mean())
    door = Door.OPEN if share >= OPEN_FROM else Door.CLOSED if share <= CLOSED_BELOW else Door.PART
    stamp = scan.stamp_ns
    unchanged = before.still_since_ns is not None and abs(share - before.share) <= CHANGE
    opened = before.open_since_ns if before.door is Door.OPEN else stamp
    # slow changes add up: the share is compared with that since which nothing moved
    return DoorView(
        door=door,
        share=before.share if unchanged else share,
        still_since_ns=before.still_since_ns if unchanged else stamp,
        open_since_ns=opened if door is Door.OPEN else None,
        seen_ns=stamp,
    )


def forgotten(view: DoorView) -> DoorView:
    """Return the view of a door that nobody looks at now."""
    return replace(view, door=Door.UNSEEN, still_since_ns=None, open_since_ns=None)


def is_shut_in(
    scan: Scan, sites: Iterable[LiftSite], storey: str, map_from_base: Pose2, base_from_laser: Pose2
) -> bool:
    """Return whether a chair is in a lift whose door is closed, or not seen: the car may go elsewhere."""
    held = lift_holding(sites, storey, map_from_base)
    if held is None:
        return False
    site, cabin_from_base = held
    cabin_from_laser = cabin_from_base @ base_from_laser
    if cabin_from_laser.x > site.door_ahead:  # the chair stands in its doorway
        return False
    return seen_door(DoorView(), scan, cabin_from_laser, site).door in (Door.CLOSED, Door.UNSEEN)


def _parts(scan: Scan, door_from_laser: Pose2, width: float) -> tuple[BoolArray, BoolArray]:
    """Return for each part of the doorway whether a beam passes it, and whether any beam tells, (PARTS,) each."""
    angles = scan.angles() + door_from_laser.theta
    ranges = scan.ranges.astype(np.float64)
    dx, dy = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore", invalid="ignore"):
        way = -door_from_laser.x / dx
        across = door_from_laser.y + way * dy
    inner = width - 2 * JAMB
    part = np.floor((across / inner + 0.5) * PARTS)
    known = np.isfinite(way) & (way > 0.0) & (part >= 0) & (part < PARTS) & ~np.isnan(ranges) & (ranges > 0.0)
    passes, blocked = (
        known & (ranges > way + PASSES),
        known & (np.abs(ranges - way) <= BEFORE) & (ranges <= way + PASSES),
    )
    free, shut = np.zeros(PARTS, np.bool_), np.zeros(PARTS, np.bool_)
    free[part[passes].astype(np.int64)] = True
    shut[part[blocked].astype(np.int64)] = True
    return free & ~shut, free | shut


def beams_through(scan: Scan, cabin_from_laser: Pose2, site: LiftSite) -> tuple[FloatArray, FloatArray]:
    """Return angles (N,) [rad] in the laser frame and ranges (N,) [m] of the beams through the doorway."""
    laser = Pose2(-site.door_ahead, 0.0) @ cabin_from_laser
    angles, ranges = scan.angles(), scan.ranges.astype(np.float64)
    dx, dy = np.cos(angles + laser.theta), np.sin(angles + laser.theta)
    with np.errstate(divide="ignore", invalid="ignore"):
        way = -laser.x / dx
        across = laser.y + way * dy
    through = (
        (way > 0.0) & (np.abs(across) < site.door_width / 2 - 0.05) & (ranges > way + PASSES) & np.isfinite(ranges)
    )
    return angles[through], ranges[through]
