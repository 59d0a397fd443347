"""What guidance knows of one rider: how late, how far and how fast this rider answers. Learnt in `learning`."""

from __future__ import annotations

import math
from dataclasses import dataclass

SEEN_TO_OBEY = 0.87
"""Share that is seen of a simulated driver who takes 95 % of the symbols rightly; of one with 70 % it is 0.72."""


@dataclass(frozen=True, slots=True)
class RiderModel:
    """One rider on one chair.

    `lag_s`: from a pattern's end until the chair obeys, counted so that the way made meanwhile is speed times lag: reaction,
    hand and chair together. `nudge` [rad]: the turn by one nudge. `swivel` [rad/s]: the rate of a turn on the spot. `veer_per_m`
    [rad/m]: turn while the rider means to drive straight, hand and chair together, left positive. `speed` [m/s]. `sure`: share of the symbols
    for a held motion that this rider is seen to obey; a symbol that the next one overtakes is not.
    """

    lag_s: float = 0.65
    nudge: float = math.radians(2.4)
    swivel: float = 0.5
    veer_per_m: float = 0.0
    speed: float = 0.3
    sure: float = SEEN_TO_OBEY

    def figures(self) -> dict[str, float]:
        """Return all of it as plain numbers."""
        return {name: float(getattr(self, name)) for name in LIMITS}


LIMITS = {
    "lag_s": (0.3, 1.6),
    "nudge": (math.radians(1.0), math.radians(10.0)),
    "swivel": (0.15, 1.5),
    "veer_per_m": (-0.3, 0.3),
    "speed": (0.08, 0.8),
    "sure": (0.0, 1.0),
}
"""Least and greatest value of each; whatever a drive seems to show, nothing outside is learnt."""
