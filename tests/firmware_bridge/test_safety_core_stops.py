"""E-stop, override, a failing board and simultaneous faults, F18, F19, F29: the holder of the lines, and its delay."""

from __future__ import annotations

from tests.firmware_bridge.rig import (
    ARMED,
    BAD_FRAME,
    BAD_FRAMES,
    BOARD,
    BOARD_FAULT,
    CREEP,
    CUT,
    DRIVE,
    ENABLE,
    ESTOP,
    ESTOP_ACK,
    FAULT,
    HOST_SILENT,
    IMPOSSIBLE,
    JOYSTICK,
    MISMATCH,
    NEUTRAL,
    RANGE,
    REFERENCE,
    RESET,
    SILENT,
    STICK,
    SWING,
    HostMessage,
    Rig,
    bent,
    forced,
)


def _reset(rig: Rig, flags: int = ENABLE | RESET) -> int:
    rig.command()
    return int(rig.command(0, 0, flags).state)


def test_f18_the_e_stop_cuts_in_the_same_step_in_every_state(rig: Rig) -> None:
    for state in (SILENT, ARMED, DRIVE, FAULT):
        rig.start()
        if state == ARMED:
            rig.arm()
        if state in (DRIVE, FAULT):
            rig.drive()
        if state == FAULT:
            rig.command(30000, 0)
        rig.estop_released = False
        out = rig.step()
        assert (out.state, out.holder) == (FAULT, CUT)
        assert out.faults & ESTOP


def test_f18_a_release_does_not_resume_and_a_reset_needs_the_acknowledgement(rig: Rig) -> None:
    rig.drive()
    rig.estop_released = False
    rig.run(100)
    assert _reset(rig, ENABLE | RESET | ESTOP_ACK) == FAULT  # still pressed
    rig.estop_released = True
    assert rig.run(500, 5000, 0).holder == CUT
    assert rig.out.state == FAULT
    assert _reset(rig) == FAULT
    assert _reset(rig, ENABLE | ESTOP_ACK) == FAULT
    assert _reset(rig, ENABLE | RESET | ESTOP_ACK) == SILENT
    assert rig.out.holder == JOYSTICK
    assert rig.run(1980).state == SILENT


def test_f18_the_rider_gets_the_joystick_back_without_a_computer(rig: Rig) -> None:
    rig.drive()
    rig.estop_released = False
    rig.idle(100)
    rig.estop_released = True
    rig.idle(1000)
    rig.stick[0] += 200  # a hand on the stick: the two seconds start again
    rig.step()
    rig.stick[0] -= 200
    assert rig.idle(2000).holder == CUT
    out = rig.step()
    assert (out.state, out.holder) == (FAULT, JOYSTICK)
    assert out.faults & ESTOP
    rig.stick[0] += 500
    assert rig.idle(100).holder == JOYSTICK
    rig.estop_released = False
    assert rig.step().holder == CUT  # pressed again: cut again
    rig.estop_released = True
    assert rig.idle(3000).holder == CUT  # the stick is not at rest


def test_f18_the_rider_does_not_get_faulty_lines_back(rig: Rig) -> None:
    rig.drive()
    rig.read_back = bent(0, 100)
    rig.run(61, 5000, 0)
    rig.read_back = bent(0, 0)
    rig.estop_released = False
    rig.step()
    rig.estop_released = True
    assert rig.idle(3000).holder == CUT


def test_f19_the_stick_takes_over_within_one_tick(rig: Rig) -> None:
    for axis in (0, 1):
        for offset in (-1200, -241, -240, 240, 241, 1200):
            rig.start()
            rig.drive()
            rig.stick[axis] = NEUTRAL + offset
            rig.run(10, 5000, -2500)
            assert rig.out.holder == BOARD
            rig.step()
            taken = abs(offset) > 240
            assert (rig.out.state, rig.out.holder) == ((SILENT, JOYSTICK) if taken else (DRIVE, BOARD))
            assert rig.out.faults == 0


def test_f19_threshold_and_debounce_are_those_of_the_rider(rig: Rig) -> None:
    for per_mille, debounce in ((150, 0), (400, 60), (800, 500)):
        rig.start(rig.settings(override_per_mille=per_mille, override_ms=debounce))
        rig.drive()
        limit = SWING * per_mille // 1000
        rig.stick[0] = NEUTRAL + limit
        assert rig.run(600, 5000, -2500).holder == BOARD
        rig.stick[0] = NEUTRAL + limit + 1
        if debounce:
            assert rig.run(debounce, 5000, -2500).holder == BOARD
        assert rig.command(5000, -2500).holder == JOYSTICK


def test_f19_the_threshold_follows_the_reference(rig: Rig) -> None:
    for reference, limit in ((2625, 1008), (2375, 912)):
        for offset in (limit, limit + 1):
            rig.start(rig.settings(override_per_mille=800))
            rig.reference, rig.stick = reference, [reference] * 2
            rig.drive()
            rig.stick[1] = reference + offset
            assert rig.run(11, 5000, -2500).holder == (BOARD if offset == limit else JOYSTICK)


def test_f19_a_tremor_shorter_than_the_debounce_is_ignored(rig: Rig) -> None:
    rig.start(rig.settings(override_ms=60))
    rig.drive()
    for _ in range(20):
        rig.stick[0] = NEUTRAL + 600
        rig.run(60, 5000, -2500)
        rig.stick[0] = NEUTRAL
        assert rig.run(3, 5000, -2500).holder == BOARD


