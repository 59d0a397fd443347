"""A guard that ends by a fault: the caps never become wider, and a stick at rest is free again."""

from __future__ import annotations

import random
from collections.abc import Callable

from tests.firmware_bridge.rig import (
    BAD_FRAME,
    BAD_FRAMES,
    BLOCKED,
    BOARD,
    BOARD_FAULT,
    CAPPED,
    CLOCK,
    CREEP,
    CUT,
    ENABLE,
    ESTOP,
    ESTOP_ACK,
    FAULT,
    FRONT,
    FULL,
    GUARD,
    GUARDS,
    HOST_SILENT,
    IMPOSSIBLE,
    JOYSTICK,
    LOST,
    MISMATCH,
    NEUTRAL,
    NEW_HOST,
    PUSHES,
    RANGE,
    REFERENCE,
    RESET,
    SILENT,
    STICK,
    SWING,
    HostMessage,
    Rig,
    bent,
    deflections,
    push,
)


def _silence(rig: Rig) -> int:
    rig.idle(79)
    assert (rig.out.state, rig.out.faults) == (GUARD, 0)
    rig.step()
    return HOST_SILENT


def _bad_frames(rig: Rig) -> int:
    for _ in range(5):
        rig.step(HostMessage(BAD_FRAME))
    return BAD_FRAMES


def _hello(rig: Rig) -> int:
    rig.hello()
    return NEW_HOST


def _late(rig: Rig) -> int:
    rig.step(ms=51)
    return CLOCK


def _wide_cap(rig: Rig) -> int:
    rig.limit((10001, 0, 0, 0))
    return RANGE


def _wide_last_cap(rig: Rig) -> int:
    rig.limit((0, 0, 0, 10001))
    return RANGE


def _wide_command(rig: Rig) -> int:
    rig.command(10001)
    return RANGE


FAULTS: tuple[Callable[[Rig], int], ...] = (
    _silence, _bad_frames, _hello, _late, _wide_cap, _wide_last_cap, _wide_command,
)  # fmt: skip


def test_f1_f3_f5_f16_f22_a_lost_computer_narrows_the_caps_at_once_and_a_stick_at_rest_is_free(rig: Rig) -> None:
    for fault in FAULTS:
        rig.start()
        rig.guard((10000, 2000, 10000, 0))
        push(rig, 0, 1000)
        rig.limit((10000, 2000, 10000, 0))
        bit = fault(rig)
        assert (rig.out.state, rig.out.faults, rig.out.holder) == (FAULT, bit, BOARD), fault
        assert list(rig.out.caps) == [2500, 2000, 2500, 0], fault
        assert rig.out.guard_bits == CAPPED | LOST, fault
        assert deflections(rig) == [300, 0]
        rig.idle(5000)  # for as long as the stick is held
        assert list(rig.out.caps) == [2500, 2000, 2500, 0], fault
        push(rig, 0, 120)  # at rest
        rig.idle(2000)
        assert (rig.out.state, rig.out.holder, rig.out.guard_bits) == (FAULT, BOARD, LOST), fault
        out = rig.step()
        assert (out.state, out.holder, out.faults, out.guard_bits) == (SILENT, JOYSTICK, 0, 0), fault
        assert list(out.caps) == [0] * 4
        push(rig, 0, SWING)
        rig.step()
        assert deflections(rig) == [SWING, 0]


def test_f1_the_rest_of_two_seconds_begins_anew_with_every_touch(rig: Rig) -> None:
    rig.guard()
    rig.limit()
    rig.idle(80)
    for _ in range(3):
        rig.idle(1990)
        push(rig, 1, 121)
        rig.step()
        rig.stick = [NEUTRAL, NEUTRAL]
    assert rig.out.state == FAULT
    rig.idle(2000)
    assert rig.step().state == SILENT


def test_a_lost_guard_is_as_narrow_as_the_profile_says(rig: Rig) -> None:
    for per_mille, caps in (
        (0, [0] * 4),
        (1, [10] * 4),
        (400, [4000, 3000, 4000, 4000]),
        (1000, [10000, 3000, 10000, 10000]),
    ):
        rig.start(rig.settings(guard_lost_per_mille=per_mille))
        rig.guard((10000, 3000, 10000, 10000))
        rig.idle(80)
        assert list(rig.out.caps) == [min(cap, caps[0]) for cap in (10000, 3000, 10000, 10000)]


def test_a_rising_cap_stays_where_it_was_when_the_computer_was_lost(rig: Rig) -> None:
    rig.guard((0,) * 4)
    rig.limited(50)
    rig.hello()
    assert list(rig.out.caps) == [1000] * 4
    assert list(rig.idle(500).caps) == [1000] * 4


