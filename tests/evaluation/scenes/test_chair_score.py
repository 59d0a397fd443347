"""The score of a model of the joystick volts: the counted commands, and the steady speeds of a chair."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from evaluation.scenes.chair_score import acceptance_chairs, inverse_error, settled_twist

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.dac import DEFAULT
from waychair.simulation.plant.plant import PlantSettings, randomised

SEED = 4
PLANT = randomised(PlantSettings(), SEED)


def test_commands_beyond_the_reach_of_the_model_do_not_count() -> None:
    error = inverse_error(DEFAULT, PLANT, CHAIR_A, np.array([[0.3, 0.0], [3.0, 0.0], [0.0, 9.0]]))
    assert (error.commands, error.beyond) == (1, 2)


def test_a_chair_settles_at_the_speed_of_its_electronics() -> None:
    plain = replace(PlantSettings(), speed_noise=0.0, slip_noise=0.0, left_wheel_scale=1.0, right_wheel_scale=1.0)
    volts = plain.neutral_volts + plain.forward_dead_band + 0.4
    assert settled_twist(plain, CHAIR_A, volts, plain.neutral_volts).v == pytest.approx(0.4 * plain.forward_gain)


def test_the_acceptance_has_twelve_chairs_of_the_fitted_form_and_eight_others() -> None:
    chairs = acceptance_chairs()
    assert len(chairs) == 20
    assert sum(plant.family == PLANT.family for plant in chairs.values()) == 12
    assert len({plant.forward_gain for plant in chairs.values()}) == 20
