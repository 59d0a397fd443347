"""Doorways judged by what range sensors have seen of a gap: where, how wide, open or not, and why it may be none.

A picture or one scan only proposes. A gap counts as a doorway when beams went through it from places apart, both jambs
were measured, a wall stands beside one of them, and the space widens behind and before it.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np

from waychair.planning.seen.door_leaf import Leaf
from waychair.planning.seen.doorway_gaps import Gap, JambSight
from waychair.types import FloatArray, IntArray, Pose2

NARROWEST, WIDEST = 0.65, 1.30
"""m; clear width of a doorway: nothing narrower passes a chair, and wider ones are passages."""

SPARE = 0.04
"""m; a doorway is wide enough for a chair if it is wider by at least this."""

APART = 0.3
"""m; beams must have gone through from places this far apart: a gap between things at different depths then shifts."""

LEAST_SIGHTS = 2
"""Views that must have measured each jamb."""

DOUBTFUL = 0.10
"""m; a jamb known less well than this in one view does not count."""

DEEP = 0.6
"""m; beams must go on this far behind the wall, or the gap is a niche."""

MOST_STOPPED = 0.35
"""Share of the beams to the opening that may have ended in it while it was open."""

LEAST_WALL = 0.7
"""m; wall seen beside both jambs together, at its best: less is furniture."""

CORRIDOR, FLANKED = 1.1, 0.7
"""m; where things in line with both jambs go on `CORRIDOR` far on one side, the gap is a corridor or its mouth. Where
they go on `FLANKED` far on both sides of one jamb, that is a wall along which one drives, and the other jamb is
furniture."""

SLACK = 0.015
"""m; error of a jamb's place in one view beside the distance of its beams."""

BIAS = 0.01
"""m; error of a width that more views do not lessen: dark frames, mixed pixels."""

LEAST_WALLS = 5
"""Single views with wall on both sides, from which on they and not the gaps give direction and place: they do not blur."""

ASKEW = math.radians(3.0)
"""rad; a single view's wall that is turned farther than this from the gaps' direction shows a pilaster or a frame."""

NEAR = 1.0
"""m; walls seen from farther away or at a slant weigh less: by the square of the distance, and of the cosine."""

LEAST_WEIGHT, BOTH_WEIGH = 0.2, 5.0
"""A gap weighs by the wall beside it [m] and at least so much; if both jambs gave its pose, so many times more."""

KEPT_GAPS, KEPT_SIGHTS = 60, 150
"""Newest gaps and sights that are kept of one doorway."""

_GAP_COLUMNS, _SIGHT_COLUMNS = 7, 18


class DoorState(enum.Enum):
    """Whether a chair could pass: the opening is free, a leaf leaves part of it, a leaf or glass shuts it, or nothing
    has told yet."""

    UNKNOWN = "unknown"
    OPEN = "open"
    AJAR = "ajar"
    CLOSED = "closed"


@dataclass(frozen=True, slots=True)
class Doorway:
    """A doorway, with `number` as its identity.

    `pose` is the middle of the opening and x leads through it (either way). `width` [m] is clear between the jambs,
    `clear` [m] is the part through which the floor is seen free as far as a leaf reaches, 0 before anything near saw it.
    `error` [m] bounds the width in about 95 of 100 cases: two sigma. `leaf` is None where none was seen. `sights` counts
    the views that bear it out. `validated` tells that range has borne it out; before, it is a candidate that was only
    seen at a slant or from one place, of unknown state. `seen_ns` is the stamp of the last view that showed it.
    """

    number: int
    pose: Pose2
    width: float
    clear: float
    error: float
    state: DoorState
    leaf: Leaf | None = None
    sights: int = 0
    validated: bool = True
    seen_ns: int = 0

    @property
    def sigma(self) -> float:
        """Error of the width [m], one sigma."""
        return self.error / 2.0

    def margin(self, chair_width: float) -> float:
        """Return how much wider [m] the opening is, at the least, than a chair of `chair_width` [m]."""
        return self.clear - self.error - chair_width

    def wide_enough(self, chair_width: float) -> bool:
        """Return whether a chair of `chair_width` [m] surely passes with at least `SPARE`.

        It never does where the doorway is not open, or not validated.
        """
        return self.validated and self.state is DoorState.OPEN and self.margin(chair_width) >= SPARE


