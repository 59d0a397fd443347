"""Frames of a simulated drive: each scan with the wheel and IMU messages since the scan before."""

from __future__ import annotations

from waychair.types import ImuSample, Scan, SensorFrame, SensorMessage, WheelTicks


class FrameGathering:
    """Collects the messages since the last scan."""

    def __init__(self) -> None:
        self._wheels: list[WheelTicks] = []
        self._imu: list[ImuSample] = []

    def add(self, message: SensorMessage) -> SensorFrame | None:
        """Add a message; return the frame that it completes, or None."""
        if isinstance(message, WheelTicks):
            self._wheels.append(message)
        elif isinstance(message, ImuSample):
            self._imu.append(message)
        elif isinstance(message, Scan):
            frame = SensorFrame(message.stamp_ns, message, wheels=tuple(self._wheels), imu=tuple(self._imu))
            self._wheels, self._imu = [], []
            return frame
        return None
