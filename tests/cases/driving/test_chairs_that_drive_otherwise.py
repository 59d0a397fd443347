"""Chairs that answer 0.4 s late, or turn half as fast as their file says: slower, or refused by name.

None touches anything but one, which is named (`_TOUCHES`).
"""

from __future__ import annotations

import pytest
from evaluation.figures.driving.wrong_chairs import SCENES, run_wrong_chair

DOOR, CORNER = SCENES
NAMED = "speed dial or drive profile changed: the chair moves at "


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("scene", "seed"), [(DOOR, 0), (DOOR, 1), (CORNER, 0), (CORNER, 1)])
def test_a_chair_that_answers_late_arrives_later_and_touches_nothing(scene: str, seed: int) -> None:
    late = run_wrong_chair(scene, "slow answer", seed)
    assert (late.reached, late.contacts) == (True, 0), late.reason
    assert late.seconds > run_wrong_chair(scene, "none", seed).seconds


@pytest.mark.sampled(2)  # one at the door, one at the corner; both are named
@pytest.mark.parametrize(
    ("scene", "seed"),
    [
        *((DOOR, seed) for seed in (0, 1, 2, 3, 4, 7)),
        *((CORNER, seed) for seed in (1, 0, 2, 3, 4)),
    ],
)
def test_a_chair_that_turns_lazily_is_named_or_arrives_later_and_touches_nothing(scene: str, seed: int) -> None:
    lazy = run_wrong_chair(scene, "lazy turn", seed)
    assert lazy.contacts == 0
    if lazy.reached:
        assert lazy.seconds > run_wrong_chair(scene, "none", seed).seconds
    else:
        assert lazy.reason.startswith(NAMED)