def test_a_computer_that_comes_back_does_not_shorten_the_wait_and_may_guard_again(rig: Rig) -> None:
    rig.guard()
    push(rig, 0, 600)
    rig.limit()
    rig.idle(80)
    rig.hello()
    rig.limited(500)
    assert list(rig.out.caps) == [2500] * 4
    rig.stick = [NEUTRAL, NEUTRAL]
    rig.limited(1000, FULL, ENABLE | GUARDS | RESET)
    assert (rig.out.state, rig.out.faults) == (FAULT, HOST_SILENT)
    rig.command(flags=0)
    rig.command(flags=RESET)
    assert (rig.out.state, rig.out.holder) == (FAULT, BOARD)
    rig.limited(1000, FULL, ENABLE | GUARDS)
    assert (rig.out.state, rig.out.holder) == (SILENT, JOYSTICK)
    assert rig.limited(2100).state == GUARD


def test_a_computer_that_dies_while_the_guard_opens_changes_nothing(rig: Rig) -> None:
    rig.guard(BLOCKED)
    push(rig, 0, SWING)
    rig.limit(BLOCKED)
    rig.limit(FULL, 0)
    rig.idle(498)
    assert (rig.out.state, rig.out.holder, rig.out.faults) == (SILENT, BOARD, 0)
    assert (rig.step().holder, rig.out.faults) == (JOYSTICK, 0)


def test_f29_a_converter_that_fails_cuts_the_lines_until_the_stick_was_at_rest(rig: Rig) -> None:
    rig.guard()
    push(rig, 0, 1000)
    rig.limit()
    rig.board_ok = False
    out = rig.step()
    assert (out.state, out.holder, out.faults, out.guard_bits) == (FAULT, CUT, BOARD_FAULT, LOST)
    assert rig.idle(3000).holder == CUT
    rig.stick = [NEUTRAL, NEUTRAL]
    assert rig.idle(2000).holder == CUT
    assert (rig.step().holder, rig.out.state, rig.out.faults) == (JOYSTICK, FAULT, BOARD_FAULT)
    rig.board_ok = True
    rig.command(flags=RESET)
    assert rig.out.state == SILENT


def test_f8_f21_the_read_back_is_compared_with_the_capped_stick(rig: Rig) -> None:
    caps = (2500,) * 4
    rig.guard(caps)
    push(rig, 0, 900)
    rig.limited(100, caps)
    rig.read_back = bent(0, 60)
    rig.limited(500, caps)
    assert rig.out.faults == 0
    rig.read_back = bent(0, -61)
    rig.limited(60, caps)
    assert rig.out.faults == 0
    assert (rig.step().faults, rig.out.holder) == (MISMATCH, CUT)
    for stick, fault in ((120, CREEP), (121, 0)):  # at rest and just beyond
        rig.start()
        rig.guard()
        push(rig, 1, stick)
        rig.limited(40)
        rig.read_back = bent(1, 35)
        rig.limited(400)
        assert rig.out.faults == 0
        rig.read_back = bent(1, 36)
        rig.limited(300)
        assert rig.out.faults == 0
        rig.step()
        assert rig.out.faults == fault, stick


def test_f9_a_drifting_reference_fades_the_caps_and_cuts(rig: Rig) -> None:
    rig.guard()
    rig.stick = [NEUTRAL + 1000, NEUTRAL - 1000]
    rig.limited(20)
    rig.reference = 2368  # 5.3 %
    rig.stick = [2375 + 1000, 2375 - 1000]
    rig.limited(60)
    assert rig.out.faults == 0
    rig.step()
    assert (rig.out.faults, rig.out.state, rig.out.holder) == (REFERENCE, FAULT, BOARD)
    before = 10000
    for left in range(198, 0, -1):
        rig.step()
        assert rig.out.holder == BOARD
        assert not rig.out.guard_bits & LOST
        assert abs(rig.out.caps[FRONT] - 50 * left) <= 25 + 200
        assert rig.out.caps[FRONT] < before
        before = rig.out.caps[FRONT]
    rig.stick = [2375, 2375 + 1000]
    rig.step()
    assert (rig.out.holder, rig.out.faults) == (CUT, REFERENCE)


def test_f9_a_stick_that_is_let_go_while_the_caps_fade_is_followed(rig: Rig) -> None:
    rig.guard()
    push(rig, 0, 1000)
    rig.limited(20)
    rig.reference = 2368
    rig.limited(100)
    assert (rig.out.faults, rig.out.holder) == (REFERENCE, BOARD)
    rig.stick = [2375, 2375]
    rig.step()
    assert rig.lines() == (2375, 2375)
    rig.stick = [2375 - 1000, 2375]
    rig.step()
    assert 2375 - 1000 <= rig.lines()[0] < 2375


