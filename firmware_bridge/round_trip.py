"""How long a command takes to the board and its answer back, in real time over a pseudo-terminal."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path

import numpy as np

from waychair.errors import BridgeError
from waychair.firmware_bridge.protocol import (
    BoardTelemetry,
    Command,
    CommandFlag,
    Decoder,
    Family,
    HelloReply,
    encode,
    hello,
)
from waychair.firmware_bridge.transports import SerialTransport, open_pseudo_terminal
from waychair.types import FloatArray

PERIOD_S = 0.02
PATIENCE_S = 1.0
POLL_S = 0.0002


def round_trips_ms(program: Path, count: int = 500) -> FloatArray:
    """Times (count,) [ms] from writing a command to reading the telemetry that echoes it, at 50 Hz by pyserial.

    `program` is the board's, by `build_board`; it runs in real time with a loop of one millisecond.

    Raises:
        BridgeError: the board stops answering.
        TransportError: pyserial is missing, or no pseudo-terminal is left.
    """
    board, computer, path = open_pseudo_terminal()
    words = [str(program), "--serial-fd", str(board), "--realtime", "--chair", "A"]
    os.set_blocking(board, False)
    process = subprocess.Popen(words, pass_fds=(board,), stdin=subprocess.DEVNULL)
    port = SerialTransport(path)
    try:
        decoder = Decoder()
        port.write(encode(hello("A", Family.HALL_5V), 0))
        _wait(port, decoder, None)
        times = np.empty(count)
        for index in range(count):
            sent = time.perf_counter()
            port.write(encode(Command(0, 0, CommandFlag.ENABLE, index), index + 1))
            _wait(port, decoder, index)
            times[index] = 1e3 * (time.perf_counter() - sent)
            time.sleep(max(0.0, PERIOD_S - (time.perf_counter() - sent)))
        return times
    finally:
        process.kill()
        process.wait()
        port.close()
        os.close(board)
        os.close(computer)


def _wait(port: SerialTransport, decoder: Decoder, stamp_us: int | None) -> None:
    """Until the telemetry that echoes this stamp, or with None the answer to the greeting, has come."""
    deadline = time.perf_counter() + PATIENCE_S
    while time.perf_counter() < deadline:
        for received in decoder.feed(port.read()):
            message = received.message
            if stamp_us is None and isinstance(message, HelloReply):
                return
            if isinstance(message, BoardTelemetry) and message.echo_stamp_us == stamp_us and message.echo_sequence > 0:
                return
        time.sleep(POLL_S)
    raise BridgeError(f"the board did not answer within {PATIENCE_S:g} s: is its program still running?")
