"""The row of a table of guided drives: what passes, and what does not; a driver's true lag and nudge."""

from __future__ import annotations

import statistics

import pytest
from evaluation.figures.guiding.blind_clutter import CLEAR, SIDE, clutter
from evaluation.scenes.guided_drives import GuidedBars, GuidedRun, guided_row
from evaluation.scenes.true_riders import NUDGES, true_rider

from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.grid.distance_field import distance_field
from waychair.planning.body.footprint import fits

THROUGH = GuidedRun(True, "arrived", 30.0, 10.5, 10.0, (), symbols=30)
STUCK = GuidedRun(False, "the time limit was reached", 180.0, 4.0, 10.0, (), symbols=60)
TOUCHED = GuidedRun(True, "arrived", 40.0, 10.5, 10.0, (0.04, 0.12), bumped=1, symbols=40)


def test_a_row_counts_arrivals_contacts_and_ways_of_those_who_arrived() -> None:
    row = guided_row("door", "guide", [THROUGH, STUCK, TOUCHED])
    assert (row["runs"], row["reached"], row["median_s"], row["s_per_m"], row["m_per_m"]) == (3, 2, 35.0, 3.5, 1.05)
    assert (row["contacts"], row["fastest_contact"], row["bumped_by_people"]) == (2, 0.12, 1)
    assert row["symbols_per_s"] == pytest.approx(130 / 250, abs=0.01)
    assert row["failures"] == {1: "the time limit was reached"}
    assert "passed" not in row


@pytest.mark.parametrize(
    ("found", "bars", "passed"),
    [
        ([THROUGH, STUCK], GuidedBars(0.5, 45.0, s_per_m=4.5, m_per_m=1.1, symbols_per_s=1.2), True),
        ([THROUGH, STUCK], GuidedBars(0.6), False),
        ([THROUGH], GuidedBars(0.9, 29.0), False),
        ([THROUGH], GuidedBars(0.9, m_per_m=1.0), False),
        ([STUCK], GuidedBars(0.0, 45.0), False),
        ([TOUCHED], GuidedBars(0.9), False),
    ],
)
def test_a_row_passes_only_within_all_of_its_bars_and_untouched(
    found: list[GuidedRun], bars: GuidedBars, passed: bool
) -> None:
    assert guided_row("door", "guide", found, bars)["passed"] is passed


def test_a_cluttered_room_is_that_of_its_seed_and_the_chair_fits_at_both_ends() -> None:
    world, empty, goal = clutter(3)
    assert clutter(3)[0].start == world.start != clutter(4)[0].start
    field = distance_field(world.grid)
    assert fits(CHAIR_A, CLEAR, field, world.start)
    assert fits(CHAIR_A, CLEAR, field, goal.pose)
    assert goal.pose.x - world.start.x > SIDE - 3.0
    assert (world.grid.cells > 50).sum() > (empty.grid.cells > 50).sum()


def test_the_true_lag_of_a_slower_driver_is_greater_and_a_driver_who_feels_something_else_has_none() -> None:
    default, older = (true_rider(CHAIR_A, driver, 5001) for driver in ("default", "older"))
    assert len(default.lags_s) == len(older.lags_s) == 3
    assert 0.3 < statistics.median(default.lags_s) < statistics.median(older.lags_s) < 1.5
    assert len(default.nudges) == len(NUDGES)
    assert 0.01 < statistics.median(default.nudges) < 0.1
    mistaken = true_rider(CHAIR_A, "default", 5012)
    assert len(mistaken.lags_s) < 3
    assert mistaken.nudges == ()
