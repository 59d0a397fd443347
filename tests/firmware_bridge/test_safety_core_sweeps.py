"""Invariants for every input: random sequences, every fault in every state, configurations, families."""

from __future__ import annotations

import random
from ctypes import c_uint8, c_uint16

from tests.firmware_bridge.rig import (
    ARMED,
    BOARD,
    COMMAND,
    CUT,
    DRIVE,
    ENABLE,
    FAULT,
    HELLO,
    JOYSTICK,
    NEUTRAL,
    SILENT,
    SWING,
    HostMessage,
    Rig,
)

RAMP_OR_CUT = 0b1111_1100_0000
"""STICK, REFERENCE, CREEP, MISMATCH, IMPOSSIBLE, ESTOP: the only faults that may take the lines from the rider."""


def _life(rig: Rig, chance: random.Random, steps: int) -> list[tuple[int, str]]:
    """Run a random sequence, mostly valid with some arbitrary inputs; return every tick with a broken invariant."""
    before, broken = rig.lines(), []
    for tick in range(steps):
        event = chance.random()
        host = None
        if event < 0.05:
            rig.sequence = (rig.sequence + chance.choice((0, 1, 1, 1, 1, 1, 2, 40))) & 0xFFFF
            big = chance.random() < 0.02
            setpoint = [chance.randint(-32768, 32767) if big else chance.choice((0, 0, 5000, -9000)) for _ in (0, 1)]
            flags = chance.choice((0, 1, 1, 1, 1, 1, 1, 3, 7, 255))
            host = HostMessage(COMMAND, False, rig.sequence, (setpoint[0], setpoint[1]), flags)
        elif event < 0.0505:
            host = HostMessage(HELLO, chance.random() < 0.8, rig.sequence)
        elif event < 0.052:
            host = HostMessage(chance.choice((1, 77)), True, 3, (9, 9), 255)
        elif event < 0.053:
            rig.stick[chance.randrange(2)] = chance.choice((NEUTRAL, NEUTRAL, 2600, 3300, 1300, 0, 65535))
        elif event < 0.0535:
            rig.reference = chance.choice((NEUTRAL, NEUTRAL, 2380, 2620, 0, 65535))
        elif event < 0.054:
            rig.estop_released = chance.random() < 0.7
        elif event < 0.0545:
            offset = chance.choice((0, 0, 50, -100, 4000))
            rig.read_back = lambda _axis, mv, offset=offset: max(mv + offset, 0)  # type: ignore[misc]
        elif event < 0.06:
            rig.stick, rig.reference, rig.estop_released = [NEUTRAL, NEUTRAL], NEUTRAL, True
            rig.read_back = lambda _axis, mv: mv
        rig.step(host, ms=chance.choice((1, 1, 1, 1, 1, 1, 2, 5)) if chance.random() < 0.999 else 60)
        broken += [(tick, name) for name, holds in _invariants(rig, before).items() if not holds]
        before = rig.lines()
    return broken


def _invariants(rig: Rig, before: tuple[int, int]) -> dict[str, bool]:
    out, lines = rig.out, rig.lines()
    board = out.holder == BOARD
    small_steps = all(abs(a - b) <= 127 for a, b in zip(lines, before, strict=True))
    return {
        "a fault state has a fault": (out.state == FAULT) == (out.faults != 0),
        "only ramps and cuts take the lines": out.holder != CUT or bool(out.faults & RAMP_OR_CUT),
        "who drives is the board": out.state != DRIVE or board,
        "an armed board leaves the rider driving": out.state != ARMED or out.holder == JOYSTICK,
        "a pressed e-stop cuts": rig.estop_released or out.holder == CUT,
        "the lines stay in range": not board or all(500 <= mv <= 4500 for mv in out.line_mv),
        "the lines move in small steps": not board or out.state != DRIVE or small_steps,
        "without the board the lines rest": board or all(abs(mv - NEUTRAL) <= 125 for mv in out.line_mv),
    }


