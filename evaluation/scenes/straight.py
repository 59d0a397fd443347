"""Straight drives of a calibrated simulated chair, by encoders and gyro, with and without the speed loop."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.fitted_dac import DeadBand, FittedDac
from waychair.calibration.fits.stopping import StopTable
from waychair.control.speed.closed_loop import ClosedLoop
from waychair.control.speed.kinematics import wheel_speeds_from_twist
from waychair.control.speed.speed_loop import SpeedLoopSettings
from waychair.simulation.plan.world import World
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.slam.odometry.odometry_filter import OdometryFilter
from waychair.trials.open_hall import open_hall
from waychair.trials.simulated_drive import TICK_NS, with_few_beams, with_gyro
from waychair.types import FloatArray, ImuSample, Pose2, SensorMessage, SentCommand, Twist, WheelTicks

BIAS_S = 3.0
"""Rest before a drive [s], for the gyro's bias."""

SPEED = 0.8  # m/s; cruising speed of a straight drive, within every chair's reach
ACCELERATION = 0.5  # m/s^2; speeding up and slowing down in comfort

_SMOOTH_S = 0.25  # a rider's trunk does not follow shorter jerks


class TwistSensor:
    """Measures the mean twist of each tick: v by the encoders, omega by the gyro less its bias at rest."""

    def __init__(self, body: ChairBody, at_rest: Sequence[SensorMessage]) -> None:
        """`at_rest`: messages of the sensors while the chair stood still."""
        self._odometry = OdometryFilter(body)
        for message in at_rest:
            if isinstance(message, WheelTicks):
                self._odometry.update_wheels(message)
        self._bias = float(np.mean([message.gyro[2] for message in at_rest if isinstance(message, ImuSample)]))

    def mean(self, messages: Sequence[SensorMessage]) -> Twist:
        """Return the mean twist over one tick's messages."""
        speeds = [
            self._odometry.update_wheels(message).twist.v for message in messages if isinstance(message, WheelTicks)
        ]
        rates = [float(message.gyro[2]) for message in messages if isinstance(message, ImuSample)]
        return Twist(float(np.mean(speeds)), float(np.mean(rates)) - self._bias)


class LoopDrive:
    """A simulated chair under the closed speed loop, one tick per call, measured by its simulated sensors."""

    def __init__(
        self,
        model: FittedDac,
        body: ChairBody,
        simulator: SimulatorSettings,
        seed: int,
        settings: SpeedLoopSettings | None = None,
        world: World | None = None,
        stops: StopTable | None = None,
    ) -> None:
        """Rest first, for the gyro's bias. `model` is the calibration of the chair, which may have changed since."""
        self.simulator = Simulator(world or open_hall(), body, with_gyro(with_few_beams(simulator)), seed)
        self.loop = ClosedLoop(model, body.track, settings, stops)
        self.measured = Twist()
        self.sent: SentCommand | None = None
        self._model = model
        self._lines = DeadBand(model)
        self._track = body.track
        self._hold(Twist())
        self._sensor = TwistSensor(body, self.simulator.advance(round(BIAS_S * 1e9)))

    def tick(self, command: Twist, *, closed: bool = True) -> Twist:
        """Drive for one tick and return its measured mean twist. Without the loop the command is sent unchanged."""
        asked = self.loop.step(command, self.measured, self.simulator.now_ns, self.sent) if closed else command
        self._hold(asked)
        self.measured = self._sensor.mean(self.simulator.advance(TICK_NS))
        return self.measured

    def _hold(self, twist: Twist) -> None:
        """Set the lines' volts for a twist, and note the sent values."""
        counts = self._lines.counts_from_wheel_speeds(wheel_speeds_from_twist(twist, self._track))
        volts = self._model.volts_from_counts(*counts)
        self.simulator.drive(*volts)
        speeds = self._model.wheel_speeds_from_counts(*counts)
        self.sent = SentCommand(self.simulator.now_ns, speeds, *counts, *volts, active=True)


@dataclass(frozen=True, slots=True)
class StraightDrive:
    """The result of a straight drive, by the true motion relative to its start.

    `ahead_m`, `left_m`, `heading_rad`: the end pose. `widest_m`: greatest offset from the line. `speed_rms` [m/s]: error
    of the speed from one second after reaching the cruising speed. `jerk_rms`, `jerk_max` [m/s^3]: of the forward speed,
    smoothed over 0.25 s. `fault`: reason of an aborted drive.
    """

    ahead_m: float
    left_m: float
    heading_rad: float
    widest_m: float
    speed_rms: float
    jerk_rms: float
    jerk_max: float
    duration_s: float
    fault: str = ""


def drive_straight(
    drive: LoopDrive, length: float = 10.0, *, closed: bool = True, limit_s: float = 120.0
) -> StraightDrive:
    """Drive straight for `length` [m] by the encoders, then rest; a fault of the loop aborts the drive."""
    simulator, start = drive.simulator, drive.simulator.truth()
    distance, speed, poses, speeds, wanted = 0.0, 0.0, [Pose2()], [0.0], [0.0]
    began_ns = simulator.now_ns
    dt = TICK_NS * 1e-9
    resting_s = 0.0
    while resting_s < 1.0 and (simulator.now_ns - began_ns) * 1e-9 < limit_s and not drive.loop.fault:
        left = length - distance - speed * dt
        speed = max(0.0, min(speed + ACCELERATION * dt, SPEED, math.sqrt(2.0 * ACCELERATION * max(left, 0.0))))
        if left < 0.01 or resting_s > 0.0:
            speed, resting_s = 0.0, resting_s + dt
        distance += drive.tick(Twist(speed, 0.0), closed=closed).v * dt
        poses.append(start.inverse() @ simulator.truth())
        speeds.append(simulator.twist().v)
        wanted.append(speed)
    return _score(poses, np.array(speeds), np.array(wanted), drive.loop.fault)


def _score(poses: list[Pose2], speeds: FloatArray, wanted: FloatArray, fault: str) -> StraightDrive:
    dt = TICK_NS * 1e-9
    smooth = round(_SMOOTH_S / dt)
    kernel = np.ones(smooth) / smooth
    jerk = np.diff(np.convolve(speeds, kernel, "valid"), 2) / dt**2
    cruising = np.flatnonzero(wanted >= SPEED - 1e-9)
    settled = cruising[cruising > cruising[0] + 1.0 / dt] if len(cruising) else cruising
    off = speeds[settled] - SPEED
    end = poses[-1]
    return StraightDrive(
        ahead_m=end.x,
        left_m=end.y,
        heading_rad=end.theta,
        widest_m=max(abs(pose.y) for pose in poses),
        speed_rms=float(np.sqrt((off**2).mean())) if len(off) else math.nan,
        jerk_rms=float(np.sqrt((jerk**2).mean())) if len(jerk) else math.nan,
        jerk_max=float(np.abs(jerk).max()) if len(jerk) else math.nan,
        duration_s=(len(speeds) - 1) * dt,
        fault=fault,
    )
