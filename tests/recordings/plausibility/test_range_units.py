"""Units of ranges that the numbers alone do not tell."""

from __future__ import annotations

import math

import numpy as np

from waychair.recordings.plausibility.range_readings import tried_units, unit_text


def test_numbers_that_fit_millimetres_and_centimetres_leave_the_choice_to_the_motion() -> None:
    ranges = np.linspace(500.0, 9000.0, 200).astype(np.float32)
    assert tried_units(ranges, math.inf) == (1e-3, 1e-2)
    assert tried_units(ranges, 12.0) == (1e-3,)
    assert tried_units(ranges / 1000.0, math.inf) == (1.0,)
    assert tried_units(ranges / 100.0, math.inf)[0] == 1.0


def test_a_unit_is_told_as_confirmed_or_as_the_likelier_one_with_the_doubt() -> None:
    units = (1e-3, 1e-2)
    assert (
        unit_text("ranges", units, 1)
        == "the ranges are in centimetres, as the odometry confirms, and are converted to metres"
    )
    assert unit_text("ranges", units, None) == (
        "the ranges are in millimetres, and are converted to metres; they may be in centimetres (10 times the size), "
        "since no motion by odometry tells the unit: measure a wall on the map"
    )
    assert unit_text("ranges", (1e-3,), None) == "the ranges are in millimetres, and are converted to metres"
    assert not unit_text("ranges", (1.0, 0.3048), None)
