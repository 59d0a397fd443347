"""Dead reckoning for mapping: wheels and IMU give each sensor frame its odometry, and level its scan."""

from __future__ import annotations

from dataclasses import replace

from waychair.calibration.chair_body import ChairBody
from waychair.slam.odometry.odometry_filter import OdometryFilter
from waychair.slam.odometry.odometry_model import OdometrySettings
from waychair.slam.odometry.tilt import Tilt, TiltFilter, levelled
from waychair.types import ImuSample, Odometry, SensorFrame, WheelTicks


class DeadReckoning:
    """Adds to each frame, in the order of the recording, one `Odometry` at the frame's stamp.

    Fusion starts with the first IMU sample or the first encoder counts. A recording that holds only `Odometry` passes
    unchanged, because the filter would have no further information.
    """

    def __init__(self, body: ChairBody, settings: OdometrySettings | None = None) -> None:
        self._body, self._settings = body, settings
        self._tilt = TiltFilter(body)
        self._filter: OdometryFilter | None = None

    @property
    def tilt(self) -> Tilt | None:
        """Tilt at the latest IMU sample; None before the first."""
        return self._tilt.tilt

    def update(self, frame: SensorFrame) -> SensorFrame:
        """Return the frame with its odometry, and with its scan levelled where the chair tilts."""
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
