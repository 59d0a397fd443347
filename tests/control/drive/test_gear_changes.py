"""Moving to and fro before people ends: after four changes of gear a chair waits instead of backing again."""

from __future__ import annotations

import numpy as np

from tests.control.drive.navigator_hall import drive, hall, navigator, segment
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.drive.navigator import Stage
from waychair.control.drive.navigator_state import MOST_CHANGES, GearChanges
from waychair.control.drive.recovery import Recovery, RecoverySettings
from waychair.maps.grid.distance_field import DistanceField, distances
from waychair.planning.window.motion_limits import DwaSettings
from waychair.types import Goal, Pose2, Twist


def driven(*ways: float) -> GearChanges:
    """Return the changes after ways [m] in steps of a centimetre, negative ones backwards."""
    gears = GearChanges()
    for way in ways:
        for _ in range(round(abs(way) / 0.01)):
            gears.note(0.01 if way > 0.0 else -0.01)
    return gears


def test_four_changes_are_enough_and_the_last_one_is_forwards() -> None:
    assert not driven(0.5, -0.3).are_enough
    assert not driven(0.5, -0.3, 0.3, -0.3).are_enough  # it may end this backing
    forwards = driven(0.5, -0.3, 0.3, -0.3, 0.3)
    assert forwards.count == MOST_CHANGES
    assert forwards.are_enough
    assert driven(-0.5, 0.3, -0.3, 0.3).are_enough  # one more would end in a fifth


def test_a_metre_one_way_counts_anew() -> None:
    gears = driven(0.5, -0.3, 0.3, -0.3, 0.3)
    for _ in range(80):
        gears.note(0.01)
    assert not gears.are_enough


def test_the_noise_of_wheels_at_rest_is_no_change_of_gear_and_a_slow_roll_back_is() -> None:
    gears = driven(0.5)
    for step in (-0.002, 0.002, -0.003, 0.0, 0.001):
        gears.note(step)
    assert gears.count == 0
    for _ in range(10):
        gears.note(-0.001)
    assert gears.count == 1


def test_a_stuck_chair_that_must_not_back_has_no_tries_left() -> None:
    recovery, field = (
        Recovery(RecoverySettings()),
        DistanceField(distances(np.zeros((200, 200), np.bool_), 0.05), 0.05, Pose2(-5, -5)),
    )
    for tick in range(200):
        choice = recovery.step(
            tick * 50_000_000, Pose2(), 3.0, Twist(), lambda: field, CHAIR_A, DwaSettings(), may_back=False
        )
        assert choice is None
    assert recovery.exhausted
    assert not recovery.backing


def test_before_things_a_chair_that_has_changed_gear_enough_still_backs_to_a_goal_behind_it() -> None:
    pilot = navigator(hall((0.0, 0.0, 12.0, 3.55), (0.0, 4.45, 12.0, 8.0)))
    pilot.go(Goal(Pose2(2.0, 4.0, 0.0)))
    pilot._now.gears = driven(0.5, -0.3, 0.3, -0.3, 0.3)
    states, _ = drive(pilot, Pose2(5.0, 4.0, 0.0), 20, segment(6.1, 3.6, 6.1, 4.4))
    assert states[-1].stage is Stage.ARRIVED
