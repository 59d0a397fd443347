"""A planar lidar on a moving chair: exact rays, reflections by material, and the faults of a real instrument.

A sweep takes time: each beam leaves from the chair's pose at its own moment, and the scan is delivered after the last
beam. Glass lets beams through, mirrors reflect them, and dark surfaces absorb them beyond a few metres. Where a level
has ramps, the plane of the beams tilts with the chair.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.calibration.chair_body import ChairBody
from waychair.config import Settings, setting
from waychair.errors import ConfigError
from waychair.geometry import in_space
from waychair.simulation.scene.scene import Mover, Reflection
from waychair.simulation.sensors.rays import NO_CIRCLES, Scenery, cosine_of_incidence, nearest_circle, nearest_segment
from waychair.simulation.sensors.silhouettes import legs, rider_legs
from waychair.simulation.sensors.tilted_rays import Terrain, TiltedPose, cast_tilted, row_from_pose
from waychair.topics import SCAN
from waychair.types import FloatArray, IntArray, Pose2, Scan

MOST_MIRRORS = 2
"""A beam reflected by more mirrors than this is lost."""

_MOST_SURFACES = 16  # ends a beam between two panes of glass
_ONWARD = 1e-7  # m; a beam that continues does not hit the same surface again
_DARK, _GLASS, _MIRROR = (int(kind) for kind in (Reflection.DARK, Reflection.GLASS, Reflection.MIRROR))


# Ranges at which surfaces vanish and rates of faults are plausible for a small indoor lidar, not measured.
SIGMA_PER_METRE = 0.0005  # growth of the range noise (one sigma) with the range
DROP_OUT = 0.002  # part of the beams that read nan
MIXED = 0.05  # part of the beams on an edge that read a range between near and far (mixed pixels)
EDGE = 0.2  # m; step from beam to beam that is an edge
DARK_RANGE = 4.0  # m; largest range of a dark surface at normal incidence
GLASS_ANGLE = math.radians(3.0)  # rad; largest angle of incidence at which glass returns a beam


@dataclass(frozen=True, slots=True)
class LidarSettings(Settings):
    """Field of view, range and noise of the lidar; beams are evenly spaced over the field of view."""

    rate_hz: float = setting(
        SCAN.rate_hz,
        "Hz",
        "scans of the lidar per second; larger: obstacles are seen sooner, simulation is slower; 0: no lidar",
        low=0.0,
        high=100.0,
    )
    beams: int = setting(
        720, "", "beams per lidar scan; more: smaller obstacles are seen, simulation is slower", low=2, high=10_000
    )
    field_of_view: float = setting(
        math.radians(270.0),
        "rad",
        "field of view of the lidar, centred on its x axis; larger: it sees more to the sides",
        low=0.1,
        high=6.28,
    )
    sweep_s: float = setting(
        0.075,
        "s",
        "time from a lidar scan's first beam to its last; larger: motion bends scans more; 0: all at once",
        low=0.0,
        high=1.0,
    )
    range_min: float = setting(
        0.05,
        "m",
        "smallest range of a lidar beam, below which it reads -inf; larger: more near things are not measured",
        low=0.0,
        high=1.0,
    )
    range_max: float = setting(
        25.0,
        "m",
        "largest range of a lidar beam, above which it reads +inf; larger: farther things are measured",
        low=1.0,
        high=200.0,
    )
    sigma: float = setting(
        0.01, "m", "noise of a short lidar range (one sigma); larger: rougher scans", low=0.0, high=0.2
    )
    faults: bool = setting(
        True, "", "true: lidar beams drop out, read mixed pixels on edges and get noisier with the range"
    )
    legs: bool = setting(False, "", "true: the rider's legs and the leg rests hide lidar beams")

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.sweep_s * self.rate_hz > 1.0 + 1e-9:
            raise ConfigError(
                f"sweep_s = {self.sweep_s:g} is impossible: at {self.rate_hz:g} Hz a sweep has {1.0 / self.rate_hz:g} s"
            )


class LidarOptics(NamedTuple):
    """Largest ranges [m] of any and of a dark surface, and the least cosine of incidence at which glass is seen."""

    reach: float
    dark_reach: float
    straight: float


class Lidar:
    """The lidar with the sweep in progress and its own random stream; every scan uses equally many random numbers."""

    def __init__(self, settings: LidarSettings, body: ChairBody, rng: np.random.Generator) -> None:
        self._settings = settings
        self._mount = body.base_from_laser.array()
        self._rng = rng
        self._period_ns = round(1e9 / settings.rate_hz) if settings.rate_hz else None
        self._sweep_ns = round(1e9 * settings.sweep_s)
        half = settings.field_of_view / 2
        self._angles = np.linspace(-half, half, settings.beams)
        self._delays = np.linspace(0.0, settings.sweep_s, settings.beams)
        self._legs = _ranges_to_rider(body, self._angles) if settings.legs else np.full(settings.beams, math.inf)
        self._optics = LidarOptics(settings.range_max, DARK_RANGE, math.cos(GLASS_ANGLE))
        self._times_ns: list[int] = []
        self._poses: list[tuple[float, float, float]] = []
        self._leaning: list[TiltedPose] = []
        self._mount_in_space = row_from_pose(in_space(body.base_from_laser, body.laser_z))
        self._people = NO_CIRCLES

    def step(
        self,
        scenery: Scenery,
        map_from_base: Pose2,
        people: Sequence[Mover],
        now_ns: int,
        leaning: TiltedPose | None = None,
    ) -> Scan | None:
        """Return the scan whose last beam left in this step, if any; to be called at every step of the chair.

        A sweep begins at every whole period; `people` are those of this moment. With `leaning` beams are cast in 3D.
        """
        scan = None
        if self._times_ns:
            self._record_pose(map_from_base, leaning, now_ns)
            scan = self._finished(scenery, people, now_ns)
        if self._period_ns is not None and now_ns % self._period_ns == 0:
            self._people = legs(people)
            self._record_pose(map_from_base, leaning, now_ns)
            # A sweep of no duration ends as it begins.
            scan = self._finished(scenery, people, now_ns) or scan
        return scan

    def scan(
        self,
        scenery: Scenery,
        times_ns: IntArray,
        poses: FloatArray,
        stamp_ns: int,
        circles_begin: FloatArray = NO_CIRCLES,
        circles_end: FloatArray = NO_CIRCLES,
    ) -> Scan:
        """Return the scan whose first beam leaves at `stamp_ns`, from a chair with poses (M, 3) in map at times_ns (M,).

        Poses are interpolated between the times and held beyond them. Circles (K, 3) move from their position at the
        first beam to that at the last. Ranges by REP-117: +inf nothing seen, -inf too close, nan dropped out.
        """
        seconds = ((np.asarray(times_ns, np.int64) - stamp_ns) * 1e-9).astype(np.float64)
        ranges = cast_sweep(
            scenery=scenery,
            circles_begin=np.ascontiguousarray(circles_begin, np.float64),
            circles_end=np.ascontiguousarray(circles_end, np.float64),
            times=seconds,
            poses=np.ascontiguousarray(poses, np.float64),
            mount=self._mount,
            angles=self._angles,
            delays=self._delays,
            optics=self._optics,
        )
        return self._scan_of(ranges, stamp_ns)

    def scan_in_space(
        self,
        terrain: Terrain,
        times_ns: IntArray,
        poses: FloatArray,
        stamp_ns: int,
        circles_begin: FloatArray = NO_CIRCLES,
        circles_end: FloatArray = NO_CIRCLES,
    ) -> Scan:
        """Return `scan` for a tilting chair: poses (M, 12) are rows of `row_from_pose` at times_ns (M,)."""
        ranges = cast_tilted(
            terrain=terrain,
            circles_begin=np.ascontiguousarray(circles_begin, np.float64),
            circles_end=np.ascontiguousarray(circles_end, np.float64),
            times=((np.asarray(times_ns, np.int64) - stamp_ns) * 1e-9).astype(np.float64),
            poses=np.ascontiguousarray(poses, np.float64),
            mount=self._mount_in_space,
            angles=self._angles,
            delays=self._delays,
            optics=self._optics,
            most_mirrors=MOST_MIRRORS,
        )
        return self._scan_of(ranges, stamp_ns)

    def _scan_of(self, ranges: FloatArray, stamp_ns: int) -> Scan:
        """Return the scan of true ranges (N,): cut by the rider's legs, then with the instrument's faults."""
        s = self._settings
        np.minimum(ranges, self._legs, out=ranges)
        return Scan(
            stamp_ns=stamp_ns,
            ranges=self._with_faults(ranges).astype(np.float32),
            angle_min=-s.field_of_view / 2,
            angle_step=s.field_of_view / (s.beams - 1),
            time_step=s.sweep_s / (s.beams - 1),
            range_min=s.range_min,
            range_max=s.range_max,
        )

    def scan_at_rest(
        self, scenery: Scenery, map_from_base: Pose2, stamp_ns: int, circles: FloatArray = NO_CIRCLES
    ) -> Scan:
        """Return the scan of a chair at rest among circles (K, 3) at rest."""
        return self.scan(
            scenery=scenery,
            times_ns=np.array([stamp_ns]),
            poses=map_from_base.array()[None],
            stamp_ns=stamp_ns,
            circles_begin=circles,
            circles_end=circles,
        )

    def _record_pose(self, pose: Pose2, leaning: TiltedPose | None, now_ns: int) -> None:
        self._times_ns.append(now_ns)
        self._poses.append((pose.x, pose.y, pose.theta))
        if leaning is not None:
            self._leaning.append(leaning)

    def _finished(self, scenery: Scenery, people: Sequence[Mover], now_ns: int) -> Scan | None:
        begun_ns = self._times_ns[0]
        if now_ns < begun_ns + self._sweep_ns:
            return None
        times_ns, people_then, people_now = np.array(self._times_ns), self._people, legs(people)
        if len(self._leaning) == len(times_ns):
            poses = np.array([row_from_pose(leaning.map_from_base) for leaning in self._leaning])
            terrain = self._leaning[-1].terrain
            scan = self.scan_in_space(
                terrain=terrain,
                times_ns=times_ns,
                poses=poses,
                stamp_ns=begun_ns,
                circles_begin=people_then,
                circles_end=people_now,
            )
        else:
            scan = self.scan(
                scenery=scenery,
                times_ns=times_ns,
                poses=np.array(self._poses),
                stamp_ns=begun_ns,
                circles_begin=people_then,
                circles_end=people_now,
            )
        self._times_ns, self._poses, self._leaning = [], [], []
        return scan

    def _with_faults(self, ranges: FloatArray) -> FloatArray:
        """Return true ranges (N,) with noise, mixed pixels, range limits and drop-outs."""
        s = self._settings
        per_metre, drop_out, mixed_part = (SIGMA_PER_METRE, DROP_OUT, MIXED) if s.faults else (0.0, 0.0, 0.0)
        normal = self._rng.standard_normal(s.beams)
        dropped, mixed, blend = self._rng.random((3, s.beams))
        # A beam on an edge lights both sides and reads a range between them (mixed pixels: Hebert and Krotkov 1992).
        with np.errstate(invalid="ignore"):
            step = np.append(ranges[1:] - ranges[:-1], 0.0)
            on_edge = np.isfinite(step) & (np.abs(step) > EDGE) & (mixed < mixed_part)
        read = np.where(on_edge, ranges + blend * np.where(on_edge, step, 0.0), ranges)
        finite = np.isfinite(read)
        read[finite] += (s.sigma + per_metre * read[finite]) * normal[finite]
        read[read > s.range_max] = math.inf
        read[read < s.range_min] = -math.inf
        read[dropped < drop_out] = math.nan
        return read


def _ranges_to_rider(body: ChairBody, angles: FloatArray) -> FloatArray:
    """Return ranges (N,) [m] of the beams to the rider's legs and the leg rests; +inf for beams that miss them."""
    circles, mount = rider_legs(body), body.base_from_laser
    ranges = [
        nearest_circle(
            begin=circles,
            end=circles,
            part=0.0,
            x=mount.x,
            y=mount.y,
            dx=math.cos(mount.theta + angle),
            dy=math.sin(mount.theta + angle),
            after=0.0,
        )
        for angle in angles
    ]
    return np.array(ranges)


