"""The score of a self-mask on a simulated chair with known legs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.calibration.fits.self_mask import SelfMask
from waychair.simulation.sensors.silhouettes import rider_legs
from waychair.simulation.simulator import Simulator
from waychair.types import Scan

_NEAR_LEG = 0.06  # [m]: a reading this near to a leg's surface is a hit of the leg


@dataclass(frozen=True, slots=True)
class MaskScore:
    """Counts of beams that hit the legs, of those a mask leaves, and the share of all other beams that it hides."""

    leg_hits: int
    leg_hits_left: int
    others_lost: float


def score_mask(mask: SelfMask, scans: Sequence[Scan], simulator: Simulator) -> MaskScore:
    """Score a mask on scans of a simulated chair with known legs."""
    laser = simulator.body.base_from_laser
    circles = rider_legs(simulator.body)
    hits = left = others = lost = 0
    for scan in scans:
        angles = scan.angles() + laser.theta
        seen = np.isfinite(scan.ranges)
        x = laser.x + scan.ranges * np.cos(angles)
        y = laser.y + scan.ranges * np.sin(angles)
        with np.errstate(invalid="ignore"):
            apart = [np.hypot(x - cx, y - cy) - radius for cx, cy, radius in circles]
            on_leg = seen & (np.min(apart, axis=0) < _NEAR_LEG)
        hidden = mask.hides(scan)
        hits, left = hits + int(on_leg.sum()), left + int((on_leg & ~hidden).sum())
        others, lost = others + int((seen & ~on_leg).sum()), lost + int((seen & ~on_leg & hidden).sum())
    return MaskScore(hits, left, lost / max(others, 1))
