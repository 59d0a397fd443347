"""The collision monitor: it checks each command against the raw scan and slows or stops the chair.

Every point of the latest scan is followed, in the chair's own frame, along the circle on which it comes nearer while
the chair drives the commanded arc; contact is where that circle enters the footprint. If the time to contact is shorter
than an emergency stop, the chair must stop. If it is shorter than a comfortable stop, the chair must slow down. So the
zones scale with the speed and bend with the turn.

The clearance round the footprint grows with the speed. At a crawl it is as narrow as a doorway needs. A point within
the clearance of a faster drive does not stop the chair but slows it down until the clearance is free. Ahead of the
chair the clearance is longer.

A lidar at the height of shins sees legs, and a person's body reaches beyond them. So a slim object that stands free is
taken for legs and gets a longer and wider clearance, at any speed. Where the space is too narrow for that, as in many
corridors, the chair stops and gives way; a person still there after a while is passed at the smaller clearance, at a
crawl.

The monitor uses no planner, no map and no pose. It knows one thing from the map: a caller that is sure of the chair's
pose may tell it the places of mapped slim objects, such as table legs, in base (`note_mapped_legs`). Slim points at
those places lose the legs' extra clearance. They are still obstacles, with the same clearance as anything else.

The monitor also checks the lidar: a lidar that is silent, sees too little or repeats one scan stops the chair. A
verdict carries its own stamp and its scan's. The caller asks for a fresh verdict before it lets speed through
(`stale_stop`), so that a dead monitor stops the chair, too. `Monitor` is a pure function of its inputs. A process of
its own calls it by a timer (`runtime.monitor_process`), and the simulator calls it in lockstep.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.self_mask import SelfMask, outline_reach
from waychair.calibration.fits.stopping import StopTable
from waychair.control.safety.arc_clearance import LEAST_POINTS, MonitorSettings, permitted_along, stoppable_along
from waychair.geometry import arcs, transform_points
from waychair.planning.body.personal_space import GIVE_WAY_S, LEG_WIDTH
from waychair.recordings.scans import without_overflow_codes
from waychair.types import BoolArray, FloatArray, IntArray, Pose2, Scan, Twist

VERDICT_MS, SCAN_MS, SILENT_MS = 150, 300, 500
"""ms; no speed passes on an older verdict or a verdict on an older scan; a monitor silent for longer ends a drive."""

MAPPED_WITHIN, MAPPED_MS = 0.1, 400
"""m, ms; slim points so near to a mapped slim object belong to it; its place is forgotten after so long."""

BLIND_S, LEAST_COVERAGE = 0.4, 0.8
"""s, share; a beam without a range for so long is blind, and so large a share of the beams must not be blind."""

JUDGED_WITHIN_V, JUDGED_WITHIN_OMEGA = 0.1, 0.2
"""m/s, rad/s; a command farther than this beyond the judged one counts as not judged."""


@dataclass(frozen=True, slots=True)
class MonitorVerdict:
    """The monitor's finding at `stamp_ns` about the commanded `twist`, from a scan stamped `scan_ns` (None: no scan).

    `share` in [0, 1] of the twist may be driven. `stop` is "" or the id of a row of `stops.STOPS`. `contact_s` is the
    driving time [s] until contact, +inf without one.
    """

    stamp_ns: int
    scan_ns: int | None
    twist: Twist
    share: float
    contact_s: float = math.inf
    stop: str = ""


class Monitor:
    """The monitor with its memory: the latest scan, each beam's last valid range, and how long scans have been the
    same.

    A beam without a range is not blind at once. In real buildings one beam in three may see nothing for a moment, past
    glass or down a hall (recordings of Intel, Freiburg 079 and Malaga), but the beams change as the chair moves.
    """

    def __init__(
        self,
        body: ChairBody,
        settings: MonitorSettings | None = None,
        stops: StopTable | None = None,
        mask: SelfMask | None = None,
    ) -> None:
        """`stops` are the measured stopping distances; `mask` hides the chair's own parts from the lidar."""
        self._body, self._stops, self._mask = body, stops, mask
        self._settings = settings or MonitorSettings()
        self._scan: Scan | None = None
        self._hidden: BoolArray = np.zeros(0, np.bool_)
        self._slim: BoolArray = np.zeros(0, np.bool_)
        self._measured_ns: IntArray = np.zeros(0, np.int64)  # each beam's last valid range
        self._same_since_ns: int | None = None
        self._blindness = ""
        self._gives_way_since_ns: int | None = None
        self._gave_way_ns: int | None = None  # the latest tick in which the chair gave way
        self._passes_until_ns: int | None = None
        self._mapped_legs: FloatArray = np.empty((0, 2))
        self._mapped_legs_ns: int | None = None

    def note_mapped_legs(self, mapped: FloatArray, stamp_ns: int) -> None:
        """Take in mapped slim objects (N, 2) [m] in base at `stamp_ns`, from a caller that is sure of the chair's pose.

        Slim points near them do not count as a person's legs for as long as this information is fresh.
        """
        self._mapped_legs, self._mapped_legs_ns = mapped, stamp_ns

    def see(self, scan: Scan) -> None:
        """Take in a scan, as the lidar gave it."""
        scan = without_near_field(without_overflow_codes(scan), self._body)
        before, self._scan = self._scan, scan
        count, longest_ns = len(scan.ranges), round(BLIND_S * 1e9)
        self._hidden = np.zeros(count, np.bool_) if self._mask is None else self._mask.hides(scan)
        if before is None or not len(before.ranges):
            self._measured_ns = np.full(count, scan.stamp_ns)  # all beams count as seeing at first
        elif len(before.ranges) != count:  # another number of beams over the same field of view
            self._measured_ns = self._measured_ns[np.arange(count) * len(before.ranges) // count]
        self._measured_ns = np.where(np.isfinite(scan.ranges), scan.stamp_ns, self._measured_ns)
        silent = scan.stamp_ns - self._measured_ns[~self._hidden] >= longest_ns
        same = before is not None and np.array_equal(before.ranges, scan.ranges, equal_nan=True)
        self._same_since_ns = _since(self._same_since_ns, same, scan.stamp_ns if before is None else before.stamp_ns)
        self._slim = slim_beams(scan, self._hidden)
        self._blindness = ""
        if self._same_since_ns is not None and scan.stamp_ns - self._same_since_ns >= longest_ns:
            self._blindness = "lidar_frozen"
        if not silent.size or 1.0 - silent.mean() < LEAST_COVERAGE:
            self._blindness = "lidar_blind"

    def judge(self, command: Twist, measured: Twist, now_ns: int) -> MonitorVerdict:
        """Return the verdict on a command now, the scan moved on by the chair's `measured` motion since."""
        scan = self._scan
        scan_ns = None if scan is None else scan.stamp_ns
        unfit = self._unfit(now_ns)
        if unfit:
            return MonitorVerdict(now_ns, scan_ns, command, 0.0, stop=unfit)
        if not all(map(math.isfinite, (command.v, command.omega, measured.v, measured.omega))):
            return MonitorVerdict(now_ns, scan_ns, command, 0.0, stop="obstacle")
        points, slim = self._points(measured, now_ns)
        share, contact_s = self._permitted(points, slim, command)
        if share == 0.0 and slim.any():
            passing, passing_contact_s = self._permitted(points, slim, command, gave_way=True)
            if passing > 0.0 and self._has_given_way(measured, now_ns):
                share, contact_s = passing, passing_contact_s
        if not is_at_rest(measured):
            self._gives_way_since_ns = None
        return MonitorVerdict(
            stamp_ns=now_ns,
            scan_ns=scan_ns,
            twist=command,
            share=share,
            contact_s=contact_s,
            stop="" if share > 0.0 else "obstacle",
        )

    def shares(self, twists: Sequence[Twist], measured: Twist, now_ns: int) -> tuple[float, ...] | None:
        """Return the share of each twist that the scan permits to a rider's own hand; None without a fit scan.

        The rider knows about the people near by: their legs slow the chair to a crawl, and only the chair's own outline
        stops it.
        """
        if self._unfit(now_ns) or not all(map(math.isfinite, (measured.v, measured.omega))):
            return None
        points, slim = self._points(measured, now_ns)
        return tuple(self._stoppable(points, slim, twist) for twist in twists)

    def _stoppable(self, points: FloatArray, slim: BoolArray, push: Twist) -> float:
        free = stoppable_along(points, slim, push, self._body, self._settings, self._stops, scanned=True)
        if free > 0.0 or not slim.any():
            return free
        return stoppable_along(points, slim, push, self._body, self._settings, self._stops, gave_way=True, scanned=True)

    def _unfit(self, now_ns: int) -> str:
        """Return the id of the stop of a lidar that cannot be judged by; empty for one that can."""
        fresh = self._scan is not None and _is_fresh(self._scan.stamp_ns, SCAN_MS, now_ns)
        return self._blindness or ("" if fresh else "lidar_late")

    def _points(self, measured: Twist, now_ns: int) -> tuple[FloatArray, BoolArray]:
        """Return the scan's points (N, 2) [m] in base now, and a mask (N,) of legs; for a fit scan only."""
        assert self._scan is not None
        valid = valid_beams(self._scan, self._hidden)
        points = points_now(self._scan, valid, self._body, measured, now_ns)
        slim = self._slim[valid]
        slim[slim] = ~self._is_mapped(points[slim], measured, now_ns)
        return points, slim

    def _is_mapped(self, points: FloatArray, measured: Twist, now_ns: int) -> BoolArray:
        """Return a mask (N,) of points (N, 2) [m] in base that lie at mapped slim objects."""
        stamp_ns = self._mapped_legs_ns
        if stamp_ns is None or not len(self._mapped_legs) or not _is_fresh(stamp_ns, MAPPED_MS, now_ns):
            return np.zeros(len(points), np.bool_)
        seconds = (now_ns - stamp_ns) * 1e-9
        (moved,) = arcs(np.array([measured.v * seconds]), np.array([measured.omega * seconds]))
        known = transform_points(Pose2(*moved).inverse(), self._mapped_legs)
        gaps = np.hypot(*(points[:, None] - known[None]).transpose(2, 0, 1))
        near: BoolArray = gaps.min(axis=1) <= MAPPED_WITHIN
        return near

    def _permitted(
        self, points: FloatArray, slim: BoolArray, command: Twist, gave_way: bool = False
    ) -> tuple[float, float]:
        return permitted_along(points, slim, command, self._body, self._settings, self._stops, gave_way=gave_way)

    def _has_given_way(self, measured: Twist, now_ns: int) -> bool:
        """Return whether the chair has stood long enough before legs in its way; called in every tick with such legs.

        The chair passes until the legs have not been in its way for a moment. It gives way anew to people that come
        later.
        """
        if self._gave_way_ns is not None and now_ns - self._gave_way_ns > _OTHERS_NS:
            self._gives_way_since_ns = None
        self._gave_way_ns = now_ns
        if self._passes_until_ns is None or now_ns > self._passes_until_ns:
            if is_at_rest(measured) and self._gives_way_since_ns is None:
                self._gives_way_since_ns = now_ns
            since_ns = self._gives_way_since_ns
            if since_ns is None or now_ns - since_ns < GIVE_WAY_S * 1e9:
                return False
        self._passes_until_ns = now_ns + _PAST_NS
        return True


_PAST_NS = 1_000_000_000
"""ns; legs that were not in the way for so long are past."""

_OTHERS_NS = 5_000_000_000
"""ns; legs in the way again after so long are somebody else's."""


def is_at_rest(twist: Twist) -> bool:
    """Return whether a measured twist is a standstill within noise."""
    return abs(twist.v) < 0.03 and abs(twist.omega) < 0.06


def stale_stop(verdict: MonitorVerdict | None, now_ns: int) -> str:
    """Return the id of the stop that forbids any speed now, or "" if verdict and scan are fresh."""
    if not _is_fresh(None if verdict is None else verdict.stamp_ns, VERDICT_MS, now_ns):
        return "monitor_silent"
    if not _is_fresh(None if verdict is None else verdict.scan_ns, SCAN_MS, now_ns):
        return "lidar_late"
    return ""


def is_silent(verdict: MonitorVerdict | None, now_ns: int) -> bool:
    """Return whether the monitor has been silent for so long that the drive ends."""
    return not _is_fresh(None if verdict is None else verdict.stamp_ns, SILENT_MS, now_ns)


def permitted_share(command: Twist, verdict: MonitorVerdict) -> float:
    """Return the share of a command that a verdict permits; the verdict may be of a command one or two ticks older.

    It is 0 for a command in another direction than the judged one, or well beyond it, because that was not judged.
    """
    judged = verdict.twist
    for value, known, slack in (
        (command.v, judged.v, JUDGED_WITHIN_V),
        (command.omega, judged.omega, JUDGED_WITHIN_OMEGA),
    ):
        if not min(known, 0.0) - slack <= value <= max(known, 0.0) + slack:
            return 0.0
    return verdict.share


def without_near_field(scan: Scan, body: ChairBody) -> Scan:
    """Return the scan without ranges below its least range, which are errors or mean "too close" (-inf).

    A beam that is too close becomes a point just outside the footprint where the footprint's edge is nearer than the
    least range. Elsewhere it is the chair itself or dirt on the lidar, and becomes invalid.
    """
    near = scan.ranges < max(scan.range_min, 0.0)
    if not near.any():
        return scan
    edge = outline_reach(scan.angles(), body, _OUTSIDE)
    stands = near & np.isneginf(scan.ranges) & (edge <= scan.range_min)
    ranges = np.where(stands, edge, np.where(near, math.nan, scan.ranges)).astype(np.float32)
    return replace(scan, ranges=ranges, range_min=0.0)


_OUTSIDE = 0.005
"""m; an object too close to be measured is placed so far outside the footprint."""


def valid_beams(scan: Scan, hidden: BoolArray) -> BoolArray:
    """Return a mask (N,) of beams with a valid range that is not the chair itself."""
    valid: BoolArray = np.isfinite(scan.ranges) & ~hidden
    valid[valid] &= (scan.ranges[valid] >= max(scan.range_min, 0.0)) & (scan.ranges[valid] <= scan.range_max)
    return valid


def slim_beams(scan: Scan, hidden: BoolArray) -> BoolArray:
    """Return a mask (N,) of beams that end on a slim object standing free: nothing beside it in the view is as near."""
    slim = np.zeros(len(scan.ranges), np.bool_)
    beams = np.flatnonzero(valid_beams(scan, hidden))
    if len(beams) < 2:
        return slim
    r, angles = scan.ranges[beams].astype(np.float64), scan.angles()[beams]
    points = np.column_stack([r * np.cos(angles), r * np.sin(angles)])
    breaks = 1 + np.flatnonzero(np.hypot(*np.diff(points, axis=0).T) > _APART)
    first = np.concatenate([[0], breaks])
    last = np.concatenate([breaks, [len(beams)]]) - 1
    beside = np.concatenate([[math.inf], r, [math.inf]])
    open_so_far = np.cumsum(np.isposinf(scan.ranges))[beams]
    opens = np.concatenate([[False], np.diff(open_so_far) > 0, [False]])  # free beams before each beam, and at the end
    before = np.where(opens[first], math.inf, beside[first])
    after = np.where(opens[last + 1], math.inf, beside[last + 2])
    width = np.hypot(*(points[last] - points[first]).T)
    stands = (before > r[first] + _APART) & (after > r[last] + _APART)
    legs = stands & (width <= LEG_WIDTH) & (last - first + 1 >= LEAST_POINTS)
    slim[beams] = np.repeat(legs, last - first + 1)
    return slim


_APART = 0.12
"""m; neighbouring beams that end farther apart end on different objects."""


def points_now(scan: Scan, valid: BoolArray, body: ChairBody, measured: Twist, now_ns: int) -> FloatArray:
    """Return the points (N, 2) [m] of a scan's beams `valid` in base now.

    Each beam is moved on by the chair's `measured` twist [m/s, rad/s] since its own time.
    """
    ranges = scan.ranges.astype(np.float64)
    r, angles = ranges[valid], scan.angles()[valid]
    points = transform_points(body.base_from_laser, np.column_stack([r * np.cos(angles), r * np.sin(angles)]))
    seconds: FloatArray = (now_ns - scan.stamp_ns) * 1e-9 - scan.time_step * np.flatnonzero(valid).astype(np.float64)
    x, y, theta = arcs(measured.v * seconds, measured.omega * seconds).T
    c, s = np.cos(theta), np.sin(theta)
    dx, dy = points[:, 0] - x, points[:, 1] - y
    return np.column_stack([c * dx + s * dy, c * dy - s * dx])


def _is_fresh(stamp_ns: int | None, longest_ms: int, now_ns: int) -> bool:
    """Return whether a stamp is at most `longest_ms` old, and not in the future by more than two ticks."""
    return stamp_ns is not None and -_AHEAD_NS <= now_ns - stamp_ns <= longest_ms * 1_000_000


_AHEAD_NS = 100_000_000


def _since(since_ns: int | None, so: bool, stamp_ns: int) -> int | None:
    """Return the start of the time over which a condition has held, None if it does not hold."""
    if not so:
        return None
    return stamp_ns if since_ns is None else since_ns
