"""The serial protocol between computer and glove: the frames of the chair's board with messages of their own.

`firmware/glove/glove_protocol.h` is the same table in C. The CRC-32 of the table's text is the layout hash: two sides built
from different tables refuse each other.
"""

from __future__ import annotations

import enum
import struct
from dataclasses import astuple, dataclass
from typing import Any, ClassVar, TypeAlias

from waychair.errors import GloveError
from waychair.firmware_bridge.frames import Frame, FrameDecoder, encode_frame, layout_hash, struct_of_layout

GLOVE_PROTOCOL_VERSION = 1
GLOVE_FIRMWARE_VERSION = 0x0100
"""Major and minor version of the firmware tested with this computer; another major version is refused."""

GLOVE_PAYLOAD_MAX = 128
"""Longest payload [bytes]; the firmware is compiled with the same number (`GLOVE_C_FLAGS`)."""

STEPS_MAX = 16
"""Most steps of one PLAY."""

DEVICE_ID_LENGTH = 16
ON_MAX_MS, OFF_MAX_MS = 500, 2000
"""Longest vibration and rest of a step that the board plays."""

_FORMATS = {"u8": "B", "u16": "H", "u32": "I", "i8": "b", "id": f"{DEVICE_ID_LENGTH}s", "gains": "16s"}
_STEP = struct.Struct("<HBHH")
_PLAY_HEAD = struct.Struct("<BH")


class Hand(enum.IntEnum):
    """The hand that a device is made for; NONE for one that is worn elsewhere, or on either."""

    NONE = 0
    LEFT = 1
    RIGHT = 2


class GloveRefusal(enum.IntFlag):
    """Reasons for which a board refuses a handshake."""

    VERSION = 1
    TABLE = 2
    DEVICE = 4
    LAYOUT = 8


class GloveState(enum.IntEnum):
    """The state of the glove's core; LOST: it has said that nobody speaks, and waits for a greeting."""

    WAITING = 0
    READY = 1
    ARMED = 2
    LOST = 3


class PlayRefusal(enum.IntFlag):
    """Reasons for which the board does not play a PLAY."""

    STEPS = 1
    FAULTY = 2
    NOT_WORN = 4
    HOT = 8
    DUTY = 16
    LOWER = 32


class PlayCut(enum.IntFlag):
    """Reasons for which the board stopped a pattern in its middle."""

    DUTY = 1
    CROWD = 2
    RUN = 4
    FAULTY = 8
    NOT_WORN = 16
    HOT = 32
    CLOCK = 64


@dataclass(frozen=True, slots=True)
class PlayStep:
    """Motors by bit that are driven at once at a strength (0 to 255) for `on_ms`, then all rest for `off_ms`."""

    mask: int
    strength: int
    on_ms: int
    off_ms: int

    @property
    def motors(self) -> tuple[int, ...]:
        """The motors of the mask, in order."""
        return tuple(k for k in range(self.mask.bit_length()) if self.mask >> k & 1)


@dataclass(frozen=True, slots=True)
class GloveHello:
    """Computer to glove: the computer's protocol, and the device and layout of the rider's profile."""

    TYPE: ClassVar[int] = 65
    LAYOUT: ClassVar[str] = "version u8,layout_hash u32,device_id id,layout u8"

    version: int
    layout_hash: int
    device_id: bytes
    layout: int


@dataclass(frozen=True, slots=True)
class GloveReply:
    """Glove to computer: its identity, the number and kind of its motors, its hand, `refused` (a `GloveRefusal`)."""

    TYPE: ClassVar[int] = 66
    LAYOUT: ClassVar[str] = (
        "version u8,layout_hash u32,firmware_version u16,device_id id,layout u8,motors u8,hand u8,refused u8"
    )

    version: int
    layout_hash: int
    firmware_version: int
    device_id: bytes
    layout: int
    motors: int
    hand: int
    refused: int


@dataclass(frozen=True, slots=True)
class Play:
    """Computer to glove: a pattern. Queued behind one of equal priority, it is dropped after `valid_ms`."""

    TYPE: ClassVar[int] = 67
    LAYOUT: ClassVar[str] = "priority u8,valid_ms u16,steps (mask u16,strength u8,on_ms u16,off_ms u16)"

    priority: int
    valid_ms: int
    steps: tuple[PlayStep, ...]


@dataclass(frozen=True, slots=True)
class StopPlaying:
    """Computer to glove: all motors rest, and nothing is queued any more."""

    TYPE: ClassVar[int] = 68
    LAYOUT: ClassVar[str] = ""


@dataclass(frozen=True, slots=True)
class Gain:
    """Computer to glove: a factor for each output, of 255."""

    TYPE: ClassVar[int] = 69
    LAYOUT: ClassVar[str] = "gains gains"

    gains: bytes


@dataclass(frozen=True, slots=True)
class Alive:
    """Computer to glove at 10 Hz. While `armed` is 1 the board itself says when the computer falls silent."""

    TYPE: ClassVar[int] = 70
    LAYOUT: ClassVar[str] = "armed u8"

    armed: int


