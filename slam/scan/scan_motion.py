"""The motion of the base between neighbouring scans, measured by the scans alone.

Each scan is matched with the one before it, from a guess of constant velocity. The motions drift when they are added up;
they serve to check the wheels and the IMU, which drift in other ways.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from waychair.geometry import arc
from waychair.slam.scan.reference_surfaces import ScanReference, reference_from_scans
from waychair.slam.scan.scan_matching import Match, MatchSettings, Window, match
from waychair.slam.scan.scan_points import MIN_POINTS, ScanPoints, ScanStore, scan_points
from waychair.types import BoolArray, FloatArray, IntArray, Pose2, Scan, Twist

LEAST_APART_S = 0.09
"""Least time [s] between two scans that are compared; of a faster lidar some scans are left out."""

LONGEST_APART_S = 1.0
"""Longest time [s] between two scans that are compared. Later the motion may lie outside the window that is searched: in a
corridor, where all places look alike, the scans then tell a wrong one, and sound wheels would be left out."""

_REACH, _RESOLUTION, _SIGMA = 12.0, 0.1, 0.08  # [m]; of the reference
_MOST_POINTS = 240  # of a scan that is matched
_WINDOW = Window(0.35, 0.35)  # round the constant velocity
_WIDE = Window(0.8, 0.9)  # the same where the first window holds no match: the fastest change of a chair in 0.3 s
_LEAST_RESPONSE, _LEAST_INLIERS = 0.5, 0.6
_LEAST_COMPLEXITY = 0.02  # with fewer surfaces across, the motion along a corridor is not measured
_LOOSE = np.diag([4.0, 4.0, 4.0])  # information of the guess: it decides only where the scan says nothing


@dataclass(frozen=True, slots=True)
class ScanMotions:
    """Motions of the base from scan `before[k]` to scan `after[k]`, indices into the scans that were compared.

    `motions` (N, 3) [m, m, rad] are in the base at the earlier scan. `turn_known` (N,) and
    `way_known` (N,) tell whether turn and translation were measured: not so where scans do not match, and for the
    translation also between parallel walls.
    """

    before: IntArray
    after: IntArray
    motions: FloatArray
    turn_known: BoolArray
    way_known: BoolArray


def scan_motions(
    scans: Sequence[Scan],
    base_from_laser: Pose2,
    range_max: float,
    progress: Callable[[float], None] | None = None,
    wanted: BoolArray | None = None,
) -> ScanMotions:
    """Return the motions between neighbouring scans in the order of the recording, at most one in 0.09 s.

    Ranges beyond `range_max` [m] are left out, and so is a pair whose stamps step backwards or lie more than 1 s apart.
    Of a sample only the pairs of `wanted` (N,) scans are measured. Both scans of a pair are corrected for the motion of the pair before, since the chair moves while the lidar sweeps.
    """
    settings = MatchSettings(resolution=_RESOLUTION, range_max=range_max)
    rows: list[tuple[int, int, Match, bool]] = []
    last, twist = -1, Twist()
    for index, scan in enumerate(scans):
        apart = math.inf if last < 0 else (scan.stamp_ns - scans[last].stamp_ns) * 1e-9
        if wanted is not None and not wanted[index]:
            last = -1
            continue
        if 0.0 <= apart < LEAST_APART_S:
            continue
        if 0.0 < apart <= LONGEST_APART_S:
            reference = _reference(scan_points(scans[last], base_from_laser, range_max, twist))
            points = scan_points(scan, base_from_laser, range_max, twist).thinned(_MOST_POINTS)
            found, known = _measured(points, reference, arc(twist.v * apart, twist.omega * apart), settings)
            rows.append((last, index, found, known))
            twist = Twist(found.pose.x / apart, found.pose.theta / apart) if known else Twist()
        else:
            twist = Twist()
        last = index
        if progress is not None:
            progress((index + 1) / len(scans))
    return ScanMotions(
        before=np.array([row[0] for row in rows], np.int64),
        after=np.array([row[1] for row in rows], np.int64),
        motions=np.array([row[2].pose.array() for row in rows]).reshape(-1, 3),
        turn_known=np.array([row[3] for row in rows], np.bool_),
        way_known=np.array([row[3] and row[2].complexity >= _LEAST_COMPLEXITY for row in rows], np.bool_),
    )


def _measured(
    points: ScanPoints, reference: ScanReference, guess: Pose2, settings: MatchSettings
) -> tuple[Match, bool]:
    """Return the match of a scan with the one before it, and whether it is good."""
    enough = len(points) >= MIN_POINTS
    found = match(points, reference, guess=guess, guess_information=_LOOSE, window=_WINDOW, settings=settings)
    if enough and not _is_good(found):
        found = match(points, reference, guess=guess, guess_information=_LOOSE, window=_WIDE, settings=settings)
    return found, enough and _is_good(found)


def _is_good(found: Match) -> bool:
    return found.response >= _LEAST_RESPONSE and found.inliers >= _LEAST_INLIERS


def _reference(points: ScanPoints) -> ScanReference:
    store = ScanStore()
    store.append(points)
    return reference_from_scans(
        store, np.zeros((1, 3)), members=[0], centre=np.zeros(2), reach=_REACH, resolution=_RESOLUTION, sigma=_SIGMA
    )
