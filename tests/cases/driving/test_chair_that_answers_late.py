"""A chair that answers its commands 0.25 s and more later than its file says, in a corridor with a hand's breadth beside it."""

from __future__ import annotations

from dataclasses import replace

import pytest
from evaluation.scenes.tight_places import corner_scene, run_scene

from waychair.calibration.chair_body import CHAIR_A
from waychair.trials.demo.demo import randomised_settings

SECONDS = 10.0
"""[s] of a drive; without any knowledge of the delay the chair touches the wall after four."""


@pytest.mark.parametrize("seed", [0, 1])
def test_it_drives_on_and_touches_nothing(seed: int) -> None:
    plant = replace(randomised_settings(seed).plant, delay_s=0.4)
    found = run_scene(corner_scene(CHAIR_A, seed), seed, SECONDS, plant)
    assert found.contacts == 0
    assert found.leg.distance_m > 0.5
