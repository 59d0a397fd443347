"""The bridge while the rider drives within the guard: caps to the board, and every way in which they end."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from tests.firmware_bridge.bridged import GOOD, MS, TICK_MS, Bridged
from waychair.calibration.fits.dac import DEFAULT
from waychair.errors import CalibrationError
from waychair.firmware_bridge.bridge import GUARD_RESET, GUARDED
from waychair.firmware_bridge.caps import Caps, StickMotion
from waychair.firmware_bridge.line_counts import LineCounts
from waychair.firmware_bridge.protocol import BoardState, CommandFlag, Holder
from waychair.types import SentCommand, Twist

WIDE = Caps(1.0, 1.0, 1.0, 1.0)
HALF = Caps(0.5, 0.5, 0.5, 0.5)
STICK = StickMotion(LineCounts.of(DEFAULT), 1.65, 1.2, 0.56)


def _limited(link: Bridged, ms: int, caps: Caps = WIDE, age_ms: int = 0) -> SentCommand:
    for _ in range(ms // TICK_MS):
        sent = link.bridge.limit(caps, link.now_ns - age_ms * MS, link.now_ns)
        link.live(TICK_MS)
    return sent


def _guarded(link: Bridged, caps: Caps = WIDE) -> None:
    sent = _limited(link, 3000, caps)
    assert (link.lines.state, link.lines.holder) == (BoardState.GUARD, Holder.BOARD)
    assert (sent.active, sent.reason) == (False, GUARDED)


def test_the_rider_drives_within_the_caps_and_the_board_reports_them(link: Bridged) -> None:
    _guarded(link, HALF)
    link.push_stick(0.9, 0.2)
    _limited(link, 100, HALF)
    assert abs(link.lines.forward_mv - 2250) <= 11  # a step of 8 bits
    assert abs(link.lines.turn_mv - 1410) <= 11
    report = link.bridge.telemetry
    assert report is not None
    assert report.guard is not None
    assert report.guard.caps == (0.5, 0.5, 0.5, 0.5)
    assert (report.guard.capped, report.guard.lost, report.state) == (True, False, "GUARD")
    assert not link.bridge.armed
    assert link.bridge.trouble == ()


def test_the_rider_ends_the_guard_at_once_and_begins_it_again_by_an_act(link: Bridged) -> None:
    _guarded(link)
    link.push_stick(0.9)
    _limited(link, 100)
    link.run(100, None)
    assert link.joystick_is_live
    assert link.lines.state is BoardState.SILENT
    link.push_stick(0.0)
    _guarded(link)


def test_old_caps_are_narrow_and_dead_ones_end_the_guard(link: Bridged) -> None:
    _guarded(link)
    link.push_stick(0.9)
    _limited(link, 100)
    link.live(200)  # the control loop hangs, the heartbeat lives
    assert link.last_report.front_cap == 2500
    assert link.lines.state is BoardState.GUARD
    _limited(link, 500)
    assert link.last_report.front_cap == 10000
    link.live(1300)
    assert link.lines.state is BoardState.FAULT
    assert link.last_report.front_cap == 2500
    _limited(link, 1000)
    assert link.last_report.front_cap == 2500  # nothing resumes
    assert link.bridge.guard_end != ""
    link.push_stick(0.0)
    _limited(link, 4500)
    assert link.lines.state is BoardState.SILENT
    link.send(None)
    assert link.bridge.guard_end == ""
    _guarded(link)


@pytest.mark.parametrize("age_ms", [150, -50])
def test_f2_f16_caps_that_come_late_or_from_the_future_are_narrow(link: Bridged, age_ms: int) -> None:
    _guarded(link)
    _limited(link, 200, WIDE, age_ms)
    assert link.last_report.front_cap == 2500


def test_a_clock_that_goes_back_narrows_the_caps(link: Bridged) -> None:
    _guarded(link)
    link.push_stick(0.9)
    _limited(link, 100)
    assert link.lines.forward_mv > 2700
    link.bridge.limit(WIDE, link.now_ns - 500 * MS, link.now_ns - 500 * MS)
    link.live(20, beats=False)
    assert abs(link.lines.forward_mv - 1950) <= 11
    assert link.lines.holder is Holder.BOARD


def test_a_drive_that_is_asked_for_takes_the_lines_from_the_guard(link: Bridged) -> None:
    _guarded(link)
    link.drive(GOOD)
    sent = _limited(link, 100)
    assert not sent.active
    _guarded(link)


def test_f1_a_lost_cable_ends_the_guard_and_says_so(link: Bridged) -> None:
    _guarded(link)
    link.push_stick(0.9)
    link.live(150, beats=False)
    assert link.last_report.guard_bits == 0
    link.live(30)
    report = link.bridge.telemetry
    assert report is not None
    assert report.guard is not None
    assert report.guard.lost
    assert "heard nothing from the computer" in link.bridge.guard_end
    assert abs(link.lines.forward_mv - 1950) <= 11


def test_a_board_that_was_reset_ends_the_guard(link: Bridged) -> None:
    _guarded(link)
    link.bridge._session._cable.write(b"\0")
    link.bridge._drive.guards = True
    link.bridge._session.board = replace(link.last_report, state=BoardState.SILENT)
    link.bridge._read_board(link.now_ns)
    assert link.bridge.guard_end == GUARD_RESET


def test_caps_are_rounded_down_bounded_and_none_if_they_are_no_number() -> None:
    caps = Caps(0.99999, -1.0, 7.0, math.nan, drops=(True, False, True, False))
    assert caps.setpoints() == (9999, 0, 10000, 0)
    assert caps.flags() == CommandFlag(8 + 1 + 16 + 64)
    assert Caps().flags() == CommandFlag.ENABLE | CommandFlag.GUARD
    assert Caps(0.1, 0.9, 0.3, 1.0).narrowed(0.25) == Caps(0.1, 0.25, 0.25, 0.25)


def test_the_sticks_motion_and_its_deflection_are_inverse() -> None:
    assert STICK.twist(0.0, 0.0) == Twist()
    assert STICK.deflection(Twist()) == (0.0, 0.0)
    for forward, turn in ((0.5, 0.0), (-0.8, 0.3), (0.3, -0.9), (0.0, 0.5)):
        twist = STICK.twist(forward, turn)
        assert twist.v * forward >= 0.0
        assert twist.omega * turn >= 0.0
        back = STICK.deflection(twist)
        assert back == pytest.approx((forward, turn), abs=0.02)
    with pytest.raises(CalibrationError):
        STICK.deflection(Twist(math.nan, 0.0))
