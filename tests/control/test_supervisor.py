"""Who drives: the rider always wins, and nothing resumes by itself."""

from __future__ import annotations

import math

import pytest

from waychair.control.supervisor import Situation, SupervisorSettings, supervise
from waychair.types import DriveMode, JoystickInput

SETTINGS = SupervisorSettings()


def situation(
    forward: float = 0.0, turn: float = 0.0, *, stop: bool = False, goal: bool = True, faults: tuple[str, ...] = ()
) -> Situation:
    return Situation(JoystickInput(0, forward, turn), stop, goal, faults)


def test_a_goal_and_a_quiet_rider_let_the_computer_drive() -> None:
    assert supervise(DriveMode.MANUAL, situation(), SETTINGS).mode is DriveMode.AUTONOMOUS


@pytest.mark.parametrize("mode", list(DriveMode))
@pytest.mark.parametrize(
    ("forward", "turn"), [(0.11, 0), (-0.11, 0), (0, 0.11), (0, -1.0), (math.nan, 0), (0, math.nan)]
)
def test_joystick_overrides_every_mode_within_one_tick(mode: DriveMode, forward: float, turn: float) -> None:
    assert supervise(mode, situation(forward, turn), SETTINGS).mode is DriveMode.MANUAL


@pytest.mark.parametrize("deflection", [-0.1, -0.05, 0.0, 0.05, 0.1])
def test_a_stick_at_rest_does_not_take_over(deflection: float) -> None:
    assert supervise(DriveMode.AUTONOMOUS, situation(deflection), SETTINGS).mode is DriveMode.AUTONOMOUS


@pytest.mark.parametrize("mode", list(DriveMode))
def test_stop_wins_over_everything(mode: DriveMode) -> None:
    verdict = supervise(mode, situation(1.0, stop=True, faults=("lidar is silent",)), SETTINGS)
    assert verdict.mode is DriveMode.STOPPED
    assert "Stop" in verdict.reason


def test_stop_stays_until_a_new_goal_is_asked_for() -> None:
    assert supervise(DriveMode.STOPPED, situation(goal=False), SETTINGS).mode is DriveMode.STOPPED
    assert supervise(DriveMode.STOPPED, situation(goal=True), SETTINGS).mode is DriveMode.AUTONOMOUS


def test_a_fault_leaves_the_riders_joystick_live_and_is_named() -> None:
    verdict = supervise(DriveMode.AUTONOMOUS, situation(faults=("the lidar is silent",)), SETTINGS)
    assert verdict.mode is DriveMode.MANUAL
    assert verdict.reason == "the lidar is silent"


def test_a_chair_without_a_joystick_message_still_obeys_faults_and_goals() -> None:
    assert supervise(DriveMode.MANUAL, Situation(None, False, True, ()), SETTINGS).mode is DriveMode.AUTONOMOUS
    assert supervise(DriveMode.MANUAL, Situation(None, False, False, ()), SETTINGS).mode is DriveMode.MANUAL
