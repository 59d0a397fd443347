"""The trace of the behaviour cells of a chair: written into a file while it drives, and read from a black box."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

from waychair.control.behaviours.trace import Trace, TraceWriter, read_trace, trace_from_bytes
from waychair.errors import OutputError, TraceError
from waychair.firmware_bridge.protocol import HelloReply
from waychair.runtime.black_box.box_file import read_cell_traces
from waychair.runtime.black_box.box_store import segment_files
from waychair.runtime.chair import ChairState
from waychair.runtime.drive_base import ChairMessage
from waychair.types import Goal


class CellTraceFile:
    """A `ChairWatcher` that writes the trace of the chair's cells, each tick at once, for as long as the block lasts.

    A full disk ends the trace, not the drive; the end of the block tells of it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._writer: TraceWriter | None = None
        self._problem: OutputError | None = None

    def note_request(self, what: str, goals: tuple[Goal, ...] = ()) -> None:
        """See `ChairWatcher`; a trace holds no requests."""

    def note_tick(self, heard: tuple[ChairMessage, ...], state: ChairState, board: HelloReply | None) -> None:
        """See `ChairWatcher`."""
        perceived = state.perceived
        if perceived is None or self._problem is not None:
            return
        try:
            if self._writer is None:
                network = perceived.network
                self._writer = TraceWriter(
                    self._path, network.wiring, network.name, network.values, after=perceived.count
                )
            elif perceived.count == 0:
                self._writer.begin_anew()
            self._writer.write(perceived.done, perceived.heard)
        except OutputError as error:
            self._problem = error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Close the file.

        Raises:
            OutputError: it could not be written to the end.
        """
        if self._writer is not None:
            self._writer.close()
        if self._problem is not None and error is None:
            raise self._problem


def trace_at(path: Path) -> Trace:
    """Read a trace from its file, from the folder of a black box (its latest run), or from that of a part of one.

    Raises:
        TraceError: there is none.
        BoxError: a file of the black box cannot be read.
    """
    if not path.is_dir():
        return read_trace(path)
    files = segment_files(path) or sorted(path.glob("*.log"))
    if not files:
        raise TraceError(f"{path} is no black box and no part of one: give its folder, or the file of a trace")
    data = read_cell_traces(files)
    if not data:
        raise TraceError(f"{path} holds no trace of behaviour cells: they were not switched on (perceive)")
    return trace_from_bytes(data, str(path))
