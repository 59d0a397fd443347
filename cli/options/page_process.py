"""The rider's page of a chair's ROS nodes: the process that `waychair up` starts, its token, port and address."""

from __future__ import annotations

import errno
import importlib.util
import os
import re
import secrets
import socket
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from waychair.cli.options.arguments import BadArgument

if TYPE_CHECKING:
    from waychair.ros.node_settings.page import PageNodeSettings
    from waychair.runtime.pages.chair_port import ChairPort

TOKEN = "WAYCHAIR_PAGE_TOKEN"
"""Environment variable with the page's token; files and arguments could be read by other users."""

_DEFAULT_PORT, _LAST_PORT = 8000, 65_535
_SHORTEST_TOKEN = 12
_HOST_NAME = re.compile(
    r"(?=.{1,253}$)[A-Za-z0-9]([A-Za-z0-9-]*[A-Za-z0-9])?(\.[A-Za-z0-9]([A-Za-z0-9-]*[A-Za-z0-9])?)*"
)
"""A name in ASCII letters, digits and hyphens (RFC 1123)."""


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


def page_names(given: Sequence[str], lan: bool) -> tuple[str, ...]:
    """Return the host names by which pages may be opened: this computer's own, and the given ones.

    Raises:
        BadArgument: a name is no host name, or names are given for a page that only this computer can open.
    """
    from waychair.ui.own_addresses import own_names

    for name in given:
        if not _HOST_NAME.fullmatch(name):
            raise BadArgument(f"--page-name '{name}' is no host name: give the name alone, such as chair.lan")
    if given and not lan:
        raise BadArgument("--page-name needs --page-lan: only this computer can open the page without it")
    return (*own_names(), *given)


def page_addresses(port: int, lan: bool, token: str, names: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the page's address; with `lan` those for other computers: by number, by `names`, and by multicast DNS.

    Most phones do not find a bare host name.
    """
    from waychair.ui.own_addresses import own_addresses, own_names

    by_mdns = [name for name in own_names() if name.endswith(".local")]
    hosts = (*own_addresses(), *names, *by_mdns) if lan else ()
    end = f"#token={token}" if token else ""
    return tuple(f"http://{host}:{port}/{end}" for host in dict.fromkeys(hosts or ("127.0.0.1",)))


def page_sentence(port: int, lan: bool, token: str, names: Sequence[str] = ()) -> str:
    """Return the sentence that tells the user the page's address or addresses."""
    return "the page is at " + "\n  or at ".join(page_addresses(port, lan, token, names))


def check_page_port(wanted: int, option: str) -> None:
    """Check the number of a page's port, before anything is built; `option` names it in errors.

    Raises:
        BadArgument: there is no such port.
    """
    if wanted > _LAST_PORT:
        raise BadArgument(f"{option} {wanted} is no port: choose 1 to {_LAST_PORT}, or omit it")


def port_of_page(wanted: int | None) -> int:
    """Return the wanted port; by default 8000, or a free port if that is taken.

    Raises:
        BadArgument: the wanted port is taken or invalid.
    """
    check_page_port(wanted or 0, "--page-port")
    for port in (_DEFAULT_PORT, 0) if wanted is None else (wanted,):
        try:
            with socket.create_server(("127.0.0.1", port)) as listener:
                return int(listener.getsockname()[1])
        except OSError as error:
            why = "is taken" if error.errno == errno.EADDRINUSE else f"cannot be used ({error.strerror})"
    raise BadArgument(f"--page-port {wanted} {why}: choose another port, or omit it")


def served(port: ChairPort, settings: PageNodeSettings) -> AbstractContextManager[str]:
    """Return the page's server, with the token of the environment."""
    from waychair.runtime.haptics.session_log import SessionLog, default_session_log
    from waychair.ui.own_addresses import own_names
    from waychair.ui.server import page_server

    names = (*own_names(), *settings.names.replace(",", " ").split())
    token = os.environ.get(TOKEN, "")
    record = SessionLog(default_session_log())
    return page_server(port, host=settings.host, http_port=settings.port, token=token, names=names, session_log=record)


def main() -> int:
    """Run the page's process."""
    from waychair.ros.nodes.node import run_node
    from waychair.ros.nodes.page_node import PageNode

    return run_node(lambda: PageNode(served))


if __name__ == "__main__":
    sys.exit(main())