def test_f29_a_converter_that_fails_while_the_caps_fade_cuts_at_once(rig: Rig) -> None:
    rig.guard()
    push(rig, 0, 1000)
    rig.limited(20)
    rig.reference = 2368
    rig.limited(100)
    assert (rig.out.faults, rig.out.holder) == (REFERENCE, BOARD)
    rig.board_ok = False
    assert rig.step().holder == CUT
    rig.board_ok, rig.stick = True, [2375, 2375]
    assert rig.idle(2500).holder == CUT


def test_f10_a_broken_wire_of_the_stick_is_nobodys_wish(rig: Rig) -> None:
    for broken in (0, 499, 4501):
        rig.start()
        rig.guard()
        rig.stick = [NEUTRAL + 600, NEUTRAL]
        rig.limited(20)
        rig.stick[1] = broken
        rig.step()
        assert (deflections(rig), rig.out.faults) == ([0, 0], 0)
        rig.limited(60)
        assert (rig.out.faults, rig.out.holder, deflections(rig)) == (STICK, BOARD, [0, 0])
        assert rig.idle(200).holder == CUT


def test_f10_f18_a_broken_line_or_the_e_stop_cuts_a_guard_at_once(rig: Rig) -> None:
    rig.guard()
    push(rig, 0, 500)
    rig.limit()
    rig.estop_released = False
    assert (rig.step().holder, rig.out.faults) == (CUT, ESTOP)
    rig.estop_released = True
    rig.stick = [NEUTRAL, NEUTRAL]
    rig.idle(2001)
    assert (rig.out.holder, rig.out.state) == (JOYSTICK, FAULT)
    rig.command(flags=RESET | ESTOP_ACK)
    assert rig.out.state == SILENT
    rig.start()
    rig.guard()
    rig.limit()
    rig.read_back = lambda _axis, _mv: 100
    rig.limited(70)
    assert (rig.out.holder, rig.out.faults & IMPOSSIBLE) == (CUT, IMPOSSIBLE)


def test_a_cut_after_a_lost_guard_stays_until_a_reset(rig: Rig) -> None:
    rig.guard()
    rig.idle(100)
    assert rig.out.guard_bits == LOST
    rig.read_back = lambda _axis, mv: mv + 100
    rig.idle(61)
    rig.read_back = lambda _axis, mv: mv
    assert (rig.out.holder, rig.out.faults) == (CUT, HOST_SILENT | MISMATCH)
    rig.idle(2500)
    assert (rig.out.holder, rig.out.state, rig.out.guard_bits) == (CUT, FAULT, 0)
    rig.hello()
    rig.command(flags=0)
    rig.command(flags=RESET)
    assert (rig.out.state, rig.out.holder) == (SILENT, JOYSTICK)


def test_a_noisy_stick_passes_no_cap_at_any_moment(rig: Rig) -> None:
    caps, noise = (10000, 2000, 5000, 0), random.Random(0)
    rig.guard(caps)
    most = {(axis, sign): caps[to] * SWING // 10000 for to, axis, sign in PUSHES}
    for tick in range(4000):
        rig.stick = [NEUTRAL + noise.randint(-700, 700), NEUTRAL + noise.randint(-700, 700)]
        if tick % 20 == 0:
            rig.limit(caps)
        else:
            rig.step()
        for axis, line in enumerate(deflections(rig)):
            pushed = rig.stick[axis] - NEUTRAL
            assert line * pushed >= 0
            assert abs(line) <= min(abs(pushed), most[axis, 1 if pushed > 0 else -1])
    assert (rig.out.state, rig.out.faults) == (GUARD, 0)


def test_a_stick_that_is_stuck_creeps_once_and_is_never_free_again_without_its_computer(rig: Rig) -> None:
    rig.guard(BLOCKED)
    push(rig, 0, SWING)
    moved = list[int]()
    for _ in range(300):
        rig.limited(100, BLOCKED)
        moved.append(deflections(rig)[0])
    assert 0 < sum(line > 0 for line in moved) <= 105  # the override of ten seconds, once
    assert moved[-1] == 0
    rig.idle(60_000)
    assert (rig.out.state, rig.out.holder) == (FAULT, BOARD)
    assert deflections(rig) == [0, 0]


def test_a_computer_at_half_speed_guards_on_and_a_slower_one_leaves_no_wider_cap(rig: Rig) -> None:
    caps = (6000, 2000, 5000, 1000)
    for period_ms, state in ((40, GUARD), (100, FAULT)):
        rig.start()
        rig.guard(caps)
        push(rig, 0, SWING)
        for tick in range(3000):
            if tick % period_ms == 0:
                rig.limit(caps)
            else:
                rig.step()
            assert all(now <= told for now, told in zip(rig.out.caps, caps, strict=True)), period_ms
            assert deflections(rig)[0] <= 0.6 * SWING, period_ms
        assert rig.out.state == state, period_ms