def test_a_random_sequence_of_inputs_breaks_no_invariant(rig: Rig) -> None:
    for seed in range(6):
        chance = random.Random(seed)
        rig.start()
        if seed % 2:
            rig.drive()
        assert _life(rig, chance, 4000) == []


def test_nothing_moves_without_a_handshake_and_two_seconds_of_zero(rig: Rig) -> None:
    chance = random.Random(1)
    for _ in range(4):
        rig.start()
        for _ in range(2500):
            rig.sequence = (rig.sequence + 1) & 0xFFFF
            setpoint = (chance.randint(-10000, 10000), chance.randint(-10000, 10000))
            rig.step(HostMessage(chance.choice((1, 2, 3, 3, 3)), True, rig.sequence, setpoint, chance.randrange(256)))
            assert rig.out.holder == JOYSTICK
            assert rig.out.state == SILENT


def test_every_fault_in_every_state_gives_the_lines_to_their_safe_holder(rig: Rig) -> None:
    for state in (SILENT, ARMED, DRIVE):
        for name, holder in (
            ("silence", JOYSTICK),
            ("bad frames", JOYSTICK),
            ("range", JOYSTICK),
            ("hello", JOYSTICK),
            ("clock", JOYSTICK),
            ("board", JOYSTICK),
            ("stick", CUT),
            ("reference", CUT),
            ("mismatch", CUT),
            ("impossible", CUT),
            ("e-stop", CUT),
        ):
            rig.start()
            _bring_to(rig, state)
            _break(rig, name)
            rig.idle(300)
            assert rig.out.holder == holder, (state, name)
            latched = state != SILENT or name not in ("silence", "bad frames", "range", "hello", "clock")
            assert (rig.out.state == FAULT) == latched, (state, name)


def _bring_to(rig: Rig, state: int) -> None:
    if state == ARMED:
        rig.arm()
    elif state == DRIVE:
        rig.drive()
    else:
        rig.hello()


def _break(rig: Rig, name: str) -> None:
    if name == "bad frames":
        for _ in range(5):
            rig.step(HostMessage(1))
    elif name == "range":
        rig.command(20000, 0)
    elif name == "hello":
        rig.hello()
    elif name == "clock":
        rig.step(ms=-10)
    elif name == "board":
        rig.board_ok = False
    elif name == "stick":
        rig.stick[1] = 100
    elif name == "reference":
        rig.reference = 2000
    elif name == "mismatch":
        rig.read_back = lambda _axis, mv: mv - 80
    elif name == "impossible":
        rig.read_back = lambda _axis, _mv: 0
    elif name == "e-stop":
        rig.estop_released = False


def test_a_configuration_out_of_its_limits_never_arms(rig: Rig) -> None:
    for name, low, high in (
        ("neutral_per_mille", 20, 199),
        ("override_per_mille", 101, 800),
        ("override_ms", 0, 500),
        ("slew_ms", 100, 1000),
        ("guard_lost_per_mille", 0, 1000),
    ):
        for value, fine in ((low - 1, False), (low, True), (high, True), (high + 1, False)):
            if value < 0:
                continue
            config = rig.settings(**{"override_per_mille": 200, name: value})
            if name == "neutral_per_mille" and value == 200:
                assert not rig.start(config)  # an override within neutral
                continue
            assert rig.start(config) == fine, (name, value)
    assert rig.start(rig.settings(neutral_per_mille=200, override_per_mille=201))
    assert not rig.start(rig.settings(neutral_per_mille=201, override_per_mille=300))
    assert not rig.start(rig.settings(neutral_per_mille=200, override_per_mille=200))


