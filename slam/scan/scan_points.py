"""Scans as points with surface normals, and the growing store of the mapper's key scans."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.calibration.fits.self_mask import SelfMask
from waychair.geometry import arc, arcs
from waychair.types import BoolArray, Float32Array, FloatArray, IntArray, Pose2, Scan, Twist

MIN_POINTS = 20
"""A scan with fewer usable points cannot be matched."""

_LINE_BEAMS = 3  # beams on either side of a point through which its line goes at least
_LINE_NOISES = 5.0  # times the noise of the ranges; least length of a line on either side of its point
_LEAST_SPREAD = 1.5  # times the noise; least standard deviation of the points along their line
# Noise lies along the beams. Seven beams of a dense lidar span a few millimetres of a near surface: a line through them
# shows the noise, its normal points along the surface, and such points hold the chair back.
_NOISE_LIMITS = (0.004, 0.04)  # m; noise of usual lidars
_NEAR_SPACING = 0.05  # m between two beams; farther, the shape of the surfaces hides the noise
_LEAST_TRIPLES = 20  # three neighbouring beams, from which the noise is estimated
_NO_MOTION = np.empty((0, 3))  # no motion during a scan


@dataclass(frozen=True, slots=True)
class ScanPoints:
    """Points (N, 2) [m] in the base frame, and unit normals (N, 2) towards the sensor; (0, 0) where the neighbouring beams
    show no straight surface."""

    points: FloatArray
    normals: FloatArray

    def __len__(self) -> int:
        return len(self.points)

    def thinned(self, most: int) -> ScanPoints:
        """Return every n-th point, so that at most `most` remain."""
        step = -(-len(self.points) // most)
        return self if step <= 1 else ScanPoints(self.points[::step].copy(), self.normals[::step].copy())


def scan_points(
    scan: Scan, base_from_laser: Pose2, range_max: float, twist: Twist | None = None, mask: SelfMask | None = None
) -> ScanPoints:
    """Return points and normals of the valid beams nearer than `range_max` [m], in the base frame at the scan's stamp.

    Normals come from a line fitted to the nearest beams on both sides that lie on one surface. If `twist` is given, a
    scan with a `time_step` between beams is corrected for the chair's motion during the scan. Beams that `mask` hides
    are invalid: they end on the chair itself.
    """
    seen = scan if mask is None else mask.applied(scan)
    points, usable = beam_ends(seen, base_from_laser, range_max, twist)
    return ScanPoints(*_with_normals(points, usable, base_from_laser.x, base_from_laser.y, abs(scan.angle_step)))


def beam_ends(
    scan: Scan, base_from_laser: Pose2, range_max: float, twist: Twist | None = None
) -> tuple[FloatArray, BoolArray]:
    """Return the beams' ends (N, 2) [m] in the base frame, and which beams (N,) are valid; see `scan_points`."""
    nearest, farthest = max(scan.range_min, 0.05), min(range_max, scan.range_max if scan.range_max > 0 else range_max)
    motion = _NO_MOTION if twist is None or scan.time_step == 0.0 else motion_of_beams(scan, twist)
    return _ends(scan.ranges, scan.angle_min, scan.angle_step, base_from_laser.array(), nearest, farthest, motion)


def motion_of_beams(scan: Scan, twist: Twist) -> FloatArray:
    """Return the pose (N, 3) [m, m, rad] of the base at each beam's time, in the base at the scan's stamp, for a constant twist."""
    seconds: FloatArray = scan.time_step * np.arange(len(scan.ranges), dtype=np.float64)
    return arcs(twist.v * seconds, twist.omega * seconds)


def sweep_motion(scan: Scan, twist: Twist) -> Pose2:
    """Return the pose of the base at a scan's last beam in the base at its first beam, for a constant twist."""
    seconds = scan.time_step * (len(scan.ranges) - 1)
    return arc(twist.v * seconds, twist.omega * seconds)


@njit(cache=True)
def _ends(
    ranges: Float32Array,
    angle_min: float,
    angle_step: float,
    mount: FloatArray,
    nearest: float,
    farthest: float,
    motion: FloatArray,
) -> tuple[FloatArray, BoolArray]:
    """Return the beams' ends (N, 2) in the base frame, and whether they are usable.

    Each beam starts from its own pose of `motion`, unless that is empty.
    """
    points, usable = np.zeros((len(ranges), 2)), np.zeros(len(ranges), np.bool_)
    c, s = math.cos(mount[2]), math.sin(mount[2])
    for i in range(len(ranges)):
        reach = np.float64(ranges[i])
        if not (nearest < reach <= farthest):
            continue
        usable[i] = True
        angle = angle_min + i * angle_step
        lx, ly = reach * math.cos(angle), reach * math.sin(angle)
        x, y = mount[0] + c * lx - s * ly, mount[1] + s * lx + c * ly
        if len(motion) > 0:
            mc, ms = math.cos(motion[i, 2]), math.sin(motion[i, 2])
            x, y = motion[i, 0] + mc * x - ms * y, motion[i, 1] + ms * x + mc * y
        points[i, 0], points[i, 1] = x, y
    return points, usable