@dataclass(frozen=True, slots=True)
class GapEvidence:
    """All that was seen of one gap, in the frame of the views.

    `gaps` (G, 7): x, y [m], theta [rad], width [m], wall beside the right and the left jamb [m], 1 if things next to both
    jambs gave the pose. `sights` (S, 18): x, y
    of the right and of the left jamb, both doubts, beams through, beams stopped, depth, x and y of the sensor in the
    gap's frame, the four flanks, x and y of a point on the wall and the direction [rad] across it (nan where the view
    shows too little of it); lengths in m. Both lists are in order of time.
    """

    gaps: FloatArray
    sights: FloatArray

    def with_gap(self, gap: Gap) -> GapEvidence:
        """Return the evidence with one gap more."""
        row = [gap.pose.x, gap.pose.y, gap.pose.theta, gap.width, *gap.walls, gap.between_both]
        return GapEvidence(np.vstack([self.gaps, row])[-KEPT_GAPS:], self.sights)

    def with_sight(self, sight: JambSight, at: Pose2) -> GapEvidence:
        """Return the evidence with one view more, measured at the gap's pose `at`."""
        right, left = at @ Pose2(*sight.right), at @ Pose2(*sight.left)
        row = [right.x, right.y, left.x, left.y, sight.right_doubt, sight.left_doubt, sight.through, sight.stopped]
        row += [sight.depth, *sight.seat, *sight.flanks]
        off, turn = sight.wall or (math.nan, math.nan)
        wall = at @ Pose2(off, 0.0, turn) if sight.wall else Pose2(off, off, turn)
        row += [wall.x, wall.y, wall.theta]
        return GapEvidence(self.gaps, np.vstack([self.sights, row])[-KEPT_SIGHTS:])


NO_EVIDENCE = GapEvidence(np.zeros((0, _GAP_COLUMNS)), np.zeros((0, _SIGHT_COLUMNS)))


@dataclass(frozen=True, slots=True)
class Judgement:
    """The best estimate of a gap, the reason why it is none (empty: nothing speaks against it), and the evidence that
    is still missing (empty: none, range has validated it).

    `strength` counts the views that measured both jambs.
    """

    pose: Pose2
    width: float
    error: float
    against: str
    missing: str
    strength: int = 0


def judge(evidence: GapEvidence, start: Pose2) -> Judgement:
    """Return the pose and width that evidence gives a gap known roughly at `start`, and the verdict on it."""
    pose, width, error = _estimate(evidence, start)
    strength = int(np.count_nonzero(evidence.sights[:, 4:6].max(axis=1) < DOUBTFUL))
    against, missing = _doubts(evidence, width)
    return Judgement(pose, width, error, against, missing, strength)


def weighted_median(values: FloatArray, weights: FloatArray) -> float:
    """Return the value (of N > 0) below which half of the weight lies."""
    order = np.argsort(values)
    below = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(below, below[-1] / 2)])


def _estimate(evidence: GapEvidence, start: Pose2) -> tuple[Pose2, float, float]:
    """Return pose, width [m] and its error [m]: direction and place across from the walls, the rest from the jambs."""
    gaps, sights = evidence.gaps, evidence.sights
    weights = (gaps[:, 4] + gaps[:, 5] + LEAST_WEIGHT) * np.where(gaps[:, 6] > 0.0, BOTH_WEIGH, 1.0)
    theta, x = _across(gaps[:, :3], weights, start)
    walls, seats = sights[:, 15:18], sights[:, 9:11]
    turned = np.abs(np.remainder(walls[:, 2] - theta + math.pi / 2, math.pi) - math.pi / 2)
    good = turned < ASKEW  # false where it is not a number
    if np.count_nonzero(good) >= LEAST_WALLS:
        weights = seats[:, 0] ** 2 / np.maximum((seats**2).sum(axis=1), NEAR**2) ** 2
        theta, x = _across(walls[good], weights[good], start)
    forward, across = np.array([math.cos(theta), math.sin(theta)]), np.array([-math.sin(theta), math.cos(theta)])
    origin = np.array([start.x, start.y])
    one, other = (sights[:, :2] - origin) @ across, (sights[:, 2:4] - origin) @ across
    flipped = bool(np.sum(other - one) < 0.0)  # `start` looks the other way
    right, left = (other, one) if flipped else (one, other)
    doubts = sights[:, [5, 4]] if flipped else sights[:, [4, 5]]
    both = doubts.max(axis=1) < DOUBTFUL
    if both.sum() >= LEAST_SIGHTS:
        doubt = (doubts[both] ** 2).sum(axis=1) + SLACK**2
        widths = (left - right)[both]
        width = weighted_median(widths, 1.0 / doubt)
        y = weighted_median(((left + right) / 2)[both], 1.0 / doubt)
        spread = 1.4826 * weighted_median(np.abs(widths - width), 1.0 / doubt) + SLACK
        error = BIAS + 2.0 * spread / math.sqrt(both.sum())
    else:
        ends = []
        for jamb, doubt in zip((right, left), doubts.T, strict=True):
            seen = np.isfinite(doubt)
            if not seen.any():
                return start, float(np.median(gaps[:, 3])), math.inf
            ends.append(weighted_median(jamb[seen], 1.0 / (doubt[seen] ** 2 + SLACK**2)))
        width, y, error = ends[1] - ends[0], (ends[0] + ends[1]) / 2, 2.0 * DOUBTFUL
    middle = origin + x * forward + y * across
    return Pose2(float(middle[0]), float(middle[1]), math.remainder(theta, math.tau)), width, error