@njit(cache=True, nogil=True)
def cast_sweep(
    scenery: Scenery,
    circles_begin: FloatArray,
    circles_end: FloatArray,
    times: FloatArray,
    poses: FloatArray,
    mount: FloatArray,
    angles: FloatArray,
    delays: FloatArray,
    optics: LidarOptics,
) -> FloatArray:
    """Return true ranges (N,) [m] of beams at `angles` [rad], each leaving `delays` [s] after the scan's stamp.

    The chair has `poses` (M, 3) at ascending `times` (M,) [s]; `mount` (3,) is base_from_laser.
    """
    ranges = np.empty(angles.shape[0])
    last = times.shape[0] - 1
    sweep = delays[-1]
    k = 0
    for i in range(angles.shape[0]):
        while k < last - 1 and times[k + 1] < delays[i]:
            k += 1
        nxt = min(k + 1, last)
        span = times[nxt] - times[k]
        part = min(max((delays[i] - times[k]) / span, 0.0), 1.0) if span > 0.0 else 0.0
        turn = poses[nxt, 2] - poses[k, 2]
        turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
        theta = poses[k, 2] + part * turn
        c, s = math.cos(theta), math.sin(theta)
        x = poses[k, 0] + part * (poses[nxt, 0] - poses[k, 0]) + c * mount[0] - s * mount[1]
        y = poses[k, 1] + part * (poses[nxt, 1] - poses[k, 1]) + s * mount[0] + c * mount[1]
        moved = delays[i] / sweep if sweep > 0.0 else 0.0
        beam = theta + mount[2] + angles[i]
        ranges[i] = _trace(
            scenery=scenery,
            begin=circles_begin,
            end=circles_end,
            moved=moved,
            x=x,
            y=y,
            dx=math.cos(beam),
            dy=math.sin(beam),
            optics=optics,
        )
    return ranges


