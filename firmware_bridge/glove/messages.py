"""The serial protocol between computer and glove: the frames of the chair's board with messages of their own.

`firmware/glove/glove_protocol.h` is the same table in C. The CRC-32 of the table's text is the layout hash: two sides built
from different tables refuse each other.
"""

from __future__ import annotations

from dataclasses import dataclass

STEPS_MAX = 16
"""Most steps of one PLAY."""


@dataclass(frozen=True, slots=True)
class PlayStep:
    """Motors by bit that are driven at once at a strength (0 to 255) for `on_ms`, then all rest for `off_ms`."""

    mask: int
    strength: int
    on_ms: int
    off_ms: int
