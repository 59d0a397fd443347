"""The protocol in Python and in C: the same bytes, the same hash, and a decoder that recovers after any bytes."""

from __future__ import annotations

import ctypes
import dataclasses
import random
from ctypes import byref, c_uint8
from itertools import islice
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.firmware_bridge.rig import CCommand, CFrame, CHello, CHelloReply, CLimit, CTelemetry, Rig
from waychair.errors import BridgeError
from waychair.firmware_bridge.board import FIRMWARE
from waychair.firmware_bridge.frames import crc16
from waychair.firmware_bridge.protocol import (
    LAYOUT_HASH,
    PROTOCOL_VERSION,
    BoardTelemetry,
    Command,
    Decoder,
    Family,
    Hello,
    HelloReply,
    Limit,
    Message,
    Received,
    encode,
    hello,
    line_millivolts,
    setpoint_from_millivolts,
)

COMMAND = Command(-10000, 10000, 1, 0x89ABCDEF)
REPLY = HelloReply(1, 2**32 - 1, 0x0102, b"A".ljust(16, b"\0"), 1, 0, 8, 255, 2500, 1200, 1100, 3900)
TELEMETRY = BoardTelemetry(
    2, 1, 0xFFF, 2000, 2001, 2002, 2003, 2004, 2005, 2006, 65535, 2**32 - 1, 7, 0, 256, 1, 2, 300, 10000, 9
)

u16 = st.integers(0, 0xFFFF)
commands = st.builds(
    Command, st.integers(-32768, 32767), st.integers(-32768, 32767), st.integers(0, 255), st.integers(0, 2**32 - 1)
)


def _c_decode(rig: Rig, data: bytes) -> tuple[list[CFrame], int]:
    """Frames that the C decoder finds, and how many bad ones."""
    decoder = ctypes.create_string_buffer(b"\xa5" * rig.core.rig_decoder_size())
    rig.core.frame_decoder_init(decoder)
    frames, bad = [], 0
    for byte in data:
        result = CFrame()
        what = rig.core.frame_decode(decoder, c_uint8(byte), byref(result))
        bad += what == 2
        if what == 1:
            frames.append(result)
    return frames, bad


def _c_encode(rig: Rig, frame: CFrame) -> bytes:
    wire = ctypes.create_string_buffer(b"\xa5" * 64)
    length = rig.core.frame_encode(byref(frame), wire)
    return wire.raw[:length]


def _numbers(value: ctypes.Structure) -> list[int]:
    """All fields of a C structure in order, arrays unrolled."""
    numbers: list[int] = []
    for name, *_ in value._fields_:
        field = getattr(value, name)
        numbers += list(field) if isinstance(field, ctypes.Array) else [field]
    return numbers


def test_the_checksum_gives_its_published_check_value(rig: Rig) -> None:
    assert crc16(b"123456789") == 0x29B1
    assert rig.core.frame_crc(b"123456789", ctypes.c_size_t(9)) == 0x29B1
    assert rig.core.frame_crc(b"", ctypes.c_size_t(0)) == 0xFFFF


def test_the_two_tables_have_the_same_hash_and_version() -> None:
    header = (FIRMWARE / "protocol.h").read_text()
    assert f"PROTOCOL_LAYOUT_HASH = 0x{LAYOUT_HASH:08X}u;" in header
    assert f"PROTOCOL_VERSION = {PROTOCOL_VERSION};" in header


def test_a_frame_has_the_described_layout() -> None:
    assert encode(Command(0x0102, -2, 5, 1), 0x1234)[:-1].count(0) == 0
    plain = bytes([3, 0x34, 0x12, 0x02, 0x01, 0xFE, 0xFF, 5, 1, 0, 0, 0])
    crc = crc16(plain)
    runs = (plain + bytes([crc & 0xFF, crc >> 8])).split(b"\0")
    assert encode(Command(0x0102, -2, 5, 1), 0x1234) == b"".join(bytes([len(r) + 1]) + r for r in runs) + b"\0"


