"""Replay regression test: each part of a chair, fed with a recorded drive, must reproduce its reference outputs.

A tape holds all inputs of a chair in a simulated drive, including the bytes of its board. Each part gets its inputs
from the tape alone, never from another part (`part_replays`), so that a change shows only in the part that was changed.
The reference holds each part's outputs tick by tick. A difference names part, tick and field, with the old and the new
value.
"""

from __future__ import annotations

import json
import lzma
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

import msgspec
import numpy as np

from waychair.errors import BoxError, ConfigError
from waychair.files import write_bytes
from waychair.firmware_bridge.protocol import HelloReply
from waychair.firmware_bridge.transports import Transport
from waychair.runtime.black_box.box_file import (
    Moment,
    RiderRequest,
    encoded,
    records,
    tick_from_state,
)
from waychair.runtime.chair import Chair, ChairState
from waychair.runtime.drive_base import ChairMessage
from waychair.runtime.measured_motion import MeasuredMotion
from waychair.simulation.simulator import Simulator
from waychair.slam.localising.localisation import Localisation
from waychair.trials.drive import BEAT_NS, TICK_NS, DriveSetup, simulated_chair
from waychair.types import Goal, ImuSample, Pose2, RgbdFrame, Scan, SonarReadings, Twist, WheelTicks

Value: TypeAlias = float | int | bool | str | None
Row: TypeAlias = dict[str, Value]
"""The outputs of one tick, by field."""

DIGITS = 6
"""Decimals that the references keep."""

TOLERANCES: Mapping[str, float] = MappingProxyType(
    {
        "odometry": 1e-4,
        "localiser": 5e-3,
        "localiser.health": 0.05,
        "localiser.inliers": 0.02,
        "pilot": 5e-3,
        "base": 2e-3,
        "base.forward_volts": 0.02,
        "base.turn_volts": 0.02,
    }
)
"""Tolerances by part, or by part and field, for numbers: rounding may differ between processors."""

IGNORED: Mapping[str, str] = MappingProxyType(
    {
        "pilot.reason": "its wording may change; the stage is compared",
        "base.reason": "its wording may change; mode and halts are compared",
    }
)
"""Fields that are stored for readers but not compared, with the reason."""


@dataclass(frozen=True, slots=True)
class TapedTick:
    """All inputs of one tick; `moment` is a record of the black box.

    `beats`: times [ns] of the heartbeats before the tick, with the board's bytes until then. `answers`: its bytes in
    the tick. `active`: there was a goal. `odom_from_base`: the odometry at the tick's scan, None without a scan.
    `twist_at_scan`: the measured twist then. `seen_from`: map_from_base at each of the tick's sonar readings and pictures,
    None before the chair was localised.
    """

    beats: tuple[tuple[int, bytes], ...]
    answers: bytes
    told: tuple[RiderRequest, ...]
    active: bool
    moment: bytes
    odom_from_base: Pose2 | None = None
    twist_at_scan: Twist | None = None
    seen_from: tuple[Pose2 | None, ...] = ()


@dataclass(frozen=True, slots=True)
class Tape:
    """A recorded drive that began at `start` on the map."""

    start: Pose2
    ticks: tuple[TapedTick, ...]

    def moments(self) -> Iterator[tuple[TapedTick, Moment]]:
        """Yield the ticks, decoded.

        Raises:
            BoxError: the ticks have another version.
        """
        for taped in self.ticks:
            moment = next(records(taped.moment))
            if not isinstance(moment, Moment):
                raise BoxError("the tape has another version: record it again with --record --reason")
            yield taped, moment


def save_tape(path: Path, tape: Tape) -> None:
    """Write a tape, compressed; numbers of numpy, as in the poses of drawn scenes, become Python's."""
    data = msgspec.msgpack.encode(tape, enc_hook=lambda number: number.item())
    write_bytes(path, lzma.compress(data, preset=9))


def load_tape(path: Path) -> Tape:
    """Read a tape.

    Raises:
        BoxError: the tape does not exist, is damaged or has another version.
    """
    try:
        return msgspec.msgpack.decode(lzma.decompress(path.read_bytes()), type=Tape)
    except (OSError, EOFError, lzma.LZMAError, msgspec.MsgspecError) as error:
        raise BoxError(f"cannot read the tape {path}: {error}: record it again with --record") from error


