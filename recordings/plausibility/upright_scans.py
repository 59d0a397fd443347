"""Scans that turn against the motion, as an upright lidar would have made them: mirrored, and swept as the motion confirms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from waychair.recordings.plausibility.motion_witness import MotionWitness
from waychair.recordings.scans import mirrored
from waychair.types import Odometry, Pose2, Scan

_Way = Callable[[Scan], Scan]


def upright_scans(
    scans: Sequence[Scan], odometry: Sequence[Odometry], base_from_laser: Pose2
) -> tuple[tuple[Scan, ...], bool]:
    """Return the mirrored scans, and whether a driver reversed their ranges: the first beam is then the last in time.

    The scans of a lidar that hangs upside down look alike but for the order in time, which the odometry tells.
    """
    ways: tuple[_Way, ...] = (mirrored, _mirrored_in_time)
    number = None
    if any(scan.time_step for scan in scans):
        witness = MotionWitness([scan.stamp_ns for scan in scans], odometry, base_from_laser)
        number = witness.choose([partial(_at_index, scans, way) for way in ways])
    return tuple(ways[number or 0](scan) for scan in scans), number == 1


def _at_index(scans: Sequence[Scan], way: _Way, index: int) -> Scan:
    return way(scans[index])


def _mirrored_in_time(scan: Scan) -> Scan:
    found = mirrored(scan)
    return replace(found, stamp_ns=scan.stamp_ns, time_step=-found.time_step)
