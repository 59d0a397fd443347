"""A camera's automatic exposure: time and gain that make the mean light of the image that of a grey card."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from waychair.simulation.sensors.renderer import RenderedImage

SENSITIVITY = 75.0
"""Light per second of exposure from a surface of brightness 1 in office light; 1 gives a white pixel."""

SETTLED = 0.05
"""Relative error of the brightness at which the automatic exposure counts as settled."""

TARGET_GREY = 0.18  # mean light of the exposed image, white is 1; the grey card of photography
EXPOSURE_MIN = 0.0002  # s
EXPOSURE_MAX = 0.015  # s; darker scenes get gain
GAIN_MAX = 16.0
ADAPTATION = 0.2  # s; time constant of the automatic exposure


class AutoExposure:
    """Exposure time and gain of the next frame."""

    def __init__(self) -> None:
        self._light = math.sqrt(EXPOSURE_MIN * EXPOSURE_MAX)
        self._stamp_ns: int | None = None

    @property
    def seconds(self) -> float:
        """Exposure time [s] of the next frame."""
        return min(max(self._light, EXPOSURE_MIN), EXPOSURE_MAX)

    @property
    def gain(self) -> float:
        """Gain of the next frame, at least 1: it makes up for light that the longest exposure cannot give."""
        return max(self._light / self.seconds, 1.0)

    @property
    def brightness(self) -> float:
        """The factor from the light of a surface to that of its pixel."""
        return SENSITIVITY * self.seconds * self.gain

    def settled(self, render: Callable[[float], RenderedImage]) -> RenderedImage:
        """Return the exposed image; the first frame is rendered again until the exposure has settled."""
        picture = render(self.brightness)
        for _ in range(8 if self._stamp_ns is None else 0):
            if abs(_factor(picture) - 1.0) < SETTLED:
                break
            self._scale(_factor(picture))
            picture = render(self.brightness)
        return picture

    def adapt(self, picture: RenderedImage, stamp_ns: int) -> None:
        """Move the exposure towards the wanted one with a first-order lag over the time since the last frame."""
        elapsed = 0.0 if self._stamp_ns is None else (stamp_ns - self._stamp_ns) * 1e-9
        self._stamp_ns = stamp_ns
        self._scale(_factor(picture) ** (1.0 - math.exp(-elapsed / ADAPTATION)))

    def _scale(self, factor: float) -> None:
        self._light = min(max(self._light * factor, EXPOSURE_MIN), EXPOSURE_MAX * GAIN_MAX)


def _factor(picture: RenderedImage) -> float:
    """Return the factor by which the exposure should change, from every eighth pixel."""
    light = np.square(picture.colour[4::8, 4::8, :3] * np.float32(1.0 / 255.0)).mean()
    return float(TARGET_GREY / max(light, 1e-3))
