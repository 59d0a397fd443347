"""An RGB-D camera: adds exposure, motion blur and noise to the rendered image.

Colours are square roots of light (a display's gamma of 2), so that shot noise is the same at all brightnesses. The depth
noise grows with the square of the distance, as it must for stereo depth; `DEPTH_SIGMA` is plausible for
a camera with a baseline of 5 cm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.config import Settings, setting
from waychair.simulation.scene.scene import Block, Mover
from waychair.simulation.sensors.exposure import AutoExposure
from waychair.simulation.sensors.renderer import Renderer
from waychair.types import Bytes, Float32Array, IntArray, Pose3, RgbdFrame, Twist

FULL_WELL = 10_000.0
"""Electrons in a white pixel at gain 1."""

NOISE_STEP = 1.0 / 32.0
"""Standard deviations per count in the stored noise."""

# Noise and vibration are plausible for a small stereo depth camera on a wheelchair, not measured.
READ_NOISE = 6.0  # electrons, one sigma; noise of reading a pixel
DEPTH_MIN = 0.3  # m; nearer things have no depth
DEPTH_SIGMA = 0.0012  # 1/m; depth noise at 1 m, one sigma; it grows as z^2
DEPTH_SLOPE = 8.0  # tangent of the steepest surface, from facing the camera, whose depth is measured
DEPTH_SPECKLE = 0.004  # part of the depths that are lost by chance
VIBRATION = 0.0015  # rad; pitch and roll at 1 m/s, one sigma
VIBRATION_HZ = 8.0  # Hz


@dataclass(frozen=True, slots=True)
class CameraSettings(Settings):
    """Image and range of the camera; the defaults are those of common stereo depth cameras."""

    rate_hz: float = setting(
        0.0, "Hz", "frames per second of the camera; larger: simulation is slower; 0: no camera", low=0.0, high=100.0
    )
    width: int = setting(
        640, "pixels", "columns of the camera's images; more: finer images, slower simulation", low=16, high=4096
    )
    height: int = setting(
        480, "pixels", "rows of the camera's images; more: finer images, slower simulation", low=16, high=4096
    )
    field_of_view: float = setting(
        math.radians(69.0),
        "rad",
        "horizontal field of view of the camera; larger: it sees more to the sides, in less detail",
        low=0.2,
        high=2.5,
    )
    depth_max: float = setting(
        8.0,
        "m",
        "largest depth that the camera measures; larger: farther things have a depth",
        low=DEPTH_MIN,
        high=100.0,
    )
    noise: float = setting(
        1.0,
        "",
        "scale of the camera's noise in colour and depth; larger: noisier images; 0: no noise",
        low=0.0,
        high=10.0,
    )


class RgbdCamera:
    """The camera with its exposure and its own random stream; every frame uses equally many random numbers."""

    def __init__(
        self, settings: CameraSettings, base_from_camera: Pose3, rng: np.random.Generator, renderer: Renderer
    ) -> None:
        """Make a camera from the mount of its optical frame and a renderer of the size in the settings."""
        self._settings = settings
        self._base_from_camera = base_from_camera
        self._rng = rng
        self._renderer = renderer
        # Drawing two million normal numbers for every frame would cost more than rendering it.
        self._normal = noise_bank(rng, settings.width, settings.height)
        self._uniform = rng.integers(0, 1 << 16, len(self._normal), np.uint16)
        self._auto = AutoExposure()

    @property
    def exposure(self) -> float:
        """Exposure time [s] of the next frame."""
        return self._auto.seconds

    @property
    def gain(self) -> float:
        """Gain of the next frame, at least 1."""
        return self._auto.gain

    def move_leaves(self, leaves: Sequence[Block]) -> None:
        """Put the leaves of the level's lifts where they are now."""
        self._renderer.leaves = tuple(leaves)

    def frame(self, stamp_ns: int, map_from_base: Pose3, twist: Twist, people: Sequence[Mover] = ()) -> RgbdFrame:
        """Return colour and depth at one moment; depth is along the optical axis, nan where none was measured."""
        s = self._settings
        jitter = self._rng.standard_normal(3) * VIBRATION * abs(twist.v)
        rows = self._rng.integers(0, len(self._normal) - 3 * s.width, (3, s.height))
        map_from_camera = map_from_base @ self._base_from_camera @ _tilted(jitter[0], jitter[1])
        picture = self._auto.settled(lambda light: self._renderer.render(map_from_camera, people, light))
        rates = twist.omega, math.tau * VIBRATION_HZ * jitter[2]
        colour = blurred(picture.colour, *(self._pixels_swept(rate) for rate in rates))
        sigma = s.noise * noise_by_level(self.gain)
        image = noisy_image(colour, sigma, self._normal, rows[0])
        focal = float(self._renderer.camera_matrix[0, 0])
        depth = measured_depth(
            depth=picture.depth,
            returns=picture.colour[..., 3],
            normal=self._normal,
            uniform=self._uniform,
            starts=rows[1:],
            nearest=DEPTH_MIN,
            farthest=s.depth_max,
            sigma=s.noise * DEPTH_SIGMA,
            slope=DEPTH_SLOPE / focal,
            kept=1.0 - s.noise * DEPTH_SPECKLE,
        )
        self._auto.adapt(picture, stamp_ns)
        return RgbdFrame(stamp_ns, image, depth, self._renderer.camera_matrix)

    def _pixels_swept(self, rate: float) -> float:
        """Return how far [pixels] the image's middle moves during the exposure at a turn rate [rad/s]."""
        return float(abs(rate)) * self.exposure * float(self._renderer.camera_matrix[0, 0])


