"""Measures the round trip of a command to the board and its echo, in real time over a pseudo-terminal."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from waychair.calibration.fits.dac import DEFAULT
from waychair.errors import BridgeError
from waychair.firmware_bridge.bridge import Bridge
from waychair.firmware_bridge.heartbeat import urgent
from waychair.firmware_bridge.protocol import Family
from waychair.firmware_bridge.transports import Reconnecting, SerialTransport, open_pseudo_terminal
from waychair.types import FloatArray, Telemetry, WheelSpeeds

PERIOD_S = 0.02
TIMEOUT_S = 5.0
CHAIR = "A"


@contextmanager
def board_in_real_time(program: Path) -> Iterator[tuple[str, int]]:
    """Run the board's program from `build_board` in real time; yield its terminal's path and its process id."""
    board, computer, path = open_pseudo_terminal()
    words = ["--serial-fd", str(board), "--realtime", "--chair", CHAIR, "--family", str(int(Family.EIGHT_PIN_3V3))]
    os.set_blocking(board, False)
    process = subprocess.Popen([str(program), *words], pass_fds=(board,), stdin=subprocess.DEVNULL)
    try:
        yield path, process.pid
    finally:
        process.kill()
        process.wait()
        os.close(board)
        os.close(computer)


def round_trips_ms(program: Path, count: int = 500, *, urgently: bool = True) -> tuple[FloatArray, bool]:
    """Return the times (count,) [ms] from sending a command to reading its echo: the bridge at 50 Hz, over pyserial.

    Between two commands the bridge sleeps until a byte arrives. The times therefore come from the terminal, the board's
    loop of one millisecond and the scheduling of both processes. `urgently` asks for real-time priority for both, as a
    board has its own processor; the second result tells whether it was granted.

    Raises:
        BridgeError: the board stops answering.
        TransportError: pyserial is missing, or no pseudo-terminal is left.
    """
    with board_in_real_time(program) as (path, process), ThreadPoolExecutor(1) as own_thread:
        granted = urgently and urgent(process) and own_thread.submit(urgent).result()
        return own_thread.submit(_measure, path, count).result(), granted


def _measure(path: str, count: int) -> FloatArray:
    times = np.empty(count)
    cable = Reconnecting(lambda: SerialTransport(path))
    bridge = Bridge(cable, DEFAULT, CHAIR)
    _beat_until(bridge, cable, lambda report: True)
    for index in range(count):
        began_ns = time.monotonic_ns()
        bridge.send(WheelSpeeds(), began_ns, began_ns)
        _beat_until(bridge, cable, partial(_echoes_since, began_ns))
        times[index] = (time.monotonic_ns() - began_ns) / 1e6
        while (left_s := PERIOD_S - (time.monotonic_ns() - began_ns) * 1e-9) > 0.0:
            cable.wait(left_s)
            bridge.listen(time.monotonic_ns())
    cable.close()
    return times


def _echoes_since(since_ns: int, report: Telemetry) -> bool:
    """Return whether a report answers a command sent at this time or later."""
    return report.round_trip_ns is not None and report.stamp_ns - report.round_trip_ns >= since_ns


def _beat_until(bridge: Bridge, cable: Reconnecting, done: Callable[[Telemetry], bool]) -> None:
    """Beat and wait for bytes until a report fulfils `done`."""
    deadline_s = time.monotonic() + TIMEOUT_S
    while time.monotonic() < deadline_s:
        bridge.beat(time.monotonic_ns())
        report = bridge.telemetry
        if report is not None and done(report):
            return
        cable.wait(PERIOD_S / 2)
    raise BridgeError(f"the board did not answer within {TIMEOUT_S:g} s: is its program still running?")
