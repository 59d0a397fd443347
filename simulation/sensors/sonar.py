"""Eight sonars round the chair: each measures the range of the first echo in a cone.

Glass and mirrors reflect sound like walls. A smooth surface far off normal incidence deflects the ping, and a sonar may
hear another sonar's ping.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.calibration.chair_body import ChairBody, sonar_mounts
from waychair.config import Settings, setting
from waychair.errors import ConfigError
from waychair.geometry import compose
from waychair.simulation.scene.scene import Mover
from waychair.simulation.sensors.rays import Scenery, cosine_of_incidence, nearest_circle, nearest_segment
from waychair.simulation.sensors.silhouettes import bodies
from waychair.types import FloatArray, Pose2, SonarReadings

_RAY_STEP = math.radians(0.5)
"""Angle between the rays of a cone [rad]: they hit a chair's leg of 3 cm up to 3.4 m away."""


# Plausible for cheap 40 kHz transducers, not measured.
RANGE_MIN = 0.02  # m; nearer things read -inf
INCIDENCE = math.radians(60.0)  # rad; largest angle of incidence at which a face echoes
SIGMA = 0.01  # m, one sigma; noise of a range
CROSS_TALK = 0.005  # part of the readings that are another sonar's ping

# Devantech's SRF-08, from its data sheet: 65 ms a ranging, about 55 degrees to -6 dB.
SRF08_RANGE_MIN = 0.03  # m
SRF08_RANGE_MAX = 6.0  # m
SRF08_HALF_CONE = math.radians(27.5)
SRF08_HZ = 15.0

SONAR_MODELS = ("plain", "srf08")


@dataclass(frozen=True, slots=True)
class SonarSettings(Settings):
    """Mount, cone and range of the sonars; the defaults are plausible for cheap 40 kHz transducers."""

    rate_hz: float = setting(
        0.0,
        "Hz",
        "readings per second of all sonars; larger: obstacles are seen sooner; 0: no sonars",
        low=0.0,
        high=100.0,
    )
    height: float = setting(
        0.40, "m", "height of the sonars above the floor; larger: they pass over more low obstacles", low=0.02, high=2.0
    )
    half_cone: float = setting(
        math.radians(15.0),
        "rad",
        "angle from a sonar's axis to its cone's edge; larger: it sees more to the sides",
        low=0.01,
        high=1.5,
    )
    range_max: float = setting(
        4.0,
        "m",
        "largest range of a sonar, above which it reads +inf; larger: farther things are measured",
        low=0.1,
        high=20.0,
    )
    model: str = setting(
        "plain", "", "make of the sonars: plain (half_cone and range_max), or srf08 (27.5 degrees, 0.03 to 6 m)"
    )

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.model not in SONAR_MODELS:
            raise ConfigError(f"sonar model = '{self.model}' is unknown: take {' or '.join(SONAR_MODELS)}")

    @property
    def cone(self) -> float:
        """Angle from the axis to the cone's edge [rad] of the model."""
        return SRF08_HALF_CONE if self.model == "srf08" else self.half_cone

    @property
    def limits(self) -> tuple[float, float]:
        """Least and largest range [m] of the model."""
        return (SRF08_RANGE_MIN, SRF08_RANGE_MAX) if self.model == "srf08" else (RANGE_MIN, self.range_max)


SRF08 = SonarSettings(rate_hz=SRF08_HZ, model="srf08")
"""The sonars of the paper's chair, each ranging as fast as it can."""


class Sonars:
    """The sonars with their own random stream; every reading uses equally many random numbers."""

    def __init__(self, settings: SonarSettings, body: ChairBody, rng: np.random.Generator) -> None:
        self._settings = settings
        self._rng = rng
        self._mounts = np.array([mount.array() for mount in sonar_mounts(body)])
        rays = 2 * math.ceil(settings.cone / _RAY_STEP) + 1
        self._fan = np.linspace(-settings.cone, settings.cone, rays)

    def read(self, scenery: Scenery, map_from_base: Pose2, people: Iterable[Mover], stamp_ns: int) -> SonarReadings:
        """Return ranges (8,) in the order of `sonar_mounts`, by REP-117: +inf no echo, -inf too close."""
        nearest, farthest = self._settings.limits
        sonars = compose(map_from_base.array(), self._mounts)
        ranges = first_echoes(
            scenery=scenery,
            circles=bodies(people),
            sonars=sonars,
            fan=self._fan,
            straight=math.cos(INCIDENCE),
            reach=farthest,
        )
        noise = self._rng.standard_normal(len(ranges))
        heard, place = self._rng.random((2, len(ranges)))
        ranges += SIGMA * noise
        # Another sonar's ping comes at any time; it counts if it comes first.
        other = np.where(heard < CROSS_TALK, nearest + place * (farthest - nearest), math.inf)
        np.minimum(ranges, other, out=ranges)
        ranges[ranges > farthest] = math.inf
        ranges[ranges < nearest] = -math.inf
        return SonarReadings(stamp_ns, ranges.astype(np.float32))


@njit(cache=True, nogil=True)
def first_echoes(
    scenery: Scenery, circles: FloatArray, sonars: FloatArray, fan: FloatArray, straight: float, reach: float
) -> FloatArray:
    """Return ranges (K,) [m] of the first echo of sonars with poses (K, 3) in map; +inf if none within `reach`.

    A cone is a `fan` of rays [rad]. A face echoes if the cosine of incidence is at least `straight`; a circle always
    does, as people are round and rough. A face that deflects the ping still hides everything behind it.
    """
    ranges = np.full(sonars.shape[0], math.inf)
    for i in range(sonars.shape[0]):
        x, y = sonars[i, 0], sonars[i, 1]
        for angle in fan:
            dx, dy = math.cos(sonars[i, 2] + angle), math.sin(sonars[i, 2] + angle)
            circle = nearest_circle(begin=circles, end=circles, part=0.0, x=x, y=y, dx=dx, dy=dy, after=0.0)
            distance, hit = nearest_segment(
                scenery=scenery, x=x, y=y, dx=dx, dy=dy, after=0.0, limit=min(reach, circle, ranges[i])
            )
            if hit < 0:
                if circle <= reach:
                    ranges[i] = min(ranges[i], circle)
            elif cosine_of_incidence(scenery.segments[hit], dx, dy) >= straight:
                ranges[i] = distance
    return ranges
