"""Where a map begins: with the last scan before the chair first moves.

What it saw before tells nothing more, but a map that begins with another scan is another one by a centimetre or three
(measured, on a drive of 50 m): so whoever looks on from earlier or later on makes the same map of the same drive.
"""

from __future__ import annotations

from collections.abc import Sequence

from waychair.types import Odometry, SensorFrame

_V, _OMEGA = 0.02, 0.05
"""Above the noise of a gyro and of encoders at rest [m/s, rad/s]."""


def rests(frame: SensorFrame) -> bool:
    """Whether wheels and IMU say that the chair stands; a frame without them says nothing."""
    return bool(frame.imu) and _stands(frame)


def begins_at(frames: Sequence[SensorFrame]) -> int:
    """The last of the frames with a scan before the chair first moves; 0 where it never does, moves from the start on, or
    has no IMU.

    A recorder finds topics one after the other: while none of the IMU has come yet, the wheels' word is enough.
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
