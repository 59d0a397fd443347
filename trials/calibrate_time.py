"""Find the delays of a chair's lidar, encoders and camera against its gyro, from a drive that turns left and right."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.time_offset import (
    Heading,
    SensorDelays,
    TimeOffset,
    heading_from_gyro,
    time_offset,
)
from waychair.errors import CalibrationError, ThinData
from waychair.simulation.plant.plant import volts_from_twist
from waychair.simulation.simulator import SensorMessage, Simulator
from waychair.trials.headings import CameraHeading, heading_from_scans, heading_from_wheels
from waychair.trials.simulated_drive import hold_lines
from waychair.types import ImuSample, Odometry, RgbdFrame, Scan, Twist, WheelTicks

LIDAR, WHEELS, CAMERA = "lidar", "wheels", "camera"
TIME_HALL = 6.0
"""Side [m] of a hall in which a chair can turn and the camera gets depth from the walls."""

_TURN_RATES = (0.4, 0.8)  # [rad/s]
_HOLDS = (0.5, 1.2)  # [s]


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


def turns_to_and_fro(simulator: Simulator, seconds: float, seed: int = 0) -> Iterator[SensorMessage]:
    """Yield the messages of a chair that rests for a second, then turns left and right at irregular intervals.

    Raises:
        WorldError: the chair touched something.
    """
    rng = np.random.default_rng(seed)
    plant, track = simulator.settings.plant, simulator.body.track
    neutral = volts_from_twist(plant, track, Twist())
    until_ns, side = simulator.now_ns + round(seconds * 1e9), 1.0
    yield from hold_lines(simulator, *neutral, 1.0)
    while simulator.now_ns < until_ns:
        rate = side * float(rng.uniform(*_TURN_RATES))
        yield from hold_lines(simulator, *volts_from_twist(plant, track, Twist(0.0, rate)), float(rng.uniform(*_HOLDS)))
        side = -side
    yield from hold_lines(simulator, *neutral, 1.0)


def milliseconds(offset: TimeOffset) -> str:
    """Return a delay as text, in milliseconds with its standard deviation."""
    return f"{1e-6 * offset.delay_ns:+.1f} ms (+- {max(1e-6 * offset.sigma_ns, 0.1):.1f})"
