"""Faults of the computer and its cable, F1, F3, F4, F5, F7, F16, F22: the joystick is live at once in every case."""

from __future__ import annotations

from itertools import pairwise

from tests.firmware_bridge.rig import (
    ARMED,
    BAD_FRAME,
    BAD_FRAMES,
    BOARD,
    CLOCK,
    DRIVE,
    ENABLE,
    FAULT,
    HOST_SILENT,
    JOYSTICK,
    MISMATCH,
    NEUTRAL,
    NEW_HOST,
    RANGE,
    RESET,
    SILENT,
    SWING,
    HostMessage,
    Rig,
)

BAD = HostMessage(BAD_FRAME)


def test_a_board_starts_silent_with_the_joystick_live(rig: Rig) -> None:
    out = rig.step()
    assert (out.state, out.holder, out.faults) == (SILENT, JOYSTICK, 0)
    assert list(out.line_mv) == [NEUTRAL, NEUTRAL]


def test_f1_the_joystick_is_live_within_100_ms_of_the_last_good_frame(rig: Rig) -> None:
    for forward, turn in ((10000, 0), (-10000, 10000), (1, 0), (0, -7000)):
        rig.start()
        rig.drive(forward, turn)
        rig.command(forward, turn)
        before = [abs(mv - NEUTRAL) for mv in rig.lines()]
        for age in range(1, 100):
            out = rig.step()
            assert (out.holder == JOYSTICK) == (age >= 99)
            assert (out.faults == HOST_SILENT) == (age >= 80)
            assert (out.state == FAULT) == (age >= 80)
            now = [abs(mv - NEUTRAL) for mv in rig.lines()]
            assert all(a <= b for a, b in zip(now, before, strict=True))
            before = now
        assert rig.lines() == (NEUTRAL, NEUTRAL)


def test_f1_the_command_changes_into_the_riders_stick_in_equal_steps(rig: Rig) -> None:
    rig.drive(10000, 0)
    rig.command(10000, 0)
    rig.stick = [NEUTRAL - 200, NEUTRAL + 100]  # neither at rest nor far enough to take over
    rig.idle(79)
    forward = [rig.lines()[0]]
    turn = [rig.lines()[1]]
    for _ in range(20):
        rig.step()
        forward.append(rig.lines()[0])
        turn.append(rig.lines()[1])
    assert forward[0] == NEUTRAL + SWING
    assert forward[-1] == NEUTRAL - 200
    assert turn[-1] == NEUTRAL + 100
    assert all(69 <= a - b <= 71 for a, b in pairwise(forward))
    assert all(4 <= b - a <= 6 for a, b in pairwise(turn))


def test_f1_a_frame_in_the_last_millisecond_keeps_the_computer_driving(rig: Rig) -> None:
    rig.drive()
    for gap in (1, 20, 60, 79):
        rig.idle(gap - 1)
        assert rig.command(5000, -2500).state == DRIVE
    rig.idle(79)
    assert rig.command(5000, -2500).faults == 0
    rig.idle(79)
    assert rig.out.faults == 0
    assert rig.step().faults == HOST_SILENT


def test_f1_holds_over_the_wrap_of_the_clock(rig: Rig) -> None:
    for offset in range(-90, 20, 7):
        rig.start(now_ms=(2**32 - 2444 + offset) & 0xFFFFFFFF)
        rig.drive()
        rig.command(5000, -2500)
        ages = [age for age in range(1, 120) if rig.step().holder == JOYSTICK]
        assert ages[0] == 99


def test_f1_an_armed_board_falls_silent_with_a_latched_fault(rig: Rig) -> None:
    rig.arm()
    rig.command()
    assert rig.idle(79).state == ARMED
    out = rig.step()
    assert (out.state, out.holder, out.faults) == (FAULT, JOYSTICK, HOST_SILENT)


def test_f1_a_computer_that_never_armed_the_board_leaves_no_fault(rig: Rig) -> None:
    rig.hello()
    rig.run(1000)
    assert rig.idle(500).faults == 0
    assert rig.out.state == SILENT


