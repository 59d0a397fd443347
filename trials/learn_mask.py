"""Scans of a simulated chair that turns on the spot, for its self-mask, and the score of a mask."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from waychair.calibration.fits.self_mask import SelfMask
from waychair.simulation.plant.plant import volts_from_twist
from waychair.simulation.sensors.silhouettes import rider_legs
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.trials.simulated_drive import hold_lines
from waychair.types import Scan, Twist

MASK_HALL = 8.0
"""Side [m] of a hall with space for a chair to turn."""

_TURN_RATE = 0.6  # [rad/s]
_NEAR_LEG = 0.06  # [m]: a reading this near to a leg's surface is a hit of the leg


@dataclass(frozen=True, slots=True)
class MaskScore:
    """Counts of beams that hit the legs, of those a mask leaves, and the share of all other beams that it hides."""

    leg_hits: int
    leg_hits_left: int
    others_lost: float


def with_legs(settings: SimulatorSettings) -> SimulatorSettings:
    """Return the settings with the rider's legs and the leg rests in the lidar's view."""
    return replace(settings, lidar=replace(settings.lidar, legs=True))


def scans_while_turning(simulator: Simulator, turns: float = 1.2) -> list[Scan]:
    """Return the scans of a chair that turns on the spot, `turns` times.

    Raises:
        WorldError: the chair touched something.
    """
    plant, track = simulator.settings.plant, simulator.body.track
    volts = volts_from_twist(plant, track, Twist(0.0, _TURN_RATE))
    messages = hold_lines(simulator, *volts, turns * math.tau / _TURN_RATE)
    simulator.release()
    return [message for message in messages if isinstance(message, Scan)]


def score_mask(mask: SelfMask, scans: Sequence[Scan], simulator: Simulator) -> MaskScore:
    """Score a mask on scans of a simulated chair, whose legs are known."""
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