def blurred(colour: Bytes, across: float, down: float) -> Bytes:
    """Return an image (H, W, 4) blurred over `across` and `down` pixels of motion; up to one pixel changes nothing."""
    width, height = (2 * round((length - 1.0) / 2.0) + 1 if length > 1.0 else 1 for length in (across, down))
    if width == 1 and height == 1:
        return colour
    return np.asarray(cv2.blur(colour, (width, height)), np.uint8)


def noise_bank(rng: np.random.Generator, width: int, height: int) -> NDArray[np.int8]:
    """Return normal numbers in steps of `NOISE_STEP`, enough for the colours of half an image."""
    most = 3 * width * (height // 2 + 1)
    return np.clip(np.rint(rng.standard_normal(most) / NOISE_STEP), -127, 127).astype(np.int8)


def noise_by_level(gain: float, read_noise: float = READ_NOISE) -> Float32Array:
    """Return the standard deviation (256,) [levels] of each pixel value: shot and read noise after gain and root."""
    light = np.square(np.maximum(np.arange(256), 4) / 255.0)
    electrons = light * FULL_WELL / gain
    noise = np.sqrt(electrons + read_noise**2)
    return (255.0 * noise / electrons * np.sqrt(light) / 2.0).astype(np.float32)


@njit(cache=True, nogil=True)
def noisy_image(colour: Bytes, sigma: Float32Array, normal: NDArray[np.int8], starts: IntArray) -> Bytes:
    """Return an image (H, W, 3): `colour` (H, W, 4) plus noise from `normal`, for row i from `starts[i]` on."""
    height, width = colour.shape[:2]
    image = np.empty((height, width, 3), np.uint8)
    step = np.float32(NOISE_STEP)
    half = np.float32(0.5)
    for row in range(height):
        start = starts[row]
        for column in range(width):
            for channel in range(3):
                value = colour[row, column, channel]
                noise = sigma[value] * (step * normal[start + 3 * column + channel])
                image[row, column, channel] = np.uint8(
                    min(max(value + noise + half, np.float32(0.0)), np.float32(255.0))
                )
    return image


@njit(cache=True, nogil=True)
def measured_depth(
    depth: Float32Array,
    returns: Bytes,
    normal: NDArray[np.int8],
    uniform: NDArray[np.uint16],
    starts: IntArray,
    nearest: float,
    farthest: float,
    sigma: float,
    slope: float,
    kept: float,
) -> Float32Array:
    """Return a measured depth (H, W) [m]: noise of `sigma` z^2, and nan where a stereo camera finds no match.

    There is no match out of range, and where depth changes by more than `slope` z from one pixel to the next (edges,
    grazing angles). Matches also fail by chance: a share of `returns` / 255 times `kept` is left. Row i uses `normal`
    and `uniform` from `starts[0, i]` and `starts[1, i]` on.
    """
    height, width = depth.shape
    measured = np.empty((height, width), np.float32)
    step = np.float32(sigma * NOISE_STEP)
    least = np.float32(kept * 65536.0 / 255.0)
    steepest, low, high = np.float32(slope), np.float32(nearest), np.float32(farthest)
    for row in range(height):
        above, below = max(row - 1, 0), min(row + 1, height - 1)
        first, second = starts[0, row], starts[1, row]
        for column in range(width):
            z = depth[row, column]
            change = max(
                max(abs(z - depth[above, column]), abs(z - depth[below, column])),
                max(abs(z - depth[row, max(column - 1, 0)]), abs(z - depth[row, min(column + 1, width - 1)])),
            )
            found = z >= low and z <= high and change <= steepest * z
            found = found and uniform[second + column] < least * returns[row, column]
            measured[row, column] = z + step * normal[first + column] * z * z if found else np.float32(np.nan)
    return measured


def _tilted(pitch: float, roll: float) -> Pose3:
    """Return the pose of a camera turned about its own x and z axes by small angles [rad]."""
    (sp, cp), (sr, cr) = ((math.sin(angle), math.cos(angle)) for angle in (pitch, roll))
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cp, -sp], [0.0, sp, cp]])
    about_z = np.array([[cr, -sr, 0.0], [sr, cr, 0.0], [0.0, 0.0, 1.0]])
    return Pose3(about_x @ about_z, np.zeros(3))
