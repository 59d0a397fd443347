"""The mapping of one recording in a process of its own, on this computer or on a worker of a cluster.

The map is made in a folder beside the others and takes its place as a whole. So a folder under its own name always holds
a finished map, and a killed run goes on from the checkpoint in the other folder.
"""

from __future__ import annotations

import fcntl
import io
import os
import shutil
import signal
import socket
import subprocess
import sys
import tarfile
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from waychair import __version__
from waychair.errors import OutputError, WaychairError
from waychair.files import os_error_text, read_bytes, write_text
from waychair.maps.folders.map_drawing import is_drawn_on
from waychair.offline.many.bags import fingerprint, size_of
from waychair.offline.many.outcomes import RECORD, Outcome, OutcomeState, read_outcome, write_outcome

WORK = ".map-all"
"""Name of the folder for unfinished maps, locks and remembered failures, in the folder of the maps."""

TOKEN = "token"
"""Name of a file by which a worker finds out whether it sees the same folder."""

OF_RECORDING, OUT_OF_MEMORY = 3, 4
"""Exit statuses of a mapping process: the recording cannot be mapped; it needed more memory than allowed."""

_TRIES = 2  # a process that was killed is started once more, and goes on from its checkpoint
_INTERRUPTED = 130
_REPORT = "report.json"


@dataclass(frozen=True, slots=True)
class BagJob:
    """A recording to be mapped, with paths as the worker sees them.

    Attributes:
        name: name of its map's folder in `out`.
        path: of the recording.
        out: folder of all maps.
        fingerprint: of the recording's files and the options (`bags.fingerprint`).
        size: bytes of its files.
        module: the Python module that maps a recording as a process: limit, recording, then options of `waychair map`.
        options: the command's options for all recordings.
        config: text of the settings file, empty for none.
        memory_limit: bytes that the process may use.
        retry_failed: whether a recording that could not be mapped is tried again.
        token: text in the file `TOKEN` of the maps' folder; empty where the worker is on this computer.
    """

    name: str
    path: str
    out: str
    fingerprint: str
    size: int
    module: str
    options: tuple[str, ...]
    config: str
    memory_limit: int
    retry_failed: bool = False
    token: str = ""
    version: str = __version__

    @property
    def work(self) -> Path:
        """The folder in which the map is made."""
        return Path(self.out) / WORK / f"{self.name}.{self.fingerprint[:12]}"

    @property
    def target(self) -> Path:
        """The folder of the finished map."""
        return Path(self.out) / self.name

    def outcome(self, state: OutcomeState, why: str = "") -> Outcome:
        """Return an outcome of this job on this computer."""
        return Outcome(
            self.name, state, self.fingerprint, why, host=socket.gethostname(), memory_limit=self.memory_limit
        )


