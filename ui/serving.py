"""Serving an ASGI application of pages in a thread, to this computer or, with a token, to the network."""

from __future__ import annotations

import ipaddress
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from waychair.errors import ConfigError, OutputError

if TYPE_CHECKING:
    from fastapi import FastAPI

STATIC = Path(__file__).parent / "static"

PORTS = range(65_536)
"""TCP ports; 0 stands for a free one."""

LARGEST_MESSAGE = 65_536
"""Most bytes of a page's command."""

_ENDING_S = 3


@contextmanager
def served(pages: Callable[[bool], FastAPI], host: str, http_port: int, token: str) -> Iterator[str]:
    """Serve pages in a thread while the block lasts; yield their address. `http_port` 0 takes a free port.

    `pages` makes the application, given whether only this computer can reach it.

    Raises:
        ConfigError: the pages would be open to the network without a token.
        OutputError: the port is in use, not allowed, or none.
        MissingExtra: the extra [ui] is not installed.
    """
    local = _is_local(host)
    if not local and not token:
        raise ConfigError(f"the page on {host} would be open to the whole network: give it a token")
    application = pages(local)
    import uvicorn

    config = uvicorn.Config(
        application,
        log_level="warning",
        ws_max_size=LARGEST_MESSAGE,
        ws_max_queue=64,
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=_ENDING_S,
        server_header=False,
    )
    listener = _listener(host, http_port)
    number = listener.getsockname()[1]
    name = f"[{host}]" if ":" in host else host
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, name="page-server")
    thread.start()
    try:
        yield f"http://{name}:{number}/" + (f"#token={token}" if token else "")
    finally:
        server.should_exit = True
        thread.join()
        listener.close()


def _listener(host: str, http_port: int) -> socket.socket:
    if http_port not in PORTS:
        raise OutputError(f"{http_port} is no port of a page: choose 1 to {PORTS[-1]}")
    try:
        return socket.create_server((host, http_port), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
    except OSError as error:
        raise OutputError(
            f"the page cannot be served on {host}:{http_port}: {error.strerror}; choose another port"
        ) from error


def _is_local(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