def test_f19_after_an_override_the_computer_waits_for_two_seconds_of_neutral(rig: Rig) -> None:
    rig.drive()
    rig.stick[0] = NEUTRAL + 600
    rig.run(100, 5000, -2500)
    rig.stick[0] = NEUTRAL
    assert rig.run(3000, 5000, -2500).state == SILENT
    assert rig.run(1990).state == SILENT
    assert rig.run(30).state == ARMED


def test_f19_the_stick_takes_over_during_a_handover(rig: Rig) -> None:
    rig.start(rig.settings(override_ms=0))
    rig.drive()
    rig.command(20000, 0)
    rig.stick[1] = NEUTRAL + 600
    out = rig.step()
    assert (out.state, out.holder, out.faults) == (FAULT, JOYSTICK, RANGE)
    rig.start(rig.settings(override_ms=0))
    rig.drive()
    rig.command(0, 0, flags=0)
    rig.stick[1] = NEUTRAL + 600
    assert rig.step().holder == JOYSTICK


def test_f19_a_stick_cannot_take_over_lines_that_are_ramped_to_a_cut(rig: Rig) -> None:
    rig.start(rig.settings(override_ms=0))
    rig.drive()
    rig.reference = NEUTRAL + 200
    rig.run(61, 5000, -2500)
    rig.stick[1] = NEUTRAL + 900
    assert rig.idle(100).holder == BOARD
    assert rig.idle(99).holder == CUT


def test_f29_a_silent_converter_leaves_the_lines_to_the_joystick(rig: Rig) -> None:
    rig.drive()
    rig.board_ok = False
    out = rig.step()
    assert (out.state, out.faults) == (FAULT, BOARD_FAULT)
    assert rig.idle(18).holder == BOARD
    assert rig.step().holder == JOYSTICK
    assert _reset(rig) == FAULT
    rig.board_ok = True
    assert _reset(rig) == SILENT


def test_f29_a_board_that_fails_its_self_test_at_boot_is_never_armed(rig: Rig) -> None:
    rig.board_ok = False
    rig.hello()
    out = rig.run(3000)
    assert (out.state, out.holder, out.faults) == (FAULT, JOYSTICK, BOARD_FAULT)


def test_f29_bad_frames_do_not_disturb_the_watchdog(rig: Rig) -> None:
    kicks = [tick for tick in range(1, 60) if rig.step(HostMessage(BAD_FRAME)).kick]
    assert kicks == [11, 21, 31, 41, 51]


def test_f29_the_watchdog_is_kicked_every_10_ms_in_every_state(rig: Rig) -> None:
    for now_ms in (0, 5, 123456, 2**32 - 25):
        rig.start(now_ms=now_ms)
        kicks = [tick for tick in range(1, 100) if rig.step().kick]
        assert kicks == [11, 21, 31, 41, 51, 61, 71, 81, 91]
    rig.start(rig.settings(family=0))
    assert sum(rig.step().kick for _ in range(101)) == 10


def test_all_faults_of_one_step_are_reported(rig: Rig) -> None:
    rig.drive()
    rig.reference, rig.stick, rig.read_back = 0, [0, 0], forced(0, 0)
    assert rig.run(60, 5000, -2500).faults == 0
    rig.estop_released = rig.board_ok = False
    rig.step()
    assert rig.out.faults == MISMATCH | IMPOSSIBLE | REFERENCE | STICK | ESTOP | BOARD_FAULT
    rig.start()
    rig.drive(0, 5000)
    rig.read_back = bent(0, 50)
    rig.run(240, 0, 5000)
    rig.read_back = bent(0, 70)
    assert rig.run(60, 0, 5000).faults == 0
    assert rig.step().faults == MISMATCH | CREEP


def test_a_stronger_stop_takes_over_from_a_weaker_one(rig: Rig) -> None:
    rig.drive()
    rig.reference = NEUTRAL + 126
    rig.run(50, 5000, -2500)
    rig.command(20000, 0)  # to the joystick within 20 ms ...
    assert rig.idle(10).faults == RANGE | REFERENCE  # ... but the reference fails on the way
    assert rig.idle(198).holder == BOARD
    assert rig.step().holder == CUT
    rig.start()
    rig.drive()
    rig.reference = NEUTRAL + 126
    rig.run(70, 5000, -2500)
    rig.estop_released = False
    assert rig.step().holder == CUT


def test_a_weaker_stop_does_not_shorten_or_lengthen_a_stronger_one(rig: Rig) -> None:
    rig.drive()
    rig.reference = NEUTRAL + 126
    rig.run(61, 5000, -2500)
    assert rig.out.faults == REFERENCE
    rig.board_ok = False
    rig.stick[0] = 0
    rig.idle(198)
    assert rig.out.faults == REFERENCE | BOARD_FAULT | STICK
    assert rig.out.holder == BOARD
    assert rig.step().holder == CUT
    assert rig.idle(100).holder == CUT


def test_later_faults_of_the_computer_are_not_added_to_a_fault(rig: Rig) -> None:
    rig.drive()
    rig.estop_released = False
    rig.step()
    for _ in range(8):
        rig.step(HostMessage(BAD_FRAME))
    rig.idle(200)
    assert rig.out.faults == ESTOP
    assert not rig.out.faults & (BAD_FRAMES | HOST_SILENT)


def test_a_line_fault_after_a_fault_of_the_computer_cuts_the_joystick(rig: Rig) -> None:
    for bend, fault in ((bent(0, 100), MISMATCH), (forced(0, 5000), IMPOSSIBLE | MISMATCH)):
        rig.start()
        rig.drive()
        rig.idle(120)
        assert rig.out.holder == JOYSTICK
        rig.read_back = bend
        rig.idle(61)
        assert (rig.out.holder, rig.out.faults) == (CUT, HOST_SILENT | fault)