class Running:
    """The processes that map now, so that all can be interrupted."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._processes: set[subprocess.Popen[bytes]] = set()
        self.stopped = False

    @contextmanager
    def noted(self, process: subprocess.Popen[bytes]) -> Iterator[None]:
        """Keep a process in mind during the block."""
        with self._lock:
            self._processes.add(process)
            late = self.stopped
        if late:
            _signal(process, signal.SIGINT)
        try:
            yield
        finally:
            with self._lock:
                self._processes.discard(process)

    def stop(self, number: signal.Signals = signal.SIGINT) -> None:
        """Send a signal to all processes, and start no further ones; an interrupted one saves its checkpoint first."""
        with self._lock:
            self.stopped = True
            for process in self._processes:
                _signal(process, number)


def _signal(process: subprocess.Popen[bytes], number: signal.Signals) -> None:
    with suppress(ProcessLookupError):
        os.kill(process.pid, number)


def run_bag(job: BagJob, running: Running | None = None) -> Outcome:
    """Map one recording, or return the outcome that an earlier run kept.

    A recording that another process maps into the same folder is waited for.
    """
    if job.version != __version__:
        return job.outcome(
            OutcomeState.STOPPED, f"the worker has waychair {__version__}, not {job.version}: install the same version"
        )
    if job.token and not _is_reached(job):
        return job.outcome(OutcomeState.UNREACHED)
    running = running or Running()
    try:
        with locked(Path(job.out) / WORK / f"{job.name}.lock"):
            return kept_outcome(job) or _mapped(job, running)
    except OSError as error:
        return job.outcome(OutcomeState.STOPPED, f"cannot write {job.out}: {os_error_text(error)}")
    except WaychairError as error:
        return job.outcome(OutcomeState.STOPPED, str(error))


def _is_reached(job: BagJob) -> bool:
    """Whether this computer sees the maps' folder and the recording by the job's paths."""
    try:
        same = (Path(job.out) / WORK / TOKEN).read_text() == job.token
    except (OSError, ValueError):
        return False
    return same and Path(job.path).exists() and size_of(Path(job.path)) == job.size


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold a lock on a file during the block; waits for another holder. The system frees it when a process dies."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _failure_file(job: BagJob) -> Path:
    return Path(job.out) / WORK / f"{job.name}.failed.json"


def kept_outcome(job: BagJob) -> Outcome | None:
    """Return the outcome of an earlier run with the same recording and options; None where it has to be mapped.

    A finished map that was not in its place yet is put there.
    """
    if not job.target.exists():
        finished = read_outcome(job.work / RECORD)
        if finished is not None and finished.fingerprint == job.fingerprint:
            publish(job)
    known = read_outcome(job.target / RECORD)
    if known is not None and known.fingerprint == job.fingerprint and (job.target / _REPORT).is_file():
        return replace(known, name=job.name, kept=True)
    failed = read_outcome(_failure_file(job))
    if failed is None or failed.fingerprint != job.fingerprint or job.retry_failed:
        return None
    return replace(failed, kept=True) if failed.memory_limit >= job.memory_limit else None


def _mapped(job: BagJob, running: Running) -> Outcome:
    """Map the recording and return the outcome, which is kept where the next run needs it.

    Raises:
        OutputError: the map's place is taken by something else, or cannot be written.
    """
    _refuse_taken(job)
    _remove_stale(job)
    job.work.mkdir(parents=True, exist_ok=True)
    path, before = Path(job.path), fingerprint(Path(job.path), ())
    outcome = job.outcome(OutcomeState.STOPPED)
    for _ in range(_TRIES):
        if running.stopped:
            return replace(outcome, why="not begun: the command was stopped")
        outcome, again = _tried(job, outcome, running)
        if not again:
            break
    if outcome.state is OutcomeState.DONE and fingerprint(path, ()) != before:
        return replace(outcome, state=OutcomeState.STOPPED, why=f"{path} changed while it was read: map it again")
    if outcome.state is OutcomeState.DONE:
        write_outcome(job.work / RECORD, outcome)
        publish(job)
    _failure_file(job).unlink(missing_ok=True)
    if outcome.state is OutcomeState.FAILED:
        write_outcome(_failure_file(job), outcome)
        shutil.rmtree(job.work, ignore_errors=True)
    return outcome


def _refuse_taken(job: BagJob) -> None:
    """Refuse to replace anything but a map of this command without places, zones or erased parts.

    Raises:
        OutputError: the map's place is taken.
    """
    if not job.target.exists():
        return
    if read_outcome(job.target / RECORD) is None:
        raise OutputError(f"{job.target} is there already, and not from this command: choose another --out, or move it")
    if is_drawn_on(job.target):
        raise OutputError(
            f"the places, zones or erased parts in {job.target} are those of another map: choose another --out, or move it"
        )


def _remove_stale(job: BagJob) -> None:
    """Remove the unfinished maps of the same name from other files or options."""
    for path in job.work.parent.glob("*"):
        stem, _, digits = path.name.rpartition(".")
        if stem == job.name and len(digits) == 12 and path != job.work and path.is_dir():
            shutil.rmtree(path, ignore_errors=True)


def publish(job: BagJob) -> None:
    """Put a finished map into its place, as a whole.

    Raises:
        OSError: it cannot be moved.
    """
    before = job.work.with_name(f"{job.name}.before")
    shutil.rmtree(before, ignore_errors=True)
    if job.target.exists():
        job.target.rename(before)
    job.work.rename(job.target)
    shutil.rmtree(before, ignore_errors=True)


def _tried(job: BagJob, so_far: Outcome, running: Running) -> tuple[Outcome, bool]:
    """Run the mapping process once; return the outcome with the costs of all tries, and whether to try again."""
    config = job.work.with_name(f"{job.name}.config.yaml")
    if job.config:
        write_text(config, job.config, lasting=False)
    command = [
        sys.executable, "-P", "-m", job.module, str(job.memory_limit), job.path, "--out", str(job.work), "--quiet",
        *job.options, *(("--config", str(config)) if job.config else ()),
    ]  # fmt: skip
    began = time.monotonic()
    process = subprocess.Popen(  # the open pipe is its lifeline: it ends when this process does
        command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
    )
    assert process.stdin is not None
    assert process.stderr is not None
    with running.noted(process), process.stdin, process.stderr:
        said = process.stderr.read().decode(errors="replace")
        _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    peak = usage.ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
    outcome = replace(
        so_far,
        seconds=round(so_far.seconds + time.monotonic() - began, 3),
        cpu_s=round(so_far.cpu_s + usage.ru_utime + usage.ru_stime, 3),
        peak_memory_mb=round(max(so_far.peak_memory_mb, peak), 1),
    )
    return _judged(outcome, process.returncode, said, running)


def _judged(outcome: Outcome, code: int, said: str, running: Running) -> tuple[Outcome, bool]:
    """Return the outcome by a process's exit status and its words, and whether to try again."""
    if code == 0:
        return replace(outcome, state=OutcomeState.DONE, why=""), False
    if running.stopped or code == _INTERRUPTED:
        return replace(outcome, state=OutcomeState.STOPPED, why="interrupted: the same command goes on with it"), False
    if code < 0:
        why = f"its process was killed by signal {-code}, as where memory runs out: the same command goes on with it"
        return replace(outcome, state=OutcomeState.STOPPED, why=why), True
    why = _sentence(said) or f"its process ended with status {code}"
    state = OutcomeState.FAILED if code in (OF_RECORDING, OUT_OF_MEMORY) else OutcomeState.STOPPED
    return replace(outcome, state=state, why=why), False