def test_c_reads_the_frames_of_python(rig: Rig) -> None:
    chance = random.Random(5)
    for _ in range(300):
        forward, turn = (chance.choice((0, 1, -1, 256, -32768, 32767)) for _ in range(2))
        stamp_us = chance.choice((0, 1, 0xFF00FF00, chance.randrange(2**32)))
        sent = Command(forward, turn, chance.randrange(256), stamp_us)
        sequence = chance.choice((0, 255, 256, 65535))
        (frame,), bad = _c_decode(rig, encode(sent, sequence))
        read = CCommand()
        assert rig.core.protocol_read_command(byref(frame), byref(read))
        assert not rig.core.protocol_read_hello(byref(frame), byref(CHello()))
        assert (frame.sequence, bad) == (sequence, 0)
        assert _numbers(read) == list(dataclasses.astuple(sent))
    for caps in ((0, 1, 256, 65535), (10000, 255, 0, 2500)):
        asked = Limit(*caps, 0xF9, 0x89ABCDEF)
        (frame,), _ = _c_decode(rig, encode(asked, 7))
        limit = CLimit()
        assert rig.core.protocol_read_limit(byref(frame), byref(limit))
        assert not rig.core.protocol_read_command(byref(frame), byref(CCommand()))
        assert _numbers(limit) == list(dataclasses.astuple(asked))
    greeting = Hello(9, 0x89ABCDEF, b"a chair\0\0\0\0\0\0\0\0\1", 200)
    (frame,), _ = _c_decode(rig, encode(greeting, 1))
    said = CHello()
    assert rig.core.protocol_read_hello(byref(frame), byref(said))
    assert not rig.core.protocol_read_command(byref(frame), byref(CCommand()))
    assert (said.version, said.layout_hash, said.family) == (9, 0x89ABCDEF, 200)
    assert bytes(said)[CHello.chair_id.offset :][:16] == greeting.chair_id


def test_c_refuses_a_payload_of_the_wrong_length(rig: Rig) -> None:
    messages = ((1, 22, "hello", CHello), (3, 9, "command", CCommand), (5, 13, "limit", CLimit))
    for kind, length, read, target in messages:
        for wrong in (length - 1, length, length + 1):
            for other in (kind, kind + 1):
                frame = CFrame(other, 0, wrong)
                fits = wrong == length and other == kind
                reader = getattr(rig.core, f"protocol_read_{read}")
                assert bool(reader(byref(frame), byref(target()))) == fits


def test_python_reads_the_frames_of_c(rig: Rig) -> None:
    pairs: tuple[tuple[Message, type[ctypes.Structure], Any], ...] = (
        (REPLY, CHelloReply, rig.core.protocol_write_hello_reply),
        (TELEMETRY, CTelemetry, rig.core.protocol_write_telemetry),
    )
    for values, source, write in pairs:
        fields = iter(dataclasses.astuple(values))
        message = source()
        for name, *_ in source._fields_:
            field = getattr(message, name)
            if isinstance(field, ctypes.Array):
                first = next(fields)
                field[:] = list(first) if isinstance(first, bytes) else [first, *islice(fields, len(field) - 1)]
            else:
                setattr(message, name, next(fields))
        frame = CFrame(length=200)
        write(byref(message), byref(frame))
        frame.sequence = 0xABCD
        assert Decoder().feed(_c_encode(rig, frame)) == [Received(0xABCD, values)]


def test_c_and_python_frame_every_payload_alike(rig: Rig) -> None:
    chance = random.Random(3)
    for length in range(49):
        for zeros in (0.0, 0.3, 1.0):
            payload = bytes(0 if chance.random() < zeros else chance.randrange(1, 256) for _ in range(length))
            frame = CFrame(chance.randrange(256), chance.randrange(65536), length)
            frame.payload[:length] = list(payload)
            wire = _c_encode(rig, frame)
            assert wire.count(0) == 1
            assert len(wire) == length + 7
            (back,), bad = _c_decode(rig, b"\0\0" + wire + b"\0")
            assert (back.type, back.sequence, back.length, bad) == (frame.type, frame.sequence, length, 0)
            assert bytes(back.payload[:length]) == payload


def test_c_and_python_count_the_same_bad_frames(rig: Rig) -> None:
    chance = random.Random(11)
    good = encode(COMMAND, 9)
    for trial in range(600):
        noise = bytes(chance.choice((0, 1, 2, 5, 255, chance.randrange(256))) for _ in range(chance.randrange(70)))
        flipped = bytearray(good)
        flipped[chance.randrange(len(good))] ^= 1 << chance.randrange(8)
        data = (noise, bytes(flipped), good[: chance.randrange(len(good))], noise + good)[trial % 4] + b"\0" + good
        python = Decoder()
        received = python.feed(data)
        frames, bad = _c_decode(rig, data)
        assert len(frames) == len(received) >= 1
        assert bad == python.bad


def test_c_bounds_its_buffer(rig: Rig) -> None:
    good = encode(COMMAND, 9)
    for length in (53, 54, 55, 56, 57, 300, 5000):
        frames, bad = _c_decode(rig, b"\1" * length + b"\0" + good)
        assert (len(frames), bad) == (1, 1)
    longest = CFrame(3, 1, 48)
    frames, bad = _c_decode(rig, _c_encode(rig, longest))
    assert (len(frames), bad) == (1, 0)
    assert _c_decode(rig, b"\7" + b"\1" * 5 + b"\0")[1] == 1
    for short in range(1, 5):
        plain = bytes(range(1, short + 1))
        assert _c_decode(rig, bytes([short + 1]) + plain + b"\0") == ([], 1)


