"""Scans seen otherwise: a laser that hangs upside down, several lasers as one, points of a cloud as a scan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.errors import ConfigError
from waychair.types import Float32Array, FloatArray, Pose2, Scan

UPSIDE_DOWN = "upside-down"


@dataclass(frozen=True, slots=True)
class LaserMount:
    """Pose of a laser in the base, and whether it hangs upside down: its beams then turn the other way round."""

    base_from_laser: Pose2 = field(default_factory=Pose2)
    upside_down: bool = False


def mount_from_text(text: str) -> LaserMount:
    """`X,Y`, `X,Y,YAW` or `X,Y,YAW,upside-down` in metres and radians.

    Raises:
        ConfigError: it is none of these.
    """
    *numbers, last = [part.strip() for part in text.split(",")]
    upside_down = last == UPSIDE_DOWN
    try:
        values = [float(part) for part in (numbers if upside_down else [*numbers, last])]
    except ValueError:
        values = []
    if len(values) not in (2, 3) or not all(math.isfinite(value) for value in values):
        raise ConfigError(
            f"a laser's mount must be X,Y,YAW or X,Y,YAW,{UPSIDE_DOWN} in metres and radians "
            f"(such as 0.6,0,0), not '{text}'"
        )
    return LaserMount(Pose2(*values), upside_down)


def text_from_mount(mount: LaserMount) -> str:
    """What `mount_from_text` reads, to the millimetre and the tenth of a degree."""
    pose = mount.base_from_laser
    return f"{pose.x:.3f},{pose.y:.3f},{pose.theta:.3f}" + (f",{UPSIDE_DOWN}" if mount.upside_down else "")


def ascending(scan: Scan) -> Scan:
    """The same scan with its beams in the order of their angles: the stamp moves to the beam that is now the first."""
    if scan.angle_step > 0:
        return scan
    last = len(scan.ranges) - 1
    return replace(
        scan,
        stamp_ns=scan.stamp_ns + round(last * scan.time_step * 1e9),
        ranges=scan.ranges[::-1].copy(),
        angle_min=scan.angle_min + last * scan.angle_step,
        angle_step=-scan.angle_step,
        time_step=-scan.time_step if scan.time_step else 0.0,
    )


def without_codes(scan: Scan) -> Scan:
    """The scan with whatever is beyond its greatest range as +inf, nothing seen: no lidar measures there.

    sensor_msgs/LaserScan has such values discarded; drivers send 65.533 or the like for a beam that did not come back.
    """
    beyond = scan.ranges > scan.range_max
    return replace(scan, ranges=np.where(beyond, np.float32(np.inf), scan.ranges)) if beyond.any() else scan


def mirrored(scan: Scan) -> Scan:
    """The scan of a laser mounted upside down as one that stands upright would have made it."""
    return ascending(replace(scan, angle_min=-scan.angle_min, angle_step=-scan.angle_step))


def beam_times(scan: Scan) -> FloatArray:
    """(N,) seconds of each beam after the stamp."""
    return scan.time_step * np.arange(len(scan.ranges), dtype=np.float64)


def ends_of_beams(scan: Scan) -> tuple[FloatArray, FloatArray]:
    """Ends (N, 2) [m] of the beams in the laser's frame, nan where a beam tells nothing, and directions (N, 2).

    A beam that saw nothing has an infinite end.
    """
    angles = scan.angles()
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ranges = scan.ranges.astype(np.float64)
    with np.errstate(invalid="ignore"):
        ranges[ranges > scan.range_max] = np.inf
        ranges[(ranges < scan.range_min) | (ranges <= 0.0)] = np.nan
        return ranges[:, None] * directions, directions


def scan_from_points(
    stamp_ns: int, hits: FloatArray, looked: FloatArray, step: float, range_min: float, range_max: float
) -> Scan:
    """One sweep of a laser at the origin that would have seen these points, the nearest one in each direction.

    Args:
        hits: (N, 2) [m] points that were seen.
        looked: (M, 2) points in directions in which was looked but nothing seen; only their directions count.
        step: [rad] between beams; a full turn is a whole number of them.
        range_min, range_max: [m] points outside are left out.

    Returns:
        All directions, from -pi on: +inf where was looked in vain, nan where nothing is known.
    """
    count = round(math.tau / step)
    ranges = np.full(count, np.nan)
    ranges[_beams(looked, count)] = np.inf
    distances = np.hypot(hits[:, 0], hits[:, 1])
    usable = (distances >= max(range_min, 1e-3)) & (distances <= range_max)  # false for nan
    beams = _beams(hits[usable], count)
    nearest = np.full(count, np.inf)
    np.minimum.at(nearest, beams, distances[usable])
    ranges[beams] = nearest[beams]
    single: Float32Array = ranges.astype(np.float32)
    return Scan(stamp_ns, single, -math.pi, math.tau / count, 0.0, range_min, range_max)


def _beams(points: FloatArray, count: int) -> np.ndarray:
    """Index of the beam that points at each point, of `count` beams in a full turn from -pi on."""
    turns = np.arctan2(points[:, 1], points[:, 0]) / math.tau + 0.5
    return np.rint(turns * count).astype(np.int64) % count


def silent(scans: Sequence[Scan]) -> int:
    """Number of scans without a single distance."""
    return sum(not (np.isfinite(scan.ranges) & (scan.ranges > 0.0)).any() for scan in scans)
