"""The trace of the behaviour cells in a black box, for `waychair behaviours trace` and `replay`."""

from __future__ import annotations

from pathlib import Path

from waychair.control.behaviours.trace import Trace, read_trace, trace_from_bytes
from waychair.errors import TraceError
from waychair.runtime.black_box.box_file import read_cell_traces
from waychair.runtime.black_box.box_store import segment_files


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
