"""The output of a localiser: the chair's pose on its map, and how reliable it is.

The module is separate from the localiser so that consumers of poses do not import the map code.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from waychair.types import FloatArray, Pose2

if TYPE_CHECKING:
    from waychair.slam.localising.kidnap_recovery import PlaceCandidate


class LocalisationState(enum.Enum):
    """Whether the chair may drive by the pose: OK yes; DEGRADED slowly, the scans confirm little; LOST no."""

    OK = "ok"
    DEGRADED = "degraded"
    LOST = "lost"


@dataclass(frozen=True, slots=True)
class Localisation:
    """Pose at a scan, and its reliability.

    - `map_from_base`: `map_from_odom` @ the odometry.
    - `inliers`: share of the scan's points on the map's walls.
    - `health` in [0, 1]: probability, by this scan alone, that the pose is within 0.3 m and 5 degrees of the truth (a pose
      that was right before is more likely right than that); 0.5 where people hide all walls.
    - `covariance`: (3, 3) of the pose [m^2, m rad, rad^2] in the map frame; None while the scan does not fit.
    - `remaining`: correction still to come, in the base frame; map_from_base @ remaining is the pose by the scans.
    - `jumped`: the pose jumped at this scan, because a start was given or a lost chair was relocalised.
    - `candidates`: places where a lost chair may be, best first.
    """

    map_from_base: Pose2
    map_from_odom: Pose2
    inliers: float
    state: LocalisationState
    health: float
    covariance: FloatArray | None = None
    remaining: Pose2 = field(default_factory=Pose2)
    jumped: bool = False
    candidates: tuple[PlaceCandidate, ...] = ()

    @property
    def lost(self) -> bool:
        """Whether the chair must not drive by the pose."""
        return self.state is LocalisationState.LOST
