"""Check of wheel odometry within itself: a chair drives along its heading, so its track turns as its headings do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from waychair.slam.odometry.aid_evidence import ENOUGH_TURN, GOOD, LEAST_CORRELATION, Evidence
from waychair.slam.odometry.aid_findings import AidPart, AidState, Cause
from waychair.slam.odometry.aid_series import ImuSeries, WheelSeries, correlation
from waychair.slam.odometry.aid_windows import turn_agreement
from waychair.slam.odometry.imu_check import up_axis
from waychair.types import FloatArray

_STEP = 0.2  # m; of the track whose direction is compared: noise of positions turns it by a degree or less
_LEAST_STEPS = 10
_AGREED = 0.6  # length of the mean of unit vectors from which angles agree
_CLEAR = 0.6  # share of that length up to which those of the other sign do not agree


def with_true_headings(
    evidence: Evidence, wheels: WheelSeries, told: FloatArray, imu: ImuSeries | None
) -> WheelSeries:  # fmt: skip
    """Return the odometry with headings that turn as its track does, and note it where they turned the other way.

    `told` (N, 3) are its motions. Headings are corrected if both the track and the scans turn against them, and no gyro
    turns with them: a lidar that hangs upside down and exchanged wheels leave track and headings in agreement.
    """
    against = evidence.turn(told[:, 2])
    if against.evidence < ENOUGH_TURN or against.share < 0.5:
        return wheels
    if correlation(told[:, 2], evidence.turns, evidence.known_turn) >= -LEAST_CORRELATION:
        return wheels
    if not track_turns_against_headings(wheels.poses) or _gyro_agrees(evidence, told[:, 2], imu):
        return wheels
    evidence.add(AidPart.WHEEL_TURN, AidState.CORRECTED, Cause.MIRRORED_HEADINGS, None, value=-1.0)
    by_twist = wheels.driven(evidence.scans.intervals)[:, 2]
    speeds = wheels.speeds
    if correlation(by_twist, evidence.turns, evidence.known_turn) < -LEAST_CORRELATION:
        speeds = speeds * (1.0, -1.0)
    return replace(wheels, poses=wheels.poses * (1.0, 1.0, -1.0), speeds=speeds)


def track_turns_against_headings(poses: FloatArray) -> bool:
    """Return whether the track of poses (M, 3) [m, m, rad] turns to the right where the headings turn left, and the reverse.

    The direction of travel keeps its angle to the headings of a chair that drives along them, and to the mirrored ones if
    they are mirrored. Twice the angle is the same forward and backward, but does not tell right angles apart. A track with
    few turns tells nothing, nor does a chair that drives in all directions.
    """
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    at = np.unique(np.searchsorted(along, np.arange(0.0, along[-1], _STEP)))
    track = np.column_stack([poses[at, :2], np.unwrap(poses[:, 2])[at]])
    if len(track) < _LEAST_STEPS:
        return False
    way = np.diff(track[:, :2], axis=0) @ (1.0, 1j)
    heading = 0.5 * (track[1:, 2] + track[:-1, 2])
    length, direction = np.abs(way), np.angle(way)
    length = np.minimum(length, 2.0 * float(np.median(length)))  # a wild step must not decide
    found = []
    for times in (1.0, 2.0):
        as_told, as_mirrored = (
            abs((length * np.exp(1j * times * (direction - sign * heading))).sum()) / length.sum()
            for sign in (1.0, -1.0)
        )
        if max(as_told, as_mirrored) >= _AGREED and min(as_told, as_mirrored) <= _CLEAR * max(as_told, as_mirrored):
            found.append(as_mirrored > as_told)
    return bool(found) and all(found)


def _gyro_agrees(evidence: Evidence, turns: FloatArray, imu: ImuSeries | None) -> bool:
    """Return whether a gyro, with gravity as its up, turns as headings (N,) do."""
    if imu is None or not np.abs(imu.gyro).max(initial=0.0) > 0.0:
        return False
    gyro = imu.turns(evidence.scans.intervals, up_axis(imu))
    both = evidence.known_turn & np.isfinite(gyro) & np.isfinite(turns)
    agreed = turn_agreement(evidence.spans, gyro, np.nan_to_num(turns), both)
    return bool(agreed.evidence > ENOUGH_TURN and agreed.share < GOOD)
