"""Gaps of a doorway's width in wall lines, and their jambs measured in single views.

A gap has something on both sides and beams that go on between. The walls give its direction and its place across the
line. Each view gives the place of both jambs along it, free of the blur that the poses of many views add.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit

from waychair.planning.seen.range_views import RangeView
from waychair.planning.seen.wall_lines import WallLine, wall_lines
from waychair.types import BoolArray, Bytes, FloatArray, IntArray, Pose2

NARROWEST, WIDEST = 0.55, 1.45
"""m; gaps outside these are no doorways for a chair: nothing passes the narrower, and the wider are passages."""

FARTHEST = 5.0
"""m; beams half a degree to a degree apart are too far from each other beyond this to show a jamb."""

AHEAD, BEHIND = 0.08, 0.30
"""m; a beam that ends from this far ahead of the wall line to this far behind ends at the wall, at the reveal or at a
closed leaf in it. A beam that ends farther behind goes through."""

SKEWED = math.radians(81.0)
"""rad; beams at a larger angle to the normal cross the line at too flat an angle to tell where."""

GRAZED, SLIPPED = 0.04, 0.15
"""m; a beam at a slant that ends this far behind the line, and so far along it from where it crossed, went through an
opening and met the far jamb's reveal: no face of the wall lay in between."""

REVEAL_DOUBT = 0.03
"""m; half the doubt of a jamb that is known by its reveal, seen at a slant."""

NEAREST = 0.18
"""m; a sensor nearer to the line than this looks along it."""

BIN = 0.02
"""m; step along the line in which beams that end and beams that pass are counted."""

LINK, LINK_BEAMS = 0.3, 2
"""m, beams; two neighbouring beams that both end at the line, or both pass, speak for all between them."""

ON_FACE, EVEN = 1.5, 0.05
"""Factor, m; neighbouring ends on a wall's face lie about as far apart along the line as their beams cross it."""

SOLID = 0.3
"""Share of the views of a bin that end at the line, above which the line is solid there."""

SEEN_THROUGH = 0.45
"""Share of a gap's width through which beams must pass."""

PAST_END = 1.6
"""m; a line is looked at this far beyond its stretches: a door may stand at the end of a wall."""

LEAST_WALL = 0.4
"""m; a line with less wall seen than this gives no direction."""

JAMB_OFF = 0.25
"""m; largest error of a jamb's expected place."""

BESIDE_JAMB = 0.15
"""m; a beam that ends this near to the plane of the far jamb may have met its reveal or a leaf open there."""

SLIM = 3
"""Beams that a slim thing in the opening may take away."""

WALL_BESIDE = 1.0
"""m; the wall on this length beside each jamb counts."""

FOR_PLACE, FOR_DIRECTION = 0.5, 0.7
"""m; what stands on these lengths beside a gap gives its place across the wall and its direction: things next to the
jambs tell where the jambs are, longer walls tell the direction better."""

LOCAL_OFF, LOCAL_POINTS = (0.14, 0.08, 0.06), 8
"""m; largest distance from the line at each step of that fit, and the fewest points of each side."""

TOLERANCE = 0.1
"""m; a stretch may reach this far into the opening by noise."""

FLANK, FLANK_INSIDE, FLANK_OUTSIDE = 1.6, 0.12, 0.15
"""m; things on this length along x, this far inside and outside a jamb's edge, stand in line with it."""

QUARTER: FloatArray = np.array([0.0, 0.0, -math.pi / 2])
"""The wall's line in the frame of a gap: its y is the gap's x."""

NOTHING, STOPS, PASSES, FALLS_SHORT, SLIPS = 0, 1, 2, 3, 4
"""Kinds of beams: no word about the line, ends at it, goes through it, ends ahead of it, ends at a reveal behind it."""


@dataclass(frozen=True, slots=True)
class Gap:
    """A gap in a wall line: `pose` in the middle of its opening, x leads through it, and its width [m].

    `walls` [m] is the length of wall seen within 1 m beside the right jamb (negative y) and beside the left one.
    `between_both` tells that what stands next to both jambs gave pose and direction, and not one long wall alone.
    """

    pose: Pose2
    width: float
    walls: tuple[float, float]
    between_both: bool = False


