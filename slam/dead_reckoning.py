"""What wheels and IMU make of a frame before it is mapped: where the chair is by them, and the scan seen upright."""

from __future__ import annotations

from dataclasses import replace

from waychair.calibration.chair import ChairBody
from waychair.slam.odometry import OdometryFilter
from waychair.slam.odometry_model import OdometrySettings
from waychair.slam.tilt import Tilt, TiltFilter, levelled
from waychair.types import ImuSample, Odometry, SensorFrame, WheelTicks


class DeadReckoning:
    """Frames in, in the order of the recording; each comes out with one `Odometry` at its own stamp.

    Readings are fused from the first sample of an IMU, or the first counts of encoders, on. A recording of odometry
    alone passes as it is: whoever recorded it had no more to go by than the wheels, and neither would the filter.
    """

    def __init__(self, body: ChairBody, settings: OdometrySettings | None = None) -> None:
        self._body, self._settings = body, settings
        self._tilt = TiltFilter(body)
        self._filter: OdometryFilter | None = None

    @property
    def tilt(self) -> Tilt | None:
        """How the chair leans at the latest sample of the IMU; None before the first."""
        return self._tilt.tilt

    def update(self, frame: SensorFrame) -> SensorFrame:
        """The frame with its odometry, and with its scan levelled where the chair leans."""
        if self._filter is None:
            if not frame.imu and not any(isinstance(reading, WheelTicks) for reading in frame.wheels):
                return frame
            self._filter = OdometryFilter(self._body, self._settings)
        readings: list[WheelTicks | Odometry | ImuSample] = sorted(
            [*frame.imu, *frame.wheels], key=lambda reading: reading.stamp_ns
        )
        for reading in readings:
            if isinstance(reading, ImuSample):
                odometry = self._filter.update_imu(reading)
                self._tilt.update(reading, odometry.twist)
            else:
                self._filter.update_wheels(reading)
        tilt, scan = self._tilt.tilt, frame.scan
        if scan is not None and tilt is not None:
            scan = levelled(scan, self._body, tilt)
        return replace(frame, scan=scan, wheels=(self._filter.predict(frame.stamp_ns),))
