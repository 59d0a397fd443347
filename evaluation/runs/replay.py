"""Replay regression test: each part of a chair, fed with a recorded drive, must reproduce its reference outputs.

A tape holds all inputs of a chair in a simulated drive, including the bytes of its board. Each part gets its inputs
from the tape alone, never from another part, so that a change shows only in the part that was changed. The reference
holds each part's outputs tick by tick. A difference names part, tick and field, with the old and the new value.
"""

from __future__ import annotations

import json
import lzma
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

import msgspec
import numpy as np

from waychair.calibration.calibration_file import ChairCalibration
from waychair.control.drive.navigation import ACTIVE
from waychair.control.safety.stops import STOPS, Halt
from waychair.control.safety.supervisor import SupervisorVerdict
from waychair.errors import BoxError, ConfigError
from waychair.files import write_bytes
from waychair.firmware_bridge.protocol import HelloReply
from waychair.firmware_bridge.transports import Reconnecting, Transport
from waychair.runtime.black_box.box_file import (
    LoggedHalt,
    LoggedLocalisation,
    Moment,
    RiderRequest,
    encoded,
    records,
    tick_from_state,
)
from waychair.runtime.chair import Chair, ChairState
from waychair.runtime.drive_base import ChairMessage, DriveBase
from waychair.runtime.pilot import Pilot
from waychair.simulation.simulator import Simulator
from waychair.slam.localising.localisation import Localisation, LocalisationState
from waychair.slam.localising.localiser import Localiser
from waychair.slam.odometry.odometry_filter import OdometryFilter
from waychair.trials.drive import BEAT_NS, TICK_NS, DriveSetup, calibration_of, simulated_chair
from waychair.types import Goal, ImuSample, Pose2, Scan, Twist, WheelTicks

Value: TypeAlias = float | int | bool | str | None
Row: TypeAlias = dict[str, Value]
"""The outputs of one tick, by field."""

_DIGITS = 6

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
    """

    beats: tuple[tuple[int, bytes], ...]
    answers: bytes
    told: tuple[RiderRequest, ...]
    active: bool
    moment: bytes
    odom_from_base: Pose2 | None


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
    """Write a tape, compressed."""
    write_bytes(path, lzma.compress(msgspec.msgpack.encode(tape), preset=9))


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

    listener, odometry = _Listener(), OdometryFilter(setup.body)
    taped: list[TapedTick] = []
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
            at_scan = _odometry_at_scan(odometry, heard)
            moment = encoded(Moment(tick_from_state(state, 0), tuple(heard)))
            taped.append(
                TapedTick(
                    beats=tuple(beats),
                    answers=_take_bytes(taps),
                    told=told,
                    active=active,
                    moment=moment,
                    odom_from_base=at_scan,
                )
            )
    return Tape(start, tuple(taped))


def part_replays(setup: DriveSetup) -> Mapping[str, Callable[[Tape], list[Row]]]:
    """Return, by part name, the function from a tape to the part's outputs."""
    calibration = calibration_of(setup)
    return {
        "odometry": lambda tape: _replay_odometry(tape, calibration),
        "localiser": lambda tape: _replay_localiser(tape, setup, calibration),
        "pilot": lambda tape: _replay_pilot(tape, setup, calibration),
        "base": lambda tape: _replay_base(tape, setup, calibration),
    }


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


def _replay_odometry(tape: Tape, calibration: ChairCalibration) -> list[Row]:
    """Replay the odometry filter; one row per tick."""
    filter_, rows = OdometryFilter(calibration.body), list[Row]()
    for _, moment in tape.moments():
        reading = None
        for message in moment.heard:
            if isinstance(message, WheelTicks):
                reading = filter_.update_wheels(message)
            elif isinstance(message, ImuSample):
                reading = filter_.update_imu(message)
        if reading is not None:
            spread = 0.0 if reading.covariance is None else math.sqrt(float(np.trace(reading.covariance)))
            pose, twist = reading.odom_from_base, reading.twist
            values = {"slipping": filter_.slipping, "sigma": spread, "v": twist.v, "omega": twist.omega}
            rows.append(_row(**_pose(pose), **values))
    return rows


def _replay_localiser(tape: Tape, setup: DriveSetup, calibration: ChairCalibration) -> list[Row]:
    """Replay the localiser with the tape's odometry; one row per scan."""
    known = setup.grid if setup.scanned is None else setup.scanned
    localiser = Localiser(known, calibration.body.base_from_laser, tape.start, setup.chair.localiser)
    rows = []
    for taped, moment in tape.moments():
        for scan in moment.heard:
            if isinstance(scan, Scan) and taped.odom_from_base is not None:
                found = localiser.process(calibration.masked(scan), taped.odom_from_base, moment.tick.twist)
                away = math.hypot(found.remaining.x, found.remaining.y)
                values = {"state": found.state.value, "health": found.health, "inliers": found.inliers}
                rows.append(_row(**_pose(found.map_from_base), **values, remaining=away, jumped=found.jumped))
    return rows