@dataclass(frozen=True, slots=True)
class JambSight:
    """One view's measurement of a gap, in the gap's frame.

    `right` and `left` are x and y [m] of the jambs, each with half its doubt [m], +inf where the view does not show it.
    `through` counts the beams that pass the opening and `stopped` those that end in it; `depth` [m] is the median
    distance that the former go on behind the line. `seat` [m] is the sensor's place. `flanks` tells where things stand in
    line with a jamb: bit k is the k-th decimetre from the line, for the right jamb at negative and at positive x, then
    for the left jamb. `wall` is x [m] and turn [rad] of the line through what this view shows beside both jambs, None if
    it shows too little of one side.
    """

    right: tuple[float, float]
    left: tuple[float, float]
    right_doubt: float
    left_doubt: float
    through: int
    stopped: int
    depth: float
    seat: tuple[float, float]
    flanks: tuple[int, int, int, int]
    wall: tuple[float, float] | None = None


def find_gaps(views: Sequence[RangeView], stretches: FloatArray) -> Iterator[list[Gap]]:
    """Yield the gaps of doorway width in each wall line of views in one frame: one line of work a step.

    `stretches` (K, 4) [m] are the straight stretches of all the views (`wall_lines.straight_stretches`).
    """
    if views:
        beams = _beams(views)
        for line in wall_lines(stretches, LEAST_WALL):
            yield _gaps_of(line, *beams)


def measure_gap(view: RangeView, gap: Pose2, width: float) -> JambSight | None:
    """Return one view's measurement of the gap at `gap` (x leads through it) of about `width` [m]; None if not seen."""
    to_gap = gap.inverse()
    seat = to_gap @ Pose2(float(view.origin[0]), float(view.origin[1]), 0.0)
    if abs(seat.x) < NEAREST:
        return None
    pose = gap.array()
    kinds, cross, x, y = _classified(pose, view.origin, view.ends, view.met)
    jambs, doubts, through, stopped, depth = _jambs(kinds, cross, x, y, seat.x, seat.y, width)
    if through == 0 and stopped == 0:
        return None
    right, left = ((float(jamb[0]), float(jamb[1])) for jamb in jambs)
    right_doubt, left_doubt = (float(value) for value in doubts)
    flanks = _flanks(x, y, view.met, width)
    walled, off, turn = _local_line(QUARTER, np.stack([x, y], axis=1)[view.met], -width / 2, width / 2, FOR_DIRECTION)
    wall = (off, turn) if walled else None
    return JambSight(right, left, right_doubt, left_doubt, through, stopped, depth, (seat.x, seat.y), flanks, wall)


def beams_at_gap(view: RangeView, gap: Pose2, width: float) -> tuple[int, int]:
    """Return how many beams of a view go through the opening of a gap, and how many end in it."""
    seat = gap.inverse() @ Pose2(float(view.origin[0]), float(view.origin[1]), 0.0)
    if abs(seat.x) < NEAREST:
        return 0, 0
    kinds, cross, x, y = _classified(gap.array(), view.origin, view.ends, view.met)
    _, _, through, stopped, _ = _jambs(kinds, cross, x, y, seat.x, seat.y, width)
    return through, stopped


def _beams(views: Sequence[RangeView]) -> tuple[FloatArray, FloatArray, IntArray, IntArray, Bytes]:
    """Return all beams with an end: origins and ends (N, 2), the number of their view and in it (N,), and `met`."""
    used = [np.flatnonzero(np.isfinite(view.ends[:, 0])) for view in views]
    origins = np.concatenate([np.broadcast_to(view.origin, (len(k), 2)) for view, k in zip(views, used, strict=True)])
    ends = np.concatenate([view.ends[k] for view, k in zip(views, used, strict=True)])
    number = np.repeat(np.arange(len(views)), [len(k) for k in used])
    met = np.concatenate([view.met[k] for view, k in zip(views, used, strict=True)]).astype(np.uint8)
    return origins, ends, number, np.concatenate(used), met


def _gaps_of(
    line: WallLine, origins: FloatArray, ends: FloatArray, number: IntArray, beam: IntArray, met: Bytes
) -> list[Gap]:
    low, high = float(line.stretches[0, 0]) - PAST_END, float(line.stretches[-1, 1]) + PAST_END
    bins = math.ceil((high - low) / BIN)
    pose = line.pose.array()
    stops, passes = _counted(pose, origins, ends, number, beam, met, low, bins)
    solid = (stops >= 1) & (stops > SOLID * (stops + passes))
    edges = np.flatnonzero(solid[1:] != solid[:-1])
    found = []
    for first, last in pairwise(edges):
        width = float(last - first) * BIN
        opening = slice(first + 1, last + 1)
        if solid[first + 1] or not NARROWEST <= width <= WIDEST or np.mean(passes[opening] > 0) < SEEN_THROUGH:
            continue
        right, left = low + float(first + 1) * BIN, low + float(last + 1) * BIN
        here = line.pose @ Pose2((right + left) / 2, 0.0, 0.0)
        within = max(FOR_PLACE, FOR_DIRECTION) + width
        near = ends[(met == 1) & (np.hypot(ends[:, 0] - here.x, ends[:, 1] - here.y) < within)]
        both, off, _ = _local_line(pose, near, right, left, FOR_PLACE)
        _, _, turn = _local_line(pose, near, right, left, FOR_DIRECTION)
        # x of the gap is y of the line, so that y of the gap runs back along the line
        middle = line.pose @ Pose2((right + left) / 2, off, math.pi / 2 + turn)
        walls = (
            _wall_within(line, left - TOLERANCE, left + WALL_BESIDE),
            _wall_within(line, right - WALL_BESIDE, right + TOLERANCE),
        )
        found.append(Gap(middle, width, walls, both))
    return found


