"""The rider's override of a cap: a hard push is warned, then creeps, once and never towards a drop-off."""

from __future__ import annotations

from tests.firmware_bridge.rig import (
    BLOCKED,
    CAPPED,
    DROPS,
    ENABLE,
    FRONT,
    GUARDS,
    LEFT,
    LOST,
    NEUTRAL,
    OVERRIDDEN,
    PUSHES,
    REAR,
    RIGHT,
    WARNS,
    Rig,
    deflections,
    push,
)

CREEPS = {0: 1100, 1: 1000}
"""Caps of an override by axis, forward and turn."""


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
        push(rig, axis, sign * 1081)
        _pushing(rig, 1999, tuple(caps))
        assert (rig.out.guard_bits, rig.out.caps[to]) == (CAPPED, 0)
        assert rig.step().guard_bits == CAPPED | WARNS
        _pushing(rig, 499, tuple(caps))
        assert (rig.out.guard_bits, rig.out.caps[to]) == (CAPPED | WARNS, 0)
        assert (rig.step().guard_bits, rig.out.caps[to]) == (CAPPED | OVERRIDDEN, 20)
        _pushing(rig, 57, tuple(caps))
        assert (rig.out.guard_bits, rig.out.caps[to]) == (CAPPED | OVERRIDDEN, CREEPS[axis])
        assert deflections(rig)[axis] == sign * CREEPS[axis] * 1200 // 10000
        _pushing(rig, 9942, tuple(caps))
        assert (rig.out.guard_bits, rig.out.caps[to]) == (CAPPED | OVERRIDDEN, CREEPS[axis])
        assert (rig.step().guard_bits, rig.out.caps[to]) == (CAPPED, 0)
        _pushing(rig, 5000, tuple(caps))  # a stick that is stuck gives no second one
        assert (rig.out.guard_bits, rig.out.caps[to]) == (CAPPED, 0)
        rig.stick = [NEUTRAL, NEUTRAL]
        rig.step()
        push(rig, axis, sign * 1081)
        _pushing(rig, 2100, tuple(caps))
        assert rig.out.guard_bits == CAPPED | WARNS
        push(rig, axis, sign * 1080)  # 90 % is not beyond it
        _pushing(rig, 2100, tuple(caps))
        assert rig.out.guard_bits == CAPPED


def test_a_push_that_went_on_past_one_thing_does_not_override_the_next(rig: Rig) -> None:
    for to, axis, sign in PUSHES:
        shut, wide = [10000] * 4, [10000] * 4
        shut[to] = 0
        for before_ms, bits in ((1500, CAPPED), (2700, CAPPED | OVERRIDDEN)):  # not warned yet, and in the override
            rig.start()
            rig.guard(shut)
            push(rig, axis, sign * 1081)
            _pushing(rig, before_ms, tuple(shut))
            assert rig.out.guard_bits == bits
            _pushing(rig, 300, tuple(wide))  # the thing is left behind
            assert rig.out.caps[to] >= 2 * CREEPS[axis]
            _pushing(rig, 1900, tuple(shut))
            assert (rig.out.guard_bits, rig.out.caps[to]) == (CAPPED, 0)
            _pushing(rig, 1000, tuple(shut))
            # a push that has overridden nothing may still do so, after its two seconds and a warning
            later = (CAPPED | OVERRIDDEN, CREEPS[axis]) if bits == CAPPED else (CAPPED, 0)
            assert (rig.out.guard_bits, rig.out.caps[to]) == later


def test_a_cap_that_flickers_about_a_creep_does_not_end_an_override(rig: Rig) -> None:
    shut, little = (0, 10000, 10000, 10000), (1500, 10000, 10000, 10000)
    rig.start()
    rig.guard(shut)
    push(rig, 0, 1081)
    _pushing(rig, 3000, shut)
    for _ in range(5):
        _pushing(rig, 200, little)
        _pushing(rig, 200, shut)
        assert (rig.out.guard_bits, rig.out.caps[FRONT]) == (CAPPED | OVERRIDDEN, CREEPS[0])


