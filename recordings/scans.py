"""Scan conversions: lasers mounted upside down, beam order, range codes, and point clouds as scans."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.errors import ConfigError
from waychair.geometry import wrap_angle
from waychair.pose_text import ImpossiblePose, pose_from_text
from waychair.types import Float32Array, FloatArray, Pose2, Scan

UPSIDE_DOWN = "upside-down"
MAX_HEIGHT = 10.0
"""Largest height [m] of a lidar over the base, above or below."""


@dataclass(frozen=True, slots=True)
class LaserMount:
    """The pose of a laser in the base, and whether it hangs upside down (its beams then turn the other way round)."""

    base_from_laser: Pose2 = field(default_factory=Pose2)
    upside_down: bool = False
    height: float = 0.0
    """Height [m] over the base; only point clouds in space need it."""


def mount_from_text(text: str) -> LaserMount:
    """Return the mount from a text `X,Y`, `X,Y,YAW` or `X,Y,Z,YAW` in metres and radians, or `90deg`, perhaps with `,upside-down`.

    Raises:
        ConfigError: the text has another form, or the angle is more than a full turn.
    """
    what = f"a laser's mount (--base-from-laser) must be X,Y[,Z],YAW or X,Y,YAW,{UPSIDE_DOWN} in metres and radians"
    pose, comma, last = text.rpartition(",")
    upside_down = bool(comma) and last.strip() == UPSIDE_DOWN
    parts = (pose if upside_down else text).split(",")
    try:
        height = float(parts.pop(2)) if len(parts) == 4 else 0.0
        at = pose_from_text(",".join(parts))
    except ImpossiblePose as error:
        raise ConfigError(f"{what}, not '{text}': {error}") from error
    except ValueError as error:
        raise ConfigError(f"{what} (such as 0.6,0,0 or 0.6,0,90deg), not '{text}'") from error
    if not abs(height) <= MAX_HEIGHT:
        raise ConfigError(f"{what}, not '{text}': Z may be up to {MAX_HEIGHT:g} m")
    return LaserMount(replace(at, theta=wrap_angle(at.theta)), upside_down, height)


def text_from_mount(mount: LaserMount) -> str:
    """Return the text that `mount_from_text` reads, with three decimals."""
    pose = mount.base_from_laser
    height = f"{mount.height:.3f}," if mount.height else ""
    return f"{pose.x:.3f},{pose.y:.3f},{height}{pose.theta:.3f}" + (f",{UPSIDE_DOWN}" if mount.upside_down else "")


def ascending(scan: Scan) -> Scan:
    """Return the scan with its beams by ascending angle; the stamp moves to the beam that is now the first."""
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


def without_overflow_codes(scan: Scan) -> Scan:
    """Return the scan with every range beyond `range_max` as +inf (nothing seen).

    sensor_msgs/LaserScan says to discard such values. Some drivers send 65.533 m or the like for a missing echo.
    """
    beyond = scan.ranges > scan.range_max
    return replace(scan, ranges=np.where(beyond, np.float32(np.inf), scan.ranges)) if beyond.any() else scan


def mirrored(scan: Scan) -> Scan:
    """Return the scan of an upside-down laser as an upright laser would have made it."""
    return ascending(replace(scan, angle_min=-scan.angle_min, angle_step=-scan.angle_step))


def beam_times(scan: Scan) -> FloatArray:
    """Return the time (N,) [s] of each beam after the stamp."""
    return scan.time_step * np.arange(len(scan.ranges), dtype=np.float64)


def beam_ends(scan: Scan) -> tuple[FloatArray, FloatArray]:
    """Return the ends (N, 2) [m] of the beams in the laser's frame, and their directions (N, 2).

    The end is nan for an invalid beam and infinite for a beam that saw nothing.
    """
    angles = scan.angles()
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ranges = scan.ranges.astype(np.float64)
    with np.errstate(invalid="ignore"):
        ranges[ranges > scan.range_max] = np.inf
        ranges[(ranges < scan.range_min) | (ranges <= 0.0)] = np.nan
        return ranges[:, None] * directions, directions


def scan_from_points(
    stamp_ns: int, hits: FloatArray, misses: FloatArray, step: float, range_min: float, range_max: float
) -> Scan:
    """Return the scan of a virtual laser at the origin that sees the nearest of these points in each direction.

    Args:
        hits: (N, 2) [m] measured points.
        looked: (M, 2) points in directions that were observed without a hit; only their directions count.
        step: [rad] between beams; rounded so that a full turn is a whole number of beams.
        range_min, range_max: [m] points outside are left out.

    Returns:
        A scan of a full turn from -pi on: +inf in observed directions without a hit, nan in unobserved ones.
    """
    count = round(math.tau / step)
    ranges = np.full(count, np.nan)
    ranges[_beams(misses, count)] = np.inf
    distances = np.hypot(hits[:, 0], hits[:, 1])
    usable = (distances >= max(range_min, 1e-3)) & (distances <= range_max)  # false for nan
    beams = _beams(hits[usable], count)
    nearest = np.full(count, np.inf)
    np.minimum.at(nearest, beams, distances[usable])
    ranges[beams] = nearest[beams]
    single: Float32Array = ranges.astype(np.float32)
    return Scan(
        stamp_ns=stamp_ns,
        ranges=single,
        angle_min=-math.pi,
        angle_step=math.tau / count,
        time_step=0.0,
        range_min=range_min,
        range_max=range_max,
    )


def _beams(points: FloatArray, count: int) -> np.ndarray:
    """Return the index of the beam towards each point, of `count` beams in a full turn from -pi on."""
    turns = np.arctan2(points[:, 1], points[:, 0]) / math.tau + 0.5
    return np.rint(turns * count).astype(np.int64) % count


def count_silent_scans(scans: Sequence[Scan]) -> int:
    """Return the number of scans without a single distance."""
    return sum(not (np.isfinite(scan.ranges) & (scan.ranges > 0.0)).any() for scan in scans)
