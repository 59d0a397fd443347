"""The page beside a chair's nodes: the process that `waychair up` starts for it, and who may open it."""

from __future__ import annotations

import importlib.util
import os
import secrets
import socket
import sys
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from waychair.cli.arguments import BadArgument

if TYPE_CHECKING:
    from waychair.ros.page_node import PageNodeSettings
    from waychair.runtime.chair_port import ChairPort

TOKEN = "WAYCHAIR_PAGE_TOKEN"
"""The page's token in its process's environment: files and arguments can be read by others."""

_USUAL = 8000
_SHORTEST = 12


def has_ui() -> bool:
    """Whether the extra [ui] is installed."""
    return all(importlib.util.find_spec(name) is not None for name in ("fastapi", "uvicorn", "websockets"))


def page_token(lan: bool, given: str | None) -> str:
    """What who opens the page has to show: nothing where only this computer can, unless it is given.

    Raises:
        BadArgument: it is too short, or holds what no address may.
    """
    if given is None:
        return secrets.token_urlsafe(16) if lan else ""
    if len(given) < _SHORTEST or not all(c.isascii() and (c.isalnum() or c in "-_") for c in given):
        raise BadArgument(
            f"--token must be {_SHORTEST} or more letters, digits, - and _; leave it out to have one made"
        )
    return given


def page_address(port: int, lan: bool, token: str) -> str:
    """What to open in a browser."""
    host = socket.gethostname() if lan else "127.0.0.1"
    return f"http://{host}:{port}/{f'#token={token}' if token else ''}"


def port_of_page(wanted: int | None) -> int:
    """The port that was asked for; by default the usual one, or a free one where that is taken.

    Raises:
        BadArgument: the one that was asked for is taken.
    """
    for port in (_USUAL, 0) if wanted is None else (wanted,):
        try:
            with socket.create_server(("127.0.0.1", port)) as listener:
                return int(listener.getsockname()[1])
        except (OSError, OverflowError):
            continue
    raise BadArgument(f"--page-port {wanted} is taken or none: choose another, or leave it out")


def served(port: ChairPort, settings: PageNodeSettings) -> AbstractContextManager[str]:
    """The page's server."""
    from waychair.ui.server import page_server

    token, names = os.environ.get(TOKEN, ""), (socket.gethostname(),)
    return page_server(port, host=settings.host, http_port=settings.port, token=token, names=names)


def main() -> int:
    """The process."""
    from waychair.ros.node import run_node
    from waychair.ros.page_node import PageNode

    return run_node(lambda: PageNode(served))


if __name__ == "__main__":
    sys.exit(main())
