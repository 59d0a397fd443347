"""The dynamic window for different chairs: delay, jerk, measured stops, and outlines at other heights."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.planning.window.test_dwa import CELL, PROMPT, hall, moved, straight
from waychair.calibration.chair_body import CHAIR_A, CHAIR_A_FRONT, CHAIR_A_MID, CHAIR_B, BodyLayer
from waychair.calibration.fits.stopping import StopTable
from waychair.maps.grid.distance_field import DistanceField, distance_field, distances
from waychair.planning.body.footprint import fits
from waychair.planning.window import dwa
from waychair.planning.window.dwa import choose
from waychair.planning.window.motion_limits import PERIOD, CommandedMotion, DwaSettings, measured, motion_after
from waychair.types import BoolArray, Path, Pose2, Twist

STOPS = StopTable(speeds=(0.2, 0.4, 0.6), distances=(0.12, 0.3, 0.6), turn_rate=0.9, turn_angle=0.8, delay_s=0.25)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=12, deadline=None)
@pytest.mark.nightly
def test_a_chair_with_its_reaction_time_as_delay_touches_nothing(seed: int) -> None:
    """Any body, in clutter, on a path through it: each command moves the chair three ticks later, and jerk is limited."""
    rng = np.random.default_rng(seed)
    body = (CHAIR_A, CHAIR_B, CHAIR_A_MID, CHAIR_A_FRONT)[seed % 4]
    obstacles: BoolArray = rng.random((120, 120)) < 0.004
    obstacles[45:75, 30:75] = False
    field, limits = DistanceField(distances(obstacles, CELL), CELL), DwaSettings(reaction_time=0.15)
    ends = [np.linspace(start, rng.uniform(0.5, 5.5), 20) for start in (2.6, 3.0)]
    path = Path(np.column_stack([*ends, np.zeros(20)]))
    pose, sent, motion = Pose2(2.6, 3.0, 0.0), [Twist()] * 4, CommandedMotion()
    for _ in range(100):
        sent.append(choose(pose, sent[-1], path, field, body, limits, motion=motion).twist)
        motion = motion_after(motion, sent[-2], sent[-1], limits)
        pose = moved(pose, sent[-4])
        assert fits(body, 0.0, field, pose)


@pytest.mark.parametrize("acceleration", [0.0, 0.3, -0.4])
def test_the_window_reaches_as_far_as_the_command_can_change_with_limited_jerk(acceleration: float) -> None:
    """In small steps: the acceleration grows by the jerk up to its limit, and with it the speed, for the window's time."""
    limits, pose, command = replace(PROMPT, jerk=0.7), Pose2(2.0, 4.0), Twist(0.2)
    motion = CommandedMotion(Twist(acceleration))
    result = choose(pose, command, straight(pose, 8.0), distance_field(hall()), CHAIR_A, limits, motion=motion)
    fastest, a = command.v, acceleration
    for _ in range(1000):
        a = min(a + limits.jerk * 0.001, limits.acceleration)
        fastest += a * 0.001
    assert result.candidates[:, 0].max() == pytest.approx(min(fastest, limits.max_speed), abs=2e-3)


@pytest.mark.parametrize(("half_width", "passes"), [(0.2, True), (0.3, False)])
def test_a_chair_drives_through_a_low_gap_that_fits_only_its_feet(half_width: float, passes: bool) -> None:
    """0.55 m between two low things, for a chair 0.6 m wide: as wide as its feet are."""
    low = np.zeros((160, 240), np.bool_)
    low[:75, 120], low[86:, 120] = True, True
    layer = BodyLayer(0.0, 0.3, CHAIR_A.front, CHAIR_A.rear, half_width)
    field = replace(distance_field(hall()), layers=((layer, distances(low, CELL)),))
    pose, command, path = Pose2(4.0, 4.025), Twist(), straight(Pose2(4.0, 4.025), 5.0)
    for _ in range(300):
        command = choose(pose, command, path, field, CHAIR_A, PROMPT).twist
        pose = moved(pose, command)
    assert (pose.x > 8.5) is passes
    assert passes or pose.x < 6.0 - CHAIR_A.front


def test_an_unmeasured_chair_crawls_and_a_measured_one_drives_up_to_its_fastest_measured_stop() -> None:
    assert measured(DwaSettings(), None).max_speed == 0.3
    limits = measured(DwaSettings(), STOPS)
    assert (limits.max_speed, limits.reaction_time, limits.stops) == (0.6, 0.25, STOPS)
    assert measured(DwaSettings(max_speed=0.2), STOPS).max_speed == 0.2


@pytest.mark.parametrize("v", [0.2, 0.3, 0.45, 0.6])
def test_the_measured_stopping_distance_must_be_free_ahead(v: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wall just within and just beyond the distance of the table: the model alone would allow both."""
    monkeypatch.setattr(dwa, "WINDOW_TIME", PERIOD)
    limits = replace(measured(PROMPT, STOPS), clearance=0.0, reaction_time=0.0)
    for spare, admitted in ((0.25, True), (-0.1, False)):
        x = round(4.0 + CHAIR_A.front + v * PERIOD + STOPS.distance(v) + spare, 2)
        field = distance_field(hall(((x, 0, x + 0.2, 8),)))
        result = choose(Pose2(4.0, 4.0), Twist(v), straight(Pose2(4.0, 4.0), 6.0), field, CHAIR_A, limits)
        near = np.argmin(np.abs(result.candidates - (v, 0.0)).sum(axis=1))
        assert np.isfinite(result.scores[near]) == admitted


@pytest.mark.parametrize("turn_angle", [0.4, 1.5])
def test_the_measured_stopping_angle_must_be_free(turn_angle: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wall that the corner would touch after a turn of some angle, for a chair that turns on by less, and by more."""
    table = replace(STOPS, turn_rate=0.8, turn_angle=turn_angle, delay_s=0.05)
    monkeypatch.setattr(dwa, "WINDOW_TIME", PERIOD)
    limits = replace(measured(DwaSettings(), table), clearance=0.0, reaction_time=0.0)
    turned = 0.75
    corner = CHAIR_A.front * math.sin(turned) + CHAIR_A.width / 2 * math.cos(turned)
    field = distance_field(hall(((0, 4.0 + corner, 8, 4.2 + corner),)))
    command = Twist(0.0, 0.8)
    result = choose(Pose2(4.0, 4.0), command, straight(Pose2(4.0, 4.0, 1.0), 6.0), field, CHAIR_A, limits)
    near = np.argmin(np.abs(result.candidates - (0.0, 0.8)).sum(axis=1))
    assert np.isfinite(result.scores[near]) == (turn_angle < turned)