def _wall_within(line: WallLine, low: float, high: float) -> float:
    """Return the length [m] of wall seen on a line from `low` to `high` [m]."""
    near, far = np.maximum(line.stretches[:, 0], low), np.minimum(line.stretches[:, 1], high)
    return float(np.clip(far - near, 0.0, None).sum())


@njit(cache=True, nogil=True)
def _local_line(
    line: FloatArray, ends: FloatArray, right: float, left: float, length: float
) -> tuple[bool, float, float]:
    """Return whether things stand next to both jambs of a gap, how far [m] beside the wall line and how turned [rad].

    Both sides weigh the same, so that a doorway between walls a little out of line stands between both. Where a side
    shows too little, the long line stays.
    """
    off, turn = 0.0, 0.0
    middle = (right + left) / 2
    c, s = math.cos(line[2]), math.sin(line[2])
    for within in LOCAL_OFF:
        sums = np.zeros((2, 6))
        sums[:, 4], sums[:, 5] = np.inf, -np.inf
        for i in range(len(ends)):
            x, y = ends[i, 0] - line[0], ends[i, 1] - line[1]
            a, d = c * x + s * y - middle, c * y - s * x
            beyond = abs(a) - (left - right) / 2
            if not -TOLERANCE < beyond < length or abs(d - off - math.tan(turn) * a) > within:
                continue
            k = 1 if a > 0.0 else 0
            sums[k, 0] += 1.0
            sums[k, 1] += a
            sums[k, 2] += d
            sums[k, 4], sums[k, 5] = min(sums[k, 4], a), max(sums[k, 5], a)
        if min(sums[0, 0], sums[1, 0]) < LOCAL_POINTS or min(sums[0, 5] - sums[0, 4], sums[1, 5] - sums[1, 4]) < 0.06:
            return False, 0.0, 0.0
        a0, d0 = sums[0, 1] / sums[0, 0], sums[0, 2] / sums[0, 0]
        a1, d1 = sums[1, 1] / sums[1, 0], sums[1, 2] / sums[1, 0]
        slope = (d1 - d0) / (a1 - a0)
        off, turn = d0 - slope * a0, math.atan(slope)
    return True, off, turn


@njit(cache=True, nogil=True)
def _beam_kind(x: float, y: float, to_x: float, to_y: float, met: bool) -> tuple[int, float]:
    """Return the kind of a beam from (x, y) to (to_x, to_y), both [m] in a frame whose y axis is the line, and the y at
    which it crosses."""
    side = -1.0 if x > 0.0 else 1.0
    go = side * (to_x - x)
    behind = side * to_x
    if -side * x < NEAREST or go < math.cos(SKEWED) / math.sin(SKEWED) * abs(to_y - y):
        return NOTHING, 0.0
    cross = y + (to_y - y) * (-side * x) / go
    if x * x + (cross - y) * (cross - y) > FARTHEST * FARTHEST:
        return NOTHING, cross
    if behind > BEHIND:
        return PASSES, cross
    if behind < -AHEAD:
        return FALLS_SHORT, cross
    if not met:
        return NOTHING, cross
    return (SLIPS if behind > GRAZED and abs(to_y - cross) > SLIPPED else STOPS), cross


@njit(cache=True, nogil=True)
def _beside(i: int, j: int, number: IntArray, alongs: FloatArray) -> bool:
    """Return whether the ends of beams i and j lie no farther apart along the line than the face of a wall has them."""
    if j < 0 or j >= len(number) or number[i] != number[j]:
        return False
    return bool(abs(alongs[0, i] - alongs[0, j]) < ON_FACE * abs(alongs[1, i] - alongs[1, j]) + EVEN)


