"""The black box of a chair: a log of the last minutes in a ring of files, and permanent parts around each stop.

`note_tick` costs the control tick a few microseconds: it puts references into a queue, and a thread does the rest. The
disk never delays the tick: ticks that do not fit into the queue are dropped and counted, and a full or broken disk ends
the log with one diagnostic while the chair drives on (F27).

After the program is killed, the log lacks at most `WRITE_S` and a tick; after a power cut at most `SYNC_S` more, if
disk and file system honour `fdatasync`. The next run finds the unfinished log and keeps its end as a part.
"""

from __future__ import annotations

import contextlib
import logging
import queue
import secrets
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec

from waychair import __version__
from waychair.calibration.calibration_file import ChairCalibration, content_hash
from waychair.config import Settings, dump, setting
from waychair.control.behaviours.trace import TraceEncoder
from waychair.control.safety.supervisor import DRIVEN
from waychair.errors import BoxError, WaychairError
from waychair.firmware_bridge.protocol import HelloReply
from waychair.runtime.black_box.box_events import BlackBoxEvent, EventDetector
from waychair.runtime.black_box.box_file import (
    BoardIdentity,
    CellTrace,
    LogEnd,
    LogHeader,
    LostTicks,
    Moment,
    RiderRequest,
    encoded,
    tick_from_state,
)
from waychair.runtime.black_box.box_store import (
    BoxLimits,
    BoxLock,
    LogPart,
    PartStore,
    Ring,
    Segment,
    append_end,
    segments_needed,
    unfinished_log,
    with_event,
)
from waychair.runtime.chair import ChairState
from waychair.runtime.drive_base import ChairMessage
from waychair.runtime.perception import Perceived
from waychair.types import Goal, Place, RgbdFrame

_LOGGER = logging.getLogger(__name__)
_CLOSE_S = 5.0
_MOVES, _ON_TICKS = 0.05, 20
"""The chair has driven on after an event once more than _MOVES [m/s] was commanded for _ON_TICKS ticks."""

SEGMENT_S = 20.0  # s; length of a file of the ring, short enough that dropping one loses little
QUEUE_TICKS = 200  # ticks (10 s) that wait for a slow disk; further ones are lost
WRITE_S = 0.2  # s; a tick survives the program's death after this time
SYNC_S = 1.0  # s; a tick survives a power cut after this further time


@dataclass(frozen=True, slots=True)
class BlackBoxSettings(Settings):
    """Size of the log."""

    ring_minutes: float = setting(
        10.0, "min", "length of the ring log on the disk; larger: older ticks are kept", low=1.0, high=1440.0
    )
    ring_mb: int = setting(
        256,
        "MB",
        "disk space of the ring log, which drops its oldest ticks when full; larger: it fills later",
        low=1,
        high=100_000,
    )
    before_s: float = setting(
        30.0,
        "s",
        "length of the log kept from before each event; larger: each part needs more disk",
        low=0.0,
        high=600.0,
    )
    after_s: float = setting(
        30.0,
        "s",
        "length of the log kept from after each event; larger: each part needs more disk",
        low=0.0,
        high=600.0,
    )
    parts: int = setting(
        20,
        "",
        "number of parts kept, one per event, the least important dropped first; larger: more disk",
        low=1,
        high=10_000,
    )
    pictures_hz: float = setting(
        0.0,
        "Hz",
        "rate of logged depth camera images, 0 for none; larger: the ring log fills sooner",
        low=0.0,
        high=30.0,
    )


@dataclass(frozen=True, slots=True)
class LoggedChair:
    """The data in the log's header: configuration in force, the chair's calibration and the places of its map."""

    configuration: Settings
    calibration: ChairCalibration
    places: Mapping[str, Place] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class _QueuedTick:
    """A tick in the thread's queue."""

    state: ChairState
    heard: tuple[ChairMessage, ...]
    board: HelloReply | None
    wall_ns: int


