"""The seam between peers and their network: bytes of a kind to all or one, and the messages that come.

`zenoh_transport.py` is the network of real chairs; the seeded network of simulations is the other one.
"""

from __future__ import annotations

from typing import Protocol


class PeerTransport(Protocol):
    """A peer's end of a network. It may lose, delay, double and reorder, and never waits."""

    def send(self, to: int | None, kind: str, data: bytes) -> None:
        """Send bytes to a peer, or to all others."""

    def received(self) -> list[tuple[int, bytes]]:
        """Return the messages since the last call, with the number of each sender as the network knows it."""

    def close(self) -> None:
        """Leave the network."""
