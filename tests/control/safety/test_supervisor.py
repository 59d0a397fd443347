"""The supervisor: the rider always has priority, and nothing resumes by itself."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.control.safety.stops import BY_MAP_ONLY, STOPS, Braking, Halt, Severity, halt
from waychair.control.safety.supervisor import (
    DRIVEN,
    TABLE,
    Override,
    Situation,
    SupervisorEvent,
    SupervisorSettings,
    SupervisorVerdict,
    event_in,
    supervise,
)
from waychair.errors import ConfigError
from waychair.firmware_bridge.board import BoardSettings
from waychair.types import DriveMode, JoystickInput

MS = 1_000_000
SETTINGS = SupervisorSettings()
ASSISTING = SupervisorSettings(override=0.5, assist=True)


LIDAR = halt("lidar_stale")
MODES = st.sampled_from(list(DriveMode))
SITUATIONS = st.builds(
    Situation,
    st.none() | st.builds(JoystickInput, st.just(0), st.floats(-1, 1), st.floats(-1, 1)),
    st.booleans(),
    st.booleans(),
    st.booleans(),
    st.booleans(),
    st.booleans(),
    st.lists(st.sampled_from([LIDAR, halt("obstacle"), halt("battery_low"), halt("disobeys")]), max_size=2).map(tuple),
)


def situation(
    forward: float = 0.0,
    turn: float = 0.0,
    *,
    taken_over: bool = False,
    stop: bool = False,
    goal: bool = True,
    requested: bool = False,
    confirmed: bool = False,
    halts: tuple[Halt, ...] = (),
) -> Situation:
    return Situation(JoystickInput(0, forward, turn), taken_over, stop, goal, requested, confirmed, halts)


def test_the_table_is_complete_and_only_an_act_of_a_person_leads_from_rest_to_motion() -> None:
    assert set(TABLE) == {(mode, event) for mode in DriveMode for event in SupervisorEvent}
    begins = {event for (mode, event), after in TABLE.items() if mode not in DRIVEN and after in DRIVEN}
    assert begins == {SupervisorEvent.CONFIRM, SupervisorEvent.STEER}
    ends = {
        SupervisorEvent.STOP,
        SupervisorEvent.TAKE_OVER,
        SupervisorEvent.FAULT,
        SupervisorEvent.NO_GOAL,
        SupervisorEvent.REFUSAL,
        SupervisorEvent.REQUEST,
    }
    assert not any(TABLE[mode, event] in DRIVEN for mode in DriveMode for event in ends)


@given(MODES, st.lists(SITUATIONS, max_size=12), st.sampled_from([SETTINGS, ASSISTING]))
def test_after_a_fault_nothing_moves_until_a_person_confirms_without_a_fault_present(
    mode: DriveMode, then: list[Situation], settings: SupervisorSettings
) -> None:
    mode = supervise(mode, situation(halts=(LIDAR,), confirmed=True, requested=True), settings).mode
    assert mode not in DRIVEN
    for now in then:
        verdict = supervise(mode, now, settings)
        if verdict.computer_drives and mode not in DRIVEN:
            assert now.confirmed
            assert now.goal_active
            assert not now.taken_over
            assert not now.stop_pressed
            assert not {LIDAR, halt("disobeys"), halt("battery_low")} & set(now.halts)
        mode = verdict.mode


@given(MODES, SITUATIONS, st.sampled_from([SETTINGS, ASSISTING]))
def test_every_cause_that_stops_the_computer_is_told_in_words(
    mode: DriveMode, now: Situation, settings: SupervisorSettings
) -> None:
    verdict = supervise(mode, now, settings)
    assert verdict.computer_drives or verdict.reason
    assert verdict.computer_drives == (verdict.mode in DRIVEN)
    assert 0.0 <= verdict.share <= 1.0


def test_a_goal_without_confirmation_moves_nothing() -> None:
    verdict = supervise(DriveMode.MANUAL, situation(), SETTINGS)
    assert (verdict.mode, verdict.drops_goal) == (DriveMode.MANUAL, False)
    assert "press Drive" in verdict.reason


def test_a_confirmation_during_a_fault_is_dropped() -> None:
    verdict = supervise(DriveMode.MANUAL, situation(confirmed=True, halts=(LIDAR,)), SETTINGS)
    assert (verdict.mode, verdict.drops_goal, verdict.halt) == (DriveMode.MANUAL, True, LIDAR)


def test_a_low_battery_lets_a_drive_continue_and_none_begin() -> None:
    low = (halt("battery_low"),)
    assert supervise(DriveMode.AUTONOMOUS, situation(halts=low), SETTINGS).mode is DriveMode.AUTONOMOUS
    refused = supervise(DriveMode.MANUAL, situation(confirmed=True, halts=low), SETTINGS)
    assert (refused.mode, refused.drops_goal) == (DriveMode.MANUAL, True)


def test_an_obstacle_pauses_a_drive_and_does_not_end_it() -> None:
    near = situation(halts=(halt("obstacle"),))
    assert supervise(DriveMode.AUTONOMOUS, near, SETTINGS) == SupervisorVerdict(DriveMode.AUTONOMOUS)


def test_the_gravest_of_several_halts_is_named_and_decides_how_to_brake() -> None:
    verdict = supervise(DriveMode.AUTONOMOUS, situation(halts=(halt("lost"), halt("disobeys"))), SETTINGS)
    assert verdict.halt == halt("disobeys")
    assert verdict.braking is Braking.RELEASE
    assert supervise(DriveMode.AUTONOMOUS, situation(halts=(halt("lost"),)), SETTINGS).braking is Braking.COMFORT


def test_a_new_goal_needs_its_own_confirmation() -> None:
    verdict = supervise(DriveMode.AUTONOMOUS, situation(requested=True), SETTINGS)
    assert (verdict.mode, verdict.drops_goal, verdict.braking) == (DriveMode.MANUAL, False, Braking.COMFORT)
    assert supervise(DriveMode.AUTONOMOUS, situation(requested=True, confirmed=True), SETTINGS).computer_drives


def test_the_gravest_of_simultaneous_events_counts() -> None:
    everything = situation(0.5, taken_over=True, stop=True, goal=False, requested=True, confirmed=True, halts=(LIDAR,))
    assert event_in(everything, ASSISTING) is SupervisorEvent.STOP


def test_a_confirmed_goal_and_a_quiet_rider_let_the_computer_drive() -> None:
    assert supervise(DriveMode.MANUAL, situation(confirmed=True), SETTINGS).mode is DriveMode.AUTONOMOUS
    assert supervise(DriveMode.AUTONOMOUS, situation(), SETTINGS).mode is DriveMode.AUTONOMOUS


@pytest.mark.parametrize("settings", [SETTINGS, ASSISTING])
@pytest.mark.parametrize("mode", list(DriveMode))
def test_f19_a_rider_who_takes_over_drives_in_every_mode(mode: DriveMode, settings: SupervisorSettings) -> None:
    assert supervise(mode, situation(0.3, taken_over=True), settings).mode is DriveMode.MANUAL


@pytest.mark.parametrize(
    ("forward", "turn"), [(0.201, 0), (-0.201, 0), (0, 0.201), (0, -1.0), (math.nan, 0), (0, math.nan), (0, math.inf)]
)
def test_f19_a_push_beyond_the_threshold_for_the_debounce_time_takes_over(forward: float, turn: float) -> None:
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
    assert not override.update(JoystickInput((held_ms + 2) * MS, 0.5, 0.0))  # its time starts again


def test_an_unknown_stick_does_not_count_as_a_push() -> None:
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


def test_a_hand_on_the_stick_changes_nothing_unless_assistance_is_enabled() -> None:
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
def test_stop_has_priority_over_everything(mode: DriveMode) -> None:
    verdict = supervise(mode, situation(1.0, taken_over=True, stop=True, confirmed=True, halts=(LIDAR,)), SETTINGS)
    assert verdict.mode is DriveMode.STOPPED
    assert "Stop" in verdict.reason


def test_stop_stays_until_a_new_goal_is_confirmed() -> None:
    assert supervise(DriveMode.STOPPED, situation(goal=False), SETTINGS).mode is DriveMode.STOPPED
    assert supervise(DriveMode.STOPPED, situation(goal=True, requested=True), SETTINGS).mode is DriveMode.STOPPED
    assert supervise(DriveMode.STOPPED, situation(goal=True, confirmed=True), SETTINGS).mode is DriveMode.AUTONOMOUS


@pytest.mark.parametrize("settings", [SETTINGS, ASSISTING])
def test_a_fault_is_named_and_leaves_the_riders_joystick_live(settings: SupervisorSettings) -> None:
    verdict = supervise(DriveMode.AUTONOMOUS, situation(0.15, halts=(LIDAR,)), settings)
    assert (verdict.mode, verdict.computer_drives, verdict.drops_goal) == (DriveMode.MANUAL, False, True)
    assert verdict.reason == "the lidar is silent: check its cable and power"


def test_a_chair_with_an_unknown_stick_still_obeys_faults_and_goals() -> None:
    unknown = Situation(None, False, False, True, False, True)
    assert supervise(DriveMode.MANUAL, unknown, ASSISTING).mode is DriveMode.AUTONOMOUS
    nothing = Situation(None, False, False, False, False, False)
    assert supervise(DriveMode.MANUAL, nothing, SETTINGS).mode is DriveMode.MANUAL


@given(MODES, SITUATIONS)
def test_steering_moves_the_chair_in_every_mode_unless_stop_the_rider_or_a_fault_comes_first(
    mode: DriveMode, now: Situation
) -> None:
    verdict = supervise(mode, replace(now, steered=True), SETTINGS)
    assert verdict.steered == (event_in(replace(now, steered=True), SETTINGS) is SupervisorEvent.STEER)
    assert not (verdict.steered and (now.stop_pressed or now.taken_over))
    assert not verdict.steered or (verdict.mode is DriveMode.ASSISTED and verdict.drops_goal == now.goal_active)


@pytest.mark.parametrize("stop_id", sorted(STOPS))
def test_steering_is_stopped_by_every_fault_except_those_of_the_map(stop_id: str) -> None:
    against = STOPS[stop_id].severity >= Severity.ENDS and stop_id not in BY_MAP_ONLY
    steering = replace(situation(goal=False, halts=(halt(stop_id),)), steered=True)
    assert supervise(DriveMode.MANUAL, steering, SETTINGS).steered != against
    assert not supervise(DriveMode.MANUAL, replace(steering, steered=False), SETTINGS).computer_drives


def test_steering_ends_a_drive_and_it_does_not_resume() -> None:
    steered = supervise(DriveMode.AUTONOMOUS, replace(situation(), steered=True), SETTINGS)
    assert (steered.mode, steered.drops_goal) == (DriveMode.ASSISTED, True)
    after = supervise(steered.mode, situation(goal=False), SETTINGS)
    assert (after.mode, after.computer_drives) == (DriveMode.MANUAL, False)


@pytest.mark.parametrize("mode", [DriveMode.MANUAL, DriveMode.STOPPED, DriveMode.GUARDED])
def test_a_rider_with_the_guard_drives_within_its_caps_and_neither_a_push_nor_a_fault_ends_it(mode: DriveMode) -> None:
    for case in (situation(goal=False), situation(0.9, taken_over=True), situation(halts=(LIDAR,), goal=False)):
        verdict = supervise(mode, replace(case, guarded=True), SETTINGS)
        assert (verdict.mode, verdict.guarded, verdict.computer_drives) == (DriveMode.GUARDED, True, False)
        assert not verdict.drops_goal
        assert not supervise(mode, case, SETTINGS).guarded
    waiting = supervise(mode, replace(situation(), guarded=True), SETTINGS)
    assert waiting.reason == halt("unconfirmed").text


def test_stop_and_a_refused_drive_leave_the_guard_and_a_confirmed_one_takes_the_lines_from_it() -> None:
    stopped = supervise(DriveMode.GUARDED, replace(situation(stop=True), guarded=True), SETTINGS)
    assert (stopped.mode, stopped.guarded) == (DriveMode.STOPPED, True)
    refused = situation(confirmed=True, halts=(halt("battery_low"),))
    assert supervise(DriveMode.GUARDED, replace(refused, guarded=True), SETTINGS).guarded
    begun = supervise(DriveMode.GUARDED, replace(situation(confirmed=True), guarded=True), SETTINGS)
    assert (begun.mode, begun.guarded) == (DriveMode.AUTONOMOUS, False)
    steered = supervise(DriveMode.GUARDED, replace(situation(goal=False), steered=True, guarded=True), SETTINGS)
    assert (steered.steered, steered.guarded) == (True, False)
