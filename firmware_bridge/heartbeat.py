"""The bridge's heartbeat in real time: a thread beside the control loop, which may take its time or hang.

It sleeps in the operating system until a byte arrives or a beat is due, so that what the board says is taken in at
once. It repeats what the control loop said last; the bridge itself lets that go stale. Where the system allows it, it
has real-time priority: on a busy computer other programs then wait for it, and not it for them.

It never dies in silence: whatever goes wrong in a beat ends the drive, is the bridge's trouble, and the next beat is
tried all the same.
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
"""Above the priorities of a chair's nodes (`waychair up --urgent`), below those of the system's own threads."""


def urgent(process: int = 0) -> bool:
    """Real-time priority for a process, by default the calling thread; false where the system does not grant it.

    Linux grants it to root and to users with an `rtprio` limit (sched(7), limits.conf(5)).
    """
    try:
        os.sched_setscheduler(process, os.SCHED_FIFO, os.sched_param(URGENT))
    except (AttributeError, OSError):
        return False
    return True


class Heartbeat:
    """Beats for as long as its block lasts. `clock` is the one by which commands are stamped [ns]."""

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
        """The board hears no more: 100 ms later the joystick is live whatever was commanded."""
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        urgent()
        while not self._ended.is_set():
            try:
                self._bridge.beat(self._clock())
                self._cable.wait(PERIOD_S / 2)
            except Exception as error:  # noqa: BLE001 - a thread that has died tells nobody
                self._fail(error)
                self._ended.wait(PERIOD_S / 2)

    def _fail(self, error: Exception) -> None:
        """Whatever it was: tell the bridge, and the log what it has not been told yet."""
        reason = (
            f"the heartbeat failed ({str(error) or type(error).__name__}): start the program again if that stays so"
        )
        self._bridge.fail(reason)
        if reason != self._failure:
            self._failure = reason
            _LOGGER.error("%s", reason, exc_info=error)
