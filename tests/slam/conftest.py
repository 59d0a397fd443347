"""A synthetic flat: walls as segments, scans by exact ray casting, and a drive through it with poor odometry."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.types import FloatArray, Odometry, Pose2, Scan, SensorFrame

WALLS = np.array(
    [
        [0, 0, 12, 0], [12, 0, 12, 9], [12, 9, 0, 9], [0, 9, 0, 0],  # outer walls
        [3, 3, 9, 3], [9, 3, 9, 6], [9, 6, 3, 6], [3, 6, 3, 3],  # a block to drive round
        [0, 4, 1, 4], [5, 0, 5, 0.7], [12, 2, 11.2, 2.5], [7, 9, 7.5, 8.2], [2, 8, 2.6, 9],  # things on the way
    ],
    float,
)  # fmt: skip


def cast(walls: FloatArray, pose: Pose2, angles: FloatArray) -> FloatArray:
    """Ranges from a pose to the nearest wall along each angle; inf without a wall."""
    ranges = np.full(len(angles), np.inf)
    for i, angle in enumerate(angles + pose.theta):
        direction = np.array([math.cos(angle), math.sin(angle)])
        for x0, y0, x1, y1 in walls:
            wall = np.array([x1 - x0, y1 - y0])
            cross = direction[0] * wall[1] - direction[1] * wall[0]
            if abs(cross) < 1e-12:
                continue
            offset = np.array([x0 - pose.x, y0 - pose.y])
            along = (offset[0] * wall[1] - offset[1] * wall[0]) / cross
            share = (offset[0] * direction[1] - offset[1] * direction[0]) / cross
            if along > 0 and 0 <= share <= 1:
                ranges[i] = min(ranges[i], along)
    return ranges


def scan_at(pose: Pose2, stamp_ns: int = 0, beams: int = 181, noise: float = 0.0, seed: int = 0) -> Scan:
    """A 180 degree scan of the flat."""
    angles = np.linspace(-math.pi / 2, math.pi / 2, beams)
    ranges = cast(WALLS, pose, angles)
    ranges += noise * np.random.default_rng(seed).standard_normal(beams)
    return Scan(stamp_ns, ranges.astype(np.float32), -math.pi / 2, math.pi / (beams - 1), range_max=30.0)


@pytest.fixture(scope="session")
def drive() -> tuple[list[SensorFrame], FloatArray]:
    """Frames of two laps round the block, with odometry that drifts, and the true poses (N, 3)."""
    corners = [(1.5, 1.5), (10.5, 1.5), (10.5, 7.5), (1.5, 7.5)]
    truth: list[Pose2] = []
    heading = 0.0
    for lap in range(2):
        for k in range(4):
            (x0, y0), (x1, y1) = corners[k], corners[(k + 1) % 4]
            towards = math.atan2(y1 - y0, x1 - x0)
            turn = math.remainder(towards - heading, math.tau)
            if lap or k:
                truth += [Pose2(x0, y0, heading + turn * share) for share in np.linspace(0.1, 1.0, 10)]
            heading = towards
            steps = round(math.hypot(x1 - x0, y1 - y0) / 0.1)
            truth += [Pose2(x0 + (x1 - x0) * i / steps, y0 + (y1 - y0) * i / steps, heading) for i in range(steps)]
    rng = np.random.default_rng(1)
    frames, odometry = [], Pose2()
    for k, pose in enumerate(truth):
        if k:
            step = truth[k - 1].inverse() @ pose
            slip = rng.standard_normal(2)
            odometry = odometry @ Pose2(step.x * 1.03, step.y, step.theta * 1.05 + 0.002 + 0.004 * slip[0])
        stamp = k * 100_000_000
        frames.append(SensorFrame(stamp, scan_at(pose, stamp, noise=0.01, seed=k), wheels=(Odometry(stamp, odometry),)))
    return frames, np.array([pose.array() for pose in truth])
