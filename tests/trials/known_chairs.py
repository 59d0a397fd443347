"""Simulated chairs with a calibration known without a sweep."""

from __future__ import annotations

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.axis_model import AxisModel, AxisSide
from waychair.calibration.fits.fitted_dac import FittedDac
from waychair.simulation.plant.plant import PlantSettings


def known_model(plant: PlantSettings, bits: int = 8) -> FittedDac:
    """Return the perfect calibration of a chair A without S-curve or cuts."""
    track, part = CHAIR_A.track, plant.family.speed

    def side(dead_band: float, gain: float) -> AxisSide:
        return AxisSide(dead_band, part * gain, 0.0, part * gain * (plant.swing_volts - dead_band))

    forward = side(plant.forward_dead_band, plant.forward_gain)
    turn = side(plant.turn_dead_band, plant.turn_gain / track)
    return FittedDac(
        bits=bits,
        forward=AxisModel(plant.neutral_volts, 1, forward, forward, plant.delay_s, plant.lag_s, plant.acceleration),
        turn=AxisModel(plant.neutral_volts, -1, turn, turn, plant.delay_s, plant.lag_s, plant.turn_acceleration),
        turn_per_v=-2.0 * plant.forward_skew / track,
        v_per_turn=-0.5 * plant.turn_skew * track,
    )
