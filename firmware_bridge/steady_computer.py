"""A computer as a process, for `fail_safe.kill_host`: it shakes hands, holds zero and then drives steadily. With four
caps instead of two set-points it lets the rider drive within them, for `guard_trials.kill_guard`.

Simulated time comes on its standard input as records (now_ms u32, fine u8). For each it answers the number of bytes
(u32) written to the terminal so far. A `fine` tick lasts one millisecond and sends half of a frame, so that the process
can be killed in the middle of a frame.
"""

from __future__ import annotations

import os
import struct
import sys
from collections.abc import Callable

from waychair.firmware_bridge.protocol import Command, CommandFlag, Family, Limit, Message, encode, hello

PERIOD_MS = 20
DRIVE_FROM_MS = 2100
"""Time of the first non-zero command: the board's two seconds of neutral and a margin."""

TICK = struct.Struct("<IB")
WRITTEN = struct.Struct("<I")


def command_at(now_ms: int, forward: int, turn: int) -> Command:
    """Return the steady computer's command at a time since its start."""
    drives = now_ms >= DRIVE_FROM_MS
    return Command(forward * drives, turn * drives, CommandFlag.ENABLE, now_ms * 1000)


def limit_at(now_ms: int, front: int, rear: int, left: int, right: int) -> Limit:
    """Return the caps of a steady computer at a time since its start."""
    return Limit(front, rear, left, right, CommandFlag.ENABLE | CommandFlag.GUARD, now_ms * 1000)


def serve(terminal: int, message_at: Callable[[int], Message]) -> None:
    """Answer ticks until the input ends; `message_at` gives the message of a time."""
    pending, written, sequence, period = encode(hello("A", Family.HALL_5V), 0), 0, 0, -1
    while len(tick := os.read(0, TICK.size)) == TICK.size:
        now_ms, fine = TICK.unpack(tick)
        if now_ms // PERIOD_MS > period:
            period, sequence = now_ms // PERIOD_MS, sequence + 1
            pending += encode(message_at(now_ms), sequence)
        part = pending[: (len(pending) + 1) // 2] if fine else pending
        written += os.write(terminal, part)
        pending = pending[len(part) :]
        os.write(1, WRITTEN.pack(written))


if __name__ == "__main__":
    path, *figures = sys.argv[1:]
    wanted = tuple(map(int, figures))
    serve(
        os.open(path, os.O_RDWR | os.O_NOCTTY),
        lambda now_ms: command_at(now_ms, *wanted) if len(wanted) == 2 else limit_at(now_ms, *wanted),
    )