class BlackBox:
    """A `ChairWatcher` that logs for as long as the block lasts.

    `problem` is empty while it logs, else the reason why the log has ended. `lost` counts ticks that were not logged
    since the disk was too slow.
    """

    def __init__(self, folder: Path, about: LoggedChair, settings: BlackBoxSettings | None = None) -> None:
        """`folder` is created if it is missing; the log of an earlier run in it is continued."""
        self.folder, self.settings = folder, settings or BlackBoxSettings()
        self.problem = ""
        self.lost = 0
        places = {name: place.pose for name, place in about.places.items()}
        self._head = LogHeader(
            session=secrets.token_hex(8),
            wall_ns=0,
            software=__version__,
            configuration=dump(about.configuration),
            calibration=msgspec.to_builtins(about.calibration),
            calibration_hash=content_hash(about.calibration),
            places=places,
        )
        self._queue: queue.Queue[_QueuedTick | RiderRequest | None] = queue.Queue(QUEUE_TICKS)
        self._pictured_ns: int | None = None

    def __enter__(self) -> Self:
        """
        Raises:
            BoxError: another program writes to the folder, or it cannot be written to.
        """
        with contextlib.ExitStack() as undone:
            self._lock = undone.enter_context(BoxLock(self.folder))
            try:
                self._writer = _Writer(self.folder, self._head, self.settings)
            except (OSError, WaychairError) as error:
                raise BoxError(f"cannot write the black box {self.folder}: {_why(error)}") from error
            undone.pop_all()
        self._thread = threading.Thread(target=self._work, name="black box", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._queue.put(None, timeout=_CLOSE_S)
            self._thread.join(_CLOSE_S)
        except queue.Full:
            self.problem = self.problem or "the disk was too slow to take the end of the log"
        self._lock.__exit__()

    def note_request(self, what: str, goals: tuple[Goal, ...] = ()) -> None:
        """See `ChairWatcher`."""
        self._put(RiderRequest(what, goals))

    def note_tick(self, heard: tuple[ChairMessage, ...], state: ChairState, board: HelloReply | None) -> None:
        """See `ChairWatcher`."""
        if self.problem:
            return
        kept = tuple(message for message in heard if not isinstance(message, RgbdFrame) or self._wanted(message))
        self._put(_QueuedTick(state, kept, board, time.time_ns()))

    def _wanted(self, frame: RgbdFrame) -> bool:
        """Whether a picture is due by `pictures_hz`."""
        if not self.settings.pictures_hz:
            return False
        before_ns, period_ns = self._pictured_ns, 0.99e9 / self.settings.pictures_hz
        if before_ns is not None and 0 <= frame.stamp_ns - before_ns < period_ns:
            return False
        self._pictured_ns = frame.stamp_ns
        return True

    def _put(self, noted: _QueuedTick | RiderRequest) -> None:
        if self.problem:
            return
        try:
            self._queue.put_nowait(noted)
        except queue.Full:
            self.lost += isinstance(noted, _QueuedTick)

    def _work(self) -> None:
        """Run the thread; any error in it ends the log and nothing else."""
        closing = False
        try:
            while not closing:
                with contextlib.suppress(queue.Empty):
                    noted = self._queue.get(timeout=WRITE_S)
                    closing = noted is None
                    if noted is not None:
                        self._writer.take(noted, self.lost)
                self._writer.flush()
            self._writer.end()
        except Exception as error:  # noqa: BLE001 - a chair does not stop because its log does
            self._give_up(error)
            while not closing:  # so that no caller waits for a full queue
                closing = self._queue.get() is None

    def _give_up(self, error: Exception) -> None:
        """End the log with one warning; the ticks logged so far stay."""
        self.problem = (
            f"the black box {self.folder} has stopped logging: {_why(error)}; free disk space or repair the disk, then "
            "restart"
        )
        self._writer.give_up(self.problem)
        _LOGGER.warning("%s", self.problem)


class _Writer:
    """The thread's data: the ring, the event detector, and the parts that are still open."""

    def __init__(self, folder: Path, head: LogHeader, settings: BlackBoxSettings) -> None:
        s = self._settings = settings
        needed = segments_needed(max(60.0 * s.ring_minutes, s.before_s + s.after_s), SEGMENT_S)
        bounds = BoxLimits(needed, s.ring_mb * 1_000_000, s.parts)
        self._parts = PartStore(folder, bounds)
        self._keep_loose_end(folder)
        self._ring = Ring(folder, bounds)
        self._head = head
        self._detector = EventDetector()
        self._open: list[LogPart] = []
        self._drove, self._driven_ticks = False, _ON_TICKS  # since the last event
        self._cells: TraceEncoder | None = None  # of the present segment
        self._lost = 0
        self._written_s = self._synced_s = time.monotonic()
        self._ring.begin(replace(head, wall_ns=time.time_ns()))

    def _keep_loose_end(self, folder: Path) -> None:
        """Keep the end of a log that a killed run has left, as an event of its own."""
        left = unfinished_log(folder, self._settings.before_s)
        if left is None:
            return
        event, log, segments = left
        span_ns = event.stamp_ns - round(self._settings.before_s * 1e9), event.stamp_ns
        self._parts.close(self._parts.open(event, log.head, segments, span_ns))
        append_end(folder, event.text)

    def take(self, noted: _QueuedTick | RiderRequest, lost: int) -> None:
        """Log a tick or a request, and keep a part for each event in it."""
        if lost > self._lost:
            self._ring.append(encoded(LostTicks(lost - self._lost)))
            self._lost = lost
        if isinstance(noted, RiderRequest):
            self._ring.append(encoded(noted))
            return
        moment = Moment(tick_from_state(noted.state, noted.wall_ns), noted.heard)
        tick = moment.tick
        self._meet(noted.board)
        segment = self._ring.segments[-1]
        if self._ring.full_segment or not self._continues(segment, tick.stamp_ns):
            self._next_segment()
        self._ring.append(encoded(moment), tick.stamp_ns)
        if noted.state.perceived is not None:
            self._trace(noted.state.perceived)
        if tick.mode in DRIVEN and not self._drove:  # a drive never resumes by itself, so this one is new
            self._driven_ticks = _ON_TICKS
        self._drove = tick.mode in DRIVEN
        for event in self._detector.update(moment):
            self._keep(event)
        drives = tick.mode in DRIVEN and tick.sent.active
        self._driven_ticks += drives and tick.command is not None and abs(tick.command.v) > _MOVES
        self._close_parts(tick.stamp_ns)

    def _trace(self, perceived: Perceived) -> None:
        """Log the behaviour cells; each segment, and what follows lost ticks, begins with their header."""
        if self._cells is None or self._cells.count != perceived.count:
            network = perceived.network
            self._cells = TraceEncoder(network.wiring, network.name, network.values, after=perceived.count)
            self._ring.append(encoded(CellTrace(self._cells.header())))
        self._ring.append(encoded(CellTrace(self._cells.innervation(perceived.done, perceived.heard))))

    def flush(self) -> None:
        """Write and sync if it is due."""
        now_s = time.monotonic()
        if now_s - self._written_s >= WRITE_S:
            self._ring.write()
            self._written_s = now_s
        if now_s - self._synced_s >= SYNC_S:
            self._ring.sync()
            self._synced_s = now_s

    def end(self) -> None:
        """Close the log in order."""
        self._ring.append(encoded(LogEnd()))
        self._close_parts(None)
        self._ring.close()

    def give_up(self, problem: str) -> None:
        """Close the log after an error."""
        self._ring.give_up(problem)

    def _meet(self, board: HelloReply | None) -> None:
        """Write a new header if the board is new."""
        if board is None:
            return
        name = board.chair_id.rstrip(b"\0").decode(errors="replace")
        identity = BoardIdentity(board.firmware_version, board.layout_hash, board.version, name)
        if identity != self._head.board:
            self._head = replace(self._head, board=identity)
            self._ring.append(encoded(replace(self._head, wall_ns=time.time_ns())))

    def _continues(self, segment: Segment, stamp_ns: int) -> bool:
        """Whether a tick belongs to the present segment; a clock that was set back begins a new one."""
        if segment.begin_ns is None or segment.end_ns is None:
            return True
        return segment.end_ns <= stamp_ns < segment.begin_ns + SEGMENT_S * 1e9

    def _next_segment(self) -> None:
        self._keep_up(self._open)  # before the ring may drop their segments
        self._cells = None
        self._ring.begin(replace(self._head, wall_ns=time.time_ns()))

    def _keep(self, event: BlackBoxEvent) -> None:
        """Open a part for an event, or add it to the open part if the chair has not driven on since the last event."""
        s, after_ns = self._settings, round(self._settings.after_s * 1e9)
        if self._open and self._driven_ticks < _ON_TICKS:
            self._open[-1] = with_event(self._open[-1], event, after_ns)
            self._parts.save(self._open[-1])
        else:
            span_ns = event.stamp_ns - round(s.before_s * 1e9), event.stamp_ns + after_ns
            self._ring.write()
            self._open.append(self._parts.open(event, self._head, self._ring.segments, span_ns))
        self._driven_ticks = 0

    def _keep_up(self, parts: Sequence[LogPart]) -> None:
        """Link the segments so far into open parts."""
        if parts:
            self._ring.write()
        for part in parts:
            self._parts.keep(part, self._ring.segments)

    def _close_parts(self, now_ns: int | None) -> None:
        """Close the parts whose span is over; with None, all of them."""
        over = [part for part in self._open if now_ns is None or not part.begin_ns <= now_ns <= part.end_ns]
        self._keep_up(over)
        for part in over:
            self._parts.close(part)
            self._open.remove(part)


def _why(error: Exception) -> str:
    return error.strerror if isinstance(error, OSError) and error.strerror else str(error) or type(error).__name__
