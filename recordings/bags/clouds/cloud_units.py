"""The unit of a topic's point clouds: where several are possible, the motion by odometry decides."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from waychair.recordings.bags.clouds.cloud_decoding import Cloud
from waychair.recordings.plausibility.findings import Finding
from waychair.recordings.plausibility.motion_witness import MotionWitness
from waychair.recordings.plausibility.range_readings import tried_units, unit_text
from waychair.recordings.scans import scan_from_points
from waychair.types import FloatArray, Odometry, Pose2, Scan

_STEP = math.radians(0.5)  # between the beams of the scans that are compared
_LEVEL = 0.1  # of the distance; points that high over or below the sensor show walls in any unit, and no floor
_LEAST_LEVEL = 20  # points; where fewer are level, all are compared


def unit_of_clouds(
    topic: str,
    sample: Sequence[tuple[int, Cloud]],
    again: Callable[[], Iterable[tuple[int, Cloud]]],
    odometry: Sequence[Odometry],
    base_from_sensor: FloatArray | None,
    findings: list[Finding],
) -> float:
    """Return the metres in the unit of a topic's clouds, and add a finding unless they are in metres.

    Args:
        topic: its name, for the finding.
        sample: its first clouds with their stamps [ns].
        again: reads all its clouds; called only where several units are possible.
        odometry: by stamp; without its motion the likelier unit is taken, and the finding names the doubt.
        base_from_sensor: the mount (4, 4); None where it is unknown.
        findings: get the finding.
    """
    distances = np.concatenate(
        [np.hypot(cloud.points[:, 0], cloud.points[:, 1]) for _, cloud in sample] or [np.zeros(0)]
    )
    units = tried_units(distances[distances > 0.0].astype(np.float32), math.inf) or (1.0,)
    if len(units) == 1:
        number = None
    else:
        number = _confirmed(units, again(), odometry, np.eye(4) if base_from_sensor is None else base_from_sensor)
    unit = units[number or 0]
    text = unit_text("points", units, number)
    if text:
        findings.append(Finding("range unit", topic, text, "check the lidar's driver"))
    return unit


def _confirmed(
    units: Sequence[float], clouds: Iterable[tuple[int, Cloud]], odometry: Sequence[Odometry], base_from_sensor: FloatArray
) -> int | None:  # fmt: skip
    """Return the index of the unit that the motion confirms, if it confirms one."""
    if not odometry:
        return None
    turn = base_from_sensor[:3, :3]
    scans = [_level_scan(stamp_ns, cloud.points @ turn.T) for stamp_ns, cloud in clouds]
    scans.sort(key=lambda scan: scan.stamp_ns)
    x, y = base_from_sensor[:2, 3].tolist()
    witness = MotionWitness([scan.stamp_ns for scan in scans], odometry, Pose2(x, y))

    def reading(unit: float) -> Callable[[int], Scan]:
        return lambda index: replace(scans[index], ranges=scans[index].ranges * np.float32(unit))

    return witness.choose([reading(unit) for unit in units])


def _level_scan(stamp_ns: int, points: FloatArray) -> Scan:
    """Return the nearest level points (N, 3) by direction, in the unit in which they are told."""
    level = np.abs(points[:, 2]) <= _LEVEL * np.hypot(points[:, 0], points[:, 1])
    hits = points[level] if np.count_nonzero(level) >= _LEAST_LEVEL else points
    return scan_from_points(stamp_ns, hits[:, :2], np.zeros((0, 2)), _STEP, 0.0, math.inf)
