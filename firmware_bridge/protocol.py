"""The serial protocol between computer and board: COBS frames, CRC-16, sequence numbers, five messages.

A frame on the wire is `COBS(type u8, sequence u16, payload, crc u16) 00`, all little endian: COBS by Cheshire and Baker
(1999), CRC-16/IBM-3740 (polynomial 0x1021, start 0xFFFF, check value 0x29B1) over everything before it. Set-points are
1/10000 of the joystick family's swing, so that they mean the same with every converter; turn is positive to the right,
as on the chair's line. `firmware/protocol.h` is the same table in C. The CRC-32 of the table's text is the layout hash:
two sides built from different tables refuse each other.
"""

from __future__ import annotations

import enum
import struct
from dataclasses import astuple, dataclass
from typing import Any, ClassVar, TypeAlias

from waychair.errors import BridgeError
from waychair.firmware_bridge.frames import Frame, FrameDecoder, encode_frame, layout_hash, struct_of_layout

PROTOCOL_VERSION = 2
FIRMWARE_VERSION = 0x0200
"""Major and minor version of the firmware tested with this computer; another major version is refused."""

SETPOINT_MAX = 10_000
"""Set-point of the full swing; anything beyond it is a fault for the board."""

PAYLOAD_MAX = 48
"""Longest payload [bytes] that either side accepts."""

CHAIR_ID_LENGTH = 16

_FORMATS = {"u8": "B", "u16": "H", "u32": "I", "i16": "h", "id": f"{CHAIR_ID_LENGTH}s"}


class Family(enum.IntEnum):
    """Joystick families of `firmware/families.c`."""

    NONE = 0
    HALL_5V = 1
    INDUCTIVE_12V = 2
    EIGHT_PIN_3V3 = 3


class CommandFlag(enum.IntFlag):
    """Flags of a command beside its set-points, or of a limit beside its caps.

    GUARD and the bits of drop-offs count in a limit only: the guard acts, and no override raises that direction's cap.
    """

    ENABLE = 1
    RESET = 2
    ESTOP_ACK = 4
    GUARD = 8
    DROP_TO_FRONT = 16
    DROP_TO_REAR = 32
    DROP_TO_LEFT = 64
    DROP_TO_RIGHT = 128


class GuardBit(enum.IntFlag):
    """How the board's guard acts on the rider's stick now: `firmware/guard.h`."""

    CAPPED = 1
    WARNS = 2
    OVERRIDDEN = 4
    LOST = 8


class HandshakeRefusal(enum.IntFlag):
    """Reasons for which a board refuses a handshake."""

    VERSION = 1
    LAYOUT = 2
    CHAIR = 4
    FAMILY = 8
    CONFIG = 16


class BoardState(enum.IntEnum):
    """The state of the safety core."""

    SILENT = 0
    ARMED = 1
    DRIVE = 2
    FAULT = 3
    GUARD = 4


class Holder(enum.IntEnum):
    """The source of the voltages on the chair's lines."""

    JOYSTICK = 0
    BOARD = 1
    CUT = 2


class BoardFault(enum.IntFlag):
    """The fault bits of the safety core, which are rows of the fault table in README.md."""

    HOST_SILENT = 1 << 0  # F1
    BAD_FRAMES = 1 << 1  # F3
    RANGE = 1 << 2  # F5
    NEW_HOST = 1 << 3  # F22
    CLOCK = 1 << 4  # F16
    BOARD = 1 << 5  # F29
    STICK = 1 << 6  # F10 at the rider's stick
    REFERENCE = 1 << 7  # F9
    CREEP = 1 << 8  # F21
    MISMATCH = 1 << 9  # F8
    IMPOSSIBLE = 1 << 10  # F10
    ESTOP = 1 << 11  # F18


@dataclass(frozen=True, slots=True)
class Hello:
    """Computer to board: the computer's protocol and the chair of its calibration."""

    TYPE: ClassVar[int] = 1
    LAYOUT: ClassVar[str] = "version u8,layout_hash u32,chair_id id,family u8"

    version: int
    layout_hash: int
    chair_id: bytes
    family: int


@dataclass(frozen=True, slots=True)
class HelloReply:
    """Board to computer: its identity, `refused` (a `HandshakeRefusal`), and its converter; `dac_low_mv` and `dac_high_mv` are
    the line voltages at the converter's lowest and highest count."""

    TYPE: ClassVar[int] = 2
    LAYOUT: ClassVar[str] = (
        "version u8,layout_hash u32,firmware_version u16,chair_id id,family u8,refused u8,dac_bits u8,"
        "dac_counts_max u16,reference_mv u16,swing_mv u16,dac_low_mv u16,dac_high_mv u16"
    )

    version: int
    layout_hash: int
    firmware_version: int
    chair_id: bytes
    family: int
    refused: int
    dac_bits: int
    dac_counts_max: int
    reference_mv: int
    swing_mv: int
    dac_low_mv: int
    dac_high_mv: int


@dataclass(frozen=True, slots=True)
class Command:
    """Computer to board at 50 Hz; each command is also the heartbeat. `stamp_us` is only echoed (modulo 2^32)."""

    TYPE: ClassVar[int] = 3
    LAYOUT: ClassVar[str] = "forward i16,turn i16,flags u8,stamp_us u32"

    forward: int
    turn: int
    flags: int
    stamp_us: int


