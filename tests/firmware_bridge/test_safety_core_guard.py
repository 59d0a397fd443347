"""The guard in the board: the rider's own stick within caps."""

from __future__ import annotations

import random
from collections.abc import Callable
from itertools import pairwise

from tests.firmware_bridge.rig import (
    ARMED,
    BAD_FRAME,
    BLOCKED,
    BOARD,
    CAPPED,
    DRIVE,
    DROPS,
    ENABLE,
    FRONT,
    FULL,
    GUARD,
    GUARDS,
    JOYSTICK,
    LEFT,
    LIMIT,
    NEUTRAL,
    PUSHES,
    REAR,
    RIGHT,
    SILENT,
    SWING,
    HostMessage,
    Outputs,
    Rig,
    deflections,
    push,
)


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
        push(rig, 1, 121)
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
                push(rig, axis, sign * mv)
                rig.limit(caps)
                deflection = sign * min(mv, cap * SWING // 10000)
                assert deflections(rig)[axis] == deflection, (to, cap, mv)
                assert deflections(rig)[1 - axis] == 0
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
    push(rig, 0, SWING)
    assert rig.limit(BLOCKED).caps[FRONT] == 0
    assert deflections(rig) == [0, 0]
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
    push(rig, 1, -SWING)
    rig.limited(1000, (2500,) * 4)
    assert (rig.out.state, rig.out.holder, deflections(rig)) == (GUARD, BOARD, [0, -300])


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
        assert deflections(rig) == [0, -50]
        rig.read_back = lambda _axis, mv: mv
        end()
        moves = [deflections(rig)[0]]
        while rig.out.holder == BOARD:
            assert rig.out.state == SILENT
            rig.step()
            moves.append(deflections(rig)[0])
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
            for axis, line in enumerate(deflections(rig)):
                stick = rig.stick[axis] - NEUTRAL
                assert abs(line) <= abs(stick)
                assert line * stick >= 0
                assert line <= out.caps[(FRONT, RIGHT)[axis]] * SWING / 10000
                assert -line <= out.caps[(REAR, LEFT)[axis]] * SWING / 10000
        assert guarded > 1000 or not seed
