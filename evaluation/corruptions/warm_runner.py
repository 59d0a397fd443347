"""Runs of `waychair map`, each in a process of its own, forked from one that has imported everything and mapped once.

`python -m evaluation.corruptions.warm_runner RECORDING ...` answers each line of JSON on its standard input by one on its
standard output. A run is forked, so that it costs neither the start of the interpreter nor the loading of kernels, and
shares nothing with other runs.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

MOST_MEMORY = 6 << 30
"""Address space of a run [bytes]: more would disturb the machine; a run that asks for it has long failed its bar."""
_GRACE_S = 5.0  # of processor time, over the limit


@dataclass(frozen=True, slots=True)
class FinishedRun:
    """A finished run: exit status (negative: the signal), text, processor time [s], wall time [s], peak memory [MB]."""

    status: int
    text: str
    cpu_s: float
    wall_s: float
    memory_mb: float


class WarmRunner:
    """The warm process; a context manager."""

    def __init__(self, recordings: list[Path]) -> None:
        """Begin the process, which maps each of the `recordings` once."""
        command = [sys.executable, "-m", "evaluation.corruptions.warm_runner", *map(str, recordings)]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()

    def run(self, arguments: list[str], limit_s: float) -> FinishedRun:
        """Return a run of the command line with arguments; it is ended after `limit_s` of processor time."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps({"arguments": arguments, "limit_s": limit_s}) + "\n")
        self._process.stdin.flush()
        return FinishedRun(**json.loads(self._process.stdout.readline()))


def _forked(arguments: list[str], limit_s: float) -> FinishedRun:
    with tempfile.TemporaryFile("w+") as output:
        began = time.perf_counter()
        child = os.fork()
        if child == 0:
            _be_the_command(arguments, limit_s, output.fileno())
        # a run that sleeps for ever uses no processor time
        late = threading.Timer(30.0 * limit_s, os.kill, (child, signal.SIGKILL))
        late.start()
        _, status, used = os.wait4(child, 0)
        late.cancel()
        wall_s = time.perf_counter() - began
        output.seek(0)
        text = output.read()
    code = os.waitstatus_to_exitcode(status)
    return FinishedRun(code, text, used.ru_utime + used.ru_stime, wall_s, used.ru_maxrss / 1e3)


def _be_the_command(arguments: list[str], limit_s: float, output: int) -> None:
    """Never return: run the command line in this process, with all output into a file."""
    code = 70
    try:
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(output, 1)
        os.dup2(output, 2)
        seconds = int(limit_s + _GRACE_S)
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
        resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
        sys.argv = ["waychair", *arguments]
        from waychair.cli.main import main

        main()
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(bool(end.code))
    except BaseException:  # noqa: BLE001  # it is printed, and ends this process
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _serve(recordings: list[str]) -> None:
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    from waychair.cli.main import app

    for recording in recordings:
        with tempfile.TemporaryDirectory() as folder:
            app(["map", recording, "--out", folder, "--quiet"], result_action="return_value")
    for line in sys.stdin:
        asked = json.loads(line)
        answers.write(json.dumps(asdict(_forked(asked["arguments"], asked["limit_s"]))) + "\n")
        answers.flush()


if __name__ == "__main__":
    _serve(sys.argv[1:])
