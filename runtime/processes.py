"""Supervision of a table of processes: all are started, a dead one is restarted, and all end together.

A process may send heartbeats (`beats`); if they cease, the process counts as hung and is killed. The other processes
notice a dead one by the age of its messages: they stop first, and nothing resumes by itself when it is back.
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

BEAT_HZ = 5.0
"""Rate of a process's heartbeats."""

_BEAT_TO = "WAYCHAIR_BEAT_TO"
"""Environment variable with the file descriptor for a process's heartbeats."""

_HELD_UP_S = 1.0
"""A supervisor that was held up for longer cannot tell how long the processes were silent."""

CANNOT_START = 2
"""Exit status of a process that is wrongly configured. At the begin of a run it is not started again."""

MAX_DEATHS = 5  # deaths within DEATHS_WITHIN_S after which a process is not restarted again
DEATHS_WITHIN_S = 60.0  # s
RESTART_PAUSE_S = 0.2  # s; from a death to the restart
END_PATIENCE_S = 5.0  # s; time for a process to end by itself before it is killed
IDLE_HANG_S = 5.0  # s; an idle process without a heartbeat counts as hung after this time
BUSY_HANG_S = 120.0  # s; the same for a computing process, which may compile kernels or read a large map
IDLE_SHARE = 0.1  # share of the time below which a process that neither computes nor waits for a processor is idle

_LIBC = ctypes.CDLL(
    None
)  # opened here, as a child that is about to begin must not wait for a lock of its parent's threads


@dataclass(frozen=True, slots=True)
class Process:
    """A row of the table: a process's name, its Python module, and the module's arguments.

    `priority` above 0 is a real-time priority from the first heartbeat on, where the system grants it (sched(7)): a process
    that starts computes for seconds, and with such a priority it would keep all other programs from their messages. If a
    process that is not `vital` dies too often, the others go on without it.
    """

    name: str
    module: str
    arguments: tuple[str, ...] = ()
    priority: int = 0
    vital: bool = True


@dataclass(slots=True)
class _Running:
    row: Process
    process: subprocess.Popen[bytes]
    beats: int
    deaths: deque[float] = field(default_factory=deque)
    beaten_s: float | None = None  # time of the latest heartbeat; None before the first
    used_s: float = 0.0  # CPU time at that heartbeat
    waited_s: float = 0.0  # time at that heartbeat for which threads had been ready, and had no processor

    @property
    def sentence(self) -> str:
        """A sentence that the process runs."""
        return f"'{self.row.name}' runs as process {self.process.pid}"


