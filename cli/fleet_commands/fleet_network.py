"""`waychair fleet keys`, `router`, `voter`, `status` and `watch`: the network of several chairs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from waychair.cli.options.arguments import BadArgument, NonEmptyPath, NonNegativeInt, PositiveInt

if TYPE_CHECKING:
    from waychair.planning.fleet.peers.peer import PeerStep
    from waychair.types import Json

keys_app = App(name="keys", help="Make keys with which chairs talk beyond one computer.")


@keys_app.command(name="new")
def keys_new_command(
    name: str,
    /,
    *,
    out: Annotated[NonEmptyPath, Parameter(name=["--out", "-o"])] = Path("keys"),
    days: Annotated[PositiveInt, Parameter(name=["--days"])] = 730,
) -> None:
    """Make a key and a certificate for a chair, by the site's authority, which is made with the first ones.

    The file authority.key stays on this computer. The chair needs authority.pem and its own two files.

    Parameters
    ----------
    name
        The name of the chair on the network: chair2 for number 2, voter9 for a voter.
    out
        The folder of the site's keys.
    days
        How long the certificate is valid.
    """
    from waychair.runtime.fleet.network.fleet_keys import new_keys

    files = new_keys(out, name, days)
    print(f"{name}: copy {files.authority}, {files.certificate} and {files.key} to the chair, and nothing else.")


def router_command(fleet: NonEmptyPath, /, *, lan: bool = False) -> None:
    """Join chairs that cannot reach each other, as on a Wi-Fi that keeps its computers apart, until Ctrl-C.

    The router's computer is a voter of the fleet, with `listen` in its file as a fixed endpoint.

    Parameters
    ----------
    fleet
        The fleet's file.
    lan
        Let other computers in; needs keys.
    """
    _serve(fleet, lan, "router", "router")


def voter_command(
    fleet: NonEmptyPath,
    /,
    *,
    lan: bool = False,
    staff_page: Annotated[NonNegativeInt | None, Parameter(name=["--staff-page"])] = None,
    log: Annotated[Path | None, Parameter(name=["--log"])] = None,
) -> None:
    """Vote among the chairs of a fleet from a computer without a chair, until Ctrl-C, so that few chairs have a majority.

    With --staff-page it is the staff's desk as well: a page of all chairs, queues, closed ways and waits, on which staff give
    priorities with their key.

    Parameters
    ----------
    fleet
        The fleet's file, with the number of a voter.
    lan
        Talk to other computers; needs keys.
    staff_page
        Port of the staff's page on this computer, 0 for any free one. Its token and key are those of the variables
        WAYCHAIR_STAFF_TOKEN and WAYCHAIR_STAFF_KEY, else random ones, which are printed.
    log
        With --staff-page: add every wait and every given priority to this file.
    """
    if staff_page is None and log is not None:
        raise BadArgument("--log needs --staff-page")
    _serve(fleet, lan, "peer", "voter", staff_page, log)


def _serve(path: Path, lan: bool, mode: str, what: str, staff_page: int | None = None, log: Path | None = None) -> None:
    import signal
    from contextlib import nullcontext

    from waychair.cli.fleet_commands.staff_options import desk_beside
    from waychair.errors import FleetError
    from waychair.runtime.fleet.fleet_file import load_fleet
    from waychair.runtime.fleet.network.peer_process import beside_nothing, serve
    from waychair.runtime.processes import signalled

    file = load_fleet(path)
    if file.number in file.chairs:
        raise FleetError(f"{path}: number {file.number} is a chair's: give the number of a voter for the {what}")
    stopped = signalled(signal.SIGINT, signal.SIGTERM)

    def tell(step: PeerStep) -> None:
        for said in step.notices:
            print(said, flush=True)

    print(f"The {what} of {len(file.chairs)} chairs is at {file.own_endpoint}. Ctrl-C ends it.", flush=True)
    desk = nullcontext(beside_nothing) if staff_page is None else desk_beside(file, staff_page, log)
    with desk as beside:
        serve(file, lan, stopped, mode=mode, told=tell, beside=beside)


def status_command(fleet: NonEmptyPath, /, *, lan: bool = False, json: bool = False, seconds: float = 1.5) -> None:
    """Print which chairs are there, where, in which mode, for what they wait, and which one orders.

    Exits with 1 if nobody orders.

    Parameters
    ----------
    fleet
        The fleet's file, of any of its computers.
    lan
        Listen to other computers; needs keys.
    json
        Print JSON.
    seconds
        How long to listen.
    """
    import sys

    orders = _watch(fleet, lan, json, seconds, again=False)
    sys.exit(0 if orders else 1)


def watch_command(fleet: NonEmptyPath, /, *, lan: bool = False, json: bool = False, seconds: float = 1.0) -> None:
    """Print the same every second until Ctrl-C; see `waychair fleet status`.

    Parameters
    ----------
    fleet
        The fleet's file, of any of its computers.
    lan
        Listen to other computers; needs keys.
    json
        Print a line of JSON each time.
    seconds
        The time between two tables.
    """
    _watch(fleet, lan, json, seconds, again=True)


def _watch(path: Path, lan: bool, as_json: bool, seconds: float, again: bool) -> bool:
    """Print the fleet's table, once or until Ctrl-C; return whether somebody orders."""
    import json
    import signal
    import time

    from waychair.runtime.fleet.fleet_file import load_fleet
    from waychair.runtime.fleet.fleet_watch import FleetWatch
    from waychair.runtime.fleet.network.peer_process import clock_ns, fleet_of
    from waychair.runtime.fleet.network.zenoh_transport import ZenohListener
    from waychair.runtime.processes import signalled

    file = load_fleet(path)
    fleet = fleet_of(file)
    watch = FleetWatch(fleet.building, fleet.ways)
    stopped = signalled(signal.SIGINT, signal.SIGTERM)
    listener = ZenohListener(file, fleet.building, lan)
    try:
        while not stopped():
            until = time.monotonic() + seconds
            while time.monotonic() < until and not stopped():
                time.sleep(0.05)
                for said in watch.hear(listener.received(), clock_ns()):
                    print(said, flush=True)
            rows = watch.rows(clock_ns())
            if as_json:
                print(json.dumps(rows), flush=True)
            else:
                _print_rows(rows)
            if not again:
                break
    finally:
        listener.close()
    return any(row["grants"] for row in watch.rows(clock_ns()))


def _print_rows(rows: list[Json]) -> None:
    from rich.table import Table

    from waychair.cli.options.tables import print_table

    table = Table("number", "mode", "at", "goal", "asked for s", "may enter", "warden", "heard s ago")
    for row in rows:
        warden = "" if row["warden"] is None else f"{row['warden']}{'' if not row['grants'] else ' (itself)'}"
        cells = (row["mode"], row["at"], row["goal"], row["waits_s"], row["may_enter"], warden, row["age_s"])
        table.add_row(str(row["number"]), *("" if cell is None else str(cell) for cell in cells))
    print_table(table)
    if not rows:
        print("No chair is heard: is `waychair fleet voter` running with this file?", flush=True)
