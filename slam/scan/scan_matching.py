"""Scan matching: a branch and bound correlative search, refined by point-to-line least squares.

The search (Olson 2009; Hess et al. 2016) has no local minima: it returns the best pose of its window, to one cell and one
angle step. The refinement then minimises the point-to-line distances together with the distance to the odometry's guess.
Along a bare corridor, where the scan gives no information, the odometry decides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from waychair.angles import wrapped
from waychair.config import Settings, setting
from waychair.geometry import pose_from_array, wrap_angles
from waychair.slam.scan.match_certainty import (
    UNKNOWN_VARIANCE,
    calibrated_covariance,
    weakest_direction,
    without_weak_direction,
)
from waychair.slam.scan.reference_surfaces import LEVELS, ScanReference, Slots
from waychair.slam.scan.scan_points import ScanPoints
from waychair.slam.scan.small_systems import solved
from waychair.types import Bytes, FloatArray, IntArray, Pose2

WIDE, NARROW = 0.3, 0.1
"""First and last width [m] of the refinement's kernel."""

BEAM_SIGMA = 0.06
"""Spread [m] of a beam's end about the surface."""

ENDLESS = 1 << 60
"""More points than any search looks up."""

DISTANCE_PENALTY, ANGLE_PENALTY = 0.15, 0.10
"""Score lost per metre [1/m] and per radian [1/rad] away from the guess."""

_INLIER_DISTANCE = 0.15  # m; a point nearer to a surface supports the match
_SPACING = 0.02  # m/m; largest space between beams of usual lidars
_LIKELY = 3.0  # standard deviations of the guess
_MAX_ITERATIONS = 20  # least-squares steps
_MIN_COMPLEXITY = 0.003  # below this share of surfaces that face the weak direction, the guess decides there


