"""Injected delays of simulated sensors are found to 5 ms, against the chair's gyro."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.drives.sensor_delays import TimeCalibration, TimeCalibrator, merged
from waychair.calibration.fits.time_offset import SensorDelays, TimeOffset, without_delay
from waychair.errors import CalibrationError, ThinData
from waychair.recordings.bags.rosbag_writer import RecordingWriter
from waychair.recordings.recording import read_recording
from waychair.simulation.sensors.camera import CameraSettings
from waychair.simulation.sensors.renderer import renderer_problem
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.trials.open_hall import open_hall
from waychair.trials.record import EPOCH_NS, mounts_of
from waychair.trials.simulated_calibration import TIME_HALL, turns_to_and_fro
from waychair.trials.simulated_drive import with_gyro
from waychair.types import ImuSample, Scan, WheelTicks

MS = 1_000_000


def simulated(seed: int, *, camera: bool = False, plant: str = "kinematic") -> Simulator:
    """Return a chair with a gyro in a small hall, optionally with a small camera."""
    settings = with_gyro(SimulatorSettings(plant_model=plant))
    if camera:
        settings = replace(settings, camera=CameraSettings(rate_hz=15.0, width=240, height=180))
    return Simulator(open_hall(TIME_HALL, 0.05), CHAIR_A, settings, seed)


def calibrated(simulator: Simulator, late: SensorDelays, seconds: float, seed: int) -> TimeCalibration:
    """Return the calibration of stamps with injected delays."""
    added = SensorDelays(-late.lidar_ns, -late.wheels_ns, -late.camera_ns)
    calibrator = TimeCalibrator(CHAIR_A)
    for message in turns_to_and_fro(simulator, seconds, seed):
        calibrator.add(without_delay(message, added))
    return calibrator.result()


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("seed", "plant", "lidar_ms", "wheels_ms"),
    [(0, "kinematic", 0, 80), (1, "kinematic", 80, 0), (3, "mujoco", 61, 12)],
)
def test_delays_of_lidar_and_encoders_are_found_to_5_ms(seed: int, plant: str, lidar_ms: int, wheels_ms: int) -> None:
    late = SensorDelays(lidar_ns=lidar_ms * MS, wheels_ns=wheels_ms * MS)
    found = calibrated(simulated(seed, plant=plant), late, 12.0, seed)
    assert found.problems == ()
    assert found.delays.lidar_ns == pytest.approx(late.lidar_ns, abs=5 * MS)
    assert found.delays.wheels_ns == pytest.approx(late.wheels_ns, abs=5 * MS)
    assert found.delays.camera_ns == 0


@pytest.mark.nightly
def test_the_cameras_delay_is_found_to_5_ms() -> None:
    if problem := renderer_problem():
        pytest.skip(problem)
    found = calibrated(simulated(4, camera=True), SensorDelays(camera_ns=55 * MS), 6.0, 4)
    assert found.delays.camera_ns == pytest.approx(55 * MS, abs=5 * MS)


def test_a_recording_gives_the_same_delays_as_the_chair_itself(tmp_path: Path) -> None:
    simulator, late = simulated(5), SensorDelays(-40 * MS, -15 * MS, 0)
    bag, direct = tmp_path / "turns.mcap", TimeCalibrator(CHAIR_A)
    with RecordingWriter(bag, mounts_of(CHAIR_A, 0.3), ticks_per_turn=CHAIR_A.ticks_per_turn) as writer:
        for message in turns_to_and_fro(simulator, 8.0, 5):
            if isinstance(message, Scan | WheelTicks | ImuSample):
                delayed = without_delay(message, late)
                writer.write(replace(delayed, stamp_ns=delayed.stamp_ns + EPOCH_NS))
                direct.add(delayed)
    recording = read_recording(bag)
    replayed = TimeCalibrator(CHAIR_A)
    for frame in recording.frames:
        for reading in (*frame.imu, *frame.wheels):
            replayed.add(reading)
        assert frame.scan is not None
        replayed.add(frame.scan)
    assert replayed.result().delays.lidar_ns == pytest.approx(direct.result().delays.lidar_ns, abs=MS)


def test_without_a_gyro_or_without_another_sensor_there_is_no_delay() -> None:
    calibrator = TimeCalibrator(CHAIR_A)
    with pytest.raises(ThinData, match="record the IMU too"):
        calibrator.result()
    for message in turns_to_and_fro(simulated(6), 1.0):
        if isinstance(message, ImuSample):
            calibrator.add(message)
    with pytest.raises(ThinData, match="no lidar, encoders or camera"):
        calibrator.result()


def test_for_a_chair_that_stands_still_the_advice_is_to_turn() -> None:
    simulator, calibrator = simulated(7), TimeCalibrator(CHAIR_A)
    for message in simulator.advance(6_000_000_000):
        calibrator.add(message)
    with pytest.raises(CalibrationError, match="turn left and right repeatedly"):
        calibrator.result()


def test_only_newly_found_delays_replace_the_known_ones() -> None:
    offset = TimeOffset(7, 1, 100, 1.0, 0.0)
    found = TimeCalibration(SensorDelays(lidar_ns=7), {"lidar": offset}, ("the camera saw nothing",))
    assert merged(SensorDelays(1, 2, 3), found) == SensorDelays(7, 2, 3)
    assert merged(None, found) == SensorDelays(7, 0, 0)