@dataclass(frozen=True, slots=True)
class GloveStatus:
    """Glove to computer at 20 Hz, and after each PLAY.

    `judged` is the sequence number of the last PLAY, `refused` its `PlayRefusal`, `cut` the `PlayCut` since the last report;
    `sequence` and `step` are of the pattern in play; `on`, `open_motors` and `shorted_motors` are motors by bit; presses are
    counted modulo 256.
    """

    TYPE: ClassVar[int] = 71
    LAYOUT: ClassVar[str] = (
        "state u8,playing u8,sequence u16,step u8,on u16,judged u16,refused u8,cut u8,open_motors u16,shorted_motors u16,"
        "worn u8,repeat_presses u8,yes_presses u8,temperature_c i8,board_ms u32,bad_frames u16,rejected u16"
    )

    state: int
    playing: int
    sequence: int
    step: int
    on: int
    judged: int
    refused: int
    cut: int
    open_motors: int
    shorted_motors: int
    worn: int
    repeat_presses: int
    yes_presses: int
    temperature_c: int
    board_ms: int
    bad_frames: int
    rejected: int


GloveMessage: TypeAlias = GloveHello | GloveReply | Play | StopPlaying | Gain | Alive | GloveStatus

_TYPES: dict[int, type[Any]] = {
    message.TYPE: message for message in (GloveHello, GloveReply, Play, StopPlaying, Gain, Alive, GloveStatus)
}
_STRUCTS = {
    number: struct_of_layout(message.LAYOUT, _FORMATS) for number, message in _TYPES.items() if message is not Play
}

GLOVE_LAYOUT_HASH = layout_hash({number: message.LAYOUT for number, message in _TYPES.items()})
"""CRC-32 of the message table; `GLOVE_LAYOUT_HASH` in firmware/glove/glove_protocol.h."""


@dataclass(frozen=True, slots=True)
class GloveReceived:
    """A message that was received without error, and the sequence number of its frame."""

    sequence: int
    message: GloveMessage


def glove_hello(device_id: str, layout: int) -> GloveHello:
    """Return the greeting for a device with the layout of this number.

    Raises:
        GloveError: the device's name is longer than 16 bytes.
    """
    name = device_id.encode()
    if len(name) > DEVICE_ID_LENGTH:
        raise GloveError(f"the glove's name '{device_id}' is {len(name)} bytes long: gloves have names of up to 16")
    return GloveHello(GLOVE_PROTOCOL_VERSION, GLOVE_LAYOUT_HASH, name.ljust(DEVICE_ID_LENGTH, b"\0"), layout)


def encode_glove(message: GloveMessage, sequence: int) -> bytes:
    """Return a frame for the wire, up to the closing zero; `sequence` is taken modulo 2^16.

    Raises:
        GloveError: a field does not fit its type in the table, or a PLAY has more than 16 steps.
    """
    try:
        payload = (
            _play_payload(message) if isinstance(message, Play) else _STRUCTS[message.TYPE].pack(*astuple(message))
        )
    except struct.error as error:
        raise GloveError(f"{message} cannot be sent to the glove: {error}") from error
    return encode_frame(Frame(message.TYPE, sequence & 0xFFFF, payload))


def _play_payload(message: Play) -> bytes:
    if len(message.steps) > STEPS_MAX:
        raise GloveError(f"a pattern of {len(message.steps)} steps cannot be sent: the glove plays up to {STEPS_MAX}")
    head = _PLAY_HEAD.pack(message.priority, message.valid_ms)
    return head + b"".join(_STEP.pack(step.mask, step.strength, step.on_ms, step.off_ms) for step in message.steps)


class GloveDecoder:
    """Decodes messages from bytes in any pieces; `bad` counts the byte runs that were no frames of this protocol."""

    def __init__(self) -> None:
        self._frames = FrameDecoder(GLOVE_PAYLOAD_MAX)
        self._unknown = 0

    @property
    def bad(self) -> int:
        return self._frames.bad + self._unknown

    def feed(self, data: bytes) -> list[GloveReceived]:
        """Return the messages completed by these bytes, in order."""
        read = [_parse(frame) for frame in self._frames.feed(data)]
        self._unknown += read.count(None)
        return [received for received in read if received is not None]


def _parse(frame: Frame) -> GloveReceived | None:
    if frame.type == Play.TYPE:
        play = _parse_play(frame.payload)
        return None if play is None else GloveReceived(frame.sequence, play)
    if frame.type not in _STRUCTS or len(frame.payload) != _STRUCTS[frame.type].size:
        return None
    return GloveReceived(frame.sequence, _TYPES[frame.type](*_STRUCTS[frame.type].unpack(frame.payload)))


def _parse_play(payload: bytes) -> Play | None:
    steps = payload[_PLAY_HEAD.size :]
    if len(payload) < _PLAY_HEAD.size or len(steps) % _STEP.size or len(steps) > STEPS_MAX * _STEP.size:
        return None
    priority, valid_ms = _PLAY_HEAD.unpack(payload[: _PLAY_HEAD.size])
    return Play(priority, valid_ms, tuple(PlayStep(*step) for step in _STEP.iter_unpack(steps)))
