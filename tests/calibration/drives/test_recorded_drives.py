"""A camera's mount is found from the recording of a chair."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.drives.camera_views import nominal_mount
from waychair.calibration.drives.recorded_drives import camera_from_recording
from waychair.recordings.bags.rosbag_writer import RecordingWriter
from waychair.simulation.plant.plant import PlantSettings, randomised
from waychair.simulation.simulator import Simulator, SimulatorSettings, with_all_sensors
from waychair.trials.open_hall import open_hall
from waychair.trials.simulated_calibration import with_displaced_camera
from waychair.types import Pose2, RgbdFrame, Scan

SEED = 4
PLANT = randomised(PlantSettings(), SEED)
SETTINGS = SimulatorSettings(plant=PLANT)


@pytest.mark.nightly
def test_a_camera_mount_is_found_from_a_recording_with_pauses(tmp_path: Path) -> None:
    if Simulator(open_hall(), CHAIR_A, SimulatorSettings(), 0).camera_problem is not None:
        pytest.skip("nothing to render with")
    true, path = with_displaced_camera(CHAIR_A, SEED), tmp_path / "turns.mcap"
    small = with_all_sensors(SETTINGS)
    small = replace(small, camera=replace(small.camera, width=320, height=240, rate_hz=5.0))
    with RecordingWriter(path, {}) as writer:
        for turn in range(6):
            world = replace(open_hall(6.0, 0.05), start=Pose2(3.0, 3.0, math.tau * (turn + 0.5) / 6))
            for message in Simulator(world, true, small, SEED).advance(600_000_000):
                if isinstance(message, Scan | RgbdFrame):
                    writer.write(replace(message, stamp_ns=message.stamp_ns + (turn + 1) * 10**9))
    found = camera_from_recording(path, CHAIR_A).camera_from_laser
    expected = nominal_mount(true)
    assert np.linalg.norm(found.translation - expected.translation) < 0.015
    assert Rotation.from_matrix(found.rotation @ expected.rotation.T).magnitude() < math.radians(0.4)