def test_f1_a_silence_of_49_days_is_remembered_over_the_wrap_of_the_clock(rig: Rig) -> None:
    rig.hello()
    rig.command()
    rig.idle(100)
    rig.step(ms=2**32 - 100)  # 1 ms old for a plain subtraction
    for _ in range(30):
        rig.step()
    rig.command(ahead=0)
    assert rig.idle(2500).state == SILENT


def test_f3_five_bad_frames_within_half_a_second_are_a_fault(rig: Rig) -> None:
    for last in (4, 5, 100, 250, 499, 500, 501, 502, 700):
        rig.start()
        rig.drive()
        for tick in range(last + 1):
            if tick in (0, 1, 2, 3, last):
                rig.step(BAD)
            elif tick % 20 == 5:
                rig.command(5000, -2500)
            else:
                rig.step()
        assert (rig.out.faults == BAD_FRAMES) == (last <= 500), last
        rig.idle(19)
        assert rig.out.holder == (JOYSTICK if last <= 500 else BOARD)


def test_f3_four_bad_frames_are_noise(rig: Rig) -> None:
    rig.drive()
    for _ in range(4):
        assert rig.step(BAD).state == DRIVE
    rig.run(501, 5000, -2500)
    for _ in range(4):
        assert rig.step(BAD).state == DRIVE
    assert rig.step(BAD).faults == BAD_FRAMES


def test_f3_old_bad_frames_are_forgotten_over_the_wrap_of_the_clock(rig: Rig) -> None:
    for count in (1, 2, 3, 4):
        rig.start(now_ms=0)
        for _ in range(count):
            rig.step(BAD)
        rig.idle(1000)
        rig.step(ms=2**32 - 3000)
        rig.drive()
        assert rig.now_ms < 500 - count  # as if the old ones were of the last half second
        for _ in range(4):
            assert rig.step(BAD).faults == 0
        assert rig.step(BAD).faults == BAD_FRAMES


def test_f3_a_bad_frame_while_silent_restarts_the_neutral_hold(rig: Rig) -> None:
    rig.hello()
    rig.run(1900)
    rig.step(BAD)
    assert rig.run(1980).state == SILENT
    assert rig.run(60).state == ARMED
    assert rig.out.faults == 0


def test_f4_only_the_next_32_sequence_numbers_count(rig: Rig) -> None:
    for start in (0, 100, 65535 - 130, 65500):
        for ahead in (0, 1, 2, 31, 32, 33, 100, 32767, 32768, 65535, 65504):
            rig.start()
            rig.sequence = start
            rig.arm()
            out = rig.command(ahead=ahead)
            assert out.heard == (1 <= ahead <= 32), (start, ahead)


def test_f4_replayed_frames_do_not_feed_the_watchdog(rig: Rig) -> None:
    rig.drive()
    rig.command(5000, 0)
    for _ in range(79):
        assert not rig.command(5000, 0, ahead=0).heard
    assert rig.out.faults == 0
    assert rig.command(5000, 0, ahead=0).faults == HOST_SILENT


