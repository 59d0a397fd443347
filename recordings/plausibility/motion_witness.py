"""The motion by odometry as a witness: which of several readings of a recording's scans does it confirm?

Scans of one place that are taken from different poses lie on top of each other if they are read rightly. Odometry is good
enough to tell degrees from radians, left from right, and a sweep that lasts from one that does not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from waychair.geometry import compose, wrap_angles
from waychair.recordings.scan_merging import OdometryInterpolation
from waychair.recordings.scans import beam_ends, beam_times
from waychair.types import FloatArray, Odometry, Pose2, Scan

_PAIRS = 40  # pairs of scans that are compared, with turns and without
_LEAST_PAIRS = 6
_TURN, _DISTANCE = 0.25, 0.5  # rad, m; least motion between the two scans of a pair
_LONGEST_S = 3.0  # s; longest time between them: later they see other surfaces, and the odometry drifts
_MOST_POINTS = 360  # of a scan
_FAR = 0.1  # of the median range; a point farther from all others lies on a surface that the other scan does not show
_DECISIVE = 0.75  # a reading wins if its disagreement is below this part of every other reading's
_ALIKE = 1.25  # times the least disagreement; readings alike in turns or without, of which the other kind decides
_AGREED = 1e-4  # of the median range; readings that agree better are alike


class MotionWitness:
    """Pairs of scans that odometry says to be taken from different poses."""

    def __init__(self, stamps_ns: Sequence[int], odometry: Sequence[Odometry], base_from_laser: Pose2) -> None:
        """Take the stamps of the scans, the odometry by stamp, and the lidar's mount."""
        self._mount = base_from_laser
        self._kinds: list[list[tuple[int, int]]] = []
        self._track = OdometryInterpolation(odometry) if odometry else None
        if self._track is not None:
            pairs = _pairs(np.array(stamps_ns, np.int64), self._track)
            self._kinds = [kind for kind in pairs if len(kind) >= _LEAST_PAIRS]

    def choose(self, readings: Sequence[Callable[[int], Scan]]) -> int | None:
        """Return the index of the reading that the motion confirms; None if there is no motion, or no clear winner.

        A reading returns the scan of an index into the stamps.
        """
        if not self._kinds or len(readings) < 2:
            return None
        disagreements = np.array([[self.disagreement(reading, kind) for reading in readings] for kind in self._kinds])
        best = disagreements.min(axis=1, keepdims=True)
        ratios = disagreements / np.maximum(best, _AGREED)
        winner = int(np.argmin(ratios.sum(axis=0)))
        others = np.delete(ratios, winner, axis=1).min(axis=1)
        decided = (ratios[:, winner] < _DECISIVE * others).any() and (ratios[:, winner] < _ALIKE).all()
        return winner if decided else None

    def disagreement(self, reading: Callable[[int], Scan], pairs: Sequence[tuple[int, int]]) -> float:
        """Return the median distance of the points of one scan of a pair from the surfaces of the other, in median ranges.

        Infinite for scans without points.
        """
        offs = []
        for first, second in pairs:
            here, there = self._points(reading(first)), self._points(reading(second))
            if len(here) < 2 or len(there) < 2:
                continue
            scale = max(float(np.median(np.hypot(*(here - np.median(here, axis=0)).T))), 1e-9)
            offs.append(min(float(np.median(_distances(here, there, _FAR * scale))) / scale, _FAR))
        return float(np.mean(offs)) if len(offs) >= _LEAST_PAIRS else math.inf

    def _points(self, scan: Scan) -> FloatArray:
        """Return the beams' ends (N, 2) [m] in the frame of the odometry."""
        assert self._track is not None
        ends, _ = beam_ends(scan)
        seen = np.flatnonzero(np.isfinite(ends).all(axis=1))
        seen = seen[:: max(1, -(-len(seen) // _MOST_POINTS))]
        stamps = scan.stamp_ns + np.rint(beam_times(scan)[seen] * 1e9).astype(np.int64)
        lasers = compose(self._track.at(stamps), self._mount.array()[None])
        points: FloatArray = compose(lasers, np.column_stack([ends[seen], np.zeros(len(seen))]))[:, :2]
        return points


def _distances(surface: FloatArray, points: FloatArray, gap: float) -> FloatArray:
    """Return the distance (N,) of points (N, 2) from the lines between successive ends (M, 2) of another scan's beams.

    Ends that are `gap` apart do not lie on one surface.
    """
    from scipy.spatial import cKDTree

    _, nearest = cKDTree(surface).query(points)
    distances: FloatArray = np.hypot(*(points - surface[nearest]).T)
    for side in (-1, 1):
        other = np.clip(nearest + side, 0, len(surface) - 1)
        along = surface[other] - surface[nearest]
        length = np.hypot(*along.T)
        part = np.clip(
            np.einsum("ij,ij->i", points - surface[nearest], along) / np.maximum(length, 1e-9) ** 2, 0.0, 1.0
        )
        off = np.hypot(*(points - surface[nearest] - part[:, None] * along).T)
        distances = np.where(length < gap, np.minimum(distances, off), distances)
    return distances


def _pairs(stamps: np.ndarray, track: OdometryInterpolation) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Return pairs of scans with a turn between them, and pairs with a distance but no turn."""
    poses = track.at(stamps)
    seconds = (stamps - stamps[0]) * 1e-9
    turning: list[tuple[int, int]] = []
    moving: list[tuple[int, int]] = []
    for first in range(0, len(stamps) - 1, max(1, len(stamps) // (4 * _PAIRS))):
        last = int(np.searchsorted(seconds, seconds[first] + _LONGEST_S))
        motion = poses[first + 1 : last] - poses[first]
        turned = np.abs(wrap_angles(motion[:, 2])) >= _TURN
        moved = np.hypot(motion[:, 0], motion[:, 1]) >= _DISTANCE
        if turned.any():
            turning.append((first, first + 1 + int(np.argmax(turned))))
        elif moved.any():
            moving.append((first, first + 1 + int(np.argmax(moved))))
    return _thinned(turning, _PAIRS), _thinned(moving, _PAIRS)


def _thinned(pairs: list[tuple[int, int]], most: int) -> list[tuple[int, int]]:
    return pairs[:: max(1, -(-len(pairs) // max(most, 1)))]