@njit(cache=True, nogil=True)
def _counted(
    line: FloatArray,
    origins: FloatArray,
    ends: FloatArray,
    number: IntArray,
    beam: IntArray,
    met: Bytes,
    low: float,
    bins: int,
) -> tuple[IntArray, IntArray]:
    """Return (bins,) the number of views with a beam that ends at the line in each bin, and with one that passes."""
    counts = np.zeros((2, bins), np.int64)
    last = np.full((2, bins), -1)
    c, s = math.cos(line[2]), math.sin(line[2])
    kinds, alongs = np.empty(len(ends), np.int64), np.empty((2, len(ends)))
    for i in range(len(ends)):
        ox, oy = origins[i, 0] - line[0], origins[i, 1] - line[1]
        ex, ey = ends[i, 0] - line[0], ends[i, 1] - line[1]
        # the frame of `_beam_kind` is the line's turned by a quarter: its x is the line's y, its y the line's -x
        kind, cross = _beam_kind(c * oy - s * ox, -c * ox - s * oy, c * ey - s * ex, -c * ex - s * ey, met[i] == 1)
        kinds[i], alongs[0, i], alongs[1, i] = kind, c * ex + s * ey, -cross
    before = np.full(2, -1)  # the last beam that ended at the line, and the last one that crossed it
    for i in range(len(ends)):
        for row in range(2):
            if kinds[i] == NOTHING or kinds[i] == FALLS_SHORT or kinds[i] == (PASSES if row == 0 else STOPS):
                continue
            if row == 0 and not (_beside(i, i - 1, number, alongs) or _beside(i, i + 1, number, alongs)):
                continue  # a mixed pixel at the edge of a jamb
            a = math.floor((alongs[row, i] - low) / BIN)
            b, j = a, before[row]
            linked = j >= 0 and number[i] == number[j] and beam[i] - beam[j] <= LINK_BEAMS
            linked = linked and abs(alongs[row, i] - alongs[row, j]) < LINK
            if linked and (row == 1 or _beside(i, j, number, alongs)):
                b = math.floor((alongs[row, j] - low) / BIN)
            for k in range(max(0, min(a, b)), min(bins - 1, max(a, b)) + 1):
                if last[row, k] != number[i]:
                    last[row, k] = number[i]
                    counts[row, k] += 1
            before[row] = i
    return counts[0], counts[1]


