"""The settings of a simulated chair: its plant, its sensors and their rates."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from waychair.config import Settings, setting
from waychair.errors import ConfigError
from waychair.simulation.plant.mujoco_chair import substeps
from waychair.simulation.plant.mujoco_model import MujocoSettings
from waychair.simulation.plant.plant import PlantSettings
from waychair.simulation.sensors.camera import CameraSettings
from waychair.simulation.sensors.imu import ImuSettings
from waychair.simulation.sensors.lidar import LidarSettings
from waychair.simulation.sensors.servo_camera import ServoCameraSettings
from waychair.simulation.sensors.sonar import SonarSettings
from waychair.topics import CAMERA, IMU, SONAR, WHEELS

PLANT_MODELS = ("kinematic", "mujoco")
"""Ideal wheels, or mass, motors, casters and slip."""


@dataclass(frozen=True, slots=True)
class SimulatorSettings(Settings):
    """Plant, sensors and their rates; the periods of encoders, lidar and IMU must be whole numbers of plant steps."""

    plant_model: str = setting(
        "kinematic", "", "plant of the simulated chair: kinematic (fast) or mujoco (casters, motors)"
    )
    plant: PlantSettings = field(default_factory=PlantSettings)
    mujoco: MujocoSettings = field(default_factory=MujocoSettings)
    lidar: LidarSettings = field(default_factory=LidarSettings)
    imu: ImuSettings = field(default_factory=ImuSettings)
    sonar: SonarSettings = field(default_factory=SonarSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    servo_camera: ServoCameraSettings = field(default_factory=ServoCameraSettings)
    wheels_hz: float = setting(
        WHEELS.rate_hz,
        "Hz",
        "readings per second of the wheel encoders; larger: speeds are known sooner",
        low=1.0,
        high=1000.0,
    )
    barometer_hz: float = setting(
        0.0, "Hz", "readings per second of a barometer; larger: rides are known sooner; 0: none", low=0.0, high=100.0
    )

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.plant_model not in PLANT_MODELS:
            raise ConfigError(f"plant_model = '{self.plant_model}' is unknown: take {' or '.join(PLANT_MODELS)}")
        if self.plant_model == "mujoco":
            substeps(self.plant, self.mujoco)
        rates = {"wheels_hz": self.wheels_hz, "lidar rate_hz": self.lidar.rate_hz, "imu rate_hz": self.imu.rate_hz}
        for name, rate in rates.items():
            steps = 1000.0 / (rate * self.plant.step_ms) if rate else 1.0
            if steps < 1.0 or not math.isclose(steps, round(steps), rel_tol=1e-9):
                raise ConfigError(
                    f"{name} = {rate:g} is impossible: its period must be a whole number of steps of "
                    f"{self.plant.step_ms} ms"
                )


@dataclass(frozen=True, slots=True)
class SensorSettings(Settings):
    """The simulated sensors; the command or node decides which sensors without a rate here are on, and at which rate."""

    lidar: LidarSettings = field(default_factory=LidarSettings)
    imu: ImuSettings = field(default_factory=ImuSettings)
    sonar: SonarSettings = field(default_factory=SonarSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    servo_camera: ServoCameraSettings = field(default_factory=ServoCameraSettings)
    wheels_hz: float = setting(
        WHEELS.rate_hz,
        "Hz",
        "readings per second of the wheel encoders; larger: speeds are known sooner",
        low=1.0,
        high=1000.0,
    )
    barometer_hz: float = setting(
        0.0, "Hz", "readings per second of a barometer; larger: rides are known sooner; 0: none", low=0.0, high=100.0
    )

    def over(self, settings: SimulatorSettings) -> SimulatorSettings:
        """Return the simulated chair with these sensors; those whose rate is 0 here keep that of `settings`."""
        return replace(
            settings,
            lidar=self.lidar,
            imu=replace(self.imu, rate_hz=self.imu.rate_hz or settings.imu.rate_hz),
            sonar=replace(self.sonar, rate_hz=self.sonar.rate_hz or settings.sonar.rate_hz),
            camera=replace(self.camera, rate_hz=self.camera.rate_hz or settings.camera.rate_hz),
            servo_camera=self.servo_camera if self.servo_camera.rate_hz else settings.servo_camera,
            wheels_hz=self.wheels_hz,
            barometer_hz=self.barometer_hz or settings.barometer_hz,
        )


@dataclass(frozen=True, slots=True)
class SimulationSettings(Settings):
    """The settings of a simulation, whichever chair it simulates; a chair's own figures are in its .yaml file."""

    plant_model: str = setting(
        "kinematic", "", "plant of the simulated chair: kinematic (fast) or mujoco (casters, motors)"
    )
    sensors: SensorSettings = field(default_factory=SensorSettings)

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        self.over(SimulatorSettings())  # refuses an unknown plant, and rates that the plant's steps cannot keep

    def over(self, settings: SimulatorSettings) -> SimulatorSettings:
        """Return the simulated chair with this plant and these sensors."""
        return replace(self.sensors.over(settings), plant_model=self.plant_model)


def with_all_sensors(settings: SimulatorSettings) -> SimulatorSettings:
    """Return the same chair with IMU, sonars and camera switched on, at the rates of `topics`."""
    return replace(
        settings,
        imu=replace(settings.imu, rate_hz=IMU.rate_hz),
        sonar=replace(settings.sonar, rate_hz=SONAR.rate_hz),
        camera=replace(settings.camera, rate_hz=CAMERA.rate_hz),
    )
