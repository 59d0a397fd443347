"""Supervised processes: started, restarted, and ended together, in whichever way the supervisor ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from waychair.runtime import processes
from waychair.runtime.processes import Process, Supervision, signalled

PATIENCE_S = 30.0


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Settings with restarts at once and short limits."""
    monkeypatch.setattr(processes, "RESTART_PAUSE_S", 0.0)
    monkeypatch.setattr(processes, "END_PATIENCE_S", 0.5)


@pytest.fixture
def soon_hung(monkeypatch: pytest.MonkeyPatch) -> None:
    """An idle process hangs after half a second."""
    monkeypatch.setattr(processes, "IDLE_HANG_S", 0.5)


SLEEPS = "import time\nwhile True: time.sleep(0.1)\n"
DEAF = "import signal, time\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\n" + SLEEPS
DIES = "import sys\nsys.exit(3)\n"
BEATS = textwrap.dedent(
    """
    import time
    from waychair.runtime.processes import beats
    beat = beats()
    while True:
        beat()
        time.sleep(0.02)
    """
)
COMPUTES = BEATS.split("while")[0] + "beat()\nwhile True: pass\n"


@pytest.fixture
def modules(tmp_path: Path) -> Path:
    """A folder of Python modules that processes can run."""
    for name, text in (("sleeps", SLEEPS), ("deaf", DEAF), ("dies", DIES), ("beats", BEATS), ("computes", COMPUTES)):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path)!r} + '/{name}.began', 'w')\n" + text)
    return tmp_path


def environment(modules: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(modules)}


def until(true: Callable[[], object]) -> None:
    ends = time.monotonic() + PATIENCE_S
    while not true():
        assert time.monotonic() < ends
        time.sleep(0.005)


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def is_alive(pid: int) -> bool:
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return stat.rsplit(") ", 1)[1][0] != "Z"


def test_all_processes_start_and_end_together_even_those_that_ignore_signals(modules: Path) -> None:
    told: list[str] = []
    table = [Process("one", "sleeps"), Process("two", "deaf")]
    with Supervision(table, environment(modules), told.append) as running:
        pids = running.pids
        until(lambda: all((modules / f"{name}.began").exists() for name in ("sleeps", "deaf")))
        assert running.watch() == ""
    assert set(pids) == {"one", "two"}
    assert not any(map(is_alive, pids.values()))
    assert told == [f"'{name}' runs as process {pid}" for name, pid in pids.items()]