def test_c_refuses_a_valid_frame_that_is_one_byte_too_long(rig: Rig) -> None:
    wires = []
    for low in range(1, 256):
        for high in range(1, 256):
            plain = bytes([7, low, high]) + b"\1" * 49
            crc = crc16(plain)
            if crc >> 8 == 0xA5 and crc & 0xFF:  # ends in the memory behind the buffer: see _c_decode
                wires.append(bytes([len(plain) + 3]) + plain + bytes([crc & 0xFF, crc >> 8, 0]))
    assert wires
    for wire in wires:
        assert _c_decode(rig, wire) == ([], 1)


def test_a_frame_without_a_payload_is_valid(rig: Rig) -> None:
    (frame,), bad = _c_decode(rig, _c_encode(rig, CFrame(7, 0x0101, 0)))
    assert (frame.type, frame.sequence, frame.length, bad) == (7, 0x0101, 0, 0)


@given(st.lists(st.tuples(commands, u16), max_size=6), st.lists(st.integers(0, 40), max_size=20))
def test_any_cut_of_the_stream_gives_the_same_messages(sent: list[tuple[Command, int]], cuts: list[int]) -> None:
    stream = b"".join(encode(message, sequence) for message, sequence in sent)
    decoder, received = Decoder(), []
    for cut in cuts:
        received += decoder.feed(stream[:cut])
        stream = stream[cut:]
    received += decoder.feed(stream)
    assert [(r.message, r.sequence) for r in received] == sent
    assert decoder.bad == 0


@given(st.lists(st.binary(max_size=200), max_size=10))
def test_after_any_bytes_the_next_frame_is_found(noise: list[bytes]) -> None:
    decoder = Decoder()
    for part in noise:
        decoder.feed(part)
    decoder.feed(b"\0")
    assert decoder.feed(encode(COMMAND, 5)) == [Received(5, COMMAND)]


@given(commands, u16, st.data())
def test_a_flipped_bit_never_gives_another_message(sent: Command, sequence: int, data: st.DataObject) -> None:
    wire = bytearray(encode(sent, sequence))
    at = data.draw(st.integers(0, len(wire) * 8 - 1))
    wire[at // 8] ^= 1 << at % 8
    decoder = Decoder()
    assert decoder.feed(bytes(wire) + b"\0") == []
    assert decoder.bad >= 1


@pytest.mark.parametrize("message", [COMMAND, REPLY, TELEMETRY, hello("A", Family.HALL_5V), Limit(1, 2, 3, 4, 9, 5)])
def test_every_message_survives_encoding_and_decoding(message: Message) -> None:
    assert Decoder().feed(encode(message, 70000)) == [Received(70000 - 65536, message)]


def test_a_flood_without_a_zero_keeps_no_more_than_a_frame() -> None:
    decoder = Decoder()
    for _ in range(100):
        assert decoder.feed(b"\1" * 1000) == []
    assert len(decoder._frames._pending) <= 54
    assert decoder.feed(b"\0" + encode(COMMAND, 1)) == [Received(1, COMMAND)]
    assert decoder.bad == 1


def test_a_known_type_of_the_wrong_length_is_bad() -> None:
    plain = bytes([3, 1, 0, 1, 1])
    crc = crc16(plain)
    body = plain + bytes([crc & 0xFF, crc >> 8])
    wire = b"".join(bytes([len(run) + 1]) + run for run in body.split(b"\0")) + b"\0"
    decoder = Decoder()
    assert decoder.feed(wire) == []
    assert decoder.bad == 1


def test_a_number_out_of_range_is_refused_with_the_name_of_its_message() -> None:
    with pytest.raises(BridgeError, match="Command"):
        encode(Command(40000, 0, 0, 0), 0)


def test_a_chair_with_a_long_name_is_refused_with_advice() -> None:
    with pytest.raises(BridgeError, match="up to 16"):
        hello("the chair of the hospital", Family.HALL_5V)


def test_set_points_and_millivolts_are_inverse_within_a_step_of_the_converter() -> None:
    for reply in (REPLY, dataclasses.replace(REPLY, dac_bits=12, dac_counts_max=4095)):
        step = (reply.dac_high_mv - reply.dac_low_mv) / reply.dac_counts_max
        for mv in range(1300, 3701):
            assert abs(line_millivolts(reply, setpoint_from_millivolts(reply, mv)) - mv) <= step / 2 + 0.5
    assert setpoint_from_millivolts(REPLY, 99999) == 10000
    assert setpoint_from_millivolts(REPLY, -1.0) == -10000
    for wrong in (float("nan"), float("inf")):
        with pytest.raises(BridgeError, match="finite"):
            setpoint_from_millivolts(REPLY, wrong)