@njit(cache=True)
def _with_normals(
    points: FloatArray, usable: BoolArray, laser_x: float, laser_y: float, angle_step: float
) -> tuple[FloatArray, FloatArray]:
    """Return the usable points and their normals towards the laser.

    A normal belongs to a total-least-squares line through `_LINE_BEAMS` beams on either side, or through more where they
    lie so close together that the line would be short beside the noise of the ranges.
    """
    count, kept = len(points), 0
    noise = _noise(points, usable, laser_x, laser_y, angle_step)
    ends = np.empty((np.count_nonzero(usable), 2))
    normals = np.zeros(ends.shape)
    for i in range(count):
        if not usable[i]:
            continue
        k, kept = kept, kept + 1
        ends[k, 0], ends[k, 1] = points[i, 0], points[i, 1]
        x, y = points[i, 0] - laser_x, points[i, 1] - laser_y
        reach = max(0.05, 4.0 * noise) + 4.0 * angle_step * math.hypot(x, y)
        nx, ny, short = _normal(points, usable, i, reach, 0.0, noise)
        if short:
            nx, ny, _ = _normal(points, usable, i, reach, _LINE_NOISES * noise, noise)
        if nx * x + ny * y > 0:
            nx, ny = -nx, -ny
        normals[k, 0], normals[k, 1] = nx, ny
    return ends, normals


@njit(cache=True)
def _normal(
    points: FloatArray, usable: BoolArray, i: int, reach: float, longest: float, noise: float
) -> tuple[float, float, bool]:
    """Return the normal of the line round point i, (0, 0) without one, and whether the line is too short for its noise.

    The line goes through `_LINE_BEAMS` beams on either side, and through further ones within `longest` [m]. It ends where
    two of them are farther apart than `reach` [m].
    """
    n, mx, my, xx, xy, yy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for side in (-1, 1):
        last = i
        for step in range(0 if side == -1 else 1, len(points)):
            j = i + side * step
            if j < 0 or j >= len(points) or not usable[j]:
                break
            if math.hypot(points[j, 0] - points[last, 0], points[j, 1] - points[last, 1]) > reach:
                break
            dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
            if step > _LINE_BEAMS and math.hypot(dx, dy) > longest:
                break
            n, mx, my = n + 1, mx + dx, my + dy
            xx, xy, yy = xx + dx * dx, xy + dx * dy, yy + dy * dy
            last = j
    if n < 3:
        return 0.0, 0.0, False
    xx, xy, yy = xx / n - mx * mx / n**2, xy / n - mx * my / n**2, yy / n - my * my / n**2
    spread = math.sqrt((xx - yy) ** 2 + 4 * xy * xy)
    thin, wide = 0.5 * (xx + yy - spread), 0.5 * (xx + yy + spread)
    if wide <= (_LEAST_SPREAD * noise) ** 2:
        return 0.0, 0.0, True
    if thin > 0.15 * wide or thin > max(0.05, 2.0 * noise) ** 2:
        return 0.0, 0.0, False
    angle = 0.5 * math.atan2(2 * xy, xx - yy)
    return -math.sin(angle), math.cos(angle), False


@njit(cache=True)
def _noise(points: FloatArray, usable: BoolArray, laser_x: float, laser_y: float, angle_step: float) -> float:
    """Return the standard deviation [m] of a scan's ranges, from their second differences, within `_NOISE_LIMITS`."""
    bends, count = np.empty(len(points)), 0
    for i in range(1, len(points) - 1):
        if not (usable[i - 1] and usable[i] and usable[i + 1]):
            continue
        here = math.hypot(points[i, 0] - laser_x, points[i, 1] - laser_y)
        if here * angle_step > _NEAR_SPACING:
            continue
        before = math.hypot(points[i - 1, 0] - laser_x, points[i - 1, 1] - laser_y)
        after = math.hypot(points[i + 1, 0] - laser_x, points[i + 1, 1] - laser_y)
        bends[count] = abs(before - 2.0 * here + after)
        count += 1
    if count < _LEAST_TRIPLES:
        return _NOISE_LIMITS[0]
    noise = np.median(bends[:count]) / (0.6745 * math.sqrt(6.0))
    return min(max(noise, _NOISE_LIMITS[0]), _NOISE_LIMITS[1])


class ScanStore:
    """Points and normals of all key scans in two growing arrays; scan k owns rows `offsets[k]:offsets[k + 1]`.

    They are kept in single precision, a micrometre at 20 m: half the memory of a large map.
    """

    def __init__(self) -> None:
        self._points = np.zeros((1024, 2), np.float32)  # spare rows are saved, too: a file holds no old memory
        self._normals = np.zeros((1024, 2), np.float32)
        self._offsets = np.zeros(64, np.int64)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def append(self, scan: ScanPoints) -> int:
        """Add a scan; return its index."""
        start = self._offsets[self._count]
        end = start + len(scan)
        if end > len(self._points):
            rows = max(int(end), len(self._points) * 5 // 4)
            self._points, self._normals = (_with_rows(own, rows) for own in (self._points, self._normals))
        if self._count + 2 > len(self._offsets):
            self._offsets = np.concatenate([self._offsets, np.zeros_like(self._offsets)])
        self._points[start:end], self._normals[start:end] = scan.points, scan.normals
        self._count += 1
        self._offsets[self._count] = end
        return self._count - 1

    def __getitem__(self, index: int) -> ScanPoints:
        rows = slice(self._offsets[index], self._offsets[index + 1])
        return ScanPoints(self._points[rows].astype(np.float64), self._normals[rows].astype(np.float64))

    @property
    def arrays(self) -> tuple[Float32Array, Float32Array, IntArray]:
        """Points, normals and offsets, for the kernels."""
        return self._points, self._normals, self._offsets


def _with_rows(values: Float32Array, rows: int) -> Float32Array:
    """Return a copy with more rows, the further ones zero."""
    longer = np.zeros((rows, values.shape[1]), np.float32)
    longer[: len(values)] = values
    return longer
