"""Faults of lines, reference and stick, F6, F8, F9, F10, F21: each limit at its boundary."""

from __future__ import annotations

from itertools import pairwise

from tests.firmware_bridge.rig import (
    BOARD,
    CREEP,
    CUT,
    DRIVE,
    ESTOP,
    FAULT,
    IMPOSSIBLE,
    JOYSTICK,
    MISMATCH,
    NEUTRAL,
    REFERENCE,
    SILENT,
    STICK,
    SWING,
    Rig,
    bent,
    forced,
)


def test_f6_a_jump_becomes_a_ramp_of_the_whole_swing_in_200_ms(rig: Rig) -> None:
    rig.arm()
    rig.command(10000, -10000)
    values = [rig.lines()]
    for tick in range(210):
        rig.command(10000, -10000) if tick % 20 == 0 else rig.step()
        values.append(rig.lines())
    steps = [(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(values)]
    assert values[0] == (NEUTRAL + 6, NEUTRAL - 6)
    assert set(steps) == {(6, -6), (0, 0)}
    assert values[198] != values[199] == (NEUTRAL + SWING, NEUTRAL - SWING) == values[-1]


def test_f6_a_late_step_catches_up_20_ms_and_no_more(rig: Rig) -> None:
    for late in (1, 2, 19, 20, 21, 50):
        rig.start()
        rig.arm()
        rig.command(10000, 0)
        before = rig.lines()[0]
        rig.command(10000, 0, ms=late)
        assert rig.lines()[0] - before == 6 * min(late, 20)


def test_f6_two_steps_in_one_millisecond_move_the_lines_once(rig: Rig) -> None:
    rig.arm()
    rig.command(10000, 0)
    before = rig.lines()
    rig.step(ms=0)
    assert rig.lines() == before


def test_f6_the_window_limits_the_lines_where_the_slew_would_not(rig: Rig) -> None:
    rig.start(rig.settings(slew_ms=100))
    rig.arm()
    start = rig.now_ms
    values = {}
    for tick in range(400):
        forward = 10000 if tick < 200 else -10000
        rig.command(forward, 0) if tick % 20 == 0 else rig.step()
        values[rig.now_ms - start] = rig.lines()[0]
    assert values[2] - values[1] == 12
    assert values[100] == NEUTRAL + 720  # held there
    assert values[101] == NEUTRAL + 732
    for begin in range(1, 300, 100):
        window = [values[begin + i] for i in range(100)]
        assert max(abs(value - values[begin - 1] if begin > 1 else value - NEUTRAL) for value in window) <= 732
    moved = [abs(values[t + 100] - values[t]) for t in range(1, 300)]
    assert max(moved) <= 2 * 720
    assert min(values.values()) >= NEUTRAL - SWING


def test_f6_lines_never_leave_the_swing(rig: Rig) -> None:
    rig.drive(10000, -10000, ms=600)
    for reference in (2500, 2375, 2450, 2625, 2560):
        rig.reference = reference
        rig.stick = [reference, reference]
        rig.run(41, 10000, -10000)
        swing = (SWING * reference + NEUTRAL // 2) // NEUTRAL
        assert max(abs(mv - reference) for mv in rig.lines()) <= swing
        rig.reference = NEUTRAL
        rig.stick = [NEUTRAL, NEUTRAL]
        rig.run(300, 10000, -10000)


def test_f6_the_command_starts_at_the_stick_without_a_jump(rig: Rig) -> None:
    rig.stick = [NEUTRAL + 100, NEUTRAL - 90]
    rig.arm()
    rig.command(-10000, 10000)
    assert rig.lines() == (NEUTRAL + 94, NEUTRAL - 84)


def test_f8_a_line_off_by_more_than_60_mv_for_60_ms_is_cut(rig: Rig) -> None:
    for axis in (0, 1):
        for off in (-200, -61, -60, 60, 61, 200):
            rig.start()
            rig.drive()
            rig.read_back = bent(axis, off)
            bad = abs(off) > 60
            rig.run(60, 5000, -2500)
            assert (rig.out.state, rig.out.holder) == (DRIVE, BOARD)
            rig.step()
            assert (rig.out.faults, rig.out.holder) == ((MISMATCH, CUT) if bad else (0, BOARD)), (axis, off)
            assert rig.lines() == ((NEUTRAL, NEUTRAL) if bad else (NEUTRAL + 600, NEUTRAL - 300))


def test_f8_a_line_that_recovers_in_time_is_no_fault(rig: Rig) -> None:
    rig.drive()
    for _ in range(5):
        rig.read_back = bent(0, 300)
        rig.run(60, 5000, -2500)
        rig.read_back = bent(0, 0)
        assert rig.run(1, 5000, -2500).faults == 0


def test_f8_a_switch_that_does_not_connect_the_stick_is_cut_in_every_state(rig: Rig) -> None:
    for armed in (False, True):
        rig.start()
        if armed:
            rig.arm()
        rig.read_back = bent(1, 61)
        rig.run(60)
        assert rig.out.holder == JOYSTICK
        rig.step()
        assert (rig.out.state, rig.out.holder, rig.out.faults) == (FAULT, CUT, MISMATCH)
        rig.run(500)
        assert rig.out.holder == CUT


def test_f8_a_stuck_line_is_found_while_the_command_moves(rig: Rig) -> None:
    for axis in (0, 1):
        rig.start()
        rig.drive(3000, 3000)
        stuck = rig.lines()[axis]
        rig.read_back = forced(axis, stuck)
        took = rig.until(lambda out: out.faults == MISMATCH, 200, -3000, -3000)
        assert 60 <= took <= 75


def test_f8_a_cut_line_is_not_compared(rig: Rig) -> None:
    rig.drive()
    rig.estop_released = False
    rig.step()
    rig.stick = [NEUTRAL + 100, NEUTRAL]
    rig.read_back = bent(1, 90)
    assert rig.idle(300).faults == ESTOP


def test_f9_a_reference_off_by_more_than_5_percent_for_60_ms_ramps_to_a_cut(rig: Rig) -> None:
    for off in (-500, -126, -125, 125, 126, 500):
        rig.start()
        rig.drive()
        rig.reference = NEUTRAL + off
        bad = abs(off) > 125
        rig.stick = [rig.reference] * 2 if abs(off) < 240 else rig.stick
        rig.run(60, 5000, -2500)
        assert rig.out.state == DRIVE
        rig.step()
        assert (rig.out.state, rig.out.faults) == ((FAULT, REFERENCE) if bad else (DRIVE, 0))
        assert rig.out.holder == BOARD
        if bad:
            rig.idle(198)
            assert rig.out.holder == BOARD
            assert rig.step().holder == CUT


def test_f9_the_ramp_is_straight_and_takes_200_ms(rig: Rig) -> None:
    rig.drive(10000, 0, ms=500)
    rig.reference = NEUTRAL + 126
    rig.run(60, 10000, 0)
    value, steps = rig.lines()[0], []
    while rig.step().holder == BOARD:
        steps.append(value - rig.lines()[0])
        value = rig.lines()[0]
    assert len(steps) == 199
    assert set(steps) <= {6, 7}
    assert abs(value - (NEUTRAL + 125)) <= 6  # the neutral of the last valid reference


def test_f9_lines_follow_the_reference_within_its_tolerance(rig: Rig) -> None:
    for reference in range(2375, 2626, 25):
        rig.start()
        rig.drive(10000, -5000, ms=600)
        rig.reference = reference
        rig.run(150, 10000, -5000)
        swing = (SWING * reference + NEUTRAL // 2) // NEUTRAL
        assert rig.lines()[0] == reference + swing
        assert abs(rig.lines()[1] - (reference - swing / 2)) <= 1


def test_f9_without_the_computer_a_wrong_reference_cuts_at_once(rig: Rig) -> None:
    rig.reference = NEUTRAL - 126
    rig.run(60)
    assert rig.out.holder == JOYSTICK
    rig.step()
    assert (rig.out.holder, rig.out.faults) == (CUT, REFERENCE)


def test_f10_an_impossible_line_is_cut_after_60_ms(rig: Rig) -> None:
    for axis in (0, 1):
        for mv in (0, 499, 500, 4500, 4501, 5000, 65535):
            rig.start()
            rig.drive()
            rig.read_back = forced(axis, mv)
            rig.run(60, 5000, -2500)
            assert rig.out.faults == 0
            rig.step()
            impossible = mv < 500 or mv > 4500
            assert rig.out.faults == (MISMATCH | IMPOSSIBLE if impossible else MISMATCH)
            assert rig.out.holder == CUT


def test_f10_a_stick_with_a_broken_wire_does_not_take_over_and_ramps_to_a_cut(rig: Rig) -> None:
    for axis in (0, 1):
        for mv in (0, 499, 4501, 65535):
            rig.start()
            rig.drive()
            rig.stick[axis] = mv
            rig.run(60, 5000, -2500)
            assert rig.out.state == DRIVE
            rig.step()
            assert (rig.out.state, rig.out.holder, rig.out.faults) == (FAULT, BOARD, STICK)
            rig.run(199, 5000, -2500)
            assert rig.out.holder == CUT


def test_f10_a_stick_at_the_ends_of_its_range_takes_over(rig: Rig) -> None:
    for mv in (500, 4500):
        rig.start()
        rig.drive()
        rig.stick[0] = mv
        rig.run(11, 5000, -2500)
        assert (rig.out.state, rig.out.holder, rig.out.faults) == (SILENT, JOYSTICK, 0)


def test_f10_a_handover_to_a_broken_stick_ramps_to_neutral(rig: Rig) -> None:
    rig.drive(10000, 0, ms=500)
    rig.stick = [0, NEUTRAL]
    rig.command(20000, 0)
    low = min(rig.step().line_mv[0] for _ in range(18))
    assert NEUTRAL <= low <= NEUTRAL + 60


def test_f21_a_line_that_creeps_at_neutral_for_300_ms_ramps_to_a_cut(rig: Rig) -> None:
    for axis in (0, 1):
        for off in (-60, -36, -35, 35, 36, 60):
            rig.start()
            rig.drive(*((0, 5000) if axis == 0 else (5000, 0)))
            rig.read_back = bent(axis, off)
            rig.run(300, *((0, 5000) if axis == 0 else (5000, 0)))
            assert rig.out.state == DRIVE
            rig.step()
            creeps = abs(off) > 35
            assert rig.out.faults == (CREEP if creeps else 0)
            assert rig.out.holder == BOARD
            rig.run(199)
            assert rig.out.holder == (CUT if creeps else BOARD)


def test_f21_an_axis_with_a_command_does_not_creep(rig: Rig) -> None:
    rig.drive(5000, -2500)
    rig.read_back = lambda _axis, mv: mv + 50
    assert rig.run(1000, 5000, -2500).faults == 0


def test_f21_the_riders_own_stick_does_not_creep(rig: Rig) -> None:
    rig.arm()
    rig.read_back = lambda _axis, mv: mv + 50
    assert rig.run(1000).faults == 0
