"""All thresholds of the paper's network. The paper gives none of them; each names its reason.

The preset `paper` is a baseline: its values stay as they are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from waychair.config import Settings, setting
from waychair.errors import ConfigError


@dataclass(frozen=True, slots=True)
class ObstacleLimits(Settings):
    """Ranges that part the classes of obstacles."""

    near: float = setting(1.5, "m", "range below which an obstacle is near, else far", low=0.1, high=6.0)
    close: float = setting(0.9, "m", "range below which it is close", low=0.1, high=6.0)
    immediate: float = setting(0.5, "m", "range below which it is immediate", low=0.03, high=6.0)
    hysteresis: float = setting(0.1, "m", "distance beyond a limit at which a nearer class ends", low=0.0, high=0.5)
    stale: float = setting(0.5, "s", "age of a packet above which nothing is known; eight rangings", low=0.05, high=5.0)

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if not self.immediate < self.close < self.near:
            raise ConfigError(
                f"immediate = {self.immediate:g}, close = {self.close:g} and near = {self.near:g} m contradict each "
                "other: give rising ranges"
            )
        if self.hysteresis >= min(self.close - self.immediate, self.near - self.close):
            raise ConfigError(
                f"hysteresis = {self.hysteresis:g} m is as large as a class of obstacles: make it smaller than the "
                "differences of immediate, close and near"
            )


@dataclass(frozen=True, slots=True)
class CameraLimits(Settings):
    """The camera on servos with its laser line, and when its aim is believed."""

    focal: float = setting(600.0, "px", "focal length of the camera", low=50.0, high=5000.0)
    middle_column: float = setting(320.0, "px", "column of the optical axis", low=0.0, high=5000.0)
    middle_row: float = setting(240.0, "px", "row of the optical axis", low=0.0, high=5000.0)
    baseline: float = setting(0.10, "m", "distance of the laser plane below the camera", low=0.01, high=1.0)
    forward: float = setting(0.40, "m", "distance of the camera ahead of the drive axle", low=-1.0, high=2.0)
    left: float = setting(0.0, "m", "distance of the camera to the left of the middle", low=-1.0, high=1.0)
    aimed: float = setting(math.radians(2.0), "rad", "greatest error of an aim that was reached", low=0.001, high=0.2)
    patience: float = setting(2.0, "s", "time after which an aim counts as out of reach", low=0.1, high=10.0)
    fastest: float = setting(
        math.radians(600.0), "rad/s", "rate above which a reported angle is not the servo's", low=0.5, high=50.0
    )
    fresh: float = setting(0.5, "s", "age above which a picture or an angle is not used", low=0.05, high=5.0)
    view: float = setting(math.radians(50.0), "rad", "horizontal field of view of the camera", low=0.1, high=2.5)


@dataclass(frozen=True, slots=True)
class DoorLimits(Settings):
    """Doorways: their validation, and the pivotal zone before them."""

    confidence: float = setting(
        0.5, "", "confidence from which a frame in the picture is a candidate", low=0.0, high=1.0
    )
    narrowest: float = setting(0.60, "m", "width between the jambs below which it is no door", low=0.2, high=2.0)
    widest: float = setting(1.60, "m", "width between the jambs above which it is no door", low=0.3, high=4.0)
    deeper: float = setting(0.30, "m", "depth behind the jambs that an open doorway shows", low=0.05, high=2.0)
    jamb: float = setting(
        math.radians(4.0), "rad", "angle around a frame's edge in which its jamb lies", low=0.01, high=0.3
    )
    held: float = setting(5.0, "s", "time for which a door is tracked without being seen", low=0.5, high=60.0)
    pivot_ahead: float = setting(
        0.75, "m", "distance of the chair's front end from the wall at the pivot", low=0.1, high=3.0
    )
    zone: float = setting(0.35, "m", "radius of the pivotal zone", low=0.05, high=1.5)
    straight: float = setting(math.radians(6.0), "rad", "error of heading at which the swivel ends", low=0.01, high=0.5)
    askew: float = setting(math.radians(20.0), "rad", "error of heading at which it begins again", low=0.02, high=1.5)

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.narrowest >= self.widest:
            raise ConfigError(
                f"narrowest = {self.narrowest:g} m is not below widest = {self.widest:g} m: give the narrower door first"
            )
        if self.zone >= self.pivot_ahead:
            raise ConfigError(
                f"zone = {self.zone:g} m reaches to the wall, pivot_ahead = {self.pivot_ahead:g} m before it: a chair "
                "would swivel in the doorway; make it smaller"
            )
        if self.straight >= self.askew:
            raise ConfigError(
                f"straight = {self.straight:g} rad is not below askew = {self.askew:g} rad: a swivel would never end"
            )


@dataclass(frozen=True, slots=True)
class NavigationLimits(Settings):
    """The arbitration between the three commands."""

    surrounded: int = setting(
        3, "", "immediate obstacles from which a direction is chosen (more than two)", low=1, high=8
    )
    agreeing: float = setting(
        math.radians(45.0),
        "rad",
        "angle between the door's direction and a free one that still serve both",
        low=0.0,
        high=3.2,
    )
    merged: float = setting(1.0, "s", "time for which a merged command is the only one taken", low=0.05, high=10.0)
    looked: float = setting(1.5, "s", "time for which a look into a sector by the camera counts", low=0.1, high=20.0)
    stick: float = setting(0.1, "", "deflection of the stick from which it points somewhere", low=0.01, high=1.0)