def _sentence(said: str) -> str:
    """Return the sentence of a failed command, or else its last line."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    own = [line.removeprefix("waychair: ") for line in lines if line.startswith("waychair: ")]
    return own[-1] if own else lines[-1] if lines else ""


def packed(path: Path) -> bytes:
    """Return a file or folder as the bytes of a tar file, under its own name.

    Raises:
        OSError: it cannot be read.
    """
    data = io.BytesIO()
    with tarfile.open(fileobj=data, mode="w") as tar:
        tar.add(path, arcname=path.name)
    return data.getvalue()


def unpacked(data: bytes, folder: Path) -> None:
    """Unpack the bytes of `packed` into a folder.

    Raises:
        OSError: it cannot be written.
    """
    with tarfile.open(fileobj=io.BytesIO(data)) as tar:
        tar.extractall(folder, filter="data")


def run_sent_bag(job: BagJob, recording: bytes) -> tuple[Outcome, bytes]:
    """Map a recording that was sent; return the outcome, and the packed map folder, empty without a map."""
    with tempfile.TemporaryDirectory(prefix="waychair-map-all-") as temporary:
        folder = Path(temporary)
        unpacked(recording, folder / "recording")
        name, out = Path(job.path).name, folder / "maps"
        outcome = run_bag(replace(job, path=str(folder / "recording" / name), out=str(out), token=""))
        return outcome, packed(out / job.name) if outcome.state is OutcomeState.DONE else b""


def receive(job: BagJob, outcome: Outcome, maps: bytes) -> None:
    """Put the map that a worker sent back into its place, and keep the outcome.

    Raises:
        OutputError: the map's place is taken.
        OSError: it cannot be written.
    """
    with locked(Path(job.out) / WORK / f"{job.name}.lock"):
        if outcome.state is OutcomeState.FAILED:
            write_outcome(_failure_file(job), outcome)
        if outcome.state is not OutcomeState.DONE:
            return
        _refuse_taken(job)
        shutil.rmtree(job.work, ignore_errors=True)
        with tempfile.TemporaryDirectory(dir=job.work.parent) as temporary:
            unpacked(maps, Path(temporary))
            (Path(temporary) / job.name).rename(job.work)
        read_bytes(job.work / RECORD, OutputError)
        publish(job)
        _failure_file(job).unlink(missing_ok=True)
