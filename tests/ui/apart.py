"""The page's server in a process of its own, as with ROS; the chair's port stays in the parent process.

    python -m tests.ui.apart HOST PORT AUTHKEY

prints the page's address and serves until it is killed.
"""

from __future__ import annotations

import sys
from multiprocessing.managers import BaseManager
from typing import Any

from waychair.runtime.pages.chair_port import ChairPort
from waychair.types import FloatArray
from waychair.ui.server import page_server

CALLS = [name for name in vars(ChairPort) if not name.startswith("_") and name != "outline"]


class Lent:
    """A port lent to another process, which can call it but not read it."""

    def __init__(self, port: ChairPort) -> None:
        self._port = port

    def corners(self) -> FloatArray:
        """The chair's outline."""
        return self._port.outline

    def __getattr__(self, name: str) -> Any:
        return getattr(self._port, name)


class Borrowed:
    """The port, in the other process."""

    def __init__(self, lent: Any) -> None:
        self._lent = lent
        self.outline: FloatArray = lent.corners()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._lent, name)


class Lending(BaseManager):
    """Lends a port over a socket."""


def lending(port: ChairPort, key: bytes) -> Any:
    """A server that lends a port: `address`, `serve_forever`."""

    class Here(BaseManager):
        pass

    lent = Lent(port)
    Here.register("port", callable=lambda: lent, exposed=["corners", *CALLS])
    return Here(("127.0.0.1", 0), key).get_server()


def main() -> None:
    host, number, key = sys.argv[1:]
    Lending.register("port", exposed=["corners", *CALLS])
    manager = Lending((host, int(number)), key.encode())
    manager.connect()
    with page_server(Borrowed(manager.port())) as address:  # type: ignore[attr-defined]
        print(address, flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main()
