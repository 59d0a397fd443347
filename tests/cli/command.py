"""`waychair` as a user types it. A process of its own spends a second or two on its imports, so few tests start one."""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from waychair.cli.main import main

WAYCHAIR = Path(sys.executable).parent / "waychair"
"""The installed program, for tests of what only a process shows: that it can be started, interrupted and killed."""


def waychair(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """What the program says and returns, run in this process; an error that it does not tell in a sentence is raised."""
    command, said, told, code = [str(WAYCHAIR), *map(str, arguments)], io.StringIO(), io.StringIO(), 0
    with contextlib.ExitStack() as stack:
        stack.enter_context(pytest.MonkeyPatch.context()).setattr(sys, "argv", command)
        stack.enter_context(warnings.catch_warnings())
        warnings.filterwarnings("ignore", "Cyclopts application invoked without tokens")  # as `main` does on purpose
        stack.enter_context(contextlib.redirect_stdout(said))
        stack.enter_context(contextlib.redirect_stderr(told))
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
    return subprocess.CompletedProcess(command, code, said.getvalue(), told.getvalue())


def started(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """The same of the installed program, in a process of its own."""
    command = [str(WAYCHAIR), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def refused(done: subprocess.CompletedProcess[str]) -> str:
    """The one sentence on standard error of a command that failed as it should."""
    assert done.returncode == 1, done.stdout
    assert "Traceback" not in done.stderr
    (sentence,) = [line for line in done.stderr.splitlines() if line.startswith("waychair: ")]
    return sentence
