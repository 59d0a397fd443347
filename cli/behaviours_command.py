"""`waychair behaviours show|trace|replay`: networks of behaviour cells, and the traces of their runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter

from waychair.cli.options.arguments import BadArgument, NonEmptyPath, PositiveInt

if TYPE_CHECKING:
    from waychair.control.behaviours.trace import Trace, TracedInnervation

behaviours_app = App(
    name="behaviours",
    help="Show the networks of behaviour cells, and read and replay their traces.",
    help_format="plaintext",
    result_action="return_value",
)

PresetName = Literal["paper", "default"]


@behaviours_app.command(name="show", help="Print a network of behaviour cells, or draw it.")
def show_command(
    preset: PresetName = "paper",
    /,
    *,
    network: str | None = None,
    picture: Annotated[NonEmptyPath | None, Parameter(name=["--picture", "--out", "-o"])] = None,
) -> None:
    """Print the cells of a network with all their ports, in their running order.

    Parameters
    ----------
    preset
        The network: `paper` is that of the publication, `default` the same cells with today's sensors.
    network
        Show only this network of it, such as "Free-space finding".
    picture
        Draw the network into this .svg file.
    """
    from waychair.control.behaviours.drawing import network_picture, network_text
    from waychair.control.behaviours.presets import preset_network
    from waychair.files import write_text

    if picture is not None and picture.suffix.lower() != ".svg":
        raise BadArgument(f"--picture is {picture}: name a .svg file")
    wiring = preset_network(preset, {})
    text = network_text(wiring, network)
    if picture is not None:
        write_text(picture, network_picture(wiring, network))
        print(f"drawn into {picture}")
    else:
        print(text)


@behaviours_app.command(name="trace", help="Print a trace as a table in time.")
def trace_command(
    trace: NonEmptyPath,
    /,
    *,
    cell: tuple[str, ...] = (),
    begin: float | None = None,
    end: float | None = None,
    most: PositiveInt = 1000,
) -> None:
    """Print the changes at each innervation: a row for each cell whose activation, effect or fault changed.

    Parameters
    ----------
    trace
        The file of a trace, or the folder of a black box or of a part of it.
    cell
        Show only these cells or networks.
    begin
        Show innervations from this time on, in seconds of the chair's clock.
    end
        Show innervations up to this time.
    most
        Greatest number of rows.
    """
    from rich.table import Column, Table

    from waychair.cli.options.tables import print_table
    from waychair.runtime.black_box.cell_traces import trace_at

    read = trace_at(trace)
    if unknown := [name for name in cell if name not in read.header.nodes]:
        raise BadArgument(f"--cell {unknown[0]} is not in the trace: choose among {', '.join(read.header.nodes)}")
    table = Table(Column("time, s", justify="right"), "cell", "EB", "IB", "RS", "AB", "EO", "fault")
    rows = _rows(read, cell or read.header.nodes, begin, end)
    for row in rows[:most]:
        table.add_row(*row)
    print_table(table)
    print(_summary(read, len(rows), most))


def _rows(trace: Trace, cells: tuple[str, ...], begin: float | None, end: float | None) -> list[tuple[str, ...]]:
    from waychair.control.behaviours.trace import value_text

    rows: list[tuple[str, ...]] = []
    before: dict[str, tuple[str, ...]] = {}
    for done in trace.innervations:
        seconds = done.stamp_ns * 1e-9
        inside = (begin is None or seconds >= begin) and (end is None or seconds <= end)
        for name in cells:
            port = done.ports[name]
            shown = ("1" if port.ab else "0", value_text(port.eo), port.fault)
            if inside and before.get(name) != shown:
                checked = (value_text(value) for value in (port.eb, port.ib, port.rs))
                rows.append((f"{seconds:.3f}", name, *checked, *shown))
            before[name] = shown
        if inside and (not cells or cells == trace.header.nodes):
            rows += _action_rows(done)
    return rows


def _action_rows(done: TracedInnervation) -> list[tuple[str, ...]]:
    from waychair.control.behaviours.trace import value_text

    seconds = f"{done.stamp_ns * 1e-9:.3f}"
    return [(seconds, f"→ {name}", "", "", "", "", value_text(value), "") for name, value in done.actions.items()]


def _summary(trace: Trace, rows: int, most: int) -> str:
    count = len(trace.innervations)
    text = f"{count} innervations of the preset {trace.header.preset or '(none)'}, wiring {trace.header.identity}"
    if rows > most:
        text += f"; {rows - most} more rows: see --begin, --end, --cell and --most"
    if trace.damaged:
        text += f"; {trace.damaged} bytes are not readable"
    return text


@behaviours_app.command(name="replay", help="Run a traced network again, and compare.")
def replay_command(
    trace: NonEmptyPath, /, *, diff: bool = False, out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None
) -> None:
    """Run a traced network again on the same stamps and sensor values; every record must have the same bytes.

    Parameters
    ----------
    trace
        The file of a trace, or the folder of a black box or of a part of it.
    diff
        Name the first port that differs, with both values.
    out
        Write the replay's own trace to this file.
    """
    from waychair.cli.options.progress import told_share
    from waychair.control.behaviours.presets import preset_network
    from waychair.control.behaviours.replay import replay
    from waychair.errors import TraceError
    from waychair.files import write_bytes
    from waychair.runtime.black_box.cell_traces import trace_at

    read = trace_at(trace)
    with told_share("replaying") as show:
        done = replay(read, preset_network(read.header.preset, read.header.settings), show)
    if out is not None:
        write_bytes(out, done.data)
    if done.difference is None:
        print(f"the replay of {done.innervations} innervations has the same bytes")
        return
    if diff:
        print(done.difference)
    raise TraceError(
        f"the replay differs at innervation {done.difference.index}"
        + ("" if diff else "; --diff names the first port that differs")
    )
