"""A colour camera on pan/tilt servos with a laser's line: pictures, and the angles that the servos report.

While the laser is ordered on, it shines in every other picture only: the picture before shows the same without it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from waychair.calibration.servo_camera_mount import PICTURE, SERVO_CAMERA
from waychair.config import Settings, setting
from waychair.simulation.plan.world import World
from waychair.simulation.scene.scene import Block, Mover
from waychair.simulation.sensors.camera import blurred, noise_bank, noise_by_level, noisy_image
from waychair.simulation.sensors.exposure import AutoExposure
from waychair.simulation.sensors.pan_tilt import RATE, PanTilt, ServoCameraFaults
from waychair.simulation.sensors.renderer import Laser, RenderedImage, Renderer
from waychair.types import Bytes, PanTiltAngles, PanTiltCommand, Picture, Pose3, Twist

LASER_POWER = 0.0045
"""m²; 5 mW of red light in a fan of 60 degrees, by the red light of an office of 500 lux (about 0.4 W/m²)."""


@dataclass(frozen=True, slots=True)
class ServoCameraSettings(Settings):
    """The simulated camera on servos; its mount and optics are `calibration.servo_camera_mount`'s."""

    rate_hz: float = setting(
        0.0,
        "Hz",
        "pictures per second of the camera on pan/tilt servos; larger: simulation is slower; 0: no such camera",
        low=0.0,
        high=60.0,
    )


class ServoCamera:
    """The camera, its servos and its laser; every picture uses equally many random numbers."""

    def __init__(self, rng: np.random.Generator, world: World) -> None:
        """
        Raises:
            MissingExtra: this machine cannot render.
        """
        self._rng = rng
        self._renderer = Renderer(world, SERVO_CAMERA.camera_matrix, *PICTURE, draws_laser=True)
        self._normal = noise_bank(rng, *PICTURE)
        self._auto = AutoExposure()
        self._lit = False
        self.servos = PanTilt()
        self.faults = ServoCameraFaults()

    def place(self, world: World) -> None:
        """Put the camera into another world."""
        self._renderer = Renderer(world, SERVO_CAMERA.camera_matrix, *PICTURE, draws_laser=True)

    def move_leaves(self, leaves: Sequence[Block]) -> None:
        """Put the leaves of the level's lifts where they are now."""
        self._renderer.leaves = tuple(leaves)

    def order(self, command: PanTiltCommand) -> None:
        """Take an order; see `PanTilt.order`."""
        self.servos.order(command)

    def step(self, step_ns: int) -> None:
        """Let time pass."""
        self.servos.step(step_ns, self.faults)

    def sense(
        self, stamp_ns: int, map_from_base: Pose3, twist: Twist, people: Sequence[Mover] = ()
    ) -> Iterator[PanTiltAngles | Picture]:
        """Yield the servos' report and the picture of one moment."""
        yield self.servos.report(stamp_ns, self.faults)
        self._lit = self.servos.laser and not self._lit
        map_from_camera = map_from_base @ SERVO_CAMERA.base_from_camera(*self.servos.angles)
        laser = None
        if self._lit and not self.faults.laser_off:
            laser = Laser(map_from_camera @ SERVO_CAMERA.camera_from_laser, LASER_POWER)
        picture = self._auto.settled(lambda light: self._renderer.render(map_from_camera, people, light, laser))
        turned = abs(twist.omega) + (RATE if self.servos.turning else 0.0)
        image = self._exposed(picture, turned)
        self._auto.adapt(picture, stamp_ns)
        yield Picture(stamp_ns, image, SERVO_CAMERA.camera_matrix, self._lit)

    def _exposed(self, picture: RenderedImage, turned: float) -> Bytes:
        """Return the image with the blur of a turn rate [rad/s] and noise; black behind a covered lens."""
        starts = self._rng.integers(0, len(self._normal) - 3 * PICTURE[0], PICTURE[1])
        colour = blurred(picture.colour, turned * self._auto.seconds * SERVO_CAMERA.focal, 1.0)
        if self.faults.dark:
            colour = np.zeros_like(colour)
        return noisy_image(colour, noise_by_level(self._auto.gain), self._normal, starts)
