"""A chair that answers its commands late is noticed by its own motion, and steered from where it will be."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.answer_time import UNPROVEN_S, AnswerTime
from waychair.planning.body.footprint import along_arc
from waychair.planning.window.motion_limits import PERIOD
from waychair.types import Pose2, Twist

REACTION_S, LAG_S = 0.15, 0.1


def way_of_commands(seconds: float) -> list[Twist]:
    """Commands as of a drive that sets off and swings about its line."""
    times = np.arange(0.0, seconds, PERIOD)
    return [Twist(min(0.4, 0.4 * t), 0.3 * math.sin(2.0 * t)) for t in times.tolist()]


def driven(late_s: float, seconds: float = 4.0, gain: float = 1.0, watch: AnswerTime | None = None) -> AnswerTime:
    """The watch of a chair that answers so much later than its file says, with a lag and noise of the odometry."""
    rng, watch = np.random.default_rng(1), watch or AnswerTime(CHAIR_A.track, REACTION_S + PERIOD)
    pose, speed = Pose2(), np.zeros(2)
    on_the_way = deque([Twist()] * round((REACTION_S - LAG_S / 2 + late_s) / PERIOD))
    for command in [Twist(), *way_of_commands(seconds)]:
        on_the_way.append(command)
        acting = on_the_way.popleft()
        speed += (gain * np.array([acting.v, acting.omega]) - speed) * PERIOD / LAG_S
        pose = Pose2(*along_arc(pose.x, pose.y, pose.theta, *speed.tolist(), PERIOD))
        noise = rng.normal(0.0, (2e-4, 0.0, 4e-4))
        watch.note_pose(command, pose @ Pose2(*noise.tolist()))
    return watch


@pytest.mark.parametrize("gain", [0.85, 1.0, 1.15])
def test_a_chair_as_its_file_says_is_not_late_and_shows_it_within_a_second(gain: float) -> None:
    assert driven(0.0, seconds=1.0, gain=gain).late_s == 0.0
    assert driven(0.0, gain=gain).late_s == 0.0


@pytest.mark.parametrize("late_s", [0.2, 0.3, 0.4])
def test_a_late_chair_is_noticed(late_s: float) -> None:
    assert driven(late_s, seconds=1.5).late_s > 0.0
    assert driven(late_s).late_s == pytest.approx(late_s, abs=PERIOD + 1e-9)


def test_a_chair_that_has_not_moved_yet_may_be_late() -> None:
    watch = AnswerTime(CHAIR_A.track, REACTION_S + PERIOD)
    for _ in range(40):
        watch.note_pose(Twist(), Pose2())
    assert (watch.late_s, watch.may_be_late_s) == (0.0, UNPROVEN_S)
    assert watch.answered(Pose2(1.0, 2.0, 0.3)) == Pose2(1.0, 2.0, 0.3)


def test_a_late_chair_is_expected_where_its_late_commands_take_it() -> None:
    watch = driven(0.4)
    late = round(watch.late_s / PERIOD)
    assert late >= 7
    commands, age = way_of_commands(4.0), round(REACTION_S / PERIOD) + 1
    expected = np.array([1.0, 2.0, 0.3])
    for command in commands[len(commands) - age - late : len(commands) - age]:
        expected = np.array(along_arc(*expected.tolist(), command.v, command.omega, PERIOD))
    found = watch.answered(Pose2(1.0, 2.0, 0.3))
    np.testing.assert_allclose(found.array(), expected, atol=1e-9)
    assert math.hypot(found.x - 1.0, found.y - 2.0) > 0.1


def test_a_chair_that_answers_in_time_again_is_no_longer_late() -> None:
    watch = driven(0.4)
    assert watch.late_s > 0.0
    assert driven(0.0, seconds=20.0, watch=watch).late_s == 0.0


def test_a_jump_of_the_odometry_tells_nothing() -> None:
    watch = driven(0.0)
    watch.note_pose(Twist(0.4, 0.0), Pose2(50.0, 3.0, 1.0))
    assert watch.late_s == 0.0
