"""The frame with which a map begins: the last scan before the chair first moves.

Earlier scans add nothing, but a map that begins with another scan differs by one to three centimetres (measured on a
drive of 50 m). With this rule, recordings of one drive that were started earlier or later give the same map.
"""

from __future__ import annotations

from collections.abc import Sequence

from waychair.types import Odometry, SensorFrame

_V, _OMEGA = 0.02, 0.05
"""Thresholds of motion [m/s, rad/s], above the noise of encoders and gyro at rest."""


def rests(frame: SensorFrame) -> bool:
    """Whether wheels and IMU say that the chair stands; False for a frame without an IMU."""
    return bool(frame.imu) and _stands(frame)


def start_index(frames: Sequence[SensorFrame]) -> int:
    """Return the index of the last frame with a scan before the chair first moves.

    0 where it never moves, moves from the start, or has no IMU. A recorder finds topics one after the other: until the
    first IMU message the wheels alone decide.
    """
    before, felt = 0, False
    for index, frame in enumerate(frames):
        felt = felt or bool(frame.imu)
        if not (rests(frame) if felt else _stands(frame)):
            return before if felt else 0
        if frame.scan is not None:
            before = index
    return 0


def _stands(frame: SensorFrame) -> bool:
    """Whether no odometry of the frame says that the chair moves."""
    readings = [reading for reading in frame.wheels if isinstance(reading, Odometry)]
    if len(readings) < len(frame.wheels):
        return False
    return all(abs(reading.twist.v) <= _V and abs(reading.twist.omega) <= _OMEGA for reading in readings)
