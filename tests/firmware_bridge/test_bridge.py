"""The bridge with the shipped firmware: commands that pass, causes of a release, and the values really sent."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.firmware_bridge.bridged import BOARD, GOOD, MS, NEUTRAL_MV, TICK_MS, Bridged
from waychair.calibration.fits.dac import DEFAULT, LinearDac
from waychair.calibration.fits.fitted_dac import FittedDac
from waychair.firmware_bridge import bridge as bridge_module
from waychair.firmware_bridge import line_counts
from waychair.firmware_bridge.board import BoardSettings
from waychair.firmware_bridge.bridge import TAKEN_OVER
from waychair.firmware_bridge.protocol import (
    BoardFault,
    BoardState,
    Family,
    Holder,
)
from waychair.types import WheelSpeeds


def test_a_new_bridge_sends_nothing_and_gives_the_reason(link: Bridged) -> None:
    sent = link.bridge.send(GOOD, 0, 0)
    assert (sent.active, sent.wheel_speeds) == (False, WheelSpeeds())
    assert "silent" in sent.reason
    assert link.bridge.trouble == (sent.reason,)
    assert link.live(1).holder is Holder.JOYSTICK


def test_f7_driving_is_preceded_by_two_seconds_of_zero(link: Bridged) -> None:
    assert "two seconds" in link.run(1900, GOOD).reason
    assert link.joystick_is_live
    assert not any(sent.active for sent in link.sent)
    link.drive()


def test_f7_a_deflected_stick_delays_arming_with_advice(link: Bridged) -> None:
    link.push_stick(0.15)
    assert "let go" in link.run(3000, GOOD).reason
    assert link.joystick_is_live
    link.push_stick(0.0)
    link.drive()


def test_the_sent_command_is_on_the_lines(link: Bridged) -> None:
    sent = link.drive(WheelSpeeds(0.4, 0.5))
    assert link.lines.forward_mv == pytest.approx(1000 * sent.forward_volts, abs=1)
    assert link.lines.turn_mv == pytest.approx(1000 * sent.turn_volts, abs=1)
    assert (sent.forward_counts, sent.turn_counts) == DEFAULT.counts_from_wheel_speeds(WheelSpeeds(0.4, 0.5))
    assert sent.wheel_speeds.left == pytest.approx(0.4, abs=0.018)
    assert sent.wheel_speeds.right == pytest.approx(0.5, abs=0.018)


def test_a_command_refused_by_a_full_cable_counts_as_unsent_and_does_not_change_the_slew(
    link: Bridged, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = link.drive(WheelSpeeds(0.1, 0.1))
    link.live(10, beats=False)
    monkeypatch.setattr(link.board.transport, "write", lambda data: False)
    sent = link.send(WheelSpeeds(0.8, 0.8))
    assert "full" in sent.reason
    assert replace(sent, stamp_ns=0, reason="") == replace(before, stamp_ns=0, reason="")
    link.live(20, beats=False)
    assert link.lines.forward_mv == pytest.approx(1000 * sent.forward_volts, abs=1)
    monkeypatch.undo()
    later = link.send(WheelSpeeds(0.8, 0.8))
    link.live(5, beats=False)
    assert before.forward_volts < later.forward_volts <= before.forward_volts + 0.006 * 20 + 0.01
    assert later.reason == ""


def test_a_zero_command_refused_by_a_full_cable_does_not_count_as_driving(
    link: Bridged, monkeypatch: pytest.MonkeyPatch
) -> None:
    link.run(1000, None)
    monkeypatch.setattr(link.board.transport, "write", lambda data: False)
    sent = link.send(GOOD)
    assert (sent.active, sent.wheel_speeds, "full" in sent.reason) == (False, WheelSpeeds(), True)


def test_a_fitted_calibration_drives_the_chair_too(board_program: Path) -> None:
    with Bridged(board_program, replace(BOARD, dac_bits=12), calibration=FittedDac()) as link:
        sent = link.drive(WheelSpeeds(0.3, 0.4))
        assert sent.wheel_speeds.left == pytest.approx(0.3, abs=0.003)
        assert link.lines.forward_mv == pytest.approx(1000 * sent.forward_volts, abs=1)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("speeds", "age_ms", "reason"),
    [
        (None, 0, "no command"),
        (WheelSpeeds(math.nan, 0.1), 0, "not finite"),
        (WheelSpeeds(0.1, math.inf), 0, "not finite"),
        (WheelSpeeds(-math.inf, 0.1), 0, "not finite"),
        (WheelSpeeds(1.61, 0.1), 0, "beyond"),
        (WheelSpeeds(0.1, -1.61), 0, "beyond"),
        (GOOD, 151, "old"),
        (GOOD, 2000, "old"),
        (GOOD, -11, "future"),
    ],
)
def test_f2_f5_f16_a_refused_command_gives_the_rider_the_joystick_and_nothing_resumes(
    link: Bridged, speeds: WheelSpeeds | None, age_ms: int, reason: str
) -> None:
    link.drive()
    sent = link.send(speeds, age_ms)
    assert (sent.active, sent.wheel_speeds) == (False, WheelSpeeds())
    assert reason in sent.reason
    link.live(25)
    assert link.joystick_is_live
    assert link.lines.faults == 0
    if speeds is not None:
        assert reason in link.run(3000, GOOD).reason
        link.run(TICK_MS, None)
    link.drive()


@pytest.mark.parametrize("age_ms", [-10, 0, 1, 149, 150])
def test_f2_a_command_of_up_to_150_ms_is_fresh(link: Bridged, age_ms: int) -> None:
    link.drive()
    assert link.send(GOOD, age_ms).active


def test_f2_a_stalled_planner_with_a_live_heartbeat_gives_zero_and_then_silence(link: Bridged) -> None:
    link.drive()
    link.send(GOOD)
    link.live(100)
    driven_mv = link.lines.forward_mv
    assert driven_mv > NEUTRAL_MV + 200
    link.live(50)
    assert (link.lines.holder, link.lines.forward_mv < driven_mv - 150) == (Holder.BOARD, True)
    assert "no command for" in link.bridge.beat(link.now_ns).reason
    link.live(60)
    assert link.joystick_is_live
    assert link.lines.faults == 0


def test_f16_a_clock_that_goes_back_releases_the_lines_and_the_next_drive_arms_again(link: Bridged) -> None:
    link.drive()
    back = link.bridge.send(GOOD, link.now_ns - 3000 * MS, link.now_ns - 3000 * MS)
    assert "clock" in back.reason
    link.live(25, beats=False)
    assert link.joystick_is_live
    link.run(TICK_MS, None)
    link.bridge.reset()
    link.run(1000, None)
    link.drive()


def test_f16_a_heartbeat_of_a_clock_that_goes_back_releases_the_lines(link: Bridged) -> None:
    link.drive()
    assert "clock" in link.bridge.beat(link.now_ns - 5 * MS).reason
    link.live(25, beats=False)
    assert link.joystick_is_live


@pytest.mark.parametrize(("thought_ms", "active"), [(0, True), (40, True), (70, True), (90, False)])
def test_f16_a_tick_that_began_before_the_last_heartbeat_does_not_count_as_a_clock_that_goes_back(
    link: Bridged, thought_ms: int, active: bool
) -> None:
    link.drive()
    for _ in range(5):
        began_ns = link.now_ns
        link.live(thought_ms)
        sent = link.bridge.send(GOOD, began_ns, began_ns)
    assert sent.active == active
    assert "clock" not in sent.reason


@pytest.mark.parametrize(("late_ms", "zero"), [(100, False), (110, True), (140, True)])
def test_f17_a_control_loop_two_periods_late_gets_zero_and_continues(link: Bridged, late_ms: int, zero: bool) -> None:
    link.drive()
    link.send(GOOD)
    link.live(late_ms)
    sent = link.send(GOOD)
    assert sent.active
    assert ("no command for" in sent.reason) == zero
    assert (sent.wheel_speeds.left < 0.29) == zero
    sent = link.run(300, GOOD)
    assert (sent.active, sent.reason) == (True, "")
    assert sent.wheel_speeds.left == pytest.approx(0.3, abs=0.018)


def test_f17_a_late_control_loop_is_stopped_before_its_command_is_stale() -> None:
    assert bridge_module.LATE_MS <= bridge_module.MAX_AGE_MS


def test_f17_the_board_alone_stops_a_paused_process_in_100_ms(link: Bridged) -> None:
    link.drive()
    link.send(GOOD)
    link.live(100, beats=False)
    assert link.joystick_is_live
    sent = link.send(GOOD)
    assert not sent.active
    assert "no command for" in sent.reason or "heard nothing" in sent.reason
    assert not link.run(3000, GOOD).active
    assert "ask for the goal again" in link.bridge.trouble[0]


def test_f1_after_a_pulled_cable_the_joystick_is_live_in_100_ms_and_the_board_is_greeted_again_later(
    link: Bridged,
) -> None:
    link.drive()
    spare, link.plugged = link.board.transport, False
    link.cable._transport = None
    link.live(100)
    assert link.joystick_is_live
    assert "plugged" in link.run(1000, GOOD).reason
    assert link.bridge.telemetry is None
    link.plugged = True
    assert link.board.transport is spare
    assert "heard nothing" in link.run(1000, GOOD).reason
    assert link.lines.faults == BoardFault.HOST_SILENT
    link.run(TICK_MS, None)
    link.bridge.reset()
    link.drive()
    assert link.cable.connections == 2


def test_f19_the_riders_stick_ends_the_drive_at_once_and_for_good(link: Bridged) -> None:
    link.drive()
    link.push_stick(-0.3)
    link.live(12)
    assert link.joystick_is_live
    sent = link.run(TICK_MS * 2, GOOD)
    assert (sent.active, sent.reason, link.bridge.taken_over) == (False, TAKEN_OVER, True)
    link.push_stick(0.0)
    assert not link.run(3000, GOOD).active
    link.run(TICK_MS, None)
    assert not link.bridge.taken_over
    link.drive()


@pytest.mark.parametrize(("push", "ms", "wins"), [(0.5, 150, False), (0.7, 99, False), (0.7, 150, True)])
def test_f19_threshold_and_debounce_of_the_board_hold_under_the_bridge(
    board_program: Path, push: float, ms: int, wins: bool
) -> None:
    tremor = BoardSettings(family=Family.EIGHT_PIN_3V3, override_per_mille=600, override_ms=100)
    with Bridged(board_program, tremor) as link:
        link.drive()
        link.push_stick(0.0, push)
        for _ in range(ms // TICK_MS):
            link.run(TICK_MS, GOOD)
        link.live(ms % TICK_MS)
        link.push_stick(0.0)
        assert link.run(100, GOOD).active != wins


def test_the_state_of_the_bridge_has_the_telemetry_of_the_board(link: Bridged) -> None:
    sent = link.drive()
    link.push_stick(0.1, -0.15)
    link.run(TICK_MS, GOOD)
    report = link.bridge.telemetry
    assert report is not None
    assert (report.state, report.holder, report.faults) == ("DRIVE", "BOARD", ())
    assert report.forward_volts == pytest.approx(sent.forward_volts, abs=0.001)
    assert (report.joystick.forward, report.joystick.turn) == (0.1, -0.15)
    assert report.round_trip_ns is not None
    assert 0 < report.round_trip_ns <= 20 * MS


def test_heartbeats_keep_a_slow_control_loop_alive_at_50_hz(link: Bridged) -> None:
    link.drive()
    before = link.last_report.echo_sequence
    link.run(1000, GOOD)
    assert 50 <= link.last_report.echo_sequence - before <= 70
    assert link.last_report.rejected == 0


@pytest.mark.parametrize("wrong", [(300, 128), (-1, 128), (128, 256), (128.4, 128)])
def test_wrong_counts_release_the_lines(link: Bridged, monkeypatch: pytest.MonkeyPatch, wrong: tuple[int, int]) -> None:
    link.drive()

    def broken(_model: LinearDac, _speeds: WheelSpeeds) -> tuple[int, int]:
        return wrong

    monkeypatch.setattr(line_counts, "counts_from_wheel_speeds", broken)
    assert "not counts" in link.send(GOOD).reason


def test_the_slew_depends_on_volts_and_time_and_not_on_counts_and_calls(
    board_program: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bridge_module, "SLEW", 1.0)
    reached = []
    for bits, beats in ((8, True), (12, False)):
        with Bridged(board_program, replace(BOARD, dac_bits=bits)) as link:
            link.run(2300, WheelSpeeds())
            for _ in range(6):
                link.send(WheelSpeeds(0.9, 0.9))
                link.live(TICK_MS, beats=beats)
            reached.append(link.lines.forward_mv)
    assert reached[0] == pytest.approx(NEUTRAL_MV + 280, abs=25)
    assert reached[1] == pytest.approx(reached[0], abs=45)


def _calls() -> st.SearchStrategy[list[tuple[float, float, int, int]]]:
    speeds = st.floats(allow_nan=True, allow_infinity=True) | st.floats(-1.7, 1.7)
    return st.lists(st.tuples(speeds, speeds, st.integers(-200, 200), st.integers(0, 60)), max_size=25)


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(_calls())
def test_f5_f6_no_stream_of_commands_raises_an_error_or_moves_a_line_faster_than_6_mv_a_millisecond(
    board_program: Path, calls: list[tuple[float, float, int, int]]
) -> None:
    with Bridged(board_program, replace(BOARD, dac_bits=12)) as link:
        link.drive()
        before = link.lines
        for left, right, age_ms, pause_ms in calls:
            allowed = (
                -10 <= age_ms <= 150
                and math.isfinite(left)
                and math.isfinite(right)
                and max(abs(left), abs(right)) <= 1.6
            )
            sent = link.send(WheelSpeeds(left, right), age_ms)
            assert allowed or not sent.active
            for _ in range(pause_ms):
                lines = link.live(1)
                if lines.holder is Holder.BOARD and lines.state is BoardState.DRIVE:
                    assert abs(lines.forward_mv - before.forward_mv) <= 7
                    assert abs(lines.turn_mv - before.turn_mv) <= 7
                before = lines


def test_the_same_seeded_sequence_gives_the_same_bytes_twice(board_program: Path) -> None:
    def life() -> list[object]:
        with Bridged(board_program) as link:
            link.drive()
            link.push_stick(0.0, 0.4)
            link.run(500, GOOD)
            return [*link.sent, link.bridge.telemetry]

    lives: list[Callable[[], list[object]]] = [life, life]
    assert lives[0]() == lives[1]()
