"""Processes that belong together, as a table: all are started, whichever dies is started again, and all end together.

One that hangs is as good as dead: a process may show that it lives (`beats`), and if it then ceases to, it is killed.
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
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

from waychair.config import Settings, setting

BEAT_HZ = 5.0
"""A process that shows that it lives does so as often."""

_BEAT_TO = "WAYCHAIR_BEAT_TO"
"""Tells a process, in its environment, by which file descriptor it may do so."""

_WATCHED_S = 1.0
"""Who has not watched for so long cannot say for how long the others were silent."""


@dataclass(frozen=True, slots=True)
class Process:
    """A row: its name, the Python module that it runs, and that one's arguments.

    `priority` above 0 is a real-time one, where the system grants it (sched(7)). The others go on without one that is not
    `vital`.
    """

    name: str
    module: str
    arguments: tuple[str, ...] = ()
    priority: int = 0
    vital: bool = True


@dataclass(frozen=True, slots=True)
class SupervisionSettings(Settings):
    """When to give up, and how long to wait for an end."""

    most_deaths: int = setting(5, "", "a process that died so often ...", low=1, high=1000)
    within_s: float = setting(60.0, "s", "... within this time stays dead, and all end", low=1.0, high=3600.0)
    pause_s: float = setting(0.2, "s", "from a death to the next start", low=0.0, high=60.0)
    patience_s: float = setting(5.0, "s", "for a process to end when it is asked to", low=0.1, high=60.0)
    idle_s: float = setting(5.0, "s", "one that ceases to beat and does nothing hangs after this", low=0.5, high=600.0)
    busy_s: float = setting(120.0, "s", "and one that computes (kernels, a large map)", low=1.0, high=3600.0)
    idle_share: float = setting(0.1, "", "part of a processor below which it does nothing", low=0.0, high=1.0)


@dataclass(slots=True)
class _Running:
    row: Process
    process: subprocess.Popen[bytes]
    beats: int
    deaths: deque[float] = field(default_factory=deque)
    beaten_s: float | None = None  # None until it has, for the first time
    used_s: float = 0.0  # CPU until then

    @property
    def sentence(self) -> str:
        """That it has begun."""
        return f"'{self.row.name}' runs as process {self.process.pid}"


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
        self._watched_s = time.monotonic()

    def __enter__(self) -> Self:
        self._running = []
        with ExitStack() as begun:  # if one cannot be started, none is left behind
            begun.push(self)
            for row in self._table:
                self._running.append(_Running(row, *self._start(row)))
                self._told(self._running[-1].sentence)
            begun.pop_all()
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
            os.close(each.beats)

    @property
    def pids(self) -> Mapping[str, int]:
        """Of the processes that run now, by name."""
        return {each.row.name: each.process.pid for each in self._running}

    def watch(self) -> str:
        """Start again what has died or hangs; why all must end, or an empty sentence. To be called several times a second."""
        now, s = time.monotonic(), self._settings
        self._kill_what_hangs(now)
        for each in list(self._running):
            status = each.process.poll()
            if status is None:
                continue
            how = f"by signal {signal.Signals(-status).name}" if status < 0 else f"with status {status}"
            each.deaths.append(now)
            while now - each.deaths[0] > s.within_s:
                each.deaths.popleft()
            if len(each.deaths) >= s.most_deaths:
                over = f"the process '{each.row.name}' ended {how}, {len(each.deaths)} times in {s.within_s:g} s"
                if each.row.vital:
                    return over
                self._told(f"{over}: the others go on without it")
                os.close(each.beats)
                self._running.remove(each)
                continue
            self._told(f"'{each.row.name}' ended {how}: it is started again, and no drive goes on by itself")
            time.sleep(s.pause_s)
            beats_of_dead = each.beats
            each.process, each.beats = self._start(each.row)
            each.beaten_s = None
            os.close(beats_of_dead)
            self._told(each.sentence)
        return ""

    def _kill_what_hangs(self, now: float) -> None:
        """One that has ceased to beat, and waits for what does not come, or computes for much too long."""
        s, unwatched = self._settings, now - self._watched_s > _WATCHED_S
        self._watched_s = now
        for each in self._running:
            if _has_beaten(each.beats) or (unwatched and each.beaten_s is not None):
                each.beaten_s, each.used_s = now, _cpu_s(each.process.pid)
            if each.beaten_s is None or each.process.poll() is not None:
                continue
            silent_s = now - each.beaten_s
            if silent_s <= s.idle_s:
                continue
            idle = _cpu_s(each.process.pid) - each.used_s < s.idle_share * silent_s
            if idle or silent_s > s.busy_s:
                self._told(f"'{each.row.name}' has hung for {silent_s:.1f} s: it is killed")
                each.process.kill()
                each.process.wait()

    def _start(self, row: Process) -> tuple[subprocess.Popen[bytes], int]:
        """The process, and our end of the pipe by which it may show that it lives."""
        command = [sys.executable, "-m", row.module, *row.arguments]
        beats, beat_to = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            process = subprocess.Popen(
                command,
                env={**self._environment, _BEAT_TO: str(beat_to)},
                pass_fds=[beat_to],
                start_new_session=True,
                preexec_fn=partial(_begin, os.getpid(), row.priority),  # noqa: PLW1509 - this process has no other threads
            )
        except OSError:
            os.close(beats)
            raise
        finally:
            os.close(beat_to)
        return process, beats


def beats() -> Callable[[], None] | None:
    """What shows a `Supervision` that this process lives, to be called at `BEAT_HZ` from the very loop that must not hang;
    None where nobody supervises it."""
    beat_to = os.environ.get(_BEAT_TO, "")
    if not beat_to:
        return None

    def beat() -> None:
        with suppress(OSError):  # nobody takes them at the moment, or any more
            os.write(int(beat_to), b".")

    return beat


def signalled(*signals: signal.Signals) -> Callable[[], bool]:
    """Whether one of these signals has come, from now on, in place of what they would do to this process."""
    came: list[int] = []
    for each in signals:
        signal.signal(each, lambda number, frame: came.append(number))
    return lambda: bool(came)


def _has_beaten(pipe: int) -> bool:
    """Since this was asked last."""
    with suppress(BlockingIOError):
        return bool(os.read(pipe, 1 << 16))
    return False


def _cpu_s(pid: int) -> float:
    """CPU time that a process has used (proc(5)); 0 where that is not to be known."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(") ")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _begin(parent: int, priority: int) -> None:
    """Asks Linux for SIGTERM when the parent dies, however it dies (prctl(2), PR_SET_PDEATHSIG), and for priority."""
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)
    if priority > 0:
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(priority))
    if os.getppid() != parent:  # it has died before it was asked
        os._exit(1)
