"""A simulated chair as a calibration drives it, with the speeds that its own sensors see."""

from __future__ import annotations

import dataclasses

from waychair.calibration.sweep import Sample
from waychair.errors import WorldError
from waychair.simulation.simulator import SensorMessage, Simulator, SimulatorSettings
from waychair.topics import COMMAND, IMU
from waychair.trials.measured_speeds import STILL_S, SpeedMeter

TICK_NS = round(1e9 / COMMAND.rate_hz)
"""Commands are held for whole numbers of ticks."""


def with_few_beams(settings: SimulatorSettings) -> SimulatorSettings:
    """The same chair with a lidar that nobody looks at, which is most of the simulator's work."""
    return dataclasses.replace(settings, lidar=dataclasses.replace(settings.lidar, beams=2))


def with_gyro(settings: SimulatorSettings) -> SimulatorSettings:
    """The same chair with its IMU switched on."""
    return dataclasses.replace(settings, imu=dataclasses.replace(settings.imu, rate_hz=IMU.rate_hz))


class SimulatedDrive:
    """A `Drive` of a simulated chair in a hall."""

    def __init__(self, simulator: Simulator, meter: SpeedMeter) -> None:
        """Stands still first, as long as `meter` needs."""
        self._simulator = simulator
        self._meter = meter
        simulator.release()
        meter.take_in(simulator.advance(TICK_NS))
        if not meter.ready:
            meter.take_in(simulator.advance(round(STILL_S * 1e9) + TICK_NS))

    @property
    def now_ns(self) -> int:
        """The simulator's time."""
        return self._simulator.now_ns

    def hold(self, forward_volts: float, turn_volts: float, seconds: float) -> list[Sample]:
        """Hold the lines; see `Drive`.

        Raises:
            WorldError: the chair touched something meanwhile, which spoils what is measured.
            CalibrationError: the sensors give no speed.
        """
        return self._meter.take_in(held(self._simulator, forward_volts, turn_volts, seconds))


def held(simulator: Simulator, forward_volts: float, turn_volts: float, seconds: float) -> tuple[SensorMessage, ...]:
    """The messages of a whole number of ticks with the lines at these volts.

    Raises:
        WorldError: the chair touched something meanwhile, which spoils what is measured.
    """
    before = simulator.contacts
    simulator.drive(forward_volts, turn_volts)
    messages = simulator.advance(round(seconds * 1e9 / TICK_NS) * TICK_NS)
    if simulator.contacts > before or simulator.in_contact:
        pose = simulator.truth()
        raise WorldError(f"the chair touched something at ({pose.x:.1f}, {pose.y:.1f}): calibrate in a larger hall")
    return messages
