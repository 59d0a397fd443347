"""The bridge's heartbeat in real time: a thread beside the control loop, which may be late or hang.

It sleeps until a byte arrives or a beat is due, so that the board's messages are read at once. It repeats the control
loop's last command; the bridge itself rejects a stale one. Where the system allows it, the thread has real-time
priority, so that on a busy computer it does not wait for other programs.

It never dies silently: an error in a beat ends the drive, becomes the bridge's trouble, and the next beat is tried.
"""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from waychair.firmware_bridge.bridge import Bridge
from waychair.firmware_bridge.transports import Reconnecting

_LOGGER = logging.getLogger(__name__)

PERIOD_S = 0.02

URGENT = 10
"""Real-time priority above a chair's nodes (`waychair up --urgent`), below the system's own threads."""


def urgent(process: int = 0) -> bool:
    """Give a process, by default the calling thread, real-time priority; return whether the system granted it.

    Linux grants it to root and to users with an `rtprio` limit (sched(7), limits.conf(5)).
    """
    try:
        os.sched_setscheduler(process, os.SCHED_FIFO, os.sched_param(URGENT))
    except (AttributeError, OSError):
        return False
    return True


class Heartbeat:
    """The heartbeat thread, running within its `with` block; `clock` must be the clock that stamps commands [ns]."""

    def __init__(self, bridge: Bridge, cable: Reconnecting, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._bridge = bridge
        self._cable = cable
        self._clock = clock
        self._ended = threading.Event()
        self._failure = ""
        self._thread = threading.Thread(target=self._run, name="heartbeat", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop the heartbeat: 100 ms later the joystick is live, whatever the last command was."""
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        urgent()
        while not self._ended.is_set():
            try:
                self._bridge.beat(self._clock())
                self._cable.wait(PERIOD_S / 2)
            except Exception as error:  # noqa: BLE001 - a thread that dies would report nothing
                self._fail(error)
                self._ended.wait(PERIOD_S / 2)

    def _fail(self, error: Exception) -> None:
        """Report an error to the bridge, and log it unless it is the same as the last one."""
        reason = f"the heartbeat failed ({str(error) or type(error).__name__}): restart the program if this continues"
        self._bridge.fail(reason)
        if reason != self._failure:
            self._failure = reason
            _LOGGER.error("%s", reason, exc_info=error)
