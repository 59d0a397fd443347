"""The barometer: the air's pressure at the chair, which falls with the height, with the weather's drift and gusts of doors."""

from __future__ import annotations

import math

import numpy as np

from waychair.simulation.sensors.imu import gauss_markov
from waychair.types import PressureSample

SEA_LEVEL, PER_METRE = 101_325.0, 12.0
"""Pa, Pa/m; pressure at the lowest floor, and its fall with the height (ISO 2533 at sea level: 12.01 Pa/m)."""

OFFSET, NOISE, STEP = 100.0, 1.5, 0.16
"""Pa, one sigma; a sensor's own offset and white noise, and its resolution (Bosch BMP388, ultra low power: 2.6 Pa to 0.03 Pa
r.m.s. by oversampling)."""

WEATHER, GUSTS, GUST_S = 0.01, 1.5, 20.0
"""Pa/s, Pa, s, one sigma; drift with the weather (36 Pa an hour is a front that passes), and gusts of doors and ventilation with
their correlation time."""


class Barometer:
    """A barometer with the offset and the weather drawn at its start, and its own random stream."""

    def __init__(self, rate_hz: float, rng: np.random.Generator) -> None:
        self._rng = rng
        self._offset = OFFSET * float(rng.standard_normal())
        self._weather = WEATHER * float(rng.standard_normal())
        self._gust = rng.standard_normal(1)
        self._keep = math.exp(-1.0 / (GUST_S * rate_hz)) if rate_hz > 0.0 else 0.0

    def sample(self, stamp_ns: int, height: float) -> PressureSample:
        """Return the reading at a height [m] above the lowest floor."""
        white, fresh = self._rng.standard_normal(2).tolist()
        self._gust = gauss_markov(self._gust, np.array([[fresh]]), self._keep)[0]
        read = SEA_LEVEL - PER_METRE * height + self._offset + self._weather * stamp_ns * 1e-9
        read += GUSTS * float(self._gust[0]) + NOISE * white
        return PressureSample(stamp_ns, round(read / STEP) * STEP)