@njit(cache=True, nogil=True)
def _trace(
    scenery: Scenery,
    begin: FloatArray,
    end: FloatArray,
    moved: float,
    x: float,
    y: float,
    dx: float,
    dy: float,
    optics: LidarOptics,
) -> float:
    """Return the length of a beam, through glass and over mirrors, up to the surface that returns it; +inf if none does.

    A diffuse surface returns light in proportion to the cosine of incidence and the inverse square of the range
    (Lambert), so the largest range of a dark surface is proportional to the root of that cosine. Glass returns a beam
    only near normal incidence (Foster et al., VisAGGE, ICRA 2013).
    """
    way, after, mirrors = 0.0, 0.0, 0
    for _ in range(_MOST_SURFACES):
        circle = nearest_circle(begin=begin, end=end, part=moved, x=x, y=y, dx=dx, dy=dy, after=after)
        distance, hit = nearest_segment(
            scenery=scenery, x=x, y=y, dx=dx, dy=dy, after=after, limit=min(optics.reach - way, circle)
        )
        if hit < 0:
            return way + circle if way + circle <= optics.reach else math.inf
        way += distance
        segment, kind = scenery.segments[hit], scenery.reflections[hit]
        cosine = cosine_of_incidence(segment, dx, dy)
        if kind == _DARK and way > optics.dark_reach * math.sqrt(cosine):
            return math.inf
        if kind != _MIRROR and (kind != _GLASS or cosine >= optics.straight):
            return way
        x, y, after = x + distance * dx, y + distance * dy, _ONWARD
        if kind == _MIRROR:
            mirrors += 1
            if mirrors > MOST_MIRRORS:
                return math.inf
            ex, ey = segment[2] - segment[0], segment[3] - segment[1]
            twice = 2.0 * (dx * ex + dy * ey) / (ex * ex + ey * ey)
            dx, dy = twice * ex - dx, twice * ey - dy
    return math.inf
