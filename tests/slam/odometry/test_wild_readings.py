"""Wild readings are told by the others around them, whatever the unit; lasting faults and hard turns are none."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.slam.odometry.wild_readings import wild_forces, wild_rates
from waychair.types import FloatArray

TIMES = np.arange(0.0, 60.0, 0.01)
TURN = 5.0
"""rad/s; limit for turn rates."""


def turning() -> FloatArray:
    """The rates of a chair that turns by 1.2 rad/s for two seconds of every ten."""
    return np.where((TIMES % 10.0 > 4.0) & (TIMES % 10.0 < 6.0), 1.2, 0.0)


@pytest.mark.parametrize("unit", [1.0, 57.29578, 1000.0])
def test_spikes_are_wild_in_every_unit_and_turns_are_not(unit: float) -> None:
    rates = unit * turning()
    assert not wild_rates(TIMES, rates, TURN).any()
    rates[[700, 3000, 3001]] += 20.0 * unit
    assert np.flatnonzero(wild_rates(TIMES, rates, TURN)).tolist() == [700, 3000, 3001]


def test_values_that_are_no_numbers_are_wild() -> None:
    rates = turning()
    rates[1234] = np.nan
    assert np.flatnonzero(wild_rates(TIMES, rates, TURN)).tolist() == [1234]


def test_a_rate_that_lasts_is_another_fault() -> None:
    assert not wild_rates(TIMES, np.where(TIMES > 30.0, 40.0, 0.0), TURN).any()


def test_a_kerb_is_no_wild_force_and_a_flipped_bit_is() -> None:
    forces = np.tile((0.0, 0.0, 9.81), (len(TIMES), 1))
    forces[900] += (30.0, 0.0, 45.0)
    forces[2000, 1] = -4e5
    assert np.flatnonzero(wild_forces(TIMES, forces)).tolist() == [2000]
