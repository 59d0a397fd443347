"""Check of the lidar mount: do scans and odometry show the same motion, and if not, which mount would make them agree?

With the assumed mount B and the true mount T, a motion M of the base by odometry appears in the matched scans as
C M C^-1 with C = B T^-1 (the equation of hand-eye calibration, Shiu and Ahmad 1989, in the plane). Its translation is
linear in the direction and the lever arm of C, so C follows from all motions by least squares.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.geometry import pose_from_array
from waychair.recordings.scans import UPSIDE_DOWN, LaserMount, text_from_mount
from waychair.types import FloatArray, Odometry, Pose2, SensorFrame

MIN_MOTIONS = 20
MIN_DISTANCE, MIN_TURN = 2.0, math.pi
"""Least distance driven [m] and turning [rad] that tell about a mount."""

_STEP, _STEP_TURN = 0.3, 0.3  # [m], [rad]; least motion that is compared
_LARGEST_YAW, _LARGEST_LEVER = math.radians(6.0), 0.15  # [rad], [m]; odometry alone may be wrong by so much
_LARGEST_SCALE = 0.2
_LEAST_DEVIATIONS = 4.0  # sigma; a larger disagreement is significant
_LEAST_TURN_RATIO = 0.3
_LEAST_TURNS, _EXPLAINED = 8, 0.5  # motions that tell about a lever, and share of the disagreement that may remain
_NOISE = 0.02  # [m]; smaller residuals have equal weight
_ROUNDS = 10


@dataclass(frozen=True, slots=True)
class MountCheck:
    """How the motion by scans differs from the motion by odometry.

    `yaw` [rad] is the difference in direction, `lever` [m] the position error of the mount by the turns, and
    `deviations` the larger of the two in standard deviations of its estimate. `scale` is the matched distance over the
    odometry's, `turn_ratio` the same for turns (nan without turning). `residual_before` and `residual_after` [m] are the
    median disagreement of a motion at the assumed mount and at `base_from_laser`, the mount that fits best.
    """

    yaw: float
    lever: float
    deviations: float
    scale: float
    turn_ratio: float
    residual_before: float
    residual_after: float
    base_from_laser: Pose2
    turns: int = 0
    """Motions with a turn in them, which tell about the lever."""
    turn_residual_before: float = 0.0
    turn_residual_after: float = 0.0

    def lever_is_clear(self) -> bool:
        """Whether the better lever explains most of the disagreement in turns; wheels that slip sideways look alike."""
        return self.turns >= _LEAST_TURNS and self.turn_residual_after < _EXPLAINED * self.turn_residual_before


def check_mount(odometry: FloatArray, matched: FloatArray, base_from_laser: Pose2) -> MountCheck | None:
    """Compare motions of the base (N, 3) by odometry and by scans matched with this mount; None for too few motions."""
    distance, turning = float(np.hypot(*odometry[:, :2].T).sum()), float(np.abs(odometry[:, 2]).sum())
    if len(odometry) < MIN_MOTIONS or distance < MIN_DISTANCE:
        return None
    turned = turning >= MIN_TURN
    x, y, theta = odometry.T
    one, zero = np.ones_like(x), np.zeros_like(x)
    lever = [[1.0 - np.cos(theta), np.sin(theta)], [-np.sin(theta), 1.0 - np.cos(theta)]] if turned else [[], []]
    rows = np.stack([np.stack([x, -y, *lever[0]], axis=1), np.stack([y, x, *lever[1]], axis=1)], axis=1)
    told = matched[:, :2]
    # least absolute deviations by reweighting: slips and false matches are outliers
    weights, solution = one, zero
    for _ in range(_ROUNDS):
        root = np.sqrt(weights)[:, None]
        solution = np.linalg.lstsq((rows * root[..., None]).reshape(2 * len(x), -1), (told * root).ravel(), rcond=None)[
            0
        ]
        away = np.hypot(*(told - rows @ solution).T)
        weights = 1.0 / np.maximum(away, _NOISE)
    yaw = math.atan2(solution[1], solution[0])
    arm = solution[2:] if turned else np.zeros(2)
    scale = math.hypot(solution[0], solution[1])
    spread = 1.48 * np.median(away)  # approximate standard deviation of normal residuals in two dimensions
    sigmas = spread * np.sqrt(np.diag(np.linalg.inv(np.einsum("nij,nik->jk", rows, rows))))
    deviations = np.abs([yaw * scale, *solution[2:]]) / sigmas[1:]
    correction = Pose2(float(arm[0]), float(arm[1]), yaw)
    bent = np.abs(theta) >= _STEP_TURN
    off = np.hypot(*(told - odometry[:, :2])[bent].T) if bent.any() else np.zeros(1)
    return MountCheck(
        yaw=yaw,
        lever=float(np.hypot(*arm)),
        deviations=float(deviations.max()),
        scale=scale,
        turn_ratio=float((matched[:, 2] * theta).sum() / (theta * theta).sum()) if turned else math.nan,
        residual_before=float(np.median(np.hypot(*(told - odometry[:, :2]).T))),
        residual_after=float(np.median(away)),
        base_from_laser=correction.inverse() @ base_from_laser,
        turns=int(bent.sum()),
        turn_residual_before=float(np.median(off)),
        turn_residual_after=float(np.median(away[bent])) if bent.any() else 0.0,
    )


def mount_warnings(frames: Sequence[SensorFrame], poses: FloatArray, base_from_laser: Pose2) -> tuple[str, ...]:
    """Return warnings about the mount, one sentence each, from frames with odometry and their mapped poses (N, 3)."""
    pairs = [
        (own[-1].odom_from_base, pose_from_array(pose))
        for frame, pose in zip(frames, poses, strict=True)
        if (own := [reading for reading in frame.wheels if isinstance(reading, Odometry)])
    ]
    check = check_mount(*_motions(pairs), base_from_laser)
    if check is None:
        return ()
    if check.turn_ratio < -_LEAST_TURN_RATIO:
        turning = f"the scans turn against the odometry (by {check.turn_ratio:.2f} times its turn)"
        return (f"{turning}: if the laser is mounted {UPSIDE_DOWN}, give --base-from-laser X,Y,YAW,{UPSIDE_DOWN}",)
    if abs(check.scale - 1.0) > _LARGEST_SCALE:
        return (f"the scans measure {check.scale:.2f} times the odometry's distance: check the wheel radius",)
    off = abs(check.yaw) > _LARGEST_YAW or (check.lever > _LARGEST_LEVER and check.lever_is_clear())
    if not off or check.deviations < _LEAST_DEVIATIONS:
        return ()
    better = text_from_mount(LaserMount(check.base_from_laser))
    off_by = f"{math.degrees(check.yaw):.0f} degrees in the direction of travel and by {check.lever:.2f} m in turns"
    advice = f"is the laser's mount right? They agree best with --base-from-laser {better}"
    return (f"the scans disagree with the odometry by {off_by}: {advice}",)


def _motions(pairs: Sequence[tuple[Pose2, Pose2]]) -> tuple[FloatArray, FloatArray]:
    """Return motions (N, 3) by odometry and as mapped, between poses some distance apart."""
    odometry, mapped = [], []
    last = pairs[0] if pairs else (Pose2(), Pose2())
    for pair in pairs:
        step = last[0].inverse() @ pair[0]
        if math.hypot(step.x, step.y) < _STEP and abs(step.theta) < _STEP_TURN:
            continue
        odometry.append(step.array())
        mapped.append((last[1].inverse() @ pair[1]).array())
        last = pair
    return np.array(odometry).reshape(-1, 3), np.array(mapped).reshape(-1, 3)
