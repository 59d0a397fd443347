"""What counts as a chair's straying from its line, and what does not."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.drive.straying import FORGETS_OVER, GENTLEST, JUDGED_FROM, STEP, Straying
from waychair.types import FloatArray

SPEED = 0.5


def line(y: float = 0.0, heading: float = 0.0) -> FloatArray:
    """A line along x, moved aside by y [m] and turned."""
    return np.array([[0.0, y, heading], [1.0, y, heading], [2.0, y, heading]])


def on_line() -> Straying:
    """A chair that has been on its line."""
    straying = Straying(CHAIR_A, 0.03)
    straying.note(line(), 0, 0.0, 0.0, 0.0, SPEED)
    return straying


def test_a_chair_that_leaves_its_line_is_expected_to_do_so_again() -> None:
    straying = on_line()
    straying.note(line(), 0, 0.07, 0.0, 0.0, SPEED)
    assert straying.seconds == pytest.approx(0.1)  # 6 cm more than a standing chair's error
    straying.note(line(), 0, 0.0, 0.0, 0.0, SPEED)
    assert straying.seconds == pytest.approx(0.1, abs=STEP)
    assert straying.gentler > 1.0
    for _ in range(round(3.0 * FORGETS_OVER / (SPEED * 0.05))):
        straying.note(line(), 0, 0.0, 0.0, 0.0, SPEED)
    assert straying.seconds == 0.0
    assert straying.gentler == 1.0


@pytest.mark.parametrize("moved", [line(-0.06), line(0.0, -0.13)])
def test_a_line_that_moves_under_the_chair_counts_only_until_the_chair_is_on_it_again(moved: FloatArray) -> None:
    straying = on_line()
    lateral, heading = -float(moved[0, 1]), -float(moved[0, 2])
    straying.note(moved, 0, lateral, heading, 0.0, SPEED)
    assert straying.seconds > 0.0
    assert straying.gentler == 1.0
    straying.note(moved, 0, 0.0, 0.0, 0.0, SPEED)
    assert straying.seconds == 0.0
    straying.note(moved, 0, 0.07, 0.0, 0.0, SPEED)
    straying.note(moved, 0, 0.0, 0.0, 0.0, SPEED)
    assert straying.seconds > 0.0, "the line does not move any more"


def test_a_line_that_creeps_is_summed_up() -> None:
    straying = on_line()
    for step in range(1, 15):
        straying.note(line(-0.005 * step), 0, 0.005 * step, 0.0, 0.0, SPEED)
    assert straying.gentler == 1.0
    assert straying.seconds == pytest.approx(0.1)


def test_neither_a_start_beside_the_line_nor_a_slow_chair_is_judged() -> None:
    beside, slow = Straying(CHAIR_A, 0.03), on_line()
    beside.note(line(), 0, 0.2, 0.0, 0.0, SPEED)
    slow.note(line(), 0, 0.2, 0.0, 0.0, JUDGED_FROM)
    assert beside.seconds == slow.seconds == 0.0


def test_a_chair_returns_to_its_line_gently_but_not_without_end() -> None:
    straying = on_line()
    straying.note(line(), 0, 2.0, 0.0, 0.0, SPEED)
    assert straying.gentler == GENTLEST


def test_a_chair_strays_from_its_next_line_too_but_not_for_beginning_beside_it() -> None:
    straying = on_line()
    straying.note(line(), 0, 0.07, 0.0, 0.0, SPEED)
    straying.begin_line()
    assert straying.seconds == pytest.approx(0.1)
    straying.note(line(0.5), 0, 0.2, 0.0, 0.0, SPEED)
    assert straying.seconds == pytest.approx(0.1, abs=STEP)
