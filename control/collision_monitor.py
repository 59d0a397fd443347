"""The last look before the chair moves on: raw scans against the commanded arc, with no planner and no map.

Each point of the latest scan is followed, in the chair's own frame, along the circle on which it will come nearer while
the chair drives the commanded arc; when that circle enters the chair's outline there is contact. Nearer than the chair
can stop, it must stop; nearer than it stops in comfort, it slows down. So the zones scale with the speed and bend with
the turn. What is kept free round the outline grows with the speed, too: at a crawl it is as narrow as a doorway needs,
and what lies within the margin of a faster drive does not stop the chair but slows it down to where the margin is free.
Ahead it is longer. Towards what is slim and stands free it is longer still, and wide, at any speed: a lidar at the
height of shins sees legs, and whom they belong to reaches beyond them. Where the way is too narrow for that, as in many
a corridor, the chair stops and gives way; who is still there after a while is passed nearer by, at a crawl. Of the map
it lets itself be told one thing, which takes only that extra room back: where a slim thing has always stood, as the legs
of a table do. It stops before it as before anything.

It also judges the lidar: one that is silent, sees too little or repeats a scan stops the chair. A verdict is stamped,
and says of which scan it was made; who lets speed through asks for a fresh one (`refusal`), so that a monitor that died
stops the chair, too. It is a pure function of what it was told (`Monitor` keeps only that), which a process of its own
calls by a timer (`runtime.monitor_process`), and the simulator in lockstep.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.calibration.self_mask import SelfMask, outline_reach
from waychair.calibration.stopping import StopTable
from waychair.config import Settings, setting
from waychair.control.arc_entry import entry_times
from waychair.errors import ConfigError
from waychair.geometry import arcs, transform_points
from waychair.scans import without_codes
from waychair.types import BoolArray, FloatArray, IntArray, Pose2, Scan, Twist


@dataclass(frozen=True, slots=True)
class MonitorSettings(Settings):
    """Zones, braking, and how fresh things must be."""

    beside: float = setting(0.05, "m", "kept free round the outline on all sides at full speed", low=0.0, high=0.5)
    ahead: float = setting(0.10, "m", "kept free besides in the direction of travel, likewise", low=0.0, high=1.0)
    beside_crawl: float = setting(0.0, "m", "kept free on all sides at a crawl", low=0.0, high=0.5)
    ahead_crawl: float = setting(
        0.01, "m", "kept free besides in the direction of travel at a crawl", low=0.0, high=1.0
    )
    crawl: float = setting(0.3, "m/s", "up to this speed of any part of the chair it crawls", low=0.05, high=1.0)
    full: float = setting(
        0.8, "m/s", "from this speed on the margins are whole; between, in proportion", low=0.1, high=3.0
    )
    ahead_of_legs: float = setting(
        0.55, "m", "as above, before what may be a person's legs: bodies reach 0.2 beyond", low=0.0, high=1.0
    )
    beside_legs: float = setting(
        0.45, "m", "kept free besides on either side of such, while not yet past", low=0.0, high=1.0
    )
    round_legs: float = setting(
        0.20, "m", "kept free round the outline before such while the chair turns on the spot", low=0.0, high=1.0
    )
    give_way_s: float = setting(
        1.5, "s", "the chair stands so long before legs that are in the way", low=0.0, high=20.0
    )
    ahead_after: float = setting(0.33, "m", "ahead_of_legs once it has given way", low=0.0, high=1.0)
    beside_after: float = setting(0.20, "m", "beside_legs once it has given way", low=0.0, high=1.0)
    slim: float = setting(0.35, "m", "legs are no wider than this, together", low=0.05, high=1.0)
    furniture: float = setting(0.1, "m", "legs so near to what the map shows are of that", low=0.0, high=0.3)
    furniture_ms: int = setting(400, "ms", "what was told of mapped things holds so long", low=20, high=1000)
    least_points: int = setting(3, "", "so many points are something, fewer are noise", low=1, high=100)
    reaction_s: float = setting(
        0.3, "s", "from a verdict to the first braking, before that was measured", low=0.0, high=2.0
    )
    emergency: float = setting(1.5, "m/s^2", "braking in an emergency, before that was measured", low=0.2, high=4.0)
    emergency_alpha: float = setting(1.5, "rad/s^2", "as above, of turning", low=0.2, high=10.0)
    braking: float = setting(0.6, "m/s^2", "braking in comfort: slowing down begins by it", low=0.1, high=3.0)
    alpha: float = setting(0.8, "rad/s^2", "as above, of turning", low=0.1, high=5.0)
    verdict_ms: int = setting(150, "ms", "an older verdict lets no speed through", low=20, high=1000)
    scan_ms: int = setting(300, "ms", "a verdict of an older scan lets none through", low=50, high=1000)
    silent_ms: int = setting(500, "ms", "a monitor that says nothing for so long ends a drive", low=100, high=5000)
    blind_s: float = setting(0.4, "s", "a beam that measures nothing for so long is blind", low=0.1, high=2.0)
    least_coverage: float = setting(0.8, "", "part of the beams that must not be blind", low=0.0, high=1.0)
    strayed_v: float = setting(0.1, "m/s", "a command this far beyond the judged one was not judged", low=0.0, high=1.0)
    strayed_omega: float = setting(0.2, "rad/s", "as above, of turning", low=0.0, high=2.0)

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if not self.crawl < self.full:
            raise ConfigError(f"full = {self.full:g} m/s must be faster than crawl = {self.crawl:g} m/s")
        if self.beside_crawl > self.beside or self.ahead_crawl > self.ahead:
            raise ConfigError(
                f"beside_crawl = {self.beside_crawl:g} m and ahead_crawl = {self.ahead_crawl:g} m must not exceed "
                f"beside = {self.beside:g} m and ahead = {self.ahead:g} m: margins grow with the speed"
            )
        if self.beside_after > self.beside_legs or self.ahead_after > self.ahead_of_legs:
            raise ConfigError(
                f"beside_after = {self.beside_after:g} m and ahead_after = {self.ahead_after:g} m must not exceed "
                f"beside_legs = {self.beside_legs:g} m and ahead_of_legs = {self.ahead_of_legs:g} m: "
                "having given way the chair may pass nearer, not less near"
            )


@dataclass(frozen=True, slots=True)
class MonitorVerdict:
    """What was found at `stamp_ns` of a scan stamped `scan_ns` (None: there was none) about the judged `twist`.

    `share` in [0, 1] of it may be driven. `stop` is "" or the id of a row of `stops.STOPS`. `contact_s`: driving time
    until something is touched, +inf where nothing is.
    """

    stamp_ns: int
    scan_ns: int | None
    twist: Twist
    share: float
    contact_s: float = math.inf
    stop: str = ""


class Monitor:
    """Keeps the latest scan, when each beam last measured something, and since when scans have been the same.

    A beam that measures nothing is not blind at once: in real buildings one in three may see nothing for a moment, past
    glass or down a hall (recordings of Intel, Freiburg 079 and Malaga), but others from scan to scan as the chair moves.
    """

    def __init__(
        self,
        body: ChairBody,
        settings: MonitorSettings | None = None,
        stops: StopTable | None = None,
        mask: SelfMask | None = None,
    ) -> None:
        """`stops`: how far the chair goes on, where it was measured; `mask`: what the lidar sees of the chair itself."""
        self._body, self._stops, self._mask = body, stops, mask
        self._settings = settings or MonitorSettings()
        self._scan: Scan | None = None
        self._hidden: BoolArray = np.zeros(0, np.bool_)
        self._slim: BoolArray = np.zeros(0, np.bool_)
        self._measured_ns: IntArray = np.zeros(0, np.int64)  # when each beam last measured something
        self._same_since_ns: int | None = None
        self._blindness = ""
        self._gives_way_since_ns: int | None = None
        self._gave_way_ns: int | None = None  # in the latest tick in which it did
        self._passes_until_ns: int | None = None
        self._furniture: FloatArray = np.empty((0, 2))
        self._furnished_ns: int | None = None

    def furnish(self, mapped: FloatArray, stamp_ns: int) -> None:
        """Told what might be legs but has always stood there, (N, 2) [m] in base at `stamp_ns`, by who is sure of it."""
        self._furniture, self._furnished_ns = mapped, stamp_ns

    def see(self, scan: Scan) -> None:
        """Take in a scan, as the lidar gave it."""
        scan = without_near_field(without_codes(scan), self._body)
        before, self._scan = self._scan, scan
        count, longest_ns = len(scan.ranges), round(self._settings.blind_s * 1e9)
        self._hidden = np.zeros(count, np.bool_) if self._mask is None else self._mask.hides(scan)
        if before is None or not len(before.ranges):
            self._measured_ns = np.full(count, scan.stamp_ns)  # until time has shown otherwise
        elif len(before.ranges) != count:  # another count of beams over the same view
            self._measured_ns = self._measured_ns[np.arange(count) * len(before.ranges) // count]
        self._measured_ns = np.where(np.isfinite(scan.ranges), scan.stamp_ns, self._measured_ns)
        silent = scan.stamp_ns - self._measured_ns[~self._hidden] >= longest_ns
        same = before is not None and np.array_equal(before.ranges, scan.ranges, equal_nan=True)
        self._same_since_ns = _since(self._same_since_ns, same, scan.stamp_ns if before is None else before.stamp_ns)
        self._slim = slim_beams(scan, self._hidden, self._settings)
        self._blindness = ""
        if self._same_since_ns is not None and scan.stamp_ns - self._same_since_ns >= longest_ns:
            self._blindness = "lidar_frozen"
        if not silent.size or 1.0 - silent.mean() < self._settings.least_coverage:
            self._blindness = "lidar_blind"

    def judge(self, command: Twist, measured: Twist, now_ns: int) -> MonitorVerdict:
        """May the chair, moving by `measured`, be commanded so now? The scan is carried on by its motion since."""
        scan, s = self._scan, self._settings
        scan_ns = None if scan is None else scan.stamp_ns
        if self._blindness:
            return MonitorVerdict(now_ns, scan_ns, command, 0.0, stop=self._blindness)
        if scan is None or not _is_fresh(scan_ns, s.scan_ms, now_ns):
            return MonitorVerdict(now_ns, scan_ns, command, 0.0, stop="lidar_late")
        if not all(map(math.isfinite, (command.v, command.omega, measured.v, measured.omega))):
            return MonitorVerdict(now_ns, scan_ns, command, 0.0, stop="obstacle")
        told = measuring(scan, self._hidden)
        points = points_now(scan, told, self._body, measured, now_ns)
        slim = self._slim[told]
        slim[slim] = ~self._is_furniture(points[slim], measured, now_ns)
        share, contact_s = self._permitted(points, slim, command)
        if share == 0.0 and slim.any():
            passing, passing_contact_s = self._permitted(points, slim, command, gave_way=True)
            if passing > 0.0 and self._has_given_way(measured, now_ns):
                share, contact_s = passing, passing_contact_s
        if not _stands(measured):
            self._gives_way_since_ns = None
        return MonitorVerdict(now_ns, scan_ns, command, share, contact_s, "" if share > 0.0 else "obstacle")

    def _is_furniture(self, points: FloatArray, measured: Twist, now_ns: int) -> BoolArray:
        """(N,) which of points (N, 2) [m, base frame] are where something has always stood."""
        stamp_ns, s = self._furnished_ns, self._settings
        if stamp_ns is None or not len(self._furniture) or not _is_fresh(stamp_ns, s.furniture_ms, now_ns):
            return np.zeros(len(points), np.bool_)
        seconds = (now_ns - stamp_ns) * 1e-9
        (moved,) = arcs(np.array([measured.v * seconds]), np.array([measured.omega * seconds]))
        known = transform_points(Pose2(*moved).inverse(), self._furniture)
        gaps = np.hypot(*(points[:, None] - known[None]).transpose(2, 0, 1))
        near: BoolArray = gaps.min(axis=1) <= s.furniture
        return near

    def _permitted(
        self, points: FloatArray, slim: BoolArray, command: Twist, gave_way: bool = False
    ) -> tuple[float, float]:
        """Share of a command that is permitted, 0 to stop, and its contact time; at most a crawl once it `gave_way`."""
        s, share, contact_s = self._settings, 0.0, math.inf
        considered = paces(command, self._body, s)
        for pace in considered[-1:] if gave_way else considered:
            contact_s = self._contact_s(points, slim, command, float(pace), gave_way)
            share = max(share, min(float(pace), slow_share(contact_s, command, s)))
            if share >= 1.0:
                return 1.0, contact_s
        if contact_s < stop_seconds(command, s, self._stops):  # by what a crawl keeps free
            return 0.0, contact_s
        return share, contact_s

    def _has_given_way(self, measured: Twist, now_ns: int) -> bool:
        """Whether the chair has stood for long before legs that are in its way; told so in every tick in which it is.

        It passes until a while after they were in the way last. Others who come later are given way to anew.
        """
        if self._gave_way_ns is not None and now_ns - self._gave_way_ns > _OTHERS_NS:
            self._gives_way_since_ns = None
        self._gave_way_ns = now_ns
        if self._passes_until_ns is None or now_ns > self._passes_until_ns:
            if _stands(measured) and self._gives_way_since_ns is None:
                self._gives_way_since_ns = now_ns
            since_ns = self._gives_way_since_ns
            if since_ns is None or now_ns - since_ns < self._settings.give_way_s * 1e9:
                return False
        self._passes_until_ns = now_ns + _PAST_NS
        return True

    def _contact_s(
        self, points: FloatArray, slim: BoolArray, command: Twist, pace: float, gave_way: bool = False
    ) -> float:
        """Driving time until so many points that they are something are touched."""
        s = self._settings
        if len(points) < s.least_points:
            return math.inf
        times = contact_times(points, slim, command, self._body, s, pace, gave_way)
        return float(np.partition(times, s.least_points - 1)[s.least_points - 1])


_PAST_NS = 1_000_000_000
"""Legs that were not in the way for so long are past."""

_OTHERS_NS = 5_000_000_000
"""Legs that are in the way again after so long are those of somebody else."""


def _stands(twist: Twist) -> bool:
    """Whether a measured twist is a standstill, but for noise."""
    return abs(twist.v) < 0.03 and abs(twist.omega) < 0.06


def refusal(verdict: MonitorVerdict | None, now_ns: int, settings: MonitorSettings) -> str:
    """Id of the stop for which no speed at all may be let through now, or "": verdict and scan must be fresh."""
    if not _is_fresh(None if verdict is None else verdict.stamp_ns, settings.verdict_ms, now_ns):
        return "monitor_silent"
    if not _is_fresh(None if verdict is None else verdict.scan_ns, settings.scan_ms, now_ns):
        return "lidar_late"
    return ""


def is_silent(verdict: MonitorVerdict | None, now_ns: int, settings: MonitorSettings) -> bool:
    """Whether the monitor has not answered for so long that a drive is over."""
    return not _is_fresh(None if verdict is None else verdict.stamp_ns, settings.silent_ms, now_ns)


def permitted_share(command: Twist, verdict: MonitorVerdict, settings: MonitorSettings) -> float:
    """Part of a command that a verdict permits, which may have been made of the command of a tick or two before.

    A command in another direction than the judged one, or well beyond it, was not judged: none of it.
    """
    judged = verdict.twist
    for value, known, slack in (
        (command.v, judged.v, settings.strayed_v),
        (command.omega, judged.omega, settings.strayed_omega),
    ):
        if not min(known, 0.0) - slack <= value <= max(known, 0.0) + slack:
            return 0.0
    return verdict.share


def without_near_field(scan: Scan, body: ChairBody) -> Scan:
    """The scan without readings below its least range: those are errors, or say that something is too close (-inf).

    What is too close stands just outside the chair's outline, where that is so near to the laser; else it is the
    chair's own, or dirt on the lidar, and invalid.
    """
    near = scan.ranges < max(scan.range_min, 0.0)
    if not near.any():
        return scan
    edge = outline_reach(scan.angles(), body, _OUTSIDE)
    stands = near & np.isneginf(scan.ranges) & (edge <= scan.range_min)
    ranges = np.where(stands, edge, np.where(near, math.nan, scan.ranges)).astype(np.float32)
    return replace(scan, ranges=ranges, range_min=0.0)


_OUTSIDE = 0.005
"""What is too close to be measured stands so far [m] outside the outline."""


def measuring(scan: Scan, hidden: BoolArray) -> BoolArray:
    """(N,) beams that measure something other than the chair itself."""
    told: BoolArray = np.isfinite(scan.ranges) & ~hidden
    told[told] &= (scan.ranges[told] >= max(scan.range_min, 0.0)) & (scan.ranges[told] <= scan.range_max)
    return told


def slim_beams(scan: Scan, hidden: BoolArray, settings: MonitorSettings) -> BoolArray:
    """(N,) beams that end on something slim that stands free, before what is beside it in the view, or nothing is."""
    slim = np.zeros(len(scan.ranges), np.bool_)
    beams = np.flatnonzero(measuring(scan, hidden))
    if len(beams) < 2:
        return slim
    r, angles = scan.ranges[beams].astype(np.float64), scan.angles()[beams]
    points = np.column_stack([r * np.cos(angles), r * np.sin(angles)])
    breaks = 1 + np.flatnonzero(np.hypot(*np.diff(points, axis=0).T) > _APART)
    first = np.concatenate([[0], breaks])
    last = np.concatenate([breaks, [len(beams)]]) - 1
    beside = np.concatenate([[math.inf], r, [math.inf]])
    open_so_far = np.cumsum(np.isposinf(scan.ranges))[beams]
    opens = np.concatenate([[False], np.diff(open_so_far) > 0, [False]])  # before each beam, and after the last
    before = np.where(opens[first], math.inf, beside[first])
    after = np.where(opens[last + 1], math.inf, beside[last + 2])
    width = np.hypot(*(points[last] - points[first]).T)
    stands = (before > r[first] + _APART) & (after > r[last] + _APART)
    legs = stands & (width <= settings.slim) & (last - first + 1 >= settings.least_points)
    slim[beams] = np.repeat(legs, last - first + 1)
    return slim


_APART = 0.12
"""Neighbouring beams that end farther apart [m] end on different things."""


def points_now(scan: Scan, told: BoolArray, body: ChairBody, measured: Twist, now_ns: int) -> FloatArray:
    """Points (N, 2) [m] that the beams `told` of a scan saw, in the base frame of now.

    The chair has moved by `measured` [m/s, rad/s] since.
    """
    ranges = scan.ranges.astype(np.float64)
    r, angles = ranges[told], scan.angles()[told]
    points = transform_points(body.base_from_laser, np.column_stack([r * np.cos(angles), r * np.sin(angles)]))
    seconds: FloatArray = (now_ns - scan.stamp_ns) * 1e-9 - scan.time_step * np.flatnonzero(told).astype(np.float64)
    x, y, theta = arcs(measured.v * seconds, measured.omega * seconds).T
    c, s = np.cos(theta), np.sin(theta)
    dx, dy = points[:, 0] - x, points[:, 1] - y
    return np.column_stack([c * dx + s * dy, c * dy - s * dx])


def paces(command: Twist, body: ChairBody, settings: MonitorSettings) -> FloatArray:
    """Shares of a command by whose margins it is judged, from the whole of it down to a crawl."""
    slowest = min(1.0, settings.crawl / max(_fastest(command, body), 1e-9))
    return np.linspace(1.0, slowest, _PACES) if slowest < 1.0 else np.ones(1)


_PACES = 4
"""So many, evenly spaced; a chair that crawls has one."""


def margins(command: Twist, body: ChairBody, settings: MonitorSettings, pace: float = 1.0) -> tuple[float, float]:
    """What is kept free [m] on all sides, and besides in the direction of travel, at a share `pace` of a command."""
    s = settings
    share = min(max((pace * _fastest(command, body) - s.crawl) / (s.full - s.crawl), 0.0), 1.0)
    return s.beside_crawl + share * (s.beside - s.beside_crawl), s.ahead_crawl + share * (s.ahead - s.ahead_crawl)


def _fastest(command: Twist, body: ChairBody) -> float:
    """Speed [m/s] of driving, or of the farthest corner in turning, whichever is more."""
    return max(abs(command.v), abs(command.omega) * body.circumscribed_radius)


def contact_times(
    points: FloatArray,
    legs: BoolArray,
    command: Twist,
    body: ChairBody,
    settings: MonitorSettings,
    pace: float = 1.0,
    gave_way: bool = False,
) -> FloatArray:
    """Driving time [s] (N,) until each point (N, 2) [m, base frame] is touched on the arc of a command; +inf if never.

    The outline is grown by the `margins` of a share `pace` of the command's speed, and by more for points of `legs`
    (N,), less once the chair `gave_way`; the time is that of the whole command.
    A point that is within that already is touched now if it comes nearer in the next second by more than a centimetre:
    driving along it or away from it is free. One well within the outline itself is touched now, whatever is commanded.
    """
    s, x, y = settings, points[:, 0], points[:, 1]
    beside, besides_ahead = margins(command, body, s, pace)
    to_come = legs & ((x > body.front) | (x < -body.rear))
    beside_legs, ahead_of_legs = (s.beside_after, s.ahead_after) if gave_way else (s.beside_legs, s.ahead_of_legs)
    # a corner that swings faster than the chair drives comes upon who stands beside it
    swings = abs(command.omega) * body.circumscribed_radius > abs(command.v)
    around = beside + np.where(legs & swings, s.round_legs, 0.0)
    half = body.width / 2 + np.maximum(around, beside + np.where(to_come, beside_legs, 0.0))
    ahead = beside + np.where(legs, max(besides_ahead, ahead_of_legs), besides_ahead)
    front = body.front + np.maximum(around, ahead if command.v > 0.0 else 0.0)
    rear = body.rear + np.maximum(around, ahead if command.v < 0.0 else 0.0)
    # the side that a point is nearest to moves in until the point lies a centimetre outside
    gaps = np.stack([front - x, rear + x, half - np.abs(y)])
    nearest, within = gaps.argmin(axis=0), gaps.min(axis=0)
    shrink = np.maximum(within + _CLOSER, 0.0)
    sides = [side - np.where(nearest == row, shrink, 0.0) for row, side in enumerate((front, rear, half))]
    times = entry_times(x, y, command, *sides)
    times = np.where((within > 0.0) & (times < _SOON), 0.0, times)
    deep = np.minimum(np.minimum(body.front - x, body.rear + x), body.width / 2 - np.abs(y)) > _DEEP
    moves = abs(command.v) > 0.0 or abs(command.omega) > 0.0
    return np.where(deep & moves, 0.0, times)


_CLOSER = 0.01
"""A point within the zone counts when it comes nearer by more [m]: noise of a lidar, and a step of the chair."""

_SOON = 1.0
"""... and within this time [s], so that a chair does not creep up to it in steps of that."""

_DEEP = 0.05
"""A point this far inside the outline [m] is no noise at its edge."""


def stop_seconds(command: Twist, settings: MonitorSettings, stops: StopTable | None = None) -> float:
    """Driving time [s] at this speed that goes by until the chair has come to rest by an emergency.

    Braking in proportion it stays on its arc and needs half the braking time at full speed. Where stops were measured
    and took longer than the settings' figures say, that counts.
    """
    v, omega = abs(command.v), abs(command.omega)
    reckoned = settings.reaction_s + 0.5 * max(v / settings.emergency, omega / settings.emergency_alpha)
    if stops is None:
        return reckoned
    fastest = stops.speeds[-1]
    known = min(max(v, 1e-6), fastest)
    straight = stops.distance(known) / known * max(1.0, v / fastest) if v > 0.0 else 0.0
    turning = (
        stops.turn_angle / stops.turn_rate * max(1.0, omega / stops.turn_rate) if omega and stops.turn_rate else 0.0
    )
    return max(reckoned, straight, turning)


def slow_share(contact_s: float, command: Twist, settings: MonitorSettings) -> float:
    """Part of a command at which the chair stops in comfort before it touches what it would touch after `contact_s`.

    At a share k it goes on for k reaction + k^2 T of its driving time, T being half the braking time: that is
    contact_s at the greatest k that is allowed.
    """
    half = 0.5 * max(abs(command.v) / settings.braking, abs(command.omega) / settings.alpha)
    if math.isinf(contact_s) or half == 0.0:
        return 1.0
    reaction = settings.reaction_s
    return min(1.0, (math.sqrt(reaction * reaction + 4.0 * half * contact_s) - reaction) / (2.0 * half))


def _is_fresh(stamp_ns: int | None, longest_ms: int, now_ns: int) -> bool:
    """Whether a stamp is no older than that, nor (by more than two ticks of a clock read elsewhere) of the future."""
    return stamp_ns is not None and -_AHEAD_NS <= now_ns - stamp_ns <= longest_ms * 1_000_000


_AHEAD_NS = 100_000_000


def _since(since_ns: int | None, so: bool, stamp_ns: int) -> int | None:
    """Since when something has been so."""
    if not so:
        return None
    return stamp_ns if since_ns is None else since_ns
