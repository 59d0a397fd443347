"""A computer as a process, for `fail_safe.kill_host`: it shakes hands, holds zero and then drives steadily.

Simulated time comes on its standard input as records (now_ms u32, fine u8). For each it answers the number of bytes
(u32) written to the terminal so far. A `fine` tick lasts one millisecond and sends half of a frame, so that the process
can be killed in the middle of a frame.
"""

from __future__ import annotations

import os
import struct
import sys

from waychair.firmware_bridge.protocol import Command, CommandFlag, Family, encode, hello

PERIOD_MS = 20
DRIVE_FROM_MS = 2100
"""Time of the first non-zero command: the board's two seconds of neutral and a margin."""

TICK = struct.Struct("<IB")
WRITTEN = struct.Struct("<I")


def command_at(now_ms: int, forward: int, turn: int) -> Command:
    """Return the steady computer's command at a time since its start."""
    drives = now_ms >= DRIVE_FROM_MS
    return Command(forward * drives, turn * drives, CommandFlag.ENABLE, now_ms * 1000)


def serve(terminal: int, forward: int, turn: int) -> None:
    """Answer ticks until the input ends."""
    pending, written, sequence, period = encode(hello("A", Family.HALL_5V), 0), 0, 0, -1
    while len(tick := os.read(0, TICK.size)) == TICK.size:
        now_ms, fine = TICK.unpack(tick)
        if now_ms // PERIOD_MS > period:
            period, sequence = now_ms // PERIOD_MS, sequence + 1
            pending += encode(command_at(now_ms, forward, turn), sequence)
        part = pending[: (len(pending) + 1) // 2] if fine else pending
        written += os.write(terminal, part)
        pending = pending[len(part) :]
        os.write(1, WRITTEN.pack(written))


if __name__ == "__main__":
    serve(os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY), int(sys.argv[2]), int(sys.argv[3]))
