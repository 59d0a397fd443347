"""All sensors of a simulated chair: after each step of time they give the messages that are due."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.simulation.plan.world import World
from waychair.simulation.plant.plant import Plant
from waychair.simulation.scene.moving import SlidingLeaf
from waychair.simulation.scene.scene import Block, Mover
from waychair.simulation.scene.seeds import random_stream
from waychair.simulation.sensors.barometer import Barometer
from waychair.simulation.sensors.camera import CameraSettings, RgbdCamera
from waychair.simulation.sensors.height_slices import slice_at
from waychair.simulation.sensors.imu import Imu, ImuSettings
from waychair.simulation.sensors.lidar import Lidar, LidarSettings
from waychair.simulation.sensors.rays import Scenery, scenery_from_slice, slide_leaves
from waychair.simulation.sensors.renderer import Renderer, camera_matrix, renderer_problem
from waychair.simulation.sensors.servo_camera import ServoCamera, ServoCameraSettings
from waychair.simulation.sensors.sonar import Sonars, SonarSettings
from waychair.simulation.sensors.tilted_rays import Terrain, TiltedPose, terrain_from_world
from waychair.types import SensorMessage, ServoMessage, WheelTicks

_LOOKED = 40
"""Messages of the camera on servos that wait at most, in pairs of angles and picture: a caller may never take them."""


@dataclass(frozen=True, slots=True)
class _Rates:
    """Samples per second [Hz] of sensors that are read after a step of `step_ns`; 0: never."""

    step_ns: int
    imu: float
    wheels: float
    sonar: float
    camera: float
    servo_camera: float
    barometer: float

    def is_due(self, rate_hz: float, now_ns: int) -> bool:
        """Return whether a sample falls into the last step; half a nanosecond guards against rounding."""
        if rate_hz == 0.0:
            return False
        before, now = (now_ns - self.step_ns + 0.5) * rate_hz * 1e-9, (now_ns + 0.5) * rate_hz * 1e-9
        return math.floor(now) > math.floor(before)


@dataclass(frozen=True, slots=True)
class _Surroundings:
    """A world as the sensors measure it: at the heights of lidar and sonars, and its terrain for a lidar that leans."""

    lidar: Scenery
    sonar: Scenery
    terrain: Terrain | None


class SensorSuite:
    """Lidar, IMU, barometer, sonars, cameras and wheel encoders of one chair, each with its own random stream."""

    def __init__(
        self,
        body: ChairBody,
        seed: int,
        step_ns: int,
        *,
        lidar: LidarSettings,
        imu: ImuSettings,
        sonar: SonarSettings,
        camera: CameraSettings,
        servo_camera: ServoCameraSettings,
        wheels_hz: float,
        leans: bool,
        barometer_hz: float = 0.0,
    ) -> None:
        """`step_ns`: the time between two calls of `sense`. `leans`: whether the chair can lean, and its lidar with it."""
        self._body = body
        self._seed = seed
        self._rates = _Rates(
            step_ns, imu.rate_hz, wheels_hz, sonar.rate_hz, camera.rate_hz, servo_camera.rate_hz, barometer_hz
        )
        self._lidar = Lidar(lidar, body, random_stream(seed, 1))
        self._imu = Imu(imu, random_stream(seed, 2))
        self._barometer = Barometer(barometer_hz, random_stream(seed, 8))
        self._sonars, self._sonar_height = Sonars(sonar, body, random_stream(seed, 3)), sonar.height
        self._camera_settings = camera
        self._camera: RgbdCamera | None = None
        self.servo_camera: ServoCamera | None = None
        self.looked: deque[ServoMessage] = deque(maxlen=_LOOKED)
        """The newest messages of the camera on servos that nobody has taken yet."""
        self._leans = leans
        self._surroundings: _Surroundings
        self._ticks_before = (0, 0)

    @property
    def camera_problem(self) -> str | None:
        """Why a camera of the settings cannot render; None if it can, or if there is no camera."""
        lacks = self._rates.camera > 0.0 and self._camera is None
        lacks = lacks or (self._rates.servo_camera > 0.0 and self.servo_camera is None)
        return renderer_problem() if lacks else None

    def place(self, world: World, leaves: Sequence[SlidingLeaf] = ()) -> None:
        """Put the sensors into a world whose lifts have these leaves."""
        lidar, sonar = (
            scenery_from_slice(slice_at(world.blocks, height), leaves)
            for height in (self._body.laser_z, self._sonar_height)
        )
        self._surroundings = _Surroundings(lidar, sonar, terrain_from_world(world) if self._leans else None)
        self._camera = self._camera_in(world)
        if self.servo_camera is not None:
            self.servo_camera.place(world)
        elif self._rates.servo_camera > 0.0 and renderer_problem() is None:
            self.servo_camera = ServoCamera(random_stream(self._seed, 6), world)

    def move_leaves(self, leaves: Sequence[Block]) -> None:
        """Put the leaves of the level's lifts where they are now."""
        slide_leaves(self._surroundings.lidar, leaves)
        slide_leaves(self._surroundings.sonar, leaves)
        for camera in (self._camera, self.servo_camera):
            if camera is not None:
                camera.move_leaves(leaves)

    def carry_over(self, chair: Plant) -> None:
        """Let the encoder counts go on from those of a chair that is about to be replaced."""
        self._ticks_before = self._ticks(chair)

    def sense(
        self, now_ns: int, chair: Plant, people: Sequence[Mover], lifted: float = 0.0, height: float = 0.0
    ) -> Iterator[SensorMessage]:
        """Yield the messages of the step that ends now.

        `lifted` is the acceleration [m/s^2] of the chair's lift, `height` [m] that of the floor below the chair.
        """
        rates, seen = self._rates, self._surroundings
        if rates.is_due(rates.imu, now_ns):
            force = chair.specific_force if not lifted else chair.specific_force + np.array([0.0, 0.0, lifted])
            yield self._imu.sample(now_ns, force, chair.angular_rate)
        if rates.is_due(rates.wheels, now_ns):
            yield WheelTicks(now_ns, *self._ticks(chair))
        if rates.is_due(rates.barometer, now_ns):
            yield self._barometer.sample(now_ns, height)
        if rates.is_due(rates.sonar, now_ns):
            yield self._sonars.read(seen.sonar, chair.pose, people, now_ns)
        leaning = TiltedPose(seen.terrain, chair.pose3) if seen.terrain is not None else None
        scan = self._lidar.step(seen.lidar, chair.pose, people, now_ns, leaning)
        if scan is not None:
            yield scan
        if self._camera is not None and rates.is_due(rates.camera, now_ns):
            yield self._camera.frame(now_ns, chair.pose3, chair.twist, people)
        if self.servo_camera is not None:
            self.servo_camera.step(rates.step_ns)
            if rates.is_due(rates.servo_camera, now_ns):
                self.looked += self.servo_camera.sense(now_ns, chair.pose3, chair.twist, people)

    def _camera_in(self, world: World) -> RgbdCamera | None:
        camera = self._camera_settings
        if camera.rate_hz == 0.0 or renderer_problem() is not None:
            return None
        matrix = camera_matrix(camera.width, camera.height, camera.field_of_view)
        renderer = Renderer(world, matrix, camera.width, camera.height)
        return RgbdCamera(camera, self._body.base_from_camera, random_stream(self._seed, 5), renderer)

    def _ticks(self, chair: Plant) -> tuple[int, int]:
        """Return the encoder counts, which continue when the chair is put into another world."""
        left, right = (sum(pair) for pair in zip(self._ticks_before, chair.ticks, strict=True))
        return (left + 2**31) % 2**32 - 2**31, (right + 2**31) % 2**32 - 2**31