@njit(cache=True, nogil=True)
def _classified(
    gap: FloatArray, origin: FloatArray, ends: FloatArray, met: BoolArray
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Return (N,) the kind of each beam at a gap's line, the y at which it crosses, and x and y of its end."""
    count = len(ends)
    kinds, cross = np.zeros(count, np.int64), np.zeros(count)
    x, y = np.full(count, np.nan), np.full(count, np.nan)
    c, s = math.cos(gap[2]), math.sin(gap[2])
    ox, oy = origin[0] - gap[0], origin[1] - gap[1]
    for i in range(count):
        if math.isfinite(ends[i, 0]):
            ex, ey = ends[i, 0] - gap[0], ends[i, 1] - gap[1]
            x[i], y[i] = c * ex + s * ey, c * ey - s * ex
            kinds[i], cross[i] = _beam_kind(c * ox + s * oy, c * oy - s * ox, x[i], y[i], met[i])
    return kinds, cross, x, y


@njit(cache=True, nogil=True)
def _jambs(
    kinds: IntArray, cross: FloatArray, x: FloatArray, y: FloatArray, from_x: float, from_y: float, width: float
) -> tuple[FloatArray, FloatArray, int, int, float]:
    """Return x, y of the right and the left jamb (2, 2), half their doubt (2,), beams through, stopped, their depth.

    Beams that end beside the far jamb's plane tell no depth: a leaf may stand open there. A jamb lies between the last
    beam that passes and its neighbour that ends at the line: half-way between both at the
    depth of that end, so that a reveal seen at an angle moves nothing.
    """
    half = width / 2
    jambs, doubts = np.zeros((2, 2)), np.full(2, np.inf)
    through, stopped, deep = 0, 0, 0
    depths = np.empty(len(kinds))
    middle = -1
    for i in range(len(kinds)):
        if kinds[i] == SLIPS and abs(cross[i]) < half < abs(y[i]) - JAMB_OFF:
            kinds[i] = PASSES  # it met a thing behind the wall, beside the opening
        if kinds[i] == PASSES and abs(cross[i]) < half:
            through += 1
            if abs(abs(y[i]) - half) > BESIDE_JAMB or y[i] * (y[i] - from_y) < 0.0:
                depths[deep] = abs(x[i])
                deep += 1
            if middle < 0 or abs(cross[i]) < abs(cross[middle]):
                middle = i
        elif (kinds[i] == STOPS or kinds[i] == SLIPS) and abs(y[i]) < half - 0.5 * JAMB_OFF:
            stopped += 1
    if through == 0:
        through = _slipped_jambs(kinds, cross, x, y, from_y, half, jambs, doubts)
        return jambs, doubts, through, stopped, np.nan
    for step in (-1, 1):
        outer = _outermost(kinds, cross, y, middle, step, half)
        i = outer + step
        while 0 <= i < len(kinds) and kinds[i] == NOTHING and abs(i - outer) < SLIM:
            i += step
        if not 0 <= i < len(kinds) or (kinds[i] != STOPS and kinds[i] != SLIPS) or abs(abs(y[i]) - half) > JAMB_OFF:
            continue
        passing = from_y + (y[outer] - from_y) * (x[i] - from_x) / (x[outer] - from_x)
        at = 0 if y[i] + passing < 0.0 else 1
        jambs[at, 0], jambs[at, 1] = x[i], (y[i] + passing) / 2
        doubts[at] = abs(y[i] - passing) / 2
        if kinds[i] == SLIPS and y[i] * (y[i] - from_y) > 0.0 and doubts[at] > REVEAL_DOUBT:
            jambs[at, 1], doubts[at] = y[i], REVEAL_DOUBT  # the reveal itself was met
    return jambs, doubts, through, stopped, float(np.median(depths[:deep])) if deep > 0 else np.nan


@njit(cache=True, nogil=True)
def _slipped_jambs(
    kinds: IntArray,
    cross: FloatArray,
    x: FloatArray,
    y: FloatArray,
    from_y: float,
    half: float,
    jambs: FloatArray,
    doubts: FloatArray,
) -> int:
    """Fill in the jambs of an opening that only shows the far jamb's reveal; return the number of beams that met it.

    The far jamb lies where they end, the near one between the first of them and the wall before it.
    """
    count, total_x, total_y, first = 0, 0.0, 0.0, -1
    for i in range(len(kinds)):
        met = kinds[i] == SLIPS and abs(cross[i]) < half + 0.5 * JAMB_OFF and abs(abs(y[i]) - half) < JAMB_OFF
        if met and y[i] * (y[i] - from_y) > 0.0:
            count += 1
            total_x += x[i]
            total_y += y[i]
            if first < 0 or abs(cross[i] - from_y) < abs(cross[first] - from_y):
                first = i
    if count == 0:
        return 0
    far = 0 if total_y < 0.0 else 1
    jambs[far, 0], jambs[far, 1], doubts[far] = total_x / count, total_y / count, REVEAL_DOUBT
    for i in (first - 1, first + 1):
        if 0 <= i < len(kinds) and kinds[i] == STOPS and abs(abs(y[i]) - half) < JAMB_OFF and y[i] * total_y < 0.0:
            jambs[1 - far, 0], jambs[1 - far, 1] = x[i], (y[i] + cross[first]) / 2
            doubts[1 - far] = abs(y[i] - cross[first]) / 2
    return count


@njit(cache=True, nogil=True)
def _outermost(kinds: IntArray, cross: FloatArray, y: FloatArray, middle: int, step: int, half: float) -> int:
    """Return the outermost beam on one side of beam `middle` that passes the opening; slim things in it are passed."""
    outer, i = middle, middle + step
    while 0 <= i < len(kinds):
        if kinds[i] == PASSES:
            if abs(cross[i]) > half + JAMB_OFF:
                break
            if abs(i - outer) <= SLIM or abs(cross[i]) < half - 0.1:
                outer = i
        elif ((kinds[i] == STOPS or kinds[i] == SLIPS) and abs(y[i]) > half - JAMB_OFF) or (
            kinds[i] == FALLS_SHORT and abs(cross[i]) > half - JAMB_OFF and abs(i - outer) <= 1
        ):
            break
        i += step
    return outer


@njit(cache=True, nogil=True)
def _flanks(x: FloatArray, y: FloatArray, met: BoolArray, width: float) -> tuple[int, int, int, int]:
    """Return in which decimetres along x beams end in line with the jambs, as `JambSight.flanks`."""
    bits = np.zeros(4, np.int64)
    for i in range(len(x)):
        if met[i] and abs(x[i]) < FLANK and -FLANK_INSIDE < abs(y[i]) - width / 2 < FLANK_OUTSIDE:
            bits[2 * (y[i] > 0.0) + (x[i] > 0.0)] |= 1 << int(10.0 * abs(x[i]))
    return bits[0], bits[1], bits[2], bits[3]
