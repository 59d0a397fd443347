"""Several lasers as one: each sweep's beams go to where the base was, by odometry, when the first laser began its own."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence

import numpy as np

from waychair.geometry import compose, invert
from waychair.scans import beam_times, ends_of_beams, scan_from_points
from waychair.types import FloatArray, IntArray, Odometry, Pose2, Scan

_FAR = 1e4  # [m]: where a beam that saw nothing is taken to end, so that only its direction counts


class Track:
    """Poses of the base by odometry at any time."""

    def __init__(self, readings: Sequence[Odometry]) -> None:
        """Readings in the order of their stamps, at least one."""
        self._first_ns = readings[0].stamp_ns
        self._seconds = np.array([(reading.stamp_ns - self._first_ns) * 1e-9 for reading in readings])
        poses = np.array([reading.odom_from_base.array() for reading in readings])
        poses[:, 2] = np.unwrap(poses[:, 2])
        self._poses = poses

    def at(self, stamps_ns: IntArray) -> FloatArray:
        """(N, 3) `odom_from_base` at stamps (N,), linear between readings and held outside of them."""
        seconds = (stamps_ns - self._first_ns) * 1e-9
        return np.stack([np.interp(seconds, self._seconds, column) for column in self._poses.T], axis=1)


def merged_scans(
    sources: Sequence[tuple[Sequence[Scan], Pose2]], track: Track | None, step: float, spread: float
) -> list[Scan]:
    """The scans of the first laser, each with the nearest in time of every other one, as one scan from the base's origin.

    Args:
        sources: scans of each laser in the order of recording, and its `base_from_laser`.
        track: the odometry, which moves beams to the pose of the base at the first scan's stamp; without it the base
            is taken to stand meanwhile.
        step: [rad] between the beams of the result.
        spread: [s] beyond which a scan is not taken together with the first laser's.
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
        hits, looked = np.concatenate([hit for hit, _ in ends]), np.concatenate([empty for _, empty in ends])
        reach = max(member.range_max + np.hypot(pose.x, pose.y) for member, pose in group)
        merged.append(scan_from_points(scan.stamp_ns, hits, looked, step, 0.0, float(reach)))
    return merged


def _nearest(stamps: Sequence[int], at_ns: int) -> int:
    after = min(bisect_left(stamps, at_ns), len(stamps) - 1)
    return after - 1 if after > 0 and at_ns - stamps[after - 1] < abs(stamps[after] - at_ns) else after


def _in_base(scan: Scan, base_from_laser: Pose2, at_ns: int, track: Track | None) -> tuple[FloatArray, FloatArray]:
    """Points that were hit, and far points where nothing was, (N, 2) in the base at a stamp."""
    ends, directions = ends_of_beams(scan)
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
