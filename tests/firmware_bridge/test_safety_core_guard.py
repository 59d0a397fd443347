"""The guard in the board: the rider's own stick within caps, which a fault never widens."""

from __future__ import annotations

import random
from collections.abc import Callable
from itertools import pairwise

from tests.firmware_bridge.rig import (
    ARMED,
    BAD_FRAME,
    BAD_FRAMES,
    BOARD,
    BOARD_FAULT,
    CAPPED,
    CLOCK,
    CREEP,
    CUT,
    DRIVE,
    DROPS,
    ENABLE,
    ESTOP,
    ESTOP_ACK,
    FAULT,
    FULL,
    GUARD,
    GUARDS,
    HOST_SILENT,
    IMPOSSIBLE,
    JOYSTICK,
    LIMIT,
    LOST,
    MISMATCH,
    NEUTRAL,
    NEW_HOST,
    OVERRIDDEN,
    RANGE,
    REFERENCE,
    RESET,
    SILENT,
    STICK,
    SWING,
    WARNS,
    HostMessage,
    Outputs,
    Rig,
    bent,
)

FRONT, REAR, LEFT, RIGHT = range(4)
BLOCKED = (0, 10000, 10000, 10000)
"""Caps with something right ahead."""

PUSHES = ((FRONT, 0, 1), (REAR, 0, -1), (LEFT, 1, -1), (RIGHT, 1, 1))
"""Direction, axis and sign: forward and right raise the voltage."""


def _push(rig: Rig, axis: int, mv: int) -> None:
    rig.stick = [NEUTRAL, NEUTRAL]
    rig.stick[axis] += mv


def _at(rig: Rig) -> list[int]:
    """The lines' deflections from neutral [mV]."""
    return [mv - NEUTRAL for mv in rig.lines()]


def test_f7_a_guard_begins_after_two_seconds_at_rest_with_both_flags(rig: Rig) -> None:
    rig.hello()
    for flags in (0, ENABLE, GUARDS, ENABLE | DROPS[0]):
        assert rig.limited(2200, FULL, flags).state == SILENT, flags
    rig.start()
    rig.hello()
    ticks = next(ms for ms in range(1, 2100) if _limit_at(rig, ms).state != SILENT)
    assert ticks == 2001
    assert (rig.out.state, rig.out.holder, list(rig.out.caps)) == (ARMED, JOYSTICK, [0] * 4)
    out = rig.limit()
    assert (out.state, out.holder, list(out.caps)) == (GUARD, BOARD, [0] * 4)
    assert list(rig.limit().caps) == [20] * 4


def _limit_at(rig: Rig, ms: int) -> Outputs:
    return rig.limit() if ms % 20 == 1 else rig.step()


def test_f7_a_stick_off_rest_or_no_handshake_gives_no_guard(rig: Rig) -> None:
    assert rig.limited(2500).state == SILENT
    rig.hello()
    for _ in range(2):
        rig.limited(1900)
        _push(rig, 1, 121)
        rig.limited(20)
        rig.stick = [NEUTRAL, NEUTRAL]
    assert rig.limited(1900).state == SILENT
    assert rig.limited(200).state == GUARD


def test_a_command_with_the_guards_bit_does_not_guard_and_a_limit_never_drives(rig: Rig) -> None:
    rig.hello()
    rig.run(2200, 0, 0, ENABLE | GUARDS)
    assert rig.out.state == ARMED
    out = rig.limit(FULL, ENABLE)
    assert (out.state, out.holder) == (SILENT, JOYSTICK)
    rig.start()
    rig.drive()
    out = rig.limit()
    assert (out.state, out.faults) == (SILENT, 0)
    rig.limited(19)
    assert rig.out.holder == JOYSTICK
    assert rig.lines() == (NEUTRAL, NEUTRAL)
    assert rig.limited(2100).state == GUARD


def test_an_armed_board_guards_at_the_first_limit(rig: Rig) -> None:
    rig.arm()
    assert rig.limit().state == GUARD
    rig.limited(4, (30, 40, 50, 60))
    assert list(rig.out.caps) == [30, 40, 50, 60]