def _across(lines: FloatArray, weights: FloatArray, start: Pose2) -> tuple[float, float]:
    """Return the direction [rad] across lines (N, 3) (x, y, direction across) and their place [m] along it from `start`."""
    turns = np.remainder(lines[:, 2] - start.theta + math.pi / 2, math.pi) - math.pi / 2
    theta = start.theta + weighted_median(turns, weights)
    offs = (lines[:, 0] - start.x) * math.cos(theta) + (lines[:, 1] - start.y) * math.sin(theta)
    return theta, weighted_median(offs, weights)


def _doubts(evidence: GapEvidence, width: float) -> tuple[str, str]:
    """Return the first reason that speaks against a doorway of `width` [m], and the first thing not yet seen of it."""
    gaps, sights = evidence.gaps, evidence.sights
    through = sights[sights[:, 6] >= 2]
    depths = through[np.isfinite(through[:, 8]), 8]
    return _against(gaps, sights, depths, width), _missing(sights, through, depths)


def _against(gaps: FloatArray, sights: FloatArray, depths: FloatArray, width: float) -> str:
    beams = sights[:, 6:8].sum(axis=0)
    if not NARROWEST <= width <= WIDEST:
        return "its width is not a doorway's"
    if len(depths) >= LEAST_SIGHTS and float(np.median(depths)) < DEEP:
        return "it is a niche"
    if beams[1] > MOST_STOPPED * beams.sum():
        return "something stands in it"
    if float((gaps[:, 4] + gaps[:, 5]).max(initial=0.0)) < LEAST_WALL:
        return "no wall stands beside it"
    flank = _flank_lengths(sights[:, 11:15].astype(np.int64))
    if max(min(flank[0], flank[2]), min(flank[1], flank[3])) >= CORRIDOR:
        return "it is the mouth of a corridor"
    if max(min(flank[0], flank[1]), min(flank[2], flank[3])) >= FLANKED:
        return "a wall runs through it"
    return ""


def _missing(sights: FloatArray, through: FloatArray, depths: FloatArray) -> str:
    if len(through) < LEAST_SIGHTS or math.hypot(*np.ptp(through[:, 9:11], axis=0)) < APART:
        return "it was seen through from one place only"
    if min(np.count_nonzero(sights[:, 4:6] < DOUBTFUL, axis=0)) < LEAST_SIGHTS:
        return "one of its jambs was not seen"
    if len(depths) < LEAST_SIGHTS or float(np.median(depths)) < DEEP:
        return "the space behind it was not seen"
    return ""


def _flank_lengths(flanks: IntArray) -> FloatArray:
    """Return (4,) [m] how much of the line beside each jamb things stand on, beyond the wall's own thickness.

    A decimetre counts if at least two views (S, 4) agree.
    """
    decimetres = (flanks[:, :, None] >> np.arange(16)) & 1
    held = decimetres.sum(axis=0) >= LEAST_SIGHTS
    lengths: FloatArray = held[:, 2:].sum(axis=1) / 10.0
    return lengths
