"""One chair's body and drive as data: the same file serves plant, footprint and calibration.

Body A (default) and B are the two chairs of DESIGN.md section 3; lengths in metres, base frame (origin in the middle
of the drive axle).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from waychair.config import Settings, setting
from waychair.geometry import rectangle
from waychair.types import FloatArray, Pose2


@dataclass(frozen=True, slots=True)
class ChairBody(Settings):
    """Outline, wheels and lidar mount of a rear-drive chair."""

    chair_id: str = setting("A", "", "name of the chair these numbers belong to")
    length: float = setting(1.00, "m", "overall length", low=0.3, high=2.5)
    width: float = setting(0.60, "m", "overall width", low=0.2, high=1.5)
    axle_from_rear: float = setting(0.25, "m", "drive axle ahead of the rear end", low=0.0, high=2.0)
    track: float = setting(0.54, "m", "distance between the drive wheels' contacts", low=0.1, high=1.5)
    wheel_radius: float = setting(0.165, "m", "radius of the drive wheels", low=0.02, high=0.6)
    ticks_per_turn: int = setting(4096, "counts", "encoder counts per turn of a drive wheel", low=16, high=1_000_000)
    laser_x: float = setting(0.60, "m", "lidar ahead of the drive axle", low=-2.0, high=2.0)
    laser_y: float = setting(0.0, "m", "lidar left of the middle", low=-1.0, high=1.0)
    laser_theta: float = setting(0.0, "rad", "direction of the lidar's x axis", low=-math.pi, high=math.pi)

    @property
    def front(self) -> float:
        """Reach ahead of the drive axle [m]."""
        return self.length - self.axle_from_rear

    @property
    def rear(self) -> float:
        """Reach behind the drive axle [m]."""
        return self.axle_from_rear

    @property
    def base_from_laser(self) -> Pose2:
        """Mount of the lidar."""
        return Pose2(self.laser_x, self.laser_y, self.laser_theta)

    @property
    def circumscribed_radius(self) -> float:
        """Distance of the farthest corner from the base origin [m]: the disc swept by turning in place."""
        return math.hypot(max(self.front, self.rear), self.width / 2)

    def outline(self) -> FloatArray:
        """Corners (4, 2) [m] in the base frame, counter-clockwise."""
        return rectangle(self.front, self.rear, self.width / 2)


CHAIR_A = ChairBody()
CHAIR_B = ChairBody(chair_id="B", length=1.10, width=0.70, track=0.62)
