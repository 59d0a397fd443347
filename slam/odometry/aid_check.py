"""Check of the aids of a drive before they are believed: wheels, twist, gyro and gravity against the scans and each other.

Each aid is compared over all turns and ways of the recording. An aid that agrees as it is, is believed. One that agrees
after a correction of a known kind (unit, sign, axis, bias, delay) is corrected. Any other is left out, from the time on at
which it ceases to agree. Two independent aids that agree with each other outvote the third, be it the lidar.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from waychair.slam.odometry.aid_evidence import ENOUGH_TURN, GOOD, LEAST_CORRELATION, Evidence
from waychair.slam.odometry.aid_findings import AidFinding, AidPart, AidState, Cause
from waychair.slam.odometry.aid_series import ImuSeries, ScanSeries, WheelSeries, correlation, robust_slope
from waychair.slam.odometry.aid_windows import turn_agreement, windows
from waychair.slam.odometry.force_check import ForceUse, check_force, shows_false_slips
from waychair.slam.odometry.heading_check import with_true_headings
from waychair.slam.odometry.imu_check import GyroUse, check_gyro, gyro_turns, up_axis
from waychair.slam.odometry.wheel_check import check_wheels, speeds_are_wrong
from waychair.types import FloatArray

_KNOWN_SHARE = 0.4  # least share of intervals that the scans must have measured


@dataclass(frozen=True, slots=True)
class AidCheck:
    """The findings, and the motions to use.

    `wheels` (N, 3), half way through the turn, are the motions of wheel odometry that is corrected or replaced; None where
    it is used as told. `gyro` are the uses of the gyro that differ from the told one, and `force` that of the
    accelerometer.
    """

    findings: tuple[AidFinding, ...] = ()
    wheels: FloatArray | None = None
    gyro: tuple[GyroUse, ...] = ()
    force: ForceUse = field(default_factory=ForceUse)
    wheels_by_scans: float = 0.0
    """Share of the motion that comes from scans in place of the wheels."""
    speeds: FloatArray | None = None
    """Motions (N, 3) from which the twists of the odometry are to be taken; None where they hold as told."""


def check_aids(scans: ScanSeries, wheels: WheelSeries | None, imu: ImuSeries | None) -> AidCheck:
    """Return the findings about the aids of a drive, and the motions to use in their place."""
    if scans.compared.sum() < 5 or scans.turn_known[scans.compared].mean() < _KNOWN_SHARE:
        return AidCheck()
    told = None if wheels is None else wheels.motions(scans.intervals)
    ways = np.hypot(*scans.motions[:, :2].T)
    spans = windows(scans.intervals, scans.motions[:, 2], ways)
    evidence = Evidence(scans, spans, scans.turn_known, scans.way_known)
    wheels_as_told = wheels
    if wheels is not None and told is not None:
        wheels = with_true_headings(evidence, wheels, told, imu)
        told = wheels.motions(scans.intervals)
    if told is not None and _lidar_is_wrong(evidence, wheels, told, imu):
        return AidCheck(tuple(evidence.findings))
    force = check_force(evidence, imu)
    gyro = () if imu is None else check_gyro(evidence, imu)
    if any(use.axis is None and use.begin_s == -np.inf and use.end_s == np.inf for use in gyro):
        evidence.findings = [found for found in evidence.findings if found.part is not AidPart.GRAVITY]
    turned = None if imu is None else gyro_turns(imu, scans.intervals, gyro)
    if wheels is None or told is None:
        return AidCheck(tuple(evidence.findings), gyro=gyro, force=force)
    used, by_scans = check_wheels(evidence, wheels, told, turned)
    if used is None and wheels is not wheels_as_told:
        used = told
    driven = wheels.driven(scans.intervals)
    motions = told if used is None else used
    if imu is not None and force.scale and shows_false_slips(evidence, imu, force, wheels, motions):
        force = ForceUse(0.0)
    wrong = used is None and speeds_are_wrong(evidence, told, driven)
    return AidCheck(tuple(evidence.findings), used, gyro, force, by_scans, told if wrong else None)


def _lidar_is_wrong(evidence: Evidence, wheels: WheelSeries | None, told: FloatArray, imu: ImuSeries | None) -> bool:
    """Note that the scans turn otherwise than wheels and gyro, or than wheels alone if they turn just the other way."""
    assert wheels is not None
    wheel_turns = told[:, 2]
    against = evidence.turn(wheel_turns)
    if against.evidence < ENOUGH_TURN or against.share < 0.5:
        return False
    mirrored = correlation(wheel_turns, evidence.turns, evidence.known_turn) < -LEAST_CORRELATION
    driven = wheels.driven(evidence.scans.intervals)[:, 2]
    if imu is not None and np.abs(imu.gyro).max(initial=0.0) > 0.0:
        gyro = imu.turns(evidence.scans.intervals, up_axis(imu))
        both = evidence.known_turn & np.isfinite(gyro) & np.isfinite(wheel_turns)
        agreed = turn_agreement(evidence.spans, gyro, np.nan_to_num(wheel_turns), both)
        moved = np.abs(wheel_turns[both]).sum() > ENOUGH_TURN
        if not (moved and agreed.share < GOOD and agreed.evidence > ENOUGH_TURN):
            return False
        factor, _ = robust_slope(evidence.turns[both], wheel_turns[both])
        cause = Cause.MIRRORED if mirrored else Cause.SCALE
        evidence.add(
            AidPart.LIDAR, AidState.CORRECTED if mirrored else AidState.LEFT_OUT, cause, None, value=float(factor[0])
        )
        return True
    by_twist = correlation(driven, evidence.turns, evidence.known_turn)
    if mirrored and by_twist < 0.5:
        evidence.add(AidPart.LIDAR, AidState.CORRECTED, Cause.MIRRORED_OR_WHEELS, None, value=-1.0)
        return True
    return False
