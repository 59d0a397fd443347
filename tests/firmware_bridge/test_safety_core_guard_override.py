"""The rider's override of a cap: a hard push is warned, then creeps, once and never towards a drop-off."""

from __future__ import annotations

from tests.firmware_bridge.rig import (
    BLOCKED,
    CAPPED,
    DROPS,
    ENABLE,
    FRONT,
    GUARDS,
    LOST,
    NEUTRAL,
    OVERRIDDEN,
    PUSHES,
    RIGHT,
    WARNS,
    Rig,
    deflections,
    push,
)


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
        assert (rig.out.guard_bits, rig.out.caps[to]) == (CAPPED | OVERRIDDEN, 1150)
        assert deflections(rig)[axis] == sign * 138
        _pushing(rig, 9942, tuple(caps))
        assert (rig.out.guard_bits, rig.out.caps[to]) == (CAPPED | OVERRIDDEN, 1150)
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
    assert rig.out.caps[FRONT] == 1150


def test_an_override_lasts_only_while_the_stick_is_held_hard(rig: Rig) -> None:
    rig.guard(BLOCKED)
    push(rig, 0, 1200)
    _pushing(rig, 2600)
    assert rig.out.caps[FRONT] == 1150
    push(rig, 0, 1080)
    rig.step()
    assert (rig.out.caps[FRONT], rig.out.guard_bits) == (0, CAPPED)
    push(rig, 0, 1200)
    _pushing(rig, 1900)
    assert rig.out.guard_bits == CAPPED


def test_a_cap_above_a_creep_needs_no_override(rig: Rig) -> None:
    caps = (1150, 10000, 10000, 10000)
    rig.guard(caps)
    push(rig, 0, 1200)
    _pushing(rig, 3000, caps)
    assert (rig.out.guard_bits, rig.out.caps[FRONT]) == (CAPPED, 1150)
    _pushing(rig, 2100, (1149, 10000, 10000, 10000))  # only the time against the narrower cap counts
    assert (rig.out.guard_bits, rig.out.caps[FRONT]) == (CAPPED | WARNS, 1149)
    _pushing(rig, 20, caps)
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
    assert rig.out.caps[FRONT] == 1150
    rig.idle(100)
    assert (rig.out.caps[FRONT], rig.out.guard_bits) == (0, CAPPED | LOST)
    rig.idle(3000)
    assert (rig.out.caps[FRONT], rig.out.guard_bits) == (0, CAPPED | LOST)