def test_without_a_joystick_family_nothing_arms_and_the_joystick_stays_live(rig: Rig) -> None:
    for family in (0, 4, 255):
        assert not rig.start(rig.settings(family=family))
        rig.estop_released = True
        rig.hello()
        out = rig.run(3000)
        assert (out.state, out.holder, out.faults, list(out.line_mv)) == (SILENT, JOYSTICK, 0, [0, 0])
        assert not out.heard
        assert rig.run(100, 5000).holder == JOYSTICK
        assert rig.config.family == family


def test_the_defaults_match_the_readme(rig: Rig) -> None:
    config = rig.core.safety_defaults(c_uint8(2))
    values = (config.family, config.neutral_per_mille, config.override_per_mille, config.override_ms, config.slew_ms)
    assert (*values, config.guard_lost_per_mille) == (2, 100, 200, 10, 200, 250)


def test_the_range_of_every_family_covers_its_swing_and_its_tolerance(rig: Rig) -> None:
    for number in (1, 2, 3):
        family = rig.core.family_find(number).contents
        assert family.fault_low_mv < family.reference_mv - family.swing_mv * 1.05 - 125 * family.reference_mv / 2500
        assert family.fault_high_mv > family.reference_mv + family.swing_mv * 1.05
        assert family.fault_high_mv < family.supply_mv
        assert family.dac_low_mv <= family.reference_mv - family.swing_mv
        assert family.dac_high_mv >= family.reference_mv + family.swing_mv
        assert 0 < family.source_ohm <= 10_000
        low, middle, high = family.test_mv
        assert (low, middle, high) == tuple(family.reference_mv + k * family.swing_mv for k in (-1, 0, 1))
    names = [rig.core.family_find(number).contents.name for number in (1, 2, 3)]
    assert names == [b"hall_5v", b"inductive_12v", b"eight_pin_3v3"]
    assert not rig.core.family_find(0)
    assert not any(rig.core.family_find(number) for number in range(4, 256))


def test_every_family_drives_to_both_ends_of_its_swing(rig: Rig) -> None:
    for number in (1, 2, 3):
        family = rig.core.family_find(number).contents
        config = rig.core.safety_defaults(c_uint8(number))
        rig.start(config)
        rig.stick, rig.reference = [family.reference_mv] * 2, family.reference_mv
        rig.out.line_mv[:] = rig.stick
        rig.hello()
        rig.run(2041)
        rig.run(600, 10000, -10000)
        assert (rig.out.state, list(rig.out.line_mv)) == (DRIVE, [family.test_mv[2], family.test_mv[0]])
        rig.command(0, 0, ENABLE)
        rig.run(600)
        assert list(rig.out.line_mv) == [family.reference_mv] * 2


def test_set_points_are_rounded_to_the_nearest_millivolt(rig: Rig) -> None:
    for setpoint in (0, 1, 4, 5, 41, 42, 4166, 4167, 9999, 10000):
        for sign in (1, -1):
            rig.start()
            rig.arm()
            rig.run(400, sign * setpoint, 5000)
            exact = setpoint * SWING / 10000
            assert rig.lines()[0] == NEUTRAL + sign * int(exact + 0.5), setpoint


def test_converter_counts_are_rounded_to_nearest_and_stay_in_range(rig: Rig) -> None:
    for number in (1, 2, 3):
        family = rig.core.family_find(number)
        low, high = family.contents.dac_low_mv, family.contents.dac_high_mv
        for top in (255, 1023, 4095, 65535):
            assert rig.core.converter_counts(family, c_uint16(top), low - 500) == 0
            assert rig.core.converter_counts(family, c_uint16(top), high + 500) == top
            for mv in range(low, high + 1, 7):
                counts = rig.core.converter_counts(family, c_uint16(top), mv)
                assert abs(counts - (mv - low) * top / (high - low)) <= 0.5
                back = rig.core.converter_line_mv(family, c_uint16(top), counts)
                assert abs(back - (low + counts * (high - low) / top)) <= 0.5
            assert rig.core.converter_counts(family, c_uint16(top), high) == top
            assert rig.core.converter_line_mv(family, c_uint16(top), c_uint16(top)) == high
