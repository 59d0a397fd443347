"""The black box's file: all undamaged records are read back."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.errors import BoxError
from waychair.runtime.black_box.box_file import (
    BoardIdentity,
    LogEnd,
    LoggedHalt,
    LoggedLocalisation,
    LogHeader,
    LostTicks,
    Moment,
    Record,
    RiderRequest,
    Tick,
    encoded,
    read_end,
    read_log,
    records,
)
from waychair.runtime.drive_base import ChairMessage
from waychair.types import (
    ChairStatus,
    DriveMode,
    Goal,
    ImuSample,
    JoystickInput,
    Pose2,
    RgbdFrame,
    Scan,
    SentCommand,
    SonarReadings,
    Telemetry,
    Twist,
    WheelSpeeds,
    WheelTicks,
)

HEAD = LogHeader(
    "s1", 7, "0.1.0", "a: 1\n", {"chair_id": "A"}, "cafe", {"lift": Pose2(1.0, 2.0)}, BoardIdentity(256, 9, 1, "A")
)


def tick_at(stamp_ns: int) -> Tick:
    sent = SentCommand(stamp_ns, WheelSpeeds(0.1, 0.2), 100, 120, 1.2, 1.3, True, "")
    telemetry = Telemetry(stamp_ns, 1.2, 1.3, JoystickInput(stamp_ns, 0.1, -0.1), ("ESTOP",), "DRIVE", "BOARD", 5)
    located = LoggedLocalisation("ok", 0.9, 0.8, Pose2(1.0, 0.0, 0.1), Pose2(), jumped=False)
    return Tick(
        stamp_ns,
        10**18 + stamp_ns,
        Pose2(1.0, 2.0, 3.0),
        Twist(0.5, 0.1),
        located,
        DriveMode.AUTONOMOUS,
        "",
        1.0,
        False,
        LoggedHalt("obstacle", "something"),
        (LoggedHalt("obstacle", "something"),),
        "driving",
        "",
        Twist(0.6),
        1,
        1,
        Pose2(9.0, 9.0),
        Twist(0.5),
        sent,
        telemetry,
    )


def moment_at(k: int) -> Moment:
    stamp_ns = k * 50_000_000
    scan = Scan(stamp_ns, np.full(8, 1.5, np.float32), -1.0, 0.25)
    return Moment(tick_at(stamp_ns), (WheelTicks(stamp_ns, k, -k), scan))


MESSAGES: tuple[ChairMessage, ...] = (
    WheelTicks(1, -5, 2**31 - 1),
    Scan(2, np.array([1.0, math.inf, -math.inf, math.nan], np.float32), -1.0, 0.5, 0.001, 0.1, 30.0),
    ImuSample(3, np.array([0.1, -0.2, 9.8]), np.array([0.0, 0.0, 0.3])),
    SonarReadings(4, np.array([0.5, math.inf], np.float32)),
    ChairStatus(5, seated=True, charging=None, battery=0.7),
)


def test_every_message_is_read_back_as_it_was() -> None:
    moment = next(records(encoded(Moment(tick_at(5), MESSAGES))))
    assert isinstance(moment, Moment)
    assert moment.tick == tick_at(5)
    assert len(moment.heard) == len(MESSAGES)
    for before, after in zip(MESSAGES, moment.heard, strict=True):
        assert type(after) is type(before)
        for name in type(before).__dataclass_fields__:
            np.testing.assert_array_equal(getattr(after, name), getattr(before, name))


def test_the_other_records_are_read_back_as_they_were() -> None:
    told = RiderRequest("go", (Goal("lift"), Goal(Pose2(1.0, 2.0, 0.5), 0.3, 0.2)))
    others: list[Record] = [HEAD, told, LostTicks(7), LogEnd("the disk is full")]
    assert list(records(b"".join(map(encoded, others)))) == others


def test_a_picture_is_kept_to_the_millimetre_of_depth_and_nearly_in_its_colours() -> None:
    depth = np.linspace(0.5, 4.0, 48, dtype=np.float32).reshape(6, 8)
    depth[0, 0] = np.nan
    image = np.full((6, 8, 3), (200, 40, 90), np.uint8)
    frame = RgbdFrame(9, image, depth, np.diag([300.0, 300.0, 1.0]), 1e-5)
    moment = next(records(encoded(Moment(tick_at(9), (frame,)))))
    assert isinstance(moment, Moment)
    after = moment.heard[0]
    assert isinstance(after, RgbdFrame)
    np.testing.assert_allclose(after.depth, depth, atol=6e-4)
    assert np.abs(after.image.astype(int) - image).max() <= 8
    np.testing.assert_array_equal(after.camera_matrix, frame.camera_matrix)
    assert (after.stamp_ns, after.row_step) == (9, 1e-5)


@given(st.integers(0, 10_000), st.data())
def test_a_file_truncated_anywhere_gives_all_complete_records(share: int, data: st.DataObject) -> None:
    pieces = [encoded(HEAD), *(encoded(moment_at(k)) for k in range(4))]
    whole = b"".join(pieces)
    cut = share * len(whole) // 10_000
    whole_pieces = sum(1 for k in range(len(pieces)) if sum(map(len, pieces[: k + 1])) <= cut)
    read = [record for record in records(whole[:cut]) if not isinstance(record, int)]
    assert len(read) == whole_pieces
    torn = data.draw(st.binary(max_size=40))  # the rest of a record after a power cut
    again = [record for record in records(whole[:cut] + torn + pieces[1]) if not isinstance(record, int)]
    assert len(again) == whole_pieces + 1


@given(st.integers(0, 1 << 30), st.integers(1, 255))
def test_a_wrong_byte_loses_one_record_only(place: int, flip: int) -> None:
    pieces = [encoded(HEAD), *(encoded(moment_at(k)) for k in range(4))]
    whole = bytearray(b"".join(pieces))
    place %= len(whole)
    whole[place] ^= flip
    read = [record for record in records(bytes(whole)) if not isinstance(record, int)]
    assert len(read) == len(pieces) - 1


def test_damage_is_counted(tmp_path: Path) -> None:
    path = tmp_path / "1.log"
    path.write_bytes(
        encoded(HEAD) + b"rubbish" + encoded(moment_at(1)) + encoded(LostTicks(3)) + encoded(moment_at(2))[:-1]
    )
    log = read_log([path])
    assert len(log.ticks) == 1
    assert log.lost == 3
    assert log.damaged == 7 + len(encoded(moment_at(2))) - 1
    assert log.end is None


def test_a_log_over_several_files_is_read_as_one_with_its_end(tmp_path: Path) -> None:
    first, second = tmp_path / "1.log", tmp_path / "2.log"
    first.write_bytes(encoded(HEAD) + encoded(moment_at(1)) + encoded(RiderRequest("stop")))
    second.write_bytes(encoded(replace(HEAD, wall_ns=8)) + encoded(moment_at(2)) + encoded(LogEnd()))
    log = read_log([first, second])
    assert [tick.stamp_ns for tick in log.ticks] == [50_000_000, 100_000_000]
    assert log.requests == ((1, RiderRequest("stop")),)
    assert log.head.wall_ns == 8
    assert log.end == LogEnd()
    assert read_end(first) is None
    assert read_end(second) == LogEnd()
    later = log.between(60_000_000, 200_000_000)
    assert [tick.stamp_ns for tick in later.ticks] == [100_000_000]
    assert later.requests == ((0, RiderRequest("stop")),)


@pytest.mark.parametrize("content", [b"", b"plain text", bytes(5000)])
def test_a_file_that_is_not_a_log_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "1.log"
    path.write_bytes(content)
    with pytest.raises(BoxError, match="not such a log"):
        read_log([path])


def test_a_log_of_another_format_is_refused_with_advice(tmp_path: Path) -> None:
    path = tmp_path / "1.log"
    path.write_bytes(encoded(replace(HEAD, format=99)))
    with pytest.raises(BoxError, match=r"format 99.*version of waychair"):
        read_log([path])


def test_an_unknown_kind_of_record_is_skipped() -> None:
    later = bytearray(encoded(LogEnd()))
    later[4:5] = b"Z"
    import zlib

    payload = bytes(later[13:])
    later[9:13] = zlib.crc32(payload, zlib.crc32(b"Z")).to_bytes(4, "little")
    assert list(records(encoded(HEAD) + bytes(later) + encoded(LostTicks(1)))) == [HEAD, LostTicks(1)]
