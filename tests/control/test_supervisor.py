"""Who drives: the rider always wins, and nothing resumes by itself."""

from __future__ import annotations

import math

import pytest

from waychair.control.supervisor import Override, Situation, SupervisorSettings, supervise
from waychair.errors import ConfigError
from waychair.firmware_bridge.board import BoardSettings
from waychair.types import DriveMode, JoystickInput

MS = 1_000_000
SETTINGS = SupervisorSettings()
ASSISTING = SupervisorSettings(override=0.5, assist=True)


def situation(
    forward: float = 0.0,
    turn: float = 0.0,
    *,
    taken_over: bool = False,
    stop: bool = False,
    goal: bool = True,
    faults: tuple[str, ...] = (),
) -> Situation:
    return Situation(JoystickInput(0, forward, turn), taken_over, stop, goal, faults)


def test_a_goal_and_a_quiet_rider_let_the_computer_drive() -> None:
    assert supervise(DriveMode.MANUAL, situation(), SETTINGS).mode is DriveMode.AUTONOMOUS


@pytest.mark.parametrize("settings", [SETTINGS, ASSISTING])
@pytest.mark.parametrize("mode", list(DriveMode))
def test_f19_a_rider_who_takes_over_drives_whatever_the_mode_was(mode: DriveMode, settings: SupervisorSettings) -> None:
    assert supervise(mode, situation(0.3, taken_over=True), settings).mode is DriveMode.MANUAL


@pytest.mark.parametrize(
    ("forward", "turn"), [(0.201, 0), (-0.201, 0), (0, 0.201), (0, -1.0), (math.nan, 0), (0, math.nan), (0, math.inf)]
)
def test_f19_a_push_beyond_the_threshold_for_its_time_takes_over(forward: float, turn: float) -> None:
    override = Override(SETTINGS)
    override.update(JoystickInput(0, forward, turn))
    assert override.update(JoystickInput(10 * MS, forward, turn))


def test_a_stick_that_cannot_be_read_takes_over_at_once() -> None:
    assert Override(SETTINGS).update(JoystickInput(0, math.nan, 0.0))


@pytest.mark.parametrize("deflection", [-0.2, -0.1, 0.0, 0.1, 0.2])
def test_a_stick_within_the_threshold_does_not_take_over(deflection: float) -> None:
    override = Override(SETTINGS)
    assert not any(override.update(JoystickInput(i * MS, deflection, deflection)) for i in range(100))


@pytest.mark.parametrize(("held_ms", "wins"), [(99, False), (100, True), (300, True)])
def test_a_tremor_shorter_than_the_debounce_does_not_take_over(held_ms: int, wins: bool) -> None:
    override = Override(SupervisorSettings(override=0.4, override_ms=100))
    pushes = [override.update(JoystickInput(ms * MS, 0.5, 0.0)) for ms in range(held_ms + 1)]
    assert pushes[-1] == wins
    assert not override.update(JoystickInput((held_ms + 1) * MS))
    assert not override.update(JoystickInput((held_ms + 2) * MS, 0.5, 0.0))  # its time begins anew


def test_an_unknown_stick_is_no_push() -> None:
    override = Override(SETTINGS)
    override.update(JoystickInput(0, 1.0))
    assert not override.update(None)
    assert not override.update(JoystickInput(20 * MS, 1.0))


def test_the_defaults_are_those_of_the_board() -> None:
    board = BoardSettings()
    assert (1000 * SETTINGS.override, SETTINGS.override_ms) == (board.override_per_mille, board.override_ms)
    assert 1000 * SETTINGS.at_rest == board.neutral_per_mille


def test_a_threshold_within_rest_is_refused() -> None:
    with pytest.raises(ConfigError, match="at rest"):
        SupervisorSettings(override=0.1, at_rest=0.1)


def test_a_hand_on_the_stick_changes_nothing_unless_assistance_is_asked_for() -> None:
    assert supervise(DriveMode.AUTONOMOUS, situation(0.19), SETTINGS).mode is DriveMode.AUTONOMOUS


@pytest.mark.parametrize(
    ("deflection", "mode", "share"),
    [
        (0.0, DriveMode.AUTONOMOUS, 1.0),
        (0.1, DriveMode.AUTONOMOUS, 1.0),
        (0.3, DriveMode.ASSISTED, 0.5),
        (-0.4, DriveMode.ASSISTED, 0.25),
        (0.5, DriveMode.ASSISTED, 0.0),
        (0.6, DriveMode.ASSISTED, 0.0),
    ],
)
def test_with_assistance_a_hand_on_the_stick_slows_the_drive_down_to_nothing_at_the_threshold(
    deflection: float, mode: DriveMode, share: float
) -> None:
    verdict = supervise(DriveMode.AUTONOMOUS, situation(0.0, deflection), ASSISTING)
    assert (verdict.mode, verdict.computer_drives) == (mode, True)
    assert verdict.share == pytest.approx(share)


@pytest.mark.parametrize("mode", list(DriveMode))
def test_stop_wins_over_everything(mode: DriveMode) -> None:
    verdict = supervise(mode, situation(1.0, taken_over=True, stop=True, faults=("lidar is silent",)), SETTINGS)
    assert verdict.mode is DriveMode.STOPPED
    assert "Stop" in verdict.reason


def test_stop_stays_until_a_new_goal_is_asked_for() -> None:
    assert supervise(DriveMode.STOPPED, situation(goal=False), SETTINGS).mode is DriveMode.STOPPED
    assert supervise(DriveMode.STOPPED, situation(goal=True), SETTINGS).mode is DriveMode.AUTONOMOUS


@pytest.mark.parametrize("settings", [SETTINGS, ASSISTING])
def test_a_fault_leaves_the_riders_joystick_live_and_is_named(settings: SupervisorSettings) -> None:
    verdict = supervise(DriveMode.AUTONOMOUS, situation(0.15, faults=("the lidar is silent",)), settings)
    assert (verdict.mode, verdict.computer_drives) == (DriveMode.MANUAL, False)
    assert verdict.reason == "the lidar is silent"


def test_a_chair_whose_stick_is_unknown_still_obeys_faults_and_goals() -> None:
    unknown = Situation(None, False, False, True, ())
    assert supervise(DriveMode.MANUAL, unknown, ASSISTING).mode is DriveMode.AUTONOMOUS
    assert supervise(DriveMode.MANUAL, Situation(None, False, False, False, ()), SETTINGS).mode is DriveMode.MANUAL