def test_if_one_cannot_be_started_the_earlier_ones_are_ended(modules: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[subprocess.Popen[bytes]] = []
    start = subprocess.Popen

    def second_fails(*words: Any, **named: Any) -> subprocess.Popen[bytes]:
        if begun:
            raise OSError(11, "Resource temporarily unavailable")
        begun.append(start(*words, **named))
        return begun[0]

    monkeypatch.setattr(subprocess, "Popen", second_fails)
    files = open_files()
    table = [Process("one", "sleeps"), Process("two", "sleeps")]
    with pytest.raises(OSError, match="unavailable"), Supervision(table, environment(modules)):
        pass
    assert begun[0].poll() is not None
    assert open_files() == files


def test_a_process_that_cannot_be_restarted_ends_all_and_no_file_is_closed_twice(
    modules: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise OSError(11, "Resource temporarily unavailable")

    files, pids = open_files(), list[int]()
    table = [Process("one", "sleeps"), Process("two", "sleeps")]

    def one_dies() -> None:
        with Supervision(table, environment(modules)) as running:
            pids.extend(running.pids.values())
            os.kill(pids[0], signal.SIGKILL)
            monkeypatch.setattr(subprocess, "Popen", fails)
            until(running.watch)

    with pytest.raises(OSError, match="unavailable"):
        one_dies()
    assert not any(map(is_alive, pids))
    assert open_files() == files


def test_a_killed_process_is_restarted_and_the_others_stay(modules: Path) -> None:
    told: list[str] = []
    table = [Process("one", "sleeps"), Process("two", "sleeps")]
    with Supervision(table, environment(modules), told.append) as running:
        before = dict(running.pids)
        os.kill(before["one"], signal.SIGKILL)
        until(lambda: running.watch() == "" and running.pids["one"] != before["one"])
        assert running.pids["two"] == before["two"]
        assert is_alive(running.pids["one"])
    assert "'one' ended by signal SIGKILL: it is started again, and no drive goes on by itself" in told


@pytest.mark.usefixtures("soon_hung")
def test_a_hung_process_is_killed_and_restarted(modules: Path) -> None:
    told: list[str] = []
    with Supervision([Process("one", "beats")], environment(modules), told.append) as running:
        pid = running.pids["one"]
        until(lambda: running.watch() == "" and running._running[0].beaten_s is not None)
        os.kill(pid, signal.SIGSTOP)
        until(lambda: running.watch() == "" and running.pids["one"] != pid)
        assert not is_alive(pid)
        assert is_alive(running.pids["one"])
    assert any(sentence.startswith("'one' has hung for ") for sentence in told)


@pytest.mark.usefixtures("soon_hung")
def test_a_process_that_computes_and_one_without_heartbeats_get_more_time(
    modules: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = [Process("one", "computes"), Process("two", "sleeps")]
    monkeypatch.setattr(processes, "IDLE_SHARE", 0.0)
    with Supervision(table, environment(modules)) as running:
        pids = dict(running.pids)
        until(lambda: running.watch() == "" and running._running[0].beaten_s is not None)
        ends = time.monotonic() + 1.0
        while time.monotonic() < ends:
            assert running.watch() == ""
            time.sleep(0.01)
        assert running.pids == pids


@pytest.mark.usefixtures("soon_hung")
@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="this system does not tell who waits")
def test_a_process_that_others_keep_from_the_processor_is_not_hung(
    modules: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes, "_is_held_up", lambda pid: False)  # a look between two of its turns
    cpu = {min(os.sched_getaffinity(0))}
    with (
        subprocess.Popen([sys.executable, "-c", "while True: pass"]) as hog,
        Supervision([Process("one", "computes")], environment(modules)) as running,
    ):
        pid = running.pids["one"]
        until(lambda: running.watch() == "" and running._running[0].beaten_s is not None)
        os.setpriority(os.PRIO_PROCESS, pid, 19)  # the other one gets seventy times as much
        for each in (pid, hog.pid):
            os.sched_setaffinity(each, cpu)
        ends = time.monotonic() + 1.5
        while time.monotonic() < ends:
            assert running.watch() == ""
            time.sleep(0.01)
        hog.kill()
        assert running.pids["one"] == pid


@pytest.mark.usefixtures("soon_hung")
def test_a_process_that_computes_for_too_long_counts_as_hung(modules: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "BUSY_HANG_S", 1.0)
    with Supervision([Process("one", "computes")], environment(modules)) as running:
        pid = running.pids["one"]
        until(lambda: running.watch() == "" and running.pids["one"] != pid)


@pytest.mark.usefixtures("soon_hung")
def test_a_supervisor_that_was_delayed_itself_kills_no_process(modules: Path) -> None:
    with Supervision([Process("one", "beats")], environment(modules)) as running:
        pid = running.pids["one"]
        until(lambda: running.watch() == "" and running._running[0].beaten_s is not None)
        os.kill(pid, signal.SIGSTOP)
        time.sleep(1.5)  # as if the whole computer had been asleep
        assert running.watch() == ""
        os.kill(pid, signal.SIGCONT)
        assert running.watch() == ""
        assert running.pids["one"] == pid


def test_a_process_that_dies_too_often_ends_all(modules: Path) -> None:
    over: list[str] = []
    table = [Process("one", "sleeps"), Process("two", "dies")]
    with Supervision(table, environment(modules)) as running:
        until(lambda: over.append(running.watch()) or over[-1])
        pids = running.pids
    assert over[-1] == "the process 'two' ended with status 3, 5 times in 60 s"
    assert not any(map(is_alive, pids.values()))


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux for the parent's death")
def test_no_process_runs_on_after_a_killed_supervisor(modules: Path) -> None:
    script = textwrap.dedent(
        """
        import os, time
        from waychair.runtime.processes import Process, Supervision
        with Supervision([Process("one", "sleeps"), Process("two", "sleeps")], os.environ) as running:
            print(*running.pids.values(), flush=True)
            time.sleep(600)
        """
    )
    with subprocess.Popen(
        [sys.executable, "-c", script], env=environment(modules), stdout=subprocess.PIPE, text=True
    ) as supervisor:
        assert supervisor.stdout is not None
        pids = [int(word) for word in supervisor.stdout.readline().split()]
        assert len(pids) == 2
        supervisor.kill()
        until(lambda: not any(map(is_alive, pids)))


@pytest.mark.skipif(sys.platform != "linux", reason="real-time priorities as Linux has them")
def test_a_process_has_its_priority_from_its_first_heartbeat_on_where_the_system_permits_it(modules: Path) -> None:
    rows = [Process("starts", "sleeps", priority=2), Process("runs", "beats", priority=2)]

    def policy(name: str) -> tuple[int, int]:
        return os.sched_getscheduler(running.pids[name]), os.sched_getparam(running.pids[name]).sched_priority

    with Supervision(rows, environment(modules)) as running:
        with subprocess.Popen(["sleep", "30"]) as other:
            try:
                os.sched_setscheduler(other.pid, os.SCHED_RR, os.sched_param(2))
                wanted = os.SCHED_RR, 2
            except PermissionError:
                wanted = os.SCHED_OTHER, 0
            other.kill()
        until(lambda: running.watch() or ((modules / "beats.began").exists() and policy("runs") == wanted))
        assert policy("starts") == (os.SCHED_OTHER, 0)


def test_a_signal_is_reported_and_ends_nothing() -> None:
    before = signal.getsignal(signal.SIGUSR1)
    try:
        came = signalled(signal.SIGUSR1)
        assert not came()
        os.kill(os.getpid(), signal.SIGUSR1)
        until(came)
    finally:
        signal.signal(signal.SIGUSR1, before)
