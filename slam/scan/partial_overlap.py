"""Loop closure by partial overlap: the latest scans and earlier ones show only a small part of the same ground.

A chair that returns with another heading, or whose lidar has a short range, sees mostly new ground, so the mean
likelihood over all points is meaningless. Here only points on ground that the earlier scans saw count: a point on a
surface is evidence for a pose, a point in known free space is evidence against it, a point elsewhere is none. Blocks of
cells bound these values as they bound the likelihood, so the search stays exact (the occupancy of Hess et al. 2016,
section V.B, with unknown cells between free and occupied).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from waychair.geometry import pose_from_array, transform_points
from waychair.slam.scan.reference_surfaces import LEVELS, ScanReference, block_maxima
from waychair.slam.scan.scan_matching import ENDLESS, MatchSettings, Window, WindowSearch, begin_search, refine
from waychair.slam.scan.scan_points import ScanPoints, ScanStore
from waychair.types import BoolArray, FloatArray, IntArray, Pose2

_GAP = 0.05  # [rad]; a larger angle between two beams is a gap


QUERY_SCANS = 15  # latest key scans that are searched for together
SPACING = 1.0  # m; distance driven between two searches
PATIENCE = 10.0  # m; distance driven since the last loop before any search
WIDENING = 2.0  # the search window over that of a match of whole views
MAX_WINDOW = 2.0  # m; largest half window
DRAWN_SCANS = 15  # earlier key scans from which the known ground is drawn
NEUTRAL_LIKELIHOOD = 0.35  # a point on known ground with a lower likelihood is evidence against a pose
MIN_EVIDENCE = 12.0  # least evidence of an accepted pose
MIN_RESPONSE = 0.55  # least mean likelihood of the points on known ground
MIN_INLIERS = 0.5  # least share of these points on the reference's surfaces
MAX_AMBIGUITY = 0.75  # largest ratio of the runner-up's evidence over the winner's


@dataclass(frozen=True, slots=True)
class PartialOverlap:
    """Pose at which the query fits the ground that it shares with the reference.

    `information` (3, 3) is as of a match. `points` of the query lie on shared ground, with mean likelihood `response`
    and share `inliers` on surfaces; `evidence` is the sum of their likelihood less the neutral level.
    """

    pose: Pose2
    information: FloatArray
    evidence: float
    points: int
    response: float
    inliers: float


def known_ground(
    store: ScanStore,
    poses: FloatArray,
    members: Sequence[int] | IntArray,
    base_from_laser: Pose2,
    reference: ScanReference,
) -> BoolArray:
    """Return the cells (H, W) of the reference that beams of the key scans `members` crossed, or that hold a surface.

    `poses` (N, 3) [m, m, rad] are the poses of all key scans in the map frame.
    """
    import cv2  # only a search by partial overlap has need of it

    crossed = np.zeros(reference.bounds.shape[1:], np.uint8)
    for member in members:
        points = store[int(member)].points
        beams = transform_points(base_from_laser.inverse(), points)
        bearing = np.arctan2(beams[:, 1], beams[:, 0])
        order = np.argsort(bearing)
        map_from_base = pose_from_array(poses[member])
        eye = map_from_base @ base_from_laser
        ends = transform_points(map_from_base, points[order])
        for run in np.split(ends, np.flatnonzero(np.diff(bearing[order]) > _GAP) + 1):
            corners = np.concatenate([[(eye.x, eye.y)], run])
            cells = np.floor((corners - reference.origin) / reference.resolution).astype(np.int32)
            cv2.fillPoly(crossed, [cells], 1)
    known: BoolArray = (crossed > 0) | (reference.bounds[0] > 0)
    return known


@dataclass(slots=True)
class OverlapSearch:
    """A search by partial overlap that is done in pieces; plain data, so that it can be stored in between.

    The first piece of `go_on` begins the search of the window, the last one refines its find. `found` is the result when
    it has returned True.
    """

    query: ScanPoints
    reference: ScanReference
    known: BoolArray
    guess: Pose2
    window: Window
    found: PartialOverlap | None = None
    _evidence: ScanReference | None = None
    _first: WindowSearch | None = None
    _second: WindowSearch | None = None

    def go_on(self, matching: MatchSettings, most: int) -> bool:
        """Look up at least `most` points, or all that are left to look up; return whether the search is done."""
        level = round(255 * NEUTRAL_LIKELIHOOD)
        neutral = level / 255
        if self._evidence is None or self._first is None:
            reference, guess = self.reference, self.guess
            middle = reference.origin + 0.5 * reference.resolution * reference.bounds.shape[1]
            reach = float(np.min(middle - reference.origin - np.abs((guess.x, guess.y) - middle)))
            inside = np.hypot(*self.query.points.T) < reach - 1.5 * self.window.distance
            self.query = _subset(self.query, inside)  # further points may leave the grid
            if len(self.query) == 0:
                return True
            self._evidence = _evidence(reference, self.known, level)
            self._first = self._searched(neutral + MIN_EVIDENCE / len(self.query), None)
        if self._second is None:
            if not self._first.go_on(self._evidence, most):
                return False
            coarse, value = self._first.best
            if value <= neutral + MIN_EVIDENCE / len(self.query):
                return True
            self._second = self._searched(neutral + MAX_AMBIGUITY * (value - neutral), coarse)
            if most < ENDLESS:
                return False
        if not self._second.go_on(self._evidence, most):
            return False
        coarse, value = self._first.best
        if self._second.best[1] <= neutral + MAX_AMBIGUITY * (value - neutral):
            self.found = self._refined(coarse, (value - neutral) * len(self.query), matching)
        return True

    def _searched(self, floor: float, excluded: Pose2 | None) -> WindowSearch:
        return begin_search(
            self.query.points, self.guess, self.window, self.reference.resolution, floor, excluded, penalised=False
        )

    def _refined(self, coarse: Pose2, evidence: float, matching: MatchSettings) -> PartialOverlap | None:
        """Return the find at a pose of the search, or None if it does not fit well enough."""
        reference = self.reference
        at = transform_points(coarse, self.query.points) - reference.origin
        cols, rows = np.floor(at / reference.resolution).T.astype(int)
        shared = self.known[rows, cols]
        response = float(reference.bounds[0][rows, cols][shared].mean()) / 255.0
        if response < MIN_RESPONSE:
            return None
        pose, information, inliers, _ = refine(
            _subset(self.query, shared),
            reference,
            start=coarse,
            guess=coarse,
            guess_information=np.zeros((3, 3)),
            settings=matching,
        )
        return PartialOverlap(
            pose=pose,
            information=information,
            evidence=evidence,
            points=int(shared.sum()),
            response=response,
            inliers=inliers,
        )


def find_partial_overlap(
    query: ScanPoints,
    reference: ScanReference,
    known: BoolArray,
    guess: Pose2,
    window: Window,
    matching: MatchSettings,
) -> PartialOverlap | None:
    """Return where the query fits on known ground (H, W), if one place of the window is unambiguous and good enough.

    The caller judges whether the points fit the right side of the surfaces (`inliers`): an object seen from behind
    does not, although the place is right.
    """
    search = OverlapSearch(query, reference, known, guess, window)
    search.go_on(matching, ENDLESS)
    return search.found


def _evidence(reference: ScanReference, known: BoolArray, level: int) -> ScanReference:
    """Return the reference with unseen ground at `level` in [0, 255], between free and occupied."""
    value = np.where(known, reference.bounds[0], np.uint8(level))
    return replace(reference, bounds=block_maxima(value, LEVELS))


def _subset(points: ScanPoints, kept: BoolArray) -> ScanPoints:
    return ScanPoints(np.ascontiguousarray(points.points[kept]), np.ascontiguousarray(points.normals[kept]))