@dataclass(frozen=True, slots=True)
class MatchSettings(Settings):
    """How a scan is matched with a reference."""

    resolution: float = setting(
        0.05, "m", "cell side of scan matching; larger: it is faster and less accurate", low=0.01, high=0.5
    )
    range_max: float = setting(
        20.0, "m", "longest lidar range that is matched; larger: more beams count, with a lidar's errors at long range",
        low=1.0, high=200.0,
    )  # fmt: skip
    point_noise: float = setting(
        0.03, "m", "standard deviation of a lidar point about its surface; larger: the odometry has more weight",
        low=0.001, high=1.0,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Window:
    """Half sizes of the search window: distance [m] in x and y, angle [rad]."""

    distance: float
    angle: float


@dataclass(frozen=True, slots=True)
class Match:
    """The best fit of a scan.

    - `response` in [0, 1]: mean likelihood of the beams' ends.
    - `inliers` in [0, 1]: share of the points on a surface; `rms` [m]: their distance to it.
    - `information` (3, 3) of x, y [1/m^2], theta [1/rad^2] in the map frame, from the scan alone.
    - `covariance` (3, 3) [m^2, m rad, rad^2]: realistic errors (see `calibrated_covariance`).
    - `complexity` in [0, 0.5]: share of the matched surfaces that face the weakest direction, 0 between parallel walls.
    - `degenerate`: the complexity is so low, or the refinement has slid along it so far, that the pose there is the guess's.
    """

    pose: Pose2
    response: float
    inliers: float
    rms: float
    information: FloatArray
    covariance: FloatArray = field(
        default_factory=lambda: np.diag([UNKNOWN_VARIANCE, UNKNOWN_VARIANCE, UNKNOWN_VARIANCE])
    )
    complexity: float = 0.0
    degenerate: bool = True


def match(
    scan: ScanPoints,
    reference: ScanReference,
    guess: Pose2,
    guess_information: FloatArray,
    window: Window,
    settings: MatchSettings,
) -> Match:
    """Return the pose in the map at which the scan fits the reference best, near a guess with information (3, 3).

    For a scan without points, response and inliers are 0 and the pose is the guess.
    """
    if len(scan) == 0:
        return Match(guess, 0.0, 0.0, math.inf, np.zeros((3, 3)))
    coarse, response = correlative_search(scan.points, reference, guess, window)
    pose, information, inliers, rms = refine(
        scan, reference, start=coarse, guess=guess, guess_information=guess_information, settings=settings
    )
    complexity, strong = weakest_direction(information)
    degenerate = complexity < _MIN_COMPLEXITY or _has_slid(pose, coarse, guess, guess_information)
    if degenerate:
        pose, information = without_weak_direction(pose, information, guess, strong)
    covariance = calibrated_covariance(information)
    return Match(
        pose=pose,
        response=response,
        inliers=inliers,
        rms=rms,
        information=information,
        covariance=covariance,
        complexity=complexity,
        degenerate=degenerate,
    )


def _has_slid(pose: Pose2, coarse: Pose2, guess: Pose2, guess_information: FloatArray) -> bool:
    """Return whether a refinement has ended where neither the search nor the guess, with information (3, 3), has the pose."""
    away = np.array([pose.x - guess.x, pose.y - guess.y, wrapped(pose.theta - guess.theta)])
    unlikely = float(away @ guess_information @ away) > _LIKELY**2
    return unlikely and math.hypot(pose.x - coarse.x, pose.y - coarse.y) > WIDE


def correlative_search(
    points: FloatArray,
    reference: ScanReference,
    guess: Pose2,
    window: Window,
    *,
    floor: float = 0.0,
    excluded: Pose2 | None = None,
    penalised: bool = True,
) -> tuple[Pose2, float]:
    """Return the best pose of the window and its response; the guess and 0 when no pose scores above `floor`, or without points.

    With `excluded`, poses within 0.5 m and 15 degrees of it do not count: the result is the runner-up, whose response tells
    how ambiguous the winner is. Unless `penalised` is False, poses lose score with their distance from the guess.
    """
    search = begin_search(points, guess, window, reference.resolution, floor, excluded, penalised)
    search.go_on(reference, ENDLESS)
    return search.best


@dataclass(slots=True)
class WindowSearch:
    """A correlative search that is done in pieces; arrays only, so that it can be stored in between.

    `best` is the best pose so far and its response, and the final one when `go_on` has returned True.
    """

    points: FloatArray
    guess: FloatArray
    cells: int
    angle_count: int
    angle_step: float
    penalties: tuple[float, float]
    excluded: FloatArray
    found: FloatArray
    """x, y, theta of the best pose, its score, which begins as the floor, and its response."""
    progress: IntArray
    """Blocks of the top level that are rated, then those that are searched."""
    bound: FloatArray
    order: IntArray

    def go_on(self, reference: ScanReference, most: int) -> bool:
        """Look up at least `most` points in the reference, or all that are left to look up; return whether the search is done.

        The reference must be that of the calls before, and of the resolution that the search was begun with.
        """
        if not len(self.points):
            return True
        done: bool = _search(
            self.points, reference.bounds, reference.origin, reference.resolution, self.guess, self.cells,
            self.angle_count, self.angle_step, *self.penalties, self.excluded, self.bound, self.order, self.progress,
            self.found, most,
        )  # fmt: skip
        return done

    @property
    def best(self) -> tuple[Pose2, float]:
        """The best pose so far and its response; the guess and 0 without one."""
        return pose_from_array(self.found[:3]), float(self.found[4])


def begin_search(
    points: FloatArray,
    guess: Pose2,
    window: Window,
    resolution: float,
    floor: float = 0.0,
    excluded: Pose2 | None = None,
    penalised: bool = True,
) -> WindowSearch:
    """Return a search on a reference of this resolution [m] that has done nothing yet; arguments as of `correlative_search`."""
    far = 1.0
    if len(points):
        radii = np.hypot(points[:, 0], points[:, 1])
        fifth = len(radii) - 1 - len(radii) // 5
        far = max(1.0, float(np.partition(radii, fifth)[fifth]))  # four fifths of the beams end nearer
    angle_step = math.acos(1 - resolution**2 / (2 * far**2))
    angle_count = max(1, math.ceil(window.angle / angle_step))
    cells = max(1, math.ceil(window.distance / resolution))
    blocks = (2 * angle_count + 1) * (2 * cells // 2 ** _top_level(cells) + 1) ** 2
    return WindowSearch(
        points=points,
        guess=guess.array(),
        cells=cells,
        angle_count=angle_count,
        angle_step=angle_step,
        penalties=(DISTANCE_PENALTY, ANGLE_PENALTY) if penalised else (0.0, 0.0),
        excluded=np.full(3, np.nan) if excluded is None else excluded.array(),
        found=np.array([guess.x, guess.y, guess.theta, floor, 0.0]),
        progress=np.zeros(2, np.int64),
        bound=np.empty(blocks),
        order=np.empty(blocks, np.int64),
    )


def refine(
    scan: ScanPoints,
    reference: ScanReference,
    start: Pose2,
    guess: Pose2,
    guess_information: FloatArray,
    settings: MatchSettings,
    *,
    reach: float = WIDE,
) -> tuple[Pose2, FloatArray, float, float]:
    """Minimise the point-to-line distances plus the distance to the guess, from `start`.

    `reach` [m] is the kernel's first width, the largest distance of surfaces at the start; a small one is faster.
    Return the pose, the information (3, 3) of the scan alone, the share of inliers and their rms distance [m].
    """
    pose, information, inliers, rms = _refine(
        scan.points, scan.normals, reference.surfaces, reference.slots, reference.origin, reference.resolution,
        start.array(), guess.array(), guess_information, settings.point_noise, _INLIER_DISTANCE,
        _MAX_ITERATIONS, reach,
    )  # fmt: skip
    pose[2] = wrap_angles(pose[2:])[0]
    return pose_from_array(pose), information, inliers, rms


@njit(cache=True)
def _score(level: Bytes, rows: np.ndarray, cols: np.ndarray, row: int, col: int, least: float) -> int:
    """Return the sum of the level's values at the points, shifted by (row, col) cells; 0 outside the grid.

    A sum that can no longer exceed `least` is not completed; the returned part of it is not above `least` either.
    """
    height, width = level.shape
    total, count = 0, len(rows)
    for i in range(count):
        if i % 32 == 0 and total + 255 * (count - i) <= least:
            return total
        r, c = rows[i] + row, cols[i] + col
        if 0 <= r < height and 0 <= c < width:
            total += level[r, c]
    return total


@njit(cache=True)
def _top_level(cells: int) -> int:
    """Return the level of the bounds whose blocks a window of so many cells on each side begins with."""
    top = 0
    while top < LEVELS - 1 and 2 ** (top + 1) <= cells:
        top += 1
    return top


@njit(cache=True)
def _search(
    points: FloatArray,
    bounds: Bytes,
    origin: FloatArray,
    resolution: float,
    guess: FloatArray,
    cells: int,
    angle_count: int,
    angle_step: float,
    distance_penalty: float,
    angle_penalty: float,
    excluded: FloatArray,
    bound: FloatArray,
    order: IntArray,
    progress: IntArray,
    found: FloatArray,
    most: int,
) -> bool:
    """Go on with a depth-first search by branch and bound over (angle, row, col) until so many points are looked up, or all
    is searched; return whether it is done. See `WindowSearch` for the arrays."""
    full = 255.0 * len(points)
    top = _top_level(cells)
    block = 2**top
    blocks = 2 * cells // block + 1
    each, spent = len(points), 0
    rows, cols, turned = np.empty(each, np.int32), np.empty(each, np.int32), -1
    while progress[0] < len(bound):
        entry = progress[0]
        if spent >= most:
            return False
        a = entry // (blocks * blocks)
        if a != turned:
            _turn(points, origin, resolution, guess, (a - angle_count) * angle_step, rows, cols)
            turned = a
        loss = angle_penalty * abs(a - angle_count) * angle_step
        row, col = (entry // blocks) % blocks * block - cells, entry % blocks * block - cells
        bound[entry] = _score(bounds[top], rows, cols, row, col, (found[3] + loss) * full) / full - loss
        spent += each
        progress[0] += 1
        if progress[0] == len(bound):
            order[:] = np.argsort(-bound)
    stack = np.empty((4 * LEVELS + 8, 3), np.int64)
    while progress[1] < len(order):
        entry = order[progress[1]]
        if bound[entry] <= found[3]:
            break
        if spent >= most:
            return False
        progress[1] += 1
        a = entry // (blocks * blocks)
        turn = (a - angle_count) * angle_step
        if a != turned:
            _turn(points, origin, resolution, guess, turn, rows, cols)
            turned = a
        near_angle = abs(wrapped(guess[2] + turn - excluded[2])) < 0.26
        loss = angle_penalty * abs(turn)
        depth = 1
        stack[0] = (top, (entry // blocks) % blocks * block - cells, entry % blocks * block - cells)
        while depth > 0:
            depth -= 1
            h, row, col = stack[depth]
            if row > cells or col > cells:  # the last block may reach beyond the window
                continue
            raw = _score(bounds[h], rows, cols, row, col, (found[3] + loss) * full) / full
            spent += each
            if raw - loss <= found[3]:
                continue
            if h > 0:
                half = 2 ** (h - 1)
                for dr in (half, 0):
                    for dc in (half, 0):
                        stack[depth] = (h - 1, row + dr, col + dc)
                        depth += 1
                continue
            x, y = guess[0] + col * resolution, guess[1] + row * resolution
            if near_angle and math.hypot(x - excluded[0], y - excluded[1]) < 0.5:
                continue
            value = raw - loss - distance_penalty * math.hypot(row, col) * resolution
            if value > found[3]:
                found[0], found[1], found[2], found[3], found[4] = x, y, guess[2] + turn, value, raw
    return True


@njit(cache=True)
def _turn(
    points: FloatArray, origin: FloatArray, resolution: float, guess: FloatArray, turn: float, rows: Slots, cols: Slots
) -> None:
    """Write the cells (N,) of the points at the guess, turned further."""
    c, s = math.cos(guess[2] + turn), math.sin(guess[2] + turn)
    for i in range(len(points)):
        x = guess[0] + c * points[i, 0] - s * points[i, 1] - origin[0]
        y = guess[1] + s * points[i, 0] + c * points[i, 1] - origin[1]
        rows[i] = math.floor(y / resolution)
        cols[i] = math.floor(x / resolution)


@njit(cache=True)
def nearest_surface(
    surfaces: FloatArray,
    slots: Slots,
    resolution: float,
    row: int,
    col: int,
    reach: int,
    x: float,
    y: float,
    nx: float,
    ny: float,
) -> int:
    """Return the slot of the nearest surface (by its mean point) with a similar normal, within `reach` cells; 0 for none.

    The search goes ring by ring round the cell: a surface's mean point lies in its cell, so surfaces of ring n are at
    least n - 1 cells away.
    """
    best, found = 1e18, 0
    height, width = slots.shape[0], slots.shape[1]
    for ring in range(reach + 1):
        if found > 0 and ((ring - 1) * resolution) ** 2 >= best:
            break
        for r in range(max(0, row - ring), min(height - 1, row + ring) + 1):
            step = 1 if abs(r - row) == ring else 2 * ring  # the whole side, or its two ends
            for c in range(col - ring, col + ring + 1, step):
                if not 0 <= c < width:
                    continue
                for side in range(2):
                    slot = slots[r, c, side]
                    if slot == 0 or surfaces[slot, 2] * nx + surfaces[slot, 3] * ny < 0.7:
                        continue
                    distance = (surfaces[slot, 0] - x) ** 2 + (surfaces[slot, 1] - y) ** 2
                    if distance < best:
                        best, found = distance, slot
    return found


@njit(cache=True)
def _refine(
    points: FloatArray,
    normals: FloatArray,
    surfaces: FloatArray,
    slots: Slots,
    origin: FloatArray,
    resolution: float,
    start: FloatArray,
    guess: FloatArray,
    guess_information: FloatArray,
    noise: float,
    inlier_distance: float,
    max_iterations: int,
    widest: float,
) -> tuple[FloatArray, FloatArray, float, float]:
    """Run Gauss-Newton with a Geman-McClure kernel whose width shrinks with the iterations; see `refine`."""
    pose = start.copy()
    information = np.zeros((3, 3))
    step = np.ones(3)
    usable, close, square = 0, 0, 0.0
    spread = math.hypot(0.5 * (guess_information[0, 0] - guess_information[1, 1]), guess_information[0, 1])
    least = 0.5 * (guess_information[0, 0] + guess_information[1, 1]) - spread
    slack = 0.5 * (resolution + 1.0 / math.sqrt(max(least, 1.0)))
    for iteration in range(max_iterations):
        kernel = max(NARROW, widest * 0.7**iteration)
        reach = math.ceil(max(0.15, 2.0 * kernel / (1 + iteration)) / resolution)
        c, s = math.cos(pose[2]), math.sin(pose[2])
        information[:] = 0.0
        gradient = np.zeros(3)
        usable, close, square = 0, 0, 0.0
        for i in range(len(points)):
            if normals[i, 0] == 0.0 and normals[i, 1] == 0.0:
                continue
            usable += 1
            rx, ry = c * points[i, 0] - s * points[i, 1], s * points[i, 0] + c * points[i, 1]
            x, y = pose[0] + rx, pose[1] + ry
            nx, ny = c * normals[i, 0] - s * normals[i, 1], s * normals[i, 0] + c * normals[i, 1]
            row, col = math.floor((y - origin[1]) / resolution), math.floor((x - origin[0]) / resolution)
            slot = nearest_surface(surfaces, slots, resolution, row, col, reach, x, y, nx, ny)
            if slot == 0:
                continue
            mx, my = surfaces[slot, 2], surfaces[slot, 3]
            dx, dy = x - surfaces[slot, 0], y - surfaces[slot, 1]
            if abs(mx * dy - my * dx) > slack + _SPACING * math.hypot(points[i, 0], points[i, 1]):
                continue  # beyond the end of what is known, where a surface's normal would pull along it
            residual = mx * dx + my * dy
            if abs(residual) < inlier_distance:
                close += 1
                square += residual * residual
            weight = (kernel**2 / (kernel**2 + residual**2)) ** 2 / noise**2
            turn = my * rx - mx * ry
            information[0, 0] += weight * mx * mx
            information[0, 1] += weight * mx * my
            information[0, 2] += weight * mx * turn
            information[1, 1] += weight * my * my
            information[1, 2] += weight * my * turn
            information[2, 2] += weight * turn * turn
            gradient[0] += weight * mx * residual
            gradient[1] += weight * my * residual
            gradient[2] += weight * turn * residual
        information[1, 0], information[2, 0] = information[0, 1], information[0, 2]
        information[2, 1] = information[1, 2]
        away = pose - guess
        away[2] = wrapped(away[2])
        pull = -(gradient + (guess_information * away).sum(axis=1))
        step[0], step[1], step[2] = solved(information + guess_information + 1e-6 * np.eye(3), pull)
        pose += step
        if kernel == NARROW and math.hypot(step[0], step[1]) < 1e-4 and abs(step[2]) < 1e-5:
            break
    return pose, information, close / max(1, usable), math.sqrt(square / max(1, close))
