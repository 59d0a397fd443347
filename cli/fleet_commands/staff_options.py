"""The staff's page of commands: its token and key, and the desk beside a voter's peer."""

from __future__ import annotations

import os
import secrets
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from waychair.runtime.fleet.desk.staff_desk import StaffDesk
    from waychair.runtime.fleet.fleet_file import FleetFile
    from waychair.runtime.fleet.network.peer_process import Beside
    from waychair.types import Json
    from waychair.ui.staff_page import StaffPage

TOKEN, KEY = "WAYCHAIR_STAFF_TOKEN", "WAYCHAIR_STAFF_KEY"
"""Environment variables with the token of the staff's page and the key with which staff give priorities."""

_VIEW_NS = 500_000_000  # between two views of the page


def staff_secrets(environment: dict[str, str]) -> dict[str, str]:
    """Return token and key by their variables: those of the environment, else random ones."""
    return {name: environment.get(name) or secrets.token_urlsafe(12) for name in (TOKEN, KEY)}


def secrets_sentence(found: dict[str, str]) -> str:
    """Return the sentence that tells the token and the key to whoever started the program."""
    return f"its token is {found[TOKEN]}, and the staff's key for priorities {found[KEY]}"


@contextmanager
def staff_page_of(
    desk: StaffDesk, token: str, port: int, clock_ms: Callable[[], int]
) -> Iterator[tuple[StaffPage, str]]:
    """Serve the staff's page while the block runs; yield it with its address. `clock_ms` is that of the given priorities.

    Raises:
        ConfigError: the port is taken.
    """
    from waychair.ui.staff_page import StaffPage, staff_page

    page = StaffPage(token, lambda chair, name, key, minutes: desk.give(chair, name, key, clock_ms(), minutes))
    with staff_page(page, port) as address:
        yield page, address


@contextmanager
def desk_beside(file: FleetFile, port: int, log: Path | None) -> Iterator[Beside]:
    """Serve the staff's page of a voter while the block runs; yield what its peer calls beside each step.

    Raises:
        ConfigError: the port is taken.
        TaskError: the key of the environment is too short.
    """
    from waychair.runtime.fleet.desk.live_desk import LiveDesk
    from waychair.runtime.fleet.desk.staff_desk import StaffDesk
    from waychair.runtime.fleet.network.peer_process import clock_ns, fleet_of
    from waychair.runtime.fleet.network.zenoh_transport import ZenohTransport

    found = staff_secrets(dict(os.environ))
    note = _logged(log)
    desk = StaffDesk(found[KEY], note)
    live = LiveDesk(fleet_of(file), desk, note)
    with staff_page_of(desk, found[TOKEN], port, lambda: clock_ns() // 1_000_000) as (page, address):
        print(f"The staff's page is at {address}; {secrets_sentence(found)}.", file=sys.stderr, flush=True)
        shown_ns = 0

        def beside(now_ns: int, heard: list[tuple[int, bytes]], transport: ZenohTransport) -> None:
            nonlocal shown_ns
            live.hear(heard, transport.received_aside(), now_ns)
            for kind, data in live.due(now_ns):
                transport.send(None, kind, data)
            if now_ns - shown_ns >= _VIEW_NS:
                shown_ns, page.view = now_ns, live.view(now_ns)

        yield beside


def _logged(log: Path | None) -> Callable[[Json], None]:
    """Return a function that appends records to a log; it says once that the log cannot be written, and goes on."""
    failed = False

    def note(record: Json) -> None:
        nonlocal failed
        if log is None or failed:
            return
        import json

        try:
            log.parent.mkdir(parents=True, exist_ok=True)
            with log.open("a", encoding="utf-8") as lines:
                lines.write(json.dumps(record) + "\n")
        except OSError as error:
            failed = True
            print(
                f"waychair: {log} cannot be written ({error.strerror}): no more is noted", file=sys.stderr, flush=True
            )

    return note
