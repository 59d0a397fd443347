"""Costs of driving through a building, in whole millimetres of straight driving.

Costs are int32: they compare exactly, without a tolerance, and reach 1,000 km. A turn, a door, a slow zone and a lift
each count as much as the straight drive that takes the same time. `CostSettings` are the `cost` record of a building's
general file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from waychair import config

CLOSED_MM = 1_000_000_000
"""The cost of a closed arc, and of no way at all [mm]; two of them still fit into int32."""

DEAREST_MM = 100_000_000
"""The most that one open arc can cost [mm], 100 km; dearer ones are given this."""


@dataclass(frozen=True, slots=True)
class CostSettings(config.Settings):
    """What turns, doors, slow parts and lifts cost, in metres of straight driving."""

    speed_mps: float = config.setting(
        0.8, "m/s", "the chair's usual speed, which turns seconds into metres", low=0.1, high=3.0
    )
    turn_m: float = config.setting(0.8, "m", "a turn of 90 degrees; more makes straighter ways", low=0.0, high=100.0)
    turn_round_m: float = config.setting(1.6, "m", "turning round on the spot", low=0.0, high=100.0)
    door_m: float = config.setting(2.0, "m", "driving through a door of up to 0.95 m", low=0.0, high=1000.0)
    narrow_door_m: float = config.setting(5.0, "m", "driving through a door of up to 0.85 m", low=0.0, high=1000.0)
    lift_wait_m: float = config.setting(
        16.0, "m", "waiting for a lift; more makes ways with fewer lifts", low=0.0, high=10_000.0
    )
    lift_board_m: float = config.setting(4.0, "m", "driving into a lift, or out of it", low=0.0, high=1000.0)
    lift_storey_m: float = config.setting(2.4, "m", "riding one storey further", low=0.0, high=1000.0)


DOOR_UP_TO_M, NARROW_DOOR_UP_TO_M = 0.95, 0.85
"""Widths [m] up to which a door slows the chair down, and up to which it has to be passed at a crawl."""

STRAIGHT_UP_TO = math.radians(45.0)
"""Changes of heading up to this [rad] are no turn."""

TURN_UP_TO = math.radians(135.0)
"""Changes of heading up to this [rad] are a turn to one side; larger ones turn the chair round."""


def millimetres(metres: float) -> int:
    """Return a cost in whole millimetres, at most `DEAREST_MM`."""
    return min(round(1000.0 * metres), DEAREST_MM)


def door_cost_m(width: float | None, costs: CostSettings) -> float:
    """Return what a door of this width [m] adds to an arc [m]; nothing for a wide one or none."""
    if width is None or width > DOOR_UP_TO_M:
        return 0.0
    return costs.narrow_door_m if width <= NARROW_DOOR_UP_TO_M else costs.door_m