def _replay_pilot(tape: Tape, setup: DriveSetup, calibration: ChairCalibration) -> list[Row]:
    """Replay pilot and navigator with the tape's poses, verdicts and commands."""
    pilot = Pilot(
        grid=setup.grid,
        places=setup.places,
        body=calibration.body,
        settings=setup.chair,
        stops=calibration.stops,
        zones=setup.zones,
    )
    rows = []
    for taped, moment in tape.moments():
        tick = moment.tick
        for told in taped.told:
            if told.what == "go":
                pilot.go(*told.goals)
        for scan in moment.heard:
            if isinstance(scan, Scan) and tick.located is not None:
                pilot.see(calibration.masked(scan), _localisation(tick.located, tick.map_from_base), tick.twist)
        pilot.expire(tick.stamp_ns)
        halt = None if tick.halt is None else _halt(tick.halt)
        pilot.obey(SupervisorVerdict(tick.mode, tick.reason, tick.share, halt, drops_goal=tick.drops_goal))
        map_from_odom = None if tick.located is None else tick.located.map_from_odom
        found = pilot.step(tick.stamp_ns, tick.map_from_base, map_from_odom)
        pilot.note_sent(tick.command if tick.sent.active else None, "")
        way = 0.0 if found.path is None else found.path.length()
        values = {"stage": found.stage.value, "reason": found.reason, "plans": found.plans, "goals": found.goals}
        rows.append(_row(**values, v=found.twist.v, omega=found.twist.omega, way=way))
    return rows


def _replay_base(tape: Tape, setup: DriveSetup, calibration: ChairCalibration) -> list[Row]:
    """Replay supervisor, limiter, monitor and bridge with the tape's board bytes and localisations."""
    board = _Replayed()
    cable = Reconnecting(lambda: board)
    base = DriveBase(
        calibration=calibration,
        cable=cable,
        start=tape.start,
        settings=setup.chair,
        model=setup.calibration,
        zones=setup.zones,
    )
    asks = {"go": base.request, "confirm": base.confirm, "stop": base.stop, "reset": base.reset}
    rows = []
    for taped, moment in tape.moments():
        tick = moment.tick
        for told in taped.told:
            asks[told.what]()
        for now_ns, said in taped.beats:
            board.say(said)
            base.beat(now_ns)
        for message in moment.heard:
            base.hear(base.with_true_stamp(message))
            if isinstance(message, Scan) and tick.located is not None:
                base.locate(_localisation(tick.located, tick.map_from_base), message.stamp_ns)
        board.say(taped.answers)
        verdict, _ = base.supervise(tick.stamp_ns, taped.active)
        drives = tick.stage in {stage.value for stage in ACTIVE}
        driven = base.drive(tick.stamp_ns, verdict, tick.asked if drives else None)
        command = driven.command or Twist()
        rows.append(
            _row(
                mode=verdict.mode.value,
                halts=" ".join(sorted(halted.stop.id for halted in base.halts)),
                reason=verdict.reason,
                commands=driven.command is not None,
                v=command.v,
                omega=command.omega,
                active=driven.sent.active,
                forward_volts=driven.sent.forward_volts,
                turn_volts=driven.sent.turn_volts,
                **_pose(base.motion.map_from_base(tick.stamp_ns)),
            )
        )
    return rows


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


class _Replayed:
    """A transport that delivers the given bytes and accepts everything written."""

    closed = False

    def __init__(self) -> None:
        self._says = b""

    def say(self, data: bytes) -> None:
        """Append bytes to be read."""
        self._says += data

    def write(self, data: bytes) -> bool:
        return True

    def read(self) -> bytes:
        data, self._says = self._says, b""
        return data

    def fileno(self) -> int:
        return -1

    def close(self) -> None:
        pass


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


def _rounded(message: ChairMessage) -> ChairMessage:
    if isinstance(message, Scan):
        return replace(message, ranges=np.round(message.ranges, 3))
    if isinstance(message, ImuSample):
        return replace(message, accel=np.round(message.accel, 3), gyro=np.round(message.gyro, 3))
    return message


def _odometry_at_scan(odometry: OdometryFilter, heard: Sequence[ChairMessage]) -> Pose2 | None:
    at_scan = None
    for message in heard:
        if isinstance(message, WheelTicks):
            odometry.update_wheels(message)
        elif isinstance(message, ImuSample):
            odometry.update_imu(message)
        elif isinstance(message, Scan):
            at_scan = odometry.predict(message.stamp_ns).odom_from_base
    return at_scan


def _localisation(located: LoggedLocalisation, map_from_base: Pose2) -> Localisation:
    return Localisation(
        map_from_base=map_from_base,
        map_from_odom=located.map_from_odom,
        inliers=located.inliers,
        state=LocalisationState(located.state),
        health=located.health,
        remaining=located.remaining,
        jumped=located.jumped,
    )


def _halt(halted: LoggedHalt) -> Halt:
    return Halt(STOPS[halted.id], halted.text)


def _pose(pose: Pose2) -> dict[str, Value]:
    return {"x": pose.x, "y": pose.y, "theta": pose.theta}


def _row(**values: Value) -> Row:
    return {name: round(value, _DIGITS) if isinstance(value, float) else value for name, value in values.items()}


def _tolerance(part: str, field: str) -> float:
    return TOLERANCES.get(f"{part}.{field}", TOLERANCES[part])


def _alike(old: Value, new: Value, tolerance: float) -> bool:
    if isinstance(old, bool) or isinstance(new, bool) or not isinstance(old, int | float):
        return old is new if isinstance(old, bool) else old == new
    return isinstance(new, int | float) and abs(old - new) <= tolerance
