"""Stops, swings, slow stretches and turning of motions that are made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from evaluation.scenes.way_manners import WayManners, manners_of

from waychair.trials.ride import TrueMotion
from waychair.types import Pose2


def _driven(parts: list[tuple[float, float, float]], people: float = math.inf) -> WayManners:
    """Return the manners of a motion of parts (seconds, v, omega) from the origin; the goal is where it ends."""
    twists = np.concatenate([np.tile([v, omega], (round(100 * seconds), 1)) for seconds, v, omega in parts])
    theta = np.cumsum(twists[:, 1]) * 0.01
    poses = np.cumsum(np.column_stack([twists[:, 0] * np.cos(theta), twists[:, 0] * np.sin(theta)]), axis=0) * 0.01
    stamps = (np.arange(len(twists)) * 10_000_000).astype(np.int64)
    motion = TrueMotion(stamps, np.column_stack([poses, theta]), twists, np.full(len(twists), people))
    return manners_of(motion, Pose2(), Pose2(float(poses[-1, 0]), float(poses[-1, 1]), 0.0))


def test_a_stop_on_the_way_counts_and_one_at_the_start_or_the_goal_does_not() -> None:
    way = [(2.0, 0.0, 0.0), (4.0, 0.5, 0.0), (0.5, 0.0, 0.0), (4.0, 0.5, 0.0), (2.0, 0.0, 0.0)]
    assert _driven(way).stops == 1
    assert _driven([way[0], way[1], way[3], way[4]]).stops == 0


def test_a_short_stand_and_a_stand_for_a_person_are_no_faultless_stops() -> None:
    assert _driven([(4.0, 0.5, 0.0), (0.25, 0.0, 0.0), (4.0, 0.5, 0.0)]).stops == 0
    way = [(4.0, 0.5, 0.0), (3.0, 0.0, 0.0), (4.0, 0.5, 0.0)]
    assert _driven(way, people=1.5).stops == 0
    assert _driven(way, people=2.5).stops == 1


def test_turns_back_and_forth_are_counted_within_a_stand_and_all_turning_is_added_up() -> None:
    fro = _driven([(4.0, 0.5, 0.0), (1.0, 0.0, 0.6), (0.2, 0.0, 0.0), (1.0, 0.0, -0.6), (4.0, 0.5, 0.0)])
    assert (fro.stops, fro.swings) == (1, 1)
    assert fro.turned == pytest.approx(1.2, abs=0.02)
    apart = _driven([(1.0, 0.0, 0.6), (4.0, 0.5, 0.0), (1.0, 0.0, -0.6)])
    assert apart.swings == 0


def test_the_slow_share_is_that_of_the_time_below_thirty_centimetres_a_second() -> None:
    assert _driven([(3.0, 0.2, 0.0), (7.0, 0.5, 0.0)]).slow_share == pytest.approx(0.3)


def test_a_drive_that_was_refused_at_once_has_no_manners() -> None:
    nothing = TrueMotion(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0))
    assert manners_of(nothing, Pose2(), Pose2(5.0, 0.0, 0.0)) == WayManners(0, 0, 0.0, 0.0, 0.0)
