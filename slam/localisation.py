"""What a localiser says: where the chair is on its map, and how far that can be trusted.

Apart from the localiser, so that whoever only hears of it starts without the map's machinery.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from waychair.types import FloatArray, Pose2

if TYPE_CHECKING:
    from waychair.slam.recovery import Candidate


class LocalisationState(enum.Enum):
    """Whether the pose can be driven by: yes; slowly, since too little is seen that bears it out; no."""

    OK = "ok"
    DEGRADED = "degraded"
    LOST = "lost"


@dataclass(frozen=True, slots=True)
class Localisation:
    """Pose at a scan and how far it can be trusted.

    `map_from_base` = `map_from_odom` @ the odometry. `inliers`: share of the scan's points on the map's walls. `health`
    in [0, 1]: probability that the pose is within 0.3 m and 5 degrees of the truth, by this scan alone: a chair that was
    right before is more likely to be right than that, and 0.5 where people hide all walls. `covariance` (3, 3) of the pose
    [m^2, m rad, rad^2] in the map frame, None while nothing fits. `remaining` is the correction still to come, in the
    base frame: map_from_base @ remaining is where the scans say the chair is. `jumped`: this time the pose was moved at
    once, because the chair has just found out where it is. `candidates`: places a lost chair may be at, best first.
    """

    map_from_base: Pose2
    map_from_odom: Pose2
    inliers: float
    state: LocalisationState
    health: float
    covariance: FloatArray | None = None
    remaining: Pose2 = field(default_factory=Pose2)
    jumped: bool = False
    candidates: tuple[Candidate, ...] = ()

    @property
    def lost(self) -> bool:
        """Whether the pose must not be driven by."""
        return self.state is LocalisationState.LOST
