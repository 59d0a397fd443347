"""Merging the scans of several lasers into one, motion-compensated by odometry to the first laser's stamp."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence

import numpy as np

from waychair.geometry import compose, invert
from waychair.recordings.scans import beam_ends, beam_times, scan_from_points
from waychair.types import FloatArray, IntArray, Odometry, Pose2, Scan

_FAR = 1e4  # m; stands for the end of a beam that saw nothing, so that only its direction counts


class OdometryInterpolation:
    """Poses of the base by odometry, interpolated to any time."""

    def __init__(self, readings: Sequence[Odometry]) -> None:
        """Take at least one reading, sorted by stamp."""
        self._first_ns = readings[0].stamp_ns
        self._seconds = np.array([(reading.stamp_ns - self._first_ns) * 1e-9 for reading in readings])
        poses = np.array([reading.odom_from_base.array() for reading in readings])
        poses[:, 2] = np.unwrap(poses[:, 2])
        self._poses = poses

    def at(self, stamps_ns: IntArray) -> FloatArray:
        """Return `odom_from_base` (N, 3) at stamps (N,): linear between readings, constant beyond the first and last."""
        seconds = (stamps_ns - self._first_ns) * 1e-9
        return np.stack([np.interp(seconds, self._seconds, column) for column in self._poses.T], axis=1)


def merged_scans(
    sources: Sequence[tuple[Sequence[Scan], Pose2]], track: OdometryInterpolation | None, step: float, spread: float
) -> list[Scan]:
    """Return each scan of the first laser merged with the nearest in time of every other laser, seen from the base.

    Args:
        sources: scans of each laser in recording order, and its `base_from_laser`.
        track: the odometry that compensates the motion between beams; without it the base is assumed to stand still.
        step: [rad] between the beams of the result.
        spread: [s] largest time between two scans that are merged.
    """
    (first, mount), *others = sources
    ordered = [(sorted(scans, key=lambda scan: scan.stamp_ns), pose) for scans, pose in others]
    stamps = [[scan.stamp_ns for scan in scans] for scans, _ in ordered]
    merged = []
    for scan in first:
        group = [(scan, mount)]
        for (scans, pose), times in zip(ordered, stamps, strict=True):
            near = _nearest(times, scan.stamp_ns)
            if abs(times[near] - scan.stamp_ns) <= spread * 1e9:
                group.append((scans[near], pose))
        ends = [_in_base(member, pose, scan.stamp_ns, track) for member, pose in group]
        hits, misses = np.concatenate([hit for hit, _ in ends]), np.concatenate([empty for _, empty in ends])
        reach = max(member.range_max + np.hypot(pose.x, pose.y) for member, pose in group)
        merged.append(
            scan_from_points(
                stamp_ns=scan.stamp_ns, hits=hits, misses=misses, step=step, range_min=0.0, range_max=float(reach)
            )
        )
    return merged


def _nearest(stamps: Sequence[int], at_ns: int) -> int:
    after = min(bisect_left(stamps, at_ns), len(stamps) - 1)
    return after - 1 if after > 0 and at_ns - stamps[after - 1] < abs(stamps[after] - at_ns) else after


def _in_base(
    scan: Scan, base_from_laser: Pose2, at_ns: int, track: OdometryInterpolation | None
) -> tuple[FloatArray, FloatArray]:
    """Return measured points, and far points for beams without a hit, both (N, 2) in the base at a stamp."""
    ends, directions = beam_ends(scan)
    empty = np.isinf(ends[:, 0]) | np.isinf(ends[:, 1])
    known = empty | np.isfinite(ends[:, 0])
    points = np.where(empty[:, None], _FAR * directions, ends)[known]
    poses = np.broadcast_to(base_from_laser.array(), (len(points), 3))
    if track is not None:
        stamps = scan.stamp_ns + np.rint(beam_times(scan)[known] * 1e9).astype(np.int64)
        now = invert(track.at(np.array([at_ns])))
        poses = compose(compose(now, track.at(stamps)), poses)
    in_base = compose(poses, np.column_stack([points, np.zeros(len(points))]))[:, :2]
    return in_base[~empty[known]], in_base[empty[known]]
