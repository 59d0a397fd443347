"""Interrupts that come while rclpy works are handled between two of its waits."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_HELD = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def held_interrupts() -> Iterator[None]:
    """Hold the Python handlers of SIGINT, SIGTERM and SIGHUP back until the block ends, and then call them.

    A handler that raises would otherwise raise anywhere, as in the midst of rclpy's conversion of a message, and make a
    different error of the interrupt. Signals without a Python handler act as always. In other threads than the main one,
    in which Python handles signals, it does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[tuple[Callable[[int, FrameType | None], object], int, FrameType | None]] = []
    before = {number: handler for number in _HELD if callable(handler := signal.getsignal(number))}

    def hold(number: int, frame: FrameType | None) -> None:
        came.append((before[signal.Signals(number)], number, frame))

    try:
        for number in before:
            signal.signal(number, hold)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for handler, at, frame in came:
            handler(at, frame)
