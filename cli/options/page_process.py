"""The rider's page of a chair's ROS nodes: the process that `waychair up` starts, its token, port and address."""

from __future__ import annotations

import importlib.util
import os
import secrets
import socket
import sys
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from waychair.cli.options.arguments import BadArgument

if TYPE_CHECKING:
    from waychair.ros.node_settings.page import PageNodeSettings
    from waychair.runtime.chair_port import ChairPort

TOKEN = "WAYCHAIR_PAGE_TOKEN"
"""Environment variable with the page's token; files and arguments could be read by other users."""

_DEFAULT_PORT = 8000
_SHORTEST_TOKEN = 12


def has_ui() -> bool:
    """Return whether the extra [ui] is installed."""
    return all(importlib.util.find_spec(name) is not None for name in ("fastapi", "uvicorn", "websockets"))


def page_token(lan: bool, given: str | None) -> str:
    """Return the given token, else a random one for `lan`, else an empty one.

    Raises:
        BadArgument: the given token is too short or holds characters that an address must not have.
    """
    if given is None:
        return secrets.token_urlsafe(16) if lan else ""
    if len(given) < _SHORTEST_TOKEN or not all(c.isascii() and (c.isalnum() or c in "-_") for c in given):
        raise BadArgument(
            f"--token must be {_SHORTEST_TOKEN} or more letters, digits, - and _: omit it to get a random one"
        )
    return given


def page_address(port: int, lan: bool, token: str) -> str:
    """Return the page's address."""
    host = socket.gethostname() if lan else "127.0.0.1"
    return f"http://{host}:{port}/{f'#token={token}' if token else ''}"


def port_of_page(wanted: int | None) -> int:
    """Return the wanted port; by default 8000, or a free port if that is taken.

    Raises:
        BadArgument: the wanted port is taken or invalid.
    """
    for port in (_DEFAULT_PORT, 0) if wanted is None else (wanted,):
        try:
            with socket.create_server(("127.0.0.1", port)) as listener:
                return int(listener.getsockname()[1])
        except (OSError, OverflowError):
            continue
    raise BadArgument(f"--page-port {wanted} is taken or invalid: choose another, or omit it")


def served(port: ChairPort, settings: PageNodeSettings) -> AbstractContextManager[str]:
    """Return the page's server, with the token of the environment."""
    from waychair.ui.server import page_server

    token, names = os.environ.get(TOKEN, ""), (socket.gethostname(),)
    return page_server(port, host=settings.host, http_port=settings.port, token=token, names=names)


def main() -> int:
    """Run the page's process."""
    from waychair.ros.nodes.node import run_node
    from waychair.ros.nodes.page_node import PageNode

    return run_node(lambda: PageNode(served))


if __name__ == "__main__":
    sys.exit(main())