def test_both_axes_are_warned_by_themselves_and_one_creeps_at_a_time(rig: Rig) -> None:
    for first, second in ((FRONT, RIGHT), (REAR, LEFT)):
        rig.start()
        caps = [10000] * 4
        caps[first] = caps[second] = 0
        rig.guard(caps)
        sign = 1 if first == FRONT else -1
        push(rig, 1, sign * 1200)
        _pushing(rig, 1000, tuple(caps))
        rig.stick = [NEUTRAL + sign * 1200, NEUTRAL + sign * 1200]
        _pushing(rig, 1700, tuple(caps))
        assert (rig.out.guard_bits, rig.out.caps[first], rig.out.caps[second]) == (CAPPED | OVERRIDDEN, 0, 1000)
        _pushing(rig, 400, tuple(caps))
        assert (rig.out.guard_bits, rig.out.caps[first], rig.out.caps[second]) == (
            CAPPED | WARNS | OVERRIDDEN,
            0,
            1000,
        )
        _pushing(rig, 500, tuple(caps))  # driving comes before turning
        assert (rig.out.guard_bits, rig.out.caps[first], rig.out.caps[second]) == (CAPPED | OVERRIDDEN, 1100, 0)
        push(rig, 1, sign * 1200)
        _pushing(rig, 100, tuple(caps))
        assert (rig.out.guard_bits, rig.out.caps[first], rig.out.caps[second]) == (CAPPED | OVERRIDDEN, 0, 1000)


def test_a_turn_is_warned_but_does_not_creep_while_the_drive_does(rig: Rig) -> None:
    caps = (0, 10000, 10000, 0)
    rig.guard(caps)
    push(rig, 0, 1200)
    _pushing(rig, 1000, caps)
    rig.stick = [NEUTRAL + 1200, NEUTRAL + 1200]
    _pushing(rig, 2100, caps)
    assert (rig.out.guard_bits, rig.out.caps[FRONT], rig.out.caps[RIGHT]) == (CAPPED | WARNS | OVERRIDDEN, 1100, 0)
    _pushing(rig, 1000, caps)
    assert (rig.out.guard_bits, rig.out.caps[FRONT], rig.out.caps[RIGHT]) == (CAPPED | OVERRIDDEN, 1100, 0)


def test_an_override_lasts_only_while_the_stick_is_held_hard(rig: Rig) -> None:
    rig.guard(BLOCKED)
    push(rig, 0, 1200)
    _pushing(rig, 2600)
    assert rig.out.caps[FRONT] == 1100
    push(rig, 0, 1080)
    rig.step()
    assert (rig.out.caps[FRONT], rig.out.guard_bits) == (0, CAPPED)
    push(rig, 0, 1200)
    _pushing(rig, 1900)
    assert rig.out.guard_bits == CAPPED


def test_a_cap_above_a_creep_needs_no_override(rig: Rig) -> None:
    for to, axis, sign in PUSHES:
        caps = [10000] * 4
        caps[to] = creep = CREEPS[axis]
        rig.start()
        rig.guard(caps)
        push(rig, axis, sign * 1200)
        _pushing(rig, 3000, tuple(caps))
        assert (rig.out.guard_bits, rig.out.caps[to]) == (CAPPED, creep)
        narrower = tuple(creep - 1 if other == to else cap for other, cap in enumerate(caps))
        _pushing(rig, 2100, narrower)  # only the time against the narrower cap counts
        assert (rig.out.guard_bits, rig.out.caps[to]) == (CAPPED | WARNS, creep - 1)
        _pushing(rig, 20, tuple(caps))
        assert rig.out.guard_bits == CAPPED


def test_a_drop_off_is_not_overridden_in_its_own_direction(rig: Rig) -> None:
    for to, axis, sign in PUSHES:
        caps = [10000] * 4
        caps[to] = 0
        rig.start()
        rig.guard(caps)
        push(rig, axis, sign * 1200)
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
    push(rig, 0, 1200)
    _pushing(rig, 2600)
    assert rig.out.caps[FRONT] == 1100
    rig.idle(100)
    assert (rig.out.caps[FRONT], rig.out.guard_bits) == (0, CAPPED | LOST)
    rig.idle(3000)
    assert (rig.out.caps[FRONT], rig.out.guard_bits) == (0, CAPPED | LOST)
