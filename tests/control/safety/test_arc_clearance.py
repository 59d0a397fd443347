"""Points that a drive cannot meet are left out first, and nothing else is."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.safety.arc_clearance import (
    BESIDE_HAND,
    MonitorSettings,
    contact_times,
    stop_seconds,
    stoppable_along,
)
from waychair.control.safety.arc_entry import entry_times, may_enter
from waychair.types import Twist

S = MonitorSettings()


@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(0.1, 3.0), st.integers(0, 1000))
def test_no_point_that_is_left_out_is_met_in_time(v: float, omega: float, within_s: float, seed: int) -> None:
    front, rear, half, x, y = 0.9, 0.3, 0.4, *np.random.default_rng(seed).uniform(-3.0, 3.0, (2, 200))
    outside = (x > front) | (x < -rear) | (np.abs(y) > half)
    sides = (np.full(len(x), side) for side in (front, rear, half))
    met = outside & (entry_times(x, y, Twist(v, omega), *sides) <= within_s)
    may = may_enter(np.column_stack([x, y]), Twist(v, omega), front, rear, half, within_s)
    assert not (met & ~may).any()
    assert may[~outside].all(), "points within are met now"


def test_far_points_do_not_change_the_share_of_a_push() -> None:
    rng = np.random.default_rng(8)
    for push in (Twist(1.4, 0.0), Twist(0.3, 0.2), Twist(-0.25, 0.1), Twist(0.0, 0.8), Twist(1e-4, 0.0)):
        near = rng.uniform(-1.3, 1.3, (200, 2))
        near = near[np.hypot(*near.T) > 1.05]
        legs = rng.random(len(near)) < 0.3
        far = np.concatenate([near, 7.0 * near / np.hypot(*near.T)[:, None]])
        alone = stoppable_along(near, legs, push, CHAIR_A, S)
        assert alone == stoppable_along(far, np.concatenate([legs, legs]), push, CHAIR_A, S)
        everywhere = contact_times(near, legs, push, CHAIR_A, S.legs, pace=1.0, least_beside=BESIDE_HAND)
        soon = np.partition(everywhere, 2)[2] < 0.5 * stop_seconds(push, S)
        assert (alone < 1.0) or not soon
