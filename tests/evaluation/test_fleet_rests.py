"""The figure of a chair's first rest, by its track."""

from __future__ import annotations

import pytest
from evaluation.figures.fleet.drive import first_rest_s


def _track(*pieces: tuple[int, float, float]) -> list[tuple[float, float, float, float]]:
    """Return a track of pieces: steps of 0.1 s, and how far [m, rad] the chair moves and turns in each."""
    rows = [(0.0, 0.0, 0.0, 3.1)]
    for count, ahead, turn in pieces:
        for _ in range(count):
            t, x, y, theta = rows[-1]
            theta = (theta + turn + 3.141592653589793) % 6.283185307179586 - 3.141592653589793
            rows.append((t + 0.1, x + ahead, y, theta))
    return rows


def test_the_first_rest_is_between_two_movements_and_the_wait_at_the_start_is_none() -> None:
    track = _track((30, 0.0, 0.0), (20, 0.05, 0.0), (40, 0.0, 0.0), (20, 0.0, 0.05), (90, 0.0, 0.0), (5, 0.05, 0.0))
    assert first_rest_s(track) == pytest.approx(4.1, abs=0.11)


def test_a_turn_over_half_a_circle_and_a_short_stop_are_no_rest() -> None:
    assert first_rest_s(_track((20, 0.05, 0.0), (8, 0.0, 0.0), (40, 0.0, 0.05))) == 0.0


def test_a_chair_that_never_moves_rests_nowhere_on_its_way() -> None:
    assert first_rest_s(_track((30, 0.0, 0.0))) == 0.0
    assert first_rest_s([]) == 0.0
