"""Ports of this computer for tests that run servers."""

from __future__ import annotations

import socket
import time
from contextlib import suppress


def free_port() -> int:
    """Return a port on which nothing listens."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return int(listener.getsockname()[1])


def wait_until_open(port: int) -> None:
    """Wait until something listens on a port, however long a busy computer takes."""
    while True:
        with suppress(ConnectionRefusedError), socket.create_connection(("127.0.0.1", port)):
            return
        time.sleep(0.02)
