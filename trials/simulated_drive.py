"""A calibration drive of a simulated chair, with the speeds by its own sensors."""

from __future__ import annotations

import dataclasses

from waychair.calibration.drives.measured_speeds import STILL_S, SpeedMeter
from waychair.calibration.fits.sweep import Sample
from waychair.errors import WorldError
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.topics import COMMAND, IMU
from waychair.types import SensorMessage

TICK_NS = round(1e9 / COMMAND.rate_hz)
"""Commands last for whole numbers of ticks."""


def with_few_beams(settings: SimulatorSettings) -> SimulatorSettings:
    """Return the settings with a lidar of two beams, as scans are most of the simulator's work."""
    return dataclasses.replace(settings, lidar=dataclasses.replace(settings.lidar, beams=2))


def with_gyro(settings: SimulatorSettings) -> SimulatorSettings:
    """Return the settings with the IMU switched on."""
    return dataclasses.replace(settings, imu=dataclasses.replace(settings.imu, rate_hz=IMU.rate_hz))


class SimulatedDrive:
    """A `Drive` of a simulated chair."""

    def __init__(self, simulator: Simulator, meter: SpeedMeter) -> None:
        """Rest first, until `meter` is ready."""
        self._simulator = simulator
        self._meter = meter
        simulator.release()
        meter.add_messages(simulator.advance(TICK_NS))
        if not meter.ready:
            meter.add_messages(simulator.advance(round(STILL_S * 1e9) + TICK_NS))

    @property
    def now_ns(self) -> int:
        """The simulator's time."""
        return self._simulator.now_ns

    def hold(self, forward_volts: float, turn_volts: float, seconds: float) -> list[Sample]:
        """Hold the lines; see `Drive`.

        Raises:
            WorldError: the chair touched something, which spoils the measurement.
            CalibrationError: the sensors give no speed.
        """
        return self._meter.add_messages(hold_lines(self._simulator, forward_volts, turn_volts, seconds))


def hold_lines(
    simulator: Simulator, forward_volts: float, turn_volts: float, seconds: float
) -> tuple[SensorMessage, ...]:
    """Hold the lines at these volts for a whole number of ticks and return the messages.

    Raises:
        WorldError: the chair touched something, which spoils the measurement.
    """
    before = simulator.contacts
    simulator.drive(forward_volts, turn_volts)
    messages = simulator.advance(round(seconds * 1e9 / TICK_NS) * TICK_NS)
    if simulator.contacts > before or simulator.in_contact:
        pose = simulator.truth()
        raise WorldError(f"the chair touched something at ({pose.x:.1f}, {pose.y:.1f}): calibrate in a larger hall")
    return messages
