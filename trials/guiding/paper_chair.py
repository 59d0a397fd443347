"""A simulated chair that has the paper's sensors and no others: eight SRF-08 sonars, and a camera with a laser's line on servos.

Besides them it has its wheels' encoders, for odometry. There is no lidar, so no board guards the stick.
"""

from __future__ import annotations

from dataclasses import replace

from waychair.calibration.chair_body import ChairBody
from waychair.simulation.sensors.servo_camera import ServoCameraSettings
from waychair.simulation.sensors.sonar import SRF08
from waychair.simulation.simulator import SimulatorSettings

PICTURES_HZ = 10.0
"""Pictures of the camera on servos; the laser shines in every other one."""


def paper_body(body: ChairBody) -> ChairBody:
    """Return a chair with its sonars where the paper has them."""
    return replace(body, sonar_layout="paper")


def paper_sensors(settings: SimulatorSettings) -> SimulatorSettings:
    """Return the same simulated chair with the paper's sensors alone."""
    return replace(
        settings,
        lidar=replace(settings.lidar, rate_hz=0.0),
        imu=replace(settings.imu, rate_hz=0.0),
        camera=replace(settings.camera, rate_hz=0.0),
        sonar=SRF08,
        servo_camera=ServoCameraSettings(rate_hz=PICTURES_HZ),
    )
