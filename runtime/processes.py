"""Processes that belong together, as a table: all are started, whichever dies is started again, and all end together.

What a dead process leaves undone is for the others to notice by the age of what it said: they stop first, and nothing
resumes by itself when it is back.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from types import TracebackType
from typing import Self

from waychair.config import Settings, setting


@dataclass(frozen=True, slots=True)
class Process:
    """A row: its name, the Python module that it runs, and that one's arguments.

    `priority` above 0 is a real-time one, where the system grants it (sched(7)).
    """

    name: str
    module: str
    arguments: tuple[str, ...] = ()
    priority: int = 0


@dataclass(frozen=True, slots=True)
class SupervisionSettings(Settings):
    """When to give up, and how long to wait for an end."""

    most_deaths: int = setting(5, "", "a process that died so often ...", low=1, high=1000)
    within_s: float = setting(60.0, "s", "... within this time stays dead, and all end", low=1.0, high=3600.0)
    pause_s: float = setting(0.2, "s", "from a death to the next start", low=0.0, high=60.0)
    patience_s: float = setting(5.0, "s", "for a process to end when it is asked to", low=0.1, high=60.0)


@dataclass(slots=True)
class _Running:
    row: Process
    process: subprocess.Popen[bytes]
    deaths: deque[float] = field(default_factory=deque)


class Supervision:
    """The processes of a table, for as long as the block lasts."""

    def __init__(
        self,
        table: Sequence[Process],
        environment: Mapping[str, str],
        told: Callable[[str], None] = lambda sentence: None,
        settings: SupervisionSettings | None = None,
    ) -> None:
        """`told` is given a sentence whenever a process dies or begins."""
        self._table = table
        self._environment = dict(environment)
        self._told = told
        self._settings = settings or SupervisionSettings()
        self._running: list[_Running] = []

    def __enter__(self) -> Self:
        self._running = [_Running(row, self._start(row)) for row in self._table]
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ask all to end, the last that was started first, and kill what does not."""
        for each in reversed(self._running):
            if each.process.poll() is None:
                each.process.send_signal(signal.SIGTERM)
        ends = time.monotonic() + self._settings.patience_s
        for each in self._running:
            try:
                each.process.wait(max(0.0, ends - time.monotonic()))
            except subprocess.TimeoutExpired:
                each.process.kill()
                each.process.wait()

    @property
    def pids(self) -> Mapping[str, int]:
        """Of the processes that run now, by name."""
        return {each.row.name: each.process.pid for each in self._running}

    def watch(self) -> str:
        """Start again what has died; why all must end, or an empty sentence. To be called several times a second."""
        now, s = time.monotonic(), self._settings
        for each in self._running:
            status = each.process.poll()
            if status is None:
                continue
            how = f"by signal {signal.Signals(-status).name}" if status < 0 else f"with status {status}"
            each.deaths.append(now)
            while now - each.deaths[0] > s.within_s:
                each.deaths.popleft()
            if len(each.deaths) >= s.most_deaths:
                return f"the process '{each.row.name}' ended {how}, {len(each.deaths)} times in {s.within_s:g} s"
            self._told(f"'{each.row.name}' ended {how}: it is started again, and no drive goes on by itself")
            time.sleep(s.pause_s)
            each.process = self._start(each.row)
        return ""

    def _start(self, row: Process) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", row.module, *row.arguments]
        process = subprocess.Popen(
            command,
            env=self._environment,
            start_new_session=True,
            preexec_fn=partial(_begin, os.getpid(), row.priority),  # noqa: PLW1509 - this process has no other threads
        )
        self._told(f"'{row.name}' runs as process {process.pid}")
        return process


def signalled(*signals: signal.Signals) -> Callable[[], bool]:
    """Whether one of these signals has come, from now on, in place of what they would do to this process."""
    came: list[int] = []
    for each in signals:
        signal.signal(each, lambda number, frame: came.append(number))
    return lambda: bool(came)


def _begin(parent: int, priority: int) -> None:
    """Asks Linux for SIGTERM when the parent dies, however it dies (prctl(2), PR_SET_PDEATHSIG), and for priority."""
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)
    if priority > 0:
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(priority))
    if os.getppid() != parent:  # it has died before it was asked
        os._exit(1)