@dataclass(frozen=True, slots=True)
class Limit:
    """Computer to board at 50 Hz instead of commands: caps of the rider's own stick [1/10000 of the swing], each also a
    heartbeat. See `CommandFlag` for the flags."""

    TYPE: ClassVar[int] = 5
    LAYOUT: ClassVar[str] = "front u16,rear u16,left u16,right u16,flags u8,stamp_us u32"

    front: int
    rear: int
    left: int
    right: int
    flags: int
    stamp_us: int


@dataclass(frozen=True, slots=True)
class BoardTelemetry:
    """Board to computer after every accepted command or limit, or every 20 ms: voltages [mV], echo, counters, and the
    guard's caps in force [1/10000 of the swing] with its `GuardBit`s."""

    TYPE: ClassVar[int] = 4
    LAYOUT: ClassVar[str] = (
        "state u8,holder u8,faults u16,forward_set_mv u16,turn_set_mv u16,forward_mv u16,turn_mv u16,reference_mv u16,"
        "joystick_forward_mv u16,joystick_turn_mv u16,echo_sequence u16,echo_stamp_us u32,board_ms u32,"
        "bad_frames u16,rejected u16,front_cap u16,rear_cap u16,left_cap u16,right_cap u16,guard_bits u8"
    )

    state: int
    holder: int
    faults: int
    forward_set_mv: int
    turn_set_mv: int
    forward_mv: int
    turn_mv: int
    reference_mv: int
    joystick_forward_mv: int
    joystick_turn_mv: int
    echo_sequence: int
    echo_stamp_us: int
    board_ms: int
    bad_frames: int
    rejected: int
    front_cap: int
    rear_cap: int
    left_cap: int
    right_cap: int
    guard_bits: int


Message: TypeAlias = Hello | HelloReply | Command | BoardTelemetry | Limit

_TYPES: dict[int, type[Any]] = {
    message.TYPE: message for message in (Hello, HelloReply, Command, BoardTelemetry, Limit)
}
_STRUCTS = {number: struct_of_layout(message.LAYOUT, _FORMATS) for number, message in _TYPES.items()}

LAYOUT_HASH = layout_hash({number: message.LAYOUT for number, message in _TYPES.items()})
"""CRC-32 of the message table; `PROTOCOL_LAYOUT_HASH` in firmware/protocol.h."""


@dataclass(frozen=True, slots=True)
class Received:
    """A message that was received without error, and the sequence number of its frame."""

    sequence: int
    message: Message


def hello(chair_id: str, family: Family) -> Hello:
    """Return the greeting of a computer that was calibrated for this chair.

    Raises:
        BridgeError: the chair's name is longer than 16 bytes.
    """
    name = chair_id.encode()
    if len(name) > CHAIR_ID_LENGTH:
        raise BridgeError(f"chair id '{chair_id}' is {len(name)} bytes long: the board knows names of up to 16")
    return Hello(PROTOCOL_VERSION, LAYOUT_HASH, name.ljust(CHAIR_ID_LENGTH, b"\0"), family)


def line_millivolts(reply: HelloReply, setpoint: int) -> float:
    """Return a line's voltage [mV] at a set-point, with the reference at its nominal value and the board's rounding."""
    wanted = reply.reference_mv + _nearest(setpoint * reply.swing_mv, SETPOINT_MAX)
    span = reply.dac_high_mv - reply.dac_low_mv
    inside = min(max(wanted, reply.dac_low_mv), reply.dac_high_mv)
    counts = ((inside - reply.dac_low_mv) * reply.dac_counts_max + span // 2) // span
    return reply.dac_low_mv + counts * span / reply.dac_counts_max


def setpoint_from_millivolts(reply: HelloReply, millivolts: float) -> int:
    """Return the nearest set-point for a line voltage [mV], limited to the swing.

    Raises:
        BridgeError: the voltage is not a finite number.
    """
    fraction = (millivolts - reply.reference_mv) / reply.swing_mv
    if not abs(fraction) < float("inf"):
        raise BridgeError(f"{millivolts} mV cannot be put on a line: give a finite voltage")
    return round(SETPOINT_MAX * min(max(fraction, -1.0), 1.0))


def encode(message: Message, sequence: int) -> bytes:
    """Return a frame for the wire, up to the closing zero; `sequence` is taken modulo 2^16.

    Raises:
        BridgeError: a field does not fit its type in the layout.
    """
    try:
        payload = _STRUCTS[message.TYPE].pack(*astuple(message))
    except struct.error as error:
        raise BridgeError(f"{message} cannot be sent: {error}") from error
    return encode_frame(Frame(message.TYPE, sequence & 0xFFFF, payload))


class Decoder:
    """Decodes messages from bytes in any pieces, with bounded memory; it resynchronises at every zero byte.

    `bad` counts the byte runs between two zero bytes that were not frames of this protocol.
    """

    def __init__(self) -> None:
        self._frames = FrameDecoder(PAYLOAD_MAX)
        self._unknown = 0

    @property
    def bad(self) -> int:
        return self._frames.bad + self._unknown

    def feed(self, data: bytes) -> list[Received]:
        """Return the messages completed by these bytes, in order."""
        read = [_parse(frame) for frame in self._frames.feed(data)]
        self._unknown += read.count(None)
        return [received for received in read if received is not None]


def _parse(frame: Frame) -> Received | None:
    if frame.type not in _STRUCTS or len(frame.payload) != _STRUCTS[frame.type].size:
        return None
    return Received(frame.sequence, _TYPES[frame.type](*_STRUCTS[frame.type].unpack(frame.payload)))


def _nearest(numerator: int, denominator: int) -> int:
    """Return the quotient to nearest, halves away from zero, which is the board's rounding."""
    size = (abs(numerator) + denominator // 2) // denominator
    return size if numerator >= 0 else -size