def test_the_stick_is_clamped_by_the_cap_of_its_direction_and_never_enlarged(rig: Rig) -> None:
    for to, axis, sign in PUSHES:
        for cap in (0, 1, 700, 2500, 9999, 10000):
            caps = [5000] * 4
            caps[to] = cap
            rig.start()
            rig.guard(caps)
            for mv in (0, 1, 84, 299, 300, 301, 1199, 1200, 1201, 1900):
                _push(rig, axis, sign * mv)
                rig.limit(caps)
                deflection = sign * min(mv, cap * SWING // 10000)
                assert _at(rig)[axis] == deflection, (to, cap, mv)
                assert _at(rig)[1 - axis] == 0
                assert rig.out.guard_bits == (CAPPED if deflection != sign * mv else 0)


def test_full_caps_pass_every_millivolt_through_and_a_stick_at_rest_is_neutral(rig: Rig) -> None:
    rig.guard()
    for tick, mv in enumerate(range(-SWING, SWING + 1, 3)):
        rig.stick = [NEUTRAL + mv, NEUTRAL - mv]
        _limit_at(rig, tick)
        assert rig.lines() == (NEUTRAL + mv, NEUTRAL - mv)
        assert rig.out.guard_bits == 0
    rig.limited(400, (5000,) * 4)
    rig.stick = [NEUTRAL, NEUTRAL]
    rig.step()
    assert rig.lines() == (NEUTRAL, NEUTRAL)


def test_the_lines_follow_a_reference_within_its_tolerance(rig: Rig) -> None:
    rig.guard((2500,) * 4)
    for reference in (2375, 2430, 2600, 2625):
        swing = (SWING * reference + NEUTRAL // 2) // NEUTRAL
        rig.reference, rig.stick = reference, [reference + 900, reference - 40]
        rig.limit((2500,) * 4)
        assert rig.lines() == (reference + 2500 * swing // 10000, reference - 40)


def test_a_cap_falls_at_once_and_rises_by_the_full_swing_in_half_a_second(rig: Rig) -> None:
    rig.guard()
    _push(rig, 0, SWING)
    assert rig.limit(BLOCKED).caps[FRONT] == 0
    assert _at(rig) == [0, 0]
    rig.limit()
    caps = [rig.out.caps[FRONT]]
    while caps[-1] < 10000:
        rig.limit()
        caps.append(rig.out.caps[FRONT])
    assert len(caps) == 500
    assert {b - a for a, b in pairwise(caps)} == {20}
    rig.limit(BLOCKED)
    rig.limit(ms=20)
    assert rig.out.caps[FRONT] == 400
    rig.limit(ms=50)  # a late step catches up at most 20 ms
    assert rig.out.caps[FRONT] == 800


def test_f19_the_stick_does_not_take_over_from_the_guard(rig: Rig) -> None:
    rig.guard((2500,) * 4)
    _push(rig, 1, -SWING)
    rig.limited(1000, (2500,) * 4)
    assert (rig.out.state, rig.out.holder, _at(rig)) == (GUARD, BOARD, [0, -300])


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
        _push(rig, 0, 1000)
        rig.limit((10000, 2000, 10000, 0))
        bit = fault(rig)
        assert (rig.out.state, rig.out.faults, rig.out.holder) == (FAULT, bit, BOARD), fault
        assert list(rig.out.caps) == [2500, 2000, 2500, 0], fault
        assert rig.out.guard_bits == CAPPED | LOST, fault
        assert _at(rig) == [300, 0]
        rig.idle(5000)  # for as long as the stick is held
        assert list(rig.out.caps) == [2500, 2000, 2500, 0], fault
        _push(rig, 0, 120)  # at rest
        rig.idle(2000)
        assert (rig.out.state, rig.out.holder, rig.out.guard_bits) == (FAULT, BOARD, LOST), fault
        out = rig.step()
        assert (out.state, out.holder, out.faults, out.guard_bits) == (SILENT, JOYSTICK, 0, 0), fault
        assert list(out.caps) == [0] * 4
        _push(rig, 0, SWING)
        rig.step()
        assert _at(rig) == [SWING, 0]


def test_f1_the_rest_of_two_seconds_begins_anew_with_every_touch(rig: Rig) -> None:
    rig.guard()
    rig.limit()
    rig.idle(80)
    for _ in range(3):
        rig.idle(1990)
        _push(rig, 1, 121)
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
    _push(rig, 0, 600)
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


def test_an_end_by_the_riders_act_lets_the_stick_free_without_a_lurch(rig: Rig) -> None:
    ends: tuple[Callable[[], Outputs], ...] = (
        lambda: rig.limit(FULL, GUARDS),
        lambda: rig.limit(FULL, ENABLE),
        lambda: rig.command(0, 0, ENABLE),
    )
    for end in ends:
        rig.start()
        rig.guard(BLOCKED)
        rig.stick = [NEUTRAL + SWING, NEUTRAL - 50]
        rig.limit(BLOCKED)
        assert _at(rig) == [0, -50]
        rig.read_back = lambda _axis, mv: mv
        end()
        moves = [_at(rig)[0]]
        while rig.out.holder == BOARD:
            assert rig.out.state == SILENT
            rig.step()
            moves.append(_at(rig)[0])
        assert len(moves) == 500
        assert max(b - a for a, b in pairwise(moves)) <= 3
        assert (moves[-1], rig.out.faults, rig.out.state) == (SWING, 0, SILENT)


def test_an_end_with_nothing_held_back_is_immediate(rig: Rig) -> None:
    rig.guard((2500,) * 4)
    rig.stick = [NEUTRAL + 300, NEUTRAL - 300]
    rig.limit((2500,) * 4)
    out = rig.limit(FULL, 0)
    assert (out.state, out.holder) == (SILENT, JOYSTICK)
    rig.start()
    rig.guard((2500,) * 4)
    rig.stick = [NEUTRAL + 1300, NEUTRAL]  # beyond the swing, where a full cap holds back as well
    rig.limit((2500,) * 4)
    for _ in range(375):
        assert rig.out.holder == BOARD
        out = rig.limit(FULL, 0)
    assert (out.state, out.holder) == (SILENT, JOYSTICK)


def test_a_computer_that_dies_while_the_guard_opens_changes_nothing(rig: Rig) -> None:
    rig.guard(BLOCKED)
    _push(rig, 0, SWING)
    rig.limit(BLOCKED)
    rig.limit(FULL, 0)
    rig.idle(498)
    assert (rig.out.state, rig.out.holder, rig.out.faults) == (SILENT, BOARD, 0)
    assert (rig.step().holder, rig.out.faults) == (JOYSTICK, 0)


def _pushing(rig: Rig, ms: int, caps: tuple[int, ...] = BLOCKED, flags: int = ENABLE | GUARDS) -> None:
    """Limits every 10 ms for so long."""
    for tick in range(ms):
        if tick % 10 == 0:
            rig.limit(caps, flags)
        else:
            rig.step()


def test_a_push_of_two_seconds_against_a_cap_is_warned_then_creeps_for_ten_seconds_once(rig: Rig) -> None:
    for to, axis, sign in PUSHES:
        caps = [10000] * 4
        caps[to] = 0
        rig.start()
        rig.guard(caps)
        _push(rig, axis, sign * 1081)
        _pushing(rig, 1999, tuple(caps))
        assert (rig.out.guard_bits, rig.out.caps[to]) == (CAPPED, 0)
        assert rig.step().guard_bits == CAPPED | WARNS
        _pushing(rig, 499, tuple(caps))
        assert (rig.out.guard_bits, rig.out.caps[to]) == (CAPPED | WARNS, 0)
        assert (rig.step().guard_bits, rig.out.caps[to]) == (CAPPED | OVERRIDDEN, 20)
        _pushing(rig, 84, tuple(caps))
        assert (rig.out.guard_bits, rig.out.caps[to]) == (CAPPED | OVERRIDDEN, 1700)
        assert _at(rig)[axis] == sign * 204
        _pushing(rig, 9915, tuple(caps))
        assert (rig.out.guard_bits, rig.out.caps[to]) == (CAPPED | OVERRIDDEN, 1700)
        assert (rig.step().guard_bits, rig.out.caps[to]) == (CAPPED, 0)
        _pushing(rig, 5000, tuple(caps))  # a stick that is stuck gives no second one
        assert (rig.out.guard_bits, rig.out.caps[to]) == (CAPPED, 0)
        rig.stick = [NEUTRAL, NEUTRAL]
        rig.step()
        _push(rig, axis, sign * 1081)
        _pushing(rig, 2100, tuple(caps))
        assert rig.out.guard_bits == CAPPED | WARNS
        _push(rig, axis, sign * 1080)  # 90 % is not beyond it
        _pushing(rig, 2100, tuple(caps))
        assert rig.out.guard_bits == CAPPED


def test_both_axes_are_warned_and_overridden_by_themselves(rig: Rig) -> None:
    caps = (0, 10000, 10000, 0)
    rig.guard(caps)
    rig.stick = [NEUTRAL + 1200, NEUTRAL]
    _pushing(rig, 1000, caps)
    rig.stick = [NEUTRAL + 1200, NEUTRAL + 1200]
    _pushing(rig, 1700, caps)
    assert (rig.out.guard_bits, rig.out.caps[RIGHT]) == (CAPPED | OVERRIDDEN, 0)
    _pushing(rig, 400, caps)
    assert (rig.out.guard_bits, rig.out.caps[RIGHT]) == (CAPPED | WARNS | OVERRIDDEN, 0)
    assert rig.out.caps[FRONT] == 1700


def test_a_second_guard_begins_without_the_caps_of_the_first(rig: Rig) -> None:
    rig.guard()
    rig.limit(FULL, 0)
    assert rig.out.holder == JOYSTICK
    for _ in range(2100):
        rig.limit()
        if rig.out.state == GUARD:
            break
    assert list(rig.out.caps) == [0] * 4
    assert list(rig.limit().caps) == [20] * 4


def test_an_override_lasts_only_while_the_stick_is_held_hard(rig: Rig) -> None:
    rig.guard(BLOCKED)
    _push(rig, 0, 1200)
    _pushing(rig, 2600)
    assert rig.out.caps[FRONT] == 1700
    _push(rig, 0, 1080)
    rig.step()
    assert (rig.out.caps[FRONT], rig.out.guard_bits) == (0, CAPPED)
    _push(rig, 0, 1200)
    _pushing(rig, 1900)
    assert rig.out.guard_bits == CAPPED


def test_a_cap_above_a_creep_needs_no_override(rig: Rig) -> None:
    caps = (1700, 10000, 10000, 10000)
    rig.guard(caps)
    _push(rig, 0, 1200)
    _pushing(rig, 3000, caps)
    assert (rig.out.guard_bits, rig.out.caps[FRONT]) == (CAPPED, 1700)
    _pushing(rig, 2100, (1699, 10000, 10000, 10000))  # only the time against the narrower cap counts
    assert (rig.out.guard_bits, rig.out.caps[FRONT]) == (CAPPED | WARNS, 1699)
    _pushing(rig, 20, caps)
    assert rig.out.guard_bits == CAPPED


def test_a_drop_off_is_not_overridden_in_its_own_direction(rig: Rig) -> None:
    for to, axis, sign in PUSHES:
        caps = [10000] * 4
        caps[to] = 0
        rig.start()
        rig.guard(caps)
        _push(rig, axis, sign * 1200)
        for other, drop in enumerate(DROPS):
            if other != to:
                continue
            _pushing(rig, 4000, tuple(caps), ENABLE | GUARDS | drop)
            assert (rig.out.guard_bits, rig.out.caps[to]) == (CAPPED, 0)
        others = sum(drop for other, drop in enumerate(DROPS) if other != to)
        _pushing(rig, 100, tuple(caps), ENABLE | GUARDS | others)  # the time against an edge has not counted
        assert rig.out.guard_bits == CAPPED
        _pushing(rig, 2500, tuple(caps), ENABLE | GUARDS | others)
        assert rig.out.guard_bits == CAPPED | OVERRIDDEN
        rig.limit(tuple(caps), ENABLE | GUARDS | DROPS[to])  # the edge comes into view while the chair creeps
        assert (rig.out.guard_bits, rig.out.caps[to]) == (CAPPED, 0)


def test_a_lost_computer_ends_an_override(rig: Rig) -> None:
    rig.guard(BLOCKED)
    _push(rig, 0, 1200)
    _pushing(rig, 2600)
    assert rig.out.caps[FRONT] == 1700
    rig.idle(100)
    assert (rig.out.caps[FRONT], rig.out.guard_bits) == (0, CAPPED | LOST)
    rig.idle(3000)
    assert (rig.out.caps[FRONT], rig.out.guard_bits) == (0, CAPPED | LOST)


def test_f29_a_converter_that_fails_cuts_the_lines_until_the_stick_was_at_rest(rig: Rig) -> None:
    rig.guard()
    _push(rig, 0, 1000)
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
    _push(rig, 0, 900)
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
        _push(rig, 1, stick)
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
    _push(rig, 0, 1000)
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
    _push(rig, 0, 1000)
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
        assert (_at(rig), rig.out.faults) == ([0, 0], 0)
        rig.limited(60)
        assert (rig.out.faults, rig.out.holder, _at(rig)) == (STICK, BOARD, [0, 0])
        assert rig.idle(200).holder == CUT


def test_f10_f18_a_broken_line_or_the_e_stop_cuts_a_guard_at_once(rig: Rig) -> None:
    rig.guard()
    _push(rig, 0, 500)
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


def test_the_caps_of_another_session_or_of_an_old_frame_are_not_taken(rig: Rig) -> None:
    rig.guard((2500,) * 4)
    assert not rig.limit(FULL, ahead=0).heard
    assert not rig.limit(FULL, ahead=-1).heard
    assert not rig.limit(FULL, ahead=60).heard
    assert (rig.out.state, rig.out.faults, list(rig.out.caps)) == (GUARD, 0, [2500] * 4)
    rig.sequence = (rig.sequence - 59) & 0xFFFF
    assert list(rig.limit((2500,) * 4).caps) == [2500] * 4
    assert (rig.out.heard, rig.out.state, rig.out.faults) == (True, GUARD, 0)


def test_random_limits_sticks_and_faults_never_give_more_than_the_stick(rig: Rig) -> None:
    for seed in range(5):
        chance = random.Random(seed)
        rig.start()
        if seed:
            rig.guard()
        caps, guarded = FULL, 0
        for tick in range(5000):
            what = chance.random()
            host = None
            if tick % 20 == 0 and what < 0.95:
                caps = tuple(chance.choice((0, 1, 1000, 2500, 10000)) for _ in range(4))  # type: ignore[assignment]
                flags = chance.choice((9, 9, 25, 249)) if chance.random() < 0.99 else chance.randrange(256)
                rig.sequence = (rig.sequence + chance.choice((1, 1, 1, 0, 40))) & 0xFFFF
                wide = chance.random() < 0.01
                host = HostMessage(LIMIT, False, rig.sequence, (0, 0), flags, (20000,) * 4 if wide else caps)
            elif what < 0.02:
                rig.stick[chance.randrange(2)] = chance.choice((NEUTRAL, 2400, 3700, 1300, 2600, 4000))
            elif what < 0.023:
                rig.stick = [NEUTRAL, NEUTRAL]
            elif what < 0.0235:
                host = HostMessage(BAD_FRAME)
            rig.step(host, ms=chance.choice((1, 1, 1, 1, 2, 5)) if chance.random() < 0.9999 else 60)
            out = rig.out
            assert out.state != DRIVE
            if out.holder != BOARD:
                continue
            guarded += 1
            for axis, line in enumerate(_at(rig)):
                stick = rig.stick[axis] - NEUTRAL
                assert abs(line) <= abs(stick)
                assert line * stick >= 0
                assert line <= out.caps[(FRONT, RIGHT)[axis]] * SWING / 10000
                assert -line <= out.caps[(REAR, LEFT)[axis]] * SWING / 10000
        assert guarded > 1000 or not seed