def record_tape(
    setup: DriveSetup, simulator: Simulator, actions: Mapping[int, Callable[[Simulator, Chair], None]], ticks: int
) -> Tape:
    """Drive for `ticks` ticks, calling `actions[k]` before tick k, and return the tape.

    Sensor messages are rounded to 1e-3 (mm, mrad/s) for the chair and for the tape alike.
    """
    start = setup.map_from_world @ simulator.truth()
    taps: list[_Tap] = []

    def wrap_transport(transport: Transport) -> Transport:
        taps.append(_Tap(transport))
        return taps[-1]

    listener, motion = _Listener(), MeasuredMotion(setup.body, start)
    taped: list[TapedTick] = []
    located: Localisation | None = None
    with simulated_chair(setup, simulator, listener, wrap_transport) as chair:
        for index in range(ticks):
            if index in actions:
                actions[index](simulator, chair)
            beats, heard = [], list[ChairMessage]()
            for _ in range(TICK_NS // BEAT_NS):
                now_ns = simulator.now_ns
                chair.beat(now_ns)
                beats.append((now_ns, _take_bytes(taps)))
                heard += map(_rounded, simulator.advance(BEAT_NS))
            told, active = listener.take(), chair.navigator.active
            state = chair.step(simulator.now_ns, heard)
            moment = encoded(Moment(tick_from_state(state, 0), tuple(heard)))
            made = TapedTick(tuple(beats), _take_bytes(taps), told=told, active=active, moment=moment)
            taped.append(_with_places(made, motion, heard, located, state.localisation))
            located = state.localisation
    return Tape(start, tuple(taped))


def pilots_part(tape: Tape) -> Tape:
    """Return the tape with nothing but what the pilot takes in. Its pictures have no colours."""
    return replace(tape, ticks=tuple(_pilots_part(taped, moment) for taped, moment in tape.moments()))


@dataclass(frozen=True, slots=True)
class Difference:
    """A field of a part that differs: first row, old and new value, and in how many rows of all."""

    part: str
    field: str
    row: int
    old: Value
    new: Value
    rows: int
    of: int

    def __str__(self) -> str:
        tolerance = _tolerance(self.part, self.field)
        return (
            f"{self.part}: {self.field} was {self.old} and is {self.new} in row {self.row} (tolerance {tolerance:g}); "
            f"it differs in {self.rows} of {self.of} rows"
        )


def differences(part: str, old: Sequence[Row], new: Sequence[Row]) -> list[Difference]:
    """Return the differing fields, ordered by the first row that differs."""
    if len(old) != len(new):
        return [
            Difference(part=part, field="rows", row=min(len(old), len(new)), old=len(old), new=len(new), rows=1, of=1)
        ]
    names = dict.fromkeys(name for row in (*old[:1], *new[:1]) for name in row)
    found = []
    for name in names:
        if f"{part}.{name}" in IGNORED:
            continue
        pairs = [(before.get(name), after.get(name)) for before, after in zip(old, new, strict=True)]
        other = [k for k, pair in enumerate(pairs) if not _alike(*pair, _tolerance(part, name))]
        if other:
            found.append(Difference(part, name, other[0], *pairs[other[0]], len(other), len(pairs)))
    return sorted(found, key=lambda difference: difference.row)


@dataclass(frozen=True, slots=True)
class ReferenceOutputs:
    """The reference outputs of a part, and the reason of each of its updates."""

    part: str
    reasons: tuple[str, ...]
    rows: tuple[Row, ...]


def save_reference(path: Path, part: str, rows: Sequence[Row], reason: str) -> None:
    """Save these outputs as the reference, and append the reason to the earlier ones.

    Raises:
        ConfigError: the reason is empty.
    """
    if not reason.strip():
        raise ConfigError(f"the reference of the {part} cannot be updated without a reason: give --reason")
    before = load_reference(path).reasons if path.exists() else ()
    columns = {name: [row.get(name) for row in rows] for name in (rows[0] if rows else {})}
    text = json.dumps({"part": part, "reasons": [*before, reason.strip()], "columns": columns}, allow_nan=False)
    write_bytes(path, lzma.compress(text.encode(), preset=9))


def load_reference(path: Path) -> ReferenceOutputs:
    """Read a reference.

    Raises:
        BoxError: the reference does not exist or is damaged.
    """
    try:
        values: dict[str, Any] = json.loads(lzma.decompress(path.read_bytes()))
        columns: dict[str, list[Value]] = values["columns"]
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        return ReferenceOutputs(values["part"], tuple(values["reasons"]), tuple(rows))
    except (OSError, EOFError, lzma.LZMAError, ValueError, KeyError) as error:
        raise BoxError(f"cannot read the reference {path}: {error}: update it with --update --reason") from error


class _Tap:
    """A transport that keeps the bytes that were read."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self.heard = b""

    @property
    def closed(self) -> bool:
        return self._transport.closed

    def write(self, data: bytes) -> bool:
        return self._transport.write(data)

    def read(self) -> bytes:
        data = self._transport.read()
        self.heard += data
        return data

    def fileno(self) -> int:
        return self._transport.fileno()

    def close(self) -> None:
        self._transport.close()


class _Listener:
    """Collects the requests to the chair since the last tick."""

    def __init__(self) -> None:
        self._told: list[RiderRequest] = []

    def note_request(self, what: str, goals: tuple[Goal, ...] = ()) -> None:
        self._told.append(RiderRequest(what, goals))

    def note_tick(self, heard: tuple[ChairMessage, ...], state: ChairState, board: HelloReply | None) -> None:
        pass

    def take(self) -> tuple[RiderRequest, ...]:
        told, self._told = tuple(self._told), []
        return told


def _take_bytes(taps: list[_Tap]) -> bytes:
    """Return the bytes read since the last call."""
    data = b"".join(tap.heard for tap in taps)
    for tap in taps:
        tap.heard = b""
    return data


def _pilots_part(taped: TapedTick, moment: Moment) -> TapedTick:
    heard = tuple(
        replace(message, image=np.zeros(message.depth.shape, np.uint8)) if isinstance(message, RgbdFrame) else message
        for message in moment.heard
        if isinstance(message, Scan | SonarReadings | RgbdFrame)
    )
    kept = encoded(Moment(replace(moment.tick, telemetry=None), heard))
    return replace(taped, beats=(), answers=b"", moment=kept)


def _rounded(message: ChairMessage) -> ChairMessage:
    if isinstance(message, Scan):
        return replace(message, ranges=np.round(message.ranges, 3))
    if isinstance(message, ImuSample):
        return replace(message, accel=np.round(message.accel, 3), gyro=np.round(message.gyro, 3))
    return message


def _with_places(
    taped: TapedTick,
    motion: MeasuredMotion,
    heard: Sequence[ChairMessage],
    before: Localisation | None,
    after: Localisation | None,
) -> TapedTick:
    """Return the tick with the chair's places and twist at its scan, sonar readings and pictures.

    `before` and `after`: the localisation until the tick's scan, and from it on.
    """
    located, seen_from = before, list[Pose2 | None]()
    for message in heard:
        if isinstance(message, WheelTicks | ImuSample):
            motion.hear(message)
        elif isinstance(message, Scan) and motion.odometry is not None:
            located = after
            odom_from_base = motion.odom_from_base(message.stamp_ns)
            taped = replace(taped, odom_from_base=odom_from_base, twist_at_scan=motion.twist)
        elif isinstance(message, SonarReadings | RgbdFrame):
            odom_from_base = motion.odom_from_base(message.stamp_ns)
            seen_from.append(None if located is None else located.map_from_odom @ odom_from_base)
    return replace(taped, seen_from=tuple(seen_from))


def _tolerance(part: str, field: str) -> float:
    return TOLERANCES.get(f"{part}.{field}", TOLERANCES[part])


def _alike(old: Value, new: Value, tolerance: float) -> bool:
    if isinstance(old, bool) or isinstance(new, bool) or not isinstance(old, int | float):
        return old is new if isinstance(old, bool) else old == new
    return isinstance(new, int | float) and abs(old - new) <= tolerance
