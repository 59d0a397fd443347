"""Drives through very large buildings, made of one recorded drive: there and back, then through further wings.

A wing is the recorded building again, mirrored and scaled by its number so that no two wings are alike, and laid beside the
earlier ones. Between two wings the chair crosses an open yard in which its lidar sees nothing.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from waychair.files import write_bytes
from waychair.geometry import compose, invert, pose_from_array
from waychair.recordings.recording import Recording
from waychair.recordings.scans import mirrored
from waychair.slam.mapping.tracking import odometry_of
from waychair.types import Float32Array, FloatArray, Odometry, Scan, SensorFrame

SPEED, TURN_SPEED = 0.5, 0.5  # m/s, rad/s; at which the drive is timed
_SCALES = (1.0, 1.12, 0.9, 1.25, 0.8)  # of the wings, each also mirrored
_YARDS = (10.0, 20.0, 40.0, 80.0, 160.0)  # m; the shortest that leads to a free place is taken
_YARD_STEP, _YARD_TURN = 0.5, 0.2  # m, rad; between two scans in a yard
_CLEAR = 20.0  # m; between the drives through two wings
_HEADINGS = 16  # in which a yard may lead
_SPACING = 2.0  # m; between the points of a drive that are compared
_NOTHING = 81.83  # m; written for a beam without an echo


@dataclass(frozen=True, slots=True)
class _Wing:
    """The scans of one wing, and the pose (N, 3) [m, m, rad] of each relative to the first."""

    scans: tuple[Scan, ...]
    poses: FloatArray


def long_drive(recording: Recording) -> Iterator[SensorFrame]:
    """Yield the frames of an endless drive: through a recorded building and back, then through wing after wing.

    The recording's odometry is the truth of the drive; stamps follow from the way at an even speed.
    """
    stamp_ns, here = 0, np.zeros(3)
    known = np.empty((0, 2))
    for number in itertools.count():
        wing = _wing(recording, number)
        yard, start = _free_place(wing, here, known) if number else (np.empty((0, 3)), here)
        inside = compose(start, wing.poses)
        blind = np.full_like(wing.scans[0].ranges, np.inf)
        silent = [_with_ranges(wing.scans[0], blind)] * len(yard)
        scans = [*silent, *wing.scans, *wing.scans[-2::-1]]
        for scan, pose in zip(scans, np.concatenate([yard, inside, inside[-2::-1]]), strict=True):
            stamp_ns += round(1e9 * max(0.05, _seconds(here, pose)))
            here = pose
            yield _frame(stamp_ns, scan, pose)
        known = np.concatenate([known, _thinned(inside[:, :2])])


def write_log(path: Path, frames: Iterator[SensorFrame] | list[SensorFrame]) -> None:
    """Write frames as a CARMEN log whose laser is the base."""
    lines = []
    for frame in frames:
        scan, own = frame.scan, odometry_of(frame)
        assert scan is not None
        assert own is not None
        count, pose, stamp = len(scan.ranges), own.odom_from_base, f"{frame.stamp_ns * 1e-9:.6f}"
        ranges = " ".join(f"{reach:.3f}" for reach in np.where(np.isfinite(scan.ranges), scan.ranges, _NOTHING))
        at = f"{pose.x:.4f} {pose.y:.4f} {pose.theta:.5f}"
        fov = scan.angle_step * (count - 1)
        lines.append(
            f"ROBOTLASER1 0 {scan.angle_min:.8f} {fov:.8f} {scan.angle_step:.10f} 80.0 0.01 0 {count} {ranges} 0 "
            f"{at} {at} 0 0 0 0 0 {stamp} chair {stamp}"
        )
    write_bytes(path, ("\n".join(lines) + "\n").encode())


def _wing(recording: Recording, number: int) -> _Wing:
    """Return a wing: the recorded building, scaled, and mirrored if the number is odd."""
    scale, turned = _SCALES[number // 2 % len(_SCALES)], number % 2 == 1
    scans, poses = [], []
    for frame in recording.frames:
        own = odometry_of(frame)
        if frame.scan is None or own is None:
            continue
        scan = mirrored(frame.scan) if turned else frame.scan
        scans.append(_with_ranges(scan, (scan.ranges * np.float32(scale)).astype(np.float32)))
        poses.append(own.odom_from_base.array())
    relative = compose(invert(poses[0]), np.array(poses))
    relative[:, :2] *= scale
    if turned:
        relative[:, 1:] *= -1.0
    return _Wing(tuple(scans), relative)


def _with_ranges(scan: Scan, ranges: Float32Array) -> Scan:
    return Scan(0, ranges, scan.angle_min, scan.angle_step, range_min=scan.range_min, range_max=scan.range_max)


def _free_place(wing: _Wing, here: FloatArray, known: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the poses (K, 3) of the way through a yard, and the first pose (3,) of the wing beyond it."""
    own, best, widest = _thinned(wing.poses[:, :2]), (0.0, _YARDS[0]), -1.0
    for length in _YARDS:
        for heading in np.linspace(-math.pi, math.pi, _HEADINGS, endpoint=False).tolist():
            start = _beyond(here, heading, length)
            laid = compose(start, np.column_stack([own, np.zeros(len(own))]))[:, :2]
            clear = float(np.hypot(*(laid[:, None] - known[None]).transpose(2, 0, 1)).min())
            if clear > widest:
                best, widest = (heading, length), clear
        if widest >= min(_CLEAR, 0.8 * length):
            break
    heading, length = best
    turn = np.outer(np.arange(1, int(abs(heading) / _YARD_TURN) + 1), (0.0, 0.0, math.copysign(_YARD_TURN, heading)))
    along = np.outer(np.arange(_YARD_STEP, length, _YARD_STEP), (1.0, 0.0, 0.0))
    way = compose(compose(here, np.array([0.0, 0.0, heading])), along)
    return np.concatenate([compose(here, turn), way]), _beyond(here, heading, length)


def _beyond(here: FloatArray, heading: float, length: float) -> FloatArray:
    """Return the pose (3,) after a turn and a straight way."""
    return compose(compose(here, np.array([0.0, 0.0, heading])), np.array([length, 0.0, 0.0]))


def _thinned(points: FloatArray) -> FloatArray:
    """Return one of the points (N, 2) [m] of each square."""
    _, first = np.unique(np.floor(points / _SPACING).astype(np.int64), axis=0, return_index=True)
    return points[first]


def _seconds(a: FloatArray, b: FloatArray) -> float:
    step = pose_from_array(a).inverse() @ pose_from_array(b)
    return math.hypot(step.x, step.y) / SPEED + abs(step.theta) / TURN_SPEED


def _frame(stamp_ns: int, scan: Scan, pose: FloatArray) -> SensorFrame:
    seen = Scan(
        stamp_ns, scan.ranges, scan.angle_min, scan.angle_step, range_min=scan.range_min, range_max=scan.range_max
    )
    return SensorFrame(stamp_ns, seen, wheels=(Odometry(stamp_ns, pose_from_array(pose)),))
