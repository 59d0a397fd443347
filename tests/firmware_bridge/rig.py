"""The firmware's safety core and frames under a fake clock: the C as a shared library, one Python call per step.

Functions named `test_*` with a `Rig` as their only argument are collected by pytest, and by `cases.py`, which runs them
against libraries that were built in other ways: with sanitizers, with coverage, with mutations.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from ctypes import (
    POINTER,
    Structure,
    byref,
    c_bool,
    c_char,
    c_int,
    c_int16,
    c_int32,
    c_size_t,
    c_uint8,
    c_uint16,
    c_uint32,
)
from pathlib import Path

from waychair.firmware_bridge.board import FIRMWARE, compile_c

SOURCES = ("safety_core.c", "guard.c", "families.c", "frame.c", "protocol.c", "converter.c")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wshadow")
TRAP = ("-fsanitize=undefined", "-fsanitize-undefined-trap-on-error")

SILENT, ARMED, DRIVE, FAULT, GUARD = range(5)
JOYSTICK, BOARD, CUT = range(3)
NO_EVENT, BAD_FRAME, HELLO, COMMAND, LIMIT = range(5)
ENABLE, RESET, ESTOP_ACK, GUARDS = 1, 2, 4, 8
DROPS = 16, 32, 64, 128
"""Flags of drop-offs to the front, the rear, the left and the right."""

CAPPED, WARNS, OVERRIDDEN, LOST = 1, 2, 4, 8
FULL = (10000,) * 4
(HOST_SILENT, BAD_FRAMES, RANGE, NEW_HOST, CLOCK, BOARD_FAULT, STICK, REFERENCE, CREEP, MISMATCH, IMPOSSIBLE, ESTOP) = (
    1 << bit for bit in range(12)
)
NEUTRAL, SWING = 2500, 1200
"""Of the 5 V Hall family [mV]."""


class Config(Structure):
    """safety_config."""

    _fields_ = [
        ("family", c_uint8),
        ("neutral_per_mille", c_uint16),
        ("override_per_mille", c_uint16),
        ("override_ms", c_uint16),
        ("slew_ms", c_uint16),
        ("guard_lost_per_mille", c_uint16),
    ]


class HostMessage(Structure):
    """host_message."""

    _fields_ = [
        ("event", c_uint8),
        ("hello_matches", c_bool),
        ("sequence", c_uint16),
        ("setpoint", c_int16 * 2),
        ("flags", c_uint8),
        ("caps", c_uint16 * 4),
    ]


class Inputs(Structure):
    """safety_inputs."""

    _fields_ = [
        ("joystick_mv", c_uint16 * 2),
        ("line_mv", c_uint16 * 2),
        ("reference_mv", c_uint16),
        ("estop_released", c_bool),
        ("board_ok", c_bool),
        ("host", HostMessage),
    ]


class Outputs(Structure):
    """safety_outputs."""

    _fields_ = [
        ("state", c_uint8),
        ("holder", c_uint8),
        ("faults", c_uint16),
        ("line_mv", c_uint16 * 2),
        ("kick", c_bool),
        ("heard", c_bool),
        ("caps", c_uint16 * 4),
        ("guard_bits", c_uint8),
    ]


class JoystickFamily(Structure):
    """joystick_family."""

    _fields_ = [
        ("name", ctypes.c_char_p),
        ("supply_mv", c_int32),
        ("reference_mv", c_int32),
        ("swing_mv", c_int32),
        ("fault_low_mv", c_int32),
        ("fault_high_mv", c_int32),
        ("source_ohm", c_int32),
        ("dac_low_mv", c_int32),
        ("dac_high_mv", c_int32),
        ("test_mv", c_int32 * 3),
    ]


class CFrame(Structure):
    """frame."""

    _fields_ = [("type", c_uint8), ("sequence", c_uint16), ("length", c_uint8), ("payload", c_uint8 * 48)]


class CHello(Structure):
    """hello."""

    _fields_ = [("version", c_uint8), ("layout_hash", c_uint32), ("chair_id", c_char * 16), ("family", c_uint8)]


class CCommand(Structure):
    """command."""

    _fields_ = [("setpoint", c_int16 * 2), ("flags", c_uint8), ("stamp_us", c_uint32)]


class CLimit(Structure):
    """limit."""

    _fields_ = [("caps", c_uint16 * 4), ("flags", c_uint8), ("stamp_us", c_uint32)]


class CHelloReply(Structure):
    """hello_reply."""

    _fields_ = [
        ("version", c_uint8),
        ("layout_hash", c_uint32),
        ("firmware_version", c_uint16),
        ("chair_id", c_uint8 * 16),
        ("family", c_uint8),
        ("refused", c_uint8),
        ("dac_bits", c_uint8),
        ("dac_counts_max", c_uint16),
        ("reference_mv", c_uint16),
        ("swing_mv", c_uint16),
        ("dac_low_mv", c_uint16),
        ("dac_high_mv", c_uint16),
    ]


class CTelemetry(Structure):
    """telemetry."""

    _fields_ = [
        ("state", c_uint8),
        ("holder", c_uint8),
        ("faults", c_uint16),
        ("set_mv", c_uint16 * 2),
        ("line_mv", c_uint16 * 2),
        ("reference_mv", c_uint16),
        ("joystick_mv", c_uint16 * 2),
        ("echo_sequence", c_uint16),
        ("echo_stamp_us", c_uint32),
        ("board_ms", c_uint32),
        ("bad_frames", c_uint16),
        ("rejected", c_uint16),
        ("caps", c_uint16 * 4),
        ("guard_bits", c_uint8),
    ]


def build_core(folder: Path, options: Sequence[str] = TRAP, firmware: Path = FIRMWARE) -> Path:
    """The portable part of the firmware as a shared library in `folder`."""
    library = folder / "core.so"
    sources = [*(str(firmware / name) for name in SOURCES), str(Path(__file__).with_name("rig.c"))]
    compile_c([*STRICT, "-g", "-O1", "-fPIC", "-shared", *options, f"-I{firmware}", *sources, "-o", str(library)])
    return library


def load_core(library: Path) -> ctypes.CDLL:
    """The library with the types of its functions."""
    core = ctypes.CDLL(str(library))
    core.rig_core_size.restype = core.rig_decoder_size.restype = core.frame_encode.restype = c_size_t
    core.safety_defaults.restype = Config
    core.safety_init.restype = c_bool
    core.safety_step.restype = Outputs
    core.safety_step.argtypes = [ctypes.c_void_p, POINTER(Inputs), c_uint32]
    core.family_find.restype = POINTER(JoystickFamily)
    core.family_find.argtypes = [c_uint8]
    core.frame_crc.restype = core.converter_counts.restype = c_uint16
    core.converter_counts.argtypes = [POINTER(JoystickFamily), c_uint16, c_int32]
    core.converter_line_mv.restype = c_int32
    core.converter_line_mv.argtypes = [POINTER(JoystickFamily), c_uint16, c_uint16]
    core.frame_decode.restype = c_int
    core.frame_decode.argtypes = [ctypes.c_void_p, c_uint8, POINTER(CFrame)]
    core.protocol_read_hello.restype = core.protocol_read_command.restype = core.protocol_read_limit.restype = c_bool
    return core


class Rig:
    """One safety core, its clock and its surroundings: lines have the commanded voltages unless a test says otherwise.

    `read_back` changes the voltage read from the lines, given (axis, mV); `stick` and `reference` are [mV].
    """

    def __init__(self, core: ctypes.CDLL) -> None:
        self.core = core
        self._armed: dict[tuple[bytes, int, int], tuple[bytes, int, int]] = {}
        self.start()

    def start(self, config: Config | None = None, now_ms: int = 1000) -> bool:
        """Switch the board on again; return whether its configuration is possible."""
        self._memory = ctypes.create_string_buffer(b"\xa5" * self.core.rig_core_size(), self.core.rig_core_size())
        self.config = config or self.core.safety_defaults(c_uint8(1))
        self.now_ms = now_ms
        self.sequence = 0
        self.stick = [NEUTRAL, NEUTRAL]
        self.reference = NEUTRAL
        self.estop_released = True
        self.board_ok = True
        self.read_back: Callable[[int, int], int] = lambda _axis, mv: mv
        self.out = Outputs(holder=JOYSTICK, line_mv=(NEUTRAL, NEUTRAL))
        return bool(self.core.safety_init(self._memory, byref(self.config)))

    def settings(self, **values: int) -> Config:
        """The default configuration of the 5 V Hall family with some values changed."""
        config: Config = self.core.safety_defaults(c_uint8(1))
        for name, value in values.items():
            setattr(config, name, value)
        return config

    def lines(self) -> tuple[int, int]:
        """Voltages of the chair's lines [mV] by their holder."""
        held = {JOYSTICK: self.stick, BOARD: list(self.out.line_mv), CUT: [self.reference] * 2}[self.out.holder]
        return held[0], held[1]

    def step(self, host: HostMessage | None = None, ms: int = 1) -> Outputs:
        """One step, `ms` after the one before."""
        self.now_ms = (self.now_ms + ms) & 0xFFFFFFFF
        read = [self.read_back(axis, mv) for axis, mv in enumerate(self.lines())]
        inputs = Inputs(
            (c_uint16 * 2)(*self.stick),
            (c_uint16 * 2)(*read),
            self.reference,
            self.estop_released,
            self.board_ok,
            host or HostMessage(),
        )
        self.out = self.core.safety_step(self._memory, byref(inputs), self.now_ms)
        return self.out

    def hello(self, matches: bool = True) -> Outputs:
        """A handshake arrives."""
        return self.step(HostMessage(HELLO, matches, self.sequence))

    def command(self, forward: int = 0, turn: int = 0, flags: int = ENABLE, ahead: int = 1, ms: int = 1) -> Outputs:
        """A command arrives, its sequence number `ahead` of the last one sent."""
        self.sequence = (self.sequence + ahead) & 0xFFFF
        return self.step(HostMessage(COMMAND, False, self.sequence, (c_int16 * 2)(forward, turn), flags), ms)

    def limit(self, caps: Sequence[int] = FULL, flags: int = ENABLE | GUARDS, ahead: int = 1, ms: int = 1) -> Outputs:
        """A limit arrives: caps to the front, the rear, the left and the right."""
        self.sequence = (self.sequence + ahead) & 0xFFFF
        message = HostMessage(LIMIT, False, self.sequence, (c_int16 * 2)(), flags, (c_uint16 * 4)(*caps))
        return self.step(message, ms)

    def limited(self, ms: int, caps: Sequence[int] = FULL, flags: int = ENABLE | GUARDS) -> Outputs:
        """Limits every 20 ms, the first at once, for so long."""
        for tick in range(ms):
            if tick % 20 == 0:
                self.limit(caps, flags)
            else:
                self.step()
        return self.out

    def guard(self, caps: Sequence[int] = FULL, ms: int = 520) -> Outputs:
        """Handshake, two seconds at rest, and the guard with these caps for so long: they are all in force."""
        key = (self._memory.raw + bytes(self.config), self.now_ms, 100_000)
        if key in self._armed:
            memory, self.now_ms, self.sequence = self._armed[key]
            self._memory.raw = memory
        else:
            self.hello()
            self.limited(2041, (0,) * 4)
            self._armed[key] = (self._memory.raw, self.now_ms, self.sequence)
        self.limited(ms, caps)
        out = self.out
        assert (out.state, out.holder, out.faults, list(out.caps)) == (GUARD, BOARD, 0, list(caps))
        return out

    def run(self, ms: int, forward: int = 0, turn: int = 0, flags: int = ENABLE) -> Outputs:
        """Commands every 20 ms, the first at once, for so long."""
        for tick in range(ms):
            if tick % 20 == 0:
                self.command(forward, turn, flags)
            else:
                self.step()
        return self.out

    def idle(self, ms: int) -> Outputs:
        """Nothing from the computer for so long."""
        for _ in range(ms):
            self.step()
        return self.out

    def arm(self) -> Outputs:
        """Handshake and two seconds of zero: ARMED. The state of a fresh board is kept, for the tests' speed."""
        key = (self._memory.raw + bytes(self.config), self.now_ms, self.sequence)
        if key in self._armed:
            memory, self.now_ms, self.sequence = self._armed[key]
            self._memory.raw = memory
        else:
            self.hello()
            self.run(2041)
            self._armed[key] = (self._memory.raw, self.now_ms, self.sequence)
        out = self.step()
        assert (out.state, out.holder, out.faults) == (ARMED, JOYSTICK, 0)
        return out

    def drive(self, forward: int = 5000, turn: int = -2500, ms: int = 400) -> Outputs:
        """Armed and on the way, the lines at the command."""
        self.arm()
        self.run(ms, forward, turn)
        assert (self.out.state, self.out.holder, self.out.faults) == (DRIVE, BOARD, 0)
        return self.out

    def until(self, done: Callable[[Outputs], bool], limit_ms: int, forward: int = 0, turn: int = 0) -> int:
        """Milliseconds of commands until the output is as wanted.

        Raises:
            AssertionError: it is not within the limit.
        """
        for tick in range(limit_ms):
            out = self.command(forward, turn) if tick % 20 == 0 else self.step()
            if done(out):
                return tick + 1
        raise AssertionError(f"not within {limit_ms} ms: state {self.out.state}, faults {self.out.faults:#x}")


def bent(axis: int, mv: int) -> Callable[[int, int], int]:
    """A read-back that is off by `mv` on one axis."""
    return lambda at, true: true + mv if at == axis else true


def forced(axis: int, mv: int) -> Callable[[int, int], int]:
    """A read-back of `mv` on one axis for any command."""
    return lambda at, true: mv if at == axis else true


FRONT, REAR, LEFT, RIGHT = range(4)
BLOCKED = (0, 10000, 10000, 10000)
"""Caps with something right ahead."""

PUSHES = ((FRONT, 0, 1), (REAR, 0, -1), (LEFT, 1, -1), (RIGHT, 1, 1))
"""Direction, axis and sign: forward and right raise the voltage."""


def push(rig: Rig, axis: int, mv: int) -> None:
    rig.stick = [NEUTRAL, NEUTRAL]
    rig.stick[axis] += mv


def deflections(rig: Rig) -> list[int]:
    """The lines' deflections from neutral [mV]."""
    return [mv - NEUTRAL for mv in rig.lines()]
