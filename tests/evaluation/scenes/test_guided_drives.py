"""The row of a table of guided drives: what passes, and what does not; a driver's true lag and nudge."""

from __future__ import annotations

import statistics
from dataclasses import replace

import numpy as np
import pytest
from evaluation.figures.guiding.blind_clutter import BOXES, CLEAR, SIDE, clutter
from evaluation.scenes.guided_drives import GuidedBars, GuidedRun, guided_row, wrongly_free
from evaluation.scenes.tight_places import door_scene, map_of
from evaluation.scenes.true_riders import NUDGES, true_rider

from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.grid.distance_field import distance_field
from waychair.planning.body.footprint import fits
from waychair.simulation.scene.contact import in_contact, solid_from_blocks
from waychair.trials.guiding.guided import GuidedSetup, SaidSymbol, guided_drive
from waychair.types import Place, Pose2

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


def test_a_symbol_that_sends_the_driver_into_a_wall_is_counted() -> None:
    world = door_scene(0.9, 0.0, CHAIR_A, 107).world
    setup = GuidedSetup(world, map_of(world), CHAIR_A)
    record = guided_drive(setup, Place("on", world.start @ Pose2(0.5), 0.5, 0.3), 0.1)
    solid, at_wall = solid_from_blocks(world.blocks), world.start @ Pose2(0.0, 0.7)  # the wall beside the door is ahead
    while not in_contact(solid, CHAIR_A, at_wall @ Pose2(0.05)):
        at_wall @= Pose2(0.02)
    told = tuple(SaidSymbol(0, symbol, "") for symbol in ("forward", "back", "swivel_left"))
    here = replace(record, told=told, times_s=np.zeros(1), truth=at_wall.array()[None])
    assert wrongly_free(here, setup) == 1
    assert wrongly_free(replace(here, truth=world.start.array()[None]), setup) == 0


def test_a_cluttered_room_is_that_of_its_seed_and_the_chair_fits_at_both_ends() -> None:
    world, goal = clutter(3)
    assert clutter(3)[0].start == world.start != clutter(4)[0].start
    field = distance_field(world.grid)
    assert fits(CHAIR_A, CLEAR, field, world.start)
    assert fits(CHAIR_A, CLEAR, field, goal.pose)
    assert goal.pose.x - world.start.x > SIDE - 3.0
    assert len(world.blocks) == 4 + BOXES


def test_the_true_lag_of_a_slower_driver_is_greater_and_a_driver_who_feels_something_else_has_none() -> None:
    default, older = (true_rider(CHAIR_A, driver, 5001) for driver in ("default", "older"))
    assert len(default.lags_s) == len(older.lags_s) == 3
    assert 0.3 < statistics.median(default.lags_s) < statistics.median(older.lags_s) < 1.5
    assert len(default.nudges) == len(NUDGES)
    assert 0.01 < statistics.median(default.nudges) < 0.1
    mistaken = true_rider(CHAIR_A, "default", 5012)
    assert len(mistaken.lags_s) < 3
    assert mistaken.nudges == ()
