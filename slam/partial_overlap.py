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

import cv2
import numpy as np

from waychair.config import Settings, setting
from waychair.geometry import pose_from_array, transform_points
from waychair.slam.reference import LEVELS, ScanReference, block_maxima
from waychair.slam.scan_matching import MatchSettings, Window, correlative_search, refine
from waychair.slam.scan_points import ScanPoints, ScanStore
from waychair.types import BoolArray, FloatArray, IntArray, Pose2

_GAP = 0.05  # [rad]; a larger angle between two beams is a gap


@dataclass(frozen=True, slots=True)
class GlimpseSettings(Settings):
    """When a partial overlap is enough evidence for a place."""

    query_scans: int = setting(15, "", "latest key scans that are searched for together", low=1, high=100)
    spacing: float = setting(1.0, "m", "distance driven between two searches", low=0.0, high=100.0)
    patience: float = setting(10.0, "m", "distance driven since the last loop before any is done", low=0.0, high=1e3)
    widening: float = setting(2.0, "", "the window is this often that of a match of whole views", low=1.0, high=10.0)
    doubt: float = setting(
        0.35, "", "a point on known ground with a likelihood below this speaks against a pose", low=0.05, high=0.95
    )
    max_window: float = setting(2.0, "m", "where it would be larger, only so much is searched", low=0.05, high=50.0)
    min_evidence: float = setting(12.0, "", "least sum of what the points say", low=1.0, high=1000.0)
    min_response: float = setting(0.55, "", "least mean likelihood of the points on known ground", low=0.0, high=1.0)
    min_inliers: float = setting(0.5, "", "least share of them on the reference's surfaces", low=0.0, high=1.0)
    max_ambiguity: float = setting(0.75, "", "largest runner-up evidence over the winner's", low=0.0, high=1.0)
    drawn_scans: int = setting(15, "", "earlier key scans that the known ground is drawn from", low=1, high=1000)


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


def find_partial_overlap(
    query: ScanPoints,
    reference: ScanReference,
    known: BoolArray,
    guess: Pose2,
    window: Window,
    matching: MatchSettings,
    settings: GlimpseSettings,
) -> PartialOverlap | None:
    """Return where the query fits on known ground (H, W), if one place of the window is unambiguous and good enough.

    The caller judges whether the points fit the right side of the surfaces (`inliers`): an object seen from behind
    does not, although the place is right.
    """
    middle = reference.origin + 0.5 * reference.resolution * reference.bounds.shape[1]
    reach = float(np.min(middle - reference.origin - np.abs((guess.x, guess.y) - middle))) - 1.5 * window.distance
    query = _subset(query, np.hypot(*query.points.T) < reach)  # further points may leave the grid
    if len(query) == 0:
        return None
    level = round(255 * settings.doubt)
    doubt, evidence = level / 255, _evidence(reference, known, level)
    free = replace(matching, distance_penalty=0.0, angle_penalty=0.0)
    floor = doubt + settings.min_evidence / len(query)
    coarse, value = correlative_search(query.points, evidence, guess, window, free, floor=floor)
    if value <= floor:
        return None
    gained = value - doubt
    floor = doubt + settings.max_ambiguity * gained
    if correlative_search(query.points, evidence, guess, window, free, floor=floor, excluded=coarse)[1] > floor:
        return None
    at = transform_points(coarse, query.points) - reference.origin
    cols, rows = np.floor(at / reference.resolution).T.astype(int)
    shared = known[rows, cols]
    response = float(reference.bounds[0][rows, cols][shared].mean()) / 255.0
    pose, information, inliers, _ = refine(
        _subset(query, shared), reference, coarse, coarse, np.zeros((3, 3)), matching
    )
    if response < settings.min_response:
        return None
    return PartialOverlap(pose, information, gained * len(query), int(shared.sum()), response, inliers)


def _evidence(reference: ScanReference, known: BoolArray, level: int) -> ScanReference:
    """Return the reference with unseen ground at `level` in [0, 255], between free and occupied."""
    value = np.where(known, reference.bounds[0], np.uint8(level))
    return replace(reference, bounds=block_maxima(value, LEVELS))


def _subset(points: ScanPoints, kept: BoolArray) -> ScanPoints:
    return ScanPoints(np.ascontiguousarray(points.points[kept]), np.ascontiguousarray(points.normals[kept]))
