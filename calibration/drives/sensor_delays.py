"""Find the delays of a chair's lidar, encoders and camera against its gyro, from a drive that turns left and right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.drives.headings import CameraHeading, heading_from_scans, heading_from_wheels
from waychair.calibration.fits.time_offset import Heading, SensorDelays, TimeOffset, heading_from_gyro, time_offset
from waychair.errors import CalibrationError, ThinData
from waychair.types import ImuSample, Odometry, RgbdFrame, Scan, SensorMessage, WheelTicks

LIDAR, WHEELS, CAMERA = "lidar", "wheels", "camera"


@dataclass(frozen=True, slots=True)
class TimeCalibration:
    """The delays (0 where none was found), the estimates behind them, and the reasons for the missing ones."""

    delays: SensorDelays
    offsets: dict[str, TimeOffset]
    problems: tuple[str, ...]


class TimeCalibrator:
    """Collects the sensors' messages of a drive with turns; of the pictures it keeps only the last."""

    def __init__(self, body: ChairBody) -> None:
        self._body = body
        self._samples: list[ImuSample] = []
        self._wheels: list[WheelTicks | Odometry] = []
        self._scans: list[Scan] = []
        self._camera = CameraHeading(body)

    def add(self, message: SensorMessage | Odometry) -> None:
        """Add a message; encoder counts are preferred to odometry."""
        if isinstance(message, ImuSample):
            self._samples.append(message)
        elif isinstance(message, WheelTicks | Odometry):
            self._wheels.append(message)
        elif isinstance(message, Scan):
            self._scans.append(message)
        elif isinstance(message, RgbdFrame):
            self._camera.add(message)

    def result(self) -> TimeCalibration:
        """Return the delay of each sensor that sent messages.

        Raises:
            ThinData: there is no gyro, or no other sensor.
            CalibrationError: no delay was found; the message gives the first sensor's reason.
        """
        gyro = heading_from_gyro(self._samples)
        seen: dict[str, Callable[[], TimeOffset]] = {}
        if self._scans:
            seen[LIDAR] = lambda: self._of_lidar(gyro)
        if self._wheels:
            seen[WHEELS] = lambda: self._of(heading_from_wheels(self._wheel_readings(), self._body), gyro, WHEELS)
        camera = self._camera.heading()
        if len(camera.stamps_ns):
            seen[CAMERA] = lambda: self._of(camera, gyro, CAMERA)
        if not seen:
            raise ThinData("the recording holds a gyro but no lidar, encoders or camera: record one of these, too")
        offsets, problems = {}, []
        for sensor, find in seen.items():
            try:
                offsets[sensor] = find()
            except CalibrationError as error:
                problems.append(str(error))
        if not offsets:
            raise CalibrationError(problems[0])
        delays = {f"{sensor}_ns": offset.delay_ns for sensor, offset in offsets.items()}
        return TimeCalibration(SensorDelays(**delays), offsets, tuple(problems))

    def _of(self, heading: Heading, gyro: Heading, sensor: str) -> TimeOffset:
        return time_offset(heading, gyro, sensor)

    def _of_lidar(self, gyro: Heading) -> TimeOffset:
        """Estimate the lidar's delay twice; the second pass deskews the scans with the delay of the first."""
        delay = 0
        for _ in range(2):
            heading = heading_from_scans(self._scans, gyro, self._body.base_from_laser, delay)
            found = self._of(heading, gyro, LIDAR)
            delay = found.delay_ns
        return found

    def _wheel_readings(self) -> list[WheelTicks | Odometry]:
        ticks: list[WheelTicks | Odometry] = [reading for reading in self._wheels if isinstance(reading, WheelTicks)]
        return ticks or self._wheels


def merged(known: SensorDelays | None, found: TimeCalibration) -> SensorDelays:
    """Return the known delays, updated with the new ones."""
    return replace(known or SensorDelays(), **{f"{sensor}_ns": o.delay_ns for sensor, o in found.offsets.items()})


def milliseconds(offset: TimeOffset) -> str:
    """Return a delay as text, in milliseconds with its standard deviation."""
    return f"{1e-6 * offset.delay_ns:+.1f} ms (+- {max(1e-6 * offset.sigma_ns, 0.1):.1f})"
