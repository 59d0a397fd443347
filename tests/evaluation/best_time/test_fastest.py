"""The least time against closed forms, and the motion against its limits and the exact outline."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from evaluation.best_time.comfort import comfort_of, rest_to_rest, straight_time, turn_time
from evaluation.best_time.fastest import best_drive
from evaluation.best_time.gaps import surroundings
from evaluation.best_time.kept import kept_best_drive
from evaluation.best_time.motion import BestDrive, Motion, faults, within_limits

from tests.evaluation.best_time.test_first_way import wall_with_gap
from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import NoPath
from waychair.simulation.scene.contact import in_contact, solid_from_blocks
from waychair.types import Pose2

COMFORT = comfort_of()
NOTHING = surroundings(solid_from_blocks([]), CHAIR_A)
GAP = 0.03
"""Part by which the time on a grid of times may exceed a closed form."""


def test_the_closed_form_of_a_line_is_the_integral_of_its_profile() -> None:
    """0.8 m/s at 0.5, 0.6 m/s^2 and 0.7 m/s^3: ramps of 2.314 s and 2.190 s, 1.802 m long, and 0.8 m/s between."""
    assert straight_time(10.0, COMFORT) == pytest.approx(2.3143 + 2.1905 + (10.0 - 1.80190) / 0.8, abs=1e-3)
    # 4 cm: two pairs of jerk phases; with t each, length 2 j t^3
    assert straight_time(0.04, COMFORT) == pytest.approx(4 * math.cbrt(0.04 / (2 * 0.7)), rel=1e-6)
    assert rest_to_rest(0.0, 1.0, 1.0, 1.0, 1.0) == 0.0


@pytest.mark.parametrize(
    ("goal", "least"),
    [
        (Pose2(6.0, 0.0, 0.0), straight_time(6.0, COMFORT)),
        (Pose2(0.0, 0.0, math.pi / 2), turn_time(math.pi / 2, COMFORT)),
        (Pose2(-0.3, 0.0, 0.0), straight_time(0.3, COMFORT, backwards=True)),
    ],
    ids=["line", "turn", "back"],
)
def test_a_line_a_turn_and_a_short_way_back_take_as_long_as_their_closed_forms(goal: Pose2, least: float) -> None:
    drive = best_drive(NOTHING, Pose2(), goal, COMFORT)
    assert least * (1 - 1e-3) <= drive.seconds <= least * (1 + GAP)


def test_an_s_of_two_arcs_is_as_fast_as_its_path_allows() -> None:
    """Two arcs that shift the chair by 1 m over 4 m: no faster than their chord, hardly slower than the line."""
    goal = Pose2(4.0, 1.0, 0.0)
    drive = best_drive(NOTHING, Pose2(), goal, COMFORT)
    radius = (4.0**2 + 1.0**2) / (4 * 1.0)  # of each arc: 4.25 m, where full speed is comfortable
    arcs = 2 * radius * 2 * math.atan(0.25)
    assert straight_time(math.hypot(4.0, 1.0), COMFORT) <= drive.seconds <= straight_time(arcs, COMFORT) * (1 + GAP)


def test_the_motion_keeps_every_limit_between_the_knots_too() -> None:
    drive = best_drive(NOTHING, Pose2(), Pose2(2.0, 2.0, math.pi / 2), COMFORT)
    dt = drive.times_s[1] - drive.times_s[0]
    v, omega = drive.twists.T
    a, alpha = np.diff(v) / dt, np.diff(omega) / dt
    assert v.max() <= COMFORT.speed * 1.01
    assert np.abs(omega).max() <= COMFORT.turn_rate * 1.01
    assert np.abs(v * omega).max() <= COMFORT.lateral * 1.03
    assert -COMFORT.braking * 1.001 <= a.min() < a.max() <= COMFORT.acceleration * 1.001
    assert np.abs(alpha).max() <= COMFORT.turn_acceleration * 1.001
    assert np.abs(np.diff(a) / dt).max() <= COMFORT.jerk * 1.01
    assert np.abs(np.diff(alpha) / dt).max() <= COMFORT.turn_jerk * 1.01
    moved = np.hypot(*np.diff(drive.poses[:, :2], axis=0).T)
    assert moved == pytest.approx(np.abs((v[1:] + v[:-1]) / 2) * dt, abs=1e-3)


def test_a_detour_through_a_door_keeps_the_exact_outline_free_and_takes_longer_than_the_straight_line() -> None:
    start, goal = Pose2(0.0, 1.0, 0.0), Pose2(4.0, 1.0, 0.0)
    solid = solid_from_blocks(wall_with_gap(0.8))
    drive = best_drive(surroundings(solid, CHAIR_A), start, goal, COMFORT)
    assert not any(in_contact(solid, CHAIR_A, Pose2(*pose)) for pose in drive.poses)
    assert drive.seconds > straight_time(2 * math.hypot(2.0, 1.0 - 0.4), COMFORT)  # by the gap's nearer edge


def test_a_motion_that_breaks_a_limit_or_touches_something_is_named() -> None:
    times = np.linspace(0.0, 10.0, 101)
    poses = np.column_stack([0.4 * times, np.zeros(101), np.zeros(101)])
    drive = BestDrive(10.0, times, poses, np.column_stack([np.full(101, 0.4), np.zeros(101)]), 10.0)
    goal = Pose2(4.0, 0.0, 0.0)
    assert faults(NOTHING, drive, goal, COMFORT) == ""
    assert "too fast" in faults(NOTHING, drive, goal, replace(COMFORT, speed=0.39))
    assert "ends 1.000 m" in faults(NOTHING, drive, Pose2(5.0, 0.0, 0.0), COMFORT)
    narrow = surroundings(solid_from_blocks(wall_with_gap(0.55)), CHAIR_A)
    assert "touches something" in faults(narrow, drive, goal, COMFORT)


def test_a_motion_a_little_beyond_a_limit_lasts_as_much_longer_as_the_limit_asks_for() -> None:
    motion = Motion(np.zeros((11, 7)), np.zeros((10, 2)), 0.25)
    times, poses = np.linspace(0.0, 2.5, 101), np.zeros((101, 3))
    for v, omega, longer in (
        (0.5, 0.5, 1.0),
        (0.84, 0.0, 1.05),
        (-0.21, 0.0, 1.05),
        (0.66, 0.7878788, 1.02),
        (1.6, 0.0, 1.0),
    ):
        drive = BestDrive(2.5, times, poses, np.broadcast_to([v, omega], (101, 2)), 2.5)
        assert within_limits(motion, drive, COMFORT).seconds == pytest.approx(2.5 * longer, rel=1e-3)


def test_a_best_drive_is_computed_once_and_a_missing_one_keeps_its_reason(tmp_path: Path) -> None:
    solid = solid_from_blocks(wall_with_gap(0.55))
    found = kept_best_drive(solid, CHAIR_A, Pose2(2.0, 0.0, 0.0), Pose2(4.0, 0.0, 0.0), COMFORT, tmp_path)
    assert isinstance(found, NoPath)
    (path,) = tmp_path.iterdir()
    path.write_bytes(path.read_bytes().replace(b"the start", b"the begin"))
    again = kept_best_drive(solid, CHAIR_A, Pose2(2.0, 0.0, 0.0), Pose2(4.0, 0.0, 0.0), COMFORT, tmp_path)
    assert "the begin" in str(again)
