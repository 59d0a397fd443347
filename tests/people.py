"""A person, as a lidar sees them."""

from __future__ import annotations

import math

import numpy as np

from waychair.types import FloatArray, Pose2

_TURNS = np.linspace(0.0, math.tau, 24, endpoint=False)
_BEARINGS = np.linspace(-math.pi, math.pi, 720)


def body(x: float, y: float) -> FloatArray:
    """Return (24, 2) points [m] on a circle of 0.15 m round the person."""
    return np.array([x, y]) + 0.15 * np.column_stack([np.cos(_TURNS), np.sin(_TURNS)])


def past(pose: Pose2, x: float, y: float, half: float, reach: float = 12.0) -> FloatArray:
    """Return (N, 2) [m] the free ends of beams from a pose that pass a person at x, y by more than `half` [rad]."""
    off = np.angle(np.exp(1j * (_BEARINGS - math.atan2(y - pose.y, x - pose.x))))
    free = _BEARINGS[np.abs(off) > half]
    return np.array([pose.x, pose.y]) + reach * np.column_stack([np.cos(free), np.sin(free)])


def half_view(pose: Pose2, x: float, y: float) -> float:
    """Return an angle [rad] of the half width of a person at x, y, and a little more."""
    return 0.18 / max(math.hypot(x - pose.x, y - pose.y), 0.3)