def test_f4_an_old_frame_changes_no_setpoint(rig: Rig) -> None:
    rig.drive(5000, 0)
    rig.command(-10000, 10000, flags=0, ahead=-1)
    assert rig.idle(10).state == DRIVE
    assert rig.lines() == (NEUTRAL + SWING // 2, NEUTRAL)


def test_f5_a_setpoint_out_of_range_stops_in_the_same_step(rig: Rig) -> None:
    for forward, turn in ((10001, 0), (-10001, 0), (0, 10001), (0, -10001), (32767, 0), (-32768, -32768)):
        rig.start()
        rig.drive()
        before = rig.lines()
        out = rig.command(forward, turn)
        assert (out.state, out.faults) == (FAULT, RANGE)
        assert abs(rig.lines()[0] - NEUTRAL) < abs(before[0] - NEUTRAL)
        assert rig.idle(18).holder == BOARD
        assert rig.step().holder == JOYSTICK


def test_f5_the_ends_of_the_range_are_accepted(rig: Rig) -> None:
    for forward, turn in ((10000, -10000), (-10000, 10000)):
        rig.start()
        rig.drive(forward, turn, ms=500)
        sign = 1 if forward > 0 else -1
        assert rig.lines() == (NEUTRAL + sign * SWING, NEUTRAL - sign * SWING)


def test_f7_arming_takes_two_seconds_of_zero_command_and_stick_at_rest(rig: Rig) -> None:
    rig.hello()
    ticks = rig.until(lambda out: out.state == ARMED, 2100)
    assert ticks == 2001
    assert rig.out.holder == JOYSTICK


def test_f7_a_command_that_is_not_zero_keeps_the_lock(rig: Rig) -> None:
    for forward, turn in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        rig.start()
        rig.hello()
        assert rig.run(3000, forward, turn).state == SILENT
        rig.run(1980)
        rig.command(forward, turn)
        assert rig.run(1980).state == SILENT
        assert rig.run(40).state == ARMED


def test_f7_a_deflected_stick_keeps_the_lock(rig: Rig) -> None:
    for axis in (0, 1):
        for offset in (-121, -120, 120, 121):
            rig.start()
            rig.stick[axis] = NEUTRAL + offset
            rig.hello()
            rig.run(2040)
            assert rig.out.state == (ARMED if abs(offset) <= 120 else SILENT)


def test_f7_a_touch_of_the_stick_restarts_the_hold(rig: Rig) -> None:
    rig.hello()
    rig.run(1999)
    rig.stick[1] += 130
    rig.step()
    rig.stick[1] -= 130
    rig.command()
    assert rig.run(1980).state == SILENT
    assert rig.run(40).state == ARMED


def test_f7_no_arming_without_handshake_enable_or_heartbeat(rig: Rig) -> None:
    assert rig.run(3000).state == SILENT  # no handshake
    rig.hello()
    assert rig.run(3000, flags=0).state == SILENT
    rig.run(1000)
    rig.idle(85)
    assert rig.run(1980).state == SILENT
    assert rig.run(40).state == ARMED


def test_an_armed_board_without_the_enable_bit_becomes_silent(rig: Rig) -> None:
    rig.arm()
    out = rig.command(flags=0)
    assert (out.state, out.faults) == (SILENT, 0)


def test_an_armed_board_becomes_silent_and_takes_no_command_when_its_stick_moves(rig: Rig) -> None:
    rig.arm()
    rig.stick[0] += 121
    out = rig.command(5000, 0)
    assert (out.state, out.holder) == (SILENT, JOYSTICK)
    rig.stick[0] -= 121
    assert rig.run(3000, 5000, 0).state == SILENT


def test_a_command_on_either_axis_takes_the_lines(rig: Rig) -> None:
    for forward, turn in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        rig.start()
        rig.arm()
        assert rig.command(forward, turn).state == DRIVE


def test_a_release_gives_the_lines_to_the_joystick_within_20_ms_without_a_fault(rig: Rig) -> None:
    rig.drive()
    out = rig.command(5000, -2500, flags=0)
    assert (out.state, out.holder, out.faults) == (SILENT, BOARD, 0)
    assert rig.idle(18).holder == BOARD
    assert rig.step().holder == JOYSTICK
    assert rig.out.faults == 0


def test_f16_a_clock_that_steps_ends_the_drive(rig: Rig) -> None:
    for jump in (51, 100, 1000, 2**31, 2**32 - 1, 2**32 - 1000):
        rig.start()
        rig.drive()
        out = rig.step(ms=jump)
        assert out.state == FAULT
        assert out.faults == (CLOCK if jump in (51, 2**32 - 1) else CLOCK | HOST_SILENT)
        assert out.holder == JOYSTICK


def test_f16_a_step_of_50_ms_is_late_but_no_fault(rig: Rig) -> None:
    rig.drive()
    rig.command(5000, -2500)
    assert rig.step(ms=50).faults == 0
    assert rig.command(5000, -2500, ms=29).faults == 0
    assert rig.command(5000, -2500, ms=50).faults == 0


def test_f16_a_clock_that_steps_completes_no_hold(rig: Rig) -> None:
    rig.hello()
    rig.run(1000)
    rig.step(ms=5000)
    rig.command()
    assert rig.run(1900).state == SILENT
    assert rig.run(140).state == ARMED


def test_f16_a_clock_that_steps_does_not_count_towards_a_fault(rig: Rig) -> None:
    rig.read_back = lambda _axis, mv: mv + 100
    rig.idle(5)
    assert rig.step(ms=5000).faults == 0
    assert rig.idle(59).faults == 0
    assert rig.step().faults == MISMATCH


def test_f16_a_step_of_50_ms_counts_as_time(rig: Rig) -> None:
    rig.read_back = lambda _axis, mv: mv + 100
    rig.idle(10)
    assert rig.step(ms=50).faults == 0
    assert rig.step().faults == MISMATCH


def test_two_faults_of_the_computer_in_one_step_are_both_reported(rig: Rig) -> None:
    rig.drive()
    rig.command(5000, 0)
    rig.idle(75)
    for _ in range(4):
        rig.step(BAD)
    assert rig.out.faults == 0
    assert rig.step(BAD).faults == HOST_SILENT | BAD_FRAMES


def test_f22_a_computer_with_a_wrong_handshake_never_arms_the_board(rig: Rig) -> None:
    rig.hello(matches=False)
    out = rig.run(3000)
    assert (out.state, out.heard, out.faults) == (SILENT, False, 0)
    rig.hello(matches=True)
    rig.run(1000)
    rig.hello(matches=False)
    assert rig.run(3000).state == SILENT


def test_f22_a_handshake_while_armed_or_driving_is_a_new_computer(rig: Rig) -> None:
    rig.arm()
    assert rig.hello().faults == NEW_HOST
    rig.start()
    rig.drive()
    for matches in (True, False):
        rig.hello(matches)
        assert (rig.out.state, rig.out.faults) == (FAULT, NEW_HOST)
    rig.idle(17)
    assert rig.out.holder == BOARD
    assert rig.step().holder == JOYSTICK


def test_f22_a_handshake_while_silent_sets_the_sequence_and_forgets_the_command(rig: Rig) -> None:
    rig.hello()
    rig.run(1000)
    rig.sequence = 40000
    rig.hello()
    assert not rig.step().heard
    assert rig.idle(60).state == SILENT
    assert rig.command().heard
    rig.run(1900)
    assert rig.out.state == SILENT
    assert rig.run(140).state == ARMED


def test_f22_a_handshake_clears_the_enable_bit(rig: Rig) -> None:
    rig.hello()
    rig.run(1990)
    rig.command()
    rig.hello()
    assert rig.idle(40).state == SILENT


def test_a_fault_of_the_computer_is_cleared_by_a_rising_reset_with_zero_and_neutral(rig: Rig) -> None:
    rig.drive()
    rig.idle(120)
    assert rig.run(3000).state == FAULT  # commands alone do not
    assert rig.command(1, 0, ENABLE | RESET).state == FAULT  # not zero
    assert rig.command(0, 0, ENABLE | RESET).state == FAULT  # not rising
    rig.command()
    rig.stick[0] += 200
    assert rig.command(0, 0, ENABLE | RESET).state == FAULT  # stick
    rig.stick[0] -= 200
    rig.command()
    out = rig.command(0, 0, ENABLE | RESET)
    assert (out.state, out.holder, out.faults) == (SILENT, JOYSTICK, 0)
    assert rig.run(1980, flags=ENABLE | RESET).state == SILENT  # reset is not arming
    assert rig.run(60).state == ARMED


def test_a_reset_during_the_handover_waits_until_the_handover_ends(rig: Rig) -> None:
    rig.drive()
    rig.command(20000, 0)
    out = rig.command(0, 0, ENABLE | RESET)
    assert (out.state, out.holder) == (FAULT, BOARD)


def test_a_valid_reset_without_a_fault_changes_nothing(rig: Rig) -> None:
    rig.drive()
    assert rig.command(0, 0, ENABLE | RESET).state == DRIVE
    rig.start()
    rig.arm()
    assert rig.command(0, 0, ENABLE | RESET).state == ARMED