class Supervision:
    """Runs the processes of a table for as long as the block lasts."""

    def __init__(
        self,
        table: Sequence[Process],
        environment: Mapping[str, str],
        report: Callable[[str], None] = lambda sentence: None,
    ) -> None:
        """`report` receives a sentence whenever a process dies or begins."""
        self._table = table
        self._environment = dict(environment)
        self._report = report
        self._running: list[_Running] = []
        self._watched_s = time.monotonic()

    def __enter__(self) -> Self:
        self._running = []
        with ExitStack() as begun:  # if one cannot be started, those before it are ended
            begun.push(self)
            for row in self._table:
                self._running.append(_Running(row, *self._start(row)))
                self._report(self._running[-1].sentence)
            begun.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ask all processes to end, the last one first, and kill those that do not."""
        for each in reversed(self._running):
            if each.process.poll() is None:
                each.process.send_signal(signal.SIGTERM)
        ends = time.monotonic() + END_PATIENCE_S
        for each in self._running:
            try:
                each.process.wait(max(0.0, ends - time.monotonic()))
            except subprocess.TimeoutExpired:
                each.process.kill()
                each.process.wait()
            os.close(each.beats)

    @property
    def pids(self) -> Mapping[str, int]:
        """Process ids of the running processes, by name."""
        return {each.row.name: each.process.pid for each in self._running}

    def watch(self) -> str:
        """Restart dead and hung processes; return why all must end, or an empty sentence. Call it at about 5 Hz."""
        now = time.monotonic()
        self._kill_hung(now)
        for each in list(self._running):
            status = each.process.poll()
            if status is None:
                continue
            if status == CANNOT_START and each.row.vital and each.beaten_s is None and not each.deaths:
                return f"'{each.row.name}' cannot start"
            how = f"by signal {signal.Signals(-status).name}" if status < 0 else f"with status {status}"
            each.deaths.append(now)
            while now - each.deaths[0] > DEATHS_WITHIN_S:
                each.deaths.popleft()
            if len(each.deaths) >= MAX_DEATHS:
                over = f"the process '{each.row.name}' ended {how}, {len(each.deaths)} times in {DEATHS_WITHIN_S:g} s"
                if each.row.vital:
                    return over
                self._report(f"{over}: the others go on without it")
                os.close(each.beats)
                self._running.remove(each)
                continue
            self._report(f"'{each.row.name}' ended {how}: it is started again, and no drive goes on by itself")
            time.sleep(RESTART_PAUSE_S)
            beats_of_dead = each.beats
            each.process, each.beats = self._start(each.row)
            each.beaten_s = None
            os.close(beats_of_dead)
            self._report(each.sentence)
        return ""

    def _kill_hung(self, now: float) -> None:
        """Kill processes whose heartbeat has ceased, after a short time if idle, after a longer one if computing.

        One that would compute, but has no processor because others have them, or that waits for the disk, is not idle.

        With the first heartbeat of a process comes its priority.
        """
        unwatched = now - self._watched_s > _HELD_UP_S
        self._watched_s = now
        for each in self._running:
            if _has_beaten(each.beats) or (unwatched and each.beaten_s is not None):
                if each.beaten_s is None:
                    _prioritise(each.process.pid, each.row.priority)
                each.beaten_s, each.used_s = now, _cpu_s(each.process.pid)
                each.waited_s = _waited_s(each.process.pid)
            if each.beaten_s is None or each.process.poll() is not None:
                continue
            silent_s = now - each.beaten_s
            if silent_s <= IDLE_HANG_S:
                continue
            wanted_s = _cpu_s(each.process.pid) - each.used_s + max(_waited_s(each.process.pid) - each.waited_s, 0.0)
            idle = wanted_s < IDLE_SHARE * silent_s and not _is_held_up(each.process.pid)
            if idle or silent_s > BUSY_HANG_S:
                self._report(f"'{each.row.name}' has hung for {silent_s:.1f} s: it is killed")
                each.process.kill()
                each.process.wait()

    def _start(self, row: Process) -> tuple[subprocess.Popen[bytes], int]:
        """Start a process; return it and the reading end of its heartbeat pipe."""
        command = [sys.executable, "-m", row.module, *row.arguments]
        beats, beat_to = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            process = subprocess.Popen(
                command,
                env={**self._environment, _BEAT_TO: str(beat_to)},
                pass_fds=[beat_to],
                start_new_session=True,
                preexec_fn=partial(_prepare_child, os.getpid()),  # noqa: PLW1509 - it takes no lock
            )
        except OSError:
            os.close(beats)
            raise
        finally:
            os.close(beat_to)
        return process, beats


def beats() -> Callable[[], None] | None:
    """Return a function that sends a heartbeat of this process to its `Supervision`; None where there is none.

    Call it at `BEAT_HZ` from the very loop that must not hang.
    """
    beat_to = os.environ.get(_BEAT_TO, "")
    if not beat_to:
        return None

    def beat() -> None:
        with suppress(OSError):  # the pipe is full or closed
            os.write(int(beat_to), b".")

    return beat


def signalled(*signals: signal.Signals) -> Callable[[], bool]:
    """Catch these signals from now on; return a function that tells whether one has come."""
    came: list[int] = []
    for each in signals:
        signal.signal(each, lambda number, frame: came.append(number))
    return lambda: bool(came)


def _has_beaten(pipe: int) -> bool:
    """Whether a heartbeat has come since the last call."""
    with suppress(BlockingIOError):
        return bool(os.read(pipe, 1 << 16))
    return False


def _cpu_s(pid: int) -> float:
    """Return the CPU time [s] that a process has used (proc(5)); 0 where it is unknown."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(") ")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _waited_s(pid: int) -> float:
    """Return the time [s] for which the threads of a process were ready, but had no processor (proc(5), schedstat).

    A single look at the threads would miss it where they wait for each other in turn. 0 where it is unknown.
    """
    with suppress(OSError, ValueError, IndexError):
        texts = [path.read_text(encoding="ascii") for path in Path(f"/proc/{pid}/task").glob("*/schedstat")]
        return sum(int(text.split()[1]) for text in texts) * 1e-9
    return 0.0


def _is_held_up(pid: int) -> bool:
    """Return whether a thread of a process is ready to run, or waits for the disk (proc(5)); false where it is unknown."""
    with suppress(OSError):
        threads = [
            path.read_text(encoding="ascii", errors="replace") for path in Path(f"/proc/{pid}/task").glob("*/stat")
        ]
        return any(text.rpartition(") ")[2].startswith(("R", "D")) for text in threads)
    return False


def _prioritise(pid: int, priority: int) -> None:
    """Give the threads of a process a real-time priority above 0, where the system grants it; those that have one keep it."""
    with suppress(OSError):
        threads = Path(f"/proc/{pid}/task").iterdir() if priority > 0 else ()
        for thread in (int(each.name) for each in threads):
            if os.sched_getscheduler(thread) == os.SCHED_OTHER:
                os.sched_setscheduler(thread, os.SCHED_RR, os.sched_param(priority))


def _prepare_child(parent: int) -> None:
    """Ask Linux for SIGTERM at the parent's death (prctl(2), PR_SET_PDEATHSIG), in the child."""
    _LIBC.prctl(1, signal.SIGTERM)
    if os.getppid() != parent:  # the parent died before prctl
        os._exit(1)
